//! `phantom` and `info`.

use super::{alvis, fails, foam, json, ok, temp};
use serde_json::Value;

#[test]
fn a_phantom_reads_back_as_it_was_made() {
    let dir = temp();
    let space = ["--spacing", "0.5,0.25,2", "--unit", "um"];
    for (name, dtype, format) in [
        ("a.mhd", "u16", "metaimage"),
        ("b.mha", "f32", "metaimage"),
        ("c.nrrd", "i8", "nrrd"),
        ("d.nrrd", "f64", "nrrd"),
        ("e.mhd", "i32", "metaimage"),
    ] {
        foam(
            dir.path(),
            name,
            &[&["--dtype", dtype][..], &space].concat(),
        );
        let info = json(&ok(dir.path(), &["info", name, "--json"]));
        assert_eq!(info["format"], format, "{name}");
        assert_eq!(info["dims"], serde_json::json!([40, 36, 32]), "{name}");
        assert_eq!(info["dtype"], dtype, "{name}");
        assert_eq!(
            info["spacing"],
            serde_json::json!([0.5, 0.25, 2.0]),
            "{name}"
        );
        assert_eq!(info["unit"], "um", "{name}");
        assert_eq!(info["nan"], 0, "{name}");
        let voxels: u64 = info["histogram"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_u64)
            .sum();
        assert_eq!(voxels, 40 * 36 * 32, "{name}");
        let (min, max) = (info["min"].as_f64().unwrap(), info["max"].as_f64().unwrap());
        let otsu = info["otsu_threshold"].as_f64().unwrap();
        // without noise the extremes are air and metal, and Otsu separates them
        assert!((min..max).contains(&otsu), "{name}: {min} {otsu} {max}");
        let triangles = info["predicted"]["triangles"].as_f64().unwrap() / 46_080.0;
        assert!((0.1..0.4).contains(&triangles), "{name}: {triangles}");
        assert!(info["predicted"]["bytes"].as_u64().unwrap() > 10_000);
        assert!(info["predicted"]["memory_bytes"].as_u64().unwrap() > 46_080);
    }
    let text = ok(dir.path(), &["info", "a.mhd"]);
    for part in [
        "40 x 36 x 32",
        "u16",
        "0.5 x 0.25 x 2 um (from the file)",
        "log scale",
        "█",
        "▲",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn a_raw_phantom_says_how_to_convert_it() {
    let dir = temp();
    let args = [
        "phantom", "sphere", "s.raw", "--dims", "16,18,20", "--dtype", "u16",
    ];
    let text = ok(dir.path(), &args);
    for part in [
        "--dims 16,18,20",
        "--dtype u16",
        "--endian little",
        "--threshold 32767.5",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let info = [
        "info", "s.raw", "--dims", "16,18,20", "--dtype", "u16", "--json",
    ];
    let info = json(&ok(
        dir.path(),
        &[&info[..], &["--spacing", "0.1", "--unit", "mm"]].concat(),
    ));
    assert_eq!(info["format"], "raw");
    assert_eq!(info["spacing"], serde_json::json!([0.1, 0.1, 0.1]));
    assert_eq!(
        (&info["min"], &info["max"]),
        (&Value::from(13_107.0), &Value::from(52_428.0))
    );
    let report = json(&ok(
        dir.path(),
        &[&args[..], &["--force", "--json"]].concat(),
    ));
    assert_eq!(report["threshold"], 32_767.5);
    assert_eq!(report["bytes"], 16 * 18 * 20 * 2);
}

#[test]
fn threads_do_not_change_a_file() {
    let dir = temp();
    foam(dir.path(), "one.raw", &["--threads", "1", "--noise", "0.1"]);
    foam(
        dir.path(),
        "four.raw",
        &["--threads", "4", "--noise", "0.1"],
    );
    foam(dir.path(), "other.raw", &["--seed", "2", "--noise", "0.1"]);
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("one.raw") == read("four.raw"));
    assert!(read("one.raw") != read("other.raw"));
}

#[test]
fn more_slices_than_the_header_says_are_told_of() {
    let dir = temp();
    foam(dir.path(), "a.nrrd", &["--dims", "20,20,20"]);
    let bytes = std::fs::read(dir.path().join("a.nrrd")).unwrap();
    assert!(!ok(dir.path(), &["info", "a.nrrd"]).contains("not read"));
    let at = bytes
        .windows(15)
        .position(|w| w == b"sizes: 20 20 20")
        .unwrap();
    let mut shorter = bytes.clone();
    shorter[at + 13..at + 15].copy_from_slice(b"10");
    std::fs::write(dir.path().join("a.nrrd"), shorter).unwrap();
    let said = ok(dir.path(), &["info", "a.nrrd"]);
    assert!(
        said.contains("4000 bytes behind the samples are not read"),
        "{said}"
    );
}

#[test]
fn what_a_header_says_need_not_be_typed_but_may() {
    let dir = temp();
    foam(dir.path(), "a.mha", &["--dims", "20,20,20"]);
    std::fs::write(dir.path().join("a.npy"), npy([20, 20, 20])).unwrap();
    for name in ["a.mha", "a.npy"] {
        ok(dir.path(), &["info", name, "--dims", "20,20,20"]);
        let message = fails(dir.path(), &["info", name, "--dims", "5,5,5"]);
        assert!(message.contains("leave the option out"), "{message}");
    }
}

/// An array of u8 in NumPy's form.
fn npy([x, y, z]: [usize; 3]) -> Vec<u8> {
    let head = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({z}, {y}, {x}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head.as_bytes());
    bytes.extend((0..x * y * z).map(|i| i as u8));
    bytes
}

#[test]
fn the_command_that_is_proposed_can_be_pasted() {
    let dir = temp();
    let args = ["phantom", "sphere", "my scan.mhd", "--dims", "16,16,16"];
    assert!(ok(dir.path(), &args).contains("alvis convert 'my scan.mhd' OUT"));
}

#[test]
fn numbers_below_zero_are_refused_by_the_option() {
    let dir = temp();
    for args in [
        &["info", "a.raw", "--spacing", "-1"][..],
        &["cells", "out", "--top", "-1"],
        &["preview", "a", "b.png", "--at", "-1"],
        &["verify", "out", "--max-issues", "-1"],
        &["export", "out", "a.ply", "--simplify", "-1"],
    ] {
        let output = alvis(dir.path(), args);
        assert_eq!(output.status.code(), Some(2));
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.contains("invalid value '-1'"), "{message}");
        assert!(message.contains(args[args.len() - 2]), "{message}");
    }
}

#[test]
fn the_threshold_of_info_may_be_negative_or_missing() {
    let dir = temp();
    foam(dir.path(), "a.mhd", &["--dtype", "i16"]);
    let info = json(&ok(
        dir.path(),
        &["info", "a.mhd", "--json", "--threshold", "-1e4"],
    ));
    assert_eq!(info["predicted"]["threshold"], -1e4);
    std::fs::write(dir.path().join("flat.raw"), [7; 64]).unwrap();
    let args = ["info", "flat.raw", "--dims", "4,4,4", "--dtype", "u8"];
    let info = json(&ok(dir.path(), &[&args[..], &["--json"]].concat()));
    assert_eq!(
        (&info["otsu_threshold"], &info["predicted"]),
        (&Value::Null, &Value::Null)
    );
    assert!(ok(dir.path(), &args).contains("no two finite samples differ"));
    let args = [
        "convert", "flat.raw", "out", "--dims", "4,4,4", "--dtype", "u8",
    ];
    let message = fails(dir.path(), &[&args[..], &["--threshold", "otsu"]].concat());
    assert!(message.contains("no two finite samples"), "{message}");
}

/// A NIfTI file of 16-bit samples that stand for `slope` times themselves.
fn nifti(dims: [i16; 3], slope: f32, samples: &[i16]) -> Vec<u8> {
    let mut bytes = vec![0; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    let [x, y, z] = dims;
    for (i, n) in [3, x, y, z, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * i, &n.to_le_bytes());
        put(76 + 4 * i, &1f32.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    put(108, &352f32.to_le_bytes());
    put(112, &slope.to_le_bytes());
    put(123, &[2]);
    put(344, b"n+1\0");
    bytes.extend(samples.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

#[test]
fn masks_and_labels_are_told_apart_from_grey_values() {
    let dir = temp();
    let dims = [24, 20, 16];
    let samples = |value: &dyn Fn([i16; 3]) -> i16| -> Vec<i16> {
        let [nx, ny, nz] = dims;
        let at = |i: i16| [i % nx, i / nx % ny, i / nx / ny];
        (0..nx * ny * nz).map(|i| value(at(i))).collect()
    };
    let body =
        |[x, y, z]: [i16; 3]| (4..14).contains(&x) && (4..12).contains(&y) && (3..9).contains(&z);
    let mask = samples(&|p| 4 * i16::from(body(p)));
    // two that touch, and one apart
    let labels = samples(&|p| match p {
        [20..23, 14..17, 2..5] => 7,
        _ => i16::from(body(p)) * (1 + p[0] / 9),
    });
    let grey = samples(&|[x, y, z]| (x * x + 3 * y + z) % 97);
    let said = |name: &str, part: &str| {
        let info = json(&ok(dir.path(), &["info", name, "--json"]));
        let rows = ok(dir.path(), &["info", name]);
        let args = ["convert", name, "out", "--threshold", "0.5", "--force"];
        let convert = json(&ok(dir.path(), &[&args[..], &["--json"]].concat()));
        let log = alvis(dir.path(), &args).stderr;
        let log = String::from_utf8(log).unwrap();
        assert_eq!(rows.contains("\nwarning  "), !part.is_empty(), "{rows}");
        assert!(
            part.is_empty() || log.contains(&format!("warning: the samples are of {part}")),
            "{log}"
        );
        for json in [info, convert] {
            let warnings = json["warnings"].as_array().unwrap();
            let found = warnings
                .iter()
                .any(|w| w.as_str().unwrap().contains("the samples are of"));
            assert_eq!(found, !part.is_empty(), "{name}: {warnings:?}");
            assert!(warnings.iter().any(|w| w.as_str().unwrap().contains(part)) == found);
        }
    };
    for (name, slope, samples, part) in [
        ("mask.nii", 1.0, &mask, "two values, 0 and 4,"),
        ("scaled.nii", 0.25, &mask, "two values, 0 and 1,"),
        ("labels.nii", 1.0, &labels, "4 values (0, 1, 2, 7)"),
        // measured values are no labels, however few
        ("scaled-labels.nii", 0.5, &labels, ""),
        ("grey.nii", 1.0, &grey, ""),
    ] {
        std::fs::write(dir.path().join(name), nifti(dims, slope, samples)).unwrap();
        said(name, part);
    }
    let text = ok(dir.path(), &["info", "labels.nii"]);
    assert!(
        text.contains("labels that touch become one object"),
        "{text}"
    );
}

#[test]
fn a_size_with_exchanged_axes_is_doubted() {
    let dir = temp();
    let make = [
        "phantom", "foam", "s.raw", "--dims", "96,72,60", "--dtype", "u16", "--quiet",
    ];
    ok(
        dir.path(),
        &[&make[..], &["--noise", "0.05", "--pitch", "24"]].concat(),
    );
    for (dims, doubted) in [
        ("96,72,60", false),
        ("72,96,60", true),
        ("60,72,96", true),
        ("96,60,72", true),
        ("48,144,60", true),
    ] {
        let raw = ["--dims", dims, "--dtype", "u16"];
        let info = json(&ok(
            dir.path(),
            &[&["info", "s.raw", "--json"][..], &raw].concat(),
        ));
        let args = ["convert", "s.raw", "out", "--threshold", "30000", "--force"];
        let output = alvis(dir.path(), &[&args[..], &raw].concat());
        assert!(output.status.success());
        let log = String::from_utf8(output.stderr).unwrap();
        let warnings = info["warnings"].to_string();
        let text = "96,72,60 fits better";
        assert_eq!(warnings.contains(text), doubted, "{dims}: {warnings}");
        assert_eq!(log.contains(text), doubted, "{dims}: {log}");
        assert_eq!(
            warnings.contains("looks wrong"),
            doubted,
            "{dims}: {warnings}"
        );
        // a header may be wrong as well
        let header = format!(
            "ObjectType = Image\nNDims = 3\nDimSize = {}\nElementType = MET_USHORT\nElementDataFile = s.raw\n",
            dims.replace(',', " ")
        );
        std::fs::write(dir.path().join("s.mhd"), header).unwrap();
        let info = ok(dir.path(), &["info", "s.mhd"]);
        let better = "96,72,60 fits better (correct the header)";
        assert_eq!(info.contains(better), doubted, "{dims}: {info}");
    }
}
