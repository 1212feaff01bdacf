//! What shells and `man` know of the command line, made from the command line itself.

use clap::{Command, CommandFactory};

use crate::commands::Cli;

/// Shells that complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Shell {
    /// GNU Bash
    Bash,
    /// Z shell
    Zsh,
    /// Fish
    Fish,
}

/// The completion script.
///
/// # Errors
/// None on a memory that suffices.
pub fn completions(shell: Shell) -> anyhow::Result<String> {
    let shell = match shell {
        Shell::Bash => clap_complete::Shell::Bash,
        Shell::Zsh => clap_complete::Shell::Zsh,
        Shell::Fish => clap_complete::Shell::Fish,
    };
    let mut script = Vec::new();
    let mut program = shown(&Cli::command());
    clap_complete::generate(shell, &mut program, "edgecap", &mut script);
    Ok(String::from_utf8(script)?)
}

/// The command with what it shows: the scripts' makers know nothing of options that are hidden.
fn shown(command: &Command) -> Command {
    // A command's words live as long as the program; this one makes its script and ends.
    let word = |text: &str| -> &'static str { text.to_owned().leak() };
    let mut shown = Command::new(word(command.get_name()))
        .args(
            command
                .get_arguments()
                .filter(|a| !a.is_hide_set())
                .cloned(),
        )
        .subcommands(
            command
                .get_subcommands()
                .filter(|v| !v.is_hide_set())
                .map(self::shown),
        );
    if let Some(about) = command.get_about() {
        shown = shown.about(about.clone());
    }
    if let Some(version) = command.get_version() {
        shown = shown.version(word(version));
    }
    shown
}

/// The pages of the manual by their file names: the program, its verbs, and those of a verb.
///
/// # Errors
/// None on a memory that suffices.
pub fn manual() -> anyhow::Result<Vec<(String, String)>> {
    // What 'help' says the pages say, which would refer to one of its own.
    let mut program = Cli::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    add_pages(&program, &mut pages)?;
    Ok(pages)
}

/// Adds the page of a command, which is built, and those of what stands below it.
fn add_pages(command: &Command, pages: &mut Vec<(String, String)>) -> anyhow::Result<()> {
    // Building has named a verb's page after the program and the verb.
    let name = command.get_display_name().unwrap_or("edgecap");
    let mut page = Vec::new();
    // Without a date: the same sources make the same bytes.
    clap_mangen::Man::new(command.clone())
        .source(format!("edgecap {}", env!("CARGO_PKG_VERSION")))
        .manual("edgecap")
        .date("")
        .render(&mut page)?;
    pages.push((format!("{name}.1"), String::from_utf8(page)?));
    let mut verbs = command.get_subcommands().filter(|v| !v.is_hide_set());
    verbs.try_for_each(|verb| add_pages(verb, pages))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_that_one_refers_to_is_there() {
        let pages = manual().unwrap();
        let mut named: Vec<String> = Vec::new();
        for (_, text) in &pages {
            let plain = text.replace("\\-", "-");
            let words = plain.split(|c: char| !c.is_ascii_alphanumeric() && !"-()".contains(c));
            let pages = words.filter_map(|word| word.strip_suffix("(1)"));
            named.extend(pages.map(|name| format!("{name}.1")));
        }
        for page in ["edgecap-run.1", "edgecap-model-import.1"] {
            assert!(named.iter().any(|n| n == page), "{page} in {named:?}");
        }
        let is_there = |name: &&String| pages.iter().any(|(page, _)| page == *name);
        let missing: Vec<&String> = named.iter().filter(|n| !is_there(n)).collect();
        assert!(missing.is_empty(), "{missing:?}");
    }
}
