//! One picture of the sample from means of slices: without what is in a few of them only, and without single pixels.

use super::circle::{Circle, DIRECTIONS, direction};
use super::slices::{Picture, Raster};
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

/// What pictures of a scan do not show, and how dark it is taken to be.
#[derive(Debug, Clone)]
pub(super) struct Hidden {
    /// Of each pixel.
    is: Vec<bool>,
    dark: f32,
}

impl Hidden {
    /// Pixels where no sample is finite, and, if all four corners are of one value in all pictures, all of that value, as
    /// programs fill what lies beyond the circle of a reconstruction. They are as dark as the air.
    pub fn of(pictures: &[Picture], raster: Raster) -> Self {
        let last = raster.len() - 1;
        let corners = [0, raster.width - 1, last + 1 - raster.width, last];
        let fill = pictures[0].pixels[0];
        let filled = pictures
            .iter()
            .all(|p| corners.iter().all(|&c| p.pixels[c] == fill));
        let nothing = |v: f32| v.is_nan() || filled && v == fill;
        let is_hidden = |i: usize| pictures.iter().all(|p| nothing(p.pixels[i]));
        let is: Vec<bool> = (0..=last).map(is_hidden).collect();
        let shown = pictures.iter().flat_map(|p| p.pixels.iter().zip(&is));
        let shown = shown.filter(|(v, hidden)| !**hidden && v.is_finite());
        let shown = shown.map(|(v, _)| f64::from(*v));
        let dark = air(shown, is[0].then_some(fill), || {
            at_rim(pictures, &is, raster)
        });
        Hidden { is, dark }
    }

    /// True if a pixel is not shown.
    pub fn hides(&self, pixel: usize) -> bool {
        self.is[pixel]
    }

    /// True if what pictures do not show begins where a circle ends, nearly all around.
    pub fn begins_at(&self, raster: Raster, circle: &Circle) -> bool {
        /// Of the directions.
        const NEARLY_ALL: usize = 9 * DIRECTIONS / 10;
        let pixel = f64::from(raster.pixel);
        let is_hidden = |i: usize, way: f64| {
            let [cos, sin] = direction(i);
            let [x, y] = [circle.centre[0] + way * cos, circle.centre[1] + way * sin]
                .map(|v| (v / pixel).floor());
            let is_in = |v: f64, n: usize| v >= 0.0 && v < n as f64;
            // beyond the slices nothing is shown either
            !is_in(x, raster.width)
                || !is_in(y, raster.height)
                || self.is[y as usize * raster.width + x as usize]
        };
        let ends = |i: &usize| {
            is_hidden(*i, circle.radius + 2.0 * pixel)
                && !is_hidden(*i, circle.radius - 3.0 * pixel)
        };
        self.is[0] && (0..DIRECTIONS).filter(ends).count() >= NEARLY_ALL
    }

    /// A picture without them: the means of 3 x 3 pixels of which each is the median of 3 x 3, so that no single pixel, nor
    /// a line of them, shows.
    pub fn image(&self, mut pixels: Vec<f32>, raster: Raster) -> Image {
        let hide = |pixels: &mut [f32]| {
            let hidden = pixels.iter_mut().zip(&self.is).filter(|(_, is)| **is);
            hidden.for_each(|(v, _)| *v = f32::NAN);
        };
        let mut found = Vec::new();
        let mut pass = |pixels: &[f32], of: fn(&mut [f32]) -> f32| -> Vec<f32> {
            let value = |i: usize| {
                around(raster, pixels, i, &mut found);
                of(&mut found)
            };
            (0..pixels.len()).map(value).collect()
        };
        hide(&mut pixels);
        pixels = pass(&pixels, |v| match v.len() {
            0 => f32::NAN,
            n => *v.select_nth_unstable_by(n / 2, f32::total_cmp).1,
        });
        hide(&mut pixels);
        pixels = pass(&pixels, |v| v.iter().sum::<f32>() / v.len() as f32);
        hide(&mut pixels);
        let hidden = pixels.iter_mut().filter(|v| v.is_nan());
        hidden.for_each(|v| *v = self.dark);
        Image { raster, pixels }
    }
}

/// How dark the air is where some values are shown and the rest, if it is known, is of one value. If that is darker than the
/// middle of what is shown, and this is not of two levels, as air and a sample are, it is the air that is shown next to it
/// or, if there is none, that value; else the mean of the lower level.
fn air(
    shown: impl Iterator<Item = f64> + Clone,
    fill: Option<f32>,
    at_rim: impl Fn() -> Option<f32>,
) -> f32 {
    /// The share of the variance between two classes that a single level with noise does not reach: it has 0.64.
    const TWO_LEVELS: f64 = 0.75;
    let levels = split(shown.clone());
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        (sum / n) as f32
    };
    let all = mean(&mut shown.clone());
    let is_two = levels.is_some_and(|(_, share)| share >= TWO_LEVELS);
    match (fill.filter(|fill| !is_two && *fill < all), levels) {
        (Some(fill), _) => at_rim().unwrap_or(fill),
        (None, Some((threshold, _))) => mean(&mut { shown }.filter(|v| *v < threshold)),
        (None, None) => all,
    }
}

/// The mean of what is shown next to pixels that are hidden, if it is air there: elsewhere are pixels that are brighter than
/// any there, as of a foam with so few walls that they make no level of their own.
fn at_rim(pictures: &[Picture], hidden: &[bool], raster: Raster) -> Option<f32> {
    /// Pixels that may be of both, and how wide it is beyond these.
    const BLURRED: usize = 1;
    const WIDE: usize = 3;
    /// The share of the brightest there, which single pixels are.
    const STRAY: usize = 1000;
    /// By how much of what those are brighter than the mean the others are brighter than them, for noise is often less at a
    /// rim; and the share of all that they have at least.
    const BRIGHTER: f32 = 0.5;
    const SHARE: usize = 200;
    let grown = |mut is: Vec<bool>, by: usize| {
        for _ in 0..by {
            is = wider(&is, raster);
        }
        is
    };
    let near = grown(hidden.to_vec(), BLURRED);
    let rim = grown(near.clone(), WIDE);
    let of = |is_in: &dyn Fn(usize) -> bool| -> Vec<f32> {
        let places: Vec<usize> = (0..hidden.len()).filter(|i| is_in(*i)).collect();
        let each = pictures
            .iter()
            .flat_map(|p| places.iter().map(|i| p.pixels[*i]));
        each.filter(|v| v.is_finite()).collect()
    };
    let mut there = of(&|i| rim[i] && !near[i]);
    if there.is_empty() {
        return None;
    }
    let mean = there.iter().map(|v| f64::from(*v)).sum::<f64>() / there.len() as f64;
    let mean = mean as f32;
    let last = there.len() - 1 - there.len() / STRAY;
    let most = *there.select_nth_unstable_by(last, f32::total_cmp).1;
    let others = of(&|i| !near[i]);
    let bright = others
        .iter()
        .filter(|v| **v > most + BRIGHTER * (most - mean));
    (bright.count() * SHARE > others.len()).then_some(mean)
}

/// Some pixels and all around them.
fn wider(is: &[bool], raster: Raster) -> Vec<bool> {
    let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    let any = |i: usize| {
        let (x, y) = (i % raster.width, i / raster.width);
        near(y, raster.height)
            .any(|y| is[raster.width * y..][near(x, raster.width)].contains(&true))
    };
    (0..is.len()).map(any).collect()
}

/// The values of 3 x 3 pixels around one that show something, into `found`.
fn around(raster: Raster, values: &[f32], i: usize, found: &mut Vec<f32>) {
    let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    let (x, y) = (i % raster.width, i / raster.width);
    found.clear();
    for y in near(y, raster.height) {
        let row = &values[raster.width * y..][near(x, raster.width)];
        found.extend(row.iter().filter(|v| v.is_finite()));
    }
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
    /// The place of the middle of a pixel, in voxels.
    pub fn place(&self, i: usize) -> [f64; 2] {
        let width = self.raster.width;
        [i % width, i / width].map(|v| self.raster.voxel(v as f64))
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
