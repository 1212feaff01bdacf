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

/// The pages of the manual by their file names: the program and each verb.
///
/// # Errors
/// None on a memory that suffices.
pub fn manual() -> anyhow::Result<Vec<(String, String)>> {
    let mut program = Cli::command();
    program.build();
    let verbs: Vec<clap::Command> = program
        .get_subcommands()
        .filter(|v| !v.is_hide_set() && v.get_name() != "help")
        .cloned()
        .collect();
    let version = env!("CARGO_PKG_VERSION");
    std::iter::once(program.clone())
        .chain(verbs)
        .map(|command| {
            // Building has named a verb's page after the program and the verb.
            let name = command.get_display_name().unwrap_or("edgecap");
            let name = format!("{name}.1");
            let mut page = Vec::new();
            // Without a date: the same sources make the same bytes.
            clap_mangen::Man::new(command)
                .source(format!("edgecap {version}"))
                .manual("edgecap")
                .date("")
                .render(&mut page)?;
            Ok((name, String::from_utf8(page)?))
        })
        .collect()
}
