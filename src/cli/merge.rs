//! `alvis merge`: joins what the parts of a plan have found.

use super::args::Common;
use super::convert::summary;
use super::work::AgainArgs;
use super::{Outcome, output};
use crate::convert::ConvertReport;
use crate::convert::parts::{Merged, NextMerge, asked_of, merge_parts, next_merge};
use crate::error::Result;
use clap::{Args, ValueHint};
use serde::Serialize;
use std::path::PathBuf;

/// Join what all parts of a plan have done, and say which are to run next
///
/// Prints the parts that are to run `alvis work`, as in `0-99` or `3,7,12-15`, until all rounds are done; then the tile set
/// is moved into place. Exit status: 0 the tile set is in place; 3 parts are to run; 2 anything went wrong.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis merge OUT\n  \
    while todo=$(alvis merge OUT); [ $? = 3 ]; do sbatch --wait --array=\"$todo\" ...; done")]
pub struct MergeArgs {
    /// The directory of the plan
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    #[command(flatten)]
    again: AgainArgs,
    #[command(flatten)]
    common: Common,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Printed<'a> {
    in_place: bool,
    /// The round that parts are to do.
    #[serde(skip_serializing_if = "Option::is_none")]
    round: Option<&'static str>,
    /// Those parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    parts: Option<String>,
    #[serde(flatten)]
    report: Option<&'a ConvertReport>,
}

impl MergeArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let merged = match next_merge(&self.out)? {
            NextMerge::ToRun(round, parts) => Merged::ToRun(round, parts),
            NextMerge::InPlace => self.tidy()?,
            NextMerge::Join => match asked_of(&self.out)? {
                None => Merged::InPlace(None),
                Some(asked) => {
                    let (again, common) = (&self.again, &self.common);
                    again.with_volume(&asked, &self.out, common, &console, |prepared, out| {
                        let volume = &*prepared.opened.volume;
                        merge_parts(volume, &prepared.options, out, &console)
                    })?
                }
            },
        };
        drop(console);
        self.tell(&merged)
    }

    /// Removes what a merge has left that was killed at its end.
    fn tidy(&self) -> Result<Merged> {
        crate::convert::parts::tidy_parts(&self.out)?;
        Ok(Merged::InPlace(None))
    }

    fn tell(&self, merged: &Merged) -> Result<Outcome> {
        let json = self.common.json;
        match merged {
            Merged::ToRun(round, parts) => {
                let list = ranges(parts);
                match json {
                    true => output::print_json(&Printed {
                        in_place: false,
                        round: Some(round),
                        parts: Some(list),
                        report: None,
                    })?,
                    false => output::print(&format!("{list}\n"))?,
                }
                Ok(Outcome::ToRun)
            }
            Merged::InPlace(report) => {
                let report = report.as_deref();
                if json {
                    output::print_json(&Printed {
                        in_place: true,
                        round: None,
                        parts: None,
                        report,
                    })?;
                } else if self.common.talks() {
                    // stdout is for parts to run
                    match report {
                        Some(report) => output::note(summary(report).trim_end()),
                        None => output::note("the tile set is in place"),
                    }
                }
                Ok(Outcome::Done)
            }
        }
    }
}

/// Numbers, which rise, as engines take them: `0-3,7`.
fn ranges(numbers: &[u32]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b);
    let text = |run: &[u32]| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}-{last}"),
        [] => String::new(),
    };
    runs.map(text).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_listed_as_engines_take_them() {
        for (numbers, text) in [
            (&[0, 1, 2, 3][..], "0-3"),
            (&[3, 7, 12, 13], "3,7,12-13"),
            (&[5], "5"),
            (&[], ""),
        ] {
            assert_eq!(ranges(numbers), text);
        }
    }
}
