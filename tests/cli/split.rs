//! `split`: a tile set again, its cells cut at another ratio.

use super::{alvis, fails, json, ok, stderr, temp};
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
    for part in [
        "totals/objects 1;",
        "totals/objects 1285;",
        "nothing was written to new",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert!(!dir.join("new").exists());
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

/// Refuses `volume` for the set `old`, whether a new set is to be made or `old` replaced; nothing changes then. Returns the
/// message.
fn refused(dir: &Path, volume: &str) -> String {
    let before = all_files(&dir.join("old"));
    let anew = |dest: &str, more: &[&str]| {
        let words = [
            "split",
            "old",
            dest,
            "--ratio",
            "0.5",
            "--against",
            volume,
            "-q",
        ];
        fails(dir, &[&words, more].concat())
    };
    let message = anew("new", &[]);
    assert!(message.contains("--against"), "{message}");
    assert!(!dir.join("new").exists(), "{message}");
    anew("old", &["--force"]);
    assert!(before == all_files(&dir.join("old")), "{message}");
    message
}

#[test]
fn another_volume_is_refused_before_anything_is_made() {
    let dir = temp();
    let dir = dir.path();
    run(
        dir,
        "phantom foam scan.mhd --dims 60,52,48 --noise 0.3 --spacing 1 --unit mm -q",
    );
    run(
        dir,
        "convert scan.mhd old --threshold otsu --downsample 2 --split 0.9 -q",
    );
    run(
        dir,
        "phantom foam larger.mhd --dims 64,52,48 --spacing 1 --unit mm -q",
    );
    let message = refused(dir, "larger.mhd");
    for part in [
        "voxels 64 x 52 x 48",
        "voxels 60 x 52 x 48",
        "after filters 32 x 26 x 24",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let text = std::fs::read_to_string(dir.join("scan.mhd")).unwrap();
    let of = |from: &str, to: &str| {
        std::fs::write(dir.join("other.mhd"), text.replace(from, to)).unwrap()
    };
    of("MET_UCHAR", "MET_CHAR");
    let message = refused(dir, "other.mhd");
    assert!(
        message.contains("samples i8") && message.contains("samples u8"),
        "{message}"
    );
    of("ElementSpacing = 1 1 1", "ElementSpacing = 1 1 2");
    assert!(refused(dir, "other.mhd").contains("[2.0, 2.0, 4.0]"));
    std::fs::remove_dir_all(dir.join("old")).unwrap();
    leaky(dir);
    run(
        dir,
        &format!("convert leaky.raw old {RAW} --threshold otsu --split 0.9 -q"),
    );
    std::fs::write(dir.join("short.raw"), [0; 1000]).unwrap();
    let message = refused(dir, "short.raw");
    assert!(
        message.contains("1000 bytes") && message.contains("60 x 52 x 48"),
        "{message}"
    );
}

/// Counts of voxels, objects and parts are the same of all these.
#[test]
fn a_volume_that_counts_the_same_is_not_taken_for_the_other() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    let scan = std::fs::read(dir.join("leaky.raw")).unwrap();
    let write = |bytes: &[u8]| std::fs::write(dir.join("other.raw"), bytes).unwrap();
    for parts in ["--split 0.9", ""] {
        let _ = std::fs::remove_dir_all(dir.join("old"));
        run(
            dir,
            &format!("convert leaky.raw old {RAW} --threshold 120 {parts} -q"),
        );
        let mirrored: Vec<u8> = scan
            .chunks(60)
            .flat_map(|row| row.iter().rev().copied())
            .collect();
        write(&mirrored);
        let message = refused(dir, "other.raw");
        assert!(message.contains("objects.csv: "), "{message}");
        // the same phases; the surface is a little elsewhere
        let greys: Vec<u8> = scan
            .iter()
            .map(|&v| if v >= 120 { v.max(121) } else { v })
            .collect();
        assert!(greys != scan);
        write(&greys);
        let message = refused(dir, "other.raw");
        assert!(message.contains("totals/volume6"), "{message}");
        write(&scan);
        let words = "split old new --ratio 0.5 --against other.raw";
        let words: Vec<&str> = words.split(' ').collect();
        let found = alvis(dir, &words);
        let said = stderr(&found);
        assert_eq!(found.status.code(), Some(0), "{said}");
        assert!(
            said.contains("warning: the volume is named \"other.raw\""),
            "{said}"
        );
        assert_eq!(said.contains("not split yet"), parts.is_empty(), "{said}");
        std::fs::remove_dir_all(dir.join("new")).unwrap();
    }
}

#[test]
fn what_the_new_set_has_not_is_said() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    run(
        dir,
        &format!("convert leaky.raw old {RAW} --threshold otsu --lod -q"),
    );
    run(dir, "select old painted --colour-by volume -q");
    let said = |words: &str| {
        let found = alvis(dir, &words.split(' ').collect::<Vec<_>>());
        assert_eq!(found.status.code(), Some(0), "{}", stderr(&found));
        stderr(&found)
    };
    let notes = said("split old new --ratio 0.5 --against leaky.raw");
    assert!(notes.contains("old has levels of detail"), "{notes}");
    assert!(
        notes.contains("--split-h 0.5 and --split-min-radius 0"),
        "{notes}"
    );
    let notes = said("split painted also --ratio 0.5 --against leaky.raw");
    assert!(notes.contains("painted is painted"), "{notes}");
    assert!(all_files(&dir.join("new")) == all_files(&dir.join("also")));
    let notes = said("split new again --ratio 0.6 --against leaky.raw");
    assert!(
        !notes.contains("levels") && !notes.contains("not split"),
        "{notes}"
    );
}

#[test]
fn a_ratio_that_cannot_be_has_words_of_its_own() {
    let dir = temp();
    for ratio in ["0", "1.01", "nan", "80%"] {
        let words = [
            "split",
            "out",
            "new",
            "--against",
            "x.raw",
            "--ratio",
            ratio,
        ];
        let message = stderr(&alvis(dir.path(), &words));
        assert!(message.contains("from 0.001 to 1, as 0.7"), "{message}");
        assert!(!message.contains("names of files"), "{message}");
    }
}
