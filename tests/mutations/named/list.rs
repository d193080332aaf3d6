//! The faults: what each is called, the set it is in, the code that finds it, and what it changes.

use super::Base::{self, Merged, Nodes, Part, Web};
use super::{Edit, column, exchange, index, json_of, table, texts, tiles};
use alvis::verify::Code;
use serde_json::{Value, json};
use std::collections::BTreeMap;

const METADATA: &str = "/extensions/EXT_structural_metadata";

fn metadata(json: &mut Value) -> &mut Value {
    json.pointer_mut(METADATA).unwrap()
}

fn class_property<'a>(json: &'a mut Value, name: &str) -> &'a mut Value {
    &mut metadata(json)["schema"]["classes"]["piece"]["properties"][name]
}

fn primitive(json: &mut Value) -> &mut Value {
    &mut json["meshes"][0]["primitives"][0]
}

/// What changes what a viewer shows of a tile, or adds what it does not show.
pub const OF_TILES: &[(&str, Base, Code, Edit)] = &[
    ("morph target", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            let position = primitive(j)["attributes"]["POSITION"].clone();
            primitive(j)["targets"] = json!([{"POSITION": position}]);
            j["meshes"][0]["weights"] = json!([1.0]);
        })
    }),
    ("instances of a node", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["nodes"][1]["extensions"] =
                json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}});
        })
    }),
    ("an extension that is used", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            j["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"])
        })
    }),
    ("Draco in a primitive", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            primitive(j)["extensions"] = json!({"KHR_draco_mesh_compression":
                {"bufferView": 0, "attributes": {"POSITION": 0}}});
        })
    }),
    ("variants of a material", Web, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            primitive(j)["extensions"]["KHR_materials_variants"] = json!({"mappings": []});
        })
    }),
    ("a skin", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["skins"] = json!([{"joints": [1]}]);
            j["nodes"][1]["skin"] = 0.into();
        })
    }),
    ("an animation", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["animations"] = json!([{"channels": [], "samplers": []}])
        })
    }),
    ("a camera", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["cameras"] = json!([{"type": "perspective"}]))
    }),
    ("a light", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
        })
    }),
    ("an image outside", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["images"] = json!([{"uri": "../../../secret.png"}]);
            j["textures"] = json!([{"source": 0}]);
            j["materials"][0]["emissiveTexture"] = json!({"index": 0});
        })
    }),
    ("an invisible material", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["materials"][0]["alphaMode"] = "MASK".into())
    }),
    ("alpha 0", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            j["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][3] = 0.into()
        })
    }),
    ("one side", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["materials"][0]["doubleSided"] = false.into())
    }),
    ("another roughness", Web, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            j["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = 0.5.into();
        })
    }),
    ("minVersion", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["asset"]["minVersion"] = "2.1".into())
    }),
    ("another attribute", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            let normal = primitive(j)["attributes"]["NORMAL"].clone();
            primitive(j)["attributes"]["TANGENT"] = normal;
        })
    }),
    ("extras of the root", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["nodes"][0]["extras"] = json!({"cell": 1}))
    }),
    ("extras of the one node", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| j["nodes"][1]["extras"] = json!({"cell": 1}))
    }),
    (
        "another number in extras",
        Nodes,
        Code::ForeignMember,
        |f| tiles(f, |j, _| j["nodes"][1]["extras"]["quality"] = 1.into()),
    ),
    ("a measure as a text", Nodes, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            for node in j["nodes"].as_array_mut().unwrap()[1..].iter_mut() {
                if node["extras"]["mesh_volume"].is_null() {
                    node["extras"]["mesh_volume"] = "7.5".into();
                }
            }
        })
    }),
    ("an id twice", Nodes, Code::ForeignMember, |f| {
        texts(f, "\"cell\":", "\"cell\":99,\"cell\":")
    }),
    ("positions twice", Web, Code::ForeignMember, |f| {
        texts(f, "\"POSITION\":", "\"POSITION\":1,\"POSITION\":")
    }),
    ("the mode twice", Nodes, Code::GltfSyntax, |f| {
        texts(f, "\"mode\":", "\"mode\":4,\"mode\":")
    }),
    ("bounds of normals", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            j["accessors"][1]["min"] = json!([-1, -1, -1]);
            j["accessors"][1]["max"] = json!([1, 1, 1]);
        })
    }),
    ("bounds of positions", Nodes, Code::AccessorBounds, |f| {
        tiles(f, |j, _| {
            let max = j["accessors"][0]["max"][2].as_f64().unwrap();
            j["accessors"][0]["max"][2] = (max + 0.5).into();
        })
    }),
    ("an accessor for nothing", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            let more = j["accessors"][0].clone();
            j["accessors"].as_array_mut().unwrap().push(more);
        })
    }),
    ("a view for nothing", Web, Code::GltfUnused, |f| {
        tiles(f, |j, _| {
            let more = json!({"buffer": 0, "byteOffset": 0, "byteLength": 4});
            j["bufferViews"].as_array_mut().unwrap().push(more);
        })
    }),
    ("a view of another target", Merged, Code::GltfUnused, |f| {
        tiles(f, |j, _| j["bufferViews"][0]["target"] = 34963.into())
    }),
    ("bytes for nothing", Nodes, Code::GltfUnused, |f| {
        tiles(f, |j, bin| {
            bin.extend([7; 4096]);
            j["buffers"][0]["byteLength"] = bin.len().into();
        })
    }),
    ("a second table", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            let mut table = metadata(j)["propertyTables"][0].clone();
            let columns = table["properties"].as_object_mut().unwrap();
            let (volume, area) = (columns["volume"].clone(), columns["area"].clone());
            columns.insert("volume".into(), area);
            columns.insert("area".into(), volume);
            metadata(j)["propertyTables"]
                .as_array_mut()
                .unwrap()
                .push(table);
        })
    }),
    ("a scale", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| class_property(j, "volume")["scale"] = 2.0.into())
    }),
    ("an offset of the table", Web, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            metadata(j)["propertyTables"][0]["properties"]["area"]["offset"] = 1.into()
        })
    }),
    ("a default", Web, Code::ForeignMember, |f| {
        tiles(f, |j, _| class_property(j, "area")["default"] = 1.0.into())
    }),
    ("a cell that is no data", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| class_property(j, "cell")["noData"] = 1.into())
    }),
    (
        "a measure that is no data",
        Merged,
        Code::ForeignMember,
        |f| tiles(f, |j, _| class_property(j, "area")["noData"] = 7.5.into()),
    ),
    ("a null feature", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            primitive(j)["extensions"]["EXT_mesh_features"]["featureIds"][0]["nullFeatureId"] =
                0.into();
        })
    }),
    ("an enumeration", Merged, Code::ForeignMember, |f| {
        tiles(f, |j, _| {
            metadata(j)["schema"]["enums"] = json!({"kind": {"values": []}})
        })
    }),
    (
        "a description in another unit",
        Merged,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, _| {
                metadata(j)["schema"]["classes"]["piece"]["description"] =
                    "Surface pieces; lengths in nm".into();
            })
        },
    ),
];

/// What changes the index or the tables.
pub const OF_INDEX: &[(&str, Base, Code, Edit)] = &[
    ("a member of the index", Nodes, Code::ForeignMember, |f| {
        index(f, |m| m["comment"] = "".into())
    }),
    ("a member of totals", Web, Code::ForeignMember, |f| {
        index(f, |m| m["totals"]["pores"] = 3.into())
    }),
    ("a member of the source", Nodes, Code::ForeignMember, |f| {
        index(f, |m| m["source"]["uri"] = "http://example.com".into())
    }),
    ("a member of a shard", Nodes, Code::ForeignMember, |f| {
        json_of(f, "index/z0000.json", |s| s["tiles"][0]["uri"] = "x".into())
    }),
    (
        "a type that is not the volume's",
        Nodes,
        Code::SourceMismatch,
        |f| index(f, |m| m["source"]["dtype"] = "f64".into()),
    ),
    (
        "a format that is not the volume's",
        Merged,
        Code::SourceMismatch,
        |f| index(f, |m| m["source"]["format"] = "nrrd".into()),
    ),
    (
        "a size that claims to be the file's",
        Nodes,
        Code::SourceMismatch,
        |f| {
            index(f, |m| {
                m["source"]["provenance"]["spacing"] = json!(["file", "file", "assumed"]);
            });
        },
    ),
    (
        "a unit that claims to be the file's",
        Merged,
        Code::SourceMismatch,
        |f| index(f, |m| m["source"]["provenance"]["unit"] = "file".into()),
    ),
    ("a filter that was none", Nodes, Code::SourceMismatch, |f| {
        index(f, |m| m["filters"] = json!([{"name": "invert"}]))
    }),
    ("blocks that were none", Web, Code::ManifestValue, |f| {
        index(f, |m| {
            m["filters"] = json!([{"name": "downsample", "factor": 2}]);
        })
    }),
    ("numbers out of range", Merged, Code::ManifestValue, |f| {
        index(f, |m| {
            m["filters"] = json!([{"name": "clamp", "low": 3, "high": 2}]);
        })
    }),
    ("a filter of no name", Nodes, Code::ManifestSyntax, |f| {
        index(f, |m| m["filters"] = json!([{"name": "sharpen"}]))
    }),
    ("a list of no filters", Web, Code::ForeignMember, |f| {
        index(f, |m| m["filters"] = json!([]))
    }),
    ("an offset", Nodes, Code::ManifestValue, |f| {
        index(f, |m| {
            m["source"]["format"] = "nrrd".into();
            m["source"]["offset"] = 7.into();
        })
    }),
    ("dust that is not there", Nodes, Code::Dust, |f| {
        index(f, |m| {
            m["dust"] = json!({"min_voxels": 2, "objects": 0, "object_voxels": 0, "cells": 1,
                "cell_voxels": 1});
        })
    }),
    ("more dust than its size", Nodes, Code::ManifestValue, |f| {
        index(f, |m| {
            m["dust"] = json!({"min_voxels": 2, "objects": 3, "object_voxels": 77, "cells": 0,
                "cell_voxels": 0});
        })
    }),
    (
        "a layout that its tiles are not of",
        Merged,
        Code::TileEncoding,
        |f| index(f, |m| m["layout"] = "auto".into()),
    ),
    (
        "a source in another directory",
        Nodes,
        Code::ManifestValue,
        |f| index(f, |m| m["source"]["name"] = "../../volume.raw".into()),
    ),
    (
        "another type of a source of another name",
        Nodes,
        Code::SourceMismatch,
        |f| {
            index(f, |m| {
                m["source"]["name"] = "other.raw".into();
                m["source"]["dtype"] = "f64".into();
            })
        },
    ),
    ("a number with an exponent", Nodes, Code::TableSyntax, |f| {
        table(f, "cells.csv", |lines| {
            let area = column(lines, "area");
            lines[1][area] += "e0";
        })
    }),
    ("a number with a plus", Nodes, Code::TableSyntax, |f| {
        table(f, "surfaces.csv", |lines| lines[1][1].insert(0, '+'))
    }),
    (
        "a number with zeros before it",
        Nodes,
        Code::TableSyntax,
        |f| table(f, "objects.csv", |lines| lines[1][0].insert(0, '0')),
    ),
    (
        "a number with zeros behind it",
        Web,
        Code::TableSyntax,
        |f| {
            table(f, "cells.csv", |lines| {
                let area = column(lines, "area");
                assert!(lines[1][area].contains('.'));
                lines[1][area] += "00";
            })
        },
    ),
    (
        "a last line without an end",
        Nodes,
        Code::TableSyntax,
        |f| _ = f.get_mut("cells.csv").unwrap().pop(),
    ),
    ("a whole number of minus 0", Nodes, Code::TableSyntax, |f| {
        table(f, "surfaces.csv", |lines| {
            let edges = column(lines, "border_edges");
            let none = lines.iter_mut().find(|l| l[edges] == "0").unwrap();
            none[edges] = "-0".into();
        })
    }),
    ("a strip of another tile", Nodes, Code::TileCount, |f| {
        json_of(f, "index/z0000.json", |s| {
            for (tile, by) in [(0, 1), (1, -1)] {
                let strips = s["tiles"][tile]["strips"].as_i64().unwrap();
                s["tiles"][tile]["strips"] = (strips + by).into();
            }
        })
    }),
    ("another byte order", Nodes, Code::SourceMismatch, |f| {
        index(f, |m| m["source"]["endian"] = "big".into())
    }),
    ("surfaces exchanged", Nodes, Code::IdOrder, |f| {
        exchange(f, "surface", [1, 2])
    }),
    ("cells exchanged", Nodes, Code::IdOrder, |f| {
        exchange(f, "cell", [1, 3])
    }),
    (
        "Euler characteristics of border cells",
        Nodes,
        Code::TableValue,
        |f| {
            let mut changed = BTreeMap::new();
            table(f, "cells.csv", |lines| {
                let [euler, border] =
                    ["euler_characteristic", "touches_border"].map(|c| column(lines, c));
                let open = lines[1..].iter_mut().filter(|l| l[border] == "1");
                for (line, by) in open.zip([7, -7]) {
                    let value = line[euler].parse::<i64>().unwrap() + by;
                    line[euler] = value.to_string();
                    changed.insert(line[0].clone(), value);
                }
            });
            assert_eq!(changed.len(), 2);
            tiles(f, |j, _| {
                for node in j["nodes"].as_array_mut().unwrap()[1..].iter_mut() {
                    if let Some(value) = changed.get(&node["extras"]["cell"].to_string()) {
                        node["extras"]["euler_characteristic"] = (*value).into();
                    }
                }
            });
        },
    ),
    ("touches_border in words", Nodes, Code::TableSyntax, |f| {
        table(f, "cells.csv", |lines| {
            let border = column(lines, "touches_border");
            for line in &mut lines[1..] {
                line[border] = if line[border] == "1" { "true" } else { "false" }.into();
            }
        })
    }),
    ("a column twice", Nodes, Code::TableSyntax, |f| {
        table(f, "cells.csv", |lines| {
            let volume = column(lines, "volume");
            for line in lines {
                let more = line[volume].replace('1', "2");
                line.push(more);
            }
        })
    }),
    ("another column", Web, Code::TableSyntax, |f| {
        table(f, "objects.csv", |lines| {
            lines.iter_mut().for_each(|l| l.push("grade".into()))
        })
    }),
    ("a field too many", Merged, Code::TableSyntax, |f| {
        table(f, "surfaces.csv", |lines| lines[2].push("1".into()))
    }),
    ("an id with a fraction", Nodes, Code::TableSyntax, |f| {
        table(f, "cells.csv", |lines| lines[1][0] = "1.0".into())
    }),
    ("an empty line", Nodes, Code::TableRows, |f| {
        f.get_mut("cells.csv").unwrap().push(b'\n')
    }),
];

/// What changes a part, or its colours.
pub const OF_PARTS: &[(&str, Base, Code, Edit)] = &[
    ("no legend", Part, Code::MissingFile, |f| {
        _ = f.remove("legend.png")
    }),
    ("a legend outside", Part, Code::PathOutside, |f| {
        index(f, |m| {
            m["selection"]["colour_by"]["legend"] = "../../etc/passwd".into()
        })
    }),
    ("another file as the legend", Part, Code::PathName, |f| {
        index(f, |m| {
            m["selection"]["colour_by"]["legend"] = "cells.csv".into()
        })
    }),
    ("another range of colours", Part, Code::Paint, |f| {
        index(f, |m| {
            let max = m["selection"]["colour_by"]["max"].as_f64().unwrap();
            m["selection"]["colour_by"]["max"] = (2.0 * max).into();
        })
    }),
    ("other colours of the map", Part, Code::Paint, |f| {
        index(f, |m| {
            m["selection"]["colour_by"]["colours"][3] = "#ffffff".into()
        })
    }),
    ("another number of painted cells", Part, Code::Paint, |f| {
        index(f, |m| m["selection"]["painted"][0]["cells"] = 7.into())
    }),
    ("another colour of a piece", Part, Code::Paint, |f| {
        tiles(f, |j, _| {
            let red = json!([1.0, 0.0, 0.0, 1.0]);
            j["materials"][0]["name"] = "colour_ff0000".into();
            j["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = red;
        })
    }),
    (
        "another colour than its name",
        Part,
        Code::GltfUnused,
        |f| {
            tiles(f, |j, _| {
                j["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] =
                    json!([1.0, 0.0, 0.5, 1.0]);
            })
        },
    ),
    ("another condition", Part, Code::Selection, |f| {
        index(f, |m| m["selection"]["where"] = "touches_border".into())
    }),
    ("no condition at all", Part, Code::Selection, |f| {
        index(f, |m| m["selection"]["where"] = "voxels >".into())
    }),
    (
        "a size of dust that cells are below",
        Part,
        Code::TableValue,
        |f| {
            index(f, |m| {
                m["dust"] = json!({"min_voxels": 400, "objects": 0, "object_voxels": 0, "cells": 0,
                "cell_voxels": 0});
            })
        },
    ),
    (
        "a part without a condition",
        Part,
        Code::ManifestValue,
        |f| index(f, |m| m["selection"]["where"] = Value::Null),
    ),
    ("a colour in capitals", Part, Code::Selection, |f| {
        index(f, |m| {
            m["selection"]["painted"][0]["colour"] = "#FF8800".into()
        })
    }),
    ("a whole that is less", Part, Code::ManifestValue, |f| {
        index(f, |m| m["selection"]["of"]["cells"] = 0.into())
    }),
    (
        "a measure of an object that is whole",
        Part,
        Code::TableValue,
        |f| {
            table(f, "objects.csv", |lines| {
                let [border, axis] = ["touches_border", "centroid_x"].map(|c| column(lines, c));
                let inner = lines[1..].iter_mut().find(|l| l[border] == "0").unwrap();
                let moved = inner[axis].parse::<f64>().unwrap() + 0.01;
                inner[axis] = moved.to_string();
            })
        },
    ),
];

/// What the volume alone shows.
pub const AGAINST: &[(&str, Base, Code, Edit)] =
    &[("normals the other way", Nodes, Code::NormalDiffers, |f| {
        tiles(f, |j, bin| {
            let view = &j["bufferViews"][1];
            let [start, length] =
                ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
            for component in bin[start..start + length].chunks_exact_mut(4) {
                component[3] ^= 0x80;
            }
        })
    })];
