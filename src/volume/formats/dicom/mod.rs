//! DICOM: the slices of a series in a folder, or the frames of one file.
//!
//! Slices are ordered by their place along the normal of their plane, never by name or number. Axes
//! and origin are those of the patient (x to the left, y to the back, z to the head) in millimetres,
//! kept as they are; the z axis of the grid is the normal, so nothing is mirrored. Samples are the
//! values after the rescale (Hounsfield units in CT) or the mapping to real-world values, in the smallest type that
//! holds them all.
//!
//! Slices that do not make a regular grid are refused with the numbers, or interpolated to one. Frames of one file
//! that share a position are slices in their order; files without positions are so by their InstanceNumber, if the
//! user gives the spacing.

mod agree;
mod cell;
mod element;
mod frame;
mod jpeg;
mod jpegls;
mod order;
mod pixel;
mod rle;
mod scale;
mod series;
mod syntax;
mod tag;
mod unplaced;

use crate::error::{Error, Result};
use crate::grid::{Dims, Frame, Origin, Provenance};
use crate::volume::adapters::resample::{Grid, SlicePlaces};
use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, Slices, Unread};
use crate::volume::formats::optional;
use crate::volume::io::blob::Blob;
use crate::volume::io::paged::MAX_CHUNK;
use crate::volume::options::OpenOptions;
use crate::volume::stated::warning::Warning;
use crate::words::counted;
use cell::Cell;
use element::Fragment;
use frame::{Found, Image, Rescale, Step};
use pixel::Frames;
use rayon::prelude::*;
use series::Candidate;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use unplaced::{in_time, no_distance, unplaced};

/// The format.
pub(crate) const FORMAT: Format = Format {
    starts: element::is_dicom,
    parse: Some(|input, options| {
        let file = Blob::file(input.path)?;
        parse(input.path, vec![file], Vec::new(), options)
    }),
    slices: Some(Slices {
        parse,
        is_single: |_| Ok(false),
        placed: true,
    }),
    ..optional::dicom::FORMAT
};

/// Opens the volume in these files; `unread` lies beside them under names of slices.
///
/// # Errors
/// [`Error::Usage`] with the list of series if there are several; [`Error::Unsupported`] by name for
/// irregular grids and what is not decoded, [`Error::Format`] for damaged files, and for what is no slice where the
/// slices lie.
pub(crate) fn parse(
    path: &Path,
    blobs: Vec<Blob>,
    unread: Vec<Unread>,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let (images, mut notes) = read(path, blobs)?;
    let (candidates, twice) = series::candidates(&images);
    notes.extend(twice.note());
    let total: usize = candidates.iter().map(|c| c.frames.len()).sum();
    let wanted = options.series.as_deref();
    let candidate = match series::choose(path, candidates, &images, wanted) {
        Err(error @ Error::Format { .. }) => {
            return Err(unread.first().map_or(error, Unread::error));
        }
        other => other?,
    };
    notes.extend(beside(&candidate, &images, &unread)?);
    let others = total - candidate.frames.len();
    let left_out = agree::left_out(&candidate.frames[0], &candidate.frames, &images);
    if wanted != Some(&candidate.key) {
        agree::none_is_lost(&candidate, &left_out)?;
    }
    agree::values(&candidate, &images)?;
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
    if others > 0 {
        notes.push(format!(
            "{} left out, of another series, size, orientation or kind of numbers{}",
            counted(others as u64, "other image is", "other images are"),
            agree::note(&left_out).unwrap_or_default()
        ));
    }
    notes.extend(padding(&candidate, &images));
    let remark = candidate.frames.iter().find_map(|frame| frame.remark);
    notes.extend(remark.map(String::from));
    let first = &images[candidate.frames[0].file as usize];
    let endian = first.cell.endian;
    let descriptor = if without_places(&candidate, options) {
        unplaced(path, candidate, images, options)?
    } else {
        placed(path, candidate, images, options, &mut notes)?
    };
    Ok(VolumeDescriptor {
        endian: Some(endian),
        notes,
        ..descriptor
    })
}

/// True if no position tells the order of slices: there are none, or all have the same and the user says how far slices
/// lie apart.
fn without_places(candidate: &Candidate, options: &OpenOptions) -> bool {
    let first = &candidate.frames[0];
    let same = candidate.frames.iter().all(|f| f.plane == first.plane);
    first.plane.is_none() || (same && options.spacing.is_some())
}

/// How values follow from the stored numbers of frames, where the files state a scale.
fn applied(frames: &[frame::Frame]) -> Option<String> {
    let by = frames
        .iter()
        .map(|f| f.scaled_by)
        .find(|by| !by.is_empty())?;
    let mut all = frames.iter().map(|f| Linear {
        slope: f.rescale.slope,
        intercept: f.rescale.intercept,
    });
    let first = all.next()?;
    let values = Values {
        scale: match all.clone().all(|other| other == first) {
            true => Scale::All(first),
            false => Scale::Slices {
                axis: 2,
                all: [first].into_iter().chain(all).collect(),
            },
        },
        nothing: Vec::new(),
        valid: None,
        stated_by: by.into(),
    };
    Some(values.to_string())
}

/// Reads the headers. What has no pixels is passed by, and, if anything is left, what is not
/// supported.
fn read(path: &Path, blobs: Vec<Blob>) -> Result<(Vec<Image>, Vec<String>)> {
    let found: Vec<Result<Found>> = blobs
        .into_par_iter()
        .map(|blob| Image::read(blob, 0))
        .collect();
    let (mut images, mut passed, mut bare) = (Vec::<Image>::new(), Vec::new(), Vec::new());
    for image in found {
        match image {
            Ok(Found::NoPixels { path, class }) => bare.push((path, class)),
            Ok(Found::Image(mut image)) => {
                let file = images.len() as u32;
                image.frames.iter_mut().for_each(|f| f.file = file);
                images.push(*image);
            }
            Err(error @ Error::Unsupported { .. }) => passed.push(error),
            Err(error) => return Err(error),
        }
    }
    let mut notes = without_pixels(&images, bare)?;
    match (images.is_empty(), passed.is_empty()) {
        (false, true) => Ok((images, notes)),
        (false, false) => {
            let files = counted(passed.len() as u64, "file is", "files are");
            notes.push(format!("{files} passed by: {}", passed[0]));
            Ok((images, notes))
        }
        (true, false) => Err(passed.swap_remove(0)),
        (true, true) => Err(Error::format(path, "DICOM without pixels", "slices")),
    }
}

/// Refuses files without pixels that are of the kind of the images, or of none: they are cut short. Others, as reports,
/// are a note.
fn without_pixels(images: &[Image], bare: Vec<(PathBuf, String)>) -> Result<Vec<String>> {
    let kinds: BTreeSet<&str> = images.iter().map(|i| i.class.as_str()).collect();
    let cut = |(_, class): &&(PathBuf, String)| class.is_empty() || kinds.contains(class.as_str());
    if let Some((path, _)) = bare.iter().find(cut).filter(|_| !images.is_empty()) {
        return Err(
            Error::format(path, "DICOM without pixels", "a slice, as beside it").with_hint(
                "the file is cut short or damaged: replace it, or take it out of the folder if it is no slice",
            ),
        );
    }
    let note = bare.first().map(|(path, _)| {
        let files = counted(
            bare.len() as u64,
            "file of DICOM without pixels is",
            "files of DICOM without pixels are",
        );
        format!("{files} passed by, as {}", path.display())
    });
    Ok(note.into_iter().collect())
}

/// Refuses what is no slice in the folders of the slices; elsewhere it is a note.
fn beside(candidate: &Candidate, images: &[Image], unread: &[Unread]) -> Result<Vec<String>> {
    let files = candidate
        .frames
        .iter()
        .map(|f| images[f.file as usize].blob.path());
    let folders: HashSet<_> = files.map(Path::parent).collect();
    match unread.iter().find(|u| folders.contains(&u.path.parent())) {
        Some(unread) => Err(unread.error()),
        None => Ok(unread.iter().take(5).map(Unread::note).collect()),
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
    let ends = images[frame.file as usize].padding?;
    let [first, last] = ends.map(|v| frame.rescale.value(v as f64));
    let which = match first == last {
        true => format!("{first}"),
        false => format!("{first} to {last}"),
    };
    Some(format!(
        "voxels of {which} are padding: the scanner measured nothing there, and they keep that value (PixelPaddingValue)"
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
) -> Result<VolumeDescriptor> {
    let Candidate { size, cell, .. } = candidate;
    let image = &images[candidate.frames[0].file as usize];
    let (padding, step) = (image.padding, image.step);
    let in_time = in_time(image, options)?;
    let mut stack = order::stack(path, candidate.frames, &images, options.spacing)?;
    let mut provenance = Provenance {
        spacing: [Origin::File; 3],
        unit: Origin::File,
        origin: Origin::File,
        frame: Frame::Lps,
    };
    notes.extend(stack.note());
    let mut warnings: Vec<Warning> = in_time.into_iter().collect();
    match step {
        _ if options.spacing.is_some() => {}
        Step::Stated => {}
        Step::Thickness(thick) => {
            provenance.spacing[2] = Origin::Assumed;
            warnings.push(thickness(thick));
        }
        Step::Unknown => return Err(no_distance(path)),
    }
    let values = applied(&stack.frames);
    let irregular = stack.irregular();
    let slices = stack.frames.len();
    let outside = stack.frames[0].rescale;
    let inner = frames(images, std::mem::take(&mut stack.frames), size, cell)?;
    let dtype = inner.dtype;
    let grid = match irregular {
        None => None,
        Some(what) if !options.resample => return Err(needs_resampling(path, &what)),
        Some(what) => {
            let slices = SlicePlaces {
                placement: stack.placement,
                places: stack.places,
                size,
                lean: 0.0,
            };
            let grid = Grid::over(path, slices, fill(cell, outside, padding))?;
            notes.push(grid.note(&format!("the files have {what}")));
            Some(grid)
        }
    };
    let dims = Dims::new([size[0].into(), size[1].into(), slices as u64]);
    let dims = dims.map_err(|e| e.of_header(path, "a series"))?;
    Ok(VolumeDescriptor {
        placement: grid.as_ref().map_or(stack.placement, |grid| grid.placement),
        provenance,
        applied: values,
        grid,
        warnings,
        ..VolumeDescriptor::new("dicom", dims, dtype, Samples::Pages(Box::new(inner)))
    })
}

fn needs_resampling(path: &Path, what: &str) -> Error {
    let what = format!("a DICOM series with {what}");
    Error::unsupported(path, what, "--resample interpolates it to a regular grid")
}

/// What to say of slices that are taken to lie as far apart as they are thick.
fn thickness(thick: f64) -> Warning {
    Warning::of_size(format!(
        "the distance of slices is assumed to be their thickness ({thick} mm), since the file states no positions and \
         no SpacingBetweenSlices: give --spacing X,Y,Z and --unit if it is another"
    ))
}

/// The value of what lies outside of every slice: padding, else air, else the least number.
fn fill(cell: Cell, rescale: Rescale, padding: Option<[i64; 2]>) -> f64 {
    match padding {
        Some([padding, _]) => rescale.value(padding as f64),
        None if cell.signed && !cell.float => -1000.0,
        None => rescale.value(0.0),
    }
}
