//! `alvis convert A B ... --out-dir DIR`: several volumes, each to a tile set of its own, and a table of them.

use super::convert::{ConvertArgs, resuming};
use super::progress::Console;
use super::scans_table::{FILE, Facts, Row, Status, write};
use super::threshold::Threshold;
use super::{Outcome, output, stop};
use crate::convert;
use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::sys::process_memory::peak_rss_bytes;
use crate::volume::stem;
use serde::Serialize;
use std::collections::HashMap;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A volume, and the name of its tile set.
#[derive(Debug)]
struct Scan {
    input: PathBuf,
    name: String,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report<'a> {
    scans: &'a [Row],
    done: usize,
    failed: usize,
    table: String,
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Converts all volumes; `typed` is the command line that asks for it.
pub fn run(args: ConvertArgs, typed: &[OsString]) -> Result<Outcome> {
    let start = Instant::now();
    // without it this is not asked for
    let dir = args.out_dir.clone().unwrap_or_default();
    let inputs = std::iter::once(&args.input)
        .chain(&args.out)
        .chain(&args.more);
    let scans = named(inputs, &dir)?;
    check(&args, &scans, &dir)?;
    let console = args.common.start();
    stop::listen();
    let mut rows: Vec<Row> = Vec::with_capacity(scans.len());
    for (i, scan) in scans.iter().enumerate() {
        let row = match stop::is_asked() {
            true => Row::new(scan.input.display().to_string(), &scan.name),
            false => convert_one(&args, scan, &dir, typed, &console),
        };
        tell(&row, [i + 1, scans.len()], &console);
        rows.push(row);
    }
    let table = dir.join(FILE);
    write(&table, &rows)?;
    drop(console);
    let count = |status: Status| rows.iter().filter(|row| row.status == status).count();
    let (done, failed) = (count(Status::Done), count(Status::Failed));
    if args.common.json {
        output::print_json(&Report {
            scans: &rows,
            done,
            failed,
            table: table.display().to_string(),
            seconds: start.elapsed().as_secs_f64(),
            peak_rss_bytes: peak_rss_bytes(),
        })?;
    } else if args.common.talks() {
        let of = output::things(rows.len() as u64, "scan");
        output::print(&format!("{done} of {of} done: {}\n", table.display()))?;
    }
    match (done + failed == rows.len(), failed) {
        (true, 0) => Ok(Outcome::Done),
        (true, failed) => Err(Error::ScansFailed {
            failed,
            of: rows.len(),
            table,
        }),
        (false, _) => Err(Error::ScansStopped {
            done,
            of: rows.len(),
            next: format!("`{}` goes on", resuming(typed)),
        }),
    }
}

/// Gives each volume the name of its tile set.
///
/// # Errors
/// [`Error::Usage`] if two get the same, or one that cannot be.
fn named<'a>(inputs: impl Iterator<Item = &'a PathBuf>, dir: &Path) -> Result<Vec<Scan>> {
    let mut scans: Vec<Scan> = Vec::new();
    // some file systems take capitals for small letters
    let mut taken: HashMap<String, PathBuf> = HashMap::new();
    for input in inputs {
        let name = stem(input);
        let refuse = |found: String, expected: &str| {
            let text = format!("{}, which {found}", input.display());
            Err(Error::usage("--out-dir", text, expected))
        };
        if input.join(MANIFEST).is_file() {
            let expected =
                "volumes: with it every name is that of a scan, and tile sets get theirs from them";
            return refuse("is a tile set".to_owned(), expected);
        }
        if name.is_empty() || name.eq_ignore_ascii_case(FILE) {
            let found = format!("would make the tile set {name:?}");
            return refuse(found, "a name for it: give the scan another one");
        }
        if let Some(other) = taken.insert(name.to_lowercase(), input.clone()) {
            let out = dir.join(&name);
            let found = format!("would be {} as {} is", out.display(), other.display());
            return refuse(found, "scans of different names, apart from their endings");
        }
        let input = input.clone();
        scans.push(Scan { input, name });
    }
    Ok(scans)
}

/// Makes the directory, and refuses to write where something is that is not to be replaced, before anything is read.
fn check(args: &ConvertArgs, scans: &[Scan], dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, "create the directory", e))?;
    if args.resume {
        return Ok(());
    }
    for scan in scans {
        convert::check_unused(&dir.join(&scan.name), args.force)?;
    }
    let table = dir.join(FILE);
    if table.symlink_metadata().is_err() {
        return Ok(());
    }
    match args.force {
        // it would be of others than the tile sets beside it if this ended early
        true => std::fs::remove_file(&table).map_err(|e| Error::io(&table, "remove", e)),
        false => Err(Error::FileExists { path: table }),
    }
}

/// Converts one volume, and sums up what was made.
fn convert_one(
    args: &ConvertArgs,
    scan: &Scan,
    dir: &Path,
    typed: &[OsString],
    console: &Console,
) -> Row {
    let out = dir.join(&scan.name);
    let made = args.convert(&scan.input, &out, typed, console);
    let facts = made.and_then(|_| {
        Facts::of(
            &out,
            match args.threshold {
                Threshold::Value(_) => "value".to_owned(),
                Threshold::Method(method) => method.to_string(),
            },
        )
    });
    let row = Row::new(scan.input.display().to_string(), &scan.name);
    match facts {
        Ok(facts) => Row {
            status: Status::Done,
            facts: Some(facts),
            ..row
        },
        Err(e) if is_stop(&e) => Row {
            status: Status::Stopped,
            error: Some(e.to_string()),
            ..row
        },
        Err(e) => Row {
            status: Status::Failed,
            error: Some(explained(&e, &scan.input)),
            ..row
        },
    }
}

/// True for an error that says that the user asked to stop.
fn is_stop(error: &Error) -> bool {
    match error {
        Error::Interrupted => true,
        Error::Resumable { error, .. } => is_stop(error),
        _ => false,
    }
}

/// An error, with a hint for one who gave a directory to write as well.
fn explained(error: &Error, input: &Path) -> String {
    match error {
        Error::Io { path, source, .. } if path == input && source.kind() == ErrorKind::NotFound => {
            format!("{error}: with --out-dir every name is that of a scan")
        }
        _ => error.to_string(),
    }
}

/// Says in a line what became of a scan.
fn tell(row: &Row, [number, of]: [usize; 2], console: &Console) {
    let head = format!("scan {number} of {of}: {}", row.scan);
    match (row.status, &row.facts, &row.error) {
        (Status::Done, Some(facts), _) => console.note(&format!("{head}: {}", facts.line())),
        (Status::Failed, _, Some(error)) => console.tell(&format!("{head}: failed: {error}")),
        _ => console.note(&format!("{head}: {}", row.status.name())),
    }
}
