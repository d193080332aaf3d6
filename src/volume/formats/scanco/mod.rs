//! Scanco Medical's volumes: ISQ of the scanner, and AIM of its programs.
//!
//! The layouts are those that ITKIOScanco (<https://github.com/KitwareMedical/ITKIOScanco>) and AimIO
//! (<https://github.com/Numerics88/AimIO>) document. Stored whole numbers are attenuation in 1/cm times a number that
//! the file states (`mu_scaling`): values are in 1/cm. A calibration to density is told and not applied.

mod aim;
mod isq;

pub(crate) use aim::FORMAT as AIM;
pub(crate) use isq::FORMAT as ISQ;

use crate::volume::adapters::values::Values;

/// The scale of samples that are attenuation times this number; none if that says nothing.
fn attenuation(scaling: f64) -> Option<Values> {
    let sound = scaling.is_finite() && scaling > 0.0;
    match sound {
        true => Values::linear(1.0 / scaling, 0.0, "mu_scaling, in 1/cm"),
        false => None,
    }
}

/// A number at a place of a header, least significant byte first; 0 behind its end.
fn i32_at(head: &[u8], at: usize) -> i32 {
    let bytes = head.get(at..).and_then(|rest| rest.first_chunk::<4>());
    bytes.map_or(0, |bytes| i32::from_le_bytes(*bytes))
}
