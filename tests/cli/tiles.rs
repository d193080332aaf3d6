//! `convert`, `verify` and `demo`.

use super::{alvis, assert_keys, fails, foam, json, ok, stderr, stdout, temp};
use serde_json::Value;

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
    assert!(stdout(&output).contains("1 object, 1 cell, 1 surface\n"));
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
    assert!(ok(dir.path(), &verify).starts_with("ok: 1 tile, "));
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
    // what is wrong is said all the same, a line each, and nothing else
    let output = alvis(dir.path(), &["verify", "out", "--quiet"]);
    assert_eq!(output.status.code(), Some(1));
    let said = stdout(&output);
    assert!(said.starts_with("error MANIFEST_"), "{said}");
    assert!(
        said.lines().all(|line| line.starts_with("error ")),
        "{said}"
    );
}

#[test]
fn a_set_made_from_raw_is_compared_with_the_volume_in_any_container() {
    let dir = temp();
    let at = |name: &str| dir.path().join(name);
    let raw = ["--dims", "24,20,16", "--dtype", "u16"];
    foam(dir.path(), "a.mha", &raw);
    foam(dir.path(), "a.raw", &raw);
    let mut samples = std::fs::read(at("a.raw")).unwrap();
    samples.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    std::fs::write(at("a.raw"), &samples).unwrap();
    let convert = ["convert", "a.raw", "out", "--threshold", "32767.5", "-q"];
    let big = ["--endian", "big"];
    ok(dir.path(), &[&convert[..], &raw, &big].concat());
    let verify = |volume| alvis(dir.path(), &["verify", "out", "--against", volume]);
    for same in ["a.raw", "a.mha"] {
        let output = verify(same);
        assert_eq!(
            output.status.code(),
            Some(0),
            "{}{}",
            stdout(&output),
            stderr(&output)
        );
    }
    // the same samples as slices, then one of them missing
    std::fs::create_dir(at("slices")).unwrap();
    for (z, slice) in samples.chunks(24 * 20 * 2).enumerate() {
        std::fs::write(at("slices").join(format!("{z:02}")), slice).unwrap();
    }
    assert_eq!(verify("slices").status.code(), Some(0));
    std::fs::remove_file(at("slices/03")).unwrap();
    let message = fails(dir.path(), &["verify", "out", "--against", "slices"]);
    assert!(message.contains("15 files"), "{message}");
    foam(dir.path(), "other.mha", &["--dims", "16,16,16"]);
    let output = verify("other.mha");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stdout(&output).contains("VOLUME_MISMATCH"));
}

#[test]
fn a_conversion_that_is_not_finished_is_no_tile_set_yet() {
    let dir = temp();
    std::fs::create_dir_all(dir.path().join("out/.alvis-partial")).unwrap();
    for command in [
        &["verify", "out"][..],
        &["cells", "out"],
        &["info", "out"],
        &["export", "out", "a.ply"],
    ] {
        let message = fails(dir.path(), command);
        assert!(message.contains("--resume"), "{message}");
    }
}

#[test]
fn info_says_what_a_tile_set_is() {
    let dir = temp();
    let space = ["--spacing", "0.05", "--unit", "mm"];
    foam(
        dir.path(),
        "f.mhd",
        &[&["--pitch", "11"][..], &space].concat(),
    );
    let convert =
        "convert f.mhd out --threshold 127.5 --macrocube 16 --crop :,1:,: --table-unit um --quiet";
    ok(dir.path(), &convert.split(' ').collect::<Vec<_>>());
    let said = ok(dir.path(), &["info", "out"]);
    let version = concat!("alvis ", env!("CARGO_PKG_VERSION"));
    for part in [
        "out: 18 tiles, ",
        "f.mhd, 40 x 36 x 32 voxels, u8, cropped to 0:40,1:36,0:32",
        version,
        "40 x 35 x 32 voxels",
        "0.05 x 0.05 x 0.05 mm (from the file)",
        "lengths in um",
        "threshold  127.5",
        " triangles\n",
        "1 object, ",
        "strips, encoding float, layout auto",
        "alvis verify out\n",
        "alvis cells out",
        "alvis export out FILE.ply",
    ] {
        assert!(said.contains(part), "{part} in {said}");
    }
    assert!(said.lines().all(|l| l.len() <= 80), "{said}");
    let report = json(&ok(dir.path(), &["info", "out", "--json"]));
    assert_keys(
        &report,
        "format name dims spacing unit origin directions threshold primitives encoding layout totals \
         selection generator source macrocube",
    );
    assert_eq!(report["format"], "alvis-tiles");
    let index = json(&std::fs::read_to_string(dir.path().join("out/index.json")).unwrap());
    assert_eq!(report["totals"], index["totals"]);
    let part = [
        "select",
        "out",
        "part",
        "--where",
        "id < 4",
        "--paint",
        "id < 2=red",
        "-q",
    ];
    ok(dir.path(), &part);
    let said = ok(dir.path(), &["info", "part"]);
    let cells = index["totals"]["cells"].as_u64().unwrap();
    let row = format!("selection  3 of {cells} cells, where id < 4; painted\n");
    assert!(said.contains(&row), "{said}");
    // what describes a volume does not go with it
    for option in [["--dims", "4,4,4"], ["--threshold", "3"]] {
        let message = fails(dir.path(), &[&["info", "out"][..], &option].concat());
        assert!(message.contains(option[0]), "{message}");
    }
}

#[test]
fn a_tile_set_one_directory_away_is_named() {
    let dir = temp();
    ok(dir.path(), &["demo", "d", "--size", "16", "--quiet"]);
    for wrong in ["d", "d/foam/tiles"] {
        for command in [
            &["verify", wrong][..],
            &["cells", wrong],
            &["export", wrong, "a.ply"],
            &["select", wrong, "part", "--where", "id > 0"],
        ] {
            let message = fails(dir.path(), command);
            assert!(
                message.contains("did you mean ") && message.contains("d/foam?"),
                "{message}"
            );
        }
    }
    assert!(!fails(dir.path(), &["verify", "."]).contains("did you mean"));
    assert!(!fails(dir.path(), &["verify", "none"]).contains("did you mean"));
}

#[test]
fn a_surface_that_was_filled_away_is_said_to_be() {
    let dir = temp();
    foam(dir.path(), "a.mha", &[]);
    let convert = "convert a.mha out --threshold 127.5 --min-voxels 1000000";
    let output = alvis(dir.path(), &convert.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0));
    let said = stderr(&output);
    assert!(said.contains("fewer than 1000000 voxels"), "{said}");
    assert!(!said.contains("reaches the threshold"), "{said}");
}

#[test]
fn a_demo_replaces_an_earlier_one() {
    let dir = temp();
    for _ in 0..2 {
        let report = json(&ok(
            dir.path(),
            &["demo", "--size", "40", "--json", "--quiet"],
        ));
        assert_keys(&report, "volume tiles threshold convert verify");
        assert!(report["convert"]["tiles"].as_u64() > Some(0));
    }
    let demo = dir.path().join("alvis-demo");
    assert!(demo.join("foam/index.json").exists());
    assert_eq!(std::fs::read_dir(demo).unwrap().count(), 4);
}

#[test]
fn a_demo_ends_with_the_line_that_shows_it() {
    let dir = temp();
    let said = ok(dir.path(), &["demo", "my demo", "--size", "16"]);
    let last = said.lines().last().unwrap();
    assert!(last.ends_with("alvis view 'my demo/foam'"), "{last}");
}

#[test]
fn a_demo_leaves_what_is_not_its_own() {
    let dir = temp();
    std::fs::create_dir(dir.path().join("mine")).unwrap();
    std::fs::write(dir.path().join("mine/thesis.tex"), "precious").unwrap();
    let refused = |name: &str| {
        let message = fails(dir.path(), &["demo", "mine", "--size", "16"]);
        assert!(message.contains(name), "{message}");
    };
    refused("thesis.tex");
    let mine = dir.path().join("mine");
    assert_eq!(std::fs::read_dir(&mine).unwrap().count(), 1);
    // what has the name of a demo's file need not be one
    std::fs::rename(mine.join("thesis.tex"), mine.join("foam.raw")).unwrap();
    refused("foam.raw");
    assert_eq!(std::fs::read(mine.join("foam.raw")).unwrap(), b"precious");
    std::fs::remove_file(mine.join("foam.raw")).unwrap();
    ok(dir.path(), &["demo", "mine", "--size", "16", "--quiet"]);
    let volume = std::fs::read(mine.join("foam.raw")).unwrap();
    std::fs::write(mine.join("foam/thesis.tex"), "precious").unwrap();
    let message = fails(dir.path(), &["demo", "mine", "--size", "20"]);
    assert!(message.contains("thesis.tex"), "{message}");
    assert!(!message.contains("--force"), "{message}");
    assert_eq!(std::fs::read(mine.join("foam.raw")).unwrap(), volume);
}

#[cfg(target_os = "linux")]
#[test]
fn a_failure_names_what_the_user_named() {
    use std::os::unix::fs::PermissionsExt;
    let dir = temp();
    foam(dir.path(), "f.mhd", &[]);
    std::fs::create_dir(dir.path().join("shut")).unwrap();
    let shut = dir.path().join("shut");
    std::fs::set_permissions(&shut, std::fs::Permissions::from_mode(0o555)).unwrap();
    if std::fs::write(shut.join("a"), "").is_ok() {
        eprintln!("SKIPPED a_failure_names_what_the_user_named: this user may write everywhere");
        return;
    }
    let message = fails(
        dir.path(),
        &["convert", "f.mhd", "shut", "--threshold", "127.5", "-q"],
    );
    assert!(message.contains("shut: cannot"), "{message}");
    assert!(!message.contains(".alvis-partial"), "{message}");
}

#[test]
fn what_needs_no_sample_is_refused_before_samples_are_read() {
    let dir = temp();
    // no two samples differ: Otsu's method would fail
    std::fs::write(dir.path().join("flat.raw"), [7; 8 * 8 * 8]).unwrap();
    std::fs::create_dir(dir.path().join("mine")).unwrap();
    std::fs::write(dir.path().join("mine/thesis.tex"), "precious").unwrap();
    let convert = "convert flat.raw OUT --dims 8,8,8 --dtype u8 --threshold otsu";
    let fails = |out: &str, more: &[&str]| {
        let convert = convert.replace("OUT", out);
        let args: Vec<_> = convert.split(' ').chain(more.iter().copied()).collect();
        fails(dir.path(), &args)
    };
    assert!(fails("mine", &["--force"]).contains("thesis.tex"));
    assert!(fails("flat.raw", &[]).contains("use as the output directory"));
    assert!(fails("new", &["--memory", "1MiB"]).contains("smallest limit"));
    assert!(fails("new", &[]).contains("no two finite samples"));
    assert!(!dir.path().join("new").exists());
}

#[test]
fn a_tile_set_goes_to_the_web_and_back() {
    let dir = temp();
    foam(dir.path(), "f.mhd", &[]);
    let convert = "convert f.mhd out --threshold otsu --macrocube 16 --quiet";
    ok(dir.path(), &convert.split(' ').collect::<Vec<_>>());
    let repack = ["repack", "out", "web", "--for", "web", "--quiet", "--json"];
    let report = json(&ok(dir.path(), &repack));
    assert_keys(
        &report,
        "tiles triangles bytes bytes_before seconds peak_rss_bytes",
    );
    let direct = [
        &convert.split(' ').collect::<Vec<_>>()[..],
        &["--for", "web"],
    ]
    .concat();
    let direct: Vec<&str> = direct
        .into_iter()
        .map(|word| if word == "out" { "direct" } else { word })
        .collect();
    ok(dir.path(), &direct);
    // a conversion leaves room in the JSON, which repacking takes out
    let again = ["repack", "direct", "again", "--for", "web", "--quiet"];
    ok(dir.path(), &again);
    let tile = "tiles/z0000/y0000_x0000.glb";
    let [a, b] =
        ["web", "again"].map(|set| std::fs::read(dir.path().join(set).join(tile)).unwrap());
    assert!(a == b, "converting for the web is converting and repacking");
    let reports = ["out", "web"].map(|set| json(&ok(dir.path(), &["verify", set, "--json"])));
    for key in [
        "ok",
        "triangles",
        "vertices",
        "volume6",
        "surfaces",
        "cells",
    ] {
        assert_eq!(reports[0][key], reports[1][key], "{key}");
    }
    // options go before the profile that they are a part of
    let lists = [
        "repack", "web", "lists", "--for", "meshlab", "--layout", "merged",
    ];
    let said = ok(dir.path(), &lists);
    assert!(said.contains("bytes each"), "{said}");
    assert_eq!(
        json(&std::fs::read_to_string(dir.path().join("lists/index.json")).unwrap())["layout"],
        "merged"
    );
    assert!(fails(dir.path(), &["repack", "out", "x"]).contains("--for, --primitives"));
    assert!(
        fails(dir.path(), &["repack", "out", "out", "--for", "web"]).contains("another directory")
    );
    assert!(fails(dir.path(), &["repack", "out", "web", "--for", "web"]).contains("--force"));
}
