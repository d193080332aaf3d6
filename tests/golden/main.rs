//! Every byte that the command writes, for small inputs: what a change of the code must not change by chance.
//!
//! A case is a command line. `expected.txt` has, for each, the SHA-256 of every file that it writes, and of what it
//! prints where that is the result. Conversions are done twice, by one thread with the smallest memory limit that
//! works and by three threads, and must agree. After a change of bytes that is meant, `GOLDEN=write cargo test
//! --test golden` writes the file anew: the commit says why.

#[path = "../command/mod.rs"]
mod command;

use command::{alvis, ok};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

/// Volumes that the cases read, made by these lines.
const INPUTS: &[&str] = &[
    "phantom foam foam.mhd --dims 40,36,44 --pitch 11 --spacing 0.05 --unit mm",
    "phantom foam noisy.nrrd --dims 33,30,28 --dtype u16 --pitch 12 --noise 0.1 --spacing 2,2,3 --unit um",
    "phantom noise noise.raw --dims 21,18,20 --dtype u8 --density 0.4",
    "phantom gyroid gyroid.mhd --dims 36,34,32 --dtype f32 --spacing 1 --unit mm",
    "phantom torus torus.raw --dims 40,40,24 --dtype i16",
];

const FOAM: &str = "convert foam.mhd OUT --threshold otsu --macrocube 16";
const NOISY: &str = "convert noisy.nrrd OUT --threshold 30000 --macrocube 13,16,9";
const NOISE: &str =
    "convert noise.raw OUT --dims 21,18,20 --dtype u8 --threshold 128 --macrocube 10";
const GYROID: &str = "convert gyroid.mhd OUT --threshold 128 --macrocube 20";
const TORUS: &str = "convert torus.raw OUT --dims 40,40,24 --dtype i16 --threshold 0";

/// Every conversion: a line of above, and what is added to it.
fn conversions() -> Vec<String> {
    let mut lines = Vec::new();
    for primitives in ["strips", "triangles"] {
        for encoding in ["float", "quantized", "meshopt"] {
            for layout in ["nodes", "merged"] {
                for cap in ["", " --cap"] {
                    lines.push(format!(
                        "{FOAM} --primitives {primitives} --encoding {encoding} --layout {layout}{cap}"
                    ));
                }
            }
        }
    }
    for (line, added) in [
        (FOAM, ""),
        (FOAM, " --for web"),
        (FOAM, " --for meshlab"),
        (FOAM, " --ambiguous join"),
        (FOAM, " --min-voxels 40"),
        (FOAM, " --walls"),
        (NOISY, " --walls --split --min-voxels 3"),
        (FOAM, " --crop 3:37,5:36,2:41"),
        (FOAM, " --unit um"),
        (NOISY, ""),
        (NOISY, " --cap"),
        (NOISY, " --ambiguous join --min-voxels 3"),
        (NOISY, " --crop 1:30,0:29,3:28 --for web"),
        (NOISE, ""),
        (NOISE, " --cap"),
        (NOISE, " --ambiguous join"),
        (NOISE, " --ambiguous join --cap --for web"),
        (NOISE, " --layout nodes --primitives triangles"),
        (NOISE, " --min-voxels 5"),
        (GYROID, ""),
        (GYROID, " --cap --for meshlab"),
        (GYROID, " --spacing 1,2,3 --unit cm"),
        (TORUS, ""),
        (TORUS, " --cap --spacing 0.1 --unit nm"),
        (FOAM, " --downsample 2 --cap"),
        (FOAM, " --invert --clamp 60,200"),
        (NOISY, " --clamp 20000,45000 --downsample 3"),
        (NOISY, " --downsample 2 --invert --crop :,1:14,2:"),
        (GYROID, " --downsample 2 --for web"),
        (FOAM, " --smooth 1"),
        (NOISY, " --smooth 3um --ambiguous join"),
        (NOISY, " --median 1 --smooth 0.8"),
        (NOISE, " --median 2"),
        (GYROID, " --smooth 1.5 --cap"),
        (TORUS, " --smooth 2,1,0.5"),
        (FOAM, " --roi cylinder:20,18,15"),
        (
            NOISY,
            " --roi cylinder:16,15,11 --roi-fill air --crop 1:30,0:29,3:28 --for web",
        ),
    ] {
        lines.push(format!("{line}{added}"));
    }
    lines
}

/// Commands on the sets `tiles` and `filtered` of the foam and the set `noise`; OUT is what they write, if they do.
const OTHERS: &[&str] = &[
    "export tiles OUT.ply",
    "export tiles OUT.stl",
    "export tiles OUT.obj",
    "export tiles OUT.glb",
    "export noise OUT.ply --where voxels>3",
    "export noise OUT.stl --objects --largest 1",
    "export tiles OUT.ply --simplify 0.3",
    "select tiles OUT --where id>5",
    "select tiles OUT --where sphericity<0.9 --omit",
    "select noise OUT --where voxels<3",
    "select noise OUT --objects --largest 1",
    "select noise OUT --objects --where voxels<3 --omit --paint voxels>9=red",
    "select noise OUT --surfaces --largest 4",
    "convert foam.mhd noisy.nrrd --out-dir OUT --threshold otsu --macrocube 16",
    "repack tiles OUT --for web",
    "repack tiles OUT --for meshlab",
    "repack noise OUT --layout nodes",
    "cells tiles --format csv",
    "cells tiles --objects --json",
    "cells tiles --surfaces --sort -area --top 5",
    "cells noise --objects --largest 3 --json",
    "cells tiles --summary --json",
    "cells noise --summary --json",
    "report tiles --json",
    "report filtered --json",
    "report tiles OUT.html",
    "report noise OUT.html",
    "verify tiles --json",
    "verify tiles --against foam.mhd --json",
    "verify noise --json",
    "verify filtered --against foam.mhd --json",
];

fn hash(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// The hash of every file at or below a path, by its name from there.
fn hashes(path: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut paths = vec![path.to_path_buf()];
    while let Some(at) = paths.pop() {
        if at.is_dir() {
            paths.extend(std::fs::read_dir(&at).unwrap().map(|e| e.unwrap().path()));
        } else if at.is_file() {
            let name = at.strip_prefix(path).unwrap().display().to_string();
            found.insert(name, hash(&std::fs::read(&at).unwrap()));
        }
    }
    found
}

/// What was printed, without what differs from run to run.
fn settled(printed: &str) -> String {
    match serde_json::from_str::<serde_json::Value>(printed) {
        Ok(serde_json::Value::Object(mut object)) => {
            for name in ["seconds", "peak_rss_bytes"] {
                object.remove(name);
            }
            serde_json::Value::Object(object).to_string()
        }
        _ => printed.to_owned(),
    }
}

/// Runs a line with OUT replaced; what it wrote there, or printed.
fn run(dir: &Path, line: &str, out: &str, more: &[&str]) -> BTreeMap<String, String> {
    let line = line.replace("OUT", out);
    let words: Vec<&str> = line.split(' ').chain(more.iter().copied()).collect();
    let printed = ok(dir, &words);
    let file = words.iter().find(|word| word.starts_with(out));
    match file {
        Some(file) => hashes(&dir.join(file)),
        None => [("stdout".to_string(), hash(settled(&printed).as_bytes()))].into(),
    }
}

/// The smallest limit with which a conversion works, as the refusal of less says.
fn smallest(dir: &Path, line: &str, out: &str) -> String {
    let line = line.replace("OUT", out);
    let mut limit = "1".to_string();
    loop {
        let mut words: Vec<&str> = line.split(' ').collect();
        words.extend(["--threads", "1", "--quiet", "--memory", &limit]);
        let output = alvis(dir, &words);
        if output.status.success() {
            std::fs::remove_dir_all(dir.join(out)).unwrap();
            return limit;
        }
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        let named = ["limit that works is ", "at least "].map(|text| error.split(text).nth(1));
        let named = named.into_iter().flatten().next();
        let next = named
            .and_then(|text| text.split([' ', ':', '\n']).next())
            .expect(&error);
        assert_ne!(next, limit, "{error}");
        limit = next.to_string();
    }
}

fn made() -> BTreeMap<String, BTreeMap<String, String>> {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let quiet = |line: &str| {
        ok(
            dir,
            &format!("{line} --quiet").split(' ').collect::<Vec<_>>(),
        )
    };
    INPUTS.iter().for_each(|line| {
        quiet(line);
    });
    quiet(&FOAM.replace("OUT", "tiles"));
    quiet(&NOISE.replace("OUT", "noise"));
    quiet(&format!(
        "{} --downsample 2 --invert",
        FOAM.replace("OUT", "filtered")
    ));
    let inputs = INPUTS.iter().map(|line| {
        let file = line.split(' ').nth(2).unwrap();
        (line.to_string(), hashes(&dir.join(file)))
    });
    let lines = conversions();
    let conversions: Vec<_> = lines
        .par_iter()
        .enumerate()
        .map(|(i, line)| {
            let (small, wide) = (format!("small{i}"), format!("wide{i}"));
            let limit = smallest(dir, line, &small);
            let tight = ["--quiet", "--threads", "1", "--memory", &limit];
            let tight = run(dir, line, &small, &tight);
            let three = run(dir, line, &wide, &["--quiet", "--threads", "3"]);
            assert_eq!(tight, three, "{line}");
            (line.clone(), three)
        })
        .collect();
    let others: Vec<_> = OTHERS
        .par_iter()
        .enumerate()
        .map(|(i, line)| (line.to_string(), run(dir, line, &format!("made{i}"), &[])))
        .collect();
    inputs.chain(conversions).chain(others).collect()
}

/// As in `expected.txt`: a line for each case, and one for each of its files.
fn text(cases: &BTreeMap<String, BTreeMap<String, String>>) -> String {
    let mut text = String::new();
    for (line, files) in cases {
        let _ = writeln!(text, "{line}");
        for (name, hash) in files {
            let _ = writeln!(text, "  {hash} {name}");
        }
    }
    text
}

/// The lines of files, each with its case.
fn entries(text: &str) -> BTreeSet<String> {
    let mut case = "";
    let lines = text.lines().filter_map(|line| {
        let of_file = line.strip_prefix("  ");
        case = if of_file.is_none() { line } else { case };
        of_file.map(|file| format!("{case}: {file}"))
    });
    lines.collect()
}

#[test]
fn bytes_are_as_before() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/expected.txt");
    let found = text(&made());
    if std::env::var_os("GOLDEN").is_some_and(|v| v == "write") {
        std::fs::write(&path, found).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(&path).unwrap();
    let (expected, found) = (entries(&expected), entries(&found));
    let differ: Vec<_> = found.symmetric_difference(&expected).collect();
    assert!(
        differ.is_empty(),
        "{} entries differ, the first ones:\n{}",
        differ.len(),
        differ
            .iter()
            .take(20)
            .map(|e| e.as_str())
            .collect::<Vec<_>>()
            .join("\n")
    );
}
