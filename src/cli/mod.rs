//! The command line: what can be typed, and what is said in return.
//!
//! Results go to stdout, everything else to stderr. The exit status is 0 if all was done, 1 if the
//! verifier found issues, 2 if anything else went wrong; then stderr ends with one message.

mod again;
mod against;
mod args;
mod batch;
mod bucket;
pub mod call;
mod cells;
mod chart;
mod chosen;
mod compare;
mod convert;
mod demo;
mod export;
mod filters;
mod form;
mod generate;
mod info;
mod info_report;
mod info_tiles;
mod input;
mod labels;
mod lod;
mod merge;
mod necks;
mod output;
mod parse;
mod phantom;
mod plan;
mod plan_script;
mod prepare;
mod preview;
mod progress;
mod region;
mod repack;
mod report;
mod same_place;
mod same_surface;
mod scans_table;
mod select;
mod serve;
mod sigbus;
mod split;
mod stop;
mod summary_text;
mod threshold;
mod verify;
mod view;
mod work;

use crate::error::Result;
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::process::ExitCode;

/// How a command ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// Exit status 0.
    Done,
    /// Exit status 1: the verifier found issues.
    Issues,
    /// Exit status 3: parts are to be run.
    ToRun,
    /// Exit status 75: nothing can be done yet, as `sysexits.h` has it.
    NotYet,
}

/// Exit status of anything that went wrong.
const FAILED: u8 = 2;

/// Turns CT volumes larger than memory into glTF tiles
#[derive(Debug, Parser)]
#[command(name = "alvis", version, propagate_version = true)]
#[command(
    after_help = "Start with `alvis demo`. All options of a command: `alvis COMMAND --help`.\n\
    Exit status: 0 done, 1 the verifier found issues, 2 anything else went wrong."
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
    View(view::ViewArgs),
    Cells(cells::CellsArgs),
    Compare(compare::CompareArgs),
    Report(report::ReportArgs),
    Select(select::SelectArgs),
    Export(export::ExportArgs),
    Repack(repack::RepackArgs),
    Split(split::SplitArgs),
    Lod(lod::LodArgs),
    Plan(plan::PlanArgs),
    Work(work::WorkArgs),
    Merge(merge::MergeArgs),
    Serve(serve::ServeArgs),
    Preview(preview::PreviewArgs),
    Phantom(phantom::PhantomArgs),
    Completions(generate::CompletionsArgs),
    Man(generate::ManArgs),
}

impl Command {
    /// Runs a command; `typed` is the whole command line.
    fn run(self, typed: &[OsString]) -> Result<Outcome> {
        match self {
            Command::Demo(args) => args.run(),
            Command::Info(args) => args.run(),
            Command::Convert(args) => args.run(typed),
            Command::Verify(args) => args.run(),
            Command::View(args) => args.run(),
            Command::Cells(args) => args.run(),
            Command::Compare(args) => args.run(),
            Command::Report(args) => args.run(),
            Command::Select(args) => args.run(),
            Command::Export(args) => args.run(),
            Command::Repack(args) => args.run(),
            Command::Split(args) => args.run(typed),
            Command::Lod(args) => args.run(),
            Command::Plan(args) => args.run(typed),
            Command::Work(args) => args.run(),
            Command::Merge(args) => args.run(),
            Command::Serve(args) => args.run(),
            Command::Preview(args) => args.run(),
            Command::Phantom(args) => args.run(),
            Command::Completions(args) => args.run(),
            Command::Man(args) => args.run(),
        }
    }
}

/// Runs the command line `args`, whose first is the program's own name.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(status(args))
}

/// Runs the command line `args` as [`run`] does; returns the exit status of the process.
pub fn status(args: impl IntoIterator<Item = OsString>) -> u8 {
    crate::sys::process_memory::give_back_large_buffers();
    let mut typed: Vec<OsString> = args.into_iter().collect();
    if typed.len() < 2 {
        // nobody who types the name alone means anything else
        typed = vec!["alvis".into(), "--help".into()];
    }
    let parsed = command()
        .try_get_matches_from(&typed)
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let result = match parsed {
        Ok(cli) => cli.command.run(&typed).map_err(|e| e.to_string()),
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
            _ => Err(one_line(&refusal, &typed)),
        },
    };
    match result {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::Issues) => 1,
        Ok(Outcome::ToRun) => 3,
        Ok(Outcome::NotYet) => 75,
        Err(message) => {
            output::note(&format!("alvis: {message}"));
            FAILED
        }
    }
}

/// The parser's complaint as one line: its paragraphs before the usage text, and whose help to read.
fn one_line(refusal: &clap::Error, typed: &[OsString]) -> String {
    let text = refusal.render().to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let mut message = String::new();
    for line in text.lines().map(str::trim).filter(|l| !l.is_empty()) {
        if line.starts_with("Usage: ") || line.starts_with("For more information") {
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
    let command = typed.get(1).and_then(|name| name.to_str()).unwrap_or("");
    match Cli::command().find_subcommand(command) {
        Some(found) => format!("{message}: see `alvis {} --help`", found.get_name()),
        None => format!("{message}: see `alvis --help`"),
    }
}

/// The commands in groups, as the help lists them.
const GROUPS: [(&str, &[&str]); 5] = [
    (
        "Make tiles",
        &["demo", "info", "convert", "split", "verify"],
    ),
    ("Look", &["view", "preview", "cells", "compare", "report"]),
    ("Use tiles", &["select", "export", "repack", "lod", "serve"]),
    ("Many machines", &["plan", "work", "merge"]),
    ("Other", &["phantom", "completions", "man", "help"]),
];

/// The whole command line, for parsing, manual pages and completions.
fn command() -> clap::Command {
    let command = Cli::command();
    let mut built = command.clone();
    built.build();
    let style = *command.get_styles().get_header();
    let mut list = String::new();
    for (title, names) in GROUPS {
        list += &format!("{style}{title}:{style:#}\n");
        for name in names {
            let found = built.find_subcommand(name).and_then(|c| c.get_about());
            let about = found.map(ToString::to_string).unwrap_or_default();
            let about = output::wrapped(&about, output::width().min(100), 15);
            list += &format!("  {name:13}{about}\n");
        }
        list.push('\n');
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}{style}Options:{style:#}\n{{options}}{{after-help}}"
    );
    command.help_template(template)
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
            &["alvis", "frobnicate"][..],
            &["alvis", "convert"],
            &["alvis", "info", "x", "--dtype", "u99"],
            &["alvis", "info", "x", "--dims", "1,2"],
            &["alvis", "info", "x", "--frob"],
        ] {
            let typed: Vec<OsString> = bad.iter().map(OsString::from).collect();
            let message = one_line(&Cli::try_parse_from(bad).unwrap_err(), &typed);
            assert!(!message.contains('\n') && message.len() < 400, "{message}");
            let whose = match bad[1] {
                "frobnicate" => "alvis".to_owned(),
                command => format!("alvis {command}"),
            };
            assert!(
                message.ends_with(&format!("see `{whose} --help`")),
                "{message}"
            );
        }
    }

    #[test]
    fn every_command_is_in_one_group() {
        let mut built = Cli::command();
        built.build();
        let mut all: Vec<&str> = built.get_subcommands().map(|c| c.get_name()).collect();
        let mut listed: Vec<&str> = GROUPS.iter().flat_map(|g| g.1).copied().collect();
        all.sort_unstable();
        listed.sort_unstable();
        assert_eq!(all, listed);
    }
}
