//! Running the command inside a memory cgroup, where the machine lets a test make one.
#![allow(dead_code)] // each test binary uses a part

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

pub const MIB: u64 = 1 << 20;

/// A memory cgroup of this test, removed when dropped.
pub struct Cgroup {
    dir: PathBuf,
    peak: &'static str,
}

impl Cgroup {
    /// One below the test's own group with a limit in bytes; `None` if the machine has or lets none.
    pub fn new(limit: u64) -> Option<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
        let own = |line: &str| {
            line.rsplit(':')
                .next()
                .map(|p| p.trim_start_matches('/').to_string())
        };
        let (root, own, file, peak) = match groups.lines().find(|l| l.contains(":memory:")) {
            Some(line) => (
                "/sys/fs/cgroup/memory",
                own(line)?,
                "memory.limit_in_bytes",
                "memory.max_usage_in_bytes",
            ),
            None => {
                let line = groups.lines().find(|l| l.starts_with("0::"))?;
                ("/sys/fs/cgroup", own(line)?, "memory.max", "memory.peak")
            }
        };
        let name = format!(
            "alvis-test-{}-{}",
            std::process::id(),
            NUMBER.fetch_add(1, Ordering::Relaxed)
        );
        // the group that the process tells of may be out of sight inside a container
        let parent = [Path::new(root).join(own), root.into()]
            .into_iter()
            .find(|p| p.join(file).exists() || p == Path::new(root))?;
        let dir = parent.join(name);
        fs::create_dir(&dir).ok()?;
        let group = Cgroup { dir, peak };
        fs::write(group.dir.join(file), limit.to_string()).ok()?;
        // swap would let a process keep more than its resident memory
        let _ = fs::write(group.dir.join("memory.swap.max"), "0");
        let _ = fs::write(group.dir.join("memory.swappiness"), "0");
        Some(group)
    }

    fn peak(&self) -> u64 {
        let text = fs::read_to_string(self.dir.join(self.peak)).unwrap_or_default();
        text.trim().parse().unwrap_or(0)
    }
}

impl Drop for Cgroup {
    fn drop(&mut self) {
        let _ = fs::remove_dir(&self.dir);
    }
}

/// A directory on the disk, as far as what lies beside the build does: a cgroup counts files that are held in memory,
/// as those of many a directory for temporary files are.
pub fn on_disk() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

/// Runs the command in `dir`, see [`on_disk`], in a cgroup of `limit` bytes if one can be had.
pub fn alvis(dir: &Path, limit: Option<u64>, args: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_alvis");
    let group = limit.and_then(Cgroup::new);
    let mut command = match &group {
        Some(group) => {
            let mut shell = Command::new("sh");
            shell
                .args(["-c", "echo $$ > \"$0\" && exec \"$@\""])
                .arg(group.dir.join("cgroup.procs"))
                .arg(program);
            shell
        }
        None => Command::new(program),
    };
    command.args(args).current_dir(dir).env("TMPDIR", dir);
    let output = command.output().unwrap();
    match group {
        Some(group) => println!(
            "{} in a cgroup of {:?}: peak with file cache {}",
            args[0],
            limit,
            group.peak()
        ),
        None if limit.is_some() => eprintln!(
            "SKIPPED the cgroup: this machine lets the test make none; resident memory is measured"
        ),
        None => {}
    }
    output
}

/// Runs what must succeed and prints one JSON object.
pub fn report(dir: &Path, limit: Option<u64>, args: &[&str]) -> Value {
    let output = alvis(dir, limit, args);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{args:?}: {}: {errors}",
        output.status
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    println!(
        "{}: peak RSS {} MiB in {} s",
        args[0],
        report["peak_rss_bytes"].as_u64().unwrap() / MIB,
        report["seconds"]
    );
    report
}
