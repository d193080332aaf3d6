//! Faults: one thing about the files of a tile set is changed.

use crate::common::seal::sealed;
use crate::random::Random;
use serde_json::Value;
use std::collections::BTreeMap;

/// All files of a tile set by their relative path.
pub type Files = BTreeMap<String, Vec<u8>>;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    BitFlip,
    BytesCut,
    BytesAdded,
    FilesSwapped,
    NumberEdited,
    FieldEdited,
    FileRemoved,
    FileRenamed,
    Replayed,
    MemberAdded,
    MemberTwice,
    MemberRemoved,
}

impl Kind {
    pub const ALL: [Kind; 12] = [
        Kind::BitFlip,
        Kind::BytesCut,
        Kind::BytesAdded,
        Kind::FilesSwapped,
        Kind::NumberEdited,
        Kind::FieldEdited,
        Kind::FileRemoved,
        Kind::FileRenamed,
        Kind::Replayed,
        Kind::MemberAdded,
        Kind::MemberTwice,
        Kind::MemberRemoved,
    ];
    /// Which kind the faults are, in turns: mostly those that have most places.
    const TURNS: [Kind; 19] = [
        Kind::BitFlip,
        Kind::FieldEdited,
        Kind::BitFlip,
        Kind::NumberEdited,
        Kind::BitFlip,
        Kind::BytesCut,
        Kind::BitFlip,
        Kind::FieldEdited,
        Kind::BitFlip,
        Kind::NumberEdited,
        Kind::BytesAdded,
        Kind::FilesSwapped,
        Kind::BitFlip,
        Kind::Replayed,
        Kind::FileRemoved,
        Kind::FileRenamed,
        Kind::MemberAdded,
        Kind::MemberTwice,
        Kind::MemberRemoved,
    ];

    pub fn turn(i: u64) -> Kind {
        Self::TURNS[(i % Self::TURNS.len() as u64) as usize]
    }
}

/// Changes one thing; says what. Nothing may have changed, as when two equal files are swapped.
/// `others` are the same volume's tile sets of other conversions.
pub fn apply(kind: Kind, files: &mut Files, others: &[Files], random: &mut Random) -> String {
    let name = any_file(files, random);
    let bytes = files.get_mut(&name).unwrap();
    match kind {
        Kind::BitFlip => {
            let (at, bit) = (random.below(bytes.len()), random.below(8));
            bytes[at] ^= 1 << bit;
            format!("{name}: bit {bit} of byte {at}")
        }
        Kind::BytesCut => {
            let from = random.below(bytes.len());
            let end = match random.below(2) {
                0 => bytes.len(),
                _ => (from + 1 + random.below(16)).min(bytes.len()),
            };
            bytes.drain(from..end);
            format!("{name}: bytes {from} to {end} cut")
        }
        Kind::BytesAdded => {
            let at = [bytes.len(), random.below(bytes.len())][random.below(2)];
            let new: Vec<u8> = (0..1 + random.below(8))
                .map(|_| random.next() as u8)
                .collect();
            let _ = bytes.splice(at..at, new.iter().copied()).count();
            format!("{name}: {new:?} added at {at}")
        }
        Kind::FilesSwapped => {
            let names: Vec<String> = files.keys().cloned().collect();
            let end = name.rsplit('.').next().unwrap();
            let same: Vec<&String> = names.iter().filter(|n| n.ends_with(end)).collect();
            let other = random.pick(&same).to_string();
            let [a, b] = [&name, &other].map(|n| files[n].clone());
            files.insert(name.clone(), b);
            files.insert(other.clone(), a);
            format!("{name} and {other} swapped")
        }
        Kind::NumberEdited => edit_number(files, random),
        Kind::FieldEdited => edit_field(files, random),
        Kind::MemberAdded | Kind::MemberTwice | Kind::MemberRemoved => {
            edit_member(kind, files, random)
        }
        Kind::FileRemoved => {
            files.remove(&name);
            format!("{name} removed")
        }
        Kind::FileRenamed => {
            let bytes = files.remove(&name).unwrap();
            files.insert(format!("{name}.old"), bytes);
            format!("{name} renamed")
        }
        Kind::Replayed => {
            let i = random.below(others.len());
            let Some(old) = others[i].get(&name) else {
                return format!("{name} is not in the other conversion");
            };
            files.insert(name.clone(), old.clone());
            format!("{name} from conversion {i}")
        }
    }
}

/// Files of each kind are as likely, not those with most files.
fn any_file(files: &Files, random: &mut Random) -> String {
    let group = ["tiles/", "tiles/", "tiles/", "index/", "index.json", ".csv"][random.below(6)];
    let names: Vec<&String> = files.keys().filter(|n| n.contains(group)).collect();
    random.pick(&names).to_string()
}

/// A JSON of the manifest, a shard or a tile: the file's name, and where it lies in its bytes.
fn any_json(files: &Files, random: &mut Random) -> (String, std::ops::Range<usize>) {
    let group = ["index.json", "index/", ".glb"][random.below(3)];
    let names: Vec<&String> = files.keys().filter(|n| n.contains(group)).collect();
    let name = random.pick(&names).to_string();
    let bytes = &files[&name];
    let place = if name.ends_with(".glb") {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap());
        20..20 + length as usize
    } else {
        0..bytes.len()
    };
    (name, place)
}

/// Puts a text in the place of a JSON; a tile's chunk has as many bytes as it needs.
fn put_json(files: &mut Files, (name, place): (&str, std::ops::Range<usize>), mut text: Vec<u8>) {
    let bytes = files.get_mut(name).unwrap();
    if name.ends_with(".glb") {
        text.resize(text.len().max(place.len()).next_multiple_of(4), b' ');
    }
    let (before, after) = (place.len(), text.len());
    bytes.splice(place, text);
    if name.ends_with(".glb") {
        let length = bytes.len() as u32;
        bytes[8..12].copy_from_slice(&length.to_le_bytes());
        bytes[12..16].copy_from_slice(&(after as u32).to_le_bytes());
        assert!(after >= before);
    }
}

/// Adds a member to an object, writes one twice, or removes one.
fn edit_member(kind: Kind, files: &mut Files, random: &mut Random) -> String {
    const NAMES: [&str; 12] = [
        "extras",
        "extensions",
        "name",
        "min",
        "max",
        "weights",
        "uri",
        "scale",
        "noData",
        "unit",
        "cell",
        "x",
    ];
    const MARK: &str = "marked-member";
    let (name, place) = any_json(files, random);
    let mut value: Value = serde_json::from_slice(&files[&name][place.clone()]).unwrap();
    let mut objects = Vec::new();
    collect_objects(&value, String::new(), &mut objects);
    let at = random.pick(&objects).clone();
    let object = value.pointer_mut(&at).unwrap().as_object_mut().unwrap();
    let keys: Vec<String> = object.keys().cloned().collect();
    let key = if keys.is_empty() {
        "x".to_owned()
    } else {
        random.pick(&keys).clone()
    };
    let told = match kind {
        Kind::MemberRemoved => {
            object.remove(&key);
            format!("{name}: {key} of {at:?} removed")
        }
        Kind::MemberTwice if !keys.is_empty() => {
            object.insert(MARK.into(), object[&key].clone());
            format!("{name}: {key} of {at:?} twice")
        }
        _ => {
            let new = random.pick(&NAMES);
            if object.contains_key(*new) {
                return format!("{name}: {at:?} has {new}");
            }
            object.insert(new.to_string(), random.below(9).into());
            format!("{name}: {new} added to {at:?}")
        }
    };
    let text = serde_json::to_string(&value).unwrap();
    put_json(files, (&name, place), text.replace(MARK, &key).into_bytes());
    told
}

/// JSON pointers of all objects.
fn collect_objects(value: &Value, at: String, out: &mut Vec<String>) {
    match value {
        Value::Array(items) => {
            let all = items.iter().enumerate();
            all.for_each(|(i, v)| collect_objects(v, format!("{at}/{i}"), out));
        }
        Value::Object(members) => {
            let all = members.iter();
            all.for_each(|(k, v)| collect_objects(v, format!("{at}/{k}"), out));
            out.push(at);
        }
        _ => {}
    }
}

/// Changes a number of the manifest, a shard, or the JSON of a tile.
fn edit_number(files: &mut Files, random: &mut Random) -> String {
    let (name, place) = any_json(files, random);
    let mut value: Value = serde_json::from_slice(&files[&name][place.clone()]).unwrap();
    let mut numbers = Vec::new();
    collect(&mut value, &mut numbers);
    let at = random.below(numbers.len());
    let number: &mut Value = numbers.swap_remove(at);
    let old = number.clone();
    *number = match (number.as_i64(), random.below(4)) {
        (Some(n), 0) => (n + 1).into(),
        (Some(n), 1) => (n - 1).into(),
        (Some(n), 2) => (n * 2 + 3).into(),
        (None, 0) => (number.as_f64().unwrap() * 1.001 + 0.01).into(),
        (None, 1) => (-number.as_f64().unwrap() - 0.5).into(),
        _ => (random.below(7) as i64).into(),
    };
    let told = format!("{name}: number {at}, {old}, is {number}");
    let new = if name == "index.json" {
        serde_json::to_vec_pretty(&value).unwrap()
    } else {
        serde_json::to_vec(&value).unwrap()
    };
    put_json(files, (&name, place), new);
    told
}

fn collect<'a>(value: &'a mut Value, out: &mut Vec<&'a mut Value>) {
    match value {
        Value::Number(_) => out.push(value),
        Value::Array(items) => items.iter_mut().for_each(|v| collect(v, out)),
        Value::Object(items) => items.values_mut().for_each(|v| collect(v, out)),
        _ => {}
    }
}

/// Changes a field of a table, empties it, or moves a row.
fn edit_field(files: &mut Files, random: &mut Random) -> String {
    let name = *random.pick(&["cells.csv", "cells.csv", "objects.csv", "surfaces.csv"]);
    let text = String::from_utf8(files[name].clone()).unwrap();
    let mut lines: Vec<Vec<String>> = text
        .lines()
        .map(|l| l.split(',').map(str::to_owned).collect())
        .collect();
    let row = 1 + random.below(lines.len() - 1);
    let told = match random.below(16) {
        0 => {
            let other = 1 + random.below(lines.len() - 1);
            lines.swap(row, other);
            format!("{name}: rows {row} and {other} swapped")
        }
        1 => {
            lines.remove(row);
            format!("{name}: row {row} removed")
        }
        _ => {
            let column = random.below(lines[0].len());
            let title = lines[0][column].clone();
            let field = &mut lines[row][column];
            let old = field.clone();
            *field = match (field.parse::<f64>(), random.below(4)) {
                (_, 0) => String::new(),
                (Ok(v), 1) => (v * 1.0001).to_string(),
                (Ok(v), 2) => (v + 1.0).to_string(),
                (Ok(v), _) => (-v).to_string(),
                (Err(_), _) => "1".to_owned(),
            };
            format!("{name}: row {row}, {title}: {old:?} is {field:?}")
        }
    };
    let text: Vec<String> = lines.iter().map(|l| l.join(",")).collect();
    files.insert(name.into(), (text.join("\n") + "\n").into_bytes());
    told
}

/// Makes all sizes and checksums agree with the files, as somebody would who means it.
pub fn mend(files: &mut Files) {
    let crc = |bytes: &[u8]| Value::from(format!("crc32:{:08x}", crc32fast::hash(bytes)));
    let Ok(mut manifest) = files.get("index.json").map_or(Err(()), |b| {
        serde_json::from_slice::<Value>(b).map_err(|_| ())
    }) else {
        return;
    };
    let shards: Vec<String> = files
        .keys()
        .filter(|n| n.starts_with("index/"))
        .cloned()
        .collect();
    for name in shards {
        let Ok(mut shard) = serde_json::from_slice::<Value>(&files[&name]) else {
            continue;
        };
        for entry in shard["tiles"].as_array_mut().into_iter().flatten() {
            let file = entry["path"].as_str().and_then(|p| files.get(p));
            if let Some(file) = file {
                entry["bytes"] = file.len().into();
                entry["checksum"] = crc(file);
            }
        }
        files.insert(name, serde_json::to_vec(&shard).unwrap());
    }
    for layer in manifest["layers"].as_array_mut().into_iter().flatten() {
        if let Some(file) = layer["path"].as_str().and_then(|p| files.get(p)) {
            layer["bytes"] = file.len().into();
            layer["checksum"] = crc(file);
        }
    }
    let text = sealed(manifest, |name| files.get(name).cloned());
    files.insert("index.json".into(), text);
}
