//! Walls between cells: how thick they are found in volumes where that is known, and the same as a slow search finds.

mod common;

use alvis::convert::{CellRows, ConvertOptions, Labels, convert};
use alvis::error::Error;
use alvis::grid::Dims;
use alvis::manifest::{Encoding, Form, Layout, Primitives};
use alvis::progress::Quiet;
use alvis::split::NeckRule;
use alvis::table::Chosen;
use alvis::transform::repack::{RepackOptions, repack};
use alvis::transform::select::{SelectOptions, select};
use alvis::volume::{MemoryVolume, Volume};
use common::set::{Table, manifest, table};
use common::volumes::{Random, placed, samples, volume};
use common::{assert_same_files, converted, files, options};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Cells by labels.
fn given(dims: [u32; 3], labels: Vec<u32>) -> Labels {
    let volume = MemoryVolume::new(Dims(dims), Default::default(), labels).unwrap();
    let dir = std::env::temp_dir();
    let (rows, checksum) = CellRows::of_labels(&volume, Dims(dims), &dir, &Quiet).unwrap();
    Labels {
        file: "labels.npy".into(),
        checksum,
        rows: rows.into(),
    }
}

fn number(table: &Table, row: usize, column: &str) -> f64 {
    let text = table.column(column).nth(row).unwrap();
    text.parse().unwrap_or(f64::NAN)
}

/// A row of the table of walls.
#[derive(Debug, Clone, PartialEq)]
struct WallRow {
    cells: [u64; 2],
    area: f64,
    thickness: f64,
    chords: u64,
    thin: bool,
    neighbour: bool,
}

fn wall_rows(dir: &Path) -> Vec<WallRow> {
    let rows = table(dir, "walls.csv");
    let row = |row| WallRow {
        cells: ["cell_a", "cell_b"].map(|name| number(&rows, row, name) as u64),
        area: number(&rows, row, "wall_area"),
        thickness: number(&rows, row, "wall_thickness"),
        chords: number(&rows, row, "chords") as u64,
        thin: number(&rows, row, "thin") == 1.0,
        neighbour: number(&rows, row, "neighbour") == 1.0,
    };
    (0..rows.rows.len()).map(row).collect()
}

/// The integral of the Gaussian from 0 on, times two over the root of pi (Abramowitz and Stegun 7.1.26, error 1.5e-7).
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let poly = [
        1.061_405_429,
        -1.453_152_027,
        1.421_413_741,
        -0.284_496_736,
        0.254_829_592,
    ];
    let sum = poly.iter().fold(0.0, |sum, c| (sum + c) * t);
    (1.0 - sum * (-x * x).exp()).copysign(x)
}

/// A plate of a thickness through the middle of a volume, blurred with a standard deviation of 0.8 voxels, between two
/// cells; lengths are in voxels of 0.5.
fn plate(normal: [f64; 3], thickness: f64, macrocube: [u32; 3]) -> (tempfile::TempDir, f64) {
    let dims = [36, 40, 90];
    let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
    let from_middle = |p: [u32; 3]| {
        let off = (0..3).map(|a| (f64::from(p[a]) - f64::from(dims[a]) / 2.0 + 0.3) * normal[a]);
        off.sum::<f64>() / length
    };
    let grey = samples(dims, |p| {
        let d = from_middle(p);
        let width = 0.8 * 2f64.sqrt();
        (100.0 * (erf((thickness / 2.0 - d) / width) + erf((thickness / 2.0 + d) / width))) as f32
    });
    let labels = samples(dims, |p| if from_middle(p) < 0.0 { 1 } else { 2 });
    let options = ConvertOptions {
        threshold: 100.0,
        walls: true,
        labels: Some(given(dims, labels)),
        ..options(macrocube)
    };
    let (dir, _) = converted(&volume(dims, grey), &options);
    // a line along z meets it once
    let area = f64::from(dims[0] * dims[1]) * length / normal[2].abs();
    (dir, area)
}

#[test]
fn plates_are_as_thick_as_they_are() {
    let mut worst: BTreeMap<u64, f64> = BTreeMap::new();
    let normals = [
        [0.0, 0.0, 1.0],
        [0.1, 0.0, 1.0],
        [0.3, -0.5, 0.81],
        [-0.4, 0.6, 0.7],
        [0.57, 0.57, 0.6],
    ];
    for (i, normal) in normals.into_iter().enumerate() {
        for thickness in [2.2, 3.0, 4.5, 9.3, 31.0] {
            let (dir, area) = plate(normal, thickness, [[40, 64, 64], [7, 5, 11]][i % 2]);
            let walls = wall_rows(dir.path());
            assert_eq!(walls.len(), 1, "{normal:?} {thickness}: {walls:?}");
            let wall = &walls[0];
            let error = wall.thickness / thickness - 1.0;
            let of = worst.entry((thickness * 10.0) as u64).or_default();
            if error.abs() > of.abs() {
                *of = error;
            }
            // lines between voxels are straight, and the grey across the thinnest one is not
            assert!(error.abs() < 0.03, "{normal:?} {thickness}: {wall:?}");
            assert!(!wall.thin, "{normal:?} {thickness}: {wall:?}");
            // a thick plate that is tilted leaves the volume before a line has crossed it
            if thickness < 9.0 && i < 4 {
                assert!(
                    (wall.area / area - 1.0).abs() < 0.03 * thickness,
                    "{normal:?} {thickness}: {wall:?} {area}"
                );
            }
            let cells = table(dir.path(), "cells.csv");
            for row in 0..2 {
                assert_eq!(number(&cells, row, "neighbours"), 1.0);
                assert_eq!(number(&cells, row, "wall_thickness"), wall.thickness);
            }
        }
    }
    println!("greatest errors by tenths of a voxel: {worst:?}");
}

#[test]
fn walls_that_are_too_thin_are_flagged_and_those_too_thick_are_none() {
    let (dir, _) = plate([0.1, 0.2, 1.0], 1.3, [40; 3]);
    assert!(wall_rows(dir.path())[0].thin);
    for macrocube in [[40, 64, 64], [7, 5, 11]] {
        let (dir, _) = plate([0.1, 0.2, 1.0], 33.5, macrocube);
        assert_eq!(wall_rows(dir.path()), []);
        let cells = table(dir.path(), "cells.csv");
        assert_eq!(number(&cells, 0, "neighbours"), 0.0);
        assert_eq!(cells.column("wall_thickness").collect::<Vec<_>>(), ["", ""]);
    }
}

/// A foam with flat walls, and what is known of it.
struct Foam {
    dims: [u32; 3],
    grey: Vec<u8>,
    labels: Vec<u32>,
    /// Voxels on the middle of the wall between two cells, by their numbers.
    faces: BTreeMap<[u32; 2], u32>,
}

/// Cells around random places, as of [`foam_around`].
fn flat_foam(dims: [u32; 3], cells: usize, thickness: f64, noise: f64) -> Foam {
    let mut random = Random(7);
    let places: Vec<[f64; 3]> = (0..cells)
        .map(|_| dims.map(|n| random.unit() * f64::from(n)))
        .collect();
    foam_around(dims, &places, thickness, noise)
}

/// Places of Kelvin's cells, of this width, whose walls lie across axes and diagonals.
fn kelvin_places(dims: [u32; 3], width: f64) -> Vec<[f64; 3]> {
    let most = dims.map(|n| (f64::from(n) / width) as i32 + 1);
    let mut places = Vec::new();
    for z in -1..=most[2] {
        for (y, x) in (-1..=most[1]).flat_map(|y| (-1..=most[0]).map(move |x| (y, x))) {
            let corner = [x, y, z].map(|v| (f64::from(v) + 0.27) * width);
            places.extend([corner, corner.map(|v| v + width / 2.0)]);
        }
    }
    places
}

/// The same places turned about the middle of the volume, by a unit quaternion; of more than the volume holds, those that
/// lie in it or beside it.
fn turned_kelvin_places(dims: [u32; 3], width: f64, [w, x, y, z]: [f64; 4]) -> Vec<[f64; 3]> {
    let turned = [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ];
    let large = dims.map(|n| 2 * n);
    let all = kelvin_places(large, width).into_iter().map(|p| {
        let off: [f64; 3] = std::array::from_fn(|a| p[a] - f64::from(large[a]) / 2.0);
        turned.map(|row| (0..3).map(|a| row[a] * off[a]).sum::<f64>())
    });
    let placed = all.map(|off| std::array::from_fn(|a| off[a] + f64::from(dims[a]) / 2.0));
    let is_near = |p: &[f64; 3]| (0..3).all(|a| -width < p[a] && p[a] < f64::from(dims[a]) + width);
    placed.filter(is_near).collect()
}

/// Cells around places, with walls of a thickness, blurred with a standard deviation of 0.8 voxels, and noise.
fn foam_around(dims: [u32; 3], places: &[[f64; 3]], thickness: f64, noise: f64) -> Foam {
    let mut random = Random(77);
    let cells = places.len();
    let apart: Vec<Vec<f64>> = places
        .iter()
        .map(|p| {
            let square = |q: &[f64; 3]| (0..3).map(|a| (q[a] - p[a]).powi(2)).sum::<f64>();
            places.iter().map(|q| square(q).sqrt()).collect()
        })
        .collect();
    let mut labels = Vec::new();
    let mut faces = BTreeMap::new();
    let solid = samples(dims, |p| {
        let square = |c: &[f64; 3]| {
            (0..3)
                .map(|a| (f64::from(p[a]) - c[a]).powi(2))
                .sum::<f64>()
        };
        let squares: Vec<f64> = places.iter().map(square).collect();
        let own = (0..cells)
            .min_by(|&a, &b| squares[a].total_cmp(&squares[b]))
            .unwrap();
        labels.push(own as u32 + 1);
        let mut depth = (f64::INFINITY, 0);
        for other in (0..cells).filter(|&other| other != own) {
            let to_face = (squares[other] - squares[own]) / 2.0 / apart[own][other];
            if to_face < depth.0 {
                depth = (to_face, other);
            }
        }
        if depth.0 < 0.5 {
            let pair = [own.min(depth.1) as u32 + 1, own.max(depth.1) as u32 + 1];
            *faces.entry(pair).or_default() += 1;
        }
        (0.5 + thickness / 2.0 - depth.0).clamp(0.0, 1.0)
    });
    let blurred = (0..3).fold(solid, |values, axis| blur(dims, &values, axis));
    let grey = blurred
        .iter()
        .map(|v| {
            let gauss = (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
            (48.5 + 160.0 * v + noise * gauss).clamp(0.0, 255.0) as u8
        })
        .collect();
    Foam {
        dims,
        grey,
        labels,
        faces,
    }
}

/// A Gaussian of 0.8 voxels along an axis.
fn blur(dims: [u32; 3], values: &[f64], axis: usize) -> Vec<f64> {
    let weights: Vec<f64> = (-3..=3)
        .map(|i| (-f64::from(i * i) / 2.0 / 0.64).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    samples(dims, |p| {
        let taps = weights.iter().zip(-3i64..).map(|(weight, step)| {
            let mut q = p.map(|v| v as usize);
            q[axis] = (i64::from(p[axis]) + step).clamp(0, i64::from(dims[axis]) - 1) as usize;
            let [nx, ny, _] = dims.map(|n| n as usize);
            weight * values[(q[2] * ny + q[1]) * nx + q[0]]
        });
        taps.sum::<f64>() / sum
    })
}

#[test]
fn walls_of_a_blurred_foam_are_as_thick_as_they_are() {
    for (thickness, noise) in [(1.3, 0.0), (2.2, 0.0), (3.0, 0.0), (4.5, 0.0), (3.0, 12.0)] {
        let foam = flat_foam([70, 66, 60], 14, thickness, noise);
        let options = ConvertOptions {
            walls: true,
            labels: Some(given(foam.dims, foam.labels.clone())),
            min_voxels: 8,
            ..options([32; 3])
        };
        let (dir, _) = converted(&volume(foam.dims, foam.grey.clone()), &options);
        let walls = wall_rows(dir.path());
        let mut errors: Vec<f64> = Vec::new();
        let mut off = Vec::new();
        for wall in &walls {
            let pair = wall.cells.map(|id| id as u32);
            let voxels = foam.faces.get(&pair).copied().unwrap_or(0);
            // smaller ones are mostly what lies between the edges of walls
            if voxels >= 200 {
                errors.push(wall.thickness / thickness - 1.0);
                off.push(wall.area / f64::from(voxels) - 1.0);
                assert_eq!(wall.thin, thickness < 2.0, "{wall:?}");
            }
        }
        errors.sort_by(f64::total_cmp);
        off.sort_by(f64::total_cmp);
        let [low, middle, high] = [0, errors.len() / 2, errors.len() - 1].map(|i| errors[i]);
        println!(
            "thickness {thickness}, noise {noise}: {} walls, error {low:+.4} {middle:+.4} {high:+.4}, area by faces \
             {:+.3}",
            errors.len(),
            off[off.len() / 2]
        );
        assert!(errors.len() > 20);
        if thickness > 2.0 {
            assert!(middle.abs() < 0.02 && low > -0.05);
            // with noise small walls are lost in the edges between them
            assert!(high < if noise > 0.0 { 0.1 } else { 0.05 });
        }
        let cells = table(dir.path(), "cells.csv");
        let found: f64 = (0..cells.rows.len())
            .map(|row| number(&cells, row, "neighbours"))
            .sum();
        let known = foam.faces.values().filter(|&&voxels| voxels >= 30).count();
        println!("neighbours {found}, faces of 30 voxels {}", 2 * known);
        if thickness > 2.0 {
            assert!((found / (2 * known) as f64 - 1.0).abs() < 0.25);
            for row in 0..cells.rows.len() {
                let error = number(&cells, row, "wall_thickness") / thickness - 1.0;
                let most = if noise > 0.0 { 0.1 } else { 0.06 };
                assert!(error.abs() < most, "{row}: {error}");
            }
        }
    }
}

#[test]
fn walls_of_kelvin_cells_are_as_thick_as_they_are() {
    for thickness in [2.2, 3.0, 4.5] {
        let dims = [62, 58, 54];
        let foam = foam_around(dims, &kelvin_places(dims, 26.0), thickness, 0.0);
        let options = ConvertOptions {
            walls: true,
            labels: Some(given(foam.dims, foam.labels.clone())),
            ..options([32; 3])
        };
        let (dir, _) = converted(&volume(foam.dims, foam.grey.clone()), &options);
        let mut errors: Vec<f64> = Vec::new();
        for wall in wall_rows(dir.path()) {
            let pair = wall.cells.map(|id| id as u32);
            let voxels = foam.faces.get(&pair).copied().unwrap_or(0);
            if voxels >= 100 {
                errors.push(wall.thickness / thickness - 1.0);
            }
        }
        errors.sort_by(f64::total_cmp);
        let [low, middle, high] = [0, errors.len() / 2, errors.len() - 1].map(|i| errors[i]);
        println!("Kelvin, thickness {thickness}: {low:+.4} {middle:+.4} {high:+.4}");
        assert!(errors.len() > 70);
        // the middle of a wall across a diagonal is small: lines along axes go through it aslant
        assert!(low > -0.05 && middle.abs() < 0.03 && high < 0.05);
    }
}

/// Lines that run along a flat wall meet the cells at its two ends, which are no neighbours.
#[test]
fn turned_kelvin_cells_have_fourteen_neighbours() {
    let (dims, width) = ([58, 60, 62], 20.0);
    let places = turned_kelvin_places(dims, width, [0.96, 0.0, 0.28, 0.0]);
    let foam = foam_around(dims, &places, 2.2, 0.0);
    let options = ConvertOptions {
        walls: true,
        labels: Some(given(dims, foam.labels)),
        ..options([32; 3])
    };
    let (dir, _) = converted(&volume(dims, foam.grey), &options);
    let cells = table(dir.path(), "cells.csv");
    let mut found = BTreeMap::new();
    for row in 0..cells.rows.len() {
        let place = places[number(&cells, row, "id") as usize - 1];
        // farther from the edge than the farthest neighbour's wall
        if (0..3).all(|a| 0.85 * width < place[a].min(f64::from(dims[a]) - place[a])) {
            let neighbours = number(&cells, row, "neighbours") as u32;
            *found.entry(neighbours).or_insert(0) += 1;
        }
    }
    assert!(found.len() == 1 && found[&14] >= 2, "{found:?}");
    let walls = wall_rows(dir.path());
    let along_walls = walls
        .iter()
        .filter(|wall| wall.area > 20.0 && !wall.neighbour);
    let along_walls = along_walls.count();
    println!("neighbours {found:?}; {along_walls} large walls make none");
    assert!(along_walls > 5, "{along_walls}");
    check_cells(dir.path(), [1.0; 3]);
}

/// How the surface crosses an edge between two voxels: where, in voxels; the cosine of its slant to the edge's axis; and the
/// share of the wall that this axis has.
struct Crossing {
    place: f64,
    cosine: f64,
    share: f64,
}

/// A chord of a wall: the thickness there, the area that it stands for, and whether it is thinner than a scan resolves.
struct Chord {
    thickness: f64,
    area: f64,
    thin: bool,
}

/// A volume of which every voxel is searched.
#[derive(Debug)]
struct Case {
    dims: [u32; 3],
    samples: Vec<u8>,
    labels: Vec<u32>,
    spacing: [f64; 3],
}

impl Case {
    fn index(&self, [x, y, z]: [u32; 3]) -> usize {
        ((z * self.dims[1] + y) * self.dims[0] + x) as usize
    }

    fn cell(&self, p: [u32; 3]) -> u64 {
        match self.labels[self.index(p)] {
            0 => u64::from(*self.labels.iter().max().unwrap()) + 1,
            label => label.into(),
        }
    }

    fn value(&self, p: [u32; 3]) -> f64 {
        self.samples[self.index(p)].into()
    }

    fn gradient(&self, p: [u32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| {
            let [mut back, mut forth] = [p; 2];
            back[a] = back[a].saturating_sub(1);
            forth[a] = (forth[a] + 1).min(self.dims[a] - 1);
            let steps = f64::from(forth[a] - back[a]).max(1.0);
            ((self.value(forth) - self.value(back)) / steps) as f32
        })
    }

    /// How the surface crosses the edge from a voxel along an axis.
    fn crossing(&self, p: [u32; 3], axis: usize) -> Crossing {
        let mut q = p;
        q[axis] += 1;
        let [v, w] = [p, q].map(|p| self.value(p));
        let step = (256.0 * (128.0 - v) / (w - v)).round().clamp(1.0, 255.0);
        let t = step / 256.0;
        let [g, h] = [p, q].map(|p| self.gradient(p).map(f64::from));
        let gradient: [f64; 3] = std::array::from_fn(|a| g[a] + (h[a] - g[a]) * t);
        let crossing = |cosine: f64, share: f64| Crossing {
            place: f64::from(p[axis]) + t,
            cosine: (cosine * 65536.0).round() / 65536.0,
            share: (share * 65536.0).round() / 65536.0,
        };
        if gradient == [0.0; 3] {
            return crossing(1.0, 1.0);
        }
        let unit = |slope: [f64; 3]| -> [f64; 3] {
            let own: [f64; 3] = std::array::from_fn(|a| slope[a] / self.spacing[a]);
            let length = own.iter().map(|v| v * v).sum::<f64>().sqrt();
            own.map(|v| v / length)
        };
        let square = unit(gradient)[axis] * unit(gradient)[axis];
        if square < 0.05 {
            return crossing(0.0, 0.0);
        }
        // what central differences miss where the grey bends
        let (wide, narrow) = ((g[axis] + h[axis]) / 2.0, w - v);
        let r = 2.0 * (wide - narrow) / (wide + 2.0 * narrow);
        let most = 0.5 * square;
        let r = if r.is_finite() {
            r.clamp(-most, most)
        } else {
            0.0
        };
        let normal = unit(std::array::from_fn(|a| {
            let measured = gradient[a] / gradient[axis];
            let mut ratio = measured;
            for _ in 0..3 {
                ratio = measured * (1.0 + r) / (1.0 + r * ratio * ratio).max(0.5);
            }
            ratio
        }));
        let above = normal.map(|v| (v * v - 0.1).max(0.0));
        crossing(normal[axis].abs(), above[axis] / above.iter().sum::<f64>())
    }

    /// The chords between cells.
    fn chords(&self) -> BTreeMap<[u64; 2], Vec<Chord>> {
        let mut found: BTreeMap<[u64; 2], Vec<Chord>> = BTreeMap::new();
        let voxel: f64 = self.spacing.iter().product();
        for z in 0..self.dims[2] {
            for (x, y) in (0..self.dims[1]).flat_map(|y| (0..self.dims[0]).map(move |x| (x, y))) {
                let start = [x, y, z];
                for axis in 0..3 {
                    let at = |i: u32| {
                        let mut p = start;
                        p[axis] = i;
                        p
                    };
                    let is_above = |i: u32| self.value(at(i)) >= 128.0;
                    let (first, n) = (start[axis], self.dims[axis]);
                    if is_above(first) || first + 1 == n || !is_above(first + 1) {
                        continue;
                    }
                    let Some(next) = (first + 1..n).find(|&i| !is_above(i)) else {
                        continue;
                    };
                    let [a, b] = [first, next].map(|i| self.cell(at(i)));
                    let [one, two] = [first, next - 1].map(|i| self.crossing(at(i), axis));
                    if a == b || one.share == 0.0 || two.share == 0.0 {
                        continue;
                    }
                    let cosine = (one.cosine + two.cosine) / 2.0;
                    let share = (one.share + two.share) / 2.0;
                    let voxels = (two.place - one.place) * cosine;
                    let chord = Chord {
                        thickness: voxels * self.spacing[axis],
                        area: voxel / self.spacing[axis] / cosine * share,
                        thin: voxels < 2.0,
                    };
                    found.entry([a.min(b), a.max(b)]).or_default().push(chord);
                }
            }
        }
        found
    }

    fn check(&self, dir: &Path) {
        let chords = self.chords();
        let walls = wall_rows(dir);
        assert_eq!(manifest(dir).totals.walls, walls.len() as u64);
        let keys: Vec<[u64; 2]> = walls.iter().map(|wall| wall.cells).collect();
        assert_eq!(keys, chords.keys().copied().collect::<Vec<_>>());
        let finest = self.spacing.into_iter().fold(f64::INFINITY, f64::min);
        for (wall, mut chords) in walls.iter().zip(chords.into_values()) {
            assert_eq!(wall.chords, chords.len() as u64);
            let area: f64 = chords.iter().map(|chord| chord.area).sum();
            // areas are counted in parts of a face
            let off = 2e-5 * finest * finest * chords.len() as f64 * 4.0;
            assert!(
                (wall.area - area).abs() < 1e-4 * area + off,
                "{wall:?} {area}"
            );
            let slack = 1e-3 * area + off;
            let thin = chords.iter().filter(|chord| chord.thin);
            let thin: f64 = thin.map(|chord| chord.area).sum();
            assert!(wall.thin == (2.0 * thin > area) || (2.0 * thin - area).abs() < slack);
            chords.sort_by(|a, b| a.thickness.total_cmp(&b.thickness));
            let up_to = |share: f64| {
                let mut sum = 0.0;
                let reaches = |chord: &&Chord| {
                    sum += chord.area;
                    sum >= share
                };
                chords
                    .iter()
                    .find(reaches)
                    .unwrap_or(&chords[chords.len() - 1])
                    .thickness
            };
            let middle = [area / 2.0 - slack, area / 2.0 + slack].map(up_to);
            let bin = finest / 64.0 * 1.001;
            assert!(
                middle[0] - bin < wall.thickness && wall.thickness < middle[1] + bin,
                "{wall:?} {middle:?}"
            );
        }
    }
}

/// Neighbours and thickness of the walls of each cell follow from the tables of walls and openings.
fn check_cells(dir: &Path, spacing: [f64; 3]) {
    let (cells, necks, walls) = (
        table(dir, "cells.csv"),
        table(dir, "necks.csv"),
        wall_rows(dir),
    );
    let ids: Vec<u64> = cells.column("id").map(|id| id.parse().unwrap()).collect();
    let of_cell = |id: u64, name| number(&cells, ids.binary_search(&id).unwrap(), name);
    let [x, y, z] = spacing;
    let face = (y * z + x * z + x * y) / 3.0;
    for wall in &walls {
        let [a, b] = wall.cells.map(|id| of_cell(id, "area"));
        let [c, d] = wall.cells.map(|id| of_cell(id, "wall_thickness"));
        let is_large = wall.area >= (5.0 * face).max(0.005 * a.min(b));
        let is_wall = wall.thickness <= 1.8 * c.max(d);
        assert_eq!(wall.neighbour, is_large && is_wall, "{wall:?}");
    }
    for (row, &id) in ids.iter().enumerate() {
        let open = (0..necks.rows.len())
            .map(|row| ["cell_a", "cell_b"].map(|name| number(&necks, row, name) as u64));
        let own = walls.iter().filter(|wall| wall.cells.contains(&id));
        let beside = own.clone().filter(|wall| wall.neighbour);
        let mut pairs: Vec<[u64; 2]> = open.filter(|pair| pair.contains(&id)).collect();
        pairs.extend(beside.map(|wall| wall.cells));
        pairs.sort_unstable();
        pairs.dedup();
        assert_eq!(
            number(&cells, row, "neighbours"),
            pairs.len() as f64,
            "{id}"
        );
        let mut own: Vec<&WallRow> = own.collect();
        own.sort_by(|a, b| a.thickness.total_cmp(&b.thickness));
        let whole: f64 = own.iter().map(|wall| wall.area).sum();
        let found = number(&cells, row, "wall_thickness");
        assert_eq!(found.is_nan(), own.is_empty());
        let below = |limit: f64| -> f64 {
            let thinner = own.iter().filter(|wall| wall.thickness < limit);
            thinner.map(|wall| wall.area).sum()
        };
        let slack = 1e-6 * whole;
        let upto = below(found * (1.0 + 1e-12)) + slack;
        assert!(own.is_empty() || 2.0 * below(found) <= whole + slack && 2.0 * upto >= whole);
    }
}

fn case() -> impl Strategy<Value = Case> {
    let dims = [3u32..15, 3..14, 3..13];
    (dims, any::<u64>(), 1usize..6, any::<bool>(), 2u64..9).prop_map(
        |(dims, seed, patch, anisotropic, share)| {
            let mut random = Random(seed);
            let grey = samples(dims, |_| {
                let (bits, low) = (random.bits(), random.bits() % 10 < share);
                if low { bits % 128 } else { 128 + bits % 128 }
            });
            let labels = samples(dims, |p| {
                let block = p.map(|v| u64::from(v) / patch as u64);
                let number = (block[2] * 16 + block[1]) * 16 + block[0];
                (Random(number ^ seed).bits() % 9) as u32
            });
            Case {
                dims,
                samples: grey.into_iter().map(|v| v as u8).collect(),
                labels,
                spacing: if anisotropic {
                    [0.5, 0.75, 1.25]
                } else {
                    [1.0; 3]
                },
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]
    #[test]
    fn walls_are_those_that_a_search_finds(case in case(), cube in [1u32..7, 1..7, 1..7], threads in 1usize..3) {
        prop_assume!(case.labels.iter().any(|&label| label > 0));
        let options = ConvertOptions {
            walls: true,
        labels: Some(given(case.dims, case.labels.clone())),
            threads,
            ..options(cube)
        };
        let grey = case.samples.clone();
        let grey: Box<dyn Volume> = match case.spacing == [1.0; 3] {
            true => Box::new(volume(case.dims, grey)),
            false => Box::new(placed(case.dims, grey)),
        };
        let (dir, _) = converted(&*grey, &options);
        case.check(dir.path());
        check_cells(dir.path(), case.spacing);
    }
}

/// A foam with holes in walls, whose cells are split.
fn leaky() -> ([u32; 3], Vec<u8>) {
    let foam = flat_foam([60, 52, 56], 10, 3.0, 6.0);
    let mut grey = foam.grey;
    let mut random = Random(3);
    for _ in 0..60 {
        let place = foam.dims.map(|n| random.bits() as i64 % i64::from(n));
        for (i, value) in grey.iter_mut().enumerate() {
            let [nx, ny, _] = foam.dims.map(|n| n as usize);
            let at = [i % nx, i / nx % ny, i / nx / ny].map(|v| v as i64);
            let square: i64 = (0..3).map(|a| (at[a] - place[a]).pow(2)).sum();
            if square < 7 {
                *value = 50;
            }
        }
    }
    (foam.dims, grey)
}

/// Walls are found in the least memory in which a conversion without them succeeds.
fn in_least_memory(volume: &dyn Volume, options: &ConvertOptions) {
    let mut without = ConvertOptions {
        split: None,
        walls: false,
        memory: 1,
        ..options.clone()
    };
    let out = tempfile::tempdir().unwrap();
    while let Err(error) = convert(volume, &without, &out.path().join("set"), &Quiet) {
        without.memory = match error {
            Error::Memory { needed, .. } | Error::TooDense { needed, .. } => needed,
            other => panic!("{other}"),
        };
        without.force = true;
    }
    let with = [without.memory, 1 << 30].map(|memory| ConvertOptions {
        walls: true,
        memory,
        ..without.clone()
    });
    let [a, b] = with.map(|options| wall_rows(converted(volume, &options).0.path()));
    assert!(a == b && !a.is_empty());
}

#[test]
fn walls_do_not_depend_on_how_a_volume_is_cut() {
    let (dims, grey) = leaky();
    let volume = placed(dims, grey);
    let options = ConvertOptions {
        walls: true,
        split: Some(NeckRule::default()),
        ..options([64; 3])
    };
    let (whole, report) = converted(&volume, &options);
    let text = |dir: &Path| std::fs::read_to_string(dir.join("walls.csv")).unwrap();
    let expected = text(whole.path());
    assert!(
        report.totals.walls > 20 && report.totals.necks > 0,
        "{:?}",
        report.totals
    );
    check_cells(whole.path(), [0.5, 0.75, 1.25]);
    for (macrocube, threads, memory) in [
        ([16; 3], 2, 1 << 30),
        ([13, 7, 5], 3, 64 << 20),
        ([32, 64, 1], 1, 1 << 30),
        ([64, 3, 64], 2, 1 << 28),
    ] {
        let other = ConvertOptions {
            threads,
            memory,
            ..options.clone()
        };
        let other = ConvertOptions { macrocube, ..other };
        let (dir, _) = converted(&volume, &other);
        assert!(text(dir.path()) == expected, "{macrocube:?}");
        for column in ["neighbours", "wall_thickness"] {
            let [a, b] = [whole.path(), dir.path()].map(|dir| table(dir, "cells.csv"));
            assert!(
                a.column(column).eq(b.column(column)),
                "{macrocube:?} {column}"
            );
        }
    }
    in_least_memory(&volume, &options);
    let to = tempfile::tempdir().unwrap();
    let form = Form {
        primitives: Primitives::Triangles,
        encoding: Encoding::Quantized,
        layout: Layout::Auto,
    };
    let options = RepackOptions { form, force: false };
    repack(whole.path(), &to.path().join("set"), &options, &Quiet).unwrap();
    assert!(text(&to.path().join("set")) == expected);
}

/// Cells of components have the walls of the same cells as labels, and all other tables are those without walls.
#[test]
fn walls_of_closed_cells_change_nothing_else() {
    let foam = flat_foam([50, 44, 40], 8, 4.0, 0.0);
    let grey = foam.grey;
    let volume = placed(foam.dims, grey.clone());
    let without = options([17, 20, 9]);
    let with = ConvertOptions {
        walls: true,
        parquet: true,
        ..without.clone()
    };
    let (plain, _) = converted(&volume, &without);
    let (walls, report) = converted(&volume, &with);
    let [mut before, mut after] = [&plain, &walls].map(|dir| files(dir.path()));
    assert_eq!(report.totals.walls, wall_rows(walls.path()).len() as u64);
    assert!(
        report.totals.walls > 8 && report.totals.cells == 8,
        "{:?}",
        report.totals
    );
    for name in [
        "cells.parquet",
        "objects.parquet",
        "surfaces.parquet",
        "walls.parquet",
        "walls.csv",
    ] {
        assert!(after.remove(name).is_some());
    }
    for all in [&mut before, &mut after] {
        assert!(all.remove("index.json").is_some() && all.remove("cells.csv").is_some());
    }
    assert_same_files(&after, &before, "walls");
    let [cells, more] = [&plain, &walls].map(|dir| table(dir.path(), "cells.csv"));
    assert_eq!(
        more.names[cells.names.len()..],
        ["neighbours", "wall_thickness"]
    );
    for (row, long) in cells.rows.iter().zip(&more.rows) {
        assert_eq!(row[..], long[..row.len()]);
    }
    // ids of components rise by their first voxels
    let mut id_of: BTreeMap<u32, u32> = BTreeMap::new();
    let label = |(&label, &value): (&u32, &u8)| {
        let next = id_of.len() as u32 + 1;
        if value < 128 {
            *id_of.entry(label).or_insert(next)
        } else {
            0
        }
    };
    let labels = foam.labels.iter().zip(&grey).map(label).collect();
    let of_labels = ConvertOptions {
        labels: Some(given(foam.dims, labels)),
        ..with
    };
    let (dir, _) = converted(&volume, &of_labels);
    assert_eq!(wall_rows(dir.path()), wall_rows(walls.path()));
    // a part keeps the walls between what it keeps
    let part = SelectOptions {
        chosen: Chosen::cells("id <= 4"),
        ..SelectOptions::default()
    };
    let to = tempfile::tempdir().unwrap();
    select(walls.path(), &to.path().join("part"), &part, &Quiet).unwrap();
    let mut expected = wall_rows(dir.path());
    expected.retain(|wall| wall.cells[1] <= 4);
    assert_eq!(wall_rows(&to.path().join("part")), expected);
    assert_eq!(
        manifest(&to.path().join("part")).totals.walls,
        expected.len() as u64
    );
}
