//! From samples to pixels.

use super::cells::Colours;
use super::slice::Slice;
use crate::grid::Ambiguous;
use crate::picture::Picture;

/// Colour of the contour.
const LINE: [u8; 3] = [255, 64, 32];
/// Share of a cell's colour in its pixels; the rest is the grey value.
const TINT: f64 = 0.7;

/// Grey values, with the cells in their colours.
pub fn grey(
    slice: &Slice,
    window: Option<[f64; 2]>,
    colours: Option<&Colours>,
    scale: u32,
) -> Picture {
    let mut picture = Picture::new(slice.size.map(|n| n * scale), [0; 3]);
    let [low, high] = window.unwrap_or([0.0, 1.0]);
    for y in 0..slice.size[1] {
        for x in 0..slice.size[0] {
            let v = slice.value([x, y]);
            let share = match high - low {
                // a NaN compares false and is black
                wide if wide > 0.0 => ((v - low) / wide).clamp(0.0, 1.0),
                _ => f64::from(u8::from(v > low)),
            };
            let grey = if share.is_nan() { 0.0 } else { 255.0 * share };
            let pixel = match colours.and_then(|c| c.at([x, y])) {
                Some(colour) => colour.map(|c| TINT * f64::from(c) + (1.0 - TINT) * grey),
                None => [grey; 3],
            };
            let pixel = pixel.map(|v| v.round() as u8);
            for v in y * scale..(y + 1) * scale {
                for u in x * scale..(x + 1) * scale {
                    picture.set([u, v], pixel);
                }
            }
        }
    }
    picture
}

/// The contour of a threshold, through the points where it crosses between voxels, as the surface
/// of the tiles does.
pub fn contour(picture: &mut Picture, slice: &Slice, (t, rule): (f64, Ambiguous), scale: u32) {
    if scale == 1 {
        return rim(picture, slice, t);
    }
    for y in 0..slice.size[1].saturating_sub(1) {
        for x in 0..slice.size[0].saturating_sub(1) {
            let corners = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
            for [a, b] in segments(corners.map(|c| slice.above(c, t)), rule) {
                let [a, b] = [a, b].map(|edge| {
                    crossing(slice, [corners[edge], corners[(edge + 1) % 4]], t)
                        .map(|v| (v + 0.5) * f64::from(scale))
                });
                line(picture, a, b, u32::from(scale >= 4));
            }
        }
    }
}

/// The lines of a square by its edges: edge i runs from corner i to the next. On an ambiguous square
/// the rule separates the above corners, or joins them.
fn segments(above: [bool; 4], rule: Ambiguous) -> Vec<[usize; 2]> {
    let crossed: Vec<usize> = (0..4).filter(|&i| above[i] != above[(i + 1) % 4]).collect();
    match crossed[..] {
        [a, b] => vec![[a, b]],
        [..] if crossed.len() == 4 => {
            // the lines cut off corners 0 and 2, or 1 and 3
            if above[0] == (rule == Ambiguous::Separate) {
                vec![[3, 0], [1, 2]]
            } else {
                vec![[0, 1], [2, 3]]
            }
        }
        _ => Vec::new(),
    }
}

/// Where the threshold crosses between two voxels.
fn crossing(slice: &Slice, [a, b]: [[u32; 2]; 2], t: f64) -> [f64; 2] {
    let (va, vb) = (slice.value(a), slice.value(b));
    let share = (t - va) / (vb - va);
    let share = if share.is_finite() {
        share.clamp(0.0, 1.0)
    } else {
        0.5
    };
    std::array::from_fn(|i| f64::from(a[i]) + share * (f64::from(b[i]) - f64::from(a[i])))
}

/// A line of pixels, and as many beside it.
fn line(picture: &mut Picture, a: [f64; 2], b: [f64; 2], beside: u32) {
    let steps = (2.0 * (b[0] - a[0]).abs().max((b[1] - a[1]).abs()))
        .ceil()
        .max(1.0);
    for step in 0..=steps as u32 {
        let share = f64::from(step) / steps;
        let at = |i: usize| (a[i] + share * (b[i] - a[i])) as u32;
        for v in 0..=beside {
            for u in 0..=beside {
                picture.set([at(0) + u, at(1) + v], LINE);
            }
        }
    }
}

/// Without room between voxels: the above voxels that have a below neighbour.
fn rim(picture: &mut Picture, slice: &Slice, t: f64) {
    let [width, height] = slice.size;
    for y in 0..height {
        for x in 0..width {
            let beside = [
                [x.wrapping_sub(1), y],
                [x + 1, y],
                [x, y.wrapping_sub(1)],
                [x, y + 1],
            ];
            let below = |n: &[u32; 2]| n[0] < width && n[1] < height && !slice.above(*n, t);
            if slice.above([x, y], t) && beside.iter().any(below) {
                picture.set([x, y], LINE);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ambiguous_squares_follow_the_rule() {
        let diagonal = [true, false, true, false];
        assert_eq!(segments(diagonal, Ambiguous::Separate), [[3, 0], [1, 2]]);
        assert_eq!(segments(diagonal, Ambiguous::Join), [[0, 1], [2, 3]]);
        let other = [false, true, false, true];
        assert_eq!(segments(other, Ambiguous::Separate), [[0, 1], [2, 3]]);
        assert_eq!(
            segments([true, true, false, false], Ambiguous::Join),
            [[1, 3]]
        );
        assert!(segments([true; 4], Ambiguous::Join).is_empty());
    }
}
