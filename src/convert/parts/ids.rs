//! The ids of all components of a volume, from what its parts have labelled.

use crate::checkpoint::{LABELS, Scratch};
use crate::convert::id_places::IdPlaces;
use crate::convert::label::{BANDS, Beyond, Labelled, Seam};
use crate::convert::parts::directory::{Directory, Done, FileSum, Made};
use crate::convert::parts::handed_out::HandedOut;
use crate::convert::parts::join::{Contributions, Joiner};
use crate::convert::parts::split::CellOwners;
use crate::convert::parts::work::{LabelsOfPart, SEAM};
use crate::convert::resolve::{ComponentId, Each, Numbering};
use crate::error::{Error, Result};
use crate::labels::{PhaseLabels, ProvisionalLabels};
use crate::sys::memory_pool::MemoryPool;
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Files of what merging leaves: the numbers of all parts, of which those are set that are still alive.
const KINDS: [&str; 3] = ["objects", "cells", "surfaces"];

/// What is known of a component that goes on in another part.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Known {
    /// Its numbers among those of all parts.
    provisional: u64,
    surface: u64,
    above: u64,
}

/// Where the numbers of a part lie among those of all.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Window {
    /// The first word of bits, and the one behind the last.
    words: [u64; 2],
    /// Those alive before it, and in it.
    before: u64,
    alive: u64,
}

/// What came of merging: how many numbers there are of each kind.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MergedIds {
    counts: Each<u64>,
    /// Cells that begin in parts before each part; at last, all of them.
    cells_before: Vec<u64>,
}

fn file_of(part: u32) -> String {
    format!("part-{part:04}.ids")
}

/// The labels of one part.
fn labels_of(directory: &Directory, round: u32, part: u32) -> Result<(Labelled, Seam)> {
    let done: Done<LabelsOfPart> = directory.done_by(round, part)?;
    let (seam, _) = done.file(SEAM)?;
    // the bands, which are large, are read by the part alone, which looks at them
    done.check_marks_of(|name| !name.ends_with(BANDS))?;
    Ok((open_labels(directory, &done, part)?, Seam::read(&seam)?))
}

/// Opens the labels of a part.
pub fn open_labels(
    directory: &Directory,
    done: &Done<LabelsOfPart>,
    part: u32,
) -> Result<Labelled> {
    let files = Scratch::of_sweep(&done.dir, LABELS);
    let labelled = Labelled::read(&files, &done.marks, directory.layers(part)?)?;
    labelled.ok_or_else(|| directory.gone(part))
}

/// How many components of each kind arrive in a part.
fn arriving(seam: &Seam) -> [u64; 3] {
    let all = seam.arrivals.len() as u64;
    let objects = seam.arrivals.iter().filter(|a| a.above == 1).count() as u64;
    [objects, all - objects, all]
}

/// Appends the numbers of a part, of which the first `dead` are those of other parts; returns where they lie.
fn append(all: &mut ProvisionalLabels, part: &ProvisionalLabels, mut dead: u64) -> Result<Window> {
    let mut window = Window::default();
    let start = all.append(&[])? / 64;
    window.words = [start, start];
    part.each_block(|words| {
        for word in &mut *words {
            let some = dead.min(64);
            *word &= (!0u64).checked_shl(some as u32).unwrap_or(0);
            dead -= some;
        }
        all.append(words)?;
        window.words[1] += words.len() as u64;
        Ok(())
    })?;
    Ok(window)
}

/// Joins the components of all parts and gives them their ids.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if what the parts have left is damaged or does not fit.
pub fn merge_ids(
    directory: &Directory,
    round: u32,
    dir: &Path,
    memory: &Arc<MemoryPool>,
) -> Result<Made<MergedIds>> {
    let none_yet = |kind: usize| ProvisionalLabels::new(&dir.join(KINDS[kind]));
    let mut labels = PhaseLabels {
        objects: none_yet(0)?,
        cells: none_yet(1)?,
        surfaces: none_yet(2)?,
    };
    let mut joiner = Joiner::new(dir, memory)?;
    let mut windows: Vec<[Window; 3]> = Vec::new();
    for part in 0..directory.parts() {
        let (labelled, seam) = labels_of(directory, round, part)?;
        let own = &labelled.provisional;
        let dead = arriving(&seam);
        let placed = [
            append(&mut labels.objects, &own.objects, dead[0])?,
            append(&mut labels.cells, &own.cells, dead[1])?,
            append(&mut labels.surfaces, &own.surfaces, dead[2])?,
        ];
        let known = seam.leaving.iter().map(|leaving| {
            let kind = usize::from(leaving.above != 1);
            // one of the part's own, and not one that arrives
            (leaving.provisional >= dead[kind]).then(|| Known {
                provisional: 64 * placed[kind].words[0] + leaving.provisional,
                surface: 64 * placed[2].words[0] + leaving.surface,
                above: leaving.above,
            })
        });
        let contributions = Contributions {
            ended: |_| None,
            leaving: known.collect(),
        };
        let joined = joiner.add(&seam, contributions, |one, other| {
            // the older one goes on
            let [old, new] = match one.provisional < other.provisional {
                true => [one.provisional, other.provisional],
                false => [other.provisional, one.provisional],
            };
            labels.of(one.above == 1).retire(new)?;
            let surfaces = [one.surface, other.surface];
            labels.surfaces.retire(surfaces[0].max(surfaces[1]))?;
            (one.provisional, one.surface) = (old, surfaces[0].min(surfaces[1]));
            Ok(())
        })?;
        joined.map_err(|misfit| unfit(directory, part, misfit))?;
        windows.push(placed);
    }
    hand_out(directory, dir, labels, windows, joiner)
}

/// The error for two parts that do not fit each other.
pub fn unfit(directory: &Directory, part: u32, misfit: String) -> Error {
    let before = part.saturating_sub(1);
    Error::format(
        &directory.out,
        format!("parts {before} and {part} with {misfit}"),
        "the same in both",
    )
    .with_hint("the input has changed between them, or files are damaged: make the plan again with --force")
}

/// Numbers what is alive, and writes what each part is to know.
fn hand_out(
    directory: &Directory,
    dir: &Path,
    mut labels: PhaseLabels,
    mut windows: Vec<[Window; 3]>,
    joiner: Joiner<Known>,
) -> Result<Made<MergedIds>> {
    let counts = Each {
        objects: labels.objects.spill()?,
        cells: labels.cells.spill()?,
        surfaces: labels.surfaces.spill()?,
    };
    for (kind, labels) in [&labels.objects, &labels.cells, &labels.surfaces]
        .into_iter()
        .enumerate()
    {
        let mut alive = 0;
        for window in windows.iter_mut().map(|of_part| &mut of_part[kind]) {
            let [start, end] = window.words.map(|word| word as usize);
            window.before = alive;
            alive = labels.renumber_some(start..end, alive)?.alive();
            window.alive = alive - window.before;
        }
    }
    let mut cells_before: Vec<u64> = windows.iter().map(|of_part| of_part[1].before).collect();
    let mut numbering = Numbering::of(&labels)?;
    let ranks = &numbering.ranks;
    let [objects, cells, both] =
        [&ranks.objects, &ranks.cells, &ranks.surfaces].map(|ranks| ranks.alive());
    if objects + cells != both {
        // each component but the first has one surface to one that begins before it
        let found = format!("{objects} objects, {cells} cells and {} surfaces", both - 1);
        return Err(Error::format(
            &directory.out,
            found,
            "one surface less than objects and cells",
        ));
    }
    cells_before.push(cells);
    let mut files = Vec::new();
    joiner.finish(
        |known: &Known| numbering.id(known.above == 1, known.provisional, known.surface),
        |part, arrivals, leaving| {
            let ids = HandedOut {
                head: windows[part as usize].to_vec(),
                arrivals,
                leaving,
            };
            files.push(ids.write(dir, &file_of(part))?);
            Ok(())
        },
    )?;
    for name in KINDS {
        files.push(FileSum::of(dir, name)?);
    }
    Ok(Made {
        marks: Default::default(),
        files,
        result: MergedIds {
            counts,
            cells_before,
        },
    })
}

/// In which part each component of voxels below begins.
pub fn cell_owners(merged: &Done<MergedIds>) -> CellOwners {
    CellOwners {
        before: merged.result.cells_before.clone(),
        begin_there: true,
    }
}

/// What merging has found of the components of a part.
pub struct IdsOfPart {
    /// Gives its components their ids.
    pub numbering: Numbering,
    /// Where the records of these are to lie.
    pub places: Each<IdPlaces>,
    /// Ids that occur in other parts, too, by rising number.
    pub shared: Each<Vec<u64>>,
}

impl IdsOfPart {
    /// Reads them.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a file is damaged.
    pub fn read(merged: &Done<MergedIds>, seam: &Seam, part: u32) -> Result<Self> {
        let name = file_of(part);
        let HandedOut {
            head,
            arrivals,
            leaving,
        } = HandedOut::<Window, ComponentId>::read(merged, &name, seam)?;
        let windows: [Window; 3] = head.try_into().map_err(|_| {
            let found = "other windows than of objects, cells and surfaces";
            Error::format(merged.dir.join(&name), found, "those three")
        })?;
        let shared = shared(seam, &arrivals, &leaving);
        let counts = &merged.result.counts;
        let counts = [counts.objects, counts.cells, counts.surfaces];
        let ranks = |kind: usize| {
            let (path, _) = merged.file(KINDS[kind])?;
            let labels = ProvisionalLabels::spilled(&path, counts[kind])?;
            let [start, end] = windows[kind].words.map(|word| word as usize);
            labels.renumber_some(start..end, windows[kind].before)
        };
        let numbering = Numbering {
            ranks: Each {
                objects: ranks(0)?,
                cells: ranks(1)?,
                surfaces: ranks(2)?,
            },
            beyond: Beyond::of(seam, &arrivals, leaving),
        };
        let places = |window: Window, shared: &[u64], first: u64| {
            let mut places = IdPlaces {
                before: window.before.saturating_sub(first),
                // the component of the first voxel has no surface
                own: window.alive - first.min(u64::from(window.before == 0)),
                others: Vec::new(),
            };
            let others = shared.iter().filter(|&&id| !places.is_own(id));
            places.others = others.copied().collect();
            places
        };
        let places = Each {
            objects: places(windows[0], &shared.objects, 0),
            cells: places(windows[1], &shared.cells, 0),
            surfaces: places(windows[2], &shared.surfaces, 1),
        };
        Ok(IdsOfPart {
            numbering,
            places,
            shared,
        })
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let Each {
            objects,
            cells,
            surfaces,
        } = &self.shared;
        let shared = objects.len() + cells.len() + surfaces.len();
        // once more among the places, and with the ids of both ends
        40 * shared as u64
    }
}

/// The ids of components of the slices that a part shares with others.
fn shared(seam: &Seam, arrivals: &[ComponentId], leaving: &[ComponentId]) -> Each<Vec<u64>> {
    let of_arrivals = seam.arrivals.iter().map(|a| a.above).zip(arrivals);
    let of_leaving = seam.leaving.iter().map(|l| l.above).zip(leaving);
    let all = of_arrivals.chain(of_leaving);
    let mut ids = Each::<Vec<u64>>::default();
    for (above, id) in all {
        match above {
            1 => ids.objects.push(id.id),
            _ => ids.cells.push(id.id),
        }
        if id.surface > 0 {
            ids.surfaces.push(id.surface);
        }
    }
    for ids in [&mut ids.objects, &mut ids.cells, &mut ids.surfaces] {
        ids.sort_unstable();
        ids.dedup();
    }
    ids
}
