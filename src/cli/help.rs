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
            "delete",
            "index",
            "collections",
            "schema",
            "drop",
            "watch",
            "computables",
            "expire",
        ],
    ),
    ("Problems and plans", &["gen-problem", "import-problem", "plan", "validate", "ff"]),
    ("World models", &["dump", "restore", "diff", "scene"]),
    ("CLIPS", &["clips"]),
    ("Robots", &["serve", "lock", "unlock", "backend"]),
    (
        "Tools",
        &[
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

    #[test]
    fn the_list_of_commands_fits_80_columns() {
        let command = crate::cli::command();
        let width = 18;
        for about in command.get_subcommands().filter_map(Command::get_about) {
            assert!(width + about.to_string().len() <= 80, "{about}");
        }
    }
}
