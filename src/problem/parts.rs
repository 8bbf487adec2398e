//! The templates that a template includes, extends or imports, and where they may be.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use super::generate::spelling;
use super::{Request, Syntax, TemplatePart, minijinja};
use crate::formats::{Diagnostic, Source, nearest};
use crate::input::decode;

/// How many files of a folder are looked at for a message, and how many are shown.
const MOST_LOOKED_AT: usize = 1_000;
const MOST_SHOWN: usize = 8;

/// Reads the templates that a template includes, extends or imports, and those that these do, from the first of the
/// folders that has one. A name leads to a file inside of its folder: it is relative, without `..`, and no symbolic
/// link on the way leads out.
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
                    let part = read(&path, |message| complain(format!("`{}`: {message}", reference.name)))?;
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
                    let error = complain(format!("there is no template `{}`", reference.name)).hint(looked);
                    return Err(match there(&reference.name, folders, &source) {
                        Some(hint) => error.hint(hint),
                        None => error,
                    });
                }
            }
        }
    }
    Ok(parts)
}

/// What there is instead of a template: the one most like it, else those beside where it would be.
fn there(name: &str, folders: &[PathBuf], from: &Source) -> Option<String> {
    let path = Path::new(name);
    let inner = path.parent().unwrap_or(Path::new(""));
    let mut names: BTreeSet<String> = BTreeSet::new();
    for folder in folders {
        for place in [inner, Path::new("")] {
            let Ok(entries) = fs::read_dir(Path::new(".").join(folder).join(place)) else { continue };
            let files = entries.filter_map(Result::ok).filter(|entry| entry.path().is_file()).take(MOST_LOOKED_AT);
            let files = files.filter(|entry| Path::new(&entry.file_name()).extension() == path.extension());
            let files = files.filter(|entry| folder.join(place).join(entry.file_name()) != Path::new(from.name()));
            names.extend(files.map(|entry| place.join(entry.file_name()).display().to_string()));
        }
    }
    if let Some(near) = nearest(name, names.iter().map(String::as_str)) {
        return Some(format!("did you mean `{near}`?"));
    }
    let rest = names.len().saturating_sub(MOST_SHOWN);
    let shown: Vec<String> = names.into_iter().take(MOST_SHOWN).collect();
    match (shown.as_slice(), rest) {
        ([], _) => None,
        (shown, 0) => Some(format!("there is {}", shown.join(", "))),
        (shown, rest) => Some(format!("there is {}, and {rest} more", shown.join(", "))),
    }
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

/// The text of a file; one that is not UTF-8 is shown at its place there.
fn read(path: &Path, complain: impl Fn(String) -> Diagnostic) -> Result<Source, Diagnostic> {
    let failed = |error: std::io::Error| complain(format!("cannot read {}: {error}", path.display()));
    // A pipe would be waited for.
    if !fs::metadata(path).map_err(failed)?.is_file() {
        return Err(complain(format!("{} is not a file", path.display())));
    }
    decode(&path.display().to_string(), fs::read(path).map_err(failed)?).map(Source::without_mark)
}
