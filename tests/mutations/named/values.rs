//! Values of another kind, members that are left out, and numbers that are next to the right ones.

use super::Base::{self, Merged, Nodes, Painted, Part, Quantized, Web};
use super::{Edit, Files, column, index, table, tiles};
use alvis::verify::Code;
use serde_json::{Value, json};

/// Writes a number where a measure of the property tables has no value; at least one has none.
fn in_place_of_none(files: &mut Files, name: &str, value: f64) {
    let count = std::cell::Cell::new(0);
    tiles(files, |json, bin| {
        let table = &json["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
        let view = table["properties"][name]["values"].as_u64().unwrap() as usize;
        let view = &json["bufferViews"][view];
        let [start, length] =
            ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
        for cell in bin[start..start + length].chunks_exact_mut(8) {
            if cell == (-1.0f64).to_le_bytes() {
                cell.copy_from_slice(&value.to_le_bytes());
                count.set(count.get() + 1);
            }
        }
    });
    assert!(count.get() > 0, "{name} is everywhere");
}

fn metal(files: &mut Files, name: &str) {
    tiles(files, |j, _| {
        let factor = &mut j["materials"][0]["pbrMetallicRoughness"][name];
        *factor = json!([factor.clone()]);
    });
}

fn no_data(files: &mut Files, name: &str) {
    tiles(files, |j, _| {
        let schema = &mut j["extensions"]["EXT_structural_metadata"]["schema"];
        let value = &mut schema["classes"]["piece"]["properties"][name]["noData"];
        *value = json!([value.clone()]);
    });
}

fn without(value: &mut Value, name: &str) {
    assert!(value.as_object_mut().unwrap().remove(name).is_some());
}

/// Turns all bodies of a table by a tiny angle.
fn turned(files: &mut Files, name: &str) {
    table(files, name, |lines| {
        let at = column(lines, "orientation_x");
        for line in &mut lines[1..] {
            line[at] = (line[at].parse::<f64>().unwrap() + 1e-11).to_string();
        }
    });
}

/// What a reader may take for what it is not, or not miss.
pub const OF_VALUES: &[(&str, Base, Code, Edit)] = &[
    ("NaN for no sphericity", Merged, Code::GltfStructure, |f| {
        in_place_of_none(f, "sphericity", f64::NAN)
    }),
    ("NaN for no form factor", Web, Code::GltfStructure, |f| {
        in_place_of_none(f, "form_factor", f64::NAN)
    }),
    (
        "infinity for no mesh volume",
        Merged,
        Code::GltfStructure,
        |f| in_place_of_none(f, "mesh_volume", f64::INFINITY),
    ),
    (
        "a number for no mesh volume",
        Merged,
        Code::CarriedMeasure,
        |f| in_place_of_none(f, "mesh_volume", 1.0),
    ),
    ("a list as a factor", Nodes, Code::ForeignMember, |f| {
        metal(f, "metallicFactor")
    }),
    (
        "a list as a factor of merged tiles",
        Merged,
        Code::ForeignMember,
        |f| metal(f, "roughnessFactor"),
    ),
    (
        "a list as a factor of small tiles",
        Quantized,
        Code::ForeignMember,
        |f| metal(f, "metallicFactor"),
    ),
    (
        "a list as a factor of a part",
        Part,
        Code::ForeignMember,
        |f| metal(f, "roughnessFactor"),
    ),
    ("a list as noData", Merged, Code::ForeignMember, |f| {
        no_data(f, "area")
    }),
    (
        "a list as noData of an integer",
        Web,
        Code::ForeignMember,
        |f| no_data(f, "euler_characteristic"),
    ),
    (
        "an index without its checksum",
        Nodes,
        Code::ForeignMember,
        |f| index(f, |m| without(m, "checksum")),
    ),
    (
        "an index without those of tables",
        Web,
        Code::ForeignMember,
        |f| index(f, |m| without(&mut m["tables"], "checksums")),
    ),
    (
        "an index without one of a table",
        Nodes,
        Code::ManifestSyntax,
        |f| index(f, |m| without(&mut m["tables"]["checksums"], "objects")),
    ),
    (
        "an index without an encoding",
        Nodes,
        Code::ForeignMember,
        |f| index(f, |m| without(m, "encoding")),
    ),
    (
        "an index without a layout",
        Nodes,
        Code::ForeignMember,
        |f| index(f, |m| without(m, "layout")),
    ),
    (
        "one word for the sizes of all axes",
        Nodes,
        Code::ManifestSyntax,
        |f| {
            index(f, |m| {
                m["source"]["provenance"]["spacing"] = "default".into()
            })
        },
    ),
    (
        "all left out but painted",
        Painted,
        Code::ManifestValue,
        |f| index(f, |m| m["selection"]["omit"] = true.into()),
    ),
    ("painted twice", Painted, Code::ManifestValue, |f| {
        index(f, |m| {
            let painted = m["selection"]["painted"].as_array_mut().unwrap();
            painted.push(painted[0].clone());
        })
    }),
    ("cells that are turned", Nodes, Code::TableValue, |f| {
        turned(f, "cells.csv")
    }),
    ("objects that are turned", Merged, Code::TableValue, |f| {
        turned(f, "objects.csv")
    }),
];

/// Calls `each` with a JSON in which one value that is no list or object is in a list of its own, for the first such
/// value of each member, however deep, and with the value's place.
pub fn in_lists(json: &Value, mut each: impl FnMut(&str, Value)) {
    let mut places = Vec::new();
    scalars(json, String::new(), &mut places);
    let member = |at: &str| -> String {
        let is_number = |part: &&str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        at.split('/').filter(|part| !is_number(part)).collect()
    };
    let mut seen = std::collections::BTreeSet::new();
    for at in places {
        if seen.insert(member(&at)) {
            let mut changed = json.clone();
            let value = changed.pointer_mut(&at).unwrap();
            *value = json!([value.clone()]);
            each(&at, changed);
        }
    }
}

fn scalars(value: &Value, at: String, out: &mut Vec<String>) {
    match value {
        Value::Array(items) => {
            let all = items.iter().enumerate();
            all.for_each(|(i, v)| scalars(v, format!("{at}/{i}"), out));
        }
        Value::Object(members) => {
            let all = members.iter();
            all.for_each(|(k, v)| scalars(v, format!("{at}/{k}"), out));
        }
        _ => out.push(at),
    }
}
