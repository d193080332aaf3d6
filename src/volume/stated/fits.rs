//! Whether the size that was given for raw samples fits them.
//!
//! Neighbours in the file are neighbours along x, whatever the size. With the right one, neighbours along y and z
//! differ about as much; with a wrong one, they are no neighbours and differ as any two samples do. Of permutations of
//! the size, and of sizes with the same slices or the same rows, one may fit clearly better: then it is told. Noise
//! fits none better than another; nor is anything told where slices are so far apart that they hardly resemble each
//! other. Where every other row or slice is brighter, two of them together are no better size: between these the samples
//! still change. A few MiB are read at most, and little of a volume whose size fits.

use crate::error::Result;
use crate::grid::{Dims, MAX_DIM};
use crate::store::is_remote;
use crate::volume::{Opened, Volume, Voxel, with_voxel_type};
use std::collections::{BTreeMap, BTreeSet};

/// Places that are looked at, and samples at each.
const PLACES: u64 = 64;
const SAMPLES: u64 = 1024;
/// Of a volume of so few samples all are read at once.
const FEW: u64 = 1 << 20;
/// Differences along y and z up to so many times that along x raise no doubt.
const SOUND: f64 = 1.3;
/// Differences up to so many times that along x are those of neighbours.
const NEIGHBOURS: f64 = 2.5;
/// A better size has differences, along y and z together, of this share at most, ...
const BETTER: f64 = 0.8;
/// ... and less by this share of the difference of any two samples.
const LESS: f64 = 0.1;
/// Fewer voxels along x or y are no better size: a few rows further, voxels resemble each other, too.
const LEAST: u64 = 16;

impl Opened {
    /// Adds a warning if the volume's size was typed by somebody, with the command or in a header of text, and another
    /// one fits its samples better.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`].
    pub fn doubt_size(&mut self) -> Result<()> {
        let header = self.volume.header();
        let remedy = match header.format {
            "raw" => "--dims",
            "metaimage" | "nrrd" => "correct the header",
            _ => return Ok(()),
        };
        // thousands of short reads here and there would each be a request
        let far = self.files.iter().any(|file| is_remote(file));
        if far || !self.volume.random_access() {
            return Ok(());
        }
        // of a folder of slices, each is a file
        let whole = self.files.len() < 2;
        if let Some(better) = better_dims(&*self.volume, whole)? {
            let [x, y, z] = header.dims.0;
            let [a, b, c] = better.0;
            self.warnings.push(format!(
                "the size {x},{y},{z} looks wrong: voxels that are neighbours with it differ as if they were none; \
                 {a},{b},{c} fits better ({remedy})"
            ));
        }
        Ok(())
    }
}

/// A size of as many voxels that fits the samples better than that of the volume, if there is one. `whole` says that
/// the number of slices may be another, too.
///
/// # Errors
/// Those of [`Volume::read_box`].
pub(crate) fn better_dims(volume: &dyn Volume, whole: bool) -> Result<Option<Dims>> {
    with_voxel_type!(volume.header().dtype, T => Look::<T>::new(volume)?.better(whole))
}

/// The samples of a volume, in the order of its file.
struct Samples<'a, T> {
    volume: &'a dyn Volume,
    /// All of them, where they are few.
    all: Option<Vec<T>>,
}

/// Samples at some places, and what they differ by from others.
struct Look<'a, T> {
    samples: Samples<'a, T>,
    /// Where in the file, in samples, and those there.
    places: Vec<(u64, Vec<T>)>,
    /// Mean differences from samples so much further in the file; `None` if these are too few.
    differences: BTreeMap<u64, Option<f64>>,
}

impl<'a, T: Voxel> Look<'a, T> {
    fn new(volume: &'a dyn Volume) -> Result<Self> {
        let samples = Samples::new(volume)?;
        let last = volume.header().dims.voxels().saturating_sub(SAMPLES);
        // by steps of the golden ratio, which keep no time with rows and slices
        let place = |i: u64| ((i as f64 * 0.618_033_988_749_894_9).fract() * last as f64) as u64;
        let places = (0..PLACES).map(|i| Ok((place(i), samples.from(place(i))?)));
        Ok(Look {
            places: places.collect::<Result<_>>()?,
            samples,
            differences: BTreeMap::new(),
        })
    }

    /// The mean difference of samples that are so far apart in the file.
    fn difference(&mut self, apart: u64) -> Result<Option<f64>> {
        if let Some(known) = self.differences.get(&apart) {
            return Ok(*known);
        }
        let (mut sum, mut count) = (0.0, 0u64);
        for (at, here) in &self.places {
            for (a, b) in here.iter().zip(self.samples.from(at + apart)?) {
                let difference = (a.to_f64() - b.to_f64()).abs();
                if difference.is_finite() {
                    sum += difference;
                    count += 1;
                }
            }
        }
        let mean = (count >= 8 * SAMPLES).then(|| sum / count as f64);
        self.differences.insert(apart, mean);
        Ok(mean)
    }

    /// The mean difference of samples far from each other.
    fn any_two(&self) -> f64 {
        let half = self.places.len() / 2;
        let pairs = self.places[..half].iter().zip(&self.places[half..]);
        let pairs = pairs.flat_map(|((_, a), (_, b))| a.iter().zip(b.iter().rev()));
        let (mut sum, mut count) = (0.0, 0u64);
        for difference in pairs.map(|(a, b)| (a.to_f64() - b.to_f64()).abs()) {
            if difference.is_finite() {
                sum += difference;
                count += 1;
            }
        }
        sum / count.max(1) as f64
    }

    /// Differences along y and z of a size.
    fn along(&mut self, [x, y, _]: [u64; 3]) -> Result<Option<[f64; 2]>> {
        let (row, slice) = (self.difference(x)?, self.difference(x * y)?);
        Ok(row.zip(slice).map(|(y, z)| [y, z]))
    }

    /// The mean difference of samples that are `apart` in the file, one before and one behind an end of `length`
    /// samples that is no end of `larger`, a multiple of it; `None` if there are none.
    fn across(&self, length: u64, larger: u64, apart: u64) -> Result<Option<f64>> {
        let ends = self.samples.volume.header().dims.voxels() / length;
        let inside = (1..ends).filter(|end| !end.is_multiple_of(larger / length));
        let few = (ends / PLACES).max(1) as usize;
        let (mut sum, mut count) = (0.0, 0u64);
        for end in inside.step_by(few) {
            let before = self.samples.from(end * length - apart)?;
            let behind = self.samples.from(end * length)?;
            for (a, b) in before.iter().zip(&behind).take(apart as usize) {
                let difference = (a.to_f64() - b.to_f64()).abs();
                if difference.is_finite() {
                    sum += difference;
                    count += 1;
                }
            }
        }
        Ok((count > 0).then(|| sum / count as f64))
    }

    /// True if samples where rows or slices of `dims` end, which would be in the middle of longer ones of `other`,
    /// differ as neighbours do there, rather than as the ones that `dims` makes neighbours.
    fn joins(&self, dims: [u64; 3], other: [u64; 3], differences: [f64; 3]) -> Result<bool> {
        let [x, y, _] = dims;
        let [along_x, along_y, along_z] = differences;
        let longer = |a: usize| other[a] > dims[a] && other[a].is_multiple_of(dims[a]);
        let (found, neighbours, given) = match (longer(0), other[0] == x && longer(1)) {
            (true, _) => (self.across(x, other[0], 1)?, along_x, along_y),
            (_, true) => (self.across(x * y, x * other[1], x)?, along_y, along_z),
            _ => return Ok(true),
        };
        Ok(found.is_none_or(|found| found <= (neighbours + given) / 2.0))
    }

    fn better(&mut self, whole: bool) -> Result<Option<Dims>> {
        let dims = self.samples.volume.header().dims.0.map(u64::from);
        let (Some(along_x), Some(given)) = (self.difference(1)?, self.along(dims)?) else {
            return Ok(None);
        };
        if given.iter().all(|d| *d <= SOUND * along_x) {
            return Ok(None);
        }
        let any = self.any_two();
        let mut best: Option<(f64, [u64; 3])> = None;
        for other in candidates(dims) {
            if other[2] != dims[2] && !whole {
                continue;
            }
            let Some(found) = self.along(other)? else {
                continue;
            };
            let same = [
                other[0] == dims[0],
                other[0] * other[1] == dims[0] * dims[1],
            ];
            let near = |a: usize| same[a] || found[a] <= NEIGHBOURS * along_x;
            // slices may be far apart: then it is rows that tell
            let far_slices = !same[0] && found[1] <= given[1];
            if !near(0) || !(near(1) || far_slices) {
                continue;
            }
            let [sum, before] = [found, given].map(|[y, z]| y + z);
            if sum < BETTER * before
                && before - sum > LESS * any
                && best.is_none_or(|(least, _)| sum < least)
                && self.joins(dims, other, [along_x, given[0], given[1]])?
            {
                best = Some((sum, other));
            }
        }
        Ok(best.and_then(|(_, dims)| Dims::new(dims).ok()))
    }
}

/// Other sizes of as many voxels: permutations, and those with slices, or rows, of the same size.
fn candidates(dims: [u64; 3]) -> BTreeSet<[u64; 3]> {
    let [x, y, z] = dims;
    let mut out: BTreeSet<[u64; 3]> =
        [[x, z, y], [y, x, z], [y, z, x], [z, x, y], [z, y, x]].into();
    let divisors = |product: u64, near: u64| {
        let range = (near / 4).max(LEAST)..=(4 * near).min(MAX_DIM.into());
        range.filter(move |n| product.is_multiple_of(*n))
    };
    out.extend(divisors(x * y, x).map(|n| [n, x * y / n, z]));
    out.extend(divisors(y * z, y).map(|n| [x, n, y * z / n]));
    out.remove(&dims);
    out.retain(|[x, y, z]| *x >= LEAST && *y >= LEAST && *z >= 2);
    out
}

impl<'a, T: Voxel> Samples<'a, T> {
    fn new(volume: &'a dyn Volume) -> Result<Self> {
        let dims = volume.header().dims;
        let few = dims.voxels() <= FEW;
        let all = few.then(|| {
            let mut all = vec![T::zeroed(); dims.voxels() as usize];
            let [x, y, z] = dims.0.map(|n| 0..n);
            let read = volume.read_box(x, y, z, bytemuck::cast_slice_mut(&mut all));
            read.map(|()| all)
        });
        Ok(Samples {
            volume,
            all: all.transpose()?,
        })
    }

    /// Up to [`SAMPLES`] samples from a place in the file on.
    fn from(&self, from: u64) -> Result<Vec<T>> {
        let dims = self.volume.header().dims;
        let end = (from + SAMPLES).min(dims.voxels());
        if let Some(all) = &self.all {
            let inside = all.get(from as usize..end as usize);
            return Ok(inside.unwrap_or_default().to_vec());
        }
        let [nx, ny, _] = dims.0.map(u64::from);
        let mut out = Vec::with_capacity(SAMPLES as usize);
        let mut at = from;
        while at < end {
            // whole rows of a slice at once, of which the ends may not be asked for
            let (slice, row) = (at / nx / ny, at / nx % ny);
            let last = (end - 1) / nx;
            let rows = row..(last + 1 - slice * ny).min(ny);
            let mut some = vec![T::zeroed(); ((rows.end - rows.start) * nx) as usize];
            let (y, z) = (rows.start as u32..rows.end as u32, slice as u32);
            let bytes = bytemuck::cast_slice_mut(&mut some);
            self.volume.read_box(0..nx as u32, y, z..z + 1, bytes)?;
            let begin = (slice * ny + rows.start) * nx;
            let until = end.min((slice * ny + rows.end) * nx);
            out.extend_from_slice(&some[(at - begin) as usize..(until - begin) as usize]);
            at = until;
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Placement;
    use crate::phantom::{Foam, Phantom, Shape, render};
    use crate::volume::{Dtype, MemoryVolume};

    /// What is found better if the samples of a volume of `dims` are taken for one of `given`.
    fn better(samples: &[u8], given: [u32; 3]) -> Option<[u32; 3]> {
        let volume = MemoryVolume::new(Dims(given), Placement::default(), samples.to_vec());
        better_dims(&volume.unwrap(), true).unwrap().map(|d| d.0)
    }

    /// A volume in memory, all of it.
    fn bytes(volume: &dyn Volume) -> Vec<u8> {
        let [x, y, z] = volume.header().dims.0.map(|n| 0..n);
        let mut out = vec![0; volume.header().dims.voxels() as usize];
        volume.read_box(x, y, z, &mut out).unwrap();
        out
    }

    fn permutations([x, y, z]: [u32; 3]) -> [[u32; 3]; 6] {
        [
            [x, y, z],
            [x, z, y],
            [y, x, z],
            [y, z, x],
            [z, x, y],
            [z, y, x],
        ]
    }

    #[test]
    fn exchanged_axes_are_found_and_right_ones_are_left_alone() {
        let dims = [90, 72, 60];
        for shape in [Shape::Foam(Foam::default()), Shape::Sphere { radius: 25.0 }] {
            let mut phantom = Phantom::new(shape);
            phantom.noise = 0.05;
            let volume = render(&phantom, Dims(dims), Dtype::U8).unwrap();
            let samples = bytes(&volume);
            for given in permutations(dims) {
                let expected = (given != dims).then_some(dims);
                assert_eq!(better(&samples, given), expected, "{given:?}");
            }
            // slices of the right size with rows of a wrong one, and slices of a wrong size
            for given in [
                [60, 108, 60],
                [45, 144, 60],
                [120, 54, 60],
                [90, 60, 72],
                [90, 48, 90],
            ] {
                assert_eq!(better(&samples, given), Some(dims), "{given:?}");
            }
        }
    }

    #[test]
    fn rows_and_slices_that_alternate_raise_no_doubt() {
        let dims = [90, 72, 60];
        for shape in [Shape::Foam(Foam::default()), Shape::Sphere { radius: 25.0 }] {
            let volume = render(&Phantom::new(shape), Dims(dims), Dtype::U8).unwrap();
            let samples = bytes(&volume);
            for (axis, length) in [90, 90 * 72].into_iter().enumerate() {
                for [from, more] in [[0, 25], [0, 255], [40, 90]] {
                    let striped = samples.iter().enumerate().map(|(i, v)| {
                        let v = from + v / 2;
                        if i / length % 2 == 1 {
                            v.saturating_add(more)
                        } else {
                            v
                        }
                    });
                    let striped: Vec<u8> = striped.collect();
                    assert_eq!(better(&striped, dims), None, "{axis} {more}");
                }
            }
        }
    }

    #[test]
    fn noise_and_slices_far_apart_raise_no_doubt() {
        let dims = [90, 72, 60];
        let volume = render(
            &Phantom::new(Shape::Noise { density: 0.5 }),
            Dims(dims),
            Dtype::U8,
        )
        .unwrap();
        let noise = bytes(&volume);
        for given in permutations(dims) {
            assert_eq!(better(&noise, given), None, "{given:?}");
        }
        let foam = render(
            &Phantom::new(Shape::Foam(Foam::default())),
            Dims([90, 72, 240]),
            Dtype::U8,
        );
        let foam = bytes(&foam.unwrap());
        for every in [4, 8, 16, 30] {
            let thin: Vec<u8> = foam
                .chunks(90 * 72)
                .step_by(every)
                .flatten()
                .copied()
                .collect();
            assert_eq!(better(&thin, [90, 72, 240 / every as u32]), None, "{every}");
        }
        assert_eq!(better(&[7; 90 * 72 * 60], dims), None);
        // too few to tell
        assert_eq!(better(&noise[..5 * 4 * 3], [5, 4, 3]), None);
    }
}
