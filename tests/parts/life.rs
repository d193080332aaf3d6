//! Parts in any order, twice, side by side, killed, stopped and woken.

use super::{Files, finish_with, plan};
use crate::command::{alvis, json, ok};
use crate::common::volumes::{Random, foam, late_joins, placed, volume};
use crate::common::{assert_same_files, converted, files, options};
use alvis::convert::parts::{
    Merged, NextMerge, NextWork, merge_parts, next_merge, next_work, work_on_part,
};
use alvis::convert::{ConvertOptions, NeckRule};
use alvis::progress::Quiet;
use alvis::volume::Volume;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

#[test]
fn parts_work_in_any_order_and_merges_come_at_any_time() {
    let (dims, values) = late_joins();
    let volume = volume(dims, values);
    let small = ConvertOptions {
        min_voxels: 3,
        ..options([16, 16, 6])
    };
    for seed in 0..4 {
        let options = ConvertOptions {
            split: (seed % 2 == 1).then(NeckRule::default),
            walls: seed > 1,
            ..small.clone()
        };
        let (whole, _) = converted(&volume, &options);
        let whole = files(whole.path());
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        let mut random = Random(seed);
        plan(&volume, &options, out, 7);
        let mut merges = 0;
        loop {
            match next_merge(out).unwrap() {
                NextMerge::InPlace => break,
                NextMerge::ToRun(..) if random.unit() < 0.7 => {
                    let part = (random.bits() % 7) as u32;
                    let next = next_work(out, part).unwrap();
                    work_on_part(&volume, &options, out, part, &Quiet).unwrap();
                    if let NextWork::Do(_) = next {
                        assert_ne!(next_work(out, part).unwrap(), next);
                    }
                }
                _ => {
                    merges += 1;
                    merge_parts(&volume, &options, out, &Quiet).unwrap();
                }
            }
        }
        assert!(merges > 5, "{merges}");
        assert_same_files(&whole, &files(out), &format!("seed {seed}"));
        // all of it once more changes nothing
        let merged = merge_parts(&volume, &options, out, &Quiet).unwrap();
        assert_eq!(merged, Merged::InPlace(None));
        work_on_part(&volume, &options, out, 3, &Quiet).unwrap();
        assert_eq!(next_work(out, 3).unwrap(), NextWork::Done);
        assert_same_files(&whole, &files(out), "twice");
    }
}

/// What one process makes, every second turn with cells that are split, and of three two with walls.
fn single_run(volume: &dyn Volume, turn: usize) -> (ConvertOptions, Files) {
    let options = ConvertOptions {
        split: (turn % 2 == 1).then(NeckRule::default),
        walls: !turn.is_multiple_of(3),
        ..options([8, 8, 5])
    };
    let (whole, _) = converted(volume, &options);
    (options, files(whole.path()))
}

#[test]
fn a_part_that_runs_twice_at_once_is_done_once() {
    let dims = [24, 20, 30];
    let volume = placed(dims, foam(dims, 2));
    for turn in 0..6 {
        let (options, whole) = single_run(&volume, turn);
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        plan(&volume, &options, out, 3);
        finish_with(&volume, &options, out, |parts| {
            std::thread::scope(|scope| {
                for part in parts.iter().chain(&parts) {
                    scope.spawn(|| work_on_part(&volume, &options, out, *part, &Quiet).unwrap());
                }
            });
        });
        assert_same_files(&whole, &files(out), "twice at once");
    }
}

/// A directory with `foam.mhd` and the files of its tile set, with `more` options.
fn foam_file(more: &str) -> (tempfile::TempDir, Files) {
    let dir = tempfile::tempdir().unwrap();
    let line = "phantom foam foam.mhd --dims 44,40,60 --pitch 11 --spacing 0.05 --unit mm --quiet";
    ok(dir.path(), &line.split(' ').collect::<Vec<_>>());
    ok(dir.path(), &words("convert foam.mhd whole", more));
    let whole = files(&dir.path().join("whole"));
    (dir, whole)
}

fn words<'a>(command: &'a str, more: &'a str) -> Vec<&'a str> {
    const OPTIONS: &str = "--threshold otsu --macrocube 16,16,8 --min-voxels 2 --quiet";
    [command, OPTIONS, more]
        .into_iter()
        .flat_map(str::split_whitespace)
        .collect()
}

fn code(dir: &Path, args: &[&str]) -> (i32, String) {
    let output = alvis(dir, args);
    let text = String::from_utf8(output.stdout).unwrap();
    (output.status.code().unwrap(), text)
}

#[test]
fn the_commands_convert_in_parts() {
    let (dir, whole) = foam_file("");
    let dir = dir.path();
    let planned = ok(dir, &words("plan foam.mhd out --parts 3", "--json"));
    let planned = json(&planned);
    for key in [
        "parts",
        "rounds",
        "memory_bytes",
        "bytes_read",
        "bytes_written",
        "files",
        "cpu_seconds",
    ] {
        assert!(planned[key].as_f64().unwrap() > 0.0, "{key}: {planned}");
    }
    assert_eq!(
        (&planned["parts"], &planned["rounds"]),
        (&3.into(), &5.into())
    );
    let merge = ["merge", "out", "--quiet"];
    let work = |part: &'static str| code(dir, &["work", "out", "--part", part, "--quiet"]).0;
    let mut rounds = 0;
    loop {
        match code(dir, &merge) {
            (0, text) => {
                assert_eq!(text, "");
                break;
            }
            (3, text) => assert_eq!(text, "0-2\n"),
            other => panic!("{other:?}"),
        }
        rounds += 1;
        assert_eq!(
            (work("1"), work("1")),
            (0, if rounds == 5 { 0 } else { 75 })
        );
        assert_eq!(code(dir, &merge), (3, "0,2\n".to_owned()));
        // every second one from 0 on
        let of = [
            "work", "out", "--part", "0", "--of", "2", "--quiet", "--memory", "300MiB",
        ];
        assert_eq!(code(dir, &of).0, 0);
    }
    assert_eq!(rounds, 5);
    assert_same_files(&whole, &files(&dir.join("out")), "commands");
    assert_eq!((code(dir, &merge).0, work("2")), (0, 0));
    let again = json(&ok(dir, &["merge", "out", "--json"]));
    assert_eq!(again["in_place"], true);
    ok(dir, &["verify", "out", "--against", "foam.mhd", "--quiet"]);
}

fn spawn(dir: &Path, args: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(args)
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// The parts that a merge asks for; `None` once the tile set is in place.
pub fn to_run(dir: &Path) -> Option<Vec<String>> {
    match code(dir, &["merge", "out", "--quiet"]) {
        (0, _) => None,
        (3, text) => {
            let mut parts = Vec::new();
            for run in text.trim().split(',') {
                let (first, last) = run.split_once('-').unwrap_or((run, run));
                let ends = [first, last].map(|n| n.parse::<u32>().unwrap());
                parts.extend((ends[0]..=ends[1]).map(|part| part.to_string()));
            }
            Some(parts)
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn work_and_merges_that_are_killed_are_done_again() {
    let mut random = Random(7);
    let mut pause = |most: f64| std::thread::sleep(Duration::from_secs_f64(most * random.unit()));
    let turns = ["", "--split", "--split 0.95 --split-h 0 --walls", "--walls"];
    for (turn, more) in turns.into_iter().enumerate() {
        let (dir, whole) = foam_file(more);
        let dir = dir.path();
        ok(dir, &words("plan foam.mhd out --parts 3", more));
        loop {
            for _ in 0..2 {
                let mut merge = spawn(dir, &["merge", "out"]);
                pause(0.1);
                let _ = merge.kill();
                merge.wait().unwrap();
            }
            let Some(parts) = to_run(dir) else { break };
            for part in &parts {
                for _ in 0..2 {
                    let mut work = spawn(dir, &["work", "out", "--part", part]);
                    pause(0.15);
                    let _ = work.kill();
                    work.wait().unwrap();
                }
                code(dir, &["work", "out", "--part", part, "--quiet"]);
            }
        }
        assert_same_files(&whole, &files(&dir.join("out")), &format!("turn {turn}"));
    }
}

fn signal(child: &Child, name: &str) {
    let pid = child.id().to_string();
    let sent = Command::new("kill").args([name, &pid]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn work_that_wakes_after_the_merge_changes_nothing() {
    let (dir, whole) = foam_file("");
    let dir = dir.path();
    let mut random = Random(3);
    for turn in 0..6 {
        ok(dir, &words("plan foam.mhd out --parts 3", ""));
        let (mut round, mut asleep) = (0, Vec::new());
        while let Some(parts) = to_run(dir) {
            // one of each round is stopped somewhere, and done by another
            let sleeper = spawn(dir, &["work", "out", "--part", "1"]);
            std::thread::sleep(Duration::from_secs_f64(0.12 * random.unit()));
            signal(&sleeper, "-STOP");
            asleep.push(sleeper);
            for part in &parts {
                code(dir, &["work", "out", "--part", part, "--quiet"]);
            }
            round += 1;
            assert!(round < 9);
        }
        assert_same_files(&whole, &files(&dir.join("out")), "before it wakes");
        for sleeper in &asleep {
            signal(sleeper, "-CONT");
        }
        for mut sleeper in asleep {
            assert_eq!(sleeper.wait().unwrap().code(), Some(0), "turn {turn}");
        }
        assert_same_files(&whole, &files(&dir.join("out")), "once it is awake");
        std::fs::remove_dir_all(dir.join("out")).unwrap();
    }
}

#[test]
fn two_merges_at_once_make_one_tile_set() {
    let dims = [24, 20, 30];
    let volume = placed(dims, foam(dims, 4));
    for turn in 0..6 {
        let (options, whole) = single_run(&volume, turn);
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        plan(&volume, &options, out, 4);
        finish_with(&volume, &options, out, |parts| {
            for part in parts {
                work_on_part(&volume, &options, out, part, &Quiet).unwrap();
            }
            std::thread::scope(|scope| {
                for _ in 0..2 {
                    scope.spawn(|| merge_parts(&volume, &options, out, &Quiet).unwrap());
                }
            });
        });
        assert_same_files(&whole, &files(out), "two merges");
    }
}
