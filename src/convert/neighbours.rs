//! What walls and openings tell of each cell: how many neighbours it has, and how thick its walls are.

use crate::convert::cells::{Opening, Wall};
use crate::convert::components::Components;
use crate::error::Result;
use crate::grid::Placement;
use crate::measure::AreaScale;
use crate::sys::sorted_spill::{Keyed, Sorter};
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 14;
/// Walls of fewer faces of a voxel make no neighbours: two cells see each other through the gaps of others.
const LEAST_FACES: f64 = 10.0;
/// Nor do walls of a smaller part of the area of the one of both cells that has less.
const LEAST_PART: f64 = 0.01;

/// Two cells, the smaller id first.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
struct Pair([u64; 2]);

impl Keyed for Pair {
    fn key(&self) -> [u64; 2] {
        self.0
    }
}

/// A wall of a cell.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct WallOfCell {
    /// Place of the cell.
    place: u64,
    thickness: f64,
    area: u64,
}

impl Keyed for WallOfCell {
    fn key(&self) -> [u64; 2] {
        // bits of positive numbers are in the order of these
        [self.place, self.thickness.to_bits()]
    }
}

/// Enters the neighbours of each cell and the median thickness of its walls by area, where walls are known.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn add_walls(components: &mut Components, place: &Placement, work: &Path) -> Result<()> {
    let Some(given) = &mut components.given else {
        return Ok(());
    };
    let (cells, parts, ids) = (&components.cells, &mut given.parts, &given.cells.ids);
    let place_of = |cell| ids.rank(cell).expect("cells of walls have voxels");
    let [x, y, z] = place.spacing;
    let mean_face = (y * z + x * z + x * y) / 3.0;
    let scale = AreaScale::new(place.spacing);
    let mut pairs = Sorter::new(work, ROOM)?;
    let mut of_cells = Sorter::new(work, ROOM)?;
    let openings = &given.cells.openings;
    openings.each(|opening: Opening| pairs.push(Pair(opening.cells)))?;
    given.cells.walls.each(|wall: Wall| {
        let places = wall.cells.map(place_of);
        let mut smaller = f64::INFINITY;
        for place in places {
            smaller = smaller.min(scale.area(cells.get(place)?.mesh.area));
            parts.update(place, |part| part.wall_area += wall.area_steps)?;
            of_cells.push(WallOfCell {
                place,
                thickness: wall.thickness,
                area: wall.area_steps,
            })?;
        }
        let least = (LEAST_FACES * mean_face).max(LEAST_PART * smaller);
        match wall.area(place.spacing) >= least {
            true => pairs.push(Pair(wall.cells)),
            false => Ok(()),
        }
    })?;
    let mut last = None;
    pairs.finish(|Pair(cells)| match last.replace(cells) == Some(cells) {
        true => Ok(()),
        false => cells
            .into_iter()
            .try_for_each(|cell| parts.update(place_of(cell), |part| part.neighbours += 1)),
    })?;
    // the place at hand, and the area of its walls so far
    let mut sum = (u64::MAX, 0);
    of_cells.finish(|wall: WallOfCell| {
        if sum.0 != wall.place {
            sum = (wall.place, 0);
        }
        let before = sum.1;
        sum.1 += wall.area;
        let whole = parts.get(wall.place)?.wall_area;
        match 2 * before < whole && 2 * sum.1 >= whole {
            true => parts.update(wall.place, |part| part.wall_thickness = wall.thickness),
            false => Ok(()),
        }
    })
}
