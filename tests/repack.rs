//! Tile sets in every form: the same surface, cells and measures, and the way back.

mod common;

use alvis::convert::ConvertOptions;
use alvis::error::Error;
use alvis::grid::Ambiguous;
use alvis::manifest::{Encoding, Form, Layout, Manifest, Primitives};
use alvis::progress::Quiet;
use alvis::tile::{SurfacePiece, TileMesh};
use alvis::tileset::TileSet;
use alvis::transform::repack::{RepackOptions, repack};
use alvis::verify::Report;
use common::volumes::{foam, late_joins, noise, placed};
use common::{assert_same_files, converted, files, glb, verified};
use std::path::Path;

/// Every form.
fn forms() -> Vec<Form> {
    let mut all = Vec::new();
    for primitives in [Primitives::Strips, Primitives::Triangles] {
        for encoding in [Encoding::Float, Encoding::Quantized, Encoding::Meshopt] {
            for layout in [Layout::Auto, Layout::Nodes, Layout::Merged] {
                all.push(Form {
                    primitives,
                    encoding,
                    layout,
                });
            }
        }
    }
    all
}

fn repacked(from: &Path, form: Form) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let options = RepackOptions { form, force: false };
    let report =
        repack(from, dir.path(), &options, &Quiet).unwrap_or_else(|e| panic!("{form:?}: {e}"));
    let totals = TileSet::open(dir.path()).unwrap().manifest().totals;
    assert_eq!((report.tiles, report.bytes), (totals.tiles, totals.bytes));
    dir
}

/// What the verifier found, without what a form may change.
fn surface(report: &Report) -> impl PartialEq + std::fmt::Debug + use<> {
    let r = report;
    let counts = [r.tiles, r.triangles, r.cap_triangles, r.vertices];
    let more = [r.tile_vertices, r.border_edges, r.surfaces, r.objects];
    (counts, more, r.cells, r.euler_characteristic, r.volume6)
}

/// The manifest without what a form may change.
fn essence(dir: &Path) -> Manifest {
    let mut m = TileSet::open(dir).unwrap().manifest().clone();
    m.primitives = Primitives::default();
    m.encoding = Encoding::default();
    m.layout = Layout::default();
    m.checksum = None;
    m.totals.strips = 0;
    m.totals.strip_indices = 0;
    m.totals.bytes = 0;
    for layer in &mut m.layers {
        layer.bytes = 0;
        layer.checksum.clear();
    }
    m
}

fn tables(dir: &Path) -> Vec<Vec<u8>> {
    ["cells.csv", "objects.csv", "surfaces.csv"]
        .map(|t| std::fs::read(dir.join(t)).unwrap())
        .to_vec()
}

/// Triangles by their corners in lattice steps, the smallest corner first, sorted.
fn triangles(piece: &SurfacePiece) -> Vec<[[i32; 3]; 3]> {
    let turn = |&t: &[u32; 3]| {
        let t = piece.corners(t).map(|p| p.map(|c| (c * 256.0) as i32));
        let first = (0..3).min_by_key(|&i| t[i]).unwrap();
        std::array::from_fn(|i| t[(first + i) % 3])
    };
    let mut all: Vec<_> = piece.triangles.iter().map(turn).collect();
    all.sort_unstable();
    all
}

fn tiles(dir: &Path) -> Vec<TileMesh> {
    let set = TileSet::open(dir).unwrap();
    set.tiles()
        .map(|t| set.read_tile(&t.unwrap()).unwrap())
        .collect()
}

/// Both sets have the same cells; normals differ by at most 0.9 degrees if `rounded`, else not.
fn assert_same_cells(a: &Path, b: &Path, rounded: bool) {
    let (a, b) = (tiles(a), tiles(b));
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(&b) {
        assert_eq!((a.matrix, a.pieces.len()), (b.matrix, b.pieces.len()));
        for (a, b) in a.pieces.iter().zip(&b.pieces) {
            assert_eq!((a.ids, &a.extras), (b.ids, &b.extras));
            assert_eq!(a.positions, b.positions);
            assert_eq!(triangles(a), triangles(b));
            if !rounded {
                assert_eq!(a.normals, b.normals);
            }
            for (m, n) in a.normals.iter().zip(&b.normals) {
                let cosine = (0..3).map(|i| m[i] * n[i]).sum::<f32>();
                assert!(cosine > 0.9998, "{m:?} {n:?}");
            }
        }
    }
}

/// Volumes with caps, late joins of pieces, dust in merged tiles, and an empty one.
fn sets() -> Vec<(&'static str, tempfile::TempDir)> {
    let base = ConvertOptions {
        threshold: 128.0,
        macrocube: [16, 12, 20],
        ..ConvertOptions::default()
    };
    let dims = [33, 30, 27];
    let sparse = noise(dims, 3)
        .into_iter()
        .map(|v| if v < 26 { 255 - v } else { v / 2 })
        .collect();
    let (serpentines, bent) = late_joins();
    let options = |cap, ambiguous, macrocube| ConvertOptions {
        cap,
        ambiguous,
        macrocube,
        ..base.clone()
    };
    let (separate, join) = (Ambiguous::Separate, Ambiguous::Join);
    let empty = ConvertOptions {
        threshold: 1000.0,
        ..base.clone()
    };
    [
        (
            "foam",
            placed(dims, foam(dims, 5)),
            options(true, join, [16, 12, 20]),
        ),
        (
            "late",
            placed(serpentines, bent),
            options(false, separate, [16; 3]),
        ),
        (
            "dust",
            placed(dims, sparse),
            options(false, separate, [64; 3]),
        ),
        ("empty", placed(dims, foam(dims, 5)), empty),
    ]
    .map(|(name, volume, options)| (name, converted(&volume, &options).0))
    .into()
}

#[test]
fn every_form_is_the_same_surface_with_the_same_cells() {
    for (name, set) in sets() {
        let expected = verified(set.path(), None);
        for form in forms() {
            let made = repacked(set.path(), form);
            let report = verified(made.path(), None);
            assert_eq!(surface(&report), surface(&expected), "{name} {form:?}");
            assert_eq!(essence(made.path()), essence(set.path()), "{name} {form:?}");
            assert_eq!(tables(made.path()), tables(set.path()), "{name} {form:?}");
            assert_same_cells(set.path(), made.path(), form.encoding != Encoding::Float);
        }
    }
}

/// A form is reached by repacking and by converting: the same bytes, but for the room that a conversion leaves in the
/// JSON, which repacking takes out.
#[test]
fn converting_into_a_form_is_converting_and_repacking() {
    let dims = [33, 30, 27];
    for (cap, volume) in [
        (false, placed(dims, foam(dims, 2))),
        (true, placed(dims, foam(dims, 8))),
    ] {
        for form in forms() {
            let options = ConvertOptions {
                threshold: 128.0,
                macrocube: [16, 12, 20],
                cap,
                primitives: form.primitives,
                ..ConvertOptions::default()
            };
            let (plain, _) = converted(&volume, &options);
            let direct = ConvertOptions {
                encoding: form.encoding,
                layout: form.layout,
                ..options
            };
            let (direct, _) = converted(&volume, &direct);
            verified(direct.path(), Some(&volume));
            let made = files(repacked(plain.path(), form).path());
            // lists that were compressed may begin at another corner when they are compressed again
            if form.encoding != Encoding::Meshopt || form.primitives == Primitives::Strips {
                let again = files(repacked(direct.path(), form).path());
                assert_same_files(&again, &made, &format!("{form:?}"));
            }
            for (name, bytes) in files(direct.path()) {
                if name.ends_with(".glb") {
                    assert!(
                        glb::chunks(&bytes) == glb::chunks(&made[&name]),
                        "{form:?} {name}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_way_back_is_exact_but_for_normals() {
    for (name, set) in sets() {
        for form in forms()
            .into_iter()
            .filter(|f| f.primitives == Primitives::Strips)
        {
            let float = repacked(set.path(), Form::BLENDER);
            let there = repacked(float.path(), form);
            let back = repacked(there.path(), Form::BLENDER);
            let again = repacked(back.path(), form);
            // nothing is lost but by the first rounding
            assert_same_files(&files(there.path()), &files(again.path()), name);
            if form.encoding == Encoding::Float {
                assert_same_files(&files(float.path()), &files(back.path()), name);
                continue;
            }
            for (path, bytes) in files(float.path()) {
                let other = std::fs::read(back.path().join(&path)).unwrap();
                if path.ends_with(".glb") {
                    assert_same_but_normals(&bytes, &other, &path);
                } else if path.ends_with(".csv") {
                    assert_eq!(bytes, other, "{path}");
                }
            }
        }
    }
}

/// Two tiles in floats are the same to the byte outside of their normals.
fn assert_same_but_normals(a: &[u8], b: &[u8], path: &str) {
    let ((doc, a), (other, b)) = (common::glb::chunks(a), common::glb::chunks(b));
    assert_eq!(doc, other, "{path}");
    let view = |at: usize| {
        let view = &doc["bufferViews"][at];
        let number = |key: &str| view[key].as_u64().unwrap() as usize;
        number("byteOffset")..number("byteOffset") + number("byteLength")
    };
    let normals = view(1);
    assert_eq!(a[..normals.start], b[..normals.start], "{path}: positions");
    assert_eq!(a[normals.end..], b[normals.end..], "{path}: behind normals");
}

#[test]
fn colours_come_along() {
    let (set, _) = converted(
        &placed([33, 30, 27], foam([33, 30, 27], 5)),
        &ConvertOptions {
            threshold: 128.0,
            macrocube: [16; 3],
            ..ConvertOptions::default()
        },
    );
    let painted = tempfile::tempdir().unwrap();
    let options = alvis::transform::select::SelectOptions {
        colour_by: Some(alvis::transform::select::ColourRule {
            column: "voxels".into(),
            map: alvis::transform::select::Map::named("magma").unwrap(),
            range: None,
        }),
        chosen: alvis::table::Chosen::cells("voxels > 4"),
        ..Default::default()
    };
    alvis::transform::select::select(set.path(), painted.path(), &options, &Quiet).unwrap();
    let float = repacked(painted.path(), Form::BLENDER);
    assert_same_files(&files(painted.path()), &files(float.path()), "painted");
    assert!(painted.path().join("legend.png").exists());
    for form in forms() {
        let there = repacked(painted.path(), form);
        verified(there.path(), None);
        let same_kind = Form {
            primitives: form.primitives,
            ..Form::BLENDER
        };
        let materials = |dir: &Path| -> Vec<serde_json::Value> {
            let of = |(path, bytes): (String, Vec<u8>)| {
                path.ends_with(".glb").then(|| {
                    let doc = common::glb::chunks(&bytes).0;
                    let nodes = doc["meshes"].as_array().unwrap().iter();
                    let index = |m: &serde_json::Value| {
                        m["primitives"][0]["material"].as_u64().unwrap() as usize
                    };
                    nodes
                        .map(|m| doc["materials"][index(m)].clone())
                        .collect::<Vec<_>>()
                })
            };
            files(dir).into_iter().filter_map(of).flatten().collect()
        };
        let back = repacked(there.path(), same_kind);
        assert_eq!(
            materials(back.path()),
            materials(painted.path()),
            "{form:?}"
        );
        // a part of a part, in the form that it has
        let part = tempfile::tempdir().unwrap();
        let fewer = alvis::transform::select::SelectOptions {
            chosen: alvis::table::Chosen::cells("voxels > 40"),
            ..Default::default()
        };
        alvis::transform::select::select(there.path(), part.path(), &fewer, &Quiet).unwrap();
        verified(part.path(), None);
    }
}

#[test]
fn no_index_has_all_bits_set_and_all_are_narrow_where_they_can_be() {
    let dims = [60, 60, 60];
    let (set, _) = converted(
        &placed(dims, noise(dims, 1)),
        &ConvertOptions {
            threshold: 128.0,
            ..ConvertOptions::default()
        },
    );
    for form in [Form::BLENDER, Form::MESHLAB, Form::WEB] {
        let made = repacked(set.path(), form);
        verified(made.path(), None);
        for (path, bytes) in files(made.path()) {
            if !path.ends_with(".glb") {
                continue;
            }
            let tile = alvis::tile::read::Tile::read(&bytes).unwrap();
            let mut indices = Vec::new();
            for p in &tile.primitives {
                p.indices.read_into(&mut indices);
                let limit = if p.indices.is_wide() {
                    u32::MAX
                } else {
                    65_535
                };
                assert!(indices.iter().all(|&i| i < limit));
                assert_eq!(p.indices.is_wide(), p.positions.len() > 65_535);
            }
        }
    }
}

#[test]
fn large_macrocubes_are_refused_before_anything_is_written() {
    let dims = [257, 4, 4];
    let volume = placed(dims, noise(dims, 1));
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [256; 3],
        ..ConvertOptions::default()
    };
    let (set, _) = converted(&volume, &options);
    let out = tempfile::tempdir().unwrap();
    let dest = out.path().join("web");
    let web = RepackOptions {
        form: Form::WEB,
        force: false,
    };
    let error = repack(set.path(), &dest, &web, &Quiet).unwrap_err();
    assert!(
        matches!(&error, Error::Usage { option, .. } if option == "--macrocube"),
        "{error}"
    );
    let direct = ConvertOptions {
        encoding: Encoding::Quantized,
        ..options.clone()
    };
    let error = alvis::convert::convert(&volume, &direct, &dest, &Quiet).unwrap_err();
    assert!(
        matches!(&error, Error::Usage { option, .. } if option == "--macrocube"),
        "{error}"
    );
    assert!(!dest.exists());
    // the most that fits, closed at both ends
    let dims = [255, 5, 5];
    let widest = ConvertOptions {
        encoding: Encoding::Meshopt,
        macrocube: [254; 3],
        cap: true,
        ..options
    };
    let volume = placed(dims, noise(dims, 4));
    let (set, _) = converted(&volume, &widest);
    verified(set.path(), Some(&volume));
}

#[test]
fn a_damaged_set_leaves_nothing_behind() {
    let (set, _) = converted(
        &placed([20, 20, 20], foam([20, 20, 20], 5)),
        &ConvertOptions {
            threshold: 128.0,
            macrocube: [8; 3],
            ..ConvertOptions::default()
        },
    );
    let out = tempfile::tempdir().unwrap();
    let dest = out.path().join("web");
    let options = RepackOptions {
        form: Form::WEB,
        force: false,
    };
    let tile = set.path().join("tiles/z0001/y0001_x0001.glb");
    let bytes = std::fs::read(&tile).unwrap();
    std::fs::write(&tile, &bytes[..bytes.len() - 1]).unwrap();
    assert!(repack(set.path(), &dest, &options, &Quiet).is_err());
    assert!(!dest.exists());
    std::fs::write(&tile, &bytes).unwrap();
    repack(set.path(), &dest, &options, &Quiet).unwrap();
    let error = repack(set.path(), &dest, &options, &Quiet).unwrap_err();
    assert!(matches!(error, Error::OutputExists { .. }), "{error}");
    let error = repack(&dest, &dest, &options, &Quiet).unwrap_err();
    assert!(matches!(error, Error::Usage { .. }), "{error}");
    let again = RepackOptions {
        force: true,
        ..options
    };
    repack(set.path(), &dest, &again, &Quiet).unwrap();
    verified(&dest, None);
}
