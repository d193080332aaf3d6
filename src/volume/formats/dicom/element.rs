//! The elements of a DICOM data set, as far as a volume needs them.
//!
//! Encodings are those of DICOM PS3.5, section 7 and annex A
//! (<https://dicom.nema.org/medical/dicom/current/output/html/part05.html>).

use crate::error::{Error, Result};
use crate::volume::Endian;
use crate::volume::formats::dicom::tag;
use crate::volume::io::blob::{Blob, Bytes, Section};
use flate2::bufread::DeflateDecoder;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longer values are passed by: none that is wanted is.
const MAX_VALUE: u64 = 64 << 10;
/// Sequences in sequences beyond this are damage.
const MAX_DEPTH: u32 = 16;
/// More elements than this are damage; a file of 65,536 frames has some twenty for each.
const MAX_ELEMENTS: u64 = 1 << 24;
/// The length that says that a delimiter will follow.
const UNDEFINED: u32 = u32::MAX;

/// The kept elements of a data set or of an item of a sequence.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Elements {
    values: BTreeMap<u32, Value>,
    big: bool,
}

#[derive(Debug, PartialEq)]
enum Value {
    Bytes(Vec<u8>),
    Items(Vec<Elements>),
}

impl Elements {
    fn bytes(&self, tag: u32) -> Option<&[u8]> {
        match self.values.get(&tag)? {
            Value::Bytes(bytes) => Some(bytes),
            Value::Items(_) => None,
        }
    }

    /// The items of a sequence.
    pub(crate) fn items(&self, tag: u32) -> &[Elements] {
        match self.values.get(&tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    pub(crate) fn has(&self, tag: u32) -> bool {
        self.values.contains_key(&tag)
    }

    /// Text without the padding around it; empty if there is none.
    pub(crate) fn text(&self, tag: u32) -> String {
        let text = String::from_utf8_lossy(self.bytes(tag).unwrap_or_default());
        let text = text.trim_matches([' ', '\0']);
        text.chars().filter(|c| !c.is_control()).take(128).collect()
    }

    /// A 16-bit whole number.
    pub(crate) fn short(&self, tag: u32) -> Option<u16> {
        let bytes = *self.bytes(tag)?.first_chunk::<2>()?;
        Some(if self.big {
            u16::from_be_bytes(bytes)
        } else {
            u16::from_le_bytes(bytes)
        })
    }

    /// The tag that an element points to, where it is one.
    pub(crate) fn pointer(&self, tag: u32) -> Option<u32> {
        let bytes: [u8; 4] = self.bytes(tag)?.try_into().ok()?;
        let pair = [[bytes[0], bytes[1]], [bytes[2], bytes[3]]];
        let [group, element] = pair.map(match self.big {
            true => u16::from_be_bytes,
            false => u16::from_le_bytes,
        });
        Some(u32::from(group) << 16 | u32::from(element))
    }

    /// A binary number of double precision.
    pub(crate) fn double(&self, tag: u32) -> Option<f64> {
        let bytes = *self.bytes(tag)?.first_chunk::<8>()?;
        Some(if self.big {
            f64::from_be_bytes(bytes)
        } else {
            f64::from_le_bytes(bytes)
        })
    }

    /// Finite decimal numbers, as many as there are.
    pub(crate) fn list(&self, tag: u32) -> Option<Vec<f64>> {
        let text = std::str::from_utf8(self.bytes(tag)?).ok()?;
        let words = text.trim_matches(['\0', ' ']).split('\\');
        let values: Option<Vec<f64>> = words.map(|w| w.trim().parse().ok()).collect();
        values.filter(|all| all.iter().all(|v| v.is_finite()))
    }

    /// Exactly `N` decimal numbers.
    pub(crate) fn numbers<const N: usize>(&self, tag: u32) -> Option<[f64; N]> {
        self.list(tag)?.try_into().ok()
    }

    pub(crate) fn number(&self, tag: u32) -> Option<f64> {
        self.numbers::<1>(tag).map(|[v]| v)
    }
}

/// How the elements after the file's preamble are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Coding {
    explicit: bool,
    big: bool,
}

/// A file's elements up to its pixels.
pub(crate) struct Header {
    pub(crate) elements: Elements,
    /// What kind of object the file holds; empty if it does not say so.
    pub(crate) class: String,
    /// The transfer syntax, or empty for a file without preamble.
    pub(crate) syntax: String,
    pub(crate) endian: Endian,
    /// Tag of the pixels, their position (in the unpacked data set if `deflated`), and their length
    /// unless they are in fragments.
    pub(crate) pixels: Option<(u32, u64, Option<u64>)>,
    /// Where the packed data set begins, if it is packed as a whole.
    pub(crate) deflated: Option<u64>,
}

enum Input {
    Plain(BufReader<Section>),
    Packed(BufReader<DeflateDecoder<BufReader<Section>>>),
}

/// Elements are read forwards; what is not wanted is skipped.
struct Reader<'a> {
    path: &'a Path,
    input: Input,
    position: u64,
    /// Where the file ends; nothing is known of what is packed.
    end: u64,
    elements: u64,
    coding: Coding,
}

/// True if a file begins as DICOM does: with a preamble, or at once with an element of group 8 as
/// files of before 1993 and some exports do.
pub(crate) fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM") || bare(head).is_some()
}

/// The coding of a data set that begins with its first element.
fn bare(head: &[u8]) -> Option<Coding> {
    let first: &[u8; 8] = head.first_chunk()?;
    // (0008,0000) group length to (0008,0018) SOP instance
    let known = |e: u8| matches!(e, 0x00 | 0x01 | 0x05 | 0x08 | 0x12 | 0x16 | 0x18);
    let explicit = first[4..6].iter().all(u8::is_ascii_uppercase);
    let long = |bytes: [u8; 4]| u32::from_le_bytes(bytes) <= 128;
    match *first {
        [8, 0, e, 0, a, b, c, d] if known(e) && (explicit || long([a, b, c, d])) => Some(Coding {
            explicit,
            big: false,
        }),
        [0, 8, 0, e, ..] if known(e) && explicit => Some(Coding {
            explicit,
            big: true,
        }),
        _ => None,
    }
}

/// Reads a file's elements.
///
/// # Errors
/// [`Error::Format`] if it is damaged.
pub(crate) fn read(blob: &Blob) -> Result<Header> {
    let bytes = blob.open()?;
    let head = blob.head(132)?;
    let (mut class, mut syntax) = (String::new(), String::new());
    let mut coding = bare(&head).unwrap_or(Coding {
        explicit: true,
        big: false,
    });
    let mut start = 0;
    if head.get(128..132) == Some(b"DICM") {
        let (known, end) = meta(&bytes)?;
        class = known.text(tag::MEDIA_SOP_CLASS);
        syntax = known.text(tag::TRANSFER_SYNTAX);
        start = end;
        coding = Coding {
            explicit: syntax != "1.2.840.10008.1.2",
            big: syntax == "1.2.840.10008.1.2.2",
        };
    }
    let packed = syntax == "1.2.840.10008.1.2.1.99";
    let mut reader = Reader::new(&bytes, start, packed, coding);
    let mut pixels = None;
    let elements = reader.set(u64::MAX, 0, Some(&mut pixels))?;
    let own = elements.text(tag::SOP_CLASS);
    Ok(Header {
        class: if own.is_empty() { class } else { own },
        elements,
        syntax,
        endian: if coding.big {
            Endian::Big
        } else {
            Endian::Little
        },
        pixels,
        deflated: packed.then_some(start),
    })
}

/// What is wanted of the file's meta information, and where that ends.
fn meta(bytes: &Bytes) -> Result<(Elements, u64)> {
    let coding = Coding {
        explicit: true,
        big: false,
    };
    let mut reader = Reader::new(bytes, 132, false, coding);
    let mut known = Elements::default();
    loop {
        let at = reader.position;
        let Some((tag, _, len)) = reader.head_of(u64::MAX, |tag| tag >> 16 == 2)? else {
            return Ok((known, at));
        };
        if matches!(tag, tag::TRANSFER_SYNTAX | tag::MEDIA_SOP_CLASS) && len <= 128 {
            let value = Value::Bytes(reader.take(len.into())?);
            known.values.insert(tag, value);
        } else {
            reader.skip(len.into())?;
        }
    }
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a Bytes, start: u64, packed: bool, coding: Coding) -> Self {
        let plain = bytes.reader(start, u64::MAX);
        Reader {
            path: bytes.path(),
            input: if packed {
                Input::Packed(BufReader::new(DeflateDecoder::new(plain)))
            } else {
                Input::Plain(plain)
            },
            position: if packed { 0 } else { start },
            end: if packed { u64::MAX } else { bytes.len() },
            elements: 0,
            coding,
        }
    }

    fn broken(&self, found: String) -> Error {
        let place = format!("{found} at byte {}", self.position);
        Error::format(self.path, place, "a whole DICOM file")
            .with_hint("the file is cut short or damaged")
    }

    fn inside(&self, what: &str) -> Error {
        self.broken(format!("the file's end inside {what}"))
    }

    fn take(&mut self, len: u64) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        let done = match &mut self.input {
            Input::Plain(r) => r.take(len).read_to_end(&mut out),
            Input::Packed(r) => r.take(len).read_to_end(&mut out),
        };
        match done {
            Ok(n) if n as u64 == len => {
                self.position += len;
                Ok(out)
            }
            Ok(_) => Err(self.inside("an element")),
            Err(e) => Err(self.broken(format!("damaged bytes ({e})"))),
        }
    }

    fn skip(&mut self, len: u64) -> Result<()> {
        // a position behind the end is no error of the system's
        if self.position.saturating_add(len) > self.end {
            return Err(self.inside("an element"));
        }
        let done = match &mut self.input {
            Input::Plain(r) => match i64::try_from(len) {
                Ok(len) => r.seek_relative(len),
                Err(_) => Err(std::io::ErrorKind::InvalidData.into()),
            },
            Input::Packed(r) => match std::io::copy(&mut r.take(len), &mut std::io::sink()) {
                Ok(n) if n < len => Err(std::io::ErrorKind::UnexpectedEof.into()),
                other => other.map(drop),
            },
        };
        done.map_err(|e| self.broken(format!("damaged bytes ({e})")))?;
        self.position = self.position.saturating_add(len);
        Ok(())
    }

    fn at_end(&mut self) -> Result<bool> {
        let rest = match &mut self.input {
            Input::Plain(r) => r.fill_buf().map(<[u8]>::is_empty),
            Input::Packed(r) => r.fill_buf().map(<[u8]>::is_empty),
        };
        rest.map_err(|e| self.broken(format!("damaged bytes ({e})")))
    }

    fn number(&self, bytes: &[u8]) -> u32 {
        let join = |n: u32, b: &u8| n << 8 | u32::from(*b);
        if self.coding.big {
            bytes.iter().fold(0, join)
        } else {
            bytes.iter().rev().fold(0, join)
        }
    }

    /// Tag, type and length of the next element; `None` at the end, or, with nothing read, if the
    /// tag is not one that `wanted` accepts.
    fn head_of(
        &mut self,
        end: u64,
        wanted: impl Fn(u32) -> bool,
    ) -> Result<Option<(u32, [u8; 2], u32)>> {
        if self.position >= end || self.at_end()? {
            return Ok(None);
        }
        self.elements += 1;
        if self.elements > MAX_ELEMENTS {
            return Err(self.broken(format!("more than {MAX_ELEMENTS} elements")));
        }
        let bytes = self.take(8)?;
        let tag = self.number(&bytes[..2]) << 16 | self.number(&bytes[2..4]);
        if !wanted(tag) {
            return Ok(None);
        }
        // items and delimiters have no type
        if !self.coding.explicit || tag >> 16 == 0xfffe {
            return Ok(Some((tag, *b"  ", self.number(&bytes[4..]))));
        }
        let kind = [bytes[4], bytes[5]];
        if !kind.iter().all(u8::is_ascii_uppercase) {
            let text = kind.escape_ascii().to_string();
            return Err(self.broken(format!("an element of type \"{text}\"")));
        }
        let long = matches!(
            &kind,
            b"OB"
                | b"OD"
                | b"OF"
                | b"OL"
                | b"OV"
                | b"OW"
                | b"SQ"
                | b"SV"
                | b"UC"
                | b"UN"
                | b"UR"
                | b"UT"
                | b"UV"
        );
        let len = if long {
            let bytes = self.take(4)?;
            self.number(&bytes)
        } else {
            self.number(&bytes[6..8])
        };
        Ok(Some((tag, kind, len)))
    }

    /// The elements up to `end`, a delimiter, or the pixels if `pixels` are asked for.
    fn set(
        &mut self,
        end: u64,
        depth: u32,
        mut pixels: Option<&mut Option<(u32, u64, Option<u64>)>>,
    ) -> Result<Elements> {
        let mut out = Elements {
            values: BTreeMap::new(),
            big: self.coding.big,
        };
        while let Some((tag, kind, len)) = self.head_of(end, |_| true)? {
            let is_pixels = matches!(tag, tag::PIXELS | tag::FLOAT_PIXELS | tag::DOUBLE_PIXELS);
            if tag == tag::ITEM_END {
                return Ok(out);
            }
            if let (true, Some(pixels)) = (is_pixels, &mut pixels) {
                let len = (len != UNDEFINED).then_some(u64::from(len));
                **pixels = Some((tag, self.position, len));
                return Ok(out);
            }
            let kept = tag::KEPT.binary_search(&tag).is_ok();
            let sequence = matches!(
                tag,
                tag::PLANE_POSITION
                    | tag::PLANE_ORIENTATION
                    | tag::PIXEL_MEASURES
                    | tag::PIXEL_VALUES
                    | tag::REAL_WORLD
                    | tag::REAL_UNITS
                    | tag::SHARED
                    | tag::PER_FRAME
            );
            if len == UNDEFINED || (kept && (sequence || &kind == b"SQ")) {
                let items = self.items(kind, len, depth + 1)?;
                if kept {
                    out.values.insert(tag, Value::Items(items));
                }
            } else if kept && u64::from(len) <= MAX_VALUE {
                out.values.insert(tag, Value::Bytes(self.take(len.into())?));
            } else {
                self.skip(len.into())?;
            }
        }
        // items end where they say, or at a delimiter
        if depth > 0 && self.position < end {
            return Err(self.inside("a sequence"));
        }
        Ok(out)
    }

    /// The items of a sequence.
    fn items(&mut self, kind: [u8; 2], len: u32, depth: u32) -> Result<Vec<Elements>> {
        if depth > MAX_DEPTH {
            return Err(self.broken(format!("sequences in sequences, {depth} deep")));
        }
        let outer = self.coding;
        // a sequence of unknown type is written without types
        if &kind == b"UN" {
            self.coding = Coding {
                explicit: false,
                big: false,
            };
        }
        let end = match len {
            UNDEFINED => u64::MAX,
            len => self.position.saturating_add(len.into()),
        };
        let (mut items, mut ended) = (Vec::new(), false);
        while let Some((tag, _, len)) = self.head_of(end, |_| true)? {
            match (tag, len) {
                (tag::SEQUENCE_END, _) => {
                    ended = true;
                    break;
                }
                (tag::ITEM, UNDEFINED) => items.push(self.set(u64::MAX, depth, None)?),
                (tag::ITEM, len) => {
                    let end = self.position.saturating_add(len.into());
                    items.push(self.set(end, depth, None)?);
                }
                _ => return Err(self.broken(format!("the tag {tag:08x} for an item"))),
            }
        }
        if !ended && self.position < end {
            return Err(self.inside("a sequence"));
        }
        self.coding = outer;
        Ok(items)
    }
}

/// Position and length of a part of a file.
pub(crate) type Fragment = (u64, u64);

/// The fragments of the pixels at `position`, without the table of offsets in front of them, which is
/// returned first.
///
/// # Errors
/// [`Error::Format`] if they are damaged.
pub(crate) fn fragments(bytes: &Bytes, position: u64) -> Result<(Vec<u64>, Vec<Fragment>)> {
    let coding = Coding {
        explicit: true,
        big: false,
    };
    let mut reader = Reader::new(bytes, position, false, coding);
    let (mut table, mut out) = (None, Vec::new());
    while let Some((tag, _, len)) = reader.head_of(u64::MAX, |_| true)? {
        match tag {
            tag::SEQUENCE_END => break,
            tag::ITEM if len != UNDEFINED => {}
            _ => return Err(reader.broken(format!("the tag {tag:08x} for a fragment"))),
        }
        let end = reader.position.saturating_add(len.into());
        if end > bytes.len() {
            return Err(reader.broken(format!("a fragment of {len} bytes")));
        }
        if table.is_none() {
            let words = reader.take(len.into())?;
            let words = words.as_chunks::<4>().0.iter();
            table = Some(words.map(|w| u64::from(u32::from_le_bytes(*w))).collect());
        } else {
            out.push((reader.position, u64::from(len)));
            reader.skip(len.into())?;
        }
    }
    Ok((table.unwrap_or_default(), out))
}
