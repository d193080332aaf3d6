//! The files of real tile sets, and the verifier's reports, against the JSON Schemas in `schema/`.

mod common;

use alvis::convert::{COMPONENT_COLUMNS, ConvertOptions};
use alvis::grid::{Ambiguous, Crop, Unit};
use alvis::manifest::Primitives;
use alvis::progress::Quiet;
use alvis::report::{DEFINITIONS, ReportOptions, report};
use alvis::split::NeckRule;
use alvis::table::Outside;
use alvis::verify::{VerifyOptions, verify};
use common::volumes::{foam, noise, placed};
use common::{converted, files, glb, options};
use serde_json::Value;

/// A compiled schema of `schema/`.
struct Schema {
    schemas: boon::Schemas,
    index: boon::SchemaIndex,
}

impl Schema {
    fn new(name: &str) -> Self {
        let path = format!("{}/schema/{name}.schema.json", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
        let mut compiler = boon::Compiler::new();
        compiler.set_default_draft(boon::Draft::V2020_12);
        // the schema of tiles refers to that of extras
        let extras = format!("{}/schema/extras.schema.json", env!("CARGO_MANIFEST_DIR"));
        let extras = serde_json::from_slice(&std::fs::read(extras).unwrap()).unwrap();
        let id = "https://alvis.invalid/schema/extras.schema.json";
        compiler.add_resource(id, extras).unwrap();
        compiler
            .add_resource(name, serde_json::from_slice(&text).unwrap())
            .unwrap();
        let mut schemas = boon::Schemas::new();
        let index = compiler
            .compile(name, &mut schemas)
            .unwrap_or_else(|e| panic!("{path}: {e:#}"));
        Schema { schemas, index }
    }

    fn check(&self, value: &Value, what: &str) {
        if let Err(e) = self.schemas.validate(value, self.index) {
            panic!("{what}: {e:#}\n{value:#}");
        }
    }
}

/// Checks every JSON of a tile set; returns how many extras there were.
fn check_set(files: &std::collections::BTreeMap<String, Vec<u8>>) -> usize {
    let [manifest, shard, tile, extras] = ["manifest", "shard", "tile", "extras"].map(Schema::new);
    let mut count = 0;
    for (name, bytes) in files {
        if name == "index.json" {
            manifest.check(&serde_json::from_slice(bytes).unwrap(), name);
        } else if name.starts_with("index/") {
            shard.check(&serde_json::from_slice(bytes).unwrap(), name);
        } else if name.ends_with(".glb") {
            let json = glb::chunks(bytes).0;
            tile.check(&json, name);
            for node in json["nodes"].as_array().unwrap() {
                if let Some(found) = node.get("extras") {
                    extras.check(found, name);
                    count += 1;
                }
            }
        }
    }
    count
}

#[test]
fn real_tile_sets_follow_the_schemas() {
    let dims = [30, 26, 24];
    let report = Schema::new("report");
    let base = ConvertOptions {
        threshold: 128.0,
        macrocube: [12; 3],
        ..ConvertOptions::default()
    };
    let crop = Crop {
        x: 1..30,
        y: 0..20,
        z: 2..23,
    };
    for (what, options) in [
        ("plain", base.clone()),
        (
            "cap",
            ConvertOptions {
                cap: true,
                ambiguous: Ambiguous::Join,
                ..base.clone()
            },
        ),
        (
            "lists",
            ConvertOptions {
                primitives: Primitives::Triangles,
                crop: Some(crop),
                ..base.clone()
            },
        ),
        (
            "tables in another unit",
            ConvertOptions {
                table_unit: Some(Unit::Micrometre),
                ..base.clone()
            },
        ),
        (
            "empty",
            ConvertOptions {
                threshold: 1000.0,
                ..base.clone()
            },
        ),
    ] {
        let volume = placed(dims, foam(dims, 9));
        let (dir, _) = converted(&volume, &options);
        let extras = check_set(&files(dir.path()));
        assert_eq!(extras > 0, what != "empty");
        let found = verify(dir.path(), &VerifyOptions::default(), &Quiet).unwrap();
        assert!(found.ok, "{:#?}", found.issues);
        report.check(&serde_json::to_value(&found).unwrap(), what);
    }
}

#[test]
fn a_merged_tile_set_and_a_report_with_issues_follow_the_schemas() {
    let dims = [30; 3];
    let sparse = noise(dims, 3)
        .into_iter()
        .map(|v| if v < 26 { 255 - v } else { v / 2 })
        .collect();
    let options = ConvertOptions {
        threshold: 128.0,
        ..ConvertOptions::default()
    };
    let (dir, _) = converted(&placed(dims, sparse), &options);
    let before = files(dir.path());
    assert_eq!(check_set(&before), 0, "a merged tile has no extras");
    let tile = "tiles/z0000/y0000_x0000.glb";
    let mut bytes = before[tile].clone();
    let at = bytes.len() / 2;
    bytes[at] ^= 0x40;
    std::fs::write(dir.path().join(tile), bytes).unwrap();
    let found = verify(dir.path(), &VerifyOptions::default(), &Quiet).unwrap();
    assert!(!found.ok && !found.issues.is_empty());
    Schema::new("report").check(&serde_json::to_value(&found).unwrap(), "a broken tile");
}

/// Lab reports of a whole, a part, a set of one phase and one whose air is left out.
#[test]
fn lab_reports_follow_the_schema() {
    let schema = Schema::new("labreport");
    let with = [Outside::None, Outside::BorderCell];
    let dims = [30, 28, 26];
    for (what, samples) in [
        ("foam", foam(dims, 4)),
        ("noise", noise(dims, 2)),
        ("air", vec![0; 30 * 28 * 26]),
    ] {
        let volume = placed(dims, samples);
        let (dir, _) = converted(&volume, &options([16; 3]));
        for outside in with {
            let options = ReportOptions {
                outside,
                ..ReportOptions::default()
            };
            let found = report(dir.path(), &options, &Quiet).unwrap();
            schema.check(&serde_json::to_value(&found).unwrap(), what);
        }
        let options = ConvertOptions {
            walls: true,
            split: Some(NeckRule::default()),
            ..options([16; 3])
        };
        let (dir, _) = converted(&volume, &options);
        let found = report(dir.path(), &ReportOptions::default(), &Quiet).unwrap();
        assert!(found.necks.is_some() && found.walls.is_some());
        schema.check(&serde_json::to_value(&found).unwrap(), what);
    }
}

/// What the page of a report cites stands in the documentation, too.
#[test]
fn definitions_are_documented() {
    let path = format!("{}/docs/definitions.md", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    for definition in DEFINITIONS {
        assert!(text.contains(definition.source), "{}", definition.source);
        assert!(
            text.contains(definition.quantity),
            "{}",
            definition.quantity
        );
    }
}

/// A column is a row of one list: what is not made from it has to say the same.
#[test]
fn schema_and_readme_know_every_column() {
    let read = |path: &str| {
        std::fs::read_to_string(format!("{}/{path}", env!("CARGO_MANIFEST_DIR"))).unwrap()
    };
    let schema: Value = serde_json::from_str(&read("schema/extras.schema.json")).unwrap();
    let stated = schema["properties"].as_object().unwrap();
    let own = ["cell", "object", "surface", "triangles", "unit"];
    let measures: Vec<&str> = stated
        .keys()
        .map(String::as_str)
        .filter(|k| !own.contains(k))
        .collect();
    let mut carried: Vec<&str> = COMPONENT_COLUMNS
        .iter()
        .filter(|c| c.in_tiles)
        .map(|c| c.name)
        .collect();
    carried.sort_unstable();
    assert_eq!(measures, carried);
    let readme = read("README.md");
    for column in COMPONENT_COLUMNS {
        // three columns of one kind are told by the first
        let stem = column
            .name
            .strip_suffix("_y")
            .or(column.name.strip_suffix("_z"));
        let told = stem.map_or(column.name.to_string(), |stem| format!("{stem}_x"));
        assert!(
            readme.contains(&format!("`{told}`")),
            "{told} is not in the README"
        );
    }
}
