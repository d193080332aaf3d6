//! Amira's run lengths of bytes (`HxByteRLE`): a count below 128 and the byte that is repeated, or a count with the highest
//! bit set and as many bytes as they are.

use std::io::{Error, ErrorKind, Read, Result, Take};

/// Bytes that are unpacked while they are read.
pub(crate) struct ByteRle<R> {
    packed: Take<R>,
    /// Bytes of the run that are still to come.
    left: usize,
    /// The byte that is repeated; those of the stream if absent.
    same: Option<u8>,
}

impl<R: Read> ByteRle<R> {
    /// Unpacks the first `packed` bytes of a stream.
    pub(crate) fn new(stream: R, packed: u64) -> Self {
        ByteRle {
            packed: stream.take(packed),
            left: 0,
            same: None,
        }
    }

    /// Reads the beginning of the next run; false at the end.
    fn next_run(&mut self) -> Result<bool> {
        let mut byte = [0];
        if self.packed.read(&mut byte)? == 0 {
            return match self.packed.limit() {
                0 => Ok(false),
                _ => Err(ErrorKind::UnexpectedEof.into()),
            };
        }
        self.left = usize::from(byte[0] & 0x7f);
        if self.left == 0 {
            return Err(Error::new(ErrorKind::InvalidData, "a run of 0 bytes"));
        }
        self.same = match byte[0] & 0x80 {
            0 => {
                self.packed.read_exact(&mut byte)?;
                Some(byte[0])
            }
            _ => None,
        };
        Ok(true)
    }
}

impl<R: Read> Read for ByteRle<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if out.is_empty() || self.left == 0 && !self.next_run()? {
            return Ok(0);
        }
        let count = self.left.min(out.len());
        match self.same {
            Some(byte) => out[..count].fill(byte),
            None => self.packed.read_exact(&mut out[..count])?,
        }
        self.left -= count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpacked(packed: &[u8], length: u64) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        ByteRle::new(packed, length).read_to_end(&mut out)?;
        Ok(out)
    }

    #[test]
    fn runs_and_bytes_as_they_are() {
        let packed = [3, 7, 0x82, 1, 2, 127, 9, 1, 5];
        let mut expected = vec![7, 7, 7, 1, 2];
        expected.extend([9; 127]);
        expected.push(5);
        assert_eq!(unpacked(&packed, 9).unwrap(), expected);
        // what follows is of something else
        assert_eq!(unpacked(&packed, 2).unwrap(), [7, 7, 7]);
        let mut one = [0; 1];
        let mut reader = ByteRle::new(&packed[..], 9);
        let single: Vec<u8> = (0..133)
            .map(|_| reader.read_exact(&mut one).map(|()| one[0]).unwrap())
            .collect();
        assert_eq!(single, expected);
    }

    #[test]
    fn damage_is_told() {
        for (packed, length) in [
            (&[3][..], 1),
            (&[0x83, 1], 2),
            (&[0, 1], 2),
            (&[0x80], 1),
            (&[3, 7], 4),
        ] {
            assert!(unpacked(packed, length).is_err(), "{packed:?}");
        }
    }
}
