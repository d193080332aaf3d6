//! Samples that stand for other values: a scale that the file states, and samples that stand for nothing.

use crate::error::Result;
use crate::volume::{Dtype, Header, Volume, Voxel, hand_on, with_voxel_type};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Stored bytes that a thread holds while it converts, unless a row has more.
const PIECE: usize = 1 << 20;

/// `slope * stored + intercept`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linear {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

impl Linear {
    /// Stored numbers are the values.
    pub(crate) const SAME: Linear = Linear {
        slope: 1.0,
        intercept: 0.0,
    };

    fn of(self, stored: f64) -> f64 {
        stored * self.slope + self.intercept
    }
}

/// How values follow from stored samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Values {
    /// One scale for all samples, or one for each slice along z.
    pub(crate) scale: Scale,
    /// Stored numbers that stand for no value: NaN is handed out for them.
    pub(crate) nothing: Vec<f64>,
    /// Stored numbers outside of this closed range stand for no value either.
    pub(crate) valid: Option<[f64; 2]>,
    /// Where the file states it, for people: `scl_slope and scl_inter`.
    pub(crate) stated_by: String,
}

/// The scale of stored samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Scale {
    All(Linear),
    /// For each slice across an axis (0 to 2 for x to z) its own.
    #[cfg_attr(not(feature = "hdf5"), allow(dead_code))]
    Slices {
        axis: usize,
        all: Arc<[Linear]>,
    },
}

impl Values {
    /// A scale for all samples; `None` if it changes nothing.
    pub(crate) fn linear(slope: f64, intercept: f64, stated_by: &str) -> Option<Self> {
        let linear = Linear { slope, intercept };
        (linear != Linear::SAME).then(|| Values {
            scale: Scale::All(linear),
            nothing: Vec::new(),
            valid: None,
            stated_by: stated_by.to_owned(),
        })
    }

    /// True if values are other numbers than the stored ones.
    pub(crate) fn is_scaled(&self) -> bool {
        match &self.scale {
            Scale::All(linear) => *linear != Linear::SAME,
            Scale::Slices { all, .. } => all.iter().any(|linear| *linear != Linear::SAME),
        }
    }

    /// The scale of a voxel.
    fn of_voxel(&self, voxel: [u32; 3]) -> Linear {
        match &self.scale {
            Scale::All(linear) => *linear,
            Scale::Slices { axis, all } => {
                let own = all.get(voxel[*axis] as usize);
                own.copied().unwrap_or(Linear::SAME)
            }
        }
    }

    /// f32 where the stored type has at most 16 bits or is f32, else f64, so that stored numbers that differ
    /// keep apart.
    pub(crate) fn dtype(&self, stored: Dtype) -> Dtype {
        match stored {
            Dtype::U8 | Dtype::I8 | Dtype::U16 | Dtype::I16 | Dtype::F32 => Dtype::F32,
            Dtype::U32 | Dtype::I32 | Dtype::F64 => Dtype::F64,
        }
    }
}

impl std::fmt::Display for Values {
    /// What is done to samples, for people.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.scale {
            Scale::All(Linear::SAME) => f.write_str("as stored")?,
            Scale::All(Linear { slope, intercept }) => {
                let sign = if *intercept < 0.0 { '-' } else { '+' };
                write!(f, "{slope} * stored {sign} {}", intercept.abs())?;
            }
            Scale::Slices { axis, all } => {
                let across = ["x", "y", "z"][*axis];
                write!(f, "scaled for each of {} slices along {across}", all.len())?;
            }
        }
        if let [first, rest @ ..] = &self.nothing[..] {
            write!(f, "; stored {first}")?;
            rest.iter().try_for_each(|n| write!(f, ", {n}"))?;
            f.write_str(" is no value (NaN)")?;
        }
        if let Some([low, high]) = self.valid {
            write!(f, "; stored beyond {low} to {high} is no value (NaN)")?;
        }
        write!(f, " ({})", self.stated_by)
    }
}

/// A volume of stored samples that hands out the values that they stand for.
pub(crate) struct Valued<'a> {
    inner: Box<dyn Volume + 'a>,
    header: Header,
    values: Values,
}

impl<'a> Valued<'a> {
    pub(crate) fn new(inner: Box<dyn Volume + 'a>, values: Values) -> Self {
        let mut header = inner.header().clone();
        header.dtype = values.dtype(header.dtype);
        Valued {
            inner,
            header,
            values,
        }
    }

    /// Values of stored samples of rows of `nx` voxels, of which the first is `voxel`.
    fn convert(&self, voxel: [u32; 3], nx: usize, stored: &[u8], out: &mut [u8]) {
        with_voxel_type!(self.inner.header().dtype, T => {
            // samples that have one scale
            let same = match self.values.scale {
                Scale::Slices { axis: 0, .. } => 1,
                Scale::Slices { axis: 1, .. } => nx,
                _ => out.len(),
            };
            let [x, y, z] = voxel;
            let stored = stored.chunks(same * size_of::<T>());
            let out = out.chunks_mut(same * self.header.dtype.bytes());
            for (i, (stored, out)) in stored.zip(out).enumerate() {
                let at = i * same;
                let voxel = [x + (at % nx) as u32, y + (at / nx) as u32, z];
                self.convert_from::<T>(self.values.of_voxel(voxel), stored, out);
            }
        });
    }

    fn convert_from<T: Voxel>(&self, linear: Linear, stored: &[u8], out: &mut [u8]) {
        let Values { nothing, valid, .. } = &self.values;
        if nothing.is_empty() && valid.is_none() {
            self.write::<T>(stored, out, |v| linear.of(v));
        } else {
            let [low, high] = valid.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            self.write::<T>(stored, out, |v| {
                if v < low || v > high || nothing.contains(&v) {
                    f64::NAN
                } else {
                    linear.of(v)
                }
            });
        }
    }

    fn write<T: Voxel>(&self, stored: &[u8], out: &mut [u8], value: impl Fn(f64) -> f64) {
        let stored = stored.chunks_exact(size_of::<T>());
        let stored = stored.map(|from| bytemuck::pod_read_unaligned::<T>(from).to_f64());
        if self.header.dtype == Dtype::F32 {
            for (out, from) in out.as_chunks_mut::<4>().0.iter_mut().zip(stored) {
                *out = (value(from) as f32).to_ne_bytes();
            }
        } else {
            for (out, from) in out.as_chunks_mut::<8>().0.iter_mut().zip(stored) {
                *out = value(from).to_ne_bytes();
            }
        }
    }
}

impl Volume for Valued<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let (from, to) = (self.inner.header().dtype.bytes(), self.header.dtype.bytes());
        let rows = (PIECE / (x.len() * from)).clamp(1, y.len());
        let mut stored = vec![0; rows * x.len() * from];
        let slice = x.len() * y.len() * to;
        for (k, out) in z.zip(out.chunks_exact_mut(slice)) {
            for (i, out) in out.chunks_mut(rows * x.len() * to).enumerate() {
                let stored = &mut stored[..out.len() / to * from];
                let top = y.start + (i * rows) as u32;
                let end = y.end.min(top + rows as u32);
                self.inner.read_box(x.clone(), top..end, k..k + 1, stored)?;
                self.convert([x.start, top, k], x.len(), stored, out);
            }
        }
        Ok(())
    }

    hand_on!(inner);

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(Valued::new(inner, self.values.clone()))
        }))
    }

    fn held_bytes(&self) -> u64 {
        let row = u64::from(self.header.dims.0[0]) * 8;
        self.inner.held_bytes() + rayon::current_num_threads() as u64 * row.max(PIECE as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::MemoryVolume;

    fn handed_out(values: Values, stored: Vec<i16>) -> Vec<f32> {
        let dims = Dims::new([2, 2, 2]).unwrap();
        let inner = MemoryVolume::new(dims, Placement::default(), stored).unwrap();
        let volume = Valued::new(Box::new(inner), values);
        let mut out = [0; 32];
        volume.read_box(0..2, 0..2, 0..2, &mut out).unwrap();
        bytemuck::pod_collect_to_vec(&out)
    }

    #[test]
    fn scales_fills_and_valid_ranges() {
        let of_slices = [1.0, 0.5].map(|slope| Linear {
            slope,
            intercept: 1.0,
        });
        let values = Values {
            scale: Scale::Slices {
                axis: 2,
                all: of_slices.into(),
            },
            nothing: vec![-9.0],
            valid: Some([-100.0, 100.0]),
            stated_by: "image-min and image-max".into(),
        };
        let text = "scaled for each of 2 slices along z; stored -9 is no value (NaN); stored beyond -100 to 100 is no \
                    value (NaN) (image-min and image-max)";
        assert_eq!(values.to_string(), text);
        let out = handed_out(values, vec![0, 1, -9, 100, 4, 6, 101, -100]);
        assert_eq!(out[..2], [1.0, 2.0]);
        assert!(out[2].is_nan() && out[6].is_nan());
        assert_eq!([out[3], out[4], out[5], out[7]], [101.0, 3.0, 4.0, -49.0]);
        let plain = Values::linear(0.001, -2.0, "scale_factor and add_offset").unwrap();
        let text = "0.001 * stored - 2 (scale_factor and add_offset)";
        assert_eq!(plain.to_string(), text);
        assert_eq!(handed_out(plain, vec![1000; 8]), [-1.0; 8]);
        assert_eq!(Values::linear(1.0, 0.0, ""), None);
    }
}
