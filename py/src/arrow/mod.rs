//! Tables by the Arrow C stream interface, <https://arrow.apache.org/docs/format/CDataInterface.html>: columns of whole
//! numbers, conditions and floats, batch by batch.

mod ffi;

pub use ffi::{ArrowArrayStream, ArrowSchema};

/// A column.
#[derive(Debug, Clone)]
pub struct Field {
    /// Its name, without a unit.
    pub name: String,
    /// Its unit; empty for a plain number.
    pub unit: String,
    /// What it holds.
    pub kind: Kind,
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers of 64 bits.
    Whole,
    /// Whole numbers of 64 bits, some of which may be missing.
    WholeIfAny,
    /// True or false.
    Condition,
    /// Floats of 64 bits, some of which may be missing.
    Real,
}

/// Bits, one for each row.
#[derive(Debug, Clone, Default)]
pub struct Bits {
    bytes: Vec<u8>,
    length: usize,
    set: usize,
}

impl Bits {
    /// Adds one.
    pub fn push(&mut self, set: bool) {
        let at = self.length % 8;
        if at == 0 {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= u8::from(set) << at;
        }
        self.length += 1;
        self.set += usize::from(set);
    }
}

/// The values of a column in a batch of rows.
#[derive(Debug, Clone)]
pub enum Values {
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Whole numbers, and which of them are there.
    WholeIfAny(Vec<i64>, Bits),
    /// Conditions.
    Condition(Bits),
    /// Floats, and which of them are there.
    Real(Vec<f64>, Bits),
}

impl Values {
    /// Of a column, empty.
    pub fn of(kind: Kind) -> Self {
        match kind {
            Kind::Whole => Values::Whole(Vec::new()),
            Kind::WholeIfAny => Values::WholeIfAny(Vec::new(), Bits::default()),
            Kind::Condition => Values::Condition(Bits::default()),
            Kind::Real => Values::Real(Vec::new(), Bits::default()),
        }
    }
}

/// Some rows of a table.
#[derive(Debug, Clone)]
pub struct Batch {
    /// How many.
    pub rows: usize,
    /// The values of each column.
    pub columns: Vec<Values>,
}

/// A table, batch by batch.
pub trait Batches: Send + 'static {
    /// Its columns.
    fn fields(&self) -> &[Field];

    /// The next rows; `None` after the last.
    ///
    /// # Errors
    /// What is wrong, for people.
    fn next(&mut self) -> Result<Option<Batch>, String>;
}
