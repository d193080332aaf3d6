//! Types of stored numbers, as Zarr and NumPy name them.

use crate::volume::{Dtype, Endian};
use half::f16;

/// Integers with or without a sign, or floating-point numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Class {
    Unsigned,
    Signed,
    Float,
}

/// A type of numbers; truth values are bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kind {
    pub(crate) class: Class,
    /// Bytes of a number: 1, 2, 4 or 8; floating-point numbers have at least 2.
    pub(crate) size: usize,
}

impl Kind {
    /// The type of a name of Zarr 3, as `uint16`, or of NumPy without its byte order, as `u2`.
    pub(crate) fn find(name: &str) -> Option<Kind> {
        if matches!(name, "bool" | "b1") {
            return Some(Kind {
                class: Class::Unsigned,
                size: 1,
            });
        }
        let long = [
            ("uint", Class::Unsigned),
            ("int", Class::Signed),
            ("float", Class::Float),
        ];
        let short = [
            ("u", Class::Unsigned),
            ("i", Class::Signed),
            ("f", Class::Float),
        ];
        let of = |names: [(&str, Class); 3], bits: usize| {
            let (rest, class) = names
                .into_iter()
                .find_map(|(front, class)| Some((name.strip_prefix(front)?, class)))?;
            let n = rest.parse::<usize>().ok()?;
            let size = n / bits;
            let sound = size * bits == n && matches!(size, 1 | 2 | 4 | 8);
            (sound && (size > 1 || class != Class::Float)).then_some(Kind { class, size })
        };
        of(long, 8).or_else(|| of(short, 1))
    }

    /// The type and byte order of a name of NumPy, as `<u2`, or of a name without order.
    pub(crate) fn with_order(name: &str, order: Endian) -> Option<(Kind, Endian)> {
        let (order, rest) = match name.split_at_checked(1)? {
            ("<" | "|", rest) => (Endian::Little, rest),
            (">", rest) => (Endian::Big, rest),
            _ => (order, name),
        };
        Some((Kind::find(rest)?, order))
    }

    /// The type that a volume hands out; `None` for integers of 64 bits.
    pub(crate) fn dtype(self) -> Option<Dtype> {
        Some(match (self.class, self.size) {
            (Class::Unsigned, 1) => Dtype::U8,
            (Class::Unsigned, 2) => Dtype::U16,
            (Class::Unsigned, 4) => Dtype::U32,
            (Class::Signed, 1) => Dtype::I8,
            (Class::Signed, 2) => Dtype::I16,
            (Class::Signed, 4) => Dtype::I32,
            (Class::Float, 2 | 4) => Dtype::F32,
            (Class::Float, 8) => Dtype::F64,
            _ => return None,
        })
    }

    /// True for numbers that are stored in 16 bits with a point.
    pub(crate) fn is_half(self) -> bool {
        self.class == Class::Float && self.size == 2
    }

    /// The whole number of these bytes, of which there are as many as the type has.
    pub(crate) fn whole(self, bytes: &[u8], order: Endian) -> i64 {
        let mut word = 0u64;
        for i in 0..self.size {
            let byte = match order {
                Endian::Little => bytes[i],
                Endian::Big => bytes[self.size - 1 - i],
            };
            word |= u64::from(byte) << (8 * i);
        }
        let spare = 64 - 8 * self.size as u32;
        match self.class {
            Class::Signed => (word << spare) as i64 >> spare,
            _ => word as i64,
        }
    }

    /// The number of these bytes.
    pub(crate) fn number(self, bytes: &[u8], order: Endian) -> f64 {
        let bits = self.whole(bytes, order);
        match (self.class, self.size) {
            (Class::Signed, _) => bits as f64,
            (Class::Unsigned, _) => bits as u64 as f64,
            (Class::Float, 2) => f16::from_bits(bits as u16).to_f32().into(),
            (Class::Float, 4) => f32::from_bits(bits as u32).into(),
            (Class::Float, _) => f64::from_bits(bits as u64),
        }
    }

    /// Appends the lowest bytes of a word.
    pub(crate) fn put(self, word: u64, order: Endian, out: &mut Vec<u8>) {
        let bytes = &word.to_le_bytes()[..self.size];
        match order {
            Endian::Little => out.extend(bytes),
            Endian::Big => out.extend(bytes.iter().rev()),
        }
    }

    /// The bits of the number of this type nearest to zero from `value`, as casts of NumPy do; `None` for f16.
    pub(crate) fn bits(self, value: f64) -> Option<u64> {
        Some(match (self.class, self.size) {
            (Class::Float, 4) => (value as f32).to_bits().into(),
            (Class::Float, 8) => value.to_bits(),
            (Class::Float, _) => return None,
            (Class::Signed, _) => value as i64 as u64,
            (Class::Unsigned, _) if value < 0.0 => value as i64 as u64,
            (Class::Unsigned, _) => value as u64,
        })
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let class = match self.class {
            Class::Unsigned => "uint",
            Class::Signed => "int",
            Class::Float => "float",
        };
        write!(f, "{class}{}", 8 * self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_both_kinds() {
        let kind = |class, size| Some(Kind { class, size });
        for (names, found) in [
            (["u1", "uint8"], kind(Class::Unsigned, 1)),
            (["b1", "bool"], kind(Class::Unsigned, 1)),
            (["i8", "int64"], kind(Class::Signed, 8)),
            (["f2", "float16"], kind(Class::Float, 2)),
            (["f1", "float8"], None),
            (["u3", "uint24"], None),
            (["M8[ns]", "complex64"], None),
        ] {
            assert_eq!(names.map(Kind::find), [found; 2], "{names:?}");
        }
    }

    #[test]
    fn bytes_of_either_order() {
        let kind = |name| Kind::find(name).unwrap();
        assert_eq!(kind("i2").number(&[0xfe, 0xff], Endian::Little), -2.0);
        assert_eq!(kind("u2").number(&[0xff, 0xfe], Endian::Big), 65_534.0);
        assert_eq!(kind("f2").number(&[0xc0, 0], Endian::Big), -2.0);
        let mut out = Vec::new();
        kind("i2").put(-2i64 as u64, Endian::Big, &mut out);
        kind("f4").put(kind("f4").bits(1.5).unwrap(), Endian::Little, &mut out);
        assert_eq!(out, [0xff, 0xfe, 0, 0, 0xc0, 0x3f]);
        assert_eq!(kind("u1").bits(-1.9), Some(u64::MAX), "-1 of any size");
    }
}
