//! Whether two tile sets are the same but for where cells end: what a ratio of `--split` cannot change.

use crate::error::{Error, Result};
use crate::manifest::{Manifest, PartsBy, file_inside};
use crate::store::File;
use crate::volume::Opened;
use serde_json::{Map, Value};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// What differs between a set and another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The place in the index, or the table, its row and its column.
    pub what: String,
    /// What the new one has.
    pub found: String,
    /// What the old one has.
    pub expected: String,
}

impl Difference {
    fn new(what: impl Into<String>, found: impl ToString, expected: impl ToString) -> Self {
        Difference {
            what: what.into(),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }
}

/// Members of the index that are of the program, of the files or of a choice.
const OF_FILES: [&str; 6] = [
    "generator",
    "layers",
    "tables",
    "selection",
    "lod",
    "checksum",
];
/// Totals that depend on where cells end.
const BY_CELLS: [&str; 7] = [
    "cells",
    "necks",
    "walls",
    "surfaces",
    "tile_vertices",
    "strips",
    "strip_indices",
];

/// How a volume that is opened again differs from what a set was made from, as far as it says of itself.
pub fn differences_of_volume(manifest: &Manifest, opened: &Opened) -> Result<Vec<Difference>> {
    let (header, source) = (opened.volume.header(), &manifest.source);
    let (dims, dtype) = match &opened.filtered {
        Some(before) => (before.dims, before.dtype),
        None => (header.dims, header.dtype),
    };
    let none = || "none".to_owned();
    let values = |of: &Option<String>| of.clone().unwrap_or_else(none);
    let filtered = manifest.filtered_dims()?;
    let placed = |of: &crate::grid::Placement| format!("{:?} {}", of.spacing, of.unit);
    let own = [
        Difference::new("voxels", dims, source.dims),
        Difference::new("samples", dtype, source.dtype),
        Difference::new("voxels after filters", header.dims, filtered),
        Difference::new(
            "rule of values",
            values(&opened.values),
            values(&source.values),
        ),
        Difference::new(
            "size of a voxel after filters",
            placed(&header.placement),
            placed(&manifest.placement),
        ),
    ];
    let differ = |d: &Difference| d.found != d.expected;
    Ok(own.into_iter().filter(differ).collect())
}

/// What differs between the set in the directory `made` and that of `manifest` in `old`, though only the ratio should: in the
/// index, in the tables of objects and of components.
///
/// # Errors
/// What reading returns.
pub fn differences(old: &Path, manifest: &Manifest, made: &Path) -> Result<Vec<Difference>> {
    let new = Manifest::open(made)?;
    let mut all = Vec::new();
    compare("", &fixed(&new, manifest), &fixed(manifest, &new), &mut all);
    let (ours, theirs) = (&new.tables, &manifest.tables);
    let of_parts = theirs.components.as_ref().unwrap_or(&theirs.cells);
    let pairs = [
        (Some(&ours.objects), &theirs.objects),
        (ours.components.as_ref(), of_parts),
    ];
    for (ours, theirs) in pairs {
        if let Some(ours) = ours {
            all.extend(first_in_table((made, ours), (old, theirs))?);
        }
    }
    Ok(all)
}

/// How the file of a volume is named and written, where this differs from what the set says.
pub fn renamed(manifest: &Manifest, opened: &Opened) -> Option<String> {
    let (name, source) = (&opened.name, &manifest.source);
    let format = opened.volume.header().format;
    let less = match format == source.format {
        true => String::new(),
        false => format!(
            ", and it is {format}, not {}: byte order, offset and where sizes come from are not compared",
            source.format
        ),
    };
    (*name != source.name).then(|| {
        format!(
            "the volume is named {name:?}, the source {:?}{less}",
            source.name
        )
    })
}

/// The index as JSON without what another ratio, another name, or another form of the file may change from that of `other`.
fn fixed(manifest: &Manifest, other: &Manifest) -> Value {
    let mut json = serde_json::to_value(manifest).expect("plain data serialises");
    let members = json.as_object_mut().expect("it is an object");
    OF_FILES.iter().for_each(|name| drop(members.remove(*name)));
    let totals = object(members, "totals");
    let cells = totals.get("cells").cloned();
    totals
        .entry("components")
        .or_insert(cells.unwrap_or_default());
    BY_CELLS.iter().for_each(|name| drop(totals.remove(*name)));
    totals.remove("bytes");
    let source = object(members, "source");
    source.remove("name");
    // the same samples may lie in a file of another form
    if manifest.source.name != other.source.name && manifest.source.format != other.source.format {
        let form = ["format", "endian", "offset", "provenance"];
        form.iter().for_each(|name| drop(source.remove(*name)));
    }
    match (&manifest.cells, &other.cells) {
        (Some(PartsBy::Split { .. }), Some(PartsBy::Split { .. })) => {
            object(members, "cells").remove("ratio_permille");
        }
        _ => drop(members.remove("cells")),
    }
    json
}

fn object<'a>(members: &'a mut Map<String, Value>, name: &str) -> &'a mut Map<String, Value> {
    let member = members.entry(name).or_insert_with(|| Map::new().into());
    member.as_object_mut().expect("it is an object")
}

/// Adds what differs between two values at a path.
fn compare(path: &str, found: &Value, expected: &Value, all: &mut Vec<Difference>) {
    if let (Value::Object(found), Value::Object(expected)) = (found, expected) {
        let mut names: Vec<&String> = expected.keys().chain(found.keys()).collect();
        names.sort();
        names.dedup();
        for name in names {
            let of = |map: &Map<String, Value>| map.get(name).cloned().unwrap_or_default();
            let below = match path {
                "" => name.clone(),
                path => format!("{path}/{name}"),
            };
            compare(&below, &of(found), &of(expected), all);
        }
    } else if found != expected {
        let text = |value: &Value| match value {
            Value::Null => "none".to_owned(),
            value => value.to_string(),
        };
        all.push(Difference::new(path, text(found), text(expected)));
    }
}

/// The first difference between two tables, where the old one may have more columns behind.
fn first_in_table(new: (&Path, &str), old: (&Path, &str)) -> Result<Option<Difference>> {
    let (path, mut new) = lines(new)?;
    let (_, mut old) = lines(old)?;
    let mut columns = Vec::new();
    loop {
        let (found, expected) = (new.next().transpose(), old.next().transpose());
        let failed = |e| Error::io(&path, "read the table", e);
        let (found, expected) = (found.map_err(failed)?, expected.map_err(failed)?);
        if found.is_none() && expected.is_none() {
            return Ok(None);
        }
        let split = |line: Option<String>| -> Vec<String> {
            line.iter()
                .flat_map(|l| l.split(','))
                .map(str::to_owned)
                .collect()
        };
        let (found, mut expected) = (split(found), split(expected));
        if columns.is_empty() {
            columns.clone_from(&found);
        }
        // neighbours and walls are of cells
        expected.truncate(columns.len());
        if found == expected {
            continue;
        }
        let at = (0..columns.len()).find(|&i| found.get(i) != expected.get(i));
        let at = at.unwrap_or_default();
        let value = |of: &[String]| of.get(at).map_or("none".to_owned(), |v| format!("\"{v}\""));
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let row = found.first().or(expected.first());
        let row = row.map_or("", String::as_str);
        let what = format!("{name}: {} of {row}", columns[at]);
        return Ok(Some(Difference::new(what, value(&found), value(&expected))));
    }
}

type Lines = std::io::Lines<BufReader<File>>;

fn lines((dir, name): (&Path, &str)) -> Result<(PathBuf, Lines)> {
    let path = file_inside(dir, name, "open the table")?;
    let file = File::open(&path).map_err(|e| Error::io(&path, "read the table", e))?;
    Ok((path, BufReader::with_capacity(1 << 16, file).lines()))
}
