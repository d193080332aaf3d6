//! The passes over a part of a volume, in rounds between which the parts are joined, and the files that they leave.

use super::bits::Beside;
use super::cells::{Found, SplitRows, Tree};
use super::graph::{RestEdge, RestTree};
use super::judge::CURVE;
use super::names::BasinNames;
use super::numbers::Numbers;
use super::run::{Files, SADDLES, TOUCHES, with_passes};
use super::seam::BasinSeam;
use super::store::{STORE, Store};
use super::{BitSource, SplitOptions};
use crate::error::Result;
use crate::progress::Progress;
use crate::sys::spill_file::{Mark, SpillFile};
use std::path::Path;

/// Files of the first round, which [`find_saddles`] and [`rows_of`] are given again.
pub const BASIN_FILES: [&str; 3] = STORE;
/// Files of the second round, which [`rows_of`] is given again: saddles, touches and the cells of basins.
pub const SADDLE_FILES: [&str; 3] = [SADDLES, TOUCHES, "cells-of-basins"];
/// Files of the second round for whoever joins parts: bits of basins with which cells begin, basins with the first ones of
/// their cells here, basins of which this is to be told to what cells they belong in the end, and what is left of trees.
pub const JOIN_FILES: [&str; 5] = ["first-basins", "links", "told", "trees", "edges"];

/// What the first round has found.
pub struct BasinsFound {
    /// How many basins there are.
    pub count: u64,
    /// What [`BASIN_FILES`] hold.
    pub marks: [Mark; 3],
    /// What other parts are to know.
    pub seam: BasinSeam,
}

/// Finds the basins of a part, of whose columns `beside` is known; its files lie in `dir`.
///
/// # Errors
/// Those of [`split`](super::split).
pub fn find_basins(
    source: &mut dyn BitSource,
    options: &SplitOptions,
    beside: Beside,
    dir: &Path,
    progress: &dyn Progress,
) -> Result<BasinsFound> {
    let files = Files {
        dir,
        have_names: true,
    };
    with_passes(source, options, beside, files, progress, |passes| {
        let mut basins = passes.basins()?;
        Ok(BasinsFound {
            count: basins.count,
            marks: basins.store.save()?,
            seam: basins.seam()?,
        })
    })
}

/// The basins of a part, and what joining the parts has made of them.
pub struct KnownBasins {
    /// [`BASIN_FILES`].
    pub files: [SpillFile; 3],
    /// What they are called.
    pub names: BasinNames,
}

/// What the second round has found.
pub struct SaddlesFound {
    /// What [`SADDLE_FILES`] hold.
    pub kept: [Mark; 3],
    /// What [`JOIN_FILES`] hold.
    pub joins: [Mark; 5],
    /// Saddles, necks among them, and necks at each ratio of the curve.
    pub counts: ([u64; 2], [u64; CURVE.len()]),
}

/// Finds the saddles of a part, and joins its basins as far as no other part is needed for that; its files lie in `dir`.
///
/// # Errors
/// Those of [`split`](super::split).
pub fn find_saddles(
    source: &mut dyn BitSource,
    options: &SplitOptions,
    beside: Beside,
    basins: KnownBasins,
    dir: &Path,
    progress: &dyn Progress,
) -> Result<SaddlesFound> {
    let files = Files {
        dir,
        have_names: true,
    };
    with_passes(source, options, beside, files, progress, |passes| {
        let store = Store::open(options.grid, dir, basins.files)?;
        leave(passes.saddles(store, basins.names)?, dir)
    })
}

/// Writes what others are to know.
fn leave(found: Found, dir: &Path) -> Result<SaddlesFound> {
    let Found {
        names,
        tree,
        mut met,
        rest: (trees, mut edges),
        ..
    } = found;
    let Tree {
        judge,
        mut saddles,
        mut sets,
    } = tree;
    let [bits, links, told, left, meets] = JOIN_FILES;
    let create = |name: &str| SpillFile::create(&dir.join(name));
    let mut firsts = create(bits)?;
    let mut cells = create(SADDLE_FILES[2])?;
    write_cells(&names, &mut sets, &mut firsts, &mut cells)?;
    let mut to_tell = names.shared();
    let mut linked = create(links)?;
    for at in 0..to_tell.len() {
        let name = to_tell[at];
        let first = names.at(sets.find(names.place(name))?);
        linked.push(&[[name, first]])?;
        to_tell.push(first);
    }
    for edge in &mut edges {
        for basin in &mut edge.basins {
            *basin = names.at(sets.find(names.place(*basin))?);
            to_tell.push(*basin);
        }
    }
    to_tell.sort_unstable();
    to_tell.dedup();
    let (mut tell, mut rest) = (create(told)?, [create(left)?, create(meets)?]);
    tell.push(&to_tell)?;
    rest[0].push::<RestTree>(&trees)?;
    rest[1].push::<RestEdge>(&edges)?;
    Ok(SaddlesFound {
        kept: [saddles.mark()?, met.mark()?, cells.mark()?],
        joins: [
            firsts.mark()?,
            linked.mark()?,
            tell.mark()?,
            rest[0].mark()?,
            rest[1].mark()?,
        ],
        counts: ([judge.saddles, judge.necks], judge.cuts),
    })
}

/// Writes the bits of basins with which a cell begins, and for each basin the place of the first one of its cell.
fn write_cells(
    names: &BasinNames,
    sets: &mut Numbers,
    firsts: &mut SpillFile,
    cells: &mut SpillFile,
) -> Result<()> {
    let others = names.distinct() - names.count();
    for place in 0..others {
        cells.push(&[sets.find(place)?])?;
    }
    let mut word = 0;
    for own in 0..names.count() {
        let place = names.place(names.name(own));
        let first = sets.find(place)?;
        cells.push(&[first])?;
        word |= u64::from(first == others + own) << (own % 64);
        if own % 64 == 63 || own + 1 == names.count() {
            firsts.push(&[std::mem::take(&mut word)])?;
        }
    }
    Ok(())
}

/// The cells of a part, by rows. `kept` has [`SADDLE_FILES`], `told` the basins of [`JOIN_FILES`] with the cells that they
/// belong to in the end, by rising basin; `begun` tells the cell that begins with a basin that is not among these. Cells
/// count from 1.
///
/// # Errors
/// [`crate::Error::Io`], and what `begun` returns.
pub fn rows_of(
    options: &SplitOptions,
    basins: KnownBasins,
    [saddles, met, cells]: [SpillFile; 3],
    told: &[(u64, u64)],
    mut begun: impl FnMut(u64) -> Result<u64>,
    dir: &Path,
) -> Result<SplitRows> {
    let names = basins.names;
    let mut cell_of = Numbers::new(dir)?;
    cells.each(|first: u64| {
        let place = cell_of.len();
        let cell = match first < place {
            true => cell_of.get(first)?,
            false => {
                let name = names.at(first);
                let known = told.binary_search_by_key(&name, |told| told.0);
                known.map_or_else(|_| begun(name), |at| Ok(told[at].1))? - 1
            }
        };
        cell_of.push(cell).map(|_| ())
    })?;
    Ok(SplitRows {
        grid: options.grid,
        store: Store::open(options.grid, dir, basins.files)?,
        names,
        saddles,
        met,
        cell_of,
    })
}
