//! `alvis convert A B ... --out-dir DIR`: several volumes, each to a tile set of its own, and a table of them.

use super::again::{Again, resuming};
use super::convert::ConvertArgs;
use super::input::Input;
use super::progress::Console;
use super::scans_table::{FILE, Facts, Row, ScansTable, Status};
use super::threshold::Threshold;
use super::{Outcome, output, stop};
use crate::convert;
use crate::error::{Error, Result};
use crate::manifest::{MANIFEST, Manifest};
use crate::sys::process_memory::peak_rss_bytes;
use crate::tileset::{Lock, refuse_bucket};
use crate::volume::stem;
use crate::words::one_line;
use serde::Serialize;
use std::collections::HashMap;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The name of the file that says who writes to a directory.
const LOCK: &str = ".scans.lock";

/// A volume, and the name of its tile set.
#[derive(Debug)]
struct Scan {
    input: PathBuf,
    name: String,
}

impl Scan {
    /// Its row before it is begun.
    fn row(&self) -> Row {
        Row::new(self.input.display().to_string(), &self.name)
    }
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
    refuse_bucket(&dir)?;
    let inputs = std::iter::once(&args.input)
        .chain(&args.out)
        .chain(&args.more);
    let scans = named(inputs, &dir)?;
    if dir.metadata().is_ok_and(|found| !found.is_dir()) {
        let found = format!("{}, which is a file", dir.display());
        let expected = "a directory, which is made if it is not there";
        return Err(Error::usage("--out-dir", found, expected));
    }
    std::fs::create_dir_all(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
    let lock = BatchLock::take(&dir)?;
    let mut table = ScansTable::open(&dir, args.force)?;
    if !args.resume {
        // refused before anything is read
        for scan in &scans {
            convert::check_unused(&dir.join(&scan.name), args.force).map_err(done_before)?;
        }
    }
    let console = args.common.start();
    stop::listen();
    let mut rows: Vec<Row> = scans.iter().map(Scan::row).collect();
    table.drop_gone()?;
    let mut kept = 0;
    for row in &rows {
        settle(&mut table, row, &dir)?;
    }
    table.write()?;
    for (i, scan) in scans.iter().enumerate() {
        if !stop::is_asked() {
            rows[i] = convert_one(&args, scan, &dir, typed, &console);
            let keeps = settle(&mut table, &rows[i], &dir)?;
            kept += usize::from(keeps && rows[i].status == Status::Failed);
            table.write()?;
        }
        tell(&rows[i], [i + 1, scans.len()], &console);
    }
    drop(lock);
    drop(console);
    report(&args, &rows, &table, start)?;
    outcome(&rows, kept, &table, &resuming(typed))
}

/// Says also how to leave what is done as it is.
fn done_before(error: Error) -> Error {
    match error {
        Error::OutputExists { path } if path.join(MANIFEST).is_file() => {
            let found = format!("{}, which holds a tile set", path.display());
            let expected = "another directory, --resume to leave what is done and make the rest, or --force to replace it";
            Error::usage("--out-dir", found, expected)
        }
        other => other,
    }
}

/// Prints how it went.
fn report(args: &ConvertArgs, rows: &[Row], table: &ScansTable, start: Instant) -> Result<()> {
    let [done, failed] = counts(rows);
    if args.common.json {
        output::print_json(&Report {
            scans: rows,
            done,
            failed,
            table: table.path().display().to_string(),
            seconds: start.elapsed().as_secs_f64(),
            peak_rss_bytes: peak_rss_bytes(),
        })?;
    } else if args.common.talks() {
        let of = output::things(rows.len() as u64, "scan");
        let path = table.path().display();
        output::print(&format!("{done} of {of} done: {path}\n"))?;
    }
    Ok(())
}

/// How many scans are done, and how many failed.
fn counts(rows: &[Row]) -> [usize; 2] {
    let count = |status: Status| rows.iter().filter(|row| row.status == status).count();
    [count(Status::Done), count(Status::Failed)]
}

/// Whether all scans are done, of which `kept` that failed have a tile set from before; `next` is the command that goes on.
fn outcome(rows: &[Row], kept: usize, table: &ScansTable, next: &str) -> Result<Outcome> {
    let [done, failed] = counts(rows);
    match (done + failed == rows.len(), failed) {
        (true, 0) => Ok(Outcome::Done),
        (true, failed) => Err(Error::ScansFailed {
            failed,
            kept,
            of: rows.len(),
            table: table.path().to_path_buf(),
        }),
        (false, _) => Err(Error::ScansStopped {
            done,
            of: rows.len(),
            next: format!("`{next}` goes on"),
        }),
    }
}

/// Puts a row into the table, unless it is of a scan that was not converted and whose tile set from before is there and
/// whole: then the table tells of that, and this returns true.
///
/// # Errors
/// What reading that tile set returns.
fn settle(table: &mut ScansTable, row: &Row, dir: &Path) -> Result<bool> {
    let out = dir.join(&row.tile_set);
    if row.status == Status::Done || Manifest::open(&out).is_err() {
        table.put(row);
        return Ok(false);
    }
    if !table.is_done(&row.tile_set) {
        // how its threshold was found is not known
        let facts = Facts::of(&out, String::new())?;
        table.put(&Row::new(row.scan.clone(), &row.tile_set).done(facts));
    }
    Ok(true)
}

/// Held while scans are converted into a directory, so that two calls do not replace each other's table.
struct BatchLock {
    path: PathBuf,
    _lock: Lock,
}

impl BatchLock {
    /// # Errors
    /// Those of [`Lock::take`].
    fn take(dir: &Path) -> Result<Self> {
        let path = dir.join(LOCK);
        let _lock = Lock::take(&path, dir)?;
        Ok(BatchLock { path, _lock })
    }
}

impl Drop for BatchLock {
    fn drop(&mut self) {
        // whoever takes the lock from here on makes a file of its own; one that stays does no harm
        let _ = std::fs::remove_file(&self.path);
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
        let reserved = [FILE, LOCK]
            .iter()
            .any(|own| name.eq_ignore_ascii_case(own));
        if name.is_empty() || reserved {
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

/// Converts one volume, and sums up what was made.
fn convert_one(
    args: &ConvertArgs,
    scan: &Scan,
    dir: &Path,
    typed: &[OsString],
    console: &Console,
) -> Row {
    let out = dir.join(&scan.name);
    let input = Input::Path(&scan.input);
    // what is told of several scans has to say of which
    let name = one_line(&scan.input.display().to_string());
    let console = Console::Scan(console, &name);
    let made = args.convert(input, &out, Again::Typed(typed), &console);
    let made = made.and_then(|_| args.levels(&out, &console));
    let facts = made.and_then(|_| {
        Facts::of(
            &out,
            match args.threshold {
                Threshold::Value(_) => "value".to_owned(),
                Threshold::Method(method) => method.to_string(),
            },
        )
    });
    let row = scan.row();
    match facts {
        Ok(facts) => row.done(facts),
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
    let head = format!("scan {number} of {of}: {}", one_line(&row.scan));
    match (row.status, &row.facts, &row.error) {
        (Status::Done, Some(facts), _) => console.note(&format!("{head}: {}", facts.line())),
        (Status::Failed, _, Some(error)) => {
            console.tell(&format!("{head}: failed: {}", one_line(error)));
        }
        _ => console.note(&format!("{head}: {}", row.status.name())),
    }
}
