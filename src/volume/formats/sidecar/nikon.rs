//! Nikon's (X-Tek's) `.xtekct` beside its `.vol`: sizes and steps in `[XTekCT]`, the latter in `Units`, which is mm
//! unless the file states another. Samples are floats of 32 bits, or whole ones where the user asked for these.

use crate::error::Result;
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::Format;
use crate::volume::formats::sidecar::keys::{Keys, has_words};
use crate::volume::formats::sidecar::{Sidecar, each, named, steps};
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "xtekct",
    title: "Nikon X-Tek",
    extensions: &["xtekct"],
    starts: |head| has_words(head, &["[xtekct]"]),
    begins: Some("a header of Nikon's, which has the section [XTekCT]"),
    headers: &["xtekct"],
    parse: Some(|input, _| parse(input.path)),
    ..Format::BASE
};

const SECTION: &str = "xtekct";

/// Parses a header.
///
/// # Errors
/// [`Error::Format`](crate::Error::Format) if a size is missing, or the file beside it has another length.
fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let keys = Keys::read(path)?;
    let sizes = each(&keys, SECTION, ["VoxelsX", "VoxelsY", "VoxelsZ"])?;
    let mut files = vec![path.with_extension("vol")];
    if let Some(name) = keys.get(SECTION, "Name")? {
        files.extend(named(path, &format!("{}.vol", name.text)));
    }
    let sidecar = Sidecar::new(path, files, sizes)?;
    let dtype = sidecar.by_length()?;
    let note = sidecar.told(dtype);
    let units = keys.get(SECTION, "Units")?;
    let unit = units.map_or("mm", |field| field.text);
    let names = ["VoxelSizeX", "VoxelSizeY", "VoxelSizeZ"];
    let mut found = sidecar.descriptor("xtekct", dtype, steps(&keys, SECTION, names, unit)?);
    found.notes.push(note);
    Ok(found)
}
