//! `split`: a tile set again, its cells cut at another ratio.

use super::{fails, json, ok, temp};
use std::collections::BTreeMap;
use std::path::Path;

/// All files below a directory, by their names.
fn files(root: &Path, dir: &Path, into: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(root, &path, into);
            continue;
        }
        let name = path.strip_prefix(root).unwrap().to_str().unwrap();
        into.insert(name.to_owned(), std::fs::read(&path).unwrap());
    }
}

fn all_files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    files(dir, dir, &mut all);
    all
}

/// A noisy foam, whose cells leak.
fn leaky(dir: &Path) {
    let words = "phantom foam leaky.raw --dims 60,52,48 --noise 0.3 --quiet";
    ok(dir, &words.split(' ').collect::<Vec<_>>());
}

const RAW: &str = "--dims 60,52,48 --dtype u8";

fn run(dir: &Path, words: &str) {
    ok(dir, &words.split_whitespace().collect::<Vec<_>>());
}

#[test]
fn a_set_that_is_split_anew_is_the_one_of_a_conversion() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    let many = "--threshold otsu --smooth 0.7 --min-voxels 5 --macrocube 16,20,24 --ambiguous join --crop 3:,:50,: \
                --spacing 0.02,0.02,0.04 --unit mm --table-unit um --for meshlab --roi cylinder:30.5,26,24 --roi-fill air \
                --tables csv,parquet --split-h 0.25 --split-min-radius 1";
    for (i, others) in ["--threshold otsu", many].into_iter().enumerate() {
        let set = |name: &str| format!("{name}{i}");
        let [old, new, expected] = ["old", "new", "expected"].map(set);
        run(
            dir,
            &format!("convert leaky.raw {old} {RAW} {others} --split 0.9 --quiet"),
        );
        run(
            dir,
            &format!("convert leaky.raw {expected} {RAW} {others} --split 0.5 --quiet"),
        );
        run(
            dir,
            &format!("split {old} {new} --ratio 0.5 --against leaky.raw --threads 1 --quiet"),
        );
        let sets = [&old, &new, &expected].map(|name| all_files(&dir.join(name)));
        assert!(sets[1] == sets[2], "{others}");
        assert!(
            sets[0]["cells.csv"] != sets[1]["cells.csv"],
            "nothing changed: {others}"
        );
        let refused = [
            "split",
            &old,
            &new,
            "--ratio",
            "0.5",
            "--against",
            "leaky.raw",
        ];
        assert!(fails(dir, &refused).contains("--force"));
    }
}

#[test]
fn what_it_needs_is_said() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    run(
        dir,
        &format!("convert leaky.raw out {RAW} --threshold otsu --quiet"),
    );
    let split = |more: &[&str]| {
        fails(
            dir,
            &[&["split", "out", "new", "--ratio", "0.7"], more].concat(),
        )
    };
    let message = split(&[]);
    assert!(message.contains("--against leaky.raw"), "{message}");
    assert!(message.contains("not split yet"), "{message}");
    let message = fails(dir, &["cells", "out", "--split-curve"]);
    assert!(message.contains("`alvis split out DEST"), "{message}");
    let message = split(&["--against", "leaky.raw", "--mask", "m.nrrd"]);
    assert!(message.contains("no mask"), "{message}");
    assert!(!dir.join("new").exists());
    // one of the same size, of another body
    run(
        dir,
        "phantom foam other.raw --dims 60,52,48 --seed 7 --quiet",
    );
    let message = split(&["--against", "other.raw", "--quiet"]);
    assert!(message.contains("voxels above the threshold"), "{message}");
    run(dir, "select out part --where voxels>100 --quiet");
    let refused = [
        "split",
        "part",
        "p",
        "--ratio",
        "0.7",
        "--against",
        "leaky.raw",
    ];
    let message = fails(dir, &refused);
    assert!(message.contains("selected from"), "{message}");
    let index = std::fs::read_to_string(dir.join("out/index.json")).unwrap();
    assert_eq!(json(&index)["totals"].get("components"), None);
}

#[test]
fn a_mask_is_given_again() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    run(dir, "phantom sphere mask.nrrd --dims 60,52,48 --quiet");
    let roi = "--threshold 128 --clamp 0,250 --roi mask:mask.nrrd";
    run(dir, &format!("convert leaky.raw old {RAW} {roi} --quiet"));
    run(
        dir,
        &format!("convert leaky.raw expected {RAW} {roi} --split 0.65 --quiet"),
    );
    let message = fails(
        dir,
        &[
            "split",
            "old",
            "new",
            "--ratio",
            "0.65",
            "--against",
            "leaky.raw",
        ],
    );
    assert!(message.contains("--mask mask.nrrd"), "{message}");
    run(
        dir,
        "split old new --ratio 0.65 --against leaky.raw --mask mask.nrrd --quiet",
    );
    assert!(all_files(&dir.join("new")) == all_files(&dir.join("expected")));
}
