//! The templates that a template includes, extends or imports, and where they may be.

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

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
    let mut computed = Computed::default();
    if spelling(request)? == Syntax::Marker {
        return Ok(parts);
    }
    let mut todo = vec![request.template.clone()];
    while let Some(source) = todo.pop() {
        computed.look_at(&source);
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
        if todo.is_empty() {
            todo = computed.find(request, folders, &mut parts);
        }
    }
    Ok(parts)
}

/// What names may be computed from: the texts in quotes of all templates, and parameters.
#[derive(Default)]
struct Computed {
    /// Whether a template computes a name at all.
    is_any: bool,
    /// Names that were not looked for yet, and those that were.
    next: Vec<String>,
    known: HashSet<String>,
}

impl Computed {
    fn look_at(&mut self, source: &Source) {
        self.is_any |= minijinja::computes_names(source.text());
        self.next.extend(minijinja::quoted_texts(source.text()).map(str::to_owned));
    }

    /// Adds the templates that have such a name, and returns them.
    fn find(&mut self, request: &Request, folders: &[PathBuf], parts: &mut Vec<TemplatePart>) -> Vec<Source> {
        let mut found = Vec::new();
        if !self.is_any {
            return found;
        }
        let parameters = request.parameters.iter().filter_map(|(_, value)| value.as_str()).map(str::to_owned);
        for name in std::mem::take(&mut self.next).into_iter().chain(parameters) {
            if !self.known.insert(name.clone()) || parts.iter().any(|part| part.name == name) {
                continue;
            }
            // Most texts are no names; one that leads out is refused where it is used.
            let Ok(Some(path)) = find(&name, folders) else { continue };
            let Ok(source) = read(&path, |message| Diagnostic::at(&name, 1, 1, message)) else { continue };
            found.push(source.clone());
            parts.push(TemplatePart { name, source });
        }
        found
    }
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
    if !minijinja::is_inside(name) {
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
