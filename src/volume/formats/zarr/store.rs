//! The nodes of a hierarchy: metadata in files of their own, or consolidated in one of a group above.

use crate::error::{Error, Result};
use crate::store::{is_file, is_remote};
use crate::volume::formats::zarr::meta::{Array, Meta};
use crate::volume::io::data;
use serde_json::Value;
use std::io::{ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

/// Longer metadata are damaged.
const MAX_JSON: u64 = 16 << 20;
/// Groups in groups beyond this are not looked into.
pub(crate) const MAX_DEPTH: usize = 6;

/// True for a folder that holds an array or group.
pub(crate) fn is_zarr(path: &Path) -> bool {
    // what is there but is no file is refused with its name
    let is_there = |path: &Path| path.exists() || is_remote(path) && is_file(path);
    let has = |folder: &Path, names: &[&str]| names.iter().any(|name| is_there(&folder.join(name)));
    if has(path, &[".zarray", ".zgroup", ".zmetadata", "zarr.json"]) {
        return true;
    }
    // perhaps a group above has its metadata
    let Ok(path) = absolute(path) else {
        return false;
    };
    let mut above = path.ancestors().skip(1).take(MAX_DEPTH);
    above.any(|group| has(group, &[".zmetadata", "zarr.json"]))
        && matches!(node(&path), Ok(Node::Array(_) | Node::Group(_)))
}

/// What a folder holds.
pub(crate) enum Node {
    Array(Box<Array>),
    /// With its attributes.
    Group(Value),
    Nothing,
}

/// A path from the root, in which `..` is no part.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf> {
    if is_remote(path) {
        return Ok(path.to_path_buf());
    }
    let fail = |e| Error::io(path, "open", e);
    let whole = std::path::absolute(path).map_err(fail)?;
    match whole.components().any(|c| c == Component::ParentDir) {
        true => path.canonicalize().map_err(fail),
        false => Ok(whole),
    }
}

/// The JSON of a file; `None` if there is none.
pub(crate) fn json(path: &Path) -> Result<Option<Value>> {
    if !is_remote(path) && !path.exists() {
        return Ok(None);
    }
    let file = match data::open_file(path) {
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => return Ok(None),
        open => open?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_JSON)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, "read", e))?;
    let value = serde_json::from_slice(&bytes);
    let value = value.or_else(|_| serde_json::from_slice(&with_words(&bytes)));
    match value {
        Ok(value) => Ok(Some(value)),
        Err(e) => Err(Error::format(path, format!("metadata with {e}"), "JSON")),
    }
}

/// JSON of Python, in which NaN and the infinities are bare words, with these as text.
fn with_words(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + 64);
    let (mut at, mut text) = (0, false);
    while let Some(&byte) = bytes.get(at) {
        let words: [&[u8]; 3] = [b"-Infinity", b"Infinity", b"NaN"];
        let word = words.into_iter().find(|w| bytes[at..].starts_with(w));
        match word.filter(|_| !text) {
            Some(word) => {
                out.extend([b"\"", word, b"\""].concat());
                at += word.len();
                continue;
            }
            None if text && byte == b'\\' => {
                out.extend(bytes[at..].iter().take(2));
                at += 2;
                continue;
            }
            None => text ^= byte == b'"',
        }
        out.push(byte);
        at += 1;
    }
    out
}

/// A document of a folder: its own file, or its part of what a group above has consolidated.
fn document(folder: &Path, name: &str) -> Result<Option<Value>> {
    let own = json(&folder.join(name))?;
    if own.is_some() {
        return Ok(own);
    }
    for above in folder.ancestors().take(MAX_DEPTH + 1) {
        let inner = folder.strip_prefix(above).unwrap_or(folder);
        let (file, key) = match name {
            "zarr.json" => (name, inner.to_path_buf()),
            _ => (".zmetadata", inner.join(name)),
        };
        let (Some(all), Some(key)) = (json(&above.join(file))?, key.to_str()) else {
            continue;
        };
        let all = match name {
            "zarr.json" => &all["consolidated_metadata"]["metadata"],
            _ => &all["metadata"],
        };
        if let Some(found) = all.get(key) {
            return Ok(Some(found.clone()));
        }
    }
    Ok(None)
}

/// Looks at a folder.
///
/// # Errors
/// [`Error::Format`] and [`Error::Unsupported`] for metadata that are damaged or not read.
pub(crate) fn node(folder: &Path) -> Result<Node> {
    let path = folder.join("zarr.json");
    if let Some(json) = document(folder, "zarr.json")? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return match json["node_type"].as_str() {
            Some("array") => Ok(Node::Array(Box::new(meta.version_3()?))),
            Some("group") => Ok(Node::Group(json["attributes"].clone())),
            other => Err(Error::format(
                &path,
                format!("{other:?}"),
                "an array or group",
            )),
        };
    }
    let path = folder.join(".zarray");
    let attributes = || Ok::<_, Error>(document(folder, ".zattrs")?.unwrap_or(Value::Null));
    if let Some(json) = document(folder, ".zarray")? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return Ok(Node::Array(Box::new(meta.version_2(attributes()?)?)));
    }
    match document(folder, ".zgroup")? {
        Some(_) => Ok(Node::Group(attributes()?)),
        None => Ok(Node::Nothing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bare_words_are_text() {
        let python = br#"{"a\"NaN": [NaN, -Infinity, Infinity, 1], "b": "NaN \" NaN"}"#;
        let json: Value = serde_json::from_slice(&with_words(python)).unwrap();
        let known = serde_json::json!({
            "a\"NaN": ["NaN", "-Infinity", "Infinity", 1], "b": "NaN \" NaN"
        });
        assert_eq!(json, known);
    }
}
