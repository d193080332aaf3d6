//! Directed edges of a level: each counted one way and against the other, by its surface and its two places.

use crate::grid::{LATTICE, Tiling};
use crate::verify::code::Code;
use crate::verify::report::{Issue, Issues};
use std::collections::{BTreeMap, HashMap};

/// A place in lattice steps.
pub(super) type Point = [i32; 3];

/// An edge of a surface, the smaller place first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Edge {
    pub surface: u64,
    pub ends: [Point; 2],
}

/// How many more triangles run along an edge than against it.
#[derive(Default)]
pub(super) struct Sums(HashMap<Edge, i32>);

impl Sums {
    /// Adds the edges of a triangle that are asked for.
    pub fn add(&mut self, surface: u64, corners: [Point; 3], wants: impl Fn(&[Point; 2]) -> bool) {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let (ends, way) = if a < b { ([a, b], 1) } else { ([b, a], -1) };
            if wants(&ends) {
                *self.0.entry(Edge { surface, ends }).or_default() += way;
            }
        }
    }

    /// The edges that are not matched, and by how many, by rising places.
    pub fn open(self) -> Vec<(Edge, i32)> {
        let mut open: Vec<(Edge, i32)> = self.0.into_iter().filter(|e| e.1 != 0).collect();
        open.sort_unstable();
        open
    }
}

/// The planes of a node of a level in lattice steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Planes {
    pub low: Point,
    pub high: Point,
    /// The upper faces of the volume.
    pub end: Point,
}

impl Planes {
    pub fn of(tiling: Tiling, level: u32, grid: [u32; 3]) -> Self {
        let end = tiling.dims.0.map(|n| (n - 1) * LATTICE);
        let at = |a: usize, node: u32| {
            let cubes = (u64::from(node) << level) * u64::from(tiling.macrocube[a]);
            (cubes * u64::from(LATTICE)).min(u64::from(end[a])) as i32
        };
        Planes {
            low: std::array::from_fn(|a| at(a, grid[a])),
            high: std::array::from_fn(|a| at(a, grid[a] + 1)),
            end: end.map(|v| v as i32),
        }
    }

    /// The axes of planes of the node in which an edge lies; `faces` says whether of those that are faces of the
    /// volume, or of the others.
    pub fn holding(&self, [p, q]: &[Point; 2], faces: bool) -> impl Iterator<Item = usize> {
        let holds = |a: usize| {
            let v = p[a];
            let on = v == self.low[a] || v == self.high[a];
            let is_face = v == 0 || v == self.end[a];
            p[a] == q[a] && on && is_face == faces
        };
        let found: [bool; 3] = std::array::from_fn(holds);
        (0..3).filter(move |&a| found[a])
    }

    /// True for an edge that another node has to continue: in a plane between two.
    pub fn share(&self, ends: &[Point; 2]) -> bool {
        self.holding(ends, false).next().is_some()
    }
}

/// The edges in planes between nodes of a level that wait for those of other nodes.
pub(super) struct Borders {
    level: u32,
    /// With the path of a node that has it.
    waiting: BTreeMap<Edge, (i32, String)>,
    /// A node could not be read, so others may lack their mates.
    lacks_some: bool,
}

impl Borders {
    pub fn new(level: u32) -> Self {
        Borders {
            level,
            waiting: BTreeMap::new(),
            lacks_some: false,
        }
    }

    /// Says that a node could not be read.
    pub fn lack_some(&mut self) {
        self.lacks_some = true;
    }

    /// Adds an edge that a node leaves open.
    pub fn add(&mut self, edge: Edge, sum: i32, path: &str) {
        let waiting = self
            .waiting
            .entry(edge)
            .or_insert_with(|| (0, path.to_owned()));
        waiting.0 += sum;
        if waiting.0 == 0 {
            self.waiting.remove(&edge);
        }
    }

    /// Says that all nodes up to a layer have been seen: what does not lie across its upper plane stays open.
    pub fn end_layer(&mut self, tiling: Tiling, level: u32, z: u32, issues: &mut Issues) {
        let top = Planes::of(tiling, level, [0, 0, z]).high[2];
        let all = std::mem::take(&mut self.waiting);
        let (later, open) = all
            .into_iter()
            .partition(|(e, _)| e.ends.iter().all(|p| p[2] == top));
        self.waiting = later;
        self.report(open, issues);
    }

    /// Says that all nodes have been seen.
    pub fn end(mut self, issues: &mut Issues) {
        let open = std::mem::take(&mut self.waiting);
        self.report(open, issues);
    }

    fn report(&self, open: BTreeMap<Edge, (i32, String)>, issues: &mut Issues) {
        if self.lacks_some {
            return;
        }
        for (edge, (_, path)) in open {
            let [p, q] = edge.ends;
            let message = format!(
                "found an edge of surface {} from {p:?} to {q:?} (in 1/{LATTICE} voxel) that no node of level {} \
                 across the plane continues",
                edge.surface, self.level
            );
            issues.push(Issue::new(Code::LodEdge, path, message).at(p));
        }
    }
}
