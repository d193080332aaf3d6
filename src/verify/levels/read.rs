//! What the files of a node and of those below it hold, each decoded once.

use super::Set;
use super::borders::{Edge, Planes, Point, Sums};
use super::entries::Family;
use crate::grid::LATTICE;
use crate::manifest::{Level, NodeEntry, node_shard_path};
use crate::sys::direct_io::Buffer;
use crate::tile::node::{SurfacePart, parts_of_pieces};
use crate::tile::read::{PieceIds, Tile};
use crate::tile::{NodeMesh, SurfacePiece, TileMesh};
use crate::verify::code::Code;
use crate::verify::files::{self, Expected};
use crate::verify::layout::joints;
use crate::verify::report::Issues;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// What a node's file holds, as whole numbers.
pub(super) struct Node {
    pub pieces: Vec<Part>,
    pub fins: Vec<Part>,
    pub bounds: [Point; 2],
    /// Its surfaces as they are when a node is made of them; `None` if a vertex is not where one can be.
    pub surfaces: Option<Vec<SurfacePart>>,
}

/// A row of a node.
pub(super) struct Part {
    /// Cell, object and surface.
    pub ids: [u64; 3],
    /// What it states of its cell.
    pub measures: Map<String, Value>,
    pub triangles: Vec<[Point; 3]>,
}

/// What the children of a node hold.
pub(super) struct Lower {
    /// What is stated of each cell, object and surface, by the first that has them.
    pub measures: BTreeMap<[u64; 3], Map<String, Value>>,
    /// Surfaces child by child, as they are when a node is made.
    pub surfaces: Vec<Vec<SurfacePart>>,
}

impl Lower {
    /// The edges in planes between nodes that it leaves open.
    pub fn open(&self, planes: &Planes, capped: bool) -> Vec<Edge> {
        let mut sums = Sums::default();
        for part in self.surfaces.iter().flatten() {
            let surface = surface_key(part.extras.surface, capped);
            for t in &part.triangles {
                let corners = t.map(|v| part.points[v as usize]);
                sums.add(surface, corners, |ends| planes.share(ends));
            }
        }
        sums.open().into_iter().map(|(edge, _)| edge).collect()
    }
}

/// Reads the nodes of a level, and what lies below them.
pub(super) struct Reader<'a> {
    pub set: &'a Set<'a>,
    pub level: &'a Level,
    /// Tiles lie below.
    pub over_tiles: bool,
    pub bytes: Buffer,
}

impl Reader<'_> {
    /// Reads a node and compares it with its entry; `None` if it cannot be looked at further.
    pub fn node(&mut self, entry: &NodeEntry, issues: &mut Issues) -> Option<Node> {
        let shard = node_shard_path(self.level.level, entry.grid[2]);
        let expected = Expected {
            path: &entry.path,
            bytes: entry.bytes,
            checksum: &entry.checksum,
            at: &shard,
        };
        if !files::fetch(self.set.root, &expected, &mut self.bytes, issues) {
            return None;
        }
        files::compare(&expected, self.bytes.get(), issues);
        let wrong = |message: String, issues: &mut Issues| -> Option<Node> {
            issues.add(Code::LodNode, &entry.path, message);
            None
        };
        let read = Tile::read_node(self.bytes.get())
            .and_then(|tile| NodeMesh::of(&tile).map(|mesh| (tile, mesh)));
        let (tile, mesh) = match read {
            Ok(read) => read,
            Err(e) => return wrong(e.to_string(), issues),
        };
        let count = |pieces: &[SurfacePiece]| pieces.iter().map(|p| p.triangles.len() as u64).sum();
        let all = || mesh.pieces.iter().chain(&mesh.fins);
        let [indices, strips] = indices_and_strips(&tile);
        let found: [u64; 6] = [
            count(&mesh.pieces),
            count(&mesh.fins),
            mesh.fins.len() as u64,
            all().map(|p| p.positions.len() as u64).sum(),
            indices,
            strips,
        ];
        let stated = [
            entry.triangles,
            entry.fin_triangles,
            entry.fin_rows.into(),
            entry.vertices,
            entry.indices,
            entry.strips,
        ];
        let said = (mesh.level, mesh.error, mesh.matrix);
        let expected = (self.level.level, entry.error, self.set.manifest.transform);
        if found != stated || said != expected {
            // what its triangles say can be looked at all the same
            let message = format!(
                "found level {} with error {} and {found:?} triangles, fin triangles, fin rows, vertices, indices and strips, \
                 expected level {} with error {} and {stated:?}, and the transform of the set",
                said.0, said.1, expected.0, expected.1
            );
            wrong(message, issues);
        }
        if found[0] == 0 {
            wrong("found no triangle of a surface".to_owned(), issues);
        }
        if let Some(p) = all().find(|p| p.ids.triangles != p.triangles.len() as u64) {
            let message = format!("a row of surface {} states other triangles", p.ids.surface);
            wrong(message, issues);
        }
        match self.whole(&tile, mesh) {
            Ok(node) => Some(node),
            Err(message) => wrong(message, issues),
        }
    }

    /// The same in whole numbers.
    fn whole(&self, tile: &Tile, mesh: NodeMesh) -> Result<Node, String> {
        let step = self.level.step as i32;
        let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        for p in mesh
            .pieces
            .iter()
            .chain(&mesh.fins)
            .flat_map(|p| &p.positions)
        {
            let point = lattice(*p);
            if point.iter().any(|v| v.rem_euclid(step) != 0) {
                return Err(format!(
                    "a vertex at {p:?} is on no multiple of {step} lattice steps"
                ));
            }
            for a in 0..3 {
                bounds[0][a] = bounds[0][a].min(point[a]);
                bounds[1][a] = bounds[1][a].max(point[a]);
            }
        }
        let normals = mesh.pieces.iter().flat_map(|p| &p.normals);
        let length = |n: &[f32; 3]| n.iter().map(|c| c * c).sum::<f32>();
        if normals
            .clone()
            .any(|n| !((0.98..=1.02).contains(&length(n))))
        {
            return Err("a normal is not of unit length".to_owned());
        }
        Ok(Node {
            pieces: mesh.pieces.iter().map(part).collect(),
            fins: mesh.fins.iter().map(part).collect(),
            bounds,
            surfaces: parts_of_pieces(tile, mesh.pieces).ok(),
        })
    }

    /// Reads what lies below a node; `None` if it cannot be read, which has been reported before.
    pub fn below(&mut self, family: &Family) -> Option<Lower> {
        debug_assert_eq!(self.over_tiles, family.below.is_tiles());
        let mut lower = Lower {
            measures: BTreeMap::new(),
            surfaces: Vec::with_capacity(family.children.len()),
        };
        for child in &family.children {
            let expected = Expected {
                path: &child.path,
                bytes: child.bytes,
                checksum: &child.checksum,
                at: "",
            };
            let mut quiet = Issues::new(1);
            if !files::fetch(self.set.root, &expected, &mut self.bytes, &mut quiet) {
                return None;
            }
            let bytes = self.bytes.get();
            let tile = match self.over_tiles {
                true => Tile::read(bytes),
                false => Tile::read_node(bytes),
            };
            let tile = tile.ok()?;
            let pieces = match self.over_tiles {
                true => TileMesh::of(&tile).ok()?.pieces,
                false => NodeMesh::of(&tile).ok()?.pieces,
            };
            for piece in &pieces {
                let known = lower.measures.entry(ids(&piece.ids));
                known.or_insert_with(|| measures(&piece.extras));
            }
            lower.surfaces.push(parts_of_pieces(&tile, pieces).ok()?);
        }
        Some(lower)
    }
}

/// Cell, object and surface.
fn ids(ids: &PieceIds) -> [u64; 3] {
    [ids.cell, ids.object, ids.surface]
}

/// Measures alone.
fn measures(extras: &Map<String, Value>) -> Map<String, Value> {
    let mut measures = extras.clone();
    measures.remove("triangles");
    measures
}

/// How many entries the indices of a node's file have, and strips that are stitched in them.
fn indices_and_strips(tile: &Tile) -> [u64; 2] {
    let (mut counts, mut indices) = ([0; 2], Vec::new());
    for primitive in &tile.primitives {
        indices.clear();
        primitive.indices.read_into(&mut indices);
        counts[0] += indices.len() as u64;
        counts[1] += 1 + joints(&indices).0;
    }
    counts
}

/// What tells a surface where edges are matched: with caps, which close all of them, there is one.
pub(super) fn surface_key(surface: u64, capped: bool) -> u64 {
    if capped { 0 } else { surface }
}

fn lattice(p: [f32; 3]) -> Point {
    p.map(|v| (v * LATTICE as f32) as i32)
}

fn part(piece: &SurfacePiece) -> Part {
    let corners = |t: &[u32; 3]| t.map(|v| lattice(piece.positions[v as usize]));
    Part {
        ids: ids(&piece.ids),
        measures: measures(&piece.extras),
        triangles: piece.triangles.iter().map(corners).collect(),
    }
}
