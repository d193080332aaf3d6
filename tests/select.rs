//! `alvis select`: parts and painted copies are tile sets that verify, and hold what was asked for.

mod command;

use alvis::manifest::{Group, Manifest, Shard};
use command::{fails, foam_tiles, json, ok};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The JSON and BIN chunks of a tile.
fn glb(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let json = &bytes[20..20 + word(12)];
    let start = 20 + word(12) + 8;
    (
        serde_json::from_slice(json).unwrap(),
        bytes[start..].to_vec(),
    )
}

fn manifest(set: &Path) -> Manifest {
    serde_json::from_slice(&std::fs::read(set.join("index.json")).unwrap()).unwrap()
}

/// Tiles by path, with their groups.
fn groups(set: &Path) -> BTreeMap<String, Vec<Group>> {
    let mut out = BTreeMap::new();
    for layer in manifest(set).layers {
        let bytes = std::fs::read(set.join(layer.path)).unwrap();
        let shard: Shard = serde_json::from_slice(&bytes).unwrap();
        out.extend(shard.tiles.into_iter().map(|t| (t.path, t.groups)));
    }
    out
}

/// Ids of the rows that `cells` lists.
fn listed(dir: &Path, set: &str, more: &[&str]) -> BTreeSet<u64> {
    let args = [&["cells", set, "--json"], more].concat();
    let value = json(&ok(dir, &args));
    let rows = value["cells"].as_array().unwrap();
    rows.iter().map(|r| r["id"].as_u64().unwrap()).collect()
}

/// A piece's geometry: positions, normals and indices as they stand in the file.
fn geometry(doc: &Value, bin: &[u8], node: usize) -> Vec<Vec<u8>> {
    let primitive = &doc["meshes"][node - 1]["primitives"][0];
    let read = |accessor: &Value| {
        let a = &doc["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &doc["bufferViews"][a["bufferView"].as_u64().unwrap() as usize];
        let start =
            (view["byteOffset"].as_u64().unwrap() + a["byteOffset"].as_u64().unwrap()) as usize;
        let size = match (
            a["componentType"].as_u64().unwrap(),
            a["type"].as_str().unwrap(),
        ) {
            (5126, "VEC3") => 12,
            (5123, "SCALAR") => 2,
            _ => 4,
        };
        bin[start..start + size * a["count"].as_u64().unwrap() as usize].to_vec()
    };
    let attributes = &primitive["attributes"];
    [
        &attributes["POSITION"],
        &attributes["NORMAL"],
        &primitive["indices"],
    ]
    .map(read)
    .to_vec()
}

/// Checks that every piece of the part is that of the whole, and that exactly the pieces of `cells`
/// are there.
fn check_part(dir: &Path, part: &str, cells: &BTreeSet<u64>, caps: bool) {
    check_pieces(dir, part, |g| match g.cell {
        0 => caps,
        cell => cells.contains(&cell),
    });
}

/// Checks that every piece of the part is that of the whole, but for its name, which is by what the cell borders in the
/// part, and that exactly those are there which `keep` keeps.
fn check_pieces(dir: &Path, part: &str, keep: impl Fn(&Group) -> bool) {
    let whole = groups(&dir.join("tiles"));
    let found = groups(&dir.join(part));
    let pieces = found.values().flatten().filter(|g| g.cell != 0);
    let pairs: BTreeSet<[u64; 2]> = pieces.map(|g| [g.cell, g.object]).collect();
    let name = |g: &Group| match (g.cell, pairs.range([g.cell, 0]..[g.cell + 1, 0]).count()) {
        (0, _) => format!("cap_object_{}", g.object),
        (cell, 1) => format!("cell_{cell}"),
        (cell, _) => format!("cell_{cell}_object_{}", g.object),
    };
    for (path, source) in &whole {
        let kept: Vec<Group> = source.iter().filter(|g| keep(g)).copied().collect();
        let file = dir.join(part).join(path);
        assert_eq!(found.get(path).cloned().unwrap_or_default(), kept, "{path}");
        assert_eq!(file.exists(), !kept.is_empty(), "{path}");
        if kept.is_empty() {
            continue;
        }
        let ((a, a_bin), (b, b_bin)) = (glb(&dir.join("tiles").join(path)), glb(&file));
        let mut node = 0;
        for (i, group) in source.iter().enumerate().filter(|(_, g)| keep(g)) {
            node += 1;
            assert_eq!(
                geometry(&a, &a_bin, i + 1),
                geometry(&b, &b_bin, node),
                "{path} {i}"
            );
            let (from, to) = (&a["nodes"][i + 1], &b["nodes"][node]);
            assert_eq!(
                (&from["extras"], to["name"].as_str()),
                (&to["extras"], Some(&*name(group)))
            );
            assert_eq!(b["meshes"][node - 1]["name"], to["name"]);
        }
        assert_eq!(b["nodes"].as_array().unwrap().len(), node + 1);
    }
    assert!(found.keys().all(|path| whole.contains_key(path)));
}

fn verifies(dir: &Path, set: &str, more: &[&str]) -> Value {
    let args = [&["verify", set, "--json"], more].concat();
    json(&ok(dir, &args))
}

#[test]
fn a_part_holds_the_pieces_of_its_cells() {
    for more in [&[][..], &["--primitives", "triangles"]] {
        let dir = foam_tiles(more);
        let dir = dir.path();
        let inner = listed(dir, "tiles", &["--where", "not touches_border"]);
        let outer = listed(dir, "tiles", &["--where", "touches_border"]);
        let args = [
            "select",
            "tiles",
            "inner",
            "--where",
            "not touches_border",
            "--json",
        ];
        let report = json(&ok(dir, &args));
        assert_eq!(report["cells"], inner.len());
        check_part(dir, "inner", &inner, false);
        let args = [
            "select",
            "tiles",
            "outer",
            "--where",
            "not touches_border",
            "--omit",
            "--quiet",
        ];
        assert_eq!(ok(dir, &args), "");
        check_part(dir, "outer", &outer, false);
        let all = manifest(&dir.join("tiles")).totals;
        let [a, b] = ["inner", "outer"].map(|set| {
            assert_eq!(verifies(dir, set, &[])["ok"], true);
            manifest(&dir.join(set)).totals
        });
        for (a, b, all) in [
            (a.triangles, b.triangles, all.triangles),
            (a.vertices, b.vertices, all.vertices),
            (a.tile_vertices, b.tile_vertices, all.tile_vertices),
            (a.strips, b.strips, all.strips),
            (a.strip_indices, b.strip_indices, all.strip_indices),
            (a.cells, b.cells, all.cells),
            (a.surfaces, b.surfaces, all.surfaces),
            (a.border_edges, b.border_edges, all.border_edges),
        ] {
            assert_eq!(a + b, all);
        }
        assert_eq!(a.volume6 + b.volume6, all.volume6);
        assert_eq!(
            a.euler_characteristic + b.euler_characteristic,
            all.euler_characteristic
        );
        assert_eq!(listed(dir, "inner", &[]), inner);
        let whole = json(&ok(dir, &["cells", "tiles", "--summary", "--json"]));
        let part = json(&ok(dir, &["cells", "inner", "--summary", "--json"]));
        assert_eq!(whole["porosity"], part["porosity"]);
        let message = fails(dir, &["verify", "inner", "--against", "foam.mhd"]);
        assert!(message.contains("a part"), "{message}");
    }
}

#[test]
fn a_part_of_a_part_remembers_the_whole() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    ok(
        dir,
        &[
            "select",
            "tiles",
            "a",
            "--where",
            "touches_border",
            "--omit",
        ],
    );
    ok(dir, &["select", "a", "b", "--where", "volume > 0.05"]);
    ok(
        dir,
        &[
            "select",
            "tiles",
            "c",
            "--where",
            "not touches_border and volume > 0.05",
        ],
    );
    let [b, c] = ["b", "c"].map(|s| manifest(&dir.join(s)));
    assert_eq!((&b.totals, &b.layers), (&c.totals, &c.layers));
    let [b, c] = [b, c].map(|m| m.selection.unwrap());
    assert_eq!(b.of, c.of);
    assert_eq!(
        b.condition.as_deref(),
        Some("(not (touches_border)) and (volume > 0.05)")
    );
    verifies(dir, "b", &[]);
    let again = listed(dir, "tiles", &["--where", &b.condition.unwrap()]);
    assert_eq!(listed(dir, "b", &[]), again);
}

#[test]
fn everything_painted_is_still_a_whole() {
    for more in [&[][..], &["--cap"], &["--cap", "--primitives", "triangles"]] {
        let dir = foam_tiles(more);
        let dir = dir.path();
        ok(dir, &["select", "tiles", "copy", "--paint", "false=red"]);
        let all = listed(dir, "tiles", &[]);
        check_part(dir, "copy", &all, true);
        let [a, b] = ["tiles", "copy"].map(|s| manifest(&dir.join(s)));
        assert!(!b.is_part() && a.cap == b.cap);
        let strip = |mut t: alvis::manifest::Totals| {
            // the JSON chunks differ in room
            t.bytes = 0;
            t
        };
        assert_eq!(strip(a.totals), strip(b.totals));
        assert_eq!(a.transform, b.transform);
        verifies(dir, "copy", &["--against", "foam.mhd"]);
    }
}

#[test]
fn caps_go_when_they_would_close_nothing() {
    let dir = foam_tiles(&["--cap"]);
    let dir = dir.path();
    let outer = listed(dir, "tiles", &["--where", "touches_border"]);
    ok(
        dir,
        &["select", "tiles", "outer", "--where", "touches_border"],
    );
    check_part(dir, "outer", &outer, false);
    let m = manifest(&dir.join("outer"));
    assert!(!m.cap && m.totals.cap_triangles == 0 && m.totals.border_edges > 0);
    verifies(dir, "outer", &[]);
}

/// Rows of a table of a set, by their ids.
fn rows(set: &Path, table: &str) -> BTreeMap<u64, String> {
    let text = std::fs::read_to_string(set.join(format!("{table}.csv"))).unwrap();
    let id = |line: &str| line.split(',').next().unwrap().parse().unwrap();
    text.lines()
        .skip(1)
        .map(|l| (id(l), l.to_owned()))
        .collect()
}

/// Cell and object of each surface.
fn sides(set: &Path) -> BTreeMap<u64, [u64; 2]> {
    let sides = |line: &String| -> [u64; 2] {
        let mut fields = line.split(',').skip(1).map(|f| f.parse().unwrap());
        [fields.next().unwrap(), fields.next().unwrap()]
    };
    let rows = rows(set, "surfaces");
    rows.iter().map(|(id, line)| (*id, sides(line))).collect()
}

/// Parts by objects and surfaces have exactly the pieces and rows that follow from the tables, verify, and come back
/// from other forms; the largest are those of a sort of the table.
#[test]
fn parts_by_objects_and_surfaces_are_what_the_tables_say() {
    for (phantom, more) in [
        (
            "foam v.mhd --dims 30,26,28 --pitch 10 --noise 0.25",
            &[][..],
        ),
        (
            "foam v.mhd --dims 30,26,28 --pitch 10 --noise 0.25 --seed 4",
            &["--cap"],
        ),
        (
            "noise v.mhd --dims 17,15,16 --density 0.42 --seed 2",
            &["--cap", "--layout", "nodes"],
        ),
        (
            "noise v.mhd --dims 17,15,16 --density 0.6 --seed 3",
            &["--ambiguous", "join"],
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path();
        let words = |line: &str| -> Vec<String> { line.split(' ').map(String::from).collect() };
        let run = |line: &str, more: &[&str]| {
            let line = words(line);
            let args: Vec<&str> = line
                .iter()
                .map(String::as_str)
                .chain(more.iter().copied())
                .collect();
            ok(dir, &args)
        };
        run(&format!("phantom {phantom} --quiet"), &[]);
        run(
            "convert v.mhd tiles --threshold 120 --macrocube 9 --quiet",
            more,
        );
        let tiles = dir.join("tiles");
        let merged = groups(&tiles).into_keys().any(|path| {
            glb(&tiles.join(path)).0["extensionsUsed"]
                .as_array()
                .is_some()
        });
        let sides = sides(&tiles);
        for (table, options) in [
            ("objects", "--largest 1"),
            ("objects", "--largest 2 --omit"),
            ("objects", "--where touches_border --largest 4"),
            ("objects", "--where voxels<4"),
            ("objects", "--where voxels<4 --omit"),
            ("surfaces", "--largest 6"),
            ("surfaces", "--where triangles>9"),
            ("surfaces", "--where id<=4 --omit"),
        ] {
            let omit = options.contains("--omit");
            let query = options.replace(" --omit", "");
            let listing = format!("cells tiles --{table} --json {query}");
            let value = json(&run(&listing, &[]));
            let listed = value[table].as_array().unwrap().iter();
            let listed: BTreeSet<u64> = listed.map(|r| r["id"].as_u64().unwrap()).collect();
            let keeps = |id: u64| listed.contains(&id) != omit;
            let kept: BTreeMap<u64, [u64; 2]> = match table {
                "objects" => sides
                    .iter()
                    .filter(|(_, s)| keeps(s[1]))
                    .map(|(i, s)| (*i, *s))
                    .collect(),
                _ => sides
                    .iter()
                    .filter(|(i, _)| keeps(**i))
                    .map(|(i, s)| (*i, *s))
                    .collect(),
            };
            let report = json(&run(
                &format!("select tiles part --{table} {options} --force --json"),
                &[],
            ));
            let part = dir.join("part");
            let made = manifest(&part);
            let objects: BTreeSet<u64> = kept.values().map(|s| s[1]).collect();
            let whole = sides
                .iter()
                .all(|(id, s)| kept.contains_key(id) || !objects.contains(&s[1]));
            assert_eq!(made.cap, manifest(&tiles).cap && whole, "{options}");
            assert!(whole || table == "surfaces");
            let has = |g: &Group| match g.cell {
                0 => made.cap && objects.contains(&g.object),
                _ => kept.contains_key(&g.surface),
            };
            if merged {
                let all = groups(&tiles).into_values().flatten().filter(has);
                assert!(
                    groups(&part).into_values().flatten().eq(all),
                    "{table} {options}"
                );
            } else {
                check_pieces(dir, "part", has);
            }
            let cells: BTreeSet<u64> = kept.values().map(|s| s[0]).collect();
            for (name, ids) in [
                ("cells", &cells),
                ("objects", &objects),
                ("surfaces", &kept.keys().copied().collect()),
            ] {
                let mut expected = rows(&tiles, name);
                expected.retain(|id, _| ids.contains(id));
                assert_eq!(rows(&part, name), expected, "{table} {options}: {name}");
                assert_eq!(report[name], ids.len());
            }
            assert_eq!(verifies(dir, "part", &[])["ok"], true);
            run("repack part web --for web --force --quiet", &[]);
            verifies(dir, "web", &[]);
        }
    }
}

/// What is chosen from a part that was chosen otherwise is said step by step, else as one condition.
#[test]
fn choices_one_after_the_other_are_told() {
    let dir = foam_tiles(&["--cap"]);
    let dir = dir.path();
    let take = |from: &str, to: &str, line: &str| {
        let args: Vec<&str> = ["select", from, to, "--force", "--json"]
            .into_iter()
            .chain(line.split(' '))
            .collect();
        let value = json(&ok(dir, &args))["selection"].clone();
        verifies(dir, to, &[]);
        value
    };
    let first = take("tiles", "a", "--objects --largest 1");
    assert_eq!(
        (&first["table"], &first["largest"], &first["before"]),
        (&"objects".into(), &1.into(), &Value::Null)
    );
    assert!(manifest(&dir.join("a")).cap);
    let then = take("a", "b", "--where not(touches_border) --paint best:2=lime");
    assert_eq!(
        then["before"],
        serde_json::json!([{"where": null, "omit": false, "table": "objects", "largest": 1}])
    );
    assert_eq!(
        (&then["where"], &then["table"]),
        (&"not(touches_border)".into(), &Value::Null)
    );
    assert_eq!(then["painted"][0]["cells"], 2);
    // all surfaces of the object are not there any more
    assert!(!manifest(&dir.join("b")).cap);
    let last = take("b", "c", "--where voxels>3 --largest 2");
    assert_eq!(last["where"], "(not(touches_border)) and (voxels>3)");
    assert_eq!(
        (&last["largest"], &last["before"]),
        (&2.into(), &then["before"])
    );
    let less = take("c", "d", "--largest 1 --omit");
    assert_eq!(less["before"].as_array().unwrap().len(), 2);
    assert_eq!(manifest(&dir.join("d")).totals.cells, 1);
    let painted = take("c", "e", "--surfaces --paint true=red");
    assert_eq!(painted["before"].as_array().unwrap().len(), 2);
    assert_eq!(painted["painted"][0]["surfaces"], 2);
    let text = ok(dir, &["info", "d"]);
    assert!(text.contains("of objects the largest"), "{text}");
    let message = fails(
        dir,
        &[
            "select",
            "tiles",
            "x",
            "--surfaces",
            "--paint",
            "best:3=red",
        ],
    );
    assert!(message.contains("no form factor"), "{message}");
    let message = fails(dir, &["select", "tiles", "x", "--objects"]);
    assert!(message.contains("--largest"), "{message}");
}

/// A volume of one phase has one row and no surface; parts and copies of it verify all the same.
#[test]
fn a_volume_of_one_phase_is_chosen_from_too() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    for (threshold, more) in [("-5", &[][..]), ("-5", &["--cap"]), ("999", &[])] {
        let convert = [
            "convert",
            "foam.mhd",
            "one",
            "--threshold",
            threshold,
            "--force",
            "-q",
        ];
        ok(dir, &[&convert[..], more].concat());
        for line in [
            "--objects --largest 1",
            "--objects --where false",
            "--objects --paint true=red",
            "--surfaces --largest 1",
            "--where true --omit",
            "--paint true=red",
        ] {
            let start = ["select", "one", "part", "--force", "--quiet"];
            ok(
                dir,
                &start.into_iter().chain(line.split(' ')).collect::<Vec<_>>(),
            );
            verifies(dir, "part", &[]);
        }
    }
}

/// Pieces have the colours of their objects, caps are grey.
#[test]
fn objects_are_painted() {
    let dir = foam_tiles(&["--cap"]);
    let dir = dir.path();
    let report = json(&ok(
        dir,
        &[
            "select",
            "tiles",
            "out",
            "--objects",
            "--paint",
            "id==1=red",
            "--json",
        ],
    ));
    assert_eq!(report["selection"]["painted"][0]["objects"], 1);
    for (path, groups) in groups(&dir.join("out")) {
        let (doc, _) = glb(&dir.join("out").join(&path));
        for (i, group) in groups.iter().enumerate() {
            let at = doc["meshes"][i]["primitives"][0]["material"]
                .as_u64()
                .unwrap() as usize;
            let red = group.object == 1 && group.cell != 0;
            let name = if red { "colour_ff0000" } else { "surface" };
            assert_eq!(doc["materials"][at]["name"], name);
        }
    }
    verifies(dir, "out", &["--against", "foam.mhd"]);
}

/// sRGB to linear, from the standard's formula.
fn linear(v: f64) -> f64 {
    let v = v / 255.0;
    if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

#[test]
fn paint_becomes_materials() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let args = [
        "select",
        "tiles",
        "out",
        "--paint",
        "touches_border == 1=#102030",
        "--paint",
        "best:3=lime",
        "--paint",
        "worst:2=red",
        "--json",
    ];
    let report = json(&ok(dir, &args));
    let counts: Vec<u64> = report["selection"]["painted"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| p["cells"].as_u64().unwrap())
        .collect();
    let outer = listed(dir, "tiles", &["--where", "touches_border"]);
    assert_eq!(counts, [outer.len() as u64, 3, 2]);
    let ranked = ["--where", "!missing(form_factor)", "--sort", "form_factor"];
    let worst = listed(dir, "tiles", &[&ranked[..], &["--top", "2"]].concat());
    let best = listed(
        dir,
        "tiles",
        &[&ranked[..], &["--descending", "--top", "3"]].concat(),
    );
    let mut seen = 0;
    for (path, groups) in groups(&dir.join("out")) {
        let (doc, _) = glb(&dir.join("out").join(&path));
        for (i, group) in groups.iter().enumerate() {
            let at = doc["meshes"][i]["primitives"][0]["material"]
                .as_u64()
                .unwrap() as usize;
            let material = &doc["materials"][at];
            assert_eq!(material["doubleSided"], true);
            let (name, rgb) = match group.cell {
                c if worst.contains(&c) => ("colour_ff0000", [255.0, 0.0, 0.0]),
                c if best.contains(&c) => ("colour_00ff00", [0.0, 255.0, 0.0]),
                c if outer.contains(&c) => ("colour_102030", [16.0, 32.0, 48.0]),
                _ => {
                    assert_eq!(material["name"], "surface");
                    continue;
                }
            };
            seen += 1;
            assert_eq!(material["name"], name);
            let factor = &material["pbrMetallicRoughness"]["baseColorFactor"];
            for c in 0..3 {
                let v = factor[c].as_f64().unwrap();
                assert!((v - linear(rgb[c])).abs() < 1e-6, "{factor}");
            }
        }
        let used = doc["materials"].as_array().unwrap();
        let names: BTreeSet<&str> = used.iter().map(|m| m["name"].as_str().unwrap()).collect();
        assert_eq!(names.len(), used.len(), "{path}");
    }
    assert!(seen > outer.len());
    verifies(dir, "out", &["--against", "foam.mhd"]);
}

#[test]
fn colours_follow_values_and_have_a_legend() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let args = [
        "select",
        "tiles",
        "out",
        "--colour-by",
        "volume",
        "--map",
        "magma",
        "--where",
        "not touches_border",
    ];
    ok(dir, &args);
    let by = manifest(&dir.join("out"))
        .selection
        .unwrap()
        .colour_by
        .unwrap();
    assert_eq!((by.unit.as_str(), by.map.as_str()), ("mm^3", "magma"));
    assert_eq!(by.colours.first().unwrap(), "#000004");
    assert_eq!(by.colours.last().unwrap(), "#fcfdbf");
    let value = json(&ok(dir, &["cells", "out", "--json", "--sort", "volume"]));
    let rows = value["cells"].as_array().unwrap();
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    assert_eq!(first["volume"], by.min);
    assert_eq!(last["volume"], by.max);
    let legend = image::open(dir.join("out/legend.png")).unwrap().to_rgb8();
    assert!(
        legend.pixels().any(|p| p.0 == [0, 0, 4])
            && legend.pixels().any(|p| p.0 == [252, 253, 191])
    );
    // a set without the SVG is whole
    verifies(dir, "out", &[]);
    std::fs::remove_file(dir.join("out/legend.svg")).unwrap();
    verifies(dir, "out", &[]);
    let mut found = BTreeMap::new();
    for (path, groups) in groups(&dir.join("out")) {
        let (doc, _) = glb(&dir.join("out").join(&path));
        for (i, group) in groups.iter().enumerate() {
            let at = doc["meshes"][i]["primitives"][0]["material"]
                .as_u64()
                .unwrap() as usize;
            let name = doc["materials"][at]["name"].as_str().unwrap().to_string();
            assert_eq!(found.entry(group.cell).or_insert(name.clone()), &name);
        }
    }
    assert_eq!(found[&first["id"].as_u64().unwrap()], "colour_000004");
    assert_eq!(found[&last["id"].as_u64().unwrap()], "colour_fcfdbf");
    assert!(found.values().collect::<BTreeSet<_>>().len() > 3);
    // a set without a legend replaces one that has it
    ok(
        dir,
        &["select", "tiles", "out", "--where", "true", "--force"],
    );
    assert!(!dir.join("out/legend.png").exists() && !dir.join("out/legend.svg").exists());
    verifies(dir, "out", &[]);
}

#[test]
fn merged_tiles_are_filtered_and_painted() {
    for kind in ["strips", "triangles"] {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path();
        let phantom = "phantom noise noise.mhd --dims 32,32,32 --density 0.94 --quiet";
        ok(dir, &phantom.split(' ').collect::<Vec<_>>());
        let convert =
            "convert noise.mhd tiles --threshold 127.5 --macrocube 40 --quiet --primitives";
        ok(dir, &convert.split(' ').chain([kind]).collect::<Vec<_>>());
        let condition = "voxels > 1 and not touches_border";
        let args = [
            "select",
            "tiles",
            "out",
            "--where",
            condition,
            "--paint",
            "voxels > 3=red",
            "--quiet",
        ];
        ok(dir, &args);
        let verdict = verifies(dir, "out", &[]);
        let kept = listed(dir, "tiles", &["--where", condition]);
        assert_eq!(verdict["cells"], kept.len());
        let red = listed(
            dir,
            "tiles",
            &["--where", &format!("{condition} and voxels > 3")],
        );
        let whole = groups(&dir.join("tiles"));
        let mut merged = 0;
        for (path, found) in groups(&dir.join("out")) {
            let expected: Vec<Group> = whole[&path]
                .iter()
                .filter(|g| kept.contains(&g.cell))
                .copied()
                .collect();
            assert_eq!(found, expected);
            let (doc, bin) = glb(&dir.join("out").join(&path));
            if doc["extensionsUsed"].is_null() {
                continue;
            }
            merged += 1;
            let primitive = &doc["meshes"][0]["primitives"][0];
            let table = &doc["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
            assert_eq!(table["count"], found.len());
            if found.iter().all(|g| !red.contains(&g.cell)) {
                assert!(primitive["attributes"]["COLOR_0"].is_null());
                continue;
            }
            let colour =
                &doc["accessors"][primitive["attributes"]["COLOR_0"].as_u64().unwrap() as usize];
            assert_eq!(
                (&colour["normalized"], &colour["componentType"]),
                (&true.into(), &5123.into())
            );
            let view = &doc["bufferViews"][colour["bufferView"].as_u64().unwrap() as usize];
            let mut at = view["byteOffset"].as_u64().unwrap() as usize;
            for group in &found {
                let expected = match red.contains(&group.cell) {
                    true => [65_535u16, 0, 0, 65_535],
                    false => [52_428, 52_428, 52_428, 65_535],
                };
                for _ in 0..group.vertices {
                    let found: Vec<u16> = bin[at..at + 8]
                        .chunks(2)
                        .map(|b| u16::from_le_bytes([b[0], b[1]]))
                        .collect();
                    assert_eq!(found, expected);
                    at += 8;
                }
            }
        }
        assert!(merged > 0, "no tile is merged");
        ok(
            dir,
            &["select", "tiles", "copy", "--paint", "false=red", "--quiet"],
        );
        let [a, b] = ["tiles", "copy"].map(|s| manifest(&dir.join(s)).totals);
        assert_eq!(
            (a.triangles, a.volume6, a.strips),
            (b.triangles, b.volume6, b.strips)
        );
        verifies(dir, "copy", &["--against", "noise.mhd"]);
    }
}

#[test]
fn nothing_left_is_an_empty_set() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    let report = json(&ok(
        dir,
        &["select", "tiles", "none", "--where", "false", "--json"],
    ));
    assert_eq!((&report["cells"], &report["tiles"]), (&0.into(), &0.into()));
    assert!(report["warnings"][0].as_str().unwrap().contains("empty"));
    verifies(dir, "none", &[]);
    assert_eq!(listed(dir, "none", &[]).len(), 0);
}

#[test]
fn refusals_leave_nothing_behind() {
    let dir = foam_tiles(&[]);
    let dir = dir.path();
    for (args, part) in [
        (&["select", "tiles", "out"][..], "--where"),
        (
            &["select", "tiles", "tiles", "--where", "true", "--force"],
            "another directory",
        ),
        (
            &["select", "tiles", "out", "--where", "volme > 1"],
            "column 1",
        ),
        (&["select", "tiles", "out", "--omit"], "--where"),
        (
            &["select", "tiles", "out", "--paint", "best:3"],
            "EXPR=COLOUR",
        ),
        (
            &["select", "tiles", "out", "--paint", "best:x=red"],
            "best:N",
        ),
        (
            &["select", "tiles", "out", "--paint", "true=reddish"],
            "CSS",
        ),
        (
            &["select", "tiles", "out", "--paint", "volume=red"],
            "a condition",
        ),
        (
            &[
                "select",
                "tiles",
                "out",
                "--map",
                "jet",
                "--colour-by",
                "volume",
            ],
            "viridis",
        ),
        (&["select", "tiles", "out", "--map", "magma"], "--colour-by"),
        (
            &[
                "select",
                "tiles",
                "out",
                "--colour-by",
                "volume",
                "--range",
                "1:1",
            ],
            "0:2.5",
        ),
        (&["select", "nothing", "out", "--where", "true"], "nothing"),
    ] {
        let message = fails(dir, args);
        assert!(message.contains(part), "{args:?}: {message}");
        assert!(!dir.join("out").exists(), "{args:?}");
    }
    std::fs::create_dir(dir.join("full")).unwrap();
    std::fs::write(dir.join("full/mine.txt"), "x").unwrap();
    for force in [&[][..], &["--force"]] {
        let args = [&["select", "tiles", "full", "--where", "true"], force].concat();
        let message = fails(dir, &args);
        assert!(message.contains("holds mine.txt"), "{args:?}: {message}");
    }
    // a damaged tile is refused by its checksum
    let path = groups(&dir.join("tiles")).into_keys().next().unwrap();
    let file = dir.join("tiles").join(path);
    let mut bytes = std::fs::read(&file).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let message = fails(dir, &["select", "tiles", "out", "--where", "true"]);
    assert!(
        message.contains("checksum") && !dir.join("out").exists(),
        "{message}"
    );
}
