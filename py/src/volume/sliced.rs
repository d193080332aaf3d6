//! What gives an array when it is sliced, such as a Zarr array in memory or far away, or one of HDF5, as a volume: read
//! through Python, a block at a time and once, to a temporary file.

use super::array::samples;
use super::{Known, header, name};
use alvis::grid::{Dims, Dtype, Placement};
use alvis::volume::{Header, Volume};
use alvis::{Error, Result};
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PySlice, PyTuple};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// What reading a volume raised first.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Takes it out.
    pub fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn keep(&self, error: PyErr) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.get_or_insert(error);
    }
}

/// An object with `shape`, `dtype` and slices.
pub struct SlicedVolume {
    header: Header,
    object: Py<PyAny>,
    /// Voxels along x, y and z of its chunks.
    grain: [u32; 3],
    raised: Raised,
}

impl SlicedVolume {
    /// Of an object of which this is known.
    pub(super) fn new(object: &Bound<'_, PyAny>, known: Known) -> Self {
        SlicedVolume {
            grain: grain(object, known.header.dims),
            header: known.header,
            object: object.clone().unbind(),
            raised: Raised::default(),
        }
    }

    /// The same in another place.
    pub fn placed(mut self, placement: Placement) -> Self {
        self.header.placement = placement;
        self
    }

    /// Where what reading it raises is kept.
    pub fn raised(&self) -> Raised {
        self.raised.clone()
    }

    /// Something that no other has: what it holds is not known before it is read.
    pub fn known_by(&self) -> String {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        format!("read through Python at {}", now.as_nanos())
    }

    fn read(&self, py: Python<'_>, ranges: [Range<u32>; 3], out: &mut [u8]) -> PyResult<()> {
        let [x, y, z] = &ranges;
        let slice = |r: &Range<u32>| PySlice::new(py, r.start as isize, r.end as isize, 1);
        let key = PyTuple::new(py, [slice(z), slice(y), slice(x)])?;
        let block = self.object.bind(py).get_item(key)?;
        let block = py.import("numpy")?.call_method1("asarray", (block,))?;
        let array = block.cast::<PyUntypedArray>()?;
        let shape = [z.len(), y.len(), x.len()];
        let found = header(array.shape(), &array.dtype());
        let same = |dtype: Dtype| dtype == self.header.dtype && array.shape() == shape;
        match found {
            Ok(Known { header, stored }) if same(header.dtype) => {
                let all = [x, y, z].map(|r| 0..r.len() as u32);
                // SAFETY: the array has just this shape and lives until the end of this function
                unsafe { samples(array, stored).copy(all, out) };
                Ok(())
            }
            _ => {
                let found = format!("shape {:?} of {}", array.shape(), name(&array.dtype()));
                let expected = format!("shape {shape:?} of {}", self.header.dtype);
                let error = Error::usage("volume", format!("a slice of {found}"), expected);
                Err(crate::errors::exception(py, &error))
            }
        }
    }
}

/// The size of an object's chunks, if it has any: three numbers, or the sizes of all along each axis.
fn grain(object: &Bound<'_, PyAny>, dims: Dims) -> [u32; 3] {
    let chunks = object.getattr("chunks").ok();
    let sizes = chunks.and_then(|chunks| {
        let sizes = chunks.extract::<[u32; 3]>().ok();
        let all = || chunks.extract::<[Vec<u32>; 3]>().ok();
        sizes.or_else(|| Some(all()?.map(|sizes| sizes.first().copied().unwrap_or(1))))
    });
    let [z, y, x] = sizes.unwrap_or([1; 3]);
    let most = dims.0;
    let sizes = [x, y, z];
    std::array::from_fn(|a| sizes[a].clamp(1, most[a]))
}

impl Volume for SlicedVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        Python::attach(|py| self.read(py, [x, y, z], out)).map_err(|error| {
            let text = Python::attach(|py| error.value(py).to_string());
            self.raised.keep(error);
            Error::io("volume", "read a slice", std::io::Error::other(text))
        })
    }

    fn random_access(&self) -> bool {
        false
    }

    fn grain(&self) -> [u32; 3] {
        self.grain
    }
}
