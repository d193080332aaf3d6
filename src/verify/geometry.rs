//! A tile's surface pieces: their groups in the shard, their geometry, and what of them is open.

use super::code::Code;
use super::edges::Edges;
use super::extras;
use super::inside::Inside;
use super::paint::{self, Colour};
use super::piece::{Flaw, Piece, Sums, position};
use super::places::bounds;
use super::report::Issue;
use super::seen::Seen;
use super::sweep::{CAP, Component, FaceEdge, Ids};
use super::tile::{Work, Workspace};
use super::walls::Crossing;
use crate::manifest::Group;
use crate::sys::simd::dispatch;
use crate::tile::read::{Measured, PieceIds};

/// The ids, names, measures and colour that a piece states.
#[derive(Clone, Copy)]
pub(super) struct Label {
    pub ids: PieceIds,
    pub node: usize,
    /// As [`Component::names`].
    pub names: u8,
    /// As [`Component::measures`].
    pub measures: u64,
    /// As [`Component::colour`].
    pub colour: Colour,
}

impl Label {
    /// What is connected of a piece that states this, with these sums, in its first tile.
    pub(super) fn component(&self, sums: Sums, cut: bool) -> Component {
        let PieceIds {
            surface,
            cell,
            object,
            ..
        } = self.ids;
        Component {
            ids: Ids {
                surface,
                cell,
                object,
            },
            sums,
            tiles: 1,
            cell_tiles: 0,
            object_tiles: 0,
            names: self.names,
            measures: self.measures,
            colour: self.colour,
            mixed: false,
            cut,
        }
    }
}

/// Marks [`FaceEdge::part`] as a component's number rather than a vertex's.
const PLACED: u32 = 1 << 31;

impl Work<'_, '_> {
    /// Checks one piece, whose triangles and positions are in `ws.piece`.
    pub(super) fn piece(&mut self, label: &Label, group: &mut usize, ws: &mut Workspace) {
        let (ids, node) = (label.ids, label.node);
        let index = *group;
        *group += 1;
        let mut flaws = Vec::new();
        let piece = &mut ws.piece;
        piece.cap = ids.cell == 0;
        let owned = piece.read_points(&self.region, &mut flaws);
        let found = Group {
            cell: ids.cell,
            object: ids.object,
            surface: ids.surface,
            vertices: piece.points.len() as u64,
            triangles: piece.triangles.len() as u64,
        };
        if !self.check_group(index, &found, ids, node) {
            self.sound = false;
            return;
        }
        if self.cx.manifest.cells.is_some() {
            return self.part(label, owned, flaws, ws);
        }
        self.whole_piece(label, owned, flaws, ws);
    }

    /// Checks a piece whose vertices have been read, or all parts of a surface, of whose cells the label has none.
    pub(super) fn whole_piece(
        &mut self,
        label: &Label,
        owned: u64,
        mut flaws: Vec<Flaw>,
        ws: &mut Workspace,
    ) {
        let node = label.node;
        let distinct = flaws.is_empty() && self.mark_seen(ws, &mut flaws);
        if flaws.is_empty() {
            self.geometry(label, owned, distinct, &mut flaws, ws);
        }
        if !flaws.is_empty() {
            self.flaws(node, &flaws);
            // a hole inside the tile does not spoil its planes
            self.sound = flaws.iter().all(|f| f.code == Code::Hole);
        }
    }

    /// Compares a piece with the shard's group.
    fn check_group(&mut self, index: usize, found: &Group, ids: PieceIds, node: usize) -> bool {
        let legal = if found.cell == 0 {
            self.cx.manifest.cap && found.surface == 0
        } else {
            found.surface > 0
        };
        let expected = self.entry.groups.get(index);
        if expected == Some(found) && ids.triangles == found.triangles && legal && found.object > 0
        {
            return true;
        }
        let message = format!(
            "found {found} ({} stated), expected {}",
            ids.triangles,
            expected.map_or("no group".to_owned(), |g| format!("{g} as in {}", self.at))
        );
        self.issue(
            Code::GroupMismatch,
            &format!("/nodes/{node}/extras"),
            message,
        );
        false
    }

    /// The flaw of lattice edges with two vertices.
    pub(super) fn repeated(&self, seen: &mut Seen, end: bool) -> Option<Flaw> {
        let (count, cell) = seen.repeated(end)?;
        let place = |a: usize| (cell[a] as i32 - 1) * 256 + self.region.lo[a];
        Some(Flaw {
            code: Code::DuplicateVertex,
            count,
            first: std::array::from_fn(place),
        })
    }

    /// Marks the lattice edges of the piece's vertices; false if two are known to be the same.
    fn mark_seen(&mut self, ws: &mut Workspace, flaws: &mut Vec<Flaw>) -> bool {
        let piece = &ws.piece;
        let seen = if piece.cap {
            &mut ws.cap_seen
        } else {
            &mut ws.surface_seen
        };
        let distinct = seen.insert(&piece.points, self.region.lo);
        flaws.extend(self.repeated(seen, false));
        self.widen(ws);
        distinct
    }

    /// Widens the boxes of the primitive and of the tile by the piece.
    pub(super) fn widen(&mut self, ws: &mut Workspace) {
        let own = dispatch!(bounds(&ws.piece.points));
        for span in [&mut ws.span, &mut self.box_seen] {
            let [lo, hi] = span.unwrap_or(own);
            *span = Some([
                std::array::from_fn(|a| lo[a].min(own[0][a])),
                std::array::from_fn(|a| hi[a].max(own[1][a])),
            ]);
        }
    }

    /// Checks triangles and edges. The tile is the first to have `owned` of the vertices, which lie on
    /// `distinct` lattice edges.
    fn geometry(
        &mut self,
        label: &Label,
        owned: u64,
        distinct: bool,
        flaws: &mut Vec<Flaw>,
        ws: &mut Workspace,
    ) {
        let piece = &mut ws.piece;
        let mut sums = piece.sum_triangles(self.cx.scale, &self.region, &mut ws.edges, flaws);
        sums.vertices = owned;
        if !flaws.is_empty() {
            return;
        }
        let matched = ws.edges.match_up(piece, distinct);
        if matched.same_way.or(matched.crowded).is_some() || piece.contradicts() {
            piece.diagnose(&matched, flaws);
            return;
        }
        sums.edges = matched.pairs;
        if !piece.cap {
            sums.inside = Inside::of(piece, &self.region, self.cx.rotated.as_ref());
            if self.cx.walls.is_some() {
                let own = Crossing::of(piece, label.ids.cell, &self.region);
                ws.crossings.extend(own);
            }
        }
        if self.keep_mesh {
            ws.mesh.add(piece);
        }
        ws.edges.connect(&piece.triangles);
        self.place_open_edges(piece, &mut ws.edges, &mut sums, flaws);
        self.counts.triangles += sums.triangles;
        self.counts.vertices += sums.vertices;
        self.counts.tile_vertices += piece.points.len() as u64;
        self.counts.edges += sums.edges;
        self.counts.volume6 += sums.volume6;
        if piece.cap {
            self.counts.cap_triangles += sums.triangles;
            self.check_cap(label);
            return;
        }
        self.add_components(label, &sums, ws);
    }

    /// A cap is of no cell: it has no measures, and the common grey.
    fn check_cap(&mut self, label: &Label) {
        let at = format!("/nodes/{}", label.node);
        if label.measures != extras::hash(&Measured::default()) {
            let message = format!("the cap of object {} carries measures", label.ids.object);
            self.issue(Code::CarriedMeasure, &at, message);
        }
        if label.colour != 0 {
            let found = paint::name(label.colour);
            let message = format!("found {found} on a cap, expected the common grey");
            self.issue(Code::Paint, &at, message);
        }
    }

    /// Sorts the piece's open edges by the plane they lie on; the rest are a hole.
    fn place_open_edges(
        &mut self,
        piece: &Piece,
        edges: &mut Edges,
        sums: &mut Sums,
        flaws: &mut Vec<Flaw>,
    ) {
        let mut holes = 0;
        let mut first = [0; 3];
        for i in 0..edges.open.len() {
            let [tail, head] = edges.open[i];
            let [a, b] = [tail, head].map(|v| position(piece.points[v as usize]));
            let on = |&f: &usize| a[f / 2] == b[f / 2] && a[f / 2] == self.region.plane(f);
            let Some(face) = (0..6).find(on) else {
                if holes == 0 {
                    first = std::array::from_fn(|x| (a[x] + b[x]) / 2);
                }
                holes += 1;
                continue;
            };
            let part = if piece.cap { CAP } else { edges.part(tail) };
            let edge = FaceEdge::new(face / 2, a, b, part);
            if !self.region.outer(face) {
                self.faces[face].push(edge);
            } else if piece.cap {
                self.cap_border.push((face, edge));
            } else {
                self.border.push((face, edge));
                sums.border += 1;
                let ends = [tail, head].map(|v| piece.points[v as usize]);
                let state = piece.state[tail as usize];
                sums.inside.rim.add_border_edge(ends, state);
            }
        }
        if holes > 0 && !self.cx.manifest.may_gape() {
            flaws.push(Flaw {
                code: Code::Hole,
                count: holes,
                first,
            });
        }
    }

    /// Makes the piece's connected parts components of the tile. The first carries all the sums:
    /// if the parts are one surface, they meet elsewhere and are added up then.
    fn add_components(&mut self, label: &Label, sums: &Sums, ws: &mut Workspace) {
        let base = self.components.len();
        let roots: Vec<u32> = ws.edges.parts().collect();
        let cut = self.edge.cuts(&ws.piece.points, &ws.piece.state);
        let first = label.component(*sums, cut);
        let other = Component {
            tiles: 0,
            ..label.component(Sums::default(), false)
        };
        for i in 0..roots.len() {
            let component = if i == 0 { first } else { other };
            self.components.push((component, false));
        }
        for face in &mut self.faces {
            // this piece's edges are the last ones, and still name a vertex
            let own = face
                .iter_mut()
                .rev()
                .take_while(|e| e.part != CAP && e.part & PLACED == 0);
            for edge in own {
                let part = roots.binary_search(&edge.part).unwrap_or_default() + base;
                self.components[part].1 = true;
                edge.part = part as u32 | PLACED;
            }
        }
    }

    /// Matches the surface's border with the caps', or counts it.
    pub(super) fn close_border(&mut self) {
        for face in &mut self.faces {
            for edge in face.iter_mut().filter(|e| e.part != CAP) {
                edge.part &= !PLACED;
            }
        }
        if !self.cx.manifest.cap {
            self.counts.border_edges += self.border.len() as u64;
            self.counts.edges += self.border.len() as u64;
            return;
        }
        let key = |&(face, e): &(usize, FaceEdge)| (face, e.a, e.b);
        let reverse = |&(face, e): &(usize, FaceEdge)| (face, e.b, e.a);
        self.border.sort_unstable_by_key(key);
        self.cap_border.sort_unstable_by_key(reverse);
        let meet = self
            .border
            .iter()
            .map(key)
            .eq(self.cap_border.iter().map(reverse));
        self.counts.edges += self.border.len() as u64;
        if meet {
            return;
        }
        let caps: std::collections::HashSet<_> = self.cap_border.iter().map(reverse).collect();
        let own: std::collections::HashSet<_> = self.border.iter().map(key).collect();
        let lone = |(face, e): &(usize, FaceEdge)| e.middle(face / 2, self.region.plane(*face));
        let bare: Vec<_> = self
            .border
            .iter()
            .filter(|e| !caps.contains(&key(e)))
            .collect();
        let loose: Vec<_> = self
            .cap_border
            .iter()
            .filter(|e| !own.contains(&reverse(e)))
            .collect();
        if let Some(first) = bare.first().or(loose.first()) {
            let message = format!(
                "{} edges on the volume's faces have no cap, {} edges of caps have no surface",
                bare.len(),
                loose.len()
            );
            let issue = Issue::new(Code::Hole, &self.entry.path, message).at(lone(first));
            self.issues.push(issue);
        }
    }
}
