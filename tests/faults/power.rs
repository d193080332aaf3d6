//! The power fails: what was not synced may be lost, cut or zeros, and the system starts anew.

use super::common::volumes::Random;
use super::common::{assert_same_files, files};
use super::{WORK, prepared, shim, shimmed, text};
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Files by name, and the names of directories.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tree {
    pub files: BTreeMap<String, Vec<u8>>,
    dirs: BTreeSet<String>,
}

impl Tree {
    pub fn read(root: &Path) -> Self {
        fn walk(root: &Path, dir: &Path, tree: &mut Tree) {
            for entry in std::fs::read_dir(dir).unwrap() {
                let path = entry.unwrap().path();
                let name = path
                    .strip_prefix(root)
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_string();
                if path.is_dir() {
                    tree.dirs.insert(name);
                    walk(root, &path, tree);
                } else {
                    tree.files.insert(name, std::fs::read(&path).unwrap());
                }
            }
        }
        let mut tree = Tree::default();
        if root.exists() {
            walk(root, root, &mut tree);
        }
        tree
    }

    pub fn write(&self, root: &Path) {
        let _ = std::fs::remove_dir_all(root);
        std::fs::create_dir_all(root).unwrap();
        for dir in &self.dirs {
            std::fs::create_dir_all(root.join(dir)).unwrap();
        }
        for (name, bytes) in &self.files {
            std::fs::write(root.join(name), bytes).unwrap();
        }
    }
}

/// What the disk may hold after the power has failed: the directories as they were when the process
/// died, and of each file what was synced, or something between that and what it was.
fn after_failure(synced: &Tree, died: &Tree, random: &mut Random) -> Tree {
    let on_disk: BTreeSet<&Vec<u8>> = synced.files.values().collect();
    let mut tree = died.clone();
    for (name, bytes) in &mut tree.files {
        if on_disk.contains(bytes) {
            continue;
        }
        match synced.files.get(name) {
            Some(old) => {
                // pages of the old and of the new, or one of them
                let mut mixed = if random.unit() < 0.5 {
                    bytes.clone()
                } else {
                    old.clone()
                };
                for at in (0..mixed.len()).step_by(4096) {
                    let page = at..(at + 4096).min(old.len()).min(bytes.len());
                    if page.start < page.end {
                        let from = if random.unit() < 0.5 { &*bytes } else { old };
                        mixed[page.clone()].copy_from_slice(&from[page]);
                    }
                }
                *bytes = mixed;
            }
            None => match random.bits() % 4 {
                0 => bytes.clear(),
                1 => bytes.fill(0),
                2 => bytes.truncate(bytes.len() / 2),
                _ => {}
            },
        }
    }
    tree
}

/// Converts with syncs after every layer, kills at random moments, takes away what was not synced, and
/// goes on, `failures` times.
fn power_fails(test: &str, more: &str, failures: u32, seed: u64) {
    let Some(shim) = shim(test) else { return };
    let line = format!("{}{more}", super::CONVERT.replace("13,12,7", "13,12,2"));
    let (_dir, here, expected) = prepared(&line);
    let (out, synced) = (here.join("out"), here.join("synced"));
    let boot = here.join("boot");
    std::fs::write(&boot, "first\n").unwrap();
    let command = || {
        let mut command = shimmed(shim, &here, &line);
        command
            .arg("--resume")
            .env("SHIM_SYNCED", &synced)
            .env("SHIM_OUT", &out)
            .env("SHIM_BOOT", &boot)
            .env("SHIM_HURRY", "1")
            .stdout(Stdio::null());
        command
    };
    let start = Instant::now();
    let undisturbed = command().output().unwrap();
    assert!(undisturbed.status.success(), "{}", text(&undisturbed));
    let time = start.elapsed().as_secs_f64();
    assert_same_files(&files(&out), &expected, test);
    assert!(synced.join(WORK).join("checkpoint.safe.new").exists());
    let mut random = Random(seed);
    let (mut resumed, mut ends, mut anew) = (0, 0, 0);
    let clear = || {
        let _ = std::fs::remove_dir_all(&out);
        for entry in std::fs::read_dir(&here).unwrap() {
            let path = entry.unwrap().path();
            if path.is_symlink() {
                std::fs::remove_file(&path).unwrap();
            } else if path.is_dir() {
                std::fs::remove_dir_all(&path).unwrap();
            }
        }
    };
    clear();
    for failure in 0..failures {
        let mut child = command();
        let mut child = child
            .process_group(0)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs_f64(time * random.unit()));
        let ended = child.try_wait().unwrap();
        // with the processes that take a snapshot
        let group = format!("-{}", child.id());
        let _ = Command::new("kill").args(["-KILL", "--", &group]).output();
        let status = ended.unwrap_or(child.wait().unwrap());
        if status.success() {
            assert_same_files(&files(&out), &expected, test);
            clear();
            ends += 1;
            continue;
        }
        assert_eq!(status.code(), None);
        let (on_disk, died) = (Tree::read(&synced), Tree::read(&out));
        let left = match random.bits() % 3 {
            0 => on_disk,
            _ => after_failure(&on_disk, &died, &mut random),
        };
        left.write(&out);
        std::fs::write(&boot, format!("boot {failure}\n")).unwrap();
        let output = command().output().unwrap();
        let errors = text(&output);
        assert!(output.status.success(), "{failure}: {errors}");
        assert_same_files(&files(&out), &expected, &format!("{test}: {failure}"));
        match errors.contains("warning: resuming: ") {
            true => resumed += 1,
            false => anew += 1,
        }
        clear();
    }
    eprintln!(
        "{test}: {resumed} went on after a power failure, {anew} began anew, {ends} had ended before"
    );
    assert!(resumed > 0, "{test}");
}

#[test]
fn the_power_fails_at_any_moment() {
    power_fails("the_power_fails_at_any_moment", "", 20, 1);
}

#[test]
fn the_power_fails_while_small_components_are_found() {
    power_fails(
        "the_power_fails_while_small_components_are_found",
        " --for web --min-voxels 20",
        20,
        2,
    );
}
