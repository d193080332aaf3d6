//! One picture of the sample from means of slices: without what is in a few of them only, and without single pixels.

use super::slices::{Group, Raster};
use crate::volume::stats::histogram::Levels;

/// A picture, of which no pixel is NaN unless none shows anything.
#[derive(Debug, Clone)]
pub(super) struct Image {
    pub raster: Raster,
    pub pixels: Vec<f32>,
}

/// The middle of some numbers, which are sorted then; NaN without any.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => (values[n / 2 - 1] + values[n / 2]) / 2.0,
    }
}

/// Pixels that show nothing: where no sample is finite, and, if all four corners are of one value in all means, all of
/// that value, as programs fill what lies beyond the circle of a reconstruction.
fn blank(groups: &[Group], raster: Raster) -> Vec<bool> {
    let last = raster.len() - 1;
    let corners = [0, raster.width - 1, last + 1 - raster.width, last];
    let fill = groups[0].pixels[0];
    let filled = groups
        .iter()
        .all(|g| corners.iter().all(|&c| g.pixels[c] == fill));
    let nothing = |v: f32| v.is_nan() || filled && v == fill;
    (0..=last)
        .map(|i| groups.iter().all(|g| nothing(g.pixels[i])))
        .collect()
}

/// The value of what shows nothing if that is the air: if it is darker than the middle of the rest, and the rest is not
/// of two levels, as air and a sample are.
fn air(groups: &[Group], blank: &[bool]) -> Option<f32> {
    /// The share of the variance between two classes that a single level with noise does not reach: it has 0.64.
    const TWO_LEVELS: f64 = 0.75;
    let fill = groups[0].pixels[0];
    let shown = groups.iter().flat_map(|g| g.pixels.iter().zip(blank));
    let shown = shown.filter(|(v, blank)| !**blank && v.is_finite());
    let shown = shown.map(|(v, _)| f64::from(*v));
    let two = split(shown.clone()).is_some_and(|(_, share)| share >= TWO_LEVELS);
    let (sum, n) = shown.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    (blank[0] && !two && f64::from(fill) < sum / n).then_some(fill)
}

/// The values of 3 x 3 pixels around one that show something, into `found`.
fn around(raster: Raster, values: &[f32], i: usize, found: &mut Vec<f64>) {
    let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    let (x, y) = (i % raster.width, i / raster.width);
    found.clear();
    for y in near(y, raster.height) {
        let row = near(x, raster.width).map(|x| f64::from(values[x + raster.width * y]));
        found.extend(row.filter(|v| v.is_finite()));
    }
}

/// The pictures of means: the means of 3 x 3 pixels of which each is the median of 3 x 3, so that no single pixel, nor a
/// line of them, shows. What shows nothing is as dark as the air, or as the darkest of all others if that is not known.
pub(super) fn of_groups(groups: Vec<Group>, raster: Raster) -> Vec<(f64, Image)> {
    let blank = blank(&groups, raster);
    let air = air(&groups, &blank);
    let smoothed = |group: Group| (group.z, smoothed(group.pixels, raster, &blank));
    let mut images: Vec<(f64, Image)> = groups.into_iter().map(smoothed).collect();
    let seen = images.iter().flat_map(|(_, image)| &image.pixels);
    let darkest = seen.copied().fold(f32::INFINITY, f32::min);
    let dark = air.unwrap_or(darkest);
    for (_, image) in &mut images {
        let hidden = image.pixels.iter_mut().filter(|v| v.is_nan());
        hidden.for_each(|v| *v = dark);
    }
    images
}

/// A mean without single pixels; NaN where it shows nothing.
fn smoothed(mut pixels: Vec<f32>, raster: Raster, blank: &[bool]) -> Image {
    let hide = |pixels: &mut [f32]| {
        let hidden = pixels.iter_mut().zip(blank).filter(|(_, blank)| **blank);
        hidden.for_each(|(v, _)| *v = f32::NAN);
    };
    hide(&mut pixels);
    let mut found = Vec::new();
    let mut pass = |pixels: &[f32], of: fn(&mut [f64]) -> f64| -> Vec<f32> {
        let value = |i: usize| {
            around(raster, pixels, i, &mut found);
            of(&mut found) as f32
        };
        (0..pixels.len()).map(value).collect()
    };
    pixels = pass(&pixels, median);
    hide(&mut pixels);
    pixels = pass(&pixels, |v| v.iter().sum::<f64>() / v.len() as f64);
    hide(&mut pixels);
    Image { raster, pixels }
}

/// The median of pictures, pixel by pixel: what less than half of them show is not in it.
pub(super) fn middle(images: &[&Image]) -> Image {
    each_pixel(images, median)
}

/// What a quarter of pictures show at least: a rim that pores open is closed where others have none.
pub(super) fn upper(images: &[&Image]) -> Image {
    each_pixel(images, |values| {
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() - 1 - values.len() / 5]
    })
}

/// The picture that is made of pictures pixel by pixel.
fn each_pixel(images: &[&Image], of: impl Fn(&mut [f64]) -> f64) -> Image {
    let raster = images[0].raster;
    let mut values = vec![0.0; images.len()];
    let pixels = (0..raster.len()).map(|i| {
        let each = values.iter_mut().zip(images);
        each.for_each(|(v, image)| *v = f64::from(image.pixels[i]));
        of(&mut values) as f32
    });
    let pixels = pixels.collect();
    Image { raster, pixels }
}

/// Otsu's threshold of some values, and the share of their variance that lies between the two classes, 0 to 1; `None` if
/// all are the same.
pub(super) fn split(values: impl Iterator<Item = f64> + Clone) -> Option<(f64, f64)> {
    const BINS: usize = 256;
    let finite = values.filter(|v| v.is_finite());
    let low = finite.clone().reduce(f64::min)?;
    let high = finite.clone().reduce(f64::max)?;
    let width = (high - low) / BINS as f64;
    if !(width > 0.0 && width.is_finite()) {
        return None;
    }
    let mut counts = vec![0; BINS];
    let bins = finite.clone();
    bins.for_each(|v| counts[(((v - low) / width) as usize).min(BINS - 1)] += 1);
    let levels = Levels {
        low,
        width,
        exact: false,
        counts,
    };
    let threshold = levels.otsu()?;
    let moments = |above: Option<bool>| {
        let of = finite
            .clone()
            .filter(|v| above.is_none_or(|above| (*v >= threshold) == above));
        let (n, sum) = of.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        (n, sum / n)
    };
    let ((n, mean), (a, of_a), (b, of_b)) =
        (moments(None), moments(Some(true)), moments(Some(false)));
    let all: f64 = finite.map(|v| (v - mean) * (v - mean)).sum();
    let between = a * b / n * (of_a - of_b) * (of_a - of_b);
    Some((threshold, between / all))
}

impl Image {
    /// The brightness between pixels; beyond the outermost ones it is theirs.
    pub fn at(&self, [x, y]: [f64; 2]) -> f64 {
        let Raster { width, height, .. } = self.raster;
        let x = x.clamp(0.0, (width - 1) as f64);
        let y = y.clamp(0.0, (height - 1) as f64);
        let (left, top) = (x.floor() as usize, y.floor() as usize);
        let at = |dx: usize, dy: usize| {
            let (x, y) = ((left + dx).min(width - 1), (top + dy).min(height - 1));
            f64::from(self.pixels[x + width * y])
        };
        let (u, v) = (x - left as f64, y - top as f64);
        let row = |dy: usize| at(0, dy) * (1.0 - u) + at(1, dy) * u;
        row(0) * (1.0 - v) + row(1) * v
    }

    /// The place of a pixel.
    pub fn place(&self, i: usize) -> [f64; 2] {
        let width = self.raster.width;
        [(i % width) as f64, (i / width) as f64]
    }

    /// The connected parts, each as the places of its pixels, of those pixels that `is_in` tells; the largest first.
    pub fn parts(&self, is_in: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let width = self.raster.width;
        let mut open: Vec<bool> = (0..self.pixels.len()).map(is_in).collect();
        let mut parts = Vec::new();
        for start in 0..open.len() {
            if !std::mem::take(&mut open[start]) {
                continue;
            }
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
                for j in around.into_iter().flatten() {
                    if open.get_mut(j).is_some_and(std::mem::take) {
                        part.push(j);
                    }
                }
            }
            parts.push(part);
        }
        parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
        parts
    }
}
