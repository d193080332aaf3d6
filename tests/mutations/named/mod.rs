//! Faults with a name: what somebody may add to a sound set, or change in it, and make the rest agree with.
//! Each is found, by the code that it has.

mod bytes;
mod choices;
mod list;
mod values;

use crate::common;
use crate::faults::{Files, mend};
use crate::{Place, volume};
use alvis::convert::{ConvertOptions, convert};
use alvis::grid::Provenance;
use alvis::manifest::{Encoding, Form, Layout};
use alvis::progress::Quiet;
use alvis::table::{Chosen, Table};
use alvis::transform::select::{ColourRule, Map, PaintRule, SelectOptions, select};
use alvis::verify::{SourceVolume, VerifyOptions, verify};
use alvis::volume::Volume;
use serde_json::Value;
use std::collections::BTreeMap;

/// The sets that are changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Base {
    Nodes,
    Merged,
    Web,
    Quantized,
    Part,
    Painted,
    /// Some objects, painted.
    Objects,
    /// Some surfaces.
    Surfaces,
    /// Some objects, and of these what borders some cells.
    Twice,
}
use Base::{Merged, Nodes, Objects, Painted, Part, Quantized, Surfaces, Twice, Web};
use bytes::OF_BYTES;
use choices::OF_CHOICES;
use list::{AGAINST, OF_INDEX, OF_PARTS, OF_TILES};
use values::{OF_VALUES, in_lists};

pub type Edit = fn(&mut Files);

/// Changes the JSON of all tiles; the second argument is the BIN chunk.
pub fn tiles(files: &mut Files, edit: impl Fn(&mut Value, &mut Vec<u8>)) {
    for bytes in files
        .iter_mut()
        .filter(|f| f.0.ends_with(".glb"))
        .map(|f| f.1)
    {
        let (mut json, bin) = common::glb::chunks(bytes);
        let mut bin = bin.to_vec();
        edit(&mut json, &mut bin);
        *bytes = glb(json.to_string(), &bin);
    }
}

/// Changes the text of the JSON of all tiles.
pub fn texts(files: &mut Files, from: &str, to: &str) {
    for bytes in files
        .iter_mut()
        .filter(|f| f.0.ends_with(".glb"))
        .map(|f| f.1)
    {
        let (json, bin) = common::glb::chunks(bytes);
        *bytes = glb(json.to_string().replacen(from, to, 1), bin);
    }
}

/// Replaces the files of all tiles.
pub fn files(files: &mut Files, edit: impl Fn(&[u8], &[u8]) -> Vec<u8>) {
    for bytes in files
        .iter_mut()
        .filter(|f| f.0.ends_with(".glb"))
        .map(|f| f.1)
    {
        let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        *bytes = edit(&bytes[20..20 + json], &bytes[28 + json..]);
    }
}

pub fn glb(mut json: String, bin: &[u8]) -> Vec<u8> {
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let word = |v: usize, out: &mut Vec<u8>| out.extend((v as u32).to_le_bytes());
    for v in [2, 28 + json.len() + bin.len(), json.len()] {
        word(v, &mut out);
    }
    out.extend(b"JSON");
    out.extend(json.as_bytes());
    word(bin.len(), &mut out);
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

/// Changes a JSON file.
pub fn json_of(files: &mut Files, name: &str, edit: impl FnOnce(&mut Value)) {
    let mut value = serde_json::from_slice(&files[name]).unwrap();
    edit(&mut value);
    files.insert(name.into(), serde_json::to_vec_pretty(&value).unwrap());
}

pub fn index(files: &mut Files, edit: impl FnOnce(&mut Value)) {
    json_of(files, "index.json", edit);
}

/// Changes a table's lines, the header among them.
pub fn table(files: &mut Files, name: &str, edit: impl FnOnce(&mut Vec<Vec<String>>)) {
    let text = String::from_utf8(files[name].clone()).unwrap();
    let fields = |l: &str| l.split(',').map(str::to_owned).collect();
    let mut lines: Vec<Vec<String>> = text.lines().map(fields).collect();
    edit(&mut lines);
    let lines: Vec<String> = lines.iter().map(|l| l.join(",")).collect();
    files.insert(name.into(), (lines.join("\n") + "\n").into_bytes());
}

pub fn column(lines: &[Vec<String>], name: &str) -> usize {
    lines[0]
        .iter()
        .position(|c| c.split(' ').next() == Some(name))
        .unwrap()
}

/// Gives ids others, in tiles, shards and tables; rows are sorted by them.
pub fn exchange(files: &mut Files, what: &str, ids: [u64; 2]) {
    let other = |id: u64| match ids.iter().position(|i| *i == id) {
        Some(i) => ids[1 - i],
        None => id,
    };
    tiles(files, |json, _| {
        for i in 1..json["nodes"].as_array().unwrap().len() {
            let extras = &mut json["nodes"][i]["extras"];
            extras[what] = other(extras[what].as_u64().unwrap()).into();
            let name = match (what, extras["object"].as_u64()) {
                ("cell", _) => json["nodes"][i]["name"].as_str().unwrap().replacen(
                    &format!(
                        "cell_{}",
                        other(json["nodes"][i]["extras"]["cell"].as_u64().unwrap())
                    ),
                    &format!("cell_{}", json["nodes"][i]["extras"]["cell"]),
                    1,
                ),
                _ => continue,
            };
            json["meshes"][i - 1]["name"] = name.clone().into();
            json["nodes"][i]["name"] = name.into();
        }
    });
    let shards: Vec<String> = files
        .keys()
        .filter(|n| n.starts_with("index/"))
        .cloned()
        .collect();
    for shard in shards {
        json_of(files, &shard, |s| {
            for tile in s["tiles"].as_array_mut().unwrap() {
                for group in tile["groups"].as_array_mut().unwrap() {
                    group[what] = other(group[what].as_u64().unwrap()).into();
                }
            }
        });
    }
    let number = |field: &str| field.parse::<u64>().unwrap();
    for name in ["cells.csv", "objects.csv", "surfaces.csv"] {
        let of = if name == format!("{what}s.csv") {
            "id"
        } else {
            what
        };
        table(files, name, |lines| {
            let Some(at) = lines[0].iter().position(|c| c == of) else {
                return;
            };
            for line in &mut lines[1..] {
                line[at] = other(number(&line[at])).to_string();
            }
            lines[1..].sort_by_key(|l| number(&l[0]));
        });
    }
}

/// Sizes, checksums and the sum of bytes agree with the files again.
fn seal(files: &mut Files) {
    let bytes: usize = files
        .iter()
        .filter(|f| f.0.ends_with(".glb"))
        .map(|f| f.1.len())
        .sum();
    if files.contains_key("index.json") {
        index(files, |m| m["totals"]["bytes"] = bytes.into());
    }
    mend(files);
}

fn bases(dir: &std::path::Path) -> BTreeMap<Base, Files> {
    let options = |form: Form| ConvertOptions {
        primitives: form.primitives,
        encoding: form.encoding,
        layout: form.layout,
        threshold: 128.0,
        macrocube: [7, 6, 5],
        source_name: "volume.raw".into(),
        ..ConvertOptions::default()
    };
    let merged = ConvertOptions {
        layout: Layout::Merged,
        ..options(Form::BLENDER)
    };
    let quantized = ConvertOptions {
        encoding: Encoding::Quantized,
        ..options(Form::BLENDER)
    };
    let make = |name: &str, options: &ConvertOptions| {
        convert(&volume(0.0), options, &dir.join(name), &Quiet).unwrap();
        common::files(&dir.join(name))
    };
    let mut out = BTreeMap::from([
        (Nodes, make("nodes", &options(Form::BLENDER))),
        (Merged, make("merged", &merged)),
        (Web, make("web", &options(Form::WEB))),
        (Quantized, make("quantized", &quantized)),
    ]);
    let part = SelectOptions {
        chosen: Chosen::cells("not touches_border"),
        paint: vec![PaintRule {
            condition: "best:1".into(),
            colour: [255, 136, 0],
        }],
        colour_by: Some(ColourRule {
            column: "volume".into(),
            map: Map::default(),
            range: None,
        }),
        ..SelectOptions::default()
    };
    select(&dir.join("nodes"), &dir.join("part"), &part, &Quiet).unwrap();
    out.insert(Part, common::files(&dir.join("part")));
    let painted = SelectOptions {
        chosen: Chosen::default(),
        ..part
    };
    select(&dir.join("nodes"), &dir.join("painted"), &painted, &Quiet).unwrap();
    out.insert(Painted, common::files(&dir.join("painted")));
    chosen(dir, &mut out);
    out
}

/// Parts that are chosen by objects and by surfaces.
fn chosen(dir: &std::path::Path, out: &mut BTreeMap<Base, Files>) {
    let by = |table: Table, condition: &str, largest| SelectOptions {
        chosen: Chosen {
            table,
            condition: Some(condition.into()),
            largest,
        },
        ..SelectOptions::default()
    };
    let mut make = |base: Base, from: &str, name: &str, options: &SelectOptions| {
        select(&dir.join(from), &dir.join(name), options, &Quiet).unwrap();
        out.insert(base, common::files(&dir.join(name)));
    };
    let paint = vec![PaintRule {
        condition: "voxels > 20".into(),
        colour: [255, 136, 0],
    }];
    let objects = SelectOptions {
        paint,
        ..by(Table::Objects, "voxels > 0", Some(1))
    };
    make(Objects, "nodes", "objects", &objects);
    let surfaces = by(Table::Surfaces, "area > 1", Some(3));
    make(Surfaces, "nodes", "surfaces", &surfaces);
    let cells = by(Table::Cells, "voxels > 20", None);
    make(Twice, "objects", "twice", &cells);
}

#[test]
fn faults_with_a_name_are_found() {
    let temporary = tempfile::tempdir().unwrap();
    let bases = bases(temporary.path());
    let dir = temporary.path().join("changed");
    let mut place = Place {
        dir: dir.clone(),
        holds: Files::new(),
    };
    let volume = volume(0.0);
    let source = SourceVolume {
        name: "volume.raw".into(),
        header: volume.header().clone(),
        offset: 0,
        values: None,
        filters: Vec::new(),
        provenance: Provenance::default(),
    };
    let mut check = |base: Base, files: &mut Files| {
        seal(files);
        place.put(files);
        let whole = ![Part, Objects, Surfaces, Twice].contains(&base);
        let options = VerifyOptions {
            against: whole.then_some(&volume as &dyn Volume),
            source: whole.then_some(&source),
            ..VerifyOptions::default()
        };
        verify(&dir, &options, &Quiet).unwrap()
    };
    for (base, files) in &bases {
        let report = check(*base, &mut files.clone());
        assert!(
            report.ok && report.issues.is_empty(),
            "{base:?}: {:#?}",
            report.issues
        );
    }
    let mut wrong = Vec::new();
    for (name, base, code, edit) in [
        OF_TILES, OF_BYTES, OF_INDEX, OF_PARTS, OF_CHOICES, OF_VALUES, AGAINST,
    ]
    .concat()
    {
        let mut files = bases[&base].clone();
        edit(&mut files);
        let report = check(base, &mut files);
        if report.ok || !report.issues.iter().any(|i| i.code == code) {
            let found: Vec<_> = report.issues.iter().map(|i| (i.code, &i.message)).collect();
            wrong.push(format!("{name}: expected {}, found {found:?}", code.name()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A value in a list of its own is another value, whatever the member.
#[test]
fn no_value_is_taken_out_of_a_list() {
    let temporary = tempfile::tempdir().unwrap();
    let mut place = Place {
        dir: temporary.path().join("changed"),
        holds: Files::new(),
    };
    let mut passed = Vec::new();
    for (base, sound) in bases(temporary.path()) {
        let mut check = |name: &str, at: &str, text: Vec<u8>| {
            // what is made to agree is no list any more
            if at.ends_with("/bytes") || at.contains("/checksum") {
                return;
            }
            let mut changed = sound.clone();
            changed.insert(name.into(), text);
            seal(&mut changed);
            place.put(&changed);
            if verify(&place.dir, &VerifyOptions::default(), &Quiet).is_ok_and(|r| r.ok) {
                passed.push(format!("{base:?}: {name}#{at}"));
            }
        };
        for name in ["index.json", "index/z0000.json"] {
            let json = serde_json::from_slice(&sound[name]).unwrap();
            in_lists(&json, |at, changed| {
                check(name, at, serde_json::to_vec(&changed).unwrap());
            });
        }
        let tile = sound.keys().rfind(|name| name.ends_with(".glb")).unwrap();
        let (json, bin) = common::glb::chunks(&sound[tile]);
        in_lists(&json, |at, changed| {
            check(tile, at, glb(changed.to_string(), bin));
        });
    }
    assert!(passed.is_empty(), "{}", passed.join("\n"));
}
