//! What a set says of the rule by which its cells were split, held against its table of necks.
//!
//! Radii are square roots of whole numbers, levels, of which one of the neck and one of the lower peak that met there follow
//! from a row: both have to be whole, and cut by the rule. Necks at which cells were cut from each other are the edges of
//! trees, one for each component, so their number is known; and at smaller ratios than that of the set all cuts are among
//! them.

use crate::grid::Placement;
use crate::manifest::{Manifest, PartsBy};
use crate::verify::code::Code;
use crate::verify::report::Issues;
use glam::{DMat3, DVec3};

/// The ratios of a curve, in thousandths.
const CURVE: [u64; 10] = [500, 550, 600, 650, 700, 750, 800, 850, 900, 950];
/// Weight of a step along the finest axis where spacings differ, and the heaviest one.
const FINEST: f64 = 16.0;
const HEAVIEST: f64 = 4_194_304.0;
/// Steps beyond which distances are not told apart.
const REACH: u8 = 255;
/// How far from a whole number one may be that is computed from numbers of a table: levels are below 2^21, and numbers have
/// 15 digits.
const OFF_WHOLE: f64 = 1e-6;
/// Relative error of a number of a table.
const ROUNDING: f64 = 1e-11;
/// Areas, in the square of the face of a voxel, up to which it is looked at whether they are whole.
const MOST_SQUARES: f64 = 1e9;

/// Places of columns.
const RADIUS: usize = 2;
const RATIO: usize = 3;
const PLACE: usize = 4;
const AREA: usize = 7;

/// The weights of squared steps along each axis, and that of one along the finest, for voxels of this size.
fn weights(spacing: [f64; 3]) -> ([u32; 3], u32) {
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let all = spacing.map(|s| (FINEST * (s / finest) * (s / finest)).round());
    match all == [FINEST; 3] {
        true => ([1; 3], 1),
        false => (all.map(|w| w.min(HEAVIEST) as u32), FINEST as u32),
    }
}

/// Compares what the index states of a split with the grid, and with itself.
pub(in crate::verify) fn check_index(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let Some(PartsBy::Split {
        ratio_permille,
        weights: stated,
        unit,
        reach,
        curve,
        ..
    }) = &m.cells
    else {
        return;
    };
    let found = weights(m.placement.spacing);
    if (*stated, *unit) != found || *reach != REACH {
        let message = format!(
            "found {stated:?}, a unit of {unit} and a reach of {reach}, expected {:?}, {} and {REACH} for the spacing of the \
             grid",
            found.0, found.1
        );
        wrong("cells/weights", message);
    }
    if !(1..=1000).contains(ratio_permille) {
        let message = format!("found {ratio_permille}, expected 1 to 1000");
        wrong("cells/ratio_permille", message);
    }
    let ratios = curve.iter().map(|point| point[0]);
    let rises = curve.windows(2).all(|two| two[0][1] <= two[1][1]);
    if !ratios.eq(CURVE) || !rises {
        let message = format!("found {curve:?}, expected cells at {CURVE:?} that do not fall");
        wrong("cells/curve", message);
    }
}

/// The rule, and what rows have said so far.
pub(super) struct SplitRule {
    permille: u64,
    h_256: u64,
    min_radius_256: u64,
    unit: u32,
    place: Placement,
    dims: [u32; 3],
    /// From places to voxels.
    to_voxels: DMat3,
    /// Rows of cells that were cut from each other, and those of them that each ratio of the curve cuts.
    cut: u64,
    cuts: [u64; CURVE.len()],
}

impl SplitRule {
    /// `None` if cells are not those of a split, or the set is not whole.
    pub fn of(manifest: &Manifest) -> Option<Self> {
        let Some(PartsBy::Split {
            ratio_permille,
            h_256,
            min_radius_256,
            unit,
            ..
        }) = &manifest.cells
        else {
            return None;
        };
        let place = manifest.measured();
        let axis = |i: usize| DVec3::from(place.directions[i]) * place.spacing[i];
        Some(SplitRule {
            permille: (*ratio_permille).into(),
            h_256: (*h_256).into(),
            min_radius_256: (*min_radius_256).into(),
            unit: (*unit).max(1),
            dims: manifest.grid.dims.0,
            to_voxels: DMat3::from_cols(axis(0), axis(1), axis(2)).inverse(),
            place,
            cut: 0,
            cuts: [0; CURVE.len()],
        })
        .filter(|_| !manifest.is_part())
    }

    fn finest(&self) -> f64 {
        self.place.spacing.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The level of a radius in units of the tables.
    fn level(&self, radius: f64) -> f64 {
        let steps = radius / self.finest();
        f64::from(self.unit) * steps * steps
    }

    /// True if a neck of this level is cut at a ratio in thousandths, where the lower peak has this one.
    fn cuts(&self, permille: u64, level: u64, peak: u64) -> bool {
        let root = |level: u64| ((level << 16) / u64::from(self.unit)).isqrt();
        level * 1_000_000 <= permille * permille * peak
            && root(peak) - root(level) >= self.h_256
            && root(peak) >= self.min_radius_256
    }

    /// What is wrong with the numbers of a row, which are there.
    pub fn check_row(&mut self, row: &[Option<f64>]) -> Option<String> {
        let number = |at: usize| row[at].unwrap_or(f64::NAN);
        let radius = number(RADIUS);
        let Some(level) = whole(self.level(radius), radius, |level| {
            (level / f64::from(self.unit)).sqrt() * self.finest()
        }) else {
            return Some(format!(
                "found neck_radius {radius}, which is no distance of voxels"
            ));
        };
        if let Some(ratio) = row[RATIO] {
            let level_of = level as f64;
            let peak = whole(level_of / (ratio * ratio), ratio, |peak| {
                (level_of / peak).sqrt()
            });
            let is_cut = |peak: &u64| *peak >= level && self.cuts(self.permille, level, *peak);
            let Some(peak) = peak.filter(is_cut) else {
                return Some(format!(
                    "found ratio {ratio} of neck_radius {radius}, at which the rule does not cut, or no voxel has the \
                     radius of that cell"
                ));
            };
            self.cut += 1;
            let points: [bool; CURVE.len()] =
                CURVE.map(|permille| self.cuts(permille, level, peak));
            for (cuts, cut) in self.cuts.iter_mut().zip(points) {
                *cuts += u64::from(cut);
            }
        }
        let place = [0, 1, 2].map(|a| number(PLACE + a));
        let voxel = self.to_voxels * (DVec3::from(place) - DVec3::from(self.place.origin));
        let is_voxel = (0..3).all(|a| {
            let slack = OFF_WHOLE + ROUNDING * self.place.origin[a].abs() / self.finest();
            let at = voxel[a].round();
            (voxel[a] - at).abs() <= slack && (0.0..f64::from(self.dims[a])).contains(&at)
        });
        if !is_voxel {
            return Some(format!(
                "found {place:?}, where no voxel of the grid has its centre"
            ));
        }
        self.check_area(number(AREA))
    }

    /// The square of an area is whole, in that of the face of a voxel, where all faces are the same.
    fn check_area(&self, area: f64) -> Option<String> {
        let [x, y, z] = self.place.spacing;
        let square = area / (x * y) * (area / (x * y));
        let off = (square - square.round()).abs();
        let is_wrong =
            x == y && y == z && square < MOST_SQUARES && off > OFF_WHOLE.max(ROUNDING * square);
        is_wrong.then(|| format!("found neck_area {area}, which no faces of voxels have"))
    }

    /// Compares all rows with the index.
    pub fn finish(&self, manifest: &Manifest, issues: &mut Issues) {
        let totals = &manifest.totals;
        let cut = totals.components.checked_add(self.cut);
        if cut != Some(totals.cells) {
            let message = format!(
                "found {} cells that were cut from {} components in {} necks with a ratio: each gives one cell more",
                totals.cells, totals.components, self.cut
            );
            issues.add(Code::TotalsMismatch, "index.json#/totals/cells", message);
        }
        let Some(PartsBy::Split { curve, .. }) = &manifest.cells else {
            return;
        };
        for ([permille, cells], cuts) in curve.iter().zip(self.cuts) {
            let least = totals.components.saturating_add(cuts);
            let fits = match *permille <= self.permille {
                true => *cells == least,
                false => *cells >= totals.cells,
            };
            if !fits {
                let message = format!(
                    "found {cells} cells at a ratio of {permille} thousandths, the table of necks gives {least}"
                );
                issues.add(Code::ManifestValue, "index.json#/cells/curve", message);
            }
        }
    }
}

/// The whole number that a value is, up to rounding, if it is one of which `back` gives `stated` again.
fn whole(value: f64, stated: f64, back: impl Fn(f64) -> f64) -> Option<u64> {
    let near = value.round();
    let close = (value - near).abs() <= OFF_WHOLE && (1.0..f64::from(1 << 21)).contains(&near);
    let same = (back(near) - stated).abs() <= ROUNDING * stated;
    (close && same).then_some(near as u64)
}
