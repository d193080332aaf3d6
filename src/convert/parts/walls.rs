//! Walls between cells, in parts of a volume. A part sums up those between cells that lie in it alone; of others, and of
//! lines that go on in other parts, it hands on chords. When these are joined, all walls are known, and what they tell of
//! each cell: this is worked out by merging, since neighbours of a cell may begin in any part.

use crate::convert::components::Components;
use crate::convert::conversion::Conversion;
use crate::convert::memory::FOR_WALLS_OF_CELLS;
use crate::convert::parts::directory::{Done, FileSum};
use crate::convert::parts::records::{
    LeftInRound, PartFiles, merged_file, own_file, shared_file, sum_of,
};
use crate::convert::parts::split::CellOwners;
use crate::convert::parts::work::PartWork;
use crate::convert::walls::{
    AreaSteps, CellWalls, Gathered, Neighbours, Wall, WallsInput, WallsOfCell, wall_of,
};
use crate::error::Result;
use crate::measure::RecordTable;
use crate::surface::{ChordEnd, Chords};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use serde::de::IgnoredAny;
use std::path::Path;

/// The table of walls.
const WALLS: &str = "walls";
/// The file of a part of ends of chords that go on in other parts.
const ENDS: &str = "chord-ends";
/// The file of a part of the areas of its cells.
const AREAS: &str = "cell-areas";
/// What walls tell of cells.
const OF_CELLS: &str = "walls-of-cells";

/// The area of the surface of a cell in a part.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Area {
    cell: u64,
    area: AreaSteps,
}

/// Finds the walls of a part, of which `shared` lists the cells that may lie in others, too.
///
/// # Errors
/// As of [`Gathered::of`].
pub fn write_walls(input: &WallsInput, shared: &[u64]) -> Result<Vec<FileSum>> {
    let create = |name: &str| SpillFile::create(&input.work.join(name));
    let names = [&own_file(WALLS), &shared_file(WALLS), ENDS];
    let [mut own, mut chords, mut ends] = [create(names[0])?, create(names[1])?, create(names[2])?];
    let is_shared = |cell: &u64| shared.binary_search(cell).is_ok();
    Gathered::of(input)?.each_wall(
        |end| ends.push(&[end]).map(|_| ()),
        |bins| match bins[0].cells.iter().any(is_shared) {
            true => chords.push(bins).map(|_| ()),
            false => own.push(&[wall_of(bins)]).map(|_| ()),
        },
    )?;
    Ok(vec![
        sum_of(names[0], own.mark()?),
        sum_of(names[1], chords.mark()?),
        sum_of(names[2], ends.mark()?),
    ])
}

/// Writes the areas of the surfaces of all cells of a part, as far as they lie in it.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_areas(components: &Components, dir: &Path) -> Result<FileSum> {
    let mut areas = SpillFile::create(&dir.join(AREAS))?;
    for place in 0..components.cells.len() {
        let area = components.cells.get(place)?.mesh.area;
        if area > 0 {
            let cell = components.id_of_cell(place);
            let area = area.into();
            areas.push(&[Area { cell, area }])?;
        }
    }
    Ok(sum_of(AREAS, areas.mark()?))
}

/// Joins the walls of all parts, and hands each part those of the cells that it owns. `openings` hands on the two cells of
/// each opening, once or more often.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged; those of `openings`.
pub fn merge_walls(
    job: &Conversion,
    left: LeftInRound,
    owners: &CellOwners,
    dir: &Path,
    openings: impl FnOnce(&mut dyn FnMut([u64; 2]) -> Result<()>) -> Result<()>,
) -> Result<Vec<FileSum>> {
    let mut gathered = Gathered::none_yet(job, &job.plan.pool(), dir)?;
    left.each(&shared_file(WALLS), |chords: Chords| gathered.push(chords))?;
    left.each(ENDS, |end: ChordEnd| gathered.push_end(end))?;
    let mut found = Neighbours::new(dir)?;
    gathered.each_wall(|_| Ok(()), |bins| found.add_wall(wall_of(bins)))?;
    left.each(&own_file(WALLS), |wall: Wall| found.add_wall(wall))?;
    left.each(AREAS, |Area { cell, area }| found.add_cell(cell, area))?;
    openings(&mut |cells| found.add_opening(cells))?;
    let mut walls = PartFiles::new(dir, WALLS)?;
    let mut of_cells = PartFiles::new(dir, OF_CELLS)?;
    let place = job.options.measured(&job.grid.header().placement)?;
    found.finish(
        &place,
        |judged| {
            walls.go_on_to(owners.part_of(judged.wall.cells[0]) as u32)?;
            walls.push(&judged)
        },
        |of_cell| {
            of_cells.go_on_to(owners.part_of(of_cell.cell) as u32)?;
            of_cells.push(&of_cell)
        },
    )?;
    let parts = left.directory.parts();
    Ok([walls.finish(parts)?, of_cells.finish(parts)?].concat())
}

impl PartWork<'_> {
    /// Enters what merging has found of the walls of the cells that the part owns.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
    pub fn add_walls(&self, components: &mut Components, round: u32, dir: &Path) -> Result<()> {
        let merged: Done<IgnoredAny> = self.directory.merged(round, self.part)?;
        let room = FOR_WALLS_OF_CELLS.of(self.job.plan.tables());
        let mut of_cells = RecordTable::new(components.cells.len(), room, dir)?;
        let handed = merged.spool(&merged_file(OF_CELLS, self.part))?;
        handed.each(|own: WallsOfCell| {
            of_cells.update(components.place_of_cell(own.cell), |place| *place = own)
        })?;
        let walls = merged.spool(&merged_file(WALLS, self.part))?;
        components.walls = Some(CellWalls { walls, of_cells });
        Ok(())
    }
}
