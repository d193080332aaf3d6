//! Two tile sets of one body, cell by cell: what a load, a heat treatment or another threshold did to each cell.
//!
//! Cells are matched by the overlap of their boxes and the distance of their centroids, in the coordinates of the
//! world. A body that became shorter is laid over the other one first, see [`Align`].

mod body;
mod matching;

use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::manifest::Manifest;
use crate::table::quantile;
use body::{Body, Cell, around_objects};
use matching::{Match, match_boxes};
use serde::Serialize;
use std::path::Path;

/// How the cells of the second set are laid over those of the first before they are matched. Measures are compared as
/// they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// As they lie.
    #[default]
    None,
    /// Moved and stretched along x, y and z so that the boxes around all objects coincide: for a body that was compressed
    /// or moved as a whole.
    Box,
}

/// What is compared.
#[derive(Debug, Clone, Default)]
pub struct CompareOptions {
    /// How the second set is laid over the first.
    pub align: Align,
    /// Compare only cells for which this condition holds, and pairs for one of which it does; see [`crate::table`].
    pub condition: Option<String>,
}

/// What a pair of cells has of each measure, in the unit of the first set's tables.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Change {
    /// In the first set; absent where it has no meaning, as a sphericity at the border.
    pub a: Option<f64>,
    /// In the second.
    pub b: Option<f64>,
    /// `b / a - 1`; absent without both.
    pub change: Option<f64>,
}

/// A cell of both sets, or of one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedCell {
    /// Its id in the first set; absent if it is new.
    pub a: Option<u64>,
    /// Its id in the second set; absent if it is lost.
    pub b: Option<u64>,
    /// Overlap of the two boxes by their union, 0 to 1; absent without both.
    pub overlap: Option<f64>,
    /// Voxels times the size of one.
    pub volume: Change,
    /// Wadell's sphericity.
    pub sphericity: Change,
    /// Second semi-axis by the first.
    pub elongation: Change,
    /// Third semi-axis by the second.
    pub flatness: Change,
    /// From the centroid in the first set to that in the second, before any alignment; absent without both.
    pub shift: Option<[f64; 3]>,
    /// In either set it touches the border of the grid and may be cut by it.
    pub touches_border: bool,
}

/// Two tile sets, compared; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Unit of lengths.
    pub unit: &'static str,
    /// How the second set was laid over the first.
    pub align: Align,
    /// Cells of the first set, and of the second, for which the condition holds.
    pub cells: [u64; 2],
    /// How many of these touch the border of the grid, or of the region of interest: they may be cut by it, or the air
    /// around the sample.
    pub cells_border: [u64; 2],
    /// Cells of both.
    pub matched: u64,
    /// Cells of the first set that the second has not.
    pub lost: u64,
    /// Cells of the second set that the first has not.
    pub new: u64,
    /// The volume of all cells for which the condition holds.
    pub volume: Change,
    /// The volume of those that do not touch the border.
    pub volume_whole: Change,
    /// The volume of matched cells, in each set.
    pub volume_matched: Change,
    /// Mean and median of the change of volume of matched cells that touch the border in neither set; absent if there
    /// is none.
    pub volume_change_mean: Option<f64>,
    /// See above.
    pub volume_change_median: Option<f64>,
    /// What makes the numbers doubtful.
    pub warnings: Vec<String>,
    /// Matched cells by the id in the first set, then lost ones, then new ones.
    pub pairs: Vec<ComparedCell>,
}

/// Compares the cells of the tile set in `b` with those of the one in `a`. Memory: some 400 bytes a cell.
///
/// # Errors
/// [`Error::Usage`] for a condition that cannot be, or if one set is in voxels and the other in a unit of length;
/// [`Error::Format`] if a tile set is damaged; [`Error::Io`].
pub fn compare(a: &Path, b: &Path, options: &CompareOptions) -> Result<Comparison> {
    let manifest = Manifest::open(a)?;
    let unit = manifest.measured().unit;
    let condition = options.condition.as_deref();
    let first = Body::read(a, &manifest, unit, condition)?;
    let other = Manifest::open(b)?;
    let in_voxels = [unit, other.measured().unit].map(|unit| unit == Unit::Voxel);
    if in_voxels[0] != in_voxels[1] {
        let found = format!(
            "lengths in {} and in {}",
            unit.name(),
            other.measured().unit.name()
        );
        let expected = "two sets with a unit of length, or two without: convert the one again with --spacing and --unit";
        return Err(Error::usage("A and B", found, expected));
    }
    let second = Body::read(b, &other, unit, condition)?;
    let aligned: Vec<_> = match options.align {
        Align::None => second.cells.iter().map(|c| c.place).collect(),
        Align::Box => {
            let from = around_objects(b, &other, unit)?;
            let to = around_objects(a, &manifest, unit)?;
            let (Some(from), Some(to)) = (from, to) else {
                let expected = "two sets with objects, or no alignment";
                return Err(Error::usage(
                    "--align",
                    "box, but one of the sets has no object",
                    expected,
                ));
            };
            second
                .cells
                .iter()
                .map(|c| c.place.laid_over(from, to))
                .collect()
        }
    };
    let places: Vec<_> = first.cells.iter().map(|c| c.place).collect();
    let matches = match_boxes(&places, &aligned);
    let pairs = pairs(&first.cells, &second.cells, &matches);
    let count = |is: fn(&ComparedCell) -> bool| pairs.iter().filter(|p| is(p)).count() as u64;
    let mut comparison = Comparison {
        unit: unit.name(),
        align: options.align,
        cells: [&first, &second].map(Body::chosen),
        cells_border: [&first, &second].map(Body::at_border),
        matched: count(|p| p.a.is_some() && p.b.is_some()),
        lost: count(|p| p.b.is_none()),
        new: count(|p| p.a.is_none()),
        volume: change(Some(first.volume(false)), Some(second.volume(false))),
        volume_whole: change(Some(first.volume(true)), Some(second.volume(true))),
        volume_matched: change(None, None),
        volume_change_mean: None,
        volume_change_median: None,
        warnings: other_region(&manifest, &other).into_iter().collect(),
        pairs,
    };
    comparison.summarise();
    Ok(comparison)
}

/// What differs by less is rounding.
const NOISE: f64 = 1e-9;

/// A distance, or 0 where it is nothing but rounding beside a length.
fn exact(distance: f64, length: f64) -> f64 {
    match distance.abs() <= NOISE * length {
        true => 0.0,
        false => distance,
    }
}

/// Says so if the regions of interest of two sets differ.
fn other_region(a: &Manifest, b: &Manifest) -> Option<String> {
    let of = |m: &Manifest| m.region.as_ref().map(|r| (r.shape.clone(), r.fill));
    let text = |m: &Manifest| match &m.region {
        Some(region) => region.to_string(),
        None => "none: all of the grid".to_owned(),
    };
    (of(a) != of(b)).then(|| {
        format!(
            "the regions of interest differ: A has {}, B has {}; what one of them has no voxels of is lost or new, and cells \
             at its edge are cut",
            text(a),
            text(b)
        )
    })
}

fn change(a: Option<f64>, b: Option<f64>) -> Change {
    let change = a.zip(b).map(|(a, b)| b / a - 1.0).filter(|c| c.is_finite());
    Change { a, b, change }
}

/// Pairs by the first id, then lost and new cells by theirs.
fn pairs(a: &[Cell], b: &[Cell], matches: &[Match]) -> Vec<ComparedCell> {
    let mut lost = vec![true; a.len()];
    let mut new = vec![true; b.len()];
    let mut all = Vec::with_capacity(a.len() + b.len() - matches.len());
    for found in matches {
        (lost[found.a], new[found.b]) = (false, false);
        if !a[found.a].chosen && !b[found.b].chosen {
            continue;
        }
        all.push(compared(
            Some(&a[found.a]),
            Some(&b[found.b]),
            Some(found.overlap),
        ));
    }
    let left = |cells: &'_ [Cell], left: &[bool]| -> Vec<usize> {
        (0..cells.len())
            .filter(|&i| left[i] && cells[i].chosen)
            .collect()
    };
    all.extend(
        left(a, &lost)
            .into_iter()
            .map(|i| compared(Some(&a[i]), None, None)),
    );
    all.extend(
        left(b, &new)
            .into_iter()
            .map(|i| compared(None, Some(&b[i]), None)),
    );
    all
}

fn compared(a: Option<&Cell>, b: Option<&Cell>, overlap: Option<f64>) -> ComparedCell {
    let of = |get: fn(&Cell) -> Option<f64>| change(a.and_then(get), b.and_then(get));
    let shift = a.zip(b).map(|(a, b)| {
        let side = |i: usize| a.place.extent.max[i] - a.place.extent.min[i];
        std::array::from_fn(|i| exact(b.place.centroid[i] - a.place.centroid[i], side(i)))
    });
    ComparedCell {
        a: a.map(|c| c.id),
        b: b.map(|c| c.id),
        overlap: overlap.map(|v| (v / NOISE).round() * NOISE),
        volume: of(|c| Some(c.volume)),
        sphericity: of(|c| c.sphericity),
        elongation: of(|c| c.elongation),
        flatness: of(|c| c.flatness),
        shift,
        touches_border: [a, b].into_iter().flatten().any(|c| c.touches_border),
    }
}

/// The overlap of boxes that cells of one body have more of.
const POOR: f64 = 0.4;

impl Comparison {
    /// What else can be tried where cells do not match.
    fn hint(&self) -> &'static str {
        match self.align {
            Align::None => " If the body was moved or compressed as a whole, try --align box",
            Align::Box => "",
        }
    }

    /// The distribution of the change, and what is doubtful.
    fn summarise(&mut self) {
        let matched = self.pairs.iter().filter(|p| p.overlap.is_some());
        let of = |get: fn(&Change) -> Option<f64>| {
            let volumes = matched.clone().filter_map(|p| get(&p.volume));
            volumes.sum::<f64>() + 0.0
        };
        self.volume_matched = change(Some(of(|v| v.a)), Some(of(|v| v.b)));
        let whole = self.pairs.iter().filter(|p| !p.touches_border);
        let mut changes: Vec<f64> = whole.filter_map(|p| p.volume.change).collect();
        changes.sort_by(f64::total_cmp);
        self.volume_change_median = quantile(&changes, 0.5);
        if !changes.is_empty() {
            let n = changes.len() as f64;
            self.volume_change_mean = Some(changes.iter().sum::<f64>() / n);
        }
        for (cells, name) in self.cells.iter().zip(["A", "B"]) {
            if *cells == 0 {
                self.warnings.push(format!("no cell of {name} is compared: it has none, or none for which the condition holds"));
            }
        }
        let at_border = |all: Option<f64>, whole: Option<f64>| {
            let (Some(all), Some(whole)) = (all, whole) else {
                return false;
            };
            2.0 * whole < all
        };
        let (all, whole) = (self.volume, self.volume_whole);
        if at_border(all.a, whole.a) || at_border(all.b, whole.b) {
            self.warnings.push(
                "most of the volume of all cells is of cells at the border, such as the air around the sample: compare whole \
                 cells, or choose with --where 'not touches_border'"
                    .to_owned(),
            );
        }
        let mut overlaps: Vec<f64> = self.pairs.iter().filter_map(|p| p.overlap).collect();
        overlaps.sort_by(f64::total_cmp);
        if let Some(overlap) = quantile(&overlaps, 0.5).filter(|overlap| *overlap < POOR) {
            self.warnings.push(format!(
                "half of the matched cells overlap by less than {overlap:.2} of both together, as cells of two bodies do by \
                 chance (look at the column overlap): are these two scans of one body in the same place?{}",
                self.hint()
            ));
        }
        let most = self.cells[0].min(self.cells[1]);
        if self.matched * 2 < most {
            self.warnings.push(format!(
                "only {} of {most} cells were found again: are these two scans of one body in the same place?{}",
                self.matched,
                self.hint()
            ));
        }
    }
}
