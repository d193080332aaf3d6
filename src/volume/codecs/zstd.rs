//! Zstandard streams of known size.

use std::io::{BufReader, Error, ErrorKind, Read, Result};
use zstd::stream::read::Decoder;

/// Windows beyond 2 to this are refused: a decoder holds one.
const MAX_WINDOW_LOG: u32 = 27;

/// Fills `out` from one or more frames.
///
/// # Errors
/// If the frames are damaged, or hold less.
pub(crate) fn decode(from: impl Read, out: &mut [u8]) -> Result<()> {
    let mut source = BufReader::new(from);
    let mut done = 0;
    while done < out.len() {
        let mut frame = Decoder::with_buffer(&mut source)?.single_frame();
        frame.window_log_max(MAX_WINDOW_LOG)?;
        let start = done;
        while done < out.len() {
            match frame.read(&mut out[done..])? {
                0 => break,
                n => done += n,
            }
        }
        // reading on reaches the checksum; what a padded strip holds beyond is no harm
        let _more = frame.read(&mut [0])?;
        if done == start {
            return Err(Error::from(ErrorKind::UnexpectedEof));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn frame(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 1).unwrap();
        encoder.include_checksum(true).unwrap();
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn unpacked(from: &[u8], len: usize) -> Result<Vec<u8>> {
        let mut out = vec![0; len];
        decode(from, &mut out).map(|()| out)
    }

    #[test]
    fn frames_come_back_one_after_the_other() {
        let known: Vec<u8> = (0..300_000u32).map(|i| (i / 7 % 251) as u8).collect();
        let (first, second) = known.split_at(200_000);
        let frames = [frame(first), frame(second)].concat();
        assert!(unpacked(&frames, known.len()).unwrap() == known);
        // less is asked for than there is, and there is more behind
        assert!(unpacked(&frames, 100_000).unwrap() == known[..100_000]);
        assert!(unpacked(&[&frames[..], &[0; 40]].concat(), known.len()).unwrap() == known);
        assert!(unpacked(&frames, known.len() + 1).is_err());
    }

    #[test]
    fn damage_is_found() {
        let known = [5; 10_000];
        let good = frame(&known);
        for at in 0..good.len() {
            assert!(unpacked(&good[..at], known.len()).is_err(), "cut at {at}");
        }
        let mut sum = good.clone();
        *sum.last_mut().unwrap() ^= 1;
        assert!(unpacked(&sum, known.len()).is_err());
    }

    #[test]
    fn windows_that_no_memory_should_be_given_to_are_refused() {
        // one raw byte in a frame of this window
        let with = |log: u8| {
            let window = (log - 10) << 3;
            [&[0x28, 0xB5, 0x2F, 0xFD, 0, window], &[9, 0, 0, 77][..]].concat()
        };
        assert_eq!(unpacked(&with(27), 1).unwrap(), [77]);
        assert!(unpacked(&with(28), 1).is_err());
    }
}
