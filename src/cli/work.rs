//! `alvis work`: the job of a part.

use super::args::Common;
use super::input::Input;
use super::plan::PlanArgs;
use super::prepare::{Prepared, Purpose};
use super::progress::Console;
use super::{Outcome, parse};
use crate::convert::parts::{Asked, NextWork, asked_of, next_work, parts_of, work_on_part};
use crate::error::{Error, Result};
use crate::store::is_remote;
use clap::{Args, ValueHint};
use std::path::{Path, PathBuf};

/// Do what a part of a plan is to do next
///
/// The same line is the job of a part in every round. A part that was killed is begun again; one that runs twice at the same
/// time is done once. Exit status: 0 it is done, or was; 75 it waits for `alvis merge`; 2 anything went wrong.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis work OUT --part 7\n  \
    alvis work OUT --part $SLURM_ARRAY_TASK_ID --memory 7GiB --threads $SLURM_CPUS_PER_TASK\n  \
    alvis work OUT --part 7 --of 50")]
pub struct WorkArgs {
    /// The directory of the plan
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The number of the part, from 0 on
    #[arg(long, value_name = "K")]
    part: u32,
    /// Do every Nth part from there on, too: for engines that do not take as many jobs as there are parts
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    of: Option<u32>,
    #[command(flatten)]
    again: AgainArgs,
    #[command(flatten)]
    common: Common,
}

/// What may differ from machine to machine.
#[derive(Debug, Args)]
pub struct AgainArgs {
    /// Limit of resident memory [default: that of the plan]
    #[arg(long, value_name = "SIZE", value_parser = parse::bytes)]
    memory: Option<u64>,
    /// Where the volume is found here [default: where it was when the plan was made]
    #[arg(long, value_name = "PATH", value_hint = ValueHint::FilePath)]
    input: Option<PathBuf>,
}

impl AgainArgs {
    /// Opens the volume of a plan, with the options of that, and calls `run` with them.
    pub fn with_volume<R>(
        &self,
        asked: &Asked,
        out: &Path,
        common: &Common,
        console: &Console,
        run: impl FnOnce(&Prepared, &Path) -> Result<R>,
    ) -> Result<R> {
        let out = std::path::absolute(out).map_err(|e| Error::io(out, "find", e))?;
        let input = match &self.input {
            Some(input) if is_remote(input) => Some(input.clone()),
            Some(input) => {
                let input = std::path::absolute(input);
                Some(input.map_err(|e| Error::io("--input", "find", e))?)
            }
            None => None,
        };
        let args = PlanArgs::again(asked)?;
        let input = input.as_ref().unwrap_or(&args.input);
        // what was typed is relative to it; machines that lack it may do without
        if let Err(e) = std::env::set_current_dir(&asked.directory)
            && input.is_relative()
            && !is_remote(input)
        {
            let action = "go to the directory of the plan";
            return Err(Error::io(&asked.directory, action, e));
        }
        let purpose = Purpose::Known(asked);
        let mut prepared = args.prepare(Input::Path(input), &out, purpose, console)?;
        let options = &mut prepared.options;
        options.threads = common.threads.map_or(0, usize::from);
        options.memory = self.memory.unwrap_or(options.memory);
        console.listen();
        run(&prepared, &out)
    }
}

impl WorkArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let parts = match (self.of, parts_of(&self.out)?) {
            (Some(step), Some(count)) => (self.part..count).step_by(step as usize).collect(),
            _ => vec![self.part],
        };
        let (mut worked, mut waits) = (false, false);
        for part in parts {
            match self.work(part, &console)? {
                NextWork::Done => {}
                NextWork::Waits(_) => waits = true,
                NextWork::Do(_) => worked = true,
            }
        }
        Ok(match waits && !worked {
            true => Outcome::NotYet,
            false => Outcome::Done,
        })
    }

    /// Does what a part is to do next; returns what that was.
    fn work(&self, part: u32, console: &Console) -> Result<NextWork> {
        let next = next_work(&self.out, part)?;
        match next {
            NextWork::Done => console.note(&format!("part {part}: all is done")),
            NextWork::Waits(round) => {
                let out = super::output::shell_word(self.out.as_os_str());
                console.note(&format!(
                    "part {part}: done with the round `{round}`; `alvis merge {out}` comes before the next one"
                ));
            }
            NextWork::Do(round) => {
                console.note(&format!("part {part}: {round}"));
                let Some(asked) = asked_of(&self.out)? else {
                    return Ok(NextWork::Done);
                };
                let (again, common) = (&self.again, &self.common);
                again.with_volume(&asked, &self.out, common, console, |prepared, out| {
                    let volume = &*prepared.opened.volume;
                    work_on_part(volume, &prepared.options, out, part, console)
                })?;
            }
        }
        Ok(next)
    }
}
