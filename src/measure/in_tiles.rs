//! The measures that tiles carry for programs that read no tables.

use crate::measure::MEASURES;

/// What a piece says of its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Unit of length.
    pub unit: Option<&'static str>,
    /// In the order of [`MEASURES`]; not a number where there is none.
    pub values: [f64; MEASURES.len()],
}

impl Default for Measured {
    fn default() -> Self {
        Measured {
            unit: None,
            values: [f64::NAN; MEASURES.len()],
        }
    }
}
