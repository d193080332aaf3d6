//! `alvis export`: the mesh of a file is the surface of the tiles, sewn, in every format.

mod command;
mod common;
mod export_common;

use alvis::convert::{ConvertOptions, RegionOfInterest, convert};
use alvis::export::{ExportOptions, ExportReport, Simplify, export};
use alvis::grid::{Ambiguous, Cylinder, Dims, Fill, Placement, Shape, Unit};
use alvis::manifest::Primitives;
use alvis::progress::Quiet;
use alvis::table::{Chosen, Table};
use alvis::volume::{MemoryVolume, RegionVoxels, Volume};
use common::volumes::{foam, noise, placed, volume};
use common::{converted, set, verified};
use export_common::{Mesh, read};
use std::collections::BTreeMap;
use std::path::Path;

const FORMATS: [&str; 4] = ["a.ply", "a.obj", "a.glb", "a.stl"];

fn made(dir: &Path, file: &Path, options: &ExportOptions) -> ExportReport {
    let options = ExportOptions {
        force: true,
        ..options.clone()
    };
    export(dir, file, &options, &Quiet).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

fn condition(text: &str) -> ExportOptions {
    ExportOptions {
        chosen: Chosen::cells(text),
        ..ExportOptions::default()
    }
}

/// Converts a volume of 128 as threshold.
fn tiles(volume: &dyn Volume, options: ConvertOptions) -> tempfile::TempDir {
    let options = ConvertOptions {
        threshold: 128.0,
        ..options
    };
    converted(volume, &options).0
}

/// Tile sets of unit voxels: ragged macrocubes, both rules, strips and lists, merged layout, caps.
fn sets() -> Vec<(&'static str, tempfile::TempDir)> {
    let dims = [19, 17, 14];
    let plain = ConvertOptions::default;
    let with = |macrocube, cap, ambiguous| ConvertOptions {
        macrocube,
        cap,
        ambiguous,
        ..plain()
    };
    let (separate, join) = (Ambiguous::Separate, Ambiguous::Join);
    let a = volume(dims, noise(dims, 3));
    let b = volume(dims, foam(dims, 5));
    let lists = ConvertOptions {
        primitives: Primitives::Triangles,
        ..with([5, 4, 3], true, join)
    };
    vec![
        ("noise, one tile", tiles(&a, plain())),
        (
            "noise, a tile per cube",
            tiles(&a, with([1; 3], false, separate)),
        ),
        ("noise, capped", tiles(&a, with([4, 7, 3], true, separate))),
        ("noise, joined, capped, lists", tiles(&a, lists)),
        ("foam", tiles(&b, with([6; 3], false, join))),
        ("foam, capped", tiles(&b, with([1, 16, 5], true, join))),
    ]
}

#[test]
fn every_format_has_the_sewn_surface_of_the_tiles() {
    for (name, dir) in sets() {
        let report = verified(dir.path(), None);
        let surface = set::weld(dir.path());
        let cells: BTreeMap<_, u64> = surface
            .triangles
            .iter()
            .map(|(t, id)| (*t, id[0]))
            .collect();
        let caps = cells.values().any(|&c| c == 0);
        for format in FORMATS {
            let file = dir.path().join(format);
            let made = made(dir.path(), &file, &ExportOptions::default());
            assert_eq!(made.triangles, report.triangles, "{name}");
            assert_eq!(made.bytes, std::fs::metadata(&file).unwrap().len());
            let mut mesh = read(&file);
            if format == "a.stl" {
                assert_eq!(made.vertices, None);
                mesh = mesh.joined();
            } else {
                assert_eq!(made.vertices, Some(report.vertices), "{name}");
                assert_eq!(mesh.normals.len(), mesh.vertices.len());
            }
            assert_eq!(
                mesh.vertices.len() as u64,
                report.vertices,
                "{name} {format}"
            );
            let edges = mesh.edges();
            assert_eq!(edges.open as u64, report.border_edges, "{name} {format}");
            assert_eq!(edges.euler, report.euler_characteristic, "{name} {format}");
            let found = mesh.lattice();
            assert_eq!(found.len() as u64, report.triangles);
            // a vertex of a cap and a surface has one cell in GLB; STL has none
            if format == "a.stl" || format == "a.glb" && caps {
                assert!(found.keys().eq(cells.keys()), "{name} {format}");
            } else {
                assert_eq!(found, cells, "{name} {format}");
            }
        }
        let ply = read(&dir.path().join("a.ply"));
        for (t, object) in ply.triangles.iter().zip(&ply.objects) {
            let corners = t.map(|v| ply.vertices[v].map(|c| (c * 256.0) as i32));
            assert_eq!(
                surface.triangles[&common::glb::canonical(corners)][1],
                *object
            );
        }
        for (v, n) in ply.vertices.iter().zip(&ply.normals) {
            let bits = surface.normals[&v.map(|c| (c * 256.0) as i32)];
            let stated = bits.map(|b| f64::from(f32::from_bits(b)));
            assert!(
                (0..3).all(|a| (stated[a] - n[a]).abs() < 1e-6),
                "{stated:?} {n:?}"
            );
        }
    }
}

#[test]
fn coordinates_are_physical_and_triangles_face_the_air() {
    let dims = [20, 18, 16];
    let dir = tiles(
        &placed(dims, foam(dims, 2)),
        ConvertOptions {
            macrocube: [7; 3],
            cap: true,
            ..ConvertOptions::default()
        },
    );
    let manifest = set::manifest(dir.path());
    let [x, y, z] = manifest.placement.spacing;
    let lattice = i128::from(LATTICE).pow(3) as f64 * 6.0;
    let volume = manifest.totals.volume6 as f64 / lattice * x * y * z;
    assert!(volume > 0.0);
    for format in ["a.ply", "a.obj", "a.stl"] {
        let file = dir.path().join(format);
        assert_eq!(
            made(dir.path(), &file, &ExportOptions::default()).unit,
            Unit::Millimetre
        );
        let mesh = read(&file);
        assert!(mesh.text.contains("unit mm"), "{}", mesh.text);
        assert!((mesh.volume() / volume - 1.0).abs() < 1e-5, "{format}");
        outward(&mesh, format);
        // the grid's box, half a voxel larger for the caps
        for v in &mesh.vertices {
            let p: [f64; 3] =
                std::array::from_fn(|a| (v[a] - [-3.0, 10.5, 0.25][a]) / [x, y, z][a]);
            assert!(
                (0..3).all(|a| (-0.51..f64::from(dims[a])).contains(&p[a])),
                "{p:?}"
            );
        }
    }
    // GLB: the matrix of the tiles
    let file = dir.path().join("a.glb");
    made(dir.path(), &file, &ExportOptions::default());
    let stated: [f64; 16] = serde_json::from_str(&read(&file).text).unwrap();
    assert_eq!(stated, manifest.transform);
    let gltf = gltf::Gltf::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    assert_eq!(gltf.meshes().count(), 1);
}

const LATTICE: u32 = alvis::grid::LATTICE;

/// Normals point to the side from which triangles are counter-clockwise, nearly everywhere.
fn outward(mesh: &Mesh, what: &str) {
    let mut sides = [0, 0];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| glam::DVec3::from(mesh.vertices[v]));
        let face = (b - a).cross(c - a);
        for v in t {
            let n = glam::DVec3::from(mesh.normals[*v]);
            assert!((n.length() - 1.0).abs() < 1e-3, "{what}: {n}");
            sides[usize::from(face.dot(n) > 0.0)] += 1;
        }
    }
    assert!(sides[0] * 5 < sides[1], "{what}: {sides:?}");
}

#[test]
fn a_mirrored_grid_is_not_inside_out_and_a_far_origin_is_exact() {
    let dims = [12, 11, 10];
    let samples = foam(dims, 9);
    let mirrored = Placement {
        directions: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        origin: [5e6, 0.0, 0.0],
        ..Placement::default()
    };
    let flip = Placement {
        directions: [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        ..Placement::default()
    };
    for (placement, kind) in [(mirrored, "double"), (flip, "float")] {
        let volume =
            MemoryVolume::new(alvis::grid::Dims(dims), placement, samples.clone()).unwrap();
        let dir = tiles(
            &volume,
            ConvertOptions {
                cap: true,
                ..ConvertOptions::default()
            },
        );
        let totals = set::manifest(dir.path()).totals;
        let inside = totals.volume6 as f64 / 6.0 / f64::from(LATTICE).powi(3);
        for format in ["a.ply", "a.obj"] {
            let file = dir.path().join(format);
            made(dir.path(), &file, &ExportOptions::default());
            let mut mesh = read(&file);
            assert!(format != "a.ply" || mesh.text.contains(&format!("property {kind} x")));
            assert_eq!(mesh.joined().vertices.len() as u64, totals.vertices);
            outward(&mesh, format);
            mesh.vertices
                .iter_mut()
                .for_each(|v| v[0] -= placement.origin[0]);
            assert!((mesh.volume() / inside - 1.0).abs() < 1e-5, "{format}");
        }
        let stl = made(
            dir.path(),
            &dir.path().join("a.stl"),
            &ExportOptions::default(),
        );
        assert_eq!(stl.warnings.len(), usize::from(kind == "double"));
    }
}

#[test]
fn a_part_is_what_select_writes() {
    let dims = [40, 36, 32];
    for cap in [false, true] {
        let dir = tiles(
            &volume(dims, foam(dims, 4)),
            ConvertOptions {
                macrocube: [16; 3],
                cap,
                ..ConvertOptions::default()
            },
        );
        for text in ["not touches_border", "voxels > 3", "id > 0", "id <= 4"] {
            let beside = tempfile::tempdir().unwrap();
            let part = beside.path().join("part");
            let options = alvis::transform::select::SelectOptions {
                chosen: Chosen::cells(text),
                force: true,
                ..Default::default()
            };
            alvis::transform::select::select(dir.path(), &part, &options, &Quiet).unwrap();
            let report = verified(&part, None);
            for format in FORMATS {
                let (a, b) = (
                    dir.path().join(format),
                    dir.path().join(format!("b{format}")),
                );
                let all = made(dir.path(), &a, &condition(text));
                made(&part, &b, &ExportOptions::default());
                assert_eq!(all.triangles, report.triangles, "{text}");
                // the faces of the volume cut some cells, unless they are capped
                let is_open = all
                    .warnings
                    .iter()
                    .any(|w| w.contains("is open at the faces"));
                let cut = text == "id > 0" && !cap;
                assert!(is_open || !cut, "{text} {cap}");
                assert!(!(is_open && text == "not touches_border"), "{text} {cap}");
                assert!(
                    std::fs::read(a).unwrap() == std::fs::read(b).unwrap(),
                    "{text} {format}"
                );
            }
        }
    }
}

/// Whoever exports a mesh that is open at the faces of the volume is told so, and nobody else is: of a whole set, of objects
/// and of cells, with a region or without.
#[test]
fn a_mesh_that_is_open_at_the_faces_comes_with_a_warning() {
    let dims = [30, 28, 24];
    let cylinder = Cylinder {
        centre: [14.5, 13.5],
        radius: 12.0,
    };
    let voxels = RegionVoxels::cylinder(&cylinder, Dims(dims)).unwrap();
    for (fill, cap) in [
        (None, false),
        (None, true),
        (Some(Fill::Material), false),
        (Some(Fill::Air), false),
        (Some(Fill::Air), true),
    ] {
        let region = fill.map(|fill| {
            let value = if fill == Fill::Air { 20.0 } else { 230.0 };
            let shape = Shape::Cylinder(cylinder);
            RegionOfInterest::new(shape, voxels.clone(), None, fill, value).unwrap()
        });
        let options = ConvertOptions {
            macrocube: [16; 3],
            cap,
            region,
            ..ConvertOptions::default()
        };
        let dir = tiles(&volume(dims, foam(dims, 4)), options);
        let file = dir.path().join("a.ply");
        let chosen = |table, condition: Option<&str>, largest| Chosen {
            table,
            condition: condition.map(str::to_owned),
            largest,
        };
        for chosen in [
            Chosen::default(),
            chosen(Table::Objects, None, Some(1)),
            chosen(Table::Objects, Some("not touches_border"), None),
            chosen(Table::Cells, None, Some(1)),
            chosen(Table::Cells, Some("touches_border"), None),
            chosen(Table::Cells, Some("not touches_border"), None),
            chosen(Table::Surfaces, None, Some(1)),
            chosen(Table::Surfaces, Some("not touches_border"), None),
        ] {
            let options = ExportOptions {
                chosen,
                ..ExportOptions::default()
            };
            let Ok(report) = export(dir.path(), &file, &options, &Quiet) else {
                // none is so
                continue;
            };
            let edges = read(&file).joined().edges();
            let told = report
                .warnings
                .iter()
                .any(|w| w.contains("is open at the faces"));
            let found = format!(
                "{fill:?}, cap {cap}, {:?}: {:?}",
                options.chosen, report.warnings
            );
            assert_eq!(told, edges.open > 0, "{found}");
            std::fs::remove_file(&file).unwrap();
        }
    }
}

/// Two pores that are open to each other, and a crumb in the first: whatever surfaces are chosen, who exports a mesh that is
/// open between pores is told so, and nobody else is.
#[test]
fn a_mesh_that_is_open_between_cells_comes_with_a_warning() {
    let dims = [54, 30, 30];
    let samples = common::volumes::samples(dims, |p| {
        let [x, y, z] = p.map(f64::from);
        let off = |cx: f64, cz: f64| {
            let [dx, dy, dz] = [x - cx, y - 15.0, z - cz];
            (dx * dx + dy * dy + dz * dz).sqrt()
        };
        let wall = off(17.0, 15.0).min(off(35.0, 15.0)) - 10.0;
        let crumb = 1.6 - off(13.0, 9.0);
        (128.0 + 40.0 * wall.max(crumb)).clamp(0.0, 255.0) as u8
    });
    let options = ConvertOptions {
        macrocube: [16; 3],
        split: Some(alvis::split::NeckRule::default()),
        ..ConvertOptions::default()
    };
    let dir = tiles(&volume(dims, samples), options);
    let totals = alvis::manifest::Manifest::open(dir.path()).unwrap().totals;
    assert_eq!([totals.cells, totals.surfaces], [2, 3]);
    let mut seen = [0; 2];
    for chosen in 1u32..8 {
        let ids = (1..=3).filter(|id| chosen >> (id - 1) & 1 == 1);
        let ids: Vec<String> = ids.map(|id| format!("id == {id}")).collect();
        for simplify in [None, Some(Simplify::Ratio(0.5))] {
            let options = ExportOptions {
                chosen: Chosen {
                    table: Table::Surfaces,
                    condition: Some(ids.join(" or ")),
                    largest: None,
                },
                simplify,
                ..ExportOptions::default()
            };
            let file = dir.path().join("a.ply");
            let report = made(dir.path(), &file, &options);
            let is_open = read(&file).edges().open > 0;
            let told = report.warnings.iter();
            let told = told.filter(|w| w.contains("is open at")).count();
            assert_eq!(told, usize::from(is_open), "{ids:?}: {:?}", report.warnings);
            seen[usize::from(is_open)] += 1;
        }
    }
    // the crumb, all of them, and what is without it
    assert_eq!(seen, [6, 8]);
}

/// Every piece belongs to one object and one surface, a cap to an object; the largest are those of the table.
#[test]
fn objects_and_surfaces_are_chosen_by_their_own_tables() {
    let dims = [24, 22, 20];
    for cap in [false, true] {
        let options = ConvertOptions {
            macrocube: [9; 3],
            cap,
            ..ConvertOptions::default()
        };
        let dir = tiles(&volume(dims, noise(dims, 8)), options);
        let manifest = alvis::manifest::Manifest::open(dir.path()).unwrap();
        let totals = manifest.totals;
        let file = dir.path().join("a.ply");
        let triangles = |chosen: Chosen| {
            let options = ExportOptions {
                chosen,
                ..ExportOptions::default()
            };
            made(dir.path(), &file, &options).triangles
        };
        for (table, size) in [
            (Table::Cells, "volume"),
            (Table::Objects, "volume"),
            (Table::Surfaces, "area"),
        ] {
            let chosen = |condition: Option<String>, largest| Chosen {
                table,
                condition,
                largest,
            };
            let mut rows = table.open(dir.path(), &manifest).unwrap();
            let size = rows.column(size).unwrap();
            let mut sizes = Vec::new();
            while let Some(row) = rows.next_row().unwrap() {
                sizes.push((row.number(size).unwrap().unwrap(), row.whole(0).unwrap()));
            }
            sizes.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let many = sizes.len().min(4);
            let condition: Vec<String> = sizes[..many]
                .iter()
                .map(|(_, id)| format!("id == {id}"))
                .collect();
            let alone: u64 = condition
                .iter()
                .map(|c| triangles(chosen(Some(c.clone()), None)))
                .sum();
            let largest = triangles(chosen(None, Some(many)));
            let together = triangles(chosen(Some(condition.join(" or ")), None));
            assert_eq!(largest, together, "{table:?}");
            if table == Table::Objects {
                // a cell's caps come only if its objects are whole, those of an object always
                assert_eq!(alone, together);
            }
            let all = triangles(chosen(Some("id > 0".into()), None));
            let caps = if table == Table::Objects || cap {
                0
            } else {
                totals.cap_triangles
            };
            assert_eq!(all, totals.triangles - caps, "{table:?} {cap}");
            // a condition first, then the largest of what is left
            let but_first = format!("id != {}", sizes[0].1);
            let second = triangles(chosen(Some(but_first), Some(1)));
            assert_eq!(second, triangles(chosen(Some(condition[1].clone()), None)));
        }
        // the largest object with its caps is closed
        if cap {
            let options = ExportOptions {
                chosen: Chosen {
                    table: Table::Objects,
                    largest: Some(1),
                    ..Chosen::default()
                },
                ..ExportOptions::default()
            };
            made(dir.path(), &file, &options);
            assert_eq!(read(&file).edges().open, 0);
        }
    }
}

#[test]
fn the_file_is_the_same_for_any_memory_and_threads() {
    let dims = [30, 28, 26];
    let options = ConvertOptions {
        macrocube: [5; 3],
        cap: true,
        ..ConvertOptions::default()
    };
    let dir = tiles(&volume(dims, noise(dims, 8)), options);
    let too_small = export(
        dir.path(),
        &dir.path().join("a.ply"),
        &ExportOptions {
            memory: 1 << 20,
            ..ExportOptions::default()
        },
        &Quiet,
    );
    let Err(alvis::Error::Memory { needed, .. }) = too_small else {
        panic!("{too_small:?}");
    };
    for format in FORMATS {
        for simplify in [None, Some(Simplify::Ratio(0.3))] {
            let mut files = Vec::new();
            for (threads, memory) in [(1, 2 * needed), (3, 2 * needed), (2, 1 << 30)] {
                let options = ExportOptions {
                    memory,
                    simplify,
                    ..ExportOptions::default()
                };
                let file = dir.path().join(format);
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                pool.install(|| made(dir.path(), &file, &options));
                files.push(std::fs::read(file).unwrap());
            }
            assert!(files[0] == files[1] && files[1] == files[2], "{format}");
        }
    }
}

#[test]
fn what_cannot_be_is_refused_and_leaves_the_old_file() {
    let dims = [24, 24, 24];
    let dir = tempfile::tempdir().unwrap();
    let set = dir.path().join("set");
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [8; 3],
        ..ConvertOptions::default()
    };
    convert(&volume(dims, foam(dims, 4)), &options, &set, &Quiet).unwrap();
    let refusal = |file: &str, options: &ExportOptions| {
        let file = dir.path().join(file);
        std::fs::write(&file, "old").unwrap();
        let options = ExportOptions {
            force: true,
            ..options.clone()
        };
        let error = export(&set, &file, &options, &Quiet)
            .unwrap_err()
            .to_string();
        assert_eq!(std::fs::read(&file).unwrap(), b"old");
        std::fs::remove_file(file).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        error
    };
    let plain = ExportOptions::default();
    assert!(refusal("a.fbx", &plain).contains(".glb, .ply, .stl or .obj"));
    assert!(refusal("a.ply", &condition("id < 0")).contains("holds for 0 of "));
    assert!(refusal("a.ply", &condition("colour > 1")).contains("--where"));
    let of_objects = |text: &str| ExportOptions {
        chosen: Chosen {
            table: Table::Objects,
            ..Chosen::cells(text)
        },
        ..ExportOptions::default()
    };
    assert!(refusal("a.ply", &of_objects("id < 0")).contains("objects"));
    assert!(refusal("a.ply", &of_objects("cell > 1")).contains("cell"));
    for simplify in [
        Simplify::Ratio(0.0),
        Simplify::Ratio(f64::NAN),
        Simplify::Voxels(-1.0),
    ] {
        let options = ExportOptions {
            simplify: Some(simplify),
            ..plain.clone()
        };
        assert!(refusal("a.ply", &options).contains("--simplify"));
    }
    let in_mm = ExportOptions {
        simplify: Some(Simplify::Length(0.1, Unit::Millimetre)),
        ..plain.clone()
    };
    assert!(refusal("a.ply", &in_mm).contains("0.5vx"));
    // a whole GLB of more than 4 GiB is refused before anything is read
    let index = set.join("index.json");
    let text = std::fs::read_to_string(&index).unwrap();
    let vertices = set::manifest(&set).totals.vertices;
    let huge = text.replace(
        &format!("\"vertices\": {vertices}"),
        "\"vertices\": 200000000",
    );
    assert_ne!(huge, text);
    std::fs::write(&index, &huge).unwrap();
    assert!(refusal("a.glb", &plain).contains("4 GiB"));
    // elsewhere the count that does not come out is an error, once it is known
    assert!(refusal("a.ply", &plain).contains("alvis verify"));
    std::fs::write(&index, &text).unwrap();
    let tile = set.join("tiles/z0001/y0001_x0001.glb");
    let mut bytes = std::fs::read(&tile).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&tile, bytes).unwrap();
    for file in FORMATS {
        assert!(refusal(file, &plain).contains("crc32"), "{file}");
    }
}

#[test]
fn the_command_reports_in_words_and_in_json() {
    use command::{fails, foam_tiles, json, ok};
    let dir = foam_tiles(&[]);
    let text = ok(
        dir.path(),
        &["export", "tiles", "a.ply", "--simplify", "20%"],
    );
    assert!(
        text.contains("triangles") && text.contains("mm at most"),
        "{text}"
    );
    let args = [
        "export",
        "tiles",
        "b.GLB",
        "--json",
        "--where",
        "not touches_border",
    ];
    let report = json(&ok(dir.path(), &args));
    assert_eq!(report["format"], "glb");
    let file = dir.path().join("b.GLB");
    assert_eq!(report["bytes"], std::fs::metadata(&file).unwrap().len());
    assert_eq!(report["triangles_before"], serde_json::Value::Null);
    use std::os::unix::fs::PermissionsExt;
    let open = dir.path().join("open");
    std::fs::write(&open, "").unwrap();
    let mode = |p: &Path| std::fs::metadata(p).unwrap().permissions().mode();
    assert_eq!(mode(&file), mode(&open));
    assert!(fails(dir.path(), &["export", "tiles", "a.ply", "--simplify", "2"]).contains("0.5vx"));
    // what is there is replaced only on request
    std::fs::write(dir.path().join("a.ply"), "mine").unwrap();
    let again = ["export", "tiles", "a.ply", "--quiet"];
    let message = fails(dir.path(), &again);
    assert!(
        message.contains("a.ply") && message.contains("--force"),
        "{message}"
    );
    assert_eq!(std::fs::read(dir.path().join("a.ply")).unwrap(), b"mine");
    ok(dir.path(), &[&again[..], &["--force"]].concat());
    assert!(
        std::fs::read(dir.path().join("a.ply"))
            .unwrap()
            .starts_with(b"ply")
    );
    assert!(fails(dir.path(), &["export", "tiles", "no/a.ply"]).contains("no/a.ply"));
    assert!(fails(dir.path(), &["export", "foam.raw", "a.ply"]).contains("foam.raw"));
}
