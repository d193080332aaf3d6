//! What is refused: other plans, inputs, options and versions; files that are damaged; what is not converted in parts.

use super::labels::{blocks, given};
use super::{Files, finish, plan};
use crate::command::{alvis, fails, ok};
use crate::common::volumes::{foam, placed};
use crate::common::{assert_same_files, converted, copy_all, files, options};
use alvis::Error;
use alvis::convert::parts::{
    Asked, Merged, NextWork, merge_parts, next_work, plan_parts, work_on_part,
};
use alvis::convert::{ConvertOptions, NeckRule};
use alvis::progress::Quiet;
use alvis::volume::MemoryVolume;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

const WORK: &str = ".alvis-partial";

fn small() -> (MemoryVolume<u8>, ConvertOptions) {
    let dims = [20, 18, 24];
    let options = ConvertOptions {
        min_voxels: 3,
        ..options([8, 8, 6])
    };
    (placed(dims, foam(dims, 9)), options)
}

/// The differences that an error names.
fn differences(error: Error) -> String {
    match error {
        Error::OtherPlan { differences, .. } => differences,
        other => panic!("{other}"),
    }
}

#[test]
fn other_options_and_another_number_of_parts_are_refused() {
    let (volume, options) = small();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path();
    plan(&volume, &options, out, 2);
    work_on_part(&volume, &options, out, 0, &Quiet).unwrap();
    let other = ConvertOptions {
        threshold: 130.0,
        ..options.clone()
    };
    let planned = plan_parts(&volume, &other, out, 2, Asked::default());
    let expected = "--threshold was 128 and is 130";
    assert_eq!(differences(planned.unwrap_err()), expected);
    let worked = work_on_part(&volume, &other, out, 1, &Quiet);
    assert_eq!(differences(worked.unwrap_err()), expected);
    let merged = merge_parts(&volume, &other, out, &Quiet);
    assert_eq!(differences(merged.unwrap_err()), expected);
    let planned = plan_parts(&volume, &options, out, 3, Asked::default());
    assert_eq!(differences(planned.unwrap_err()), "--parts was 2 and is 3");
    // the same plan, with what changes no byte, leaves all that is done
    let same = ConvertOptions {
        memory: 1 << 29,
        threads: 2,
        ..options.clone()
    };
    plan(&volume, &same, out, 2);
    assert!(matches!(next_work(out, 0).unwrap(), NextWork::Waits(_)));
    // another volume of the same kind
    let other = placed([20, 18, 24], foam([20, 18, 24], 10));
    let worked = work_on_part(&other, &options, out, 1, &Quiet);
    let text = differences(worked.unwrap_err());
    assert!(
        text.starts_with("samples of the input was CRC-32 "),
        "{text}"
    );
    // by force the other plan takes its place
    let forced = ConvertOptions {
        threshold: 130.0,
        force: true,
        ..options.clone()
    };
    plan(&volume, &forced, out, 3);
    finish(&volume, &forced, out);
    let (whole, _) = converted(&volume, &forced);
    assert_same_files(&files(whole.path()), &files(out), "by force");
}

#[test]
fn what_others_do_there_is_refused_while_a_plan_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let line = "phantom foam foam.mhd --dims 30,26,40 --pitch 9 --quiet";
    let run = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    let refused = |line: &str| fails(dir, &line.split(' ').collect::<Vec<_>>());
    run(line);
    let convert = "convert foam.mhd out --threshold otsu --macrocube 8 --quiet";
    let plan = convert.replace("convert", "plan") + " --parts 3";
    run(&plan);
    run("work out --part 1 --quiet");
    for more in ["", " --resume"] {
        let message = refused(&format!("{convert}{more}"));
        assert!(
            message.contains("a plan to convert a volume in parts is there"),
            "{message}"
        );
    }
    assert_eq!(
        alvis(dir, &["work", "out", "--part", "1"]).status.code(),
        Some(75)
    );
    for (line, what) in [
        ("work out --part 3", "0 to 2"),
        ("work nowhere --part 0", "nowhere, which holds no plan"),
        ("merge nowhere", "nowhere, which holds no plan"),
        ("work foam.mhd --part 0", "foam.mhd"),
    ] {
        let message = refused(line);
        assert!(message.contains(what), "{line}: {message}");
    }
    let plan_in_bucket = plan.replace(" out ", " s3://bucket/out ");
    for line in [
        &plan_in_bucket,
        "work s3://bucket/out --part 0",
        "merge s3://bucket/out",
    ] {
        let message = refused(line);
        let what = "plan into a directory that all machines share";
        assert!(message.contains(what), "{line}: {message}");
    }
    let plan_of = |more: &str| plan.replace(" out ", " other ") + more;
    for (line, what) in [
        (plan_of(" --split 1.5"), "--split"),
        (plan_of(" --labels nowhere.tif"), "nowhere.tif"),
        (plan_of(" --lod"), "--lod"),
        (plan_of(" --resume"), "--resume"),
        (plan_of("").replace("--parts 3", "--parts 9"), "1 to 5"),
        (plan_of("").replace("--parts 3", "--parts 0"), "--parts"),
        (plan_of(" --memory 1MiB"), "--memory"),
    ] {
        let message = refused(&line);
        assert!(message.contains(what), "{line}: {message}");
        assert!(!dir.join("other").exists(), "{line}");
    }
    // a plan is dropped by force alone, and makes no tile set where one is
    run(&format!("{convert} --force"));
    assert!(!dir.join("out").join(WORK).exists());
    for more in ["", " --force"] {
        let message = refused(&format!("{plan}{more}"));
        assert!(message.contains("which holds a tile set"), "{message}");
    }
}

#[test]
fn an_input_that_changed_is_refused_with_both_values() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let run = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    let refused = |line: &str| fails(dir, &line.split(' ').collect::<Vec<_>>());
    run("phantom foam foam.raw --dims 30,26,40 --pitch 9 --quiet");
    run(
        "plan foam.raw out --dims 30,26,40 --dtype u8 --offset 0 --threshold 128 --macrocube 8 --quiet --parts 2",
    );
    run("work out --part 0 --quiet");
    let path = dir.join("foam.raw");
    let (bytes, time) = (
        fs::read(&path).unwrap(),
        path.metadata().unwrap().modified().unwrap(),
    );
    let write = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let file = fs::File::options().write(true).open(&path).unwrap();
        file.set_modified(time).unwrap();
    };
    let mut longer = bytes.clone();
    longer.push(0);
    write(&longer);
    let message = refused("work out --part 1 --quiet");
    let expected = "size of the input was 31200 bytes and is 31201 bytes";
    assert!(message.contains(expected), "{message}");
    let mut other = bytes.clone();
    other[7] ^= 255;
    write(&other);
    let message = refused("work out --part 1 --quiet");
    assert!(
        message.contains("samples of the input was CRC-32 "),
        "{message}"
    );
    write(&bytes);
    run("work out --part 1 --quiet");
    // elsewhere it is the same, and relative to where one is
    fs::create_dir(dir.join("mount")).unwrap();
    fs::rename(&path, dir.join("mount/foam.raw")).unwrap();
    assert_eq!(
        alvis(dir, &["merge", "out", "--input", "mount/foam.raw"])
            .status
            .code(),
        Some(3)
    );
    refused("work out --part 0 --quiet");
    run("work out --part 0 --quiet --input mount/foam.raw");
}

/// A file of labels for a volume of 30 x 26 x 40 voxels, as it was when it was written.
struct LabelFile {
    path: PathBuf,
    bytes: Vec<u8>,
    time: SystemTime,
}

impl LabelFile {
    fn new(path: PathBuf) -> Self {
        let labels = blocks([30, 26, 40], 7, 1);
        let bytes: Vec<u8> = labels.into_iter().flat_map(u32::to_le_bytes).collect();
        fs::write(&path, &bytes).unwrap();
        let time = path.metadata().unwrap().modified().unwrap();
        LabelFile { path, bytes, time }
    }

    /// Writes other bytes, and sets the time back or to another one.
    fn write(&self, bytes: &[u8], later: u64) {
        fs::write(&self.path, bytes).unwrap();
        let file = fs::File::options().write(true).open(&self.path).unwrap();
        file.set_modified(self.time + Duration::from_secs(later))
            .unwrap();
    }
}

#[test]
fn labels_that_changed_are_refused_with_both_values() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let run = |line: &str| ok(dir, &line.split(' ').collect::<Vec<_>>());
    let refused = |line: &str| fails(dir, &line.split(' ').collect::<Vec<_>>());
    run("phantom foam foam.raw --dims 30,26,40 --pitch 9 --quiet");
    let labels = LabelFile::new(dir.join("labels.raw"));
    let options = "--dims 30,26,40 --dtype u8 --threshold otsu --macrocube 8 --labels labels.raw \
                   --crop 2:30,0:26,3:38 --quiet";
    run(&format!("convert foam.raw whole {options}"));
    run(&format!("plan foam.raw out {options} --parts 3"));
    let part = |part: u32| format!("work out --part {part} --quiet");
    let merge = || alvis(dir, &["merge", "out", "--quiet"]).status.code();
    (0..2).for_each(|k| drop(run(&part(k))));
    labels.write(&labels.bytes, 7);
    let message = refused(&part(2));
    assert!(
        message.contains("last change of the labels was ") && message.contains(" and is "),
        "{message}"
    );
    let mut other = labels.bytes.clone();
    other[0] ^= 1;
    labels.write(&other, 0);
    let message = refused(&part(2));
    assert!(
        message.contains("samples of the labels was CRC-32 "),
        "{message}"
    );
    labels.write(&labels.bytes, 0);
    run(&part(2));
    assert_eq!(merge(), Some(3));
    // when all is meshed, too
    (0..3).for_each(|k| drop(run(&part(k))));
    labels.write(&other, 0);
    let message = refused("merge out");
    assert!(
        message.contains("samples of the labels was CRC-32 "),
        "{message}"
    );
    fs::rename(&labels.path, dir.join("elsewhere.raw")).unwrap();
    let message = refused("merge out");
    assert!(message.contains("labels.raw"), "{message}");
    labels.write(&labels.bytes, 0);
    assert_eq!(merge(), Some(3));
    (0..3).for_each(|k| drop(run(&part(k))));
    assert_eq!(merge(), Some(0));
    assert_same_files(
        &files(&dir.join("whole")),
        &files(&dir.join("out")),
        "labels",
    );
    run("verify out --against foam.raw --dims 30,26,40 --dtype u8 --labels labels.raw --quiet");
}

#[test]
fn labels_that_parts_cannot_have_are_refused_by_the_plan() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let refused = |line: &str| fails(dir, &line.split(' ').collect::<Vec<_>>());
    let line = "phantom foam foam.mhd --dims 30,26,40 --pitch 9 --quiet";
    ok(dir, &line.split(' ').collect::<Vec<_>>());
    let labels = LabelFile::new(dir.join("labels.raw"));
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&labels.bytes).unwrap();
    fs::write(dir.join("labels.raw.gz"), packed.finish().unwrap()).unwrap();
    fs::write(dir.join("none.raw"), vec![0; labels.bytes.len()]).unwrap();
    fs::write(dir.join("short.raw"), &labels.bytes[..4 * 30 * 26 * 39]).unwrap();
    for (name, what) in [
        ("labels.raw.gz", "labels.raw.gz"),
        ("none.raw", "labels that are all 0"),
        ("short.raw", "short.raw"),
    ] {
        let message = refused(&format!(
            "plan foam.mhd out --threshold 128 --macrocube 8 --parts 2 --labels {name}"
        ));
        assert!(message.contains(what), "{name}: {message}");
        assert!(!dir.join("out").exists(), "{name}");
    }
}

/// All files below a directory, but for the geometry of tiles, whose checksums are in the index and for `alvis verify`.
fn part_files(dir: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(part_files(&path)),
            false if path.extension().is_some_and(|e| e == "glb") => {}
            false => found.push(path),
        }
    }
    found.sort();
    found
}

/// Goes on as the commands do; an error ends it.
fn go_on(volume: &MemoryVolume<u8>, options: &ConvertOptions, out: &Path) -> Result<(), Error> {
    loop {
        match merge_parts(volume, options, out, &Quiet)? {
            Merged::InPlace(_) => return Ok(()),
            Merged::ToRun(_, parts) => {
                for part in parts {
                    work_on_part(volume, options, out, part, &Quiet)?;
                }
            }
        }
    }
}

/// What merging reads of a part it looks at, before others go on with it; the bands a part looks at itself.
#[test]
fn labels_that_are_damaged_are_found_by_who_reads_them() {
    let (volume, options) = small();
    // so that labelling comes first
    let options = ConvertOptions {
        min_voxels: 1,
        ..options
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    plan(&volume, &options, &out, 3);
    for part in 0..3 {
        work_on_part(&volume, &options, &out, part, &Quiet).unwrap();
    }
    let mut names = Vec::new();
    for path in part_files(&out) {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if !name.starts_with("labels.") || !path.to_string_lossy().contains("part-0001") {
            continue;
        }
        let tried = dir.path().join(&name);
        copy_all(&out, &tried);
        let bytes = fs::read(&path).unwrap();
        if bytes.is_empty() {
            continue;
        }
        let other: Vec<u8> = bytes.iter().map(|byte| !byte).collect();
        fs::write(tried.join(path.strip_prefix(&out).unwrap()), other).unwrap();
        let said = match merge_parts(&volume, &options, &tried, &Quiet) {
            Err(error) => error,
            Ok(_) => {
                assert_eq!(name, "labels.bands");
                work_on_part(&volume, &options, &tried, 1, &Quiet).unwrap_err()
            }
        };
        let said = said.to_string();
        assert!(
            said.contains(&name) && said.contains("part-0001.done"),
            "{name}: {said}"
        );
        names.push(name);
    }
    assert!(
        names.len() >= 4 && names.iter().any(|name| name == "labels.summary"),
        "{names:?}"
    );
}

#[test]
fn files_that_are_damaged_are_found_or_not_needed() {
    let (volume, options) = small();
    damaged_files_are_found_or_not_needed(&volume, &options);
}

#[test]
fn damaged_files_of_cells_that_are_split_are_found_or_not_needed() {
    let (volume, options) = small();
    let options = ConvertOptions {
        min_voxels: 1,
        split: Some(NeckRule::default()),
        ..options
    };
    damaged_files_are_found_or_not_needed(&volume, &options);
}

#[test]
fn damaged_files_of_cells_that_labels_give_are_found_or_not_needed() {
    let (volume, options) = small();
    let dims = [20, 18, 24];
    let [_, on_demand] = given(dims, blocks(dims, 5, 3));
    let options = ConvertOptions {
        min_voxels: 1,
        labels: Some(on_demand),
        ..options
    };
    damaged_files_are_found_or_not_needed(&volume, &options);
}

#[test]
fn damaged_files_of_walls_are_found_or_not_needed() {
    let (volume, options) = small();
    let options = ConvertOptions {
        min_voxels: 1,
        split: Some(NeckRule::default()),
        walls: true,
        ..options
    };
    damaged_files_are_found_or_not_needed(&volume, &options);
}

fn damaged_files_are_found_or_not_needed(volume: &MemoryVolume<u8>, options: &ConvertOptions) {
    let (whole, _) = converted(volume, options);
    let whole: Files = files(whole.path());
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    plan(volume, options, &out, 2);
    let (mut refused, mut harmless, mut round) = (0, 0, 0);
    loop {
        match merge_parts(volume, options, &out, &Quiet).unwrap() {
            Merged::InPlace(_) => break,
            Merged::ToRun(_, parts) => {
                for part in parts {
                    work_on_part(volume, options, &out, part, &Quiet).unwrap();
                }
            }
        }
        round += 1;
        // what the next merge reads, and what the next round reads after it
        for (number, path) in part_files(&out).into_iter().enumerate() {
            let name = path.strip_prefix(&out).unwrap();
            // a flipped bit each, and in turns half of it or nothing
            for way in [0, 1 + number % 2] {
                if (number + way + round) % 3 > 0 {
                    continue;
                }
                let tried = dir.path().join(format!("tried-{round}-{number}-{way}"));
                copy_all(&out, &tried);
                let file = tried.join(name);
                let mut bytes = fs::read(&file).unwrap();
                match way {
                    0 if bytes.is_empty() => {}
                    0 => {
                        let at = (number * 7919) % bytes.len();
                        bytes[at] ^= 1 << (number % 8);
                        fs::write(&file, bytes).unwrap();
                    }
                    1 => fs::write(&file, &bytes[..bytes.len() / 2]).unwrap(),
                    _ => fs::remove_file(&file).unwrap(),
                }
                match go_on(volume, options, &tried) {
                    Ok(()) => {
                        harmless += 1;
                        let what = format!("round {round}, {}, {way}", name.display());
                        assert_same_files(&whole, &files(&tried), &what);
                    }
                    Err(error) => {
                        refused += 1;
                        let text = error.to_string();
                        assert!(text.contains("tried"), "{}: {text}", name.display());
                    }
                }
                fs::remove_dir_all(&tried).unwrap();
            }
        }
    }
    assert!(refused > 30 && harmless > 10, "{refused} {harmless}");
    assert_same_files(&whole, &files(&out), "undamaged");
}

/// A file of JSON with its checksum, in which a text stands for another one.
fn reseal(path: &Path, was: &str, is: &str) {
    let text = fs::read_to_string(path).unwrap();
    let sealed: serde_json::Value = serde_json::from_str(&text).unwrap();
    let (_, body) = text.split_once("\"body\":").unwrap();
    let body = body.strip_suffix('}').unwrap().replace(was, is);
    let before = sealed["checksum"].as_str().unwrap();
    let (kind, _) = before.split_once(':').unwrap();
    let crc = crc32fast::hash(body.as_bytes());
    let sealed = format!("{{\"checksum\":\"{kind}:{crc:08x}\",\"body\":{body}}}");
    fs::write(path, sealed).unwrap();
}

#[test]
fn another_version_and_markers_of_another_plan_are_refused() {
    let (volume, options) = small();
    let dir = tempfile::tempdir().unwrap();
    let [out, other] = ["out", "other"].map(|name| dir.path().join(name));
    plan(&volume, &options, &out, 2);
    let shifted = ConvertOptions {
        threshold: 127.0,
        ..options.clone()
    };
    plan(&volume, &shifted, &other, 2);
    for (out, options) in [(&out, &options), (&other, &shifted)] {
        work_on_part(&volume, options, out, 0, &Quiet).unwrap();
        work_on_part(&volume, options, out, 1, &Quiet).unwrap();
    }
    let marker = Path::new(WORK).join("parts/1/part-0001.done");
    let good = fs::read(out.join(&marker)).unwrap();
    fs::copy(other.join(&marker), out.join(&marker)).unwrap();
    let merged = merge_parts(&volume, &options, &out, &Quiet);
    let text = differences(merged.unwrap_err());
    assert!(
        text.starts_with("plan of ") && text.contains(" and is crc32:"),
        "{text}"
    );
    fs::write(out.join(&marker), &good).unwrap();
    let version = env!("CARGO_PKG_VERSION");
    reseal(
        &out.join(&marker),
        &format!("\"version\":\"{version}\""),
        "\"version\":\"9.9.9\"",
    );
    let text = differences(next_work(&out, 1).unwrap_err());
    assert!(
        text.contains(&format!("was 9.9.9 and is {version}")),
        "{text}"
    );
    fs::write(out.join(&marker), &good).unwrap();
    let plan_file = out.join(WORK).join("plan.json");
    let own = format!("[\"version\",\"{version}\"]");
    reseal(&plan_file, &own, "[\"version\",\"0.0.9\"]");
    let text = differences(next_work(&out, 1).unwrap_err());
    assert_eq!(text, format!("version was 0.0.9 and is {version}"));
}
