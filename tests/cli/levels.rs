//! Levels of detail: what `lod`, `convert --lod` and `verify` say of them, also after they were interrupted.

use super::common::{assert_same_files, copy_all, files};
use super::{alvis, fails, json, ok, stderr, stdout, temp};
use std::path::{Path, PathBuf};

#[test]
fn a_conversion_ends_with_levels_and_goes_on_with_them() {
    let dir = temp();
    let dir = dir.path();
    let ok = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    ok("phantom foam a.mhd --dims 40,36,40 --quiet");
    let line = "convert a.mhd out --threshold 127.5 --macrocube 10 --threads 1";
    let printed = ok(&format!("{line} --lod --json"));
    let report = json(&printed);
    assert_eq!(report["lod"]["levels"], 3);
    assert!(report["triangles"].as_u64() > report["lod"]["triangles"].as_u64());
    ok("verify out --quiet");
    let levels = || std::fs::read(dir.join("out/lod/index.json")).unwrap();
    let first = levels();
    // nothing is left to do
    ok(&format!("{line} --lod --resume --quiet"));
    assert_eq!(levels(), first);
    // of a set that was done without them
    ok(&format!("{line} --force --quiet"));
    assert!(!dir.join("out/lod").exists());
    ok(&format!("{line} --lod --resume --quiet"));
    assert_eq!(levels(), first);
    ok("verify out --quiet");
    // tiles take less memory than levels: the command that is shown makes these
    let little = format!("{line} --force --lod --memory 31MiB --quiet");
    let message = fails(dir, &little.split(' ').collect::<Vec<_>>());
    assert!(message.contains("there and whole"), "{message}");
    let next = message.split("`alvis ").nth(1).unwrap();
    ok(&format!("{} --quiet", next.split('`').next().unwrap()));
    assert_eq!(levels(), first);
}

#[test]
fn a_set_without_a_surface_has_no_levels() {
    let dir = temp();
    let dir = dir.path();
    std::fs::write(dir.join("air.raw"), [0; 1000]).unwrap();
    let line = "convert air.raw air --dims 10,10,10 --dtype u8 --threshold 100 --lod";
    let output = alvis(dir, &line.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("no levels of detail"));
    assert!(!dir.join("air/lod").exists());
    ok(dir, &["verify", "air", "--quiet"]);
}

/// What levels say of themselves: cells that are left, what was written and what is there, and where they are not kept.
#[test]
fn levels_tell_what_is_left_and_what_was_done() {
    let dir = temp();
    let dir = dir.path();
    let run = |line: &str| {
        let output = alvis(dir, &line.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        (stdout(&output), stderr(&output))
    };
    run("phantom foam a.mhd --dims 40,36,40 --quiet");
    run("convert a.mhd out --threshold 127.5 --macrocube 10 --quiet");
    let cells = json(&run("lod out --json").0)["cells_by_level"].clone();
    let row = |text: &str, title: &str| {
        let row = text.lines().find(|l| l.starts_with(title));
        row.map(|row| row[title.len()..].trim().to_owned())
    };
    let first = run("lod out --force").0;
    let left = format!("{} of {} cells", cells[2], cells[0]);
    assert!(row(&first, "level 2").unwrap().contains(&left), "{first}");
    let again = run("lod out --resume").0;
    assert_eq!(row(&again, "written"), None, "{again}");
    assert_eq!(row(&again, "there"), row(&first, "written"), "{again}");

    let note = |dest: &str| format!("levels of detail are not kept: `alvis lod {dest}` makes them");
    let said = run("repack out web --for web").1;
    assert!(said.lines().any(|l| l == note("web")), "{said}");
    let said = run("select out part --largest 1 --objects").1;
    assert!(said.lines().any(|l| l == note("part")), "{said}");
    for quiet in [
        "repack out web --for web --force --quiet",
        "repack web lists --for meshlab",
    ] {
        let said = run(quiet).1;
        assert!(!said.contains("levels of detail"), "{said}");
    }
}

#[test]
fn options_of_levels_are_refused_in_their_own_words() {
    let dir = temp();
    let fails = |line: &str| fails(dir.path(), &line.split(' ').collect::<Vec<_>>());
    let line = "convert a.mhd out --threshold 127.5 --lod";
    for option in ["--split", "--labels l.npy"] {
        let said = fails(&format!("{line} {option}"));
        assert!(said.contains("would gape"), "{said}");
    }
    let said = fails(&format!("{line} b.mhd --out-dir all --split"));
    assert!(said.contains("would gape"), "{said}");
    for (option, expected) in [
        ("--ratio -1", "a share above 0"),
        ("--ratio -1/8", "a share above 0"),
        ("--levels -1", "2..=32"),
        ("--pixel-error -1", "pixels from 0.001 to 1000"),
    ] {
        let said = fails(&format!("lod out {option}"));
        assert!(said.contains(expected) && !said.contains("tip"), "{said}");
    }
}

/// A small set without levels, and the same with them.
fn sets(dir: &Path) {
    let ok = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    ok("phantom foam a.mhd --dims 30,30,30 --quiet");
    ok("convert a.mhd out --threshold 127.5 --macrocube 10 --quiet");
    copy_all(&dir.join("out"), &dir.join("plain"));
    ok("lod out --quiet");
    copy_all(&dir.join("out"), &dir.join("levels"));
}

/// What `verify` warns of beside a set that is sound.
fn verify_says(dir: &Path) -> String {
    let output = alvis(dir, &["verify", "out"]);
    let said = stdout(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.starts_with("ok: "), "{said}");
    // on a slow machine there is progress, too
    let said = stderr(&output);
    said.lines().filter(|l| l.starts_with("warning")).collect()
}

/// Begins anew with a copy of a set.
fn begin_with(dir: &Path, set: &str) -> PathBuf {
    let _ = std::fs::remove_dir_all(dir.join("out"));
    copy_all(&dir.join(set), &dir.join("out"));
    dir.join("out")
}

/// Levels that were interrupted before their first node are told with the command that goes on with them, or are not there at
/// all; `lod` ends with the same set either way, and leaves nothing beside it.
#[test]
fn levels_that_were_hardly_begun_are_no_hindrance() {
    let dir = temp();
    let dir = dir.path();
    sets(dir);
    let expected = files(&dir.join("levels"));
    let left: [(&[&str], bool); 6] = [
        (&[], false),
        (&["lock"], false),
        (&["lock", "lod/1/z0000.done"], false),
        (&["lock", "lod.new"], false),
        // of a conversion that had done no layer
        (
            &[
                "lock",
                "conversion.json",
                "tiles/z0000/y0000_x0000.glb",
                "index/",
            ],
            false,
        ),
        (&["lock", "lod.json"], true),
    ];
    for set in ["plain", "levels"] {
        for (names, begun) in left {
            for option in ["--resume", "--force"] {
                let out = begin_with(dir, set);
                let work = out.join(".alvis-partial");
                std::fs::create_dir(&work).unwrap();
                for name in names {
                    std::fs::create_dir_all(work.join(name).parent().unwrap()).unwrap();
                    match name.strip_suffix('/') {
                        Some(name) => std::fs::create_dir(work.join(name)).unwrap(),
                        None => std::fs::write(work.join(name), "{}").unwrap(),
                    }
                }
                let said = verify_says(dir);
                assert_eq!(said.contains("`alvis lod out --resume`"), begun, "{said}");
                assert!(begun || said.is_empty(), "{names:?}: {said}");
                ok(dir, &["lod", "out", option, "--quiet"]);
                assert_same_files(&files(&out), &expected, &format!("{set}: {names:?}"));
                assert!(!work.exists() && verify_says(dir).is_empty());
            }
        }
    }
}

/// Levels that are all made and were interrupted while they were moved into place are no faults of the set: `verify` names
/// the command that moves in the rest, and that says so.
#[test]
fn levels_that_are_partly_in_place_are_told() {
    let dir = temp();
    let dir = dir.path();
    sets(dir);
    let expected = files(&dir.join("levels"));
    let names = ["tileset.json", "lod", "index.json"];
    // in place of others, of which a part may still be there, and where there were none
    for replaces in [true, false] {
        for moved in 0..names.len() {
            let out = begin_with(dir, "levels");
            let work = out.join(".alvis-partial");
            std::fs::create_dir(&work).unwrap();
            for name in ["lod.json", "lod-moving"] {
                std::fs::write(work.join(name), "{}").unwrap();
            }
            for name in &names[moved..] {
                std::fs::rename(out.join(name), work.join(name)).unwrap();
            }
            std::fs::copy(dir.join("plain/index.json"), out.join("index.json")).unwrap();
            if replaces && moved < 2 {
                std::fs::create_dir(out.join("lod")).unwrap();
                std::fs::write(out.join("lod/index.json"), "{}").unwrap();
            }
            let said = verify_says(dir);
            for part in ["not all in place", "`alvis lod out --resume`"] {
                assert!(said.contains(part), "{moved}: {said}");
            }
            let output = alvis(dir, &["lod", "out", "--resume"]);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            let said = stderr(&output);
            assert!(said.contains("was moved in"), "{said}");
            assert!(!said.contains("nothing was done"), "{said}");
            assert_same_files(&files(&out), &expected, &format!("{moved} moved"));
            assert!(!work.exists() && verify_says(dir).is_empty());
        }
    }
}

/// Levels of other options than `convert` makes are told with the command that makes them anew.
#[test]
fn a_conversion_names_what_replaces_other_levels() {
    let dir = temp();
    let dir = dir.path();
    sets(dir);
    ok(dir, &["lod", "out", "--ratio", "1/4", "--force", "--quiet"]);
    let line = "convert a.mhd out --threshold 127.5 --macrocube 10 --lod --resume --quiet";
    for more in ["", " --force"] {
        let line = format!("{line}{more}");
        let said = fails(dir, &line.split(' ').collect::<Vec<_>>());
        assert!(said.contains("`alvis lod out --force`"), "{said}");
    }
    ok(dir, &["lod", "out", "--force", "--quiet"]);
    ok(dir, &line.split(' ').collect::<Vec<_>>());
    assert_same_files(
        &files(&dir.join("out")),
        &files(&dir.join("levels")),
        "anew",
    );
}

/// A disk that is full only for what is written last, the tree and the indexes, costs none of the nodes.
#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_written_in_the_end_leaves_the_nodes() {
    let dir = temp();
    let dir = dir.path();
    let ok = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    ok("phantom foam a.mhd --dims 64,64,64 --quiet");
    ok("convert a.mhd out --threshold 127.5 --macrocube 8 --for web --quiet");
    copy_all(&dir.join("out"), &dir.join("whole"));
    ok("lod whole --quiet");
    // files of at most 40 KiB: no node is larger, the tree is
    let limited = format!(
        "trap '' XFSZ; ulimit -f 40; exec {} lod out --threads 1",
        env!("CARGO_BIN_EXE_alvis")
    );
    let run = std::process::Command::new("bash");
    let output = { run }.args(["-c", &limited]).current_dir(dir).output();
    let output = output.unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    let said = stderr(&output);
    assert!(said.contains("layers are done and kept"), "{said}");
    assert!(said.contains("tileset.json"), "{said}");
    let nodes = || files(&dir.join("out/.alvis-partial/lod"));
    assert!(nodes().keys().any(|name| name.ends_with(".glb")));
    let said = stderr(&alvis(dir, &["lod", "out", "--resume"]));
    assert!(!said.contains("anew"), "{said}");
    assert_same_files(
        &files(&dir.join("whole")),
        &files(&dir.join("out")),
        "gone on with",
    );
}
