//! A simple and slow producer of tile sets for tests.

use crate::bodies::{Body, HEADER};
use crate::cubes::{Field, Key, Table, cross, cube};
use crate::glb::{Piece, Tile, crc32, write_json};
use alvis::grid::{Ambiguous, Placement, Unit};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// How to write a tile set.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    pub macrocube: [usize; 3],
    pub rule: Ambiguous,
    pub cap: bool,
    pub strips: bool,
}

pub const SPACING: [f64; 3] = [0.5, 0.75, 1.25];

type Pieces = BTreeMap<(u64, u64), Vec<[Key; 3]>>;

struct Set<'a> {
    field: &'a Field,
    style: &'a Style,
    tiles: BTreeMap<[usize; 3], Pieces>,
    /// Surface ids by (cell, object).
    surfaces: BTreeMap<(u64, u64), u64>,
    labels: [Vec<u64>; 2],
    matrix: Vec<f64>,
}

/// Writes the tile set of a field.
pub fn write(dir: &Path, field: &Field, style: &Style) {
    let labels = [
        field.label(false, style.rule == Ambiguous::Separate),
        field.label(true, style.rule == Ambiguous::Join),
    ];
    let place = Placement {
        spacing: SPACING,
        unit: Unit::Millimetre,
        ..Placement::default()
    };
    let mut set = Set {
        field,
        style,
        tiles: triangulate(field, style, &labels),
        surfaces: BTreeMap::new(),
        labels,
        matrix: place.gltf_matrix().to_vec(),
    };
    let mut first: BTreeMap<(u64, u64), [i32; 4]> = BTreeMap::new();
    for (pair, triangles) in set.tiles.values().flatten().filter(|(p, _)| p.0 != 0) {
        let keys = triangles.iter().flatten().map(|k| first_edge(*k));
        let own = first.entry(*pair).or_insert([i32::MAX; 4]);
        *own = keys.fold(*own, |least, key| least.min(key));
    }
    let mut pairs: Vec<_> = first.into_iter().collect();
    pairs.sort_by_key(|(_, place)| *place);
    let ids = pairs.iter().map(|(pair, _)| *pair).zip(1..);
    set.surfaces = ids.collect();
    set.write(dir);
}

/// By what surfaces are numbered: the lattice edge of their first vertex, by z, y, x, then axis.
fn first_edge(key: Key) -> [i32; 4] {
    let axis = (0..3).find(|&a| key[a] & 255 != 0).unwrap();
    [key[2] >> 8, key[1] >> 8, key[0] >> 8, axis as i32]
}

fn triangulate(
    field: &Field,
    style: &Style,
    labels: &[Vec<u64>; 2],
) -> BTreeMap<[usize; 3], Pieces> {
    let table = Table::new(style.rule);
    let mut tiles: BTreeMap<[usize; 3], Pieces> = BTreeMap::new();
    let n = field.dims.map(|n| n as i64);
    let range = |a: usize| if style.cap { -1..n[a] } else { 0..n[a] - 1 };
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let at = [x, y, z];
                // padding cubes belong to the nearest macrocube; sorted by z, y, x
                let home = |a: usize| at[a].clamp(0, n[a] - 2) as usize / style.macrocube[a];
                for t in cube(field, &table, labels, at) {
                    let tile = tiles.entry([home(2), home(1), home(0)]).or_default();
                    tile.entry((t.cell, t.object)).or_default().push(t.keys);
                }
            }
        }
    }
    tiles
}

fn volume6(t: &[Key; 3]) -> i128 {
    let n = cross(t);
    (0..3).map(|a| i128::from(t[0][a]) * i128::from(n[a])).sum()
}

fn area(t: &[Key; 3]) -> f64 {
    let s = SPACING.map(|s| s / 256.0);
    let n = cross(t);
    let v = [s[1] * s[2], s[2] * s[0], s[0] * s[1]];
    (0..3)
        .map(|a| (n[a] as f64 * v[a]).powi(2))
        .sum::<f64>()
        .sqrt()
        / 2.0
}

/// Vertices, edges that have no reverse, and V - E + F.
fn topology(triangles: &[[Key; 3]]) -> (u64, u64, i64) {
    let vertices: BTreeSet<Key> = triangles.iter().flatten().copied().collect();
    let directed: BTreeSet<(Key, Key)> = triangles
        .iter()
        .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
        .collect();
    let open = directed
        .iter()
        .filter(|(a, b)| !directed.contains(&(*b, *a)))
        .count();
    let edges = (directed.len() + open) / 2;
    let euler = vertices.len() as i64 - edges as i64 + triangles.len() as i64;
    (vertices.len() as u64, open as u64, euler)
}

impl Set<'_> {
    fn write(&self, dir: &Path) {
        fs::create_dir_all(dir.join("index")).unwrap();
        let [mut strips, mut strip_indices, mut bytes, mut tile_vertices] = [0u64; 4];
        let mut layers = Vec::new();
        let zs: BTreeSet<usize> = self.tiles.keys().map(|t| t[0]).collect();
        for z in zs {
            fs::create_dir_all(dir.join(format!("tiles/z{z:04}"))).unwrap();
            let mut entries = Vec::new();
            for (grid, pieces) in self.tiles.range([z, 0, 0]..[z + 1, 0, 0]) {
                let tile = self.tile(pieces);
                let entry = write_tile(dir, [grid[2], grid[1], grid[0]], &tile);
                strips += entry["strips"].as_u64().unwrap();
                strip_indices += entry["indices"].as_u64().unwrap();
                bytes += entry["bytes"].as_u64().unwrap();
                tile_vertices += entry["vertices"].as_u64().unwrap();
                entries.push(entry);
            }
            let path = format!("index/z{z:04}.json");
            let shard = json!({"z": z, "tiles": entries}).to_string();
            layers.push(
                json!({"z": z, "path": path, "tiles": entries.len(), "bytes": shard.len(),
                "checksum": crc32(shard.as_bytes())}),
            );
            fs::write(dir.join(path), shard).unwrap();
        }
        let mut totals = self.totals();
        totals["strips"] = strips.into();
        totals["strip_indices"] = if self.style.strips { strip_indices } else { 0 }.into();
        totals["bytes"] = bytes.into();
        totals["tile_vertices"] = tile_vertices.into();
        self.manifest(dir, totals, layers);
        self.tables(dir);
        crate::seal::seal(dir);
    }

    fn tile(&self, pieces: &Pieces) -> Tile {
        let piece = |(&(cell, object), triangles): (&(u64, u64), &Vec<[Key; 3]>)| {
            let mut index: BTreeMap<Key, u32> = BTreeMap::new();
            let mut keys = Vec::new();
            let mut number = |k: Key| {
                *index.entry(k).or_insert_with(|| {
                    keys.push(k);
                    keys.len() as u32 - 1
                })
            };
            let triangles: Vec<_> = triangles.iter().map(|t| t.map(&mut number)).collect();
            let several = self.surfaces.range((cell, 0)..(cell + 1, 0)).count() > 1;
            let name = match (cell, several) {
                (0, _) => format!("cap_object_{object}"),
                (_, false) => format!("cell_{cell}"),
                (_, true) => format!("cell_{cell}_object_{object}"),
            };
            let surface = self.surfaces.get(&(cell, object)).copied().unwrap_or(0);
            let mut extras = json!({"cell": cell, "object": object, "surface": surface,
                "triangles": triangles.len()});
            if cell != 0 {
                extras.as_object_mut().unwrap().extend(self.carried(cell));
            }
            Piece {
                name,
                extras,
                positions: keys.iter().map(|k| k.map(|c| c as f32 / 256.0)).collect(),
                normals: keys.iter().map(|k| self.field.normal(*k)).collect(),
                triangles,
            }
        };
        Tile {
            matrix: json!(self.matrix),
            mode: if self.style.strips { 5 } else { 4 },
            wide: false,
            pieces: pieces.iter().map(piece).collect(),
        }
    }

    fn all(&self, wanted: impl Fn(u64, u64) -> bool) -> Vec<[Key; 3]> {
        let pieces = self.tiles.values().flatten();
        pieces
            .filter(|(k, _)| wanted(k.0, k.1))
            .flat_map(|(_, t)| t.iter().copied())
            .collect()
    }

    fn totals(&self) -> Value {
        let all = self.all(|_, _| true);
        let (vertices, open, euler) = topology(&all);
        let above = self.labels[1].iter().filter(|l| **l > 0).count();
        json!({
            "tiles": self.tiles.len(), "triangles": all.len(), "vertices": vertices,
            "objects": self.labels[1].iter().max(), "cells": self.labels[0].iter().max(),
            "surfaces": self.surfaces.len(), "border_edges": open, "euler_characteristic": euler,
            "cap_triangles": self.all(|c, _| c == 0).len(), "voxels_above": above,
            "voxels_nan": self.field.values.iter().filter(|v| v.is_nan()).count(),
            "volume6": all.iter().map(volume6).sum::<i128>().to_string(),
        })
    }

    fn manifest(&self, dir: &Path, totals: Value, layers: Vec<Value>) {
        let dims = self.field.dims;
        let m = self.style.macrocube;
        let tiles: Vec<usize> = (0..3).map(|a| (dims[a] - 1).div_ceil(m[a])).collect();
        let rule = if self.style.rule == Ambiguous::Join {
            "join"
        } else {
            "separate"
        };
        let kind = if self.style.strips {
            "strips"
        } else {
            "triangles"
        };
        let manifest = json!({
            "format": "alvis-tiles", "format_version": 1,
            "generator": {"name": "tests", "version": "0"},
            "source": {"name": "field.raw", "format": "raw", "dims": dims, "dtype": "f32",
                "endian": "little", "offset": 0,
                "provenance": {"spacing": ["option", "option", "option"], "unit": "option", "origin": "default"}},
            "grid": {"dims": dims, "macrocube": m, "tiles": tiles},
            "spacing": SPACING, "unit": "mm", "origin": [0.0, 0.0, 0.0],
            "directions": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "threshold": self.field.threshold, "ambiguous": rule, "cap": self.style.cap,
            "primitives": kind, "encoding": "float", "layout": "auto", "lattice": 256, "transform": self.matrix, "totals": totals,
            "layers": layers,
            "tables": {"cells": "cells.csv", "objects": "objects.csv", "surfaces": "surfaces.csv",
                "checksums": {"cells": "", "objects": "", "surfaces": ""}},
            "checksum": "",
        });
        write_json(&dir.join("index.json"), &manifest);
    }

    /// A cell (phase 0) or an object.
    fn body(&self, phase: usize, id: u64) -> Body {
        let own = |c: u64, o: u64| c != 0 && [c, o][phase] == id;
        let triangles = self.all(own);
        let [nx, ny, _] = self.field.dims;
        let place = |i: usize| [i % nx, i / nx % ny, i / nx / ny].map(|c| c as i64);
        let six = triangles.iter().map(volume6).sum::<i128>() as f64;
        let sign = if phase == 0 { -1.0 } else { 1.0 };
        let cube = SPACING.iter().product::<f64>();
        let voxels = (0..self.labels[phase].len()).filter(|&i| self.labels[phase][i] == id);
        Body {
            voxels: voxels.map(place).collect(),
            dims: self.field.dims,
            mesh_volume: sign * six / 6.0 / f64::from(1 << 24) * cube,
            area: triangles.iter().map(area).sum(),
            tiles: self
                .tiles
                .values()
                .filter(|p| p.keys().any(|k| own(k.0, k.1)))
                .count(),
            by_edges: (phase == 0) == (self.style.rule == Ambiguous::Separate),
        }
    }

    /// The measures that tiles carry, as JSON.
    fn carried(&self, cell: u64) -> serde_json::Map<String, Value> {
        const NAMES: [&str; 11] = [
            "voxels",
            "volume",
            "mesh_volume",
            "area",
            "equivalent_diameter",
            "sphericity",
            "form_factor",
            "elongation",
            "flatness",
            "euler_characteristic",
            "touches_border",
        ];
        let row = self.body(0, cell).row(cell);
        let mut out = serde_json::Map::new();
        out.insert("unit".into(), "mm".into());
        for (title, value) in HEADER.split(',').zip(row) {
            let name = title.split(' ').next().unwrap();
            if NAMES.contains(&name) && !value.is_empty() {
                out.insert(name.into(), value.parse::<f64>().unwrap().into());
            }
        }
        out
    }

    fn tables(&self, dir: &Path) {
        for (phase, name) in [(0, "cells"), (1, "objects")] {
            let mut out = format!("{HEADER}\n");
            for id in 1..=self.labels[phase].iter().max().copied().unwrap_or(0) {
                out += &format!("{}\n", self.body(phase, id).row(id).join(","));
            }
            fs::write(dir.join(format!("{name}.csv")), out).unwrap();
        }
        let mut out = String::from(
            "id,cell,object,triangles,vertices,area [mm^2],euler_characteristic,border_edges,\
             touches_border,tiles\n",
        );
        let mut surfaces: Vec<_> = self.surfaces.iter().collect();
        surfaces.sort_by_key(|(_, id)| **id);
        for (&(cell, object), id) in surfaces {
            let triangles = self.all(|c, o| (c, o) == (cell, object));
            let (vertices, open, euler) = topology(&triangles);
            let area: f64 = triangles.iter().map(area).sum();
            let n = triangles.len();
            let tiles = self
                .tiles
                .values()
                .filter(|p| p.contains_key(&(cell, object)))
                .count();
            out += &format!(
                "{id},{cell},{object},{n},{vertices},{area},{euler},{open},{},{tiles}\n",
                u8::from(open > 0)
            );
        }
        fs::write(dir.join("surfaces.csv"), out).unwrap();
    }
}

/// Writes a tile and returns its entry for the shard.
pub fn write_tile(dir: &Path, grid: [usize; 3], tile: &Tile) -> Value {
    let (glb, strips, indices) = tile.encode();
    let path = format!("tiles/z{:04}/y{:04}_x{:04}.glb", grid[2], grid[1], grid[0]);
    fs::write(dir.join(&path), &glb).unwrap();
    let points = || tile.pieces.iter().flat_map(|p| &p.positions);
    let bound = |pick: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
        (0..3)
            .map(|a| points().map(|p| p[a]).fold(start, pick))
            .collect()
    };
    let group = |p: &Piece| {
        json!({"cell": p.extras["cell"], "object": p.extras["object"], "surface": p.extras["surface"],
            "vertices": p.positions.len(), "triangles": p.triangles.len()})
    };
    json!({
        "path": path, "grid": grid,
        "box": {"min": bound(f32::min, f32::INFINITY), "max": bound(f32::max, f32::NEG_INFINITY)},
        "vertices": points().count(), "strips": strips, "indices": indices,
        "triangles": tile.pieces.iter().map(|p| p.triangles.len()).sum::<usize>(),
        "bytes": glb.len(), "checksum": crc32(&glb),
        "groups": tile.pieces.iter().map(group).collect::<Vec<_>>(),
    })
}
