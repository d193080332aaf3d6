//! Which cells touch the border, by the cells of all voxels: those with a voxel at a face of the grid, and those that the
//! edge of a region of interest cuts. It does so where a face of a voxel parts what is below from what is above, or a cell
//! from another one, and is beside a voxel outside, or only one of the two is inside; and across edges of voxels, where the
//! phase that is joined there is inside and the other one outside.

use super::rows::CellVolume;
use crate::error::Result;
use crate::grid::Ambiguous;
use crate::sys::id_set::IdSet;
use crate::verify::region_edge::RegionEdge;
use crate::volume::Volume;

/// The cell of each voxel of a slice, 0 for none, and whether it is inside.
#[derive(Default, Clone)]
struct Slice {
    cells: Vec<u32>,
    inside: Vec<bool>,
}

/// A voxel: its cell, 0 for none, and whether it is inside.
type Voxel = (u32, bool);

/// The cells that touch the border.
///
/// # Errors
/// Those of the volume and of the region.
pub(super) fn cells_at_border(
    cells: &CellVolume,
    edge: RegionEdge,
    rule: Ambiguous,
) -> Result<IdSet> {
    let [nx, ny, nz] = cells.header().dims.0;
    let (mut below, mut here) = (Slice::default(), Slice::default());
    let (mut found, mut words) = (IdSet::default(), Vec::new());
    for z in 0..nz {
        std::mem::swap(&mut below, &mut here);
        here.cells.resize(nx as usize * ny as usize, 0);
        let out = bytemuck::cast_slice_mut(&mut here.cells);
        cells.read_box(0..nx, 0..ny, z..z + 1, out)?;
        edge.slice([nx, ny], z, &mut words)?;
        let row_words = words.len() / ny as usize;
        here.inside.clear();
        for row in words.chunks_exact(row_words) {
            let bits = (0..nx as usize).map(|x| row[x / 64] >> (x % 64) & 1 == 1);
            here.inside.extend(bits);
        }
        let slices = Slices {
            below: (z > 0).then_some(&below),
            here: &here,
            size: [nx as usize, ny as usize],
        };
        for y in 0..ny as usize {
            for x in 0..nx as usize {
                let own = slices.at([x, y], 0, [0; 2]);
                let own = own.expect("a voxel of the slice");
                let at_face = [(x as u32, nx), (y as u32, ny), (z, nz)]
                    .iter()
                    .any(|&(at, n)| at == 0 || at + 1 == n);
                if at_face {
                    insert(&mut found, own.0);
                }
                slices.compare([x, y], own, rule, &mut found);
            }
        }
    }
    Ok(found)
}

fn insert(found: &mut IdSet, cell: u32) {
    if cell != 0 {
        found.insert(cell.into());
    }
}

struct Slices<'a> {
    below: Option<&'a Slice>,
    here: &'a Slice,
    size: [usize; 2],
}

impl Slices<'_> {
    /// The voxel so many steps along x and y from one, of the slice itself or of the one below.
    fn at(&self, [x, y]: [usize; 2], slices: usize, steps: [isize; 2]) -> Option<Voxel> {
        let slice = if slices == 0 {
            Some(self.here)
        } else {
            self.below
        }?;
        let x = x
            .checked_add_signed(steps[0])
            .filter(|x| *x < self.size[0])?;
        let y = y
            .checked_add_signed(steps[1])
            .filter(|y| *y < self.size[1])?;
        let at = y * self.size[0] + x;
        Some((slice.cells[at], slice.inside[at]))
    }

    /// Compares a voxel with those of its neighbours that come before it.
    fn compare(&self, place: [usize; 2], own: Voxel, rule: Ambiguous, found: &mut IdSet) {
        for (slices, steps) in [(0, [-1, 0]), (0, [0, -1]), (1, [0, 0])] {
            if let Some(other) = self.at(place, slices, steps) {
                across_face([own, other], found);
            }
        }
        let beside = [
            (0, [-1, -1]),
            (0, [1, -1]),
            (1, [-1, 0]),
            (1, [1, 0]),
            (1, [0, -1]),
            (1, [0, 1]),
        ];
        for (slices, steps) in beside {
            if let Some(other) = self.at(place, slices, steps) {
                across_edge([own, other], rule, found);
                across_edge([other, own], rule, found);
            }
        }
    }
}

fn across_face([(a, a_inside), (b, b_inside)]: [Voxel; 2], found: &mut IdSet) {
    let parts_phases = (a == 0) != (b == 0) && !(a_inside && b_inside);
    if parts_phases || a != b && a_inside != b_inside {
        insert(found, a);
        insert(found, b);
    }
}

/// The first one inside, the second one outside.
fn across_edge(voxels: [Voxel; 2], rule: Ambiguous, found: &mut IdSet) {
    let [(a, true), (b, false)] = voxels else {
        return;
    };
    let is_joined = match rule {
        Ambiguous::Separate => a != 0 && b == 0,
        Ambiguous::Join => a == 0 && b != 0,
    };
    if is_joined {
        insert(found, a);
        insert(found, b);
    }
}
