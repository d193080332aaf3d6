//! Where the surface crosses edges of the grid, and which end of the edge is above, from single triangles.

use crate::grid::LATTICE;

/// Steps of the lattice in a voxel.
const STEP: i32 = LATTICE as i32;

/// A crossing of an edge of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Crossing {
    /// The axis along which the edge runs.
    pub axis: u8,
    /// The voxel at the lower end of the edge.
    pub voxel: [u16; 3],
    /// True if this voxel is above, and the one at the upper end below.
    pub falls: bool,
}

/// Finds the crossings of all edges along x; of those along y in the grid's last plane across x; and of those along z on
/// the last line of that plane. They tell every voxel: the state of the last one being known, the line gives the ends of
/// the plane's rows, these give the ends of all rows, and the edges of a row give its voxels.
///
/// A vertex belongs to up to four cubes, in each of which the loop of the surface passes through it between two of the
/// cube's faces. It is counted in one cube and one of these faces alone.
#[derive(Debug, Clone, Copy)]
pub struct Finder {
    /// The last voxel along each axis.
    last: [i32; 3],
}

impl Finder {
    /// For a grid of so many voxels.
    pub fn new(dims: [u32; 3]) -> Self {
        Finder {
            last: dims.map(|n| n as i32 - 1),
        }
    }

    /// Calls `each` for the crossings that a triangle stands for. Its corners are in steps of the lattice and wind
    /// counter-clockwise seen from below.
    #[inline]
    pub fn of_triangle(&self, corners: [[i32; 3]; 3], each: &mut impl FnMut(Crossing)) {
        let cube = cube_of(&corners);
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            self.of_edge([corners[a], corners[b]], cube, each);
        }
    }

    /// The crossings at the two ends of a directed side of a triangle in a cube.
    fn of_edge(&self, ends: [[i32; 3]; 2], cube: [i32; 3], each: &mut impl FnMut(Crossing)) {
        let [from, to] = ends;
        for (own, other) in [(from, to), (to, from)] {
            let Some(axis) = self.counted(own, cube) else {
                continue;
            };
            // rows are counted in the faces across z, the last line in that across y
            let across = if axis == 2 { 1 } else { 2 };
            if own[across] != other[across] {
                continue;
            }
            let ahead: [i32; 3] = std::array::from_fn(|r| to[r] - from[r]);
            let rises = below_is_ahead(axis, ahead) == (own[across] == cube[across] * STEP);
            each(Crossing {
                axis: axis as u8,
                voxel: own.map(|v| v.div_euclid(STEP) as u16),
                falls: rises,
            });
        }
    }

    /// The axis of the edge that a vertex lies on, if it is one that counts and this is the cube in which it does.
    fn counted(&self, vertex: [i32; 3], cube: [i32; 3]) -> Option<usize> {
        let axis = (0..3).find(|&a| vertex[a] % STEP != 0)?;
        let voxel = vertex.map(|v| v.div_euclid(STEP));
        // a tile from elsewhere may say anything
        let inside = (0..3).all(|a| (0..=self.last[a]).contains(&voxel[a]));
        if !inside || voxel[axis] == self.last[axis] {
            return None;
        }
        let is_last = |a: usize| voxel[a] == self.last[a];
        let counts = match axis {
            0 => true,
            1 => is_last(0),
            _ => is_last(0) && is_last(1),
        };
        let own: [i32; 3] = std::array::from_fn(|a| voxel[a].min(self.last[a] - 1));
        (counts && own == cube).then_some(axis)
    }
}

/// The cube that a triangle lies in: none lies in a face, so the mean of its corners is inside.
fn cube_of(corners: &[[i32; 3]; 3]) -> [i32; 3] {
    std::array::from_fn(|a| (corners[0][a] + corners[1][a] + corners[2][a]).div_euclid(3 * STEP))
}

/// Whether the end of the edge with the greater number is below, if the side `ahead` of a triangle lies in the lower face
/// of a cube, across z, or for an edge along z, across y; in the upper face it is the other way round.
///
/// A triangle lies on the left of its sides, seen from below, so the below phase lies along the product of the side
/// and the inward normal of the face.
fn below_is_ahead(axis: usize, ahead: [i32; 3]) -> bool {
    match axis {
        0 => ahead[1] > 0,
        1 => ahead[0] < 0,
        _ => ahead[0] > 0,
    }
}
