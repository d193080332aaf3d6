//! The structures of the Arrow C interface. Each owns what it points at, and gives it back in its `release`, which the one
//! who has the structure then calls once; dropped here, it is released if nobody has done so.

use super::{Batch, Batches, Bits, Field, Kind, Values};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};

/// A column may have missing values.
const NULLABLE: i64 = 2;
/// The system's number of an error of reading.
const EIO: c_int = 5;

/// `struct ArrowSchema`.
#[repr(C)]
pub struct ArrowSchema {
    format: *const c_char,
    name: *const c_char,
    metadata: *const c_char,
    flags: i64,
    n_children: i64,
    children: *mut *mut ArrowSchema,
    dictionary: *mut ArrowSchema,
    release: Option<unsafe extern "C" fn(*mut ArrowSchema)>,
    private_data: *mut c_void,
}

/// `struct ArrowArray`.
#[repr(C)]
struct ArrowArray {
    length: i64,
    null_count: i64,
    offset: i64,
    n_buffers: i64,
    n_children: i64,
    buffers: *const *const c_void,
    children: *mut *mut ArrowArray,
    dictionary: *mut ArrowArray,
    release: Option<unsafe extern "C" fn(*mut ArrowArray)>,
    private_data: *mut c_void,
}

/// `struct ArrowArrayStream`.
#[repr(C)]
pub struct ArrowArrayStream {
    get_schema: unsafe extern "C" fn(*mut ArrowArrayStream, *mut ArrowSchema) -> c_int,
    get_next: unsafe extern "C" fn(*mut ArrowArrayStream, *mut ArrowArray) -> c_int,
    get_last_error: unsafe extern "C" fn(*mut ArrowArrayStream) -> *const c_char,
    release: Option<unsafe extern "C" fn(*mut ArrowArrayStream)>,
    private_data: *mut c_void,
}

// SAFETY: all that these point at is their own, and `Send`
unsafe impl Send for ArrowSchema {}
// SAFETY: as above
unsafe impl Send for ArrowArrayStream {}

impl Drop for ArrowSchema {
    fn drop(&mut self) {
        if let Some(release) = self.release {
            // SAFETY: it has not been released yet, and is not used after this
            unsafe { release(self) };
        }
    }
}

impl Drop for ArrowArrayStream {
    fn drop(&mut self) {
        if let Some(release) = self.release {
            // SAFETY: it has not been released yet, and is not used after this
            unsafe { release(self) };
        }
    }
}

/// Pointers to structures on the heap, as an array of them. What a vector holds stays where it is when that is moved, and
/// pointers to it stay valid.
type Pointers<T> = Vec<*mut T>;

/// What a schema points at.
struct SchemaParts {
    _name: Vec<u8>,
    _metadata: Vec<u8>,
    children: Pointers<ArrowSchema>,
}

/// What an array points at.
struct ArrayParts {
    _values: Option<Values>,
    _buffers: Vec<*const c_void>,
    children: Pointers<ArrowArray>,
}

fn pointers<T>(all: impl Iterator<Item = T>) -> Pointers<T> {
    all.map(|each| Box::into_raw(Box::new(each))).collect()
}

/// A text without the zeros that would end it.
fn text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Pairs of keys and values, as the interface has them: their number, and each with its length before it.
fn metadata(pairs: &[(&str, &str)]) -> Vec<u8> {
    let mut bytes = (pairs.len() as i32).to_ne_bytes().to_vec();
    for text in pairs.iter().flat_map(|(key, value)| [key, value]) {
        bytes.extend((text.len() as i32).to_ne_bytes());
        bytes.extend(text.as_bytes());
    }
    bytes
}

impl ArrowSchema {
    /// Of a table with these columns.
    pub fn table(fields: &[Field]) -> Self {
        let children = pointers(fields.iter().map(Self::column));
        Self::new(c"+s", 0, "", Vec::new(), children)
    }

    fn column(field: &Field) -> Self {
        let (format, flags) = match field.kind {
            Kind::Whole => (c"l", 0),
            Kind::WholeIfAny => (c"l", NULLABLE),
            Kind::Condition => (c"b", 0),
            Kind::Real => (c"g", NULLABLE),
        };
        let unit = match &field.unit[..] {
            "" => Vec::new(),
            unit => metadata(&[("unit", unit)]),
        };
        Self::new(format, flags, &field.name, unit, Vec::new())
    }

    fn new(
        format: &'static CStr,
        flags: i64,
        name: &str,
        metadata: Vec<u8>,
        mut children: Pointers<ArrowSchema>,
    ) -> Self {
        let name = text(name).into_bytes_with_nul();
        let pairs = match metadata.is_empty() {
            true => null(),
            false => metadata.as_ptr(),
        };
        let name_at = name.as_ptr();
        let (n_children, first) = (children.len() as i64, children.as_mut_ptr());
        let parts = SchemaParts {
            _name: name,
            _metadata: metadata,
            children,
        };
        ArrowSchema {
            format: format.as_ptr(),
            name: name_at.cast(),
            metadata: pairs.cast(),
            flags,
            n_children,
            children: first,
            dictionary: null_mut(),
            release: Some(release_schema),
            private_data: Box::into_raw(Box::new(parts)).cast(),
        }
    }
}

unsafe extern "C" fn release_schema(schema: *mut ArrowSchema) {
    // SAFETY: the caller's is a schema that was made by `new` and not released; its parts are taken once
    unsafe {
        let parts = Box::from_raw((*schema).private_data.cast::<SchemaParts>());
        for &child in &parts.children {
            // dropping releases it, unless the consumer has moved it out
            drop(Box::from_raw(child));
        }
        (*schema).release = None;
    }
}

impl ArrowArray {
    /// What stands for the end of a stream.
    fn released() -> Self {
        ArrowArray {
            length: 0,
            null_count: 0,
            offset: 0,
            n_buffers: 0,
            n_children: 0,
            buffers: null(),
            children: null_mut(),
            dictionary: null_mut(),
            release: None,
            private_data: null_mut(),
        }
    }

    fn batch(batch: Batch) -> Self {
        let rows = batch.rows;
        let children = batch.columns.into_iter();
        let children = pointers(children.map(|values| Self::column(rows, values)));
        Self::new(rows, 0, None, vec![null()], children)
    }

    fn column(rows: usize, values: Values) -> Self {
        let some_of = |there: &Bits, values| {
            let buffers = vec![there.bytes.as_ptr().cast(), values];
            (rows - there.set, buffers)
        };
        let (missing, buffers) = match &values {
            Values::Whole(values) => (0, vec![null(), values.as_ptr().cast()]),
            Values::Condition(bits) => (0, vec![null(), bits.bytes.as_ptr().cast()]),
            Values::WholeIfAny(values, there) => some_of(there, values.as_ptr().cast()),
            Values::Real(values, there) => some_of(there, values.as_ptr().cast()),
        };
        Self::new(rows, missing, Some(values), buffers, Vec::new())
    }

    fn new(
        rows: usize,
        missing: usize,
        values: Option<Values>,
        buffers: Vec<*const c_void>,
        mut children: Pointers<ArrowArray>,
    ) -> Self {
        let (n_buffers, first_buffer) = (buffers.len() as i64, buffers.as_ptr());
        let (n_children, first) = (children.len() as i64, children.as_mut_ptr());
        let parts = ArrayParts {
            _values: values,
            _buffers: buffers,
            children,
        };
        ArrowArray {
            length: rows as i64,
            null_count: missing as i64,
            offset: 0,
            n_buffers,
            n_children,
            buffers: first_buffer,
            children: first,
            dictionary: null_mut(),
            release: Some(release_array),
            private_data: Box::into_raw(Box::new(parts)).cast(),
        }
    }
}

unsafe extern "C" fn release_array(array: *mut ArrowArray) {
    // SAFETY: the caller's is an array that was made by `new` and not released; its parts are taken once
    unsafe {
        let parts = Box::from_raw((*array).private_data.cast::<ArrayParts>());
        for &child in &parts.children {
            let child = Box::from_raw(child);
            // a consumer may have moved it out, and releases it there
            if let Some(release) = child.release {
                let child = Box::into_raw(child);
                release(child);
                drop(Box::from_raw(child));
            }
        }
        (*array).release = None;
    }
}

/// What a stream points at.
struct StreamParts {
    batches: Box<dyn Batches>,
    error: CString,
}

impl ArrowArrayStream {
    /// Of a table.
    pub fn new(batches: impl Batches) -> Self {
        let parts = StreamParts {
            batches: Box::new(batches),
            error: CString::default(),
        };
        ArrowArrayStream {
            get_schema,
            get_next,
            get_last_error,
            release: Some(release_stream),
            private_data: Box::into_raw(Box::new(parts)).cast(),
        }
    }
}

unsafe extern "C" fn get_schema(stream: *mut ArrowArrayStream, out: *mut ArrowSchema) -> c_int {
    // SAFETY: the caller's is a stream that is not released, and room for a schema that holds none
    unsafe {
        let parts = &*(*stream).private_data.cast::<StreamParts>();
        out.write(ArrowSchema::table(parts.batches.fields()));
    }
    0
}

unsafe extern "C" fn get_next(stream: *mut ArrowArrayStream, out: *mut ArrowArray) -> c_int {
    // SAFETY: the caller's is a stream that is not released, which one thread asks at a time, and room for an array that
    // holds none
    unsafe {
        let parts = &mut *(*stream).private_data.cast::<StreamParts>();
        match parts.batches.next() {
            Ok(batch) => {
                out.write(batch.map_or_else(ArrowArray::released, ArrowArray::batch));
                0
            }
            Err(message) => {
                parts.error = text(&message);
                EIO
            }
        }
    }
}

unsafe extern "C" fn get_last_error(stream: *mut ArrowArrayStream) -> *const c_char {
    // SAFETY: the caller's is a stream that is not released
    unsafe {
        (*(*stream).private_data.cast::<StreamParts>())
            .error
            .as_ptr()
    }
}

unsafe extern "C" fn release_stream(stream: *mut ArrowArrayStream) {
    // SAFETY: the caller's is a stream that is not released; its parts are taken once
    unsafe {
        drop(Box::from_raw((*stream).private_data.cast::<StreamParts>()));
        (*stream).release = None;
    }
}
