//! What walls and openings tell of each cell: how many neighbours it has, and how thick its walls are.
//!
//! All is sorted by cells, then by pairs of them, so that cells and walls come in any order, from all parts of a volume.

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
use std::path::{Path, PathBuf};

/// Records that are sorted in memory.
const ROOM: usize = 1 << 13;
/// Walls of fewer faces of a voxel make no neighbours: two cells see each other through the gaps of others.
const LEAST_FACES: f64 = 5.0;
/// Nor do walls of a smaller part of the area of the one of both cells that has less.
const LEAST_PART: f64 = 0.005;
/// Nor do those that are as many times thicker than the walls of either cell: lines that run along a flat wall join the
/// cells at its two ends.
const MOST_TIMES: f64 = 1.8;

/// Walls, and what they tell of each cell.
pub struct CellWalls {
    /// The walls, by rising ids, each a [`JudgedWall`].
    pub walls: SpillFile,
    /// What they tell, by the places of the cells' ids.
    pub of_cells: RecordTable<WallsOfCell>,
}

/// A wall, and whether it makes its cells neighbours.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct JudgedWall {
    /// The wall.
    pub wall: Wall,
    /// 1 if it does.
    pub neighbour: u64,
}

/// What walls tell of a cell.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct WallsOfCell {
    /// The cell.
    pub cell: u64,
    /// Cells that it has an opening or a large enough wall to.
    pub neighbours: u64,
    /// Sum of its walls' areas, see [`Wall::area_steps`].
    pub area_steps: u64,
    /// Median thickness of its walls by area, in voxels of the finest axis; 0 if it has none.
    pub thickness: f64,
}

impl WallsOfCell {
    fn merge(&mut self, other: &WallsOfCell) {
        self.neighbours += other.neighbours;
        self.area_steps += other.area_steps;
        // one of them has it
        self.thickness = self.thickness.max(other.thickness);
    }
}

impl Keyed for WallsOfCell {
    fn key(&self) -> [u64; 2] {
        [self.cell, 0]
    }
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

/// A wall of a cell, or, with thickness 0, which no wall has, a part of the sum over all of them.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct WallOfCell {
    cell: u64,
    thickness: f64,
    area: u64,
}

impl Keyed for WallOfCell {
    fn key(&self) -> [u64; 2] {
        // bits of positive numbers are in the order of these
        [self.cell, self.thickness.to_bits()]
    }
}

/// An area as [`AreaScale`] counts it, in a record of a file: the low half and the high one.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct AreaSteps([u64; 2]);

impl From<u128> for AreaSteps {
    fn from(area: u128) -> Self {
        AreaSteps([area as u64, (area >> 64) as u64])
    }
}

impl From<AreaSteps> for u128 {
    fn from(AreaSteps([low, high]): AreaSteps) -> Self {
        u128::from(high) << 64 | u128::from(low)
    }
}

/// A wall of a cell and what is known of the cell, or, without a wall, a part of that.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct AtCell {
    wall: Wall,
    cell: u64,
    /// Area of its surface.
    area: AreaSteps,
    /// Median thickness of its walls.
    thickness: f64,
}

impl Keyed for AtCell {
    fn key(&self) -> [u64; 2] {
        // what has no wall comes first
        [self.cell, u64::from(self.wall.cells != [0; 2])]
    }
}

/// The same, by walls.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct AtWall(AtCell);

impl Keyed for AtWall {
    fn key(&self) -> [u64; 2] {
        self.0.wall.cells
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
    let mut found = Neighbours::new(work)?;
    for at in 0..known.cells.len() {
        let area = known.cells.get(at)?.mesh.area;
        found.add_cell(known.id_of_cell(at), area.into())?;
    }
    if let Some(given) = &known.given {
        let openings = &given.cells.openings;
        openings.each(|opening: Opening| found.add_opening(opening.cells))?;
    }
    walls.each(|wall: Wall| found.add_wall(wall))?;
    let room = FOR_WALLS_OF_CELLS.of(memory);
    let mut of_cells = RecordTable::<WallsOfCell>::new(known.cells.len(), room, work)?;
    let mut judged = SpillFile::new(work)?;
    found.finish(
        place,
        |wall| judged.push(&[wall]).map(|_| ()),
        |of_cell| of_cells.update(known.place_of_cell(of_cell.cell), |own| *own = of_cell),
    )?;
    judged.mark()?;
    components.walls = Some(CellWalls {
        walls: judged,
        of_cells,
    });
    Ok(())
}

/// Finds out which cells are neighbours, and what walls tell of each.
pub struct Neighbours {
    of_cells: Sorter<WallOfCell>,
    at_cells: Sorter<AtCell>,
    pairs: Sorter<Pair>,
    work: PathBuf,
}

impl Neighbours {
    /// Of no cells yet; temporary files lie in `work`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(work: &Path) -> Result<Self> {
        Ok(Neighbours {
            of_cells: Sorter::new(work, ROOM)?,
            at_cells: Sorter::new(work, ROOM)?,
            pairs: Sorter::new(work, ROOM)?,
            work: work.to_path_buf(),
        })
    }

    /// Takes the area of the surface of a cell, or of a part of it.
    pub fn add_cell(&mut self, cell: u64, area: AreaSteps) -> Result<()> {
        let mut known = AtCell::zeroed();
        (known.cell, known.area) = (cell, area);
        self.at_cells.push(known)
    }

    /// Takes two cells with an opening between them, the smaller id first.
    pub fn add_opening(&mut self, cells: [u64; 2]) -> Result<()> {
        self.pairs.push(Pair(cells))
    }

    /// Takes a wall.
    pub fn add_wall(&mut self, wall: Wall) -> Result<()> {
        wall.cells.into_iter().try_for_each(|cell| {
            for thickness in [0.0, wall.thickness] {
                let area = wall.area_steps;
                self.of_cells.push(WallOfCell {
                    cell,
                    thickness,
                    area,
                })?;
            }
            let mut own = AtCell::zeroed();
            (own.cell, own.wall) = (cell, wall);
            self.at_cells.push(own)
        })
    }

    /// Hands on all walls, by rising ids, and then what they and openings tell of each cell that has any, by rising ids.
    pub fn finish(
        self,
        place: &Placement,
        mut each_wall: impl FnMut(JudgedWall) -> Result<()>,
        each_cell: impl FnMut(WallsOfCell) -> Result<()>,
    ) -> Result<()> {
        let Neighbours {
            of_cells,
            mut at_cells,
            mut pairs,
            work,
        } = self;
        let mut found = Sorter::new(&work, ROOM)?;
        each_median(of_cells, |of_cell| {
            let mut known = AtCell::zeroed();
            (known.cell, known.thickness) = (of_cell.cell, of_cell.thickness);
            at_cells.push(known)?;
            found.push(of_cell)
        })?;
        let rule = NeighbourRule::new(place);
        each_with_cells(at_cells, &work, |sides| {
            let wall = sides[0].wall;
            let holds = rule.holds(&sides);
            if holds {
                pairs.push(Pair(wall.cells))?;
            }
            let neighbour = u64::from(holds);
            each_wall(JudgedWall { wall, neighbour })
        })?;
        let same = |_: &mut Pair, _: &Pair| ();
        pairs.finish_merged(same, |Pair(cells)| {
            cells.into_iter().try_for_each(|cell| {
                let mut of_cell = WallsOfCell::zeroed();
                (of_cell.cell, of_cell.neighbours) = (cell, 1);
                found.push(of_cell)
            })
        })?;
        found.finish_merged(WallsOfCell::merge, each_cell)
    }
}

/// Finds the median thickness by area of each cell.
fn each_median(
    sorted: Sorter<WallOfCell>,
    mut each: impl FnMut(WallsOfCell) -> Result<()>,
) -> Result<()> {
    let mut at_hand: Option<WallsOfCell> = None;
    let mut sum = 0;
    sorted.finish(|wall| {
        if at_hand.is_none_or(|own| own.cell != wall.cell) {
            let mut next = WallsOfCell::zeroed();
            (next.cell, sum) = (wall.cell, 0);
            at_hand.replace(next).map_or(Ok(()), &mut each)?;
        }
        let own = at_hand.as_mut().expect("that of the wall");
        if wall.thickness == 0.0 {
            own.area_steps += wall.area;
            return Ok(());
        }
        let before = sum;
        sum += wall.area;
        if 2 * before < own.area_steps && 2 * sum >= own.area_steps {
            own.thickness = wall.thickness;
        }
        Ok(())
    })?;
    at_hand.map_or(Ok(()), each)
}

/// Calls `each` for every wall, by rising ids, with what is known of its two cells.
fn each_with_cells(
    at_cells: Sorter<AtCell>,
    work: &Path,
    mut each: impl FnMut([AtCell; 2]) -> Result<()>,
) -> Result<()> {
    let mut at_walls = Sorter::new(work, ROOM)?;
    let mut known = AtCell::zeroed();
    at_cells.finish(|mut at| {
        if known.cell != at.cell {
            known = AtCell::zeroed();
            known.cell = at.cell;
        }
        if at.wall.cells == [0; 2] {
            known.area = (u128::from(known.area) + u128::from(at.area)).into();
            known.thickness = known.thickness.max(at.thickness);
            return Ok(());
        }
        (at.area, at.thickness) = (known.area, known.thickness);
        at_walls.push(AtWall(at))
    })?;
    let mut other = None;
    at_walls.finish(|AtWall(side)| match other.take() {
        None => {
            other = Some(side);
            Ok(())
        }
        Some(first) => each([first, side]),
    })
}

/// Which walls make their cells neighbours.
struct NeighbourRule {
    spacing: [f64; 3],
    scale: AreaScale,
    /// The least area of a wall between cells of any size.
    least: f64,
}

impl NeighbourRule {
    /// For a grid that lies there.
    fn new(place: &Placement) -> Self {
        let [x, y, z] = place.spacing;
        let mean_face = (y * z + x * z + x * y) / 3.0;
        NeighbourRule {
            spacing: place.spacing,
            scale: AreaScale::new(place.spacing),
            least: LEAST_FACES * mean_face,
        }
    }

    /// True if a wall is large enough, and not much thicker than the walls of both its cells.
    fn holds(&self, sides: &[AtCell; 2]) -> bool {
        let wall = sides[0].wall;
        let [a, b] = sides.map(|side| self.scale.area(side.area.into()));
        let thicker = sides[0].thickness.max(sides[1].thickness);
        let least = self.least.max(LEAST_PART * a.min(b));
        wall.area(self.spacing) >= least && wall.thickness <= MOST_TIMES * thicker
    }
}
