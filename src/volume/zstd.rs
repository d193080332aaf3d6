//! Zstandard streams of known size, by a decoder in Rust alone.

use ruzstd::decoding::{FrameDecoder, StreamingDecoder};
use std::io::{Error, ErrorKind, Read, Result};

/// Windows beyond this are refused: a decoder holds one.
const MAX_WINDOW: u64 = 128 << 20;

/// Fills `out` from one or more frames.
///
/// # Errors
/// If the frames are damaged, or hold less.
pub(super) fn decode(from: impl Read, out: &mut [u8]) -> Result<()> {
    let bad = |e: &dyn std::fmt::Display| Error::new(ErrorKind::InvalidData, e.to_string());
    let mut source = from;
    let mut done = 0;
    while done < out.len() {
        let mut frame = FrameDecoder::new();
        frame.set_max_window_size(MAX_WINDOW);
        let mut decoder =
            StreamingDecoder::new_with_decoder(&mut source, frame).map_err(|e| bad(&e))?;
        let start = done;
        while done < out.len() {
            match decoder.read(&mut out[done..])? {
                0 => break,
                n => done += n,
            }
        }
        // reading on reaches the checksum; what a padded strip holds beyond is no harm
        let more = decoder.read(&mut [0])?;
        let frame = &decoder.decoder;
        let sums = (
            frame.get_checksum_from_data(),
            frame.get_calculated_checksum(),
        );
        if let (0, (Some(stored), Some(found))) = (more, sums)
            && stored != found
        {
            return Err(Error::new(ErrorKind::InvalidData, "wrong checksum"));
        }
        if done == start {
            return Err(ErrorKind::UnexpectedEof.into());
        }
    }
    Ok(())
}
