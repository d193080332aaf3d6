//! The command line: what can be typed, and what is said in return.
//!
//! Results go to stdout, everything else to stderr. The exit status is 0 if all was done, 1 if the
//! verifier found issues, 2 if anything else went wrong; then stderr ends with one message.

mod args;
mod cells;
mod chart;
mod convert;
mod demo;
mod export;
mod form;
mod generate;
mod info;
mod output;
mod parse;
mod phantom;
mod preview;
mod progress;
mod repack;
mod select;
mod sigbus;
mod verify;

use crate::error::Result;
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;

/// How a command ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// Exit status 0.
    Done,
    /// Exit status 1: the verifier found issues.
    Issues,
}

/// Exit status of anything that went wrong.
const FAILED: u8 = 2;

/// Turns CT volumes larger than memory into glTF tiles
#[derive(Debug, Parser)]
#[command(name = "alvis", version, propagate_version = true)]
#[command(
    after_help = "Exit status: 0 done, 1 the verifier found issues, 2 anything else went \
    wrong.\nStart with `alvis demo`."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Info(info::InfoArgs),
    Convert(convert::ConvertArgs),
    Verify(verify::VerifyArgs),
    Cells(cells::CellsArgs),
    Select(select::SelectArgs),
    Export(export::ExportArgs),
    Repack(repack::RepackArgs),
    Preview(preview::PreviewArgs),
    Phantom(phantom::PhantomArgs),
    Completions(generate::CompletionsArgs),
    Man(generate::ManArgs),
}

impl Command {
    fn run(self) -> Result<Outcome> {
        match self {
            Command::Demo(args) => args.run(),
            Command::Info(args) => args.run(),
            Command::Convert(args) => args.run(),
            Command::Verify(args) => args.run(),
            Command::Cells(args) => args.run(),
            Command::Select(args) => args.run(),
            Command::Export(args) => args.run(),
            Command::Repack(args) => args.run(),
            Command::Preview(args) => args.run(),
            Command::Phantom(args) => args.run(),
            Command::Completions(args) => args.run(),
            Command::Man(args) => args.run(),
        }
    }
}

/// Runs the command line `args`, whose first is the program's own name.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    crate::sys::process_memory::give_back_large_buffers();
    let result = match Cli::try_parse_from(args) {
        Ok(cli) => cli.command.run().map_err(|e| e.to_string()),
        Err(refusal) => match refusal.kind() {
            ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
                let text = refusal.render();
                let text = if output::stdout_has_colour() {
                    text.ansi().to_string()
                } else {
                    text.to_string()
                };
                output::print(&text)
                    .map(|()| Outcome::Done)
                    .map_err(|e| e.to_string())
            }
            _ => Err(one_line(&refusal)),
        },
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Issues) => ExitCode::from(1),
        Err(message) => {
            output::note(&format!("alvis: {message}"));
            ExitCode::from(FAILED)
        }
    }
}

/// The parser's complaint as one line: its paragraphs before the usage text, and whose help to read.
fn one_line(refusal: &clap::Error) -> String {
    if refusal.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "no command given: see `alvis --help`".to_string();
    }
    let text = refusal.render().to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let mut message = String::new();
    let mut whose = "alvis".to_string();
    for line in text.lines().map(str::trim).filter(|l| !l.is_empty()) {
        if let Some(usage) = line.strip_prefix("Usage: ") {
            let words = usage.split(' ');
            let names = words.take_while(|w| w.starts_with(|c: char| c.is_ascii_lowercase()));
            whose = names.collect::<Vec<_>>().join(" ");
            break;
        }
        if line.starts_with("For more information") {
            break;
        }
        if line.starts_with("tip:") {
            message.push(';');
        }
        if !message.is_empty() {
            message.push(' ');
        }
        message.push_str(line);
    }
    format!("{message}: see `{whose} --help`")
}

/// The whole command line, for manual pages and completions.
fn command() -> clap::Command {
    Cli::command()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parser_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn complaints_are_one_line() {
        for bad in [
            &["alvis"][..],
            &["alvis", "frobnicate"],
            &["alvis", "convert"],
            &["alvis", "info", "x", "--dtype", "u99"],
            &["alvis", "info", "x", "--dims", "1,2"],
            &["alvis", "info", "x", "--frob"],
        ] {
            let message = one_line(&Cli::try_parse_from(bad).unwrap_err());
            assert!(!message.contains('\n') && message.len() < 400, "{message}");
            assert!(message.contains("--help"), "{message}");
        }
    }
}
