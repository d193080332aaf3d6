//! Frames whose order no position tells.

use crate::error::{Error, Result};
use crate::grid::{Dims, Origin, Placement, Provenance, Unit};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::formats::dicom::frame::{self, Image, Step};
use crate::volume::formats::dicom::series::Candidate;
use crate::volume::formats::dicom::{applied, frames, thickness};
use crate::volume::options::OpenOptions;
use crate::volume::stated::warning::Warning;
use std::path::Path;

/// What to say of slices in an order that no position confirms.
const BY_NUMBER: &str = "slices are in the order of their InstanceNumber, since the files state no positions: where \
                         that counts the other way, the volume is mirrored";
const AS_STORED: &str = "slices are the frames in the order in which they are stored, since all state the same \
                         position: where that runs the other way, the volume is mirrored";

/// Refuses frames that follow each other in time, as those of a film, unless the user says how far they lie apart.
pub(crate) fn in_time(image: &Image, options: &OpenOptions) -> Result<Option<Warning>> {
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

pub(crate) fn no_distance(path: &Path) -> Error {
    let found = "DICOM frames without a position for each, and without their distance";
    let expected = "ImagePositionPatient for each, or PixelSpacing and SpacingBetweenSlices";
    Error::format(path, found, expected)
        .with_hint("if the frames are slices in order, give --spacing and --unit")
}

/// Frames without places: those of one file in their order, if the size of a voxel is known, those of several files
/// by their InstanceNumber, if the user gives it.
pub(crate) fn unplaced(
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
        warnings.push(BY_NUMBER.into());
    } else {
        if plane.is_some() {
            warnings.push(AS_STORED.into());
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
