//! How fast, beside what else there is: whole processes on the same volumes, taken in turns.
//!
//! ```sh
//! cargo run --release --example bench -- [DIRECTORY] [--python PYTHON] [--kinds] [--deep] [--lobster FILE]
//! ```
//!
//! Makes foams in DIRECTORY (by default `target/bench`; with what comes of them 12 GiB, with `--deep` 60 GiB),
//! and prints a table of medians as Markdown. Volumes are in the file cache, as far as memory has room. With
//! the PYTHON of an environment that has the packages that `peers.py` beside this file names, others race
//! along. `--kinds` takes volumes of other kinds instead: rock, floats, signed numbers, little surface, noise, and the
//! real scans below `ALVIS_DATA`. `--deep` adds the volumes of ten times the depth and of eight times the voxels; `--lobster` adds a
//! real scan (301 x 324 x 56, u8) repeated to 1 GB.
//!
//! Its results are deleted in the end, and ext4 without a journal is slow to make files for six minutes after
//! others were deleted, a build's too: run it again later.

mod input;
mod kinds;
mod run;

use input::{Input, Sets};
use run::{Alvis, Peer, Sample, least, median};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Runs of each command, in turns.
const RUNS: usize = 9;
/// Runs of each command on volumes of other kinds.
const RUNS_OF_KINDS: usize = 5;
/// Voxels from which on a volume is converted less often.
const LARGE: f64 = 1e9;

/// Rows of the table.
#[derive(Default)]
struct Table(Vec<[String; 3]>);

impl Table {
    fn row(&mut self, what: impl Into<String>, value: String, how: String) {
        let row = [what.into(), value, how];
        println!("{}: {} ({})", row[0], row[1], row[2]);
        self.0.push(row);
    }

    fn print(&self) {
        println!("\n| measured | value | from |\n|---|---|---|");
        for [what, value, how] in &self.0 {
            println!("| {what} | {value} | {how} |");
        }
    }
}

fn mib(bytes: f64) -> f64 {
    bytes / (1 << 20) as f64
}

/// What was run on one volume.
#[derive(Default)]
struct Race {
    /// Conversions by as many threads as there are cores.
    all: Vec<Sample>,
    /// By one thread, which has its tiles written beside it.
    one_thread: Vec<Sample>,
    /// On one core.
    one_core: Vec<Sample>,
    /// Seconds of as many of one thread as there are cores, at once.
    side_by_side: Vec<f64>,
    verify: Vec<Sample>,
    surface: Vec<Sample>,
    script: Vec<Sample>,
    /// What the machine gave meanwhile, see [`run::work_of_all_cores`].
    cores: Vec<f64>,
}

fn seconds(samples: &[Sample]) -> f64 {
    median(samples.iter().map(|s| s.wall))
}

/// Of the fastest run: the one that a shared machine disturbed least.
fn least_seconds(samples: &[Sample]) -> f64 {
    least(samples.iter().map(|s| s.wall))
}

fn peak(samples: &[Sample]) -> f64 {
    median(samples.iter().map(|s| s.number("peak_rss_bytes")))
}

/// Conversion, verification and others on one volume.
fn race(
    input: &Input,
    sets: &mut Sets,
    peers: Option<&Peer>,
    table: &mut Table,
) -> Result<(), String> {
    let mut race = Race::default();
    for run in 0..RUNS {
        race.cores.push(run::work_of_all_cores());
        // the process before leaves cores awake or asleep: to and fro, none always runs behind the same one
        let order = if run % 2 == 0 {
            [0, 1, 2, 3]
        } else {
            [3, 2, 1, 0]
        };
        for who in order {
            match who {
                0 => race.side_by_side.push(input.convert_side_by_side(sets)?),
                1 => race
                    .one_thread
                    .push(input.convert(sets, &["--threads", "1"])?),
                2 => {
                    race.all.push(input.convert(sets, &[])?);
                    race.verify.push(Alvis::verify(&sets.last())?);
                }
                _ => race.one_core.push(input.convert_on_one_core(sets)?),
            }
        }
        if let Some(peer) = peers {
            sets.empty()?;
            race.surface.push(peer.run(input_args(input), "vtk")?);
            if run == 0 {
                race.script.push(peer.run(input_args(input), "script")?);
            }
        }
    }
    race.own_rows(input, table);
    if peers.is_some() {
        race.peer_rows(&input.name(), table)?;
    }
    Ok(())
}

impl Race {
    fn own_rows(&self, input: &Input, table: &mut Table) {
        let name = input.name();
        let (ours, triangles) = (seconds(&self.all), self.all[0].number("triangles"));
        table.row(
            format!("{name}: convert"),
            format!("{ours:.2} s"),
            format!(
                "{:.1} M triangles, {:.0} Mvoxel/s, {:.1} Mtriangle/s",
                triangles / 1e6,
                input.voxels() / ours / 1e6,
                triangles / ours / 1e6
            ),
        );
        table.row(
            format!("{name}: peak memory of convert"),
            format!("{:.0} MiB", mib(peak(&self.all))),
            "default settings".into(),
        );
        for (what, samples) in [("threads", &self.one_thread), ("cores", &self.one_core)] {
            let one = seconds(samples);
            let fastest = least_seconds(samples) / least_seconds(&self.all);
            table.row(
                format!("{name}: 1 -> {} {what}", run::cores()),
                format!("{:.2} x", one / ours),
                format!("{one:.2} s with one; {fastest:.2} x between the fastest runs"),
            );
        }
        self.machine_rows(&name, table);
        let proof = seconds(&self.verify);
        table.row(
            format!("{name}: verify / convert"),
            format!("{:.2}", proof / ours),
            format!("{proof:.2} s, {:.0} MiB", mib(peak(&self.verify))),
        );
        table.row(
            format!("{name}: index entries per triangle"),
            format!("{:.3}", self.all[0].number("strip_indices") / triangles),
            "stitches included".into(),
        );
    }

    /// What the machine gave to all its cores meanwhile: threads can hardly gain more than that.
    fn machine_rows(&self, name: &str, table: &mut Table) {
        let (cores, ours) = (run::cores(), seconds(&self.all));
        let beside = median(self.side_by_side.iter().copied());
        let gain = cores as f64 * seconds(&self.one_thread) / beside;
        table.row(
            format!("{name}: 1 -> {cores} conversions of one thread each"),
            format!("{gain:.2} x"),
            format!(
                "at once, sharing nothing but the machine; threads of one gain {:.2} times that",
                beside / cores as f64 / ours
            ),
        );
        let least = least(self.cores.iter().copied());
        table.row(
            format!("{name}: arithmetic of {cores} threads / of one"),
            format!("{:.2} x", median(self.cores.iter().copied())),
            format!("what the machine gave meanwhile; {least:.2} at least"),
        );
    }

    /// What is told of a volume of another kind; `web` are conversions with `--for web`.
    fn rows_of_kind(&self, input: &Input, web: &[Sample], table: &mut Table) {
        let (name, ours) = (input.name(), seconds(&self.all));
        let triangles = self.all[0].number("triangles");
        let processor = |samples: &[Sample]| median(samples.iter().map(|s| s.processor));
        table.row(
            format!("{name}: convert"),
            format!("{ours:.3} s"),
            format!(
                "{:.2} s of processor time, {:.3} triangles per voxel, {:.0} MiB",
                processor(&self.all),
                triangles / input.voxels(),
                mib(peak(&self.all))
            ),
        );
        if let Some(surface) = self.surface.first() {
            let vtk = median(self.surface.iter().map(|s| s.number("seconds")));
            // where faces are ambiguous, others may have other triangles
            let theirs = surface.number("triangles") / triangles;
            table.row(
                format!("{name}: convert / {} Flying Edges", surface.text("version")),
                format!("{:.2}", ours / vtk),
                format!("{vtk:.3} s, {theirs:.4} times the triangles"),
            );
        }
        for (what, samples) in [
            ("verify / convert", &self.verify[..]),
            ("--for web / default", web),
        ] {
            let of_processor = processor(samples) / processor(&self.all);
            table.row(
                format!("{name}: {what}"),
                format!("{:.2}", seconds(samples) / ours),
                format!("{of_processor:.2} of processor time"),
            );
        }
        table.row(
            format!("{name}: index entries per triangle"),
            format!("{:.3}", self.all[0].number("strip_indices") / triangles),
            "stitches included".into(),
        );
    }

    /// # Errors
    /// If the surface has another number of triangles.
    fn peer_rows(&self, name: &str, table: &mut Table) -> Result<(), String> {
        let (ours, triangles) = (seconds(&self.all), self.all[0].number("triangles"));
        let found = self.surface[0].number("triangles");
        if found != triangles {
            return Err(format!("{name}: {triangles} triangles, VTK has {found}"));
        }
        let vtk = median(self.surface.iter().map(|s| s.number("seconds")));
        let version = self.surface[0].text("version");
        table.row(
            format!("{name}: convert / {version} Flying Edges"),
            format!("{:.2}", ours / vtk),
            format!("{vtk:.2} s for the surface in memory"),
        );
        let theirs = median(self.script.iter().map(|s| s.number("seconds")));
        table.row(
            format!("{name}: script / convert"),
            format!("{:.1}", theirs / ours),
            format!("{theirs:.1} s for cc3d, scikit-image and trimesh"),
        );
        let (vtk, ours) = (peak(&self.surface), peak(&self.all));
        table.row(
            format!("{name}: peak memory, Flying Edges / convert"),
            format!("{:.0}", vtk / ours),
            format!("{:.0} MiB / {:.0} MiB", mib(vtk), mib(ours)),
        );
        Ok(())
    }
}

fn input_args(input: &Input) -> Vec<String> {
    let mut args = vec![input.path.display().to_string()];
    args.extend(input.dims.iter().map(u32::to_string));
    args.extend([input.dtype.to_string(), input.threshold.to_string()]);
    args
}

/// True if a volume is converted in this of [`RUNS`] rounds: large ones in three of them, or in one.
fn takes_part(input: &Input, round: usize) -> bool {
    match input.voxels() {
        ..LARGE => true,
        ..5e9 => round % 3 == 1,
        _ => round == RUNS / 2,
    }
}

/// Conversions of each volume in those of [`RUNS`] rounds in which it takes part.
fn convert_in_turns(
    inputs: &[Input],
    sets: &mut Sets,
    takes_part: impl Fn(&Input, usize) -> bool,
) -> Result<Vec<Vec<Sample>>, String> {
    let mut samples: Vec<Vec<Sample>> = inputs.iter().map(|_| Vec::new()).collect();
    for round in 0..RUNS {
        for (input, samples) in inputs.iter().zip(&mut samples) {
            if takes_part(input, round) {
                samples.push(input.convert(sets, &[])?);
            }
        }
    }
    Ok(samples)
}

/// Nanoseconds per voxel of foams of rising size, in turns.
fn flatness(inputs: &[Input], sets: &mut Sets, table: &mut Table) -> Result<(), String> {
    let samples = convert_in_turns(inputs, sets, takes_part)?;
    let mut costs = Vec::new();
    for (input, samples) in inputs.iter().zip(&samples) {
        let cost = seconds(samples) / input.voxels() * 1e9;
        costs.push(cost);
        table.row(
            format!("{}: cost per voxel", input.name()),
            format!("{cost:.1} ns"),
            format!(
                "{:.2} triangles per voxel, {:.0} MiB, {} runs",
                samples[0].number("triangles") / input.voxels(),
                mib(peak(samples)),
                samples.len()
            ),
        );
    }
    let most = costs.iter().copied().fold(0.0, f64::max);
    let least = least(costs.iter().copied());
    table.row(
        "cost per voxel: most / least",
        format!("{:.2}", most / least),
        "of the volumes above".into(),
    );
    Ok(())
}

/// Ten times as deep as the larger volume of the race.
fn deep(input: &Input, sets: &mut Sets, table: &mut Table) -> Result<(), String> {
    let (mut made, mut proofs) = (Vec::new(), Vec::new());
    for _ in 0..3 {
        made.push(input.convert(sets, &[])?);
        proofs.push(Alvis::verify(&sets.last())?);
    }
    for (what, samples) in [("convert", &made), ("verify", &proofs)] {
        table.row(
            format!("{}: {what}", input.name()),
            format!("{:.1} s", seconds(samples)),
            format!("{:.0} MiB, {} runs", mib(peak(samples)), samples.len()),
        );
    }
    Ok(())
}

/// A real scan, repeated along z to 1 GB.
fn sparse(file: &Path, dir: &Path, sets: &mut Sets, table: &mut Table) -> Result<(), String> {
    let (x, y, slices) = (301u32, 324u32, 56u32);
    let one = std::fs::read(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let [bytes, times] = [u64::from(x * y * slices), 190];
    let Some(samples) = one.get(..bytes as usize) else {
        return Err(format!(
            "{}: {} bytes, expected {x} x {y} x {slices} samples of u8",
            file.display(),
            one.len()
        ));
    };
    let path = dir.join("lobsters.raw");
    std::fs::write(&path, samples.repeat(times as usize)).map_err(|e| e.to_string())?;
    let inputs = [40.0, 130.0].map(|threshold| Input {
        what: "lobster",
        path: path.clone(),
        dims: [x, y, slices * times as u32],
        dtype: "u8",
        threshold,
    });
    let samples = convert_in_turns(&inputs, sets, |_, _| true)?;
    for (input, samples) in inputs.iter().zip(&samples) {
        table.row(
            format!("lobster, {times} times, threshold {}", input.threshold),
            format!("{:.0} Mvoxel/s", input.voxels() / seconds(samples) / 1e6),
            format!(
                "{:.3} triangles per voxel, {RUNS} runs; {:.0} Mvoxel/s in the fastest",
                samples[0].number("triangles") / input.voxels(),
                input.voxels() / least_seconds(samples) / 1e6
            ),
        );
    }
    Ok(())
}

/// Volumes of other kinds.
fn kinds(
    inputs: &[Input],
    sets: &mut Sets,
    peers: Option<&Peer>,
    table: &mut Table,
) -> Result<(), String> {
    for input in inputs {
        let mut race = Race::default();
        let mut web = Vec::new();
        for _ in 0..RUNS_OF_KINDS {
            race.all.push(input.convert(sets, &[])?);
            race.verify.push(Alvis::verify(&sets.last())?);
            web.push(input.convert(sets, &["--for", "web"])?);
            if let Some(peer) = peers {
                sets.empty()?;
                race.surface.push(peer.run(input_args(input), "vtk")?);
            }
        }
        race.rows_of_kind(input, &web, table);
    }
    Ok(())
}

/// What to do.
#[derive(Default)]
struct Args {
    dir: Option<PathBuf>,
    python: Option<PathBuf>,
    lobster: Option<PathBuf>,
    deep: bool,
    kinds: bool,
}

fn args() -> Result<Args, String> {
    let mut args = Args::default();
    let mut given = std::env::args_os().skip(1);
    while let Some(arg) = given.next() {
        let mut value = || given.next().map(PathBuf::from).ok_or("a path is missing");
        match arg.to_str() {
            Some("--python") => args.python = Some(value()?),
            Some("--lobster") => args.lobster = Some(value()?),
            Some("--deep") => args.deep = true,
            Some("--kinds") => args.kinds = true,
            Some(option) if option.starts_with('-') => return Err(format!("unknown: {option}")),
            _ => args.dir = Some(arg.into()),
        }
    }
    Ok(args)
}

fn bench(args: &Args) -> Result<(), String> {
    let dir = args.dir.clone().unwrap_or_else(|| "target/bench".into());
    std::fs::create_dir_all(&dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let mut sets = Sets::new(dir.join("sets"))?;
    let peers = args.python.as_deref().map(Peer::new);
    let mut table = Table::default();
    println!("{}", run::machine());
    if args.kinds {
        let data = std::env::var_os("ALVIS_DATA").map(PathBuf::from);
        let mut inputs = kinds::made_up(&dir)?;
        inputs.extend(kinds::scans(
            &data.unwrap_or_else(|| "../shared/data".into()),
            &dir,
        )?);
        kinds(&inputs, &mut sets, peers.as_ref(), &mut table)?;
        table.print();
        return sets.delete();
    }
    for (dims, dtype) in [([313, 313, 380], "u8"), ([512; 3], "u16")] {
        race(
            &Input::phantom(&dir, "foam", dims, dtype)?,
            &mut sets,
            peers.as_ref(),
            &mut table,
        )?;
    }
    let mut sizes = vec![256, 512, 1024];
    sizes.extend(args.deep.then_some(2048));
    let sizes: Vec<_> = sizes
        .iter()
        .map(|&n| Input::phantom(&dir, "foam", [n; 3], "u8"))
        .collect::<Result<_, _>>()?;
    flatness(&sizes, &mut sets, &mut table)?;
    if args.deep {
        let input = Input::phantom(&dir, "foam", [512, 512, 5120], "u16")?;
        deep(&input, &mut sets, &mut table)?;
    }
    if let Some(file) = &args.lobster {
        sparse(file, &dir, &mut sets, &mut table)?;
    }
    table.print();
    sets.delete()
}

fn main() -> ExitCode {
    // the commands are run by this program itself, in processes of their own
    if let Some(command) = run::command() {
        return alvis::cli::run(command);
    }
    match args().and_then(|args| bench(&args)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("bench: {message}");
            ExitCode::from(2)
        }
    }
}
