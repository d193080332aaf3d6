//! The region of interest: every command that reads a volume takes the same one.

use super::{fails, json, ok, temp};
use serde_json::{Value, json as value};
use std::path::Path;

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn run(dir: &Path, line: &str) -> String {
    ok(dir, &words(line))
}

/// `a.raw`, 40 x 40 x 12 bytes: a round sample of brightness 200 with pores of 20 in air of 30, at 19.5, 20.5 with a
/// radius of 15; and `m.raw`, a mask of its left half.
fn scan(dir: &Path) {
    let (mut scan, mut mask) = (Vec::new(), Vec::new());
    for z in 0..12 {
        for y in 0..40 {
            for x in 0..40 {
                let from = |cx: f64, cy: f64, cz: f64| {
                    let d = [f64::from(x) - cx, f64::from(y) - cy, f64::from(z) - cz];
                    d.iter().map(|v| v * v).sum::<f64>().sqrt()
                };
                let pore = from(15.0, 20.0, 5.0) < 3.2 || from(30.5, 20.0, 6.0) < 3.2;
                let inside = from(19.5, 20.5, f64::from(z)) < 15.0;
                scan.push(match (inside, pore) {
                    (false, _) => 30u8,
                    (true, true) => 20,
                    (true, false) => 200,
                });
                mask.push(u8::from(x < 20));
            }
        }
    }
    std::fs::write(dir.join("a.raw"), scan).unwrap();
    std::fs::write(dir.join("m.raw"), mask).unwrap();
}

const INPUT: &str = "a.raw --dims 40,40,12 --dtype u8";

#[test]
fn a_round_sample_is_found_and_counts_alone() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    let info = json(&run(
        dir,
        &format!("info {INPUT} --roi cylinder --json --quiet"),
    ));
    let region = &info["region"];
    assert_eq!(
        (&region["shape"], &region["fill"]),
        (&"cylinder".into(), &"material".into())
    );
    let near = |v: &Value, expected: f64| (v.as_f64().unwrap() - expected).abs() < 0.3;
    assert!(
        near(&region["centre"][0], 19.5) && near(&region["centre"][1], 20.5),
        "{region}"
    );
    let radius = region["radius"].as_f64().unwrap();
    assert!((13.0..14.6).contains(&radius), "{region}");
    let share = region["voxels"].as_f64().unwrap() / (40.0 * 40.0 * 12.0);
    assert!((region["share"].as_f64().unwrap() - share).abs() < 1e-9);
    // the air around is not in it
    assert_eq!(info["min"], value!(20.0));
    let sum: u64 = info["histogram"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_u64().unwrap())
        .sum();
    assert_eq!(region["voxels"], value!(sum));
    let text = run(dir, &format!("info {INPUT} --roi cylinder"));
    assert!(
        text.contains("(found)") && text.contains("material outside"),
        "{text}"
    );

    let made = format!(
        "convert {INPUT} out --threshold otsu --macrocube 16 --roi cylinder --json --quiet"
    );
    let made = json(&run(dir, &made));
    // the pore at the rim is cut
    assert_eq!((&made["cells"], &made["objects"]), (&value!(2), &value!(1)));
    assert_eq!(made["region"]["centre"], region["centre"]);
    assert_eq!(made["region"]["fill_value"], value!(200.0));
    let cells = run(dir, "cells out --format csv");
    let touches: Vec<&str> = cells
        .lines()
        .skip(1)
        .map(|l| l.rsplit(',').nth(1).unwrap())
        .collect();
    assert_eq!(touches, ["0", "1"], "{cells}");
    let summary = json(&run(dir, "cells out --summary --json"));
    assert_eq!(summary["porosity_of"], value!("region"));
    let below = 40.0 * 40.0 * 12.0 - made["voxels_above"].as_f64().unwrap();
    let porosity = below / region["voxels"].as_f64().unwrap();
    assert!((summary["porosity"].as_f64().unwrap() - porosity).abs() < 1e-12);
    let objects = json(&run(dir, "cells out --objects --summary --json --quiet"));
    assert_eq!(objects["volume_fraction"], Value::Null);
    assert!(
        objects["warnings"][0]
            .as_str()
            .unwrap()
            .contains("--roi-fill air")
    );
    let set = run(dir, "info out");
    assert!(set.contains("cylinder along z, axis at x 19."), "{set}");

    assert!(run(dir, "verify out").starts_with("ok"));
    for more in ["", " --roi cylinder"] {
        let said = run(dir, &format!("verify out --against {INPUT}{more}"));
        assert!(said.contains("that of the volume"), "{said}");
    }
    run(
        dir,
        &format!("preview {INPUT} a.png --roi cylinder --threshold otsu"),
    );
    run(dir, &format!("preview {INPUT} b.png --tiles out"));
    let cells = json(&run(
        dir,
        &format!("preview {INPUT} c.png --tiles out --axis y --json --quiet"),
    ));
    assert_eq!(cells["cells"], value!(2));

    // what is made of the set is of the same region
    run(dir, "repack out web --for web --quiet");
    run(dir, "select out part --where id=2 --quiet");
    for set in ["web", "part"] {
        let index = std::fs::read_to_string(dir.join(set).join("index.json")).unwrap();
        assert_eq!(json(&index)["region"], made["region"], "{set}");
        assert!(run(dir, &format!("verify {set}")).starts_with("ok"));
    }

    // as air, what is outside is one cell with the pore at the rim
    let air =
        format!("convert {INPUT} air --threshold 110 --roi cylinder --roi-fill air --json --quiet");
    let air = json(&run(dir, &air));
    assert_eq!((&air["cells"], &air["objects"]), (&value!(2), &value!(1)));
    let objects = json(&run(dir, "cells air --objects --summary --json --quiet"));
    let solid = objects["volume_fraction"].as_f64().unwrap();
    assert!((solid + porosity - 1.0).abs() < 1e-12, "{solid} {porosity}");
    let message = fails(dir, &words("cells air --summary --outside border-cell"));
    assert!(message.contains("region of interest"), "{message}");
}

#[test]
fn a_mask_is_needed_again_to_compare_with_the_volume() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    run(
        dir,
        &format!("convert {INPUT} out --threshold 110 --roi mask:m.raw --crop 2:,:,: --quiet"),
    );
    let index = json(&std::fs::read_to_string(dir.join("out/index.json")).unwrap());
    let region = &index["region"];
    assert_eq!(
        (&region["shape"], &region["file"]),
        (&"mask".into(), &"m.raw".into())
    );
    assert_eq!(region["voxels"], value!(18 * 40 * 12));
    assert!(run(dir, "verify out").starts_with("ok"));
    let against = format!("verify out --against {INPUT}");
    let said = run(dir, &format!("{against} --roi mask:m.raw"));
    assert!(said.contains("that of the volume"), "{said}");
    let message = fails(dir, &words(&against));
    assert!(
        message.contains("--roi mask:FILE, of the mask m.raw"),
        "{message}"
    );
    let message = fails(dir, &words(&format!("preview {INPUT} a.png --tiles out")));
    assert!(message.contains("--roi mask:FILE"), "{message}");
    run(
        dir,
        &format!("preview {INPUT} a.png --tiles out --roi mask:m.raw"),
    );
    let mut other = std::fs::read(dir.join("m.raw")).unwrap();
    other[7] = 0;
    std::fs::write(dir.join("other.raw"), other).unwrap();
    for (roi, part) in [
        ("mask:other.raw", "other.raw, with other voxels inside"),
        (
            "cylinder",
            "expected that of the tiles: mask:m.raw with material outside",
        ),
        ("mask:m.raw --roi-fill air", "air outside"),
    ] {
        let message = fails(dir, &words(&format!("{against} --roi {roi}")));
        assert!(message.contains(part), "{roi}: {message}");
    }
    // a conversion with another mask is another one
    let again = format!("convert {INPUT} out --threshold 110 --crop 2:,:,: --quiet --resume");
    let other = run(dir, &format!("{again} --roi mask:m.raw"));
    assert_eq!(other, "");
    run(
        dir,
        &format!("convert {INPUT} none --threshold 110 --quiet"),
    );
    let message = fails(
        dir,
        &words(&format!("verify none --against {INPUT} --roi mask:m.raw")),
    );
    assert!(
        message.contains("expected none, as the tiles have"),
        "{message}"
    );
}

#[test]
fn bad_regions_get_one_message() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    std::fs::write(dir.join("nothing.raw"), vec![0; 40 * 40 * 12]).unwrap();
    let convert = format!("convert {INPUT} out --threshold 110");
    for (line, parts) in [
        (format!("{convert} --roi sphere"), vec!["cylinder:CX,CY,R"]),
        (
            format!("{convert} --roi cylinder:1,2"),
            vec!["cylinder:CX,CY,R"],
        ),
        (
            format!("{convert} --roi cylinder:90,90,10"),
            vec!["cylinder:90,90,10", "meets the volume of 40 x 40 x 12"],
        ),
        (
            format!("{convert} --roi cylinder:5,5,4 --crop 20:,:,:"),
            vec!["nothing lies in the crop"],
        ),
        (
            format!("{convert} --roi-fill air"),
            vec!["--roi-fill", "no --roi with it"],
        ),
        (
            format!("{convert} --roi mask:m.raw --downsample 2"),
            vec!["m.raw"],
        ),
        (format!("{convert} --roi mask:nothing.raw"), vec!["all 0"]),
        (
            format!("{convert} --roi mask:missing.raw"),
            vec!["missing.raw"],
        ),
        (
            format!("convert {INPUT} out --threshold 300 --roi cylinder"),
            vec!["--roi-fill", "material", "largest sample of u8"],
        ),
        (
            format!("{convert} --roi cylinder --clamp 30,31"),
            vec![
                "--roi cylinder",
                "brighter than the air",
                "cylinder:CX,CY,R",
            ],
        ),
    ] {
        // of one value, of which no sample is brighter
        let line = line.replace("--clamp 30,31", "--clamp 30,30");
        let message = fails(dir, &words(&line));
        for part in parts {
            assert!(message.contains(part), "{line}: {message}");
        }
        assert!(!dir.join("out").exists(), "{line}");
    }
    // of another size, with a header
    run(dir, "phantom sphere small.mhd --dims 20,20,20 --quiet");
    let message = fails(dir, &words(&format!("{convert} --roi mask:small.mhd")));
    assert!(
        message.contains("20 x 20 x 20") && message.contains("40 x 40 x 12"),
        "{message}"
    );
    // of the same size, but in another place
    let header =
        "NDims = 3\nDimSize = 40 40 12\nElementType = MET_UCHAR\nElementDataFile = m.raw\n";
    let mask = |spacing: &str| {
        header.replace(
            "ElementType",
            &format!("ElementSpacing = {spacing}\nElementType"),
        )
    };
    let placed = format!("{convert} --spacing 0.2 --unit mm --roi mask:m.mhd");
    std::fs::write(dir.join("m.mhd"), mask("0.1 0.1 0.1")).unwrap();
    let message = fails(dir, &words(&placed));
    assert!(
        message.contains("the mask m.mhd with voxels of [0.1"),
        "{message}"
    );
    // of a volume at 0, 0, 0
    let moved = mask("0.2 0.2 0.2\nOffset = 5 0 0");
    std::fs::write(dir.join("m.mhd"), moved).unwrap();
    let message = fails(dir, &words(&placed));
    assert!(message.contains("the first voxel at [5"), "{message}");
    std::fs::write(dir.join("m.mhd"), mask("0.2 0.2 0.2")).unwrap();
    run(dir, &format!("{placed} --quiet"));
    // of two arrays none is chosen
    let array = |name: &str| {
        let values = "1 ".repeat(40 * 40 * 12);
        format!("<DataArray type=\"UInt8\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>")
    };
    let extent = "0 39 0 39 0 11";
    let vti = format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"{extent}\"><Piece \
         Extent=\"{extent}\"><PointData>{}{}</PointData></Piece></ImageData></VTKFile>",
        array("a"),
        array("b")
    );
    std::fs::write(dir.join("two.vti"), vti).unwrap();
    for option in ["--roi mask:", "--labels "] {
        let line = format!("convert {INPUT} parts --threshold 110 {option}two.vti");
        let message = fails(dir, &words(&line));
        assert!(
            message.contains("two.vti, of which one part has to be chosen")
                && message.contains("a file of its own"),
            "{message}"
        );
    }
    // what is known not to be raw is not taken for it
    let vtk =
        "# vtk DataFile Version 3.0\nit\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 40 40 12\n";
    std::fs::write(dir.join("old.vtk"), vtk).unwrap();
    std::fs::write(dir.join("text.tif"), "a text").unwrap();
    for (option, file, part) in [
        ("--roi mask:", "old.vtk", "legacy VTK"),
        ("--labels ", "old.vtk", "legacy VTK"),
        ("--labels ", "text.tif", "a TIFF"),
        ("--labels ", "text.tif", ".npy or .nrrd"),
    ] {
        let line = format!("convert {INPUT} parts --threshold 110 {option}{file}");
        let message = fails(dir, &words(&line));
        assert!(message.contains(part), "{message}");
        assert!(
            !message.contains("--dims") && !message.contains("--offset"),
            "{message}"
        );
    }
    let inner = convert.replace(" out ", " out/inner ");
    let message = fails(dir, &words(&inner));
    assert!(
        message.contains("out/inner, which lies in the tile set"),
        "{message}"
    );
}

#[test]
fn masks_and_labels_lie_where_scans_of_patients_do_in_either_world() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nspace: right-anterior-superior\nsizes: 40 40 12\n\
        space directions: (-0.2,0,0) (0,-0.2,0) (0,0,0.2)\nspace units: \"mm\" \"mm\" \"mm\"\n\
        space origin: (5,6,7)\nencoding: raw\ndata file: a.raw\n\n";
    std::fs::write(dir.join("scan.nhdr"), header).unwrap();
    let mask = |more: &str| {
        let header = format!(
            "NDims = 3\nDimSize = 40 40 12\nElementSpacing = 0.2 0.2 0.2\nOffset = -5 -6 7\n{more}\
             ElementType = MET_UCHAR\nElementDataFile = m.raw\n"
        );
        std::fs::write(dir.join("m.mhd"), header).unwrap();
    };
    let lines = ["--roi mask:m.mhd", "--labels m.mhd"]
        .map(|option| format!("convert scan.nhdr out --threshold 110 --quiet --force {option}"));
    for line in &lines {
        mask("AnatomicalOrientation = RAI\n");
        run(dir, line);
        // of a world that is not stated, numbers are compared as they are
        mask("");
        let message = fails(dir, &words(line));
        assert!(message.contains("m.mhd with axes along"), "{message}");
    }
}

#[test]
fn labels_and_masks_in_chunks_too_large_for_the_limit_are_refused_before_they_are_read() {
    let dir = temp();
    let dir = dir.path();
    let scan = std::fs::File::create(dir.join("s.raw")).unwrap();
    scan.set_len(256 << 16).unwrap();
    std::fs::create_dir(dir.join("one.zarr")).unwrap();
    let array = value!({
        "zarr_format": 2, "shape": [256, 256, 256], "chunks": [256, 256, 256], "dtype": "<u4",
        "compressor": null, "fill_value": 1, "order": "C", "filters": null
    });
    std::fs::write(dir.join("one.zarr/.zarray"), array.to_string()).unwrap();
    let scan = "convert s.raw out --dims 256,256,256 --dtype u8 --threshold 1 --memory 64MiB";
    for option in ["--labels one.zarr", "--roi mask:one.zarr"] {
        let message = fails(dir, &words(&format!("{scan} {option}")));
        let name = &option[..option.find(' ').unwrap()];
        assert!(
            message.contains("64MiB is too little")
                && message.contains(&format!("the file of {name} is read in parts so large")),
            "{message}"
        );
        assert!(!dir.join("out").exists());
    }
}

/// Writes bytes of a scan of 60 x 60 voxels and some slices.
fn write(dir: &Path, name: &str, slices: u32, of: impl Fn([f64; 3]) -> u8) {
    let at = |i: u32| [i % 60, i / 60 % 60, i / 3600].map(f64::from);
    let bytes: Vec<u8> = (0..3600 * slices).map(|i| of(at(i))).collect();
    std::fs::write(dir.join(name), bytes).unwrap();
}

fn disc([x, y, _]: [f64; 3], [cx, cy, r]: [f64; 3]) -> bool {
    (x - cx) * (x - cx) + (y - cy) * (y - cy) < r * r
}

#[test]
fn what_else_is_round_and_which_slices_show_it_is_said() {
    let dir = temp();
    let dir = dir.path();
    let grey = |is: bool| if is { 200u8 } else { 30 };
    write(dir, "tube.raw", 20, |p| {
        let tube = disc(p, [30.0, 30.0, 28.0]) && !disc(p, [30.0, 30.0, 24.0]);
        grey(tube || disc(p, [29.0, 30.0, 18.0]) && (3.0..16.0).contains(&p[2]))
    });
    let input = "tube.raw --dims 60,60,20 --dtype u8 --roi cylinder";
    let info = json(&run(dir, &format!("info {input} --json")));
    let region = &info["region"];
    assert!(
        (region["radius"].as_f64().unwrap() - 17.0).abs() < 0.6,
        "{region}"
    );
    assert_eq!(region["slices"], value!([3, 16]));
    let other = region["others"][0].as_str().unwrap();
    assert!(other.starts_with("cylinder:30,30,2"), "{region}");
    let told = |warnings: &Value, part: &str| {
        let warnings = warnings.as_array().unwrap().iter();
        warnings
            .filter(|w| w.as_str().unwrap().contains(part))
            .count()
    };
    let made = json(&run(
        dir,
        &format!("convert {input} out --threshold 100 --json --quiet"),
    ));
    for warnings in [&info["warnings"], &made["warnings"]] {
        assert_eq!(told(warnings, "a tube around it"), 1, "{warnings}");
        assert_eq!(told(warnings, "--crop :,:,3:16"), 1, "{warnings}");
    }
    // in those slices there is nothing to say of them
    let crop = "--crop :,:,3:16";
    let part = json(&run(dir, &format!("info {input} {crop} --json")));
    assert_eq!(
        (told(&part["warnings"], "--crop"), &part["crop"]),
        (0, &value!("0:60,0:60,3:16"))
    );
    assert_eq!(part["region"]["centre"], region["centre"]);
    let text = run(dir, &format!("info {input} {crop}"));
    assert!(text.contains("crop       0:60,0:60,3:16\n"), "{text}");
    run(
        dir,
        &format!("convert {input} part --threshold 100 {crop} --quiet"),
    );
    // a region that the scan shows has to be that of the tiles
    run(dir, &format!("verify part --against {input}"));
    run(
        dir,
        &"convert INPUT other --threshold 100 --quiet --roi cylinder:30,30,20"
            .replace("INPUT", &input.replace(" --roi cylinder", "")),
    );
    let message = fails(dir, &words(&format!("verify other --against {input}")));
    let parts = [
        "--roi: found cylinder:29,30,1",
        "which the scan shows",
        "expected that of the tiles: cylinder:30,30,20",
    ];
    for part in parts {
        assert!(message.contains(part), "{message}");
    }
    write(dir, "two.raw", 9, |p| {
        grey(disc(p, [16.0, 30.0, 13.0]) || disc(p, [43.0, 30.0, 14.0]))
    });
    let message = fails(
        dir,
        &words("info two.raw --dims 60,60,9 --dtype u8 --roi cylinder"),
    );
    assert!(
        message.contains("two of them, cylinder:43") && message.contains(" and cylinder:16"),
        "{message}"
    );
}

#[test]
fn what_is_outside_of_the_region_is_not_taken_for_the_sample() {
    let dir = temp();
    let dir = dir.path();
    // grains in a round sample of resin, one of them at its edge
    write(dir, "a.raw", 16, |[x, y, z]| {
        let grain = |c: [f64; 3], r: f64| {
            let d = [x - c[0], y - c[1], z - c[2]];
            d.iter().map(|v| v * v).sum::<f64>() < r * r
        };
        let grains = grain([28.0, 30.0, 8.0], 6.0)
            || grain([36.0, 22.0, 8.0], 3.5)
            || grain([8.0, 30.0, 8.0], 4.0);
        if grains { 200 } else { 30 }
    });
    let roi = "a.raw --dims 60,60,16 --dtype u8 --roi cylinder:30,30,24";
    run(dir, &format!("convert {roi} out --threshold 100 --quiet"));
    run(
        dir,
        &format!("convert {roi} air --threshold 100 --roi-fill air --quiet"),
    );
    let warns = |line: &str| {
        let output = super::alvis(dir, &words(line));
        assert_eq!(
            output.status.code(),
            Some(0),
            "{line}: {}",
            super::stderr(&output)
        );
        super::stderr(&output).contains("object 1 reaches outside of the region of interest")
    };
    for (line, of_outside) in [
        ("export SET a.stl --objects --largest 1 --force", true),
        ("select SET part --objects --largest 1 --force", true),
        (
            "preview a.raw a.png --dims 60,60,16 --dtype u8 --tiles SET --objects --largest 1 --force",
            true,
        ),
        ("cells SET --objects --largest 1", true),
        ("cells SET --objects --largest 1 --json", true),
        ("export SET a.stl --objects --where id>1 --force", false),
        (
            "select SET part --objects --largest 1 --omit --force",
            false,
        ),
        ("export SET a.stl --objects --force", false),
        ("export SET a.stl --largest 1 --force", false),
    ] {
        assert_eq!(warns(&line.replace("SET", "out")), of_outside, "{line}");
        assert!(!warns(&line.replace("SET", "air")), "{line}");
    }
    let export = "export out a.stl --objects --largest 1 --force --json --quiet";
    let warnings = &json(&run(dir, export))["warnings"];
    assert!(
        warnings[0]
            .as_str()
            .unwrap()
            .contains("--roi-fill air makes that"),
        "{warnings}"
    );
    let text = run(dir, "cells out --summary");
    assert!(
        text.contains("the grid or the edge of the region cuts them"),
        "{text}"
    );

    // two regions of one scan are not compared without a word
    run(
        dir,
        "convert a.raw --dims 60,60,16 --dtype u8 all --threshold 100 --quiet",
    );
    for (other, differs) in [("out", false), ("air", true), ("all", true)] {
        let compared = json(&run(dir, &format!("compare out {other} --json --quiet")));
        let warnings = compared["warnings"].as_array().unwrap().iter();
        let told = warnings.filter(|w| w.as_str().unwrap().contains("regions of interest differ"));
        assert_eq!(told.count(), usize::from(differs), "{other}");
    }
}

#[test]
fn what_a_mask_does_not_tell_is_said() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    run(
        dir,
        &format!("convert {INPUT} out --threshold 110 --roi mask:m.raw --quiet"),
    );
    let said = run(dir, "verify out");
    let told = "not proved without --against: which voxels the mask m.raw holds";
    assert!(said.starts_with("ok") && said.contains(told), "{said}");
    let report = json(&run(dir, "verify out --json"));
    assert_eq!(report["unproved"].as_array().unwrap().len(), 1);
    let against = json(&run(
        dir,
        &format!("verify out --json --against {INPUT} --roi mask:m.raw"),
    ));
    assert_eq!(against.get("unproved"), None);
    // raw masks are of bytes, and none is packed as a whole
    std::fs::write(dir.join("wide.raw"), vec![1; 2 * 40 * 40 * 12]).unwrap();
    std::fs::write(dir.join("m.nrrd.gz"), [0x1f, 0x8b, 8, 0, 0]).unwrap();
    let convert = format!("convert {INPUT} no --threshold 110");
    for (mask, parts) in [
        ("wide.raw", ["2 bytes for each voxel", "a header, as .mhd"]),
        ("m.nrrd.gz", ["m.nrrd.gz, packed by gzip", "gunzip"]),
    ] {
        let message = fails(dir, &words(&format!("{convert} --roi mask:{mask}")));
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    // a share that is not 0 does not read so
    let one = vec![1u8]
        .into_iter()
        .chain(vec![0; 40 * 40 * 12 - 1])
        .collect::<Vec<u8>>();
    std::fs::write(dir.join("one.raw"), one).unwrap();
    let text = run(
        dir,
        &format!("info {INPUT} --roi mask:one.raw --threshold 20"),
    );
    assert!(text.contains("0.0052 % of the voxels"), "{text}");
}

#[test]
fn what_a_region_hides_is_said() {
    let dir = temp();
    let dir = dir.path();
    scan(dir);
    // one that leaves nothing out
    let info = json(&run(
        dir,
        &format!("info {INPUT} --roi cylinder:20,20,900 --json"),
    ));
    let told = |warnings: &Value, part: &str| {
        let mut warnings = warnings.as_array().unwrap().iter();
        warnings.any(|w| w.as_str().unwrap().contains(part))
    };
    assert!(told(&info["warnings"], "leaves nothing out"), "{info}");

    // the threshold that a method found
    let line = format!("convert {INPUT} out --threshold otsu --roi mask:m.raw --json --quiet");
    let made = json(&run(dir, &line));
    let index = json(&std::fs::read_to_string(dir.join("out/index.json")).unwrap());
    assert_eq!(made["threshold"], index["threshold"]);
    assert!(made["threshold"].is_number(), "{made}");

    // panels say what found their threshold; one without a contour is told
    let line =
        format!("preview {INPUT} a.png --threshold otsu,300 --roi mask:m.raw --json --quiet");
    let drawn = json(&run(dir, &line));
    assert!(
        told(&drawn["warnings"], "threshold 300 is above all samples"),
        "{drawn}"
    );

    // a fill that is no sample, which nobody typed
    let path = dir.join("out/index.json");
    let mut index = index;
    index["region"]["fill_value"] = value!(37_873_078);
    std::fs::write(&path, index.to_string()).unwrap();
    let message = fails(
        dir,
        &words(&format!("verify out --against {INPUT} --roi mask:m.raw")),
    );
    assert!(
        message.contains("index.json") && message.contains("region.fill_value of 37873078"),
        "{message}"
    );
}
