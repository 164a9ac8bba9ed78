//! Help as wide as its reader's terminal.

use clap::Command;

/// A command, and those below it, whose texts behind the options are broken where the terminal ends and nowhere else.
///
/// In the source they are broken for who reads that; a terminal that is narrower would break what is broken again.
pub(crate) fn flowing(command: Command) -> Command {
    let text = command.get_after_help().map(|text| joined(&text.to_string()));
    let command = command.mut_subcommands(flowing);
    match text {
        Some(text) => command.after_help(text),
        None => command,
    }
}

/// Paragraphs as one line each; what is indented, lists and examples, stays as it is.
fn joined(text: &str) -> String {
    let mut whole = String::new();
    let mut before = "";
    for line in text.lines() {
        let goes_on = |line: &str| !line.is_empty() && !line.starts_with(' ');
        if goes_on(before) && goes_on(line) {
            whole.push(' ');
        } else if !whole.is_empty() || !before.is_empty() {
            whole.push('\n');
        }
        whole.push_str(line);
        before = line;
    }
    whole
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::args::Arguments;

    #[test]
    fn paragraphs_are_joined_and_lists_are_not() {
        let text = "One\ntwo.\n\nThree:\n  a  b\n  c\nFour\nfive.";
        assert_eq!(joined(text), "One two.\n\nThree:\n  a  b\n  c\nFour five.");
    }

    /// All commands and what is below them.
    fn all(command: Command, into: &mut Vec<Command>) {
        command.get_subcommands().for_each(|below| all(below.clone(), into));
        into.push(command);
    }

    #[test]
    fn help_fits_a_terminal_of_80_columns() {
        let mut commands = Vec::new();
        let mut root = flowing(Arguments::command()).term_width(80);
        root.build();
        all(root, &mut commands);
        assert!(commands.len() > 15);
        for mut command in commands {
            let help = command.render_long_help().to_string();
            let name = command.get_name();
            // Clap breaks all but the line of usage.
            let too_long = |line: &&str| line.chars().count() > 80 && !line.starts_with("Usage: ");
            assert_eq!(help.lines().find(too_long), None, "{name}");
            // Lists and examples are not broken at all.
            let behind = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            for line in behind.lines().filter(|line| line.starts_with(' ')) {
                assert!(help.lines().any(|shown| shown == line), "{name}: {line:?} is broken");
            }
            // A line of a paragraph ends where the next word has no room.
            let lines: Vec<&str> = help.lines().collect();
            for pair in lines.windows(2) {
                let goes_on = pair.iter().all(|line| !line.is_empty() && !line.starts_with(' '));
                let next = pair[1].split(' ').next().unwrap_or_default();
                let room = pair[0].chars().count() + 1 + next.chars().count();
                assert!(!goes_on || room > 80, "{name}: {pair:?}");
            }
        }
    }
}
