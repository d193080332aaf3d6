//! What walls and openings tell of each cell: how many neighbours it has, and how thick its walls are.

use crate::convert::cells::Opening;
use crate::convert::components::Components;
use crate::convert::memory::FOR_WALLS_OF_CELLS;
use crate::convert::walls::Wall;
use crate::error::Result;
use crate::grid::Placement;
use crate::measure::{AreaScale, RecordTable};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 14;
/// Walls of fewer faces of a voxel make no neighbours: two cells see each other through the gaps of others.
const LEAST_FACES: f64 = 5.0;
/// Nor do walls of a smaller part of the area of the one of both cells that has less.
const LEAST_PART: f64 = 0.005;
/// Nor do those that are as many times thicker than the walls of either cell: lines that run along a flat wall join the
/// cells at its two ends.
const MOST_TIMES: f64 = 1.8;

/// Walls, and what they tell of each cell.
pub struct CellWalls {
    /// The walls, by rising ids.
    pub walls: SpillFile,
    /// What they tell, by the places of the cells' ids.
    pub of_cells: RecordTable<WallsOfCell>,
}

/// What walls tell of a cell.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct WallsOfCell {
    /// Cells that it has an opening or a large enough wall to.
    pub neighbours: u64,
    /// Sum of its walls' areas, see [`Wall::area_steps`].
    pub area_steps: u64,
    /// Median thickness of its walls by area, in voxels of the finest axis; 0 if it has none.
    pub thickness: f64,
}

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

/// Finds the neighbours of each cell and the median thickness of its walls by area, for a table of at most `memory` bytes
/// in memory, and enters them.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn add_walls(
    components: &mut Components,
    walls: SpillFile,
    place: &Placement,
    memory: u64,
    work: &Path,
) -> Result<()> {
    let known = &*components;
    let room = FOR_WALLS_OF_CELLS.of(memory);
    let mut of_cells = RecordTable::<WallsOfCell>::new(known.cells.len(), room, work)?;
    let mut sorted = Sorter::new(work, ROOM)?;
    walls.each(|wall: Wall| {
        wall.cells.into_iter().try_for_each(|cell| {
            let place = known.place_of_cell(cell);
            of_cells.update(place, |own| own.area_steps += wall.area_steps)?;
            sorted.push(WallOfCell {
                place,
                thickness: wall.thickness,
                area: wall.area_steps,
            })
        })
    })?;
    add_medians(sorted, &mut of_cells)?;
    let pairs = neighbours(known, &walls, &of_cells, place, work)?;
    let mut last = None;
    pairs.finish(|Pair(cells)| {
        let is_new = last.replace(cells) != Some(cells);
        cells.into_iter().filter(|_| is_new).try_for_each(|cell| {
            of_cells.update(known.place_of_cell(cell), |own| own.neighbours += 1)
        })
    })?;
    components.walls = Some(CellWalls { walls, of_cells });
    Ok(())
}

/// Pairs of cells with an opening, and those with a wall that makes neighbours.
fn neighbours(
    known: &Components,
    walls: &SpillFile,
    of_cells: &RecordTable<WallsOfCell>,
    place: &Placement,
    work: &Path,
) -> Result<Sorter<Pair>> {
    let mut pairs = Sorter::new(work, ROOM)?;
    if let Some(given) = &known.given {
        let openings = &given.cells.openings;
        openings.each(|opening: Opening| pairs.push(Pair(opening.cells)))?;
    }
    let rule = NeighbourRule::new(known, of_cells, place);
    walls.each(|wall: Wall| match rule.holds(&wall)? {
        true => pairs.push(Pair(wall.cells)),
        false => Ok(()),
    })?;
    Ok(pairs)
}

/// Which walls make their cells neighbours.
pub struct NeighbourRule<'a> {
    known: &'a Components,
    of_cells: &'a RecordTable<WallsOfCell>,
    spacing: [f64; 3],
    scale: AreaScale,
    /// The least area of a wall between cells of any size.
    least: f64,
}

impl<'a> NeighbourRule<'a> {
    /// For walls of these cells, of which `of_cells` knows the thickness.
    pub fn new(
        known: &'a Components,
        of_cells: &'a RecordTable<WallsOfCell>,
        place: &Placement,
    ) -> Self {
        let [x, y, z] = place.spacing;
        let mean_face = (y * z + x * z + x * y) / 3.0;
        NeighbourRule {
            known,
            of_cells,
            spacing: place.spacing,
            scale: AreaScale::new(place.spacing),
            least: LEAST_FACES * mean_face,
        }
    }

    /// True if a wall is large enough, and not much thicker than the walls of both cells.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn holds(&self, wall: &Wall) -> Result<bool> {
        let (mut smaller, mut thicker) = (f64::INFINITY, 0.0);
        for cell in wall.cells {
            let own = self.of_cells.get(self.known.place_of_cell(cell))?;
            smaller = self
                .scale
                .area(self.known.cell(cell)?.mesh.area)
                .min(smaller);
            thicker = own.thickness.max(thicker);
        }
        let least = self.least.max(LEAST_PART * smaller);
        Ok(wall.area(self.spacing) >= least && wall.thickness <= MOST_TIMES * thicker)
    }
}

/// Enters the median thickness by area, given the sum of all areas.
fn add_medians(sorted: Sorter<WallOfCell>, of_cells: &mut RecordTable<WallsOfCell>) -> Result<()> {
    let (mut place, mut sum) = (u64::MAX, 0);
    sorted.finish(|wall| {
        if place != wall.place {
            (place, sum) = (wall.place, 0);
        }
        let before = sum;
        sum += wall.area;
        let whole = of_cells.get(place)?.area_steps;
        match 2 * before < whole && 2 * sum >= whole {
            true => of_cells.update(place, |own| own.thickness = wall.thickness),
            false => Ok(()),
        }
    })
}
