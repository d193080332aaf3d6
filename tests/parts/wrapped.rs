//! Filters, masks and crops beside cells that labels give, or that are split: by the commands, since these are what a plan
//! has to have again.

use super::life::to_run;
use crate::command::{fails, ok};
use crate::common::volumes::samples;
use crate::common::{assert_same_files, files};
use std::path::Path;

const DIMS: [u32; 3] = [44, 40, 60];

fn run(dir: &Path, line: &str) -> String {
    ok(dir, &line.split_whitespace().collect::<Vec<_>>())
}

fn write_mhd(dir: &Path, name: &str, values: &[u16]) {
    let [nx, ny, nz] = DIMS;
    let header = format!(
        "ObjectType = Image\nNDims = 3\nDimSize = {nx} {ny} {nz}\nElementSpacing = 0.05 0.05 0.05\n\
         ElementType = MET_USHORT\nElementByteOrderMSB = False\nElementDataFile = {name}.raw\n"
    );
    std::fs::write(dir.join(format!("{name}.mhd")), header).unwrap();
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(dir.join(format!("{name}.raw")), bytes).unwrap();
}

/// A directory with a foam, labels of blocks some of which are none, and a mask of a cone.
fn inputs() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    run(
        dir.path(),
        "phantom foam foam.mhd --dims 44,40,60 --pitch 11 --wall 3 --spacing 0.05 --unit mm --quiet",
    );
    let labels = samples(DIMS, |[x, y, z]| {
        ((x / 9 + 5 * (y / 8) + 29 * (z / 7)) % 41) as u16
    });
    write_mhd(dir.path(), "labels", &labels);
    let mask = samples(DIMS, |[x, y, z]| {
        let [dx, dy] = [f64::from(x) - 21.0, f64::from(y) - 20.0];
        let radius = 19.0 - f64::from(z) / 8.0;
        u16::from(dx * dx + dy * dy < radius * radius)
    });
    write_mhd(dir.path(), "mask", &mask);
    dir
}

/// Compares two and five parts with one process, with each of these options.
fn same_in_parts(options: &[&str]) {
    let dir = inputs();
    for more in options {
        same_with(dir.path(), more);
    }
}

fn same_with(dir: &Path, more: &str) {
    let options =
        format!("foam.mhd out --threshold otsu --unit mm --macrocube 16,16,8 --quiet {more}");
    let fresh = || match std::fs::remove_dir_all(dir.join("out")) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => panic!("{e}"),
        _ => {}
    };
    fresh();
    run(dir, &format!("convert {options}"));
    let whole = files(&dir.join("out"));
    for parts in [2, 5] {
        fresh();
        run(dir, &format!("plan {options} --parts {parts}"));
        while let Some(parts) = to_run(dir) {
            for part in parts {
                run(dir, &format!("work out --quiet --part {part}"));
            }
        }
        assert_same_files(&whole, &files(&dir.join("out")), more);
    }
}

#[test]
fn parts_of_filtered_volumes_with_labels_are_the_single_run() {
    same_in_parts(&[
        "--labels labels.mhd --smooth 1",
        "--labels labels.mhd --median 1 --min-voxels 5 --walls",
        "--labels labels.mhd --median 2 --smooth 0.7,1,2 --cap --crop 3:,:35,5:57",
    ]);
}

#[test]
fn parts_of_a_region_with_labels_are_the_single_run() {
    same_in_parts(&[
        "--labels labels.mhd --roi mask:mask.mhd",
        "--labels labels.mhd --roi mask:mask.mhd --roi-fill air --median 1 --walls",
        "--labels labels.mhd --roi cylinder:21,20,15 --smooth 1 --crop 3:,:35,5:57",
    ]);
}

#[test]
fn parts_of_split_filtered_regions_are_the_single_run() {
    same_in_parts(&[
        "--split --roi mask:mask.mhd --smooth 0.8 --walls",
        "--split 0.95 --roi cylinder:21,20,15 --median 1 --roi-fill air",
    ]);
}

/// What a filter makes of a volume of labels would be no labels, so it is of the volume alone; and another mask is another plan.
#[test]
fn another_mask_beside_labels_is_refused() {
    let dir = inputs();
    let dir = dir.path();
    let plan = "plan foam.mhd out --threshold otsu --unit mm --macrocube 16,16,8 --quiet --parts 3 \
                --labels labels.mhd --roi mask:mask.mhd";
    run(dir, plan);
    run(dir, "work out --part 0 --quiet");
    let mask = samples(DIMS, |[x, ..]| u16::from(x > 5));
    write_mhd(dir, "mask", &mask);
    let line = ["work", "out", "--part", "1", "--quiet"];
    let refused = fails(dir, &line);
    assert!(refused.contains("the mask as it was"), "{refused}");
    let checksums = refused.split("(crc32:").skip(1).map(|rest| &rest[..8]);
    let [found, expected] = checksums.collect::<Vec<_>>()[..] else {
        panic!("{refused}");
    };
    assert_ne!(found, expected);
}
