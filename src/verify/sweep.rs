//! The front of the sweep: edges on tile planes that wait for the neighbour, and the surfaces that
//! can still grow.
//!
//! Tiles arrive layer by layer, in a layer by rising y, then x. A tile's lower faces are matched with
//! what its lower neighbours left; its upper faces wait. So what is kept is bounded by the planes of
//! one layer, whatever the height of the volume.

use super::code::Code;
use super::first::voxel_key;
use super::ledger::Ledger;
use super::paint::{Colour, MIXED};
use super::parts::PartSums;
use super::piece::{Region, Sums};
use super::report::{Issue, Issues};
use super::walls::{TileChords, WallLedger};
use crate::error::Result;
use std::collections::BTreeMap;
use std::fmt;

/// The ids of a surface. Cell and surface are 0 of what is connected where cells are parts of components: it may have
/// several of both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct Ids {
    pub surface: u64,
    pub cell: u64,
    pub object: u64,
}

impl fmt::Display for Ids {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Ids {
            surface,
            cell,
            object,
        } = self;
        match cell {
            0 => write!(f, "a surface of object {object}"),
            _ => write!(f, "surface {surface} (cell {cell}, object {object})"),
        }
    }
}

/// A connected part of a surface, with the sums over its pieces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Component {
    pub ids: Ids,
    pub sums: Sums,
    /// Tiles that have a piece of it.
    pub tiles: u64,
    /// Tiles that its cell has, as far as they are counted on this surface.
    pub cell_tiles: u64,
    /// The same for its object.
    pub object_tiles: u64,
    /// Bit 0: a node is named after the cell alone. Bit 1: after cell and object.
    pub names: u8,
    /// A hash of the measures in the extras of its pieces, see [`super::carried`].
    pub measures: u64,
    /// Their colour.
    pub colour: Colour,
    /// True if pieces carry different ones.
    pub mixed: bool,
    /// True if it meets the edge of the region of interest.
    pub cut: bool,
}

impl Component {
    pub fn absorb(&mut self, other: &Component) {
        self.sums.add(&other.sums);
        self.tiles += other.tiles;
        self.cell_tiles += other.cell_tiles;
        self.object_tiles += other.object_tiles;
        self.names |= other.names;
        self.cut |= other.cut;
        self.mixed |= other.mixed || self.measures != other.measures;
        if self.colour != other.colour {
            self.colour = MIXED;
        }
    }
}

/// [`FaceEdge::part`] of an edge of a cap.
pub(super) const CAP: u32 = u32::MAX;

/// An open edge on a tile plane, from `a` to `b`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FaceEdge {
    /// The tail's two coordinates in the plane, the earlier axis in the upper half; they are raised
    /// by 256 so that caps are not negative.
    pub a: u64,
    /// The head, likewise.
    pub b: u64,
    /// Component: within the tile when it arrives, within the front while it waits.
    pub part: u32,
}

impl FaceEdge {
    /// Packs the ends of an edge on a plane across `axis`.
    pub fn new(axis: usize, a: [i32; 3], b: [i32; 3], part: u32) -> Self {
        let pack = |p: [i32; 3]| {
            let (u, v) = match axis {
                0 => (p[1], p[2]),
                1 => (p[0], p[2]),
                _ => (p[0], p[1]),
            };
            u64::from((u + 256) as u32) << 32 | u64::from((v + 256) as u32)
        };
        FaceEdge {
            a: pack(a),
            b: pack(b),
            part,
        }
    }

    /// The middle of the edge in lattice units, given the plane.
    pub fn middle(&self, axis: usize, plane: i32) -> [i32; 3] {
        let unpack = |k: u64| [(k >> 32) as i32 - 256, k as u32 as i32 - 256];
        let (a, b) = (unpack(self.a), unpack(self.b));
        let [u, v] = [0, 1].map(|i| (a[i] + b[i]) / 2);
        match axis {
            0 => [plane, u, v],
            1 => [u, plane, v],
            _ => [u, v, plane],
        }
    }
}

/// The part of a tile that the sweep needs.
pub(super) struct TileFront {
    /// Macrocube index.
    pub grid: [u32; 3],
    pub region: Region,
    /// The tile's file, for messages.
    pub path: String,
    /// Open edges per face, sorted by (a, b) on upper and by (b, a) on lower faces; `None` if the
    /// tile could not be read, so that its neighbours' edges are not held against them.
    pub faces: Option<[Vec<FaceEdge>; 6]>,
    /// The tile's components, and whether each has an edge on a tile plane.
    pub components: Vec<(Component, bool)>,
    /// Parts of surfaces, where cells are parts of components.
    pub parts: Vec<PartSums>,
    /// Chords of walls, if these are looked for.
    pub chords: TileChords,
}

/// Edges that wait on the plane above a tile.
enum Waiting {
    Edges {
        edges: Vec<FaceEdge>,
        plane: i32,
        path: String,
    },
    /// The tile below could not be read.
    Anything,
}

struct Live {
    parent: u32,
    component: Component,
}

/// The front.
pub(super) struct Sweep {
    live: Vec<Live>,
    /// By axis and the macrocube below the plane.
    waiting: BTreeMap<(usize, [u32; 3]), Waiting>,
    /// The last layer of which nothing could be read.
    lost_layer: Option<u32>,
    pub ledger: Ledger,
    /// Chords of walls, if these are looked for.
    pub walls: Option<WallLedger>,
    /// Edges matched across planes.
    pub matched: u64,
    /// See [`Manifest::may_gape`](crate::manifest::Manifest::may_gape).
    may_gape: bool,
}

impl Sweep {
    pub fn new(ledger: Ledger, may_gape: bool) -> Self {
        Sweep {
            live: Vec::new(),
            waiting: BTreeMap::new(),
            lost_layer: None,
            ledger,
            walls: None,
            matched: 0,
            may_gape,
        }
    }

    /// Takes the next tile.
    ///
    /// # Errors
    /// The ledger's, when it cannot write its temporary files.
    pub fn add(&mut self, tile: TileFront, issues: &mut Issues) -> Result<()> {
        let handles = self.add_components(&tile)?;
        self.add_parts(&tile)?;
        if let Some(walls) = &mut self.walls {
            walls.add(tile.chords)?;
        }
        let TileFront {
            grid,
            region,
            path,
            faces,
            ..
        } = tile;
        let Some(mut faces) = faces else {
            for axis in 0..3 {
                self.waiting.remove(&(axis, below(grid, axis)));
                if !region.outer(2 * axis + 1) {
                    self.waiting.insert((axis, grid), Waiting::Anything);
                }
            }
            return Ok(());
        };
        for (face, edges) in faces.iter_mut().enumerate() {
            for edge in edges.iter_mut().filter(|e| e.part != CAP) {
                edge.part = handles[edge.part as usize];
            }
            let axis = face / 2;
            if region.outer(face) {
                continue;
            }
            let edges = std::mem::take(edges);
            let plane = region.plane(face);
            if face % 2 == 1 {
                if !edges.is_empty() {
                    let path = path.clone();
                    let wait = Waiting::Edges { edges, plane, path };
                    self.waiting.insert((axis, grid), wait);
                }
                continue;
            }
            let lost = axis == 2 && self.lost_layer.is_some_and(|z| z + 1 == grid[2]);
            match self.waiting.remove(&(axis, below(grid, axis))) {
                Some(Waiting::Anything) => {}
                Some(Waiting::Edges {
                    edges: lower,
                    path: lower_path,
                    ..
                }) => {
                    let plane = Plane {
                        axis,
                        at: plane,
                        paths: [&lower_path, &path],
                    };
                    self.join(&lower, &edges, &plane, issues);
                }
                None if lost => {}
                None if self.may_gape => {}
                None => report_open(&edges, axis, plane, &path, issues),
            }
        }
        Ok(())
    }

    fn add_components(&mut self, tile: &TileFront) -> Result<Vec<u32>> {
        let mut handles = Vec::with_capacity(tile.components.len());
        for (component, open) in &tile.components {
            if *open && tile.faces.is_some() {
                let handle = self.live.len() as u32;
                handles.push(handle);
                self.live.push(Live {
                    parent: handle,
                    component: *component,
                });
            } else {
                handles.push(CAP);
                self.ledger.add(component)?;
            }
        }
        Ok(handles)
    }

    fn add_parts(&mut self, tile: &TileFront) -> Result<()> {
        let number = voxel_key(tile.grid.map(|c| c as i32));
        let mut parts = tile.parts.iter();
        parts.try_for_each(|part| self.ledger.add_part(part, number))
    }

    /// Matches the edges of both sides of a plane and unites their components.
    fn join(&mut self, lower: &[FaceEdge], upper: &[FaceEdge], plane: &Plane, issues: &mut Issues) {
        let (mut l, mut u) = (0, 0);
        let mut open = [Vec::new(), Vec::new()];
        while l < lower.len() || u < upper.len() {
            let left = lower.get(l).map(|e| (e.a, e.b));
            let right = upper.get(u).map(|e| (e.b, e.a));
            match (left, right) {
                (Some(x), Some(y)) if x == y => {
                    self.unite(&lower[l], &upper[u], plane, issues);
                    self.matched += 1;
                    l += 1;
                    u += 1;
                }
                (Some(x), y) if y.is_none_or(|y| x < y) => {
                    open[0].push(lower[l]);
                    l += 1;
                }
                _ => {
                    open[1].push(upper[u]);
                    u += 1;
                }
            }
        }
        // edges that fail to meet are one hole, seen from both sides
        let (side, other) = if open[0].is_empty() { (1, 0) } else { (0, 1) };
        if let Some(first) = open[side].first().filter(|_| !self.may_gape) {
            let count = open[0].len() + open[1].len();
            let message = format!(
                "{count} edges on the plane to {} do not meet an edge of the other tile",
                plane.paths[other]
            );
            let issue = Issue::new(Code::Hole, plane.paths[side], message);
            issues.push(issue.at(first.middle(plane.axis, plane.at)));
        }
    }

    fn unite(&mut self, lower: &FaceEdge, upper: &FaceEdge, plane: &Plane, issues: &mut Issues) {
        let place = || lower.middle(plane.axis, plane.at);
        if lower.part == CAP || upper.part == CAP {
            if lower.part != upper.part {
                let message = format!("a cap continues as a surface in {}", plane.paths[0]);
                let issue = Issue::new(Code::SurfaceMixed, plane.paths[1], message);
                issues.push(issue.at(place()));
            }
            return;
        }
        let (a, b) = (self.root(lower.part), self.root(upper.part));
        self.live[a.min(b) as usize].component.sums.edges += 1;
        if a == b {
            return;
        }
        let (keep, gone) = (a.min(b), a.max(b));
        let (x, y) = (
            self.live[a as usize].component.ids,
            self.live[b as usize].component.ids,
        );
        if x != y {
            let message = format!("{y} continues as {x} in {}", plane.paths[0]);
            let issue = Issue::new(Code::SurfaceMixed, plane.paths[1], message);
            issues.push(issue.at(place()));
        }
        let absorbed = self.live[gone as usize].component;
        self.live[gone as usize].parent = keep;
        self.live[keep as usize].component.absorb(&absorbed);
    }

    fn root(&mut self, mut v: u32) -> u32 {
        while self.live[v as usize].parent != v {
            let up = self.live[v as usize].parent;
            self.live[v as usize].parent = self.live[up as usize].parent;
            v = up;
        }
        v
    }

    /// Says that all tiles of layer `z` have arrived: what waits in vain is a hole, and surfaces
    /// without a waiting edge are complete.
    ///
    /// # Errors
    /// The ledger's.
    pub fn end_layer(&mut self, z: u32, issues: &mut Issues) -> Result<()> {
        let all = std::mem::take(&mut self.waiting);
        for (key, waiting) in all {
            let (axis, tile) = key;
            if axis == 2 && tile[2] == z {
                self.waiting.insert(key, waiting);
            } else if let (Waiting::Edges { edges, plane, path }, false) = (waiting, self.may_gape)
            {
                report_open(&edges, axis, plane, &path, issues);
            }
        }
        self.retire()
    }

    /// Says that layer `z` cannot be read: no hole is reported on its planes.
    pub fn lose_layer(&mut self, z: u32) {
        self.waiting.clear();
        self.lost_layer = Some(z);
    }

    /// Hands finished components to the ledger and numbers the others again.
    fn retire(&mut self) -> Result<()> {
        let mut renamed = vec![CAP; self.live.len()];
        let mut kept = Vec::new();
        let mut waiting = std::mem::take(&mut self.waiting);
        for wait in waiting.values_mut() {
            let Waiting::Edges { edges, .. } = wait else {
                continue;
            };
            for edge in edges.iter_mut().filter(|e| e.part != CAP) {
                let root = self.root(edge.part) as usize;
                if renamed[root] == CAP {
                    renamed[root] = kept.len() as u32;
                    kept.push(Live {
                        parent: renamed[root],
                        component: self.live[root].component,
                    });
                }
                edge.part = renamed[root];
            }
        }
        for (i, live) in self.live.iter().enumerate() {
            if live.parent as usize == i && renamed[i] == CAP {
                self.ledger.add(&live.component)?;
            }
        }
        self.live = kept;
        self.waiting = waiting;
        Ok(())
    }
}

struct Plane<'a> {
    axis: usize,
    at: i32,
    /// The files below and above.
    paths: [&'a str; 2],
}

fn below(mut grid: [u32; 3], axis: usize) -> [u32; 3] {
    // a lower face that is not the volume's has a neighbour, so wrapping never names a real one
    grid[axis] = grid[axis].wrapping_sub(1);
    grid
}

fn report_open(edges: &[FaceEdge], axis: usize, plane: i32, path: &str, issues: &mut Issues) {
    if let Some(first) = edges.first() {
        let name = ["x", "y", "z"][axis];
        let message = format!(
            "{} edges on the plane {name} = {} have no tile on the other side",
            edges.len(),
            plane / 256
        );
        issues.push(Issue::new(Code::Hole, path, message).at(first.middle(axis, plane)));
    }
}
