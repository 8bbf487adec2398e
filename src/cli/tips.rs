//! Commands that a word of another tool stands for.

use std::ffi::OsString;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};

use crate::formats::command_line::word;
use crate::formats::mongosh;
use crate::store::Namespace;

/// Words of mongosh, SQL, Unix and planners, and the command of rmem for each.
const TIPS: [(&[&str], &str); 22] = [
    (&["get", "select", "search"], "'rmem query NS [QUERY]' prints documents"),
    (&["save", "write"], "'rmem dump' writes collections, 'rmem clips export' writes CLIPS facts"),
    (
        &["import", "load"],
        "'rmem restore' reads dumps and world files, 'rmem insert --file' documents, 'rmem clips import' CLIPS facts, and 'rmem import-problem' PDDL problems",
    ),
    (&["rm", "del"], "'rmem delete NS QUERY' removes documents"),
    (&["replace", "upsert", "set"], "'rmem update NS QUERY UPDATE [--replace] [--upsert]' changes documents"),
    (&["add", "put", "store"], "'rmem insert NS DOC' stores documents"),
    (&["ls", "list", "show", "tables", "databases"], "'rmem collections' lists collections, 'rmem plan list' plans"),
    (&["solve", "search-plan", "planner"], "'rmem plan' finds a plan"),
    (&["generate", "render", "problem", "template"], "'rmem gen-problem' generates a PDDL problem"),
    (&["check", "val", "simulate", "parse"], "'rmem validate' checks PDDL files and plans"),
    (&["listen", "subscribe", "tail", "trigger", "monitor"], "'rmem watch NS [QUERY]' prints changes as they happen"),
    (&["indexes"], "'rmem index NS [KEYS]' creates and lists indexes"),
    (&["group", "pipeline"], "'rmem aggregate NS PIPELINE' runs a pipeline"),
    (&["log", "changes", "audit"], "'rmem history NS' prints what changed, 'rmem watch NS' what changes"),
    (
        &["revert", "rollback", "restore-point"],
        "'rmem undo NS' takes changes back, 'rmem query NS --at TIME' reads what was",
    ),
    (&["new", "setup", "scaffold"], "'rmem init [DIR]' makes a project to begin with"),
    (&["benchmark", "evaluate"], "'rmem compare' compares planners, 'rmem bench' measures the memory"),
    (
        &["replan", "execute", "run"],
        "'rmem plan rerun last' plans again, 'rmem plan step' notes execution, 'rmem clips run' runs CLIPS",
    ),
    (&["use", "db"], TIP_OF_USE),
    (&["describe", "stats", "fields"], "'rmem schema NS' prints the fields of documents"),
    (&["why", "explain"], "'rmem plan why' says where a plan is from, 'rmem gen-problem --explain ATOM' an atom"),
    (&["settings", "status", "info", "env"], "'rmem config' prints the settings, 'rmem doctor' checks them"),
];

/// The commands of features, of which this program may have been built without some.
const FEATURES: [(&str, &str); 3] = [("serve", "serve"), ("view", "views"), ("export", "views")];

/// The tip for `use DATABASE` in one word.
const TIP_OF_USE: &str = "a collection is named with its database, as in 'rmem query robmem.worldmodel'";

/// Adds a tip to the error of the command line `args`: for an unknown command, or for a line of mongosh, where `db` is
/// `database`.
pub(super) fn with_tip(mut error: Error, args: &[OsString], database: &str) -> Error {
    if let Some(error) = with_number(&error) {
        return error;
    }
    let (kind, value) = match error.kind() {
        ErrorKind::InvalidSubcommand => (ContextKind::InvalidSubcommand, ContextKind::SuggestedSubcommand),
        ErrorKind::ValueValidation => (ContextKind::InvalidValue, ContextKind::SuggestedValue),
        ErrorKind::UnknownArgument => return with_option(error, args),
        ErrorKind::MissingRequiredArgument => return with_missing(error),
        _ => return error,
    };
    let Some(ContextValue::String(word)) = error.get(kind) else { return error };
    let lower = word.to_ascii_lowercase();
    let is_command = error.kind() == ErrorKind::InvalidSubcommand;
    let known = || TIPS.iter().find(|(words, _)| is_command && words.contains(&lower.as_str()));
    let feature = FEATURES.iter().find(|(command, _)| is_command && *command == lower);
    let feature = feature.map(|(command, feature)| {
        format!("this rmem was built without '{command}'; build it with the feature {feature}, as `cargo install --path .` does")
    });
    let tip = mongosh::command(word, database).map(|command| format!("write: {command}"));
    let tip = tip.or_else(|| mongosh::advice(word, database));
    let tip = tip.or_else(|| lower.starts_with("use ").then(|| TIP_OF_USE.to_owned()));
    let method = || is_command.then(|| mongosh::advice_on_method(word, database)).flatten();
    let files = || is_command.then(|| of_domain(word, args, &error)).flatten();
    let documents = || is_command.then(|| of_namespace(word, &error)).flatten();
    let known = || known().map(|(_, tip)| (*tip).to_owned());
    let first = || (!is_command && is_of_namespace(&error)).then(|| collection_first(word)).flatten();
    if let Some(tip) = feature.or(tip).or_else(known).or_else(method).or_else(files).or_else(documents).or_else(first) {
        error.remove(value);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

/// The error for a value that is not a number, without the words of the reader of numbers.
fn with_number(error: &Error) -> Option<Error> {
    let source = std::error::Error::source(error)?;
    let expected = match source.downcast_ref::<ParseIntError>().map(ParseIntError::kind) {
        Some(IntErrorKind::PosOverflow | IntErrorKind::NegOverflow) => "the number is too large".to_owned(),
        Some(_) => "expected a whole number, like 10".to_owned(),
        None if source.is::<ParseFloatError>() => "expected a number, like 0.5".to_owned(),
        None => of_range(&source.to_string())?,
    };
    let context = |kind| error.get(kind).map(ToString::to_string);
    let (value, argument) = (context(ContextKind::InvalidValue)?, context(ContextKind::InvalidArg)?);
    let message =
        format!("invalid value '{value}' for '{argument}': {expected}\n\nFor more information, try '--help'.\n");
    Some(Error::raw(ErrorKind::ValueValidation, message))
}

/// What is expected where a message says that a number `is not in 1..=100`, or in `1..` and the largest number.
fn of_range(message: &str) -> Option<String> {
    let (least, most) = message.split_once(" is not in ")?.1.split_once("..")?;
    Some(match most.strip_prefix('=') {
        Some(most) => format!("expected a whole number from {least} to {most}"),
        None => format!("expected a whole number from {least} on"),
    })
}

/// Whether the value is that of a collection.
fn is_of_namespace(error: &Error) -> bool {
    error.get(ContextKind::InvalidArg).is_some_and(|argument| argument.to_string().contains("<NS>"))
}

/// The tip for a document in the place of the collection.
fn collection_first(text: &str) -> Option<String> {
    let is_document = text.trim_start().starts_with(['{', '[']);
    is_document.then(|| format!("the collection stands in front of it: robmem.worldmodel {}", word(text)))
}

/// What to write where an argument is missing.
const MISSING: [(&str, &str); 4] = [
    ("update", "the query stands before the update; '{}' is the query for all documents"),
    ("find-and-modify", "the query stands before the update, '{}' for all documents; --remove needs no update"),
    ("distinct", "the field stands behind the collection: rmem distinct robmem.worldmodel object"),
    ("dump", "--all writes all collections"),
];

/// Adds a tip to the error for a missing argument.
fn with_missing(mut error: Error) -> Error {
    let usage = error.get(ContextKind::Usage).map(ToString::to_string).unwrap_or_default();
    if let Some((_, tip)) = MISSING.iter().find(|(command, _)| usage.contains(&format!("rmem {command} "))) {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![(*tip).into()]));
    }
    error
}

/// Options of mongosh and MongoDB's tools, and what rmem has for each.
const OPTIONS: [(&[&str], &str); 7] = [
    (&["--projection", "--project"], "'--fields PROJECTION' selects fields"),
    (&["-n"], "'--limit N' limits how many are printed"),
    (&["--pretty"], "'--format' has other formats; see the help of the command"),
    (&["--db", "--database"], TIP_OF_USE),
    (
        &["--nsInclude", "--nsFrom", "--nsTo"],
        "'rmem dump NS' writes one collection, 'rmem restore --into NS' reads one",
    ),
    (&["--port", "--bind", "--bind_ip", "--host"], "'rmem serve --listen HOST:PORT' listens there, as :27017"),
    (&["--dbpath", "--replSet"], "'--memory file:PATH' names the memory; for several robots, see 'rmem backend up'"),
];

/// Adds a tip to the error for an argument that a command does not have.
fn with_option(mut error: Error, args: &[OsString]) -> Error {
    let Some(ContextValue::String(argument)) = error.get(ContextKind::InvalidArg) else { return error };
    let usage = error.get(ContextKind::Usage).map(ToString::to_string).unwrap_or_default();
    let is_of = |name: &str| usage.contains(&format!("rmem {name} "));
    let known = || OPTIONS.iter().find(|(names, _)| names.contains(&argument.split('=').next().unwrap_or_default()));
    let tip = match argument.as_str() {
        fields if fields.starts_with('{') && is_of("query") => Some(format!("write: --fields {}", word(fields))),
        options if options.starts_with('{') && is_of("update") => {
            let flags = [("upsert", " --upsert"), ("multi", " --many")];
            let flags: String =
                flags.iter().filter(|(name, _)| options.contains(name)).map(|(_, flag)| *flag).collect();
            (!flags.is_empty()).then(|| format!("write:{flags}"))
        }
        number if is_negative(number) => of_negative(number, args)
            .or_else(|| is_of("query").then(|| "all documents are printed without '--limit'".to_owned())),
        "--all" if is_of("update") => Some("'--many' changes all documents that match".to_owned()),
        "--query" | "--filter" | "--where" if usage.contains("QUERY") => {
            Some("the query stands behind the collection, without an option: NS '{name: 1}'".to_owned())
        }
        file if is_of("gen-problem") && is_of_task(file) => Some(format!("write: --template {}", word(file))),
        template if is_of("gen-problem") && !template.starts_with('-') => {
            Some(format!("write: --template {}", word(template)))
        }
        _ if usage.contains("rmem collections") => Some(
            "'rmem collections' lists all; 'rmem schema NS' prints the fields of one, 'rmem count NS' counts"
                .to_owned(),
        ),
        value if is_of("query") && !value.starts_with('-') => {
            Some("a query is one argument: robmem.worldmodel \"{name: 'A'}\"".to_owned())
        }
        "--explain" if is_of("plan") => {
            Some("'rmem gen-problem --explain ATOM' explains an atom, and 'rmem plan why' a plan".to_owned())
        }
        _ => known().map(|(_, tip)| (*tip).to_owned()),
    };
    if let Some(tip) = tip {
        error.remove(ContextKind::SuggestedArg);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

/// Whether an argument is a negative number, or its beginning: of `-29m`, `-2` is what clap takes for an option.
fn is_negative(argument: &str) -> bool {
    argument.strip_prefix('-').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
}

/// The tip for a negative value of an option. Behind `--`, as clap proposes, it would be no value of the option.
fn of_negative(number: &str, args: &[OsString]) -> Option<String> {
    let pairs = args.windows(2).filter_map(|pair| Some((pair[0].to_str()?, pair[1].to_str()?)));
    let (option, value) =
        pairs.into_iter().find(|(option, value)| option.starts_with("--") && value.starts_with(number))?;
    let positive = value.trim_start_matches('-');
    Some(match option {
        "--at" | "--since" => format!("a time that is past has no sign: {option} {positive}"),
        "--limit" => "all documents are printed without '--limit'".to_owned(),
        _ if value.parse::<f64>().is_ok() => format!("'{option}' takes no negative number"),
        _ => format!("'{option}' takes no negative value"),
    })
}

/// Whether an argument is the name of a domain, a problem or a template.
fn is_of_task(file: &str) -> bool {
    [".pddl", ".j2", ".tmpl"].iter().any(|end| file.ends_with(end))
}

/// The tip for the files of a task behind `plan`, as planners take them.
fn of_domain(file: &str, args: &[OsString], error: &Error) -> Option<String> {
    let usage = error.get(ContextKind::Usage).map(ToString::to_string).unwrap_or_default();
    let is_file = is_of_task(file);
    let file = word(file);
    // The usage names `--domain` whether or not it is there.
    let is_domain = |word: &str| word.starts_with("--domain") || (word.starts_with("-d") && !word.starts_with("--"));
    let has_domain = args.iter().any(|word| word.to_str().is_some_and(is_domain));
    (is_file && usage.contains("rmem plan")).then(|| match has_domain {
        true if file.contains(".pddl") && !file.contains(".pddl.") => format!("write: --problem {file}"),
        true => format!("write: --template {file}"),
        false => format!("write: rmem plan --domain {file} --problem FILE, or --template FILE for one with queries"),
    })
}

/// The tip for a collection or a database in the place of a command.
fn of_namespace(word: &str, error: &Error) -> Option<String> {
    let usage = error.get(ContextKind::Usage).map(ToString::to_string).unwrap_or_default();
    let is_export = usage.contains(" export ");
    if is_export && format!("{word}.x").parse::<Namespace>().is_ok_and(|namespace| namespace.database == word) {
        return Some(format!(
            "'rmem dump {word}.COLLECTION -o FILE.json' and 'rmem clips export {word}.COLLECTION' write documents, and 'rmem dump --all -o FOLDER' all"
        ));
    }
    word.parse::<Namespace>().ok()?;
    Some(match is_export {
        true => format!("'rmem dump {word} -o FILE.json' and 'rmem clips export {word}' write its documents"),
        false => format!("'rmem query {word}' prints its documents"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tip_names_commands_and_is_given_for_no_command() {
        let command = crate::cli::command();
        for (words, tip) in TIPS {
            // These words mean something else outside of mongosh.
            let is_method = |word: &&&str| mongosh::advice_on_method(word, "lab").is_some();
            assert!(
                words.iter().filter(is_method).all(|word| ["save", "stats", "explain"].contains(word)),
                "{words:?}"
            );
            assert!(words.iter().all(|word| command.find_subcommand(word).is_none()), "{words:?}");
            for name in tip.split("'rmem ").skip(1).map(|rest| rest.split([' ', '\'']).next().unwrap_or_default()) {
                assert!(command.find_subcommand(name).is_some(), "{name}");
            }
        }
    }
}
