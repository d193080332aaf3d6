//! A broken tile set for each code.

use crate::cubes::Field;
use crate::edit::{self, Place, Set};
use crate::glb::{Piece, Tile};
use alvis::verify::Code;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;

/// Breaks a sound tile set (strips, open, several tiles along each axis) so that exactly `code` is
/// found. `field` is what the set was made from; it is changed where the volume is to differ.
pub fn break_it(code: Code, set: &Set, field: &mut Field) {
    let big = biggest(set);
    match code {
        Code::ManifestSyntax
        | Code::FormatVersion
        | Code::ManifestValue
        | Code::PathOutside
        | Code::PathName
        | Code::MissingFile
        | Code::ForeignFile
        | Code::FileSize
        | Code::Checksum
        | Code::ShardSyntax
        | Code::ShardValue
        | Code::TileCount
        | Code::TileBox
        | Code::TileEncoding
        | Code::ForeignMember
        | Code::Selection
        | Code::Dust
        | Code::TotalsMismatch => index(code, set, &big),
        Code::GlbContainer
        | Code::GltfSyntax
        | Code::GltfStructure
        | Code::GltfAccessor
        | Code::AccessorBounds
        | Code::PrimitiveMode
        | Code::RootMatrix
        | Code::NodeName
        | Code::NodeExtras
        | Code::CarriedMeasure
        | Code::GltfUnused
        | Code::Paint
        | Code::GroupMismatch => layout(code, set, &big),
        Code::SurfaceMixed
        | Code::SurfaceSplit
        | Code::PairRepeated
        | Code::IdGap
        | Code::IdOrder
        | Code::Law => surfaces(code, set),
        Code::TableSyntax | Code::TableRows | Code::TableValue => tables(code, set),
        Code::MeshoptBuffer => set.edit_json(&big, |doc| {
            let stream = &mut doc["bufferViews"][2]["extensions"]["EXT_meshopt_compression"];
            let bytes = stream["byteLength"].as_u64().unwrap();
            stream["byteLength"] = (bytes - 1).into();
        }),
        Code::Hole => set.drop_tile(&big),
        // what is said of the volume differs
        Code::SourceMismatch => {}
        Code::VolumeMismatch
        | Code::MissingVertex
        | Code::ExtraVertex
        | Code::VertexMisplaced
        | Code::TriangleCount
        | Code::BitsDiffer => volume(code, set, field),
        _ => set.put(&big, &geometry(code, set.tile(&big))),
    }
}

/// The tile with the most triangles.
pub fn biggest(set: &Set) -> Place {
    let triangles = |p: &Place| set.entry(p)["triangles"].as_u64();
    set.places().into_iter().max_by_key(triangles).unwrap()
}

fn index(code: Code, set: &Set, place: &Place) {
    match code {
        Code::ManifestSyntax => set.manifest(|m| m["totals"]["tiles"] = "many".into()),
        Code::FormatVersion => set.manifest(|m| m["format_version"] = 2.into()),
        Code::TileEncoding => set.manifest(|m| m["encoding"] = "quantized".into()),
        Code::ManifestValue => set.manifest(|m| m["grid"]["tiles"][1] = 7.into()),
        Code::PathOutside => set.edit_entry(place, |e| e["path"] = "../tile.glb".into()),
        Code::PathName => {
            let old = set.entry(place)["path"].as_str().unwrap().to_owned();
            let new = old.replace('y', "row");
            fs::rename(set.0.join(&old), set.0.join(&new)).unwrap();
            set.edit_entry(place, |e| e["path"] = new.into());
        }
        Code::MissingFile => fs::remove_file(set.file(place)).unwrap(),
        Code::ForeignFile => fs::write(set.0.join("tiles/z0000/.y0000_x0000.glb.tmp"), "").unwrap(),
        Code::FileSize => set.edit_entry(place, |e| e["bytes"] = 17.into()),
        Code::Checksum => set.edit_entry(place, |e| e["checksum"] = "crc32:00000000".into()),
        Code::ShardSyntax => {
            fs::write(&place.0, "{").unwrap();
            set.stamp();
        }
        Code::ShardValue => set.edit_entry(place, |e| e["grid"][0] = 99.into()),
        Code::ForeignMember => set.edit_entry(place, |e| e["groups"][0]["colour"] = 1.into()),
        Code::Selection => set.manifest(|m| {
            m["selection"] = selection(m);
            m["selection"]["where"] = "voxels > 1e9".into();
        }),
        // a ball has no dust
        Code::Dust => set.manifest(|m| {
            m["dust"] = json!({"min_voxels": 2, "objects": 1, "object_voxels": 1, "cells": 0,
                "cell_voxels": 0});
        }),
        Code::TileCount => set.edit_entry(place, |e| e["indices"] = 3000.into()),
        Code::TileBox => set.edit_entry(place, |e| e["box"]["min"][1] = 0.25.into()),
        _ => set.manifest(|m| {
            let euler = m["totals"]["euler_characteristic"].as_i64().unwrap();
            m["totals"]["euler_characteristic"] = (euler + 2).into();
        }),
    }
}

/// A selection of all cells.
fn selection(manifest: &Value) -> Value {
    let of = ["cells", "objects", "surfaces", "voxels_above"];
    let of = of.map(|name| (name.to_owned(), manifest["totals"][name].clone()));
    json!({"where": null, "omit": false, "painted": [], "colour_by": null,
        "of": serde_json::Map::from_iter(of)})
}

fn layout(code: Code, set: &Set, place: &Place) {
    let bytes = fs::read(set.file(place)).unwrap();
    match code {
        Code::GlbContainer => set.put_bytes(place, &bytes[..bytes.len() - 8]),
        Code::GltfSyntax => {
            let mut bytes = bytes;
            bytes[20] = b'[';
            set.put_bytes(place, &bytes);
        }
        Code::GltfStructure => set.edit_json(place, |j| j["scenes"][0]["nodes"] = json!([0, 1])),
        Code::GltfAccessor => {
            set.edit_json(place, |j| j["accessors"][0]["count"] = json!(1u64 << 62))
        }
        Code::AccessorBounds => set.edit_json(place, |j| j["accessors"][0]["max"][2] = json!(1e3)),
        Code::PrimitiveMode => {
            set.edit_json(place, |j| {
                j["meshes"][0]["primitives"][0]["mode"] = json!(4)
            });
        }
        Code::RootMatrix => set.edit_json(place, |j| j["nodes"][0]["matrix"][12] = json!(0.5)),
        Code::NodeName => set.edit_json(place, |j| j["nodes"][1]["name"] = json!("Cube.001")),
        Code::CarriedMeasure => {
            set.edit_json(place, |j| j["nodes"][1]["extras"]["volume"] = json!(77.5))
        }
        Code::GltfUnused => set.edit_json(place, |j| {
            let more = j["materials"][0].clone();
            j["materials"].as_array_mut().unwrap().push(more);
        }),
        Code::Paint => set.edit_json(place, |j| {
            j["materials"][0]["name"] = "colour_ff0000".into();
            j["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 1]);
        }),
        Code::NodeExtras => set.edit_json(place, |j| j["nodes"][1]["extras"]["area"] = json!([1])),
        _ => set.edit_json(place, |j| {
            let cell = j["nodes"][1]["extras"]["cell"].as_u64().unwrap() + 1;
            j["nodes"][1]["extras"]["cell"] = cell.into();
            let object = j["nodes"][1]["extras"]["object"].as_u64().unwrap();
            let name = json!(format!("cell_{cell}_object_{object}"));
            j["nodes"][1]["name"] = name.clone();
            j["meshes"][0]["name"] = name;
        }),
    }
}

fn surfaces(code: Code, set: &Set) {
    let all = set.surfaces();
    let ids: Vec<[u64; 3]> = all.keys().copied().collect();
    let last = *ids.last().unwrap();
    // surfaces of other cells and other objects, so that a change of ids keeps pairs apart
    let apart = |a: &[u64; 3], b: &[u64; 3]| a[1] != b[1] && a[2] != b[2];
    match code {
        Code::SurfaceMixed => {
            let wide = *all.iter().max_by_key(|(_, n)| **n).unwrap().0;
            let place = set
                .places()
                .into_iter()
                .find(|p| set.tile(p).pieces.iter().any(|q| edit::ids(q) == wide))
                .unwrap();
            set.edit_tile(&place, |t| {
                let piece = t.pieces.iter_mut().find(|q| edit::ids(q) == wide).unwrap();
                piece.extras["surface"] = last[0].into();
                if wide == last {
                    piece.extras["surface"] = ids[0][0].into();
                }
            });
        }
        Code::SurfaceSplit => set.relabel(last, [ids[0][0], last[1], last[2]]),
        Code::PairRepeated => {
            let other = ids.iter().find(|i| i[2] == last[2] && i[1] != last[1]);
            let other = other
                .or(ids.iter().find(|i| !apart(i, &last) && **i != last))
                .unwrap();
            set.relabel(last, [last[0], other[1], other[2]]);
        }
        Code::IdGap => set.relabel(last, [last[0] + 5, last[1], last[2]]),
        Code::IdOrder => {
            set.exchange_surfaces(ids[0], ids[1]);
        }
        _ => {
            let shared = |i: &&[u64; 3]| ids.iter().filter(|j| j[2] == i[2]).count() > 1;
            let one = *ids.iter().find(shared).unwrap();
            let objects = ids.iter().map(|i| i[2]).max().unwrap();
            set.relabel(one, [one[0], one[1], objects + 1]);
        }
    }
}

fn tables(code: Code, set: &Set) {
    let path = set.0.join("surfaces.csv");
    let text = fs::read_to_string(&path).unwrap();
    let new = match code {
        Code::TableSyntax => text.replacen("euler", "eulre", 1),
        Code::TableRows => text + "99,1,1,1,1,1,1,0,true,1\n",
        _ => {
            let mut lines: Vec<&str> = text.lines().collect();
            let mut fields: Vec<&str> = lines[2].split(',').collect();
            fields[3] = "12345";
            let row = fields.join(",");
            lines[2] = &row;
            lines.join("\n") + "\n"
        }
    };
    fs::write(path, new).unwrap();
    set.seal();
}

/// Breaks the piece with the most triangles.
fn geometry(code: Code, mut tile: Tile) -> Tile {
    let pieces = tile.pieces.iter_mut();
    let piece = pieces.max_by_key(|p| p.triangles.len()).unwrap();
    let n = piece.positions.len() as u32;
    let middle = piece.triangles.len() / 2;
    match code {
        Code::IndexType => tile.wide = true,
        Code::IndexRange => piece.triangles[middle][0] = n,
        Code::PositionNotFinite => piece.positions[3][1] = f32::NAN,
        Code::PositionOffLattice => piece.positions[3][1] += 1.0 / 1024.0,
        Code::PositionOutsideTile => piece.positions[3][1] += 100.0,
        Code::NormalInvalid => piece.normals[3] = [f32::NAN; 3],
        Code::NormalDiffers => piece.normals[3] = piece.normals[3].map(|c| -c),
        Code::DuplicateVertex => {
            let t = piece.triangles[middle];
            piece.positions.push(piece.positions[t[0] as usize]);
            piece.normals.push(piece.normals[t[0] as usize]);
            // the vertex's other triangles keep the old one, so the place occurs twice
            piece.triangles[middle][0] = n;
        }
        Code::UnusedVertex => {
            piece.positions.push(free_edge(&tile_edges(piece), piece));
            piece.normals.push([1.0, 0.0, 0.0]);
        }
        Code::DegenerateTriangle => unreachable!("needs a list of triangles"),
        Code::TriangleOutsideCube => {
            let here = piece.positions[piece.triangles[middle][0] as usize];
            let far = |p: &[f32; 3]| (0..3).any(|a| (p[a] - here[a]).abs() > 2.0);
            let other = piece.positions.iter().position(far).unwrap();
            piece.triangles[middle][1] = other as u32;
        }
        Code::DuplicateTriangle => piece.triangles.push(piece.triangles[middle]),
        Code::FlippedTriangle => piece.triangles[middle].swap(0, 1),
        Code::EdgeRepeated => unreachable!("is searched for"),
        _ => panic!("no fixture for {}", code.name()),
    }
    tile
}

/// The lattice edges that have a vertex: the lower point and the axis.
fn tile_edges(piece: &Piece) -> BTreeSet<([i32; 3], usize)> {
    let edge = |p: &[f32; 3]| {
        let axis = (0..3).find(|&a| p[a].fract() != 0.0).unwrap();
        (p.map(|c| c.floor() as i32), axis)
    };
    piece.positions.iter().map(edge).collect()
}

/// A place on a lattice edge without a vertex, beside the piece's first vertex.
fn free_edge(used: &BTreeSet<([i32; 3], usize)>, piece: &Piece) -> [f32; 3] {
    for p in &piece.positions {
        let at = p.map(|c| c.floor() as i32);
        for axis in 0..3 {
            // stay between the first and the last vertex along the axis, and so in the tile
            let inside = piece
                .positions
                .iter()
                .any(|q| q[axis] >= at[axis] as f32 + 1.0);
            if inside && !used.contains(&(at, axis)) {
                let mut out = at.map(|c| c as f32);
                out[axis] += 0.5;
                return out;
            }
        }
    }
    panic!("all edges have a vertex");
}

/// Tiles with one more triangle, on an edge that may have two already.
pub fn third_triangles(tile: &Tile) -> Vec<Tile> {
    let (at, piece) = tile
        .pieces
        .iter()
        .enumerate()
        .max_by_key(|(_, p)| p.triangles.len())
        .unwrap();
    let mut out = Vec::new();
    for t in &piece.triangles {
        for c in 0..piece.positions.len() as u32 {
            let mut changed = tile.clone();
            let [a, b, d] = *t;
            let near = |i: u32| {
                let [p, q] = [i, c].map(|i| piece.positions[i as usize]);
                (0..3).all(|a| (p[a].floor() - q[a].floor()).abs() <= 1.0)
            };
            if c != a && c != b && c != d && near(a) && near(b) {
                changed.pieces[at].triangles.push([a, b, c]);
                out.push(changed);
            }
        }
    }
    out
}

fn volume(code: Code, set: &Set, field: &mut Field) {
    let [nx, ny, _] = field.dims;
    // the field has an island of one voxel, and room for another one
    let island = 2 + nx * (2 + ny * 2);
    let room = 6 + nx * (2 + ny * 2);
    match code {
        Code::VolumeMismatch => {
            field.dims.swap(0, 1);
        }
        Code::MissingVertex => field.values[room] = 1.0,
        Code::ExtraVertex => field.values[island] = 0.0,
        Code::VertexMisplaced => field.values[island] = 0.8,
        Code::BitsDiffer => field.values.iter_mut().for_each(|v| *v = 1.0 - *v),
        _ => set.manifest(|m| m["ambiguous"] = "join".into()),
    }
}
