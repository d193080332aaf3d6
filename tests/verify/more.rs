//! Random faults, hostile input, other layouts.

use crate::cubes::Field;
use crate::edit::Set;
use crate::writer::{self, Style};
use crate::{STYLE, check, codes, compare, compare_with, noise, noisy_field, random_field, styles};
use alvis::grid::Origin;
use alvis::progress::Quiet;
use alvis::verify::{Code, SourceVolume, VerifyOptions, verify};
use alvis::volume::Dtype;
use std::fs;
use std::path::Path;

fn noisy_set(dir: &Path) -> Field {
    let field = noisy_field();
    writer::write(dir, &field, &STYLE);
    field
}

/// The place of a random tile, piece and triangle or vertex.
fn pick(seed: u64, what: u64, n: usize) -> usize {
    (noise(seed, what) * n as f32) as usize % n
}

#[test]
fn random_faults_are_found() {
    for seed in 0..60 {
        let dir = tempfile::tempdir().unwrap();
        let style = styles().nth(seed as usize % 8).unwrap();
        writer::write(dir.path(), &random_field(seed, [9, 8, 7], 0.4), &style);
        let set = Set(dir.path());
        let places = set.places();
        let place = &places[pick(seed, 1, places.len())];
        let mut tile = set.tile(place);
        let n = tile.pieces.len();
        let piece = &mut tile.pieces[pick(seed, 2, n)];
        let t = pick(seed, 3, piece.triangles.len());
        match seed % 4 {
            0 if piece.triangles.len() > 1 => _ = piece.triangles.remove(t),
            1 => piece.triangles[t].swap(1, 2),
            2 => piece.triangles.push(piece.triangles[t]),
            _ => {
                // one lattice step along the vertex's edge
                let v = piece.triangles[t][0] as usize;
                let p = &mut piece.positions[v];
                let axis = (0..3).find(|&a| p[a].fract() != 0.0).unwrap();
                let up = p[axis].fract() < 0.5 && p[axis] > 0.0;
                p[axis] += if up { 1.0 } else { -1.0 } / 256.0;
            }
        }
        set.put(place, &tile);
        let report = check(dir.path());
        assert!(!report.ok, "seed {seed}, {style:?}: nothing found");
        assert!(
            report
                .issues
                .iter()
                .all(|i| !i.path.is_empty() && !i.message.is_empty())
        );
    }
}

#[test]
fn a_missing_component_is_seen_by_the_volume_alone() {
    let dir = tempfile::tempdir().unwrap();
    let full = noisy_field();
    let mut less = full.clone();
    less.values[2 + 14 * (2 + 9 * 2)] = 0.0;
    // all sums are made from what is left
    writer::write(dir.path(), &less, &STYLE);
    assert!(check(dir.path()).ok);
    let report = compare(dir.path(), &full);
    assert!(
        codes(&report).iter().eq([&Code::MissingVertex]),
        "{report:#?}"
    );
    assert_eq!(report.issues[0].voxel, Some([1.5, 2.0, 2.0]));
}

#[test]
fn a_shift_that_keeps_all_sums_is_seen_by_the_volume() {
    let dir = tempfile::tempdir().unwrap();
    let field = noisy_set(dir.path());
    let mut other = field.clone();
    let i = 2 + 14 * (2 + 9 * 2);
    other.values[i] += 0.05;
    let report = compare(dir.path(), &other);
    assert!(
        codes(&report).iter().eq([&Code::VertexMisplaced]),
        "{report:#?}"
    );
}

#[test]
fn merged_tiles_pass_and_their_faults_are_found() {
    for strips in [true, false] {
        let dir = tempfile::tempdir().unwrap();
        let field = noisy_field();
        writer::write(dir.path(), &field, &Style { strips, ..STYLE });
        let set = Set(dir.path());
        for place in set.places() {
            let (glb, strips, indices) = set.tile(&place).encode_merged();
            set.edit_entry(&place, |e| {
                e["strips"] = strips.into();
                e["indices"] = indices.into();
            });
            set.put_bytes(&place, &glb);
        }
        // so few pieces are merged only where that is asked for
        assert!(
            codes(&compare(dir.path(), &field))
                .iter()
                .eq([&Code::TileEncoding])
        );
        set.manifest(|m| m["layout"] = "merged".into());
        let report = compare(dir.path(), &field);
        assert!(report.ok && report.issues.is_empty(), "{report:#?}");
        let place = &set.places()[0];
        set.edit_json(place, |j| {
            let table = &mut j["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
            table["count"] = 77.into();
        });
        assert!(codes(&check(dir.path())).iter().eq([&Code::GltfStructure]));
    }
}

#[test]
fn paths_that_lead_outside_are_refused() {
    let outside = tempfile::tempdir().unwrap();
    fs::write(outside.path().join("cells.csv"), "id\n").unwrap();
    let absolute = outside.path().join("cells.csv");
    for path in [
        absolute.to_str().unwrap(),
        "a/../../cells.csv",
        "c:\\cells.csv",
        "",
        "./cells.csv",
    ] {
        let dir = tempfile::tempdir().unwrap();
        noisy_set(dir.path());
        Set(dir.path()).manifest(|m| m["tables"]["cells"] = path.into());
        assert!(
            codes(&check(dir.path())).iter().eq([&Code::PathOutside]),
            "{path}"
        );
    }
    #[cfg(unix)]
    {
        let dir = tempfile::tempdir().unwrap();
        noisy_set(dir.path());
        let table = dir.path().join("cells.csv");
        fs::rename(&table, &absolute).unwrap();
        std::os::unix::fs::symlink(&absolute, &table).unwrap();
        assert!(codes(&check(dir.path())).iter().eq([&Code::PathOutside]));
    }
}

/// Everything in the directory is named by the index and written by the program; what systems write is told.
#[test]
fn foreign_files_are_found_wherever_they_are() {
    let dir = tempfile::tempdir().unwrap();
    noisy_set(dir.path());
    let at = |name: &str| dir.path().join(name);
    for name in [
        "evil.exe",
        "volumes.csv",
        ".hidden",
        "index/z0000.json.bak",
        "tiles/a.txt",
        "tiles/z0000/y0000_x0000.glb~",
        "legend.png",
        "legend.svg",
        "index.json.tmp",
    ] {
        fs::write(at(name), "").unwrap();
        let report = check(dir.path());
        assert!(
            !report.ok && codes(&report).iter().eq([&Code::ForeignFile]),
            "{name}"
        );
        assert_eq!(report.issues[0].path, name);
        fs::remove_file(at(name)).unwrap();
    }
    for name in ["textures", "index/z0001", "tiles/z9999"] {
        fs::create_dir(at(name)).unwrap();
        assert!(
            codes(&check(dir.path())).iter().eq([&Code::ForeignFile]),
            "{name}"
        );
        fs::remove_dir(at(name)).unwrap();
    }
    for name in [
        ".DS_Store",
        "tiles/Thumbs.db",
        "tiles/z0000/.nfs0000",
        "index/._z0000.json",
    ] {
        fs::write(at(name), "").unwrap();
        let report = check(dir.path());
        assert!(
            report.ok && codes(&report).iter().eq([&Code::ForeignFile]),
            "{name}"
        );
        fs::remove_file(at(name)).unwrap();
    }
    // a directory is none of those that systems write
    fs::create_dir(at(".DS_Store")).unwrap();
    assert!(!check(dir.path()).ok);
    fs::remove_dir(at(".DS_Store")).unwrap();
    // an interrupted conversion lies in a directory of its own
    fs::create_dir(at(".alvis-partial")).unwrap();
    assert!(check(dir.path()).issues.is_empty());
}

/// A set has no links, not even to its own files.
#[test]
#[cfg(unix)]
fn links_are_found() {
    let dir = tempfile::tempdir().unwrap();
    noisy_set(dir.path());
    let at = |name: &str| dir.path().join(name);
    for name in [
        "cells.csv",
        "tiles/z0000/y0000_x0000.glb",
        "index/z0000.json",
        "tiles",
        "index.json",
    ] {
        let moved = at(&format!("{name}.moved"));
        fs::rename(at(name), &moved).unwrap();
        std::os::unix::fs::symlink(&moved, at(name)).unwrap();
        let report = check(dir.path());
        let links = report
            .issues
            .iter()
            .filter(|i| i.message.contains("a link"));
        assert_eq!(links.count(), 1, "{name}: {report:#?}");
        fs::remove_file(at(name)).unwrap();
        fs::rename(&moved, at(name)).unwrap();
    }
    // one that leads outside is not followed, be it that of the index, and neither is one that leads nowhere
    let outside = tempfile::tempdir().unwrap();
    for name in ["cells.csv", "index.json"] {
        let moved = outside.path().join(name);
        fs::rename(at(name), &moved).unwrap();
        std::os::unix::fs::symlink(&moved, at(name)).unwrap();
        assert!(
            codes(&check(dir.path())).contains(&Code::PathOutside),
            "{name}"
        );
        fs::rename(&moved, outside.path().join("away")).unwrap();
        assert!(
            codes(&check(dir.path())).contains(&Code::MissingFile),
            "{name}"
        );
        fs::remove_file(at(name)).unwrap();
        fs::rename(outside.path().join("away"), at(name)).unwrap();
    }
    std::os::unix::fs::symlink("/etc/passwd", at("notes")).unwrap();
    assert!(codes(&check(dir.path())).iter().eq([&Code::ForeignFile]));
}

/// What the volume says of itself is compared whatever its name, which is told if nothing else differs.
#[test]
fn a_source_of_another_name_is_compared_all_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let field = noisy_set(dir.path());
    let found = |edit: fn(&mut SourceVolume)| {
        let report = compare_with(dir.path(), &field, |s| {
            s.name = "copy.raw".into();
            edit(s);
        });
        assert!(
            codes(&report).iter().eq([&Code::SourceMismatch]),
            "{report:#?}"
        );
        let paths: Vec<String> = report.issues.iter().map(|i| i.path.clone()).collect();
        (report.ok, paths.join(" ").replace("index.json#/", ""))
    };
    let name = (true, "source/name".to_owned());
    assert_eq!(found(|_| {}), name);
    assert_eq!(
        found(|s| s.header.dtype = Dtype::F64),
        (false, "source/dtype".into())
    );
    assert_eq!(
        found(|s| s.header.dims.0[1] += 1),
        (false, "source/dims".into())
    );
    assert_eq!(
        found(|s| s.values = Some("2 x stored".into())),
        (false, "source/values".into())
    );
    assert_eq!(found(|s| s.offset = 7), (false, "source/offset".into()));
    assert_eq!(
        found(|s| s.provenance.origin = Origin::File),
        (false, "source/provenance/origin".into())
    );
    // another form of file has another offset, and says other things of itself
    assert_eq!(
        found(|s| {
            s.header.format = "nrrd";
            s.offset = 7;
            s.provenance.origin = Origin::File;
        }),
        name
    );
    assert_eq!(
        found(|s| {
            s.header.format = "nrrd";
            s.header.dtype = Dtype::F64;
        }),
        (false, "source/dtype".into())
    );
}

#[test]
fn damaged_bytes_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    noisy_set(dir.path());
    let set = Set(dir.path());
    let place = set.places()[0].clone();
    let files = [
        set.file(&place),
        place.0.clone(),
        dir.path().join("index.json"),
    ];
    for (f, file) in files.iter().enumerate() {
        let sound = fs::read(file).unwrap();
        for i in 0..150 {
            let mut bytes = sound.clone();
            let at = pick(i, f as u64, bytes.len());
            match i % 3 {
                0 => bytes[at] ^= 1 << (i % 8),
                1 => bytes.truncate(at),
                _ => bytes[at] = b"9-\"]{,e"[i as usize % 7],
            }
            fs::write(file, &bytes).unwrap();
            if f == 1 && serde_json::from_slice::<serde_json::Value>(&bytes).is_ok() {
                set.stamp();
            }
            let report = check(dir.path());
            // a change in white space or of a member that is not read may be harmless in the index
            assert!(
                f == 2 || bytes == sound || !report.ok,
                "{}: fault {i}",
                file.display()
            );
        }
        fs::write(file, &sound).unwrap();
        set.stamp();
    }
    assert!(check(dir.path()).ok);
}

#[test]
fn reports_do_not_depend_on_threads_and_keep_to_their_limit() {
    let dir = tempfile::tempdir().unwrap();
    noisy_set(dir.path());
    let set = Set(dir.path());
    for place in set.places() {
        set.edit_tile(&place, |t| {
            for p in &mut t.pieces {
                p.normals[0] = [0.0; 3];
            }
        });
    }
    let run = |threads, max_issues| {
        let options = VerifyOptions {
            threads,
            max_issues,
            ..VerifyOptions::default()
        };
        verify(dir.path(), &options, &Quiet).unwrap()
    };
    let one = run(1, 1000);
    assert!(one.issues.len() > 12);
    assert_eq!(one.issues, run(4, 1000).issues);
    let few = run(2, 5);
    assert_eq!(few.issues, one.issues[..5]);
    assert_eq!(few.issues_omitted as usize, one.issues.len() - 5);
}

#[test]
fn single_phases_and_empty_layers_pass() {
    for (value, cap) in [(0.0, false), (1.0, false), (1.0, true)] {
        let field = Field {
            dims: [9, 8, 7],
            values: vec![value; 9 * 8 * 7],
            threshold: 0.5,
        };
        let dir = tempfile::tempdir().unwrap();
        writer::write(dir.path(), &field, &Style { cap, ..STYLE });
        let report = compare(dir.path(), &field);
        assert!(
            report.ok && report.issues.is_empty(),
            "{value} {cap}: {report:#?}"
        );
    }
    let missing = tempfile::tempdir().unwrap();
    assert!(verify(missing.path(), &VerifyOptions::default(), &Quiet).is_err());
}

/// A compressed tile set of the simple producer's, and its one largest tile.
fn compressed_tile(dir: &Path) -> Vec<u8> {
    noisy_set(dir);
    crate::compress(dir);
    let set = Set(dir);
    fs::read(set.file(&crate::faults::biggest(&set))).unwrap()
}

#[test]
fn damaged_streams_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let sound = compressed_tile(dir.path());
    let set = Set(dir.path());
    let place = crate::faults::biggest(&set);
    let (_, bin) = crate::glb::unwrap(&sound);
    let start = sound.len() - bin.len();
    for seed in 0..400 {
        let mut bytes = sound.clone();
        for k in 0..1 + seed % 7 {
            let at = start + pick(seed, 2 * k, bin.len());
            bytes[at] = (noise(seed, 2 * k + 1) * 256.0) as u8;
        }
        // whatever it is now, it is read or refused
        let _ = alvis::tile::TileMesh::read(&bytes);
        if seed % 20 == 0 {
            set.put_bytes(&place, &bytes);
            check(dir.path());
        }
    }
}

/// Streams that say they are more than their bytes can hold, or use the same bytes twice.
#[test]
fn no_stream_makes_more_than_it_can() {
    let dir = tempfile::tempdir().unwrap();
    let sound = compressed_tile(dir.path());
    let (doc, bin) = crate::glb::unwrap(&sound);
    let extension = "EXT_meshopt_compression";
    let views = doc["bufferViews"].as_array().unwrap().len();
    let streams = (0..views).filter(|&v| !doc["bufferViews"][v]["extensions"].is_null());
    assert_eq!(streams.clone().count(), 4);
    type Edit = fn(&mut serde_json::Value);
    let edits: [(&str, Edit); 8] = [
        ("count", |s| s["count"] = 0.into()),
        ("huge count", |s| s["count"] = (1u64 << 40).into()),
        ("overflow", |s| {
            s["count"] = u64::MAX.into();
            s["byteStride"] = 8.into();
        }),
        ("stride", |s| s["byteStride"] = 3.into()),
        ("mode", |s| s["mode"] = "QUADS".into()),
        ("filter", |s| s["filter"] = "EXPONENTIAL".into()),
        ("offset", |s| s["byteOffset"] = (u64::MAX - 1).into()),
        ("buffer", |s| s["buffer"] = 1.into()),
    ];
    for at in streams {
        for (what, edit) in edits {
            let mut broken = doc.clone();
            edit(&mut broken["bufferViews"][at]["extensions"][extension]);
            let error = alvis::tile::TileMesh::read(&crate::glb::wrap(&broken, &bin)).unwrap_err();
            assert_eq!(
                error.fault,
                alvis::tile::read::Fault::Compression,
                "{what}: {error}"
            );
        }
        // consistent, and more than any stream of that length holds
        let mut broken = doc.clone();
        let view = &mut broken["bufferViews"][at];
        let stride = view["extensions"][extension]["byteStride"]
            .as_u64()
            .unwrap();
        let count = (1u64 << 31) / stride / 3 * 3;
        view["extensions"][extension]["count"] = count.into();
        view["byteLength"] = (count * stride).into();
        view["byteOffset"] = 0.into();
        broken["buffers"][1]["byteLength"] = (1u64 << 31).into();
        let error = alvis::tile::TileMesh::read(&crate::glb::wrap(&broken, &bin)).unwrap_err();
        assert!(error.message.contains("expected at least"), "{error}");
        // the same bytes again and again
        let mut broken = doc.clone();
        let view = broken["bufferViews"][at].clone();
        let list = broken["bufferViews"].as_array_mut().unwrap();
        list.extend(std::iter::repeat_n(view, 2000));
        let error = alvis::tile::TileMesh::read(&crate::glb::wrap(&broken, &bin)).unwrap_err();
        assert!(error.message.contains("other streams use them"), "{error}");
    }
}
