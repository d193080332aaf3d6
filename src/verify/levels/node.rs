//! One node, with what lies below it.

use super::Set;
use super::borders::{Borders, Edge, Planes, Point, Sums};
use super::entries::{Child, Family};
use super::error::check_error;
use super::fins::Covered;
use super::read::{Lower, Node, Reader, surface_key};
use crate::grid::LATTICE;
use crate::lod::NodePlace;
use crate::manifest::{Level, NodeEntry};
use crate::sys::direct_io::Buffer;
use crate::verify::code::Code;
use crate::verify::report::{Issue, Issues};
use std::collections::BTreeSet;

/// Checks the nodes of a level and adds them up.
pub(super) struct Checker<'a> {
    set: &'a Set<'a>,
    level: &'a Level,
    reader: Reader<'a>,
    sums: [u64; 6],
    most: [f64; 3],
    cells: BTreeSet<u64>,
}

impl<'a> Checker<'a> {
    pub fn new(set: &'a Set<'a>, level: &'a Level, over_tiles: bool) -> Self {
        Checker {
            set,
            level,
            reader: Reader {
                set,
                level,
                over_tiles,
                bytes: Buffer::default(),
            },
            sums: [0; 6],
            most: [0.0; 3],
            cells: BTreeSet::new(),
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
        let Some(node) = self.reader.node(entry, issues) else {
            borders.lack_some();
            return;
        };
        self.check_entry(entry, &node, family, issues);
        let planes = Planes::of(self.set.tiling, self.level.level, entry.grid);
        let open = self.check_edges(entry, &node, &planes, borders, issues);
        let Some(below) = self.reader.below(family) else {
            return;
        };
        check_ids(entry, &node, &below, issues);
        let capped = self.set.manifest.cap;
        let before = below.open(&planes, capped);
        if let Some(own) = &node.surfaces {
            let place = NodePlace {
                tiling: self.set.tiling,
                level: self.level.level,
                place: entry.grid,
                block: self.level.block,
            };
            check_error(entry, &place, family, (own, below.surfaces), issues);
        }
        let covered = Covered {
            entry,
            planes: &planes,
            step: self.level.step as i32,
            capped,
        };
        covered.check(&node.fins, &open, before, issues);
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
            let surface = surface_key(piece.ids[2], self.set.manifest.cap);
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

/// Compares ids and measures of a node's rows with those below.
fn check_ids(entry: &NodeEntry, node: &Node, below: &Lower, issues: &mut Issues) {
    for rows in [&node.pieces, &node.fins] {
        let mut seen = BTreeSet::new();
        for part in rows {
            let [cell, object, surface] = part.ids;
            let what = format!("cell {cell}, object {object}, surface {surface}");
            let message = match below.measures.get(&part.ids) {
                None => format!("found {what}, which nothing below has"),
                Some(_) if !seen.insert(part.ids) => format!("found {what} twice"),
                Some(own) if *own != part.measures => {
                    format!("found other measures of {what} than below")
                }
                Some(_) => continue,
            };
            issues.add(Code::LodIds, &entry.path, message);
        }
    }
}
