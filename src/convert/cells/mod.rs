//! Cells that are given, as parts of components: by a volume of labels, or by splitting them at their necks.
//!
//! The surface does not change, nor do objects and components. A pass over the bits that labelling has kept finds what
//! the voxels of each cell are, and which cells touch.

mod band;
mod contacts;
mod kept_bits;
mod opening;
mod split;

pub use contacts::Contact;
pub use kept_bits::KeptBits;
pub use opening::Opening;
pub use split::{for_blocks, metric, opening_of, split_options, splitting_bytes, write_rows};

use crate::checkpoint::{Checkpointer, Marks};
use crate::convert::cells::band::{BelowZero, CellPart, CellSettings, CellsOfBand, cells_of_band};
use crate::convert::cells::split::{SplitCells, split_cells};
use crate::convert::conversion::Conversion;
use crate::convert::id_places::IdPlaces;
use crate::convert::known_band::{KnownBand, KnownBands};
use crate::convert::label::span_of;
use crate::convert::memory::BANDS;
use crate::error::{Error, Result};
use crate::labels::{BandCells, CellRows, InsideBand};
use crate::measure::VoxelSums;
use crate::sys::id_set::{IdRanks, IdSet};
use crate::sys::locks::{into_inner, lock};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Parts of cells that are sorted in memory.
const ROOM: usize = 1 << 12;

/// The voxels of a cell in a component.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct CellInComponent {
    /// Sums over them; without the Euler characteristic of the border.
    pub sums: VoxelSums,
    /// The cell.
    pub cell: u64,
    /// The component.
    pub component: u64,
}

impl Keyed for CellInComponent {
    fn key(&self) -> [u64; 2] {
        [self.cell, self.component]
    }
}

/// Where the records of cells lie in a table.
#[derive(Debug)]
pub enum CellIds {
    /// By the ranks of their ids, which are any numbers.
    Ranked(IdRanks),
    /// Ids without gaps, of which some are those of this part of the volume.
    Placed(IdPlaces),
    /// Ids with gaps, of a part of the volume.
    Listed(ListedIds),
}

/// Ids with gaps, of which some have their rows in this part of the volume: these come first.
#[derive(Debug, Default)]
pub struct ListedIds {
    /// Those, by rising number.
    pub own: Vec<u64>,
    /// Others that have a record, by rising number.
    pub others: Vec<u64>,
}

impl ListedIds {
    /// The place of an id that has one.
    pub fn of(&self, id: u64) -> u64 {
        let other = || {
            let place = self.others.binary_search(&id);
            self.own.len() + place.expect("cells of a part are listed")
        };
        self.own.binary_search(&id).unwrap_or_else(|_| other()) as u64
    }

    /// The id in a place.
    pub fn id(&self, place: u64) -> u64 {
        let place = place as usize;
        match self.own.get(place) {
            Some(&id) => id,
            None => self.others[place - self.own.len()],
        }
    }

    /// How many places there are.
    pub fn len(&self) -> u64 {
        (self.own.len() + self.others.len()) as u64
    }
}

impl CellIds {
    /// How many records there are.
    pub fn len(&self) -> u64 {
        match self {
            CellIds::Ranked(ids) => ids.len(),
            CellIds::Placed(ids) => ids.len(),
            CellIds::Listed(ids) => ids.len(),
        }
    }

    /// How many of them are of cells that begin in this part of the volume: the first ones.
    pub fn own(&self) -> u64 {
        match self {
            CellIds::Ranked(ids) => ids.len(),
            CellIds::Placed(ids) => ids.own,
            CellIds::Listed(ids) => ids.own.len() as u64,
        }
    }

    /// The place of a cell that has voxels.
    pub fn place(&self, cell: u64) -> u64 {
        match self {
            CellIds::Ranked(ids) => ids.rank(cell).expect("cells of pieces have voxels"),
            CellIds::Placed(ids) => ids.of(cell),
            CellIds::Listed(ids) => ids.of(cell),
        }
    }

    /// Between which ids those lie that begin in this part of the volume, or have their rows there.
    pub fn own_ids(&self) -> Range<u64> {
        match self {
            CellIds::Ranked(_) => 1..u64::MAX,
            CellIds::Placed(ids) => ids.before + 1..ids.before + 1 + ids.own,
            CellIds::Listed(ids) => match ids.own[..] {
                [first, .., last] => first..last + 1,
                [one] => one..one + 1,
                [] => 0..0,
            },
        }
    }

    /// The cell in a place.
    pub fn id(&self, place: u64) -> u64 {
        match self {
            CellIds::Ranked(ids) => ids.id(place),
            CellIds::Placed(ids) => ids.id(place),
            CellIds::Listed(ids) => ids.id(place),
        }
    }
}

/// What is known of all cells, where these are given.
#[derive(Debug)]
pub struct KnownCells {
    /// The ids of those that have voxels.
    pub ids: CellIds,
    /// Where cells of one component touch, by rising ids; those of a part of the volume whose first cell begins there.
    pub openings: SpillFile,
    /// Voxels below that are given to none.
    pub unlabelled: u64,
    /// Cells for each ratio in thousandths, where components were split.
    pub curve: Vec<[u64; 2]>,
    /// Each cell with each component that it has voxels in, by rising ids; kept where there is a file for it.
    pub pairs: Option<SpillFile>,
}

/// The cells of a volume.
#[derive(Debug)]
pub struct GivenCells {
    /// Which voxels belong to which cell; those below that are given to none have one together.
    pub rows: CellRows,
    /// What is known of all.
    pub known: KnownCells,
    /// The voxels of each in each component, by parts.
    pub parts: Sorter<CellInComponent>,
}

/// Hands on the voxels of each cell in each component, by rising ids.
///
/// # Errors
/// [`Error::Io`], and what `each` returns.
pub fn each_in_component(
    parts: Sorter<CellInComponent>,
    each: impl FnMut(CellInComponent) -> Result<()>,
) -> Result<()> {
    parts.finish_merged(|sum, part| sum.sums.merge(&part.sums), each)
}

/// What the pass works on.
pub struct CellsInput<'a> {
    /// The conversion.
    pub job: &'a Conversion<'a>,
    /// Its bands.
    pub known: KnownBands<'a>,
    /// Its memory.
    pub memory: &'a Arc<MemoryPool>,
    /// Directory for temporary files.
    pub work: &'a Path,
}

/// What is gathered from all bands.
struct Gathered {
    ids: IdSet,
    parts: Sorter<CellInComponent>,
    contacts: Sorter<Contact>,
    unlabelled: u64,
    /// The first voxel of a component whose label is below 0.
    below_0: Option<BelowZero>,
}

/// Finds the cells, where these are given: by labels, or by a rule for necks. What splitting finds is kept beside the labels,
/// of whose files `marks` tells.
///
/// # Errors
/// [`Error::Io`], [`Error::TooDense`] and [`Error::Interrupted`]; [`Error::Usage`] if a voxel below has a label below 0.
pub fn cells(
    input: &CellsInput,
    marks: &Marks,
    checkpointer: &mut Checkpointer,
) -> Result<Option<GivenCells>> {
    if let Some(labels) = &input.job.options.labels {
        let [.., slices] = input.job.plan.tiling.dims.0;
        let crop = input.job.options.crop.as_ref();
        let rows = labels.rows(crop, 0..slices, input.work, input.job.progress)?;
        return sum_cells(input, rows, None).map(Some);
    }
    let Some(rule) = input.job.options.split else {
        return Ok(None);
    };
    let SplitCells {
        rows,
        openings,
        curve,
    } = split_cells(input, rule, marks, checkpointer)?;
    let known = KnownCells {
        ids: CellIds::Placed(IdPlaces::all(rows.largest())),
        openings,
        unlabelled: 0,
        curve,
        pairs: None,
    };
    sum_cells(input, rows, Some(known)).map(Some)
}

/// Sums up the cells of all voxels, given as `rows`, and finds which there are and where they touch unless that is known.
///
/// # Errors
/// As of [`cells`].
pub fn sum_cells(
    input: &CellsInput,
    rows: CellRows,
    known: Option<KnownCells>,
) -> Result<GivenCells> {
    let gathered = gather(input, &rows, known.is_none())?;
    let known = match known {
        Some(known) => known,
        None => KnownCells {
            ids: CellIds::Ranked(gathered.ids.into_ranks()),
            openings: input.merge_contacts(gathered.contacts)?,
            unlabelled: gathered.unlabelled,
            curve: Vec::new(),
            pairs: None,
        },
    };
    Ok(GivenCells {
        rows,
        known,
        parts: gathered.parts,
    })
}

/// Sums up the cells of a part of the volume, which others may know more of: none of them is its own, and openings are known
/// when all parts are. Hands on where cells touch here, by rising ids.
///
/// # Errors
/// As of [`cells`], and what `each` returns.
pub fn sum_cells_of_part(
    input: &CellsInput,
    rows: CellRows,
    each: impl FnMut(Contact) -> Result<()>,
) -> Result<GivenCells> {
    let gathered = gather(input, &rows, true)?;
    let ids = gathered.ids.into_ranks();
    gathered.contacts.finish_merged(Contact::merge, each)?;
    let mut openings = SpillFile::new(input.work)?;
    openings.mark()?;
    let known = KnownCells {
        ids: CellIds::Listed(ListedIds {
            own: Vec::new(),
            others: (0..ids.len()).map(|place| ids.id(place)).collect(),
        }),
        openings,
        unlabelled: gathered.unlabelled,
        curve: Vec::new(),
        pairs: Some(SpillFile::new(input.work)?),
    };
    Ok(GivenCells {
        rows,
        known,
        parts: gathered.parts,
    })
}

/// Goes through all bands.
fn gather(input: &CellsInput, rows: &CellRows, finds_contacts: bool) -> Result<Gathered> {
    let (job, none) = (input.job, rows.none());
    let ([_, bands, _], layers) = (job.plan.tiling.tiles(), job.made);
    job.progress
        .begin("cells", u64::from(bands) * u64::from(layers.count()));
    let gathered = Mutex::new(Gathered {
        ids: IdSet::default(),
        parts: Sorter::new(input.work, ROOM)?,
        contacts: Sorter::new(input.work, ROOM)?,
        unlabelled: 0,
        below_0: None,
    });
    // no more bands at once than for labelling
    let at_once = job.plan.bands_at_once as usize;
    let all: Vec<[u32; 2]> = layers
        .each()
        .flat_map(|tz| (0..bands).map(move |ty| [ty, tz]))
        .collect();
    for some in all.chunks(at_once.max(1)) {
        if job.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let add = |place| {
            let (found, held) = input.band(place, rows, finds_contacts)?;
            job.progress.advance(1);
            let added = lock(&gathered).add(found, none, finds_contacts);
            drop(held);
            added
        };
        let left = Mutex::new(Vec::new());
        some.par_iter()
            .with_max_len(1)
            .try_for_each(|&place| match add(place) {
                // alone it may fit
                Err(Error::TooDense { .. }) if some.len() > 1 => {
                    lock(&left).push(place);
                    Ok(())
                }
                added => added,
            })?;
        into_inner(left).into_iter().try_for_each(add)?;
    }
    let gathered = into_inner(gathered);
    match gathered.below_0 {
        Some(found) => Err(refused(found, rows)),
        None => Ok(gathered),
    }
}

/// A label that no pore may have.
fn refused(BelowZero { zyx, label }: BelowZero, rows: &CellRows) -> Error {
    let [z, y, x] = zyx;
    let [x, y, z] = rows.in_whole([x, y, z]);
    let found = format!("label {label} at voxel {x}, {y}, {z}, which is below the threshold");
    let expected = "labels from 0 on of voxels below, of which 0 is no cell of its own";
    Error::usage("--labels", found, expected)
        .with_hint("give such voxels label 0; labels of voxels above are not looked at")
}

impl CellsInput<'_> {
    /// The cells of band `ty` of layer `tz`, and the memory that they take.
    fn band(
        &self,
        place: [u32; 2],
        rows: &CellRows,
        finds_contacts: bool,
    ) -> Result<(CellsOfBand, MemoryReservation)> {
        let (known, tiling) = (self.known, self.known.tiling);
        let number = known.number(place);
        let kept = known.kept.get(number)?;
        let span = span_of(tiling, place[0], place[1]);
        let kinds = known.kept.kinds(&kept, &span)?;
        let mut held = MemoryReservation::new(self.memory, BANDS);
        if !kept.has_surface() && kinds.0[0] != 0 {
            return Ok((CellsOfBand::default(), held));
        }
        let bytes = KnownBands::bytes(&kept, &span);
        held.grow_to(bytes)?;
        let (mut band, mut cells) = (KnownBand::default(), BandCells::default());
        known.load(number, &kept, &kinds, span.clone(), &mut band)?;
        rows.load(&span, &mut cells)?;
        let mut inside = None;
        if let Some(region) = self.job.region {
            let mut own = InsideBand::default();
            own.load(region, &span)?;
            inside = Some(own);
        }
        held.grow_to(bytes + cells.bytes())?;
        let options = self.job.options;
        let settings = CellSettings {
            dims: tiling.dims,
            rule: options.ambiguous,
            finds_contacts,
            place: &options.measured(&self.job.grid.header().placement)?,
        };
        let inside = inside.as_ref();
        let found = cells_of_band(&band, &cells, inside, &settings, &mut held)?;
        Ok((found, held))
    }

    /// Where cells touch, one opening for each two.
    fn merge_contacts(&self, contacts: Sorter<Contact>) -> Result<SpillFile> {
        let placement = &self.job.grid.header().placement;
        let spacing = self.job.options.measured(placement)?.spacing;
        let mut openings = SpillFile::new(self.work)?;
        contacts.finish_merged(Contact::merge, |contact| {
            let opening = Opening::of(&contact, spacing);
            openings.push(&[opening]).map(|_| ())
        })?;
        openings.mark()?;
        Ok(openings)
    }
}

impl Gathered {
    fn add(&mut self, found: CellsOfBand, none: u64, finds_ids: bool) -> Result<()> {
        self.below_0 = [self.below_0, found.below_0].into_iter().flatten().min();
        for CellPart {
            cell,
            component,
            sums,
        } in found.parts
        {
            // those of rows that other bands own are there, too: pieces of the surface begin at them
            if finds_ids {
                self.ids.insert(cell);
            }
            self.unlabelled += if cell == none { sums.voxels } else { 0 };
            self.parts.push(CellInComponent {
                sums,
                cell,
                component,
            })?;
        }
        found
            .contacts
            .into_iter()
            .try_for_each(|contact| self.contacts.push(contact))
    }
}
