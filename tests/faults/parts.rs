//! Every file operation of work on a part, and of merges, fails in turn; then all goes on to the end.

use super::{EACCES, EIO, ENOSPC, WORK, shim, shimmed, text};
use crate::command::{alvis, ok};
use crate::common::{assert_same_files, copy_all, files};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const OPTIONS: &str =
    "foam.raw out --dims 24,22,20 --dtype u8 --threshold 128 --macrocube 13,12,7 --quiet";

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// Works and merges until the tile set is in place.
fn finish(here: &Path, what: &str) {
    for _ in 0..30 {
        let merged = alvis(here, &["merge", "out", "--quiet"]);
        match merged.status.code() {
            Some(0) => return,
            Some(3) => {}
            code => panic!("{what}: {code:?}: {}", text(&merged)),
        }
        for part in ["0", "1"] {
            let worked = alvis(here, &["work", "out", "--part", part, "--quiet"]);
            let code = worked.status.code();
            assert!(
                matches!(code, Some(0 | 75)),
                "{what}: {code:?}: {}",
                text(&worked)
            );
        }
    }
    panic!("{what}: it does not end");
}

/// Lets every `step`th operation of a command fail, and goes on; returns how many of them the command told of.
fn fail_each(
    shim: &Path,
    here: &Path,
    line: &str,
    step: usize,
    expected: &BTreeMap<String, Vec<u8>>,
) -> usize {
    let (out, kept) = (here.join("out"), here.join("kept"));
    let put_back = || {
        fs::remove_dir_all(&out).unwrap();
        copy_all(&kept, &out);
    };
    copy_all(&out, &kept);
    let log = here.join("log");
    let counted = shimmed(shim, here, line)
        .env("SHIM_LOG", &log)
        .output()
        .unwrap();
    assert!(
        matches!(counted.status.code(), Some(0 | 3)),
        "{}",
        text(&counted)
    );
    let operations = fs::read_to_string(&log).unwrap();
    fs::remove_file(&log).unwrap();
    let mut told = 0;
    for (turn, operation) in operations.lines().step_by(step).enumerate() {
        put_back();
        let number = operation.split(' ').next().unwrap();
        let way = [EIO, ENOSPC, EACCES][turn % 3];
        let output = shimmed(shim, here, line)
            .env("SHIM_AT", number)
            .env("SHIM_ERRNO", way.to_string())
            .output()
            .unwrap();
        let what = format!("{line}: {way}: {operation}");
        let code = output.status.code();
        assert!(
            matches!(code, Some(0 | 2 | 3 | 75)),
            "{what}: {code:?}: {}",
            text(&output)
        );
        told += usize::from(code == Some(2));
        finish(here, &what);
        assert_same_files(&files(&out), expected, &what);
    }
    put_back();
    fs::remove_dir_all(&kept).unwrap();
    assert!(alvis(here, &words(line)).status.code().is_some());
    told
}

#[test]
fn every_file_operation_of_parts() {
    if let Some(shim) = shim("every_file_operation_of_parts") {
        fail_all(shim, "--min-voxels 5", 13);
    }
}

#[test]
fn every_file_operation_of_parts_that_split_cells() {
    if let Some(shim) = shim("every_file_operation_of_parts_that_split_cells") {
        fail_all(shim, "--split", 17);
    }
}

/// Lets every `step`th operation or so fail in each of five rounds, with `more` options.
fn fail_all(shim: &Path, more: &str, step: usize) {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path().canonicalize().unwrap();
    ok(
        &here,
        &words("phantom foam foam.raw --dims 24,22,20 --pitch 9 --quiet"),
    );
    ok(&here, &words(&format!("convert {OPTIONS} {more}")));
    let expected = files(&here.join("out"));
    fs::remove_dir_all(here.join("out")).unwrap();
    ok(&here, &words(&format!("plan {OPTIONS} {more} --parts 2")));
    let work = "work out --part 0 --threads 1 --quiet";
    let merge = "merge out --threads 1 --quiet";
    let mut told = 0;
    for round in 0..5 {
        told += fail_each(shim, &here, work, step + round, &expected);
        ok(&here, &words("work out --part 1 --quiet"));
        told += fail_each(shim, &here, merge, step - 2 + round, &expected);
    }
    assert!(told > 40, "{told}");
    let found = files(&here.join("out"));
    assert!(found.keys().all(|name| !name.starts_with(WORK)));
    assert_same_files(&found, &expected, "at the end");
}
