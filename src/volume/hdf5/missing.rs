//! Chunks of a dataset that are not in the file.

use hdf5_reader::btree_v1::{BTreeV1Key, collect_btree_v1_leaves_storage};
use hdf5_reader::chunk_index::collect_v2_chunk_entries_storage;
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::extensible_array::collect_extensible_array_chunk_entries_storage;
use hdf5_reader::fixed_array::collect_fixed_array_chunk_entries_storage;
use hdf5_reader::io::Cursor;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::external_files::ExternalFilesMessage;
use hdf5_reader::messages::filter_pipeline::FilterPipelineMessage;
use hdf5_reader::messages::layout::{ChunkIndexing, DataLayout};
use hdf5_reader::{Dataset, Hdf5File};
use std::ops::Range;

/// The tables of more chunks than this are not read to count what is missing.
const MAX_CHUNKS: u64 = 1 << 17;

/// How a dataset is stored, beyond what the library tells of an opened one.
#[derive(Default)]
pub(super) struct Stored {
    pub(super) layout: Option<DataLayout>,
    pub(super) filters: Option<FilterPipelineMessage>,
    pub(super) external: Option<ExternalFilesMessage>,
}

impl Stored {
    pub(super) fn of(file: &Hdf5File, dataset: &Dataset) -> Result<Stored, H5Error> {
        let mut stored = Stored::default();
        for message in &file.get_or_parse_header(dataset.address())?.messages {
            match message {
                HdfMessage::DataLayout(m) => stored.layout = Some(m.layout.clone()),
                HdfMessage::FilterPipeline(m) => stored.filters = Some(m.clone()),
                HdfMessage::ExternalFiles(m) => stored.external = Some(m.clone()),
                _ => {}
            }
        }
        Ok(stored)
    }
}

/// What is not stored of a part of a dataset.
#[derive(Debug, PartialEq)]
pub(super) enum Missing {
    Nothing,
    /// No sample was ever written.
    All,
    /// So many chunks of so many.
    Chunks(u64, u64),
    /// Nobody looked, as there are so many.
    Unknown(u64),
}

/// Counts the chunks of a part of a dataset, given as a range along each axis, that are not in the file.
pub(super) fn missing(
    file: &Hdf5File,
    dataset: &Dataset,
    stored: &Stored,
    part: &[Range<u64>],
) -> Result<Missing, H5Error> {
    let sizes = file.superblock();
    let (offset, length) = (sizes.offset_size, sizes.length_size);
    let (address, indexing) = match &stored.layout {
        Some(DataLayout::Contiguous { address, .. }) => {
            let none = Cursor::is_undefined_offset(*address, offset);
            return Ok(if none { Missing::All } else { Missing::Nothing });
        }
        Some(DataLayout::Chunked {
            address,
            chunk_indexing,
            ..
        }) => (*address, chunk_indexing),
        _ => return Ok(Missing::Nothing),
    };
    let chunk = dataset.chunks().unwrap_or_default();
    if Cursor::is_undefined_offset(address, offset) {
        return Ok(Missing::All);
    }
    if chunk.len() != part.len() || chunk.contains(&0) {
        return Ok(Missing::Nothing);
    }
    let (shape, storage) = (dataset.shape(), file.storage());
    let along = |range: &Range<u64>, &c: &u32| {
        let c = u64::from(c);
        (range.start / c, range.end.saturating_sub(1) / c)
    };
    let bounds: Vec<(u64, u64)> = part.iter().zip(&chunk).map(|(r, c)| along(r, c)).collect();
    let count = |n: u64, (a, b): &(u64, u64)| n.saturating_mul(b - a + 1);
    let total = bounds.iter().fold(1, count);
    let grid = shape.iter().zip(&chunk);
    let grid = grid.fold(1u64, |n, (s, &c)| n.saturating_mul(s.div_ceil(c.into())));
    if grid > MAX_CHUNKS {
        return Ok(Missing::Unknown(total));
    }
    let inside = |offsets: &[u64]| {
        let places = offsets.iter().zip(&chunk).zip(&bounds);
        places.fold(true, |all, ((&at, &c), (a, b))| {
            all && (*a..=*b).contains(&(at / u64::from(c)))
        })
    };
    let entries = match indexing {
        None => {
            let ndim = Some(shape.len() as u32);
            let leaves = collect_btree_v1_leaves_storage(
                storage, address, offset, length, ndim, &chunk, None,
            )?;
            let there = leaves.iter().filter(|(key, _)| match key {
                BTreeV1Key::RawData { offsets, .. } => {
                    inside(&offsets[..shape.len().min(offsets.len())])
                }
                _ => false,
            });
            return Ok(told(total, there.count()));
        }
        Some(ChunkIndexing::BTreeV2) => {
            let ndim = shape.len() as u32;
            collect_v2_chunk_entries_storage(storage, address, offset, length, ndim, &chunk, None)?
        }
        Some(ChunkIndexing::FixedArray { .. }) => collect_fixed_array_chunk_entries_storage(
            storage, address, offset, length, shape, &chunk, None,
        )?,
        Some(ChunkIndexing::ExtensibleArray { .. }) => {
            let max = dataset.max_dims();
            collect_extensible_array_chunk_entries_storage(
                storage, address, offset, length, shape, max, &chunk, None,
            )?
        }
        // written as a whole
        Some(ChunkIndexing::SingleChunk { .. } | ChunkIndexing::Implicit) => {
            return Ok(Missing::Nothing);
        }
    };
    let there = entries.iter().filter(|e| inside(&e.offsets)).count();
    Ok(told(total, there))
}

fn told(total: u64, there: usize) -> Missing {
    match total.saturating_sub(there as u64) {
        0 => Missing::Nothing,
        n if n == total => Missing::All,
        n => Missing::Chunks(n, total),
    }
}
