//! The verifier against tile sets of a simple producer, sound ones and broken ones.

mod bodies;
mod cubes;
mod edit;
mod faults;
mod glb;
mod more;
mod parts;
#[path = "../common/seal.rs"]
mod seal;
mod split;
mod volume;
mod walls;
mod writer;

use alvis::grid::{Ambiguous, Provenance};
use alvis::manifest::Form;
use alvis::progress::Quiet;
use alvis::transform::repack::{RepackOptions, repack};
use alvis::verify::{Code, Report, SourceVolume, VerifyOptions, verify};
use alvis::volume::{Dtype, Header, Volume};
use cubes::Field;
use edit::Set;
use std::collections::BTreeSet;
use std::path::Path;
use volume::Samples;
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

fn compare(dir: &Path, field: &Field) -> Report {
    let volume = Samples::new(field);
    let options = VerifyOptions {
        against: Some(&volume),
        ..VerifyOptions::default()
    };
    verify(dir, &options, &Quiet).unwrap()
}

/// Compares what the manifest states of its source as well, with a volume of which something else is said.
fn compare_with(dir: &Path, field: &Field, edit: impl FnOnce(&mut SourceVolume)) -> Report {
    let volume = Samples::new(field);
    let mut source = SourceVolume {
        name: "field.raw".into(),
        header: Header {
            format: "raw",
            ..volume.header().clone()
        },
        offset: 0,
        values: None,
        filters: Vec::new(),
        provenance: Provenance::default(),
    };
    edit(&mut source);
    let options = VerifyOptions {
        against: Some(&volume),
        source: Some(&source),
        ..VerifyOptions::default()
    };
    verify(dir, &options, &Quiet).unwrap()
}

fn codes(report: &Report) -> BTreeSet<Code> {
    report.issues.iter().map(|i| i.code).collect()
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
            let field = random_field(seed as u64, [9, 8, 7], threshold);
            writer::write(dir.path(), &field, &style);
            let report = check(dir.path());
            assert!(
                report.ok && report.issues.is_empty(),
                "{style:?} {threshold}: {report:#?}"
            );
            assert!(report.triangles > 100 && report.surfaces > 0);
            let report = compare(dir.path(), &field);
            assert!(
                report.ok && report.issues.is_empty(),
                "{style:?} {threshold}: {report:#?}"
            );
        }
    }
}

const STYLE: Style = Style {
    macrocube: [5, 4, 3],
    rule: Ambiguous::Separate,
    cap: false,
    strips: true,
};

/// A quiet corner with an island of one voxel at (2, 2, 2), else noise.
fn noisy_field() -> Field {
    let mut field = random_field(7, [14, 9, 9], 0.2);
    let [nx, ny, _] = field.dims;
    for (i, v) in field.values.iter_mut().enumerate() {
        let [x, y, z] = [i % nx, i / nx % ny, i / nx / ny];
        if x < 9 && y < 5 && z < 5 {
            *v = 0.0;
        }
        if [x, y, z] == [2, 2, 2] {
            *v = 0.9;
        }
    }
    field
}

/// A smooth ball, in which no face is ambiguous.
fn ball() -> Field {
    let mut field = random_field(0, [12, 11, 10], 0.5);
    for (i, v) in field.values.iter_mut().enumerate() {
        let p = [i % 12, i / 12 % 11, i / 12 / 11].map(|c| c as f32);
        let square: f32 = p
            .iter()
            .zip([5.6, 5.3, 4.4])
            .map(|(a, b)| (a - b) * (a - b))
            .sum();
        *v = 0.5 + (3.3 - square.sqrt()) / 20.0;
    }
    field
}

#[test]
fn each_code_has_a_fixture_that_yields_exactly_it() {
    let mut wrong = Vec::new();
    // those of levels are broken in tests/lod.rs, those of parts of surfaces in parts.rs
    let of_parts = [Code::SeamDiffers, Code::PartOrder, Code::CellMixed];
    let own = |c: &&Code| !c.name().starts_with("LOD_") && !of_parts.contains(c);
    for &code in Code::ALL.iter().filter(own) {
        let dir = tempfile::tempdir().unwrap();
        let set = Set(dir.path());
        let mut field = if matches!(code, Code::BitsDiffer | Code::Dust) {
            ball()
        } else {
            noisy_field()
        };
        let lists = code == Code::DegenerateTriangle;
        let style = Style {
            strips: !lists,
            ..STYLE
        };
        writer::write(dir.path(), &field, &style);
        if code == Code::MeshoptBuffer {
            compress(dir.path());
        }
        let place = faults::biggest(&set);
        if lists {
            set.edit_tile(&place, |t| t.pieces[0].triangles.push([0, 0, 1]));
        } else if code == Code::EdgeRepeated {
            let sound = set.tile(&place);
            let exact = faults::third_triangles(&sound).into_iter().any(|changed| {
                set.put(&place, &changed);
                codes(&check(dir.path())).iter().eq([&code])
            });
            assert!(exact, "no third triangle on an edge yields {}", code.name());
        } else {
            faults::break_it(code, &set, &mut field);
        }
        // a hole is a missing vertex as well, once there is a volume to compare with
        let report = match code {
            Code::Hole => check(dir.path()),
            Code::SourceMismatch => {
                compare_with(dir.path(), &field, |s| s.header.dtype = Dtype::F64)
            }
            _ => compare(dir.path(), &field),
        };
        if !codes(&report).iter().eq([&code]) || report.ok {
            wrong.push(format!("{}: {:#?}", code.name(), report.issues));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Puts the same tile set in place with its tiles compressed.
fn compress(dir: &Path) {
    let made = tempfile::tempdir().unwrap();
    let options = RepackOptions {
        form: Form::WEB,
        force: false,
    };
    repack(dir, made.path(), &options, &Quiet).unwrap();
    repack(
        made.path(),
        dir,
        &RepackOptions {
            force: true,
            ..options
        },
        &Quiet,
    )
    .unwrap();
}
