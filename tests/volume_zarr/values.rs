//! Values and axes: scales, signs, order of axes, channels and times, filters.

use super::*;

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
    let opened = read(zero.path());
    assert_plain(&opened);
    assert!(opened.notes[0].contains("stored 0"), "{:?}", opened.notes);
    let error = refusal(
        plain(r#"{"scale_factor": "half"}"#, json!({})).path(),
        &OpenOptions::default(),
    );
    assert!(error.to_string().contains("scale_factor"), "{error}");
}

#[test]
fn attributes_of_other_writers_are_applied_or_refused() {
    for (attributes, slope, intercept) in [
        (r#"{"slope": 2.0, "intercept": 1.0}"#, 2.0, 1.0),
        (r#"{"RescaleSlope": 0.5}"#, 0.5, 0.0),
        (r#"{"rescale_intercept": -1024}"#, 1.0, -1024.0),
        (r#"{"scaleFactor": 0.5, "addOffset": 3}"#, 0.5, 3.0),
        (r#"{"intercept": -1000}"#, 1.0, -1000.0),
        (r#"{"BSCALE": 2, "bzero": 32768}"#, 2.0, 32768.0),
        (r#"{"calibrationSlope": 0.5}"#, 0.5, 0.0),
        (r#"{"unitSI": 2.0}"#, 2.0, 0.0),
    ] {
        let scaled = plain(attributes, json!({}));
        let opened = read(scaled.path());
        assert_values(&opened, |v| slope * v as f64 + intercept);
        assert!(opened.values.unwrap().contains("stored"), "{attributes}");
    }
    for (attributes, word) in [
        (r#"{"axes": ["x", "y", "z"]}"#, "`axes`"),
        (r#"{"dim_order": "XYZ"}"#, "`dim_order`"),
        (
            r#"{"DIMENSION_LABELS": ["z", "x", "y"]}"#,
            "DIMENSION_LABELS",
        ),
        (
            r#"{"axistags": {"axes": [{"key": "x"}, {"key": "y"}, {"key": "z"}]}}"#,
            "`axistags`",
        ),
        (r#"{"order": "F"}"#, "order is F"),
        (r#"{"arrayOrder": "xyz"}"#, "arrayOrder is xyz"),
        (r#"{"slope": 2.0, "scale_factor": 3.0}"#, "scale_factor"),
        (r#"{"slope": "two"}"#, "`slope`"),
    ] {
        let error = refusal(plain(attributes, json!({})).path(), &OpenOptions::default());
        assert!(error.to_string().contains(word), "{error}");
    }
    for attributes in [
        r#"{"axes": ["z", "y", "x"]}"#,
        r#"{"order": "abc", "slope": 1.0}"#,
    ] {
        assert_plain(&read(plain(attributes, json!({})).path()));
    }
    for (attributes, says) in [
        (r#"{"gain": 2.5}"#, "attribute gain (2.5)"),
        (r#"{"mu_scaling": 4096}"#, "attribute mu_scaling (4096)"),
        (
            r#"{"calibration": [1.0, 2.0]}"#,
            "attribute calibration (1, 2)",
        ),
        (r#"{"scaleFactor": 0.5}"#, "attribute scaleFactor (0.5)"),
        (
            r#"{"origin": [1, 2, 3]}"#,
            "attribute origin (1, 2, 3) is not applied",
        ),
    ] {
        let vague = read(plain(attributes, json!({})).path());
        assert!(vague.warnings[0].contains(says), "{:?}", vague.warnings);
    }
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
fn axes_that_are_none_of_space_make_no_volume() {
    for (names, says) in [
        (json!(["wavelength", "y", "x"]), "wavelength 4, y 5, x 6"),
        (json!(["theta", "y", "x"]), "projections"),
        (json!(["y", "a", "b"]), "two axes that may be x, y or z"),
    ] {
        let named = json!({"_ARRAY_DIMENSIONS": names}).to_string();
        let error = refusal(plain(&named, json!({})).path(), &OpenOptions::default());
        assert!(error.to_string().contains(says), "{error}");
    }
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

/// Both versions of what xarray writes (make_chunked.py): packed, in the order y, z, x, with coordinates.
#[test]
fn what_xarray_writes_is_what_it_reads() {
    for name in ["xarray_2", "xarray_3"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/zarr");
        let opened = read(&folder.join(name));
        let header = opened.volume.header();
        assert_eq!((header.dims.0, header.dtype), ([19, 17, 3], Dtype::F32));
        let place = header.placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.5, 0.25, 2.0], Unit::Micrometre)
        );
        assert_eq!(
            (place.origin, place.directions[1]),
            ([0.0, 6.0, 5.0], [0.0, -1.0, 0.0])
        );
        for (i, found) in numbers(&opened).into_iter().enumerate() {
            let (x, y, z) = (i % 19, i / 19 % 17, i / 323);
            let known = (x * 7 + y * 13 + z * 29) as f64 + 0.5;
            match (x, y, z) {
                (3, 2, 1) => assert!(found.is_nan(), "{name}"),
                _ => assert_eq!(found, known, "{name}: {x} {y} {z}"),
            }
        }
        assert!(
            opened.values.unwrap().starts_with("0.5 * stored + 2"),
            "{name}"
        );
        assert_eq!(opened.warnings.len(), 0, "{:?}", opened.warnings);
    }
}
