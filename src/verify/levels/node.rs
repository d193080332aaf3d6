//! One node, with what lies below it.

use super::Set;
use super::borders::{Borders, Edge, Planes, Point, Sums};
use super::entries::{Child, Family};
use super::error::check_error;
use super::fins::Fins;
use crate::grid::LATTICE;
use crate::lod::NodePlace;
use crate::manifest::{Level, NodeEntry};
use crate::sys::direct_io::Buffer;
use crate::tile::node::{SurfacePart, parts_of_node, parts_of_tile};
use crate::tile::read::{PieceIds, ReadError, Tile};
use crate::tile::{NodeMesh, SurfacePiece, TileMesh};
use crate::verify::code::Code;
use crate::verify::files::{self, Expected};
use crate::verify::layout::joints;
use crate::verify::report::{Issue, Issues};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Checks the nodes of a level and adds them up.
pub(super) struct Checker<'a> {
    set: &'a Set<'a>,
    level: &'a Level,
    over_tiles: bool,
    sums: [u64; 6],
    most: [f64; 3],
    cells: BTreeSet<u64>,
    bytes: Buffer,
}

/// What a node's file holds, as whole numbers.
struct Node {
    pieces: Vec<Part>,
    fins: Vec<Part>,
    bounds: [Point; 2],
}

/// What the children of a node hold, child by child: as whole numbers, and as it is when a node is made.
struct Lower {
    parts: Vec<Vec<Part>>,
    surfaces: Vec<Vec<SurfacePart>>,
}

struct Part {
    ids: [u64; 3],
    extras: Map<String, Value>,
    triangles: Vec<[Point; 3]>,
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

impl<'a> Checker<'a> {
    pub fn new(set: &'a Set<'a>, level: &'a Level, over_tiles: bool) -> Self {
        Checker {
            set,
            level,
            over_tiles,
            sums: [0; 6],
            most: [0.0; 3],
            cells: BTreeSet::new(),
            bytes: Buffer::default(),
        }
    }

    /// Checks a node against its entry and what lies below it, and hands its open edges to `borders`.
    pub fn check(
        &mut self,
        entry: &NodeEntry,
        family: &Family,
        borders: &mut Borders,
        issues: &mut Issues,
    ) {
        self.add(entry);
        if family.children.is_empty() {
            issues.add(
                Code::LodTree,
                &entry.path,
                "found a node that stands for nothing",
            );
            return;
        }
        let Some(node) = self.read(entry, issues) else {
            borders.lack_some();
            return;
        };
        self.check_entry(entry, &node, family, issues);
        let planes = Planes::of(self.set.tiling, self.level.level, entry.grid);
        let open = self.check_edges(entry, &node, &planes, borders, issues);
        let own = parts_of_node(self.bytes.get()).ok();
        let Some(Lower {
            parts: below,
            surfaces,
        }) = self.below(family)
        else {
            return;
        };
        check_ids(entry, &node, &below, issues);
        if let Some(own) = own {
            let place = NodePlace {
                tiling: self.set.tiling,
                level: self.level.level,
                place: entry.grid,
                block: self.level.block,
            };
            check_error(entry, &place, family, (&own, surfaces), issues);
        }
        let covered = Covered {
            entry,
            planes: &planes,
            step: self.level.step as i32,
            capped: self.set.manifest.cap,
        };
        covered.check(&node, &open, &below, issues);
    }

    fn add(&mut self, e: &NodeEntry) {
        let values = [
            1,
            e.triangles,
            e.fin_triangles,
            e.vertices,
            e.border_edges,
            e.bytes,
        ];
        for (sum, value) in self.sums.iter_mut().zip(values) {
            *sum = sum.saturating_add(value);
        }
        for (most, value) in self
            .most
            .iter_mut()
            .zip([e.error, e.curve_gap, e.fin_width])
        {
            *most = most.max(value);
        }
    }

    /// Reads a node and compares it with its entry.
    fn read(&mut self, entry: &NodeEntry, issues: &mut Issues) -> Option<Node> {
        let shard = format!("lod/{}/z{:04}.json", self.level.level, entry.grid[2]);
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
        let mesh = match NodeMesh::read(self.bytes.get()) {
            Ok(mesh) => mesh,
            Err(e) => return wrong(e.to_string(), issues),
        };
        let count = |pieces: &[SurfacePiece]| pieces.iter().map(|p| p.triangles.len() as u64).sum();
        let all = || mesh.pieces.iter().chain(&mesh.fins);
        let [indices, strips] = match indices_and_strips(self.bytes.get()) {
            Ok(counts) => counts,
            Err(e) => return wrong(e.to_string(), issues),
        };
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
        match self.whole(mesh) {
            Ok(node) => Some(node),
            Err(message) => wrong(message, issues),
        }
    }

    /// The same in whole numbers.
    fn whole(&self, mesh: NodeMesh) -> Result<Node, String> {
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
            pieces: mesh.pieces.into_iter().map(part).collect(),
            fins: mesh.fins.into_iter().map(part).collect(),
            bounds,
        })
    }

    /// Compares box, error and width with those of the children.
    fn check_entry(&self, e: &NodeEntry, node: &Node, family: &Family, issues: &mut Issues) {
        let voxels = |p: Point| p.map(|v| f64::from(v) / f64::from(LATTICE));
        let mut all = node.bounds.map(voxels);
        for child in &family.children {
            for a in 0..3 {
                all[0][a] = all[0][a].min(child.bounds.min[a]);
                all[1][a] = all[1][a].max(child.bounds.max[a]);
            }
        }
        if [e.bounds.min, e.bounds.max] != all {
            let message = format!(
                "found the box {:?} to {:?}, expected {:?} to {:?} by its vertices and the nodes below",
                e.bounds.min, e.bounds.max, all[0], all[1]
            );
            issues.add(Code::LodBox, &e.path, message);
        }
        let most = |of: fn(&Child) -> f64| family.children.iter().map(of).fold(0.0, f64::max);
        let below = most(|c| c.error);
        if !(e.error > below && e.error.is_finite()) {
            let message = format!(
                "found {}, expected more than {below} of a node below",
                e.error
            );
            issues.add(Code::LodError, &e.path, message);
        }
        let width = e.curve_gap + most(|c| c.fin_width);
        if e.fin_width != width || e.curve_gap < 0.0 {
            let message = format!(
                "found {}, expected {width}: how far the border has moved here and below",
                e.fin_width
            );
            issues.add(Code::LodFins, format!("{}: fin_width", e.path), message);
        }
    }

    /// Finds the edges that the node leaves open, and hands on those that others must have.
    fn check_edges(
        &mut self,
        entry: &NodeEntry,
        node: &Node,
        planes: &Planes,
        borders: &mut Borders,
        issues: &mut Issues,
    ) -> Vec<(Edge, i32)> {
        let mut sums = Sums::default();
        for piece in &node.pieces {
            if piece.ids[0] > 0 {
                self.cells.insert(piece.ids[0]);
            }
            let surface = surface_key(piece, self.set.manifest.cap);
            for t in &piece.triangles {
                if t[0] == t[1] || t[1] == t[2] || t[0] == t[2] {
                    let message = "found a triangle with two corners at one place".to_owned();
                    issues.push(Issue::new(Code::LodNode, &entry.path, message).at(t[0]));
                    continue;
                }
                sums.add(surface, *t, |_| true);
            }
        }
        let open = sums.open();
        for (edge, sum) in &open {
            if planes.share(&edge.ends) {
                borders.add(*edge, *sum, &entry.path);
                continue;
            }
            let on_face = planes.holding(&edge.ends, true).next().is_some();
            if !on_face || self.set.manifest.cap {
                let [p, q] = edge.ends;
                let message = format!(
                    "found an edge of surface {} from {p:?} to {q:?} (in 1/{LATTICE} voxel) that no triangle continues",
                    edge.surface
                );
                issues.push(Issue::new(Code::LodEdge, &entry.path, message).at(p));
            }
        }
        open
    }

    /// Reads what lies below a node; `None` if it cannot be read, which has been reported before.
    fn below(&mut self, family: &Family) -> Option<Lower> {
        let mut all = Vec::with_capacity(family.children.len());
        let mut surfaces = Vec::with_capacity(family.children.len());
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
            let pieces = match self.over_tiles {
                true => TileMesh::read(bytes).ok()?.pieces,
                false => NodeMesh::read(bytes).ok()?.pieces,
            };
            let read = match self.over_tiles {
                true => parts_of_tile(bytes, self.set.manifest.primitives),
                false => parts_of_node(bytes),
            };
            surfaces.push(read.ok()?);
            all.push(pieces.into_iter().map(part).collect());
        }
        debug_assert_eq!(self.over_tiles, family.below.is_tiles());
        Some(Lower {
            parts: all,
            surfaces,
        })
    }

    /// Compares the level's sums with those of its nodes.
    pub fn end(self, issues: &mut Issues) {
        let l = self.level;
        let stated = [
            l.nodes,
            l.triangles,
            l.fin_triangles,
            l.vertices,
            l.border_edges,
            l.bytes,
        ];
        let most = [l.error_max, l.curve_tolerance, l.fin_width];
        let cells = self.cells.len() as u64;
        if stated != self.sums || most != self.most || l.cells != cells {
            let message = format!(
                "found {stated:?} nodes, triangles, fin triangles, vertices, border edges and bytes, {} cells, and \
                 {most:?} as the largest error, gap and width, expected {:?}, {cells} and {:?}",
                l.cells, self.sums, self.most
            );
            let at = format!("lod/index.json#/levels/{}", l.level - 1);
            issues.add(Code::LodValue, at, message);
        }
    }
}

/// How many entries the indices of a node's file have, and strips that are stitched in them.
fn indices_and_strips(bytes: &[u8]) -> Result<[u64; 2], ReadError> {
    let (mut counts, mut indices) = ([0; 2], Vec::new());
    for primitive in &Tile::read_node(bytes)?.primitives {
        indices.clear();
        primitive.indices.read_into(&mut indices);
        counts[0] += indices.len() as u64;
        counts[1] += 1 + joints(&indices).0;
    }
    Ok(counts)
}

/// What tells the surface of an edge: with caps, which close all of them, there is one.
fn surface_key(part: &Part, capped: bool) -> u64 {
    if capped { 0 } else { part.ids[2] }
}

fn lattice(p: [f32; 3]) -> Point {
    p.map(|v| (v * LATTICE as f32) as i32)
}

fn part(piece: SurfacePiece) -> Part {
    let corners = |t: &[u32; 3]| t.map(|v| lattice(piece.positions[v as usize]));
    Part {
        ids: ids(&piece.ids),
        triangles: piece.triangles.iter().map(corners).collect(),
        extras: piece.extras,
    }
}

/// Compares ids and measures of a node's rows with those below.
fn check_ids(entry: &NodeEntry, node: &Node, below: &[Vec<Part>], issues: &mut Issues) {
    let mut known: BTreeMap<[u64; 3], Map<String, Value>> = BTreeMap::new();
    for part in below.iter().flatten() {
        known
            .entry(part.ids)
            .or_insert_with(|| measures(&part.extras));
    }
    for rows in [&node.pieces, &node.fins] {
        let mut seen = BTreeSet::new();
        for part in rows {
            let [cell, object, surface] = part.ids;
            let what = format!("cell {cell}, object {object}, surface {surface}");
            let message = match known.get(&part.ids) {
                None => format!("found {what}, which nothing below has"),
                Some(_) if !seen.insert(part.ids) => format!("found {what} twice"),
                Some(own) if *own != measures(&part.extras) => {
                    format!("found other measures of {what} than below")
                }
                Some(_) => continue,
            };
            issues.add(Code::LodIds, &entry.path, message);
        }
    }
}

/// What of the borders of a node and of those below it lies under its fins.
struct Covered<'a> {
    entry: &'a NodeEntry,
    planes: &'a Planes,
    step: i32,
    capped: bool,
}

impl Covered<'_> {
    fn check(&self, node: &Node, open: &[(Edge, i32)], below: &[Vec<Part>], issues: &mut Issues) {
        let mut fins = Fins::default();
        for part in &node.fins {
            let surface = surface_key(part, self.capped);
            if !fins.add(surface, &part.triangles) {
                let message = "found fins that are not flat quadrilaterals one after another";
                return issues.add(Code::LodFins, &self.entry.path, message);
            }
        }
        let planes = self.planes;
        let inner = |a: usize, v: i32| {
            (v == planes.low[a] && v > 0) || (v == planes.high[a] && v < planes.end[a])
        };
        if fins.any_outside(inner) {
            let message = "found a fin in no plane between two nodes";
            issues.add(Code::LodFins, &self.entry.path, message);
        }
        let steps = |voxels: f64| voxels * f64::from(LATTICE);
        let width = steps(self.entry.fin_width);
        // corners are rounded to steps, outwards
        if fins.widest() > 2.0 * width + 6.0 * f64::from(self.step) {
            let message = format!(
                "found a fin wider than {} voxels",
                2.0 * self.entry.fin_width
            );
            issues.add(Code::LodFins, &self.entry.path, message);
        }
        let mut sums = Sums::default();
        for part in below.iter().flatten() {
            let surface = surface_key(part, self.capped);
            let in_plane = |ends: &[Point; 2]| planes.share(ends);
            part.triangles
                .iter()
                .for_each(|t| sums.add(surface, *t, in_plane));
        }
        let before = sums.open().into_iter().map(|(edge, _)| edge);
        if width == 0.0 {
            // it has not moved, and has no fins
            let own: BTreeSet<Edge> = open.iter().map(|(edge, _)| *edge).collect();
            let moved = before.filter(|edge| !own.contains(edge));
            return self.covered(&fins, moved, 0.0, Code::LodCurve, issues);
        }
        let shared = |edge: &Edge| planes.share(&edge.ends);
        let own = open.iter().map(|(edge, _)| *edge).filter(shared);
        self.covered(&fins, own, width, Code::LodFins, issues);
        let margin = width - steps(self.entry.curve_gap);
        self.covered(&fins, before, margin, Code::LodCurve, issues);
    }

    /// Reports edges in planes between nodes that do not lie so far inside of a fin.
    fn covered(
        &self,
        fins: &Fins,
        edges: impl Iterator<Item = Edge>,
        margin: f64,
        code: Code,
        issues: &mut Issues,
    ) {
        let margin = (margin - 1e-6).max(0.0);
        for edge in edges {
            let mut planes = self.planes.holding(&edge.ends, false);
            let mut any = false;
            let covered = planes.any(|axis| {
                any = true;
                fins.cover(edge.surface, &edge.ends, axis, margin)
            });
            if any && !covered {
                let [p, q] = edge.ends;
                let what = match code {
                    Code::LodCurve => "the border of a node below",
                    _ => "the border",
                };
                let message = format!(
                    "{what} runs from {p:?} to {q:?} (in 1/{LATTICE} voxel), and no fin covers {margin} on both sides \
                     of it"
                );
                issues.push(Issue::new(code, &self.entry.path, message).at(p));
            }
        }
    }
}
