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
            vec!["--roi-fill", "without --roi"],
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
    std::fs::write(dir.join("m.mhd"), mask("0.2 0.2 0.2")).unwrap();
    run(dir, &format!("{placed} --quiet"));
    let inner = convert.replace(" out ", " out/inner ");
    let message = fails(dir, &words(&inner));
    assert!(
        message.contains("out/inner, which lies in the tile set"),
        "{message}"
    );
}
