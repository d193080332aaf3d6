//! Tile sets and files from somebody who means harm: no panic, nothing read outside the directory, no
//! memory beyond what the files' sizes allow, no waiting.

#[path = "mutations/random.rs"]
mod random;

#[path = "common/seal.rs"]
mod seal;

use alvis::convert::{ConvertOptions, convert};
use alvis::export::{ExportOptions, export};
use alvis::grid::Dims;
use alvis::manifest::Form;
use alvis::phantom::{Phantom, Shape, render};
use alvis::progress::Quiet;
use alvis::table::{Expr, Table};
use alvis::tile::TileMesh;
use alvis::tileset::TileSet;
use alvis::transform::repack::{RepackOptions, repack};
use alvis::verify::{Code, VerifyOptions, verify};
use alvis::view::TileIndex;
use alvis::volume::{Dtype, OpenOptions, open};
use random::Random;
use serde_json::{Value, json};
use std::alloc::{GlobalAlloc, Layout, System};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The most bytes that one allocation may ask for while files of a few KiB are read: the map of lattice
/// edges of the largest macrocubes takes 16 MiB, and grows by doubling.
const MOST: usize = 40 << 20;

/// Notes the largest allocation.
struct Noting;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all calls go to the system's allocator as they are
unsafe impl GlobalAlloc for Noting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's duty is the same
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's duty is the same
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: the caller's duty is the same
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        // SAFETY: the caller's duty is the same
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static NOTING: Noting = Noting;

fn frugal(what: &str) {
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(largest <= MOST, "{what}: {largest} bytes at once");
}

/// A directory with a small tile set, `set`.
fn ball(form: Form) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let phantom = Phantom::new(Shape::Sphere { radius: 4.0 });
    let volume = render(&phantom, Dims::new([11, 10, 9]).unwrap(), Dtype::U8).unwrap();
    let options = ConvertOptions {
        threshold: volume.threshold(),
        macrocube: [6, 5, 4],
        primitives: form.primitives,
        encoding: form.encoding,
        layout: form.layout,
        ..ConvertOptions::default()
    };
    let set = dir.path().join("set");
    convert(&volume, &options, &set, &Quiet).unwrap();
    (dir, set)
}

/// Lets everything that reads tile sets read this one; what they make of it is their affair.
fn read_everything(set: &Path, out: &Path) -> bool {
    let options = VerifyOptions {
        threads: 1,
        max_issues: 5,
        ..VerifyOptions::default()
    };
    let ok = verify(set, &options, &Quiet).is_ok_and(|r| r.ok);
    if let Ok(open) = TileSet::open(set) {
        for entry in open.tiles().flatten() {
            let _ = open.read_tile(&entry);
        }
        for table in [Table::Cells, Table::Objects, Table::Surfaces] {
            if let Ok(mut table) = table.open(set, open.manifest()) {
                while let Ok(Some(_)) = table.next_row() {}
            }
        }
        let _ = TileIndex::read(&open);
    }
    let options = RepackOptions {
        form: Form::MESHLAB,
        force: true,
    };
    let _ = repack(set, &out.join("repacked"), &options, &Quiet);
    let _ = export(set, &out.join("all.ply"), &ExportOptions::default(), &Quiet);
    ok
}

fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    change(&mut value);
    std::fs::write(path, serde_json::to_vec(&value).unwrap()).unwrap();
}

fn crc(bytes: &[u8]) -> Value {
    format!("crc32:{:08x}", crc32fast::hash(bytes)).into()
}

/// Makes the manifest state what the shard of layer 0 is.
fn stamp(set: &Path) {
    let shard = std::fs::read(set.join("index/z0000.json")).unwrap();
    edit(&set.join("index.json"), |m| {
        m["layers"][0]["bytes"] = shard.len().into();
        m["layers"][0]["checksum"] = crc(&shard);
    });
    seal::seal(set);
}

/// Replaces the first tile, and makes shard and manifest agree.
fn put_tile(set: &Path, bytes: &[u8]) {
    let shard = set.join("index/z0000.json");
    edit(&shard, |s| {
        let path = set.join(s["tiles"][0]["path"].as_str().unwrap());
        std::fs::write(path, bytes).unwrap();
        s["tiles"][0]["bytes"] = bytes.len().into();
        s["tiles"][0]["checksum"] = crc(bytes);
    });
    stamp(set);
}

/// Changes bytes, or takes some out, or puts some in; numbers in JSON grow far.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len());
        match random.below(5) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => drop(bytes.drain(at..(at + 1 + random.below(40)).min(bytes.len()))),
            2 => drop(bytes.splice(at..at, std::iter::repeat_n(b'[', 1 + random.below(3000)))),
            3 => {
                let digit = (at..bytes.len()).find(|&i| bytes[i].is_ascii_digit());
                if let Some(i) = digit {
                    let huge = random.pick(&["4294967295", "18446744073709551615", "-1", "1e308"]);
                    drop(bytes.splice(i..i + 1, huge.bytes()));
                }
            }
            _ => bytes[at] = random.next() as u8,
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
}

#[test]
fn damaged_indexes_and_tiles_do_no_harm() {
    for form in [Form::BLENDER, Form::WEB] {
        let (dir, set) = ball(form);
        let [index, shard] = ["index.json", "index/z0000.json"].map(|n| set.join(n));
        let sound = [&index, &shard].map(|p| std::fs::read(p).unwrap());
        let entry: Value = serde_json::from_slice(&sound[1]).unwrap();
        let tile = set.join(entry["tiles"][0]["path"].as_str().unwrap());
        let glb = std::fs::read(&tile).unwrap();
        LARGEST.store(0, Ordering::Relaxed);
        for seed in 0..240 {
            let mut random = Random::new(seed);
            match seed % 3 {
                0 => {
                    let mut bytes = sound[0].clone();
                    damage(&mut bytes, &mut random);
                    std::fs::write(&index, bytes).unwrap();
                }
                1 => {
                    let mut bytes = sound[1].clone();
                    damage(&mut bytes, &mut random);
                    std::fs::write(&shard, bytes).unwrap();
                    stamp(&set);
                }
                _ => {
                    let mut bytes = glb.clone();
                    damage(&mut bytes, &mut random);
                    let _ = TileMesh::read(&bytes);
                    put_tile(&set, &bytes);
                }
            }
            read_everything(&set, dir.path());
            frugal(&format!("seed {seed}"));
            std::fs::write(&index, &sound[0]).unwrap();
            std::fs::write(&shard, &sound[1]).unwrap();
            std::fs::write(&tile, &glb).unwrap();
        }
        assert!(read_everything(&set, dir.path()), "what is sound stays so");
    }
}

#[test]
fn a_manifest_that_claims_much_gets_little() {
    let (dir, set) = ball(Form::BLENDER);
    let sound = std::fs::read(set.join("index.json")).unwrap();
    let claims: [fn(&mut Value); 5] = [
        |m| {
            m["grid"] = json!({"dims": [65536, 65536, 65536], "macrocube": [65535, 65535, 65535],
                "tiles": [1, 1, 1]});
            m["source"]["dims"] = json!([65536, 65536, 65536]);
        },
        |m| {
            m["grid"] = json!({"dims": [65536, 65536, 65536], "macrocube": [1, 1, 1],
                "tiles": [65535, 65535, 65535]});
            m["source"]["dims"] = json!([65536, 65536, 65536]);
        },
        |m| m["layers"][0]["tiles"] = json!(u64::MAX),
        |m| m["totals"]["volume6"] = json!("9".repeat(4000)),
        |m| m["grid"]["macrocube"] = json!([4294967295u32, 4294967295u32, 4294967295u32]),
    ];
    for claim in claims {
        LARGEST.store(0, Ordering::Relaxed);
        std::fs::write(set.join("index.json"), &sound).unwrap();
        edit(&set.join("index.json"), claim);
        seal::seal(&set);
        assert!(!read_everything(&set, dir.path()));
        frugal("a claim");
    }
}

#[test]
fn tiles_with_counts_beyond_the_file_are_refused() {
    let (_dir, set) = ball(Form::WEB);
    let sound: Value =
        serde_json::from_slice(&std::fs::read(set.join("index/z0000.json")).unwrap()).unwrap();
    let glb = std::fs::read(set.join(sound["tiles"][0]["path"].as_str().unwrap())).unwrap();
    let room = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    LARGEST.store(0, Ordering::Relaxed);
    for count in [1u64 << 20, 1 << 32, 1 << 60, u64::MAX] {
        for place in [
            "/accessors/0/count",
            "/bufferViews/0/byteLength",
            "/bufferViews/0/extensions/EXT_meshopt_compression/count",
            "/bufferViews/0/extensions/EXT_meshopt_compression/byteStride",
            "/bufferViews/2/extensions/EXT_meshopt_compression/count",
            "/buffers/0/byteLength",
            "/extensions/EXT_structural_metadata/propertyTables/0/count",
            "/meshes/0/primitives/0/extensions/EXT_mesh_features/featureIds/0/featureCount",
        ] {
            let mut doc: Value = serde_json::from_slice(&glb[20..20 + room]).unwrap();
            let Some(number) = doc.pointer_mut(place) else {
                continue;
            };
            *number = count.into();
            let mut json = serde_json::to_vec(&doc).unwrap();
            json.resize(json.len().next_multiple_of(4), b' ');
            let bin = &glb[20 + room..];
            let mut bytes = glb[..12].to_vec();
            bytes.extend((json.len() as u32).to_le_bytes());
            bytes.extend(b"JSON");
            bytes.extend(&json);
            bytes.extend(bin);
            let total = (bytes.len() as u32).to_le_bytes();
            bytes[8..12].copy_from_slice(&total);
            assert!(TileMesh::read(&bytes).is_err(), "{place} = {count}");
            frugal(place);
        }
    }
}

/// What the readers say must not be had from elsewhere.
fn refused(set: &Path, code: Code) {
    let report = verify(set, &VerifyOptions::default(), &Quiet);
    if let Ok(report) = report {
        assert!(
            report.issues.iter().any(|i| i.code == code),
            "{:?}",
            report.issues
        );
    }
    let outcome = TileSet::open(set).and_then(|open| {
        for entry in open.tiles() {
            open.read_tile(&entry?)?;
        }
        for table in [Table::Cells, Table::Objects, Table::Surfaces] {
            table.open(set, open.manifest())?;
        }
        Ok(())
    });
    let error = outcome.expect_err("it must not be read").to_string();
    assert!(!error.contains("secret content"), "{error}");
}

#[test]
fn nothing_outside_the_directory_is_read() {
    for file in [
        "index.json",
        "index/z0000.json",
        "tile",
        "cells.csv",
        "surfaces.csv",
        "index",
    ] {
        let (dir, set) = ball(Form::BLENDER);
        let shard: Value =
            serde_json::from_slice(&std::fs::read(set.join("index/z0000.json")).unwrap()).unwrap();
        let tile = shard["tiles"][0]["path"].as_str().unwrap();
        let inside = set.join(if file == "tile" { tile } else { file });
        // a sound file, but elsewhere: only the place is wrong
        let outside = dir.path().join("outside");
        std::fs::rename(&inside, &outside).unwrap();
        symlink(&outside, &inside).unwrap();
        refused(&set, Code::PathOutside);
    }
    let paths = [
        "/etc/hostname",
        "../secret",
        "tiles/../../secret",
        "a\\b",
        "C:x",
        "//x",
        "",
    ];
    for bad in paths {
        for place in ["/tables/cells", "/layers/0/path", "tile"] {
            let (dir, set) = ball(Form::BLENDER);
            std::fs::write(dir.path().join("secret"), "secret content").unwrap();
            if place == "tile" {
                edit(&set.join("index/z0000.json"), |s| {
                    s["tiles"][0]["path"] = bad.into()
                });
                stamp(&set);
            } else {
                edit(&set.join("index.json"), |m| {
                    *m.pointer_mut(place).unwrap() = bad.into();
                });
                seal::seal(&set);
            }
            let report = verify(&set, &VerifyOptions::default(), &Quiet).unwrap();
            assert!(!report.ok, "{place} {bad}");
            for issue in &report.issues {
                assert!(!issue.message.contains("secret content"), "{issue:?}");
            }
            assert!(!read_everything(&set, dir.path()));
        }
    }
}

#[test]
fn pipes_and_devices_are_not_waited_for() {
    for file in ["index.json", "index/z0000.json", "cells.csv", "tile"] {
        let (dir, set) = ball(Form::BLENDER);
        let shard: Value =
            serde_json::from_slice(&std::fs::read(set.join("index/z0000.json")).unwrap()).unwrap();
        let tile = shard["tiles"][0]["path"].as_str().unwrap();
        let path = set.join(if file == "tile" { tile } else { file });
        std::fs::remove_file(&path).unwrap();
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.unwrap().success());
        assert!(!read_everything(&set, dir.path()), "{file}");
    }
}

#[test]
fn deep_nesting_and_long_expressions_end_well() {
    let (dir, set) = ball(Form::BLENDER);
    let sound = std::fs::read(set.join("index.json")).unwrap();
    for text in [
        "[".repeat(1 << 20),
        "{\"a\":".repeat(1 << 18),
        "\"".to_owned(),
    ] {
        std::fs::write(set.join("index.json"), text).unwrap();
        assert!(!read_everything(&set, dir.path()));
    }
    std::fs::write(set.join("index.json"), sound).unwrap();
    let open = TileSet::open(&set).unwrap();
    let table = Table::Cells.open(&set, open.manifest()).unwrap();
    for text in [
        "(".repeat(1 << 18),
        "not ".repeat(1 << 18),
        "-".repeat(1 << 18) + "1",
        "1".to_owned() + &"^1".repeat(1 << 16),
        "1".to_owned() + &" or 1".repeat(1 << 16),
        "abs(".repeat(1 << 16) + "id",
    ] {
        let _ = Expr::condition("--where", &text, table.columns());
        let _ = Expr::number("--sort", &text, table.columns());
    }
}

#[test]
fn damaged_volumes_do_no_harm() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let dir = tempfile::tempdir().unwrap();
    let mut files: Vec<PathBuf> = std::fs::read_dir(&fixtures)
        .unwrap()
        .chain(std::fs::read_dir(fixtures.join("dicom")).unwrap())
        .map(|e| e.unwrap().path())
        .filter(|p| p.is_file() && p.extension().is_none_or(|e| e != "py"))
        .collect();
    files.sort();
    assert!(files.len() > 50);
    LARGEST.store(0, Ordering::Relaxed);
    for (i, file) in files.iter().enumerate() {
        let sound = std::fs::read(file).unwrap();
        for seed in 0..12 {
            let mut random = Random::new((i * 100 + seed) as u64);
            let mut bytes = sound.clone();
            // headers are where the harm is
            let head = bytes.len().min(600);
            let mut front = bytes[..head].to_vec();
            damage(&mut front, &mut random);
            drop(bytes.splice(..head, front));
            let path = dir.path().join(file.file_name().unwrap());
            std::fs::write(&path, bytes).unwrap();
            let Ok(opened) = open(&path, &OpenOptions::default()) else {
                continue;
            };
            let header = opened.volume.header();
            let [nx, ny, nz] = header.dims.0;
            let slice = u64::from(nx) * u64::from(ny) * header.dtype.bytes() as u64;
            if slice < 1 << 20 {
                let mut out = vec![0; slice as usize];
                for z in [0, nz - 1] {
                    let _ = opened.volume.read_box(0..nx, 0..ny, z..z + 1, &mut out);
                }
            }
            frugal(&format!("{} seed {seed}", file.display()));
        }
    }
}
