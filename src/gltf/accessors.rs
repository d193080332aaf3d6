//! The numbers of a tile's geometry as iterators, whatever way they are stored.

use crate::gltf::buffer_views::Bytes;
use crate::grid::LATTICE;

/// Positions in voxel coordinates: floats, or steps of 1/256 voxel in 16 bits from a corner.
#[derive(Debug, Clone)]
pub struct Positions<'a> {
    pub(crate) bytes: Bytes<'a>,
    /// The corner that 16-bit steps count from, in voxels; nothing for floats.
    pub(crate) base: Option<[f32; 3]>,
}

/// Normals: floats, or 8 bits normalised.
#[derive(Debug, Clone)]
pub struct Normals<'a> {
    pub(crate) bytes: Bytes<'a>,
    pub(crate) quantized: bool,
}

/// The indices of a primitive, little-endian of 16 or 32 bits.
#[derive(Debug, Clone)]
pub struct Indices<'a> {
    pub(crate) bytes: Bytes<'a>,
    pub(crate) wide: bool,
}

/// One of two iterators.
enum Either<A, B> {
    Left(A),
    Right(B),
}

impl<T, A: Iterator<Item = T>, B: Iterator<Item = T>> Iterator for Either<A, B> {
    type Item = T;

    #[inline]
    fn next(&mut self) -> Option<T> {
        match self {
            Either::Left(a) => a.next(),
            Either::Right(b) => b.next(),
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        match self {
            Either::Left(a) => a.size_hint(),
            Either::Right(b) => b.size_hint(),
        }
    }

    // asks which it is once, not for each item
    #[inline]
    fn fold<Acc, F: FnMut(Acc, T) -> Acc>(self, first: Acc, f: F) -> Acc {
        match self {
            Either::Left(a) => a.fold(first, f),
            Either::Right(b) => b.fold(first, f),
        }
    }
}

impl<T, A, B> ExactSizeIterator for Either<A, B>
where
    A: ExactSizeIterator<Item = T>,
    B: ExactSizeIterator<Item = T>,
{
}

/// Three little-endian floats.
pub(crate) fn float3(e: &[u8; 12]) -> [f32; 3] {
    let at = |i: usize| f32::from_le_bytes([e[i], e[i + 1], e[i + 2], e[i + 3]]);
    [at(0), at(4), at(8)]
}

fn stepped(e: &[u8; 8], base: [f32; 3]) -> [f32; 3] {
    let steps = |a: usize| u16::from_le_bytes([e[2 * a], e[2 * a + 1]]);
    std::array::from_fn(|a| base[a] + f32::from(steps(a)) / LATTICE as f32)
}

impl Positions<'_> {
    /// Number of positions.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / if self.base.is_some() { 8 } else { 12 }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The positions in order, in voxels; 16-bit steps are exact in `f32`.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        match self.base {
            None => Either::Left(self.bytes.chunks::<12>().iter().map(float3)),
            Some(base) => {
                let all = self.bytes.chunks::<8>();
                Either::Right(all.iter().map(move |e| stepped(e, base)))
            }
        }
    }

    /// Replaces the contents of `out` by the positions, see [`Positions::iter`].
    pub fn read_into(&self, out: &mut Vec<[f32; 3]>) {
        out.clear();
        match self.base {
            None => out.extend(self.bytes.chunks::<12>().iter().map(float3)),
            Some(base) => {
                let all = self.bytes.chunks::<8>();
                out.extend(all.iter().map(|e| stepped(e, base)));
            }
        }
    }
}

impl Normals<'_> {
    /// Number of normals.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / if self.quantized { 4 } else { 12 }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if they have 8 bits to a component.
    pub fn is_quantized(&self) -> bool {
        self.quantized
    }

    /// The normals in order, as stored: those of 8 bits are of length 1 up to 0.7 %.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        if self.quantized {
            Either::Right(self.bytes.chunks::<4>().iter().map(|e| {
                // glTF 2.0, section 3.11: max(c / 127, -1)
                std::array::from_fn(|a| (f32::from(e[a] as i8) / 127.0).max(-1.0))
            }))
        } else {
            Either::Left(self.bytes.chunks::<12>().iter().map(float3))
        }
    }

    /// The normals in order: floats as stored, those of 8 bits made unit vectors.
    pub fn unit(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + '_ {
        let quantized = self.quantized;
        self.iter().map(move |n| {
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            if quantized && length > 0.0 {
                n.map(|c| c / length)
            } else {
                n
            }
        })
    }
}

impl Indices<'_> {
    /// Number of indices.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / if self.wide { 4 } else { 2 }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True for 32-bit indices.
    pub fn is_wide(&self) -> bool {
        self.wide
    }

    /// Replaces the contents of `out` by the indices.
    pub fn read_into(&self, out: &mut Vec<u32>) {
        out.clear();
        if self.wide {
            let all = self.bytes.chunks::<4>();
            out.extend(all.iter().map(|&b| u32::from_le_bytes(b)));
        } else {
            let all = self.bytes.chunks::<2>();
            out.extend(all.iter().map(|&b| u32::from(u16::from_le_bytes(b))));
        }
    }
}
