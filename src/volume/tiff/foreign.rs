//! Formats that are TIFF by their first bytes, and put more into a file than TIFF's own tags say.

use super::ifd::Directory;
use crate::error::{Error, Result};
use std::path::Path;

/// Texts by which other programs' files are known, in Software or ImageDescription.
const TEXTS: &[(u16, &str, &str)] = &[
    (305, "SI.", "ScanImage's TIFF"),
    (270, "state.config", "ScanImage's TIFF"),
    (270, "<PerkinElmer-QPI", "the QPTIFF format"),
    (270, "<scn", "Leica's SCN format"),
    (270, "<DataObject", "Philips' TIFF"),
];

/// Refuses pages that hold several planes, or planes in an order of their own.
///
/// # Errors
/// [`Error::Unsupported`] with the format's name.
pub(super) fn refuse(path: &Path, dir: &Directory) -> Result<()> {
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
