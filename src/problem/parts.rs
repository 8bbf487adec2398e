//! The templates that a template includes, extends or imports, and where they may be.

use std::fs;
use std::path::{Component, Path, PathBuf};

use super::generate::spelling;
use super::{Request, Syntax, TemplatePart, minijinja};
use crate::formats::{Diagnostic, Source};
use crate::input::decode;

/// Reads the templates that a template includes, extends or imports, and those that these do, from the first of the folders that
/// has one. A name leads to a file inside of its folder: it is relative, without `..`, and no symbolic link on the way leads out.
///
/// # Errors
/// A name that leads out of the folders, or to no file, at its place.
pub fn read_parts(request: &Request, folders: &[PathBuf]) -> Result<Vec<TemplatePart>, Diagnostic> {
    let mut parts: Vec<TemplatePart> = Vec::new();
    if spelling(request)? == Syntax::Marker {
        return Ok(parts);
    }
    let mut todo = vec![request.template.clone()];
    while let Some(source) = todo.pop() {
        for reference in minijinja::references(source.text()) {
            if parts.iter().any(|part| part.name == reference.name) {
                continue;
            }
            let complain = |message: String| Diagnostic::new(&source, reference.span, message);
            match find(&reference.name, folders).map_err(complain)? {
                Some(path) => {
                    let part = read(&path).map_err(|message| complain(format!("`{}`: {message}", reference.name)))?;
                    todo.push(part.clone());
                    parts.push(TemplatePart { name: reference.name, source: part });
                }
                None if reference.is_optional => {}
                None => {
                    let looked: Vec<String> = folders.iter().map(|folder| shown(folder)).collect();
                    let looked = match looked.as_slice() {
                        [] => "a template from stdin has no folder; name one with --template-path".to_owned(),
                        looked => format!("looked for it in {}; --template-path names more folders", looked.join(", ")),
                    };
                    return Err(complain(format!("there is no template `{}`", reference.name)).hint(looked));
                }
            }
        }
    }
    Ok(parts)
}

fn shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() { ".".to_owned() } else { folder.display().to_string() }
}

/// The file of a name in the first of the folders that has it.
fn find(name: &str, folders: &[PathBuf]) -> Result<Option<PathBuf>, String> {
    let path = Path::new(name);
    let is_inside = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if name.is_empty() || !is_inside || name.contains(['\\', '\0']) {
        return Err(format!("`{}` leads out of the folders of templates", name.escape_debug()));
    }
    for folder in folders {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let candidate = folder.join(path);
        if candidate.symlink_metadata().is_err() {
            continue;
        }
        let real =
            |path: &Path| path.canonicalize().map_err(|error| format!("cannot read {}: {error}", path.display()));
        if !real(&candidate)?.starts_with(real(folder)?) {
            return Err(format!("`{name}` is a symbolic link out of {}", folder.display()));
        }
        return Ok(Some(candidate.strip_prefix(".").map_or_else(|_| candidate.clone(), Path::to_path_buf)));
    }
    Ok(None)
}

fn read(path: &Path) -> Result<Source, String> {
    let failed = |error: std::io::Error| format!("cannot read {}: {error}", path.display());
    // A pipe would be waited for.
    if !fs::metadata(path).map_err(failed)?.is_file() {
        return Err(format!("{} is not a file", path.display()));
    }
    decode(&path.display().to_string(), fs::read(path).map_err(failed)?).map_err(|error| error.to_string())
}
