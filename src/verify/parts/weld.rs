//! The parts of surfaces in a tile, one for each cell and object, put together again: those of one object at a time.

use super::sums::{Begins, PartSums};
use crate::tile::read::PieceIds;
use crate::verify::code::Code;
use crate::verify::first::voxel_key;
use crate::verify::geometry::Label;
use crate::verify::inside::{Inside, Span};
use crate::verify::marks::axis;
use crate::verify::piece::{Flaw, Piece, Sums, Tally, Vertex, position};
use crate::verify::report::Issue;
use crate::verify::rim::cell_is_low;
use crate::verify::tile::{Work, Workspace};
use foldhash::fast::RandomState;
use std::cmp::Reverse;
use std::collections::{HashMap, HashSet};

/// The surface at hand; buffers are kept from tile to tile.
#[derive(Default)]
pub(in crate::verify) struct Weld {
    parts: Vec<Part>,
    whole: Piece,
    /// The vertex on each lattice edge, if there are several parts.
    vertices: HashMap<u64, Known, RandomState>,
    /// Vertices that the tile is the first to have, each counted once.
    owned: u64,
    /// Of all surfaces of the tile, the voxels at which triangles begin, with their cells.
    begins: Vec<(u64, u64)>,
}

struct Part {
    label: Label,
    /// Its first triangle in the whole, and its first vertex that no part before it has.
    first: usize,
    first_vertex: usize,
}

struct Known {
    vertex: u32,
    /// The last part that has it.
    part: usize,
}

impl Weld {
    /// Forgets the last tile.
    pub fn begin(&mut self) {
        self.parts.clear();
        self.begins.clear();
    }

    /// The voxels at which triangles begin, by rising numbers, with their cells, of a tile whose parts are all known.
    pub(in crate::verify) fn noted(&self) -> &[(u64, u64)] {
        &self.begins
    }

    /// The same by their places.
    pub(in crate::verify) fn begins(&self) -> impl Iterator<Item = ([i32; 3], u64)> {
        let voxel = |key: u64| [key & 0xFFFF, key >> 16 & 0xFFFF, key >> 32].map(|c| c as i32);
        let noted = self.noted().iter();
        noted.map(move |&(key, cell)| (voxel(key), cell))
    }

    /// Adds a piece as a part, of whose vertices the tile owns some; returns how many vertices other parts have, too, those
    /// that differ from these, and those that parts of larger cells had before.
    fn add(
        &mut self,
        label: &Label,
        piece: &mut Piece,
        owned: u64,
        owns: impl Fn([i32; 3]) -> bool,
    ) -> (u64, [Tally; 2]) {
        let number = self.parts.len();
        let [mut differs, mut behind] = [Tally::default(), Tally::default()];
        if number == 0 {
            std::mem::swap(&mut self.whole, piece);
            self.parts.push(Part {
                label: *label,
                first: 0,
                first_vertex: 0,
            });
            self.owned = owned;
            return (0, [differs, behind]);
        }
        if number == 1 {
            self.vertices.clear();
            for (vertex, point) in (0..).zip(&self.whole.points) {
                let known = Known { vertex, part: 0 };
                self.vertices.entry(lattice_edge(*point)).or_insert(known);
            }
        }
        self.parts.push(Part {
            label: *label,
            first: self.whole.triangles.len(),
            first_vertex: self.whole.points.len(),
        });
        self.owned += owned;
        let (mut shared, mut place_of) = (0, Vec::with_capacity(piece.points.len()));
        for (v, point) in piece.points.iter().enumerate() {
            let new = self.whole.points.len() as u32;
            let known = self.vertices.entry(lattice_edge(*point)).or_insert(Known {
                vertex: new,
                part: number,
            });
            if known.part < number {
                if self.parts[known.part].label.ids.cell >= label.ids.cell {
                    behind.add(position(*point));
                }
                known.part = number;
                shared += 1;
                self.owned -= u64::from(owns(position(*point)));
                let at = known.vertex as usize;
                let bits = |normal: [f32; 3]| normal.map(f32::to_bits);
                if self.whole.points[at] != *point
                    || bits(self.whole.normals[at]) != bits(piece.normals[v])
                {
                    differs.add(position(*point));
                }
                place_of.push(known.vertex);
                continue;
            }
            // one that the part has twice stays twice, as in any piece
            place_of.push(new);
            self.whole.points.push(*point);
            self.whole.state.push(piece.state[v]);
            self.whole.normals.push(piece.normals[v]);
        }
        let moved = piece
            .triangles
            .iter()
            .map(|t| t.map(|v| place_of[v as usize]));
        self.whole.triangles.extend(moved);
        (shared, [differs, behind])
    }
}

/// A number for the lattice edge of a vertex: those that come first by z, y, x and axis have smaller ones.
fn lattice_edge([x, y, z, code]: Vertex) -> u64 {
    voxel_key([x >> 8, y >> 8, z >> 8]) << 2 | u64::from(axis(code))
}

/// The voxel below at a vertex.
fn below([x, y, z, code]: Vertex, state: u8) -> [i32; 3] {
    let mut voxel = [x >> 8, y >> 8, z >> 8];
    voxel[usize::from(axis(code))] += i32::from(!cell_is_low(state));
    voxel
}

/// The part with which each vertex of a surface counts: of the cubes that have triangles at it the last one by z, y and x
/// decides, by the smallest cell of these triangles.
fn counted_with(whole: &Piece, parts: &[Part]) -> Vec<usize> {
    let none = (Reverse(0), u64::MAX, 0);
    let mut deciding = vec![none; whole.points.len()];
    let ends = parts[1..].iter().map(|part| part.first);
    let ends = ends.chain([whole.triangles.len()]);
    for (number, (part, end)) in parts.iter().zip(ends).enumerate() {
        for triangle in &whole.triangles[part.first..end] {
            let corners = triangle.map(|v| position(whole.points[v as usize]));
            let low = |a: usize| corners.iter().map(|corner| corner[a] >> 8).min();
            let cube = [0, 1, 2].map(|a| low(a).unwrap_or(0));
            for v in triangle {
                let here = (Reverse(voxel_key(cube)), part.label.ids.cell, number);
                let known = &mut deciding[*v as usize];
                *known = here.min(*known);
            }
        }
    }
    deciding.into_iter().map(|(.., part)| part).collect()
}

impl Work<'_, '_> {
    /// Takes a piece, whose vertices have been found sound, as a part of its surface. Caps are of no cell.
    pub(in crate::verify) fn part(
        &mut self,
        label: &Label,
        owned: u64,
        flaws: Vec<Flaw>,
        ws: &mut Workspace,
    ) {
        let last = ws.weld.parts.last().map(|part| part.label);
        if last.is_some_and(|last| label.ids.cell == 0 || last.ids.object != label.ids.object) {
            self.end_surface(ws);
        }
        if !self.sound {
            return;
        }
        if label.ids.cell == 0 || !flaws.is_empty() {
            return self.whole_piece(label, owned, flaws, ws);
        }
        self.widen(ws);
        let region = self.region;
        let (shared, [differs, behind]) =
            ws.weld.add(label, &mut ws.piece, owned, |p| region.owns(p));
        self.counts.tile_vertices += shared;
        if behind.count > 0 {
            let message = format!(
                "{} vertices of cell {} are those of larger cells before it, expected cells of an object that touch by \
                 rising cell, each once",
                behind.count, label.ids.cell
            );
            self.issue(Code::PartOrder, &format!("/nodes/{}", label.node), message);
        }
        let mut flaws = Vec::new();
        differs.report(Code::SeamDiffers, &mut flaws);
        if !flaws.is_empty() {
            self.flaws(label.node, &flaws);
            self.sound = false;
        }
    }

    /// Checks what the parts at hand are together, if there are any.
    pub(in crate::verify) fn end_surface(&mut self, ws: &mut Workspace) {
        let parts = std::mem::take(&mut ws.weld.parts);
        let Some(first) = parts.first().map(|part| part.label) else {
            return;
        };
        let span = ws.span;
        std::mem::swap(&mut ws.piece, &mut ws.weld.whole);
        let label = Label {
            ids: PieceIds {
                cell: 0,
                surface: 0,
                ..first.ids
            },
            ..first
        };
        self.whole_piece(&label, ws.weld.owned, Vec::new(), ws);
        if self.sound {
            self.sum_parts(&parts, ws);
        }
        std::mem::swap(&mut ws.piece, &mut ws.weld.whole);
        // that of the primitive at hand
        ws.span = span;
        ws.weld.parts = parts;
        ws.weld.parts.clear();
    }

    /// Sums up what the triangles and vertices of each part say.
    fn sum_parts(&mut self, parts: &[Part], ws: &mut Workspace) {
        let piece = &ws.piece;
        let outer = self.border_of(piece, &ws.edges.open);
        // most vertices are at no such edge
        let mut at_border = vec![false; piece.points.len()];
        for vertex in outer.iter().flatten() {
            at_border[*vertex as usize] = true;
        }
        // where the last tile has them
        let mut counted = vec![0; parts.len()];
        for (with, point) in counted_with(piece, parts).into_iter().zip(&piece.points) {
            counted[with] += u64::from(self.region.is_last(position(*point)));
        }
        let ends = parts[1..]
            .iter()
            .map(|part| (part.first, part.first_vertex));
        let ends = ends.chain([(piece.triangles.len(), piece.points.len())]);
        for (number, (part, (end, end_vertex))) in parts.iter().zip(ends).enumerate() {
            let triangles = &piece.triangles[part.first..end];
            let label = &part.label;
            let own = part.first_vertex..end_vertex;
            let points = &piece.points[own.clone()];
            let place = self.cx.rotated.as_ref();
            let mut sums = Sums {
                triangles: triangles.len() as u64,
                vertices: counted[number],
                inside: Inside::of_some(points, &piece.state[own], &self.region, place),
                ..Sums::default()
            };
            for t in triangles {
                let (area, volume6) = piece.measure(*t, self.cx.scale);
                sums.area += area;
                sums.volume6 += volume6;
                for [tail, head] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                    if at_border[tail as usize] && outer.contains(&[tail, head]) {
                        sums.border += 1;
                        let ends = [tail, head].map(|v| piece.points[v as usize]);
                        let state = piece.state[tail as usize];
                        sums.inside.rim.add_border_edge(ends, state);
                    }
                }
            }
            let corners = piece.points.as_slice();
            let is_cut = triangles.iter().any(|t| {
                let states = t.map(|v| piece.state[v as usize]);
                self.edge.cuts(&t.map(|v| corners[v as usize]), &states)
            });
            let begins = self.begins(piece, triangles, label.ids.cell, &mut ws.weld.begins);
            self.parts.push(PartSums {
                component: label.component(sums, is_cut),
                begins,
            });
        }
    }

    /// The open edges of a piece on the faces of the volume.
    fn border_of(&self, piece: &Piece, open: &[[u32; 2]]) -> HashSet<[u32; 2], RandomState> {
        let on_face = |edge: &&[u32; 2]| {
            let [a, b] = edge.map(|v| position(piece.points[v as usize]));
            let on = |f: &usize| a[f / 2] == b[f / 2] && a[f / 2] == self.region.plane(*f);
            (0..6).find(on).is_some_and(|face| self.region.outer(face))
        };
        open.iter().filter(on_face).copied().collect()
    }

    /// The voxels at which triangles of a cell begin, which are noted, too.
    fn begins(
        &self,
        piece: &Piece,
        triangles: &[[u32; 3]],
        cell: u64,
        noted: &mut Vec<(u64, u64)>,
    ) -> Begins {
        let mut begins = Begins::default();
        for t in triangles {
            let edge = |v: &u32| lattice_edge(piece.points[*v as usize]);
            let first = *t.iter().min_by_key(|v| edge(v)).unwrap_or(&t[0]) as usize;
            let voxel = below(piece.points[first], piece.state[first]);
            let begin = (voxel_key(voxel), cell);
            if noted.last() == Some(&begin) {
                continue;
            }
            noted.push(begin);
            let corner = voxel.map(|c| c as u16);
            begins.span.add(&Span {
                lo: corner,
                hi: corner,
            });
            if let Some(place) = &self.cx.rotated {
                begins.far.add(place.step(voxel.map(f64::from)));
            }
        }
        begins
    }

    /// Looks for voxels at which triangles of several cells begin.
    pub(in crate::verify) fn check_begins(&mut self, weld: &mut Weld) {
        weld.begins.sort_unstable();
        weld.begins.dedup();
        let of_two = |pair: &&[(u64, u64)]| pair[0].0 == pair[1].0;
        let mut mixed = weld.begins.windows(2).filter(of_two);
        let Some(&[(key, one), (_, other)]) = mixed.next() else {
            return;
        };
        let message = format!(
            "triangles of cells {one} and {other} begin at one voxel below, and those of {} more voxels, expected \
             each triangle in the cell of the voxel below at its first vertex",
            mixed.count()
        );
        let voxel = [key & 0xFFFF, key >> 16 & 0xFFFF, key >> 32].map(|c| c as i32 * 256);
        let issue = Issue::new(Code::CellMixed, &self.entry.path, message);
        self.issues.push(issue.at(voxel));
    }
}
