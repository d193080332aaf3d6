//! Zarr: values, axes, places and missing chunks are what the metadata of each convention state. The arrays are
//! written here, byte by byte.
#![cfg(feature = "zarr")]

mod chunks;
mod places;
mod values;
#[path = "../volume_common/mod.rs"]
mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, OpenOptions, Opened, open};
use alvis::{Error, Result};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::{TempDir, tempdir};
use volume_common::all;

/// Size along x, y and z.
const DIMS: [u32; 3] = [6, 5, 4];

/// The sample at (x, y, z), below 128.
fn sample([x, y, z]: [u64; 3]) -> i64 {
    (x + 6 * y + 30 * z) as i64
}

fn put(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// Calls `f` for every place of a grid, last axis fastest.
fn each(sizes: &[u64], mut f: impl FnMut(&[u64])) {
    let mut place = vec![0; sizes.len()];
    for i in 0..sizes.iter().product() {
        let mut rest: u64 = i;
        for (p, n) in place.iter_mut().zip(sizes).rev() {
            (*p, rest) = (rest % n, rest / n);
        }
        f(&place);
    }
}

/// Adds the members of an object to another.
fn with(mut json: Value, more: &Value) -> Value {
    for (name, value) in more.as_object().unwrap() {
        json[name] = value.clone();
    }
    json
}

/// Bytes of a chunk: `bytes` gives those of a sample.
fn chunk_of(place: &[u64], chunk: &[u64], bytes: &dyn Fn(&[u64]) -> Vec<u8>) -> Vec<u8> {
    let mut out = Vec::new();
    each(chunk, |inner| {
        let at = place
            .iter()
            .zip(chunk)
            .zip(inner)
            .map(|((p, c), i)| p * c + i);
        out.extend(bytes(&at.collect::<Vec<_>>()));
    });
    out
}

fn grid(shape: &[u64], chunk: &[u64]) -> Vec<u64> {
    shape
        .iter()
        .zip(chunk)
        .map(|(s, c)| s.div_ceil(*c))
        .collect()
}

fn key(place: &[u64], separator: &str) -> String {
    let words: Vec<String> = place.iter().map(u64::to_string).collect();
    words.join(separator)
}

/// Writes an array of version 2; `more` replaces metadata.
fn version_2(
    folder: &Path,
    [shape, chunk]: [&[u64]; 2],
    more: Value,
    bytes: &dyn Fn(&[u64]) -> Vec<u8>,
) {
    let meta = json!({
        "zarr_format": 2, "shape": shape, "chunks": chunk, "dtype": "<i2", "order": "C", "compressor": null,
        "fill_value": null, "filters": null,
    });
    put(&folder.join(".zarray"), &with(meta, &more).to_string());
    each(&grid(shape, chunk), |place| {
        let chunk = chunk_of(place, chunk, bytes);
        fs::write(folder.join(key(place, ".")), chunk).unwrap();
    });
}

/// The same of version 3.
fn version_3(
    folder: &Path,
    [shape, chunk]: [&[u64]; 2],
    more: Value,
    bytes: &dyn Fn(&[u64]) -> Vec<u8>,
) {
    let meta = json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": "int16", "fill_value": 0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
    });
    put(&folder.join("zarr.json"), &with(meta, &more).to_string());
    each(&grid(shape, chunk), |place| {
        let path = folder.join("c").join(key(place, "/"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, chunk_of(place, chunk, bytes)).unwrap();
    });
}

const ZYX: [u64; 3] = [4, 5, 6];
const CHUNK: [u64; 3] = [2, 3, 4];

/// i16 samples of an array with the axes z, y and x.
fn zyx(at: &[u64]) -> Vec<u8> {
    (sample([at[2], at[1], at[0]]) as i16)
        .to_le_bytes()
        .to_vec()
}

fn xyz(at: &[u64]) -> Vec<u8> {
    (sample([at[0], at[1], at[2]]) as i16)
        .to_le_bytes()
        .to_vec()
}

/// An array of version 2 with attributes.
fn plain(attributes: &str, more: Value) -> TempDir {
    let dir = tempdir().unwrap();
    version_2(dir.path(), [&ZYX, &CHUNK], more, &zyx);
    put(&dir.path().join(".zattrs"), attributes);
    dir
}

fn read(path: &Path) -> Opened {
    open(path, &OpenOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn refusal(path: &Path, options: &OpenOptions) -> Error {
    open(path, options).map(|_| ()).unwrap_err()
}

/// All samples as numbers, x fastest.
fn numbers(opened: &Opened) -> Vec<f64> {
    let bytes = all(&*opened.volume).unwrap();
    let size = opened.volume.header().dtype.bytes();
    let number = |b: &[u8]| match opened.volume.header().dtype {
        Dtype::U8 => b[0].into(),
        Dtype::I8 => (b[0] as i8).into(),
        Dtype::U16 => u16::from_ne_bytes([b[0], b[1]]).into(),
        Dtype::I16 => i16::from_ne_bytes([b[0], b[1]]).into(),
        Dtype::F32 => f32::from_ne_bytes(b.try_into().unwrap()).into(),
        Dtype::F64 => f64::from_ne_bytes(b.try_into().unwrap()),
        other => panic!("{other}"),
    };
    bytes.chunks_exact(size).map(number).collect()
}

/// Asserts that each value follows from the sample at its place.
fn assert_values(opened: &Opened, value: impl Fn(i64) -> f64) {
    assert_eq!(opened.volume.header().dims.0, DIMS);
    for (i, found) in numbers(opened).into_iter().enumerate() {
        let known = value(i as i64);
        assert!(
            found == known || (found.is_nan() && known.is_nan()),
            "{i}: {found} and not {known}"
        );
    }
}

fn assert_plain(opened: &Opened) {
    assert_values(opened, |v| v as f64);
    assert_eq!(opened.values, None);
}

/// Metadata of a pyramid whose only level is `0`.
fn pyramid(group: &Path, version: &str, axes: Value, transforms: Value, more: Value) {
    let datasets = json!([{"path": "0", "coordinateTransformations": transforms}]);
    let one = with(json!({"datasets": datasets, "version": version}), &more);
    let one = match axes.is_null() {
        true => one,
        false => with(one, &json!({"axes": axes})),
    };
    if version == "0.4" {
        put(&group.join(".zgroup"), r#"{"zarr_format": 2}"#);
        put(
            &group.join(".zattrs"),
            &json!({"multiscales": [one]}).to_string(),
        );
    } else {
        let attributes = json!({"ome": {"version": version, "multiscales": [one]}});
        let meta = json!({"zarr_format": 3, "node_type": "group", "attributes": attributes});
        put(&group.join("zarr.json"), &meta.to_string());
    }
}
