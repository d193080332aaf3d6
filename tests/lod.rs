//! Levels of detail: laws of surfaces on random volumes, the same bytes whatever threads and memory, interrupted work,
//! options that are refused, and a broken set for each code of the verifier.

mod common;
mod lod_common;

use alvis::Error;
use alvis::convert::ConvertOptions;
use alvis::grid::Dims;
use alvis::lod::{LodOptions, LodReport, interrupted, lod};
use alvis::manifest::{Form, Primitives};
use alvis::phantom::{Foam, Phantom, Shape, render};
use alvis::progress::{Progress, Quiet};
use alvis::tile::{NodeMesh, SurfacePiece};
use alvis::tileset::TileSet;
use alvis::transform::repack::{RepackOptions, repack};
use alvis::verify::{Code, VerifyOptions, verify};
use alvis::volume::{Dtype, Volume};
use common::{assert_same_files, converted, files, options, seal, verified};
use lod_common::picture::others;
use lod_common::{Drawings, Pore};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

fn volume(shape: Shape, dims: [u64; 3]) -> Box<dyn Volume> {
    let dims = Dims::new(dims).unwrap();
    Box::new(render(&Phantom::new(shape), dims, Dtype::U8).unwrap())
}

fn made(dir: &Path, options: &LodOptions) -> LodReport {
    let options = LodOptions {
        threads: 1,
        ..*options
    };
    lod(dir, &options, &Quiet).unwrap()
}

type Point = [i32; 3];

fn point(p: [f32; 3]) -> Point {
    p.map(|v| {
        assert_eq!((v * 256.0).fract(), 0.0, "{v} is not on the lattice");
        (v * 256.0) as i32
    })
}

/// What the edges of a level say: each counted one way and against the other, by its surface; a cap's, if both is
/// wanted, with those of all others.
#[derive(Default)]
struct Edges(BTreeMap<(u64, [Point; 2]), i64>);

impl Edges {
    fn add(&mut self, pieces: &[SurfacePiece], together: bool) {
        for piece in pieces {
            let surface = if together { 0 } else { piece.ids.surface };
            for t in &piece.triangles {
                let corners = piece.corners(*t).map(point);
                for k in 0..3 {
                    let (a, b) = (corners[k], corners[(k + 1) % 3]);
                    assert_ne!(a, b, "a triangle without an area");
                    let way = if a < b { 1 } else { -1 };
                    *self.0.entry((surface, [a.min(b), a.max(b)])).or_default() += way;
                }
            }
        }
    }

    /// The edges without a mate.
    fn open(&self) -> impl Iterator<Item = [Point; 2]> {
        self.0.iter().filter(|e| *e.1 != 0).map(|e| e.0.1)
    }
}

/// Every directed edge of each level has its mate, or lies on a face of the volume that no cap closes.
fn is_closed(set: &TileSet) {
    let manifest = set.manifest();
    let end = manifest.grid.dims.0.map(|n| (n as i32 - 1) * 256);
    for level in &set.levels().unwrap().unwrap().levels {
        let mut edges = Edges::default();
        for node in set.nodes(level) {
            let mesh = set.read_node(&node.unwrap()).unwrap();
            edges.add(&mesh.pieces, manifest.cap);
        }
        assert!(!edges.0.is_empty());
        for [a, b] in edges.open() {
            let on_face = (0..3).any(|i| a[i] == b[i] && (a[i] == 0 || a[i] == end[i]));
            assert!(
                on_face && !manifest.cap,
                "level {}: {a:?} {b:?} has no mate",
                level.level
            );
        }
    }
}

/// Small volumes of any samples: every voxel on its own, where surfaces touch planes and faces in all ways.
#[test]
fn random_volumes_stay_closed_on_every_level() {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut random = move |below: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % below
    };
    for round in 0..24 {
        let dims = [(); 3].map(|()| 5 + random(9) as usize);
        let samples = (0..dims.iter().product()).map(|_| random(256) as u8);
        let volume = common::volumes::volume(dims.map(|n| n as u32), samples.collect());
        let options = ConvertOptions {
            cap: round % 3 == 0,
            threshold: [60.0, 128.0, 200.5][round % 3],
            ..options([(); 3].map(|()| 2 + random(4) as u32))
        };
        let (dir, report) = converted(&volume, &options);
        if report.totals.triangles > 0 {
            made(dir.path(), &LodOptions::default());
            is_closed(&TileSet::open(dir.path()).unwrap());
            verified(dir.path(), None);
        }
    }
}

#[test]
fn closed_surfaces_stay_closed_on_every_level() {
    let shapes = [
        (Shape::Noise { density: 0.3 }, [17, 12, 14]),
        (Shape::Noise { density: 0.5 }, [11, 15, 13]),
        (Shape::Sphere { radius: 7.0 }, [18, 18, 18]),
        (Shape::Gyroid { period: 8.0 }, [24, 20, 19]),
    ];
    for (shape, dims) in shapes {
        for (macrocube, cap) in [([4, 4, 4], false), ([8, 5, 7], true), ([3, 16, 6], true)] {
            let volume = volume(shape, dims);
            let options = ConvertOptions {
                cap,
                threshold: 128.0,
                ..options(macrocube)
            };
            let (dir, _) = converted(&*volume, &options);
            made(dir.path(), &LodOptions::default());
            is_closed(&TileSet::open(dir.path()).unwrap());
            verified(dir.path(), None);
        }
    }
}

/// A small set of many tiles, with four levels over them.
fn gyroid(primitives: Primitives) -> tempfile::TempDir {
    let volume = volume(Shape::Gyroid { period: 9.0 }, [38, 14, 15]);
    let options = ConvertOptions {
        primitives,
        ..options([4, 4, 5])
    };
    converted(&*volume, &options).0
}

#[test]
fn bytes_do_not_depend_on_threads_memory_or_interruptions() {
    let dir = gyroid(Primitives::Strips);
    let before = files(dir.path());
    let report = made(dir.path(), &LodOptions::default());
    let first = files(dir.path());
    assert_eq!((report.levels, report.triangles_by_level.len()), (5, 5));
    assert!(report.triangles_by_level.is_sorted_by(|a, b| a > b));
    assert!(report.error_by_level.is_sorted_by(|a, b| a < b));
    assert!(first.contains_key("lod/tilesets/3_z0_y0_x0.json"));
    // the tiles stay, and all but the index
    for (name, bytes) in &before {
        assert!(
            name == "index.json" || first[name] == *bytes,
            "{name} has changed"
        );
    }
    for (threads, memory) in [(3, 1 << 30), (2, 60 << 20)] {
        let options = LodOptions {
            threads,
            memory,
            force: true,
            ..LodOptions::default()
        };
        lod(dir.path(), &options, &Quiet).unwrap();
        assert_same_files(&first, &files(dir.path()), "threads and memory");
    }
    for nodes in [0, 1, 12, 21, 25] {
        let dir = gyroid(Primitives::Strips);
        let resume = LodOptions {
            threads: 1,
            resume: true,
            ..LodOptions::default()
        };
        let stop = StopsAfter(AtomicU64::new(nodes));
        let error = lod(dir.path(), &resume, &stop).unwrap_err();
        let kept = matches!(error, Error::Resumable { .. });
        assert!(kept || matches!(error, Error::Interrupted), "{error}");
        assert_eq!(interrupted(dir.path()), kept);
        // until it is done the set is as it was
        let set: BTreeMap<_, _> = files(dir.path())
            .into_iter()
            .filter(|(name, _)| !name.starts_with(".alvis-partial"))
            .collect();
        assert_same_files(&before, &set, "interrupted");
        if kept {
            let again = lod(dir.path(), &LodOptions::default(), &Quiet).unwrap_err();
            assert!(again.to_string().contains("--resume"), "{again}");
        }
        lod(dir.path(), &resume, &Quiet).unwrap();
        assert_same_files(&first, &files(dir.path()), "resumed");
    }
}

/// Asks to stop after so many nodes.
struct StopsAfter(AtomicU64);

impl Progress for StopsAfter {
    fn advance(&self, steps: u64) {
        let left = self.0.load(Ordering::Relaxed);
        self.0.store(left.saturating_sub(steps), Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

#[test]
fn levels_are_of_any_form_of_tiles_and_go_with_them() {
    let dir = gyroid(Primitives::Triangles);
    made(dir.path(), &LodOptions::default());
    verified(dir.path(), None);
    let other = tempfile::tempdir().unwrap();
    let options = RepackOptions {
        form: Form::WEB,
        force: false,
    };
    repack(dir.path(), other.path(), &options, &Quiet).unwrap();
    assert!(
        TileSet::open(other.path())
            .unwrap()
            .levels()
            .unwrap()
            .is_none()
    );
    made(other.path(), &LodOptions::default());
    verified(other.path(), None);
    // another set in its place has no levels
    let force = RepackOptions {
        force: true,
        ..options
    };
    repack(dir.path(), other.path(), &force, &Quiet).unwrap();
    assert!(!other.path().join("lod").exists() && !other.path().join("tileset.json").exists());
    verified(other.path(), None);
}

#[test]
fn what_cannot_be_is_refused_and_nothing_is_changed() {
    let dir = gyroid(Primitives::Strips);
    made(dir.path(), &LodOptions::default());
    let before = files(dir.path());
    let base = LodOptions {
        force: true,
        ..LodOptions::default()
    };
    for (options, word) in [
        (LodOptions::default(), "--force"),
        (LodOptions { ratio: 0.6, ..base }, "--ratio"),
        (
            LodOptions {
                ratio: f64::NAN,
                ..base
            },
            "--ratio",
        ),
        (
            LodOptions {
                levels: Some(1),
                ..base
            },
            "--levels",
        ),
        (
            LodOptions {
                pixel_error: 0.0,
                ..base
            },
            "--pixel-error",
        ),
        (
            LodOptions {
                pixel_error: 1e300,
                ..base
            },
            "pixels from 0.001 to 1000",
        ),
        (
            LodOptions {
                resume: true,
                ratio: 0.25,
                force: false,
                ..base
            },
            "--ratio 0.125, 5 levels",
        ),
        (
            LodOptions {
                memory: 1 << 20,
                ..base
            },
            "--memory",
        ),
    ] {
        let error = lod(dir.path(), &options, &Quiet).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
        assert_same_files(&before, &files(dir.path()), word);
    }
    // a tile that is damaged
    let tile = before
        .keys()
        .find(|name| name.starts_with("tiles/"))
        .unwrap();
    fs::write(dir.path().join(tile), "x").unwrap();
    // with more threads another node may be done first, which is kept
    let alone = LodOptions { threads: 1, ..base };
    let error = lod(dir.path(), &alone, &Quiet).unwrap_err().to_string();
    assert!(error.contains(tile), "{error}");
    assert!(!dir.path().join(".alvis-partial").exists());
}

/// A tile set whose levels are being changed: what counts and checks follows.
struct Levels<'a>(&'a Path);

impl Levels<'_> {
    fn json(&self, path: &str) -> Value {
        serde_json::from_slice(&fs::read(self.0.join(path)).unwrap()).unwrap()
    }

    fn put(&self, path: &str, value: &Value) {
        fs::write(self.0.join(path), serde_json::to_vec(value).unwrap()).unwrap();
    }

    fn edit(&self, path: &str, edit: impl FnOnce(&mut Value)) {
        let mut value = self.json(path);
        edit(&mut value);
        self.put(path, &value);
        self.stamp();
    }

    /// Makes sizes, checksums and sums agree with the files, from the nodes up.
    fn stamp(&self) {
        let crc = |bytes: &[u8]| Value::from(format!("crc32:{:08x}", crc32fast::hash(bytes)));
        let mut index = self.json("lod/index.json");
        for level in index["levels"].as_array_mut().unwrap() {
            let mut nodes = Vec::new();
            for layer in level["layers"].as_array_mut().unwrap() {
                let path = layer["path"].as_str().unwrap().to_owned();
                let mut shard = self.json(&path);
                for node in shard["nodes"].as_array_mut().unwrap() {
                    let bytes = fs::read(self.0.join(node["path"].as_str().unwrap())).unwrap();
                    node["bytes"] = bytes.len().into();
                    node["checksum"] = crc(&bytes);
                    nodes.push(node.clone());
                }
                layer["tiles"] = shard["nodes"].as_array().unwrap().len().into();
                self.put(&path, &shard);
                let bytes = fs::read(self.0.join(&path)).unwrap();
                layer["bytes"] = bytes.len().into();
                layer["checksum"] = crc(&bytes);
            }
            level["nodes"] = nodes.len().into();
            for name in [
                "triangles",
                "fin_triangles",
                "vertices",
                "border_edges",
                "bytes",
            ] {
                level[name] = nodes
                    .iter()
                    .map(|n| n[name].as_u64().unwrap())
                    .sum::<u64>()
                    .into();
            }
            for (name, of) in [
                ("error_max", "error"),
                ("curve_tolerance", "curve_gap"),
                ("fin_width", "fin_width"),
            ] {
                let all = nodes.iter().map(|n| n[of].as_f64().unwrap());
                level[name] = all.fold(0.0, f64::max).into();
            }
        }
        self.put("lod/index.json", &index);
        self.seal();
    }

    /// Makes the set's index agree with that of levels.
    fn seal(&self) {
        let bytes = fs::read(self.0.join("lod/index.json")).unwrap();
        let mut index = self.json("index.json");
        index["lod"]["bytes"] = bytes.len().into();
        index["lod"]["checksum"] = format!("crc32:{:08x}", crc32fast::hash(&bytes)).into();
        self.put("index.json", &index);
        seal::seal(self.0);
    }

    /// Changes the JSON and the binary chunk of a node's file.
    fn edit_node(&self, path: &str, edit: impl FnOnce(&mut Value, &mut Vec<u8>)) {
        let bytes = fs::read(self.0.join(path)).unwrap();
        let (mut json, bin) = common::glb::chunks(&bytes);
        let mut bin = bin.to_vec();
        edit(&mut json, &mut bin);
        let mut text = serde_json::to_vec(&json).unwrap();
        text.resize((text.len() + 28).next_multiple_of(8) - 28, b' ');
        bin.resize(bin.len().next_multiple_of(4), 0);
        let length = 28 + text.len() + bin.len();
        let word = |n: usize| (n as u32).to_le_bytes();
        let head = [
            &b"glTF"[..],
            &word(2),
            &word(length),
            &word(text.len()),
            b"JSON",
        ]
        .concat();
        let file = [&head[..], &text, &word(bin.len()), b"BIN\0", &bin].concat();
        fs::write(self.0.join(path), file).unwrap();
    }
}

/// Where bytes of a buffer view lie in the binary chunk.
fn range(json: &Value, view: usize) -> std::ops::Range<usize> {
    let view = &json["bufferViews"][view];
    let stream = &view["extensions"]["EXT_meshopt_compression"];
    let view = if stream.is_null() { view } else { stream };
    let at = |name: &str| view[name].as_u64().unwrap() as usize;
    at("byteOffset")..at("byteOffset") + at("byteLength")
}

/// Takes the last triangle out of a node's strip.
fn drop_triangle(json: &mut Value, bin: &mut [u8]) {
    let at = range(json, 2);
    let count = json["accessors"][2]["count"].as_u64().unwrap() as usize;
    let wide = json["accessors"][2]["componentType"] == 5125;
    let mut strip: Vec<u32> = meshopt::decode_index_sequence(&bin[at.clone()], count).unwrap();
    let is_drawn = |w: &[u32]| w[0] != w[1] && w[1] != w[2] && w[0] != w[2];
    while !is_drawn(&strip[strip.len() - 3..]) {
        strip.pop();
    }
    strip.pop();
    let vertices = json["accessors"][0]["count"].as_u64().unwrap() as usize;
    let stream = meshopt::encode_index_sequence(&strip, vertices).unwrap();
    assert!(stream.len() <= at.len());
    bin[at.start..at.start + stream.len()].copy_from_slice(&stream);
    json["accessors"][2]["count"] = strip.len().into();
    let view = &mut json["bufferViews"][2];
    view["byteLength"] = (strip.len() * if wide { 4 } else { 2 }).into();
    let compressed = &mut view["extensions"]["EXT_meshopt_compression"];
    compressed["byteLength"] = stream.len().into();
    compressed["count"] = strip.len().into();
    add_to_rows(json, bin, "triangles", -1);
}

/// Adds to the last row of a column of 32 bits.
fn add_to_rows(json: &Value, bin: &mut [u8], column: &str, value: i64) {
    let table = &json["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
    let view = table["properties"][column]["values"].as_u64().unwrap() as usize;
    let end = range(json, view).end;
    let old = u32::from_le_bytes(bin[end - 4..end].try_into().unwrap());
    let new = (i64::from(old) + value) as u32;
    bin[end - 4..end].copy_from_slice(&new.to_le_bytes());
}

/// Moves the corners of all fins, the last vertices of a node, inwards by so many of its steps on each side.
fn narrow_fins(json: &mut Value, bin: &mut Vec<u8>, fins: usize, less: f64) {
    let at = range(json, 0);
    let count = json["accessors"][0]["count"].as_u64().unwrap() as usize;
    let mut vertices: Vec<[u16; 4]> =
        meshopt::decode_vertex_buffer(&bin[at.clone()], count).unwrap();
    for corners in vertices[count - 4 * fins..].as_chunks_mut::<4>().0 {
        let place = |c: [u16; 4]| [0, 1, 2].map(|a| f64::from(c[a]));
        let [a, b, c, d] = corners.map(place);
        let mid = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|i| (p[i] + q[i]) / 2.0);
        let minus = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|i| p[i] - q[i]);
        let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        let (from, to) = (mid(a, b), mid(c, d));
        let along = minus(to, from);
        let long = length(along);
        let across = minus(b, a);
        let new = [
            (from, 1.0, -1.0),
            (from, 1.0, 1.0),
            (to, -1.0, -1.0),
            (to, -1.0, 1.0),
        ];
        for (corner, (end, inward, side)) in corners.iter_mut().zip(new) {
            for i in 0..3 {
                let out = along[i] / long * less * inward;
                let half = across[i] / length(across) * (length(across) / 2.0 - less) * side;
                corner[i] = (end[i] + out + half).round() as u16;
            }
        }
    }
    put_vertices(json, bin, &vertices);
}

/// Replaces the positions of a node.
fn put_vertices(json: &mut Value, bin: &mut Vec<u8>, vertices: &[[u16; 4]]) {
    let stream = meshopt::encode_vertex_buffer_level(vertices, 0, Some(0)).unwrap();
    // it may be longer than before, so it comes behind all else
    bin.resize(bin.len().next_multiple_of(8), 0);
    let compressed = &mut json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"];
    compressed["byteOffset"] = bin.len().into();
    compressed["byteLength"] = stream.len().into();
    bin.extend_from_slice(&stream);
    bin.resize(bin.len().next_multiple_of(4), 0);
    json["buffers"][0]["byteLength"] = bin.len().into();
}

/// The nodes of a shard.
fn nodes(shard: &mut Value) -> &mut Vec<Value> {
    shard["nodes"].as_array_mut().unwrap()
}

fn break_it(code: Code, set: &Levels) {
    let (root, root_shard) = ("lod/4/z0000/y0000_x0000.glb", "lod/4/z0000.json");
    match code {
        Code::LodSyntax => {
            fs::write(set.0.join("lod/index.json"), "{").unwrap();
            set.seal();
        }
        Code::LodValue => {
            let mut index = set.json("lod/index.json");
            let triangles = &mut index["levels"][0]["triangles"];
            *triangles = (triangles.as_u64().unwrap() + 1).into();
            set.put("lod/index.json", &index);
            set.seal();
        }
        Code::LodNode => {
            set.edit_node(root, |json, _| {
                json["nodes"][0]["extras"]["level"] = 3.into()
            });
            set.stamp();
        }
        Code::LodIds => {
            set.edit_node(root, |json, bin| {
                add_to_rows(json, bin, "euler_characteristic", 2)
            });
            set.stamp();
        }
        Code::LodFins => set.edit("lod/1/z0000.json", |shard| {
            let node = &mut nodes(shard)[0];
            for name in ["curve_gap", "fin_width"] {
                node[name] = (node[name].as_f64().unwrap() + 1.0).into();
            }
        }),
        Code::LodBox => set.edit(root_shard, |shard| {
            let max = &mut nodes(shard)[0]["box"]["max"][1];
            *max = (max.as_f64().unwrap() + 1.0).into();
        }),
        Code::LodError => {
            set.edit_node(root, |json, _| {
                json["nodes"][0]["extras"]["error"] = 0.001.into()
            });
            set.edit(root_shard, |shard| nodes(shard)[0]["error"] = 0.001.into());
        }
        Code::LodTileset => {
            let mut tree = set.json("tileset.json");
            let error = &mut tree["root"]["geometricError"];
            *error = (error.as_f64().unwrap() * 1.01).into();
            set.put("tileset.json", &tree);
        }
        _ => unreachable!("{code:?}"),
    }
}

fn codes(dir: &Path) -> BTreeSet<Code> {
    let options = VerifyOptions {
        threads: 1,
        ..VerifyOptions::default()
    };
    let report = verify(dir, &options, &Quiet).unwrap();
    report.issues.iter().map(|i| i.code).collect()
}

#[test]
fn each_code_of_levels_has_a_broken_set_that_yields_exactly_it() {
    let sound = gyroid(Primitives::Strips);
    made(sound.path(), &LodOptions::default());
    let all = files(sound.path());
    let mut wrong = Vec::new();
    let own = Code::ALL
        .iter()
        .filter(|code| code.name().starts_with("LOD_"));
    let others = [Code::LodCurve, Code::LodEdge, Code::LodTree];
    for &code in own.filter(|code| !others.contains(code)) {
        for (name, bytes) in &all {
            fs::write(sound.path().join(name), bytes).unwrap();
        }
        break_it(code, &Levels(sound.path()));
        let found = codes(sound.path());
        if found != BTreeSet::from([code]) {
            wrong.push(format!("{}: {found:?}", code.name()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What a tree and the entries of nodes say besides places and files is looked at, too.
#[test]
fn words_of_trees_and_counts_of_nodes_are_compared() {
    let sound = gyroid(Primitives::Strips);
    made(sound.path(), &LodOptions::default());
    let all = files(sound.path());
    let external = all.keys().find(|name| name.starts_with("lod/tilesets/"));
    let external = external.unwrap().as_str();
    let broken = |what: &str, code: Code, edit: &dyn Fn(&Levels)| {
        for (name, bytes) in &all {
            fs::write(sound.path().join(name), bytes).unwrap();
        }
        edit(&Levels(sound.path()));
        assert_eq!(codes(sound.path()), BTreeSet::from([code]), "{what}");
    };
    let in_tree = |path: &str, pointer: &str, value: Value| {
        broken(pointer, Code::LodTileset, &|set| {
            let mut tree = set.json(path);
            let at = tree.pointer_mut(pointer).unwrap();
            assert_ne!(*at, value);
            *at = value.clone();
            set.put(path, &tree);
        });
    };
    for (pointer, value) in [
        ("/asset/tilesetVersion", "crc32:00000000".into()),
        ("/extras/alvis/voxel_metres", 2.5.into()),
        ("/extras/alvis/unit", "um".into()),
        ("/extras/alvis/pixel_error", 2.0.into()),
        ("/extras/alvis/error_scale", 15.0.into()),
        ("/extras/alvis", Value::Null),
        ("/extras", Value::Null),
    ] {
        in_tree("tileset.json", pointer, value);
    }
    in_tree(external, "/asset/tilesetVersion", "other".into());
    for (path, factor) in [("tileset.json", 2.0), (external, 1.5)] {
        let error = Levels(sound.path()).json(path)["geometricError"].as_f64();
        in_tree(path, "/geometricError", (factor * error.unwrap()).into());
    }
    for edges in [0u64, 4_000_000_000] {
        broken("border_edges", Code::LodValue, &|set| {
            set.edit("lod/1/z0000.json", |shard| {
                let stated = &mut nodes(shard)[0]["border_edges"];
                assert_ne!(*stated, 0);
                *stated = edges.into();
            });
        });
    }
    broken("extras", Code::LodTileset, &|set| {
        let mut tree = set.json(external);
        tree["extras"] = serde_json::json!({"alvis": {}});
        set.put(external, &tree);
    });
    for name in ["indices", "strips"] {
        broken(name, Code::LodNode, &|set| {
            set.edit("lod/1/z0000.json", |shard| {
                let count = &mut nodes(shard)[0][name];
                *count = (count.as_u64().unwrap() + 1).into();
            });
        });
    }
}

/// What the work says, to be looked at.
#[derive(Default)]
struct Said(std::sync::Mutex<Vec<String>>);

impl Progress for Said {
    fn warn(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
}

/// Levels whose index is gone or no index are made anew if that is asked for, and only then; those that are finished need
/// no more work.
#[test]
fn levels_that_cannot_be_read_are_replaced_and_finished_ones_stay() {
    let dir = gyroid(Primitives::Strips);
    made(dir.path(), &LodOptions::default());
    let before = files(dir.path());
    let index = dir.path().join("lod/index.json");
    let force = LodOptions {
        force: true,
        ..LodOptions::default()
    };
    for breaks in 0..3 {
        match breaks {
            0 => fs::remove_file(&index).unwrap(),
            1 => fs::write(&index, "x").unwrap(),
            _ => fs::remove_dir_all(dir.path().join("lod")).unwrap(),
        }
        let error = lod(dir.path(), &LodOptions::default(), &Quiet).unwrap_err();
        assert!(error.to_string().contains("--force"), "{error}");
        made(dir.path(), &force);
        assert_same_files(&before, &files(dir.path()), "made anew");
    }
    let said = Said::default();
    let resume = LodOptions {
        resume: true,
        ..LodOptions::default()
    };
    lod(dir.path(), &resume, &said).unwrap();
    assert_same_files(&before, &files(dir.path()), "finished");
    let said = said.0.into_inner().unwrap();
    assert!(
        said.len() == 1 && said[0].contains("nothing was done"),
        "{said:?}"
    );
}

/// Levels are finished only if all of their files are there.
#[test]
fn levels_without_some_of_their_files_are_not_finished() {
    let dir = gyroid(Primitives::Strips);
    made(dir.path(), &LodOptions::default());
    let before = files(dir.path());
    let resume = LodOptions {
        resume: true,
        ..LodOptions::default()
    };
    let external = before.keys().find(|n| n.starts_with("lod/tilesets/"));
    let node = before
        .keys()
        .find(|n| n.starts_with("lod/1/") && n.ends_with(".glb"));
    for name in [
        "tileset.json",
        "lod/2/z0000.json",
        external.unwrap(),
        node.unwrap(),
    ] {
        for cut in [None, Some(1)] {
            let path = dir.path().join(name);
            match cut {
                None => fs::remove_file(&path).unwrap(),
                Some(bytes) => fs::write(&path, &before[name][..bytes]).unwrap(),
            }
            let error = lod(dir.path(), &resume, &Quiet).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("--force"), "{error}");
            fs::write(&path, &before[name]).unwrap();
        }
    }
    // a pipe is not waited for
    #[cfg(unix)]
    {
        let path = dir.path().join("tileset.json");
        fs::remove_file(&path).unwrap();
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.unwrap().success());
        let error = lod(dir.path(), &resume, &Quiet).unwrap_err().to_string();
        assert!(error.contains("tileset.json"), "{error}");
        fs::remove_file(&path).unwrap();
        fs::write(&path, &before["tileset.json"]).unwrap();
    }
    lod(dir.path(), &resume, &Quiet).unwrap();
    assert_same_files(&before, &files(dir.path()), "finished");
}

/// What has the names of levels and is of none is somebody else's.
#[test]
fn what_is_of_no_levels_is_replaced_by_force_alone() {
    let dir = gyroid(Primitives::Strips);
    for name in ["tileset.json", "lod"] {
        let path = dir.path().join(name);
        match name {
            "lod" => fs::create_dir(&path).unwrap(),
            _ => fs::write(&path, "mine").unwrap(),
        }
        let error = lod(dir.path(), &LodOptions::default(), &Quiet).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
        assert!(path.exists() && !dir.path().join(".alvis-partial").exists());
        if name == "tileset.json" {
            assert_eq!(fs::read(&path).unwrap(), b"mine");
            fs::remove_file(&path).unwrap();
        }
    }
    let force = LodOptions {
        force: true,
        ..LodOptions::default()
    };
    made(dir.path(), &force);
}

/// Begins and stops after so many nodes, as a process that is killed does.
fn stopped(dir: &Path, options: &LodOptions, nodes: u64) {
    let options = LodOptions {
        threads: 1,
        ..*options
    };
    let error = lod(dir, &options, &StopsAfter(AtomicU64::new(nodes))).unwrap_err();
    assert!(matches!(error, Error::Resumable { .. }), "{error}");
    assert!(interrupted(dir));
}

/// Finished levels that were being replaced, those of other options and of the same, are replaced by going on.
#[test]
fn replacing_levels_goes_on_in_place_of_the_finished_ones() {
    let dir = gyroid(Primitives::Strips);
    let force = LodOptions {
        force: true,
        ..LodOptions::default()
    };
    made(dir.path(), &force);
    let wanted = files(dir.path());
    let two = LodOptions {
        levels: Some(2),
        ..force
    };
    let resume = LodOptions {
        resume: true,
        ..LodOptions::default()
    };
    for old in [two, force] {
        made(dir.path(), &old);
        stopped(dir.path(), &force, 12);
        let plain = lod(dir.path(), &LodOptions::default(), &Quiet).unwrap_err();
        assert!(plain.to_string().contains("--resume"), "{plain}");
        let made = made(dir.path(), &resume);
        assert!(made.levels == 5 && made.bytes_written > 0, "{made:?}");
        assert_same_files(&wanted, &files(dir.path()), "gone on with");
    }
    // once that is done nothing is left to do
    let said = Said::default();
    lod(dir.path(), &resume, &said).unwrap();
    assert!(said.0.into_inner().unwrap()[0].contains("nothing was done"));
}

/// What is there of nodes, and when their files were written.
fn nodes_in(work: &Path) -> BTreeMap<String, std::time::SystemTime> {
    let names = files(work).into_keys().filter(|n| n.ends_with(".glb"));
    let time = |name: &String| fs::metadata(work.join(name)).unwrap().modified().unwrap();
    names.map(|name| (name.clone(), time(&name))).collect()
}

/// Nodes that are done stay, unless all are asked to be made anew: of another ratio they are refused, and whatever
/// changes no node goes on with them.
#[test]
fn finished_nodes_are_not_thrown_away() {
    let dir = gyroid(Primitives::Strips);
    let work = dir.path().join(".alvis-partial");
    let resume = LodOptions {
        threads: 1,
        resume: true,
        ..LodOptions::default()
    };
    stopped(dir.path(), &LodOptions::default(), 21);
    let done = nodes_in(&work);
    assert!(done.len() >= 20, "{}", done.len());
    let quarter = LodOptions {
        ratio: 0.25,
        ..resume
    };
    let said = lod(dir.path(), &quarter, &Quiet).unwrap_err().to_string();
    for word in ["--ratio 0.125, all", "--ratio 0.25, all", "--force"] {
        assert!(said.contains(word), "{word} in {said}");
    }
    let little = LodOptions {
        memory: 1 << 20,
        ..resume
    };
    let said = lod(dir.path(), &little, &Quiet).unwrap_err().to_string();
    assert!(said.contains("--memory"), "{said}");
    assert_eq!(nodes_in(&work), done);

    // other pixels and fewer levels
    let other = LodOptions {
        levels: Some(3),
        pixel_error: 2.0,
        ..resume
    };
    stopped(
        dir.path(),
        &LodOptions {
            levels: None,
            ..other
        },
        25,
    );
    let kept = nodes_in(&work);
    assert!(done.iter().all(|(name, time)| kept[name] == *time));
    made(dir.path(), &other);
    let found = nodes_in(dir.path());
    assert!(found.keys().all(|n| !n.starts_with("lod/3")), "{found:?}");
    assert!(
        kept.iter()
            .all(|(name, time)| found.get(name).is_none_or(|t| t == time))
    );
    verified(dir.path(), None);
    let first = files(dir.path());
    let anew = LodOptions {
        force: true,
        resume: false,
        ..other
    };
    made(dir.path(), &anew);
    assert_same_files(&first, &files(dir.path()), "gone on with");
}

/// Whoever waits for another that makes levels of the same set finds them there.
#[test]
fn two_at_a_time_make_levels_once() {
    /// Tells when the last of so many nodes is done, and takes a while then.
    struct Waits(std::sync::mpsc::Sender<()>, AtomicU64);
    impl Progress for Waits {
        fn advance(&self, _: u64) {
            if self.1.fetch_sub(1, Ordering::Relaxed) == 1 {
                self.0.send(()).unwrap();
                std::thread::sleep(std::time::Duration::from_millis(500));
            }
        }
    }
    let dir = gyroid(Primitives::Strips);
    let alone = LodOptions {
        threads: 1,
        ..LodOptions::default()
    };
    let nodes = made(dir.path(), &alone).nodes;
    let wanted = files(dir.path());
    let (ends, ending) = std::sync::mpsc::channel();
    let waits = Waits(ends, AtomicU64::new(nodes));
    let force = LodOptions {
        force: true,
        ..alone
    };
    std::thread::scope(|scope| {
        let first = scope.spawn(|| lod(dir.path(), &force, &waits).unwrap());
        ending.recv().unwrap();
        let second = lod(dir.path(), &alone, &Quiet).unwrap_err().to_string();
        assert!(second.contains("there already"), "{second}");
        first.join().unwrap();
    });
    assert_same_files(&wanted, &files(dir.path()), "made by the first");
}

/// The size is told alike by whoever makes levels and whoever finds them, and it is that of the files.
#[test]
fn nothing_is_written_where_nothing_is_done() {
    let dir = gyroid(Primitives::Strips);
    let before = files(dir.path());
    let first = made(dir.path(), &LodOptions::default());
    let is_new = |name: &str| name != "index.json" && !before.contains_key(name);
    let all = files(dir.path());
    let new = all.iter().filter(|(name, _)| is_new(name));
    let bytes: u64 = new.map(|(_, bytes)| bytes.len() as u64).sum();
    assert_eq!((first.bytes, first.bytes_written), (bytes, bytes));
    let resume = LodOptions {
        resume: true,
        ..LodOptions::default()
    };
    let again = made(dir.path(), &resume);
    assert_eq!((again.bytes, again.bytes_written), (bytes, 0));
}

/// Two balls in two nodes that share no border.
fn two_balls() -> tempfile::TempDir {
    let [nx, ny, nz] = [64usize, 24, 24];
    let mut samples = vec![0u8; nx * ny * nz];
    for (i, v) in samples.iter_mut().enumerate() {
        let p = [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f64);
        let ball = |x: f64| {
            let square: f64 = p
                .iter()
                .zip([x, 12.0, 12.0])
                .map(|(a, b)| (a - b).powi(2))
                .sum();
            9.0 - square.sqrt()
        };
        *v = (128.0 + 12.0 * ball(16.0).max(ball(48.0))).clamp(0.0, 255.0) as u8;
    }
    let volume = common::volumes::volume([64, 24, 24], samples);
    converted(&volume, &options([16, 12, 12])).0
}

#[test]
fn a_hole_in_a_node_is_found() {
    let dir = two_balls();
    made(dir.path(), &LodOptions::default());
    verified(dir.path(), None);
    let set = Levels(dir.path());
    let shard = "lod/1/z0000.json";
    let path = set.json(shard)["nodes"][0]["path"].clone();
    let mut indices = Value::Null;
    set.edit_node(path.as_str().unwrap(), |json, bin| {
        drop_triangle(json, bin);
        indices = json["accessors"][2]["count"].clone();
    });
    set.edit(shard, |shard| {
        let node = &mut nodes(shard)[0];
        let triangles = node["triangles"].as_u64().unwrap();
        node["triangles"] = (triangles - 1).into();
        node["indices"] = indices;
    });
    // what is gone lies further from the rest
    let found = codes(dir.path());
    assert!(found.contains(&Code::LodEdge), "{found:?}");
    assert!(
        found.is_subset(&[Code::LodEdge, Code::LodError].into()),
        "{found:?}"
    );
}

#[test]
fn what_no_node_stands_for_is_found() {
    let dir = two_balls();
    made(
        dir.path(),
        &LodOptions {
            levels: Some(2),
            ..LodOptions::default()
        },
    );
    verified(dir.path(), None);
    let set = Levels(dir.path());
    let mut gone = String::new();
    set.edit("lod/1/z0000.json", |shard| {
        gone = nodes(shard).remove(0)["path"].as_str().unwrap().to_owned();
    });
    fs::remove_file(dir.path().join(&gone)).unwrap();
    assert_eq!(codes(dir.path()), BTreeSet::from([Code::LodTree]));
}

/// Moves a vertex of a node, by its number in the file, along y by one step.
fn move_vertex(json: &mut Value, bin: &mut Vec<u8>, vertex: usize) {
    let at = range(json, 0);
    let count = json["accessors"][0]["count"].as_u64().unwrap() as usize;
    let mut vertices: Vec<[u16; 4]> = meshopt::decode_vertex_buffer(&bin[at], count).unwrap();
    vertices[vertex][1] ^= 1;
    put_vertices(json, bin, &vertices);
}

/// Nodes on both sides of a plane that do not decide alike: by data of the inside, by ties the other way, by another
/// tolerance. Whatever the cause, a vertex of the border lies elsewhere on one side.
#[test]
fn a_border_that_differs_on_one_side_is_found() {
    let dir = gyroid(Primitives::Strips);
    made(dir.path(), &LodOptions::default());
    let set = Levels(dir.path());
    let all = files(dir.path());
    let path = "lod/1/z0000/y0000_x0000.glb";
    let mesh = NodeMesh::read(&all[path]).unwrap();
    let points = mesh.pieces.iter().flat_map(|p| &p.positions);
    // in the plane between two nodes, and in no other
    let is_shared =
        |p: &[f32; 3]| p[0] == 8.0 && p[1] > 0.5 && p[1] < 7.5 && p[2] > 0.5 && p[2] < 9.5;
    let shared: Vec<usize> = points
        .enumerate()
        .filter(|(_, p)| is_shared(p))
        .map(|(i, _)| i)
        .collect();
    assert!(!shared.is_empty());
    for &vertex in shared.iter().take(3) {
        for (name, bytes) in &all {
            fs::write(dir.path().join(name), bytes).unwrap();
        }
        set.edit_node(path, |json, bin| move_vertex(json, bin, vertex));
        set.stamp();
        assert!(codes(dir.path()).contains(&Code::LodEdge), "{vertex}");
    }
}

#[test]
fn fins_that_are_gone_are_found() {
    let dir = gyroid(Primitives::Strips);
    made(dir.path(), &LodOptions::default());
    let set = Levels(dir.path());
    let mut shard = set.json("lod/1/z0000.json");
    let node = nodes(&mut shard)[0].clone();
    let fins = node["fin_triangles"].as_u64().unwrap() as usize / 2;
    let path = node["path"].as_str().unwrap();
    set.edit_node(path, |json, bin| {
        let count = json["accessors"][0]["count"].as_u64().unwrap() as usize;
        let mut vertices: Vec<[u16; 4]> =
            meshopt::decode_vertex_buffer(&bin[range(json, 0)], count).unwrap();
        // each shrinks to a point
        for corners in vertices[count - 4 * fins..].as_chunks_mut::<4>().0 {
            *corners = [corners[0]; 4];
        }
        put_vertices(json, bin, &vertices);
    });
    set.stamp();
    assert!(codes(dir.path()).contains(&Code::LodFins));
}

#[test]
fn a_border_that_has_moved_further_than_its_fins_reach_is_found() {
    let dir = gyroid(Primitives::Strips);
    let options = LodOptions {
        levels: Some(2),
        ..LodOptions::default()
    };
    made(dir.path(), &options);
    let set = Levels(dir.path());
    let mut shard = set.json("lod/1/z0000.json");
    let node = &mut nodes(&mut shard)[0];
    let number = |node: &Value, name: &str| node[name].as_f64().unwrap();
    // in whole lattice steps, as the width is
    let quarter = (number(node, "fin_width") * 256.0 / 4.0).floor();
    assert!(quarter > 8.0, "{quarter}");
    let step = set.json("lod/index.json")["levels"][0]["step"]
        .as_f64()
        .unwrap();
    let path = node["path"].as_str().unwrap().to_owned();
    let fins = number(node, "fin_triangles") as usize / 2;
    set.edit_node(&path, |json, bin| {
        narrow_fins(json, bin, fins, 3.0 * quarter / step)
    });
    for name in ["curve_gap", "fin_width"] {
        node[name] = (quarter / 256.0).into();
    }
    // its fins reach less far
    let mesh = NodeMesh::read(&fs::read(dir.path().join(&path)).unwrap()).unwrap();
    let points = mesh
        .pieces
        .iter()
        .chain(&mesh.fins)
        .flat_map(|p| &p.positions);
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let mut add = |p: [f64; 3]| {
        for a in 0..3 {
            bounds[0][a] = bounds[0][a].min(p[a]);
            bounds[1][a] = bounds[1][a].max(p[a]);
        }
    };
    points.for_each(|p| add(p.map(f64::from)));
    for tile in TileSet::open(dir.path()).unwrap().tiles() {
        let tile = tile.unwrap();
        if tile.grid.map(|v| v / 2) == [0; 3] {
            add(tile.bounds.min);
            add(tile.bounds.max);
        }
    }
    node["box"] = serde_json::json!({"min": bounds[0], "max": bounds[1]});
    set.put("lod/1/z0000.json", &shard);
    set.stamp();
    // corners that are rounded twice may miss the border itself as well
    assert!(codes(dir.path()).contains(&Code::LodCurve));
}

/// Pixels along the side of a picture from inside of a pore; six of them are a cube.
const SIDE: usize = 160;

/// From inside of a closed pore nothing but its wall is seen, whatever levels meet around it; and there is something to
/// see where fins are left out, or where one node decides by itself where its border lies.
#[test]
fn from_inside_of_a_pore_nothing_else_is_seen() {
    let foam = Foam {
        pitch: 24.0,
        wall: 4.0,
        ..Foam::default()
    };
    let volume = volume(Shape::Foam(foam), [80; 3]);
    let (dir, _) = converted(&*volume, &options([20; 3]));
    made(dir.path(), &LodOptions::default());
    let set = TileSet::open(dir.path()).unwrap();
    let mut drawings = Drawings::of(&set);
    let mut pores = drawings.pores([80; 3]);
    // where the nodes of level 1 meet
    pores.retain(|p| (0..3).any(|a| p.low[a] < 39.0 && p.high[a] > 41.0));
    pores.truncate(7);
    let mut state = 88_172_645_463_325_252_u64;
    let mut coin = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.is_multiple_of(2)
    };
    let (mut wrong, mut pixels, mut without) = (0, 0, 0);
    for (i, pore) in pores.iter().enumerate() {
        let cut = drawings.cut(|(level, _)| level == 2 || coin());
        let seen = |fins: bool, side: usize| {
            others(
                &drawings.scene(&cut, pore, fins),
                pore.middle,
                pore.cell,
                side,
            )
        };
        wrong += seen(true, SIDE);
        pixels += 6 * SIDE * SIDE;
        if i < 4 {
            without += seen(false, SIDE);
        }
    }
    assert!(pixels > 1_000_000, "{pixels}");
    assert!(wrong <= 1, "{wrong} of {pixels} pixels show no wall");
    assert!(without > 10, "nothing is seen where fins are left out");

    let is_cut = |p: &&Pore| p.low[0] < 36.0 && p.high[0] > 44.0;
    let pore = pores.iter().find(is_cut).expect("a pore on both sides");
    let grid = pore.middle.map(|v| (v / 40.0) as u32);
    drawings.place_by_inside((1, [0, grid[1], grid[2]]), 0, 40.0);
    let cut = drawings.cut(|(level, _)| level == 2);
    let scene = drawings.scene(&cut, pore, true);
    let moved = others(&scene, pore.middle, pore.cell, SIDE);
    assert!(moved > 10, "{moved}");
}
