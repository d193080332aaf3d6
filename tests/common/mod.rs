//! What the tests of whole conversions share: a reader of tile sets of their own, slow references,
//! volumes, and where the shared data lies.
#![allow(dead_code)] // each test binary uses a part

pub mod glb;
pub mod reference;
pub mod seal;
pub mod set;
pub mod volumes;

use alvis::convert::{ConvertOptions, ConvertReport, convert};
use alvis::progress::Quiet;
use alvis::verify::{Report, VerifyOptions, verify};
use alvis::volume::Volume;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Directory of the shared data, or `None` after saying that the test is skipped.
pub fn data(test: &str) -> Option<PathBuf> {
    let dir = std::env::var_os("ALVIS_DATA").map_or_else(|| "../shared/data".into(), PathBuf::from);
    if dir.join("topology").is_dir() {
        return Some(dir);
    }
    eprintln!(
        "SKIPPED {test}: no test data in {} (set ALVIS_DATA to their directory)",
        dir.display()
    );
    None
}

/// Copies a directory with all that is in it to where nothing is.
pub fn copy_all(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        match path.is_dir() {
            true => copy_all(&path, &target),
            false => _ = std::fs::copy(&path, &target).unwrap(),
        }
    }
}

/// Converts into a temporary directory; panics if that fails.
pub fn converted(
    volume: &dyn Volume,
    options: &ConvertOptions,
) -> (tempfile::TempDir, ConvertReport) {
    let dir = tempfile::tempdir().unwrap();
    let report = convert(volume, options, dir.path(), &Quiet)
        .unwrap_or_else(|e| panic!("{}: {e}: {options:?}", volume.header().dims));
    (dir, report)
}

/// The report of a tile set that has to be sound. `against` is the cropped volume.
pub fn verified(dir: &Path, against: Option<&dyn Volume>) -> Report {
    let options = VerifyOptions {
        against,
        threads: 1,
        max_issues: 5,
        ..VerifyOptions::default()
    };
    let report = verify(dir, &options, &Quiet).unwrap();
    assert!(
        report.ok && report.issues.is_empty(),
        "{:#?}",
        report.issues
    );
    report
}

/// One thread and a threshold in the middle of 8 bits.
pub fn options(macrocube: [u32; 3]) -> ConvertOptions {
    ConvertOptions {
        threshold: 128.0,
        macrocube,
        threads: 1,
        ..ConvertOptions::default()
    }
}

/// All files below a directory by relative path.
pub fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(root: &Path, dir: &Path, out: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(root, &path, out);
            } else {
                let name = path
                    .strip_prefix(root)
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_string();
                out.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    let mut out = BTreeMap::new();
    walk(dir, dir, &mut out);
    out
}

/// Fails with the first file that differs.
pub fn assert_same_files(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>, what: &str) {
    let names = |m: &BTreeMap<String, Vec<u8>>| m.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(a), names(b), "{what}: other files");
    for (name, bytes) in a {
        assert!(*bytes == b[name], "{what}: {name} differs");
    }
}
