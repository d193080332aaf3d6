//! Volumes that Python has: arrays in memory, and what gives arrays when it is sliced.

mod array;
mod gather;
mod sliced;

use alvis::cli::call::Given;
use alvis::grid::{Dims, Dtype, Placement};
use alvis::volume::{Endian, Header};
use alvis::{Error, Result};
use array::ArrayVolume;
use gather::Stored;
use numpy::{PyArrayDescr, PyArrayDescrMethods, PyUntypedArray};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use sliced::{Raised, SlicedVolume};

/// Types of samples that are taken, for messages.
const TAKEN: &str = "bool, int8, uint8, int16, uint16, int32, uint32, float16, float32 or float64";

/// A volume of Python's.
pub enum Source {
    /// In memory.
    Array(ArrayVolume),
    /// Read through Python.
    Sliced(SlicedVolume),
}

impl Source {
    /// Of a NumPy array, or an object with `shape`, `dtype` and slices.
    ///
    /// # Errors
    /// `OptionError` for another number of axes, or samples of a type that is not taken; `TypeError` for what is neither.
    pub fn of(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        let refused = |error: &Error| crate::errors::exception(object.py(), error);
        if let Ok(array) = object.cast::<PyUntypedArray>() {
            return ArrayVolume::new(array)
                .map(Source::Array)
                .map_err(|e| refused(&e));
        }
        let (Ok(shape), Ok(dtype)) = (object.getattr("shape"), object.getattr("dtype")) else {
            let found = object.get_type().name()?;
            let text =
                format!("volume: found {found}, expected a path or an array with the axes z, y, x");
            return Err(PyTypeError::new_err(text));
        };
        let shape: Vec<usize> = shape.extract()?;
        let stored = PyArrayDescr::new(object.py(), dtype)?;
        let header = header(&shape, &stored).map_err(|e| refused(&e))?;
        Ok(Source::Sliced(SlicedVolume::new(object, header)))
    }

    /// Where what reading it raises is kept.
    pub fn raised(&self) -> Option<Raised> {
        match self {
            Source::Array(_) => None,
            Source::Sliced(volume) => Some(volume.raised()),
        }
    }

    /// As the library takes it; with what it is known by if that is asked for, which reads all of an array.
    ///
    /// # Errors
    /// None but those of reading it.
    pub fn given(self, name: &str, identified: bool) -> Result<Given> {
        let name = name.to_owned();
        Ok(match self {
            Source::Array(volume) => Given {
                name,
                identity: match identified {
                    true => vec![("the array".into(), volume.checksum()?)],
                    false => Vec::new(),
                },
                make: Box::new(move |place| Ok(Box::new(volume.placed(place)))),
            },
            Source::Sliced(volume) => Given {
                name,
                identity: vec![("the array".into(), volume.known_by())],
                make: Box::new(move |place| Ok(Box::new(volume.placed(place)))),
            },
        })
    }
}

/// What is known of an array: its size and type, and how samples are stored.
struct Known {
    header: Header,
    stored: Stored,
}

/// Of an array of this shape, z first, and type.
///
/// # Errors
/// [`Error::Usage`] for another number of axes, one that is too short or too long, and types that are not taken.
fn header(shape: &[usize], descr: &Bound<'_, PyArrayDescr>) -> Result<Known> {
    let &[z, y, x] = shape else {
        let found = format!("an array of shape {shape:?}");
        let hint = "take one volume of several, as array[0], and stack slices by numpy.stack";
        return Err(Error::usage("volume", found, "three axes: z, y, x").with_hint(hint));
    };
    let dims = Dims::new([x, y, z].map(|n| n as u64)).map_err(|error| match error {
        Error::Usage { expected, .. } => {
            Error::usage("volume", format!("an array of shape {shape:?}"), expected)
        }
        other => other,
    })?;
    let (kind, bytes) = (descr.kind(), descr.itemsize());
    let dtype = match (kind, bytes) {
        (b'b' | b'u', 1) => Dtype::U8,
        (b'i', 1) => Dtype::I8,
        (b'u', 2) => Dtype::U16,
        (b'i', 2) => Dtype::I16,
        (b'u', 4) => Dtype::U32,
        (b'i', 4) => Dtype::I32,
        (b'f', 2 | 4) => Dtype::F32,
        (b'f', 8) => Dtype::F64,
        _ => {
            let found = format!("an array of type {}", name(descr));
            let hint = "convert it, as volume.astype(numpy.float32)";
            return Err(Error::usage("volume", found, TAKEN).with_hint(hint));
        }
    };
    let swapped = descr.is_native_byteorder() == Some(false);
    let stored = match (kind, bytes) {
        (b'f', 2) => Stored::Half { swapped },
        _ => Stored::Plain { bytes, swapped },
    };
    let endian = match (Endian::NATIVE, swapped) {
        (Endian::Little, true) => Endian::Big,
        (Endian::Big, true) => Endian::Little,
        (native, false) => native,
    };
    let header = Header {
        format: "array",
        dims,
        dtype,
        endian,
        placement: Placement::default(),
    };
    Ok(Known { header, stored })
}

/// The name of a type of samples, as NumPy has it.
fn name(descr: &Bound<'_, PyArrayDescr>) -> String {
    descr
        .str()
        .map_or_else(|_| "unknown".to_owned(), |name| name.to_string())
}
