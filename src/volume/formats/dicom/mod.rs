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

use crate::error::{Error, Result};
use crate::grid::{Dims, Origin, Placement, Provenance, Unit};
use crate::volume::adapters::resample::Grid;
use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::formats::folder::unread::Unread;
use crate::volume::io::blob::Blob;
use crate::volume::io::descriptor::{Samples, VolumeDescriptor};
use crate::volume::io::paged::MAX_CHUNK;
use crate::volume::open::OpenOptions;
use crate::volume::stated::warning::Warning;
use element::Fragment;
use frame::{Cell, Found, Image, Rescale, Step};
use pixel::Frames;
use rayon::prelude::*;
use series::Candidate;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(crate) use element::is_dicom;

/// True for the list of its files that a disc of DICOM holds: it has no pixels.
pub(crate) fn is_index(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.eq_ignore_ascii_case("DICOMDIR"))
}

/// Opens the volume in these files.
///
/// # Errors
/// [`Error::Usage`] with the list of series if there are several; [`Error::Unsupported`] by name for
/// irregular grids and what is not decoded, [`Error::Format`] for damaged files.
pub(crate) fn parse(
    path: &Path,
    blobs: Vec<Blob>,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    parse_folder(path, blobs, Vec::new(), options)
}

/// Opens the volume in the files of a folder; `unread` lies beside them under names of slices.
///
/// # Errors
/// As [`parse`], and [`Error::Format`] for what is no slice where the slices lie.
pub(crate) fn parse_folder(
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
            counted(others, "other image is", "other images are"),
            agree::note(&left_out).unwrap_or_default()
        ));
    }
    notes.extend(padding(&candidate, &images));
    let remark = candidate.frames.iter().find_map(|frame| frame.remark);
    notes.extend(remark.map(String::from));
    let first = &images[candidate.frames[0].file as usize];
    let endian = first.cell.endian;
    let recipe = if without_places(&candidate, options) {
        unplaced(path, candidate, images, options)?
    } else {
        placed(path, candidate, images, options, &mut notes)?
    };
    Ok(VolumeDescriptor {
        endian: Some(endian),
        notes,
        ..recipe
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
            let files = counted(passed.len(), "file is", "files are");
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
            bare.len(),
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

/// A number with the word for one, or for several.
fn counted(number: usize, one: &str, several: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { several })
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
    let given = options.spacing.map(|[x, y, _]| [x, y]);
    let mut stack = order::stack(path, candidate.frames, &images, given)?;
    let mut provenance = Provenance {
        spacing: [Origin::File; 3],
        unit: Origin::File,
        origin: Origin::File,
    };
    if let Some([one, other]) = &stack.repeats {
        notes.push(format!(
            "{} the place and the pixels of another, as {other} those of {one}: each place counts once",
            counted(stack.repeated, "slice has", "slices have")
        ));
    }
    let mut warnings: Vec<Warning> = in_time.into_iter().collect();
    if options.spacing.is_none() {
        match step {
            Step::Stated => {}
            Step::Thickness(thick) => {
                provenance.spacing[2] = Origin::Assumed;
                warnings.push(thickness(thick));
            }
            Step::Unknown => return Err(no_distance(path)),
        }
    }
    let values = applied(&stack.frames);
    let irregular = stack.irregular();
    let slices = stack.frames.len();
    let outside = stack.frames[0].rescale;
    let inner = frames(images, std::mem::take(&mut stack.frames), size, cell)?;
    let dtype = inner.dtype;
    let grid = match irregular {
        None => None,
        Some(what) if !options.resample => {
            let what = format!("a DICOM series with {what}");
            let hint = "--resample interpolates it to a regular grid";
            return Err(Error::unsupported(path, what, hint));
        }
        Some(what) => {
            let fill = fill(cell, outside, padding);
            let grid = Grid::over(path, stack.placement, (stack.places, 0.0), size, fill)?;
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

/// What to say of slices that are taken to lie as far apart as they are thick.
fn thickness(thick: f64) -> Warning {
    Warning::of_size(format!(
        "the distance of slices is assumed to be their thickness ({thick} mm), since the file states no positions and \
         no SpacingBetweenSlices: give --spacing X,Y,Z and --unit if it is another"
    ))
}

/// Refuses frames that follow each other in time, as those of a film, unless the user says how far they lie apart.
fn in_time(image: &Image, options: &OpenOptions) -> Result<Option<Warning>> {
    let stated = "frames that follow each other in time (FrameIncrementPointer is FrameTime)";
    match (image.in_time, options.spacing.is_some()) {
        (false, _) => Ok(None),
        (true, true) => Ok(Some(
            format!("the file states {stated}: --spacing has them read as slices, in the order in which they are stored").into(),
        )),
        (true, false) => Err(Error::unsupported(
            image.blob.path(),
            format!("a DICOM film, of {stated},"),
            "if its frames are slices in order all the same, --spacing X,Y,Z --unit mm reads them so",
        )),
    }
}

fn no_distance(path: &Path) -> Error {
    let found = "DICOM frames without a position for each, and without their distance";
    let expected = "ImagePositionPatient for each, or PixelSpacing and SpacingBetweenSlices";
    Error::format(path, found, expected)
        .with_hint("if the frames are slices in order, give --spacing and --unit")
}

/// The value of what lies outside of every slice: padding, else air, else the least number.
fn fill(cell: Cell, rescale: Rescale, padding: Option<[i64; 2]>) -> f64 {
    match padding {
        Some([padding, _]) => rescale.value(padding as f64),
        None if cell.signed && !cell.float => -1000.0,
        None => rescale.value(0.0),
    }
}

/// Frames without places: those of one file in their order, if the size of a voxel is known, those of several files
/// by their InstanceNumber, if the user gives it.
fn unplaced(
    path: &Path,
    candidate: Candidate,
    images: Vec<Image>,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let Candidate {
        size,
        cell,
        frames: mut own,
        ..
    } = candidate;
    let image = &images[own[0].file as usize];
    let (pixel, between, step) = (own[0].pixel, image.between, image.step);
    let plane = own[0].plane;
    let mut warnings: Vec<Warning> = in_time(image, options)?.into_iter().collect();
    let (mut placement, mut provenance) = (Placement::default(), Provenance::default());
    if own.iter().any(|frame| frame.file != own[0].file) {
        by_number(path, &mut own, &images, options)?;
        warnings.push(
            "slices are in the order of their InstanceNumber, since the files state no positions: where that counts \
             the other way, the volume is mirrored"
                .into(),
        );
    } else {
        if plane.is_some() {
            warnings.push(
                "slices are the frames in the order in which they are stored, since all state the same position: where \
                 that runs the other way, the volume is mirrored"
                    .into(),
            );
        }
        match (pixel, between) {
            (Some([x, y]), Some(z)) => {
                placement.spacing = [x, y, z];
                placement.unit = Unit::Millimetre;
                (provenance.spacing, provenance.unit) = ([Origin::File; 3], Origin::File);
                if let (Step::Thickness(thick), None) = (step, options.spacing) {
                    provenance.spacing[2] = Origin::Assumed;
                    warnings.push(thickness(thick));
                }
            }
            _ if options.spacing.is_some() => {}
            _ => return Err(no_distance(path)),
        }
    }
    if let Some(plane) = plane {
        let [row, column] = plane.axes.map(glam::DVec3::from);
        placement.unit = Unit::Millimetre;
        placement.origin = plane.position;
        // adding 0 turns -0 into 0
        placement.directions =
            [row, column, row.cross(column)].map(|axis| (axis + glam::DVec3::ZERO).into());
        (provenance.unit, provenance.origin) = (Origin::File, Origin::File);
    }
    let slices = own.len() as u64;
    let values = applied(&own);
    let pages = frames(images, own, size, cell)?;
    let dims = Dims::new([size[0].into(), size[1].into(), slices])
        .map_err(|e| e.of_header(path, "frames"))?;
    Ok(VolumeDescriptor {
        placement,
        provenance,
        applied: values,
        warnings,
        ..VolumeDescriptor::new("dicom", dims, pages.dtype, Samples::Pages(Box::new(pages)))
    })
}

/// Orders the frames of several files by the files' numbers, which must count them.
fn by_number(
    path: &Path,
    own: &mut [frame::Frame],
    images: &[Image],
    options: &OpenOptions,
) -> Result<()> {
    let found = "a DICOM series without positions (ImagePositionPatient)";
    if options.spacing.is_none() {
        return Err(Error::format(path, found, "the place of every slice").with_hint(
            "if the InstanceNumber of its files counts slices in order, --spacing X,Y,Z --unit mm reads them in that \
             order",
        ));
    }
    let number = |frame: &frame::Frame| images[frame.file as usize].number;
    own.sort_by_key(number);
    let numbers: Option<Vec<i64>> = own.iter().map(number).collect();
    let counts = numbers.is_some_and(|all| {
        let mut steps = all.windows(2).map(|w| w[1].saturating_sub(w[0]));
        let first = steps.next().unwrap_or(0);
        first > 0 && steps.all(|step| step == first)
    });
    match counts {
        true => Ok(()),
        false => Err(
            Error::format(path, found, "an InstanceNumber that counts its slices")
                .with_hint("the order of its slices is unknown: convert it to TIFF or NRRD"),
        ),
    }
}
