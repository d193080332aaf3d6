//! DICOM: the slices of a series in a folder, or the frames of one file.
//!
//! Slices are ordered by their place along the normal of their plane, never by name or number. Axes
//! and origin are those of the patient (x to the left, y to the back, z to the head) in millimetres,
//! kept as they are; the z axis of the grid is the normal, so nothing is mirrored. Samples are the
//! values after the rescale (Hounsfield units in CT), in the smallest type that holds them all.
//!
//! Slices that do not make a regular grid are refused with the numbers, or interpolated to one.

mod element;
mod frame;
mod jpeg;
mod jpegls;
mod order;
mod pixel;
mod resample;
mod rle;
mod series;
mod syntax;

use super::blob::Blob;
use super::layout::{Recipe, Samples};
use super::open::OpenOptions;
use super::paged::MAX_CHUNK;
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use element::Fragment;
use frame::{Cell, Image, Rescale};
use order::Stack;
use pixel::Frames;
use rayon::prelude::*;
use series::Candidate;
use std::path::Path;
use std::sync::Arc;

pub(super) use element::is_dicom;

/// Opens the volume in these files.
///
/// # Errors
/// [`Error::Usage`] with the list of series if there are several; [`Error::Unsupported`] by name for
/// irregular grids and what is not decoded, [`Error::Format`] for damaged files.
pub(super) fn parse(path: &Path, blobs: Vec<Blob>, options: &OpenOptions) -> Result<Recipe> {
    let (images, mut notes) = read(path, blobs)?;
    let (candidates, twice) = series::candidates(&images);
    if twice > 0 {
        notes.push(format!("{twice} files come twice and count once"));
    }
    let candidate = series::choose(path, candidates, options.series.as_deref())?;
    let [x, y] = candidate.size;
    let bytes = u64::from(x) * u64::from(y) * candidate.cell.bytes as u64;
    let packed = |i: &Image| i.syntax.is_packed() || i.deflated.is_some();
    if bytes > MAX_CHUNK && images.iter().any(packed) {
        let what = format!("a compressed DICOM frame of {x} x {y} pixels");
        return Err(Error::unsupported(
            path,
            what,
            "uncompress it, as with `gdcmconv --raw`",
        ));
    }
    notes.insert(0, title(&candidate));
    notes.extend(padding(&candidate, &images));
    let first = &images[candidate.frames[0].file as usize];
    let endian = first.cell.endian;
    let recipe = if candidate.frames.iter().all(|f| f.plane.is_none()) {
        unplaced(path, candidate, images, options)?
    } else {
        placed(path, candidate, images, options, &mut notes)?
    };
    Ok(Recipe {
        endian: Some(endian),
        notes,
        ..recipe
    })
}

/// Reads the headers. What has no pixels is passed by, and, if anything is left, what is not
/// supported.
fn read(path: &Path, blobs: Vec<Blob>) -> Result<(Vec<Image>, Vec<String>)> {
    let found: Vec<Result<Option<Image>>> = blobs
        .into_par_iter()
        .map(|blob| Image::read(blob, 0))
        .collect();
    let (mut images, mut passed) = (Vec::new(), Vec::new());
    for image in found {
        match image {
            Ok(None) => {}
            Ok(Some(mut image)) => {
                let file = images.len() as u32;
                image.frames.iter_mut().for_each(|f| f.file = file);
                images.push(image);
            }
            Err(error @ Error::Unsupported { .. }) => passed.push(error),
            Err(error) => return Err(error),
        }
    }
    match (images.is_empty(), passed.is_empty()) {
        (false, true) => Ok((images, Vec::new())),
        (false, false) => {
            let note = format!("{} files are passed by: {}", passed.len(), passed[0]);
            Ok((images, vec![note]))
        }
        (true, false) => Err(passed.swap_remove(0)),
        (true, true) => Err(Error::format(path, "DICOM without pixels", "slices")),
    }
}

fn title(candidate: &Candidate) -> String {
    let series = &candidate.series;
    let mut words = vec![format!("series {}", candidate.key)];
    let texts = [&series.modality, &series.description];
    words.extend(texts.into_iter().filter(|t| !t.is_empty()).cloned());
    words.join(", ")
}

/// What to know of voxels outside of the scanner's circle.
fn padding(candidate: &Candidate, images: &[Image]) -> Option<String> {
    let frame = &candidate.frames[0];
    let padding = images[frame.file as usize].padding?;
    let value = frame.rescale.value(padding as f64);
    Some(format!(
        "voxels of {value} are padding, not measured (PixelPaddingValue)"
    ))
}

/// The frames as pages.
fn frames(
    images: Vec<Image>,
    frames: Vec<frame::Frame>,
    size: [u32; 2],
    cell: Cell,
) -> Result<Frames> {
    let rescale: Vec<Rescale> = frames.iter().map(|f| f.rescale).collect();
    let fragments = images.iter().map(|image| {
        let many = image.syntax.is_packed() && image.frames.len() > 1;
        if many { split(image) } else { Ok(Vec::new()) }
    });
    let fragments = fragments.collect::<Result<_>>()?;
    Ok(Frames {
        dtype: cell.dtype(&rescale),
        images: Arc::new(images),
        frames,
        fragments,
        size,
    })
}

/// The fragments of each frame of a file of many.
fn split(image: &Image) -> Result<Vec<Vec<Fragment>>> {
    let bytes = image.blob.open()?;
    let (table, fragments) = element::fragments(&bytes, image.pixels.0)?;
    let count = image.frames.len();
    if fragments.len() == count {
        return Ok(fragments.into_iter().map(|f| vec![f]).collect());
    }
    // the table counts from the first fragment's item, which is 8 bytes before what it holds
    let base = fragments.first().map_or(0, |f| f.0 - 8);
    let mut out: Vec<Vec<Fragment>> = Vec::new();
    for fragment in &fragments {
        if table.contains(&(fragment.0 - 8 - base)) {
            out.push(Vec::new());
        }
        match out.last_mut() {
            Some(frame) => frame.push(*fragment),
            None => out.push(vec![*fragment]),
        }
    }
    if table.len() == count && out.len() == count {
        return Ok(out);
    }
    let found = format!(
        "{} fragments and a table of {}",
        fragments.len(),
        table.len()
    );
    Err(Error::format(
        image.blob.path(),
        found,
        format!("those of {count} frames"),
    ))
}

/// A series whose frames say where they lie.
fn placed(
    path: &Path,
    candidate: Candidate,
    images: Vec<Image>,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Recipe> {
    let Candidate { size, cell, .. } = candidate;
    let padding = images[candidate.frames[0].file as usize].padding;
    let mut stack = order::stack(path, candidate.frames)?;
    let provenance = Provenance {
        spacing: [Origin::File; 3],
        unit: Origin::File,
        origin: Origin::File,
    };
    let irregular = stack.irregular();
    let slices = stack.frames.len();
    let outside = stack.frames[0].rescale;
    let inner = frames(images, std::mem::take(&mut stack.frames), size, cell)?;
    let dtype = inner.dtype;
    let (dims, placement, samples): (_, _, Samples) = match irregular {
        None => {
            let dims = Dims::new([size[0].into(), size[1].into(), slices as u64]);
            (dims, stack.placement, Samples::Pages(Box::new(inner)))
        }
        Some(what) if !options.resample => {
            let what = format!("a DICOM series with {what}");
            let hint = "--resample interpolates it to a regular grid";
            return Err(Error::unsupported(path, what, hint));
        }
        Some(what) => {
            let (grid, pages) = regular(path, &stack, inner, fill(cell, outside, padding))?;
            let [x, y, z] = grid.size;
            notes.push(format!(
                "interpolated to {x} x {y} x {z} voxels, since the files have {what}"
            ));
            (grid.dims(), grid.placement, pages)
        }
    };
    let dims = dims.map_err(|e| Error::format(path, format!("a series with {e}"), "a volume"))?;
    Ok(Recipe {
        placement,
        provenance,
        ..Recipe::new("dicom", dims, dtype, samples)
    })
}

fn regular(
    path: &Path,
    stack: &Stack,
    inner: Frames,
    fill: f64,
) -> Result<(resample::Grid, Samples)> {
    let grid = resample::Grid::over(path, stack, inner.size)?;
    let pages = resample::Resampled {
        places: stack.places.clone(),
        grid: grid.clone(),
        inner,
        fill,
    };
    Ok((grid, Samples::Pages(Box::new(pages))))
}

/// The value of what lies outside of every slice: padding, else air, else the least number.
fn fill(cell: Cell, rescale: Rescale, padding: Option<i64>) -> f64 {
    match padding {
        Some(padding) => rescale.value(padding as f64),
        None if cell.signed && !cell.float => -1000.0,
        None => rescale.value(0.0),
    }
}

/// The frames of one file without places: in their order, if the size of a voxel is known.
fn unplaced(
    path: &Path,
    candidate: Candidate,
    images: Vec<Image>,
    options: &OpenOptions,
) -> Result<Recipe> {
    let Candidate {
        size,
        cell,
        frames: own,
        ..
    } = candidate;
    let (pixel, between) = (own[0].pixel, images[0].between.map(f64::abs));
    if images.len() > 1 {
        let found = "a DICOM series without positions (ImagePositionPatient)";
        return Err(Error::format(path, found, "the place of every slice")
            .with_hint("the order of its slices is unknown: convert it to TIFF or NRRD"));
    }
    let mut placement = Placement::default();
    let mut provenance = Provenance::default();
    match (pixel, between) {
        (Some([x, y]), Some(z)) if z > 0.0 => {
            placement.spacing = [x, y, z];
            placement.unit = Unit::Millimetre;
            (provenance.spacing, provenance.unit) = ([Origin::File; 3], Origin::File);
        }
        _ if options.spacing.is_some() => {}
        _ => {
            let found = "DICOM frames without positions or distance";
            let expected = "ImagePositionPatient, or PixelSpacing and SpacingBetweenSlices";
            return Err(Error::format(path, found, expected)
                .with_hint("if the frames are slices in order, give --spacing and --unit"));
        }
    }
    let slices = own.len() as u64;
    let pages = frames(images, own, size, cell)?;
    let dims = Dims::new([size[0].into(), size[1].into(), slices])
        .map_err(|e| Error::format(path, format!("frames with {e}"), "a volume"))?;
    Ok(Recipe {
        placement,
        provenance,
        ..Recipe::new("dicom", dims, pages.dtype, Samples::Pages(Box::new(pages)))
    })
}
