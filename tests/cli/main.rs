//! The command as its users see it: texts, exit status, one message for each failure, JSON.

#[path = "../common/mod.rs"]
mod common;

mod batch;
mod filters;
mod levels;
mod region;
mod report;
mod split;
mod texts;
mod tiles;
mod volumes;

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the command in a directory.
fn alvis(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(args)
        .current_dir(dir)
        .output()
        .unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Runs what must succeed; returns stdout.
fn ok(dir: &Path, args: &[&str]) -> String {
    let output = alvis(dir, args);
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {errors}");
    stdout(&output)
}

/// Runs what must fail with status 2 and one message of one line, which is returned.
fn fails(dir: &Path, args: &[&str]) -> String {
    let output = alvis(dir, args);
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{args:?}: {errors}");
    assert_eq!(stdout(&output), "", "{args:?}");
    let last = errors.lines().last().unwrap_or_default().to_string();
    let messages = errors.lines().filter(|l| l.starts_with("alvis: "));
    assert_eq!(messages.count(), 1, "{args:?}: {errors}");
    assert!(last.starts_with("alvis: "), "{args:?}: {errors}");
    last
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

fn temp() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// A small foam phantom.
fn foam(dir: &Path, name: &str, more: &[&str]) {
    let args = ["phantom", "foam", name, "--quiet"];
    let dims = ["--dims", "40,36,32"];
    let dims: &[&str] = if more.contains(&"--dims") { &[] } else { &dims };
    assert_eq!(ok(dir, &[&args[..], dims, more].concat()), "");
}

/// The keys that scripts rely on.
fn assert_keys(object: &Value, keys: &str) {
    for key in keys.split_whitespace() {
        assert!(object.get(key).is_some(), "{key} in {object}");
    }
}
