//! Files that programs load, found in the folders of their search path, by the names of Fawkes.

use super::arguments::Arguments;
use super::failure::Failure;
use super::function::{Function, function, open};
use crate::clips::engine::load;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::search_path::MOST_OPEN;
use crate::clips::engine::state::State;
use crate::input::{decode_clips, read_file};

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["path-load", "path-load*", "path-batch", "path-batch*"], 1, 1, load),
    function(&["path-resolve", "resolve-file"], 1, 1, |state, _, arguments| {
        let found = state.search.find(arguments.text(1)?);
        Ok(found.map_or_else(|| Value::truth(false), |path| Value::Text(path.display().to_string())))
    }),
    open(&["path-add"], 1, |state, _, arguments| {
        for folder in arguments.rest(1) {
            let (Value::Text(folder) | Value::Symbol(folder)) = folder else {
                return Err(Failure::wrong("expected names of folders"));
            };
            if !state.search.add(folder) {
                return Err(Failure::Declined(format!("the name of the folder {folder} is too long")));
            }
        }
        Ok(Value::truth(true))
    }),
    function(&["path-add-subst"], 2, 2, |state, _, arguments| {
        state.search.substitute(arguments.text(1)?, arguments.text(2)?);
        Ok(Value::truth(true))
    }),
    function(&["path-get", "get-clips-dirs"], 0, 0, |state, _, _| {
        Ok(Value::Many(state.search.folders().into_iter().map(Value::Text).collect()))
    }),
];

/// `(path-load FILE)`: constructs, and commands among them.
fn load(state: &State<'_>, clips: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let name = arguments.text(1)?;
    if state.is_loading() {
        return Err(Failure::Declined(format!("{name} cannot be loaded while a construct is being loaded")));
    }
    let Some(path) = state.search.find(name) else {
        let folders = state.search.folders().join(", ");
        return Err(Failure::Declined(format!("no file {name} in {folders}; --path names other folders")));
    };
    let shown = path.display().to_string();
    let bytes = read_file(&path).map_err(Failure::declined)?;
    let program = decode_clips(&shown, bytes).map_err(Failure::declined)?;
    let Some(_opened) = state.search.open(&path) else {
        let message = format!("{shown} is being loaded already, or files load one another more than {MOST_OPEN} deep");
        return Err(Failure::Declined(message));
    };
    let loaded = load::program(&program, clips, state);
    for complaint in &loaded.complaints {
        clips.complain(complaint.to_string().trim_end());
    }
    Ok(Value::truth(loaded.complaints.is_empty()))
}
