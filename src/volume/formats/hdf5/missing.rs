//! Chunks of a dataset that are not in the file.

use crate::volume::stated::written::Missing;
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
pub(crate) struct Stored {
    pub(crate) layout: Option<DataLayout>,
    pub(crate) filters: Option<FilterPipelineMessage>,
    pub(crate) external: Option<ExternalFilesMessage>,
}

impl Stored {
    pub(crate) fn of(file: &Hdf5File, dataset: &Dataset) -> Result<Stored, H5Error> {
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

/// The chunks of a part of a dataset, given as a range along each axis, that are not in the file; they are not counted
/// if there are too many to look. One piece that was never written counts as a chunk.
pub(crate) fn missing(
    file: &Hdf5File,
    dataset: &Dataset,
    stored: &Stored,
    part: &[Range<u64>],
) -> Result<Missing, H5Error> {
    let found = |count: Option<u64>, total: u64| Ok(Missing { count, total });
    let undefined =
        |address: u64| Cursor::is_undefined_offset(address, file.superblock().offset_size);
    let (address, indexing) = match &stored.layout {
        Some(DataLayout::Contiguous { address, .. }) => {
            return found(Some(undefined(*address).into()), 1);
        }
        Some(DataLayout::Chunked {
            address,
            chunk_indexing,
            ..
        }) => (*address, chunk_indexing.as_ref()),
        _ => return found(Some(0), 1),
    };
    let chunk = dataset.chunks().unwrap_or_default();
    if chunk.len() != part.len() || chunk.contains(&0) {
        return found(Some(0), 1);
    }
    let along = |(range, c): (&Range<u64>, &u32)| {
        let c = u64::from(*c);
        range.start / c..range.end.div_ceil(c)
    };
    let wanted: Vec<Range<u64>> = part.iter().zip(&chunk).map(along).collect();
    let count = |n: u64, r: &Range<u64>| n.saturating_mul(r.end - r.start);
    let total = wanted.iter().fold(1, count);
    if undefined(address) {
        return found(Some(total), total);
    }
    let grid = dataset.shape().iter().zip(&chunk);
    let grid = grid.fold(1u64, |n, (s, &c)| n.saturating_mul(s.div_ceil(c.into())));
    if grid > MAX_CHUNKS {
        return found(None, total);
    }
    let Some(there) = chunks_of(file, dataset, address, indexing)? else {
        return found(Some(0), total);
    };
    let inside = |offsets: &&Vec<u64>| {
        let mut places = offsets.iter().zip(&chunk).zip(&wanted);
        places.all(|((&at, &c), wanted)| wanted.contains(&(at / u64::from(c))))
    };
    let there = there.iter().filter(inside).count() as u64;
    found(Some(total.saturating_sub(there)), total)
}

/// Where the chunks begin that are in the file; `None` if they were written as a whole.
fn chunks_of(
    file: &Hdf5File,
    dataset: &Dataset,
    address: u64,
    indexing: Option<&ChunkIndexing>,
) -> Result<Option<Vec<Vec<u64>>>, H5Error> {
    let (storage, sizes) = (file.storage(), file.superblock());
    let (offset, length) = (sizes.offset_size, sizes.length_size);
    let (shape, chunk) = (dataset.shape(), dataset.chunks().unwrap_or_default());
    let ndim = shape.len() as u32;
    let entries = match indexing {
        None => {
            let leaves = collect_btree_v1_leaves_storage(
                storage,
                address,
                offset,
                length,
                Some(ndim),
                &chunk,
                None,
            )?;
            let places = leaves.into_iter().filter_map(|(key, _)| match key {
                BTreeV1Key::RawData { offsets, .. } => Some(offsets),
                _ => None,
            });
            return Ok(Some(places.collect()));
        }
        Some(ChunkIndexing::BTreeV2) => {
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
        Some(ChunkIndexing::SingleChunk { .. } | ChunkIndexing::Implicit) => return Ok(None),
    };
    Ok(Some(entries.into_iter().map(|e| e.offsets).collect()))
}
