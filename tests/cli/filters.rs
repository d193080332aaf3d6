//! Filters before the threshold: every command that reads a volume applies the same ones.

use super::{alvis, fails, foam, json, ok, stderr, stdout, temp};
use serde_json::{Value, json as value};
use std::path::Path;

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

fn index(dir: &Path, set: &str) -> Value {
    let text = std::fs::read_to_string(dir.join(set).join("index.json")).unwrap();
    json(&text)
}

/// A foam of 41 x 36 x 32 voxels of u16, which blocks of 2 do not fill.
fn noisy(dir: &Path, name: &str) {
    let more = "--dims 41,36,32 --dtype u16 --pitch 13 --noise 0.1 --spacing 0.1,0.1,0.2 --unit mm";
    foam(dir, name, &words(more));
}

#[test]
fn all_commands_apply_the_same_filters() {
    let dir = temp();
    noisy(dir.path(), "a.nrrd");
    let line = "--clamp 15000,50000 --downsample 2 --invert";
    let list = value!([
        {"name": "clamp", "low": 15000.0, "high": 50000.0},
        {"name": "downsample", "factor": 2},
        {"name": "invert"},
    ]);
    let info = json(&ok(
        dir.path(),
        &words(&format!("info a.nrrd --json --quiet {line}")),
    ));
    assert_eq!(info["filters"], list);
    assert_eq!(info["dims"], value!([20, 18, 16]));
    assert_eq!(
        (&info["dtype"], &info["spacing"], &info["origin"]),
        (
            &"u16".into(),
            &value!([0.2, 0.2, 0.4]),
            &value!([0.05, 0.05, 0.1])
        )
    );
    let low = info["min"].as_f64().unwrap();
    assert!(low >= 65_535.0 - 50_000.0, "{low}");
    let text = ok(dir.path(), &words(&format!("info a.nrrd {line}")));
    let row = "clamp 15000,50000, downsample 2, invert; before: 41 x 36 x 32 voxels, u16\n";
    assert!(text.contains(row) && text.contains("rounded"), "{text}");

    let convert = format!("convert a.nrrd out --threshold otsu --macrocube 8 {line}");
    let made = json(&ok(
        dir.path(),
        &words(&format!("{convert} --json --quiet")),
    ));
    assert_eq!(made["filters"], list);
    let stated = index(dir.path(), "out");
    assert_eq!(stated["filters"], list);
    assert_eq!(stated["source"]["dims"], value!([41, 36, 32]));
    assert_eq!(stated["grid"]["dims"], value!([20, 18, 16]));
    assert_eq!(stated["threshold"], info["otsu_threshold"]);
    assert_eq!(stated["spacing"], info["spacing"]);
    let set = ok(dir.path(), &["info", "out"]);
    assert!(
        set.contains("clamp 15000,50000, downsample 2, invert\n"),
        "{set}"
    );
    let set = json(&ok(dir.path(), &["info", "out", "--json"]));
    assert_eq!(set["filters"], list);

    // by themselves, or as they were given
    for more in ["", " ", &format!(" {line}")] {
        let verify = format!("verify out --against a.nrrd{}", more.trim_end());
        let said = ok(dir.path(), &words(&verify));
        assert!(said.contains("that of the volume"), "{said}");
    }
    let others = "--clamp 15000,50000 --invert --downsample 2";
    for other in ["--downsample 2", others] {
        for command in [
            "verify out --against a.nrrd",
            "preview a.nrrd p.png --tiles out",
        ] {
            let message = fails(dir.path(), &words(&format!("{command} {other}")));
            for part in [
                "those of the tiles: clamp 15000,50000, downsample 2, invert",
                "leave",
            ] {
                assert!(message.contains(part), "{message}");
            }
        }
    }
    // the picture of the tiles' volume is that of the filtered one
    let picture = |name: &str, more: &str| {
        let line = format!("preview a.nrrd {name} --plain --scale 1 --quiet {more}");
        ok(dir.path(), &words(&line));
        image::open(dir.path().join(name)).unwrap().to_rgb8()
    };
    let window = "--window 15535:50535 --at 7";
    let own = picture("own.png", &format!("{line} {window}"));
    assert_eq!(own.dimensions(), (20, 18));
    let of_tiles = picture(
        "tiles.png",
        &format!("--tiles out --where id<0 --threshold 1e9 {window}"),
    );
    assert!(own == of_tiles);
    let cells = picture("cells.png", &format!("--tiles out {window}"));
    assert!(own != cells);
}

#[test]
fn a_set_without_filters_has_no_key_and_takes_none() {
    let dir = temp();
    foam(dir.path(), "a.mhd", &[]);
    let convert = words("convert a.mhd out --threshold otsu --json --quiet");
    let made = json(&ok(dir.path(), &convert));
    assert_eq!(made.get("filters"), None);
    assert_eq!(index(dir.path(), "out").get("filters"), None);
    let info = json(&ok(dir.path(), &["info", "a.mhd", "--json", "-q"]));
    assert_eq!(info["filters"], value!([]));
    let verify = words("verify out --against a.mhd --invert");
    let message = fails(dir.path(), &verify);
    assert!(message.contains("those of the tiles: none"), "{message}");
    for command in ["verify out --invert", "info out --downsample 2"] {
        let message = fails(dir.path(), &words(command));
        assert!(message.contains("without a volume"), "{message}");
    }
}

/// Filters are applied as they are typed, whatever lies between them.
#[test]
fn the_order_is_that_of_the_command_line() {
    let dir = temp();
    foam(dir.path(), "a.mhd", &[]);
    let names = |line: &str| {
        let args = format!("info a.mhd --json -q {line}");
        let info = json(&ok(dir.path(), &words(&args)));
        let list = info["filters"].as_array().unwrap().clone();
        let names: Vec<String> = list
            .iter()
            .map(|f| f["name"].as_str().unwrap()[..1].into())
            .collect();
        (names.join(""), info["min"].as_f64().unwrap())
    };
    let (clamped, low) = names("--clamp 60,90 --invert");
    assert_eq!((clamped.as_str(), low), ("ci", 165.0));
    let (inverted, low) = names("--invert --threshold 3 --clamp=60,90");
    assert_eq!((inverted.as_str(), low), ("ic", 60.0));
    let (many, _) =
        names("--downsample 2 --clamp 10,200 --io read --invert --downsample 3 --clamp 0,90");
    assert_eq!(many, "dcidc");
}

#[test]
fn bad_values_are_one_message() {
    let dir = temp();
    foam(dir.path(), "a.mhd", &["--dims", "20,20,12"]);
    for (option, part) in [
        ("--clamp 5,1", "the first not above the second"),
        ("--clamp 5", "two finite numbers"),
        ("--clamp -5", "two finite numbers"),
        ("--clamp nan,5", "two finite numbers"),
        (
            "--clamp 300,400",
            "--clamp: found 300,400, expected a range with a value of u8 in it",
        ),
        ("--clamp 7.2,7.8", "a whole number from 0 to 255"),
        ("--downsample 1", "from 2 to 16"),
        ("--downsample -2", "from 2 to 16"),
        ("--downsample 2.5", "from 2 to 16"),
        (
            "--downsample 7",
            "--downsample: found 7 for 20 x 20 x 12 voxels, expected a factor that leaves",
        ),
        ("--downsample 2 --downsample 4", "found 4 for 10 x 10 x 6"),
        ("--smooth 0", "above 0 and up to 32"),
        ("--smooth -1", "above 0 and up to 32"),
        ("--median 3", "expected 1 or 2 voxels"),
        ("--invert=3", "--invert"),
    ] {
        for command in [
            "info a.mhd",
            "convert a.mhd out --threshold 9",
            "preview a.mhd p.png",
        ] {
            let message = fails(dir.path(), &words(&format!("{command} {option}")));
            assert!(message.contains(part), "{option}: {message}");
        }
    }
    let many = format!("info a.mhd{}", " --clamp 0,9".repeat(17));
    let message = fails(dir.path(), &words(&many));
    assert!(
        message.contains("17 of them, expected at most 16"),
        "{message}"
    );
    assert!(!dir.path().join("out").exists() && !dir.path().join("p.png").exists());
}

/// A length is as many voxels as the voxel's size at that place of the list says, along each axis.
#[test]
fn a_length_is_smoothed_over_by_the_size_of_a_voxel() {
    let dir = temp();
    noisy(dir.path(), "a.nrrd");
    let sigma = |line: &str| {
        let args = format!("info a.nrrd --json -q {line}");
        let info = json(&ok(dir.path(), &words(&args)));
        assert_eq!(info["dtype"], "f32");
        let list = info["filters"].as_array().unwrap().clone();
        list.iter().map(|f| f["sigma"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(sigma("--smooth 1.5"), [value!(1.5)]);
    assert_eq!(sigma("--smooth 1,1,0.5"), [value!([1.0, 1.0, 0.5])]);
    assert_eq!(sigma("--smooth 70um"), [value!([0.7, 0.7, 0.35])]);
    assert_eq!(
        sigma("--smooth 0.2mm --spacing 0.1 --unit mm"),
        [value!(2.0)]
    );
    let twice = sigma("--downsample 2 --smooth 70um");
    assert_eq!(twice, [Value::Null, value!([0.35, 0.35, 0.175])]);
    for (option, part) in [
        ("--smooth 20parsec", "or a length, as in 20um"),
        ("--smooth 0um", "or a length, as in 20um"),
        (
            "--smooth 9mm",
            "--smooth: found 9mm, which is 90,90,45 voxels, expected a number of voxels above 0 and up to 32",
        ),
    ] {
        let message = fails(dir.path(), &words(&format!("info a.nrrd {option}")));
        assert!(message.contains(part), "{option}: {message}");
    }
    foam(dir.path(), "b.mhd", &["--dims", "20,20,12"]);
    let message = fails(dir.path(), &words("info b.mhd --smooth 20um"));
    assert!(message.contains("give --spacing and --unit"), "{message}");
    // what was a length is verified as it was done
    let line = "convert a.nrrd out --threshold otsu --smooth 70um --median 1 -q";
    ok(dir.path(), &words(line));
    assert_eq!(
        index(dir.path(), "out")["filters"],
        value!([{"name": "smooth", "sigma": [0.7, 0.7, 0.35]}, {"name": "median", "radius": 1}])
    );
    ok(dir.path(), &words("verify out --against a.nrrd"));
    ok(
        dir.path(),
        &words("verify out --against a.nrrd --smooth 70um --median 1"),
    );
}

/// What a raw file is, before filters, is in the index, as is the size of a voxel that was given.
#[test]
fn a_raw_file_is_opened_again_as_it_was_before_filters() {
    let dir = temp();
    foam(dir.path(), "a.raw", &words("--dims 33,30,28 --dtype i16"));
    let raw = "--dims 33,30,28 --dtype i16 --spacing 0.1 --unit mm";
    let line = format!("convert a.raw out --threshold 0 --downsample 3 --crop 1:,:9,: -q {raw}");
    ok(dir.path(), &words(&line));
    let stated = index(dir.path(), "out");
    assert_eq!(stated["source"]["dims"], value!([33, 30, 28]));
    assert_eq!(stated["grid"]["dims"], value!([10, 9, 9]));
    assert_eq!(stated["spacing"], value!([0.3, 0.3, 0.3]));
    ok(dir.path(), &words("verify out --against a.raw"));
    // and one that was said to be filtered otherwise does not fit
    let text = stated.to_string().replace(r#""factor":3"#, r#""factor":2"#);
    std::fs::write(dir.path().join("out/index.json"), text).unwrap();
    let output = alvis(dir.path(), &words("verify out --against a.raw"));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(
        stdout(&output).contains("VERTEX_MISPLACED"),
        "{}",
        stdout(&output)
    );
    let text = stated
        .to_string()
        .replace(r#""downsample""#, r#""sharpen""#);
    std::fs::write(dir.path().join("out/index.json"), text).unwrap();
    let message = fails(dir.path(), &["cells", "out"]);
    assert!(
        message.contains("sharpen") && message.contains("downsample"),
        "{message}"
    );
}

/// A compressed stream is read forward, whatever is made of it; the tiles are the same.
#[test]
fn a_stream_gives_the_same_tiles() {
    let dir = temp();
    noisy(dir.path(), "a.raw");
    let raw = std::fs::read(dir.path().join("a.raw")).unwrap();
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packed, &raw).unwrap();
    std::fs::write(dir.path().join("a.raw.gz"), packed.finish().unwrap()).unwrap();
    for input in ["a.raw", "a.raw.gz"] {
        let line = format!(
            "convert {input} {input}.out --threshold otsu --median 1 --downsample 2 --smooth 0.6 --invert --macrocube 9 -q --dims 41,36,32 \
             --dtype u16"
        );
        ok(dir.path(), &words(&line));
        let verify = format!("verify {input}.out --against {input}");
        ok(dir.path(), &words(&verify));
    }
    let cells = |input: &str| std::fs::read(dir.path().join(input).join("cells.csv")).unwrap();
    assert!(cells("a.raw.out") == cells("a.raw.gz.out"));
}

#[test]
fn what_is_typed_is_told_as_it_was() {
    let dir = temp();
    let dir = dir.path();
    foam(dir, "a.mhd", &["--spacing", "0.05", "--unit", "mm"]);
    let message = fails(dir, &words("convert a.mhd out --threshold 100 --smooth 1m"));
    assert!(
        message.contains("found 1m, which is 20000 voxels"),
        "{message}"
    );
    // each filter counts as often as it is given
    ok(
        dir,
        &words("convert a.mhd twice --threshold 100 --invert --median 1 --invert --quiet"),
    );
    let index = json(&std::fs::read_to_string(dir.join("twice/index.json")).unwrap());
    let names: Vec<&str> = index["filters"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["invert", "median", "invert"]);
    let output = alvis(dir, &words("convert a.mhd none --threshold 1e300"));
    assert!(stderr(&output).contains("no voxel reaches the threshold 1e300:"));
}
