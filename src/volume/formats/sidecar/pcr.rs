//! GE phoenix's (Waygate's) `.pcr` beside its `.vol`: sizes in `[VolumeData]`, the size of a voxel in mm, and the type of
//! samples by a number, of which 5 (u16) and 10 (f32) are known.

use crate::error::Result;
use crate::volume::Dtype;
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::Format;
use crate::volume::formats::sidecar::keys::{Keys, has_words};
use crate::volume::formats::sidecar::{Sidecar, each, named};
use crate::volume::io::blob::Blob;
use crate::volume::stated::size::Step;
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "pcr",
    title: "GE phoenix",
    extensions: &["pcr"],
    starts: is_pcr,
    // the section of the volume may stand behind others
    looks: Some(|path, _| {
        let named = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("pcr"));
        let long = || Blob::file(path).and_then(|blob| blob.head(1 << 16));
        named && long().is_ok_and(|head| is_pcr(&head))
    }),
    begins: Some("a header of GE phoenix, which has the section [VolumeData]"),
    headers: &["pcr"],
    parse: Some(|input, _| parse(input.path)),
    ..Format::BASE
};

const SECTION: &str = "volumedata";

fn is_pcr(head: &[u8]) -> bool {
    has_words(head, &["[volumedata]", "volume_sizex"])
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`](crate::Error::Format) if a size is missing, or the stated type does not fit the length of the file
/// beside it.
fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let keys = Keys::read(path)?;
    let sizes = each(
        &keys,
        SECTION,
        ["Volume_SizeX", "Volume_SizeY", "Volume_SizeZ"],
    )?;
    let mut files = Vec::new();
    if let Some(name) = keys.get(SECTION, "VOL_File")? {
        files.extend(named(path, name.text));
    }
    files.push(path.with_extension("vol"));
    let sidecar = Sidecar::new(path, files, sizes)?;
    let by_length = sidecar.by_length()?;
    let (dtype, note) = match keys.get(SECTION, "Format")? {
        Some(code) => match (code.text, by_length) {
            ("5", Dtype::U16) | ("10", Dtype::F32) => (by_length, None),
            ("5" | "10", _) => {
                let file = sidecar.file.display();
                return Err(code.wrong(format!(
                    "the type that the length of {file} gives, which is {by_length}"
                )));
            }
            (other, _) => {
                let dtype = of_range(&keys, by_length)?;
                let note = format!("Format {other} is not known; {}", sidecar.told(dtype));
                (dtype, Some(note))
            }
        },
        None => {
            let dtype = of_range(&keys, by_length)?;
            (dtype, Some(sidecar.told(dtype)))
        }
    };
    let step = keys.get(SECTION, "VoxelSizeRec")?;
    let step = step.map(|field| Step::of_text(field.text, "mm"));
    let mut found = sidecar.descriptor("pcr", dtype, [step.clone(), step.clone(), step]);
    found.notes.extend(note);
    Ok(found)
}

/// Signed numbers where the header states a smallest value below 0.
fn of_range(keys: &Keys, by_length: Dtype) -> Result<Dtype> {
    let least = keys.get(SECTION, "Min")?;
    let below = least.and_then(|field| field.text.parse::<f64>().ok());
    Ok(match (by_length, below.is_some_and(|v| v < 0.0)) {
        (Dtype::U8, true) => Dtype::I8,
        (Dtype::U16, true) => Dtype::I16,
        (other, _) => other,
    })
}
