//! `--memory` is a promise: proved in a memory cgroup of that size where the machine lets the test make
//! one, by the peak of resident memory everywhere.
//!
//! With `ALVIS_BIG=1` a volume of 4 GiB is converted and verified inside 256 MiB as well; that takes
//! 12 GiB of disk and minutes: `ALVIS_BIG=1 cargo test --release --test memory -- --nocapture`.
#![cfg(target_os = "linux")]

mod cgroup;

use cgroup::{MIB, alvis, on_disk, report};
use serde_json::Value;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;

/// Slices after which [`lattice`] repeats.
const PITCH: u32 = 32;

/// Writes u16 samples slice by slice: balls of pore in metal on a lattice of [`PITCH`] voxels, with
/// radii that differ, each with a grain of metal inside. `first` is the place of the first slice in the
/// lattice.
fn lattice(path: &Path, [nx, ny, nz]: [u32; 3], first: u32) {
    let file = File::create(path).unwrap();
    let mut out = BufWriter::with_capacity(1 << 20, file);
    let mut row = Vec::new();
    let mut slices = Vec::new();
    for z in first..first + PITCH.min(nz) {
        let mut slice = Vec::new();
        for y in 0..ny {
            row.clear();
            for x in 0..nx {
                let ball = x / PITCH + 3 * (y / PITCH);
                let off = [x, y, z].map(|v| f64::from(v % PITCH) - f64::from(PITCH) / 2.0);
                let r = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt();
                let wall = f64::from(8 + ball % 7) - r;
                let depth = wall.min(r - 2.5);
                row.extend_from_slice(
                    &((32_768.0 - 3000.0 * depth.clamp(-5.0, 5.0)) as u16).to_le_bytes(),
                );
            }
            slice.extend_from_slice(&row);
        }
        slices.push(slice);
    }
    for z in 0..nz {
        out.write_all(&slices[(z % PITCH) as usize]).unwrap();
    }
    out.flush().unwrap();
}

fn convert<'a>(input: &'a str, out: &'a str, dims: &'a str, memory: &'a str) -> Vec<&'a str> {
    let mut args = vec![
        "convert",
        input,
        out,
        "--threshold",
        "32768",
        "--quiet",
        "--json",
    ];
    args.extend([
        "--dims",
        dims,
        "--dtype",
        "u16",
        "--memory",
        memory,
        "--threads",
        "2",
    ]);
    args
}

const VERIFY: [&str; 6] = ["verify", "out", "--quiet", "--json", "--threads", "2"];

/// Converts a volume that is larger than the limit in a form, and verifies it; returns where it is.
fn larger_than(limit: u64, form: &[&str]) -> tempfile::TempDir {
    let dir = on_disk();
    lattice(&dir.path().join("a.raw"), [512, 512, 160], 0);
    assert!(fs::metadata(dir.path().join("a.raw")).unwrap().len() > limit);
    let memory = limit.to_string();
    let mut args = convert("a.raw", "out", "512,512,160", &memory);
    args.extend(form);
    let made = report(dir.path(), Some(limit), &args);
    let peak = made["peak_rss_bytes"].as_u64().unwrap();
    assert!(peak <= limit, "{form:?} {made}");
    assert_eq!(made["cells"], 16 * 16 * 5);
    assert_eq!(made["objects"], 16 * 16 * 5 + 1);
    assert_eq!(report(dir.path(), Some(limit), &VERIFY)["ok"], true);
    dir
}

#[test]
fn a_volume_larger_than_the_limit_stays_inside_it() {
    let limit = 64 * MIB;
    let dir = larger_than(limit, &[]);
    let against = [&VERIFY[..], &["--against", "a.raw"]].concat();
    assert_eq!(report(dir.path(), Some(limit), &against)["ok"], true);
}

/// Inputs, and the filters that they go through: a stream is read forward, which keeps whole slices.
const FILTERED: [(&str, &str); 5] = [
    ("a.raw", "--smooth 1"),
    ("a.raw.gz", "--smooth 1 --downsample 2"),
    ("a.raw", "--median 1 --downsample 2"),
    ("a.raw", "--clamp 25000,40000 --invert"),
    ("a.raw", "--downsample 2"),
];

/// What filters keep is counted, so the smallest limit that is named works, however far they read.
#[test]
fn filters_stay_inside_the_limit() {
    let dir = on_disk();
    let raw = dir.path().join("a.raw");
    lattice(&raw, [768, 192, 48], 0);
    let file = File::create(dir.path().join("a.raw.gz")).unwrap();
    let mut packed = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
    packed.write_all(&fs::read(&raw).unwrap()).unwrap();
    packed.finish().unwrap();
    for (input, filters) in FILTERED {
        let args = |memory| {
            let mut args = convert(input, "out", "768,192,48", memory);
            args.extend(filters.split(' ').chain(["--force"]));
            args
        };
        let smallest = named_limit(dir.path(), &args("1MiB"));
        assert!(smallest < 96 * MIB, "{filters}: {smallest}");
        let memory = smallest.to_string();
        let made = report(dir.path(), Some(smallest), &args(&memory));
        let peak = made["peak_rss_bytes"].as_u64().unwrap();
        assert!(peak <= smallest, "{filters}: {made}");
        assert!(made["cells"].as_u64().unwrap() >= 24, "{filters}: {made}");
        let against = [&VERIFY[..], &["--against", input]].concat();
        assert_eq!(report(dir.path(), None, &against)["ok"], true, "{filters}");
    }
}

/// Tiles are encoded while others are made.
#[test]
fn tiles_for_the_web_stay_inside_the_limit() {
    for form in [
        ["--for", "web"],
        ["--encoding", "quantized"],
        ["--layout", "merged"],
    ] {
        larger_than(72 * MIB, &form);
    }
}

/// Cuts raw u16 samples into compressed chunks of 64 x 64 x 64.
#[cfg(feature = "zarr")]
fn to_zarr(raw: &Path, array: &Path, dims: [usize; 3]) {
    const N: usize = 64;
    let samples = fs::read(raw).unwrap();
    fs::create_dir(array).unwrap();
    let [nx, ny, nz] = dims;
    let meta = serde_json::json!({
        "zarr_format": 2, "shape": [nz, ny, nx], "chunks": [N, N, N], "dtype": "<u2", "order": "C",
        "compressor": {"id": "zlib", "level": 1}, "fill_value": 0, "filters": null,
    });
    fs::write(array.join(".zarray"), meta.to_string()).unwrap();
    for place in 0..(nx / N) * (ny / N) * (nz / N) {
        let (i, j, k) = (
            place % (nx / N),
            place / (nx / N) % (ny / N),
            place / (nx / N) / (ny / N),
        );
        let file = File::create(array.join(format!("{k}.{j}.{i}"))).unwrap();
        let mut chunk = flate2::write::ZlibEncoder::new(file, flate2::Compression::fast());
        for row in 0..N * N {
            let at = i * N + nx * (j * N + row % N + ny * (k * N + row / N));
            chunk.write_all(&samples[2 * at..2 * (at + N)]).unwrap();
        }
        chunk.finish().unwrap();
    }
}

/// Chunks of all three axes are kept in a file, where bands and slabs share them, and not in memory.
#[cfg(feature = "zarr")]
#[test]
fn chunks_of_a_volume_larger_than_the_limit_stay_inside_it() {
    let limit = 112 * MIB;
    let dir = on_disk();
    let raw = dir.path().join("a.raw");
    lattice(&raw, [512, 512, 256], 0);
    assert!(fs::metadata(&raw).unwrap().len() > limit);
    to_zarr(&raw, &dir.path().join("a.zarr"), [512, 512, 256]);
    let memory = limit.to_string();
    let args = convert("a.raw", "plain", "512,512,256", &memory);
    report(dir.path(), Some(limit), &args);
    let mut args = convert("a.zarr", "out", "512,512,256", &memory);
    let dims = args.iter().position(|&a| a == "--dims").unwrap();
    args.drain(dims..dims + 4);
    let made = report(dir.path(), Some(limit), &args);
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit, "{made}");
    let against = [&VERIFY[..], &["--against", "a.zarr"]].concat();
    assert_eq!(report(dir.path(), Some(limit), &against)["ok"], true);
    let bytes = |set: &str, name: &str| fs::read(dir.path().join(set).join(name)).unwrap();
    assert!(bytes("out", "cells.csv") == bytes("plain", "cells.csv"));
    for (x, y, z) in [(0, 0, 0), (3, 2, 1), (7, 7, 3)] {
        let name = format!("tiles/z{z:04}/y{y:04}_x{x:04}.glb");
        assert!(bytes("out", &name) == bytes("plain", &name), "{name}");
    }
}

/// Shards of millions of chunks of a few voxels: their tables and their number are part of the plan.
#[cfg(feature = "zarr")]
#[test]
fn shards_of_tiny_chunks_stay_inside_the_limit() {
    let dir = on_disk();
    let [nx, ny, nz] = [256u64, 256, 32];
    let bytes = serde_json::json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    let meta = serde_json::json!({
        "zarr_format": 3, "node_type": "array", "shape": [nz, ny, nx], "data_type": "uint8", "fill_value": 0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [nz, ny, nx]}},
        "chunk_key_encoding": {"name": "default"},
        "codecs": [{"name": "sharding_indexed", "configuration": {
            "chunk_shape": [1, 1, 1], "codecs": bytes, "index_codecs": bytes}}],
    });
    let array = dir.path().join("a.zarr");
    fs::create_dir_all(array.join("c/0/0")).unwrap();
    fs::write(array.join("zarr.json"), meta.to_string()).unwrap();
    // one chunk of 255 at every place of a box, none elsewhere
    let count = nx * ny * nz;
    let mut shard = vec![255];
    for i in 0..count {
        let inside = [i % nx, i / nx % ny, i / nx / ny]
            .iter()
            .all(|&v| (8..24).contains(&v));
        let entry = if inside { [0, 1] } else { [u64::MAX; 2] };
        shard.extend(entry.map(u64::to_le_bytes).concat());
    }
    assert_eq!(shard.len() as u64, 1 + 16 * count);
    fs::write(array.join("c/0/0/0"), shard).unwrap();
    let args = [
        "convert",
        "a.zarr",
        "out",
        "--threshold",
        "128",
        "--quiet",
        "--json",
        "--threads",
        "2",
        "--memory",
    ];
    let refused = alvis(
        dir.path(),
        Some(256 * MIB),
        &[&args[..], &["32MiB"]].concat(),
    );
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8_lossy(&refused.stderr);
    let needed = message
        .split("works is ")
        .nth(1)
        .and_then(|m| m.split("MiB").next()?.parse::<u64>().ok())
        .map(|mebi| mebi << 20);
    let needed = needed.unwrap_or_else(|| panic!("{message}"));
    assert!(needed < 200 * MIB, "{message}");
    // the smallest limit that works does work
    let limit = needed.to_string();
    let made = report(dir.path(), Some(needed), &[&args[..], &[&limit]].concat());
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= needed, "{made}");
    assert_eq!(made["objects"], 1);
}

#[test]
fn ten_times_the_depth_takes_no_more_memory() {
    let dir = on_disk();
    let mut peaks = Vec::new();
    for dims in [[256, 256, 160], [256, 256, 1600]] {
        let input = dir.path().join("a.raw");
        lattice(&input, dims, 0);
        let text = dims.map(|n| n.to_string()).join(",");
        let mut args = convert("a.raw", "out", &text, "64MiB");
        args.push("--force");
        let made = report(dir.path(), None, &args);
        assert_eq!(made["cells"].as_u64(), Some(u64::from(dims[2]) / 32 * 64));
        let found = report(dir.path(), None, &VERIFY);
        assert_eq!(found["ok"], true);
        peaks.push([&made, &found].map(|r| r["peak_rss_bytes"].as_u64().unwrap()));
    }
    for (stage, name) in ["convert", "verify"].into_iter().enumerate() {
        let (flat, deep) = (peaks[0][stage], peaks[1][stage]);
        // two threads do not meet their largest tiles at the same time in every run, and the verifier
        // sorts the first surfaces, whose number is bounded, in memory
        let slack = if name == "verify" { 4 * MIB } else { flat / 20 };
        assert!(
            deep <= flat + slack,
            "{name}: {flat} bytes, ten times as deep {deep}"
        );
    }
}

/// Writes u8 samples, 200 where `above(x, y, z)`, else 10.
fn mask(path: &Path, [nx, ny, nz]: [u32; 3], above: impl Fn([u32; 3]) -> bool) {
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path).unwrap());
    for z in 0..nz {
        for y in 0..ny {
            let row: Vec<u8> = (0..nx)
                .map(|x| if above([x, y, z]) { 200 } else { 10 })
                .collect();
            out.write_all(&row).unwrap();
        }
    }
    out.flush().unwrap();
}

/// Converts a volume that has far more components than pixels in a slice, or components that stay open
/// to the end, inside a limit, and verifies it.
fn worst_case(dims: [u32; 3], limit: u64, above: impl Fn([u32; 3]) -> bool) -> Value {
    worst_case_as(&[], dims, limit, above)
}

/// The same in another form.
fn worst_case_as(
    form: &[&str],
    dims: [u32; 3],
    limit: u64,
    above: impl Fn([u32; 3]) -> bool,
) -> Value {
    let dir = on_disk();
    mask(&dir.path().join("a.raw"), dims, above);
    let (text, memory) = (dims.map(|n| n.to_string()).join(","), limit.to_string());
    let mut args = convert("a.raw", "out", &text, &memory);
    let dtype = args.iter().position(|&a| a == "u16").unwrap();
    args[dtype] = "u8";
    args[3..5].copy_from_slice(&["--threshold", "105"]);
    args.extend(form);
    let made = report(dir.path(), Some(limit), &args);
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit);
    assert_eq!(report(dir.path(), None, &VERIFY)["ok"], true);
    made
}

#[test]
fn a_million_specks_stay_inside_the_limit() {
    let made = worst_case([401, 401, 402], 160 * MIB, |p| p.iter().all(|v| v % 4 == 1));
    assert_eq!(made["objects"], 100 * 100 * 101);
    assert_eq!(made["surfaces"], 100 * 100 * 101);
}

#[test]
fn columns_that_join_in_the_last_slice_stay_inside_the_limit() {
    let last = 140;
    let made = worst_case([193, 193, last + 2], 128 * MIB, |[x, y, z]| {
        (x % 4 < 2 && y % 4 < 2) || z == last
    });
    assert_eq!(made["objects"], 1);
    assert_eq!(made["cells"], 2);
}

/// One path of metal that fills the volume: rows to and fro, joined at alternating ends, layer on layer.
#[test]
fn a_serpentine_is_one_object_inside_the_limit() {
    let n = 129;
    // its tiles alone have a million triangles each
    let made = worst_case([n, n, n], 224 * MIB, |[x, y, z]| {
        // rows and layers at even places, a way to the next row or layer at every odd one
        let end = |turn: u32| if turn.is_multiple_of(2) { n - 1 } else { 0 };
        match (y % 2, z % 2) {
            (0, 0) => true,
            (1, 0) => x == end((y / 2) + (z / 2)),
            (0, 1) => y == end(z / 2) && x == end(0),
            _ => false,
        }
    });
    assert_eq!(made["objects"], 1);
}

/// True for half of all voxels, at random.
fn is_noise([x, y, z]: [u32; 3]) -> bool {
    let mut h = u64::from(x) | u64::from(y) << 20 | u64::from(z) << 40;
    // the finaliser of MurmurHash3
    for factor in [0xff51_afd7_ed55_8ccd, 0xc4ce_b9fe_1a85_ec53] {
        h = (h ^ h >> 33).wrapping_mul(factor);
    }
    (h ^ h >> 33) & 1 == 0
}

/// Thousands of components to a tile, and one that spans everything.
#[test]
fn white_noise_stays_inside_the_limit() {
    let made = worst_case([320, 320, 70], 256 * MIB, is_noise);
    assert!(made["objects"].as_u64().unwrap() > 50_000, "{made}");
}

/// The same in tiles that are encoded, some before their pieces are known to be one, some after.
#[test]
fn white_noise_for_the_web_stays_inside_the_limit() {
    let made = worst_case_as(&["--for", "web"], [192, 192, 134], 320 * MIB, is_noise);
    assert!(made["objects"].as_u64().unwrap() > 30_000, "{made}");
}

/// Tiles full of specks, under limits from far too little to enough: what is not refused stays inside.
#[test]
fn a_limit_that_is_not_refused_holds() {
    let dir = on_disk();
    let above = |p| is_noise(p) && is_noise([p[1], p[2], p[0]]) && is_noise([p[2], p[0], p[1]]);
    mask(&dir.path().join("a.raw"), [129; 3], above);
    for form in [&[][..], &["--layout", "merged"], &["--for", "web"]] {
        let mut done = 0;
        for limit in (56..=120).step_by(16) {
            let limit = limit * MIB;
            let memory = limit.to_string();
            let mut args = convert("a.raw", "out", "129,129,129", &memory);
            let dtype = args.iter().position(|&a| a == "u16").unwrap();
            args[dtype] = "u8";
            args[3..5].copy_from_slice(&["--threshold", "105"]);
            args.extend(form);
            args.push("--force");
            let output = alvis(dir.path(), Some(limit), &args);
            if output.status.success() {
                let made: Value = serde_json::from_slice(&output.stdout).unwrap();
                assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit, "{made}");
                done += 1;
            } else {
                let message = String::from_utf8(output.stderr).unwrap();
                assert!(message.contains("denser than planned"), "{message}");
            }
        }
        assert!((1..5).contains(&done), "{form:?}: {done} of 5 limits");
    }
}

/// The smallest limit as the refusal of a smaller one names it.
fn named_limit(dir: &Path, args: &[&str]) -> u64 {
    let output = alvis(dir, None, args);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    let (_, rest) = message
        .split_once("the smallest limit that works is ")
        .unwrap_or_else(|| panic!("{message}"));
    let mebi = rest.split("MiB").next().unwrap().parse::<u64>().unwrap();
    mebi << 20
}

#[test]
fn one_slice_may_be_larger_than_the_limit_and_the_smallest_limit_works() {
    let dir = on_disk();
    let slice = 6016 * 4000 * 4;
    let path = dir.path().join("a.raw");
    lattice(&path, [6016, 4000, 3], 15);
    let wide: Vec<u8> = std::fs::read(&path)
        .unwrap()
        .chunks_exact(2)
        .flat_map(|v| f32::from(u16::from_le_bytes([v[0], v[1]])).to_le_bytes())
        .collect();
    std::fs::write(&path, wide).unwrap();
    let run = |memory: u64, then: &dyn Fn(&[&str]) -> Value| {
        let memory = memory.to_string();
        let mut args = convert("a.raw", "out", "6016,4000,3", &memory);
        args.extend(["--macrocube", "64,16,64"]);
        let dtype = args.iter().position(|&a| a == "u16").unwrap();
        args[dtype] = "f32";
        then(&args)
    };
    let named = |memory: u64| {
        run(memory, &|args| named_limit(dir.path(), args).into())
            .as_u64()
            .unwrap()
    };
    let smallest = named(MIB);
    assert!(smallest < slice, "{smallest} of a slice of {slice}");
    assert_eq!(named(smallest - MIB), smallest);
    assert!(!dir.path().join("out").exists());
    let made = run(smallest, &|args| report(dir.path(), Some(smallest), args));
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= smallest);
    // a pore through all three slices, and its grain, for each place of the lattice
    assert_eq!(made["surfaces"], 2 * 188 * 125);
    assert_eq!(report(dir.path(), None, &VERIFY)["ok"], true);
}

/// Runs what must succeed inside a limit; its resident memory is below that if there is no cgroup.
fn inside(dir: &Path, limit: u64, args: &[&str]) {
    let output = alvis(dir, Some(limit), args);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{args:?}: {}: {errors}",
        output.status
    );
}

/// Everything that can be done with a tile set whose volume is `a.raw`, inside a limit of its memory; to sew it
/// together takes another one.
fn all_commands(dir: &Path, limit: u64, sewn: u64, dims: &str) {
    let volume = ["--dims", dims, "--dtype", "u8"];
    let memory = sewn.to_string();
    inside(dir, sewn, &["export", "out", "a.ply", "--memory", &memory]);
    let commands: [&[&str]; 9] = [
        &["verify", "out", "--threads", "2"],
        &["verify", "out", "--threads", "2", "--against", "a.raw"],
        &["select", "out", "sel", "--where", "id > 5"],
        &["select", "out", "painted", "--colour-by", "volume"],
        &["repack", "out", "packed", "--for", "meshlab"],
        &["cells", "out", "--sort", "-volume"],
        &["cells", "out", "--summary"],
        &["info", "a.raw"],
        &[
            "preview",
            "a.raw",
            "a.png",
            "--tiles",
            "out",
            "--colour-by",
            "volume",
        ],
    ];
    for args in commands {
        let reads = ["a.raw"].iter().any(|name| args.contains(name));
        let mut args = args.to_vec();
        args.push("--quiet");
        if reads {
            args.extend(volume);
        }
        inside(dir, limit, &args);
    }
}

/// As many layers of tiles as slices: memory does not grow with their number, whatever is done with them.
#[test]
fn thousands_of_layers_stay_inside_the_limit() {
    let (dims, limit) = ([2, 2, 4096], 32 * MIB);
    let dir = on_disk();
    mask(&dir.path().join("a.raw"), dims, |[x, y, z]| {
        x == 0 && y == 0 && z % 2 == 1
    });
    let (text, memory) = (dims.map(|n| n.to_string()).join(","), limit.to_string());
    let mut args = convert("a.raw", "out", &text, &memory);
    let dtype = args.iter().position(|&a| a == "u16").unwrap();
    args[dtype] = "u8";
    args[3..5].copy_from_slice(&["--threshold", "105"]);
    args.extend(["--macrocube", "1"]);
    let made = report(dir.path(), Some(limit), &args);
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit, "{made}");
    assert_eq!(made["tiles"], 4095);
    assert_eq!(made["objects"], 2048);
    all_commands(dir.path(), limit, limit, &text);
}

/// Half a million pieces in a layer: its shard is read a tile at a time, and as many tiles at once as fit. With all
/// of it in memory, verifying took 200 MiB.
#[test]
fn a_layer_of_half_a_million_pieces_is_read_inside_the_limit() {
    let (dims, limit) = ([257, 257, 66], 96 * MIB);
    let dir = on_disk();
    mask(&dir.path().join("a.raw"), dims, |p| {
        p.iter().any(|v| v % 2 == 0)
    });
    let text = dims.map(|n| n.to_string()).join(",");
    let memory = (256 * MIB).to_string();
    let mut args = convert("a.raw", "out", &text, &memory);
    let dtype = args.iter().position(|&a| a == "u16").unwrap();
    args[dtype] = "u8";
    args[3..5].copy_from_slice(&["--threshold", "105"]);
    args.extend(["--macrocube", "32,32,64"]);
    let made = report(dir.path(), Some(256 * MIB), &args);
    assert_eq!(made["cells"], 128 * 128 * 33);
    let shard = fs::metadata(dir.path().join("out/index/z0000.json")).unwrap();
    assert!(shard.len() > limit / 3, "{}", shard.len());
    all_commands(dir.path(), limit, 128 * MIB, &text);
}

/// A tile with a node for each of very many pieces is refused in time, or stays inside the limit, as does whoever
/// verifies it.
#[test]
fn a_node_for_each_of_many_pieces_is_refused_or_stays_inside_the_limit() {
    let dir = on_disk();
    mask(&dir.path().join("a.raw"), [64; 3], |p| {
        p.iter().all(|v| v % 2 == 1)
    });
    let run = |memory: u64| {
        let memory = memory.to_string();
        let mut args = convert("a.raw", "out", "64,64,64", &memory);
        let dtype = args.iter().position(|&a| a == "u16").unwrap();
        args[dtype] = "u8";
        args[3..5].copy_from_slice(&["--threshold", "105"]);
        args.extend(["--macrocube", "128", "--layout", "nodes", "--force"]);
        alvis(dir.path(), Some(memory.parse().unwrap()), &args)
    };
    let mut limit = 96 * MIB;
    let mut refused = 0;
    let made = loop {
        let output = run(limit);
        if output.status.success() {
            break serde_json::from_slice::<Value>(&output.stdout).unwrap();
        }
        refused += 1;
        let message = String::from_utf8(output.stderr).unwrap();
        let needed = message.split_once("at least ").expect(&message).1;
        let needed = needed.split("MiB").next().unwrap().parse::<u64>().unwrap() * MIB;
        assert!(needed > limit && refused < 5, "{message}");
        limit = needed;
    };
    assert!(refused > 0, "{made}");
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit, "{made}");
    assert_eq!(made["surfaces"], 32 * 32 * 32);
    assert_eq!(report(dir.path(), Some(limit), &VERIFY)["ok"], true);
}

/// A chunk of 64 MiB in a file of HDF5: too large a chunk is refused before it is unpacked, and the limit that is
/// named instead works.
#[cfg(feature = "hdf5")]
#[test]
fn a_chunk_is_unpacked_only_inside_the_limit() {
    let dir = on_disk();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/hdf5/one_chunk.h5");
    fs::copy(fixture, dir.path().join("a.h5")).unwrap();
    let args = |memory: &'static str| {
        let mut args = vec!["convert", "a.h5", "out", "--threshold", "100", "--quiet"];
        args.extend(["--json", "--threads", "2", "--memory", memory]);
        args
    };
    let limit = 64 * MIB;
    let refused = alvis(dir.path(), Some(limit), &args("64MiB"));
    let message = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{message}");
    let smallest = named_limit(dir.path(), &args("64MiB"));
    // the chunk as it is kept, as an array, and before and after a filter
    assert!(smallest < 7 * 64 * MIB, "{smallest}");
    let memory = smallest.to_string();
    let mut all = args("64MiB");
    *all.last_mut().unwrap() = &memory;
    let made = report(dir.path(), Some(smallest), &all);
    assert!(
        made["peak_rss_bytes"].as_u64().unwrap() <= smallest,
        "{made}"
    );
    assert_eq!((&made["objects"], &made["cells"]), (&1.into(), &1.into()));
}

/// Free bytes of the file system that holds `dir`.
fn free(dir: &Path) -> u64 {
    let output = Command::new("df")
        .args(["--output=avail", "-B1"])
        .arg(dir)
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .last()
        .and_then(|l| l.trim().parse().ok())
        .unwrap_or(0)
}

#[test]
fn four_gibibytes_are_converted_and_verified_inside_256_mebibytes() {
    if std::env::var_os("ALVIS_BIG").is_none() {
        eprintln!("SKIPPED the volume of 4 GiB: set ALVIS_BIG=1 to run it");
        return;
    }
    let dir = on_disk();
    let needed = 12 << 30;
    assert!(
        free(dir.path()) >= needed,
        "{} has less than {needed} bytes free",
        dir.path().display()
    );
    let dims = [2048, 2048, 512];
    lattice(&dir.path().join("a.raw"), dims, 0);
    assert_eq!(
        fs::metadata(dir.path().join("a.raw")).unwrap().len(),
        4 << 30
    );
    let limit = 256 * MIB;
    let args = convert("a.raw", "out", "2048,2048,512", "256MiB");
    let made = report(dir.path(), Some(limit), &args);
    println!("{made:#}");
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit);
    assert_eq!(made["cells"], 64 * 64 * 16);
    let against = [&VERIFY[..], &["--against", "a.raw"]].concat();
    let found = report(dir.path(), Some(limit), &against);
    println!("{found:#}");
    assert_eq!(found["ok"], true);
    assert!(found["peak_rss_bytes"].as_u64().unwrap() <= limit);
}

/// Every process of a conversion in parts keeps the limit: work on a part takes what a conversion takes, and merges what is
/// in a slice, however many parts there are.
#[test]
fn parts_and_their_merges_stay_inside_the_limit() {
    let (limit, dims) = (48 * MIB, "320,320,161");
    let dir = on_disk();
    let here = dir.path();
    lattice(&here.join("a.raw"), [320, 320, 161], 0);
    let memory = limit.to_string();
    let mut args = convert("a.raw", "out", dims, &memory);
    args[0] = "plan";
    args.extend(["--macrocube", "64,64,8", "--parts", "20"]);
    let planned: Value = serde_json::from_slice(&alvis(here, None, &args).stdout).unwrap();
    assert!(
        planned["memory_bytes"].as_u64().unwrap() <= limit,
        "{planned}"
    );
    let merge = ["merge", "out", "--memory", &memory, "--quiet", "--json"];
    for _ in 0..4 {
        let merged = alvis(here, Some(limit), &merge);
        let told: Value = serde_json::from_slice(&merged.stdout).unwrap();
        if merged.status.code() == Some(0) {
            assert!(told["peak_rss_bytes"].as_u64().unwrap() <= limit, "{told}");
            assert_eq!(told["cells"], 10 * 10 * 5);
            return;
        }
        assert_eq!(
            (merged.status.code(), &told["parts"]),
            (Some(3), &"0-19".into())
        );
        for part in 0..20 {
            let part = part.to_string();
            let work = ["work", "out", "--part", &part, "--threads", "2", "--quiet"];
            inside(here, limit, &work);
        }
    }
    panic!("three rounds are not enough");
}
