//! Sample types, and the comparison with a threshold in the type's own arithmetic.

use crate::error::{Error, Result};
use bytemuck::Pod;
use serde::{Deserialize, Serialize};

/// The type of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)] // the names say it all
pub enum Dtype {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Dtype {
    /// Every type, in the order of the help text.
    pub const ALL: [Dtype; 8] = [
        Dtype::U8,
        Dtype::I8,
        Dtype::U16,
        Dtype::I16,
        Dtype::U32,
        Dtype::I32,
        Dtype::F32,
        Dtype::F64,
    ];

    /// Bytes per sample.
    pub fn bytes(self) -> usize {
        match self {
            Dtype::U8 | Dtype::I8 => 1,
            Dtype::U16 | Dtype::I16 => 2,
            Dtype::U32 | Dtype::I32 | Dtype::F32 => 4,
            Dtype::F64 => 8,
        }
    }

    /// The short name: `u16`.
    pub fn name(self) -> &'static str {
        match self {
            Dtype::U8 => "u8",
            Dtype::I8 => "i8",
            Dtype::U16 => "u16",
            Dtype::I16 => "i16",
            Dtype::U32 => "u32",
            Dtype::I32 => "i32",
            Dtype::F32 => "f32",
            Dtype::F64 => "f64",
        }
    }

    /// The name that NumPy gives it: `uint16`.
    pub fn numpy_name(self) -> &'static str {
        match self {
            Dtype::U8 => "uint8",
            Dtype::I8 => "int8",
            Dtype::U16 => "uint16",
            Dtype::I16 => "int16",
            Dtype::U32 => "uint32",
            Dtype::I32 => "int32",
            Dtype::F32 => "float32",
            Dtype::F64 => "float64",
        }
    }

    /// The smallest and the largest value of a type of whole numbers.
    pub fn whole_numbers(self) -> Option<[f64; 2]> {
        let ends = match self {
            Dtype::U8 => [0.0, f64::from(u8::MAX)],
            Dtype::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
            Dtype::U16 => [0.0, f64::from(u16::MAX)],
            Dtype::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
            Dtype::U32 => [0.0, f64::from(u32::MAX)],
            Dtype::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
            Dtype::F32 | Dtype::F64 => return None,
        };
        Some(ends)
    }

    /// True for f32 and f64, which can hold NaN.
    pub fn is_float(self) -> bool {
        matches!(self, Dtype::F32 | Dtype::F64)
    }
}

impl std::fmt::Display for Dtype {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Dtype {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Dtype::ALL
            .into_iter()
            .find(|d| [d.name(), d.numpy_name()].contains(&text))
            .ok_or_else(|| {
                Error::usage(
                    "--dtype",
                    text,
                    "one of u8, i8, u16, i16, u32, i32, f32, f64",
                )
            })
    }
}

/// One component of a gradient, in samples per voxel step.
pub trait Slope: Copy + Send + Sync + std::fmt::Debug + 'static {
    /// A slope of 1.
    const ONE: Self;

    /// The slope as a number.
    fn to_f32(self) -> f32;
}

/// In halves, so that differences of small integers stay exact and numbers are made of many at once.
impl Slope for i32 {
    const ONE: Self = 2;
    #[inline(always)]
    fn to_f32(self) -> f32 {
        0.5 * self as f32
    }
}

/// The slope itself, from a difference that was rounded once.
impl Slope for f32 {
    const ONE: Self = 1.0;
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

/// A sample type that the kernels are compiled for.
pub trait Voxel: Pod + PartialOrd + Send + Sync + std::fmt::Debug + 'static {
    /// The run-time name of this type.
    const DTYPE: Dtype;

    /// The exact value; every type here fits an `f64`.
    fn to_f64(self) -> f64;

    /// The nearest value of this type, the even one of two whole numbers; the end of the type for what is beyond it.
    fn nearest(value: f64) -> Self;

    /// What slopes between such samples are kept in.
    type Slope: Slope;

    /// The slope between this sample and the one two voxels before it.
    fn central_slope(self, before: Self) -> Self::Slope;

    /// The slope between this sample and the one next before it.
    fn one_sided_slope(self, before: Self) -> Self::Slope;

    /// The smallest sample s with s >= t, so that `v >= t` can be decided in this type. `None` if
    /// no sample reaches t (t is above the type's largest value, or NaN).
    fn ceil_from(t: f64) -> Option<Self>;

    /// Reverses the bytes of the sample.
    fn swap_bytes(self) -> Self;
}

macro_rules! integer_voxel {
    ($($t:ty => $dtype:ident, $slope:ty, $slope_of:ident;)*) => {$(
        impl Voxel for $t {
            const DTYPE: Dtype = Dtype::$dtype;
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            fn nearest(value: f64) -> Self {
                // casts of floats saturate
                value.round_ties_even() as $t
            }
            type Slope = $slope;
            #[inline(always)]
            fn central_slope(self, before: Self) -> $slope {
                $slope_of(self.into(), before.into(), 1)
            }
            #[inline(always)]
            fn one_sided_slope(self, before: Self) -> $slope {
                $slope_of(self.into(), before.into(), 2)
            }
            fn ceil_from(t: f64) -> Option<Self> {
                let c = t.ceil();
                // NaN compares false and gives None; the cast below saturates at MIN
                (c <= f64::from(<$t>::MAX)).then_some(c as $t)
            }
            fn swap_bytes(self) -> Self {
                <$t>::swap_bytes(self)
            }
        }
    )*};
}

/// Half of so many times the difference, in halves.
#[inline(always)]
fn halves(value: i32, before: i32, times: i32) -> i32 {
    times * (value - before)
}

/// Half of so many times the difference.
#[inline(always)]
fn rounded(value: i64, before: i64, times: u8) -> f32 {
    0.5 * f32::from(times) * (value - before) as f32
}

integer_voxel! {
    u8 => U8, i32, halves;
    i8 => I8, i32, halves;
    u16 => U16, i32, halves;
    i16 => I16, i32, halves;
    u32 => U32, f32, rounded;
    i32 => I32, f32, rounded;
}

impl Voxel for f32 {
    const DTYPE: Dtype = Dtype::F32;
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    fn nearest(value: f64) -> Self {
        value as f32
    }
    type Slope = f32;
    #[inline(always)]
    fn central_slope(self, before: Self) -> f32 {
        0.5 * (self - before)
    }
    #[inline(always)]
    fn one_sided_slope(self, before: Self) -> f32 {
        self - before
    }
    fn ceil_from(t: f64) -> Option<Self> {
        let near = t as f32;
        if t.is_nan() {
            None
        } else if f64::from(near) >= t {
            Some(near)
        } else {
            Some(near.next_up())
        }
    }
    fn swap_bytes(self) -> Self {
        f32::from_bits(self.to_bits().swap_bytes())
    }
}

impl Voxel for f64 {
    const DTYPE: Dtype = Dtype::F64;
    fn to_f64(self) -> f64 {
        self
    }
    fn nearest(value: f64) -> Self {
        value
    }
    type Slope = f32;
    #[inline(always)]
    fn central_slope(self, before: Self) -> f32 {
        0.5 * (self - before) as f32
    }
    #[inline(always)]
    fn one_sided_slope(self, before: Self) -> f32 {
        (self - before) as f32
    }
    fn ceil_from(t: f64) -> Option<Self> {
        (!t.is_nan()).then_some(t)
    }
    fn swap_bytes(self) -> Self {
        f64::from_bits(self.to_bits().swap_bytes())
    }
}

/// Byte order of samples of more than one byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// The order of this machine.
    pub const NATIVE: Endian = if cfg!(target_endian = "big") {
        Endian::Big
    } else {
        Endian::Little
    };

    /// `little` or `big`.
    pub fn name(self) -> &'static str {
        match self {
            Endian::Little => "little",
            Endian::Big => "big",
        }
    }
}

impl std::fmt::Display for Endian {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Endian {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "little" => Ok(Endian::Little),
            "big" => Ok(Endian::Big),
            _ => Err(Error::usage("--endian", text, "little or big")),
        }
    }
}

/// Runs an expression with a type alias bound to the Rust type of a [`Dtype`]:
/// `with_voxel_type!(dtype, T => sum::<T>(bytes))`.
macro_rules! with_voxel_type {
    ($dtype:expr, $t:ident => $body:expr) => {
        match $dtype {
            $crate::grid::Dtype::U8 => {
                type $t = u8;
                $body
            }
            $crate::grid::Dtype::I8 => {
                type $t = i8;
                $body
            }
            $crate::grid::Dtype::U16 => {
                type $t = u16;
                $body
            }
            $crate::grid::Dtype::I16 => {
                type $t = i16;
                $body
            }
            $crate::grid::Dtype::U32 => {
                type $t = u32;
                $body
            }
            $crate::grid::Dtype::I32 => {
                type $t = i32;
                $body
            }
            $crate::grid::Dtype::F32 => {
                type $t = f32;
                $body
            }
            $crate::grid::Dtype::F64 => {
                type $t = f64;
                $body
            }
        }
    };
}
pub(crate) use with_voxel_type;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_compare_as_real_numbers_do() {
        for t in [
            -1.0,
            0.0,
            0.5,
            127.0,
            127.5,
            254.5,
            255.0,
            255.5,
            1e30,
            f64::NAN,
            f64::NEG_INFINITY,
        ] {
            let ceil = u8::ceil_from(t);
            for v in 0..=255u8 {
                assert_eq!(ceil.is_some_and(|c| v >= c), f64::from(v) >= t, "{v} {t}");
            }
        }
        for t in [0.1, 0.1f32 as f64, 1.0 + 1e-12, -0.3, 1e300, f64::NAN] {
            let ceil = f32::ceil_from(t);
            for v in [
                0.1f32,
                0.1f32.next_up(),
                0.1f32.next_down(),
                1.0,
                1.0f32.next_up(),
                -0.3,
                f32::NAN,
                f32::INFINITY,
            ] {
                assert_eq!(ceil.is_some_and(|c| v >= c), f64::from(v) >= t, "{v} {t}");
            }
        }
    }

    #[test]
    fn names_parse_back() {
        for d in Dtype::ALL {
            for name in [d.name(), d.numpy_name()] {
                assert_eq!(name.parse::<Dtype>().unwrap(), d);
            }
        }
        assert!("u64".parse::<Dtype>().is_err());
    }
}
