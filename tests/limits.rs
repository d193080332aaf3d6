//! The limits that the README states, at their edges.

// other programs use the rest
mod command;

use alvis::convert::{ConvertOptions, convert};
use alvis::grid::Dims;
use alvis::manifest::{Manifest, Totals};
use alvis::progress::Quiet;
use alvis::verify::{VerifyOptions, verify};
use alvis::volume::{Dtype, MemoryVolume, OpenOptions, open};
use command::{alvis, fails, json, ok};
use std::ffi::{OsStr, OsString};
use std::fs::{File, Permissions};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::Path;
use std::process::Command;

/// Converts and verifies a sparse volume with a block at each end, which must come out right.
fn far_ends(dims: [u64; 3]) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sparse.raw");
    let file = File::create(&path).unwrap();
    file.set_len(dims.iter().product()).unwrap();
    // blocks of 3 x 3 x 3 voxels, a voxel away from the first and from the last corner
    for far in [false, true] {
        let start = dims.map(|n| if far { n - 4 } else { 1 });
        for z in 0..3 {
            for y in 0..3 {
                let at = start[0] + dims[0] * (start[1] + y + dims[1] * (start[2] + z));
                file.write_all_at(&[200; 3], at).unwrap();
            }
        }
    }
    let options = OpenOptions {
        dims: Some(dims),
        dtype: Some(Dtype::U8),
        ..OpenOptions::default()
    };
    let volume = open(&path, &options).unwrap().volume;
    let out = dir.path().join("out");
    let options = ConvertOptions {
        threshold: 100.0,
        ..ConvertOptions::default()
    };
    let made = convert(&*volume, &options, &out, &Quiet).unwrap();
    assert_eq!((made.totals.objects, made.totals.cells), (2, 1));
    let options = VerifyOptions {
        against: Some(&*volume),
        ..VerifyOptions::default()
    };
    let report = verify(&out, &options, &Quiet).unwrap();
    assert!(report.ok && report.issues.is_empty(), "{:?}", report.issues);
    let objects = std::fs::read_to_string(out.join("objects.csv")).unwrap();
    let last = objects.lines().last().unwrap();
    let centroid: Vec<f64> = last
        .split(',')
        .skip(8)
        .take(3)
        .map(|f| f.parse().unwrap())
        .collect();
    assert_eq!(centroid, dims.map(|n| (n - 3) as f64));
}

#[test]
fn x_may_have_65536_voxels() {
    far_ends([65_536, 64, 64]);
}

#[test]
fn y_may_have_65536_voxels() {
    far_ends([64, 65_536, 64]);
}

#[test]
fn z_may_have_65536_voxels() {
    far_ends([64, 64, 65_536]);
}

#[test]
fn more_than_65536_voxels_are_refused_early() {
    let dir = tempfile::tempdir().unwrap();
    for dims in [[65_537, 2, 2], [2, 65_537, 2], [2, 2, 65_537]] {
        File::create(dir.path().join("long.raw"))
            .unwrap()
            .set_len(65_537 * 4)
            .unwrap();
        let dims = dims.map(|n: u64| n.to_string()).join(",");
        let args = [
            "convert",
            "long.raw",
            "out",
            "--dims",
            &dims,
            "--dtype",
            "u8",
            "--threshold",
            "1",
        ];
        let message = fails(dir.path(), &args);
        assert!(
            message.contains("65537") && message.contains("65536"),
            "{message}"
        );
        assert!(!dir.path().join("out").exists());
    }
    assert!(Dims::new([65_537, 2, 2]).is_err());
}

/// The index type of the one piece of a sheet of nx x ny vertices: 5123 for 16 bits, 5125 for 32.
fn sheet(nx: u64, ny: u64) -> u64 {
    let dims = Dims::new([nx, ny, 2]).unwrap();
    let half = (nx * ny) as usize;
    let samples: Vec<u8> = [vec![0; half], vec![200; half]].concat();
    let volume = MemoryVolume::new(dims, Default::default(), samples).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let options = ConvertOptions {
        threshold: 100.0,
        macrocube: [400, 400, 64],
        ..ConvertOptions::default()
    };
    let made = convert(&volume, &options, &out, &Quiet).unwrap();
    assert_eq!((made.totals.tiles, made.totals.tile_vertices), (1, nx * ny));
    let report = verify(&out, &VerifyOptions::default(), &Quiet).unwrap();
    assert!(report.ok, "{:?}", report.issues);
    let glb = std::fs::read(out.join("tiles/z0000/y0000_x0000.glb")).unwrap();
    let room = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let doc = json(std::str::from_utf8(&glb[20..20 + room]).unwrap());
    let indices = &doc["accessors"][2];
    let view = &doc["bufferViews"][indices["bufferView"].as_u64().unwrap() as usize];
    let offset = |v: &serde_json::Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let start = 28 + room + offset(view) + offset(indices);
    let count = indices["count"].as_u64().unwrap() as usize;
    let kind = indices["componentType"].as_u64().unwrap();
    if kind == 5123 {
        // the value that restarts a strip must not occur
        let values = glb[start..start + 2 * count].as_chunks::<2>().0;
        let most = values.iter().map(|b| u16::from_le_bytes(*b)).max();
        assert_eq!(most, Some((nx * ny - 1) as u16));
        assert!(most < Some(u16::MAX));
    }
    kind
}

#[test]
fn pieces_of_more_than_65535_vertices_have_wide_indices() {
    assert_eq!(sheet(217, 302), 5123, "65,534 vertices");
    assert_eq!(sheet(255, 257), 5123, "65,535 vertices");
    assert_eq!(sheet(256, 256), 5125, "65,536 vertices");
}

#[test]
fn counts_have_64_bits() {
    // 2^32 vertices and more would take 50 GB of tiles: the types say it
    let wide = |t: &Totals| -> [u64; 8] {
        [
            t.vertices,
            t.tile_vertices,
            t.triangles,
            t.strip_indices,
            t.cells,
            t.objects,
            t.surfaces,
            t.bytes,
        ]
    };
    let totals = Totals {
        vertices: 5 << 32,
        volume6: i128::from(u64::MAX) * 9,
        ..Totals::default()
    };
    assert_eq!(wide(&totals)[0], 5 << 32);
    let text = serde_json::to_string(&totals).unwrap();
    assert_eq!(serde_json::from_str::<Totals>(&text).unwrap(), totals);
}

/// A small volume as a raw file.
fn small(path: &Path) {
    let mut samples = vec![0u8; 8 * 8 * 8];
    samples[8 * 8 * 3 + 8 * 3 + 3] = 200;
    std::fs::write(path, samples).unwrap();
}

const SMALL: [&str; 6] = ["--dims", "8,8,8", "--dtype", "u8", "--threshold", "100"];

fn run(dir: &Path, args: &[&OsStr]) -> (Option<i32>, Vec<u8>, Vec<u8>) {
    let output = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(args)
        .current_dir(dir)
        .output()
        .unwrap();
    (output.status.code(), output.stdout, output.stderr)
}

#[test]
fn names_may_have_spaces_and_be_no_text() {
    let dir = tempfile::tempdir().unwrap();
    let names: [&[u8]; 3] = [
        b"a scan of mine",
        "schäum \u{1F9FD}".as_bytes(),
        b"latin1 \xE4\xFF",
    ];
    for name in names {
        let base = OsString::from(OsStr::from_bytes(name));
        let mut input = base.clone();
        input.push(".raw");
        small(&dir.path().join(&input));
        let mut args: Vec<&OsStr> = vec![OsStr::new("convert"), &input, &base];
        args.extend(SMALL.iter().map(OsStr::new));
        args.push(OsStr::new("--json"));
        let (code, out, err) = run(dir.path(), &args);
        assert_eq!(code, Some(0), "{}", String::from_utf8_lossy(&err));
        assert_eq!(json(std::str::from_utf8(&out).unwrap())["objects"], 1);
        let args = ["verify", "--json"].map(OsStr::new);
        let (code, out, err) = run(dir.path(), &[args[0], &base, args[1]]);
        assert_eq!(code, Some(0), "{}", String::from_utf8_lossy(&err));
        assert_eq!(json(std::str::from_utf8(&out).unwrap())["ok"], true);
        let manifest = Manifest::open(&dir.path().join(&base)).unwrap();
        assert_eq!(manifest.source.name, input.to_string_lossy());
        // and in messages
        let mut missing = base.clone();
        missing.push(" missing.raw");
        let mut args: Vec<&OsStr> = vec![OsStr::new("convert"), &missing, OsStr::new("x")];
        args.extend(SMALL.iter().map(OsStr::new));
        let (code, _, err) = run(dir.path(), &args);
        let err = String::from_utf8_lossy(&err).into_owned();
        assert_eq!(code, Some(2), "{err}");
        assert!(err.contains("missing.raw"), "{err}");
    }
}

#[test]
fn a_place_that_cannot_be_written_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    small(&dir.path().join("small.raw"));
    // nothing can be made in /proc, not even by the superuser
    let mut args = vec!["convert", "small.raw", "/proc/alvis out"];
    args.extend(SMALL);
    let message = fails(dir.path(), &args);
    assert!(message.contains("/proc/alvis out"), "{message}");
    let locked = dir.path().join("locked");
    std::fs::create_dir(&locked).unwrap();
    std::fs::set_permissions(&locked, Permissions::from_mode(0o555)).unwrap();
    if File::create(locked.join("probe")).is_ok() {
        eprintln!("SKIPPED a folder without the right to write: this user may write anywhere");
        return;
    }
    let mut args = vec!["convert", "small.raw", "locked/out"];
    args.extend(SMALL);
    let message = fails(dir.path(), &args);
    assert!(message.contains("locked"), "{message}");
}

#[test]
fn inputs_may_be_read_only_and_stay_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("small.raw");
    small(&path);
    let before = std::fs::read(&path).unwrap();
    std::fs::set_permissions(&path, Permissions::from_mode(0o444)).unwrap();
    let mut args = vec!["convert", "small.raw", "out", "--quiet"];
    args.extend(SMALL);
    ok(dir.path(), &args);
    // a tile set that is only to be read is one all the same
    for name in [
        "out/index.json",
        "out/cells.csv",
        "out/tiles/z0000/y0000_x0000.glb",
    ] {
        std::fs::set_permissions(dir.path().join(name), Permissions::from_mode(0o444)).unwrap();
    }
    let output = alvis(dir.path(), &["verify", "out", "--against", "small.raw"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(std::fs::read(&path).unwrap(), before);
}
