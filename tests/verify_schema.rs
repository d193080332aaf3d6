//! The JSON Schemas against values of the Rust types, and against values that must not pass.

use alvis::grid::{
    Ambiguous, Crop, Cylinder, Dims, Fill, Filter, Part, Placement, Provenance, Region, Shape, Unit,
};
use alvis::manifest::{
    Bounds, ColourBy, Encoding, FORMAT, FORMAT_VERSION, Generator, GridInfo, Group, LEVELS, Layer,
    Layout, LevelsEntry, Manifest, Paint, Painted, ParquetTables, PartsBy, Primitives, Selection,
    Shard, Source, Step, Table, TableChecksums, Tables, TileEntry, Totals, WholeTotals,
    checksum_text,
};
use alvis::verify::{Code, Issue, Report, Severity};
use alvis::volume::{Dtype, Endian};
use serde_json::{Value, json};

/// Validates with the schema of that name; the schema itself is checked against draft 2020-12.
fn valid(name: &str, value: &Value) -> Result<(), String> {
    let path = format!("{}/schema/{name}.schema.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read(&path).unwrap();
    let mut compiler = boon::Compiler::new();
    compiler.set_default_draft(boon::Draft::V2020_12);
    compiler
        .add_resource(name, serde_json::from_slice(&text).unwrap())
        .unwrap();
    let mut schemas = boon::Schemas::new();
    let index = compiler
        .compile(name, &mut schemas)
        .unwrap_or_else(|e| panic!("{path}: {e:#}"));
    schemas.validate(value, index).map_err(|e| format!("{e:#}"))
}

fn manifest() -> Manifest {
    let placement = Placement {
        unit: Unit::Micrometre,
        ..Placement::default()
    };
    Manifest {
        format: FORMAT.into(),
        format_version: FORMAT_VERSION,
        generator: Generator {
            name: "alvis".into(),
            version: "0.1.0".into(),
        },
        source: Source {
            name: "scan.raw".into(),
            format: "raw".into(),
            dims: Dims([300, 200, 100]),
            dtype: Dtype::U16,
            values: Some("0.5 x stored - 1000".into()),
            endian: Endian::Big,
            offset: 512,
            crop: Some(Crop {
                x: 0..300,
                y: 0..200,
                z: 10..90,
            }),
            part: Part {
                dataset: Some("entry/data".into()),
                ..Part::default()
            },
            provenance: Provenance::default(),
        },
        filters: vec![
            Filter::Invert {},
            Filter::Clamp {
                low: -0.5,
                high: 1e4,
            },
        ],
        region: Some(Region {
            shape: Shape::Cylinder(Cylinder {
                centre: [150.0, 99.5],
                radius: 90.0,
            }),
            fill: Fill::Material,
            fill_value: 40_000.0,
            voxels: 2_035_680,
        }),
        grid: GridInfo {
            dims: Dims([300, 200, 80]),
            macrocube: [64; 3],
            tiles: [5, 4, 2],
        },
        placement,
        table_unit: Some(Unit::Millimetre),
        threshold: -0.5,
        ambiguous: Ambiguous::Join,
        cap: true,
        primitives: Primitives::Triangles,
        encoding: Encoding::Meshopt,
        layout: Layout::Merged,
        cells: Some(PartsBy::Labels {
            file: "pores.npy".into(),
            checksum: "crc32:0000000a".into(),
            unlabelled: Some(7),
        }),
        dust: None,
        lattice: 256,
        transform: placement.gltf_matrix(),
        totals: Totals {
            volume6: -(1 << 100),
            euler_characteristic: -2,
            components: 5,
            ..Totals::default()
        },
        layers: vec![Layer {
            z: 0,
            path: "index/z0000.json".into(),
            tiles: 1,
            bytes: 1,
            checksum: checksum_text(0xAB),
        }],
        tables: Tables {
            cells: "cells.csv".into(),
            objects: "objects.csv".into(),
            surfaces: "surfaces.csv".into(),
            components: Some("components.csv".into()),
            necks: Some("necks.csv".into()),
            walls: Some("walls.csv".into()),
            checksums: Some(TableChecksums {
                cells: "crc32:00000001".into(),
                objects: "crc32:00000002".into(),
                surfaces: "crc32:00000003".into(),
                components: Some("crc32:00000007".into()),
                necks: Some("crc32:00000008".into()),
                walls: Some("crc32:00000009".into()),
            }),
            parquet: Some(ParquetTables {
                cells: "cells.parquet".into(),
                objects: "objects.parquet".into(),
                surfaces: "surfaces.parquet".into(),
                components: None,
                necks: None,
                walls: Some("walls.parquet".into()),
                checksums: Some(TableChecksums {
                    cells: "crc32:00000004".into(),
                    objects: "crc32:00000005".into(),
                    surfaces: "crc32:00000006".into(),
                    components: None,
                    necks: None,
                    walls: None,
                }),
            }),
        },
        selection: Some(Selection {
            last: Step {
                condition: Some("volume > 1".into()),
                omit: true,
                table: Table::Objects,
                largest: Some(3),
            },
            before: vec![Step::default()],
            painted: vec![Paint {
                condition: "best:3".into(),
                colour: "#00ff00".into(),
                count: Painted::Objects(3),
            }],
            colour_by: Some(ColourBy {
                column: "volume".into(),
                unit: "mm^3".into(),
                map: "viridis".into(),
                min: 0.5,
                max: 2.0,
                colours: vec!["#440154".into(), "#fde725".into()],
                legend: "legend.png".into(),
            }),
            of: WholeTotals::default(),
        }),
        lod: Some(LevelsEntry {
            path: LEVELS.into(),
            levels: 3,
            bytes: 100,
            checksum: checksum_text(0xCD),
        }),
        checksum: Some("crc32:0123abcd".into()),
    }
}

fn shard() -> Shard {
    Shard {
        z: 3,
        tiles: vec![TileEntry {
            path: "tiles/z0003/y0002_x0005.glb".into(),
            grid: [5, 2, 3],
            bounds: Bounds {
                min: [-0.5, 0.00390625, 1.0],
                max: [64.0, 63.5, 65535.5],
            },
            vertices: 9,
            triangles: 3,
            strips: 1,
            indices: 5,
            bytes: 1000,
            checksum: checksum_text(0xFFFF_FFFF),
            groups: vec![Group {
                cell: 0,
                object: 1,
                surface: 0,
                vertices: 9,
                triangles: 3,
            }],
        }],
    }
}

fn report() -> Report {
    Report {
        ok: false,
        against: true,
        labels: true,
        part: false,
        unproved: vec!["which voxels a mask holds".to_owned()],
        tiles: 1,
        triangles: 2,
        cap_triangles: 0,
        vertices: 3,
        tile_vertices: 4,
        border_edges: 5,
        surfaces: 6,
        objects: 7,
        cells: 8,
        components: Some(9),
        euler_characteristic: -9,
        volume6: -(1 << 70),
        bytes: 10,
        issues: Code::ALL
            .iter()
            .map(|&code| Issue {
                code,
                severity: Severity::Error,
                path: "index.json#/grid".into(),
                message: "found 1, expected 2".into(),
                voxel: (code != Code::Checksum).then_some([1.0, 2.5, -0.5]),
            })
            .collect(),
        issues_omitted: 11,
        seconds: 0.25,
        peak_rss_bytes: 12,
    }
}

#[test]
fn values_of_the_types_pass() {
    for (name, value) in [
        ("manifest", serde_json::to_value(manifest())),
        ("shard", serde_json::to_value(shard())),
        ("report", serde_json::to_value(report())),
    ] {
        valid(name, &value.unwrap()).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    let extras = json!({"cell": 3, "object": 1, "surface": 2, "triangles": 40, "area": 1.5,
        "unit": "mm", "touches_border": 0});
    valid("extras", &extras).unwrap();
}

#[test]
fn cells_are_split_or_given_by_labels() {
    let mut value = serde_json::to_value(manifest()).unwrap();
    let split = json!({"by": "split", "version": 1, "ratio_permille": 800, "h_256": 128, "min_radius_256": 0,
        "weights": [1, 1, 4], "unit": 1, "reach": 255, "curve": [[500, 25], [800, 89]]});
    value["cells"] = split.clone();
    valid("manifest", &value).unwrap();
    let read: Manifest = serde_json::from_value(value.clone()).unwrap();
    assert_eq!(serde_json::to_value(read).unwrap()["cells"], split);
    for wrong in [
        json!({"by": "hand"}),
        json!({"by": "labels"}),
        json!({"by": "split", "version": 1}),
    ] {
        value["cells"] = wrong;
        assert!(valid("manifest", &value).is_err());
    }
}

#[test]
fn codes_keep_their_names() {
    for code in Code::ALL {
        assert_eq!(serde_json::to_value(code).unwrap(), code.name());
    }
}

#[test]
fn broken_values_do_not_pass() {
    let breaks: &[(&str, &str, Value)] = &[
        ("manifest", "/format_version", json!(2)),
        ("manifest", "/lattice", json!(128)),
        ("manifest", "/spacing/1", json!(0.0)),
        ("manifest", "/tables/cells", json!("../cells.csv")),
        ("manifest", "/tables/cells", json!("/cells.csv")),
        ("manifest", "/layers/0/path", json!("index/../z0000.json")),
        ("manifest", "/totals/volume6", json!(12)),
        ("manifest", "/grid/dims", json!([1, 2, 3])),
        ("manifest", "/filters", json!([])),
        ("manifest", "/filters/0/name", json!("sharpen")),
        ("manifest", "/filters/0/name", json!("clamp")),
        ("manifest", "/filters/1/name", json!("invert")),
        (
            "manifest",
            "/filters/1",
            json!({"name": "downsample", "factor": 1}),
        ),
        (
            "manifest",
            "/filters/1",
            json!({"name": "downsample", "low": 2}),
        ),
        ("shard", "/tiles/0/path", json!("tiles/../../x.glb")),
        ("shard", "/tiles/0/checksum", json!("crc32:0")),
        ("shard", "/tiles/0/box/min/0", json!(0.3)),
        ("shard", "/tiles/0/groups", json!([])),
        ("report", "/issues/0/code", json!("SOMETHING")),
        ("report", "/issues/0/voxel", json!([1, 2])),
        ("report", "/ok", json!("yes")),
    ];
    for (name, place, bad) in breaks {
        let mut value = match *name {
            "manifest" => serde_json::to_value(manifest()),
            "shard" => serde_json::to_value(shard()),
            _ => serde_json::to_value(report()),
        }
        .unwrap();
        *value.pointer_mut(place).unwrap() = bad.clone();
        assert!(valid(name, &value).is_err(), "{name}{place} = {bad} passes");
    }
    for more in [json!([1]), json!("text"), json!(1)] {
        let extras = json!({"cell": 3, "object": 1, "surface": 2, "triangles": 40, "more": more});
        assert!(valid("extras", &extras).is_err());
    }
}

/// The format is closed: no object has a place for another member.
#[test]
fn members_that_are_not_of_the_format_do_not_pass() {
    fn objects(value: &Value, at: String, out: &mut Vec<String>) {
        match value {
            Value::Object(members) => {
                let name = |key: &str| format!("{at}/{key}");
                members
                    .iter()
                    .for_each(|(key, v)| objects(v, name(key), out));
                out.push(at);
            }
            Value::Array(items) => {
                let all = items.iter().enumerate();
                all.for_each(|(i, v)| objects(v, format!("{at}/{i}"), out));
            }
            _ => {}
        }
    }
    for (name, sound) in [
        ("manifest", serde_json::to_value(manifest()).unwrap()),
        ("shard", serde_json::to_value(shard()).unwrap()),
    ] {
        let mut places = Vec::new();
        objects(&sound, String::new(), &mut places);
        assert!(places.len() > 3);
        for place in places {
            let mut value = sound.clone();
            value.pointer_mut(&place).unwrap()["more"] = json!(1);
            assert!(valid(name, &value).is_err(), "{name}{place}/more passes");
        }
    }
}
