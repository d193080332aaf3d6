//! `alvis cells` as its users see it: rows chosen, ordered and summed up, and refusals.

mod command;
#[path = "common/seal.rs"]
mod seal;

use command::{alvis, fails, foam_tiles, json, ok};
use serde_json::Value;
use std::path::Path;

/// The table as this test reads it: the header's names, and the rows' fields.
fn csv(dir: &Path, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let text = std::fs::read_to_string(dir.join("tiles").join(name)).unwrap();
    let mut lines = text
        .lines()
        .map(|l| l.split(',').map(String::from).collect());
    let header: Vec<String> = lines.next().unwrap();
    let names = header
        .iter()
        .map(|h| h.split(" [").next().unwrap().to_string());
    (names.collect(), lines.collect())
}

fn ids(value: &Value, key: &str) -> Vec<u64> {
    let rows = value[key].as_array().unwrap();
    rows.iter().map(|r| r["id"].as_u64().unwrap()).collect()
}

#[test]
fn air_around_a_sample_is_left_out_of_summaries_alone() {
    let dir = foam_tiles(&[]);
    for more in [&[][..], &["--columns", "id"]] {
        let args = [&["cells", "tiles", "--outside", "border-cell"], more].concat();
        let message = fails(dir.path(), &args);
        assert!(message.contains("--summary"), "{message}");
    }
}

#[test]
fn json_holds_the_tables_of_the_set() {
    let dir = foam_tiles(&[]);
    for (option, key) in [
        (None, "cells"),
        (Some("--objects"), "objects"),
        (Some("--surfaces"), "surfaces"),
    ] {
        let mut args = vec!["cells", "tiles", "--json"];
        args.extend(option);
        let value = json(&ok(dir.path(), &args));
        let (names, rows) = csv(dir.path(), &format!("{key}.csv"));
        let columns = value["columns"].as_array().unwrap();
        let found: Vec<&str> = columns
            .iter()
            .map(|c| c["name"].as_str().unwrap())
            .collect();
        assert_eq!(found, names);
        let area = columns.iter().find(|c| c["name"] == "area").unwrap();
        assert_eq!(area["unit"], "mm^2");
        assert_eq!(columns[0]["unit"], "");
        let objects = value[key].as_array().unwrap();
        assert_eq!(objects.len(), rows.len());
        for (object, row) in objects.iter().zip(&rows) {
            for (name, text) in names.iter().zip(row) {
                match (&object[name], name.as_str()) {
                    (Value::Null, _) => assert_eq!(text, ""),
                    (Value::Bool(b), "touches_border") => assert_eq!(*b, text == "1"),
                    (Value::Number(n), n2) if n2 != "touches_border" => {
                        assert_eq!(n.as_f64().unwrap(), text.parse::<f64>().unwrap());
                    }
                    (other, name) => panic!("{name} is {other}"),
                }
            }
        }
    }
}

#[test]
fn csv_is_the_file_itself() {
    let dir = foam_tiles(&[]);
    for (option, name) in [("--objects", "objects.csv"), ("--surfaces", "surfaces.csv")] {
        let text = ok(dir.path(), &["cells", "tiles", option, "--format", "csv"]);
        let file = std::fs::read_to_string(dir.path().join("tiles").join(name)).unwrap();
        assert_eq!(text, file);
    }
    let part = ok(
        dir.path(),
        &[
            "cells",
            "tiles",
            "--format",
            "csv",
            "--columns",
            "volume,id",
            "--top",
            "1",
        ],
    );
    assert!(
        part.starts_with("volume [mm^3],id\n") && part.ends_with(",1\n"),
        "{part}"
    );
}

#[test]
fn rows_are_filtered_and_sorted() {
    let dir = foam_tiles(&[]);
    let (names, rows) = csv(dir.path(), "cells.csv");
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let number = |row: &Vec<String>, name: &str| row[at(name)].parse::<f64>().ok();
    let expected = |keep: &dyn Fn(&Vec<String>) -> bool, key: &str| -> Vec<u64> {
        let mut kept: Vec<&Vec<String>> = rows.iter().filter(|r| keep(r)).collect();
        kept.sort_by(|a, b| number(b, key).partial_cmp(&number(a, key)).unwrap());
        kept.iter().map(|r| r[0].parse().unwrap()).collect()
    };
    let inner = expected(&|r| r[at("touches_border")] == "0", "sphericity");
    assert!(inner.len() > 3 && inner.len() < rows.len(), "{inner:?}");
    for args in [
        &["--where", "not touches_border", "--sort", "-sphericity"][..],
        &[
            "--where",
            "touches_border == false",
            "--sort",
            "sphericity",
            "--descending",
        ],
        &[
            "--where",
            "!missing(sphericity)",
            "--sort",
            "-1 * sphericity",
        ],
    ] {
        let all = [&["cells", "tiles", "--json"], args].concat();
        assert_eq!(
            ids(&json(&ok(dir.path(), &all)), "cells"),
            inner,
            "{args:?}"
        );
        let top = [&all[..], &["--top", "3"]].concat();
        assert_eq!(
            ids(&json(&ok(dir.path(), &top)), "cells"),
            inner[..3],
            "{args:?}"
        );
    }
    let big = expected(&|r| number(r, "area").unwrap() > 0.3, "volume");
    let args = [
        "cells",
        "tiles",
        "--json",
        "--where",
        "area > 3 / 10",
        "--sort",
        "-volume",
    ];
    assert_eq!(ids(&json(&ok(dir.path(), &args)), "cells"), big);
    let none = ["cells", "tiles", "--json", "--where", "volume < 0"];
    assert_eq!(ids(&json(&ok(dir.path(), &none)), "cells"), [0u64; 0]);
}

/// The largest are the first of a sort, after the condition; they come in that order, or in the one asked for.
#[test]
fn the_largest_are_those_of_a_sort() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let noise = "phantom noise noise.mhd --dims 20,18,16 --density 0.2 --quiet";
    ok(dir, &noise.split(' ').collect::<Vec<_>>());
    let convert = "convert noise.mhd tiles --threshold 128 --force --quiet";
    ok(dir, &convert.split(' ').collect::<Vec<_>>());
    for (table, key) in [
        ("cells", "volume"),
        ("objects", "volume"),
        ("surfaces", "area"),
    ] {
        let table_option = format!("--{table}");
        let base: Vec<&str> = match table {
            "cells" => vec!["cells", "tiles", "--json"],
            _ => vec!["cells", "tiles", "--json", &table_option],
        };
        let run = |more: &[&str]| ids(&json(&ok(dir, &[&base[..], more].concat())), table);
        let falling = format!("-{key}");
        for condition in ["true", "tiles < 3", "id > 2"] {
            let sorted = run(&["--where", condition, "--sort", &falling]);
            for n in [1, 3, 1000] {
                let text = n.to_string();
                let args = ["--where", condition, "--largest", &text];
                let first = &sorted[..n.min(sorted.len())];
                assert_eq!(run(&args), first, "{table} {condition} {n}");
                let mut by_id = first.to_vec();
                by_id.sort_unstable();
                assert_eq!(run(&[&args[..], &["--sort", "id"]].concat()), by_id);
                let top = run(&[&args[..], &["--sort", "id", "--top", "2"]].concat());
                assert_eq!(top, by_id[..2.min(by_id.len())]);
            }
        }
    }
    let value = json(&ok(
        dir,
        &["cells", "tiles", "--objects", "--largest", "3", "--json"],
    ));
    let rows = value["objects"].as_array().unwrap();
    let voxels: f64 = rows.iter().map(|r| r["voxels"].as_f64().unwrap()).sum();
    let args = [
        "cells",
        "tiles",
        "--objects",
        "--largest",
        "3",
        "--summary",
        "--json",
    ];
    let summary = json(&ok(dir, &args));
    assert_eq!(summary["objects"], 3);
    let share = voxels / (20.0 * 18.0 * 16.0);
    assert!((summary["volume_fraction"].as_f64().unwrap() - share).abs() < 1e-12);
}

#[test]
fn a_table_for_people_is_short() {
    let dir = foam_tiles(&[]);
    let text = ok(dir.path(), &["cells", "tiles", "--top", "5"]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 3 + 5 + 1, "{text}");
    assert!(
        lines[0].contains("sphericity") && lines[2].contains("[mm^3]"),
        "{text}"
    );
    assert!(
        lines[0].contains("equivalent_") && lines[1].contains("diameter"),
        "{text}"
    );
    assert!(lines[3].contains("yes") && lines[3].contains('-'), "{text}");
    assert!(lines[8].starts_with("..."), "{text}");
    assert!(
        lines[3..8].iter().all(|l| l.len() == lines[0].len()),
        "{text}"
    );
    assert!(lines.iter().all(|l| l.len() <= 80), "{text}");
    // four digits in the column of areas, all of them in the file
    let area: Vec<&str> = lines[3..8]
        .iter()
        .map(|l| l.split_whitespace().nth(2).unwrap())
        .collect();
    assert!(
        area.iter().all(|a| a.trim_start_matches("0.").len() <= 5),
        "{area:?}"
    );
    let (names, rows) = csv(dir.path(), "cells.csv");
    let at = names.iter().position(|n| n == "area").unwrap();
    assert!(rows.iter().any(|r| r[at].len() > 8));
    let summary = ok(dir.path(), &["cells", "tiles", "--summary"]);
    assert!(
        summary.lines().all(|l| l.chars().count() <= 80),
        "{summary}"
    );
    let surfaces = ok(dir.path(), &["cells", "tiles", "--surfaces"]);
    assert!(
        surfaces.contains("triangles") && surfaces.contains("object"),
        "{surfaces}"
    );
}

/// Weights of Miles and Lantuejoul, from the boxes that the table has.
#[test]
fn a_summary_corrects_for_the_edge_of_the_grid() {
    let dir = foam_tiles(&[]);
    let (names, rows) = csv(dir.path(), "cells.csv");
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let value = |row: &Vec<String>, name: &str| -> f64 { row[at(name)].parse().unwrap() };
    let (step, dims) = (0.05, [40.0, 36.0, 32.0]);
    let (mut density, mut volume, mut whole, mut alone) = (0.0, 0.0, 0, 0.0);
    for row in rows.iter().filter(|r| r[at("touches_border")] == "0") {
        let places: f64 = ["x", "y", "z"]
            .iter()
            .zip(dims)
            .map(|(axis, n)| {
                let [low, high] = ["min", "max"].map(|end| value(row, &format!("{end}_{axis}")));
                n - ((high - low) / step).round() - 2.0
            })
            .product();
        let weight = 1.0 / (places * step * step * step);
        density += weight;
        volume += weight * value(row, "volume");
        alone += value(row, "volume");
        whole += 1;
    }
    let found = json(&ok(dir.path(), &["cells", "tiles", "--summary", "--json"]));
    let near = |v: &Value, expected: f64| {
        let ratio = v.as_f64().unwrap() / expected;
        assert!((ratio - 1.0).abs() < 1e-9, "{v} {expected}");
    };
    near(&found["number_density"], density);
    near(&found["mean_volume_corrected"], volume / density);
    let correction = &found["edge_correction"];
    assert_eq!(correction["method"], "miles-lantuejoul");
    assert_eq!(
        (&correction["applies"], &correction["rows"]),
        (&true.into(), &whole.into())
    );
    assert_eq!(correction["unit"], "mm^3");
    near(&correction["mean_volume_whole"], alone / f64::from(whole));
    // whole cells alone are too few and too small
    assert!(density > 1.2 * f64::from(whole) / (40.0 * 36.0 * 32.0 * step.powi(3)));
    assert!(volume / density > alone / f64::from(whole));
    let text = ok(dir.path(), &["cells", "tiles", "--summary"]);
    assert!(text.contains("per mm^3, edge corrected"), "{text}");
    // the metal reaches all faces, and a class without whole cells has none to count
    for (more, said) in [
        (&["--objects"][..], "reaches from one end of the grid"),
        (&["--where", "touches_border"], "no cell is whole"),
    ] {
        let args = [&["cells", "tiles", "--summary", "--json"], more].concat();
        let found = json(&ok(dir.path(), &args));
        assert_eq!(found["number_density"], Value::Null);
        assert_eq!(found["mean_volume_corrected"], Value::Null);
        let correction = &found["edge_correction"];
        assert_eq!(correction["applies"], false);
        let reason = correction["reason"].as_str().unwrap();
        assert!(reason.contains(said), "{reason}");
        let args = [&["cells", "tiles", "--summary"], more].concat();
        let text = ok(dir.path(), &args);
        assert!(text.contains("not corrected: "), "{text}");
        assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
    }
}

/// A cell that is stretched along one axis: the ellipsoid of lines has its axes, and turns with them.
#[test]
fn anisotropy_is_that_of_a_stretched_body_and_turns_with_it() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let radius = 9.0;
    for longest in 0..3usize {
        let stretch: [f64; 3] = std::array::from_fn(|a| if a == longest { 2.0 } else { 1.0 });
        let dims = stretch.map(|s| (2.0 * s * radius + 6.0) as u32);
        let mut bytes = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let at = [x, y, z];
                    let r = (0..3)
                        .map(|a| {
                            let away = f64::from(at[a]) - f64::from(dims[a] - 1) / 2.0;
                            (away / stretch[a]).powi(2)
                        })
                        .sum::<f64>()
                        .sqrt();
                    bytes.push((128.0 + 12.0 * (r - radius)).clamp(0.0, 255.0) as u8);
                }
            }
        }
        let name = format!("long-{longest}");
        std::fs::write(dir.join(format!("{name}.raw")), bytes).unwrap();
        let dims = dims.map(|n| n.to_string()).join(",");
        let input = format!("{name}.raw");
        let convert = "--dtype u8 --threshold 128 --spacing 0.5 --unit mm --macrocube 16 --quiet";
        let args = ["convert", &input, &name, "--dims", &dims];
        let args: Vec<&str> = args.into_iter().chain(convert.split(' ')).collect();
        ok(dir, &args);
        let found = json(&ok(dir, &["cells", &name, "--summary", "--json"]));
        let lines = &found["mean_intercept_length"];
        let number = |v: &Value| v.as_f64().unwrap();
        let near = |found: f64, expected: f64, within: f64| {
            assert!(
                (found / expected - 1.0).abs() < within,
                "{found} {expected}: {lines}"
            );
        };
        // along the axes of an ellipsoid lines are 4/3 of its semi-axis, in mm
        for (a, axis) in ["x", "y", "z"].into_iter().enumerate() {
            near(
                number(&lines[axis]),
                4.0 / 3.0 * radius * stretch[a] * 0.5,
                0.01,
            );
        }
        near(number(&lines["degree_of_anisotropy"]), 2.0, 0.01);
        assert!(number(&lines["directions"][0][longest]) > 0.9999);
        assert_eq!(lines["unit"], "mm");
        let fabric = &found["fabric"];
        let values: Vec<f64> = (0..3).map(|i| number(&fabric["eigenvalues"][i])).collect();
        near(values.iter().sum(), 1.0, 1e-12);
        // of a spheroid of aspect 2: the integral of n n^T over its surface
        near(
            number(&fabric["tensor"][longest][longest]),
            0.138_310,
            0.005,
        );
        near(values[0], values[1], 0.01);
        // the surface of one cell
        let cells = json(&ok(dir, &["cells", &name, "--json"]));
        near(
            number(&fabric["area"]),
            number(&cells["cells"][0]["area"]),
            1e-6,
        );
    }
    let text = ok(dir, &["cells", "long-2", "--summary"]);
    assert!(text.contains("anisotropy"), "{text}");
    assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
    // tables without their tiles still sum up
    std::fs::remove_dir_all(dir.join("long-1/tiles")).unwrap();
    let output = alvis(dir, &["cells", "long-1", "--summary", "--json"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("there is no anisotropy"), "{said}");
    let found = json(&String::from_utf8(output.stdout).unwrap());
    assert_eq!(
        (&found["cells"], &found["fabric"]),
        (&1.into(), &Value::Null)
    );
    // it is of the whole set
    let part = [
        "cells",
        "long-2",
        "--summary",
        "--json",
        "--where",
        "id > 0",
    ];
    assert_eq!(json(&ok(dir, &part))["fabric"], Value::Null);
}

#[test]
fn a_summary_agrees_with_the_table_and_the_manifest() {
    let dir = foam_tiles(&[]);
    let (names, rows) = csv(dir.path(), "cells.csv");
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let column =
        |name: &str| -> Vec<f64> { rows.iter().map(|r| r[at(name)].parse().unwrap()).collect() };
    let value = json(&ok(dir.path(), &["cells", "tiles", "--summary", "--json"]));
    let n = rows.len() as f64;
    let near = |v: &Value, expected: f64| {
        let v = v.as_f64().unwrap();
        assert!(
            (v - expected).abs() <= 1e-9 * expected.abs(),
            "{v} {expected}"
        );
    };
    assert_eq!(value["count"], rows.len());
    let voxels: f64 = column("voxels").iter().sum();
    near(&value["volume_fraction"], voxels / (40.0 * 36.0 * 32.0));
    near(&value["porosity"], voxels / (40.0 * 36.0 * 32.0));
    near(
        &value["border"]["share"],
        column("touches_border").iter().sum::<f64>() / n,
    );
    let border = column("touches_border");
    // what the grid cuts is smaller than it is: it counts, but is in no distribution
    let whole = |name: &str| -> Vec<f64> {
        let values = column(name).into_iter().zip(&border);
        values.filter(|(_, b)| **b == 0.0).map(|(v, _)| v).collect()
    };
    assert_eq!(value["cells"], rows.len());
    assert_eq!(value["cells_whole"], whole("id").len());
    assert_eq!(value["cells_border"], rows.len() - whole("id").len());
    let mut d = whole("equivalent_diameter");
    let (all, n) = (n, d.len() as f64);
    assert!(n > 3.0 && n < all);
    let mean = d.iter().sum::<f64>() / n;
    let sd = (d.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    let spread = &value["equivalent_diameter"]["number"];
    near(&spread["mean"], mean);
    near(&spread["sd"], sd);
    near(&value["equivalent_diameter"]["mean"], mean);
    near(&value["equivalent_diameter"]["sd"], sd);
    let v = whole("volume");
    let weighted = d.iter().zip(&v).map(|(d, v)| d * v).sum::<f64>() / v.iter().sum::<f64>();
    near(&value["equivalent_diameter"]["volume"]["mean"], weighted);
    d.sort_by(f64::total_cmp);
    near(&spread["min"], d[0]);
    let middle = (d[(d.len() - 1) / 2] + d[d.len() / 2]) / 2.0;
    near(&value["equivalent_diameter"]["median"], middle);
    near(&spread["median"], middle);
    let by_volume = &value["equivalent_diameter"]["by_volume_median"];
    assert_eq!(*by_volume, value["equivalent_diameter"]["volume"]["median"]);
    near(&spread["max"], d[d.len() - 1]);
    assert_eq!(value["equivalent_diameter"]["unit"], "mm");
    let text = ok(dir.path(), &["cells", "tiles", "--summary"]);
    for part in ["porosity", "median", "by volume", "█", "▲"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let none = ["cells", "tiles", "--summary", "--where", "false"];
    assert!(ok(dir.path(), &none).contains("0 of "));
    let none = json(&ok(dir.path(), &[&none[..], &["--json"]].concat()));
    assert_eq!(none["equivalent_diameter"], Value::Null);
    let objects = ["cells", "tiles", "--summary", "--objects", "--json"];
    let objects = json(&ok(dir.path(), &objects));
    let [all, whole, cut] =
        ["objects", "objects_whole", "objects_border"].map(|name| objects[name].as_u64().unwrap());
    assert_eq!(all, whole + cut);
}

#[test]
fn a_summary_of_surfaces_is_of_their_areas() {
    let dir = foam_tiles(&[]);
    let (names, rows) = csv(dir.path(), "surfaces.csv");
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let number = |row: &[String], name: &str| -> f64 { row[at(name)].parse().unwrap() };
    let words = ["cells", "tiles", "--summary", "--surfaces"];
    let near = |v: &Value, expected: f64| {
        let v = v.as_f64().unwrap();
        assert!((v - expected).abs() <= 1e-9 * expected, "{v} {expected}");
    };
    for (condition, keeps) in [("id > 0", 0.0), ("area > 0.4", 0.4)] {
        let of: Vec<&Vec<String>> = rows.iter().filter(|r| number(r, "area") > keeps).collect();
        let asked = [&words[..], &["--json", "--where", condition]].concat();
        let value = json(&ok(dir.path(), &asked));
        assert_eq!(value["of"], rows.len());
        assert_eq!(value["surfaces"], of.len());
        let sum = |name: &str| of.iter().map(|r| number(r, name)).sum::<f64>();
        assert_eq!(value["surfaces_border"], sum("touches_border") as u64);
        assert_eq!(value["triangles"], sum("triangles") as u64);
        near(&value["area"], sum("area"));
        assert_eq!(value["area_unit"], "mm^2");
        let index = std::fs::read_to_string(dir.path().join("tiles/index.json")).unwrap();
        let spacing = json(&index)["spacing"].clone();
        let voxel: f64 = (0..3).map(|a| spacing[a].as_f64().unwrap()).product();
        near(
            &value["specific_surface"],
            sum("area") / (40.0 * 36.0 * 32.0 * voxel),
        );
        let mut whole: Vec<f64> = of
            .iter()
            .filter(|r| number(r, "touches_border") == 0.0)
            .map(|r| number(r, "area"))
            .collect();
        whole.sort_by(f64::total_cmp);
        let n = whole.len();
        assert!(n > 2);
        near(
            &value["areas"]["median"],
            (whole[(n - 1) / 2] + whole[n / 2]) / 2.0,
        );
        near(&value["areas"]["max"], whole[n - 1]);
    }
    let text = ok(dir.path(), &words);
    for part in ["surfaces", "mm^2", "1/mm", "the grid", "(median)"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let none = ok(dir.path(), &[&words[..], &["--where", "false"]].concat());
    assert!(none.contains("0 of "), "{none}");
}

#[test]
fn names_are_taken_as_people_write_them() {
    let dir = foam_tiles(&[]);
    let rows = |condition: &str| {
        let args = ["cells", "tiles", "--json", "--where", condition];
        ids(&json(&ok(dir.path(), &args)), "cells")
    };
    let plain = rows("volume > 0.01 and not touches_border");
    assert!(!plain.is_empty());
    assert_eq!(rows("volume [mm^3] > 0.01 AND NOT touches_border"), plain);
    let first = |more: &[&str]| {
        let args = [&["cells", "tiles", "--format", "csv", "--top", "1"], more].concat();
        ok(dir.path(), &args)
    };
    let sorted = first(&["--sort", "-volume", "--columns", "id,volume"]);
    assert_eq!(
        first(&["--sort", "-volume [mm^3]", "--columns", "id,volume [mm^3]"]),
        sorted
    );
    for (args, part) in [
        (["--where", "volme > 1"], "did you mean `volume`?"),
        (
            ["--where", "volume [um^3] > 1"],
            "[mm^3], the unit of volume",
        ),
        (["--sort", "sphericty"], "did you mean `sphericity`?"),
        (
            ["--columns", "id,diameter"],
            "did you mean `equivalent_diameter`?",
        ),
    ] {
        let message = fails(dir.path(), &[&["cells", "tiles"][..], &args].concat());
        assert!(message.contains(part), "{message}");
    }
    let colour = ["select", "tiles", "painted", "--colour-by", "Volume"];
    let message = fails(dir.path(), &colour);
    assert!(message.contains("did you mean `volume`?"), "{message}");
}

#[test]
fn a_table_without_rows_says_of_how_many() {
    let dir = foam_tiles(&[]);
    let count = csv(dir.path(), "cells.csv").1.len();
    let none = ok(dir.path(), &["cells", "tiles", "--where", "volume < 0"]);
    assert_eq!(none, format!("0 of {count} cells\n"));
    let none = ["cells", "tiles", "--objects", "--where", "volume < 0"];
    assert_eq!(ok(dir.path(), &none), "0 of 1 object\n");
    let none = ["export", "tiles", "a.ply", "--where", "volume < 0"];
    let message = fails(dir.path(), &none);
    assert!(
        message.contains(&format!("0 of {count} cells")),
        "{message}"
    );
}

/// A body of 200 in air of 50, with three pores of 5 x 5 x 5 voxels inside and one that the grid cuts at its
/// lower face: bytes of a cube of `n` voxels. The body is where `solid` says, x and y from the middle.
fn sample_in_air(n: i32, solid: impl Fn(f64, f64) -> bool) -> Vec<u8> {
    let pores = [[-8, 0, 10], [7, 3, 20], [0, -9, 27], [0, 0, 1]];
    let value = |i: i32| {
        let [x, y, z] = [i % n, i / n % n, i / n / n];
        let middle = |c: i32| f64::from(c) - f64::from(n - 1) / 2.0;
        let in_pore = pores.iter().any(|p| {
            let away = [x - n / 2 - p[0], y - n / 2 - p[1], z - p[2]];
            away.iter().all(|d| d.abs() <= 2)
        });
        if solid(middle(x), middle(y)) && !in_pore {
            200
        } else {
            50
        }
    };
    (0..n * n * n).map(value).collect()
}

fn summary(dir: &Path, name: &str, outside: &str) -> (Value, String) {
    let args = ["cells", name, "--summary", "--json", "--outside", outside];
    let out = alvis(dir, &args);
    assert!(out.status.success());
    let text = String::from_utf8(out.stderr).unwrap();
    (serde_json::from_slice(&out.stdout).unwrap(), text)
}

/// Tells by x and y from the middle where a body is.
type Solid<'a> = &'a dyn Fn(f64, f64) -> bool;

#[test]
fn porosity_of_a_sample_in_air_leaves_the_air_out() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let n = 40;
    let convert = |bytes: Vec<u8>, name: &str, more: &[&str]| {
        std::fs::write(dir.join("s.raw"), bytes).unwrap();
        let args = ["convert", "s.raw", name, "--threshold", "125", "--quiet"];
        let raw = ["--dims", "40,40,40", "--dtype", "u8"];
        ok(dir, &[&args[..], &raw, more].concat());
    };
    // three whole pores, and one of which 4 slices of 5 are in the grid
    let pores = (3 * 125 + 100) as f64;
    let bodies: [(&str, u64, Solid); 3] = [
        ("cylinder", 1, &|x, y| x * x + y * y < 300.0),
        // as wide as the grid: air in four wedges
        ("touching", 4, &|x, y| x * x + y * y < 390.0),
        ("slab", 2, &|_, y| y.abs() < 16.0),
    ];
    for (name, cells, solid) in bodies {
        let bytes = sample_in_air(n, solid);
        let metal = bytes.iter().filter(|v| **v == 200).count() as f64;
        let all = f64::from(n * n * n);
        convert(bytes, name, &[]);
        let near = |v: &Value, expected: f64| {
            assert!(
                (v.as_f64().unwrap() - expected).abs() < 1e-12,
                "{name}: {v}"
            );
        };
        let (with, said) = summary(dir, name, "none");
        near(&with["porosity"], 1.0 - metal / all);
        assert_eq!(with["porosity_of"], "grid");
        assert_eq!(with["outside"], "none");
        assert_eq!(with["cells"], 4 + cells);
        assert_eq!(with["cells_whole"], 3);
        assert_eq!(with["cells_border"], 1 + cells);
        // one cell around the sample is told of
        assert_eq!(said.contains("--outside border-cell"), cells == 1, "{said}");
        assert_eq!(
            with["warnings"].as_array().unwrap().len(),
            usize::from(cells == 1)
        );
        let (without, said) = summary(dir, name, "border-cell");
        near(&without["porosity"], pores / (metal + pores));
        near(&without["volume_fraction"], pores / (metal + pores));
        assert_eq!(without["porosity_of"], "grid without outside");
        assert_eq!(without["outside"], "border-cell");
        assert_eq!(without["outside_cells"], cells);
        near(&without["outside_voxels"], all - metal - pores);
        // the pore that is cut stays one
        assert_eq!(without["cells"], 4);
        assert_eq!(without["cells_border"], 1);
        // a wedge at an edge of the grid may be a pore as well
        assert_eq!(
            said.contains("a pore at an edge"),
            name == "touching",
            "{said}"
        );
        assert_eq!(said.is_empty(), name != "touching", "{said}");
        // half of the cells' diameters are no smaller than those of the whole pores
        for summary in [&with, &without] {
            near(&summary["equivalent_diameter"]["sd"], 0.0);
        }
        let text = ok(
            dir,
            &["cells", name, "--summary", "--outside", "border-cell"],
        );
        assert!(
            text.contains("of the grid without what is outside"),
            "{text}"
        );
    }
    // nothing to leave out
    let whole = sample_in_air(n, |_, _| true);
    convert(whole, "whole", &[]);
    let (value, said) = summary(dir, "whole", "border-cell");
    assert_eq!(value["outside_cells"], 0);
    assert!(said.contains("four faces"), "{said}");
    ok(
        dir,
        &[
            "select",
            "cylinder",
            "part",
            "--where",
            "not touches_border",
            "--quiet",
        ],
    );
    let message = fails(
        dir,
        &["cells", "part", "--summary", "--outside", "border-cell"],
    );
    assert!(message.contains("3 of 5 cells"), "{message}");
}

/// What has no voxels has no share of them; what has no rows has no distribution.
#[test]
fn summaries_of_nothing_say_so() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let make = |name: &str, value: &dyn Fn(usize, usize, usize) -> u8| {
        let all = (0..6 * 5 * 4).map(|i| value(i % 6, i / 6 % 5, i / 30));
        std::fs::write(dir.join("s.raw"), all.collect::<Vec<u8>>()).unwrap();
        let args = ["convert", "s.raw", name, "--threshold", "125", "--quiet"];
        let raw = ["--dims", "6,5,4", "--dtype", "u8"];
        ok(dir, &[&args[..], &raw].concat());
    };
    make("air", &|_, _, _| 0);
    let (all, said) = summary(dir, "air", "none");
    assert_eq!(
        (&all["porosity"], &all["volume_fraction"]),
        (&1.0.into(), &1.0.into())
    );
    assert_eq!(
        (&all["cells"], &all["border"]["share"]),
        (&1.into(), &1.0.into())
    );
    assert!(said.contains("100.0 % of the air"), "{said}");
    assert!(all["equivalent_diameter"].is_null() && all["sphericity_median"].is_null());
    let (none, said) = summary(dir, "air", "border-cell");
    for name in ["porosity", "volume_fraction", "equivalent_diameter"] {
        assert!(none[name].is_null(), "{name}: {none}");
    }
    assert!(none["border"]["share"].is_null());
    assert_eq!(
        (&none["cells"], &none["outside_voxels"]),
        (&0.into(), &120.into())
    );
    assert!(said.contains("all voxels of the grid"), "{said}");
    let text = ok(
        dir,
        &["cells", "air", "--summary", "--outside", "border-cell"],
    );
    assert!(
        !text.contains('%') && text.contains("none: all of the grid"),
        "{text}"
    );
    make("solid", &|_, _, _| 200);
    for outside in ["none", "border-cell"] {
        let (value, said) = summary(dir, "solid", outside);
        assert_eq!(
            (&value["porosity"], &value["volume_fraction"]),
            (&0.0.into(), &0.0.into())
        );
        assert_eq!((&value["cells"], &value["of"]), (&0.into(), &0.into()));
        assert!(value["border"]["share"].is_null() && value["equivalent_diameter"].is_null());
        assert_eq!(said.contains("no cell reaches"), outside == "border-cell");
    }
    let rows = json(&ok(dir, &["cells", "solid", "--json"]));
    assert_eq!(rows["cells"].as_array().unwrap().len(), 0);
    make("one", &|x, y, z| {
        if [x, y, z] == [2, 2, 2] { 0 } else { 200 }
    });
    let (value, said) = summary(dir, "one", "none");
    assert_eq!(
        (&value["porosity"], said.as_str()),
        (&(1.0 / 120.0).into(), "")
    );
    assert_eq!(value["border"]["share"], 0.0);
    let sizes = &value["equivalent_diameter"];
    let diameter = (6.0 / std::f64::consts::PI).cbrt();
    for name in ["mean", "median", "by_volume_median"] {
        assert!(
            (sizes[name].as_f64().unwrap() - diameter).abs() < 1e-9,
            "{name}: {sizes}"
        );
    }
    assert_eq!(sizes["sd"], 0.0);
    assert_eq!(sizes["histogram"]["bins"][0], 1);
    // a pore at an edge of a thin grid reaches as many faces as air around a sample
    make("corner", &|x, y, _| if x < 2 && y < 2 { 0 } else { 200 });
    let (value, said) = summary(dir, "corner", "border-cell");
    assert_eq!(
        (&value["porosity"], &value["outside_cells"]),
        (&0.0.into(), &1.into())
    );
    assert!(said.contains("a pore at an edge"), "{said}");
    let (value, said) = summary(dir, "corner", "none");
    assert_eq!(
        (&value["porosity"], said.as_str()),
        (&(16.0 / 120.0).into(), "")
    );
}

#[test]
fn the_air_around_a_sample_is_found_however_its_axes_lie() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(
        dir.join("s.raw"),
        sample_in_air(40, |x, y| x * x + y * y < 300.0),
    )
    .unwrap();
    for axes in [
        "(0.6,0.8,0) (-0.8,0.6,0) (0,0,1)",
        "(0,0,2) (3,0,0) (0,-1,0)",
        "(0.36,0.48,-0.8) (-0.8,0.6,0) (0.48,0.64,0.6)",
    ] {
        let header = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 40 40\nspace dimension: 3\nspace directions: {axes}\n\
             space origin: (100,-7,1e3)\nencoding: raw\ndata file: s.raw\n"
        );
        std::fs::write(dir.join("s.nhdr"), header).unwrap();
        let args = [
            "convert",
            "s.nhdr",
            "set",
            "--threshold",
            "125",
            "--quiet",
            "--force",
        ];
        ok(dir, &args);
        let (value, said) = summary(dir, "set", "none");
        assert_eq!(value["cells_border"], 2);
        assert!(said.contains("all four sides"), "{axes}: {said}");
        let (value, _) = summary(dir, "set", "border-cell");
        assert_eq!(
            (&value["outside_cells"], &value["cells"]),
            (&1.into(), &4.into()),
            "{axes}"
        );
    }
}

#[test]
fn refusals_are_one_message() {
    let dir = foam_tiles(&[]);
    for (args, part) in [
        (&["cells", "nothing"][..], "nothing/index.json"),
        (&["cells", "tiles", "--where", "volme > 1"], "column 1"),
        (&["cells", "tiles", "--where", "volume >"], "column 9"),
        (&["cells", "tiles", "--where", "volume"], "a condition"),
        (&["cells", "tiles", "--sort", "volum"], "volume"),
        (&["cells", "tiles", "--columns", "id,nope"], "--columns"),
        (&["cells", "tiles", "--descending"], "--sort"),
        (&["cells", "tiles", "--objects", "--surfaces"], "--surfaces"),
        (
            &[
                "cells",
                "tiles",
                "--summary",
                "--surfaces",
                "--outside",
                "border-cell",
            ],
            "--surfaces",
        ),
        (&["cells", "tiles", "--summary", "--format", "csv"], "csv"),
        (&["cells", "tiles", "--outside", "none"], "--summary"),
        (&["cells", "tiles", "--largest", "0"], "at least 1"),
        (
            &[
                "cells",
                "tiles",
                "--summary",
                "--largest",
                "2",
                "--outside",
                "border-cell",
            ],
            "--largest",
        ),
    ] {
        let message = fails(dir.path(), args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
    let path = dir.path().join("tiles/cells.csv");
    let good = std::fs::read_to_string(&path).unwrap();
    let line = good.lines().count();
    std::fs::write(
        &path,
        good.trim_end().trim_end_matches(|c| c != ',').to_string() + "x,1\n",
    )
    .unwrap();
    let message = fails(dir.path(), &["cells", "tiles", "--json"]);
    assert!(message.contains(&format!("line {line}")), "{message}");
    std::fs::remove_file(&path).unwrap();
    assert!(fails(dir.path(), &["cells", "tiles"]).contains("cells.csv"));
    let manifest = dir.path().join("tiles/index.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("\"cells.csv\"", "\"../cells.csv\"")).unwrap();
    assert!(fails(dir.path(), &["cells", "tiles"]).contains("inside the directory"));
    assert_eq!(alvis(dir.path(), &["cells"]).status.code(), Some(2));
}

/// The same body once more, 20 % shorter along z: every cell is found again, 20 % smaller.
#[test]
fn a_compressed_body_is_compared_cell_by_cell() {
    let dir = foam_tiles(&["--table-unit", "um"]);
    let dir = dir.path();
    for (out, spacing) in [("same", "0.05"), ("short", "0.05,0.05,0.04")] {
        let args = [
            "convert",
            "foam.mhd",
            out,
            "--threshold",
            "otsu",
            "--spacing",
            spacing,
            "--unit",
            "mm",
            "--quiet",
        ];
        ok(dir, &args);
    }
    let compare = |args: &[&str]| json(&ok(dir, &[&["compare", "--json"], args].concat()));
    let (_, rows) = csv(dir, "cells.csv");
    let same = compare(&["tiles", "same"]);
    assert_eq!(same["unit"], "um");
    assert_eq!(
        (&same["matched"], &same["lost"], &same["new"]),
        (&rows.len().into(), &0.into(), &0.into())
    );
    for pair in same["pairs"].as_array().unwrap() {
        assert_eq!(pair["a"], pair["b"]);
        assert!((pair["overlap"].as_f64().unwrap() - 1.0).abs() < 1e-9);
        assert!(pair["volume"]["change"].as_f64().unwrap().abs() < 1e-9);
    }
    let short = compare(&["tiles", "short", "--align", "box"]);
    assert_eq!(short["matched"], rows.len());
    let median = short["volume_change_median"].as_f64().unwrap();
    assert!((median + 0.2).abs() < 1e-9, "{median}");
    let flatter = |p: &&Value| p["flatness"]["change"].as_f64().unwrap() < 0.0;
    let pairs = short["pairs"].as_array().unwrap();
    assert!(pairs.iter().filter(flatter).count() * 2 > pairs.len());
    assert!(
        pairs
            .iter()
            .all(|p| p["a"] == p["b"] && p["shift"][2].as_f64().unwrap() <= 0.0)
    );

    // cells that one set alone has
    ok(
        dir,
        &["select", "same", "part", "--where", "id > 3", "--quiet"],
    );
    let part = compare(&["tiles", "part"]);
    assert_eq!((&part["lost"], &part["new"]), (&3.into(), &0.into()));
    let part = compare(&["part", "tiles"]);
    assert_eq!((&part["lost"], &part["new"]), (&0.into(), &3.into()));
    let new: Vec<&Value> = part["pairs"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|p| p["a"].is_null())
        .collect();
    let new: Vec<u64> = new.iter().map(|p| p["b"].as_u64().unwrap()).collect();
    assert_eq!(new, [1, 2, 3]);
    // a pair is one if the condition holds for one of it; volumes of both are in the unit of the first
    let (names, _) = csv(dir, "cells.csv");
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let (border, volume) = (at("touches_border"), at("volume"));
    let largest = rows.iter().map(|row| row[volume].parse::<f64>().unwrap());
    let largest = largest.fold(0.0, f64::max);
    let condition = format!("voxels > 100 and volume > {}", 0.9 * largest);
    let small = compare(&["tiles", "short", "--align", "box", "--where", &condition]);
    assert_eq!((&small["lost"], &small["new"]), (&0.into(), &0.into()));
    assert!(small["cells"][0].as_u64() > small["cells"][1].as_u64());
    // the sums of all are of different cells then, those of the pairs are not
    let sum = |side: &str| -> f64 {
        let pairs = small["pairs"].as_array().unwrap().iter();
        pairs.map(|p| p["volume"][side].as_f64().unwrap()).sum()
    };
    for side in ["a", "b"] {
        let matched = small["volume_matched"][side].as_f64().unwrap();
        assert!((matched / sum(side) - 1.0).abs() < 1e-12, "{small}");
    }
    let none = compare(&["tiles", "same", "--where", "id < 0"]);
    assert_eq!(none["volume"]["a"].to_string(), "0.0");
    assert_eq!(none["warnings"].as_array().unwrap().len(), 2);
    let table = ok(dir, &["compare", "tiles", "short"]);
    assert!(table.contains("-20.0 % (median)"), "{table}");
    assert!(table.lines().all(|l| l.chars().count() <= 80), "{table}");
    let all = fails(
        dir,
        &["compare", "tiles", "short", "--format", "csv", "--top", "3"],
    );
    assert!(all.contains("--top") && all.contains("CSV"), "{all}");
    let text = ok(dir, &["compare", "tiles", "short", "--format", "csv"]);
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(
        &head[..5],
        ["a", "b", "overlap", "volume_a [um^3]", "volume_b [um^3]"]
    );
    assert!(lines.all(|l| l.split(',').count() == head.len()));
    // in one unit, whichever the tables are in: to the last digit, also in conditions
    for pair in same["pairs"].as_array().unwrap() {
        assert_eq!(
            (&pair["overlap"], &pair["volume"]["change"]),
            (&1.0.into(), &0.0.into())
        );
        assert_eq!(pair["shift"], serde_json::json!([0.0, 0.0, 0.0]));
    }
    for (sets, limit) in [
        (["tiles", "same"], "1.05e6"),
        (["same", "tiles"], "1.05e-3"),
    ] {
        let condition = format!("volume > {limit}");
        let large = compare(&[sets[0], sets[1], "--where", &condition]);
        assert_eq!(large["cells"][0], large["cells"][1], "{condition}");
        assert!(large["cells"][0].as_u64() > Some(0));
    }
    // cells at the border are told apart
    let touch = rows.iter().filter(|row| row[border] == "1").count();
    assert_eq!(same["cells_border"], serde_json::json!([touch, touch]));
    let whole: f64 = rows
        .iter()
        .filter(|row| row[border] == "0")
        .map(|row| row[volume].parse::<f64>().unwrap())
        .sum();
    let found = same["volume_whole"]["a"].as_f64().unwrap();
    assert!((found / whole - 1.0).abs() < 1e-9, "{found} {whole}");
    for (args, part) in [
        (&["compare", "tiles", "nothing"][..], "nothing/index.json"),
        (
            &["compare", "tiles", "same", "--where", "volme > 1"],
            "volme",
        ),
        (&["compare", "tiles"], "<B>"),
    ] {
        let message = fails(dir, args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
}

/// Every reader of tables takes and says the unit that tables are in; coordinates stay in that of the volume.
#[test]
fn tables_may_be_in_another_unit_than_the_volume() {
    let own = foam_tiles(&[]);
    let other = foam_tiles(&["--table-unit", "um"]);
    let dir = other.path();
    let listed = |dir: &Path, condition: &str| {
        let args = ["cells", "tiles", "--json", "--where", condition];
        let value = json(&ok(dir, &args));
        let volume = value["columns"].as_array().unwrap().iter();
        let unit = volume.clone().find(|c| c["name"] == "volume").unwrap()["unit"].clone();
        (ids(&value, "cells"), unit)
    };
    let (expected, unit) = listed(own.path(), "volume > 0.03");
    assert_eq!(unit, "mm^3");
    let (found, unit) = listed(dir, "volume > 0.03e9");
    assert_eq!(unit, "um^3");
    assert!(!found.is_empty() && found == expected);
    assert!(ok(dir, &["cells", "tiles"]).contains("[um^3]"));
    let (value, _) = summary(dir, "tiles", "none");
    assert_eq!(value["equivalent_diameter"]["unit"], "um");
    let (plain, _) = summary(own.path(), "tiles", "none");
    let mean = |v: &Value| v["equivalent_diameter"]["mean"].as_f64().unwrap();
    assert!((mean(&value) / mean(&plain) - 1e3).abs() < 1e-6);
    for args in [
        &["verify", "tiles"][..],
        &["verify", "tiles", "--against", "foam.mhd"],
        &[
            "select",
            "tiles",
            "part",
            "--where",
            "volume > 0.03e9",
            "--colour-by",
            "area",
        ],
        &["verify", "part"],
        &["repack", "tiles", "packed", "--encoding", "meshopt"],
        &["verify", "packed"],
        &["repack", "part", "merged", "--layout", "merged"],
        &["verify", "merged"],
    ] {
        ok(dir, args);
    }
    for set in ["tiles", "part", "packed", "merged"] {
        let index = std::fs::read_to_string(dir.join(set).join("index.json")).unwrap();
        let index = json(&index);
        assert_eq!(
            (&index["unit"], &index["table_unit"]),
            (&"mm".into(), &"um".into())
        );
    }
    let index = json(&std::fs::read_to_string(dir.join("part/index.json")).unwrap());
    assert_eq!(index["selection"]["colour_by"]["unit"], "um^2");
    // coordinates of one mesh are in the unit of the volume
    for dir in [own.path(), dir] {
        ok(dir, &["export", "tiles", "all.obj", "--where", "id > 3"]);
    }
    let [a, b] = [own.path(), dir].map(|dir| std::fs::read(dir.join("all.obj")).unwrap());
    assert!(a == b && a.starts_with(b"# alvis"));
    let picture = [
        "preview",
        "foam.mhd",
        "a.png",
        "--tiles",
        "tiles",
        "--colour-by",
        "volume",
    ];
    ok(dir, &picture);
    let refused = [
        "convert",
        "foam.mhd",
        "x",
        "--threshold",
        "9",
        "--table-unit",
    ];
    for unit in ["voxel", "inch"] {
        let message = fails(dir, &[&refused[..], &[unit]].concat());
        assert!(message.contains("m, cm, mm, um or nm"), "{message}");
    }
    ok(dir, &["phantom", "sphere", "bare.mhd", "--dims", "9,9,9"]);
    let args = [
        "convert",
        "bare.mhd",
        "x",
        "--threshold",
        "9",
        "--table-unit",
        "um",
    ];
    let message = fails(dir, &args);
    assert!(message.contains("--spacing and --unit"), "{message}");
    assert!(!dir.join("x").exists());
}

/// Writes over a Parquet file of the tiles, and has the index state its checksum.
fn replace_parquet(tiles: &Path, bytes: &[u8]) {
    std::fs::write(tiles.join("cells.parquet"), bytes).unwrap();
    let path = tiles.join("index.json");
    let mut index: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let crc = format!("crc32:{:08x}", crc32fast::hash(bytes));
    index["tables"]["parquet"]["checksums"]["cells"] = crc.into();
    std::fs::write(&path, serde_json::to_vec_pretty(&index).unwrap()).unwrap();
    seal::seal(tiles);
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Codes and messages of what the verifier finds in the tables as Parquet.
fn findings(dir: &Path) -> Vec<(String, String)> {
    let report: Value =
        json(&String::from_utf8(alvis(dir, &["verify", "tiles", "--json"]).stdout).unwrap());
    let issues = report["issues"].as_array().unwrap();
    let text = |issue: &Value, key: &str| issue[key].as_str().unwrap().to_string();
    let found = issues.iter().filter(|i| text(i, "path") == "cells.parquet");
    assert_eq!(found.clone().count(), issues.len(), "{issues:?}");
    found
        .map(|i| (text(i, "code"), text(i, "message")))
        .collect()
}

#[test]
fn tables_are_parquet_too_where_that_is_asked_for() {
    let plain = foam_tiles(&[]);
    let dir = foam_tiles(&["--tables", "csv,parquet"]);
    let there = |dir: &Path| dir.join("cells.parquet").exists();
    assert!(!there(&plain.path().join("tiles")) && there(&dir.path().join("tiles")));
    let same = |name: &str| {
        let [a, b] =
            [&plain, &dir].map(|d| std::fs::read(d.path().join("tiles").join(name)).unwrap());
        assert!(a == b, "{name}");
    };
    same("cells.csv");
    same("surfaces.csv");
    ok(dir.path(), &["verify", "tiles", "--quiet"]);
    // what is made of these tiles has them, too
    ok(
        dir.path(),
        &["select", "tiles", "part", "--where", "id <= 3"],
    );
    ok(
        dir.path(),
        &["repack", "tiles", "web", "--encoding", "meshopt"],
    );
    for made in ["part", "web"] {
        ok(dir.path(), &["verify", made, "--quiet"]);
        assert!(there(&dir.path().join(made)), "{made}");
    }
    let message = fails(
        dir.path(),
        &[
            "convert",
            "foam.mhd",
            "other",
            "--threshold",
            "128",
            "--tables",
            "parquet",
        ],
    );
    assert!(message.contains("csv,parquet"), "{message}");
    // without them, the same directory keeps none
    let tiles = dir.path().join("tiles");
    let (cells, part) = (
        std::fs::read(tiles.join("cells.parquet")).unwrap(),
        std::fs::read(dir.path().join("part/cells.parquet")).unwrap(),
    );
    let objects = std::fs::read(tiles.join("objects.parquet")).unwrap();
    let mut changed = cells.clone();
    changed[100] ^= 1;
    std::fs::write(tiles.join("cells.parquet"), &changed).unwrap();
    assert_eq!(findings(dir.path())[0].0, "CHECKSUM");
    for (bytes, code, message) in [
        (&part[..], "TABLE_ROWS", "3 rows"),
        (&objects, "TABLE_VALUE", "row 1"),
        (
            &cells[..cells.len() - 9],
            "TABLE_SYNTAX",
            "expected the table in Parquet",
        ),
        (b"", "TABLE_SYNTAX", "expected the table in Parquet"),
    ] {
        replace_parquet(&tiles, bytes);
        let found = findings(dir.path());
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].0 == code && found[0].1.contains(message),
            "{found:?}"
        );
    }
    // whatever single byte is wrong, the verifier ends with a finding or none
    for at in (0..cells.len()).step_by(cells.len() / 40) {
        let mut changed = cells.clone();
        changed[at] ^= 0x55;
        replace_parquet(&tiles, &changed);
        findings(dir.path());
    }
    replace_parquet(&tiles, &cells);
    ok(dir.path(), &["verify", "tiles", "--quiet"]);
    // a table in CSV that has no business there is reported once, and nothing is compared with it
    let index = std::fs::read(tiles.join("index.json")).unwrap();
    for (path, code) in [
        ("../foam.mhd", "PATH_OUTSIDE"),
        ("objects.csv", "PATH_NAME"),
    ] {
        let mut other: Value = serde_json::from_slice(&index).unwrap();
        other["tables"]["cells"] = path.into();
        std::fs::write(tiles.join("index.json"), other.to_string()).unwrap();
        seal::seal(&tiles);
        let report = json(&text(
            &alvis(dir.path(), &["verify", "tiles", "--json"]).stdout,
        ));
        let issues = report["issues"].as_array().unwrap();
        let codes: Vec<&str> = issues.iter().map(|i| i["code"].as_str().unwrap()).collect();
        assert!(codes.contains(&code), "{issues:?}");
        assert!(
            issues.iter().all(|i| i["path"] != "cells.parquet"),
            "{issues:?}"
        );
    }
    std::fs::write(tiles.join("index.json"), index).unwrap();
    std::fs::remove_file(tiles.join("cells.parquet")).unwrap();
    let report = alvis(dir.path(), &["verify", "tiles", "--json"]);
    assert!(String::from_utf8_lossy(&report.stdout).contains("MISSING_FILE"));
    ok(
        dir.path(),
        &[
            "convert",
            "foam.mhd",
            "tiles",
            "--threshold",
            "128",
            "--force",
        ],
    );
    assert!(!there(&tiles) && !tiles.join("objects.parquet").exists());
    ok(dir.path(), &["verify", "tiles", "--quiet"]);
}

/// Parquet has the type of a column by its name alone.
#[test]
fn whole_numbers_are_known_by_name() {
    use alvis::convert::{COMPONENT_COLUMNS, Column, Get, SURFACE_COLUMNS};
    fn check<T>(columns: &[Column<T>]) {
        for column in columns {
            let named = alvis::table::Column {
                name: column.name.into(),
                unit: String::new(),
            };
            let is_whole = matches!(column.get, Get::Count(_) | Get::Signed(_));
            let is_flag = named.is_condition();
            assert!(is_flag || named.is_whole() == is_whole, "{}", column.name);
            assert!(
                is_flag || !matches!(column.get, Get::Flag(_)),
                "{}",
                column.name
            );
        }
    }
    check(&COMPONENT_COLUMNS);
    check(&SURFACE_COLUMNS);
}
