//! Zarr: values, axes, places and missing chunks are what the metadata of each convention state. The arrays are
//! written here, byte by byte.
#![cfg(feature = "zarr")]

mod volume_common;

use alvis::grid::Unit;
use alvis::manifest::Origin;
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

#[test]
fn scales_are_applied() {
    let packed = plain(
        r#"{"_ARRAY_DIMENSIONS": ["z", "y", "x"], "scale_factor": 0.5, "add_offset": -3.0, "missing_value": [7, NaN]}"#,
        json!({"fill_value": 11}),
    );
    let opened = read(packed.path());
    let known = |v: i64| {
        if [7, 11].contains(&v) {
            f64::NAN
        } else {
            0.5 * v as f64 - 3.0
        }
    };
    assert_values(&opened, known);
    let text = opened.values.unwrap();
    assert!(
        text.contains("0.5 * stored - 3") && text.contains("7, 11"),
        "{text}"
    );
    // without xarray's names the value of missing chunks is one like others
    let own = plain(r#"{"units": "1"}"#, json!({"fill_value": 11}));
    assert_plain(&read(own.path()));
    let zero = plain(
        r#"{"_ARRAY_DIMENSIONS": ["z", "y", "x"]}"#,
        json!({"fill_value": 0}),
    );
    assert_plain(&read(zero.path()));
    let error = refusal(
        plain(r#"{"scale_factor": "half"}"#, json!({})).path(),
        &OpenOptions::default(),
    );
    assert!(error.to_string().contains("scale_factor"), "{error}");
}

#[test]
fn scales_of_version_3_and_signs() {
    let dir = tempdir().unwrap();
    let float = |at: &[u64]| {
        (sample([at[2], at[1], at[0]]) as f32)
            .to_le_bytes()
            .to_vec()
    };
    // xarray writes 99 so; the value of missing chunks is another
    let attributes = json!({"_FillValue": "AAAAAADAWEA=", "scale_factor": 2.0});
    let more = json!({"data_type": "float32", "attributes": attributes, "dimension_names": ["z", "y", "x"]});
    version_3(dir.path(), [&ZYX, &CHUNK], more, &float);
    assert_values(&read(dir.path()), |v| {
        if v == 99 { f64::NAN } else { 2.0 * v as f64 }
    });
    let dir = tempdir().unwrap();
    let byte = |at: &[u64]| vec![(sample([at[2], at[1], at[0]]) + 100) as u8];
    let more = json!({"dtype": "|i1", "fill_value": -1});
    version_2(dir.path(), [&ZYX, &CHUNK], more, &byte);
    put(
        &dir.path().join(".zattrs"),
        r#"{"_Unsigned": "true", "_FillValue": -56}"#,
    );
    let opened = read(dir.path());
    assert_values(
        &opened,
        |v| if v == 100 { f64::NAN } else { (v + 100) as f64 },
    );
}

#[test]
fn axes_are_where_their_names_say() {
    let turned = [6, 5, 4];
    let names = json!(["x", "y", "z"]);
    let dir = tempdir().unwrap();
    let [two, three, ome] = ["two", "three", "ome"].map(|name| dir.path().join(name));
    version_2(&two, [&turned, &[4, 4, 4]], json!({"order": "F"}), &|_| {
        Vec::new()
    });
    put(
        &two.join(".zattrs"),
        &json!({"_ARRAY_DIMENSIONS": names}).to_string(),
    );
    each(&[2, 2, 1], |place| {
        // the first axis is the fastest of a chunk
        let mut bytes = Vec::new();
        each(&[4, 4, 4], |i| {
            bytes.extend(xyz(&[
                place[0] * 4 + i[2],
                place[1] * 4 + i[1],
                place[2] * 4 + i[0],
            ]));
        });
        fs::write(two.join(key(place, ".")), bytes).unwrap();
    });
    assert_plain(&read(&two));
    version_3(
        &three,
        [&turned, &[4, 4, 4]],
        json!({"dimension_names": names}),
        &xyz,
    );
    assert_plain(&read(&three));
    version_2(&ome.join("0"), [&turned, &[4, 4, 4]], json!({}), &xyz);
    let axes = ["x", "y", "z"].map(|n| json!({"name": n, "type": "space", "unit": "millimeter"}));
    pyramid(
        &ome,
        "0.4",
        json!(axes),
        json!([{"type": "scale", "scale": [0.1, 0.2, 0.5]}]),
        json!({}),
    );
    let opened = read(&ome);
    assert_plain(&opened);
    assert_eq!(opened.volume.header().placement.spacing, [0.1, 0.2, 0.5]);
    // and with axes of one entry anywhere
    let dir = tempdir().unwrap();
    let wide = |at: &[u64]| xyz(&[at[3], at[1], at[0]]);
    version_2(
        dir.path(),
        [&[4, 5, 1, 6, 1], &[2, 2, 1, 2, 1]],
        json!({}),
        &wide,
    );
    assert_plain(&read(dir.path()));
}

#[test]
fn one_channel_and_time_is_read() {
    let dir = tempdir().unwrap();
    let value = |at: &[u64]| {
        let own = sample([at[4], at[3], at[2]]) + 1000 * at[0] as i64 + 100 * at[1] as i64;
        (own as i16).to_le_bytes().to_vec()
    };
    let names = json!({"dimension_names": ["t", "c", "z", "y", "x"]});
    version_3(
        dir.path(),
        [&[3, 2, 4, 5, 6], &[2, 2, 2, 3, 4]],
        names,
        &value,
    );
    let options = OpenOptions {
        channel: Some(1),
        time: Some(2),
        ..OpenOptions::default()
    };
    let opened = open(dir.path(), &options).unwrap();
    assert_values(&opened, |v| (v + 2100) as f64);
    assert!(
        opened.notes.iter().any(|n| n == "t 2 of 3"),
        "{:?}",
        opened.notes
    );
    for (options, says) in [
        (OpenOptions::default(), "t 3, c 2, z 4, y 5, x 6"),
        (
            OpenOptions {
                time: Some(3),
                ..options.clone()
            },
            "0 to 2",
        ),
        (
            OpenOptions {
                channel: None,
                ..options.clone()
            },
            "--channel",
        ),
    ] {
        let error = refusal(dir.path(), &options);
        assert!(matches!(error, Error::Usage { .. }), "{error}");
        assert!(error.to_string().contains(says), "{error}");
    }
    let error = refusal(plain("{}", json!({})).path(), &options);
    assert!(error.to_string().contains("--channel"), "{error}");
}

/// A coordinate array of xarray's beside an array.
fn coordinates(group: &Path, name: &str, values: &[f64], units: &str) {
    let n = [values.len() as u64];
    let bytes = |at: &[u64]| {
        values
            .get(at[0] as usize)
            .copied()
            .unwrap_or(0.0)
            .to_le_bytes()
            .to_vec()
    };
    version_2(
        &group.join(name),
        [&n, &[3]],
        json!({"dtype": "<f8"}),
        &bytes,
    );
    let attributes = json!({"_ARRAY_DIMENSIONS": [name], "units": units});
    put(&group.join(name).join(".zattrs"), &attributes.to_string());
}

#[test]
fn coordinates_state_the_place() {
    let group = |z: [f64; 4]| {
        let dir = tempdir().unwrap();
        put(&dir.path().join(".zgroup"), r#"{"zarr_format": 2}"#);
        version_2(&dir.path().join("ct"), [&ZYX, &CHUNK], json!({}), &zyx);
        put(
            &dir.path().join("ct/.zattrs"),
            r#"{"_ARRAY_DIMENSIONS": ["z", "y", "x"]}"#,
        );
        coordinates(dir.path(), "x", &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5], "mm");
        coordinates(dir.path(), "y", &[5.0, 4.8, 4.6, 4.4, 4.2], "millimeter");
        coordinates(dir.path(), "z", &z, "um");
        dir
    };
    let dir = group([1000.0, 1500.0, 2000.0, 2500.0]);
    let opened = read(dir.path());
    assert_plain(&opened);
    let place = opened.volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([0.1, 0.2, 0.5], Unit::Millimetre)
    );
    assert_eq!(place.origin, [0.0, 5.0, 1.0]);
    assert_eq!(place.directions[1], [0.0, -1.0, 0.0], "y runs down");
    assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
    assert_eq!(opened.warnings.len(), 0, "{:?}", opened.warnings);
    let dir = group([1000.0, 1500.0, 2000.0, 3000.0]);
    let opened = read(dir.path());
    assert_eq!(opened.volume.header().placement.spacing, [1.0; 3]);
    assert!(
        opened.warnings[0].contains("of z are not evenly spaced"),
        "{:?}",
        opened.warnings
    );
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

/// A pyramid of version 0.4 with these units of z, y and x, transformations, and more.
fn ome(units: [&str; 3], transforms: Value, more: Value) -> TempDir {
    let dir = tempdir().unwrap();
    version_2(&dir.path().join("0"), [&ZYX, &CHUNK], json!({}), &zyx);
    let axis = |(name, unit): (&str, &str)| match unit {
        "" => json!({"name": name, "type": "space"}),
        unit => json!({"name": name, "type": "space", "unit": unit}),
    };
    let axes: Vec<Value> = ["z", "y", "x"].into_iter().zip(units).map(axis).collect();
    pyramid(dir.path(), "0.4", json!(axes), transforms, more);
    dir
}

fn scale(z: f64, y: f64, x: f64) -> Value {
    json!({"type": "scale", "scale": [z, y, x]})
}

#[test]
fn units_are_those_of_each_axis() {
    for (units, [z, y, x], spacing, unit) in [
        (
            ["micrometer", "nanometer", "nanometer"],
            [0.03, 4.0, 4.0],
            [4.0, 4.0, 30.0],
            Unit::Nanometre,
        ),
        (["angstrom"; 3], [5.0, 5.0, 5.0], [0.5; 3], Unit::Nanometre),
        ([""; 3], [3.0, 2.0, 1.0], [1.0, 2.0, 3.0], Unit::Voxel),
        (
            ["inch", "millimeter", "millimeter"],
            [1.0, 2.0, 3.0],
            [3.0, 2.0, 25.4],
            Unit::Millimetre,
        ),
    ] {
        let dir = ome(units, json!([scale(z, y, x)]), json!({}));
        let opened = read(dir.path());
        let place = opened.volume.header().placement;
        assert_eq!((place.spacing, place.unit), (spacing, unit), "{units:?}");
        assert_eq!(opened.warnings.len(), 0, "{:?}", opened.warnings);
        assert_plain(&opened);
    }
    for (units, z) in [
        (["parsec"; 3], 1.0),
        (["millimeter", "", ""], 1.0),
        (["millimeter"; 3], 0.0),
    ] {
        let dir = ome(units, json!([scale(z, 1.0, 1.0)]), json!({}));
        let opened = read(dir.path());
        assert_eq!(opened.provenance.spacing, [Origin::Default; 3], "{units:?}");
        assert!(
            opened.warnings[0].contains("--spacing"),
            "{:?}",
            opened.warnings
        );
    }
}

#[test]
fn transformations_follow_one_another() {
    let shift = json!({"type": "translation", "translation": [1, 2, 3]});
    let root = json!({"coordinateTransformations": [{"type": "scale", "scale": [2, 2, 2]}]});
    for (list, origin) in [
        (json!([scale(0.5, 0.1, 0.1), shift]), [6.0, 4.0, 2.0]),
        (json!([shift, scale(0.5, 0.1, 0.1)]), [0.6, 0.4, 1.0]),
    ] {
        let opened = read(ome(["um"; 3], list, root.clone()).path());
        let place = opened.volume.header().placement;
        assert_eq!(place.spacing, [0.2, 0.2, 1.0]);
        for (found, known) in place.origin.iter().zip(origin) {
            assert!((found - known).abs() < 1e-12, "{:?}", place.origin);
        }
    }
    let mirrored = read(ome(["um"; 3], json!([scale(1.0, -2.0, 1.0)]), json!({})).path());
    let place = mirrored.volume.header().placement;
    assert_eq!(
        (place.spacing, place.directions[1]),
        ([1.0, 2.0, 1.0], [0.0, -1.0, 0.0])
    );
    // parameters in an array, and a field that is no matrix
    let at_path = ome(
        ["um"; 3],
        json!([{"type": "scale", "path": "factors"}]),
        json!({}),
    );
    let factors = |at: &[u64]| [3.0f64, 2.0, 1.0][at[0] as usize].to_le_bytes().to_vec();
    version_2(
        &at_path.path().join("factors"),
        [&[3], &[3]],
        json!({"dtype": "<f8"}),
        &factors,
    );
    assert_eq!(
        read(at_path.path()).volume.header().placement.spacing,
        [1.0, 2.0, 3.0]
    );
    for list in [
        json!([{"type": "displacements", "path": "field"}]),
        json!([scale(1.0, 1.0, 1.0), {"type": "warp"}]),
        json!([{"type": "affine", "affine": [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]),
        json!([{"type": "scale", "scale": [1, 1]}]),
    ] {
        let dir = ome(["um"; 3], list, json!({}));
        let refused = open(dir.path(), &OpenOptions::default()).map(|_| ());
        assert!(
            matches!(
                refused,
                Err(Error::Unsupported { .. } | Error::Format { .. })
            ),
            "{refused:?}"
        );
        let options = OpenOptions {
            spacing: Some([1.0, 2.0, 3.0]),
            unit: Some(Unit::Micrometre),
            ..OpenOptions::default()
        };
        let opened = open(dir.path(), &options);
        if let Ok(opened) = opened {
            assert_eq!(opened.volume.header().placement.spacing, [1.0, 2.0, 3.0]);
        }
    }
}

/// A pyramid of version 0.6 whose level is placed by a transformation.
fn ome_6(transforms: Value, more: Value) -> TempDir {
    let dir = tempdir().unwrap();
    version_3(&dir.path().join("0"), [&ZYX, &CHUNK], json!({}), &zyx);
    let axes =
        |names: [&str; 3]| names.map(|n| json!({"name": n, "type": "space", "unit": "micrometer"}));
    let systems = json!([
        {"name": "world", "axes": axes(["z", "y", "x"])},
        {"name": "own", "axes": axes(["z", "y", "x"])},
    ]);
    let more = with(json!({"coordinateSystems": systems}), &more);
    pyramid(dir.path(), "0.6", Value::Null, transforms, more);
    dir
}

#[test]
fn coordinate_systems_of_version_6() {
    let placed = |mut json: Value| {
        json["input"] = json!({"path": "0"});
        json["output"] = json!({"name": "own"});
        json!([json])
    };
    let sequence = json!({"type": "sequence", "transformations": [
        scale(2.0, 0.25, 0.5), {"type": "translation", "translation": [5, 6, 7]},
    ]});
    let dir = ome_6(placed(sequence.clone()), json!({}));
    let opened = read(dir.path());
    let place = opened.volume.header().placement;
    assert_eq!(
        (place.spacing, place.origin),
        ([0.5, 0.25, 2.0], [7.0, 6.0, 5.0])
    );
    assert_eq!(opened.warnings.len(), 0, "{:?}", opened.warnings);
    assert_plain(&opened);
    // other systems are told of, not taken
    let step = json!({"type": "affine", "affine": [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0]],
                      "input": {"name": "own"}, "output": {"name": "world"}});
    let more = json!({"coordinateTransformations": [step]});
    let dir = ome_6(placed(sequence), more);
    let opened = read(dir.path());
    assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 2.0]);
    let warning = &opened.warnings[0];
    assert!(
        warning.contains("`affine` from \"own\" to \"world\""),
        "{warning}"
    );
    // axes in another order are named by where they lead
    let dir = tempdir().unwrap();
    version_3(
        &dir.path().join("0"),
        [&[6, 5, 4], &[4, 4, 4]],
        json!({}),
        &xyz,
    );
    let whole = ome_6(
        placed(json!({"type": "mapAxis", "mapAxis": [2, 1, 0]})),
        json!({}),
    );
    fs::copy(whole.path().join("zarr.json"), dir.path().join("zarr.json")).unwrap();
    assert_plain(&read(dir.path()));
    // a rotation of a quarter turn: x runs along the world's y
    let turn = json!({"type": "rotation", "rotation": [[1, 0, 0], [0, 0, 1], [0, -1, 0]]});
    let place = read(ome_6(placed(turn), json!({})).path())
        .volume
        .header()
        .placement;
    assert!(
        place
            .directions
            .iter()
            .flatten()
            .all(|v| v.abs() == 1.0 || *v == 0.0)
    );
    let error = refusal(
        ome_6(
            placed(json!({"type": "coordinates", "path": "field"})),
            json!({}),
        )
        .path(),
        &OpenOptions::default(),
    );
    assert!(
        error.to_string().contains("`coordinates`") && error.to_string().contains("--spacing"),
        "{error}"
    );
}

#[test]
fn versions_that_are_not_known_are_told() {
    let dir = tempdir().unwrap();
    version_3(&dir.path().join("0"), [&ZYX, &CHUNK], json!({}), &zyx);
    pyramid(
        dir.path(),
        "0.10",
        json!(["z", "y", "x"]),
        json!([scale(1.0, 1.0, 1.0)]),
        json!({}),
    );
    let opened = read(dir.path());
    assert!(opened.warnings[0].contains("0.10"), "{:?}", opened.warnings);
}

#[test]
fn levels_and_images_have_their_sizes_by_any_path() {
    let dir = tempdir().unwrap();
    put(&dir.path().join(".zgroup"), r#"{"zarr_format": 2}"#);
    put(
        &dir.path().join(".zattrs"),
        r#"{"bioformats2raw.layout": 3}"#,
    );
    put(&dir.path().join("OME/.zgroup"), r#"{"zarr_format": 2}"#);
    let image = |name: &str| {
        let image = dir.path().join(name);
        version_2(&image.join("0"), [&ZYX, &CHUNK], json!({}), &zyx);
        let axes =
            ["z", "y", "x"].map(|n| json!({"name": n, "type": "space", "unit": "micrometer"}));
        pyramid(
            &image,
            "0.4",
            json!(axes),
            json!([scale(10.0, 5.0, 5.0)]),
            json!({}),
        );
    };
    image("0");
    let dataset = |name: &str| OpenOptions {
        dataset: Some(name.into()),
        ..OpenOptions::default()
    };
    let sized = |path: &Path, options: &OpenOptions| {
        let opened = open(path, options).unwrap_or_else(|e| panic!("{e}"));
        assert_plain(&opened);
        let place = opened.volume.header().placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([5.0, 5.0, 10.0], Unit::Micrometre)
        );
    };
    sized(dir.path(), &OpenOptions::default());
    for name in ["0", "0/0", "/0/"] {
        sized(dir.path(), &dataset(name));
    }
    sized(&dir.path().join("0"), &OpenOptions::default());
    sized(&dir.path().join("0/0"), &OpenOptions::default());
    sized(&dir.path().join("OME/../0/0"), &OpenOptions::default());
    image("1");
    let error = refusal(dir.path(), &OpenOptions::default()).to_string();
    assert!(
        error.contains("2 pyramids") && error.contains("one of 0, 1"),
        "{error}"
    );
    sized(dir.path(), &dataset("1"));
}

#[test]
fn groups_say_what_is_in_them() {
    let dir = tempdir().unwrap();
    put(&dir.path().join(".zgroup"), r#"{"zarr_format": 2}"#);
    let error = refusal(dir.path(), &OpenOptions::default()).to_string();
    assert!(error.contains("without an array"), "{error}");
    version_2(
        &dir.path().join("flat"),
        [&[5, 6], &[5, 6]],
        json!({}),
        &|at| xyz(&[at[1], at[0], 0]),
    );
    let error = refusal(dir.path(), &OpenOptions::default()).to_string();
    assert!(error.contains("flat (5, 6)"), "{error}");
}

#[test]
fn chunks_that_are_missing_are_counted() {
    let dir = plain("{}", json!({"fill_value": 3}));
    for name in ["0.0.0", "1.1.1", "0.1.0"] {
        fs::remove_file(dir.path().join(name)).unwrap();
    }
    fs::write(dir.path().join("0.0.0.part"), "").unwrap();
    let opened = read(dir.path());
    let notes = opened.notes.join("\n");
    assert!(
        notes.contains("3 of 8 chunks are missing and read as the fill value 3"),
        "{notes}"
    );
    assert!(notes.contains("0.0.0.part"), "{notes}");
    for name in fs::read_dir(dir.path()).unwrap() {
        let path = name.unwrap().path();
        if !path.file_name().unwrap().to_str().unwrap().starts_with('.') {
            fs::remove_file(path).unwrap();
        }
    }
    let opened = read(dir.path());
    assert!(
        opened.warnings[0].contains("none of the 8 chunks"),
        "{:?}",
        opened.warnings
    );
    assert_values(&opened, |_| 3.0);
}

#[test]
fn chunks_of_other_names_are_found() {
    let dir = plain("{}", json!({}));
    each(&[2, 2, 2], |place| {
        let nested = dir.path().join(key(place, "/"));
        fs::create_dir_all(nested.parent().unwrap()).unwrap();
        fs::rename(dir.path().join(key(place, ".")), nested).unwrap();
    });
    let opened = read(dir.path());
    assert_plain(&opened);
    assert!(
        opened.notes.iter().any(|n| n.contains("0/0/0")),
        "{:?}",
        opened.notes
    );
    // of a version 3 that states folders, and has none
    let dir = tempdir().unwrap();
    version_3(dir.path(), [&ZYX, &ZYX], json!({}), &zyx);
    fs::rename(dir.path().join("c/0/0/0"), dir.path().join("c.0.0.0")).unwrap();
    assert_plain(&read(dir.path()));
}

/// Shards with small chunks inside, each of which may be left out.
fn shards(folder: &Path, inner: [u64; 3], leave_out: impl Fn([u64; 3]) -> bool) {
    let outer = inner.map(|n| 2 * n);
    let bytes = json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    let configuration = json!({"chunk_shape": inner, "codecs": bytes, "index_codecs": bytes, "index_location": "start"});
    let codecs = json!([{"name": "sharding_indexed", "configuration": configuration}]);
    version_3(
        folder,
        [&ZYX, &outer],
        json!({"codecs": codecs, "fill_value": 9}),
        &zyx,
    );
    each(&grid(&ZYX, &outer), |shard| {
        let (mut table, mut data) = (Vec::new(), Vec::new());
        each(&[2, 2, 2], |i| {
            let place = [0, 1, 2].map(|a| shard[a] * 2 + i[a]);
            if leave_out(place) {
                table.extend([0xff; 16]);
                return;
            }
            let chunk = chunk_of(&place, &inner, &zyx);
            table.extend((128 + data.len() as u64).to_le_bytes());
            table.extend((chunk.len() as u64).to_le_bytes());
            data.extend(chunk);
        });
        let path = folder.join("c").join(key(shard, "/"));
        fs::write(path, [table, data].concat()).unwrap();
    });
}

#[test]
fn small_chunks_in_shards_are_put_together() {
    for inner in [[1, 1, 1], [1, 2, 3], [2, 3, 2], [3, 3, 4]] {
        let dir = tempdir().unwrap();
        let left_out = |p: [u64; 3]| p.iter().sum::<u64>() % 3 == 1;
        shards(dir.path(), inner, left_out);
        let opened = read(dir.path());
        assert_values(&opened, |v| {
            let v64 = v as u64;
            let at = [v64 / 30, v64 / 6 % 5, v64 % 6];
            let place = [0, 1, 2].map(|a| at[a] / inner[a]);
            if left_out(place) { 9.0 } else { v as f64 }
        });
        let (mut missing, mut total) = (0, 0);
        each(&grid(&ZYX, &inner), |place| {
            missing += u64::from(left_out(place.try_into().unwrap()));
            total += 1;
        });
        let note = format!("{missing} of {total} chunks are missing");
        assert!(
            opened.notes.iter().any(|n| n.contains(&note)),
            "{note}: {:?}",
            opened.notes
        );
    }
}

/// Filters as numcodecs 0.16.6 packs them.
#[test]
fn filters_are_undone_or_named() {
    let shuffled = |at: &[u64]| {
        // one chunk: the low bytes of all samples, then the high ones
        let i = (at[2] + 6 * (at[1] + 5 * at[0])) as usize;
        let all: Vec<u8> = (0..120u64)
            .flat_map(|i| (sample([i % 6, i / 6 % 5, i / 30]) as i16).to_le_bytes())
            .collect();
        let planes = [all.iter().step_by(2), all[1..].iter().step_by(2)];
        let planes: Vec<u8> = planes.into_iter().flatten().copied().collect();
        planes[2 * i..2 * i + 2].to_vec()
    };
    let dir = tempdir().unwrap();
    let more = json!({"filters": [{"id": "shuffle", "elementsize": 2}], "compressor": {"id": "zstd", "level": 1}});
    version_2(dir.path(), [&ZYX, &ZYX], more, &shuffled);
    let chunk = dir.path().join("0.0.0");
    let packed = zstd::bulk::compress(&fs::read(&chunk).unwrap(), 1).unwrap();
    fs::write(&chunk, packed).unwrap();
    assert_plain(&read(dir.path()));
    let dir = tempdir().unwrap();
    let delta = json!({"filters": [{"id": "delta", "dtype": "<i2", "astype": "|i1"}]});
    let first = |at: &[u64]| vec![u8::from(at[0] + at[1] + at[2] > 0)];
    version_2(dir.path(), [&ZYX, &ZYX], delta, &first);
    assert_plain(&read(dir.path()));
    let dir = tempdir().unwrap();
    let set =
        json!({"id": "fixedscaleoffset", "offset": 2, "scale": 4, "dtype": "<f4", "astype": "|u1"});
    let byte = |at: &[u64]| vec![sample([at[2], at[1], at[0]]) as u8];
    version_2(
        dir.path(),
        [&ZYX, &CHUNK],
        json!({"dtype": "<f4", "filters": [set]}),
        &byte,
    );
    assert_values(&read(dir.path()), |v| v as f64 / 4.0 + 2.0);
    let dir = tempdir().unwrap();
    let set = json!({"name": "numcodecs.fixedscaleoffset",
                     "configuration": {"offset": 2, "scale": 4, "dtype": "<f4", "astype": "|u1"}});
    let more = json!({"data_type": "float32", "codecs": [set, "bytes"]});
    version_3(dir.path(), [&ZYX, &CHUNK], more, &byte);
    assert_values(&read(dir.path()), |v| v as f64 / 4.0 + 2.0);
    for name in ["categorize", "adler32", "pcodec"] {
        let error = refusal(
            plain("{}", json!({"filters": [{"id": name}]})).path(),
            &OpenOptions::default(),
        );
        assert!(
            matches!(error, Error::Unsupported { .. }) && error.to_string().contains(name),
            "{error}"
        );
    }
}

#[test]
fn metadata_may_be_in_one_file_alone() {
    let dir = tempdir().unwrap();
    version_2(&dir.path().join("ct"), [&ZYX, &CHUNK], json!({}), &zyx);
    let meta = fs::read_to_string(dir.path().join("ct/.zarray")).unwrap();
    fs::remove_file(dir.path().join("ct/.zarray")).unwrap();
    let all = json!({"zarr_consolidated_format": 1, "metadata": {
        ".zgroup": {"zarr_format": 2},
        "ct/.zarray": serde_json::from_str::<Value>(&meta).unwrap(),
        "ct/.zattrs": {"scale_factor": 2.0},
    }});
    put(&dir.path().join(".zmetadata"), &all.to_string());
    assert_values(&read(dir.path()), |v| 2.0 * v as f64);
    assert_values(&read(&dir.path().join("ct")), |v| 2.0 * v as f64);
}

/// What would wait for ever is refused.
#[test]
fn pipes_are_no_chunks_and_no_metadata() {
    for name in ["0.0.0", ".zarray", ".zattrs"] {
        let dir = plain("{}", json!({}));
        let path = dir.path().join(name);
        fs::remove_file(&path).unwrap();
        let made = std::process::Command::new("mkfifo")
            .arg(&path)
            .status()
            .unwrap();
        assert!(made.success());
        let found =
            open(dir.path(), &OpenOptions::default()).and_then(|opened| all(&*opened.volume));
        let error = found.unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("pipe"), "{error}");
    }
}

#[test]
fn kin_of_zarr_are_named() {
    let dir = tempdir().unwrap();
    put(&dir.path().join("n5/attributes.json"), r#"{"n5": "2.5.0"}"#);
    let error = refusal(&dir.path().join("n5"), &OpenOptions::default());
    assert!(error.to_string().contains("N5"), "{error}");
    let result: Result<()> = Err(error);
    assert!(matches!(result, Err(Error::Unsupported { .. })));
}
