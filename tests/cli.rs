//! The command as its users see it: texts, exit status, one message for each failure, JSON.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output, Stdio};

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

const COMMON: &str = "--json --quiet --threads";
const INPUT: &str = "--dims --dtype --endian --offset --spacing --unit --io";

#[test]
fn help_names_every_option() {
    let dir = temp();
    let top = ok(dir.path(), &["--help"]);
    let convert = format!(
        "{COMMON} {INPUT} --threshold --macrocube --memory --ambiguous --cap --crop --primitives \
         --force separate join strips triangles otsu 1GiB mmap read little big u16 f64"
    );
    for (command, words) in [
        ("demo", format!("{COMMON} --size --primitives alvis-demo")),
        ("info", format!("{COMMON} {INPUT} --threshold")),
        ("convert", convert),
        ("verify", format!("{COMMON} {INPUT} --against --max-issues")),
        (
            "phantom",
            format!(
                "{COMMON} --dims --dtype --noise --seed --spacing --unit --force --pitch --wall \
                 --bubble --radius --tube --edge --semi-axes --density foam sphere torus cube \
                 ellipsoid gyroid noise .mhd .nrrd"
            ),
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
        assert!(ok(dir.path(), &[command, "-h"]).contains("Usage: alvis "));
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
        (&[][..], "no command"),
        (&["frobnicate"], "frobnicate"),
        (&["convert", "a.raw"], "OUT"),
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
        (&["info", "a.raw"], "--dims"),
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
    ] {
        let message = fails(dir.path(), args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
    let mut left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
    assert_eq!(left.remove(0).unwrap().file_name(), "a.raw");
}

#[test]
fn a_phantom_reads_back_as_it_was_made() {
    let dir = temp();
    let space = ["--spacing", "0.5,0.25,2", "--unit", "um"];
    for (name, dtype, format) in [
        ("a.mhd", "u16", "metaimage"),
        ("b.mha", "f32", "metaimage"),
        ("c.nrrd", "i8", "nrrd"),
        ("d.nrrd", "f64", "nrrd"),
        ("e.mhd", "i32", "metaimage"),
    ] {
        foam(
            dir.path(),
            name,
            &[&["--dtype", dtype][..], &space].concat(),
        );
        let info = json(&ok(dir.path(), &["info", name, "--json"]));
        assert_eq!(info["format"], format, "{name}");
        assert_eq!(info["dims"], serde_json::json!([40, 36, 32]), "{name}");
        assert_eq!(info["dtype"], dtype, "{name}");
        assert_eq!(
            info["spacing"],
            serde_json::json!([0.5, 0.25, 2.0]),
            "{name}"
        );
        assert_eq!(info["unit"], "um", "{name}");
        assert_eq!(info["nan"], 0, "{name}");
        let voxels: u64 = info["histogram"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_u64)
            .sum();
        assert_eq!(voxels, 40 * 36 * 32, "{name}");
        let (min, max) = (info["min"].as_f64().unwrap(), info["max"].as_f64().unwrap());
        let otsu = info["otsu_threshold"].as_f64().unwrap();
        // without noise the extremes are air and metal, and Otsu separates them
        assert!((min..max).contains(&otsu), "{name}: {min} {otsu} {max}");
        let triangles = info["predicted"]["triangles"].as_f64().unwrap() / 46_080.0;
        assert!((0.1..0.4).contains(&triangles), "{name}: {triangles}");
        assert!(info["predicted"]["bytes"].as_u64().unwrap() > 10_000);
        assert!(info["predicted"]["memory_bytes"].as_u64().unwrap() > 46_080);
    }
    let text = ok(dir.path(), &["info", "a.mhd"]);
    for part in [
        "40 x 36 x 32",
        "u16",
        "0.5 x 0.25 x 2 um (from the file)",
        "log scale",
        "█",
        "▲",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn a_raw_phantom_says_how_to_convert_it() {
    let dir = temp();
    let args = [
        "phantom", "sphere", "s.raw", "--dims", "16,18,20", "--dtype", "u16",
    ];
    let text = ok(dir.path(), &args);
    for part in [
        "--dims 16,18,20",
        "--dtype u16",
        "--endian little",
        "--threshold 32767.5",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let info = [
        "info", "s.raw", "--dims", "16,18,20", "--dtype", "u16", "--json",
    ];
    let info = json(&ok(
        dir.path(),
        &[&info[..], &["--spacing", "0.1", "--unit", "mm"]].concat(),
    ));
    assert_eq!(info["format"], "raw");
    assert_eq!(info["spacing"], serde_json::json!([0.1, 0.1, 0.1]));
    assert_eq!(
        (&info["min"], &info["max"]),
        (&Value::from(13_107.0), &Value::from(52_428.0))
    );
    let report = json(&ok(
        dir.path(),
        &[&args[..], &["--force", "--json"]].concat(),
    ));
    assert_eq!(report["threshold"], 32_767.5);
    assert_eq!(report["bytes"], 16 * 18 * 20 * 2);
}

#[test]
fn threads_do_not_change_a_file() {
    let dir = temp();
    foam(dir.path(), "one.raw", &["--threads", "1", "--noise", "0.1"]);
    foam(
        dir.path(),
        "four.raw",
        &["--threads", "4", "--noise", "0.1"],
    );
    foam(dir.path(), "other.raw", &["--seed", "2", "--noise", "0.1"]);
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("one.raw") == read("four.raw"));
    assert!(read("one.raw") != read("other.raw"));
}

#[test]
fn the_threshold_of_info_may_be_negative_or_missing() {
    let dir = temp();
    foam(dir.path(), "a.mhd", &["--dtype", "i16"]);
    let info = json(&ok(
        dir.path(),
        &["info", "a.mhd", "--json", "--threshold", "-1e4"],
    ));
    assert_eq!(info["predicted"]["threshold"], -1e4);
    std::fs::write(dir.path().join("flat.raw"), [7; 64]).unwrap();
    let args = ["info", "flat.raw", "--dims", "4,4,4", "--dtype", "u8"];
    let info = json(&ok(dir.path(), &[&args[..], &["--json"]].concat()));
    assert_eq!(
        (&info["otsu_threshold"], &info["predicted"]),
        (&Value::Null, &Value::Null)
    );
    assert!(ok(dir.path(), &args).contains("all samples are the same"));
    let args = [
        "convert", "flat.raw", "out", "--dims", "4,4,4", "--dtype", "u8",
    ];
    let message = fails(dir.path(), &[&args[..], &["--threshold", "otsu"]].concat());
    assert!(message.contains("are the same"), "{message}");
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

/// The keys that scripts rely on.
fn assert_keys(object: &Value, keys: &str) {
    for key in keys.split_whitespace() {
        assert!(object.get(key).is_some(), "{key} in {object}");
    }
}

#[test]
fn a_conversion_says_what_it_understood_and_made() {
    let dir = temp();
    let sphere = [
        "phantom", "sphere", "s.mhd", "--dims", "40,40,40", "--quiet",
    ];
    ok(
        dir.path(),
        &[&sphere[..], &["--spacing", "0.5", "--unit", "mm"]].concat(),
    );
    let output = alvis(
        dir.path(),
        &["convert", "s.mhd", "out", "--threshold", "otsu"],
    );
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = stderr(&output);
    for part in [
        "40 x 40 x 40",
        "u8",
        "0.5 x 0.5 x 0.5 mm (from the file)",
        "Otsu",
        "1.0 GiB",
    ] {
        assert!(said.contains(part), "{part} in {said}");
    }
    assert!(stdout(&output).contains("1 objects, 1 cells, 1 surfaces"));
    // a tile set is replaced only on request
    let again = [
        "convert",
        "s.mhd",
        "out",
        "--threshold",
        "127.5",
        "--json",
        "--quiet",
    ];
    let message = fails(dir.path(), &again);
    assert!(message.contains("--force"), "{message}");
    let output = alvis(
        dir.path(),
        &[&again[..], &["--force", "--crop", "3:,:,:37"]].concat(),
    );
    assert_eq!(stderr(&output), "", "nothing is said with --quiet");
    let report = json(&stdout(&output));
    assert_keys(
        &report,
        "tiles triangles vertices tile_vertices strips strip_indices objects cells surfaces \
         bytes_written seconds peak_rss_bytes",
    );
    assert_eq!(report["surfaces"], 1);
    let manifest = std::fs::read(dir.path().join("out/index.json")).unwrap();
    let manifest = json(&String::from_utf8(manifest).unwrap());
    assert_eq!(manifest["grid"]["dims"], serde_json::json!([37, 40, 37]));
    let message = fails(
        dir.path(),
        &[
            "convert",
            "s.mhd",
            "o",
            "--threshold",
            "1",
            "--memory",
            "1kB",
        ],
    );
    assert!(message.contains("smallest limit"), "{message}");
    let message = fails(
        dir.path(),
        &[
            "convert",
            "s.mhd",
            "o",
            "--threshold",
            "1",
            "--crop",
            "9:99,:,:",
        ],
    );
    assert!(message.contains("--crop"), "{message}");
    assert!(!dir.path().join("o").exists());
}

#[test]
fn verify_tells_a_sound_set_from_a_damaged_one() {
    let dir = temp();
    let raw = ["--dims", "32,32,32", "--dtype", "u16"];
    ok(
        dir.path(),
        &[&["phantom", "sphere", "s.raw", "-q"][..], &raw].concat(),
    );
    let convert = [
        "convert",
        "s.raw",
        "out",
        "--threshold",
        "32767.5",
        "-q",
        "--crop",
        ":,1:,:31",
    ];
    ok(dir.path(), &[&convert[..], &raw].concat());
    // the manifest knows the size, type and crop of the raw file
    let verify = ["verify", "out", "--against", "s.raw"];
    assert!(ok(dir.path(), &verify).starts_with("ok: 1 tiles, "));
    let report = json(&ok(dir.path(), &[&verify[..], &["--json"]].concat()));
    assert_keys(
        &report,
        "ok tiles triangles vertices border_edges surfaces euler_characteristic issues",
    );
    assert_eq!(
        (&report["ok"], &report["against"]),
        (&Value::Bool(true), &Value::Bool(true))
    );
    foam(dir.path(), "small.mhd", &["--dims", "16,16,16"]);
    let message = fails(dir.path(), &["verify", "out", "--against", "small.mhd"]);
    assert!(message.contains("16 x 16 x 16"), "{message}");

    std::fs::write(dir.path().join("out/index.json"), "{}").unwrap();
    let output = alvis(dir.path(), &["verify", "out", "--json"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let report = json(&stdout(&output));
    assert_eq!(report["ok"], false);
    assert_keys(&report["issues"][0], "code severity path message voxel");
    let output = alvis(dir.path(), &["verify", "out"]);
    assert!(stdout(&output).contains("not ok: "));
    let output = alvis(dir.path(), &["verify", "out", "--quiet"]);
    assert_eq!(
        (output.status.code(), stdout(&output).as_str()),
        (Some(1), "")
    );
}

#[test]
fn a_demo_replaces_an_earlier_one() {
    let dir = temp();
    for _ in 0..2 {
        let output = alvis(dir.path(), &["demo", "--size", "24", "--json", "--quiet"]);
        let report = json(&stdout(&output));
        assert_keys(&report, "volume tiles threshold convert verify");
        assert!(report["convert"]["tiles"].as_u64() > Some(0));
    }
    let demo = dir.path().join("alvis-demo");
    assert!(demo.join("foam/index.json").exists());
    assert_eq!(std::fs::read_dir(demo).unwrap().count(), 3);
}

#[test]
fn a_demo_leaves_what_is_not_its_own() {
    let dir = temp();
    std::fs::create_dir(dir.path().join("mine")).unwrap();
    std::fs::write(dir.path().join("mine/thesis.tex"), "precious").unwrap();
    let message = fails(dir.path(), &["demo", "mine", "--size", "16"]);
    assert!(message.contains("thesis.tex"), "{message}");
    assert_eq!(
        std::fs::read_dir(dir.path().join("mine")).unwrap().count(),
        1
    );
}
