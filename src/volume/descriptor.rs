//! What a format's parser finds out.

use crate::grid::{Dims, Placement, Provenance};
use crate::volume::adapters::permute::stored_dims;
use crate::volume::adapters::resample::Grid;
use crate::volume::adapters::values::Values;
use crate::volume::io::byte_source::ByteSource;
use crate::volume::io::data::{Data, Stored};
use crate::volume::io::paged::Pages;
use crate::volume::stated::warning::Warning;
use crate::volume::{Dtype, Endian};

/// A parsed header.
pub(crate) struct VolumeDescriptor {
    pub(crate) format: &'static str,
    pub(crate) dims: Dims,
    pub(crate) dtype: Dtype,
    /// `None` where the file does not say.
    pub(crate) endian: Option<Endian>,
    pub(crate) placement: Placement,
    pub(crate) provenance: Provenance,
    /// The values that the samples stand for; `None` if these are the samples.
    pub(crate) values: Option<Values>,
    /// How they follow from what is stored, where the samples already are the values.
    pub(crate) applied: Option<String>,
    /// True along x or y if the samples are stored the other way round.
    pub(crate) mirrored: [bool; 2],
    /// Which of x, y and z each axis of the stored samples is, the fastest first.
    pub(crate) stored_axes: [usize; 3],
    /// Samples in files are floats of 16 bits, which are handed out as the f32 of `dtype`.
    pub(crate) half: bool,
    pub(crate) samples: Samples,
    /// The regular grid that samples are interpolated to, if they do not lie on one. `dims` are those of the
    /// samples, `placement` is that of the grid.
    pub(crate) grid: Option<Grid>,
    /// What a user should know that the header does not show.
    pub(crate) notes: Vec<String>,
    /// What may make numbers wrong unless the user does something about it.
    pub(crate) warnings: Vec<Warning>,
}

impl VolumeDescriptor {
    /// A volume of whose byte order and place nothing is known.
    pub(crate) fn new(format: &'static str, dims: Dims, dtype: Dtype, samples: Samples) -> Self {
        VolumeDescriptor {
            format,
            dims,
            dtype,
            endian: None,
            placement: Placement::default(),
            provenance: Provenance::default(),
            values: None,
            applied: None,
            mirrored: [false; 2],
            stored_axes: [0, 1, 2],
            half: false,
            grid: None,
            samples,
            notes: Vec::new(),
            warnings: Vec::new(),
        }
    }
}

impl VolumeDescriptor {
    /// Size and type of samples as files hold them.
    pub(crate) fn stored(&self) -> Stored {
        Stored {
            dims: stored_dims(self.stored_axes, self.dims),
            bytes: if self.half {
                2
            } else {
                self.dtype.bytes() as u64
            },
            name: if self.half { "f16" } else { self.dtype.name() },
        }
    }
}

/// Where the samples of a volume come from.
pub(crate) enum Samples {
    /// Files of which the layout is known.
    Files(Data),
    /// Bytes that the parser has found already, in the byte order of the descriptor.
    Bytes(Box<dyn ByteSource>),
    /// Pages that hand out samples in the machine's byte order.
    Pages(Box<dyn Pages>),
    /// Chunks of all three axes, likewise.
    #[cfg(any(feature = "hdf5", feature = "zarr"))]
    Chunks(Box<dyn crate::volume::io::chunked::Chunks>),
}
