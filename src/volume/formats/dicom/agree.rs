//! What all slices of a volume must state alike, and the slices that do not.

use crate::error::{Error, Result};
use crate::volume::formats::dicom::frame::{Frame, Image, Series};
use crate::volume::formats::dicom::order::called;
use crate::volume::formats::dicom::series::Candidate;
use glam::DVec3;
use std::collections::HashSet;
use std::path::Path;

/// The name of an element, what is found and what is expected.
pub(crate) type Difference = [String; 3];

const NOT_STATED: &str = "not stated";

/// A slice of the volume's series that is not one of the volume's slices.
pub(crate) struct Other {
    /// Its file, as people find it.
    pub(crate) name: String,
    pub(crate) differs: Difference,
    /// It looks another way, as a scout does.
    turned: bool,
    localizer: bool,
}

impl Series {
    /// True for images of one series.
    pub(crate) fn same(&self, other: &Series) -> bool {
        self.uid == other.uid && (!self.uid.is_empty() || self.number == other.number)
    }
}

/// The first element in which a frame differs from another one of its series.
pub(crate) fn difference(of: (&Image, &Frame), own: (&Image, &Frame)) -> Option<Difference> {
    let ((image, frame), (own_image, own)) = (of, own);
    let told = |tag: &str, found: String, expected: String| {
        let shown = |text: String| {
            if text.is_empty() {
                NOT_STATED.into()
            } else {
                text
            }
        };
        (found != expected).then(|| [tag.to_owned(), shown(found), shown(expected)])
    };
    let text = |tag: &str, get: fn(&Image) -> String| told(tag, get(own_image), get(image));
    text("Rows", |i| i.size[1].to_string())
        .or_else(|| text("Columns", |i| i.size[0].to_string()))
        .or_else(|| text("BitsAllocated", |i| (8 * i.cell.bytes).to_string()))
        .or_else(|| text("BitsStored", |i| i.cell.bits.to_string()))
        .or_else(|| {
            text("PixelRepresentation", |i| {
                u8::from(i.cell.signed).to_string()
            })
        })
        .or_else(|| {
            text("the kind of numbers", |i| {
                (if i.cell.float { "floats" } else { "integers" }).into()
            })
        })
        .or_else(|| text("the byte order", |i| i.cell.endian.to_string()))
        .or_else(|| {
            text("PhotometricInterpretation", |i| {
                let names = ["MONOCHROME2", "MONOCHROME1"];
                names[usize::from(i.inverse)].into()
            })
        })
        .or_else(|| spacing(frame, own))
        .or_else(|| orientation(frame, own))
        .or_else(|| text("Modality", |i| i.series.modality.clone()))
        .or_else(|| text("SeriesNumber", |i| i.series.number.clone()))
        .or_else(|| text("SeriesDescription", |i| i.series.description.clone()))
}

fn spacing(frame: &Frame, own: &Frame) -> Option<Difference> {
    let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|i| (a[i] / b[i] - 1.0).abs() < 1e-3);
    match (frame.pixel, own.pixel) {
        (None, None) => return None,
        (Some(a), Some(b)) if near(a, b) => return None,
        _ => {}
    }
    let show = |pixel: Option<[f64; 2]>| match pixel {
        // from row to row comes first
        Some([x, y]) => format!("{y}\\{x}"),
        None => NOT_STATED.into(),
    };
    Some(["PixelSpacing".into(), show(own.pixel), show(frame.pixel)])
}

fn orientation(frame: &Frame, own: &Frame) -> Option<Difference> {
    let [a, b] = [frame, own].map(|f| f.plane.map(|p| p.axes));
    let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-3;
    match (a, b) {
        (None, None) => return None,
        (Some(a), Some(b)) if a.as_flattened().iter().zip(b.as_flattened()).all(near) => {
            return None;
        }
        (Some(_), Some(_)) => {}
        (a, b) => {
            let show = |there| if there { "stated" } else { NOT_STATED }.to_owned();
            let tag = "the place (ImagePositionPatient and ImageOrientationPatient)";
            return Some([tag.into(), show(b.is_some()), show(a.is_some())]);
        }
    }
    let show = |axes: Option<[[f64; 3]; 2]>| {
        let all = axes.unwrap_or_default();
        let short = |v: &f64| (v * 1e6).round() / 1e6 + 0.0;
        let words = all.as_flattened().iter().map(|v| short(v).to_string());
        words.collect::<Vec<_>>().join("\\")
    };
    Some(["ImageOrientationPatient".into(), show(b), show(a)])
}

/// Slices of the series of `first` that are not among `taken`.
pub(crate) fn left_out(first: &Frame, taken: &[Frame], images: &[Image]) -> Vec<Other> {
    let image = &images[first.file as usize];
    let taken: HashSet<(u32, u32)> = taken.iter().map(|f| (f.file, f.index)).collect();
    let mut others = Vec::new();
    for other in images.iter().filter(|i| i.series.same(&image.series)) {
        let own = other.frames.iter();
        for frame in own.filter(|f| !taken.contains(&(f.file, f.index))) {
            let Some(differs) = difference((image, first), (other, frame)) else {
                continue;
            };
            others.push(Other {
                name: called(images, frame),
                differs,
                turned: turned(first, frame),
                localizer: other.localizer && !image.localizer,
            });
        }
    }
    others
}

/// True if two frames look far different ways.
fn turned(a: &Frame, b: &Frame) -> bool {
    let (Some(a), Some(b)) = (a.plane, b.plane) else {
        return false;
    };
    let cosine = |i: usize| DVec3::from(a.axes[i]).dot(b.axes[i].into());
    cosine(0).min(cosine(1)) < 0.9
}

/// Refuses a volume of whose series a slice that looks the same way is left out, since it differs.
///
/// # Errors
/// [`Error::Format`] with the file, the element, what it says and what the others say.
pub(crate) fn none_is_lost(candidate: &Candidate, others: &[Other]) -> Result<()> {
    let lost = |other: &&Other| !other.turned && !other.localizer;
    let Some(other) = others.iter().find(lost) else {
        return Ok(());
    };
    let [tag, found, expected] = &other.differs;
    let count = candidate.frames.len();
    let expected = format!("{expected}, as {count} other slices of its series state");
    Err(Error::format(Path::new(&other.name), format!("{tag} {found}"), expected).with_hint(
        format!(
            "correct the file or take it out of the folder; --series {} reads the others without it",
            candidate.key
        ),
    ))
}

/// What a note says of such slices.
pub(crate) fn note(others: &[Other]) -> Option<String> {
    let first = others.first()?;
    let [tag, found, expected] = &first.differs;
    Some(format!(
        ", the first of this series {} ({tag} {found}, not {expected})",
        first.name
    ))
}

/// Checks that all slices state a scale of their values and units in the same elements. Its numbers may differ.
///
/// # Errors
/// [`Error::Format`] with the file and the element.
pub(crate) fn values(candidate: &Candidate, images: &[Image]) -> Result<()> {
    let frames = &candidate.frames;
    let names = [
        "RescaleSlope",
        "RescaleIntercept",
        "RealWorldValueMapping",
        "DoseGridScaling",
    ];
    for (i, name) in names.into_iter().enumerate() {
        let stated = frames.iter().filter(|f| f.stated.scale[i]).count();
        let most = 2 * stated >= frames.len();
        if let Some(odd) = frames.iter().find(|f| f.stated.scale[i] != most) {
            let show = |there: bool| if there { "stated" } else { NOT_STATED };
            let number = if most { stated } else { frames.len() - stated };
            let found = format!("{name} {}", show(!most));
            let expected = format!("{}, as in {number} other slices of its series", show(most));
            return Err(wrong(images, odd, found, expected));
        }
    }
    let names = [
        "RescaleType",
        "Units",
        "MeasurementUnitsCodeSequence",
        "DoseUnits",
    ];
    for (i, name) in names.into_iter().enumerate() {
        let mut stated = frames.iter().filter(|f| !f.stated.units[i].is_empty());
        let Some(first) = stated.next() else {
            continue;
        };
        let mut odd: Vec<_> = stated
            .filter(|f| f.stated.units[i] != first.stated.units[i])
            .collect();
        let mut expected = first;
        if let (Some(other), true) = (odd.first(), 2 * odd.len() > frames.len()) {
            (expected, odd) = (*other, vec![first]);
        }
        if let Some(odd) = odd.first() {
            let found = format!("{name} {}", odd.stated.units[i]);
            let expected = format!("{}, as in other slices", expected.stated.units[i]);
            return Err(wrong(images, odd, found, expected));
        }
    }
    Ok(())
}

fn wrong(images: &[Image], odd: &Frame, found: String, expected: String) -> Error {
    Error::format(Path::new(&called(images, odd)), found, expected).with_hint(
        "correct the file or take it out of the folder: its values may not be those of the others",
    )
}
