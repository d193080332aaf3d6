//! Numbers in the headers of binary files.

use crate::volume::Endian;

/// The bytes of a number at a place of a header, the least significant first; zeros if it does not end inside.
pub(crate) fn word<const N: usize>(head: &[u8], at: usize, endian: Endian) -> [u8; N] {
    let found = head.get(at..).and_then(|rest| rest.first_chunk::<N>());
    let mut bytes = found.copied().unwrap_or([0; N]);
    if endian == Endian::Big {
        bytes.reverse();
    }
    bytes
}
