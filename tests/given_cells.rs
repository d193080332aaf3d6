//! Cells that are given: by labels, or by splitting components at their necks. They are compared with what a search over
//! all voxels finds, and with the set in which components are the cells.

mod common;

use alvis::convert::{CellRows, ConvertOptions, Labels, convert};
use alvis::grid::{Ambiguous, Crop, Dims, Placement};
use alvis::manifest::{Encoding, Layout, PartsBy, Primitives};
use alvis::progress::Quiet;
use alvis::split::NeckRule;
use alvis::tileset::TileSet;
use alvis::volume::MemoryVolume;
use common::set::{Table, manifest, table};
use common::volumes::{foam, noise, placed};
use common::{assert_same_files, converted, files, options};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Above if the sample is at least this.
const THRESHOLD: f64 = 128.0;

/// A volume and the label of each voxel.
#[derive(Debug)]
struct Case {
    dims: [usize; 3],
    samples: Vec<u8>,
    labels: Vec<u32>,
    rule: Ambiguous,
}

impl Case {
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    fn place(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [i % nx, i / nx % ny, i / nx / ny]
    }

    fn is_below(&self, i: usize) -> bool {
        f64::from(self.samples[i]) < THRESHOLD
    }

    /// The cell of a voxel below: its label, or one more than the largest.
    fn cell(&self, i: usize) -> u64 {
        match self.labels[i] {
            0 => u64::from(*self.labels.iter().max().unwrap()) + 1,
            label => label.into(),
        }
    }

    /// Pairs of neighbouring voxels below, of which the second has the larger index, and the axis along which they share
    /// a face.
    fn neighbours(&self) -> Vec<(usize, usize, Option<usize>)> {
        let far = if self.rule == Ambiguous::Separate {
            2
        } else {
            1
        };
        let mut pairs = Vec::new();
        for i in (0..self.samples.len()).filter(|&i| self.is_below(i)) {
            let place = self.place(i);
            for step in 0..27i64 {
                let step = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                let distance: i64 = step.iter().map(|s| s.abs()).sum();
                let to: [i64; 3] = std::array::from_fn(|a| place[a] as i64 + step[a]);
                let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&to[a]));
                if !(1..=far).contains(&distance) || !inside {
                    continue;
                }
                let j = self.index(to.map(|v| v as usize));
                if j > i && self.is_below(j) {
                    let axis = (distance == 1).then(|| step.iter().position(|&s| s != 0).unwrap());
                    pairs.push((i, j, axis));
                }
            }
        }
        pairs
    }

    /// The component of each voxel below, from 1 by its first voxel; 0 for others.
    fn components(&self) -> Vec<u64> {
        let mut root: Vec<usize> = (0..self.samples.len()).collect();
        let find = |root: &Vec<usize>, mut i: usize| {
            while root[i] != i {
                i = root[i];
            }
            i
        };
        for (i, j, _) in self.neighbours() {
            let [a, b] = [i, j].map(|i| find(&root, i));
            root[a.max(b)] = a.min(b);
        }
        let mut names = BTreeMap::new();
        (0..root.len())
            .map(|i| match self.is_below(i) {
                true => {
                    let next = names.len() as u64 + 1;
                    *names.entry(find(&root, i)).or_insert(next)
                }
                false => 0,
            })
            .collect()
    }

    fn volume(&self) -> MemoryVolume<u8> {
        let dims = Dims::new(self.dims.map(|n| n as u64)).unwrap();
        MemoryVolume::new(dims, Placement::default(), self.samples.clone()).unwrap()
    }

    fn given(&self) -> Labels {
        let dims = Dims::new(self.dims.map(|n| n as u64)).unwrap();
        let labels = MemoryVolume::new(dims, Placement::default(), self.labels.clone()).unwrap();
        let dir = std::env::temp_dir();
        let (rows, checksum) = CellRows::of_labels(&labels, dims, &dir, &Quiet).unwrap();
        Labels {
            file: "labels.npy".into(),
            checksum,
            rows: rows.into(),
        }
    }

    fn options(&self, macrocube: [u32; 3]) -> ConvertOptions {
        ConvertOptions {
            threshold: THRESHOLD,
            ambiguous: self.rule,
            ..options(macrocube)
        }
    }
}

/// All triangles of a set by their corners in lattice steps, the smallest one first; each with its cell, object and surface.
fn triangles(dir: &Path) -> BTreeMap<[[i32; 3]; 3], [u64; 3]> {
    let set = TileSet::open(dir).unwrap();
    let mut all = BTreeMap::new();
    for tile in set.tiles() {
        for piece in set.read_tile(&tile.unwrap()).unwrap().pieces {
            if piece.is_cap() {
                continue;
            }
            for &triangle in &piece.triangles {
                let corners = piece
                    .corners(triangle)
                    .map(|p| p.map(|v| (v * 256.0) as i32));
                let first = (0..3).min_by_key(|&i| corners[i]).unwrap();
                let corners = std::array::from_fn(|i| corners[(first + i) % 3]);
                let ids = [piece.ids.cell, piece.ids.object, piece.ids.surface];
                assert!(all.insert(corners, ids).is_none());
            }
        }
    }
    all
}

fn number(table: &Table, row: usize, column: &str) -> Option<f64> {
    table.column(column).nth(row).unwrap().parse().ok()
}

/// The cell that a triangle must have: that of the below end of its vertex with the smallest lattice key.
fn cell_of(case: &Case, corners: &[[i32; 3]; 3]) -> u64 {
    let ends = corners.map(|corner| {
        let axis = (0..3).find(|&a| corner[a] % 256 != 0).unwrap();
        let lower = corner.map(|v| (v / 256) as usize);
        let mut upper = lower;
        upper[axis] += 1;
        let [lower, upper] = [lower, upper].map(|place| case.index(place));
        let below = if case.is_below(lower) { lower } else { upper };
        assert!(case.is_below(below));
        (3 * lower + axis, below)
    });
    case.cell(ends.into_iter().min().unwrap().1)
}

/// How many vertices count with each pair of a cell and an object: a vertex with the triangles at it in the last cube, by z,
/// y and x, and of these with that of the smallest cell.
fn vertices(triangles: &BTreeMap<[[i32; 3]; 3], [u64; 3]>) -> BTreeMap<[u64; 2], u64> {
    let mut deciding: BTreeMap<[i32; 3], ([i32; 3], [u64; 2])> = BTreeMap::new();
    for (corners, [cell, object, _]) in triangles {
        let cube = [2, 1, 0].map(|a| -corners.iter().map(|p| p[a].div_euclid(256)).min().unwrap());
        for corner in corners {
            let here = (cube, [*cell, *object]);
            let known = deciding.entry(*corner).or_insert(here);
            *known = here.min(*known);
        }
    }
    let mut counts = BTreeMap::new();
    for (_, pair) in deciding.into_values() {
        *counts.entry(pair).or_default() += 1;
    }
    counts
}

/// Converts with components and with labels for cells, and compares both and a search over all voxels.
fn check(case: &Case, options: &ConvertOptions) {
    let volume = case.volume();
    let (plain, _) = converted(&volume, options);
    let given = ConvertOptions {
        labels: Some(case.given()),
        ..options.clone()
    };
    let (dir, report) = converted(&volume, &given);
    let [plain, dir] = [plain.path(), dir.path()];
    // components, objects and triangles are those of the set without labels
    let same = |a: &str, b: &str| {
        let [a, b] =
            [plain.join(a), dir.join(b)].map(|path| std::fs::read_to_string(path).unwrap());
        assert_eq!(a, b);
    };
    same("cells.csv", "components.csv");
    same("objects.csv", "objects.csv");
    let [before, after] = [plain, dir].map(triangles);
    assert_eq!(before.len(), after.len());
    let components = case.components();
    let mut surfaces: BTreeMap<[u64; 2], (u64, u64)> = BTreeMap::new();
    for (corners, [_, object, _]) in &before {
        let [cell, found, surface] = after[corners];
        assert_eq!((cell, found), (cell_of(case, corners), *object));
        let known = surfaces.entry([cell, found]).or_insert((surface, 0));
        assert_eq!(known.0, surface);
        known.1 += 1;
    }
    let rows = table(dir, "surfaces.csv");
    let vertices = vertices(&after);
    for (row, ([cell, object], (surface, count))) in surfaces.iter().enumerate() {
        let expected = [*surface, *cell, *object, *count].map(|v| Some(v as f64));
        let found = ["id", "cell", "object", "triangles"].map(|c| number(&rows, row, c));
        assert_eq!(found, expected);
        let counted = vertices
            .get(&[*cell, *object])
            .map_or(0.0, |&n: &u64| n as f64);
        assert_eq!(number(&rows, row, "vertices"), Some(counted));
        assert_eq!(*surface, row as u64 + 1);
    }
    assert_eq!(report.totals.surfaces, surfaces.len() as u64);
    let sum = |column: &str| -> f64 {
        let rows = 0..surfaces.len();
        rows.map(|row| number(&table(dir, "surfaces.csv"), row, column).unwrap())
            .sum()
    };
    if !options.cap {
        assert_eq!(sum("vertices"), report.totals.vertices as f64);
        assert_eq!(sum("border_edges"), report.totals.border_edges as f64);
    }
    // cells and openings
    let mut voxels: BTreeMap<u64, (u64, BTreeSet<u64>)> = BTreeMap::new();
    for i in (0..case.samples.len()).filter(|&i| case.is_below(i)) {
        let known = voxels.entry(case.cell(i)).or_default();
        known.0 += 1;
        known.1.insert(components[i]);
    }
    let mut openings: BTreeMap<[u64; 2], [i64; 3]> = BTreeMap::new();
    for (i, j, axis) in case.neighbours() {
        let [a, b] = [i, j].map(|i| case.cell(i));
        if a != b {
            let faces = openings.entry([a.min(b), a.max(b)]).or_default();
            if let Some(axis) = axis {
                faces[axis] += if a < b { 1 } else { -1 };
            }
        }
    }
    let rows = table(dir, "cells.csv");
    assert_eq!(rows.rows.len(), voxels.len());
    for (row, (cell, (count, within))) in voxels.iter().enumerate() {
        assert_eq!(number(&rows, row, "id"), Some(*cell as f64));
        assert_eq!(number(&rows, row, "voxels"), Some(*count as f64));
        let one = within.first().filter(|_| within.len() == 1);
        assert_eq!(number(&rows, row, "component"), one.map(|&c| c as f64));
        let necks = openings.keys().filter(|pair| pair.contains(cell)).count();
        assert_eq!(number(&rows, row, "necks"), Some(necks as f64));
        let is_open = necks > 0;
        assert_eq!(
            number(&rows, row, "euler_characteristic").is_none(),
            is_open
        );
        let cut = is_open || number(&rows, row, "touches_border") == Some(1.0);
        let none = cut || number(&rows, row, "tiles") == Some(0.0);
        assert_eq!(number(&rows, row, "mesh_volume").is_none(), none);
    }
    let rows = table(dir, "necks.csv");
    assert_eq!(rows.rows.len(), openings.len());
    assert_eq!(report.totals.necks, openings.len() as u64);
    for (row, ([a, b], faces)) in openings.iter().enumerate() {
        assert_eq!(number(&rows, row, "cell_a"), Some(*a as f64));
        assert_eq!(number(&rows, row, "cell_b"), Some(*b as f64));
        let area = (faces.iter().map(|f| f * f).sum::<i64>() as f64).sqrt();
        assert!((number(&rows, row, "neck_area").unwrap() - area).abs() < 1e-9);
    }
}

fn case() -> impl Strategy<Value = Case> {
    let dims = [3usize..12, 3..12, 3..12];
    (dims, any::<u64>(), 2u64..9, 1usize..5, any::<bool>()).prop_map(
        |(dims, seed, share, patch, join)| {
            let count = dims.iter().product::<usize>();
            let random = |i: usize, salt: u64| {
                let mut v = (i as u64 ^ salt.wrapping_mul(0x9E37_79B9) ^ seed)
                    .wrapping_mul(0xD134_2543_DE82_EF95);
                v ^= v >> 31;
                v.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33
            };
            let samples = (0..count)
                .map(|i| if random(i, 1) % 10 < share { 40 } else { 200 })
                .collect();
            let [nx, ny, _] = dims;
            let labels = (0..count).map(|i| {
                let place = [i % nx / patch, i / nx % ny / patch, i / nx / ny / patch];
                let block = (place[2] * 16 + place[1]) * 16 + place[0];
                (random(block, 2) % 12 * 7) as u32
            });
            Case {
                dims,
                samples,
                labels: labels.collect(),
                rule: if join {
                    Ambiguous::Join
                } else {
                    Ambiguous::Separate
                },
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn labels_are_the_cells(case in case(), cube in [1u32..7, 1..7, 1..7], merged in any::<bool>(), cap in any::<bool>()) {
        prop_assume!(case.labels.iter().any(|&label| label > 0));
        let mut options = case.options(cube);
        (options.cap, options.layout) = (cap, if merged { Layout::Merged } else { Layout::Auto });
        check(&case, &options);
    }
}

#[test]
fn cells_that_touch_nobody_are_as_their_components() {
    let dims = [40, 36, 30];
    let samples = foam(dims, 5);
    let mut case = Case {
        dims: dims.map(|n| n as usize),
        samples,
        labels: Vec::new(),
        rule: Ambiguous::Separate,
    };
    case.labels = case.components().iter().map(|&c| c as u32).collect();
    let options = case.options([13, 11, 9]);
    check(&case, &options);
    let (plain, _) = converted(&case.volume(), &options);
    let given = ConvertOptions {
        labels: Some(case.given()),
        ..options
    };
    let (dir, _) = converted(&case.volume(), &given);
    let [plain, given] = [plain.path(), dir.path()].map(|dir| table(dir, "cells.csv"));
    for column in &plain.names {
        assert!(plain.column(column).eq(given.column(column)), "{column}");
    }
}

/// Compares all tables but for the numbers of tiles.
fn assert_same_tables(a: &Path, b: &Path) {
    for name in [
        "components.csv",
        "necks.csv",
        "surfaces.csv",
        "cells.csv",
        "objects.csv",
    ] {
        let [a, b] = [a, b].map(|dir| table(dir, name));
        assert_eq!(a.rows.len(), b.rows.len());
        for column in a.names.iter().filter(|column| *column != "tiles") {
            assert!(a.column(column).eq(b.column(column)), "{name} {column}");
        }
    }
}

#[test]
fn tables_do_not_depend_on_macrocubes() {
    let dims = [70, 66, 40];
    let samples = leaky(dims);
    let volume = placed(dims, samples.clone());
    // labels whose seams run through the hollows
    let place = |i: u32| [i % 70, i / 70 % 66, i / 70 / 66];
    let label = |i: u32| {
        let [x, y, z] = place(i).map(|v| (v + 3) / 9);
        1 + (x * 7 + y * 5 + z * 3) % 23
    };
    let case = Case {
        dims: dims.map(|n| n as usize),
        samples,
        labels: (0..dims.iter().product()).map(label).collect(),
        rule: Ambiguous::Separate,
    };
    let split = ConvertOptions {
        threshold: THRESHOLD,
        split: Some(NeckRule::default()),
        ..options([64; 3])
    };
    let labels = ConvertOptions {
        split: None,
        labels: Some(case.given()),
        ..split.clone()
    };
    for asked in [split, labels] {
        let (whole, _) = converted(&volume, &asked);
        for macrocube in [[16; 3], [32; 3], [13, 70, 9], [7, 11, 39]] {
            let (other, report) = converted(
                &volume,
                &ConvertOptions {
                    macrocube,
                    ..asked.clone()
                },
            );
            assert!(report.totals.necks > 20);
            assert_same_tables(whole.path(), other.path());
        }
    }
}

/// Labels of what splitting gives are the same cells, byte by byte, but for the radii of openings, which labels do not tell.
#[test]
fn split_cells_are_those_of_their_labels() {
    let dims = [48, 44, 40];
    let volume = placed(dims, leaky(dims));
    for (rule, macrocube) in [
        (Ambiguous::Separate, [16, 15, 14]),
        (Ambiguous::Join, [64, 9, 30]),
    ] {
        let options = ConvertOptions {
            threshold: THRESHOLD,
            ambiguous: rule,
            split: Some(NeckRule::default()),
            ..options(macrocube)
        };
        let (split, report) = converted(&volume, &options);
        assert!(
            report.totals.cells > report.totals.components + 3,
            "{:?}",
            report.totals
        );
        let other = ConvertOptions {
            threads: 1,
            memory: options.memory / 2,
            encoding: Encoding::Quantized,
            primitives: Primitives::Triangles,
            macrocube: [7, 33, 5],
            ..options.clone()
        };
        let (other, _) = converted(&volume, &other);
        assert_same_tables(split.path(), other.path());
        match manifest(split.path()).cells {
            Some(PartsBy::Split { curve, .. }) => {
                assert_eq!(curve[6], [800, report.totals.cells]);
                assert!(curve.windows(2).all(|pair| pair[0][1] <= pair[1][1]));
            }
            other => panic!("{other:?}"),
        }
    }
}

/// Balls in walls, some of which have holes.
fn leaky(dims: [u32; 3]) -> Vec<u8> {
    let mut samples = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let place = [x, y, z];
                let off = place.map(|v| f64::from(v % 12) - 5.5);
                let middle = off.iter().map(|v| v * v).sum::<f64>().sqrt();
                let hole = off[1].hypot(off[2]) < 1.6 && (y / 12 + z / 12) % 2 == 0;
                samples.push(if middle < 5.4 || hole { 30 } else { 220 });
            }
        }
    }
    samples
}

#[test]
fn bytes_do_not_depend_on_threads_memory_or_stops() {
    let dims = [48, 30, 40];
    let volume = placed(dims, leaky(dims));
    let options = ConvertOptions {
        threshold: THRESHOLD,
        split: Some(NeckRule::default()),
        min_voxels: 3,
        ..options([20, 11, 7])
    };
    let (dir, _) = converted(&volume, &options);
    let expected = files(dir.path());
    for threads in 1..4 {
        let again = ConvertOptions {
            threads,
            memory: options.memory * threads as u64,
            keep_samples: threads == 2,
            ..options.clone()
        };
        let (dir, _) = converted(&volume, &again);
        assert_same_files(&files(dir.path()), &expected, &format!("{threads} threads"));
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let dims = [9, 8, 7];
    let volume = placed(dims, noise(dims, 3));
    let case = Case {
        dims: dims.map(|n| n as usize),
        samples: vec![0; 504],
        labels: vec![1; 504],
        rule: Ambiguous::Separate,
    };
    let dir = tempfile::tempdir().unwrap();
    let refused = |options: &ConvertOptions| {
        let out = dir.path().join("out");
        let error = convert(&volume, options, &out, &Quiet).unwrap_err();
        assert!(!out.exists());
        error.to_string()
    };
    let both = ConvertOptions {
        split: Some(NeckRule::default()),
        labels: Some(case.given()),
        ..options([4; 3])
    };
    assert!(refused(&both).contains("together with --labels"));
    let ratio = NeckRule {
        ratio_permille: 1001,
        ..NeckRule::default()
    };
    let wide = ConvertOptions {
        split: Some(ratio),
        ..options([4; 3])
    };
    assert!(refused(&wide).contains("1.001"));
    let dims = Dims([9, 8, 7]);
    let of = |dims: Dims, values: Vec<f32>| {
        let labels = MemoryVolume::new(dims, Placement::default(), values).unwrap();
        CellRows::of_labels(&labels, Dims([9, 8, 7]), dir.path(), &Quiet).unwrap_err()
    };
    assert!(of(dims, vec![1.0; 504]).to_string().contains("f32"));
    assert!(
        of(Dims([9, 8, 6]), vec![1.0; 432])
            .to_string()
            .contains("9 x 8 x 6")
    );
}

#[test]
fn labels_below_0_are_refused_in_pores_alone() {
    let dims = Dims([9, 8, 7]);
    let mut samples = vec![200u8; 504];
    samples[100..110].fill(0);
    let volume = placed(dims.0, samples);
    let dir = tempfile::tempdir().unwrap();
    let set = |values: &[i32], crop: Option<Crop>| {
        let labels = MemoryVolume::new(dims, Placement::default(), values.to_vec()).unwrap();
        let (rows, checksum) = CellRows::of_labels(&labels, dims, dir.path(), &Quiet).unwrap();
        let labels = Some(Labels {
            file: "labels.npy".into(),
            checksum,
            rows: rows.into(),
        });
        let options = ConvertOptions {
            labels,
            crop,
            threshold: THRESHOLD,
            force: true,
            ..options([4; 3])
        };
        let out = dir.path().join("out");
        convert(&volume, &options, &out, &Quiet).map(|_| table(&out, "cells.csv"))
    };
    let mut values = vec![-1i32; 504];
    values[100..110].fill(7);
    values[109] = 0;
    let cells = set(&values, None).unwrap();
    assert_eq!(cells.column("id").collect::<Vec<_>>(), ["7", "8"]);
    assert_eq!(cells.column("voxels").collect::<Vec<_>>(), ["9", "1"]);
    values[108] = -2;
    values[106] = i32::MIN;
    let crop = Crop {
        x: 1..9,
        y: 1..8,
        z: 1..7,
    };
    for crop in [None, Some(crop)] {
        let error = set(&values, crop).unwrap_err().to_string();
        let expected = "--labels: found label -2147483648 at voxel 7, 3, 1, which is below";
        assert!(error.contains(expected), "{error}");
    }
}

/// What the command prints, if it succeeds.
fn alvis(dir: &Path, line: &str) -> String {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(line.split(' '))
        .current_dir(dir)
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{line}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// What the command says of what it refuses.
fn refusal(dir: &Path, line: &str) -> String {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(line.split(' '))
        .current_dir(dir)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{line}");
    String::from_utf8(output.stderr).unwrap()
}

/// An array of this type as NumPy writes it, from the bytes of its numbers.
fn npy(kind: &str, [x, y, z]: [u32; 3], bytes: &[u8]) -> Vec<u8> {
    let mut header =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({z}, {y}, {x}), }}");
    let length = (header.len() + 11).next_multiple_of(64) - 10;
    header = format!("{header:<width$}\n", width = length - 1);
    let start = [&b"\x93NUMPY\x01\x00"[..], &(length as u16).to_le_bytes()].concat();
    [&start, header.as_bytes(), bytes].concat()
}

#[test]
fn a_set_says_what_its_cells_are() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let dims = [24, 20, 18];
    std::fs::write(here.join("leaky.raw"), leaky(dims)).unwrap();
    let labels: Vec<u8> = (0..8640u32).map(|i| (i % 24 / 5) as u8).collect();
    std::fs::write(here.join("parts.npy"), npy("|u1", dims, &labels)).unwrap();
    let convert = "--dims 24,20,18 --dtype u8 --threshold 128 --quiet";
    alvis(here, &format!("convert leaky.raw plain {convert}"));
    alvis(
        here,
        &format!("convert leaky.raw split {convert} --split 0.75 --split-h 1"),
    );
    alvis(
        here,
        &format!("convert leaky.raw labelled {convert} --labels parts.npy"),
    );
    let info = |out: &str| -> serde_json::Value {
        serde_json::from_str(&alvis(here, &format!("info {out} --json"))).unwrap()
    };
    let said = info("split");
    assert_eq!(said["cells"]["by"], "split");
    assert_eq!(said["cells"]["ratio_permille"], 750);
    assert_eq!(
        said["totals"]["necks"],
        manifest(&here.join("split")).totals.necks
    );
    assert_eq!(info("labelled")["cells"]["by"], "labels");
    assert!(info("plain").get("cells").is_none());
    let text = alvis(here, "info split");
    assert!(
        text.contains("split at necks: ratio 0.75, h 1, min radius 0"),
        "{text}"
    );
    assert!(
        text.contains(" components with ") && text.contains(" openings, "),
        "{text}"
    );
    let text = alvis(here, "info labelled");
    assert!(text.contains("by the labels of parts.npy; "), "{text}");
    // what a set has not is said to be so
    let message = refusal(here, "cells labelled --split-curve");
    assert!(
        message.contains("whose cells are the labels of parts.npy"),
        "{message}"
    );
    assert!(message.contains("alvis convert with --split"), "{message}");
    let message = refusal(here, "cells plain --necks");
    assert!(
        message.contains("connected components") && message.contains("--split or --labels"),
        "{message}"
    );
    assert!(refusal(here, "cells plain --split-curve").contains("connected components"));
    // and labels that have to be of another type
    let wide: Vec<u8> = labels
        .iter()
        .flat_map(|&l| i64::from(l).to_le_bytes())
        .collect();
    std::fs::write(here.join("wide.npy"), npy("<i8", dims, &wide)).unwrap();
    std::fs::write(here.join("wide.raw"), &wide).unwrap();
    for file in ["wide.npy", "wide.raw"] {
        let message = refusal(
            here,
            &format!("convert leaky.raw no {convert} --labels {file}"),
        );
        assert!(message.contains("labels.astype('uint32')"), "{message}");
        assert!(!message.contains("float64"), "{message}");
    }
    assert!(!here.join("no").exists());
    let batch = "convert leaky.raw --out-dir all --dims 24,20,18 --dtype u8 --threshold 128 --quiet --split 0.75";
    alvis(here, batch);
    let rows = table(&here.join("all"), "scans.csv");
    let totals = manifest(&here.join("all/leaky")).totals;
    let expected = [
        ("split", 0.75),
        ("split_h", 0.5),
        ("split_min_radius", 0.0),
        ("components", totals.components as f64),
        ("necks", totals.necks as f64),
    ];
    for (column, expected) in expected {
        assert_eq!(number(&rows, 0, column), Some(expected), "{column}");
    }
}

#[test]
fn openings_and_the_curve_of_ratios_are_listed() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    std::fs::write(here.join("leaky.raw"), leaky([48, 44, 40])).unwrap();
    let convert = "convert leaky.raw out --dims 48,44,40 --dtype u8 --threshold 128 --tables csv,parquet --quiet --split";
    alvis(here, convert);
    let out = here.join("out");
    let totals = manifest(&out).totals;
    let necks = alvis(here, "cells out --necks --format csv");
    assert_eq!(
        necks,
        std::fs::read_to_string(out.join("necks.csv")).unwrap()
    );
    assert_eq!(necks.lines().count() as u64, 1 + totals.necks);
    let wide = alvis(
        here,
        "cells out --necks --where neck_radius>1000 --format csv",
    );
    assert_eq!(wide.lines().count(), 1);
    let curve: serde_json::Value =
        serde_json::from_str(&alvis(here, "cells out --split-curve --json")).unwrap();
    assert_eq!(curve["cells"], totals.cells);
    assert_eq!(curve["components"], totals.components);
    let points = curve["split_curve"].as_array().unwrap();
    assert_eq!((points.len(), &points[6]["cells"]), (10, &curve["cells"]));
    assert!(alvis(here, "cells out --split-curve").contains("<- these tiles"));
    // a mesh is open where a cell that is left out touches it
    let warning = |chosen: &str| {
        let line = format!("export {chosen} --force --json");
        let report: serde_json::Value = serde_json::from_str(&alvis(here, &line)).unwrap();
        let warnings = report["warnings"].as_array().unwrap().clone();
        let found = warnings.iter().find_map(|w| {
            let text = w.as_str().unwrap();
            let rest = text.strip_prefix("the mesh is open at ")?;
            rest.split_once(" opening")
                .map(|(n, _)| n.parse::<u64>().unwrap())
        });
        found.unwrap_or(0)
    };
    let rows = table(&out, "necks.csv");
    let open = |kept: &dyn Fn(f64) -> bool| -> u64 {
        let ends = |row: usize| ["cell_a", "cell_b"].map(|c| kept(number(&rows, row, c).unwrap()));
        let one = |row: &usize| ends(*row)[0] != ends(*row)[1];
        (0..rows.rows.len()).filter(one).count() as u64
    };
    assert_eq!(warning("out all.ply"), 0);
    assert_eq!(warning("out all.ply --objects --largest 1"), 0);
    let some = open(&|id| id < 3.0);
    assert!(some > 0);
    assert_eq!(warning("out some.ply --where id<3"), some);
    assert_eq!(warning("out some.ply --surfaces --where cell<3"), some);
    alvis(here, "select out few --where id<3 --quiet");
    assert_eq!(warning("few some.ply"), some);
    // a part has the openings between the cells that it has, and what cells are parts of
    alvis(here, "select out part --largest 6 --quiet");
    let part = here.join("part");
    let kept: Vec<f64> = table(&part, "cells.csv")
        .column("id")
        .map(|id| id.parse().unwrap())
        .collect();
    let rows = table(&part, "necks.csv");
    let all = table(&out, "necks.csv");
    let both = (0..all.rows.len()).filter(|&row| {
        ["cell_a", "cell_b"]
            .iter()
            .all(|c| kept.contains(&number(&all, row, c).unwrap()))
    });
    assert_eq!(rows.rows.len(), both.count());
    assert_eq!(manifest(&part).totals.necks, rows.rows.len() as u64);
    let proof = alvis(here, "verify part");
    assert!(
        proof.contains("where cells that were left out touched"),
        "{proof}"
    );
    let components = table(&part, "components.csv").rows.len() as u64;
    assert_eq!(manifest(&part).totals.components, components);
    // levels would gape where cells touch
    let lod = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(["lod", "out"])
        .current_dir(here)
        .output()
        .unwrap();
    assert_eq!(lod.status.code(), Some(2));
    assert!(!out.join("lod").exists());
}

#[test]
fn many_labels_in_a_tile_keep_the_limit_of_memory() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let (n, block) = (48u32, 3);
    std::fs::write(here.join("noise.raw"), noise([n; 3], 11)).unwrap();
    let blocks = n / block;
    let label =
        |i: u32| 1 + (i / n / n / block * blocks + i / n % n / block) * blocks + i % n / block;
    let labels: Vec<u8> = (0..n * n * n)
        .flat_map(|i| label(i).to_le_bytes())
        .collect();
    std::fs::write(here.join("labels.npy"), npy("<u4", [n; 3], &labels)).unwrap();
    let limit = 256;
    let made = alvis(
        here,
        &format!(
            "convert noise.raw out --dims {n},{n},{n} --dtype u8 --threshold 128 --labels labels.npy --macrocube 48 \
             --threads 1 --memory {limit}MiB --json"
        ),
    );
    let made: serde_json::Value = serde_json::from_str(&made).unwrap();
    assert_eq!(made["cells"], blocks.pow(3));
    let peak = made["peak_rss_bytes"].as_u64().unwrap();
    assert!(peak <= limit << 20, "{peak}");
    // where they cannot fit, that is said, not done
    let said = refusal(
        here,
        &format!(
            "convert noise.raw small --dims {n},{n},{n} --dtype u8 --threshold 128 --labels labels.npy --macrocube 48 \
             --threads 1 --memory 64MiB"
        ),
    );
    assert!(said.contains("tiles that are made"), "{said}");
}

#[test]
fn labels_lie_where_the_scan_does_whichever_way_the_world_runs() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let nrrd = |name: &str, space: &str, step: f64| {
        let header = format!(
            "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 6 5 4\nspace: {space}\n\
             space directions: ({step},0,0) (0,{step},0) (0,0,0.5)\nspace origin: ({step},{step},1)\nencoding: raw\n\n"
        );
        let samples = (0..120u8).map(|i| 1 + i % 6 / 3);
        let bytes: Vec<u8> = header.bytes().chain(samples).collect();
        std::fs::write(here.join(name), bytes).unwrap();
    };
    nrrd("scan.nrrd", "left-posterior-superior", 0.5);
    nrrd("same.nrrd", "right-anterior-superior", -0.5);
    nrrd("turned.nrrd", "right-anterior-superior", 0.5);
    let convert = "convert scan.nrrd out --threshold 1.5 --quiet";
    alvis(here, &format!("{convert} --labels same.nrrd"));
    alvis(here, &format!("{convert} --force --roi mask:same.nrrd"));
    let said = refusal(here, &format!("{convert} --force --labels turned.nrrd"));
    assert!(said.contains("axes along"), "{said}");
    let said = refusal(here, &format!("{convert} --force --roi mask:turned.nrrd"));
    assert!(said.contains("axes along"), "{said}");
}

#[test]
fn large_ids_are_exported_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    std::fs::write(here.join("leaky.raw"), leaky([24, 20, 18])).unwrap();
    for (largest, kind) in [(16_777_217u32, "int"), (3_000_000_000, "uint")] {
        let label = |i: u32| largest - i % 24 / 12;
        let labels: Vec<u8> = (0..8640).flat_map(|i| label(i).to_le_bytes()).collect();
        std::fs::write(here.join("labels.npy"), npy("<u4", [24, 20, 18], &labels)).unwrap();
        let convert =
            "convert leaky.raw out --dims 24,20,18 --dtype u8 --threshold 128 --quiet --force";
        alvis(here, &format!("{convert} --labels labels.npy"));
        alvis(here, "export out out.ply --force");
        let mesh = std::fs::read(here.join("out.ply")).unwrap();
        let head = String::from_utf8_lossy(&mesh[..1000]);
        assert!(head.contains(&format!("property {kind} cell\n")), "{head}");
        // as floats they would be one
        alvis(here, "export out out.glb --force");
        let mesh = std::fs::read(here.join("out.glb")).unwrap();
        let head = String::from_utf8_lossy(&mesh[..4096]);
        assert!(!head.contains("_FEATURE_ID_0"), "{head}");
    }
}

#[test]
fn what_labels_leave_without_a_meaning_is_refused_or_said() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    std::fs::write(here.join("leaky.raw"), leaky([24, 20, 18])).unwrap();
    std::fs::write(here.join("one.npy"), npy("|u1", [24, 20, 18], &[7; 8640])).unwrap();
    let convert =
        "convert leaky.raw out --dims 24,20,18 --dtype u8 --threshold 128 --labels one.npy";
    for option in ["--split-h 1", "--split-min-radius 2"] {
        let said = refusal(here, &format!("{convert} {option}"));
        assert!(said.contains("--labels"), "{said}");
    }
    let made: serde_json::Value =
        serde_json::from_str(&alvis(here, &format!("{convert} --json"))).unwrap();
    assert_eq!(made["necks"], 0);
    let said = refusal(here, "lod out");
    assert!(said.contains("out: found cells"), "{said}");
}
