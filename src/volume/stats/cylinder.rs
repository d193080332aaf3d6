//! Finds the round sample in a scan: a cylinder along z that is brighter than what is around it.
//!
//! The mean of slices from all over the volume hides pores and noise. Otsu's threshold parts the sample in it from the
//! air; its rim is where rays towards its middle first meet it, and a circle is laid through the rim by least squares
//! (I. Kasa, A circle fitting procedure and its error analysis, 1976), without what is far off. The slices of the lower and of
//! the upper half have to show the same circle.

use crate::error::{Error, Result};
use crate::grid::{Cylinder, Voxel, with_voxel_type};
use crate::progress::Progress;
use crate::volume::Volume;
use crate::volume::stats::histogram::Levels;
use std::f64::consts::TAU;

/// Slices that are read at most, half of them from either half of the volume.
const SLICES: u32 = 32;
/// Pixels along the longer side of the mean of slices at most; each stands for a square of voxels then.
const PIXELS: u32 = 1024;
/// Bytes of samples that are read at once, unless a row has more.
const SAMPLES: usize = 2 << 20;
/// Rays towards the middle.
const RAYS: usize = 720;
/// Share of the rays that have to end on one circle.
const ON_CIRCLE: f64 = 0.8;
/// How far from the circle, as a share of its radius, the rim may be, and the circles of both halves from each other.
const OFF: f64 = 0.02;
/// Voxels of the smallest radius.
const SMALLEST: f64 = 8.0;

/// The cylinder that a scan of a round sample in air shows. Its radius is a voxel less than that of the sample's rim, or
/// a pixel where the mean of slices is coarser, so that no air lies inside.
///
/// Memory: 32 bytes for a pixel of the mean of slices, and 2 MiB of samples, or a row if that is more.
///
/// # Errors
/// The volume's; [`Error::Usage`] that says why there is none; [`Error::Interrupted`].
pub fn find_cylinder(volume: &dyn Volume, progress: &dyn Progress) -> Result<Cylinder> {
    let header = volume.header();
    let (lower, upper) =
        with_voxel_type!(header.dtype, T => Ok::<_, Error>(halves::<T>(volume, progress)?))?;
    let pixel = f64::from(lower.pixel);
    let found = (|| {
        let all = lower.with(&upper);
        let blank = all.blank();
        let [a, b] = [circle(&lower, &blank)?, circle(&upper, &blank)?];
        let all = circle(&all, &blank)?;
        let apart = distance([a.x, a.y], [b.x, b.y]).max((a.radius - b.radius).abs());
        let most = (OFF * all.radius).max(1.0);
        match apart <= most {
            true => Ok(all),
            false => Err(format!(
                "one that is not upright: its axis or radius differs by {:.1} voxels from the lower half of the slices to \
                 the upper one",
                apart * pixel
            )),
        }
    })();
    let rim = found.map_err(not_found)?;
    // a pixel stands for the voxels from its first one on
    let place = |v: f64| rounded(v * pixel + (pixel - 1.0) / 2.0);
    let cylinder = Cylinder {
        centre: [place(rim.x), place(rim.y)],
        radius: rounded((rim.radius - 1.0) * pixel),
    };
    if cylinder.radius < SMALLEST {
        let found = format!("one of a radius of {} voxels", cylinder.radius);
        return Err(not_found(found));
    }
    Ok(cylinder)
}

fn not_found(found: String) -> Error {
    let expected = "a round sample along z, brighter than the air around it";
    Error::usage("--roi cylinder", found, expected)
        .with_hint("give it as --roi cylinder:CX,CY,R in voxels, or as --roi mask:FILE")
}

/// A hundredth of a voxel is more than can be seen.
fn rounded(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

/// The mean of some slices.
struct Mean {
    width: usize,
    height: usize,
    /// Voxels along the side of a pixel.
    pixel: u32,
    /// Of finite samples.
    sums: Vec<f64>,
    counts: Vec<u64>,
}

impl Mean {
    fn new([nx, ny]: [u32; 2]) -> Self {
        let pixel = nx.max(ny).div_ceil(PIXELS);
        let [width, height] = [nx, ny].map(|n| n.div_ceil(pixel) as usize);
        Mean {
            width,
            height,
            pixel,
            sums: vec![0.0; width * height],
            counts: vec![0; width * height],
        }
    }

    /// Adds a row of voxels.
    fn add<T: Voxel>(&mut self, y: u32, samples: &[T]) {
        let start = (y / self.pixel) as usize * self.width;
        let pixels = samples.chunks(self.pixel as usize).enumerate();
        for (x, samples) in pixels {
            for v in samples.iter().map(|v| v.to_f64()).filter(|v| v.is_finite()) {
                self.sums[start + x] += v;
                self.counts[start + x] += 1;
            }
        }
    }

    fn with(&self, other: &Mean) -> Mean {
        let sums = self.sums.iter().zip(&other.sums).map(|(a, b)| a + b);
        let counts = self.counts.iter().zip(&other.counts).map(|(a, b)| a + b);
        Mean {
            sums: sums.collect(),
            counts: counts.collect(),
            ..*self
        }
    }

    /// Pixels that show nothing: where no sample is finite, and, if all four corners are of one value, all of that value,
    /// as programs fill what lies beyond the circle of a reconstruction.
    fn blank(&self) -> Vec<bool> {
        let mean = |i: usize| self.sums[i] / self.counts[i] as f64;
        let last = self.sums.len() - 1;
        let corners = [0, self.width - 1, last + 1 - self.width, last].map(mean);
        let fill = corners[0];
        let filled = corners.iter().all(|c| *c == fill);
        let blank = |i: usize| self.counts[i] == 0 || filled && mean(i) == fill;
        (0..=last).map(blank).collect()
    }

    /// The means of 3 x 3 pixels, or of those that show something. What shows nothing is as dark as the darkest of the
    /// others.
    fn smooth(&self, blank: &[bool]) -> Vec<f64> {
        let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
        let mean = |i: usize| {
            let (x, y) = (i % self.width, i / self.width);
            let (mut sum, mut count) = (0.0, 0);
            for y in near(y, self.height) {
                for at in near(x, self.width).map(|x| x + self.width * y) {
                    if !blank[at] {
                        sum += self.sums[at];
                        count += self.counts[at];
                    }
                }
            }
            sum / count as f64
        };
        let mut image: Vec<f64> = (0..self.sums.len()).map(mean).collect();
        let seen = image
            .iter()
            .zip(blank)
            .filter(|(v, blank)| !**blank && v.is_finite());
        let darkest = seen.map(|(v, _)| *v).fold(f64::INFINITY, f64::min);
        let dark = image.iter_mut().zip(blank).filter(|(_, blank)| **blank);
        dark.for_each(|(v, _)| *v = darkest);
        image
    }
}

/// The means of slices from the lower and from the upper half, evenly spread.
fn halves<T: Voxel>(volume: &dyn Volume, progress: &dyn Progress) -> Result<(Mean, Mean)> {
    let [nx, ny, nz] = volume.header().dims.0;
    let mut means = [Mean::new([nx, ny]), Mean::new([nx, ny])];
    let slices = SLICES.min(nz);
    let rows = (SAMPLES / (nx as usize * size_of::<T>())).clamp(1, ny as usize);
    let mut samples = vec![T::zeroed(); nx as usize * rows];
    progress.begin("region", slices.into());
    for i in 0..slices {
        let z = ((2 * u64::from(i) + 1) * u64::from(nz) / (2 * u64::from(slices))) as u32;
        let mean = &mut means[usize::from(2 * i >= slices)];
        for y in (0..ny).step_by(rows) {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let y = y..(y + rows as u32).min(ny);
            let samples = &mut samples[..nx as usize * y.len()];
            let out = bytemuck::cast_slice_mut(samples);
            volume.read_box(0..nx, y.clone(), z..z + 1, out)?;
            let rows = samples.chunks_exact(nx as usize);
            y.zip(rows).for_each(|(y, row)| mean.add(y, row));
        }
        volume.release(z..z + 1);
        progress.advance(1);
    }
    let [lower, upper] = means;
    Ok((lower, upper))
}

/// A circle, in pixels.
#[derive(Debug, Clone, Copy)]
struct Circle {
    x: f64,
    y: f64,
    radius: f64,
}

/// The rim of the sample in a mean of slices; else what was found instead.
fn circle(mean: &Mean, blank: &[bool]) -> std::result::Result<Circle, String> {
    let image = mean.smooth(blank);
    let threshold = threshold(&image).ok_or("slices of one value")?;
    let sample = largest(&image, mean.width, threshold);
    let rim = rim(&image, mean, &sample, threshold);
    let enough = (ON_CIRCLE * RAYS as f64) as usize;
    if rim.len() < enough {
        return Err("a sample that fills the slices, or is cut off by their edges".into());
    }
    let mut points = rim.clone();
    let mut best = fit(&points).ok_or("a sample without extent")?;
    // those that are far off are pores that are open to the air, or a holder
    for _ in 0..10 {
        let near = |p: &[f64; 2]| off(&best, p).abs() <= (OFF * best.radius).max(1.0);
        points = rim.iter().copied().filter(near).collect();
        if points.len() < enough / 2 {
            break;
        }
        best = fit(&points).ok_or("a sample without extent")?;
    }
    let on = rim
        .iter()
        .filter(|p| off(&best, p).abs() <= (OFF * best.radius).max(1.0));
    if on.count() < enough {
        return Err("a sample that is not round".into());
    }
    Ok(best)
}

/// How far two points are apart.
fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// How far a point lies outside of a circle.
fn off(circle: &Circle, [x, y]: &[f64; 2]) -> f64 {
    distance([*x, *y], [circle.x, circle.y]) - circle.radius
}

/// Otsu's threshold of an image; `None` if all of it is the same.
fn threshold(image: &[f64]) -> Option<f64> {
    const BINS: usize = 256;
    let finite = || image.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (finite().reduce(f64::min)?, finite().reduce(f64::max)?);
    let width = (high - low) / BINS as f64;
    if !(width > 0.0 && width.is_finite()) {
        return None;
    }
    let mut counts = vec![0; BINS];
    finite().for_each(|v| counts[(((v - low) / width) as usize).min(BINS - 1)] += 1);
    let levels = Levels {
        low,
        width,
        exact: false,
        counts,
    };
    levels.otsu()
}

/// The pixels, by their places, of the largest connected part of those that are bright.
fn largest(image: &[f64], width: usize, threshold: f64) -> Vec<usize> {
    let mut seen: Vec<bool> = image.iter().map(|v| *v < threshold || v.is_nan()).collect();
    let mut best = Vec::new();
    for start in 0..image.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut part = vec![start];
        let mut next = 0;
        while let Some(&i) = part.get(next) {
            next += 1;
            let x = i % width;
            let around = [
                (x > 0).then(|| i.wrapping_sub(1)),
                (x + 1 < width).then_some(i + 1),
                i.checked_sub(width),
                Some(i + width),
            ];
            for j in around.into_iter().flatten().filter(|&j| j < image.len()) {
                if !seen[j] {
                    seen[j] = true;
                    part.push(j);
                }
            }
        }
        if part.len() > best.len() {
            best = part;
        }
    }
    best
}

/// Where rays from outside towards the middle of the sample first meet it, between pixels where its brightness passes the
/// threshold. A ray that meets it at the edge of the image is left out.
fn rim(image: &[f64], mean: &Mean, sample: &[usize], threshold: f64) -> Vec<[f64; 2]> {
    /// Steps to a pixel along a ray.
    const STEPS: f64 = 4.0;
    let (width, height) = (mean.width, mean.height);
    let mut is_sample = vec![false; image.len()];
    sample.iter().for_each(|&i| is_sample[i] = true);
    let n = sample.len() as f64;
    let middle_x = sample.iter().map(|i| (i % width) as f64).sum::<f64>() / n;
    let middle_y = sample.iter().map(|i| (i / width) as f64).sum::<f64>() / n;
    let longest = libm::hypot(width as f64, height as f64) * STEPS;
    let pixel = |x: f64, y: f64| {
        let inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64;
        inside.then(|| x.round() as usize + width * y.round() as usize)
    };
    let ray = |i: usize| {
        let (sin, cos) = libm::sincos(TAU * i as f64 / RAYS as f64);
        let at = |step: f64| [middle_x + cos * step / STEPS, middle_y + sin * step / STEPS];
        let is_met = |step: &u32| {
            let [x, y] = at(f64::from(*step));
            pixel(x, y).is_some_and(|i| is_sample[i])
        };
        let met = f64::from((0..longest as u32).rev().find(is_met)?);
        let value = |step: f64| sampled(image, width, height, at(step));
        // half a pixel's width on either side of where the pixels change
        let (mut inner, mut outer) = (met - STEPS, met + STEPS);
        if value(outer) >= threshold {
            return None;
        }
        for _ in 0..20 {
            let half = (inner + outer) / 2.0;
            match value(half) >= threshold {
                true => inner = half,
                false => outer = half,
            }
        }
        Some(at(inner))
    };
    (0..RAYS).filter_map(ray).collect()
}

/// The brightness between pixels; beyond the outermost ones it is theirs.
fn sampled(image: &[f64], width: usize, height: usize, [x, y]: [f64; 2]) -> f64 {
    let x = x.clamp(0.0, (width - 1) as f64);
    let y = y.clamp(0.0, (height - 1) as f64);
    let (left, top) = (x.floor() as usize, y.floor() as usize);
    let at = |dx: usize, dy: usize| {
        let (x, y) = ((left + dx).min(width - 1), (top + dy).min(height - 1));
        image[x + width * y]
    };
    let (u, v) = (x - left as f64, y - top as f64);
    let row = |dy: usize| at(0, dy) * (1.0 - u) + at(1, dy) * u;
    row(0) * (1.0 - v) + row(1) * v
}

/// The circle x^2 + y^2 + a x + b y + c = 0 with the least sum of squares at some points; `None` if they are on a line.
fn fit(points: &[[f64; 2]]) -> Option<Circle> {
    let n = points.len() as f64;
    let mean = |a: usize| points.iter().map(|p| p[a]).sum::<f64>() / n;
    let [mx, my] = [mean(0), mean(1)];
    let (mut xx, mut yy, mut xy, mut xr, mut yr, mut rr) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for [x, y] in points {
        let (x, y) = (x - mx, y - my);
        let r = x * x + y * y;
        xx += x * x;
        yy += y * y;
        xy += x * y;
        xr += x * r;
        yr += y * r;
        rr += r;
    }
    let determinant = 2.0 * (xx * yy - xy * xy);
    if determinant <= 0.0 || determinant.is_nan() {
        return None;
    }
    let x = (xr * yy - yr * xy) / determinant;
    let y = (yr * xx - xr * xy) / determinant;
    Some(Circle {
        x: x + mx,
        y: y + my,
        radius: (rr / n + x * x + y * y).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;

    /// A scan whose samples are what `of` says, with noise.
    fn scan(dims: [u32; 3], of: impl Fn([f64; 3]) -> f64) -> MemoryVolume<u16> {
        let [nx, ny, nz] = dims;
        let mut samples = Vec::new();
        let mut noise = 1u32;
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let sample = of([x, y, z].map(f64::from)) + f64::from(noise >> 24) * 8.0;
                    samples.push(sample as u16);
                }
            }
        }
        MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap()
    }

    fn round(x: f64, y: f64, [cx, cy, r]: [f64; 3]) -> f64 {
        1000.0 + 2000.0 * (r + 0.5 - libm::hypot(x - cx, y - cy)).clamp(0.0, 1.0)
    }

    #[test]
    fn a_round_sample_is_found_in_spite_of_pores_and_noise() {
        for [cx, cy, r] in [[60.3, 55.8, 40.2], [64.0, 64.0, 60.0], [30.0, 90.5, 20.0]] {
            let volume = scan([130, 128, 40], |[x, y, z]| {
                let pore = libm::sin(x / 7.0) + libm::cos(y / 5.0) + libm::sin(z / 3.0) > 0.9;
                round(x, y, [cx, cy, r]) - if pore { 900.0 } else { 0.0 }
            });
            let found = find_cylinder(&volume, &Quiet).unwrap();
            let [x, y] = found.centre;
            assert!(libm::hypot(x - cx, y - cy) < 0.4, "{found}");
            assert!((found.radius + 1.0 - r).abs() < 0.7, "{found}");
        }
    }

    #[test]
    fn what_lies_beyond_a_reconstruction_is_not_the_air() {
        let dims = [110, 110, 12];
        let sample = [55.0, 54.0, 35.0];
        let beyond = |x: f64, y: f64| libm::hypot(x - 54.5, y - 54.5) > 54.0;
        let mut volume = scan(dims, |[x, y, _]| round(x, y, sample));
        let plain = find_cylinder(&volume, &Quiet).unwrap();
        for fill in [0u16, 65_535] {
            let mut samples = Vec::new();
            let mut row = vec![0u16; 110];
            for z in 0..12 {
                for y in 0..110 {
                    let out = bytemuck::cast_slice_mut(&mut row);
                    volume.read_box(0..110, y..y + 1, z..z + 1, out).unwrap();
                    for (x, v) in row.iter_mut().enumerate() {
                        if beyond(x as f64, f64::from(y)) {
                            *v = fill;
                        }
                    }
                    samples.extend_from_slice(&row);
                }
            }
            volume = MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap();
            let found = find_cylinder(&volume, &Quiet).unwrap();
            assert!(
                (found.radius - plain.radius).abs() < 0.6,
                "{fill}: {found}, {plain}"
            );
        }
        // a pixel and a half of air on each side
        let close = scan([100, 100, 10], |[x, y, _]| round(x, y, [49.5, 49.5, 48.0]));
        let found = find_cylinder(&close, &Quiet).unwrap();
        assert!((found.radius + 1.0 - 48.0).abs() < 0.7, "{found}");
    }

    #[test]
    fn large_slices_are_seen_coarser() {
        let [cx, cy, r] = [1100.0, 1003.5, 700.0];
        let volume = scan([2100, 2060, 2], |[x, y, _]| round(x, y, [cx, cy, r]));
        let found = find_cylinder(&volume, &Quiet).unwrap();
        let [x, y] = found.centre;
        assert!(libm::hypot(x - cx, y - cy) < 1.0, "{found}");
        assert!((found.radius + 3.0 - r).abs() < 1.5, "{found}");
    }

    #[test]
    fn what_is_no_upright_round_sample_is_told() {
        let dims = [100, 100, 20];
        let square = |x: f64, y: f64| f64::max((x - 50.0).abs(), (y - 50.0).abs()) < 30.0;
        let message =
            |volume: MemoryVolume<u16>| find_cylinder(&volume, &Quiet).unwrap_err().to_string();
        let of_square = scan(dims, |[x, y, _]| if square(x, y) { 3000.0 } else { 500.0 });
        assert!(message(of_square).contains("not round"));
        let tilted = scan(dims, |[x, y, z]| round(x, y, [40.0 + z, 50.0, 25.0]));
        assert!(message(tilted).contains("not upright"));
        let cut_off = scan(dims, |[x, y, _]| round(x, y, [50.0, 50.0, 65.0]));
        assert!(message(cut_off).contains("fills the slices"));
        let same = MemoryVolume::new(Dims([20; 3]), Placement::default(), vec![7u8; 8000]);
        let of_one = find_cylinder(&same.unwrap(), &Quiet)
            .unwrap_err()
            .to_string();
        assert!(of_one.contains("of one value") && of_one.contains("cylinder:CX,CY,R"));
        let tiny = scan(dims, |[x, y, _]| round(x, y, [50.0, 50.0, 5.0]));
        assert!(message(tiny).contains("a radius of"));
    }
}
