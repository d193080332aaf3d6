//! Which chunks and metadata are there, and where.

use super::*;

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

#[test]
fn metadata_that_are_not_understood_are_refused() {
    for (more, says) in [
        (json!({"extra": {"must_understand": true}}), "`extra`"),
        (
            json!({"dimension_names": ["y", "x"]}),
            "a name for each axis",
        ),
        (json!({"data_type": "complex64"}), "complex64"),
        (
            json!({"data_type": {"name": "numpy.datetime64"}}),
            "numpy.datetime64",
        ),
        (
            json!({"chunk_grid": {"name": "rectilinear"}}),
            "rectilinear",
        ),
        (json!({"codecs": ["vlen-utf8"]}), "vlen-utf8"),
    ] {
        let dir = tempdir().unwrap();
        version_3(dir.path(), [&ZYX, &CHUNK], more, &zyx);
        let error = refusal(dir.path(), &OpenOptions::default()).to_string();
        assert!(error.contains(says), "{error}");
    }
    let dir = tempdir().unwrap();
    let more = json!({"extra": {"must_understand": false}});
    version_3(dir.path(), [&ZYX, &CHUNK], more, &zyx);
    assert_plain(&read(dir.path()));
}
