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
