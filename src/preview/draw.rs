//! From samples to pixels.

use super::cells::{Colours, Style};
use super::slice::Slice;
use super::zoom::Zoom;
use crate::grid::Ambiguous;
use crate::picture::{INK, Picture};

/// Colour of the contour where nothing else has a colour.
const LINE: [u8; 3] = [255, 64, 32];
/// What is outside of a region, and the region's edge.
const OUTSIDE: [u8; 3] = [214, 222, 232];
const OUTLINE: [u8; 3] = [24, 104, 208];
/// Cells without a value that means something: strips of two greys.
const HATCH: [[u8; 3]; 2] = [[176; 3], [128; 3]];
/// Pixels from one strip to the next, and those of the darker one.
const STRIP: [u32; 2] = [8, 2];

/// The place of a slice in a picture.
pub struct Canvas<'a> {
    /// The picture.
    pub picture: &'a mut Picture,
    /// Upper left pixel of the slice.
    pub corner: [u32; 2],
    /// The slice.
    pub slice: &'a Slice,
    /// How large its voxels are.
    pub zoom: Zoom,
}

/// The grey of a sample, 0 for `window[0]` and 255 for `window[1]`; a NaN is black.
fn grey(v: f64, [low, high]: [f64; 2]) -> u8 {
    let share = match high - low {
        wide if wide > 0.0 => ((v - low) / wide).clamp(0.0, 1.0),
        _ => f64::from(u8::from(v > low)),
    };
    // a NaN becomes 0
    (255.0 * share).round() as u8
}

/// A pixel of cells without a value.
pub fn hatched([x, y]: [u32; 2]) -> [u8; 3] {
    HATCH[usize::from((x + y) % STRIP[0] < STRIP[1])]
}

impl Canvas<'_> {
    /// Draws the samples in grey, and the cells in their colours.
    pub fn voxels(&mut self, window: Option<[f64; 2]>, colours: Option<&Colours>) {
        let window = window.unwrap_or([0.0, 1.0]);
        let [width, height] = self.zoom.size();
        let columns: Vec<u32> = (0..width).map(|u| self.zoom.voxel(0, u)).collect();
        for v in 0..height {
            let y = self.zoom.voxel(1, v);
            for (u, &x) in (0..width).zip(&columns) {
                let pixel = match colours.map_or(Style::Sample, |c| c.at([x, y])) {
                    Style::Sample => [grey(self.slice.value([x, y]), window); 3],
                    Style::Colour(colour) => colour,
                    Style::NoValue => hatched([u, v]),
                };
                self.picture
                    .set([self.corner[0] + u, self.corner[1] + v], pixel);
            }
        }
    }

    /// Makes pale what is outside of a region, whose voxels are 1 in `inside`.
    pub fn pale(&mut self, inside: &Slice) {
        let [width, height] = self.zoom.size();
        for v in 0..height {
            let y = self.zoom.voxel(1, v);
            for u in 0..width {
                if inside.value([self.zoom.voxel(0, u), y]) == 0.0 {
                    let at = [self.corner[0] + u, self.corner[1] + v].map(i64::from);
                    self.picture.blend(at, OUTSIDE, 0.75);
                }
            }
        }
    }

    /// The edge of a region, whose voxels are 1 in the slice and others 0.
    pub fn outline(&mut self) {
        const EDGE: f64 = 0.5;
        match self.zoom.finer() < 2.0 {
            true => self.rim(EDGE, |_, _| Some(OUTLINE)),
            false => self.lines(EDGE, Ambiguous::Separate, 1.0, |_| Some(OUTLINE)),
        }
    }

    /// The contour of a threshold, through the points where it crosses between voxels, as the surface of the tiles
    /// does. Beside colours it is dark with a light rim, which shows on all of them.
    pub fn contour(&mut self, t: f64, rule: Ambiguous, beside_colours: bool) {
        let finer = self.zoom.finer();
        if finer < 2.0 {
            let colour = if beside_colours { INK } else { LINE };
            return self.rim(t, |_, _| Some(colour));
        }
        let radius = (finer / 8.0).clamp(0.6, 1.25);
        if beside_colours {
            let light = radius + (finer / 6.0).clamp(0.5, 1.25);
            self.lines(t, rule, light, |_| Some([255; 3]));
            self.lines(t, rule, radius, |_| Some(INK));
        } else {
            self.lines(t, rule, radius, |_| Some(LINE));
        }
    }

    /// The contour of a threshold where a surface lies that has a colour, in that colour.
    pub fn outlines(&mut self, t: f64, rule: Ambiguous, colours: &Colours) {
        let colour = |style| match style {
            Style::Sample => None,
            Style::Colour(colour) => Some(colour),
            Style::NoValue => Some(HATCH[0]),
        };
        let finer = self.zoom.finer();
        if finer < 2.0 {
            let between = |at, beside| colour(colours.between([at, beside]));
            return self.rim(t, between);
        }
        let radius = (finer / 5.0).clamp(0.9, 2.5);
        self.lines(t, rule, radius, |ends| colour(colours.between(ends)));
    }

    /// The contour, `radius` pixels wide to both sides, in the colours that edges have which it crosses.
    fn lines(
        &mut self,
        t: f64,
        rule: Ambiguous,
        radius: f64,
        colour: impl Fn([[u32; 2]; 2]) -> Option<[u8; 3]>,
    ) {
        let [width, height] = self.slice.size;
        for y in 0..height.saturating_sub(1) {
            for x in 0..width.saturating_sub(1) {
                let corners = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
                for edges in segments(corners.map(|c| self.slice.above(c, t)), rule) {
                    let ends = edges.map(|edge| [corners[edge], corners[(edge + 1) % 4]]);
                    let Some(colour) = colour(ends[0]) else {
                        continue;
                    };
                    let line = ends.map(|e| self.zoom.point(crossing(self.slice, e, t)));
                    self.line(line, radius, colour);
                }
            }
        }
    }

    /// A line between two points in pixels of the slice, with round ends and smooth edges.
    fn line(&mut self, [a, b]: [[f64; 2]; 2], radius: f64, colour: [u8; 3]) {
        let along = [b[0] - a[0], b[1] - a[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        let size = self.zoom.size();
        let range = |i: usize| {
            let low = (a[i].min(b[i]) - radius - 1.0).max(0.0) as u32;
            let high = (a[i].max(b[i]) + radius + 1.0) as u32;
            low..=high.min(size[i] - 1)
        };
        for v in range(1) {
            for u in range(0) {
                let from = [f64::from(u) + 0.5 - a[0], f64::from(v) + 0.5 - a[1]];
                let share = match squared > 0.0 {
                    true => ((from[0] * along[0] + from[1] * along[1]) / squared).clamp(0.0, 1.0),
                    false => 0.0,
                };
                let off = [from[0] - share * along[0], from[1] - share * along[1]];
                let distance = (off[0] * off[0] + off[1] * off[1]).sqrt();
                let cover = (radius + 0.5 - distance).clamp(0.0, 1.0);
                if cover > 0.0 {
                    let at = [self.corner[0] + u, self.corner[1] + v].map(i64::from);
                    self.picture.blend(at, colour, cover);
                }
            }
        }
    }

    /// Without room between voxels: the above voxels that have a below neighbour, in the colour that such a pair has.
    fn rim(&mut self, t: f64, colour: impl Fn([u32; 2], [u32; 2]) -> Option<[u8; 3]>) {
        let [width, height] = self.slice.size;
        let [across, down] = self.zoom.size();
        for v in 0..down {
            let y = self.zoom.voxel(1, v);
            for u in 0..across {
                let x = self.zoom.voxel(0, u);
                let beside = [
                    [x.wrapping_sub(1), y],
                    [x + 1, y],
                    [x, y.wrapping_sub(1)],
                    [x, y + 1],
                ];
                if !self.slice.above([x, y], t) {
                    continue;
                }
                let below =
                    |n: &[u32; 2]| n[0] < width && n[1] < height && !self.slice.above(*n, t);
                let mut pairs = beside.iter().filter(|n| below(n));
                if let Some(pixel) = pairs.find_map(|n| colour([x, y], *n)) {
                    self.picture
                        .set([self.corner[0] + u, self.corner[1] + v], pixel);
                }
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

    #[test]
    fn samples_become_grey() {
        assert_eq!(grey(5.0, [0.0, 10.0]), 128);
        assert_eq!(grey(f64::NAN, [0.0, 10.0]), 0);
        assert_eq!((grey(3.0, [3.0; 2]), grey(4.0, [3.0; 2])), (0, 255));
    }
}
