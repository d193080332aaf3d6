//! Faults in what a part says of how it was chosen by objects and by surfaces.

use super::Base::{self, Objects, Surfaces, Twice};
use super::{Edit, column, index, table};
use crate::faults::Files;
use alvis::verify::Code;

/// Changes a number of a row, the first where `at` is 1.
fn number(f: &mut Files, file: &str, at: usize, name: &str, change: fn(f64) -> f64) {
    table(f, file, |lines| {
        let c = column(lines, name);
        let value = change(lines[at][c].parse().unwrap());
        lines[at][c] = value.to_string();
    });
}

/// What changes a part of some objects, of some surfaces, or of some cells of some objects.
pub const OF_CHOICES: &[(&str, Base, Code, Edit)] = &[
    ("more of the largest", Objects, Code::ManifestValue, |f| {
        index(f, |m| {
            m["selection"]["largest"] = 2.into();
            m["selection"]["where"] = serde_json::Value::Null;
        })
    }),
    ("none of the largest", Objects, Code::ManifestValue, |f| {
        index(f, |m| m["selection"]["largest"] = 0.into())
    }),
    ("fewer of the largest", Surfaces, Code::ManifestValue, |f| {
        index(f, |m| m["selection"]["largest"] = 2.into())
    }),
    ("objects that do not match", Objects, Code::Selection, |f| {
        index(f, |m| m["selection"]["where"] = "voxels < 2".into())
    }),
    (
        "surfaces that do not match",
        Surfaces,
        Code::Selection,
        |f| index(f, |m| m["selection"]["where"] = "area < 1".into()),
    ),
    ("a condition of no column", Surfaces, Code::Selection, |f| {
        index(f, |m| m["selection"]["where"] = "voxels > 0".into())
    }),
    ("another table", Objects, Code::Selection, |f| {
        index(f, |m| m["selection"]["table"] = "surfaces".into())
    }),
    ("no table", Objects, Code::Selection, |f| {
        index(f, |m| {
            m["selection"].as_object_mut().unwrap().remove("table");
        })
    }),
    (
        "objects that have lost surfaces, though they were chosen",
        Surfaces,
        Code::TableValue,
        |f| {
            index(f, |m| {
                m["selection"]["table"] = "objects".into();
                m["selection"]["where"] = "voxels > 0".into();
            })
        },
    ),
    (
        "cells that have lost surfaces, though they were chosen",
        Surfaces,
        Code::TableValue,
        |f| {
            index(f, |m| {
                m["selection"].as_object_mut().unwrap().remove("table");
                m["selection"]["where"] = "voxels > 0".into();
            })
        },
    ),
    ("another number of objects", Objects, Code::Paint, |f| {
        index(f, |m| m["selection"]["painted"][0]["objects"] = 7.into())
    }),
    ("painted cells for objects", Objects, Code::Selection, |f| {
        index(f, |m| {
            let painted = m["selection"]["painted"][0].as_object_mut().unwrap();
            let count = painted.remove("objects").unwrap();
            painted.insert("cells".into(), count);
        })
    }),
    ("an object that is not painted", Objects, Code::Paint, |f| {
        index(f, |m| {
            let painted = &mut m["selection"]["painted"][0];
            painted["where"] = "voxels < 20".into();
            painted["objects"] = 0.into();
        })
    }),
    (
        "voxels of a chosen object",
        Objects,
        Code::TableValue,
        |f| number(f, "objects.csv", 1, "voxels", |v| v + 1.0),
    ),
    ("area of a chosen object", Objects, Code::TableValue, |f| {
        number(f, "objects.csv", 1, "area", |v| v + 1.0)
    }),
    ("less area than is there", Surfaces, Code::TableValue, |f| {
        number(f, "objects.csv", 1, "area", |v| v / 100.0)
    }),
    (
        "a cell beside its surfaces",
        Surfaces,
        Code::TableValue,
        |f| {
            for name in ["min_x", "centroid_x", "max_x"] {
                number(f, "cells.csv", 1, name, |v| v + 1.0);
            }
        },
    ),
    (
        "voxels of a cell that is whole",
        Objects,
        Code::TableValue,
        |f| number(f, "cells.csv", 1, "voxels", |v| v + 1.0),
    ),
    (
        "a row of a cell that is not there",
        Objects,
        Code::TableRows,
        |f| {
            table(f, "cells.csv", |lines| {
                let mut last = lines.last().unwrap().clone();
                last[0] = (last[0].parse::<u64>().unwrap() + 1).to_string();
                lines.push(last);
            })
        },
    ),
    ("objects of the first choice", Twice, Code::Selection, |f| {
        index(f, |m| {
            m["selection"]["before"][0]["where"] = "voxels < 2".into()
        })
    }),
    ("no first choice", Twice, Code::TableValue, |f| {
        index(f, |m| {
            m["selection"].as_object_mut().unwrap().remove("before");
        })
    }),
    (
        "a first choice that left all out",
        Twice,
        Code::ManifestValue,
        |f| {
            index(f, |m| {
                let first = &mut m["selection"]["before"][0];
                first["omit"] = true.into();
                first["where"] = serde_json::Value::Null;
                first["largest"] = 9.into();
            })
        },
    ),
];
