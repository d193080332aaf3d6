//! How large the surface at a threshold will be, from the signs of the samples alone.

use crate::error::Result;
use crate::progress::Progress;
use crate::volume::stats::walk::{Piece, Walk};
use crate::volume::{Volume, Voxel, with_voxel_type};
use std::ops::Range;

/// Triangles per vertex. A closed surface of V vertices and Euler characteristic c has 2 (V - c)
/// triangles; borders and solid balls make it slightly fewer, tunnels slightly more.
const TRIANGLES_PER_VERTEX: f64 = 2.0;

/// The size of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Vertices: lattice edges between an above and a below voxel. Exact unless `sampled`.
    pub vertices: u64,
    /// Triangles, from a mean of 2 per vertex.
    pub triangles: u64,
    /// Voxels above, of those that were measured. Exact unless `sampled`.
    pub voxels_above: u64,
    /// Only some of the slices were read and the numbers scaled up.
    pub sampled: bool,
    /// Slices that were looked at; each next one was read too.
    pub slices: u32,
}

/// Counts the lattice edges that the surface at `threshold` crosses. Of a volume of more than
/// `max_slices` slices, about `max_slices` are read, in pairs that are evenly spaced; `u32::MAX`
/// reads all. Threads hold 2 MiB of samples each, or four rows if those are more.
///
/// # Errors
/// The volume's own; [`crate::Error::Interrupted`].
pub fn predict(
    volume: &dyn Volume,
    threshold: f64,
    max_slices: u32,
    progress: &dyn Progress,
) -> Result<Prediction> {
    let header = volume.header();
    let nz = header.dims.0[2];
    let sampled = nz > max_slices.max(2);
    let walk = if sampled {
        // a slice costs the decoding of the whole layer of chunks that it is in
        let layers = nz.div_ceil(volume.grain()[2]);
        let slabs = (max_slices / 2).min(layers.saturating_mul(2));
        Walk::sampled(header.dims, header.dtype.bytes(), slabs)
    } else {
        Walk::whole(volume, 1)
    };
    progress.begin("prediction", walk.pieces());
    let counts =
        with_voxel_type!(header.dtype, T => count::<T>(volume, threshold, &walk, progress))?;
    let (in_slice, between) = match sampled {
        true => (
            f64::from(nz) / walk.slabs() as f64,
            f64::from(nz - 1) / walk.slabs() as f64,
        ),
        false => (1.0, 1.0),
    };
    let scale = |n: u64, by: f64| (n as f64 * by).round() as u64;
    let vertices = scale(counts.in_slice, in_slice) + scale(counts.between, between);
    Ok(Prediction {
        vertices,
        triangles: scale(vertices, TRIANGLES_PER_VERTEX),
        voxels_above: scale(counts.above, in_slice),
        sampled,
        slices: if sampled { walk.slabs() as u32 } else { nz },
    })
}

#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    above: u64,
    /// Crossed edges along x and y.
    in_slice: u64,
    /// Crossed edges along z.
    between: u64,
}

fn count<T: Voxel>(
    volume: &dyn Volume,
    threshold: f64,
    walk: &Walk,
    progress: &dyn Progress,
) -> Result<Counts> {
    let Some(least) = T::ceil_from(threshold) else {
        return Ok(Counts::default()); // no sample of this type is above
    };
    let nx = volume.header().dims.0[0] as usize;
    walk.fold(
        volume,
        progress,
        Counts::default,
        |counts: &mut Counts, piece, samples: &[T]| {
            let measured = |y: u32, z: u32| volume.measured(y, z);
            count_piece(counts, piece, samples, nx, least, measured);
            Ok(())
        },
        |a, b| Counts {
            above: a.above + b.above,
            in_slice: a.in_slice + b.in_slice,
            between: a.between + b.between,
        },
    )
}

/// Counts the edges that start at the piece's own voxels, and those of these that are above and were measured.
fn count_piece<T: Voxel>(
    counts: &mut Counts,
    piece: &Piece,
    samples: &[T],
    nx: usize,
    least: T,
    measured: impl Fn(u32, u32) -> Option<Range<u32>>,
) {
    let rows = piece.read_y.len();
    let row = |j: usize, k: usize| {
        let at = (j + rows * k) * nx;
        &samples[at..at + nx]
    };
    for k in 0..piece.z.len() {
        for j in 0..piece.y.len() {
            let own = row(j, k);
            let counted = match measured(piece.y.start + j as u32, piece.z.start + k as u32) {
                Some(x) => &own[x.start as usize..x.end as usize],
                None => own,
            };
            // a row has at most 65,536 samples
            let above: u32 = counted.iter().map(|&v| u32::from(v >= least)).sum();
            counts.above += u64::from(above);
            counts.in_slice += crossed(own, &own[1..], least);
            if j + 1 < rows {
                counts.in_slice += crossed(own, row(j + 1, k), least);
            }
            if k + 1 < piece.read_z.len() {
                counts.between += crossed(own, row(j, k + 1), least);
            }
        }
    }
}

/// Pairs of which exactly one is above.
fn crossed<T: Voxel>(a: &[T], b: &[T], least: T) -> u64 {
    let pairs = a.iter().zip(b);
    let n: u32 = pairs
        .map(|(&a, &b)| u32::from((a >= least) != (b >= least)))
        .sum();
    u64::from(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_are_those_of_the_definition(
            dims in [2u32..6, 2u32..6, 2u32..6],
            samples in prop::collection::vec(0u8..4, 125),
            threshold in 0.0..4.0,
        ) {
            let dims = Dims(dims);
            let samples = samples[..dims.voxels() as usize].to_vec();
            let above = |p: [u32; 3]| f64::from(samples[dims.linear(p) as usize]) >= threshold;
            let mut vertices = 0;
            for i in 0..dims.voxels() as u32 {
                let p = [i % dims.0[0], i / dims.0[0] % dims.0[1], i / dims.0[0] / dims.0[1]];
                for axis in 0..3 {
                    let mut q = p;
                    q[axis] += 1;
                    vertices += u64::from(q[axis] < dims.0[axis] && above(p) != above(q));
                }
            }
            let volume = MemoryVolume::new(dims, Placement::default(), samples.clone()).unwrap();
            let found = predict(&volume, threshold, u32::MAX, &Quiet).unwrap();
            prop_assert_eq!(found.vertices, vertices);
            let n = samples.iter().filter(|v| f64::from(**v) >= threshold).count();
            prop_assert_eq!(found.voxels_above, n as u64);
        }
    }

    #[test]
    fn sampling_scales_what_it_sees() {
        // columns along z: every slice is the same, so the sample is exact up to the z edges
        let dims = Dims([5, 4, 100]);
        let samples: Vec<u8> = (0..2000u32).map(|i| u8::from(i % 20 == 7)).collect();
        let volume = MemoryVolume::new(dims, Placement::default(), samples).unwrap();
        let all = predict(&volume, 1.0, u32::MAX, &Quiet).unwrap();
        let some = predict(&volume, 1.0, 10, &Quiet).unwrap();
        assert!(some.sampled && !all.sampled);
        assert_eq!((some.slices, all.slices), (5, 100));
        assert_eq!(
            (some.vertices, some.voxels_above),
            (all.vertices, all.voxels_above)
        );
        assert_eq!(all.vertices, 400);
        assert_eq!(predict(&volume, f64::NAN, 10, &Quiet).unwrap().vertices, 0);
    }
}
