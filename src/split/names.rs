//! What the basins of some slices are called among those of the whole volume.

use super::ascent::RowPieces;
use super::metric::Peak;
use super::seam::{BasinSeam, OpenBasin};

/// The last slice of the slices below: its rows, by places in a table of basins.
#[derive(Debug, Default)]
pub struct SliceBelow {
    /// Its rows.
    pub rows: RowPieces,
    /// The basins of their numbers, as they are called in the whole volume.
    pub basins: Vec<OpenBasin>,
}

/// The names of the basins of some slices. A basin is called by its own number, counted on from those below, unless it goes
/// on there: then it has the name that it has in the lowest slices that it reaches.
#[derive(Debug, Default)]
pub struct BasinNames {
    /// The name of basin 0.
    base: u64,
    /// How many basins there are, by their own numbers.
    count: u64,
    /// Those of the first and of the last slice, by their own numbers, rising.
    own: Vec<u64>,
    /// What these are called.
    open: Vec<OpenBasin>,
    /// What lies below.
    pub below: SliceBelow,
    /// Names of basins below, rising.
    foreign: Vec<u64>,
}

impl BasinNames {
    /// Of all basins of a whole volume.
    pub fn whole(count: u64) -> Self {
        BasinNames {
            count,
            ..BasinNames::default()
        }
    }

    /// Of slices with this seam and `count` basins, the first of which is called `base`; `open` has what merging has found
    /// of those of the seam.
    pub fn of(
        base: u64,
        count: u64,
        seam: &BasinSeam,
        open: Vec<OpenBasin>,
        below: SliceBelow,
    ) -> Self {
        let all = open.iter().chain(&below.basins).map(|open| open.number);
        let mut foreign: Vec<u64> = all.filter(|&name| name < base).collect();
        foreign.sort_unstable();
        foreign.dedup();
        BasinNames {
            base,
            count,
            own: seam.open.iter().map(|open| open.number).collect(),
            open,
            below,
            foreign,
        }
    }

    /// How many basins there are, by their own numbers.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// What merging has found of a basin, if it reaches the first or the last slice.
    fn known(&self, own: u64) -> Option<&OpenBasin> {
        let at = self.own.binary_search(&own).ok()?;
        Some(&self.open[at])
    }

    /// What a basin is called, by its own number.
    pub fn name(&self, own: u64) -> u64 {
        self.known(own).map_or(self.base + own, |open| open.number)
    }

    /// The maximum of a basin that lies elsewhere, if that is known.
    pub fn peak(&self, own: u64) -> Option<Peak> {
        self.known(own)?.peak()
    }

    /// Names of basins that lie in slices below.
    pub fn foreign(&self) -> &[u64] {
        &self.foreign
    }

    /// Names of basins that other slices may know: those of the first and the last slice, and those below; rising.
    pub fn shared(&self) -> Vec<u64> {
        let own = self.open.iter().map(|open| open.number);
        let mut all: Vec<u64> = own.chain(self.foreign.iter().copied()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// How many names there are to tell apart: those of others, and those of its own.
    pub fn distinct(&self) -> u64 {
        self.foreign.len() as u64 + self.count
    }

    /// The place of a name among these; places rise with names.
    pub fn place(&self, name: u64) -> u64 {
        let others = self.foreign.len() as u64;
        match name.checked_sub(self.base) {
            Some(own) => others + own,
            None => {
                let at = self.foreign.binary_search(&name);
                at.expect("a basin of these slices, or one that they touch") as u64
            }
        }
    }

    /// The name in a place.
    pub fn at(&self, place: u64) -> u64 {
        let others = self.foreign.len() as u64;
        match place.checked_sub(others) {
            Some(own) => self.base + own,
            None => self.foreign[place as usize],
        }
    }
}
