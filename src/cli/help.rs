//! The help of rmem itself: its commands in groups.

use clap::Command;

/// The groups, and the commands of each in the order of the help.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Memory",
        &[
            "insert",
            "query",
            "count",
            "distinct",
            "aggregate",
            "map-reduce",
            "update",
            "find-and-modify",
            "delete",
            "index",
            "create",
            "coll-mod",
            "rename",
            "collections",
            "schema",
            "drop",
            "history",
            "undo",
            "record",
            "watch",
            "computables",
            "expire",
        ],
    ),
    ("Problems and plans", &["gen-problem", "import-problem", "plan", "compare", "validate", "ff"]),
    ("World models", &["dump", "restore", "diff", "scene"]),
    ("CLIPS", &["clips"]),
    ("Robots", &["serve", "lock", "unlock", "backend"]),
    (
        "Tools",
        &[
            "init",
            "view",
            "plot",
            "export",
            "backup",
            "repair",
            "bench",
            "config",
            "doctor",
            "completions",
            "man",
            "exit-codes",
            "help",
        ],
    ),
];

/// Returns the command line with its commands in groups.
pub(super) fn grouped(command: Command) -> Command {
    let width = command.get_subcommands().map(|command| command.get_name().len()).max().unwrap_or_default();
    let groups: Vec<String> = GROUPS.iter().map(|(title, names)| group(title, names, &command, width)).collect();
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}\nGlobal options:\n{{options}}{{after-help}}",
        groups.join("\n")
    );
    command.help_template(template)
}

/// Returns the command line with the paragraphs below each help in one line each, so that they wrap at any width.
pub(super) fn flowing(mut command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    for name in names {
        command = command.mut_subcommand(name, flowing);
    }
    match command.get_after_help().map(|text| joined(&text.to_string())) {
        Some(text) => command.after_help(text),
        None => command,
    }
}

/// Joins the lines of each paragraph. Indented lines, and texts in another language (`(deftemplate …`, `[[table]]`),
/// stay as they are.
fn joined(text: &str) -> String {
    let paragraphs = text.split("\n\n").map(|paragraph| match paragraph.starts_with(['(', '[']) {
        true => paragraph.to_owned(),
        false => flow(paragraph),
    });
    paragraphs.collect::<Vec<_>>().join("\n\n")
}

fn flow(paragraph: &str) -> String {
    let mut flowing = String::new();
    let mut before = " ";
    for line in paragraph.lines() {
        let goes_on = !line.starts_with(' ') && !before.starts_with(' ');
        if !flowing.is_empty() {
            flowing.push(if goes_on { ' ' } else { '\n' });
        }
        flowing.push_str(line);
        before = line;
    }
    flowing
}

fn group(title: &str, names: &[&str], command: &Command, width: usize) -> String {
    // A build without a feature lacks its command.
    let present = |name: &&&str| **name == "help" || command.find_subcommand(name).is_some();
    let lines = names.iter().filter(present).map(|name| {
        let about = command.find_subcommand(name).and_then(Command::get_about).map(ToString::to_string);
        let about = about.unwrap_or_else(|| "Print the help of a command".to_owned());
        format!("  {name:width$}  {about}\n")
    });
    format!("{title}:\n{}", lines.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_one_group() {
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        let command = crate::cli::command();
        let mut commands: Vec<&str> = command.get_subcommands().map(Command::get_name).chain(["help"]).collect();
        grouped.sort_unstable();
        commands.sort_unstable();
        assert_eq!(grouped, commands);
    }

    /// All commands and subcommands.
    fn all(command: &Command) -> Vec<Command> {
        let below = command.get_subcommands().flat_map(all);
        std::iter::once(command.clone()).chain(below).collect()
    }

    #[test]
    fn no_line_of_a_paragraph_is_broken_before_the_width_is_used() {
        for width in [80, 100] {
            for mut command in all(&crate::cli::command()) {
                let help = command.clone().term_width(width).render_help().to_string();
                let lines: Vec<&str> = help.lines().collect();
                for pair in lines.windows(2) {
                    let is_prose = |line: &str| line.starts_with(char::is_alphabetic) && !line.ends_with(':');
                    let next = pair[1].split(' ').next().unwrap_or_default();
                    let fits = pair[0].chars().count() + 1 + next.chars().count() <= width;
                    let is_broken = is_prose(pair[0]) && is_prose(pair[1]) && fits && !pair[1].contains(" = ");
                    assert!(!is_broken, "{} at {width}:\n{}\n{}", command.get_name(), pair[0], pair[1]);
                }
                command.build();
            }
        }
    }

    /// What a shell would put a variable or a program's output in the place of.
    fn expansions(text: &str) -> Vec<&str> {
        let (mut quote, mut is_escaped, mut found) = (None, false, Vec::new());
        for (at, c) in text.char_indices() {
            match c {
                _ if is_escaped => is_escaped = false,
                '\\' if quote != Some('\'') => is_escaped = true,
                '\'' | '"' if quote.is_none() => quote = Some(c),
                c if quote == Some(c) => quote = None,
                '$' | '`' if quote != Some('\'') => found.push(&text[at..]),
                _ => {}
            }
        }
        found
    }

    #[test]
    fn examples_can_be_pasted_into_a_shell() {
        for command in all(&crate::cli::command()) {
            let Some(help) = command.get_after_help().map(ToString::to_string) else { continue };
            for paragraph in help.split("\n\n").filter(|paragraph| paragraph.starts_with("Example")) {
                let name = command.get_name();
                assert_eq!(expansions(paragraph), [""; 0], "{name}");
                for line in paragraph.lines() {
                    assert!(line.chars().count() <= 100, "{name}, wrapped: {line}");
                }
            }
        }
    }

    #[test]
    fn the_list_of_commands_fits_80_columns() {
        let command = crate::cli::command();
        let width = 18;
        for about in command.get_subcommands().filter_map(Command::get_about) {
            assert!(width + about.to_string().len() <= 80, "{about}");
        }
    }
}
