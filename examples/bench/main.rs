//! How fast, beside what else there is: whole processes on the same volumes, taken in turns.
//!
//! ```sh
//! cargo run --release --example bench -- [DIRECTORY] [--python PYTHON] [--deep] [--lobster FILE]
//! ```
//!
//! Makes foams in DIRECTORY (by default `target/bench`; with what comes of them 25 GiB, with `--deep` 80 GiB), and prints a table
//! of medians as Markdown. With the PYTHON of an environment that has the packages that `peers.py`
//! beside this file names, others race along. `--deep` adds the volumes of ten times the depth and of
//! eight times the voxels; `--lobster` adds a real scan (301 x 324 x 56, u8) repeated to 1 GB.

mod run;

use run::{Alvis, Peer, Sample, median};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Runs of each command, in turns.
const RUNS: usize = 5;

/// A volume on disk.
struct Input {
    path: PathBuf,
    dims: [u32; 3],
    dtype: &'static str,
    threshold: f64,
}

impl Input {
    fn voxels(&self) -> f64 {
        self.dims.iter().map(|&n| f64::from(n)).product()
    }

    fn name(&self) -> String {
        let [x, y, z] = self.dims;
        format!("{x} x {y} x {z} {}", self.dtype)
    }

    /// Makes a foam, unless a file of that size is there.
    fn foam(dir: &Path, dims: [u32; 3], dtype: &'static str) -> Result<Input, String> {
        let [x, y, z] = dims;
        let path = dir.join(format!("foam_{x}x{y}x{z}_{dtype}.raw"));
        let (bytes, threshold) = match dtype {
            "u8" => (1, 127.5),
            _ => (2, 32_767.5),
        };
        let input = Input {
            path,
            dims,
            dtype,
            threshold,
        };
        let size = input.voxels() as u64 * bytes;
        if std::fs::metadata(&input.path).map_or(0, |m| m.len()) != size {
            let text = format!("{x},{y},{z}");
            let path = input.path.display().to_string();
            let args = ["phantom", "foam", &path, "--dims", &text, "--dtype", dtype];
            Alvis::run(&[&args[..], &["--force", "--quiet"]].concat())?;
        }
        Ok(input)
    }

    /// Converts into a directory that is not there: removing an old one is no part of it. That one is
    /// moved aside until the end, since ext4 looks long for room for a file right after others were
    /// deleted (half a conversion of thousands of small tiles).
    fn convert(&self, out: &Path, more: &[&str]) -> Result<Sample, String> {
        let fail = |e: std::io::Error| format!("{}: {e}", out.display());
        if out.exists() {
            let aside = aside(out);
            std::fs::create_dir_all(&aside).map_err(fail)?;
            let count = std::fs::read_dir(&aside).map_err(fail)?.count();
            std::fs::rename(out, aside.join(count.to_string())).map_err(fail)?;
        }
        let [x, y, z] = self.dims;
        let (dims, threshold) = (format!("{x},{y},{z}"), self.threshold.to_string());
        let (input, out) = (self.path.display().to_string(), out.display().to_string());
        let args = [
            "convert",
            &input,
            &out,
            "--dims",
            &dims,
            "--dtype",
            self.dtype,
            "--threshold",
            &threshold,
            "--json",
            "--quiet",
        ];
        Alvis::run(&[&args[..], more].concat())
    }
}

/// Where earlier results wait for their end.
fn aside(out: &Path) -> PathBuf {
    out.with_extension("old")
}

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

/// Conversion, verification and others on one volume.
fn race(input: &Input, out: &Path, peers: Option<&Peer>, table: &mut Table) -> Result<(), String> {
    let (mut two, mut one, mut proof) = (Vec::new(), Vec::new(), Vec::new());
    let (mut surface, mut script) = (Vec::new(), Vec::new());
    let set = out.display().to_string();
    for run in 0..RUNS {
        two.push(input.convert(out, &[])?);
        proof.push(Alvis::run(&["verify", &set, "--json", "--quiet"])?);
        if let Some(peer) = peers {
            surface.push(peer.run(input_args(input), "vtk")?);
            if run == 0 {
                script.push(peer.run(input_args(input), "script")?);
            }
        }
        one.push(input.convert(out, &["--threads", "1"])?);
    }
    let name = input.name();
    let seconds = |samples: &[Sample]| median(samples.iter().map(|s| s.wall));
    let peak = |samples: &[Sample]| median(samples.iter().map(|s| s.number("peak_rss_bytes")));
    let (ours, triangles) = (seconds(&two), two[0].number("triangles"));
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
    if !surface.is_empty() {
        let found = surface[0].number("triangles");
        if found != triangles {
            return Err(format!("{name}: {triangles} triangles, VTK has {found}"));
        }
        let vtk = median(surface.iter().map(|s| s.number("seconds")));
        table.row(
            format!(
                "{name}: convert / {} Flying Edges",
                surface[0].text("version")
            ),
            format!("{:.2}", ours / vtk),
            format!("{vtk:.2} s for the surface in memory"),
        );
        let theirs = median(script.iter().map(|s| s.number("seconds")));
        table.row(
            format!("{name}: script / convert"),
            format!("{:.1}", theirs / ours),
            format!("{theirs:.1} s for cc3d, scikit-image and trimesh"),
        );
        table.row(
            format!("{name}: peak memory, Flying Edges / convert"),
            format!("{:.0}", peak(&surface) / peak(&two)),
            format!(
                "{:.0} MiB / {:.0} MiB",
                mib(peak(&surface)),
                mib(peak(&two))
            ),
        );
    }
    table.row(
        format!("{name}: peak memory of convert"),
        format!("{:.0} MiB", mib(peak(&two))),
        "default settings".into(),
    );
    table.row(
        format!("{name}: 1 -> {} threads", run::cores()),
        format!("{:.2} x", seconds(&one) / ours),
        format!("{:.2} s with one", seconds(&one)),
    );
    table.row(
        format!("{name}: verify / convert"),
        format!("{:.2}", seconds(&proof) / ours),
        format!("{:.2} s, {:.0} MiB", seconds(&proof), mib(peak(&proof))),
    );
    table.row(
        format!("{name}: index entries per triangle"),
        format!("{:.3}", two[0].number("strip_indices") / triangles),
        "stitches included".into(),
    );
    Ok(())
}

fn input_args(input: &Input) -> Vec<String> {
    let mut args = vec![input.path.display().to_string()];
    args.extend(input.dims.iter().map(u32::to_string));
    args.extend([input.dtype.to_string(), input.threshold.to_string()]);
    args
}

/// Nanoseconds per voxel of foams of rising size.
fn flatness(inputs: &[Input], out: &Path, table: &mut Table) -> Result<(), String> {
    for input in inputs {
        let runs = if input.voxels() < 1e9 { RUNS } else { 2 };
        let samples: Vec<_> = (0..runs)
            .map(|_| input.convert(out, &[]))
            .collect::<Result<_, _>>()?;
        let seconds = median(samples.iter().map(|s| s.wall));
        table.row(
            format!("{}: cost per voxel", input.name()),
            format!("{:.1} ns", seconds / input.voxels() * 1e9),
            format!(
                "{:.2} triangles per voxel, {:.0} MiB",
                samples[0].number("triangles") / input.voxels(),
                mib(samples[0].number("peak_rss_bytes"))
            ),
        );
    }
    Ok(())
}

/// A real scan, repeated along z to 1 GB.
fn sparse(file: &Path, dir: &Path, out: &Path, table: &mut Table) -> Result<(), String> {
    let (x, y, slices) = (301u32, 324u32, 56u32);
    let one = std::fs::read(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let [bytes, times] = [u64::from(x * y * slices), 190];
    let samples = &one[..bytes as usize];
    let path = dir.join("lobsters.raw");
    std::fs::write(&path, samples.repeat(times as usize)).map_err(|e| e.to_string())?;
    for threshold in [40.0, 130.0] {
        let input = Input {
            path: path.clone(),
            dims: [x, y, slices * times as u32],
            dtype: "u8",
            threshold,
        };
        let runs: Vec<_> = (0..3)
            .map(|_| input.convert(out, &[]))
            .collect::<Result<_, _>>()?;
        let seconds = median(runs.iter().map(|s| s.wall));
        table.row(
            format!("lobster, {times} times, threshold {threshold}"),
            format!("{:.0} Mvoxel/s", input.voxels() / seconds / 1e6),
            format!(
                "{:.3} triangles per voxel",
                runs[0].number("triangles") / input.voxels()
            ),
        );
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
            Some(option) if option.starts_with('-') => return Err(format!("unknown: {option}")),
            _ => args.dir = Some(arg.into()),
        }
    }
    Ok(args)
}

fn bench(args: &Args) -> Result<(), String> {
    let dir = args.dir.clone().unwrap_or_else(|| "target/bench".into());
    std::fs::create_dir_all(&dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let out = dir.join("tiles");
    let peers = args.python.as_deref().map(Peer::new);
    let mut table = Table::default();
    println!("{}", run::machine());
    for (dims, dtype) in [([313, 313, 380], "u8"), ([512; 3], "u16")] {
        race(
            &Input::foam(&dir, dims, dtype)?,
            &out,
            peers.as_ref(),
            &mut table,
        )?;
    }
    let mut sizes = vec![256, 512, 1024];
    sizes.extend(args.deep.then_some(1536));
    let sizes: Vec<_> = sizes
        .iter()
        .map(|&n| Input::foam(&dir, [n; 3], "u8"))
        .collect::<Result<_, _>>()?;
    flatness(&sizes, &out, &mut table)?;
    if args.deep {
        flatness(
            &[Input::foam(&dir, [512, 512, 5120], "u16")?],
            &out,
            &mut table,
        )?;
    }
    if let Some(file) = &args.lobster {
        sparse(file, &dir, &out, &mut table)?;
    }
    table.print();
    for directory in [aside(&out), out] {
        std::fs::remove_dir_all(&directory).map_err(|e| format!("{}: {e}", directory.display()))?;
    }
    Ok(())
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
