//! Samples from memory with any steps between them.

use half::f16;
use std::ops::Range;

/// How samples are stored.
#[derive(Debug, Clone, Copy)]
pub enum Stored {
    /// As they are handed out, but for the order of their bytes.
    Plain {
        /// Of a sample.
        bytes: usize,
        /// In the other order than the machine's.
        swapped: bool,
    },
    /// Floats of 16 bits, which are handed out as floats of 32.
    Half {
        /// In the other order than the machine's.
        swapped: bool,
    },
}

/// Samples in memory.
#[derive(Debug, Clone, Copy)]
pub struct Samples {
    /// That at 0, 0, 0.
    pub first: *const u8,
    /// Bytes from one to the next along x, y and z.
    pub strides: [isize; 3],
    /// How they are stored.
    pub stored: Stored,
}

/// An axis of a box.
#[derive(Debug, Clone, Copy)]
struct Axis {
    count: usize,
    /// Bytes between neighbours where samples are read, and samples between them where they are written.
    from: isize,
    to: usize,
}

/// Samples of a row that are written near each other before the next row is begun, whatever is near where they are read.
const BLOCK: usize = 64;

impl Samples {
    /// Copies the box `x` by `y` by `z` to `out`, x fastest, in the machine's order.
    ///
    /// # Safety
    /// All samples of the box can be read at their places, and go on to be there; `out` has the box's samples, of the
    /// size that they are handed out in.
    pub unsafe fn copy(&self, [x, y, z]: [Range<u32>; 3], out: &mut [u8]) {
        let [nx, ny] = [x.len(), y.len()];
        let (mut start, mut done) = (x.start, 0);
        while start < x.end {
            let count = BLOCK.min((x.end - start) as usize);
            // where rows lie one behind the other, all of them at once
            let count = if self.is_plain() { x.len() } else { count };
            let mut axes = [
                Axis {
                    count,
                    from: self.strides[0],
                    to: 1,
                },
                Axis {
                    count: ny,
                    from: self.strides[1],
                    to: nx,
                },
                Axis {
                    count: z.len(),
                    from: self.strides[2],
                    to: nx * ny,
                },
            ];
            // what lies near each other is read one after the other
            axes.sort_by_key(|axis| std::cmp::Reverse(axis.from.unsigned_abs()));
            let at = [start, y.start, z.start];
            let offset: isize = (0..3).map(|a| at[a] as isize * self.strides[a]).sum();
            // SAFETY: the offset is that of a sample of the box, which the caller vouches for
            let first = unsafe { self.first.offset(offset) };
            // SAFETY: the axes are those of a part of the box, `done` samples into its rows
            unsafe { self.copy_axes(first, &axes, done, out) };
            start += count as u32;
            done += count;
        }
    }

    /// True if rows are copied as they are.
    fn is_plain(&self) -> bool {
        match self.stored {
            Stored::Plain {
                bytes,
                swapped: false,
            } => self.strides[0] == bytes as isize,
            _ => false,
        }
    }

    /// # Safety
    /// As of [`Samples::copy`], of the part of its box that begins at `first` and goes to `out` from sample `to` on.
    unsafe fn copy_axes(&self, first: *const u8, axes: &[Axis; 3], to: usize, out: &mut [u8]) {
        // SAFETY: as this function's
        unsafe {
            match self.stored {
                Stored::Plain { bytes, .. } if self.is_plain() => {
                    copy_rows(first, axes, bytes, out)
                }
                Stored::Plain { bytes: 1, .. } => each(first, axes, to, out, |b: [u8; 1]| b),
                Stored::Plain { bytes: 2, swapped } => {
                    each(first, axes, to, out, turned::<2>(swapped))
                }
                Stored::Plain { bytes: 4, swapped } => {
                    each(first, axes, to, out, turned::<4>(swapped))
                }
                Stored::Plain { swapped, .. } => each(first, axes, to, out, turned::<8>(swapped)),
                Stored::Half { swapped } => {
                    let turn = turned::<2>(swapped);
                    let float = |b| f16::from_ne_bytes(turn(b)).to_f32().to_ne_bytes();
                    each(first, axes, to, out, float);
                }
            }
        }
    }
}

/// The bytes of a sample in the machine's order.
fn turned<const N: usize>(swapped: bool) -> impl Fn([u8; N]) -> [u8; N] {
    move |mut bytes| {
        if swapped {
            bytes.reverse();
        }
        bytes
    }
}

/// Copies whole rows, whose samples lie one behind the other.
///
/// # Safety
/// As of [`Samples::copy`]; the axes are of whole rows.
unsafe fn copy_rows(first: *const u8, axes: &[Axis; 3], bytes: usize, out: &mut [u8]) {
    // an axis of one voxel may have any stride, and stand anywhere
    let Some(row) = axes.iter().position(|axis| axis.to == 1) else {
        return;
    };
    let others: [Axis; 2] = std::array::from_fn(|i| axes[if i < row { i } else { i + 1 }]);
    let length = axes[row].count * bytes;
    for i in 0..others[0].count {
        for j in 0..others[1].count {
            let offset = i as isize * others[0].from + j as isize * others[1].from;
            let at = (i * others[0].to + j * others[1].to) * bytes;
            // SAFETY: a row of the box, which the caller vouches for; `out` is none of Python's memory
            unsafe {
                let row = first.offset(offset);
                std::ptr::copy_nonoverlapping(row, out[at..at + length].as_mut_ptr(), length);
            }
        }
    }
}

/// Copies sample by sample.
///
/// # Safety
/// As of [`Samples::copy`]: samples of `N` bytes, which become `M`.
unsafe fn each<const N: usize, const M: usize>(
    first: *const u8,
    axes: &[Axis; 3],
    to: usize,
    out: &mut [u8],
    of: impl Fn([u8; N]) -> [u8; M],
) {
    let (out, _) = out.as_chunks_mut::<M>();
    for i in 0..axes[0].count {
        for j in 0..axes[1].count {
            let from = i as isize * axes[0].from + j as isize * axes[1].from;
            let to = to + i * axes[0].to + j * axes[1].to;
            for k in 0..axes[2].count {
                // SAFETY: a sample of the box, which the caller vouches for; it may lie at any address
                let sample = unsafe {
                    let at = first.offset(from + k as isize * axes[2].from);
                    at.cast::<[u8; N]>().read_unaligned()
                };
                out[to + k * axes[2].to] = of(sample);
            }
        }
    }
}
