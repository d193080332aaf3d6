//! Commands in processes of their own, timed.

use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// First argument of a process that stands for the command.
const COMMAND: &str = "--alvis";

/// The arguments of the command that this process is to be, if it is.
pub fn command() -> Option<Vec<OsString>> {
    let mut args: Vec<OsString> = std::env::args_os().collect();
    (args.get(1)? == COMMAND).then(|| {
        args.remove(1);
        args
    })
}

/// A finished process.
pub struct Sample {
    /// Seconds from start to end.
    pub wall: f64,
    /// Seconds of processor time of all its threads, in hundredths: what a busy machine disturbs least.
    pub processor: f64,
    report: Value,
}

impl Sample {
    /// A number of its JSON report.
    pub fn number(&self, key: &str) -> f64 {
        self.report[key].as_f64().unwrap_or(f64::NAN)
    }

    /// A text of its JSON report.
    pub fn text(&self, key: &str) -> &str {
        self.report[key].as_str().unwrap_or("")
    }
}

/// Runs a command to its end, begun with all cores awake.
pub fn timed(mut command: Command) -> Result<Sample, String> {
    wake_all_cores();
    let before = processor_of_children();
    let start = Instant::now();
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| format!("{command:?}: {e}"))?;
    let wall = start.elapsed().as_secs_f64();
    if !output.status.success() {
        return Err(format!("{command:?}: {}", output.status));
    }
    let report = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    Ok(Sample {
        wall,
        processor: processor_of_children() - before,
        report,
    })
}

/// Seconds of processor time of all processes that this one has started and waited for.
fn processor_of_children() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // behind the name, which may hold blanks: the numbers 16 and 17 of all
    let numbers = stat.rsplit(") ").next().unwrap_or_default().split(' ');
    let ticks: f64 = numbers
        .skip(13)
        .take(2)
        .filter_map(|n| n.parse::<f64>().ok())
        .sum();
    ticks / rustix::param::clock_ticks_per_second() as f64
}

/// Runs commands at once, begun with all cores awake; seconds until the last one has ended.
pub fn timed_at_once(mut commands: Vec<Command>) -> Result<f64, String> {
    wake_all_cores();
    let start = Instant::now();
    let children: Vec<_> = commands
        .iter_mut()
        .map(|command| command.stdin(Stdio::null()).stdout(Stdio::null()).spawn())
        .collect();
    let ends: Vec<_> = children
        .into_iter()
        .map(|child| child.and_then(|mut child| child.wait()))
        .collect();
    let wall = start.elapsed().as_secs_f64();
    for (command, end) in commands.iter().zip(ends) {
        match end {
            Ok(status) if status.success() => (),
            Ok(status) => return Err(format!("{command:?}: {status}")),
            Err(e) => return Err(format!("{command:?}: {e}")),
        }
    }
    Ok(wall)
}

/// The command itself.
pub struct Alvis;

impl Alvis {
    /// With these arguments.
    pub fn command<S: AsRef<OsStr>>(args: &[S]) -> Result<Command, String> {
        let mut command = Command::new(Alvis::program()?);
        command.arg(COMMAND).args(args);
        Ok(command)
    }

    /// On one core.
    pub fn command_on_one_core<S: AsRef<OsStr>>(args: &[S]) -> Result<Command, String> {
        let mut command = Command::new("taskset");
        command.args(["--cpu-list", "0"]).arg(Alvis::program()?);
        command.arg(COMMAND).args(args);
        Ok(command)
    }

    /// Verifies a set.
    pub fn verify(set: &str) -> Result<Sample, String> {
        timed(Alvis::command(&["verify", set, "--json", "--quiet"])?)
    }

    fn program() -> Result<PathBuf, String> {
        std::env::current_exe().map_err(|e| e.to_string())
    }
}

/// Other programs, run by `peers.py`.
pub struct Peer {
    python: PathBuf,
}

impl Peer {
    /// With this interpreter.
    pub fn new(python: &Path) -> Self {
        Peer {
            python: python.to_path_buf(),
        }
    }

    /// Runs one of them on a volume.
    pub fn run(&self, volume: Vec<String>, name: &str) -> Result<Sample, String> {
        let mut command = Command::new(&self.python);
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/bench/peers.py");
        command.arg(script).args(volume).arg(name);
        timed(command)
    }
}

/// The one in the middle.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The smallest one.
pub fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

/// Threads that the machine runs at once.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get())
}

/// How much more arithmetic threads on all cores do than one thread does alone.
///
/// Cores of a virtual machine may be two threads of one core, or become so for a while: then this falls to 1, and
/// no program can gain much by a second thread.
pub fn work_of_all_cores() -> f64 {
    wake_all_cores();
    let before = rate();
    let all: f64 = rates_of_all_cores().into_iter().sum();
    all / before.max(rate())
}

/// Lets all cores work for a moment. Those that sleep may take a while to wake, and those of a virtual machine to
/// be given to it again, which would be measured with whatever runs next.
pub fn wake_all_cores() {
    rates_of_all_cores();
}

/// Rounds of arithmetic per second of a thread on each core, all at once.
fn rates_of_all_cores() -> Vec<f64> {
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores()).map(|_| scope.spawn(rate)).collect();
        let rates = threads.into_iter().map(|t| t.join().expect("no panic"));
        rates.collect()
    })
}

/// Rounds of arithmetic per second of this thread, measured for some hundredths of one.
fn rate() -> f64 {
    const ROUNDS: u64 = 2_000_000;
    let start = Instant::now();
    let mut lanes: [u64; 32] = std::array::from_fn(|i| i as u64);
    for round in 0..ROUNDS {
        lanes.iter_mut().for_each(|v| *v = (*v << 1) ^ (*v + round));
    }
    std::hint::black_box(lanes);
    ROUNDS as f64 / start.elapsed().as_secs_f64()
}

/// A line about the machine and the version.
pub fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map_or("unknown processor", |rest| {
            rest.trim_start_matches(['\t', ' ', ':'])
        });
    format!(
        "alvis {}, {} threads of {model}",
        env!("CARGO_PKG_VERSION"),
        cores()
    )
}
