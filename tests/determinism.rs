//! The result depends on the volume and on nothing else: not on threads, on memory, on the cut into
//! macrocubes beyond the cut itself, on the kind of primitives, nor on what lies outside a crop.

mod common;
mod volume_common;

use alvis::convert::{ConvertOptions, convert, predicted_memory};
use alvis::grid::{Ambiguous, Crop, Dims};
use alvis::manifest::{Encoding, Layout, Primitives};
use alvis::progress::Quiet;
use alvis::volume::{MemoryVolume, OpenOptions, Volume, Voxel, open};
use common::glb;
use common::set::{Surface, Table, manifest, shards, table, weld};
use common::volumes::{foam, late_joins, noise, placed, samples};
use common::{assert_same_files, converted, files, options, verified};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use volume_common::data;

/// The smallest memory limit of every plan: one band at once, two, ... one for each thread, with tiles on their way to
/// the disk meanwhile and without.
fn limits(volume: &dyn Volume, options: &ConvertOptions) -> Vec<u64> {
    let with = |memory: u64| {
        predicted_memory(
            volume,
            &ConvertOptions {
                memory,
                ..options.clone()
            },
        )
    };
    let smallest = match with(1) {
        Err(alvis::Error::Memory { needed, .. }) => needed,
        other => panic!("{other:?}"),
    };
    assert!(with(smallest - 1).is_err());
    let largest = with(1 << 40).unwrap();
    let mut limits = vec![smallest];
    for limit in (smallest..largest).step_by(512).chain([largest]) {
        let predicted = with(limit).unwrap();
        assert!(predicted <= limit);
        if predicted > *limits.last().unwrap() {
            limits.push(predicted);
        }
    }
    limits
}

/// Converts within a limit. Dense noise has more triangles in a tile than are planned for: then the
/// limit is refused, nothing is left, and the one that the refusal names is tried.
fn converted_within<T: Voxel>(
    volume: &MemoryVolume<T>,
    options: &ConvertOptions,
) -> BTreeMap<String, Vec<u8>> {
    let mut options = options.clone();
    for _ in 0..400 {
        let dir = tempfile::tempdir().unwrap();
        match convert(volume, &options, dir.path(), &Quiet) {
            Ok(_) => return files(dir.path()),
            Err(
                alvis::Error::Memory { limit, needed, .. }
                | alvis::Error::TooDense { limit, needed, .. },
            ) => {
                assert!(
                    limit == options.memory && needed > limit,
                    "{limit} {needed}"
                );
                // what is kept of layers that fitted lies apart
                let kept = |name: &String| name.starts_with(".alvis-partial/");
                assert!(files(dir.path()).keys().all(kept));
                options.memory = needed;
            }
            Err(e) => panic!("{e}"),
        }
    }
    panic!("no limit that is named works: {options:?}");
}

/// Converts in many ways and expects the same bytes; returns the files.
fn same_in_every_way<T: Voxel>(
    volume: &MemoryVolume<T>,
    options: &ConvertOptions,
) -> BTreeMap<String, Vec<u8>> {
    let (dir, _) = converted(volume, options);
    verified(dir.path(), Some(volume));
    let first = files(dir.path());
    let tiles = |axis: usize| {
        let cubes = volume.header().dims.0[axis].saturating_sub(1);
        cubes.div_ceil(options.macrocube[axis]) as usize
    };
    let bands = tiles(1) * tiles(2);
    for threads in [1, 2, 5] {
        let options = ConvertOptions {
            threads,
            ..options.clone()
        };
        let limits = limits(volume, &options);
        // each number of bands at once, up to one for each thread, and all with tiles on their way to the disk
        assert!(limits.len() > bands.min(threads), "{limits:?}");
        let mut chosen: Vec<usize> = (0..limits.len()).collect();
        if threads == 5 {
            // they take as long as all others
            chosen.drain(1..limits.len() - 1);
        }
        for at in chosen {
            let options = ConvertOptions {
                memory: limits[at],
                ..options.clone()
            };
            let what = format!("{threads} threads, limit {at} of {limits:?}");
            assert_same_files(&first, &converted_within(volume, &options), &what);
        }
    }
    let (again, _) = converted(volume, options);
    assert_same_files(&first, &files(again.path()), "a second run");
    first
}

#[test]
fn threads_memory_and_repetition_change_no_byte() {
    let dims = [70, 61, 45];
    let volume = placed(dims, foam(dims, 1));
    for primitives in [Primitives::Strips, Primitives::Triangles] {
        for (ambiguous, cap) in [(Ambiguous::Separate, true), (Ambiguous::Join, false)] {
            let options = ConvertOptions {
                primitives,
                ambiguous,
                cap,
                ..options([16, 9, 11])
            };
            let files = same_in_every_way(&volume, &options);
            assert!(files.len() > 100, "{}", files.len());
        }
    }
}

#[test]
fn wide_integers_and_floats_are_as_deterministic() {
    let dims = [33, 40, 21];
    let bytes = foam(dims, 2);
    let floats = bytes.iter().enumerate().map(|(i, &v)| match i % 97 {
        0 => f32::NAN,
        1 => f32::INFINITY,
        _ => f32::from(v) * 1.1 - 13.0,
    });
    same_in_every_way(
        &placed(dims, floats.collect::<Vec<f32>>()),
        &options([8; 3]),
    );
    let wide = bytes
        .iter()
        .map(|&v| i32::from(v) * 1_000_003 - 90_000_000)
        .collect();
    let options = ConvertOptions {
        threshold: 40_000_000.5,
        ..options([8; 3])
    };
    same_in_every_way(&placed(dims, wide), &options);
}

#[test]
fn tiles_that_go_past_the_page_cache_are_as_deterministic() {
    let dims = [101, 61, 81];
    let volume = placed(dims, foam(dims, 5));
    let mut options = options([50, 60, 40]);
    let made = same_in_every_way(&volume, &options);
    let long = |name: &&String| name.ends_with(".glb") && made[*name].len() > 256 << 10;
    assert_eq!(made.keys().filter(long).count(), 4);
    // temporary files may lie in memory; what lies beside the build is more often on a disk
    for threads in [1, 2] {
        options.threads = threads;
        let dir = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        convert(&volume, &options, dir.path(), &Quiet).unwrap();
        assert_same_files(&made, &files(dir.path()), "on the disk");
    }
}

#[test]
fn tiles_of_more_than_500_pieces_are_merged_and_as_deterministic() {
    let dims = [31, 30, 29];
    // one voxel in ten is above: about a thousand objects in a tile
    let sparse = noise(dims, 3)
        .into_iter()
        .map(|v| if v < 26 { 255 - v } else { v / 2 })
        .collect();
    let volume = placed(dims, sparse);
    for primitives in [Primitives::Strips, Primitives::Triangles] {
        let options = ConvertOptions {
            primitives,
            ..options([64; 3])
        };
        let files = same_in_every_way(&volume, &options);
        let (doc, _) = glb::chunks(&files["tiles/z0000/y0000_x0000.glb"]);
        assert_eq!(doc["meshes"][0]["name"], "cells");
        let text = String::from_utf8(files["index/z0000.json"].clone()).unwrap();
        let shard: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(shard["tiles"][0]["groups"].as_array().unwrap().len() > 500);
    }
    same_in_every_way(
        &volume,
        &ConvertOptions {
            cap: true,
            ..options([31, 15, 14])
        },
    );
}

#[test]
fn tiles_that_are_encoded_are_as_deterministic() {
    let dims = [70, 61, 45];
    let foam = placed(dims, foam(dims, 6));
    let (dims, values) = late_joins();
    let joins = placed(dims, values);
    let dims = [25, 24, 26];
    let noise = placed(dims, noise(dims, 7));
    for (encoding, layout, primitives) in [
        (Encoding::Meshopt, Layout::Merged, Primitives::Strips),
        (Encoding::Meshopt, Layout::Auto, Primitives::Triangles),
        (Encoding::Quantized, Layout::Nodes, Primitives::Strips),
        (Encoding::Float, Layout::Merged, Primitives::Triangles),
    ] {
        let options = |macrocube| ConvertOptions {
            encoding,
            layout,
            primitives,
            cap: true,
            ..options(macrocube)
        };
        same_in_every_way(&foam, &options([40, 30, 11]));
        // tiles are written anew, as often as they are expected to be and more seldom
        same_in_every_way(&joins, &options([9, 6, 4]));
        same_in_every_way(&noise, &options([8, 8, 9]));
    }
}

#[test]
fn pieces_that_join_in_later_slabs_get_one_id() {
    let (dims, values) = late_joins();
    let above: Vec<bool> = values.iter().map(|&v| v >= 128).collect();
    let volume = placed(dims, values);
    let size = dims.map(|n| n as usize);
    for ambiguous in [Ambiguous::Separate, Ambiguous::Join] {
        let expected = common::reference::components(size, &above, ambiguous);
        for macrocube in [[5, 4, 3], [64, 64, 2], [7, 64, 10], [64; 3]] {
            let options = ConvertOptions {
                ambiguous,
                ..options(macrocube)
            };
            let (dir, report) = converted(&volume, &options);
            verified(dir.path(), Some(&volume));
            assert_eq!((report.totals.objects, report.totals.cells), expected);
        }
        same_in_every_way(
            &volume,
            &ConvertOptions {
                ambiguous,
                ..options([9, 6, 4])
            },
        );
    }
}

#[test]
fn one_voxel_in_two_of_noise_is_as_deterministic() {
    let dims = [26, 25, 27];
    let volume = placed(dims, noise(dims, 4));
    for ambiguous in [Ambiguous::Separate, Ambiguous::Join] {
        same_in_every_way(
            &volume,
            &ConvertOptions {
                ambiguous,
                cap: true,
                ..options([7, 8, 9])
            },
        );
    }
}

/// What does not depend on the cut: the welded surface with ids, and the tables.
struct Result {
    surface: Surface,
    tables: [Table; 3],
}

const TABLES: [&str; 3] = ["cells.csv", "objects.csv", "surfaces.csv"];

fn result<T: Voxel>(volume: &MemoryVolume<T>, options: &ConvertOptions) -> Result {
    let (dir, report) = converted(volume, options);
    verified(dir.path(), Some(volume));
    let surface = weld(dir.path());
    let m = manifest(dir.path());
    assert_eq!(m.totals, report.totals);
    assert_eq!(surface.normals.len() as u64, m.totals.vertices);
    assert_eq!(surface.euler(), m.totals.euler_characteristic);
    // tables count the tiles that each id is in
    let tables = TABLES.map(|name| table(dir.path(), name));
    for (table, column) in tables.iter().zip([0, 1, 2]) {
        let mut tiles = vec![0i64; table.rows.len() + 1];
        for entry in shards(dir.path()).iter().flat_map(|s| &s.tiles) {
            let ids = entry
                .groups
                .iter()
                .filter(|g| g.cell > 0)
                .map(|g| [g.cell, g.object, g.surface][column]);
            let ids: std::collections::BTreeSet<u64> = ids.collect();
            ids.into_iter().for_each(|id| tiles[id as usize] += 1);
        }
        let stated: Vec<i64> = table.column("tiles").map(|v| v.parse().unwrap()).collect();
        assert_eq!(stated, tiles[1..]);
    }
    Result {
        surface,
        tables: tables.map(|t| t.without("tiles")),
    }
}

fn same_for_every_cut<T: Voxel>(volume: &MemoryVolume<T>, cuts: &[[u32; 3]], cap: bool) {
    let whole = ConvertOptions {
        cap,
        ..options([u32::MAX; 3])
    };
    let expected = result(volume, &whole);
    assert!(expected.surface.triangles.len() > 1000);
    for &macrocube in cuts {
        for primitives in [Primitives::Strips, Primitives::Triangles] {
            let options = ConvertOptions {
                macrocube,
                primitives,
                ..whole.clone()
            };
            let found = result(volume, &options);
            assert!(found.surface == expected.surface, "{macrocube:?}");
            assert_eq!(found.tables, expected.tables, "{macrocube:?}");
        }
    }
}

#[test]
fn the_welded_surface_does_not_depend_on_macrocubes() {
    let small = [11, 9, 12];
    for cap in [false, true] {
        same_for_every_cut(
            &placed(small, foam(small, 5)),
            &[[1; 3], [5, 7, 3], [2, 1, 11]],
            cap,
        );
        same_for_every_cut(&placed(small, noise(small, 6)), &[[1; 3], [5, 7, 3]], cap);
    }
    let large = [90, 70, 66];
    same_for_every_cut(
        &placed(large, foam(large, 7)),
        &[[16; 3], [64; 3], [5, 70, 13]],
        true,
    );
    let (dims, values) = late_joins();
    same_for_every_cut(&placed(dims, values), &[[5, 7, 3], [16; 3]], false);
}

#[test]
fn a_crop_is_a_volume_of_its_own() {
    let dims = [40, 35, 30];
    let values = foam(dims, 8);
    let whole = placed(dims, values.clone());
    let crop = Crop {
        x: 3..31,
        y: 10..35,
        z: 0..22,
    };
    let (start, size) = (crop.start(), crop.dims_in(Dims(dims)).unwrap());
    let inner = samples(size.0, |p| {
        let at: [u32; 3] = std::array::from_fn(|a| p[a] + start[a]);
        values[Dims(dims).linear(at) as usize]
    });
    let place = whole.header().placement.shifted(start);
    let part = MemoryVolume::new(size, place, inner).unwrap();
    for cap in [false, true] {
        let plain = ConvertOptions {
            cap,
            ..options([10, 12, 9])
        };
        let cropped = ConvertOptions {
            crop: Some(crop.clone()),
            ..plain.clone()
        };
        let (a, _) = converted(&whole, &cropped);
        let (b, _) = converted(&part, &plain);
        verified(a.path(), Some(&part));
        let (mut a, mut b) = (files(a.path()), files(b.path()));
        let index = |files: &mut BTreeMap<String, Vec<u8>>| -> serde_json::Value {
            serde_json::from_slice(&files.remove("index.json").unwrap()).unwrap()
        };
        let (mut ia, mut ib) = (index(&mut a), index(&mut b));
        assert_same_files(&a, &b, "a crop");
        assert_eq!(ia["source"]["dims"], serde_json::json!(dims));
        assert!(ia["source"].get("crop").is_some() && ib["source"].get("crop").is_none());
        for i in [&mut ia, &mut ib] {
            let members = i.as_object_mut().unwrap();
            members.remove("source");
            // the index's own, which covers the source
            assert!(members.remove("checksum").is_some());
        }
        assert_eq!(ia, ib);
    }
}

/// Converts a volume whole, and from macrocube layer `layer` on, and expects the pieces that are the same triangles in
/// both to have them in the same order, and the same normals but in the first layer, whose lower gradients miss a
/// slice. Returns how many are the same, and how many there are.
fn same_from_layer(volume: &dyn Volume, options: &ConvertOptions, layer: u32) -> [usize; 2] {
    let [nx, ny, nz] = volume.header().dims.0;
    let first = layer * options.macrocube[2];
    let cropped = ConvertOptions {
        crop: Some(Crop {
            x: 0..nx,
            y: 0..ny,
            z: first..nz,
        }),
        ..options.clone()
    };
    let [whole, part] = [options, &cropped].map(|options| {
        let dir = tempfile::tempdir().unwrap();
        convert(volume, options, dir.path(), &Quiet).unwrap();
        files(dir.path())
    });
    let (mut same, mut all) = (0, 0);
    for (name, bytes) in part.iter().filter(|(name, _)| name.ends_with(".glb")) {
        let (z, rest) = name.strip_prefix("tiles/z").unwrap().split_at(4);
        let z: u32 = z.parse().unwrap();
        let mut known = HashMap::new();
        for piece in glb::read(&whole[&format!("tiles/z{:04}{rest}", z + layer)]) {
            let mut key = piece.triangles.clone();
            key.sort_unstable();
            known.insert(key, piece);
        }
        for mut piece in glb::read(bytes) {
            let up = |p: [i32; 3]| [p[0], p[1], p[2] + (256 * first) as i32];
            piece.triangles.iter_mut().for_each(|t| *t = t.map(up));
            let mut key = piece.triangles.clone();
            key.sort_unstable();
            all += 1;
            if let Some(before) = known.get(&key) {
                same += 1;
                assert!(piece.triangles == before.triangles, "{name}");
                let normal_is_same = |(at, n): (&[i32; 3], _)| before.normals[&up(*at)] == n;
                let same_normals = piece.normals.iter().all(|(at, n)| normal_is_same((at, *n)));
                assert!(z == 0 || same_normals, "{name}");
            }
        }
    }
    [same, all]
}

/// What lies before a tile does not show in its pieces, in porous volumes least of all.
#[test]
fn pieces_do_not_depend_on_what_lies_before() {
    let mut found = Vec::new();
    let dims = [70, 60, 64];
    for (seed, macrocube) in [(1, [16; 3]), (2, [9, 33, 8])] {
        let plain = options(macrocube);
        found.push(same_from_layer(&placed(dims, foam(dims, seed)), &plain, 2));
        found.push(same_from_layer(&placed(dims, noise(dims, seed)), &plain, 1));
    }
    let (dims, values) = late_joins();
    found.push(same_from_layer(&placed(dims, values), &options([8; 3]), 2));
    if let Some(data) = data() {
        for (path, threshold) in [
            ("derived/snow_be.nhdr", 22_779.0),
            ("derived/cement_lzw_be.tif", 75.0),
        ] {
            let volume = open(&data.join(path), &OpenOptions::default())
                .unwrap()
                .volume;
            let plain = ConvertOptions {
                threshold,
                ..options([16; 3])
            };
            found.push(same_from_layer(&*volume, &plain, 1));
        }
    }
    // where components are joined before the part, more is one piece in the whole
    for [same, all] in &found {
        assert!(*same > 100.min(all / 2) && 4 * same > 3 * all, "{found:?}");
    }
}

/// Processors without wide vectors and bit counting take other instructions, to the same bytes.
/// Writes u16 samples as PNG slices, as a compressed stream, and in compressed chunks.
fn packed(dir: &Path, [nx, ny, nz]: [usize; 3], samples: &[u16]) -> Vec<PathBuf> {
    let slices = dir.join("slices");
    std::fs::create_dir(&slices).unwrap();
    for (k, slice) in samples.chunks_exact(nx * ny).enumerate() {
        let path = slices.join(format!("{k:03}.png"));
        let slice = bytemuck::cast_slice(slice);
        let (w, h) = (nx as u32, ny as u32);
        image::save_buffer(path, slice, w, h, image::ExtendedColorType::L16).unwrap();
    }
    let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
    let stream = dir.join("a.nrrd");
    let mut file = File::create(&stream).unwrap();
    let head = format!(
        "NRRD0004\ntype: uint16\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\nencoding: gzip\n\n"
    );
    file.write_all(head.as_bytes()).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
    gzip.write_all(&bytes).unwrap();
    gzip.finish().unwrap();
    let mut all = vec![slices, stream];
    if cfg!(feature = "zarr") {
        let array = dir.join("a.zarr");
        std::fs::create_dir(&array).unwrap();
        let shape = [20, 30, 100];
        let meta = serde_json::json!({
            "zarr_format": 2, "shape": [nz, ny, nx], "chunks": shape, "dtype": "<u2", "order": "C",
            "compressor": {"id": "zlib", "level": 1}, "fill_value": 0, "filters": null,
        });
        std::fs::write(array.join(".zarray"), meta.to_string()).unwrap();
        let [cz, cy, cx] = shape;
        for (k, j, i) in (0..nz.div_ceil(cz)).flat_map(|k| {
            (0..ny.div_ceil(cy)).flat_map(move |j| (0..nx.div_ceil(cx)).map(move |i| (k, j, i)))
        }) {
            let file = File::create(array.join(format!("{k}.{j}.{i}"))).unwrap();
            let mut chunk = flate2::write::ZlibEncoder::new(file, flate2::Compression::fast());
            for row in 0..cz * cy {
                let (y, z) = (j * cy + row % cy, k * cz + row / cy);
                let mut line = vec![0; 2 * cx];
                if y < ny && z < nz {
                    let at = 2 * (i * cx + nx * (y + ny * z));
                    let len = 2 * cx.min(nx - i * cx);
                    line[..len].copy_from_slice(&bytes[at..at + len]);
                }
                chunk.write_all(&line).unwrap();
            }
            chunk.finish().unwrap();
        }
        all.push(array);
    }
    all
}

/// Larger than what is kept in memory of packed volumes, so that they are unpacked into files: pages and chunks
/// as the sweep comes to them, streams ahead of it.
#[test]
fn the_tiles_do_not_depend_on_how_the_volume_is_packed() {
    let dims = [384, 170, 140];
    let ball = |[x, y, z]: [u32; 3]| {
        let off = [x, y, z].map(|v| f64::from(v % 20) - 9.3);
        let r = off.iter().map(|v| v * v).sum::<f64>().sqrt();
        let radius = f64::from(2 + (x / 20 + 3 * (y / 20) + 5 * (z / 20)) % 9);
        (30_000.0 + 2_000.0 * (r - radius).clamp(-6.0, 6.0)) as u16
    };
    let samples = samples(dims, ball);
    assert!(2 * samples.len() > 17 << 20);
    let dir = tempfile::tempdir().unwrap();
    let inputs = packed(dir.path(), dims.map(|n| n as usize), &samples);
    let plain = common::volumes::volume(dims, samples);
    let part = Crop {
        x: 5..300,
        y: 3..160,
        z: 7..133,
    };
    for (threads, min_voxels, crop) in [(1, 0, None), (3, 200, None), (2, 0, Some(part))] {
        let options = ConvertOptions {
            threshold: 30_000.0,
            threads,
            min_voxels,
            crop,
            ..options([64; 3])
        };
        let of = |volume: &dyn Volume| {
            let (dir, report) = converted(volume, &options);
            assert!(report.totals.cells > 50, "{}", report.totals.cells);
            let mut files = files(dir.path());
            files.remove("index.json");
            files
        };
        let known = of(&plain);
        assert!(known.len() > 30);
        for input in &inputs {
            let opened = open(input, &OpenOptions::default()).unwrap();
            assert_same_files(&known, &of(&*opened.volume), &input.display().to_string());
        }
    }
}

#[test]
fn the_portable_way_makes_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let alvis = |portable: &str, args: &[&str]| {
        let status = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
            .args(args)
            .arg("--quiet")
            .current_dir(dir.path())
            .env("ALVIS_PORTABLE", portable)
            .status();
        assert!(status.unwrap().success(), "{args:?}");
    };
    for (dtype, noise, threshold) in [
        ("u8", "0.3", "127.5"),
        ("i16", "0.1", "0"),
        ("u16", "0", "32767.5"),
        ("f32", "0.2", "0.5"),
        ("f64", "0", "0.5"),
    ] {
        let kind = ["--dtype", dtype, "--dims", "150,71,83"];
        let make = ["phantom", "foam", "a.raw", "--noise", noise, "--force"];
        alvis("0", &[&make[..], &kind].concat());
        for more in [&[][..], &["--ambiguous", "join", "--cap"]] {
            let sets = ["0", "1"].map(|portable| {
                let args = [
                    "convert",
                    "a.raw",
                    portable,
                    "--force",
                    "--threshold",
                    threshold,
                ];
                alvis(portable, &[&args[..], &kind, more].concat());
                files(&dir.path().join(portable))
            });
            assert!(sets[0].len() > 4);
            assert_same_files(&sets[0], &sets[1], dtype);
        }
    }
}
