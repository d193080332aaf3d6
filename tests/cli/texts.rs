//! Help, manual, completions; refusals; what happens to stdout.

use super::{fails, ok, stderr, temp};
use std::process::{Command, Stdio};

const COMMON: &str = "--json --quiet --threads";
const FORM: &str = "--for --primitives --encoding --layout blender meshlab web strips triangles \
                    float quantized meshopt nodes merged";
const INPUT: &str = "--dims --dtype --endian --offset --spacing --unit --io --smooth --median --downsample --invert --clamp \
                     Filters";

#[test]
fn help_names_every_option() {
    let dir = temp();
    let top = ok(dir.path(), &["--help"]);
    let convert = format!(
        "{COMMON} {INPUT} --threshold --macrocube --memory --ambiguous --cap --crop --force --table-unit --lod --view --out-dir \
         {FORM} separate join otsu 1GiB mmap read little big u16 f64"
    );
    for (command, words) in [
        ("demo", format!("{COMMON} --size --primitives alvis-demo")),
        ("info", format!("{COMMON} {INPUT} --threshold")),
        ("convert", convert),
        (
            "cells",
            format!(
                "{COMMON} --objects --surfaces --where --largest --sort --descending --top --columns \
                 --format --summary --outside border-cell csv missing"
            ),
        ),
        (
            "select",
            format!(
                "{COMMON} --objects --surfaces --largest --where --omit --paint --colour-by --map --range --force viridis best"
            ),
        ),
        (
            "preview",
            format!(
                "{COMMON} {INPUT} --axis --at --threshold --tiles --objects --surfaces --largest --colour-by --map --window --scale"
            ),
        ),
        ("verify", format!("{COMMON} {INPUT} --against --max-issues")),
        (
            "view",
            "--port --no-open --gpu-memory 400MiB --volume ssh".to_string(),
        ),
        ("serve", "--port --allow-origin index".to_string()),
        (
            "phantom",
            format!(
                "{COMMON} --dims --dtype --noise --seed --spacing --unit --force --pitch --wall \
                 --bubble --radius --tube --edge --semi-axes --density foam sphere torus cube \
                 ellipsoid gyroid noise .mhd .nrrd"
            ),
        ),
        ("repack", format!("{COMMON} {FORM} --force")),
        (
            "lod",
            format!("{COMMON} --ratio --levels --pixel-error --memory --resume --force 1/8 1GiB"),
        ),
        (
            "plan",
            format!(
                "{COMMON} {INPUT} {FORM} --parts --script --threshold --min-voxels slurm nextflow"
            ),
        ),
        ("work", format!("{COMMON} --part --of --memory --input 75")),
        ("merge", format!("{COMMON} --memory --input 0-99")),
        (
            "report",
            format!("{COMMON} {INPUT} --against --outside --force border-cell html"),
        ),
        ("completions", "bash zsh fish".to_string()),
        ("man", "convert".to_string()),
    ] {
        assert!(top.contains(command), "{command} in {top}");
        let help = ok(dir.path(), &[command, "--help"]);
        for word in words.split_whitespace() {
            assert!(
                help.contains(word),
                "{word} in the help of {command}: {help}"
            );
        }
        let short = ok(dir.path(), &[command, "-h"]);
        assert!(short.contains("Usage: alvis "));
        if !["completions", "man"].contains(&command) {
            for help in [&help, &short] {
                let examples = help.split("Examples:").nth(1).unwrap_or_default();
                assert!(examples.contains(&format!("  alvis {command}")), "{help}");
            }
        }
        assert!(ok(dir.path(), &["man", command]).contains(".TH"));
    }
    assert!(ok(dir.path(), &["man"]).contains("Exit status"));
    assert!(ok(dir.path(), &["--version"]).starts_with("alvis "));
    for shell in ["bash", "zsh", "fish"] {
        assert!(ok(dir.path(), &["completions", shell]).contains("macrocube"));
    }
}

#[test]
fn wrong_use_is_one_message_and_status_2() {
    let dir = temp();
    std::fs::write(dir.path().join("a.raw"), [0; 64]).unwrap();
    for (args, part) in [
        (&["frobnicate"][..], "frobnicate"),
        (&["convert", "a.raw"], "OUT"),
        // the help that has the options of the command
        (&["convert", "a.raw"], "see `alvis convert --help`"),
        (&["info", "a.raw", "--frob"], "see `alvis info --help`"),
        (
            &["info", "a.raw", "--unit", "ell"],
            "see `alvis info --help`",
        ),
        (&["convert", "a.raw", "out"], "--threshold"),
        (
            &["convert", "a.raw", "out", "--threshold", "nan"],
            "--threshold",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--macrocube",
                "0",
            ],
            "--macrocube",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--memory",
                "lots",
            ],
            "--memory",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--crop",
                "1:2",
            ],
            "--crop",
        ),
        (&["info", "a.raw"], "--dims and --dtype"),
        (&["info", "a.raw", "--dims", "4,4,4"], "--dtype"),
        (
            &["info", "a.raw", "--dims", "4,4", "--dtype", "u8"],
            "--dims",
        ),
        (
            &["info", "a.raw", "--dims", "4,4,5", "--dtype", "u8"],
            "a.raw",
        ),
        (
            &["info", "a.raw", "--dims", "4,4,4", "--dtype", "u99"],
            "u99",
        ),
        (&["info", "a.raw", "--spacing", "0,1,1"], "--spacing"),
        (&["info", "none.mhd"], "none.mhd"),
        (&["verify", "none"], "none"),
        (&["verify", ".", "--dims", "4,4,4"], "--against"),
        (&["phantom", "foam", "a.raw"], "--force"),
        (&["phantom", "foam", "a.png"], ".nrrd"),
        (&["phantom", "bread", "b.raw"], "bread"),
        (&["phantom", "foam", "b.raw", "--wall", "1"], "--wall"),
        (&["phantom", "sphere", "b.raw", "--wall", "3"], "--wall"),
        (&["phantom", "foam", "b.raw", "--dims", "1,2,2"], "dims"),
        (&["man", "frobnicate"], "convert"),
        (&["info", "a.raw", "--threads", "0"], "--threads"),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--split",
                "--split-h",
                "-1",
            ],
            "from 0 to 256",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--split",
                "--split-min-radius",
                "257",
            ],
            "from 0 to 256",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--split",
                "-0.5",
            ],
            "from 0.001 to 1",
        ),
        (
            &[
                "convert",
                "a.raw",
                "out",
                "--threshold",
                "1",
                "--split",
                "1.01",
            ],
            "from 0.001 to 1",
        ),
        (&["verify", ".", "--labels", "a.raw"], "--against"),
    ] {
        let message = fails(dir.path(), args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
    let mut left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
    assert_eq!(left.remove(0).unwrap().file_name(), "a.raw");
}

#[test]
fn the_help_of_cells_explains_every_column() {
    let dir = temp();
    let help = ok(dir.path(), &["cells", "--help"]);
    assert!(help.lines().all(|l| l.chars().count() <= 100), "{help}");
    let (_, columns) = help.split_once("Columns of cells").unwrap();
    let (components, surfaces) = columns.split_once("Columns of surfaces").unwrap();
    let has = |text: &str, name: &str| {
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let all: Vec<&str> = words.collect();
        let stem = name.rsplit_once('_').map_or(name, |(stem, _)| stem);
        let first = ["_x", "_a"].map(|end| format!("{stem}{end}"));
        let axis = first.iter().any(|name| all.contains(&name.as_str()));
        all.contains(&name)
            || axis
                && ["_y", "_z", "_b", "_c"]
                    .iter()
                    .any(|end| name.ends_with(end))
    };
    for name in alvis::convert::COMPONENT_COLUMNS.map(|c| c.name) {
        assert!(has(components, name), "{name} in {components}");
    }
    for name in alvis::convert::SURFACE_COLUMNS.map(|c| c.name) {
        assert!(has(surfaces, name), "{name} in {surfaces}");
    }
}

#[test]
fn the_name_alone_is_helped() {
    let dir = temp();
    let help = ok(dir.path(), &[]);
    assert_eq!(help, ok(dir.path(), &["--help"]));
    for group in ["Make tiles:\n", "Look:\n", "Use tiles:\n", "Other:\n"] {
        assert!(help.contains(group), "{help}");
    }
    assert!(help.lines().all(|l| l.chars().count() <= 80), "{help}");
    let narrow = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .env("COLUMNS", "50")
        .output()
        .unwrap();
    let narrow = super::stdout(&narrow);
    let list = narrow.split("Make tiles:").nth(1).unwrap();
    let list = list.split("Options:").next().unwrap();
    assert!(list.lines().all(|l| l.chars().count() <= 50), "{narrow}");
}

#[test]
fn a_reader_that_has_gone_is_no_failure() {
    let dir = temp();
    let mut child = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(["completions", "zsh"])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(stderr(&output), "");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_stdout_is_one_message() {
    let dir = temp();
    let output = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .arg("--help")
        .current_dir(dir.path())
        .stdout(std::fs::File::create("/dev/full").unwrap())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).starts_with("alvis: stdout: cannot write: "));
}
