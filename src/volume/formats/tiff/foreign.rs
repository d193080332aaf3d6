//! Formats that are TIFF by their first bytes, and put more into a file than TIFF's own tags say.

use crate::error::{Error, Result};
use crate::grid::length::tidy;
use crate::volume::formats::tiff::ifd::Directory;
use crate::volume::stated::size::Step;
use std::path::Path;

/// Texts by which other programs' files are known, in Software or ImageDescription.
const TEXTS: &[(u16, &str, &str)] = &[
    (305, "SI.", "ScanImage's TIFF"),
    (270, "state.config", "ScanImage's TIFF"),
    (270, "<PerkinElmer-QPI", "the QPTIFF format"),
    (270, "<scn", "Leica's SCN format"),
    (270, "<DataObject", "Philips' TIFF"),
];

/// Tags that may state the size of a voxel, and are not read.
const MAY_STATE_SIZES: &[(u16, &str)] = &[
    (33550, "GeoTIFF's ModelPixelScale"),
    (33922, "GeoTIFF's ModelTiepoint"),
    (34264, "GeoTIFF's ModelTransformation"),
    (33628, "MetaMorph's UIC1Tag"),
    (34118, "Zeiss' CZ_SEM"),
    (34680, "FEI's FEI_SFEG"),
    (34682, "FEI's FEI_HELIOS"),
    (51023, "Fibics' metadata"),
    (51123, "Micro-Manager's metadata"),
];

/// Names such tags; those of microscopes only where nothing else states a size.
pub(crate) fn unread(dir: &Directory, stated: bool) -> Option<String> {
    let known = |(tag, name): &(u16, &str)| (name.starts_with("Geo") || !stated) && dir.has(*tag);
    let (tag, name) = MAY_STATE_SIZES.iter().find(|known_as| known(known_as))?;
    Some(format!(
        "{name} (tag {tag}) is not used: give --spacing and --unit if it states the size of a voxel"
    ))
}

/// The size of a voxel that Zeiss' LSM states, in metres.
pub(crate) fn lsm_size(dir: &Directory) -> Result<Option<[Step; 3]>> {
    let bytes = dir.bytes(34412, 64)?;
    let Some(sizes) = bytes.get(40..64) else {
        return Ok(None);
    };
    let mut steps = [(); 3].map(|()| Step::new(0.0, "m"));
    for (step, size) in steps.iter_mut().zip(sizes.as_chunks::<8>().0) {
        step.size = tidy(f64::from_le_bytes(*size));
        // products of a million have noise in their last digits
        step.size = format!("{:.12e}", step.size).parse().unwrap_or(step.size);
    }
    let sound = steps.iter().all(|s| s.size.is_finite() && s.size > 0.0);
    Ok(sound.then_some(steps))
}

/// Refuses pages that hold several planes, or planes in an order of their own.
///
/// # Errors
/// [`Error::Unsupported`] with the format's name.
pub(crate) fn refuse(path: &Path, dir: &Directory) -> Result<()> {
    let hint = "open it in the program that wrote it, or in ImageJ, and save the one volume as a TIFF stack";
    let no = |what: &str| Err(Error::unsupported(path, what, hint));
    // UIC2Tag has a value for each plane
    if dir.count(33629) > 1 {
        return no("MetaMorph's STK format of several planes in one page");
    }
    if dir.has(34361) {
        return no("Olympus' FluoView format");
    }
    if dir.has(65420) || dir.has(65421) {
        return no("Hamamatsu's NDPI format");
    }
    // Molecular Dynamics' GEL: 2 are square roots, 128 are numbers as they are
    if dir.has(33445) && dir.number(33445, 128)? == 2 {
        return no("a scale of square roots (Molecular Dynamics' GEL)");
    }
    for (tag, begin, name) in TEXTS {
        let text = dir.text_begin(*tag)?;
        // an element comes behind the declaration of XML
        if text.starts_with(begin) || (begin.starts_with('<') && text.contains(begin)) {
            return no(name);
        }
    }
    lsm(path, dir, hint)
}

/// Zeiss' LSM states slices and times in a tag of its own: a file of several times or channels is refused.
fn lsm(path: &Path, dir: &Directory, hint: &str) -> Result<()> {
    let head = dir.bytes(34412, 28)?;
    let Some(head) = head.first_chunk::<28>() else {
        return Ok(());
    };
    // LSM is always little-endian: magic, length, x, y, z, channels, times
    let number =
        |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let [slices, channels, times] = [number(16), number(20), number(24)];
    if channels > 1 || times > 1 {
        let what =
            format!("Zeiss' LSM format of {slices} slices, {channels} channels and {times} times");
        return Err(Error::unsupported(path, what, hint));
    }
    Ok(())
}
