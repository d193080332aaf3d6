//! The triangles of a tile's cubes and which of them are neighbours.
//!
//! Triangles go straight to their surface's piece: a piece has room for as many as its vertices can
//! have, and its triangles are numbered in the order of their cubes. Nearly all cubes are cut by one
//! sheet and go a way without branches on the case; the others, and a test for all, take the plain way.
//!
//! Counters step from cube to cube as in Flying Edges (Schroeder et al. 2015). Cubes with surface are listed first,
//! see `surface::active_cubes`.

use crate::strip::{APEXES, NONE, STRIDE};
use crate::surface::active_cubes::{ActiveCube, Batch, CubeRow, NUMBER_OF_EDGE, NUMBERS};
use crate::surface::assign_pieces::{Piece, VertexAssignment};
use crate::surface::case_table::{Across, Case, MAX_TRIANGLES, cases};
use crate::surface::edges::Edges;
use crate::surface::mesher::{TileBox, TileMesh};
use crate::sys::simd::dispatch;
use crate::sys::unchecked::{Unchecked, UncheckedMut};
use std::sync::LazyLock;

/// Elements for the triangles of a piece of so many vertices in the tile's arrays: one that stands for
/// none, and some more that may be overwritten. At a vertex meet four cubes at most, and in a cube a loop
/// of n <= 7 vertices has n - 2 triangles, so there are 4 * 5/7 < 3 to a vertex.
pub fn room_for(vertices: u32) -> u32 {
    1 + 3 * vertices + MAX_TRIANGLES as u32
}

/// Numbers to a triangle.
const N: usize = STRIDE as usize;

/// Triangles by which the room for those of a piece is fetched ahead.
const AHEAD: usize = 24;

/// A half-edge of a triangle that is not one of its three: may be written to and means nothing.
const UNUSED: u8 = 3;

/// A case prepared for the loop, in one cache line. Half-edges are `8 t + e`, t counted within the cube.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Plan {
    /// Places of the corners' edges among the cube's numbers.
    corners: [[u8; 4]; MAX_TRIANGLES],
    /// The mate inside the cube, its triangle counted from 1, or 0.
    inside: [[u8; 4]; MAX_TRIANGLES],
    /// Half-edge on the lower and the upper face of each axis, or [`UNUSED`].
    low: [u8; 3],
    high: [u8; 3],
    /// -1, all bits, where `low` is one.
    has_low: [i8; 3],
    triangles: u8,
    /// One sheet that meets each face once at most.
    simple: bool,
}

/// The plans of a rule's 256 cases.
pub struct CaseKernels {
    plans: Box<[Plan; 256]>,
    cases: &'static [Case; 256],
}

impl CaseKernels {
    /// For the table of one rule.
    pub fn of(rule: crate::grid::Ambiguous) -> &'static CaseKernels {
        use crate::grid::Ambiguous;
        static SEPARATE: LazyLock<CaseKernels> =
            LazyLock::new(|| CaseKernels::new(Ambiguous::Separate));
        static JOIN: LazyLock<CaseKernels> = LazyLock::new(|| CaseKernels::new(Ambiguous::Join));
        match rule {
            Ambiguous::Separate => &SEPARATE,
            Ambiguous::Join => &JOIN,
        }
    }

    fn new(rule: crate::grid::Ambiguous) -> Self {
        let cases = cases(rule);
        let plan = |c: usize| Plan::new(&cases[c]);
        CaseKernels {
            plans: Box::new(std::array::from_fn(plan)),
            cases,
        }
    }
}

impl Plan {
    fn new(case: &Case) -> Self {
        let mut plan = Plan {
            // those without a triangle name an edge that is there, in case they are written
            corners: [[NUMBER_OF_EDGE[usize::from(case.edges[0][0])]; 4]; MAX_TRIANGLES],
            inside: [[0; 4]; MAX_TRIANGLES],
            low: [UNUSED; 3],
            high: [UNUSED; 3],
            has_low: [0; 3],
            triangles: case.triangles,
            simple: is_one_sheet(case),
        };
        for t in 0..usize::from(case.triangles) {
            for e in 0..3 {
                plan.corners[t][e] = NUMBER_OF_EDGE[usize::from(case.edges[t][e])];
                let half_edge = (N * t + e) as u8;
                match case.across[t][e] {
                    Across::Inside(mate) => plan.inside[t][e] = (mate / 3 + 1) * N as u8 + mate % 3,
                    Across::Face { slot: 1, .. } => plan.simple = false,
                    Across::Face { face, .. } if face % 2 == 0 => {
                        plan.low[usize::from(face / 2)] = half_edge;
                        plan.has_low[usize::from(face / 2)] = -1;
                    }
                    Across::Face { face, .. } => plan.high[usize::from(face / 2)] = half_edge,
                }
            }
        }
        plan
    }
}

/// Whether the triangles hang together.
fn is_one_sheet(case: &Case) -> bool {
    let mut reached = [false; MAX_TRIANGLES];
    let mut waiting = vec![0];
    while let Some(t) = waiting.pop() {
        if std::mem::replace(&mut reached[t], true) {
            continue;
        }
        for across in case.across[t] {
            if let Across::Inside(mate) = across {
                waiting.push(usize::from(mate / 3));
            }
        }
    }
    reached[..usize::from(case.triangles)].iter().all(|&r| r)
}

/// Makes triangles; its buffers are reused from tile to tile.
#[derive(Debug, Default)]
pub struct CubeMarcher {
    /// Half-edges on the upper y face of the row of cubes before, two slots per x.
    row_slots: Vec<[u32; 2]>,
    /// Half-edges on the upper z face of the slice of cubes before, two slots per cube.
    slice_slots: Vec<[u32; 2]>,
    cursors: Vec<Cursor>,
    /// Takes the plain way everywhere.
    #[cfg(test)]
    pub plain: bool,
}

/// What the walk reads.
#[derive(Clone, Copy)]
pub struct MarchInput<'a> {
    /// The crossed edges.
    pub edges: &'a Edges,
    /// The cubes.
    pub tile: &'a TileBox,
    /// Which piece and vertex lies on each edge.
    pub sheets: &'a VertexAssignment,
}

/// What it writes, see [`TileMesh`].
struct Faces<'a> {
    pieces: &'a mut [Piece],
    cursors: UncheckedMut<'a, Cursor>,
    /// The triangles' numbers: by half-edge of the tile its mate, and [`APEXES`] behind it the corner off it.
    triangles: UncheckedMut<'a, u32>,
}

/// The pieces and vertices of [`VertexAssignment`].
#[derive(Clone, Copy)]
struct Numbered<'a> {
    piece_of: Unchecked<'a, u32>,
    vertex_of: Unchecked<'a, u32>,
}

/// A tile whose crossed edges have pieces and vertices.
#[derive(Clone, Copy)]
struct NumberedTile<'a> {
    tile: &'a TileBox,
    numbered: Numbered<'a>,
}

/// Active cubes of one slice of a tile.
#[derive(Clone, Copy)]
struct SliceCubes<'a> {
    cubes: &'a [ActiveCube],
    z: usize,
}

/// Where a piece's triangles go.
#[derive(Debug, Clone, Copy)]
struct Cursor {
    /// Element that stands for none.
    first: u32,
    /// Number of the next triangle.
    next: u32,
}

/// A cube and what it shares with the ones before.
struct Cube<'a> {
    active: &'a ActiveCube,
    at: [usize; 3],
    /// By axis: the slots of the faces it shares.
    slots: [&'a mut [u32; 2]; 3],
}

impl CubeMarcher {
    /// Makes the triangles of all cubes of a tile, whose pieces have their vertices and the place of
    /// their triangles.
    pub fn make(&mut self, cut: MarchInput, plans: &CaseKernels, mesh: &mut TileMesh) {
        let mut cursors = std::mem::take(&mut self.cursors);
        cursors.clear();
        cursors.extend(mesh.pieces.iter().map(|p| Cursor {
            first: p.first_triangle,
            next: 1,
        }));
        let faces = mesh.pieces.last().map_or(0, Piece::end_of_faces) as usize;
        assert!(mesh.triangles.len() >= faces);
        assert!(cut.sheets.are_of(cut.edges));
        // SAFETY: an edge's number counts the crossed edges before it, all of which have a piece and a
        // vertex; a piece's triangles are as many as `room_for` its vertices at most; and a half-edge is
        // one of a triangle before, in the same piece, since the two share vertices
        let (numbered, mut out) = unsafe {
            let numbered = Numbered {
                piece_of: Unchecked::new(&cut.sheets.piece_of),
                vertex_of: Unchecked::new(&cut.sheets.vertex_of),
            };
            let out = Faces {
                pieces: &mut mesh.pieces,
                cursors: UncheckedMut::new(&mut cursors),
                triangles: UncheckedMut::new(bytemuck::cast_slice_mut(&mut mesh.triangles)),
            };
            (numbered, out)
        };
        dispatch!(self.make_inlined(cut, plans, numbered, &mut out));
        for (piece, cursor) in mesh.pieces.iter_mut().zip(&cursors) {
            piece.triangles = cursor.next - 1;
        }
        self.cursors = cursors;
    }

    #[inline(always)]
    fn make_inlined(
        &mut self,
        cut: MarchInput,
        plans: &CaseKernels,
        numbered: Numbered,
        out: &mut Faces,
    ) {
        let from = NumberedTile {
            tile: cut.tile,
            numbered,
        };
        let [cx, cy, cz] = cut.tile.cubes.map(|c| c as usize);
        self.row_slots.resize(cx, [NONE; 2]);
        self.slice_slots.clear();
        self.slice_slots.resize(cx * cy, [NONE; 2]);
        let mut batch = Batch::new();
        for z in 0..cz {
            self.row_slots.fill([NONE; 2]);
            let mut x_slots = [NONE; 2];
            // not by a closure: what is handed to others may be compiled apart, for any processor
            for y in 0..cy {
                let mut row = CubeRow::new(cut.edges, [y, z]);
                while batch.list(&mut row, cut.edges, cut.tile) {
                    let cubes = SliceCubes {
                        cubes: batch.take(),
                        z,
                    };
                    self.write_all(from, plans, cubes, &mut x_slots, out);
                }
            }
            let cubes = SliceCubes {
                cubes: batch.take(),
                z,
            };
            self.write_all(from, plans, cubes, &mut x_slots, out);
        }
    }

    /// Writes the triangles of active cubes of a slice.
    #[inline(always)]
    fn write_all(
        &mut self,
        from: NumberedTile,
        plans: &CaseKernels,
        slice: SliceCubes,
        x_slots: &mut [u32; 2],
        out: &mut Faces,
    ) {
        let NumberedTile { tile, numbered } = from;
        let SliceCubes { cubes, z } = slice;
        let cx = tile.cubes[0] as usize;
        // SAFETY: a row's active cubes lie below `cx`, and those of a slice below that times its rows
        let (mut row_slots, mut slice_slots) = unsafe {
            let row_slots = UncheckedMut::new(&mut self.row_slots);
            (row_slots, UncheckedMut::new(&mut self.slice_slots))
        };
        for cube in cubes {
            let plan = &plans.plans[usize::from(cube.case)];
            let (x, column) = (cube.x as usize, cube.column as usize);
            if x == 0 {
                // what the row before ended with is no neighbour
                *x_slots = [NONE; 2];
            }
            let slots = [
                &mut *x_slots,
                row_slots.at_mut(x),
                slice_slots.at_mut(column),
            ];
            let on_border = cube.on_border;
            #[cfg(test)]
            let on_border = on_border || self.plain;
            if plan.simple && !on_border {
                write_simple(plan, &cube.numbers, numbered, slots, out);
            } else {
                let cube = Cube {
                    active: cube,
                    at: [x, column / cx, z],
                    slots,
                };
                let case = &plans.cases[usize::from(cube.active.case)];
                cube.write(from, case, out);
            }
        }
    }
}

/// Writes the triangles of one sheet that meets each face once at most.
#[inline(always)]
fn write_simple(
    plan: &Plan,
    numbers: &[u32; NUMBERS],
    sheets: Numbered,
    slots: [&mut [u32; 2]; 3],
    out: &mut Faces,
) {
    // SAFETY: the plan's places are below `NUMBERS`
    let numbers = unsafe { Unchecked::new(numbers) };
    let number = |place: u8| numbers.at(usize::from(place)) as usize;
    let piece = sheets.piece_of.at(number(plan.corners[0][0])) as usize;
    let cursor = out.cursors.at_mut(piece);
    let (start, triangle) = (cursor.first as usize, cursor.next);
    cursor.next += u32::from(plan.triangles);
    let at = start + triangle as usize;
    let before = STRIDE * (triangle - 1);
    out.triangles.prefetch(N * (at + AHEAD));
    let vertex = |place: u8| sheets.vertex_of.at(number(place));
    // spelled out, since a closure that is called three times is not compiled into the loop
    macro_rules! put {
        ($t:expr) => {{
            let t: usize = $t;
            let [a, b, c, _] = plan.corners[t];
            let apexes = [vertex(c), vertex(a), vertex(b)];
            out.triangles.put(N * (at + t) + APEXES as usize, apexes);
            let across = plan.inside[t].map(|mate| match u32::from(mate) {
                0 => NONE,
                mate => before + mate,
            });
            out.triangles.put(N * (at + t), across);
        }};
    }
    put!(0);
    put!(1);
    if plan.triangles > 2 {
        put!(2);
        put!(3);
        put!(4);
    }
    let (start, first) = (N * start, STRIDE * triangle);
    for (axis, slots) in slots.into_iter().enumerate() {
        let low = first + u32::from(plan.low[axis]);
        *out.triangles.at_mut(start + low as usize) = slots[0];
        // where there is none, the mate of triangle 0 is written, which is no triangle
        let across = slots[0] & i32::from(plan.has_low[axis]) as u32;
        *out.triangles.at_mut(start + across as usize) = low;
        slots[0] = first + u32::from(plan.high[axis]);
    }
}

impl Cube<'_> {
    /// The triangles of any case.
    #[cold]
    fn write(self, from: NumberedTile, case: &Case, out: &mut Faces) {
        let (tile, sheets) = (from.tile, from.numbered);
        let number = |edge: u8| {
            let place = NUMBER_OF_EDGE[usize::from(edge)];
            self.active.numbers[usize::from(place)] as usize
        };
        let count = usize::from(case.triangles);
        let mut pieces = [0; MAX_TRIANGLES];
        let mut triangles = [0; MAX_TRIANGLES];
        for t in 0..count {
            pieces[t] = sheets.piece_of.at(number(case.edges[t][0])) as usize;
            let cursor = out.cursors.at_mut(pieces[t]);
            triangles[t] = cursor.next;
            cursor.next += 1;
            if self.active.on_border {
                let count = border_edges(tile, self.at, case, t..t + 1);
                out.pieces[pieces[t]].sums.border_edges += count;
            }
        }
        for t in 0..count {
            let start = out.cursors.at(pieces[t]).first as usize;
            let at = start + triangles[t] as usize;
            let vertex = |e: usize| sheets.vertex_of.at(number(case.edges[t][e]));
            let [a, b, c] = [0, 1, 2].map(vertex);
            out.triangles
                .put(N * at, [NONE, NONE, NONE, NONE, NONE, c, a, b]);
            for e in 0..3 {
                let half_edge = STRIDE * triangles[t] + e as u32;
                let mut link = |from: u32, to: u32| {
                    *out.triangles.at_mut(N * start + from as usize) = to;
                };
                match case.across[t][e] {
                    Across::Inside(mate) => {
                        let mate = usize::from(mate);
                        let across = STRIDE * triangles[mate / 3] + mate as u32 % 3;
                        link(half_edge, across);
                    }
                    Across::Face { face, slot } if face % 2 == 0 => {
                        let held = self.slots[usize::from(face / 2)][usize::from(slot)];
                        if held != NONE {
                            link(half_edge, held);
                            link(held, half_edge);
                        }
                    }
                    Across::Face { .. } => {}
                }
            }
        }
        // only now: a slot is read for the lower face before it is written for the upper one
        for t in 0..count {
            for e in 0..3 {
                if let Across::Face { face, slot } = case.across[t][e]
                    && face % 2 == 1
                {
                    let half_edge = STRIDE * triangles[t] + e as u32;
                    self.slots[usize::from(face / 2)][usize::from(slot)] = half_edge;
                }
            }
        }
    }
}

/// Edges of some of a cube's triangles on the volume's faces.
#[cold]
fn border_edges(
    tile: &TileBox,
    at: [usize; 3],
    case: &Case,
    triangles: std::ops::Range<usize>,
) -> u64 {
    let across = case.across[triangles].as_flattened();
    let on_border = across.iter().filter(|a| match a {
        Across::Inside(_) => false,
        Across::Face { face, .. } => {
            let axis = usize::from(face / 2);
            if face % 2 == 0 {
                tile.first_cube[axis] == 0 && at[axis] == 0
            } else {
                tile.is_last[axis] && at[axis] + 1 == tile.cubes[axis] as usize
            }
        }
    });
    on_border.count() as u64
}
