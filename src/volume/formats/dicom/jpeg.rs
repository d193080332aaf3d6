//! JPEG and JPEG 2000 frames, by crates.

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};
use jpeg_decoder::{Decoder, PixelFormat};

/// Unpacks JPEG of 8 bits or lossless JPEG of up to 16 to pixels of `bytes` bytes, least significant
/// first.
///
/// # Errors
/// What is wrong, as text for a message.
pub(crate) fn decode(
    packed: &[u8],
    size: [u32; 2],
    bytes: usize,
    out: &mut [u8],
) -> Result<(), String> {
    let mut decoder = Decoder::new(packed);
    let no = |e: jpeg_decoder::Error| format!("damaged JPEG ({e})");
    decoder.set_max_decoding_buffer_size(out.len().saturating_mul(4));
    decoder.read_info().map_err(no)?;
    let info = decoder.info().ok_or("JPEG without a header")?;
    let found = [info.width, info.height].map(u32::from);
    let stored = match info.pixel_format {
        PixelFormat::L8 => 1,
        PixelFormat::L16 => 2,
        _ => return Err("JPEG in colour".into()),
    };
    if found != size || stored > bytes {
        let [x, y] = found;
        return Err(format!("JPEG of {x} x {y} pixels of {stored} bytes"));
    }
    let pixels = decoder.decode().map_err(no)?;
    let words = pixels.chunks_exact(stored).map(|p| match p {
        // the crate's order is the machine's
        [a, b] => u32::from(u16::from_ne_bytes([*a, *b])),
        _ => u32::from(p[0]),
    });
    if pixels.len() != out.len() / bytes * stored {
        return Err(format!("JPEG of {} bytes", pixels.len()));
    }
    put(words, bytes, out);
    Ok(())
}

fn put(words: impl Iterator<Item = u32>, bytes: usize, out: &mut [u8]) {
    for (out, word) in out.chunks_exact_mut(bytes).zip(words) {
        out.copy_from_slice(&word.to_le_bytes()[..bytes]);
    }
}

/// Unpacks JPEG 2000 likewise.
///
/// # Errors
/// What is wrong, as text for a message.
pub(crate) fn decode_2000(
    packed: &[u8],
    size: [u32; 2],
    bytes: usize,
    out: &mut [u8],
) -> Result<(), String> {
    let (found, bits, signed) = component(packed)?;
    if found != size || bits > 24 {
        let [x, y] = found;
        return Err(format!("JPEG 2000 of {x} x {y} pixels of {bits} bits"));
    }
    let settings = DecodeSettings {
        strict: true,
        ..DecodeSettings::default()
    };
    let no = |e: hayro_jpeg2000::DecodeError| format!("damaged JPEG 2000 ({e})");
    let image = Image::new(packed, &settings).map_err(no)?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(no)?;
    let samples = match decoded.components() {
        [one] if one.samples().len() == out.len() / bytes => one.samples(),
        other => return Err(format!("JPEG 2000 of {} components", other.len())),
    };
    // the crate takes every component for unsigned and adds half its range
    let (low, high, shift) = match signed {
        true => (
            -(1i64 << (bits - 1)),
            (1i64 << (bits - 1)) - 1,
            1i64 << (bits - 1),
        ),
        false => (0, (1i64 << bits) - 1, 0),
    };
    let words = samples.iter().map(|v| {
        let value = f64::from(*v).round() as i64 - shift;
        value.clamp(low, high) as u32
    });
    put(words, bytes, out);
    Ok(())
}

/// Size, bits and sign of the only component of a codestream, by its SIZ segment, which comes first
/// (ISO/IEC 15444-1, A.5.1).
fn component(packed: &[u8]) -> Result<([u32; 2], u32, bool), String> {
    let start = packed
        .windows(4)
        .position(|w| w == [0xff, 0x4f, 0xff, 0x51])
        .ok_or("JPEG 2000 without a codestream")?;
    let siz = packed[start + 4..].first_chunk::<39>();
    let siz = siz.ok_or("JPEG 2000 that is cut short")?;
    let word = |at: usize| u32::from_be_bytes([siz[at], siz[at + 1], siz[at + 2], siz[at + 3]]);
    let [right, down, left, up] = [4, 8, 12, 16].map(word);
    let count = u16::from_be_bytes([siz[36], siz[37]]);
    if count != 1 {
        return Err(format!("JPEG 2000 of {count} components"));
    }
    let size = [right.saturating_sub(left), down.saturating_sub(up)];
    Ok((size, u32::from(siz[38] & 0x7f) + 1, siz[38] & 0x80 != 0))
}
