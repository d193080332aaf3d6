//! What goes wrong from outside: the command says where, what was found and what was expected, ends
//! with status 2, and leaves nothing half-written under a final name.
#![cfg(unix)]

use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output};

const ALVIS: &str = env!("CARGO_BIN_EXE_alvis");
const SMALL: [&str; 6] = ["--dims", "12,10,8", "--dtype", "u8", "--threshold", "100"];

fn alvis(dir: &Path, args: &[&str]) -> Output {
    Command::new(ALVIS)
        .args(args)
        .current_dir(dir)
        .output()
        .unwrap()
}

/// The one message of a run that must fail.
fn message(output: &Output, what: &str) -> String {
    let errors = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{what}: {errors}");
    assert!(output.stdout.is_empty(), "{what}");
    let said = errors.lines().filter(|l| l.starts_with("alvis: ")).count();
    assert_eq!(said, 1, "{what}: {errors}");
    assert!(!errors.contains("panicked"), "{what}: {errors}");
    errors.lines().last().unwrap().to_string()
}

fn fails(dir: &Path, args: &[&str]) -> String {
    message(&alvis(dir, args), &args.join(" "))
}

fn ok(dir: &Path, args: &[&str]) -> Value {
    let output = alvis(dir, &[args, &["--json", "--quiet"]].concat());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {errors}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Names in a directory, sorted.
fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap();
    let mut names: Vec<_> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// A directory with `a.raw`, a ball of 12 x 10 x 8 voxels.
fn ball() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut samples = Vec::new();
    for i in 0..12 * 10 * 8i32 {
        let off = [i % 12 - 6, i / 12 % 10 - 5, i / 120 - 4];
        samples.push((200 - 12 * off.iter().map(|v| v * v).sum::<i32>()).max(0) as u8);
    }
    fs::write(dir.path().join("a.raw"), samples).unwrap();
    dir
}

fn small<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["convert", "a.raw", out], &SMALL[..], more].concat()
}

const SET: [&str; 6] = [
    "cells.csv",
    "index",
    "index.json",
    "objects.csv",
    "surfaces.csv",
    "tiles",
];

#[test]
fn sizes_that_cannot_be_are_refused_before_anything_is_made() {
    let dir = ball();
    for (dims, dtype, part) in [
        ("12,10,9", "u8", "960"),
        ("12,10,7", "u8", "960"),
        ("12,10,8", "u16", "960"),
        ("0,10,8", "u8", "dims"),
        ("1,10,96", "u8", "dims"),
        ("65537,10,8", "u8", "dims"),
        ("65536,65536,65536", "f64", "960"),
        (
            "18446744073709551615,18446744073709551615,18446744073709551615",
            "f64",
            "dims",
        ),
        ("18446744073709551616,2,2", "u8", "dims"),
        ("-1,10,8", "u8", "dims"),
        ("12,10", "u8", "dims"),
        ("12,10,8,1", "u8", "dims"),
        ("1e1,10,8", "u8", "dims"),
        ("12,10,8", "u12", "u12"),
        ("12,10,8", "", "dtype"),
    ] {
        let dims = format!("--dims={dims}");
        let args = [
            "convert",
            "a.raw",
            "out",
            &dims,
            "--dtype",
            dtype,
            "--threshold",
            "1",
        ];
        let said = fails(dir.path(), &args);
        assert!(said.contains(part), "{args:?}: {said}");
        assert_eq!(names(dir.path()), ["a.raw"], "{args:?}");
    }
}

#[test]
fn a_threshold_outside_the_data_is_a_warning_and_an_empty_set() {
    let dir = ball();
    for (threshold, objects, cells) in [("201", 0, 1), ("1e300", 0, 1), ("0", 1, 0), ("-5", 1, 0)] {
        let threshold = format!("--threshold={threshold}");
        let args = [
            "convert", "a.raw", "out", "--dims", "12,10,8", "--dtype", "u8", &threshold, "--force",
        ];
        let output = alvis(dir.path(), &args);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains("threshold"), "{said}");
        let report = ok(dir.path(), &args);
        let counts = [
            "tiles",
            "triangles",
            "vertices",
            "surfaces",
            "objects",
            "cells",
        ]
        .map(|k| &report[k]);
        assert_eq!(
            counts,
            [
                &json!(0),
                &json!(0),
                &json!(0),
                &json!(0),
                &json!(objects),
                &json!(cells)
            ]
        );
        assert_eq!(report["warnings"].as_array().unwrap().len(), 1);
        assert_eq!(names(&dir.path().join("out")), SET);
        for more in [&[][..], &["--against", "a.raw"]] {
            let found = ok(dir.path(), &[&["verify", "out"], more].concat());
            assert_eq!((&found["ok"], &found["tiles"]), (&json!(true), &json!(0)));
        }
    }
    for (value, part) in [
        ("nan", "--threshold"),
        ("inf", "--threshold"),
        ("abc", "--threshold"),
    ] {
        let args = [
            "convert",
            "a.raw",
            "new",
            "--dims",
            "12,10,8",
            "--dtype",
            "u8",
            "--threshold",
            value,
        ];
        assert!(fails(dir.path(), &args).contains(part));
        assert!(!dir.path().join("new").exists());
    }
}

#[test]
fn an_existing_output_is_replaced_with_force_only() {
    let dir = ball();
    let first = ok(dir.path(), &small("out", &[]));
    assert!(first["triangles"].as_u64().unwrap() > 100);
    let before = fs::read(dir.path().join("out/index.json")).unwrap();
    let said = fails(dir.path(), &small("out", &["--macrocube", "3"]));
    assert!(said.contains("--force") && said.contains("out"), "{said}");
    assert_eq!(fs::read(dir.path().join("out/index.json")).unwrap(), before);
    let second = ok(dir.path(), &small("out", &["--macrocube", "3", "--force"]));
    assert!(second["tiles"].as_u64() > first["tiles"].as_u64());
    // nothing of the first set is left
    assert_eq!(
        ok(dir.path(), &["verify", "out", "--against", "a.raw"])["ok"],
        true
    );
    assert_eq!(names(&dir.path().join("out")), SET);
    // files of somebody else are never removed
    fs::write(dir.path().join("out/notes.txt"), "mine").unwrap();
    let said = fails(dir.path(), &small("out", &["--force"]));
    assert!(said.contains("out"), "{said}");
    assert_eq!(fs::read(dir.path().join("out/notes.txt")).unwrap(), b"mine");
    fs::create_dir(dir.path().join("empty")).unwrap();
    ok(dir.path(), &small("empty", &[]));
}

#[test]
fn an_output_that_cannot_be_a_directory_is_refused() {
    let dir = ball();
    fs::write(dir.path().join("file"), "text").unwrap();
    symlink("nowhere/at/all", dir.path().join("dangling")).unwrap();
    for out in [
        "file",
        "file/below",
        "a.raw",
        "dangling",
        "/proc/alvis-test",
        "/dev/null",
        "/dev/full/x",
    ] {
        for force in [&[][..], &["--force"]] {
            let said = fails(dir.path(), &small(out, force));
            assert!(said.contains(out), "{out}: {said}");
        }
    }
    assert_eq!(names(dir.path()), ["a.raw", "dangling", "file"]);
    assert_eq!(fs::read(dir.path().join("file")).unwrap(), b"text");
    assert_eq!(fs::metadata(dir.path().join("a.raw")).unwrap().len(), 960);
    fails(dir.path(), &small("", &[]));
    assert!(!dir.path().join("tiles").exists());
}

#[test]
fn inputs_that_are_missing_or_not_files_are_refused() {
    let dir = ball();
    let at = dir.path();
    fs::create_dir(at.join("folder")).unwrap();
    fs::write(at.join("gone.mhd"), "ObjectType = Image\nNDims = 3\nDimSize = 12 10 8\nElementType = MET_UCHAR\nElementDataFile = gone.raw\n").unwrap();
    fs::write(at.join("short.mhd"), "ObjectType = Image\nNDims = 3\nDimSize = 12 10 9\nElementType = MET_UCHAR\nElementDataFile = a.raw\n").unwrap();
    fs::write(at.join("slices.nhdr"), "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 10 2\nencoding: raw\ndata file: s%d.raw 1 2 1\n").unwrap();
    fs::write(at.join("s1.raw"), [0; 120]).unwrap();
    fs::write(
        at.join("bad.nrrd"),
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 10 8\nencoding: gzip\n\nnot gzip at all",
    )
    .unwrap();
    fs::write(at.join("empty.raw"), "").unwrap();
    let fifo = Command::new("mkfifo")
        .arg(at.join("pipe"))
        .status()
        .is_ok_and(|s| s.success());
    let before = names(at);
    for (input, part) in [
        ("none.raw", "none.raw"),
        ("empty.raw", "empty.raw"),
        ("folder", "folder"),
        ("gone.mhd", "gone.raw"),
        ("short.mhd", "a.raw"),
        ("slices.nhdr", "s2.raw"),
        ("bad.nrrd", "bad.nrrd"),
        ("/dev/zero", "/dev/zero"),
        ("pipe", "pipe"),
    ] {
        if input == "pipe" && !fifo {
            continue;
        }
        let raw = ["--dims", "12,10,8", "--dtype", "u8"];
        let needs_raw = !input.contains("hd") && !input.contains("nrrd");
        let args = ["convert", input, "out", "--threshold", "1"];
        let args = [&args[..], if needs_raw { &raw } else { &[] }].concat();
        let said = fails(at, &args);
        assert!(said.contains(part), "{input}: {said}");
        assert_eq!(names(at), before, "{input}");
    }
}

/// Runs a script with a small file system of its own at `full`; `None`, after saying so, where that is
/// not permitted.
fn on_a_small_disk(dir: &Path, kib: u32, script: &str) -> Option<Output> {
    fs::create_dir(dir.join("full")).unwrap();
    let mount = format!("mount -t tmpfs -o size={kib}k tmpfs full");
    // a mount namespace goes away with its last process, and so does the file system
    for namespace in [&["-m"][..], &["-r", "-m"]] {
        let run = |script: &str| {
            let unshare = Command::new("unshare")
                .args(namespace)
                .args(["sh", "-c", script])
                .current_dir(dir)
                .output();
            unshare.ok()
        };
        if run(&mount).is_some_and(|o| o.status.success()) {
            return run(&format!("{mount} && {script}"));
        }
    }
    eprintln!("SKIPPED the full disk: this machine lets the test mount none");
    None
}

#[test]
fn a_full_disk_leaves_nothing_behind() {
    let dir = ball();
    let noise: Vec<u8> = (0..64u64 * 64 * 64)
        .map(|i| (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8)
        .collect();
    fs::write(dir.path().join("noise.raw"), noise).unwrap();
    let script = format!(
        "{ALVIS} convert noise.raw full/out --dims 64,64,64 --dtype u8 --threshold 128 --quiet; code=$?; \
         find full >&2; exit $code"
    );
    let Some(output) = on_a_small_disk(dir.path(), 1024, &script) else {
        return;
    };
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{errors}");
    let lines: Vec<&str> = errors.lines().collect();
    assert_eq!(lines.len(), 2, "{errors}");
    assert!(
        lines[0].starts_with("alvis: ")
            && lines[0].contains("space")
            && lines[0].contains("full/out"),
        "{errors}"
    );
    assert_eq!(lines[1], "full", "{errors}");
}

#[test]
fn a_full_disk_keeps_the_set_that_was_to_be_replaced() {
    let dir = ball();
    let noise: Vec<u8> = (0..64u64 * 64 * 64)
        .map(|i| (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8)
        .collect();
    fs::write(dir.path().join("noise.raw"), noise).unwrap();
    let convert = SMALL.join(" ");
    let script = format!(
        "{ALVIS} convert a.raw full/out {convert} --quiet && cp -r full/out before && \
         {ALVIS} convert noise.raw full/out --dims 64,64,64 --dtype u8 --threshold 128 --quiet --force; code=$?; \
         diff -r before full/out >&2 && {ALVIS} verify full/out --against a.raw --quiet && exit $code"
    );
    let Some(output) = on_a_small_disk(dir.path(), 1024, &script) else {
        return;
    };
    let said = message(&output, "a full disk");
    assert!(said.contains("space"), "{said}");
}

/// A volume that is changed while a command reads it: all of them tell so, and make nothing of it.
#[test]
#[cfg(target_os = "linux")]
fn an_input_that_is_changed_while_it_is_read_is_refused() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let (n, input) = (400, at("a.raw"));
    let file = fs::File::create(&input).unwrap();
    file.set_len(n * n * n).unwrap();
    let dims = [n; 3].map(|n| n.to_string()).join(",");
    let volume = ["--dims", &dims, "--dtype", "u8", "--offset", "0"];
    let some = [&volume[..], &["--crop", "0:9,0:9,0:9", "--threshold", "1"]].concat();
    ok(
        dir.path(),
        &[&["convert", "a.raw", "set"], &some[..]].concat(),
    );
    let convert = [
        "convert",
        "a.raw",
        "out",
        "--threshold",
        "1",
        "--threads",
        "1",
    ];
    let against = ["verify", "set", "--against", "a.raw"];
    for args in [&convert[..], &["info", "a.raw"], &against] {
        // with a crop little is read: the whole of it takes a while
        let args = [args, &volume[..]].concat();
        if args[0] == "verify" {
            fs::remove_dir_all(at("set")).unwrap();
            let whole = [
                &["convert", "a.raw", "set", "--threshold", "1"],
                &volume[..],
            ]
            .concat();
            ok(dir.path(), &whole);
        }
        let child = Command::new(ALVIS)
            .args(&args)
            .current_dir(dir.path())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let id = child.id();
        let has_it_open = || {
            let files = fs::read_dir(format!("/proc/{id}/fd")).into_iter().flatten();
            let mut files = files.flatten().map(|f| fs::read_link(f.path()));
            files.any(|link| link.is_ok_and(|link| link == input))
        };
        while !has_it_open() {
            std::thread::yield_now();
        }
        // SAFETY: the child has not been waited for, so the number is its own.
        unsafe { libc::kill(id as i32, libc::SIGSTOP) };
        let mut file = fs::File::options().append(true).open(&input).unwrap();
        file.write_all(b"more").unwrap();
        // SAFETY: as above.
        unsafe { libc::kill(id as i32, libc::SIGCONT) };
        let said = message(&child.wait_with_output().unwrap(), args[0]);
        assert!(said.contains("was changed while it was read"), "{said}");
        assert!(!at("out").exists());
    }
}

/// The picture of a changed volume takes the place of no other.
#[test]
fn a_picture_of_a_changed_volume_is_not_written() {
    use alvis::preview::{PreviewOptions, preview};
    use alvis::volume::stamp;
    use alvis::volume::{Before, Dtype, OpenOptions, open};
    let dir = ball();
    let (input, picture) = (dir.path().join("a.raw"), dir.path().join("a.png"));
    let before = Before::of(&input, Path::new(""));
    let options = OpenOptions {
        dims: Some([12, 10, 8]),
        dtype: Some(Dtype::U8),
        ..OpenOptions::default()
    };
    let opened = open(&input, &options).unwrap();
    let options = PreviewOptions {
        input: stamp(&before, &opened).unwrap(),
        ..PreviewOptions::default()
    };
    preview(&*opened.volume, &picture, &options).unwrap();
    let drawn = fs::read(&picture).unwrap();
    let file = fs::File::options().write(true).open(&input).unwrap();
    file.set_modified(std::time::SystemTime::UNIX_EPOCH)
        .unwrap();
    fs::write(&picture, "another").unwrap();
    let error = preview(&*opened.volume, &picture, &options).unwrap_err();
    assert!(
        matches!(error, alvis::Error::InputChanged { .. }),
        "{error}"
    );
    assert_eq!(fs::read(&picture).unwrap(), b"another");
    assert!(!drawn.is_empty());
}

/// A volume whose samples are others whenever they are read, as of a file that is written to through a memory map.
struct Flickering {
    header: alvis::volume::Header,
    reads: std::sync::atomic::AtomicU64,
}

impl alvis::volume::Volume for Flickering {
    fn header(&self) -> &alvis::volume::Header {
        &self.header
    }

    fn fill_box(
        &self,
        _: std::ops::Range<u32>,
        _: std::ops::Range<u32>,
        _: std::ops::Range<u32>,
        out: &mut [u8],
    ) -> alvis::Result<()> {
        use std::sync::atomic::Ordering;
        let mut state = self.reads.fetch_add(1, Ordering::Relaxed);
        for sample in out {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            *sample = (state >> 56) as u8;
        }
        Ok(())
    }
}

#[test]
fn samples_that_change_without_a_trace_are_an_error() {
    use alvis::volume::{Header, MemoryVolume, Volume};
    let dims = alvis::grid::Dims([20, 18, 30]);
    let still = MemoryVolume::new(dims, alvis::grid::Placement::default(), vec![0u8; 10800]);
    let header: Header = still.unwrap().header().clone();
    let mut refused = 0;
    for seed in 0..8 {
        let volume = Flickering {
            header: header.clone(),
            reads: (seed * 1000).into(),
        };
        let options = alvis::convert::ConvertOptions {
            threshold: 128.0,
            macrocube: [8; 3],
            ..Default::default()
        };
        let out = tempfile::tempdir().unwrap();
        let made = alvis::convert::convert(
            &volume,
            &options,
            &out.path().join("out"),
            &alvis::progress::Quiet,
        );
        if let Err(error) = made {
            refused += 1;
            let said = error.to_string();
            assert!(said.contains("was changed while it was read"), "{said}");
        }
        assert!(!out.path().join("out/index.json").exists());
    }
    assert_eq!(refused, 8);
}

#[test]
fn empty_and_cut_files_are_called_so() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.tif", "a.h5", "a.dcm", "a.nii", "a.zip", "a.raw"] {
        fs::write(dir.path().join(name), b"").unwrap();
        let said = fails(dir.path(), &["info", name]);
        assert!(
            said.contains(name) && said.contains("an empty file"),
            "{said}"
        );
    }
    for name in ["a.nii", "a.h5", "a.tif", "a.zip"] {
        fs::write(dir.path().join(name), [92; 200]).unwrap();
        let said = fails(dir.path(), &["info", name]);
        assert!(
            said.contains("200 bytes") && said.contains("cut short"),
            "{said}"
        );
    }
    // raw samples under such a name are still read
    fs::write(dir.path().join("a.tif"), [1; 960]).unwrap();
    ok(
        dir.path(),
        &["info", "a.tif", "--dims", "12,10,8", "--dtype", "u8"],
    );
}

#[test]
fn a_header_is_offered_for_the_file_that_it_names() {
    let dir = tempfile::tempdir().unwrap();
    let header = "NDims = 3\nDimSize = 12 10 8\nElementType = MET_UCHAR\nElementDataFile = s.raw\n";
    fs::write(dir.path().join("s.mhd"), header).unwrap();
    for name in ["s.raw", "s.bin"] {
        fs::write(dir.path().join(name), [1; 960]).unwrap();
        let said = fails(dir.path(), &["info", name]);
        assert_eq!(said.contains("give s.mhd"), name == "s.raw", "{said}");
    }
    let mut gipl = vec![0; 256];
    gipl[252..].copy_from_slice(&[0xef, 0xff, 0xe9, 0xb0]);
    for (name, bytes, kind) in [
        ("s.gipl", &gipl[..], "GIPL"),
        ("s.mgh", &[0, 0, 0, 1, 0, 0, 0, 2], "FreeSurfer"),
        ("s.mgz", &[9; 8], "FreeSurfer"),
    ] {
        fs::write(dir.path().join(name), bytes).unwrap();
        let said = fails(dir.path(), &["info", name]);
        assert!(said.contains(kind) && !said.contains("s.mhd"), "{said}");
    }
}
