//! The measures that tiles carry for programs that read no tables.

/// Names of the measures that a piece carries, as in the table of cells.
pub const MEASURES: [&str; 11] = [
    "voxels",
    "volume",
    "mesh_volume",
    "area",
    "equivalent_diameter",
    "sphericity",
    "form_factor",
    "elongation",
    "flatness",
    "euler_characteristic",
    "touches_border",
];

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
