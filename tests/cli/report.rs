//! `alvis report`: a page that needs nothing else, and the same numbers as JSON.

use super::{alvis, fails, json, ok, stderr, temp};
use serde_json::Value;
use std::path::Path;

/// A foam in `tiles`, and its volume.
fn foam(dir: &Path) {
    let phantom = "phantom foam foam.mhd --dims 44,40,36 --pitch 11 --spacing 0.05 --unit mm -q";
    ok(dir, &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert foam.mhd tiles --threshold otsu --macrocube 16 -q";
    ok(dir, &convert.split(' ').collect::<Vec<_>>());
}

fn page(dir: &Path, name: &str) -> String {
    std::fs::read_to_string(dir.join(name)).unwrap()
}

/// Everything that a page may not have: it would be loaded from elsewhere, or run.
fn needs_nothing(page: &str) {
    for bad in [
        "<script", "<link", "<iframe", "<object", "url(", "@import", "onerror=", "href=",
    ] {
        assert!(!page.contains(bad), "{bad}");
    }
    for (at, _) in page.match_indices("src=\"") {
        assert!(page[at + 5..].starts_with("data:image/png;base64,"));
    }
    // names of namespaces are no addresses that anything loads
    let addresses = page.matches("://").count();
    assert_eq!(
        addresses,
        page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count()
    );
}

#[test]
fn a_page_and_json_have_the_numbers_of_the_tables() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    let said = ok(dir, &["report", "tiles", "a.html"]);
    assert_eq!(said, "a.html: a page for any browser\n");
    let found = json(&ok(dir, &["report", "tiles", "--json"]));
    let summary = json(&ok(dir, &["cells", "tiles", "--summary", "--json"]));
    for (key, value) in summary.as_object().unwrap() {
        let own = match key.as_str() {
            "surface_of" | "fabric" | "mean_intercept_length" => &found[key],
            _ => &found["summary"][key],
        };
        assert_eq!(own, value, "{key}");
    }
    let number = |v: &Value| v.as_f64().unwrap();
    let pores: u64 = ["x", "y", "z"]
        .map(|axis| {
            let slices = found["profile"][axis]["pores"].as_array().unwrap();
            slices.iter().map(|n| n.as_u64().unwrap()).sum()
        })
        .into_iter()
        .reduce(|a: u64, b| {
            assert_eq!(a, b);
            a
        })
        .unwrap();
    let share = pores as f64 / (44.0 * 40.0 * 36.0);
    assert!((share - number(&found["summary"]["porosity"])).abs() < 1e-12);
    assert!((number(&found["boxes"][0]["mean"]) - share).abs() < 0.02);
    let text = page(dir, "a.html");
    needs_nothing(&text);
    assert!(text.starts_with("<!DOCTYPE html>"));
    let median = number(&found["summary"]["equivalent_diameter"]["median"]);
    for part in [
        format!("{:.1} % of the grid", 100.0 * share),
        format!("{median:.4}"),
        "foam.mhd".to_owned(),
        "data:image/png;base64,iVBOR".to_owned(),
        found["settings"]["index_checksum"]
            .as_str()
            .unwrap()
            .to_owned(),
        format!(
            "{:.3}",
            number(&found["mean_intercept_length"]["degree_of_anisotropy"])
        ),
        found["definitions"][0]["source"]
            .as_str()
            .unwrap()
            .to_owned(),
    ] {
        assert!(text.contains(&part), "{part}");
    }
    // sizes by number and by volume, three measures of form, slices, boxes
    assert_eq!(text.matches("<svg ").count(), 7);
    assert!(!text.contains("<h2>Necks") && !text.contains("<h2>Walls"));
}

#[test]
fn the_same_set_gives_the_same_bytes() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    std::fs::create_dir(dir.join("moved")).unwrap();
    let mut pages = Vec::new();
    for (n, threads) in ["1", "2", "7"].into_iter().enumerate() {
        let name = format!("{n}.html");
        ok(dir, &["report", "tiles", &name, "--threads", threads, "-q"]);
        pages.push(page(dir, &name));
    }
    std::fs::rename(dir.join("tiles"), dir.join("moved/set")).unwrap();
    ok(dir, &["report", "moved/set", "moved/3.html"]);
    pages.push(page(dir, "moved/3.html"));
    assert!(pages.windows(2).all(|p| p[0] == p[1]));
}

#[test]
fn nothing_is_written_over_or_half() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    std::fs::write(dir.join("mine.html"), "mine").unwrap();
    for (args, part) in [
        (&["report", "tiles", "mine.html"][..], "mine.html"),
        (&["report", "tiles", "a.txt"], ".html"),
        (&["report", "nothing", "a.html"], "nothing"),
        (&["report", "tiles"], "FILE"),
        (&["report", "tiles", "no/a.html"], "a.html"),
        (
            &["report", "tiles", "a.html", "--dims", "1,2,3"],
            "--against",
        ),
        (
            &["report", "tiles", "a.html", "--against", "no.mhd"],
            "no.mhd",
        ),
        (
            &["report", "tiles", "--json", "--against", "foam.mhd"],
            "FILE",
        ),
    ] {
        let message = fails(dir, args);
        assert!(message.contains(part), "{args:?}: {message}");
    }
    assert_eq!(page(dir, "mine.html"), "mine");
    ok(dir, &["report", "tiles", "mine.html", "--force", "-q"]);
    assert!(page(dir, "mine.html").starts_with("<!DOCTYPE html>"));
    // a damaged tile leaves no page
    let tile = dir.join("tiles/tiles/z0000/y0000_x0000.glb");
    let mut bytes = std::fs::read(&tile).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&tile, bytes).unwrap();
    assert!(fails(dir, &["report", "tiles", "b.html"]).contains("crc32"));
    let left = std::fs::read_dir(dir).unwrap();
    let names: Vec<String> = left
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    assert!(
        !names
            .iter()
            .any(|n| n.contains("b.html") || n.contains("partial")),
        "{names:?}"
    );
}

#[test]
fn what_comes_from_files_is_escaped() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    let name = "<img src=x onerror='alert(1)'>&\"</title>.mhd";
    // no file of Linux has a slash in its name
    let name = name.replace('/', "\\");
    std::fs::rename(dir.join("foam.mhd"), dir.join(&name)).unwrap();
    ok(dir, &["convert", &name, "odd", "--threshold", "otsu", "-q"]);
    ok(dir, &["report", "odd", "odd.html", "-q"]);
    let text = page(dir, "odd.html");
    assert!(!text.contains("<img src=x"), "{text}");
    assert!(text.contains("&lt;img src=x"));
    needs_nothing(&text.replace("onerror='alert(1)'", ""));
}

/// Gives the set `tiles` a table more, with its checksum in the index.
fn put_table(dir: &Path, name: &str, text: &str) {
    let tiles = dir.join("tiles");
    std::fs::write(tiles.join(format!("{name}.csv")), text).unwrap();
    let path = tiles.join("index.json");
    let mut index = json(&std::fs::read_to_string(&path).unwrap());
    index["tables"][name] = format!("{name}.csv").into();
    index["tables"]["checksums"][name] = "".into();
    std::fs::write(&path, index.to_string()).unwrap();
    super::common::seal::seal(&tiles);
}

#[test]
fn tables_of_necks_and_walls_are_told_where_they_are() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    let necks = "cell_a,cell_b,neck_radius [mm],ratio,x [mm],y [mm],z [mm],neck_area [mm^2]\n\
                 1,2,0.05,0.5,0.1,0.2,0.3,0.01\n2,3,0.15,0.75,0.4,0.5,0.6,0.07\n";
    let walls = "cell_a,cell_b,wall_area [mm^2],wall_thickness [mm],chords,thin,neighbour\n\
                 1,2,1.5,0.1,40,0,1\n2,3,0.5,0.3,20,1,1\n4,5,0.25,0.7,1,0,0\n";
    put_table(dir, "necks", necks);
    put_table(dir, "walls", walls);
    let found = json(&ok(dir, &["report", "tiles", "a.html", "--json"]));
    assert_eq!(found["necks"]["count"], 2);
    assert_eq!(found["necks"]["unit"], "mm");
    assert_eq!(found["necks"]["widest"][0]["cell_b"], 3);
    assert_eq!(found["necks"]["neck_radius"]["max"], 0.15);
    // what makes no neighbours is left out, the rest counts by its area
    let own = &found["walls"];
    assert_eq!([&own["count"], &own["left_out"], &own["thin"]], [2, 1, 1]);
    assert_eq!(own["wall_area"], 2.0);
    assert_eq!(own["wall_thickness"]["median"], 0.1);
    assert_eq!(own["wall_thickness"]["max"], 0.3);
    let mean = own["wall_thickness"]["mean"].as_f64().unwrap();
    assert!((mean - 0.15).abs() < 1e-12);
    let text = page(dir, "a.html");
    for part in [
        "<h2>Necks",
        "<h2>Walls",
        "2 and 3",
        "2 walls of 2 mm²",
        "1 pair of cells",
    ] {
        assert!(text.contains(part), "{part}");
    }
    for (bad, part) in [
        ("cell_a,cell_b\n1,2\n", "neck_radius"),
        ("", "empty"),
        ("id\n1\n", "cell_a"),
    ] {
        put_table(dir, "necks", bad);
        let message = fails(dir, &["report", "tiles", "--json"]);
        assert!(message.contains(part), "{bad:?}: {message}");
    }
    // openings between cells of labels have no radius, and touch at edges of voxels alone without a place
    let of_labels = "cell_a,cell_b,neck_radius [mm],ratio,x [mm],y [mm],z [mm],neck_area [mm^2]\n\
                     1,2,,,0.1,0.2,0.3,0.01\n2,3,,,,,,0\n";
    put_table(dir, "necks", of_labels);
    let found = json(&ok(dir, &["report", "tiles", "--json"]));
    assert_eq!(found["necks"]["count"], 2);
    assert!(found["necks"]["neck_radius"].is_null());
    assert_eq!(found["necks"]["widest"].as_array().unwrap().len(), 0);
}

#[test]
fn walls_of_cells_come_first() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    let convert = "convert foam.mhd walls --threshold otsu --macrocube 16 --walls -q";
    ok(dir, &convert.split(' ').collect::<Vec<_>>());
    let found = json(&ok(dir, &["report", "walls", "a.html", "--json"]));
    let median = found["summary"]["wall_thickness"]["median"]
        .as_f64()
        .unwrap();
    let (walls, all) = (&found["walls"], &found["totals"]["walls"]);
    let [count, left_out] = ["count", "left_out"].map(|key| walls[key].as_u64().unwrap());
    assert!(count > 10 && count + left_out == all.as_u64().unwrap());
    let text = page(dir, "a.html");
    let results = &text[..text.find("<h2>Input and settings").unwrap()];
    let expected = format!("{median:.4} mm (median of whole cells)");
    assert!(results.contains(&expected), "{expected}");
    assert!(text.contains("whole cells, each by its median"));
}

#[test]
fn what_was_changed_is_refused() {
    let dir = temp();
    let dir = dir.path();
    let phantom = "phantom foam leaky.mhd --dims 44,40,36 --pitch 11 --wall 2 -q";
    ok(dir, &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert leaky.mhd tiles --threshold otsu --split --walls -q";
    ok(dir, &convert.split(' ').collect::<Vec<_>>());
    ok(dir, &["report", "tiles", "sound.html", "-q"]);
    for name in [
        "cells.csv",
        "objects.csv",
        "surfaces.csv",
        "components.csv",
        "necks.csv",
        "walls.csv",
        "index.json",
    ] {
        let path = dir.join("tiles").join(name);
        let before = std::fs::read(&path).unwrap();
        // one digit, after the head
        let mut after = before.clone();
        let digit = after
            .iter()
            .rposition(|b| (b'1'..b'9').contains(b) && name != "index.json");
        let digit = digit.unwrap_or_else(|| {
            let text = String::from_utf8(before.clone()).unwrap();
            text.find("\"threshold\": ").unwrap() + 13
        });
        after[digit] = if after[digit] == b'1' { b'2' } else { b'1' };
        std::fs::write(&path, &after).unwrap();
        let message = fails(dir, &["report", "tiles", "a.html"]);
        assert!(
            message.contains(name) && message.contains("checksum"),
            "{name}: {message}"
        );
        assert!(!dir.join("a.html").exists());
        std::fs::write(&path, &before).unwrap();
    }
    ok(dir, &["report", "tiles", "a.html", "-q"]);
}

#[test]
fn the_volume_gives_grey_values() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    ok(dir, &["report", "tiles", "a.html", "-q"]);
    ok(
        dir,
        &["report", "tiles", "b.html", "--against", "foam.mhd", "-q"],
    );
    let [a, b] = ["a.html", "b.html"].map(|name| page(dir, name));
    assert!(a.contains("Material (light)") && !b.contains("Material (light)"));
    assert!(b.contains("Grey values of the scan"));
    needs_nothing(&b);
    let other = "phantom foam other.mhd --dims 30,30,30 -q";
    ok(dir, &other.split(' ').collect::<Vec<_>>());
    let message = fails(
        dir,
        &["report", "tiles", "c.html", "--against", "other.mhd"],
    );
    assert!(message.contains("30 x 30 x 30"), "{message}");
    // a raw volume that was cropped and filtered is opened as the index says
    let convert = "convert foam.raw raw --dims 44,40,36 --dtype u8 --threshold 128 --smooth 1 --crop 4:40,2:38,3:33 \
                   --roi cylinder:20,18,14 -q";
    ok(dir, &convert.split_whitespace().collect::<Vec<_>>());
    ok(
        dir,
        &["report", "raw", "d.html", "--against", "foam.raw", "-q"],
    );
    ok(dir, &["report", "raw", "e.html", "-q"]);
    let text = page(dir, "e.html");
    assert!(
        text.contains("of the region of interest") && text.contains("gauss")
            || text.contains("smooth")
    );
}

#[test]
fn odd_sets_have_a_page_too() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    // a part, a set without any cell or without any surface, one of cells at the border alone
    ok(
        dir,
        &[
            "select",
            "tiles",
            "part",
            "--where",
            "not touches_border",
            "-q",
        ],
    );
    for (name, value) in [("metal", 200u8), ("air", 10)] {
        let raw = format!("{name}.raw");
        std::fs::write(dir.join(&raw), vec![value; 1000]).unwrap();
        let convert = "--dims 10,10,10 --dtype u8 --threshold 128 -q";
        let args = ["convert", &raw, name];
        let args: Vec<&str> = args.into_iter().chain(convert.split(' ')).collect();
        ok(dir, &args);
    }
    let cut = "convert foam.mhd cut --threshold otsu --crop 0:9,0:9,0:9 --cap -q";
    ok(dir, &cut.split(' ').collect::<Vec<_>>());
    for name in ["part", "metal", "air", "cut"] {
        let file = format!("{name}.html");
        let output = alvis(dir, &["report", name, &file, "--json"]);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", stderr(&output));
        needs_nothing(&page(dir, &file));
    }
    let air = json(&ok(
        dir,
        &["report", "air", "--json", "--outside", "border-cell"],
    ));
    assert_eq!(air["profile"]["z"]["porosity"][0], Value::Null);
    assert_eq!(air["fabric"], Value::Null);
    let metal = json(&ok(dir, &["report", "metal", "--json"]));
    assert_eq!(metal["profile"]["z"]["porosity"][5], 0.0);
    assert_eq!(metal["form"], Value::Array(Vec::new()));
    let part = json(&ok(dir, &["report", "part", "--json"]));
    assert_eq!(part["profile"], Value::Null);
    assert!(
        part["notes"][0]
            .as_str()
            .unwrap()
            .contains("a part of a tile set")
    );
}

/// A foam whose cells leak, in `leaky.raw`.
fn leaky(dir: &Path) {
    let phantom = "phantom foam leaky.raw --dims 60,52,48 --noise 0.3 -q";
    ok(dir, &phantom.split(' ').collect::<Vec<_>>());
}

const RAW: &str = "--dims 60,52,48 --dtype u8 --threshold 120 -q";

fn run(dir: &Path, words: &str) -> String {
    ok(dir, &words.split_whitespace().collect::<Vec<_>>())
}

#[test]
fn how_cells_were_split_is_told() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    run(
        dir,
        &format!("convert leaky.raw split {RAW} --split 0.85 --split-h 0.25 --split-min-radius 1"),
    );
    let found = json(&run(dir, "report split page.html --json"));
    let curve = json(&run(dir, "cells split --split-curve --json"));
    let split = &found["split"];
    assert_eq!(
        (&split["h"], &split["min_radius"]),
        (&0.25.into(), &1.0.into())
    );
    for key in ["ratio", "cells", "components", "split_curve"] {
        assert_eq!(split[key], curve[key], "{key}");
    }
    assert!(split["cells"].as_u64() > split["components"].as_u64());
    assert_eq!(found["settings"]["cells"]["ratio_permille"], 850);
    let page = page(dir, "page.html");
    let info = run(dir, "info split");
    let words = "split at necks: ratio 0.85, h 0.25, min radius 1";
    assert!(info.contains(words) && page.contains(words));
    for part in [
        "connected components",
        "these tiles",
        "<dt>split</dt>",
        "<dt>neck, neck radius</dt>",
        "or a part of one that was cut",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(
        !page.contains("<dt>cell, object</dt>") && !page.contains("labels"),
        "{page}"
    );
}

/// The same words as when it was converted.
#[test]
fn structures_without_clear_necks_are_warned_of() {
    let dir = temp();
    let dir = dir.path();
    let phantom = "phantom noise open.raw --dims 60,52,48 -q";
    ok(dir, &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert open.raw open --dims 60,52,48 --dtype u8 --smooth 2 --threshold porosity=50% --split";
    let said = stderr(&alvis(dir, &convert.split(' ').collect::<Vec<_>>()));
    let warning = said.lines().find(|l| l.contains("hangs on the ratio"));
    let warning = warning.unwrap_or_else(|| panic!("{said}"));
    let warning = warning.trim_start_matches("warning: ");
    let found = json(&run(dir, "report open --json -q"));
    let warnings = found["warnings"].as_array().unwrap();
    assert!(
        warnings.iter().any(|w| w == warning),
        "{warning}: {warnings:?}"
    );
    for form in [&[][..], &["--json"]] {
        let curve = alvis(dir, &[&["cells", "open", "--split-curve"], form].concat());
        assert!(stderr(&curve).contains(warning), "{}", stderr(&curve));
    }
}

#[test]
fn cells_of_labels_name_their_file() {
    let dir = temp();
    let dir = dir.path();
    leaky(dir);
    // of each voxel the half of the volume that it is in
    let scan = std::fs::read(dir.join("leaky.raw")).unwrap();
    let labels: Vec<u8> = (0..scan.len())
        .map(|i| if i % 60 < 30 { 1 } else { 2 })
        .collect();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 60 52 48\nencoding: raw\n\n";
    std::fs::write(
        dir.join("halves.nrrd"),
        [header.as_bytes(), &labels].concat(),
    )
    .unwrap();
    run(
        dir,
        &format!("convert leaky.raw set {RAW} --labels halves.nrrd"),
    );
    let found = json(&run(dir, "report set page.html --json -q"));
    assert_eq!(found["settings"]["cells"]["file"], "halves.nrrd");
    assert_eq!(found.get("split"), None);
    let page = page(dir, "page.html");
    for part in [
        "by the labels of halves.nrrd",
        "one label in the file of labels",
        "connected components",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("<dt>cell, object</dt>") && !page.contains("<dt>split</dt>"));
}

/// The deviation by volume of one cell is 0, and no root of less than 0.
#[test]
fn one_cell_does_not_vary() {
    let dir = temp();
    let dir = dir.path();
    for voxels in 1..12 {
        let mut scan = vec![200_u8; 20 * 6 * 6];
        scan[20 * 14 + 4..][..voxels].fill(10);
        std::fs::write(dir.join("one.raw"), scan).unwrap();
        run(
            dir,
            "convert one.raw set --dims 20,6,6 --dtype u8 --threshold 100 --spacing 0.3 --unit mm --force -q",
        );
        let found = json(&run(dir, "cells set --summary --json"));
        let spread = &found["equivalent_diameter"]["volume"];
        assert_eq!(spread["sd"], 0.0, "{voxels}: {spread}");
        assert_eq!(spread["mean"], spread["min"], "{voxels}: {spread}");
    }
}

#[test]
fn a_volume_of_another_size_is_refused_by_the_option_that_gave_it() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    run(dir, "phantom foam larger.mhd --dims 48,40,36 -q");
    let message = fails(
        dir,
        &["report", "tiles", "a.html", "--against", "larger.mhd"],
    );
    assert!(
        message.contains("--against: found larger.mhd of 48 x 40 x 36"),
        "{message}"
    );
    assert!(
        message.contains("44 x 40 x 36") && !message.contains("--tiles"),
        "{message}"
    );
}

/// Nothing is below the threshold, or everything: there is no plot of that.
#[test]
fn a_set_without_cells_has_no_plots_of_them() {
    let dir = temp();
    let dir = dir.path();
    foam(dir);
    for (threshold, porosity) in [("0", "0.0 %"), ("256", "100")] {
        run(
            dir,
            &format!("convert foam.mhd none --threshold {threshold} --force -q"),
        );
        run(dir, "report none none.html --force -q");
        let page = page(dir, "none.html");
        assert!(!page.contains("e-17") && !page.contains("<svg"));
        let words = format!("have the same porosity, {porosity}");
        assert!(page.contains(&words), "{words}");
    }
}
