//! The fields of a NRRD header that place it in space.

use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::volume::text::Field;

/// Three vectors; an axis without direction cannot be an axis of a volume.
pub(super) fn vectors(field: Field) -> Result<[[f64; 3]; 3]> {
    match &vectors_in(field.text).unwrap_or_default()[..] {
        [Some(x), Some(y), Some(z)] => Ok([*x, *y, *z]),
        found if found.contains(&None) => Err(Error::unsupported(
            field.path,
            "a NRRD with an axis outside space (`none`)",
            "volumes have 3 axes in space and one number per voxel",
        )),
        _ => Err(field.wrong("three vectors of 3 numbers: (x,y,z) (x,y,z) (x,y,z)")),
    }
}

/// `none` or `(x,y,z)`, any number of times.
pub(super) fn vectors_in(text: &str) -> Option<Vec<Option<[f64; 3]>>> {
    let mut rest = text.trim_start();
    let mut vectors = Vec::new();
    while !rest.is_empty() {
        let after = if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            after
        } else {
            let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
            let numbers: Option<Vec<f64>> =
                inside.split(',').map(|n| n.trim().parse().ok()).collect();
            let vector: [f64; 3] = numbers?.try_into().ok()?;
            vector.iter().all(|v| v.is_finite()).then_some(())?;
            vectors.push(Some(vector));
            after
        };
        rest = after.trim_start();
    }
    Some(vectors)
}

/// The one unit of all axes; `None` if it is not stated or not a length.
pub(super) fn unit(field: Field) -> Result<Option<Unit>> {
    let names: Vec<&str> = if field.text.contains('"') {
        field.text.split('"').skip(1).step_by(2).collect()
    } else {
        field.text.split_whitespace().collect()
    };
    let units: Option<Vec<Unit>> = names.iter().map(|name| name.parse().ok()).collect();
    match units.as_deref() {
        Some([first, rest @ ..]) if rest.iter().all(|u| u == first) => Ok(Some(*first)),
        Some([_, ..]) => Err(field.wrong("the same unit for all axes")),
        _ => Ok(None),
    }
}

/// True for the spaces of DICOM and its relatives, which measure in millimetres.
pub(super) fn is_anatomical(space: &str) -> bool {
    let space = space.to_ascii_lowercase();
    let names = [
        "right-anterior-superior",
        "left-anterior-superior",
        "left-posterior-superior",
        "scanner-xyz",
        "ras",
        "las",
        "lps",
    ];
    names.contains(&space.trim())
}
