//! How far it is from the faces of a part to what is solid in others: each tells what passing it does to the state of a
//! column, one byte in each direction, and each composes what lies within reach of it.

use crate::convert::cells::{KeptBits, split_options};
use crate::convert::conversion::Conversion;
use crate::convert::layers::Layers;
use crate::convert::parts::directory::{Directory, FileSum};
use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::split::{Beside, NeckRule, Passage, SplitOptions, pass};
use serde::de::IgnoredAny;
use std::ops::Range;
use std::path::Path;

/// Files of a part: a byte for each column, rows by y.
const COLUMNS: [&str; 2] = ["columns-up", "columns-down"];

/// The slices that are a part's own: the first one of each layer is that of the layer below.
pub fn own_slices(tiling: Tiling, layers: Layers) -> Range<u32> {
    let [.., height] = tiling.macrocube;
    let [.., nz] = tiling.dims.0;
    let first = match layers.first {
        0 => 0,
        first => first * height + 1,
    };
    first..nz.min(layers.end * height + 1)
}

/// How the cells of a part are split, in blocks of so many bytes.
pub fn options_of(job: &Conversion, rule: NeckRule, for_blocks: u64) -> SplitOptions {
    let slices = own_slices(job.plan.tiling, job.made);
    let mut options = split_options(job, rule, for_blocks);
    options.grid.height = options.grid.height.min(slices.len() as u32);
    options.grid = options.grid.of_slices(slices);
    options
}

/// Writes what passing a part does to the states of columns, given its bits.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn write_columns(
    job: &Conversion,
    rule: NeckRule,
    bits: &mut KeptBits,
    dir: &Path,
) -> Result<Vec<FileSum>> {
    let options = options_of(job, rule, 0);
    let passage = Passage::of(bits, options.grid, options.metric.reach(), job.progress)?;
    for (name, columns) in COLUMNS.into_iter().zip([&passage.up, &passage.down]) {
        let path = dir.join(name);
        std::fs::write(&path, columns).map_err(|e| Error::io(&path, "write", e))?;
    }
    let sums = COLUMNS.into_iter().map(|name| FileSum::of(dir, name));
    sums.collect()
}

/// What is known of the columns of a part, from what the parts around it have told in the round that labels.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if a file is damaged.
pub fn beside(
    job: &Conversion,
    directory: &Directory,
    round: u32,
    part: u32,
    reach: u8,
) -> Result<Beside> {
    let columns = Columns {
        directory,
        tiling: job.plan.tiling,
        round,
        reach,
    };
    let Beside {
        mut before,
        mut behind,
    } = Beside::unknown(job.plan.tiling.dims, reach);
    columns.through(&mut before, (0..part).rev(), 0)?;
    columns.through(&mut behind, part + 1..directory.parts(), 1)?;
    Ok(Beside { before, behind })
}

/// Reads what parts have told of columns.
struct Columns<'a> {
    directory: &'a Directory,
    tiling: Tiling,
    round: u32,
    reach: u8,
}

impl Columns<'_> {
    /// Takes columns through other parts, the nearest of which comes first, as far as these are within reach.
    fn through(
        &self,
        columns: &mut [u8],
        parts: impl Iterator<Item = u32>,
        direction: usize,
    ) -> Result<()> {
        let (mut near, mut slices) = (Vec::new(), 0);
        for part in parts {
            if slices >= u32::from(self.reach) {
                break;
            }
            let count = own_slices(self.tiling, self.directory.layers(part)?).len() as u32;
            slices += count;
            near.push((part, count));
        }
        for (part, slices) in near.into_iter().rev() {
            let done = self.directory.done_by::<IgnoredAny>(self.round, part)?;
            let (path, _) = done.file(COLUMNS[direction])?;
            let passage = std::fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
            if passage.len() != columns.len() {
                let found = format!("{} bytes", passage.len());
                let expected = format!("{}, one for each column", columns.len());
                return Err(Error::format(&path, found, expected));
            }
            pass(columns, &passage, slices, self.reach);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;

    #[test]
    fn each_slice_is_in_one_part() {
        for (nz, height) in [(1, 8), (2, 8), (8, 8), (9, 8), (10, 8), (40, 7), (43, 7)] {
            let tiling = Tiling {
                dims: Dims([3, 3, nz]),
                macrocube: [8, 8, height],
            };
            let [.., layers] = tiling.tiles();
            for parts in 1..=layers {
                let mut next = 0;
                for part in 0..parts {
                    let [first, end] = [part, part + 1].map(|p| layers * p / parts);
                    let slices = own_slices(tiling, Layers { first, end });
                    assert_eq!(slices.start, next);
                    next = slices.end;
                }
                assert_eq!(next, nz);
            }
        }
    }
}
