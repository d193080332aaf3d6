//! What the user should know of a cylinder that was found, in words.

use super::axis::Axis;
use super::extent::{Shown, Shows};
use crate::grid::Cylinder;
use std::ops::Range;

/// That there is air in the middle of it, up to this radius.
pub(super) fn of_hollow(radius: f64) -> String {
    format!(
        "around its axis the cylinder that was taken is empty, up to a radius of {radius} voxels, as an empty tube or a sample \
         with a bore is: that air counts as a pore; --roi mask:FILE of what is to count leaves it out"
    )
}

/// That something in it ends at a circle.
pub(super) fn of_inside(inside: &Cylinder) -> String {
    format!(
        "there are two round things: inside of the one that was taken the brightness, or how much of it is pores, changes at a \
         circle, as where a tube, a can, resin or a skin around a sample begins; give --roi {inside} for what is inside of it"
    )
}

/// That it may be no sample.
pub(super) fn of_view(cylinder: &Cylinder) -> String {
    format!(
        "{cylinder} ends where the scan does, whose slices are filled with one value beside it: it may be all of the round \
         field of view; if the sample is smaller, give --roi cylinder:CX,CY,R"
    )
}

/// That there is something else beside the sample.
pub(super) fn of_beside(at: [f64; 2]) -> String {
    let [x, y] = at.map(f64::round);
    format!(
        "beside the round sample there is something of a size like it that is not round, about x {x}, y {y}: the cylinder \
         leaves it out; if that is the sample, give --roi mask:FILE"
    )
}

/// That what is round in voxels is not round in the body, where these are longer along x than along y, or the other way round.
pub(super) fn of_uneven([x, y, _]: [f64; 3]) -> Option<String> {
    /// By how much of the longer side they differ at least.
    const UNEVEN: f64 = 0.01;
    ((x - y).abs() > UNEVEN * x.max(y)).then(|| {
        format!(
            "voxels are {x} long along x and {y} along y, and --roi cylinder is round in voxels: the circle of a round sample is an \
             ellipse there; give --roi mask:FILE for it"
        )
    })
}

/// That some of the slices between others with the sample are of one value.
pub(super) fn of_blank(slices: &str) -> String {
    format!(
        "about {slices} all samples are of one value, as where a part of a scan is missing: nothing of the sample is seen there, \
         and all of it counts as a pore or as material; --crop leaves it out"
    )
}

/// That the sample is not upright, by so many degrees and voxels, if it is not.
pub(super) fn of_tilt(tilt: f64, moves: f64) -> Option<String> {
    (tilt > 0.0).then(|| {
        format!(
            "the sample is tilted by {tilt:.1} degrees: the cylinder of --roi, which is upright, ends up to {moves:.1} voxels \
             inside of its rim"
        )
    })
}

/// That the sample is wider at one end, if it is.
pub(super) fn of_taper(axis: &Axis, shown: &Range<u32>) -> Option<String> {
    let [first, last] = [shown.start, shown.end - 1].map(|z| (z, axis.at(z.into()).radius));
    ((last.1 - first.1).abs() > 0.0).then(|| {
        format!(
            "the sample is tapered: its radius is {:.1} voxels in slice {} and {:.1} in slice {}; the cylinder of --roi, which \
             is the same in all slices, ends inside of the narrow end",
            first.1, first.0, last.1, last.0
        )
    })
}

/// That not all slices show the sample, if they do not.
pub(super) fn of_slices(shown: &Shown, all: &Range<u32>) -> Option<String> {
    let Range { start, end } = shown.slices;
    let what = |slices: Range<u32>, shows: &[Shows]| {
        let range = match slices.len() {
            0 => return None,
            1 => format!("slice {} shows", slices.start),
            _ => format!("slices {} to {} show", slices.start, slices.end - 1),
        };
        let kinds = [
            Shows::Brighter,
            Shows::Wider,
            Shows::Narrower,
            Shows::Elsewhere,
            Shows::Air,
            Shows::Blank,
            Shows::Sample,
        ];
        let kinds = kinds.iter().filter(|kind| shows.contains(kind));
        let kinds = kinds.map(|kind| match kind {
            Shows::Wider => "something wider, as a holder",
            Shows::Narrower => "something narrower",
            Shows::Elsewhere => "air there and something else beside it or around it",
            Shows::Brighter => "something far brighter, as a holder",
            Shows::Air => "air",
            Shows::Blank => "nothing but one value",
            Shows::Sample => "the sample again",
        });
        let kinds: Vec<&str> = kinds.collect();
        Some(format!("{range} {}", kinds.join(" or ")))
    };
    let before = what(all.start..start, &shown.before);
    let after = what(end..all.end, &shown.after);
    let others: Vec<String> = before.into_iter().chain(after).collect();
    let only = match end - start {
        1 => format!("slice {start}"),
        _ => format!("slices {start} to {}", end - 1),
    };
    (!others.is_empty()).then(|| {
        format!(
            "only {only} of {} to {} show the round sample: {}; the cylinder of --roi goes through all of them: \
             --crop :,:,{start}:{end} leaves out what is not the sample",
            all.start,
            all.end - 1,
            others.join(", ")
        )
    })
}
