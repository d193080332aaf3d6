//! What a tile set says, read without the verifier: its surface, ids and measures.

use alvis::grid::Placement;
use alvis::tileset::TileSet;
use std::collections::BTreeMap;
use std::path::Path;

/// Measures that tiles carry.
const CARRIED: [&str; 12] = [
    "unit",
    "voxels",
    "volume",
    "mesh_volume",
    "area",
    "equivalent_diameter",
    "sphericity",
    "form_factor",
    "elongation",
    "flatness",
    "euler_characteristic",
    "touches_border",
];

/// A number, or a text that is none.
#[derive(Debug, Clone, PartialEq)]
enum Value {
    Number(f64),
    Text(String),
}

impl Value {
    fn of(text: &str) -> Value {
        match text.trim() {
            "true" => Value::Number(1.0),
            "false" => Value::Number(0.0),
            t => t.parse().map_or(Value::Text(t.to_owned()), Value::Number),
        }
    }

    fn same(&self, other: &Value, error: f64) -> bool {
        match (self, other) {
            (Value::Number(a), Value::Number(b)) => {
                a == b || (a - b).abs() <= error * a.abs().max(b.abs())
            }
            (a, b) => a == b,
        }
    }
}

type Triangle = ([u64; 3], [[u32; 3]; 3]);

/// All of it. Normals are left out.
#[derive(Debug, PartialEq)]
pub struct Essence {
    place: Placement,
    cap: bool,
    triangles: Vec<Triangle>,
    /// What each piece carries, by its ids.
    carried: Vec<([u64; 3], BTreeMap<String, Value>)>,
    /// Each table's rows: column with unit, and value.
    tables: Vec<Vec<BTreeMap<String, Value>>>,
}

impl Essence {
    /// Reads a tile set; an error if that cannot be done.
    pub fn read(dir: &Path) -> Result<Essence, String> {
        let text = |e: alvis::Error| e.to_string();
        let set = TileSet::open(dir).map_err(text)?;
        let m = set.manifest();
        let mut out = Essence {
            place: m.placement,
            cap: m.cap,
            triangles: Vec::new(),
            carried: Vec::new(),
            tables: Vec::new(),
        };
        for entry in set.tiles() {
            let tile = set.read_tile(&entry.map_err(text)?).map_err(text)?;
            if tile.matrix != m.transform {
                return Err("another matrix".into());
            }
            for piece in &tile.pieces {
                let ids = [piece.ids.cell, piece.ids.object, piece.ids.surface];
                for &t in &piece.triangles {
                    let mut corners = piece.corners(t).map(|p| p.map(f32::to_bits));
                    let first = (0..3).min_by_key(|&i| corners[i]).unwrap();
                    corners.rotate_left(first);
                    out.triangles.push((ids, corners));
                }
                let value = |v: &serde_json::Value| {
                    v.as_f64().map_or(Value::Text(v.to_string()), Value::Number)
                };
                let known = piece
                    .extras
                    .iter()
                    .filter(|(k, _)| CARRIED.contains(&k.as_str()));
                out.carried
                    .push((ids, known.map(|(k, v)| (k.clone(), value(v))).collect()));
            }
        }
        out.triangles.sort_unstable();
        out.carried.sort_by_key(|a| a.0);
        for name in [&m.tables.cells, &m.tables.objects, &m.tables.surfaces] {
            let path = set.path(name).map_err(text)?;
            let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
            out.tables.push(rows(&String::from_utf8_lossy(&bytes)));
        }
        Ok(out)
    }

    /// True if both say the same, numbers up to a relative error.
    pub fn same(&self, other: &Essence, error: f64) -> bool {
        type Map = BTreeMap<String, Value>;
        let maps = |a: &Map, b: &Map| {
            a.len() == b.len()
                && a.iter()
                    .all(|(k, v)| b.get(k).is_some_and(|w| v.same(w, error)))
        };
        let round = a_ball(&self.tables);
        let table = |(i, (a, b)): (usize, (&Vec<Map>, &Vec<Map>))| {
            a.len() == b.len()
                && a.iter().zip(b).enumerate().all(|(r, (a, b))| {
                    // the longest axis of a ball has no direction to speak of
                    if round.contains(&(i, r)) {
                        let other = |m: &Map| -> Map {
                            m.iter()
                                .filter(|(k, _)| !k.starts_with("orientation"))
                                .map(|(k, v)| (k.clone(), v.clone()))
                                .collect()
                        };
                        maps(&other(a), &other(b))
                    } else {
                        maps(a, b)
                    }
                })
        };
        self.place == other.place
            && self.cap == other.cap
            && self.triangles == other.triangles
            && self.carried.len() == other.carried.len()
            && (self.carried.iter().zip(&other.carried))
                .all(|(a, b)| a.0 == b.0 && maps(&a.1, &b.1))
            && self.tables.iter().zip(&other.tables).enumerate().all(table)
    }
}

/// The rows of bodies whose two longest axes are nearly the same.
fn a_ball(tables: &[Vec<BTreeMap<String, Value>>]) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    for (i, table) in tables.iter().enumerate() {
        for (r, row) in table.iter().enumerate() {
            if matches!(row.get("elongation"), Some(Value::Number(v)) if *v > 0.999) {
                out.push((i, r));
            }
        }
    }
    out
}

fn rows(text: &str) -> Vec<BTreeMap<String, Value>> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines
        .next()
        .unwrap_or("")
        .split(',')
        .map(str::trim)
        .collect();
    let row = |line: &str| {
        let fields = line.split(',');
        let named = names.iter().zip(fields);
        named.map(|(n, f)| (n.to_string(), Value::of(f))).collect()
    };
    lines.filter(|l| !l.trim().is_empty()).map(row).collect()
}
