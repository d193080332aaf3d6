//! Spacing, unit and the number of images: what ImageJ and OME write into ImageDescription, and
//! TIFF's own resolution.
//!
//! ImageJ's `key=value` lines are those of `ij.io.TiffEncoder` and `FileSaver`
//! (<https://github.com/imagej/ImageJ>): `spacing` is left out where it is 1. OME's attributes are
//! those of <https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/>.

use super::ifd::Directory;
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::manifest::{Origin, Provenance};
use std::path::Path;

/// What the first page says of the whole stack.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Stack {
    /// Number of images, where ImageJ states it.
    pub(super) images: Option<u64>,
    pub(super) placement: Placement,
    pub(super) provenance: Provenance,
    pub(super) notes: Vec<String>,
}

/// Reads the description and the resolution of the first page.
///
/// # Errors
/// [`Error::Unsupported`] for stacks with several channels or times.
pub(super) fn stack(path: &Path, dir: &Directory) -> Result<Stack> {
    let text = dir.text(270)?;
    let resolution = [dir.fraction(282)?, dir.fraction(283)?];
    let mut stack = Stack::default();
    if text.starts_with("ImageJ=") {
        imagej(path, &text, resolution, &mut stack)?;
    } else if let Some(pixels) = text.find("<Pixels").map(|at| &text[at..]) {
        let pixels = pixels.split('>').next().unwrap_or_default();
        ome(path, pixels, &mut stack)?;
    } else if text.starts_with('{') && text.contains("\"truncated\": true") {
        let hint = "write it with `imagej=True` or `metadata=None`";
        return Err(Error::unsupported(
            path,
            "a truncated tifffile series",
            hint,
        ));
    }
    if stack.provenance.spacing == [Origin::Default; 3] && !text.starts_with("ImageJ=") {
        baseline(dir.number(296, 2)?, resolution, &mut stack);
    }
    if dir.number(262, 1)? == 0 {
        let note =
            "0 is white in this TIFF (WhiteIsZero): values are as they are stored, not inverted";
        stack.notes.push(note.into());
    }
    Ok(stack)
}

fn only_slices(path: &Path, channels: u64, frames: u64) -> Result<()> {
    if channels.max(1) == 1 && frames.max(1) == 1 {
        return Ok(());
    }
    let what = format!("a stack of {channels} channels and {frames} times");
    Err(Error::unsupported(
        path,
        what,
        "save one channel and time as a stack of slices",
    ))
}

fn imagej(path: &Path, text: &str, resolution: [Option<f64>; 2], stack: &mut Stack) -> Result<()> {
    let get = |key: &str| {
        let mut lines = text.lines();
        lines.find_map(|line| line.trim().strip_prefix(key)?.strip_prefix('='))
    };
    let whole = |key| get(key).and_then(|v| v.trim().parse::<u64>().ok());
    let (slices, frames) = (whole("slices").unwrap_or(1), whole("frames").unwrap_or(1));
    // a movie of one slice is a stack that was opened as a sequence of times
    let frames = if slices == 1 { 1 } else { frames };
    only_slices(path, whole("channels").unwrap_or(1), frames)?;
    stack.images = whole("images");
    let depth = get("spacing").and_then(|v| v.trim().parse::<f64>().ok());
    let depth = depth.map(f64::abs).filter(|d| *d > 0.0 && d.is_finite());
    let unit = get("unit").and_then(imagej_unit);
    let pixel = pixel(resolution);
    match (unit, pixel) {
        (Some(unit), Some([x, y])) => {
            stack.placement.unit = unit;
            // 1 is the value that ImageJ does not write
            stack.placement.spacing = [x, y, depth.unwrap_or(1.0)];
            stack.provenance.unit = Origin::File;
            stack.provenance.spacing = [Origin::File; 3];
        }
        _ => {
            if let Some(depth) = depth.filter(|_| get("unit").is_none_or(is_pixel)) {
                stack.placement.spacing[2] = depth;
                stack.provenance.spacing = [Origin::File; 3];
            }
        }
    }
    Ok(())
}

fn is_pixel(unit: &str) -> bool {
    matches!(unit.parse(), Ok(Unit::Voxel))
}

/// ImageJ's unit, which may have the micro sign as an escape. Inches are the resolution of a screen
/// or printer that some program put in, never that of a scan, and are ignored.
fn imagej_unit(text: &str) -> Option<Unit> {
    let text = text.trim().replace("\\u00B5", "u").replace("\\u00b5", "u");
    text.parse().ok().filter(|unit| *unit != Unit::Voxel)
}

/// Size of a pixel from pixels per unit.
fn pixel(resolution: [Option<f64>; 2]) -> Option<[f64; 2]> {
    let [Some(x), Some(y)] = resolution.map(|r| r.filter(|r| *r > 0.0)) else {
        return None;
    };
    Some([1.0 / x, 1.0 / y])
}

/// TIFF's own resolution: pixels per centimetre (3) or inch (2), given in millimetres. It has no
/// distance of slices: that of the pixels is taken, if they are square.
fn baseline(unit: u64, resolution: [Option<f64>; 2], stack: &mut Stack) {
    let (Some([x, y]), [Some(per_unit), _]) = (pixel(resolution), resolution) else {
        return;
    };
    let scale = match unit {
        2 => 25.4,
        3 => 10.0,
        _ => return,
    };
    // what screens and printers have is put in by programs that know nothing of the scan
    let per_inch = per_unit * 25.4 / scale;
    let of_paper = |dpi: f64| (per_inch - dpi).abs() < 0.002 * dpi;
    let paper = [
        1.0, 72.0, 75.0, 90.0, 96.0, 100.0, 120.0, 150.0, 200.0, 300.0, 400.0, 600.0,
    ];
    let paper = paper
        .into_iter()
        .chain([720.0, 1200.0, 1440.0, 2400.0])
        .any(of_paper);
    if paper || per_unit == 1.0 || (x - y).abs() > 1e-6 * x {
        return;
    }
    stack.placement.unit = Unit::Millimetre;
    stack.placement.spacing = [x * scale, y * scale, x * scale];
    stack.provenance.unit = Origin::File;
    stack.provenance.spacing = [Origin::File; 3];
}

fn ome(path: &Path, pixels: &str, stack: &mut Stack) -> Result<()> {
    let get = |key: &str| {
        let at = pixels.find(&format!(" {key}=\""))?;
        pixels[at + key.len() + 3..].split('"').next()
    };
    let whole = |key| get(key).and_then(|v| v.parse::<u64>().ok()).unwrap_or(1);
    only_slices(path, whole("SizeC"), whole("SizeT"))?;
    let size = |axis| {
        let value = get(&format!("PhysicalSize{axis}"))?.parse::<f64>().ok()?;
        let unit = match get(&format!("PhysicalSize{axis}Unit")) {
            Some(unit) => unit.parse().ok()?,
            None => Unit::Micrometre,
        };
        (value > 0.0 && value.is_finite()).then_some((value, unit))
    };
    if let (Some((x, ux)), Some((y, uy)), Some((z, uz))) = (size("X"), size("Y"), size("Z"))
        && ux == uy
        && ux == uz
    {
        stack.placement.spacing = [x, y, z];
        stack.placement.unit = ux;
        stack.provenance.spacing = [Origin::File; 3];
        stack.provenance.unit = Origin::File;
    }
    Ok(())
}
