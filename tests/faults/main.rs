//! Every file operation of a conversion fails, in turn and in every way; the disk is full; the power
//! fails; the input is cut. A conversion then ends with a message and goes on with `--resume`, or
//! it notices nothing. Levels of detail are killed before every change of a file.
//!
//! `shim.c` stands between the command and the C library. Without a C compiler these tests say that
//! they skip.

#[path = "../command/mod.rs"]
mod command;
#[path = "../common/mod.rs"]
mod common;

mod levels;
mod parts;
mod power;

use command::ok;
use common::{assert_same_files, files};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

const WORK: &str = ".alvis-partial";
const CONVERT: &str =
    "convert foam.raw out --dims 24,22,20 --dtype u8 --threshold 128 --macrocube 13,12,7";

const EINTR: u32 = 4;
const EIO: u32 = 5;
const EACCES: u32 = 13;
const EINVAL: u32 = 22;
const ENOSPC: u32 = 28;
const ENOSYS: u32 = 38;
/// Not an errno: half of what was asked for.
const SHORT: u32 = 0;

/// The compiled shim, or `None` after saying that the test is skipped.
fn shim(test: &str) -> Option<&'static Path> {
    static SHIM: OnceLock<Option<PathBuf>> = OnceLock::new();
    let built = SHIM.get_or_init(|| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults/shim.c");
        let to = Path::new(env!("CARGO_TARGET_TMPDIR")).join("shim.so");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-o"])
            .args([&to, &source])
            .arg("-ldl")
            .output();
        match compiled {
            Ok(output) if output.status.success() => Some(to),
            Ok(output) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
            Err(_) => None,
        }
    });
    if built.is_none() {
        eprintln!("SKIPPED {test}: no C compiler `cc`");
    }
    built.as_deref()
}

/// The command with the shim before it.
fn shimmed(shim: &Path, here: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_alvis"));
    command
        .args(line.split(' '))
        .current_dir(here)
        .env("LD_PRELOAD", shim)
        .env("SHIM_DIR", here);
    command
}

/// A directory with a small foam, by its real path, and the files of its conversion by this line.
fn prepared(line: &str) -> (tempfile::TempDir, PathBuf, BTreeMap<String, Vec<u8>>) {
    prepared_of("24,22,20", line)
}

/// The same of a foam of this size.
fn prepared_of(dims: &str, line: &str) -> (tempfile::TempDir, PathBuf, BTreeMap<String, Vec<u8>>) {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path().canonicalize().unwrap();
    let phantom = format!("phantom foam foam.raw --dims {dims} --pitch 9 --quiet");
    ok(&here, &phantom.split(' ').collect::<Vec<_>>());
    ok(&here, &line.split(' ').collect::<Vec<_>>());
    let expected = files(&here.join("out"));
    std::fs::remove_dir_all(here.join("out")).unwrap();
    (dir, here, expected)
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Checks how a conversion ended that met a fault, then goes on without.
fn judge(
    here: &Path,
    line: &str,
    output: &Output,
    expected: &BTreeMap<String, Vec<u8>>,
    what: &str,
) -> bool {
    let out = here.join("out");
    let errors = text(output);
    let failed = match output.status.code() {
        Some(0) => false,
        Some(2) => true,
        code => panic!("{what}: {code:?}: {errors}"),
    };
    if failed {
        let messages: Vec<_> = errors
            .lines()
            .filter(|l| l.starts_with("alvis: "))
            .collect();
        assert_eq!(messages.len(), 1, "{what}: {errors}");
        let named = messages[0].contains("out") || messages[0].contains("foam.raw");
        assert!(
            named && messages[0].contains(": cannot "),
            "{what}: {errors}"
        );
        assert!(messages[0].contains("(os error"), "{what}: {errors}");
        // what nobody gets to see has no name for the user
        assert!(!messages[0].contains(WORK), "{what}: {errors}");
        if out.exists() {
            for (name, bytes) in files(&out) {
                let whole = name.starts_with(WORK) || expected.get(&name) == Some(&bytes);
                assert!(whole, "{what}: {name} is not whole");
            }
        }
        let again = command::alvis(
            here,
            &format!("{line} --resume").split(' ').collect::<Vec<_>>(),
        );
        assert!(again.status.success(), "{what}: {errors}: {}", text(&again));
    }
    let found = files(&out);
    assert_same_files(&found, expected, what);
    std::fs::remove_dir_all(&out).unwrap();
    failed
}

/// Lets every `step`th operation go wrong, each in the ways that it can.
fn every_operation(test: &str, more: &str, step: usize) {
    let Some(shim) = shim(test) else { return };
    let line = format!("{CONVERT} --threads 1{more}");
    let (_dir, here, expected) = prepared(&line);
    let log = here.with_extension("log");
    let _ = std::fs::remove_file(&log);
    let counted = shimmed(shim, &here, &line)
        .env("SHIM_LOG", &log)
        .output()
        .unwrap();
    assert!(counted.status.success(), "{}", text(&counted));
    std::fs::remove_dir_all(here.join("out")).unwrap();
    let operations = std::fs::read_to_string(&log).unwrap();
    std::fs::remove_file(&log).unwrap();
    let mut tally = BTreeMap::<(String, u32), (u32, u32)>::new();
    for operation in operations.lines().step_by(step) {
        let mut parts = operation.split(' ');
        let (number, name) = (parts.next().unwrap(), parts.next().unwrap());
        let turn = |ways: &[u32]| ways[number.parse::<usize>().unwrap() % ways.len()];
        let ways = match name {
            "read" => vec![EIO, turn(&[EINTR, SHORT])],
            "write" => vec![turn(&[ENOSPC, EIO]), turn(&[EINTR, SHORT, SHORT])],
            "open" => vec![turn(&[EACCES, EIO, EINTR])],
            "create" | "mkdir" => vec![turn(&[ENOSPC, EACCES])],
            _ => vec![turn(&[EIO, EACCES])],
        };
        for way in ways {
            let output = shimmed(shim, &here, &line)
                .env("SHIM_AT", number)
                .env("SHIM_ERRNO", way.to_string())
                .output()
                .unwrap();
            let failed = judge(
                &here,
                &line,
                &output,
                &expected,
                &format!("{way}: {operation}"),
            );
            let counts = tally.entry((name.to_string(), way)).or_default();
            counts.0 += 1;
            counts.1 += u32::from(failed);
        }
    }
    eprintln!(
        "{test}: {} operations; (name, errno): (times, of these ended): {tally:?}",
        operations.lines().count()
    );
    for ((name, way), (times, failed)) in tally {
        // nobody sees these
        let harmless = way == SHORT || way == EINTR || name == "close";
        if harmless {
            assert_eq!(failed, 0, "{name}, {way}");
        } else if !["flock", "opendir", "open", "unlinkat", "rmdir", "unlink"].contains(&&*name) {
            assert_eq!(failed, times, "{name}, {way}");
        }
    }
}

#[test]
fn every_file_operation_of_a_conversion() {
    every_operation("every_file_operation_of_a_conversion", "", 1);
}

#[test]
fn a_sync_behind_the_work_that_fails() {
    let Some(shim) = shim("a_sync_behind_the_work_that_fails") else {
        return;
    };
    let line = CONVERT.replace("13,12,7", "13,12,2");
    let (_dir, here, expected) = prepared(&line);
    // the last two say that the file system cannot do it, which is no failure
    for (error, ends) in [
        (EIO, true),
        (ENOSPC, true),
        (EINVAL, false),
        (ENOSYS, false),
    ] {
        for number in ["1", "2"] {
            let output = shimmed(shim, &here, &line)
                .env("SHIM_HURRY", "1")
                .env("SHIM_NAME", "syncfs")
                .env("SHIM_AT", number)
                .env("SHIM_ERRNO", error.to_string())
                .output()
                .unwrap();
            let what = format!("sync {number}, {error}");
            assert_eq!(ends, text(&output).contains(": cannot sync: "), "{what}");
            assert_eq!(ends, judge(&here, &line, &output, &expected, &what));
        }
    }
}

#[test]
fn file_operations_with_small_components() {
    every_operation(
        "file_operations_with_small_components",
        " --for web --min-voxels 20",
        5,
    );
}

#[test]
fn writes_of_tiles_that_go_past_the_page_cache() {
    let Some(shim) = shim("writes_of_tiles_that_go_past_the_page_cache") else {
        return;
    };
    let line = CONVERT
        .replace("24,22,20", "66,60,33")
        .replace("13,12,7", "33,60,16");
    let (_dir, here, expected) = prepared_of("66,60,33", &line);
    let long = |bytes: &&Vec<u8>| bytes.len() > 256 << 10;
    assert_eq!(expected.values().filter(long).count(), 4);
    let with = |at: Option<usize>, way: u32, log: &Path| {
        let mut command = shimmed(shim, &here, &line);
        command.env("SHIM_NAME", "write").env("SHIM_LOG", log);
        if let Some(at) = at {
            command.env("SHIM_AT", at.to_string());
        }
        command.env("SHIM_ERRNO", way.to_string()).output().unwrap()
    };
    let log = here.with_extension("log");
    assert!(with(None, EIO, &log).status.success());
    std::fs::remove_dir_all(here.join("out")).unwrap();
    let writes = std::fs::read_to_string(&log).unwrap();
    std::fs::remove_file(&log).unwrap();
    // those of tiles begin early; threads write, so a number does not always stand for the same one
    for number in 1..=writes.lines().count().min(40) {
        for (way, ends) in [(EIO, true), (ENOSPC, true), (EINTR, false), (SHORT, false)] {
            let output = with(Some(number), way, Path::new("/dev/null"));
            let what = format!("{way}: write {number}");
            assert_eq!(
                judge(&here, &line, &output, &expected, &what),
                ends,
                "{what}"
            );
        }
    }
}

#[test]
fn a_disk_that_is_full_from_some_moment_on() {
    let Some(shim) = shim("a_disk_that_is_full_from_some_moment_on") else {
        return;
    };
    let line = format!("{CONVERT} --threads 1");
    let (_dir, here, expected) = prepared(&line);
    let mut resumable = 0;
    for number in (5..400).step_by(17) {
        let output = shimmed(shim, &here, &line)
            .env("SHIM_AT", number.to_string())
            .env("SHIM_ERRNO", ENOSPC.to_string())
            .env("SHIM_STICKY", "1")
            .output()
            .unwrap();
        resumable += u32::from(text(&output).contains("--resume` goes on"));
        judge(
            &here,
            &line,
            &output,
            &expected,
            &format!("from {number} on"),
        );
    }
    eprintln!("{resumable} went on with layers");
    assert!(resumable > 2, "{resumable}");
}

#[test]
fn a_full_disk() {
    const TEST: &str = "a_full_disk";
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let disk = here.join("disk");
    std::fs::create_dir(&disk).unwrap();
    let mount = |args: &[&str]| {
        let run = Command::new("mount").args(args).arg(&disk).output();
        run.is_ok_and(|o| o.status.success())
    };
    if !mount(&["-t", "tmpfs", "-o", "size=2m", "tmpfs"]) {
        eprintln!("SKIPPED {TEST}: mounting a small file system needs root");
        return;
    }
    let run = std::panic::catch_unwind(|| {
        let words = |line: &str| line.split(' ').map(str::to_string).collect::<Vec<_>>();
        let run = |line: &str| {
            let words = words(line);
            command::alvis(here, &words.iter().map(String::as_str).collect::<Vec<_>>())
        };
        assert!(
            run("phantom foam foam.mhd --dims 80,80,80 --quiet")
                .status
                .success()
        );
        let line = "convert foam.mhd disk/out --threshold 128 --macrocube 40,40,8";
        let failed = run(line);
        let errors = text(&failed);
        assert_eq!(failed.status.code(), Some(2), "{errors}");
        assert!(errors.contains("No space left on device"), "{errors}");
        assert!(errors.contains("free some space"), "{errors}");
        assert!(errors.contains("--resume` goes on"), "{errors}");
        let names: Vec<_> = std::fs::read_dir(disk.join("out"))
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        assert_eq!(names, [WORK]);
        let still = run(&format!("{line} --resume"));
        assert_eq!(still.status.code(), Some(2), "{}", text(&still));
        assert!(mount(&["-o", "remount,size=64m"]));
        let report = run(&format!("{line} --resume --json --quiet"));
        assert!(report.status.success(), "{}", text(&report));
        let report = command::json(&String::from_utf8(report.stdout).unwrap());
        assert!(report["resumed_layers"].as_u64().unwrap() > 0);
        assert!(
            run("convert foam.mhd whole --threshold 128 --macrocube 40,40,8")
                .status
                .success()
        );
        assert_same_files(&files(&disk.join("out")), &files(&here.join("whole")), TEST);
    });
    let unmounted = Command::new("umount").arg(&disk).status();
    run.unwrap();
    assert!(unmounted.unwrap().success());
}

#[test]
fn an_input_that_is_cut_while_it_is_read() {
    let Some(shim) = shim("an_input_that_is_cut_while_it_is_read") else {
        return;
    };
    for (io, says) in [("mmap", "use --io read"), ("read", "the file's end inside")] {
        let line = format!("{CONVERT} --threads 1 --io {io}");
        let (_dir, here, expected) = prepared(&line);
        let input = here.join("foam.raw");
        let samples = std::fs::read(&input).unwrap();
        let changed = std::fs::metadata(&input).unwrap().modified().unwrap();
        let (mut cut, mut found, mut resumed) = (0, 0, 0);
        for number in (1..400).step_by(13) {
            let output = shimmed(shim, &here, &line)
                .env("SHIM_AT", number.to_string())
                .env("SHIM_CUT", &input)
                .output()
                .unwrap();
            let errors = text(&output);
            std::fs::write(&input, &samples).unwrap();
            let file = std::fs::File::options().write(true).open(&input).unwrap();
            file.set_modified(changed).unwrap();
            let out = here.join("out");
            if output.status.code() != Some(0) {
                assert_eq!(output.status.code(), Some(2), "{io}: {number}: {errors}");
                let message = errors.lines().find(|l| l.starts_with("alvis: ")).unwrap();
                // before it was mapped
                let early = message.contains("the file's end inside")
                    || message.contains("bytes, expected")
                    // after the last read
                    || message.contains("was changed while it was read");
                found += u32::from(message.contains(says));
                assert!(message.contains("foam.raw"), "{io}: {number}: {errors}");
                assert!(message.contains(says) || early, "{io}: {number}: {errors}");
                assert!(!out.join("index.json").exists());
                cut += 1;
                let again = format!("{line} --resume --json --quiet");
                let report = ok(&here, &again.split(' ').collect::<Vec<_>>());
                resumed += u32::from(command::json(&report)["resumed_layers"] != 0);
            }
            assert_same_files(&files(&out), &expected, io);
            std::fs::remove_dir_all(&out).unwrap();
        }
        eprintln!("--io {io}: {cut} conversions met the cut, {resumed} went on with layers");
        assert!(found > 1 && resumed > 0, "{io}: {cut} {found} {resumed}");
    }
}
