//! `alvis preview`: the picture against the samples, and the cells against a labelling of its own.

mod command;

use command::{fails, foam_tiles, json, ok};
use image::RgbImage;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const DIMS: [usize; 3] = [40, 36, 32];

fn samples(dir: &Path) -> Vec<u8> {
    let bytes = std::fs::read(dir.join("foam.raw")).unwrap();
    assert_eq!(bytes.len(), DIMS.iter().product::<usize>());
    bytes
}

fn picture(dir: &Path, args: &[&str]) -> RgbImage {
    let args = [
        &[
            "preview", "foam.mhd", "out.png", "--quiet", "--force", "--plain",
        ],
        args,
    ]
    .concat();
    assert_eq!(ok(dir, &args), "");
    image::open(dir.join("out.png")).unwrap().to_rgb8()
}

/// The linear index of a slice's voxel, by the orientation that the help states.
fn index(axis: usize, at: usize, x: usize, y: usize) -> usize {
    let [i, j, k] = [[at, x, y], [x, at, y], [x, y, at]][axis];
    i + DIMS[0] * (j + DIMS[1] * k)
}

#[test]
fn grey_values_are_the_samples() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let samples = samples(dir);
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let args = [
            "--axis", name, "--at", "5", "--scale", "2", "--window", "0:255",
        ];
        let picture = picture(dir, &args);
        let size = [[36, 32], [40, 32], [40, 36]][axis];
        assert_eq!(picture.dimensions(), (2 * size[0], 2 * size[1]));
        for (x, y, pixel) in picture.enumerate_pixels() {
            let v = samples[index(axis, 5, x as usize / 2, y as usize / 2)];
            assert_eq!(pixel.0, [v; 3]);
        }
    }
    let report = json(&ok(
        dir,
        &[
            "preview",
            "foam.mhd",
            "a.png",
            "--json",
            "--threshold",
            "otsu",
        ],
    ));
    assert_eq!((&report["axis"], &report["at"]), (&"z".into(), &16.into()));
    assert_eq!(report["slice_size"], serde_json::json!([1000, 900]));
    let drawn = image::open(dir.join("a.png")).unwrap().to_rgb8();
    assert!(drawn.pixels().any(|p| p.0 == [255, 64, 32]));
}

/// Several thresholds are drawn side by side, each as it is drawn alone.
#[test]
fn contours_stand_side_by_side() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let draw = |threshold: &str, more: &[&str]| {
        let args = [
            "preview",
            "foam.mhd",
            "b.png",
            "--json",
            "--force",
            "--scale",
            "8",
            "--threshold",
            threshold,
        ];
        let report = json(&ok(dir, &[&args[..], more].concat()));
        (report, image::open(dir.join("b.png")).unwrap().to_rgb8())
    };
    let (report, many) = draw("60,otsu,peaks", &[]);
    let panels = report["panels"].as_array().unwrap();
    assert_eq!(
        (panels.len(), &panels[0]["corner"]),
        (3, &report["slice_corner"])
    );
    assert_eq!(report["threshold"], 60.0);
    let size: [u32; 2] = serde_json::from_value(report["slice_size"].clone()).unwrap();
    let mut shares = Vec::new();
    for panel in panels {
        let (alone, one) = draw(&panel["threshold"].to_string(), &[]);
        assert!(alone.get("panels").is_none());
        let corner =
            |v: &serde_json::Value| -> [u32; 2] { serde_json::from_value(v.clone()).unwrap() };
        let (a, b) = (corner(&panel["corner"]), corner(&alone["slice_corner"]));
        for y in 0..size[1] {
            for x in 0..size[0] {
                assert_eq!(
                    many.get_pixel(a[0] + x, a[1] + y),
                    one.get_pixel(b[0] + x, b[1] + y)
                );
            }
        }
        shares.push(panel["share_above"].as_f64().unwrap());
    }
    assert!(
        shares[0] > shares[1] && shares.iter().all(|s| (0.01..0.99).contains(s)),
        "{shares:?}"
    );
    let (report, plain) = draw("60,90", &["--plain"]);
    assert_eq!(report["panels"][0]["corner"], serde_json::json!([0, 0]));
    assert_eq!(plain.dimensions().1, size[1]);
    assert!(plain.dimensions().0 > 2 * size[0]);
}

/// Labels the below voxels of the volume, 18-connected or 6-connected, ids by the first voxel.
fn labels(samples: &[u8], threshold: f64, diagonal: bool) -> Vec<u64> {
    labels_of(samples, |v| v < threshold, diagonal)
}

/// The same of the voxels of one phase.
fn labels_of(samples: &[u8], phase: impl Fn(f64) -> bool, diagonal: bool) -> Vec<u64> {
    let below = |i: usize| phase(f64::from(samples[i]));
    let mut label = vec![0; samples.len()];
    let mut next = 0;
    for start in 0..samples.len() {
        if !below(start) || label[start] != 0 {
            continue;
        }
        next += 1;
        label[start] = next;
        let mut open = vec![start];
        while let Some(i) = open.pop() {
            let p = [i % DIMS[0], i / DIMS[0] % DIMS[1], i / DIMS[0] / DIMS[1]];
            for n in 0..27 {
                let d = [n % 3, n / 3 % 3, n / 9].map(|v| v as i64 - 1);
                let steps: i64 = d.iter().map(|v| v.abs()).sum();
                let q: Vec<i64> = (0..3).map(|a| p[a] as i64 + d[a]).collect();
                let inside = (0..3).all(|a| q[a] >= 0 && q[a] < DIMS[a] as i64);
                if !inside || steps == 0 || steps > if diagonal { 2 } else { 1 } {
                    continue;
                }
                let j = q[0] as usize + DIMS[0] * (q[1] as usize + DIMS[1] * q[2] as usize);
                if below(j) && label[j] == 0 {
                    label[j] = next;
                    open.push(j);
                }
            }
        }
    }
    label
}

#[test]
fn cells_have_the_colours_of_their_labels() {
    for rule in ["separate", "join"] {
        let dir = foam_tiles(&["--ambiguous", rule]);
        let dir = dir.path();
        let samples = samples(dir);
        let manifest = std::fs::read_to_string(dir.join("tiles/index.json")).unwrap();
        let threshold = json(&manifest)["threshold"].as_f64().unwrap();
        let label = labels(&samples, threshold, rule == "separate");
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            for at in [0, 15, 16, DIMS[axis] - 1] {
                let at_text = at.to_string();
                let args = [
                    "--axis",
                    name,
                    "--at",
                    &at_text,
                    "--scale",
                    "1",
                    "--tiles",
                    "tiles",
                    "--threshold",
                    "1000",
                    "--window",
                    "500:501",
                ];
                let picture = picture(dir, &args);
                let mut colour = BTreeMap::new();
                for (x, y, pixel) in picture.enumerate_pixels() {
                    let cell = label[index(axis, at, x as usize, y as usize)];
                    // every sample is black in this window, so only cells have a colour
                    assert_eq!(cell == 0, pixel.0 == [0; 3], "{name} {at} {x} {y}");
                    assert_eq!(colour.entry(cell).or_insert(*pixel), pixel, "cell {cell}");
                }
                let distinct: BTreeSet<[u8; 3]> = colour.values().map(|p| p.0).collect();
                assert_eq!(distinct.len(), colour.len());
            }
        }
        let args = [
            "preview",
            "foam.mhd",
            "b.png",
            "--tiles",
            "tiles",
            "--colour-by",
            "volume",
            "--json",
            "--force",
        ];
        let report = json(&ok(dir, &args));
        assert_eq!(report["threshold"], threshold);
        let seen: BTreeSet<u64> = (0..DIMS[0] * DIMS[1])
            .map(|i| label[i + 16 * DIMS[0] * DIMS[1]])
            .filter(|&l| l != 0)
            .collect();
        let cells = report["cells"].as_u64().unwrap();
        let cut = report["cells_without_value"].as_u64().unwrap();
        assert_eq!((cells + cut) as usize, seen.len());
        assert!(cells > 0 && cut > 0, "{cells} {cut}");
    }
}

/// A directory with noise in place of the foam, whose objects are many, and its tile set.
fn noise_tiles(rule: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let phantom = "phantom noise foam.mhd --dims 40,36,32 --density 0.12 --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert foam.mhd tiles --threshold 128 --macrocube 16 --quiet --ambiguous";
    ok(
        dir.path(),
        &convert.split(' ').chain([rule]).collect::<Vec<_>>(),
    );
    dir
}

#[test]
fn objects_have_the_colours_of_their_labels() {
    for rule in ["separate", "join"] {
        let dir = noise_tiles(rule);
        let dir = dir.path();
        let samples = samples(dir);
        let label = labels_of(&samples, |v| v >= 128.0, rule == "join");
        let black = "--scale 1 --tiles tiles --objects --threshold 1000 --window 500:501";
        for (axis, at) in [(2, 0), (2, 15), (1, 16), (0, 39)] {
            let at_text = at.to_string();
            let place = ["--axis", ["x", "y", "z"][axis], "--at", &at_text];
            let picture = |more: &[&str]| {
                let args: Vec<&str> = black.split(' ').chain(place).collect();
                picture(dir, &[&args[..], more].concat())
            };
            let all = picture(&[]);
            let chosen = picture(&["--where", "id <= 40"]);
            let mut colour = BTreeMap::new();
            for (x, y, pixel) in all.enumerate_pixels() {
                let object = label[index(axis, at, x as usize, y as usize)];
                assert_eq!(object == 0, pixel.0 == [0; 3], "{axis} {at} {x} {y}");
                assert_eq!(colour.entry(object).or_insert(*pixel), pixel, "{object}");
                let expected = if object <= 40 { pixel.0 } else { [0; 3] };
                assert_eq!(chosen.get_pixel(x, y).0, expected, "{object}");
            }
            let distinct: BTreeSet<[u8; 3]> = colour.values().map(|p| p.0).collect();
            assert!(distinct.len() > colour.len() / 2 && colour.len() > 20);
        }
    }
}

/// Outlines lie where the surface crosses between voxels, those that are chosen and no others.
#[test]
fn surfaces_are_outlined() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let samples = samples(dir);
    let manifest = std::fs::read_to_string(dir.join("tiles/index.json")).unwrap();
    let threshold = json(&manifest)["threshold"].as_f64().unwrap();
    let label = labels(&samples, threshold, true);
    let draw = |scale: &str, more: &[&str]| {
        let args = ["--tiles", "tiles", "--surfaces", "--scale", scale];
        picture(dir, &[&args[..], more].concat())
    };
    let none = draw("8", &["--where", "false"]);
    assert!(none.pixels().all(|p| p.0 == [p.0[0]; 3]));
    let all = draw("8", &[]);
    let cell = label.iter().copied().max().unwrap() / 2;
    let one = draw("8", &["--where", &format!("cell == {cell}")]);
    let grey = |picture: &RgbImage, [x, y]: [f64; 2]| {
        let at = [x, y].map(|v| ((v + 0.5) * 8.0) as u32);
        picture.get_pixel(at[0], at[1]) == none.get_pixel(at[0], at[1])
    };
    let mut found = [0; 2];
    let slice = 16;
    for y in 0..DIMS[1] {
        for x in 0..DIMS[0] - 1 {
            let at = [x, x + 1].map(|x| index(2, slice, x, y));
            let [a, b] = at.map(|i| f64::from(samples[i]));
            if (a < threshold) == (b < threshold) {
                continue;
            }
            let crossing = [x as f64 + (threshold - a) / (b - a), y as f64];
            assert!(!grey(&all, crossing), "{crossing:?}");
            let beside = label[at[0]].max(label[at[1]]);
            if beside == cell {
                assert!(!grey(&one, crossing), "{crossing:?}");
                found[0] += 1;
                continue;
            }
            let around = |d: usize| -> bool {
                let column = |v: usize, n: usize| v.saturating_sub(d)..(v + d + 1).min(n);
                let mut near = column(x, DIMS[0])
                    .flat_map(|u| column(y, DIMS[1]).map(move |v| index(2, slice, u, v)));
                near.any(|i| label[i] == cell)
            };
            if !around(3) {
                assert!(grey(&one, crossing), "{crossing:?}");
                found[1] += 1;
            }
        }
    }
    // the cell is one that the slice cuts
    assert!(found[1] > 20, "{found:?}");
    let report = reported(dir, &["--surfaces", "--scale", "1"]);
    assert_eq!(report["threshold"], threshold);
    assert!(report["surfaces"].as_u64().unwrap() > 3 && report["cells"].is_null());
    let report = reported(
        dir,
        &["--surfaces", "--colour-by", "area", "--largest", "2"],
    );
    let both = ["surfaces", "surfaces_without_value"].map(|k| report[k].as_u64().unwrap());
    assert!(both[0] + both[1] <= 2);
}

/// Labels that cut straight through hollows are shown as they are, which tiles cannot tell.
#[test]
fn labels_tell_the_cell_of_each_voxel() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let samples = samples(dir);
    // none in some, so that there is a cell without
    let label = |[x, y, z]: [usize; 3]| ((x / 7 + y / 5 + z / 6) % 4) as u8;
    let place = |i: usize| [i % 40, i / 40 % 36, i / 40 / 36];
    let labels: Vec<u8> = (0..samples.len()).map(|i| label(place(i))).collect();
    std::fs::write(dir.join("labels.raw"), &labels).unwrap();
    let convert =
        "convert foam.mhd labelled --threshold 128 --labels labels.raw --crop 4:38,3:,5:30 --quiet";
    ok(dir, &convert.split(' ').collect::<Vec<_>>());
    let black = "--scale 1 --threshold 1000 --window 500:501 --tiles labelled --labels labels.raw";
    let mut colour = BTreeMap::new();
    for (axis, at) in [(2, 11), (1, 0), (0, 33)] {
        let at_text = at.to_string();
        let mut args: Vec<&str> = black.split(' ').collect();
        args.extend(["--axis", ["x", "y", "z"][axis], "--at", &at_text]);
        for (x, y, pixel) in picture(dir, &args).enumerate_pixels() {
            let start = [4, 3, 5];
            let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
            let (x, y) = (x as usize + start[u], y as usize + start[v]);
            let i = index(axis, at + start[axis], x, y);
            assert_eq!(samples[i] >= 128, pixel.0 == [0; 3], "{axis} {at} {x} {y}");
            if samples[i] < 128 {
                assert_eq!(colour.entry(labels[i]).or_insert(*pixel), pixel);
            }
        }
    }
    let distinct: BTreeSet<[u8; 3]> = colour.values().map(|p| p.0).collect();
    assert_eq!((colour.len(), distinct.len()), (4, 4));
    let start = [
        "preview",
        "foam.mhd",
        "a.png",
        "--labels",
        "labels.raw",
        "--tiles",
    ];
    let message = fails(dir, &[&start[..], &["tiles"]].concat());
    assert!(message.contains("alvis convert --labels"), "{message}");
    let message = fails(dir, &[&start[..], &["labelled", "--objects"]].concat());
    assert!(message.contains("it for cells"), "{message}");
}

#[test]
fn a_crop_is_followed() {
    let dir = foam_tiles(&["--crop", "4:30,2:,8:"]);
    let picture = picture(dir.path(), &["--tiles", "tiles", "--scale", "1"]);
    assert_eq!(picture.dimensions(), (26, 34));
}

/// What `preview --json` says of the foam's middle slice.
fn reported(dir: &Path, args: &[&str]) -> serde_json::Value {
    let start = [
        "preview", "foam.mhd", "out.png", "--tiles", "tiles", "--json", "--force",
    ];
    json(&ok(dir, &[&start, args].concat()))
}

#[test]
fn cells_that_match_are_coloured_and_the_slice_is_the_plain_one() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let all = reported(dir, &[])["cells"].as_u64().unwrap();
    let inner = reported(dir, &["--where", "not touches_border"])["cells"].as_u64();
    assert!((1..all).contains(&inner.unwrap()), "{inner:?} of {all}");
    let none = reported(dir, &["--where", "false"]);
    assert_eq!(none["cells"], 0);
    assert!(none["warnings"][0].as_str().unwrap().contains("no cell"));
    let args = ["--colour-by", "id", "--range", "0:1000", "--scale", "3"];
    let report = reported(dir, &args);
    assert_eq!(report["range"], serde_json::json!([0.0, 1000.0]));
    // an id means something for cut cells too
    assert_eq!(
        (&report["cells"], &report["cells_without_value"]),
        (&all.into(), &0.into())
    );
    let whole = image::open(dir.join("out.png")).unwrap().to_rgb8();
    let plain = picture(dir, &[&["--tiles", "tiles"], &args[..]].concat());
    let at = |name: &str, i: usize| report[name][i].as_u64().unwrap() as u32;
    assert_eq!(
        plain.dimensions(),
        (at("slice_size", 0), at("slice_size", 1))
    );
    let corner = [at("slice_corner", 0), at("slice_corner", 1)];
    for (x, y, pixel) in plain.enumerate_pixels() {
        assert_eq!(pixel, whole.get_pixel(corner[0] + x, corner[1] + y));
    }
}

#[test]
fn painted_tiles_keep_their_colours() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    ok(
        dir,
        &[
            "select",
            "tiles",
            "painted",
            "--paint",
            "true=#12ab34",
            "--quiet",
        ],
    );
    let drawn = picture(dir, &["--tiles", "painted"]);
    assert!(drawn.pixels().any(|p| p.0 == [0x12, 0xab, 0x34]));
    // colours of objects are shown as such, unless cells are asked for
    let select = "select tiles red --objects --paint id==1=#ff0001 --quiet";
    ok(dir, &select.split(' ').collect::<Vec<_>>());
    let red = |more: &[&str]| {
        let drawn = picture(dir, &[&["--tiles", "red"], more].concat());
        drawn.pixels().any(|p| p.0 == [0xff, 0, 1])
    };
    assert!(red(&[]) && red(&["--objects"]) && !red(&["--colour-by", "id"]));
}

#[test]
fn voxels_have_their_true_proportion() {
    let dir = foam_tiles(&[]);
    let args = ["--spacing", "0.1,0.1,0.25", "--axis", "x", "--scale", "2"];
    let drawn = picture(dir.path(), &args);
    assert_eq!(drawn.dimensions(), (72, 160));
}

#[test]
fn a_file_that_is_there_is_replaced_only_on_request() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    std::fs::write(dir.join("a.png"), "mine").unwrap();
    let args = ["preview", "foam.mhd", "a.png", "--quiet"];
    let message = fails(dir, &args);
    assert!(
        message.contains("a.png") && message.contains("--force"),
        "{message}"
    );
    assert_eq!(std::fs::read(dir.join("a.png")).unwrap(), b"mine");
    ok(dir, &[&args[..], &["--force"]].concat());
    assert!(image::open(dir.join("a.png")).is_ok());
}

#[test]
fn refusals_leave_no_picture() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    ok(
        dir,
        &[
            "phantom",
            "sphere",
            "other.mhd",
            "--dims",
            "8,8,8",
            "--quiet",
        ],
    );
    for (args, part) in [
        (
            &["preview", "foam.mhd", "a.png", "--at", "32"][..],
            "0 to 31",
        ),
        (&["preview", "foam.mhd", "a.jpg"], ".png"),
        (&["preview", "foam.mhd", "no/a.png"], "no/a.png"),
        (
            &["preview", "other.mhd", "a.png", "--tiles", "tiles"],
            "40 x 36 x 32",
        ),
        (
            &["preview", "foam.mhd", "a.png", "--tiles", "nothing"],
            "nothing",
        ),
        (
            &[
                "preview",
                "foam.mhd",
                "a.png",
                "--tiles",
                "tiles",
                "--colour-by",
                "volme",
            ],
            "column 1",
        ),
        (&["preview", "foam.mhd", "a.png", "--scale", "0"], "--scale"),
        (
            &["preview", "foam.mhd", "a.png", "--colour-by", "volume"],
            "--tiles",
        ),
        (&["preview", "foam.mhd", "a.png", "--objects"], "--tiles"),
        (
            &["preview", "foam.mhd", "a.png", "--where", "true"],
            "--tiles",
        ),
    ] {
        let message = fails(dir, args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
    let left: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|n| n.contains("png"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}
