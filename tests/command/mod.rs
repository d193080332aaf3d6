//! Running the command, and tile sets to run it on.
#![allow(dead_code)] // each test binary uses a part

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the command in a directory.
pub fn alvis(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(args)
        .current_dir(dir)
        .output()
        .unwrap()
}

/// Runs what must succeed; returns stdout.
pub fn ok(dir: &Path, args: &[&str]) -> String {
    let output = alvis(dir, args);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{args:?}: {errors}{text}");
    text
}

/// Runs what must fail with status 2 and one message, which is returned.
pub fn fails(dir: &Path, args: &[&str]) -> String {
    let output = alvis(dir, args);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {errors}");
    assert!(output.stdout.is_empty(), "{args:?}");
    let messages: Vec<&str> = errors
        .lines()
        .filter(|l| l.starts_with("alvis: "))
        .collect();
    assert_eq!(messages.len(), 1, "{args:?}: {errors}");
    messages[0].to_string()
}

/// Reads JSON.
pub fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// A directory with `foam.mhd`, a small foam in millimetres, and its tile set `tiles`, made with
/// more options.
pub fn foam_tiles(more: &[&str]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let phantom =
        "phantom foam foam.mhd --dims 40,36,32 --pitch 11 --spacing 0.05 --unit mm --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert foam.mhd tiles --threshold otsu --macrocube 16 --quiet";
    let args: Vec<&str> = convert.split(' ').chain(more.iter().copied()).collect();
    ok(dir.path(), &args);
    dir
}
