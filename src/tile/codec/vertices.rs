//! Positions and normals of a tile that was read, whatever way they are stored.

use super::TileCodec;
use super::float::float3;
use crate::gltf::buffer_views::Bytes;

/// Positions in voxel coordinates.
#[derive(Debug, Clone)]
pub struct Positions<'a> {
    pub(in crate::tile) bytes: Bytes<'a>,
    pub(in crate::tile) codec: &'static dyn TileCodec,
    /// The corner that they count from, in voxels.
    pub(in crate::tile) base: [f32; 3],
}

/// Normals: floats, or 8 bits normalised.
#[derive(Debug, Clone)]
pub struct Normals<'a> {
    pub(in crate::tile) bytes: Bytes<'a>,
    pub(in crate::tile) codec: &'static dyn TileCodec,
}

/// Vectors that are decoded together.
const TOGETHER: usize = 64;

/// Vectors in order.
struct Decoded<'a, D> {
    /// Those that are not decoded yet, and the bytes of each.
    bytes: &'a [u8],
    stride: usize,
    /// Decodes as many as there is room for.
    decode: D,
    /// Those that are decoded: the ones from `next` to `end` are still to be handed out.
    block: [[f32; 3]; TOGETHER],
    next: usize,
    end: usize,
}

impl<'a, D: Fn(&[u8], &mut [[f32; 3]])> Decoded<'a, D> {
    fn new(bytes: &'a [u8], stride: u64, decode: D) -> Self {
        Decoded {
            bytes,
            stride: stride as usize,
            decode,
            block: [[0.0; 3]; TOGETHER],
            next: 0,
            end: 0,
        }
    }

    /// Decodes the next ones; false if there are none.
    fn advance(&mut self) -> bool {
        let count = (self.bytes.len() / self.stride).min(TOGETHER);
        let (some, rest) = self.bytes.split_at(count * self.stride);
        (self.decode)(some, &mut self.block[..count]);
        self.bytes = rest;
        (self.next, self.end) = (0, count);
        count > 0
    }
}

impl<D: Fn(&[u8], &mut [[f32; 3]])> Iterator for Decoded<'_, D> {
    type Item = [f32; 3];

    #[inline]
    fn next(&mut self) -> Option<[f32; 3]> {
        if self.next == self.end && !self.advance() {
            return None;
        }
        self.next += 1;
        Some(self.block[self.next - 1])
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.end - self.next + self.bytes.len() / self.stride;
        (left, Some(left))
    }

    // asks once for a block whether it is used up, not for each vector
    #[inline]
    fn fold<Acc, F: FnMut(Acc, [f32; 3]) -> Acc>(mut self, first: Acc, mut f: F) -> Acc {
        let mut all = first;
        loop {
            for &vector in &self.block[self.next..self.end] {
                all = f(all, vector);
            }
            if !self.advance() {
                return all;
            }
        }
    }
}

impl<D: Fn(&[u8], &mut [[f32; 3]])> ExactSizeIterator for Decoded<'_, D> {}

impl Positions<'_> {
    /// Number of positions.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / self.codec.vertices().position.stride as usize
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The positions in order, in voxels, exact.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        let stride = self.codec.vertices().position.stride;
        Decoded::new(self.bytes.get(), stride, |bytes, out| {
            self.codec.decode_positions(bytes, self.base, out);
        })
    }

    /// Replaces the contents of `out` by the positions, see [`Positions::iter`].
    pub fn read_into(&self, out: &mut Vec<[f32; 3]>) {
        // all of them are overwritten
        out.resize(self.len(), [0.0; 3]);
        self.codec
            .decode_positions(self.bytes.get(), self.base, out);
    }
}

impl Normals<'_> {
    /// Number of normals.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / self.codec.vertices().normal.stride as usize
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if they are rounded.
    pub fn is_quantized(&self) -> bool {
        self.codec.vertices().rounded
    }

    /// The normals in order, as stored: rounded ones are of length 1 up to 0.7 %.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        let stride = self.codec.vertices().normal.stride;
        Decoded::new(self.bytes.get(), stride, |bytes, out| {
            self.codec.decode_normals(bytes, out);
        })
    }

    /// Replaces the contents of `out` by the normals, see [`Normals::iter`].
    pub fn read_into(&self, out: &mut Vec<[f32; 3]>) {
        // all of them are overwritten
        out.resize(self.len(), [0.0; 3]);
        self.codec.decode_normals(self.bytes.get(), out);
    }

    /// How many normals are so; floats are looked at where they stand, in the vectors of the caller.
    #[inline(always)]
    pub(crate) fn count(&self, is: impl Fn([f32; 3]) -> bool) -> usize {
        let add = |count, n| count + usize::from(is(n));
        match self.codec.keeps_floats() {
            true => {
                let (floats, _) = self.bytes.get().as_chunks();
                floats.iter().map(float3).fold(0, add)
            }
            false => self.iter().fold(0, add),
        }
    }

    /// The normals in order: floats as stored, rounded ones made unit vectors.
    pub fn unit(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        let rounded = self.is_quantized();
        self.iter().map(move |n| {
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            if rounded && length > 0.0 {
                n.map(|c| c / length)
            } else {
                n
            }
        })
    }
}
