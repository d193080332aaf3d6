//! What the page gets, compared with the tile set as other programs read it.

use super::client::{self, Reply, Served, encoded, view};
use super::command::{foam_tiles, json, ok};
use alvis::manifest::{Manifest, TileEntry};
use alvis::tile::SurfacePiece;
use alvis::tileset::TileSet;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// A tile or a node as the page draws it.
pub struct Mesh {
    /// On the lattice.
    pub points: Vec<[i32; 3]>,
    pub normals: Vec<[f64; 3]>,
    /// Surface, cell and object of each vertex.
    pub ids: Vec<[u32; 3]>,
    /// Bit 0: of a cap; bit 1: of a fin; bit 2: of the side of a fin that lies in the cell.
    pub flags: Vec<u8>,
    pub triangles: Vec<[u32; 3]>,
    shift: u32,
    index_bytes: u32,
    /// Numbers of the strip, those that begin a new one among them.
    entries: usize,
}

impl Mesh {
    pub fn read(reply: &Reply) -> Mesh {
        assert_eq!(reply.status, 200, "{}", reply.text());
        assert_eq!(
            reply.header("content-type"),
            Some("application/octet-stream")
        );
        let body = &reply.body;
        assert_eq!(&body[..4], b"ALVM");
        let words = client::words(&body[..48]);
        let [version, vertices, indices, slots, index_bytes, triangles] = words[1..7] else {
            panic!()
        };
        let origin = [7, 8, 9].map(|i| words[i] as i32);
        let (shift, stride) = (words[10], words[11]);
        assert_eq!((version, stride), (1, 12));
        assert_eq!(index_bytes, if vertices > 65_535 { 4 } else { 2 });
        let (vertex_bytes, rest) = body[48..].split_at(12 * vertices as usize);
        let (slot_bytes, index_part) = rest.split_at(12 * slots as usize);
        assert_eq!(index_part.len(), (index_bytes * indices) as usize);
        let slots: Vec<[u32; 3]> = slot_bytes
            .as_chunks::<12>()
            .0
            .iter()
            .map(|s| [0, 4, 8].map(|i| u32::from_le_bytes(s[i..i + 4].try_into().unwrap())))
            .collect();
        let mut mesh = Mesh {
            points: Vec::new(),
            normals: Vec::new(),
            ids: Vec::new(),
            flags: Vec::new(),
            triangles: Vec::new(),
            shift,
            index_bytes,
            entries: indices as usize,
        };
        for v in vertex_bytes.as_chunks::<12>().0 {
            let short = |i: usize| i32::from(u16::from_le_bytes([v[i], v[i + 1]]));
            mesh.points
                .push([0, 1, 2].map(|a| origin[a] + (short(2 * a) << shift)));
            mesh.normals.push(normal(v[8] as i8, v[9] as i8));
            let slot = short(6) as usize | usize::from(v[10]) << 16;
            mesh.ids.push(slots[slot]);
            assert_eq!(v[11] & !7, 0);
            mesh.flags.push(v[11]);
        }
        let numbers: Vec<u32> = match index_bytes {
            2 => index_part
                .as_chunks::<2>()
                .0
                .iter()
                .map(|i| u16::from_le_bytes(*i).into())
                .collect(),
            _ => client::words(index_part),
        };
        let restart = if index_bytes == 2 { 0xFFFF } else { u32::MAX };
        // as OpenGL ES 3.0 draws a TRIANGLE_STRIP
        for strip in numbers.split(|&i| i == restart) {
            for (k, w) in strip.windows(3).enumerate() {
                let [a, b, c] = if k % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[1], w[0], w[2]]
                };
                if a != b && b != c && a != c {
                    mesh.triangles.push([a, b, c]);
                }
            }
        }
        assert_eq!(mesh.triangles.len(), triangles as usize);
        mesh
    }

    /// Triangles by their corners and ids, in any order.
    pub fn drawn(&self) -> Vec<([[i32; 3]; 3], [u32; 3])> {
        let of = |t: &[u32; 3]| {
            let ids = t.map(|i| self.ids[i as usize]);
            assert!(ids[0] == ids[1] && ids[1] == ids[2]);
            (turned(t.map(|i| self.points[i as usize])), ids[0])
        };
        let mut all: Vec<_> = self.triangles.iter().map(of).collect();
        all.sort_unstable();
        all
    }
}

/// The unit vector of a code on the octahedron.
fn normal(x: i8, y: i8) -> [f64; 3] {
    let [mut x, mut y] = [x, y].map(|c| f64::from(c) / 127.0);
    let z = 1.0 - x.abs() - y.abs();
    if z < 0.0 {
        x += if x >= 0.0 { z } else { -z };
        y += if y >= 0.0 { z } else { -z };
    }
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|c| c / length)
}

/// The same oriented triangle from its smallest corner on.
fn turned<T: Ord + Copy>(t: [T; 3]) -> [T; 3] {
    let first = (0..3).min_by_key(|&i| t[i]).unwrap();
    [0, 1, 2].map(|i| t[(first + i) % 3])
}

fn lattice(position: [f32; 3]) -> [i32; 3] {
    position.map(|c| (c * 256.0) as i32)
}

/// What the library reads of pieces, see [`Mesh::drawn`].
pub fn expected(pieces: &[SurfacePiece]) -> Vec<([[i32; 3]; 3], [u32; 3])> {
    let mut all = Vec::new();
    for piece in pieces {
        let ids = [piece.ids.surface, piece.ids.cell, piece.ids.object].map(|id| id as u32);
        let corners = |t: &[u32; 3]| (turned(piece.corners(*t).map(lattice)), ids);
        all.extend(piece.triangles.iter().map(corners));
    }
    all.sort_unstable();
    all
}

fn path(entry: &TileEntry) -> String {
    let [x, y, z] = entry.grid;
    format!("/tile/0/{z}/{y}/{x}")
}

/// Compares all that is served of a tile set with the set; returns bytes of meshes and triangles.
fn compare(dir: &Path) -> [u64; 2] {
    let served = view(dir, &[]);
    let set = TileSet::open(dir).unwrap();
    let entries: Vec<TileEntry> = set.tiles().map(Result::unwrap).collect();
    let bounds = nodes(&served, &entries);
    let [mut bytes, mut triangles] = [0; 2];
    for (entry, bound) in entries.iter().zip(bounds) {
        let reply = served.get(&path(entry));
        let mesh = Mesh::read(&reply);
        let tile = set.read_tile(entry).unwrap();
        assert!(mesh.drawn() == expected(&tile.pieces), "{}", entry.path);
        let mut vertex = 0;
        for piece in &tile.pieces {
            for n in &piece.normals {
                let cosine: f64 = n
                    .iter()
                    .zip(mesh.normals[vertex])
                    .map(|(a, b)| f64::from(*a) * b)
                    .sum();
                assert!(
                    cosine > 0.9995,
                    "{}: {n:?} {:?}",
                    entry.path,
                    mesh.normals[vertex]
                );
                assert_eq!(mesh.flags[vertex], u8::from(piece.is_cap()));
                vertex += 1;
            }
        }
        assert_eq!(vertex, mesh.points.len());
        assert_eq!(mesh.shift, 0);
        let length = reply.body.len() as u64;
        assert!(
            bound == 0 || length <= bound.into(),
            "{}: {length} > {bound}",
            entry.path
        );
        bytes += length;
        triangles += mesh.triangles.len() as u64;
    }
    assert_eq!(triangles, set.manifest().totals.triangles);
    description(&served, dir, set.manifest());
    [bytes, triangles]
}

/// Compares `/tree.bin` with the tiles; returns the bytes that it tells of each.
fn nodes(served: &Served, entries: &[TileEntry]) -> Vec<u32> {
    let words = served.get("/tree.bin").words();
    assert_eq!(
        words[..4],
        [u32::from_le_bytes(*b"ALVT"), 1, entries.len() as u32, 40]
    );
    let (nodes, rest) = words[4..].as_chunks::<10>();
    assert!(rest.is_empty());
    assert_eq!(nodes.len(), entries.len());
    for (node, entry) in nodes.iter().zip(entries) {
        let [x, y, z] = entry.grid;
        assert_eq!(node[..5], [0, x, y, z, entry.triangles as u32]);
        assert_eq!(node[6..], [0, 0, 0, 1]);
    }
    nodes.iter().map(|node| node[5]).collect()
}

/// Compares `/set.json` with the manifest.
fn description(served: &Served, dir: &Path, manifest: &Manifest) {
    let told = served.json("/set.json");
    let totals = &manifest.totals;
    let index = json(&std::fs::read_to_string(dir.join("index.json")).unwrap());
    for name in [
        "spacing",
        "unit",
        "origin",
        "directions",
        "threshold",
        "cap",
        "lattice",
    ] {
        assert_eq!(told[name], index[name], "{name}");
    }
    assert_eq!(told["dims"], index["grid"]["dims"]);
    assert_eq!(told["macrocube"], index["grid"]["macrocube"]);
    for name in ["tiles", "triangles", "cells", "objects", "surfaces"] {
        assert_eq!(told[name], index["totals"][name], "{name}");
    }
    for (name, rows) in [
        ("cells", totals.cells),
        ("objects", totals.objects),
        ("surfaces", totals.surfaces),
    ] {
        let table = &told["tables"][name];
        assert_eq!(table["rows"], rows);
        let head = std::fs::read_to_string(dir.join(format!("{name}.csv"))).unwrap();
        let header = |c: &Value| match (c["name"].as_str().unwrap(), c["unit"].as_str().unwrap()) {
            (name, "") => name.to_owned(),
            (name, unit) => format!("{name} [{unit}]"),
        };
        let columns: Vec<String> = table["columns"]
            .as_array()
            .unwrap()
            .iter()
            .map(header)
            .collect();
        assert_eq!(columns.join(","), head.lines().next().unwrap());
    }
    assert_eq!(told["command"]["where"], ".");
    assert_eq!(told["gpu_memory"], 400 << 20);
}

#[test]
fn tiles_of_every_form_are_the_same_triangles() {
    for (form, more) in [
        ("blender", &[][..]),
        ("meshlab", &["--for", "meshlab"]),
        ("quantized", &["--encoding", "quantized"]),
        ("web", &["--for", "web"]),
        ("blender", &["--layout", "merged", "--cap"]),
        ("quantized", &["--encoding", "quantized", "--cap"]),
        ("meshlab", &["--for", "meshlab", "--layout", "merged"]),
    ] {
        let dir = foam_tiles(more);
        let tiles = dir.path().join("tiles");
        let [bytes, triangles] = compare(&tiles);
        // small tiles have more vertices for each triangle than those of 64 cubes
        assert!(
            bytes < 13 * triangles,
            "{form}: {bytes} bytes for {triangles} triangles"
        );
        let served = view(&tiles, &[]);
        let told = served.json("/set.json");
        if !more.contains(&"--layout") {
            assert_eq!(told["form"], form);
        }
    }
}

/// What the demo has, but smaller.
#[test]
fn a_triangle_takes_eleven_bytes_at_most() {
    let dir = tempfile::tempdir().unwrap();
    let phantom = "phantom foam foam.mhd --dims 66,66,66 --pitch 20 --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    ok(
        dir.path(),
        &[
            "convert",
            "foam.mhd",
            "tiles",
            "--threshold",
            "otsu",
            "--quiet",
        ],
    );
    let [bytes, triangles] = compare(&dir.path().join("tiles"));
    assert!(
        triangles > 10_000 && bytes <= 11 * triangles,
        "{bytes} bytes for {triangles} triangles"
    );
}

#[test]
fn parts_noise_and_empty_sets_are_served_too() {
    let dir = foam_tiles(&["--cap"]);
    let at = dir.path();
    ok(
        at,
        &[
            "select",
            "tiles",
            "part",
            "--where",
            "volume > 0.05",
            "--colour-by",
            "volume",
            "--quiet",
        ],
    );
    compare(&at.join("part"));
    ok(
        at,
        &[
            "select",
            "tiles",
            "none",
            "--where",
            "volume < 0",
            "--quiet",
        ],
    );
    let [_, triangles] = compare(&at.join("none"));
    assert_eq!(triangles, 0);
    // hundreds of pieces in a tile
    let noise = "phantom noise noise.mhd --density 0.1 --dims 26,25,24 --quiet";
    ok(at, &noise.split(' ').collect::<Vec<_>>());
    ok(
        at,
        &[
            "convert",
            "noise.mhd",
            "noise",
            "--threshold",
            "otsu",
            "--quiet",
        ],
    );
    compare(&at.join("noise"));
    // nothing is above
    ok(
        at,
        &[
            "convert",
            "foam.mhd",
            "air",
            "--threshold",
            "1000",
            "--quiet",
        ],
    );
    compare(&at.join("air"));
}

/// Steps of 16 bits do not reach over it: vertices are rounded, and in both tiles to the same place.
#[test]
fn wide_tiles_are_rounded_and_still_meet() {
    let dir = tempfile::tempdir().unwrap();
    let phantom = "phantom noise long.mhd --density 0.3 --dims 600,5,5 --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert long.mhd tiles --threshold otsu --macrocube 300 --cap --quiet";
    ok(dir.path(), &convert.split(' ').collect::<Vec<_>>());
    let tiles = dir.path().join("tiles");
    let (served, set) = (view(&tiles, &[]), TileSet::open(&tiles).unwrap());
    let mut ends = Vec::new();
    for entry in set.tiles().map(Result::unwrap) {
        let mesh = Mesh::read(&served.get(&path(&entry)));
        assert_eq!(mesh.shift, 1);
        let tile = set.read_tile(&entry).unwrap();
        let exact = tile
            .pieces
            .iter()
            .flat_map(|p| &p.positions)
            .map(|p| lattice(*p));
        let rounded = |v: i32| (v + 1) >> 1 << 1;
        let mut end = BTreeMap::new();
        for (exact, point) in exact.zip(&mesh.points) {
            assert_eq!(exact.map(rounded), *point);
            if exact[0] == 300 * 256 {
                end.insert(exact, *point);
            }
        }
        ends.push(end);
    }
    assert_eq!(ends.len(), 2);
    assert!(!ends[0].is_empty() && ends[0] == ends[1]);
}

#[test]
fn more_vertices_than_two_bytes_count_take_four() {
    let dir = tempfile::tempdir().unwrap();
    let phantom = "phantom noise noise.mhd --density 0.5 --dims 44,44,44 --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    ok(
        dir.path(),
        &[
            "convert",
            "noise.mhd",
            "tiles",
            "--threshold",
            "otsu",
            "--quiet",
        ],
    );
    let tiles = dir.path().join("tiles");
    let mesh = Mesh::read(&view(&tiles, &[]).get("/tile/0/0/0/0"));
    assert_eq!(mesh.index_bytes, 4);
    assert!(mesh.entries > mesh.triangles.len());
    compare(&tiles);
}

#[test]
fn a_tile_that_the_page_has_is_not_sent_again() {
    let dir = foam_tiles(&[]);
    let served = view(&dir.path().join("tiles"), &[]);
    let first = served.get("/tile/0/0/0/0");
    let tag = first.header("etag").unwrap().to_owned();
    assert_eq!(first.header("cache-control"), Some("no-cache"));
    let with = |tags: &str| {
        let lines = format!("{}If-None-Match: {tags}\r\n", served.lines());
        served.ask("GET", "/tile/0/0/0/0", &lines)
    };
    for tags in [tag.clone(), format!("\"other\", {tag}")] {
        let reply = with(&tags);
        assert_eq!((reply.status, reply.body.len()), (304, 0));
        assert_eq!(reply.header("etag"), Some(&tag[..]));
    }
    assert_eq!(with("\"other\"").body, first.body);
    let other = served.get("/tile/0/0/0/1");
    assert_ne!(other.header("etag"), Some(&tag[..]));
    let head = served.ask("HEAD", "/tile/0/0/0/0", &served.lines());
    assert_eq!((head.status, head.body.len()), (200, 0));
    assert_eq!(
        head.header("content-length"),
        Some(&first.body.len().to_string()[..])
    );
}

#[test]
fn tables_rows_and_queries_are_those_of_the_command() {
    let dir = foam_tiles(&["--table-unit", "um"]);
    let tiles = dir.path().join("tiles");
    let served = view(&tiles, &[]);
    for (name, options) in [
        ("cells", &[][..]),
        ("objects", &["--objects"]),
        ("surfaces", &["--surfaces"]),
    ] {
        let listed = |more: &[&str]| {
            let args = [
                &["cells", "tiles", "--json", "--top", "1000000"],
                options,
                more,
            ]
            .concat();
            json(&ok(dir.path(), &args))[name]
                .as_array()
                .unwrap()
                .clone()
        };
        let rows = listed(&[]);
        let column = |name: &str| -> Vec<f64> {
            let number = |row: &Value| match &row[name] {
                Value::Bool(set) => f64::from(u8::from(*set)),
                value => value.as_f64().unwrap_or(f64::NAN),
            };
            rows.iter().map(number).collect()
        };
        let names = ["area", "touches_border", "euler_characteristic"];
        let reply = served.get(&format!("/table/{name}?columns={}", names.join(",")));
        let words = reply.words();
        let n = rows.len();
        assert_eq!(words[..4], [u32::from_le_bytes(*b"ALVC"), 2, n as u32, 3]);
        let first = (4 + n).next_multiple_of(2);
        assert_eq!(words.len(), first + 6 * n);
        let ids: Vec<u32> = rows
            .iter()
            .map(|r| r["id"].as_u64().unwrap() as u32)
            .collect();
        assert_eq!(words[4..4 + n], ids);
        for (i, name) in names.iter().enumerate() {
            let expected: Vec<u64> = column(name).into_iter().map(f64::to_bits).collect();
            let found = words[first + 2 * i * n..][..2 * n].as_chunks::<2>().0;
            let found: Vec<u64> = found
                .iter()
                .map(|&[low, high]| u64::from(high) << 32 | u64::from(low))
                .collect();
            assert_eq!(found, expected, "{name}");
        }
        assert_eq!(served.get(&format!("/table/{name}")).words().len(), first);

        let set = TileSet::open(&tiles).unwrap();
        for row in rows.iter().step_by(3) {
            let id = row["id"].as_u64().unwrap();
            let told = served.json(&format!("/row/{name}/{id}"));
            for c in told["columns"].as_array().unwrap() {
                assert_eq!(c["value"], row[c["name"].as_str().unwrap()], "{c}");
            }
            let of = |entry: &TileEntry| {
                entry.groups.iter().any(|g| {
                    id == match name {
                        "cells" => g.cell,
                        "objects" => g.object,
                        _ => g.surface,
                    }
                })
            };
            let tiles = set.tiles().map(Result::unwrap).filter(of);
            let tiles: Vec<Value> = tiles.map(|entry| entry.grid.to_vec().into()).collect();
            assert_eq!(told["tiles"], Value::from(tiles), "{name} {id}");
        }

        for (condition, sort, descending) in [
            ("area > 100", "", false),
            ("not touches_border or area < 3000", "-area", false),
            ("", "euler_characteristic", true),
            ("area < 0", "area", false),
            ("missing(area / 0)", "sqrt(area)", true),
        ] {
            let mut more = Vec::new();
            let mut asked = format!("/query/{name}?where={}", encoded(condition));
            if !condition.is_empty() {
                more.extend(["--where", condition]);
            }
            if !sort.is_empty() {
                more.extend(["--sort", sort]);
                asked += &format!("&sort={}", encoded(sort));
            }
            if descending {
                more.push("--descending");
                asked += "&descending=1";
            }
            let expected: Vec<u32> = listed(&more)
                .iter()
                .map(|r| r["id"].as_u64().unwrap() as u32)
                .collect();
            let words = served.get(&asked).words();
            assert_eq!(
                words[..3],
                [u32::from_le_bytes(*b"ALVQ"), 1, expected.len() as u32]
            );
            assert_eq!(words[3..], expected, "{asked}");
        }
    }
    for (path, status, part) in [
        (
            "/query/cells?where=volum%3E1",
            400,
            "did you mean `volume`?",
        ),
        ("/query/cells?where=volume%3E", 400, "--where"),
        ("/query/cells?sort=nothing", 400, "--sort"),
        ("/table/cells?columns=volume,nothing", 400, "nothing"),
        (
            &format!("/table/cells?columns={}", ["id"; 65].join(",")),
            400,
            "at most",
        ),
        ("/table/nothing", 404, "nothing"),
        ("/row/cells/0", 404, "row 0"),
        ("/row/cells/1000000", 404, "1000000"),
        ("/row/cells/x", 404, "x"),
    ] {
        let reply = served.get(path);
        assert_eq!(reply.status, status, "{path}");
        assert!(reply.error().contains(part), "{path}: {}", reply.error());
    }
}

/// Samples of a slice: the numbers of `foam.raw`, x fastest.
fn slice_of(samples: &[u8], dims: [usize; 3], axis: usize, at: usize) -> Vec<u8> {
    let [right, down] = [[1, 2], [0, 2], [0, 1]][axis];
    let mut out = Vec::new();
    for v in 0..dims[down] {
        for u in 0..dims[right] {
            let mut voxel = [at; 3];
            (voxel[right], voxel[down]) = (u, v);
            out.push(samples[voxel[0] + dims[0] * (voxel[1] + dims[1] * voxel[2])]);
        }
    }
    out
}

fn decoded(reply: &Reply) -> ([u32; 2], Vec<u8>) {
    assert_eq!(reply.status, 200, "{}", reply.text());
    assert_eq!(reply.header("content-type"), Some("image/png"));
    let picture = image::load_from_memory(&reply.body).unwrap();
    assert_eq!(picture.color(), image::ColorType::L8);
    ([picture.width(), picture.height()], picture.into_bytes())
}

#[test]
fn slices_are_those_of_the_volume() {
    let dir = foam_tiles(&["--crop", "2:,:,3:30"]);
    let samples = std::fs::read(dir.path().join("foam.raw")).unwrap();
    let served = view(&dir.path().join("tiles"), &[]);
    assert_eq!(served.json("/set.json")["slices"], true);
    let (whole, dims) = ([40, 36, 32], [38, 36, 27]);
    let mut cropped = Vec::new();
    for z in 3..30 {
        for y in 0..36 {
            let row = whole[0] * (y + whole[1] * z);
            cropped.extend(&samples[row + 2..row + 40]);
        }
    }
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        for at in [0, 7, dims[axis] - 1] {
            let reply = served.get(&format!("/slice/{name}/{at}.png?low=0&high=255"));
            assert_eq!(reply.header("x-step"), Some("1"));
            let (size, grey) = decoded(&reply);
            let [right, down] = [[1, 2], [0, 2], [0, 1]][axis];
            assert_eq!(size, [dims[right] as u32, dims[down] as u32]);
            assert!(grey == slice_of(&cropped, dims, axis, at), "{name} {at}");
        }
        let outside = served.get(&format!("/slice/{name}/{}.png", dims[axis]));
        assert_eq!(outside.status, 400, "{}", outside.error());
    }
    let own = served.get("/slice/z/5.png");
    let values = slice_of(&cropped, dims, 2, 5);
    assert_eq!(
        own.header("x-low"),
        Some(&values.iter().min().unwrap().to_string()[..])
    );
    assert_eq!(
        own.header("x-high"),
        Some(&values.iter().max().unwrap().to_string()[..])
    );
    let (_, grey) = decoded(&own);
    assert!(grey.contains(&0) && grey.contains(&255));
    for path in [
        "/slice/w/0.png",
        "/slice/z/0",
        "/slice/z/a.png",
        "/slice/z/-1.png",
    ] {
        assert_eq!(served.get(path).status, 404, "{path}");
    }
}

#[test]
fn slices_are_filtered_as_the_tiles_were() {
    let dir = foam_tiles(&["--downsample", "2", "--invert"]);
    let served = view(&dir.path().join("tiles"), &[]);
    assert_eq!(
        served.json("/set.json")["filters"],
        json(r#"["downsample 2", "invert"]"#)
    );
    let samples = std::fs::read(dir.path().join("foam.raw")).unwrap();
    let (size, grey) = decoded(&served.get("/slice/z/4.png?low=0&high=255"));
    assert_eq!(size, [20, 18]);
    let mean = |x: usize, y: usize| {
        let block = (0..8).map(|i| {
            let [x, y, z] = [2 * x + i % 2, 2 * y + i / 2 % 2, 8 + i / 4];
            f64::from(samples[x + 40 * (y + 36 * z)])
        });
        255.0 - (block.sum::<f64>() / 8.0).round_ties_even()
    };
    for y in 0..18 {
        for x in 0..20 {
            assert_eq!(f64::from(grey[x + 20 * y]), mean(x, y), "{x} {y}");
        }
    }
}

/// What is outside of a region is shown as it was scanned.
#[test]
fn slices_of_a_region_are_whole() {
    let dir = foam_tiles(&["--roi", "cylinder:20,18,12"]);
    let served = view(&dir.path().join("tiles"), &[]);
    let told = served.json("/set.json");
    let region = told["region"].as_str().unwrap();
    assert!(region.contains("cylinder"), "{region}");
    let samples = std::fs::read(dir.path().join("foam.raw")).unwrap();
    let (_, grey) = decoded(&served.get("/slice/z/9.png?low=0&high=255"));
    assert!(grey == slice_of(&samples, [40, 36, 32], 2, 9));
}

#[test]
fn volumes_that_are_gone_changed_or_others_give_no_slices() {
    let dir = foam_tiles(&[]);
    let (tiles, volume) = (dir.path().join("tiles"), dir.path().join("foam.mhd"));
    let served = view(&tiles, &[]);
    assert_eq!(served.get("/slice/z/0.png").status, 200);
    // written to while it is shown, and so younger than the tiles
    let samples = dir.path().join("foam.raw");
    std::fs::write(&samples, vec![7; 40 * 36 * 32]).unwrap();
    let reply = served.get("/slice/z/0.png");
    assert_eq!(reply.status, 409, "{}", reply.error());
    let later = view(&tiles, &[]);
    assert_eq!(later.json("/set.json")["slices"], false);
    let reply = later.get("/slice/z/0.png");
    assert_eq!(reply.status, 404);
    assert!(reply.error().contains("--volume"), "{}", reply.error());
    // who names it knows what it is
    let named = view(&tiles, &["--volume", volume.to_str().unwrap()]);
    assert_eq!(named.get("/slice/z/0.png").status, 200);
    // one of another size is not that of the tiles
    let other =
        "phantom foam other.mhd --dims 40,36,33 --pitch 11 --spacing 0.05 --unit mm --quiet";
    ok(dir.path(), &other.split(' ').collect::<Vec<_>>());
    let message = super::command::fails(
        dir.path(),
        &["view", "tiles", "--no-open", "--volume", "other.mhd"],
    );
    assert!(
        message.contains("--volume") && message.contains("40 x 36 x 33"),
        "{message}"
    );
    std::fs::remove_file(&volume).unwrap();
    assert_eq!(view(&tiles, &[]).json("/set.json")["slices"], false);
}
