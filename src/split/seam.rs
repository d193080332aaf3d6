//! What the basins of some slices tell those of the slices below and above: which of them reach the first and the last
//! slice, and which ways leave them there.

use super::ascent::{Piece, RowPieces};
use super::metric::Peak;
use crate::error::{Error, Result};
use crate::sys::state_codec::{Decoder, Encoder};
use std::path::Path;

/// A basin that reaches the first or the last slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct OpenBasin {
    /// Its number; among those of its own slices, or of all.
    pub number: u64,
    /// Its maximum, if that is known.
    pub peak_voxel: u64,
    /// The level of that, or 0.
    pub peak_level: u32,
    reserved: u32,
}

impl OpenBasin {
    /// Of this number, with this maximum if that is known.
    pub fn new(number: u64, peak: Option<Peak>) -> Self {
        OpenBasin {
            number,
            peak_voxel: peak.map_or(0, |peak| peak.voxel),
            peak_level: peak.map_or(0, |peak| peak.level),
            reserved: 0,
        }
    }

    /// Its maximum, if that is known.
    pub fn peak(&self) -> Option<Peak> {
        (self.peak_level > 0).then_some(Peak {
            level: self.peak_level,
            voxel: self.peak_voxel,
        })
    }
}

/// What some slices share with those below and above.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BasinSeam {
    /// Basins that reach the first or the last slice, by rising number.
    pub open: Vec<OpenBasin>,
    /// The rows of the first slice, by places in `open`.
    pub first: RowPieces,
    /// Those of the last slice.
    pub last: RowPieces,
    /// Ways that leave downwards: the voxel to which one goes, and the place in `open` of its basin.
    pub down: Vec<[u64; 2]>,
    /// Ways that leave upwards.
    pub up: Vec<[u64; 2]>,
}

impl BasinSeam {
    /// Of rows with tables of the basins of their numbers, and of ways with their basins. Maxima are not known yet.
    pub fn of(
        (first, low): (RowPieces, Vec<u64>),
        (last, high): (RowPieces, Vec<u64>),
        mut down: Vec<[u64; 2]>,
        mut up: Vec<[u64; 2]>,
    ) -> Self {
        let of_rows = |rows: &RowPieces, table: &[u64]| -> Vec<u64> {
            let ends = rows.pieces.iter().map(|piece| piece.end);
            let mut used: Vec<u64> = ends.map(|end| table[end as usize]).collect();
            used.sort_unstable();
            used.dedup();
            used
        };
        let mut all = [of_rows(&first, &low), of_rows(&last, &high)].concat();
        all.sort_unstable();
        all.dedup();
        let place = |number: u64| all.binary_search(&number).expect("it is open") as u64;
        let renamed = |rows: &RowPieces, table: &[u64]| {
            let mut out = RowPieces::new();
            (0..rows.len()).for_each(|row| {
                out.push_row(rows.row(row), |end| place(table[end as usize]) as u32);
            });
            out
        };
        for exits in [&mut down, &mut up] {
            exits.iter_mut().for_each(|exit| exit[1] = place(exit[1]));
            exits.sort_unstable();
        }
        BasinSeam {
            first: renamed(&first, &low),
            last: renamed(&last, &high),
            open: all.iter().map(|&n| OpenBasin::new(n, None)).collect(),
            down,
            up,
        }
    }

    /// Notes the maximum of a basin, if it is open.
    pub fn note_peak(&mut self, number: u64, peak: Peak) {
        if let Ok(at) = self.open.binary_search_by_key(&number, |open| open.number) {
            self.open[at] = OpenBasin::new(number, Some(peak));
        }
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let rows = |rows: &RowPieces| size_of_val(&rows.rows[..]) + size_of_val(&rows.pieces[..]);
        let exits = size_of_val(&self.down[..]) + size_of_val(&self.up[..]);
        (size_of_val(&self.open[..]) + rows(&self.first) + rows(&self.last) + exits) as u64
    }

    /// Writes it to a file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut out = Encoder::create(path)?;
        out.array(&self.open)?;
        for rows in [&self.first, &self.last] {
            out.array(&rows.rows)?;
            out.array(&rows.pieces)?;
        }
        out.array(&self.down)?;
        out.array(&self.up)?;
        out.finish()
    }

    /// Reads it from a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the file is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
        let seam = Decoder::new(bytes).and_then(|mut input| {
            let open: Vec<OpenBasin> = input.array()?;
            let mut rows = || -> Option<RowPieces> {
                let (rows, pieces): (Vec<u32>, Vec<Piece>) = (input.array()?, input.array()?);
                let within = pieces.iter().all(|p| (p.end as usize) < open.len());
                let sound = rows.is_sorted() && rows.first() == Some(&0);
                let whole = rows.last() == Some(&(pieces.len() as u32));
                (within && sound && whole).then_some(RowPieces { rows, pieces })
            };
            let (first, last) = (rows()?, rows()?);
            let mut exits = || -> Option<Vec<[u64; 2]>> {
                let exits: Vec<[u64; 2]> = input.array()?;
                let within = exits.iter().all(|exit| exit[1] < open.len() as u64);
                within.then_some(exits)
            };
            let (down, up) = (exits()?, exits()?);
            Some(BasinSeam {
                first,
                last,
                down,
                up,
                open,
            })
        });
        seam.ok_or_else(|| {
            let expected = "which basins a part has in common with others";
            Error::format(path, "other bytes than were written", expected)
        })
    }
}
