//! The source that the manifest states, against the volume that the tiles are compared with.

use super::code::Code;
use super::report::{Issue, Issues, Severity};
use crate::grid::{Filter, Origin, Placement, Provenance, filters_text};
use crate::manifest::Manifest;
use crate::volume::{Header, Opened};

/// What the volume that tiles are compared with says of itself, before it is filtered and cropped.
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
    /// Filters that the samples that are compared have been through.
    pub filters: Vec<Filter>,
    /// Where the placement's parts came from.
    pub provenance: Provenance,
}

impl SourceVolume {
    /// Of a volume that has been opened.
    pub fn of(opened: &Opened) -> Self {
        let mut header = opened.volume.header().clone();
        if let Some(before) = &opened.filtered {
            (header.dims, header.dtype) = (before.dims, before.dtype);
        }
        let filtered = opened.filtered.as_ref();
        SourceVolume {
            name: opened.name.clone(),
            header,
            offset: opened.offset,
            values: opened.values.clone(),
            filters: filtered.map_or_else(Vec::new, |f| f.filters.clone()),
            provenance: opened.provenance,
        }
    }
}

/// Compares format, size, type, byte order, offset, scaling and filters with those of the volume, and what of the
/// place neither has from an option; `place` is that of the volume as it was cut. A file of another name and another
/// format may hold the same samples: of one, what depends on the form of the file is left out. If nothing differs but
/// the name, that is a warning.
pub(super) fn check(
    manifest: &Manifest,
    volume: &SourceVolume,
    place: &Placement,
    issues: &mut Issues,
) {
    let (source, header) = (&manifest.source, &volume.header);
    let renamed = volume.name != source.name;
    let other_form = renamed && header.format != source.format;
    let mut differences = 0;
    let mut compare = |name: &str, found: String, stated: String| {
        if found != stated {
            differences += 1;
            let message = format!("stated {stated}, the volume has {found}");
            issues.add(Code::SourceMismatch, format!("index.json#/{name}"), message);
        }
    };
    compare(
        "source/dims",
        header.dims.to_string(),
        source.dims.to_string(),
    );
    compare(
        "source/dtype",
        header.dtype.to_string(),
        source.dtype.to_string(),
    );
    compare(
        "source/values",
        values(&volume.values),
        values(&source.values),
    );
    compare(
        "filters",
        filters_text(&volume.filters),
        filters_text(&manifest.filters),
    );
    if !other_form {
        check_form(manifest, volume, &mut compare);
    }
    check_place(manifest, &volume.provenance, place, &mut compare);
    if renamed && differences == 0 {
        let less = match other_form {
            true => format!(
                ", and it is {}, not {}: byte order, offset and where sizes come from were not compared",
                header.format, source.format
            ),
            false => String::new(),
        };
        let message = format!(
            "the volume is named {:?}, the source {:?}{less}",
            volume.name, source.name
        );
        issues.push(Issue {
            severity: Severity::Warning,
            ..Issue::new(Code::SourceMismatch, "index.json#/source/name", message)
        });
    }
}

/// Compares what depends on the form of the file, and where the parts of its place come from.
fn check_form(
    manifest: &Manifest,
    volume: &SourceVolume,
    compare: &mut impl FnMut(&str, String, String),
) {
    let (source, header) = (&manifest.source, &volume.header);
    compare(
        "source/format",
        header.format.to_owned(),
        source.format.clone(),
    );
    compare(
        "source/endian",
        header.endian.to_string(),
        source.endian.to_string(),
    );
    compare(
        "source/offset",
        volume.offset.to_string(),
        source.offset.to_string(),
    );
    let (own, stated) = (&volume.provenance, &source.provenance);
    let word = |origin: Origin| format!("{origin:?}").to_lowercase();
    let axis = |a: usize| (format!("spacing/{a}"), own.spacing[a], stated.spacing[a]);
    let others = [
        ("unit".to_owned(), own.unit, stated.unit),
        ("origin".to_owned(), own.origin, stated.origin),
    ];
    for (name, own, stated) in (0..3).map(axis).chain(others) {
        if own != Origin::Option && stated != Origin::Option {
            compare(
                &format!("source/provenance/{name}"),
                word(own),
                word(stated),
            );
        }
    }
}

fn values(values: &Option<String>) -> String {
    values.clone().unwrap_or_else(|| "none".to_owned())
}

/// Compares spacing, unit and origin where neither the index nor the volume, by its provenance `own`, has them from an
/// option, which says nothing of the file.
fn check_place(
    manifest: &Manifest,
    own: &Provenance,
    place: &Placement,
    compare: &mut impl FnMut(&str, String, String),
) {
    let stated = &manifest.source.provenance;
    // those that are no option's are the file's, or the same for lack of them
    let known = |a: Origin, b: Origin| a == b && a != Origin::Option;
    // in the unit of the index, or as numbers where the file has no unit
    let shown = place.in_unit(manifest.placement.unit).unwrap_or(*place);
    for a in (0..3).filter(|&a| known(own.spacing[a], stated.spacing[a])) {
        let size = |p: &Placement| p.spacing[a].to_string();
        compare("spacing", size(&shown), size(&manifest.placement));
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
