//! `alvis completions` and `alvis man`: texts made from the command line's own definition.

use super::{Outcome, command, output};
use crate::error::{Error, Result};
use clap::Args;
use clap_complete::Shell;

/// Print a completion script for a shell
///
/// For bash: `alvis completions bash > ~/.local/share/bash-completion/completions/alvis`
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

impl CompletionsArgs {
    pub fn run(self) -> Result<Outcome> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command(), "alvis", &mut script);
        output::print(&String::from_utf8_lossy(&script))?;
        Ok(Outcome::Done)
    }
}

/// Print a manual page in roff
///
/// To read it at once: `alvis man convert | man -l -`
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The command that the page describes [default: alvis as a whole]
    command: Option<String>,
}

impl ManArgs {
    pub fn run(self) -> Result<Outcome> {
        let mut whole = command();
        whole.build();
        let page = match &self.command {
            None => whole,
            Some(name) => match whole.find_subcommand(name) {
                Some(found) => found.clone(),
                None => {
                    let names: Vec<&str> = whole.get_subcommands().map(|c| c.get_name()).collect();
                    let expected = format!("one of {}", names.join(", "));
                    return Err(Error::usage("COMMAND", name, expected));
                }
            },
        };
        let mut text = Vec::new();
        clap_mangen::Man::new(page)
            .render(&mut text)
            .map_err(|e| Error::io("stdout", "write", e))?;
        output::print(&String::from_utf8_lossy(&text))?;
        Ok(Outcome::Done)
    }
}
