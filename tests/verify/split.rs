//! Tile sets whose cells are split at their necks: each number of their tables, changed by itself.

use crate::edit::Set;
use crate::parts::{Scan, Sound, edit_table};
use crate::{check, codes};
use alvis::verify::Code;
use std::collections::BTreeSet;
use std::fs;

/// Bubbles that leak into each other, and some that do not.
fn leaky() -> Scan {
    let dims = [28, 24, 21];
    let bubbles = [
        [6.0, 6.0, 5.5],
        [13.6, 6.2, 5.4],
        [8.2, 13.4, 11.9],
        [16.6, 14.6, 12.6],
        [20.1, 14.7, 5.8],
        [20.0, 5.4, 14.6],
        [9.5, 6.0, 13.8],
        [24.0, 20.5, 17.5],
    ];
    let sample = |i: usize| {
        let at = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(|c| c as f32);
        let distance = |centre: &[f32; 3]| {
            let square = |a: usize| (at[a] - centre[a]) * (at[a] - centre[a]);
            (square(0) + square(1) + square(2)).sqrt()
        };
        let nearest = bubbles.iter().map(distance).fold(f32::INFINITY, f32::min);
        (100.0 + 25.0 * (nearest - 4.1)).clamp(0.0, 200.0) as u8
    };
    Scan {
        dims,
        samples: (0..dims.iter().product()).map(sample).collect(),
        labels: vec![0; dims.iter().product()],
        threshold: 100,
    }
}

fn sound(scan: &Scan, more: &[&str]) -> Sound {
    let dir = tempfile::tempdir().unwrap();
    let split = ["--split", "0.85", "--walls", "--macrocube", "12"];
    scan.convert(dir.path(), "own", false, &[&split[..], more].concat());
    let own = dir.path().join("own");
    let report = check(&own);
    assert!(report.ok && report.issues.is_empty(), "{report:#?}");
    assert_eq!(report.unproved.len(), 3, "{:?}", report.unproved);
    let report = scan.compare(&own);
    assert!(report.ok && report.issues.is_empty(), "{report:#?}");
    // with the volume nothing of cells is taken on trust
    assert!(report.unproved.is_empty(), "{:?}", report.unproved);
    Sound { dir }
}

/// Another number in the place of one: the next whole one, or one that is larger by so much of itself.
fn other(field: &str, column: &str, by: f64) -> String {
    let is_whole = !column.contains('[') && column != "ratio" && !field.contains('.');
    match field {
        "" => "1".to_owned(),
        "1" if is_whole => "0".to_owned(),
        "0" => "1".to_owned(),
        _ if is_whole => (field.parse::<i64>().unwrap() + 1).to_string(),
        _ => (field.parse::<f64>().unwrap() * (1.0 + by)).to_string(),
    }
}

/// The numbers of a table of which a change is not found, as `column of row`; `volume` to compare with that, too.
fn missed(sound: &Sound, scan: Option<&Scan>, name: &str) -> BTreeSet<String> {
    let file = format!("{name}.csv");
    let text = fs::read_to_string(sound.dir.path().join("own").join(&file)).unwrap();
    let rows = text.lines().count() - 1;
    let columns = text.lines().next().unwrap().split(',');
    // areas and thicknesses of walls hang on normals, which are not known as well as whole numbers are
    let by = if name == "walls" { 0.01 } else { 0.001 };
    let mut missed = BTreeSet::new();
    for (at, column) in columns.enumerate() {
        for row in BTreeSet::from([rows / 3, rows - 1]) {
            let found = sound.broken_by(scan, |set| {
                edit_table(set, &file, |rows| {
                    rows[row][at] = other(&rows[row][at], column, by)
                });
                true
            });
            let found = found.unwrap();
            assert!(!found.contains(&Code::Checksum), "{name} {column}");
            if found.is_empty() {
                let column = column.split(' ').next().unwrap();
                missed.insert(column.to_owned());
            }
        }
    }
    missed
}

const TABLES: [&str; 6] = [
    "necks",
    "walls",
    "cells",
    "components",
    "objects",
    "surfaces",
];

/// With the volume each number of each table is proved.
#[test]
fn each_number_is_proved_by_the_volume() {
    let scan = leaky();
    let sound = sound(&scan, &[]);
    for name in TABLES {
        let missed = missed(&sound, Some(&scan), name);
        assert!(missed.is_empty(), "{name}: {missed:?}");
    }
}

/// By the tiles alone all but what the documents name.
#[test]
fn each_number_is_held_against_others_by_the_tiles() {
    let scan = leaky();
    let sound = sound(&scan, &["--spacing", "0.5"]);
    for name in TABLES {
        let missed = missed(&sound, None, name);
        let expected: &[&str] = match name {
            // within the bounds that normals leave, and with chords that end at voxels at which no triangle begins
            "walls" => &["wall_area", "wall_thickness", "chords", "thin"],
            // of another whole number of faces
            "necks" => &["neck_area"],
            _ => &[],
        };
        let others = missed.iter().filter(|m| !expected.contains(&m.as_str()));
        assert_eq!(others.count(), 0, "{name}: {missed:?}");
    }
}

/// A row that could be one of another volume, and the curve: the volume tells.
#[test]
fn possible_necks_and_curves_are_held_against_the_volume() {
    let scan = leaky();
    let sound = sound(&scan, &["--spacing", "0.5"]);
    let necks = fs::read_to_string(sound.dir.path().join("own/necks.csv")).unwrap();
    let mut unseen = 0;
    for at in 4..7 {
        for row in 0..necks.lines().count() - 1 {
            // by a voxel
            let edit = |set: &Set| {
                edit_table(set, "necks.csv", |rows| {
                    let field = &mut rows[row][at];
                    *field = (field.parse::<f64>().unwrap() + 0.5).to_string();
                });
                true
            };
            unseen += usize::from(sound.broken_by(None, edit) == Some(BTreeSet::new()));
            let found = sound.broken_by(Some(&scan), edit).unwrap();
            assert!(found.iter().eq([&Code::TableValue]), "{at}: {found:?}");
        }
    }
    assert!(unseen > 3, "{unseen}");
    let curve = |at: usize, by: i64| {
        move |set: &Set| {
            set.manifest(|m| {
                let cells = &mut m["cells"]["curve"][at][1];
                *cells = (cells.as_i64().unwrap() + by).into();
            });
            true
        }
    };
    // below the ratio of the set the table of necks tells, above it the volume alone
    let below = sound.broken_by(None, curve(0, -1)).unwrap();
    assert!(below.iter().eq([&Code::ManifestValue]), "{below:?}");
    assert_eq!(sound.broken_by(None, curve(9, 1)), Some(BTreeSet::new()));
    let above = sound.broken_by(Some(&scan), curve(9, 1)).unwrap();
    assert!(above.iter().eq([&Code::ManifestValue]), "{above:?}");
}

/// What the index says of the rule follows from the grid.
#[test]
fn weights_are_those_of_the_grid() {
    let sound = sound(&leaky(), &[]);
    for (name, value) in [("unit", 15), ("reach", 254), ("ratio_permille", 1001)] {
        let found = sound.broken(|set| {
            set.manifest(|m| m["cells"][name] = value.into());
            true
        });
        assert!(found.unwrap().contains(&Code::ManifestValue), "{name}");
    }
    let found = sound.broken(|set| {
        set.manifest(|m| m["cells"]["weights"][0] = 17.into());
        true
    });
    assert!(found.unwrap().iter().eq([&Code::ManifestValue]));
}

/// Necks that are left out or made up.
#[test]
fn rows_of_necks_are_those_of_the_volume() {
    let scan = leaky();
    let sound = sound(&scan, &[]);
    let without = sound.broken_by(Some(&scan), |set| {
        edit_table(set, "necks.csv", |rows| _ = rows.remove(0));
        true
    });
    assert!(without.unwrap().contains(&Code::TableRows));
    let own = sound.dir.path().join("own");
    assert!(codes(&check(&own)).is_empty());
}
