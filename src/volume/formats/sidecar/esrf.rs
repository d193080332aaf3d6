//! ESRF's `.vol.info`, which PyHST writes beside its `.vol`: `NUM_X`, `NUM_Y`, `NUM_Z`, `voxelSize` in micrometres and
//! `BYTEORDER`. PyHST's samples are floats of 32 bits; programs that convert them to whole numbers keep the header.

use crate::error::Result;
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::Format;
use crate::volume::formats::sidecar::keys::{Keys, has_words};
use crate::volume::formats::sidecar::{Sidecar, each, endian};
use crate::volume::stated::size::Step;
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "pyhst",
    title: "ESRF PyHST",
    extensions: &["vol.info"],
    starts: |head| has_words(head, &["num_x", "num_y", "num_z"]),
    begins: Some("a header of PyHST, which has NUM_X, NUM_Y and NUM_Z"),
    headers: &["info"],
    parse: Some(|input, _| parse(input.path)),
    ..Format::BASE
};

/// Parses a header.
///
/// # Errors
/// [`Error::Format`](crate::Error::Format) if a size is missing, or the file beside it has another length.
fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let keys = Keys::read(path)?;
    let sizes = each(&keys, "", ["NUM_X", "NUM_Y", "NUM_Z"])?;
    let sidecar = Sidecar::new(path, vec![path.with_extension("")], sizes)?;
    let dtype = sidecar.by_length()?;
    let note = sidecar.told(dtype);
    let step = keys.get("", "voxelSize")?;
    let step = step.map(|field| Step::of_text(field.text, "um"));
    let order = keys.get("", "BYTEORDER")?.map(endian).transpose()?;
    let mut found = sidecar.descriptor("pyhst", dtype, [step.clone(), step.clone(), step]);
    found.endian = order;
    found.notes.push(note);
    Ok(found)
}
