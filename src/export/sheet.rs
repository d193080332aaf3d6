//! The kept surface of one tile, each vertex once, with what its neighbours need to sew it on.

use super::choice::Choice;
use super::gaps::Gaps;
use super::simplify::{self, InGrid, Simplified};
use crate::error::{Error, Result};
use crate::grid::{LATTICE, Tiling};
use crate::manifest::TileEntry;
use crate::tile::SurfacePiece;
use crate::tileset::TileSet;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Lattice steps per voxel.
const STEPS: i32 = LATTICE as i32;
/// Caps lie this many steps outside the grid.
const OUTSIDE: i32 = STEPS / 2;

/// The kept surface of a tile.
#[derive(Debug, Default)]
pub(super) struct Sheet {
    /// Macrocube index.
    pub grid: [u32; 3],
    /// Vertices in lattice steps, no two the same, in the order of the pieces that bring them.
    pub points: Vec<[i32; 3]>,
    /// Unit normals in voxel coordinates, one for each vertex.
    pub normals: Vec<[f32; 3]>,
    /// Triangles over `points`, piece after piece.
    pub triangles: Vec<[u32; 3]>,
    /// Pieces in the order of the file.
    pub pieces: Vec<Piece>,
    /// Vertices on the planes shared with the tiles before along x, y and z, by rising key.
    pub lower: [Vec<PlaneVertex>; 3],
    /// The same for the tiles after.
    pub upper: [Vec<PlaneVertex>; 3],
    /// What simplification did.
    pub simplified: Simplified,
    /// Edges without a mate.
    pub gaps: Gaps,
}

/// A piece of a sheet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Cell; 0 for a cap.
    pub cell: u64,
    /// Object.
    pub object: u64,
    /// End of its vertices among those of the sheet: of those that no earlier piece has.
    pub vertices: usize,
    /// End of its triangles among those of the sheet.
    pub triangles: usize,
}

/// A vertex on a plane between tiles: its place in the plane, and its number in the sheet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PlaneVertex {
    pub key: u64,
    pub vertex: u32,
}

/// A macrocube's extent in lattice steps, and which of its planes have a tile beyond.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region {
    pub low: [i32; 3],
    pub high: [i32; 3],
    pub before: [bool; 3],
    pub after: [bool; 3],
}

impl Region {
    /// The region of a macrocube inside the grid.
    pub fn new(tiling: Tiling, grid: [u32; 3]) -> Self {
        let cubes = |a: usize| tiling.cubes(a, grid[a]);
        Region {
            low: std::array::from_fn(|a| cubes(a).start as i32 * STEPS),
            high: std::array::from_fn(|a| cubes(a).end as i32 * STEPS),
            before: grid.map(|g| g > 0),
            after: std::array::from_fn(|a| grid[a] + 1 < tiling.tiles()[a]),
        }
    }

    /// A position as lattice steps; `None` if it is not on the lattice or not in the region.
    fn lattice(&self, position: [f32; 3]) -> Option<[i32; 3]> {
        let mut point = [0; 3];
        for a in 0..3 {
            let steps = position[a] * LATTICE as f32;
            // a float that is no number fails the comparison
            let near = steps.abs() <= (1 << 25) as f32;
            if !near || steps.fract() != 0.0 {
                return None;
            }
            point[a] = steps as i32;
            let low = self.low[a] - if self.before[a] { 0 } else { OUTSIDE };
            let high = self.high[a] + if self.after[a] { 0 } else { OUTSIDE };
            if point[a] < low || point[a] > high {
                return None;
            }
        }
        Some(point)
    }

    /// True for a vertex on a plane that is shared with a tile before.
    pub fn on_lower(&self, p: [i32; 3]) -> bool {
        (0..3).any(|a| self.before[a] && p[a] == self.low[a])
    }

    /// True for a vertex on a plane that is shared with a tile after.
    pub fn on_upper(&self, p: [i32; 3]) -> bool {
        (0..3).any(|a| self.after[a] && p[a] == self.high[a])
    }

    /// True if two vertices lie on the same face of the volume.
    pub fn on_face(&self, p: [i32; 3], q: [i32; 3]) -> bool {
        (0..3).any(|a| {
            let is_face = |v: i32| {
                (!self.before[a] && v == self.low[a]) || (!self.after[a] && v == self.high[a])
            };
            p[a] == q[a] && is_face(p[a])
        })
    }
}

/// The place of a point in a plane across `axis`, caps included.
fn plane_key(axis: usize, p: [i32; 3]) -> u64 {
    let [u, v] = [[p[1], p[2]], [p[0], p[2]], [p[0], p[1]]][axis];
    u64::from((u + STEPS) as u32) << 32 | u64::from((v + STEPS) as u32)
}

impl Sheet {
    /// Reads a tile, drops what is not chosen, simplifies what is left and joins vertices that pieces
    /// share (those of caps).
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the tile is damaged.
    pub fn read(
        set: &TileSet,
        entry: &TileEntry,
        choice: &Choice,
        simplify: Option<&InGrid>,
    ) -> Result<Sheet> {
        let manifest = set.manifest();
        let region = Region::new(manifest.tiling(), entry.grid);
        let mut tile = set.read_tile(entry)?;
        tile.pieces.retain(|p| choice.keeps(&p.ids));
        let mut points = Vec::with_capacity(tile.pieces.len());
        for piece in &tile.pieces {
            points.push(lattice(piece, &region).map_err(|found| {
                let expected = "positions on multiples of 1/256 inside the tile";
                Error::format(set.dir().join(&entry.path), found, expected)
                    .with_hint("`alvis verify` says more")
            })?);
        }
        let mut simplified = Simplified::default();
        if let Some(simplify) = simplify {
            simplified = simplify::pieces(&mut tile.pieces, &points, &region, simplify);
        }
        let mut sheet = Sheet {
            grid: entry.grid,
            simplified,
            ..Sheet::default()
        };
        let mut joined = HashMap::with_capacity(points.iter().map(Vec::len).sum());
        for (piece, points) in tile.pieces.iter().zip(&points) {
            sheet.add(piece, points, &mut joined);
        }
        sheet.find_planes(&region);
        sheet.gaps = Gaps::of(&sheet, &region);
        Ok(sheet)
    }

    /// Adds a piece with those of its vertices that have a triangle.
    fn add(
        &mut self,
        piece: &SurfacePiece,
        points: &[[i32; 3]],
        joined: &mut HashMap<[i32; 3], u32>,
    ) {
        const UNSEEN: u32 = u32::MAX;
        let mut renamed = vec![UNSEEN; points.len()];
        for &i in piece.triangles.as_flattened() {
            renamed[i as usize] = 0;
        }
        for (i, new) in renamed.iter_mut().enumerate().filter(|(_, n)| **n == 0) {
            let next = self.points.len() as u32;
            *new = match joined.entry(points[i]) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(free) => {
                    self.points.push(points[i]);
                    self.normals.push(piece.normals[i]);
                    *free.insert(next)
                }
            };
        }
        let triangles = piece.triangles.iter();
        self.triangles
            .extend(triangles.map(|t| t.map(|i| renamed[i as usize])));
        self.pieces.push(Piece {
            cell: piece.ids.cell,
            object: piece.ids.object,
            vertices: self.points.len(),
            triangles: self.triangles.len(),
        });
    }

    fn find_planes(&mut self, region: &Region) {
        for (i, &p) in self.points.iter().enumerate() {
            for a in 0..3 {
                let vertex = PlaneVertex {
                    key: plane_key(a, p),
                    vertex: i as u32,
                };
                if region.before[a] && p[a] == region.low[a] {
                    self.lower[a].push(vertex);
                }
                if region.after[a] && p[a] == region.high[a] {
                    self.upper[a].push(vertex);
                }
            }
        }
        for plane in self.lower.iter_mut().chain(&mut self.upper) {
            plane.sort_unstable();
        }
    }

    /// The pieces with their new vertices and their triangles.
    pub fn parts(&self) -> impl Iterator<Item = (Piece, std::ops::Range<usize>, &[[u32; 3]])> {
        let mut from = [0; 2];
        self.pieces.iter().map(move |piece| {
            let vertices = from[0]..piece.vertices;
            let triangles = &self.triangles[from[1]..piece.triangles];
            from = [piece.vertices, piece.triangles];
            (*piece, vertices, triangles)
        })
    }
}

/// The positions of a piece as lattice steps, or the first that has none.
fn lattice(piece: &SurfacePiece, region: &Region) -> Result<Vec<[i32; 3]>, String> {
    let step = |&p: &[f32; 3]| region.lattice(p).ok_or(format!("the position {p:?}"));
    piece.positions.iter().map(step).collect()
}
