//! Numbers as HDF5 stores them: of any width, with bits that do not belong to them, or with a point.

use crate::volume::Dtype;
use half::f16;
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::{ByteOrder, Datatype, H5Type, VarLenKind};

/// The bytes of an element, as they are stored.
#[derive(Clone, Copy)]
pub(crate) struct Raw<const N: usize>(pub(crate) [u8; N]);

impl<const N: usize> H5Type for Raw<N> {
    fn hdf5_type() -> Datatype {
        Datatype::Opaque {
            size: N as u32,
            tag: String::new(),
        }
    }

    fn from_bytes(bytes: &[u8], _: &Datatype) -> Result<Self, H5Error> {
        let bytes = bytes.try_into().map(Raw);
        bytes.map_err(|_| H5Error::InvalidData(format!("an element that has not {N} bytes")))
    }

    fn element_size(_: &Datatype) -> usize {
        N
    }

    fn native_copy_compatible(_: &Datatype) -> bool {
        true
    }
}

/// How to get a number from the bytes of an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Number {
    /// Bytes of an element, 1 to 8.
    pub(crate) size: usize,
    pub(crate) order: ByteOrder,
    /// The type that is handed out.
    pub(crate) dtype: Dtype,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// The bytes are the number.
    Plain,
    /// `bits` bits from bit `shift` on.
    Bits { shift: u32, bits: u32, signed: bool },
    /// IEEE 754 binary16.
    Half,
    /// The upper half of a binary32.
    Brain,
}

/// A number that the type handed out cannot hold.
#[derive(Debug, PartialEq)]
pub(crate) struct Inexact(pub(crate) String);

impl Number {
    /// The numbers of a type, of which `raw` is the message.
    ///
    /// # Errors
    /// What the elements are, if they are no numbers that can be read.
    pub(crate) fn of(dtype: &Datatype, raw: &[u8]) -> Result<Number, String> {
        match dtype {
            Datatype::FixedPoint {
                size,
                signed,
                byte_order,
            } => integer(*size, *signed, *byte_order, raw),
            Datatype::Bitfield { size, byte_order } => integer(*size, false, *byte_order, raw),
            // the base type follows the head
            Datatype::Enum { base, .. } => {
                Self::of(base, raw.get(8..).unwrap_or_default()).map_err(|_| type_text(dtype))
            }
            Datatype::FloatingPoint { size, byte_order } => float(*size, *byte_order, raw),
            _ => Err(format!("its elements are {}", type_text(dtype))),
        }
    }

    /// Writes the number of an element in the machine's byte order; `out` has the bytes of `dtype`.
    ///
    /// # Errors
    /// The number, if the type cannot hold it exactly.
    pub(crate) fn put(&self, mut element: [u8; 8], out: &mut [u8]) -> Result<(), Inexact> {
        let (size, native) = (self.size, cfg!(target_endian = "little"));
        if (self.order == ByteOrder::LittleEndian) != native {
            element[..size].reverse();
        }
        let Kind::Bits {
            shift,
            bits,
            signed,
        } = self.kind
        else {
            let half = u16::from_ne_bytes([element[0], element[1]]);
            match self.kind {
                Kind::Half => out.copy_from_slice(&f16::from_bits(half).to_f32().to_ne_bytes()),
                Kind::Brain => {
                    let value = f32::from_bits(u32::from(half) << 16);
                    out.copy_from_slice(&value.to_ne_bytes());
                }
                _ => out.copy_from_slice(&element[..size]),
            }
            return Ok(());
        };
        if !native {
            element.rotate_left(size);
        }
        // behind the highest bit first, so that shifting back extends the sign or zeros
        let top = u64::from_ne_bytes(element) << (64 - shift - bits);
        let signed_value = (top as i64) >> (64 - bits);
        let value = top >> (64 - bits);
        if self.dtype == Dtype::F64 {
            let (float, exact, text) = if signed {
                let float = signed_value as f64;
                let same = float as i128 == i128::from(signed_value);
                (float, same, signed_value.to_string())
            } else {
                let float = value as f64;
                (float, float as u128 == u128::from(value), value.to_string())
            };
            out.copy_from_slice(&float.to_ne_bytes());
            return if exact { Ok(()) } else { Err(Inexact(text)) };
        }
        let value = if signed { signed_value as u64 } else { value };
        let bytes = value.to_le_bytes();
        out.copy_from_slice(&bytes[..out.len()]);
        if !native {
            out.reverse();
        }
        Ok(())
    }

    /// True if the bytes of an element are the number.
    pub(crate) fn is_native(&self) -> bool {
        let little = self.order == ByteOrder::LittleEndian;
        self.kind == Kind::Plain && (little == cfg!(target_endian = "little") || self.size == 1)
    }

    /// The least and the largest number, if they are integers that the type handed out is made for.
    pub(crate) fn range(&self) -> Option<[f64; 2]> {
        let (bits, signed) = match (self.kind, self.dtype) {
            (_, Dtype::F32 | Dtype::F64) => return None,
            (Kind::Bits { bits, signed, .. }, _) => (bits, signed),
            (_, dtype) => {
                let signed = matches!(dtype, Dtype::I8 | Dtype::I16 | Dtype::I32);
                (8 * self.size as u32, signed)
            }
        };
        let span = (1u64 << bits) as f64;
        Some(if signed {
            [-span / 2.0, span / 2.0 - 1.0]
        } else {
            [0.0, span - 1.0]
        })
    }

    /// True for integers of more bits than those handed out have.
    pub(crate) fn is_wide(&self) -> bool {
        self.dtype == Dtype::F64 && matches!(self.kind, Kind::Bits { .. })
    }

    /// The same bits as numbers of another sign.
    pub(crate) fn read_as(mut self, dtype: Dtype) -> Number {
        if let Kind::Bits { signed, .. } = &mut self.kind
            && dtype != self.dtype
        {
            *signed = matches!(dtype, Dtype::I8 | Dtype::I16 | Dtype::I32);
        }
        self.dtype = dtype;
        self
    }

    /// The value of an element, for people.
    pub(crate) fn show(&self, element: &[u8]) -> Option<String> {
        let mut bytes = [0; 8];
        bytes
            .get_mut(..self.size)?
            .copy_from_slice(element.get(..self.size)?);
        let mut out = vec![0; self.dtype.bytes()];
        if let Err(Inexact(text)) = self.put(bytes, &mut out) {
            return Some(text);
        }
        Some(crate::volume::with_voxel_type!(self.dtype, T => {
            bytemuck::pod_read_unaligned::<T>(&out).to_string()
        }))
    }

    /// What a user should know of how numbers are stored.
    pub(crate) fn note(&self) -> Option<String> {
        match self.kind {
            Kind::Plain => None,
            Kind::Half => Some("stored as f16".into()),
            Kind::Brain => Some("stored as bfloat16".into()),
            Kind::Bits {
                shift,
                bits,
                signed,
            } => {
                let sign = if signed { "signed" } else { "unsigned" };
                let at = match shift {
                    0 => String::new(),
                    n => format!(" from bit {n} on"),
                };
                let of = match 8 * self.size as u32 {
                    all if all == bits => String::new(),
                    all => format!(" of {all}"),
                };
                Some(format!("stored as {sign} integers of {bits}{of} bits{at}"))
            }
        }
    }
}

/// Two numbers of a type's message, of 16 bits each.
fn bits_of(raw: &[u8]) -> Option<[u32; 2]> {
    let word = |at: usize| Some(u16::from_le_bytes([*raw.get(at)?, *raw.get(at + 1)?]).into());
    Some([word(8)?, word(10)?])
}

fn integer(size: u8, signed: bool, order: ByteOrder, raw: &[u8]) -> Result<Number, String> {
    let all = 8 * u32::from(size);
    let [shift, bits] = bits_of(raw).ok_or("integers of unknown bits")?;
    if !(1..=8).contains(&size) || bits == 0 || shift + bits > all {
        return Err(format!(
            "integers of {bits} of {all} bits from bit {shift} on"
        ));
    }
    let dtype = match (size, signed) {
        (1, false) => Dtype::U8,
        (1, true) => Dtype::I8,
        (2, false) => Dtype::U16,
        (2, true) => Dtype::I16,
        (3 | 4, false) => Dtype::U32,
        (3 | 4, true) => Dtype::I32,
        (_, false) if bits <= 32 => Dtype::U32,
        (_, true) if bits <= 32 => Dtype::I32,
        // exact up to 2^53, and refused beyond
        _ => Dtype::F64,
    };
    let plain = bits == all && matches!(size, 1 | 2 | 4);
    let kind = if plain {
        Kind::Plain
    } else {
        Kind::Bits {
            shift,
            bits,
            signed,
        }
    };
    Ok(Number {
        size: size.into(),
        order,
        dtype,
        kind,
    })
}

/// Floats of the layouts that have a name.
fn float(size: u8, order: ByteOrder, raw: &[u8]) -> Result<Number, String> {
    let flags = raw.get(1..3).ok_or("floats of unknown bits")?;
    let sign = u32::from(flags[1]);
    let [shift, bits] = bits_of(raw).ok_or("floats of unknown bits")?;
    let fields = raw.get(12..16).ok_or("floats of unknown bits")?;
    let bias = raw.get(16..20).and_then(|b| b.first_chunk());
    let bias = u32::from_le_bytes(*bias.ok_or("floats of unknown bits")?);
    let [exponent, exponents, fraction, fractions] = [0, 1, 2, 3].map(|i| u32::from(fields[i]));
    let implied = flags[0] >> 4 & 3 == 2;
    let vax = flags[0] >> 6 & 1 == 1;
    // where the sign, the exponent and the fraction are, how wide the latter two, and what 0 is
    let layout = (bits, sign, exponent, exponents, fraction, fractions, bias);
    let (dtype, kind) = match layout {
        _ if vax || !implied || shift != 0 || 8 * u32::from(size) != bits => (Dtype::F32, None),
        (16, 15, 10, 5, 0, 10, 15) => (Dtype::F32, Some(Kind::Half)),
        (16, 15, 7, 8, 0, 7, 127) => (Dtype::F32, Some(Kind::Brain)),
        (32, 31, 23, 8, 0, 23, 127) => (Dtype::F32, Some(Kind::Plain)),
        (64, 63, 52, 11, 0, 52, 1023) => (Dtype::F64, Some(Kind::Plain)),
        _ => (Dtype::F32, None),
    };
    let Some(kind) = kind else {
        let form = if vax { " in VAX order" } else { "" };
        return Err(format!(
            "floats of {bits} of {} bits{form}, {exponents} of them exponent",
            8 * u32::from(size)
        ));
    };
    Ok(Number {
        size: size.into(),
        order,
        dtype,
        kind,
    })
}

/// A type in words.
pub(crate) fn type_text(dtype: &Datatype) -> String {
    match dtype {
        Datatype::FixedPoint { size, signed, .. } => {
            let sign = if *signed { 'i' } else { 'u' };
            format!("{sign}{}", 8 * u64::from(*size))
        }
        Datatype::FloatingPoint { size, .. } => format!("f{}", 8 * u64::from(*size)),
        Datatype::Bitfield { size, .. } => format!("bits of {size} bytes"),
        Datatype::Enum { members, .. } => {
            let names: Vec<&str> = members.iter().map(|m| m.name.as_str()).take(4).collect();
            match &names[..] {
                ["FALSE", "TRUE"] => "bool".into(),
                _ => format!("an enumeration ({}, ...)", names.join(", ")),
            }
        }
        Datatype::Compound { fields, .. } => {
            let names: Vec<&str> = fields.iter().map(|f| f.name.as_str()).take(8).collect();
            match &names[..] {
                ["r", "i"] | ["real", "imag"] => "complex numbers".into(),
                _ => format!("records of {}", names.join(", ")),
            }
        }
        Datatype::Array { base, dims } => {
            let dims: Vec<String> = dims.iter().map(u64::to_string).collect();
            format!("arrays of {} {}", dims.join(" x "), type_text(base))
        }
        Datatype::String { .. } => "text".into(),
        Datatype::VarLen {
            kind: VarLenKind::String,
            ..
        } => "text".into(),
        Datatype::VarLen { .. } => "lists of any length".into(),
        Datatype::Reference { .. } => "references".into(),
        Datatype::Opaque { .. } => "bytes without a meaning".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(class: u8, flags: [u8; 2], size: u8, rest: &[u8]) -> Vec<u8> {
        let head = [0x10 | class, flags[0], flags[1], 0, size, 0, 0, 0];
        [&head, rest].concat()
    }

    fn put(number: &Number, element: &[u8]) -> Result<Vec<u8>, Inexact> {
        let mut bytes = [0; 8];
        bytes[..element.len()].copy_from_slice(element);
        let mut out = vec![0; number.dtype.bytes()];
        number.put(bytes, &mut out).map(|()| out)
    }

    #[test]
    fn bits_that_are_not_of_the_number_are_left_out() {
        for (order, element) in [
            (ByteOrder::LittleEndian, [0x5f, 0xfd]),
            (ByteOrder::BigEndian, [0xfd, 0x5f]),
        ] {
            // 12 bits from bit 2 on of 0xfd5f: 0xf57
            let raw = message(0, [0, 0], 2, &[2, 0, 12, 0]);
            let number = integer(2, false, order, &raw).unwrap();
            assert_eq!(put(&number, &element).unwrap(), 0xf57u16.to_ne_bytes());
            let number = integer(2, true, order, &raw).unwrap();
            let value = 0xf57i16 - 0x1000;
            assert_eq!(put(&number, &element).unwrap(), value.to_ne_bytes());
            assert_eq!(number.show(&element), Some(value.to_string()));
        }
        let raw = message(0, [0, 0], 2, &[6, 0, 12, 0]);
        assert!(integer(2, false, ByteOrder::LittleEndian, &raw).is_err());
    }

    #[test]
    fn wide_integers_are_exact_or_refused() {
        let raw = message(0, [8, 0], 8, &[0, 0, 64, 0]);
        let number = integer(8, true, ByteOrder::BigEndian, &raw).unwrap();
        let of = |v: i64| put(&number, &v.to_be_bytes());
        assert_eq!(of(-7).unwrap(), (-7f64).to_ne_bytes());
        assert_eq!(of(i64::MIN).unwrap(), (i64::MIN as f64).to_ne_bytes());
        assert_eq!(of(-(1 << 53) - 1), Err(Inexact("-9007199254740993".into())));
        let number = integer(8, false, ByteOrder::LittleEndian, &raw).unwrap();
        let of = |v: u64| put(&number, &v.to_le_bytes());
        assert_eq!(of(1 << 53).unwrap(), ((1u64 << 53) as f64).to_ne_bytes());
        assert_eq!(of(u64::MAX), Err(Inexact(u64::MAX.to_string())));
    }

    #[test]
    fn floats_of_a_layout_that_has_no_name_are_refused() {
        let of = |sign: u8, flags: u8, size: u8, rest: [u8; 12]| {
            let raw = message(1, [flags, sign], size, &rest);
            float(size, ByteOrder::LittleEndian, &raw)
        };
        let half = of(15, 0x20, 2, [0, 0, 16, 0, 10, 5, 0, 10, 15, 0, 0, 0]).unwrap();
        assert_eq!(put(&half, &[0, 0xc0]).unwrap(), (-2f32).to_ne_bytes());
        let brain = of(15, 0x20, 2, [0, 0, 16, 0, 7, 8, 0, 7, 127, 0, 0, 0]).unwrap();
        assert_eq!(put(&brain, &[0x80, 0x3f]).unwrap(), 1f32.to_ne_bytes());
        let single = [0, 0, 32, 0, 23, 8, 0, 23, 127, 0, 0, 0];
        assert_eq!(of(31, 0x20, 4, single).unwrap().kind, Kind::Plain);
        assert!(of(31, 0x61, 4, single).unwrap_err().contains("VAX"));
        assert!(of(31, 0x00, 4, single).is_err());
        assert!(of(7, 0x20, 1, [0, 0, 8, 0, 3, 4, 0, 3, 7, 0, 0, 0]).is_err());
        assert!(of(31, 0x20, 4, [0, 0, 32, 0, 23, 8, 0, 23, 126, 0, 0, 0]).is_err());
    }
}
