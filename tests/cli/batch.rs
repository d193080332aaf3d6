//! `alvis convert A B ... --out-dir DIR`: several scans, and the table of them.

use super::{alvis, fails, foam, json, ok, stderr, stdout, temp};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

/// The rows of a table, by name of their columns; fields that are quoted have a comma at most.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let fields = |line: &str| -> Vec<String> {
        let mut fields = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        fields
    };
    let mut lines = text.lines().map(fields);
    let head = lines.next().unwrap();
    lines
        .map(|line| {
            assert_eq!(line.len(), head.len(), "{line:?}");
            head.iter().cloned().zip(line).collect()
        })
        .collect()
}

/// Every file below a directory.
fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![dir.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(dir).unwrap().display().to_string();
                found.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// Three scans: in millimetres, in voxels, and large values.
fn scans(dir: &Path) {
    std::fs::create_dir(dir.join("ct")).unwrap();
    foam(
        dir,
        "ct/a.mhd",
        &["--spacing", "0.05", "--unit", "mm", "--pitch", "11"],
    );
    foam(dir, "b.nrrd", &["--dtype", "u16", "--pitch", "12"]);
    foam(dir, "c.raw.mhd", &["--seed", "5", "--pitch", "10"]);
}

#[test]
fn every_scan_gets_a_tile_set_and_a_row() {
    let dir = temp();
    let dir = dir.path();
    scans(dir);
    let line = "convert ct/a.mhd b.nrrd c.raw.mhd --out-dir out --threshold otsu --macrocube 16 --crop :,:,2:30 --walls";
    let output = alvis(dir, &words(line));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(stdout(&output), "3 of 3 scans done: out/scans.csv\n");
    let errors = stderr(&output);
    let told: Vec<&str> = errors.lines().filter(|l| l.starts_with("scan ")).collect();
    assert_eq!(told.len(), 3, "{errors}");
    assert!(
        told[1].starts_with("scan 2 of 3: b.nrrd: threshold "),
        "{errors}"
    );
    let rows = table(&dir.join("out/scans.csv"));
    let names: Vec<&str> = rows.iter().map(|r| r["tile_set"].as_str()).collect();
    assert_eq!(names, ["a", "b", "c"]);
    for (row, scan) in rows.iter().zip(["ct/a.mhd", "b.nrrd", "c.raw.mhd"]) {
        let out = format!("out/{}", row["tile_set"]);
        assert_eq!(
            (&*row["scan"], &*row["status"], &*row["error"]),
            (scan, "done", "")
        );
        assert_eq!(
            (&*row["threshold_method"], &*row["filters"]),
            ("otsu", "none")
        );
        assert_eq!(row["crop"], "0:40,0:36,2:30");
        ok(dir, &["verify", &out, "--against", scan]);
        // as the tile set itself says, and as one that is made alone
        let index = json(&std::fs::read_to_string(dir.join(&out).join("index.json")).unwrap());
        for (name, at) in [
            ("threshold", "/threshold"),
            ("cells", "/totals/cells"),
            ("triangles", "/totals/triangles"),
            ("spacing_y", "/spacing/1"),
            ("dims_z", "/grid/dims/2"),
            ("walls", "/totals/walls"),
        ] {
            let value = index.pointer(at).unwrap().as_f64().unwrap();
            assert_eq!(row[name].parse::<f64>().unwrap(), value, "{name}");
        }
        assert_eq!(index["unit"], *row["unit"]);
        let sums = json(&ok(dir, &["cells", &out, "--summary", "--json"]));
        for (name, at) in [
            ("porosity", "/porosity"),
            ("cells_whole", "/cells_whole"),
            ("equivalent_diameter_mean", "/equivalent_diameter/mean"),
            ("equivalent_diameter_median", "/equivalent_diameter/median"),
            ("neighbours_mean", "/neighbours/mean"),
            ("wall_thickness_median", "/wall_thickness/median"),
        ] {
            let value = sums.pointer(at).unwrap().as_f64().unwrap();
            assert_eq!(row[name].parse::<f64>().unwrap(), value, "{name}");
        }
        let alone = format!(
            "convert {scan} alone --force --quiet --threshold otsu --macrocube 16 --crop :,:,2:30 --walls"
        );
        ok(dir, &words(&alone));
        assert_eq!(files(&dir.join("alone")), files(&dir.join(&out)));
    }
    let again = format!(
        "{} --threads 1 --memory 64MiB --quiet",
        line.replace(" out ", " other ")
    );
    assert_eq!(ok(dir, &words(&again)), "");
    assert!(files(&dir.join("out")) == files(&dir.join("other")));
}

#[test]
fn an_error_in_one_scan_does_not_stop_the_others() {
    let dir = temp();
    let dir = dir.path();
    scans(dir);
    std::fs::rename(dir.join("b.nrrd"), dir.join("kept")).unwrap();
    std::fs::write(dir.join("d.nrrd"), "NRRD0004\ntype: uchar\n").unwrap();
    let line =
        "convert ct/a.mhd b.nrrd d.nrrd c.raw.mhd --out-dir out --threshold 120 --min-voxels 3";
    let output = alvis(dir, &words(&format!("{line} --json")));
    assert_eq!(output.status.code(), Some(2));
    let report = json(&stdout(&output));
    assert_eq!((&report["done"], &report["failed"]), (&2.into(), &2.into()));
    assert_eq!(report["table"], "out/scans.csv");
    let status: Vec<&str> = report["scans"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["status"].as_str().unwrap())
        .collect();
    assert_eq!(status, ["done", "failed", "failed", "done"]);
    assert!(report["scans"][0]["cells"].as_u64().unwrap() > 3);
    let errors = stderr(&output);
    let last = errors.lines().last().unwrap();
    assert!(
        last.starts_with("alvis: 2 of 4 scans could not be converted")
            && last.contains("out/scans.csv"),
        "{errors}"
    );
    let rows = table(&dir.join("out/scans.csv"));
    assert!(
        rows[1]["error"].contains("b.nrrd") && rows[1]["error"].contains("--out-dir"),
        "{rows:?}"
    );
    assert!(
        rows[2]["error"].contains("d.nrrd") && rows[2]["cells"].is_empty(),
        "{rows:?}"
    );
    assert_eq!(
        (&*rows[0]["min_voxels"], &*rows[0]["threshold_method"]),
        ("3", "value")
    );
    // what failed leaves nothing behind; errors are told with --quiet too
    assert!(!dir.join("out/b").exists() && !dir.join("out/d").exists());
    // once it is there, --resume makes what is missing and takes the others as they are
    let message = fails(dir, &words(line));
    assert!(
        message.contains("out/a") && message.contains("--force") && message.contains("--resume"),
        "{message}"
    );
    let made = |name: &str| {
        std::fs::metadata(dir.join("out").join(name).join("index.json"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let before = made("a");
    std::fs::rename(dir.join("kept"), dir.join("b.nrrd")).unwrap();
    std::fs::remove_file(dir.join("d.nrrd")).unwrap();
    foam(dir, "d.nrrd", &["--pitch", "13"]);
    ok(dir, &words(&format!("{line} --resume --quiet")));
    assert_eq!(made("a"), before);
    assert_eq!(table(&dir.join("out/scans.csv")).len(), 4);
    ok(
        dir,
        &words(&format!("{} --quiet", line.replace(" out ", " new "))),
    );
    assert!(files(&dir.join("out")) == files(&dir.join("new")));
    ok(dir, &words(&format!("{line} --force --quiet")));
    assert!(made("a") > before);
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_read() {
    let dir = temp();
    let dir = dir.path();
    scans(dir);
    ok(dir, &words("convert b.nrrd tiles --threshold 128 --quiet"));
    for (line, part) in [
        (
            "convert b.nrrd ct/B.mhd --out-dir out --threshold otsu",
            "different names",
        ),
        (
            "convert b.nrrd b.nrrd --out-dir out --threshold otsu",
            "different names",
        ),
        (
            "convert b.nrrd tiles --out-dir out --threshold otsu",
            "is a tile set",
        ),
        (
            "convert b.nrrd scans.csv.raw --out-dir out --threshold otsu",
            "scans.csv",
        ),
        ("convert b.nrrd --out-dir out", "--threshold"),
        ("convert --out-dir out --threshold otsu", "INPUT"),
        ("convert b.nrrd a c --threshold otsu", "--out-dir"),
        (
            "convert b.nrrd --out-dir b.nrrd --threshold otsu",
            "--out-dir: found b.nrrd, which is a file, expected a directory",
        ),
    ] {
        let message = fails(dir, &words(line));
        assert!(message.contains(part), "{line}: {message}");
        assert!(!dir.join("out").exists(), "{line}");
    }
    // a table of other scans is not replaced by chance
    std::fs::create_dir(dir.join("out")).unwrap();
    std::fs::write(dir.join("out/scans.csv"), "mine").unwrap();
    let message = fails(dir, &words("convert b.nrrd --out-dir out --threshold otsu"));
    assert!(
        message.contains("scans.csv") && message.contains("--force"),
        "{message}"
    );
    assert_eq!(
        std::fs::read_to_string(dir.join("out/scans.csv")).unwrap(),
        "mine"
    );
    assert!(!dir.join("out/b").exists());
}

#[test]
fn a_signal_stops_all_scans_and_resume_goes_on() {
    let dir = temp();
    let dir = dir.path();
    for (name, seed) in [("a.mhd", "1"), ("b.mhd", "2"), ("c.mhd", "3")] {
        let dims = if name == "a.mhd" {
            "40,36,32"
        } else {
            "120,120,240"
        };
        foam(
            dir,
            name,
            &["--dims", dims, "--seed", seed, "--noise", "0.2"],
        );
    }
    let line = "convert a.mhd b.mhd c.mhd --out-dir out --threshold 128 --macrocube 16 --threads 1";
    ok(
        dir,
        &words(&format!("{} --quiet", line.replace(" out ", " whole "))),
    );
    let errors = std::fs::File::create(dir.join("errors")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(words(line))
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(errors)
        .spawn()
        .unwrap();
    // its first layer is done
    let begun =
        || alvis::convert::interrupted(&dir.join("out/b")).is_some_and(|kept| kept.done > 0);
    while child.try_wait().unwrap().is_none() && !begun() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    // SAFETY: a signal to a child that was not waited for yet
    assert_eq!(unsafe { libc::kill(child.id() as i32, libc::SIGINT) }, 0);
    assert_eq!(child.wait().unwrap().code(), Some(2));
    let errors = std::fs::read_to_string(dir.join("errors")).unwrap();
    let last = errors.lines().last().unwrap();
    assert!(
        last.contains("1 of 3 scans are done") && last.contains("--resume"),
        "{errors}"
    );
    let status: Vec<String> = table(&dir.join("out/scans.csv"))
        .iter()
        .map(|r| r["status"].clone())
        .collect();
    assert_eq!(status, ["done", "stopped", "waiting"]);
    assert!(!dir.join("out/c").exists());
    ok(dir, &words(&format!("{line} --resume --quiet")));
    assert!(files(&dir.join("out")) == files(&dir.join("whole")));
}

/// The row of a tile set.
fn row<'a>(rows: &'a [BTreeMap<String, String>], name: &str) -> &'a BTreeMap<String, String> {
    rows.iter().find(|row| row["tile_set"] == name).unwrap()
}

#[test]
fn rows_of_tile_sets_that_are_there_stay() {
    let dir = temp();
    let dir = dir.path();
    scans(dir);
    let path = dir.join("out/scans.csv");
    let rows = || table(&path);
    let first = "convert ct/a.mhd b.nrrd --out-dir out --threshold 120 --quiet";
    ok(dir, &words(first));
    let before = (rows(), files(&dir.join("out/a")));
    // other options: refused, with the old and the new value; what was made stays, and so does its row
    let other = "convert ct/a.mhd c.raw.mhd --out-dir out --threshold 90 --cap --resume";
    let output = alvis(dir, &words(other));
    assert_eq!(output.status.code(), Some(2));
    let errors = stderr(&output);
    let told = "out/a: the tile set there was made otherwise: --threshold was 120 and is 90; --cap was false and is true";
    assert!(errors.contains(told), "{errors}");
    let last = errors.lines().last().unwrap();
    assert!(
        last.contains("1 of 2 scans") && last.contains("one of them has a tile set from before"),
        "{errors}"
    );
    // the row tells of that, so it does not say why
    assert!(
        last.contains("said above and by --json") && !last.contains("column `error`"),
        "{errors}"
    );
    let by_method = other.replace("--threshold 90 --cap", "--threshold otsu");
    let errors = stderr(&alvis(dir, &words(&by_method)));
    let told = errors.split("--threshold was 120 and is ").nth(1);
    assert!(
        told.is_some_and(|it| it.contains("(by Otsu's method)")),
        "{errors}"
    );
    let after = rows();
    assert_eq!(after[..2], before.0[..]);
    assert_eq!(row(&after, "c")["threshold"], "90");
    assert!(files(&dir.join("out/a")) == before.1);
    let report = alvis(dir, &words(&format!("{other} --json")));
    let report = json(&stdout(&report));
    assert_eq!((&report["done"], &report["failed"]), (&1.into(), &1.into()));
    assert_eq!(report["scans"][0]["status"], "failed");
    // so it does if the scan is gone
    std::fs::rename(dir.join("b.nrrd"), dir.join("kept")).unwrap();
    let gone = first.replace("ct/a.mhd b.nrrd", "b.nrrd");
    let errors = fails(dir, &words(&format!("{gone} --resume")));
    assert!(errors.contains("1 of 1 scans"), "{errors}");
    assert_eq!(rows(), after);
    std::fs::rename(dir.join("kept"), dir.join("b.nrrd")).unwrap();
    // fewer scans: the others' rows stay, whichever way
    ok(
        dir,
        &words("convert b.nrrd --out-dir out --threshold 120 --quiet --resume"),
    );
    assert_eq!(rows(), after);
    ok(
        dir,
        &words("convert b.nrrd --out-dir out --threshold 130 --quiet --force"),
    );
    let forced = rows();
    assert_eq!(row(&forced, "b")["threshold"], "130");
    assert_eq!((&forced[0], &forced[2]), (&after[0], &after[2]));
    // a scan that is new needs no permission
    foam(dir, "d.nrrd", &["--pitch", "13"]);
    ok(
        dir,
        &words("convert d.nrrd --out-dir out --threshold 120 --quiet"),
    );
    let names: Vec<String> = rows().iter().map(|r| r["tile_set"].clone()).collect();
    assert_eq!(names, ["a", "b", "c", "d"]);
    // of a set that is gone there is no row, and of one without a row there is one again
    std::fs::remove_dir_all(dir.join("out/c")).unwrap();
    std::fs::remove_file(&path).unwrap();
    let errors = fails(dir, &words(&format!("{first} --cap --resume")));
    assert!(errors.contains("2 of 2 scans"), "{errors}");
    let again = rows();
    assert_eq!(again.len(), 2);
    for (name, old) in [("a", &forced[0]), ("b", &forced[1])] {
        let mut expected = old.clone();
        expected.insert("threshold_method".to_owned(), String::new());
        assert_eq!(row(&again, name), &expected);
    }
    // one set by itself is refused in the same way
    let errors = fails(
        dir,
        &words("convert ct/a.mhd out/a --threshold 120 --min-voxels 9 --resume --quiet"),
    );
    assert!(errors.contains("--min-voxels was 1 and is 9"), "{errors}");
    assert!(files(&dir.join("out/a")) == before.1);
}

#[test]
fn two_calls_do_not_write_to_one_directory_at_once() {
    let dir = temp();
    let dir = dir.path();
    scans(dir);
    let line = "convert ct/a.mhd --out-dir out --threshold 120 --quiet";
    ok(dir, &words(line));
    let before = files(&dir.join("out"));
    let lock = std::fs::File::create(dir.join("out/.scans.lock")).unwrap();
    lock.lock().unwrap();
    for more in ["", " --resume", " --force"] {
        let line = line.replace("ct/a.mhd", "ct/a.mhd b.nrrd");
        let message = fails(dir, &words(&format!("{line}{more}")));
        assert!(
            message.contains("out: another run of alvis is writing there"),
            "{message}"
        );
    }
    drop(lock);
    ok(dir, &words(&format!("{line} --resume")));
    // and nothing is left of the lock
    assert!(files(&dir.join("out")) == before);
}

#[test]
fn names_are_no_formulas_and_every_scan_is_a_line() {
    let dir = temp();
    let dir = dir.path();
    for name in ["=1+2.nrrd", "two\nlines.nrrd"] {
        foam(dir, name, &[]);
    }
    let line = [
        "convert",
        "=1+2.nrrd",
        "two\nlines.nrrd",
        "-x.nrrd",
        "--out-dir",
        "out",
    ];
    let line = [
        &line[..3],
        &["./-x.nrrd"],
        &line[4..],
        &["--threshold", "120"],
    ]
    .concat();
    let output = alvis(dir, &line);
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert_eq!(
        errors.lines().filter(|l| l.starts_with("scan ")).count(),
        3,
        "{errors}"
    );
    let text = || std::fs::read_to_string(dir.join("out/scans.csv")).unwrap();
    let lines: Vec<String> = text().lines().map(str::to_owned).collect();
    assert_eq!(lines.len(), 4, "{lines:?}");
    assert!(lines[1].starts_with("'=1+2.nrrd,'=1+2,done,"), "{lines:?}");
    assert!(
        lines[2].starts_with("two\\nlines.nrrd,two\\nlines,done,"),
        "{lines:?}"
    );
    assert!(lines[3].starts_with("./-x.nrrd,'-x,failed,"), "{lines:?}");
    // they are known again by these names
    let before = text();
    let again = [&line[..3], &line[4..], &["--resume", "--quiet"]].concat();
    ok(dir, &again);
    assert_eq!(text(), before);
}

/// What is told of several scans says of which.
#[test]
fn warnings_name_their_scan() {
    let dir = temp();
    let dir = dir.path();
    let mut samples = vec![20u8; 20 * 20 * 20];
    samples[3000..4000].fill(200);
    for name in ["a.raw", "b.raw"] {
        std::fs::write(dir.join(name), &samples).unwrap();
    }
    let line =
        "convert a.raw b.raw --out-dir all --dims 20,20,20 --dtype u8 --threshold porosity=50%";
    for more in [&[][..], &["--force", "--quiet"]] {
        let output = alvis(dir, &[&words(line)[..], more].concat());
        let errors = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{errors}");
        for name in ["a.raw", "b.raw"] {
            let head = format!("warning: {name}: porosity=50% is not to be had");
            let told = errors.lines().filter(|l| l.starts_with(&head)).count();
            assert_eq!(told, 1, "{errors}");
        }
    }
}
