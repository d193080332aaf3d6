//! Filters of numcodecs that turn numbers into other numbers, undone.
//!
//! <https://numcodecs.readthedocs.io/en/stable/filter/index.html>.

use crate::volume::Endian;
use crate::volume::codecs::blosc::Broken;
use crate::volume::formats::zarr::kind::{Class, Kind};
use serde_json::Value;

/// A filter: the numbers of an array, and what is stored for them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Filter {
    op: Op,
    /// The type of the numbers.
    plain: (Kind, Endian),
    /// The type of what is stored for them.
    stored: (Kind, Endian),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Op {
    /// The same number, of another type or rounded.
    Same,
    /// The difference from the one before.
    Delta,
    /// (number - offset) * scale.
    Scale { offset: f64, scale: f64 },
    /// Eight truth values in a byte, behind a byte with the number of bits that are none.
    Bits,
}

impl Filter {
    /// The filter of a name and its settings for numbers of a type. `None` if there is none of this name, or its
    /// settings are not understood.
    pub(crate) fn find(name: &str, set: &Value, plain: (Kind, Endian)) -> Option<Filter> {
        let kind = |member: &str| match set[member].as_str() {
            Some(name) => Kind::with_order(name, plain.1),
            None => None,
        };
        let as_type = |member: &str, default| match set[member].is_null() {
            true => Some(default),
            false => kind(member),
        };
        let number = |member: &str| set[member].as_f64().filter(|v| v.is_finite());
        let (op, first, stored) = match name {
            "delta" => {
                let first = as_type("dtype", plain)?;
                (Op::Delta, first, as_type("astype", first)?)
            }
            "fixedscaleoffset" => {
                let (offset, scale) = (number("offset")?, number("scale")?);
                let first = as_type("dtype", plain)?;
                let op = Op::Scale { offset, scale };
                (op, first, as_type("astype", first)?)
            }
            "quantize" => {
                let first = as_type("dtype", plain)?;
                (Op::Same, first, as_type("astype", first)?)
            }
            "astype" => {
                let first = as_type("decode_dtype", plain)?;
                (Op::Same, first, kind("encode_dtype")?)
            }
            "bitround" => (Op::Same, plain, plain),
            "packbits" => {
                let byte = Kind {
                    class: Class::Unsigned,
                    size: 1,
                };
                (Op::Bits, plain, (byte, plain.1))
            }
            _ => return None,
        };
        let same_size = first.0.size == plain.0.size;
        let halves = first.0.is_half() && (op != Op::Same || first != stored);
        let bits = op == Op::Bits && plain.0.size != 1;
        (same_size && !halves && !bits).then_some(Filter {
            op,
            plain: first,
            stored,
        })
    }

    /// The type of what is stored, for the filter that comes next.
    pub(crate) fn stored(&self) -> (Kind, Endian) {
        self.stored
    }

    /// The same with numbers in one byte order, whatever its settings say: in Zarr 3 that is a step of its own.
    pub(crate) fn in_order(mut self, order: Endian) -> Filter {
        (self.plain.1, self.stored.1) = (order, order);
        self
    }

    /// True if what is stored depends on the order of the numbers.
    pub(crate) fn ordered(&self) -> bool {
        self.op == Op::Delta
    }

    /// Bytes of what is stored for `size` bytes of numbers.
    pub(crate) fn packed(&self, size: usize) -> usize {
        match self.op {
            Op::Bits => 1 + size.div_ceil(8),
            _ => size / self.plain.0.size * self.stored.0.size,
        }
    }

    /// Undoes it; there are as many bytes as [`Filter::packed`] says for `size`.
    pub(crate) fn undo(&self, from: Vec<u8>, size: usize) -> Result<Vec<u8>, Broken> {
        if from.len() != self.packed(size) {
            let found = format!("a chunk of {} bytes for {}", from.len(), self.packed(size));
            return Err(Broken::Damaged(found));
        }
        if self.op == Op::Same && self.plain == self.stored {
            return Ok(from);
        }
        let mut out = Vec::with_capacity(size);
        match self.op {
            Op::Bits => {
                let bits = from[1..]
                    .iter()
                    .flat_map(|b| (0..8).map(move |i| b >> (7 - i) & 1));
                out.extend(bits.take(size));
            }
            Op::Delta if self.plain.0.class != Class::Float => self.sum_whole(&from, &mut out),
            Op::Delta => {
                // sums are rounded as those of the type itself
                let short = self.plain.0.size == 4;
                let mut sum = 0.0;
                self.each(&from, &mut out, |v| {
                    sum = if short {
                        f64::from(sum as f32 + v as f32)
                    } else {
                        sum + v
                    };
                    sum
                });
            }
            Op::Scale { offset, scale } if self.stored.0 == FLOAT => {
                let (offset, scale) = (offset as f32, scale as f32);
                self.each(&from, &mut out, |v| (v as f32 / scale + offset).into());
            }
            Op::Scale { offset, scale } => self.each(&from, &mut out, |v| v / scale + offset),
            Op::Same => self.each(&from, &mut out, |v| v),
        }
        Ok(out)
    }

    fn each(&self, from: &[u8], out: &mut Vec<u8>, mut value: impl FnMut(f64) -> f64) {
        let ((stored, from_order), (plain, order)) = (self.stored, self.plain);
        for bytes in from.chunks_exact(stored.size) {
            let value = value(stored.number(bytes, from_order));
            // f16 are refused above
            plain.put(plain.bits(value).unwrap_or(0), order, out);
        }
    }

    fn sum_whole(&self, from: &[u8], out: &mut Vec<u8>) {
        let ((stored, from_order), (plain, order)) = (self.stored, self.plain);
        let mut sum = 0u64;
        for bytes in from.chunks_exact(stored.size) {
            let step = match stored.class {
                Class::Float => stored.number(bytes, from_order) as i64,
                _ => stored.whole(bytes, from_order),
            };
            sum = sum.wrapping_add(step as u64);
            plain.put(sum, order, out);
        }
    }
}

/// f32, in which its own sums and quotients are rounded.
const FLOAT: Kind = Kind {
    class: Class::Float,
    size: 4,
};

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn undone(name: &str, set: Value, plain: &str, from: &[u8], size: usize) -> Vec<u8> {
        let plain = Kind::with_order(plain, Endian::Little).unwrap();
        let filter = Filter::find(name, &set, plain).expect(name);
        filter.undo(from.to_vec(), size).unwrap()
    }

    #[test]
    fn filters_are_undone() {
        // numcodecs 0.16: Delta(dtype="<u2", astype="|i1") of 1000, 1001, 999 does not fit, of 3, 4, 2 it does
        let set = json!({"dtype": "<u2", "astype": "|i1"});
        let out = undone("delta", set, "<u2", &[3, 1, 0xfe], 6);
        assert_eq!(out, [3, 0, 4, 0, 2, 0]);
        let set = json!({"offset": 1000, "scale": 10, "dtype": "<f8", "astype": "|u1"});
        let out = undone("fixedscaleoffset", set, "<f8", &[0, 15], 16);
        let out: Vec<f64> = bytemuck::pod_collect_to_vec(&out);
        assert_eq!(out, [1000.0, 1001.5]);
        let set = json!({"encode_dtype": ">i2", "decode_dtype": "<f4"});
        let out = undone("astype", set, "<f4", &[0xff, 0xfe], 4);
        assert_eq!(out, (-2f32).to_le_bytes());
        let out = undone(
            "packbits",
            json!({}),
            "|b1",
            &[6, 0b1011_0000, 0b0100_0000],
            10,
        );
        assert_eq!(out, [1, 0, 1, 1, 0, 0, 0, 0, 0, 1]);
        let set = json!({"digits": 2, "dtype": "<f4", "astype": "<f4"});
        assert_eq!(
            undone("quantize", set, "<f4", &[1, 2, 3, 4], 4),
            [1, 2, 3, 4]
        );
    }

    #[test]
    fn what_is_not_understood_is_none() {
        let plain = Kind::with_order("<u2", Endian::Little).unwrap();
        for (name, set) in [
            ("delta", json!({"dtype": "<M8[ns]"})),
            ("delta", json!({"dtype": "<u4"})),
            ("fixedscaleoffset", json!({"scale": 10})),
            ("astype", json!({"decode_dtype": "<u2"})),
            ("packbits", json!({})),
            ("categorize", json!({})),
        ] {
            assert_eq!(Filter::find(name, &set, plain), None, "{name}");
        }
    }
}
