//! The verifier against tile sets of a simple producer, sound ones and broken ones.

mod cubes;
mod glb;
mod writer;

use alvis::grid::Ambiguous;
use alvis::progress::Quiet;
use alvis::verify::{Report, VerifyOptions, verify};
use cubes::Field;
use std::path::Path;
use writer::Style;

/// A number from 0 to 1 that depends on its arguments alone.
fn noise(seed: u64, at: u64) -> f32 {
    let mut v = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ at.wrapping_mul(0xD1B5_4A32_D192_ED03);
    v = (v ^ v >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (v >> 40) as f32 / (1u64 << 24) as f32
}

fn random_field(seed: u64, dims: [usize; 3], threshold: f64) -> Field {
    let n = dims.iter().product::<usize>() as u64;
    Field {
        dims,
        values: (0..n).map(|i| noise(seed, i)).collect(),
        threshold,
    }
}

fn check(dir: &Path) -> Report {
    verify(dir, &VerifyOptions::default(), &Quiet).unwrap()
}

fn styles() -> impl Iterator<Item = Style> {
    (0..8).map(|i| Style {
        macrocube: [[5, 4, 3], [3, 64, 4]][i & 1],
        rule: [Ambiguous::Separate, Ambiguous::Join][i >> 1 & 1],
        cap: i & 4 != 0,
        strips: i & 1 == 0,
    })
}

#[test]
fn sound_tile_sets_pass() {
    for (seed, style) in styles().enumerate() {
        for threshold in [0.2, 0.5, 0.9] {
            let dir = tempfile::tempdir().unwrap();
            writer::write(
                dir.path(),
                &random_field(seed as u64, [9, 8, 7], threshold),
                &style,
            );
            let report = check(dir.path());
            assert!(
                report.ok && report.issues.is_empty(),
                "{style:?} {threshold}: {report:#?}"
            );
            assert!(report.triangles > 100 && report.surfaces > 0);
        }
    }
}
