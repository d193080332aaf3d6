//! The parts of a surface in a tile, one for each cell, put together again.

use super::sums::CellSums;
use crate::tile::read::PieceIds;
use crate::verify::code::Code;
use crate::verify::first::voxel_key;
use crate::verify::geometry::Label;
use crate::verify::inside::Span;
use crate::verify::marks::axis;
use crate::verify::piece::{Flaw, Piece, Tally, Vertex, position};
use crate::verify::report::Issue;
use crate::verify::rim::cell_is_low;
use crate::verify::tile::{Work, Workspace};
use std::collections::HashMap;

/// The surface at hand; buffers are kept from tile to tile.
#[derive(Default)]
pub(in crate::verify) struct Weld {
    parts: Vec<Part>,
    whole: Piece,
    /// The vertex on each lattice edge, if there are several parts.
    vertices: HashMap<u64, Known>,
    /// Vertices that the tile is the first to have, each counted once.
    owned: u64,
    /// Of all surfaces of the tile, the voxels at which triangles begin, with their cells.
    begins: Vec<(u64, u64)>,
}

struct Part {
    label: Label,
    /// Its first triangle in the whole.
    first: usize,
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

    /// Adds a piece as a part, of whose vertices the tile owns some; returns how many vertices other parts have, too, and
    /// the first that differs from these.
    fn add(
        &mut self,
        label: &Label,
        piece: &mut Piece,
        owned: u64,
        owns: impl Fn([i32; 3]) -> bool,
    ) -> (u64, Tally) {
        let number = self.parts.len();
        let mut differs = Tally::default();
        if number == 0 {
            std::mem::swap(&mut self.whole, piece);
            self.parts.push(Part {
                label: *label,
                first: 0,
            });
            self.owned = owned;
            return (0, differs);
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
        (shared, differs)
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
        let of = |ids: PieceIds| (ids.surface, ids.object);
        if last.is_some_and(|last| label.ids.cell == 0 || of(last.ids) != of(label.ids)) {
            self.end_surface(ws);
        }
        if !self.sound {
            return;
        }
        if label.ids.cell == 0 || !flaws.is_empty() {
            return self.whole_piece(label, owned, flaws, ws);
        }
        self.widen(ws);
        if let Some(last) = ws.weld.parts.last().map(|part| part.label.ids.cell)
            && last >= label.ids.cell
        {
            let message = format!(
                "found cell {} behind cell {last} in surface {}, expected its parts by rising cell, one for each",
                label.ids.cell, label.ids.surface
            );
            self.issue(Code::PartOrder, &format!("/nodes/{}", label.node), message);
        }
        let region = self.region;
        let (shared, differs) = ws.weld.add(label, &mut ws.piece, owned, |p| region.owns(p));
        self.counts.tile_vertices += shared;
        let mut flaws = Vec::new();
        differs.report(Code::SeamDiffers, &mut flaws);
        if !flaws.is_empty() {
            self.flaws(label.node, &flaws);
            self.sound = false;
        }
    }

    /// Checks the surface whose parts are at hand, if there is one.
    pub(in crate::verify) fn end_surface(&mut self, ws: &mut Workspace) {
        let parts = std::mem::take(&mut ws.weld.parts);
        let Some(first) = parts.first().map(|part| part.label) else {
            return;
        };
        let span = ws.span;
        std::mem::swap(&mut ws.piece, &mut ws.weld.whole);
        let one_colour = parts.iter().all(|part| part.label.colour == first.colour);
        let label = Label {
            ids: PieceIds {
                cell: 0,
                ..first.ids
            },
            colour: match one_colour {
                true => first.colour,
                false => crate::verify::paint::MIXED,
            },
            ..first
        };
        self.whole_piece(&label, ws.weld.owned, Vec::new(), ws);
        if self.sound {
            self.sum_cells(&parts, ws);
        }
        std::mem::swap(&mut ws.piece, &mut ws.weld.whole);
        // that of the primitive at hand
        ws.span = span;
        ws.weld.parts = parts;
        ws.weld.parts.clear();
    }

    /// Sums up what the triangles of a surface say of cells.
    fn sum_cells(&mut self, parts: &[Part], ws: &mut Workspace) {
        let (piece, begins) = (&ws.piece, &mut ws.weld.begins);
        let place = self.cx.rotated.as_ref();
        let ends = parts[1..].iter().map(|part| part.first);
        let ends = ends.chain([piece.triangles.len()]);
        for (part, end) in parts.iter().zip(ends) {
            let label = &part.label;
            let mut sums = CellSums {
                cell: label.ids.cell,
                surface: label.ids.surface,
                triangles: (end - part.first) as u64,
                names: label.names,
                measures: label.measures,
                colour: label.colour,
                ..CellSums::default()
            };
            for t in &piece.triangles[part.first..end] {
                sums.area += piece.area(*t, self.cx.scale);
                let edge = |v: &u32| lattice_edge(piece.points[*v as usize]);
                let first = *t.iter().min_by_key(|v| edge(v)).unwrap_or(&t[0]) as usize;
                let voxel = below(piece.points[first], piece.state[first]);
                let begin = (voxel_key(voxel), label.ids.cell);
                if begins.last() == Some(&begin) {
                    continue;
                }
                begins.push(begin);
                let corner = voxel.map(|c| c as u16);
                sums.begins.add(&Span {
                    lo: corner,
                    hi: corner,
                });
                if let Some(place) = place {
                    sums.far.add(place.step(voxel.map(f64::from)));
                }
            }
            self.cells.push(sums);
        }
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
