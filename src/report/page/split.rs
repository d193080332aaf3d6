//! How cells were split.

use super::super::{CurvePoint, SplitCells};
use super::rows;
use crate::words::{count, exact, things};
use maud::{Markup, html};

/// What the cells are that were split, and how many other ratios give.
pub fn section(split: &SplitCells) -> Markup {
    let line = |point: &CurvePoint| {
        let mark = if point.ratio == split.ratio {
            "these tiles"
        } else {
            ""
        };
        vec![
            format!("{:.2}", point.ratio),
            count(point.cells),
            mark.to_owned(),
        ]
    };
    let lines: Vec<Vec<String>> = split.split_curve.iter().map(line).collect();
    html! {
        h2 { "Split" }
        p {
            (things(split.cells, "cell")) " of " (things(split.components, "connected component")) ": cut where the radius of an "
            "opening is at most " (exact(split.ratio)) " of that of the smaller cell, not where it falls by less than h = " (exact(split.h))
            " or where the smaller radius is less than " (exact(split.min_radius)) ", both in voxels of the finest axis."
        }
        @if !lines.is_empty() {
            p { "Other ratios give so many cells. With clear necks their number hardly depends on it." }
            (rows(&["ratio", "cells", ""], &lines))
        }
    }
}
