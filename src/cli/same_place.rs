//! Whether a file of voxels lies where the volume does to which it is given.

use crate::error::{Error, Result};
use crate::grid::{Frame, Origin, Placement, Unit};
use crate::volume::Opened;
use std::path::Path;

/// An error of a file that an option gives, with what helps there: options such as `--dataset` and `--dims` are of the scan
/// only.
pub fn parts_of_other(error: Error, option: &str, what: &str, path: &Path) -> Error {
    const OF_SCAN: [&str; 6] = [
        "--dataset",
        "--series",
        "--level",
        "--channel",
        "--time",
        "--resample",
    ];
    match error {
        Error::Usage {
            option: part,
            found,
            ..
        } if OF_SCAN.contains(&&*part) => {
            let expected = format!("a file that holds {what} alone");
            let found = format!(
                "{}, of which one part has to be chosen ({found})",
                path.display()
            );
            let hint = format!(
                "{part} is for the scan: write {what} to a file of its own, as .npy or .nrrd"
            );
            Error::usage(option, found, expected).with_hint(hint)
        }
        // advice on raw samples, whose size and type cannot be given here
        Error::Format { ref hint, .. } | Error::Unsupported { ref hint, .. }
            if hint.contains("--dims") || hint.contains("--offset") =>
        {
            error.with_hint(format!("write {what} to another file, as .npy or .nrrd"))
        }
        error => error,
    }
}

/// A placement in the world whose axes run as `frame` says, where both worlds are known: from one to the other, x and y
/// turn round.
fn in_frame(mut placement: Placement, own: Frame, frame: Frame) -> Placement {
    let known = own != Frame::Unstated && frame != Frame::Unstated;
    if known && own != frame {
        let directions = placement.directions.iter_mut();
        for vector in directions.chain([&mut placement.origin]) {
            // subtracted, so that 0 does not become -0
            vector[..2].iter_mut().for_each(|v| *v = 0.0 - *v);
        }
    }
    placement
}

/// Refuses a file, given by an option, that states that it lies otherwise than the volume: voxel by voxel it would be of
/// another place. The volume has its placement and the world that this is in. What a file does not state is taken to be the volume's.
///
/// # Errors
/// [`Error::Usage`].
pub fn same_place(
    option: &str,
    what: &str,
    path: &Path,
    file: &Opened,
    (volume, frame): (&Placement, Frame),
) -> Result<()> {
    /// Of a voxel, by how much places may differ: files round them.
    const OFF: f64 = 0.1;
    let stated = &file.provenance;
    let own = in_frame(file.volume.header().placement, stated.frame, frame);
    let known = own.unit != Unit::Voxel && volume.unit != Unit::Voxel;
    let (true, Ok(own)) = (known, own.in_unit(volume.unit)) else {
        return Ok(());
    };
    let from_file = |origin: Origin| origin == Origin::File;
    let steps = (0..3).filter(|&a| from_file(stated.spacing[a]));
    let step = |a: usize| (own.spacing[a] / volume.spacing[a] - 1.0).abs() > OFF / 10.0;
    let directions = own.directions.as_flattened().iter();
    let turned = directions
        .zip(volume.directions.as_flattened())
        .any(|(a, b)| (a - b).abs() > OFF / 10.0);
    let moved = (0..3).any(|a| {
        let smallest = volume
            .spacing
            .iter()
            .fold(f64::INFINITY, |s: f64, v| s.min(*v));
        (own.origin[a] - volume.origin[a]).abs() > OFF * smallest
    });
    let lies = if steps.clone().any(step) {
        format!("voxels of {:?} {}", own.spacing, own.unit)
    } else if from_file(stated.origin) && turned {
        format!("axes along {:?}", own.directions)
    } else if from_file(stated.origin) && moved {
        format!("the first voxel at {:?} {}", own.origin, own.unit)
    } else {
        return Ok(());
    };
    let expected = format!(
        "one that lies as the volume does: voxels of {:?} {}, axes along {:?}, the first voxel at {:?}",
        volume.spacing, volume.unit, volume.directions, volume.origin
    );
    let found = format!("{what} {} with {lies}", path.display());
    Err(Error::usage(option, found, expected)
        .with_hint("a file without a place, as .npy or raw, is taken voxel by voxel"))
}
