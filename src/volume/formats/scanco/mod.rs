//! Scanco Medical's volumes: ISQ of the scanner, and AIM of its programs.
//!
//! The layouts are those that ITKIOScanco (<https://github.com/KitwareMedical/ITKIOScanco>) and AimIO
//! (<https://github.com/Numerics88/AimIO>) document. Stored whole numbers are attenuation in 1/cm times a number that
//! the file states (`mu_scaling`): values are in 1/cm. A calibration to density is told and not applied.

mod aim;
mod isq;

pub(crate) use aim::FORMAT as AIM;
pub(crate) use isq::FORMAT as ISQ;

use crate::volume::Endian;
use crate::volume::adapters::values::Values;
use crate::volume::io::word::word;

/// The scale of samples that are attenuation times this number; none if that says nothing.
fn attenuation(scaling: f64) -> Option<Values> {
    let sound = scaling.is_finite() && scaling > 0.0;
    match sound {
        true => Values::linear(1.0 / scaling, 0.0, "mu_scaling, in 1/cm"),
        false => None,
    }
}

/// A calibration of attenuation, in 1/cm, to another quantity.
#[derive(Debug, Clone, PartialEq)]
struct Calibration {
    slope: f64,
    intercept: f64,
    /// As the file has it: `mg HA/ccm`.
    unit: String,
}

impl Calibration {
    /// What a user should know of it: values are as attenuation, and how a threshold in the other quantity becomes one.
    /// None for one that says nothing.
    fn note(&self) -> Option<String> {
        let Calibration {
            slope,
            intercept,
            unit,
        } = self;
        let says = slope.is_finite() && intercept.is_finite() && *slope != 0.0;
        let says = says && (*slope, *intercept) != (1.0, 0.0);
        let unit = match unit.trim() {
            "" => "of an unstated unit",
            unit => unit,
        };
        let [plus, minus] = match *intercept < 0.0 {
            true => ['-', '+'],
            false => ['+', '-'],
        };
        let by = intercept.abs();
        says.then(|| {
            format!(
                "the file states a density ({unit}) of {slope} times the attenuation in 1/cm {plus} {by}, which is not \
                 applied: a density D is the threshold (D {minus} {by}) / {slope} here"
            )
        })
    }
}

/// A number at a place of a header, least significant byte first; 0 behind its end.
fn i32_at(head: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(word(head, at, Endian::Little))
}
