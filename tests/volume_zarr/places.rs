//! Sizes, units, origins and directions, by xarray's coordinates and by OME-Zarr.

use super::*;

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

/// By attributes, as HDF5's (src/volume/written/size.rs).
#[test]
fn attributes_state_the_size_of_a_voxel() {
    for (attributes, spacing) in [
        (
            json!({"voxel_size": [0.5, 0.5, 0.5], "Unit": "um"}),
            [0.5; 3],
        ),
        (
            json!({"pixelResolution": {"dimensions": [0.5, 0.5, 0.5], "unit": "um"}}),
            [0.5; 3],
        ),
        (
            json!({"transform": {"axes": ["z", "y", "x"], "scale": [2, 0.25, 0.5], "units": ["um", "um", "um"]}}),
            [0.5, 0.25, 2.0],
        ),
        (
            json!({"_ARRAY_DIMENSIONS": ["z", "y", "x"], "spacing_um": [2, 0.25, 0.5]}),
            [0.5, 0.25, 2.0],
        ),
    ] {
        let folder = plain(&attributes.to_string(), json!({}));
        let opened = read(folder.path());
        let place = opened.volume.header().placement;
        assert_eq!(
            (place.spacing, place.unit),
            (spacing, Unit::Micrometre),
            "{attributes}"
        );
        assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
        assert_eq!(opened.warnings.len(), 0, "{:?}", opened.warnings);
    }
    let unclear = plain(r#"{"voxel_size": [2, 0.25, 0.5], "unit": "um"}"#, json!({}));
    let opened = read(unclear.path());
    assert_eq!(opened.provenance.spacing, [Origin::Default; 3]);
    assert!(
        opened.warnings[0].contains("--spacing 0.5,0.25,2 if"),
        "{:?}",
        opened.warnings
    );
}

/// Of a group, unless it holds arrays of several sizes.
#[test]
fn groups_state_the_size_of_a_voxel() {
    let dir = tempdir().unwrap();
    put(&dir.path().join(".zgroup"), r#"{"zarr_format": 2}"#);
    put(
        &dir.path().join(".zattrs"),
        r#"{"voxel_size": 0.5, "units": "um", "add_offset": -3}"#,
    );
    version_2(&dir.path().join("ct"), [&ZYX, &CHUNK], json!({}), &zyx);
    let opened = read(dir.path());
    assert_eq!(opened.volume.header().placement.spacing, [0.5; 3]);
    assert!(
        opened.warnings[0].contains("add_offset (-3) of the group"),
        "{:?}",
        opened.warnings
    );
    version_2(
        &dir.path().join("other"),
        [&[2, 2, 2], &[2, 2, 2]],
        json!({}),
        &zyx,
    );
    let opened = read(&dir.path().join("ct"));
    assert_eq!(opened.provenance.spacing, [Origin::Default; 3]);
    assert!(
        opened.warnings[0].contains("arrays of several sizes"),
        "{:?}",
        opened.warnings
    );
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
        let opened = open(dir.path(), &options).unwrap();
        assert_eq!(opened.volume.header().placement.spacing, [1.0, 2.0, 3.0]);
        assert_plain(&opened);
    }
}

/// Sizes alone do not make right angles of sheared axes, so --spacing is no way out of those.
#[test]
fn sheared_axes_are_resampled_or_refused() {
    let shear = [
        [1.0, 0.5, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ];
    let list = json!([{"type": "affine", "affine": shear}]);
    let dir = ome(["um"; 3], list, json!({}));
    let sized = OpenOptions {
        spacing: Some([1.0, 2.0, 3.0]),
        unit: Some(Unit::Micrometre),
        ..OpenOptions::default()
    };
    for options in [OpenOptions::default(), sized] {
        let refused = open(dir.path(), &options).map(|_| ()).unwrap_err();
        assert!(refused.to_string().contains("--resample"), "{refused}");
    }
    let options = OpenOptions {
        resample: true,
        ..OpenOptions::default()
    };
    let opened = open(dir.path(), &options).unwrap();
    let placement = opened.volume.header().placement;
    assert_eq!(placement.shear(), None);
    // y leans by half a step along z: slices, in which it lies, stay slices, and a voxel keeps its volume
    let expected = [1.0, 1.25f64.sqrt(), 1.0 / 1.25f64.sqrt()];
    let near = |(a, b): (f64, f64)| (a - b).abs() < 1e-6;
    let mut pairs = placement.spacing.into_iter().zip(expected);
    assert!(pairs.all(near), "{:?}", placement.spacing);
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
fn several_pyramids_of_a_group_are_listed() {
    let dir = ome(["um"; 3], json!([scale(1.0, 1.0, 1.0)]), json!({}));
    let text = fs::read_to_string(dir.path().join(".zattrs")).unwrap();
    let mut attributes: Value = serde_json::from_str(&text).unwrap();
    let mut second = attributes["multiscales"][0].clone();
    second["datasets"][0]["path"] = json!("other");
    second["datasets"][0]["coordinateTransformations"] = json!([scale(3.0, 2.0, 2.0)]);
    attributes["multiscales"]
        .as_array_mut()
        .unwrap()
        .push(second);
    put(&dir.path().join(".zattrs"), &attributes.to_string());
    version_2(&dir.path().join("other"), [&ZYX, &CHUNK], json!({}), &zyx);
    let error = refusal(dir.path(), &OpenOptions::default()).to_string();
    assert!(
        error.contains("2 pyramids") && error.contains("0, other"),
        "{error}"
    );
    let options = OpenOptions {
        dataset: Some("other".into()),
        ..OpenOptions::default()
    };
    let opened = open(dir.path(), &options).unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [2.0, 2.0, 3.0]);
}

/// Of the first versions: five axes if nothing is said, and what other writers have called so.
#[test]
fn pyramids_without_axes() {
    let dir = tempdir().unwrap();
    version_2(&dir.path().join("0"), [&ZYX, &CHUNK], json!({}), &zyx);
    pyramid(dir.path(), "0.4", Value::Null, json!([]), json!({}));
    let opened = read(dir.path());
    assert_plain(&opened);
    assert_eq!(opened.provenance.spacing, [Origin::Default; 3]);
    let five = tempdir().unwrap();
    let last = |at: &[u64]| zyx(&at[2..]);
    version_2(
        &five.path().join("0"),
        [&[1, 2, 4, 5, 6], &[1, 1, 2, 3, 4]],
        json!({}),
        &last,
    );
    pyramid(five.path(), "0.4", Value::Null, json!([]), json!({}));
    let options = OpenOptions {
        channel: Some(1),
        ..OpenOptions::default()
    };
    assert_plain(&open(five.path(), &options).unwrap());
}
