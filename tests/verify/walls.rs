//! Tables of walls: sound ones of all kinds of cells, and one broken for each way to be wrong.

use crate::edit::Set;
use crate::parts::{Scan, Sound, edit_table};
use crate::{check, codes};
use alvis::verify::{Code, Report};
use std::fs;
use std::path::Path;

/// Places of columns of cells without parts.
const AREA: usize = 4;
const NEIGHBOURS: usize = 28;
const THICKNESS: usize = 29;

/// Checks the set `own`, and compares it with its volume.
fn pass(scan: &Scan, dir: &Path, what: &str) -> Report {
    let own = dir.join("own");
    let report = check(&own);
    assert!(report.ok && report.issues.is_empty(), "{what}: {report:#?}");
    let report = scan.compare(&own);
    assert!(report.ok && report.issues.is_empty(), "{what}: {report:#?}");
    report
}

fn rows(dir: &Path, name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(dir.join(name)).unwrap();
    let split = |line: &str| line.split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(split).collect()
}

#[test]
fn sound_walls_pass_in_all_forms() {
    let forms: [&[&str]; 8] = [
        &["--macrocube", "5"],
        &["--macrocube", "4,30,3", "--cap", "--tables", "csv,parquet"],
        &["--macrocube", "30,4,5", "--for", "meshlab"],
        &["--macrocube", "6", "--encoding", "quantized"],
        &["--macrocube", "7", "--for", "web", "--table-unit", "um"],
        &[
            "--macrocube",
            "5",
            "--ambiguous",
            "join",
            "--layout",
            "merged",
        ],
        &["--macrocube", "9", "--min-voxels", "4"],
        &["--macrocube", "40", "--primitives", "triangles", "--cap"],
    ];
    for (seed, form) in (0u64..).zip(forms) {
        for kind in ["plain", "labels", "split"] {
            let dir = tempfile::tempdir().unwrap();
            let scan = Scan::new(seed, [17, 14, 15], 2 + seed as usize % 4, seed % 2 == 1);
            let split: &[&str] = if kind == "split" { &["--split"] } else { &[] };
            let more = [form, split, &["--walls"]].concat();
            scan.convert(dir.path(), "own", kind == "labels", &more);
            pass(&scan, dir.path(), &format!("{kind} {form:?}"));
            let walls = rows(&dir.path().join("own"), "walls.csv");
            assert!(walls.len() > 2 || kind == "plain", "{kind} {form:?}");
        }
    }
}

#[test]
fn many_sound_walls_pass() {
    for seed in 100..112u64 {
        let dir = tempfile::tempdir().unwrap();
        let dims = [
            9 + seed as usize % 7,
            8 + seed as usize % 5,
            10 + seed as usize % 3,
        ];
        let scan = Scan::new(seed, dims, 3, false);
        let macrocube = (3 + seed % 9).to_string();
        let spacing = ["1,1,1", "1,1,3", "2,0.5,0.7"][seed as usize % 3];
        let more = ["--walls", "--macrocube", &macrocube, "--spacing", spacing];
        scan.convert(dir.path(), "own", seed % 4 == 0, &more);
        pass(&scan, dir.path(), &format!("{seed}"));
    }
}

#[test]
fn volumes_of_one_phase_have_no_walls() {
    for value in [0, 255] {
        for labels in [false, true] {
            let dir = tempfile::tempdir().unwrap();
            let mut scan = Scan::new(9, [9, 8, 7], 3, true);
            scan.samples.fill(value);
            scan.convert(dir.path(), "own", labels, &["--walls"]);
            pass(&scan, dir.path(), &format!("{value} {labels}"));
        }
    }
}

/// Cells that are the components, with many walls.
fn sound() -> Sound {
    let dir = tempfile::tempdir().unwrap();
    let scan = Scan::pockets();
    scan.convert(dir.path(), "own", false, &["--macrocube", "8", "--walls"]);
    let report = pass(&scan, dir.path(), "pockets");
    assert!(report.cells > 8);
    assert!(rows(&dir.path().join("own"), "walls.csv").len() > 10);
    Sound { dir }
}

fn scale(field: &mut String, by: f64) {
    *field = (field.parse::<f64>().unwrap() * by).to_string();
}

/// The row with most chords.
fn largest(rows: &mut [Vec<String>]) -> &mut Vec<String> {
    rows.iter_mut()
        .max_by_key(|row| row[4].parse::<u64>().unwrap())
        .unwrap()
}

#[test]
fn wrong_rows_of_walls_are_found() {
    let sound = sound();
    let value = &[Code::TableValue];
    let table = |edit: fn(&mut Vec<Vec<String>>), expected: &[Code]| {
        sound.table("walls.csv", edit, expected);
    };
    // what a row says by itself
    table(|rows| rows[0][4] = "0".into(), value);
    table(|rows| rows[0][3] = "0".into(), value);
    table(|rows| scale(&mut rows[0][3], 100.0), value);
    table(|rows| scale(&mut rows[0][2], 2.0), value);
    table(|rows| scale(&mut rows[0][2], 0.1), value);
    table(|rows| rows[0][5] = "2".into(), value);
    table(|rows| rows[0][5].clear(), value);
    table(|rows| rows[0][6] = "2".into(), value);
    table(|rows| rows[0][6].clear(), value);
    table(|rows| rows[0][0] = "x".into(), &[Code::TableSyntax]);
    table(|rows| _ = rows[0].pop(), &[Code::TableSyntax]);
    table(|rows| rows.swap(1, 2), &[Code::TableRows]);
    table(|rows| rows[1].swap(0, 1), &[Code::TableRows]);
    table(|rows| rows.insert(1, rows[1].clone()), &[Code::TableRows]);
    // what follows from it and its cells
    for from in ["0", "1"] {
        let turn = |rows: &mut Vec<Vec<String>>| {
            let row = rows.iter_mut().find(|row| row[6] == from).unwrap();
            row[6] = if from == "0" { "1" } else { "0" }.into();
        };
        sound.table("walls.csv", turn, value);
    }
    // what the tiles say
    let lacks = &[Code::TableRows, Code::TotalsMismatch];
    let lost = |rows: &mut Vec<Vec<String>>| {
        let at = largest(rows).clone();
        rows.retain(|row| *row != at);
    };
    table(lost, lacks);
    table(|rows| largest(rows)[4] = "100000".into(), value);
    let fewer = |rows: &mut Vec<Vec<String>>| {
        let row = largest(rows);
        for at in [2, 4] {
            scale(&mut row[at], 0.5);
        }
        row[4] = (row[4].parse::<f64>().unwrap().floor()).to_string();
    };
    table(fewer, value);
    table(|rows| scale(&mut largest(rows)[3], 2.0), value);
    table(|rows| scale(&mut largest(rows)[3], 0.5), value);
    let unknown = |rows: &mut Vec<Vec<String>>| {
        let mut row = rows.last().unwrap().clone();
        row[1] = "60000".into();
        rows.push(row);
    };
    table(unknown, &[Code::TableValue, Code::TotalsMismatch]);
    sound.table("walls.csv", |rows| rows.clear(), lacks);
}

/// What normals leave open, the samples tell.
#[test]
fn the_volume_tells_walls_exactly() {
    let dir = tempfile::tempdir().unwrap();
    let scan = Scan::pockets();
    let more = ["--macrocube", "8", "--walls", "--spacing", "0.5"];
    scan.convert(dir.path(), "own", false, &more);
    let own = dir.path().join("own");
    let before = fs::read_to_string(own.join("walls.csv")).unwrap();
    for (column, by) in [(2, 1.001), (2, 0.999), (3, 1.001), (3, 0.999)] {
        edit_table(&Set(&own), "walls.csv", |rows| {
            scale(&mut largest(rows)[column], by)
        });
        Set(&own).seal();
        let report = scan.compare(&own);
        assert!(
            codes(&report).iter().eq([&Code::TableValue]),
            "{column} {by}: {report:#?}"
        );
        let at = &report.issues[0].path;
        assert!(
            report
                .issues
                .iter()
                .any(|i| i.path.starts_with("walls.csv:")),
            "{at}"
        );
        fs::write(own.join("walls.csv"), &before).unwrap();
    }
}

#[test]
fn wrong_columns_of_cells_are_found() {
    let sound = sound();
    let value = &[Code::TableValue];
    let table = |edit: fn(&mut Vec<Vec<String>>)| sound.table("cells.csv", edit, value);
    table(|rows| rows[0][NEIGHBOURS] = "77".into());
    table(|rows| rows[0][NEIGHBOURS].clear());
    table(|rows| scale(&mut walled(rows)[THICKNESS], 1.01));
    table(|rows| walled(rows)[THICKNESS].clear());
    // that of another wall, if there are some
    let alone = |rows: &mut Vec<Vec<String>>| {
        let largest =
            |row: &&mut Vec<String>| (row[THICKNESS].parse::<f64>().unwrap() * 1e6) as u64;
        let row = rows
            .iter_mut()
            .filter(|row| !row[THICKNESS].is_empty())
            .max_by_key(largest);
        scale(&mut row.unwrap()[THICKNESS], 0.7);
    };
    table(alone);
    // the area of a cell decides which walls make neighbours, and is held against the surface
    sound.table(
        "cells.csv",
        |rows| scale(&mut rows[0][AREA], 1.5),
        &[Code::TableValue, Code::CarriedMeasure],
    );
}

/// A row with walls.
fn walled(rows: &mut [Vec<String>]) -> &mut Vec<String> {
    rows.iter_mut()
        .find(|row| !row[THICKNESS].is_empty())
        .unwrap()
}

#[test]
fn wrong_indexes_of_walls_are_found() {
    let sound = sound();
    let expect = |edit: fn(&mut serde_json::Value), expected: Code| {
        let found = sound.broken(|set| {
            set.manifest(edit);
            true
        });
        assert!(found.unwrap().iter().eq([&expected]));
    };
    expect(|m| m["totals"]["walls"] = 7.into(), Code::TotalsMismatch);
    expect(
        |m| m["tables"]["walls"] = "wall.csv".into(),
        Code::MissingFile,
    );
    expect(
        |m| m["tables"]["walls"] = "../walls.csv".into(),
        Code::PathOutside,
    );
    let dir = tempfile::tempdir().unwrap();
    Scan::new(6, [12, 11, 10], 4, false).convert(dir.path(), "own", false, &[]);
    let own = dir.path().join("own");
    fs::write(own.join("walls.csv"), "").unwrap();
    assert!(codes(&check(&own)).iter().eq([&Code::ForeignFile]));
    fs::remove_file(own.join("walls.csv")).unwrap();
    Set(&own).manifest(|m| m["totals"]["walls"] = 2.into());
    assert!(codes(&check(&own)).iter().eq([&Code::ManifestValue]));
}

/// Tables of openings and walls are Parquet, too, where others are.
#[test]
fn wrong_parquet_of_walls_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let scan = Scan::new(3, [17, 14, 15], 3, true);
    let more = ["--macrocube", "9", "--walls", "--tables", "csv,parquet"];
    scan.convert(dir.path(), "own", true, &more);
    pass(&scan, dir.path(), "parquet");
    let sound = Sound { dir };
    for name in ["components", "necks", "walls"] {
        let file = format!("{name}.parquet");
        let gone = sound.broken(|set| fs::remove_file(set.0.join(&file)).is_ok());
        assert!(gone.unwrap().iter().eq([&Code::MissingFile]), "{name}");
        let other = sound.broken(|set| {
            fs::copy(set.0.join("objects.parquet"), set.0.join(&file)).unwrap();
            let bytes = fs::read(set.0.join(&file)).unwrap();
            let sum = format!("crc32:{:08x}", crc32fast::hash(&bytes));
            set.manifest(|m| m["tables"]["parquet"]["checksums"][name] = sum.clone().into());
            true
        });
        let expected = [Code::TableSyntax, Code::TableRows, Code::TableValue];
        let other = other.unwrap();
        let found = other.iter().all(|code| expected.contains(code));
        assert!(!other.is_empty() && found, "{name}: {other:?}");
        let unnamed = sound.broken(|set| {
            set.manifest(|m| {
                let parquet = m["tables"]["parquet"].as_object_mut().unwrap();
                parquet.remove(name).unwrap();
            });
            true
        });
        assert!(unnamed.unwrap().iter().eq([&Code::ManifestValue]), "{name}");
    }
}

/// A part has the walls between its own cells, which say less of these.
#[test]
fn walls_of_a_part_agree_with_its_cells() {
    let sound = sound();
    let [own, whole] = ["own", "whole"].map(|name| sound.dir.path().join(name));
    fs::rename(&own, &whole).unwrap();
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .arg("select")
        .args([&whole, &own])
        .args(["--where", "id > 3", "--quiet"])
        .status();
    assert!(done.unwrap().success());
    let [before, after] = [&whole, &own].map(|dir| rows(dir, "walls.csv").len());
    assert!(0 < after && after < before);
    let report = check(&own);
    assert!(
        report.ok && report.part && !report.unproved.is_empty(),
        "{report:#?}"
    );
    let foreign = |rows: &mut Vec<Vec<String>>| {
        let mut row = rows.last().unwrap().clone();
        row[1] = "60000".into();
        rows.push(row);
    };
    sound.table(
        "walls.csv",
        foreign,
        &[Code::TableRows, Code::TotalsMismatch],
    );
    sound.table(
        "walls.csv",
        |rows| scale(&mut rows[0][3], 100.0),
        &[Code::TableValue],
    );
    let most = |rows: &mut Vec<Vec<String>>| {
        let number = |row: &&mut Vec<String>| row[NEIGHBOURS].parse::<u64>().unwrap();
        rows.iter_mut().max_by_key(number).unwrap()[NEIGHBOURS] = "0".into();
    };
    sound.table("cells.csv", most, &[Code::TableValue]);
}
