//! A tile's primitives: modes, indices, normals, names and bounds, and their surface pieces.

use super::code::Code;
use super::extras;
use super::geometry::Label;
use super::paint::{self, Colour, MIXED};
use super::piece::Piece;
use super::report::Issue;
use super::tile::{Work, Workspace};
use crate::manifest::Primitives;
use crate::sys::simd::dispatch;
use crate::tile::read::{Normals, PieceIds, Pieces, Primitive};

impl Work<'_, '_> {
    pub(super) fn primitive(&mut self, p: &Primitive, group: &mut usize, ws: &mut Workspace) {
        let node = p.node;
        let at = |what: &str| format!("/nodes/{node}{what}");
        let strips = self.cx.manifest.primitives == Primitives::Strips;
        let mode = if strips { 5 } else { 4 };
        if p.mode != mode {
            let message = format!("found mode {}, expected {mode}", p.mode);
            self.issue(Code::PrimitiveMode, &at("/mesh"), message);
            self.sound = false;
            return;
        }
        if !self.read_indices(p, &mut ws.indices) {
            self.sound = false;
            return;
        }
        self.check_normals(p);
        ws.list.clear();
        ws.span = None;
        if !decode(&ws.indices, strips, &mut ws.list) {
            let message = "a triangle names a vertex twice, or indices are left over".to_owned();
            self.issue(Code::DegenerateTriangle, &at("/mesh"), message);
            self.sound = false;
            return;
        }
        if strips {
            self.count_strips(node, &ws.indices);
        }
        match &p.pieces {
            Pieces::One(ids) => {
                let label = Label {
                    ids: *ids,
                    node,
                    names: self.check_name(p, ids),
                    measures: extras::hash(&p.measured[0]),
                    colour: p.colour(0).map_or(MIXED, paint::colour),
                };
                std::mem::swap(&mut ws.piece.triangles, &mut ws.list);
                p.positions.read_into(&mut ws.piece.positions);
                if self.wants_normals() {
                    p.normals.read_into(&mut ws.piece.normals);
                }
                self.piece(&label, group, ws);
            }
            Pieces::Merged(rows, ids) => {
                if p.name != "cells" || p.mesh_name != "cells" {
                    let message =
                        format!("found {:?} and {:?}, expected cells", p.name, p.mesh_name);
                    self.issue(Code::NodeName, &at("/name"), message);
                }
                self.merged(p, rows.get(), ids, group, ws);
            }
        }
        if self.sound {
            self.check_bounds(p, ws.span);
        }
    }

    /// True if normals are compared with a volume, or with those of other parts of a surface, or tell how walls lie.
    fn wants_normals(&self) -> bool {
        self.keep_mesh || self.cx.manifest.cells.is_some() || self.cx.walls.is_some()
    }

    /// Reads the indices of a primitive; false if one of them is of no vertex.
    fn read_indices(&mut self, p: &Primitive, indices: &mut Vec<u32>) -> bool {
        self.check_index_type(p);
        p.indices.read_into(indices);
        self.counts.indices += indices.len() as u64;
        let vertices = p.positions.len();
        let beyond = |i: &&u32| **i as usize >= vertices;
        let largest = dispatch!(largest(indices));
        if beyond(&&largest)
            && let Some(bad) = indices.iter().find(beyond)
        {
            let message = format!("found index {bad}, expected one below {vertices}");
            self.issue(
                Code::IndexRange,
                &format!("/nodes/{}/mesh", p.node),
                message,
            );
            return false;
        }
        true
    }

    /// Counts the strips that are stitched in a primitive.
    fn count_strips(&mut self, node: usize, indices: &[u32]) {
        let (joints, odd) = dispatch!(joints(indices));
        self.counts.strips += 1 + joints;
        if odd {
            let message = "entries are repeated at the end, or more often than joints need";
            self.issue(
                Code::GltfUnused,
                &format!("/nodes/{node}/mesh"),
                message.to_owned(),
            );
        }
    }

    fn check_index_type(&mut self, p: &Primitive) {
        let wide = p.indices.is_wide();
        if wide != (p.positions.len() > 65_535) {
            let message = format!(
                "found {} bit indices for {} vertices, expected 16 bits up to 65535 vertices, else 32",
                if wide { 32 } else { 16 },
                p.positions.len()
            );
            self.issue(Code::IndexType, &format!("/nodes/{}/mesh", p.node), message);
        }
    }

    fn check_normals(&mut self, p: &Primitive) {
        // three components rounded to 1/127 each change the square of the length by 1.4 % at most
        let slack = if p.normals.is_quantized() {
            1.5e-2
        } else {
            2e-3
        };
        // counted first: a search that may end early asks of each normal whether it ends
        let count = dispatch!(count_odd(&p.normals, slack));
        if count == 0 {
            return;
        }
        if let Some(i) = p.normals.iter().position(|n| !is_unit(n, slack)) {
            let n = p.normals.iter().nth(i).unwrap_or_default();
            let v = p.positions.iter().nth(i).unwrap_or_default();
            let path = format!("{}#/nodes/{}", self.entry.path, p.node);
            let message = format!("{count} normals are not of length 1, the first is {n:?}");
            let issue = Issue::new(Code::NormalInvalid, path, message);
            self.issues.push(issue.at(v.map(|c| (c * 256.0) as i32)));
        }
    }

    /// Returns what [`Label::names`] is.
    fn check_name(&mut self, p: &Primitive, ids: &PieceIds) -> u8 {
        let form = name_form(&p.name, ids);
        if p.name != p.mesh_name || form.is_none() {
            let message = format!(
                "found node {:?} with mesh {:?}, expected both named {}",
                p.name,
                p.mesh_name,
                if ids.cell == 0 {
                    format!("cap_object_{}", ids.object)
                } else {
                    format!("cell_{0} or cell_{0}_object_{1}", ids.cell, ids.object)
                }
            );
            self.issue(Code::NodeName, &format!("/nodes/{}/name", p.node), message);
        }
        form.unwrap_or(0)
    }

    /// Compares the accessor's bounds with those of the primitive's vertices, of which `span` is what
    /// their coordinates times 256, all of them whole numbers, span.
    fn check_bounds(&mut self, p: &Primitive, span: Option<[[i32; 3]; 2]>) {
        let voxels = |c: [i32; 3]| c.map(|c| f64::from(c) / 256.0);
        if span.is_some_and(|[lo, hi]| (p.min, p.max) == (voxels(lo), voxels(hi))) {
            return;
        }
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        for v in p.positions.iter() {
            for a in 0..3 {
                lo[a] = lo[a].min(v[a]);
                hi[a] = hi[a].max(v[a]);
            }
        }
        let (lo, hi) = (lo.map(f64::from), hi.map(f64::from));
        if (p.min, p.max) != (lo, hi) {
            let message = format!(
                "the POSITION accessor states {:?} to {:?}, its values span {lo:?} to {hi:?}",
                p.min, p.max
            );
            self.issue(
                Code::AccessorBounds,
                &format!("/nodes/{}/mesh", p.node),
                message,
            );
        }
    }

    /// Splits a merged primitive into its pieces by the vertices' feature ids.
    fn merged(
        &mut self,
        p: &Primitive,
        rows: &[[u8; 4]],
        ids: &[PieceIds],
        group: &mut usize,
        ws: &mut Workspace,
    ) {
        let list = std::mem::take(&mut ws.list);
        let feature = match features(rows, ids.len(), &list) {
            Ok(feature) => feature,
            Err((code, message)) => {
                self.issue(code, &format!("/nodes/{}/mesh", p.node), message);
                self.sound = false;
                return;
            }
        };
        let of = |t: &[u32; 3]| feature[t[0] as usize];
        let mut by_feature: Vec<u32> = (0..list.len() as u32).collect();
        by_feature.sort_by_key(|&t| of(&list[t as usize]));
        let mut order: Vec<u32> = (0..feature.len() as u32).collect();
        order.sort_by_key(|&v| feature[v as usize]);
        let mut whole = Merged {
            triangles: &list,
            points: p.positions.iter().collect(),
            normals: match self.wants_normals() {
                true => p.normals.iter().collect(),
                false => Vec::new(),
            },
            local: vec![0; p.positions.len()],
        };
        let (mut triangles, mut vertices) = (&by_feature[..], &order[..]);
        for (row, (ids, measured)) in ids.iter().zip(&p.measured).enumerate() {
            let row = row as u32;
            let v = vertices.partition_point(|&v| feature[v as usize] == row);
            let t = triangles.partition_point(|&t| of(&list[t as usize]) == row);
            let (own, rest) = vertices.split_at(v);
            vertices = rest;
            let (mine, rest) = triangles.split_at(t);
            triangles = rest;
            whole.take_out(own, mine, &mut ws.piece);
            let label = Label {
                ids: *ids,
                node: p.node,
                names: 0,
                measures: extras::hash(measured),
                colour: colour_of(p, own),
            };
            self.piece(&label, group, ws);
            if !self.sound {
                break;
            }
        }
        ws.list = list;
    }
}

/// A primitive of several pieces.
struct Merged<'a> {
    triangles: &'a [[u32; 3]],
    points: Vec<[f32; 3]>,
    /// Empty if they are not to be compared.
    normals: Vec<[f32; 3]>,
    /// The number of each vertex in its own piece, of those that have been taken out.
    local: Vec<u32>,
}

impl Merged<'_> {
    /// Makes these of its vertices and triangles a piece.
    fn take_out(&mut self, vertices: &[u32], triangles: &[u32], piece: &mut Piece) {
        for (i, &v) in vertices.iter().enumerate() {
            self.local[v as usize] = i as u32;
        }
        let local = &self.local;
        piece.triangles.clear();
        let numbered = triangles
            .iter()
            .map(|&t| self.triangles[t as usize].map(|i| local[i as usize]));
        piece.triangles.extend(numbered);
        piece.positions.clear();
        let positions = vertices.iter().map(|&v| self.points[v as usize]);
        piece.positions.extend(positions);
        piece.normals.clear();
        if !self.normals.is_empty() {
            let normals = vertices.iter().map(|&v| self.normals[v as usize]);
            piece.normals.extend(normals);
        }
    }
}

/// The colour of a merged piece with these vertices.
fn colour_of(p: &Primitive, vertices: &[u32]) -> Colour {
    let first = vertices.first().and_then(|v| p.colour(*v as usize));
    match first {
        Some(colour) if p.are_one_colour(vertices) => paint::colour(colour),
        _ => MIXED,
    }
}

/// The row of each vertex; all vertices of a triangle must have the same.
fn features(
    values: &[[u8; 4]],
    rows: usize,
    triangles: &[[u32; 3]],
) -> Result<Vec<u32>, (Code, String)> {
    let mut out = Vec::with_capacity(values.len());
    for value in values {
        let value = f32::from_le_bytes(*value);
        if !(value >= 0.0 && value.fract() == 0.0 && (value as usize) < rows) {
            let message = format!("found feature id {value}, expected a row of {rows}");
            return Err((Code::GltfStructure, message));
        }
        out.push(value as u32);
    }
    let row = |i: u32| out[i as usize];
    let mixed = |t: &&[u32; 3]| row(t[0]) != row(t[1]) || row(t[1]) != row(t[2]);
    match triangles.iter().find(mixed) {
        None => Ok(out),
        Some(t) => {
            let message = format!("triangle {t:?} has vertices of several features");
            Err((Code::SurfaceMixed, message))
        }
    }
}

/// Which form the name of a surface piece has: 1 for the cell alone, 2 with the object, 0 for a cap.
fn name_form(name: &str, ids: &PieceIds) -> Option<u8> {
    if ids.cell == 0 {
        (name == format!("cap_object_{}", ids.object)).then_some(0)
    } else if name == format!("cell_{}", ids.cell) {
        Some(1)
    } else {
        (name == format!("cell_{}_object_{}", ids.cell, ids.object)).then_some(2)
    }
}

/// The largest index; 0 if there is none.
#[inline(always)]
fn largest(indices: &[u32]) -> u32 {
    indices.iter().fold(0, |most, &i| most.max(i))
}

/// True if the square of a normal's length is 1, give or take `slack`.
#[inline(always)]
fn is_unit([x, y, z]: [f32; 3], slack: f32) -> bool {
    let square = x * x + y * y + z * z;
    // a NaN compares false
    (square - 1.0).abs() <= slack
}

/// How many normals are not of length 1.
#[inline(always)]
fn count_odd(normals: &Normals, slack: f32) -> usize {
    normals.count(|n| !is_unit(n, slack))
}

/// The number of joints in a stitched strip, where entries follow themselves, the next such entry at most two behind
/// the one before. True if the strip ends with a joint, begins with more than an entry twice, which puts it at an odd
/// place, or has an entry six times in a row.
#[inline(always)]
pub(super) fn joints(indices: &[u32]) -> (u64, bool) {
    let ends = |last: &[u32; 3]| last[0] == last[1] || last[1] == last[2];
    let begins = |first: &[u32; 3]| first[1] == first[2];
    let mut odd =
        indices.last_chunk().is_some_and(ends) || indices.first_chunk().is_some_and(begins);
    // entries k to k + 5, for all k together
    let n = indices.len().saturating_sub(5);
    let ahead: [&[u32]; 6] = std::array::from_fn(|k| indices.get(k..k + n).unwrap_or_default());
    let mut joints = 0u32;
    for i in 0..n {
        let same: [bool; 5] = std::array::from_fn(|k| ahead[k][i] == ahead[k + 1][i]);
        joints += u32::from(same[2] & !same[1] & !same[0]);
        odd |= same.iter().fold(true, |all, same| all & same);
    }
    for w in indices.get(n..).unwrap_or_default().windows(4) {
        joints += u32::from((w[2] == w[3]) & (w[1] != w[2]) & (w[0] != w[1]));
    }
    (joints.into(), odd)
}

/// Triangles of a strip that are decoded at once.
const BLOCK: usize = 64;

/// Decodes strips, or a list, to triangles. False if a list has indices left over or names a vertex
/// twice in a triangle; in a strip such triangles are joints.
fn decode(indices: &[u32], strips: bool, out: &mut Vec<[u32; 3]>) -> bool {
    if !strips {
        let (triangles, rest) = indices.as_chunks::<3>();
        out.extend_from_slice(triangles);
        let joint = |t: &[u32; 3]| (t[0] == t[1]) | (t[1] == t[2]) | (t[0] == t[2]);
        return rest.is_empty() && !out.iter().any(joint);
    }
    let &[mut a, mut b, ref rest @ ..] = indices else {
        return true;
    };
    let (pairs, last) = rest.as_chunks::<2>();
    let mut block = [[0; 3]; BLOCK];
    for pairs in pairs.chunks(BLOCK / 2) {
        let mut count = 0;
        // written without asking whether it is a joint: then the next one takes its place
        for &[c, d] in pairs {
            block[count] = [a, b, c];
            count += usize::from((a != b) & (b != c) & (a != c));
            block[count] = [c, b, d];
            count += usize::from((b != c) & (c != d) & (b != d));
            (a, b) = (c, d);
        }
        out.extend_from_slice(&block[..count]);
    }
    if let &[c] = last
        && (a != b) & (b != c) & (a != c)
    {
        out.push([a, b, c]);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn strips_are_decoded_as_by_definition(indices in prop::collection::vec(0..6u32, 0..250)) {
            let mut expected = Vec::new();
            for k in 2..indices.len() {
                let [a, b, c] = [indices[k - 2], indices[k - 1], indices[k]];
                if a != b && b != c && a != c {
                    expected.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                }
            }
            let mut found = Vec::new();
            prop_assert!(decode(&indices, true, &mut found));
            prop_assert_eq!(found, expected);
        }
    }
}
