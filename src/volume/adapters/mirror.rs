//! A volume whose rows or columns are stored the other way round than they are meant.

use crate::error::Result;
use crate::volume::{Header, Volume, hand_on};
use std::ops::Range;
use std::path::Path;

/// A volume that hands out another one turned round along x, y or both.
pub(crate) struct Mirrored<'a> {
    inner: Box<dyn Volume + 'a>,
    /// Along x and y.
    turned: [bool; 2],
}

impl<'a> Mirrored<'a> {
    pub(crate) fn new(inner: Box<dyn Volume + 'a>, turned: [bool; 2]) -> Self {
        Mirrored { inner, turned }
    }
}

impl Volume for Mirrored<'_> {
    fn header(&self) -> &Header {
        self.inner.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let [nx, ny, _] = self.header().dims.0;
        let sample = self.header().dtype.bytes();
        let (row, rows) = (x.len() * sample, y.len());
        let turn = |turned: bool, r: Range<u32>, n: u32| match turned {
            true => n - r.end..n - r.start,
            false => r,
        };
        let [turn_x, turn_y] = self.turned;
        self.inner
            .read_box(turn(turn_x, x, nx), turn(turn_y, y, ny), z, out)?;
        for slice in out.chunks_exact_mut(row * rows) {
            if turn_y {
                for j in 0..rows / 2 {
                    let (above, below) = slice.split_at_mut((rows - 1 - j) * row);
                    above[j * row..][..row].swap_with_slice(&mut below[..row]);
                }
            }
            if turn_x {
                for row in slice.chunks_exact_mut(row) {
                    // all bytes the other way round, and those of each sample back again
                    row.reverse();
                    row.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
                }
            }
        }
        Ok(())
    }

    hand_on!(inner);

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once
            .map(|inner| -> Box<dyn Volume + '_> { Box::new(Mirrored::new(inner, self.turned)) }))
    }

    fn held_bytes(&self) -> u64 {
        self.inner.held_bytes()
    }
}
