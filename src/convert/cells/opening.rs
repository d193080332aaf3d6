//! An opening between two cells of one component, as the table of necks has it.

use crate::convert::cells::contacts::Contact;
use bytemuck::{Pod, Zeroable};

/// An opening; NaN stands for what is not known.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Opening {
    /// The cells, the smaller id first.
    pub cells: [u64; 2],
    /// Radius of the narrowest place on the widest way, in the unit of measures.
    pub radius: f64,
    /// That over the radius of the smaller cell, where the cells were cut from each other.
    pub ratio: f64,
    /// The narrowest place or the middle of the faces, in voxels.
    pub place: [f64; 3],
    /// Area, in the square of the unit.
    pub area: f64,
}

impl Opening {
    /// Of a contact of cells that were given, with voxels of this size.
    pub fn of(contact: &Contact, spacing: [f64; 3]) -> Self {
        Opening {
            cells: contact.cells,
            radius: f64::NAN,
            ratio: f64::NAN,
            place: contact.middle().unwrap_or([f64::NAN; 3]),
            area: contact.area(spacing),
        }
    }
}
