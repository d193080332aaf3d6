//! What the manifest states of its source, beside the volume that the tiles are compared with.

use super::code::Code;
use super::report::{Issue, Issues, Severity};
use crate::grid::Placement;
use crate::manifest::{Manifest, Origin, Provenance};
use crate::volume::{Header, Opened};

/// What the volume that tiles are compared with says of itself, before it is cropped.
#[derive(Debug, Clone)]
pub struct SourceVolume {
    /// The file's name without its directory.
    pub name: String,
    /// Format, size, type and place.
    pub header: Header,
    /// Bytes before the first sample of a headerless raw file.
    pub offset: u64,
    /// How the values follow from what the file stores.
    pub values: Option<String>,
    /// Where the placement's parts came from.
    pub provenance: Provenance,
}

impl SourceVolume {
    /// Of a volume that has been opened.
    pub fn of(opened: &Opened) -> Self {
        SourceVolume {
            name: opened.name.clone(),
            header: opened.volume.header().clone(),
            offset: opened.offset,
            values: opened.values.clone(),
            provenance: opened.provenance,
        }
    }
}

/// Compares format, size, type, byte order, offset and scaling with those of the volume, and what of the
/// place neither has from an option; `place` is that of the volume as it was cut. A file of another name may
/// hold the same samples in another form, so of one it is only said that this was not compared.
pub(super) fn check(
    manifest: &Manifest,
    volume: &SourceVolume,
    place: &Placement,
    issues: &mut Issues,
) {
    let (source, header) = (&manifest.source, &volume.header);
    if volume.name != source.name {
        let message = format!(
            "the volume is named {}, the source {}: what is stated of the source was not compared",
            volume.name, source.name
        );
        issues.push(Issue {
            severity: Severity::Warning,
            ..Issue::new(Code::SourceMismatch, "index.json#/source/name", message)
        });
        return;
    }
    let mut compare = |name: &str, found: String, stated: String| {
        if found != stated {
            let message = format!("stated {stated}, the volume has {found}");
            issues.add(Code::SourceMismatch, format!("index.json#/{name}"), message);
        }
    };
    let pairs = [
        ("format", header.format.to_owned(), source.format.clone()),
        ("dims", header.dims.to_string(), source.dims.to_string()),
        ("dtype", header.dtype.to_string(), source.dtype.to_string()),
        (
            "endian",
            header.endian.to_string(),
            // the order of single bytes says nothing
            match header.dtype.bytes() {
                1 => header.endian.to_string(),
                _ => source.endian.to_string(),
            },
        ),
        (
            "offset",
            volume.offset.to_string(),
            source.offset.to_string(),
        ),
        ("values", values(&volume.values), values(&source.values)),
    ];
    for (name, found, stated) in pairs {
        compare(&format!("source/{name}"), found, stated);
    }
    check_place(manifest, &volume.provenance, place, &mut compare);
}

fn values(values: &Option<String>) -> String {
    values.clone().unwrap_or_else(|| "none".to_owned())
}

/// Compares where spacing, unit and origin come from, and those that neither the index nor the volume, by its
/// provenance `own`, has from an option, which says nothing of the file.
fn check_place(
    manifest: &Manifest,
    own: &Provenance,
    place: &Placement,
    compare: &mut impl FnMut(&str, String, String),
) {
    let stated = &manifest.source.provenance;
    let known = |a: Origin, b: Origin| a != Origin::Option && b != Origin::Option;
    let word = |origin: Origin| format!("{origin:?}").to_lowercase();
    // in the unit of the index, or as numbers where the file has no unit
    let shown = place.in_unit(manifest.placement.unit).unwrap_or(*place);
    for a in (0..3).filter(|&a| known(own.spacing[a], stated.spacing[a])) {
        let path = format!("source/provenance/spacing/{a}");
        compare(&path, word(own.spacing[a]), word(stated.spacing[a]));
        let size = |p: &Placement| p.spacing[a].to_string();
        compare("spacing", size(&shown), size(&manifest.placement));
    }
    for (name, own, stated) in [
        ("unit", own.unit, stated.unit),
        ("origin", own.origin, stated.origin),
    ] {
        if known(own, stated) {
            let path = format!("source/provenance/{name}");
            compare(&path, word(own), word(stated));
        }
    }
    let of_file = |a: Origin, b: Origin| a == Origin::File && b == Origin::File;
    if of_file(own.unit, stated.unit) {
        let unit = |p: &Placement| p.unit.name().to_owned();
        compare("unit", unit(place), unit(&manifest.placement));
        if of_file(own.origin, stated.origin) {
            let of = |p: &Placement| format!("{:?} and {:?}", p.origin, p.directions);
            compare("origin", of(place), of(&manifest.placement));
        }
    }
}
