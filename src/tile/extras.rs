//! The numbers that ride on a tile's nodes.

use super::read::{PieceIds, Tile};
use crate::gltf::buffer_views::Buffers;
use crate::gltf::container::{Fault, ReadError, fail};
use crate::gltf::read_json::whole;
use crate::grid::Unit;
use crate::measure::{CARRIED, CARRIED_COLUMNS, Column, Field, Get, MEASURES, Measured, Measures};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value};

/// `extras` of a node: ids, the piece's triangles in this tile, and measures of the whole cell, in
/// the unit named. Quantities without meaning are left out; caps have ids and `triangles` alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Extras {
    /// The cell; 0 for a cap.
    pub cell: u64,
    /// The object.
    pub object: u64,
    /// The surface; 0 for a cap.
    pub surface: u64,
    /// Triangles of this piece in this tile.
    pub triangles: u64,
    /// Unit of length of the measures.
    pub unit: Option<&'static str>,
    /// Measures of the cell, in the order of [`MEASURES`](crate::tile::read::MEASURES).
    pub measures: [Option<Field>; CARRIED],
}

impl Serialize for Extras {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        let mut map = s.serialize_map(None)?;
        map.serialize_entry("cell", &self.cell)?;
        map.serialize_entry("object", &self.object)?;
        map.serialize_entry("surface", &self.surface)?;
        map.serialize_entry("triangles", &self.triangles)?;
        if let Some(unit) = self.unit {
            map.serialize_entry("unit", unit)?;
        }
        for (name, field) in MEASURES.iter().zip(self.measures) {
            match field {
                // Blender makes a text of a larger integer
                Some(Field::Count(v)) if v > i32::MAX as u64 => {
                    map.serialize_entry(name, &(v as f64))?;
                }
                Some(Field::Count(v)) => map.serialize_entry(name, &v)?,
                Some(Field::Signed(v)) => map.serialize_entry(name, &v)?,
                Some(Field::Flag(v)) => map.serialize_entry(name, &u8::from(v))?,
                Some(Field::Real(v)) => map.serialize_entry(name, &v)?,
                None => {}
            }
        }
        map.end()
    }
}

impl Extras {
    /// Ids alone, as on a cap.
    pub fn ids(cell: u64, object: u64, surface: u64, triangles: u64) -> Self {
        Extras {
            cell,
            object,
            surface,
            triangles,
            unit: None,
            measures: [None; CARRIED],
        }
    }

    /// Voxels of the cell, if they are known.
    pub fn voxels(&self) -> Option<u64> {
        let at = MEASURES.iter().position(|name| *name == "voxels")?;
        match self.measures.get(at)? {
            Some(Field::Count(voxels)) => Some(*voxels),
            _ => None,
        }
    }

    /// What a tile's node or table has, with the ids and triangles that were read from there already.
    pub fn read(ids: &PieceIds, found: &Map<String, Value>) -> Self {
        let unit = found.get("unit").map(Unit::deserialize);
        let measures = CARRIED_COLUMNS.map(|column| {
            let value = found.get(column.name)?;
            match column.get {
                Get::Count(_) => value.as_f64().and_then(whole).map(Field::Count),
                Get::Signed(_) => value.as_i64().map(Field::Signed),
                Get::Flag(_) => value.as_f64().map(|v| Field::Flag(v != 0.0)),
                Get::Real(_) => value.as_f64().map(Field::Real),
            }
        });
        Extras {
            unit: unit.and_then(Result::ok).map(Unit::name),
            measures,
            ..Extras::ids(ids.cell, ids.object, ids.surface, ids.triangles)
        }
    }

    /// Ids and measures that a piece states of its cell.
    pub fn measured(ids: &PieceIds, found: &Measured) -> Self {
        let measure = |(column, &value): (&Column<Measures>, &f64)| match column.get {
            _ if value.is_nan() => None,
            Get::Count(_) => whole(value).map(Field::Count),
            Get::Signed(_) => Some(Field::Signed(value as i64)),
            Get::Flag(_) => Some(Field::Flag(value != 0.0)),
            Get::Real(_) => Some(Field::Real(value)),
        };
        let mut measures = [None; CARRIED];
        for (to, from) in measures
            .iter_mut()
            .zip(CARRIED_COLUMNS.iter().zip(&found.values))
        {
            *to = measure(from);
        }
        Extras {
            unit: found.unit,
            measures,
            ..Extras::ids(ids.cell, ids.object, ids.surface, ids.triangles)
        }
    }

    /// Adds the cell's measures; values that are not finite are left out.
    pub fn with_measures(self, m: &Measures, unit: &'static str) -> Self {
        Extras {
            unit: Some(unit),
            measures: CARRIED_COLUMNS.map(|column| column.get.of(m).meaningful()),
            ..self
        }
    }

    /// Extras that take at least as many bytes of JSON as any: what a tile's JSON chunk has to hold
    /// is known only at the end, but its room is needed at the start.
    pub fn widest() -> Self {
        let measures = CARRIED_COLUMNS.map(|column| {
            Some(match column.get {
                Get::Count(_) => Field::Count(u64::MAX),
                Get::Signed(_) => Field::Signed(i64::MIN),
                Get::Flag(_) => Field::Flag(true),
                Get::Real(_) => Field::Real(WIDEST),
            })
        });
        Extras {
            unit: Some("voxel"),
            measures,
            ..Extras::ids(u64::MAX, u64::MAX, u64::MAX, u64::MAX)
        }
    }
}

/// What a tile says of each of its pieces: the `extras` of nodes, or the rows of the table.
///
/// # Errors
/// [`ReadError`] if they cannot be read.
pub(super) fn of_pieces(tile: &Tile) -> Result<Vec<Map<String, Value>>, ReadError> {
    #[derive(Deserialize)]
    struct Nodes {
        nodes: Vec<Node>,
    }
    #[derive(Deserialize)]
    struct Node {
        #[serde(default)]
        extras: Map<String, Value>,
    }
    if tile.is_merged() {
        return super::features::extras(&tile.document, &Buffers::plain(tile.glb.bin));
    }
    match serde_json::from_slice::<Nodes>(tile.json()) {
        // the first node is the root
        Ok(doc) => Ok(doc.nodes.into_iter().skip(1).map(|n| n.extras).collect()),
        Err(e) => fail(Fault::Json, "", e.to_string()),
    }
}

/// A number than which none takes more bytes.
const WIDEST: f64 = -f64::MIN_POSITIVE;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn widest_number() -> usize {
        serde_json::to_string(&WIDEST).unwrap().len()
    }

    #[test]
    fn the_widest_number_has_17_digits_a_sign_and_an_exponent() {
        assert_eq!(widest_number(), "-2.2250738585072014e-308".len());
    }

    proptest! {
        #[test]
        fn no_number_is_wider(v in any::<f64>().prop_filter("finite", |v| v.is_finite())) {
            prop_assert!(serde_json::to_string(&v).unwrap().len() <= widest_number());
        }
    }

    #[test]
    fn large_counts_stay_numbers_in_blender() {
        let extras = Extras {
            measures: CARRIED_COLUMNS.map(|column| match column.get {
                Get::Count(_) => Some(Field::Count(1 << 31)),
                _ => None,
            }),
            ..Extras::ids(1, 1, 1, 1)
        };
        assert!(
            serde_json::to_string(&extras)
                .unwrap()
                .contains("\"voxels\":2147483648.0")
        );
    }
}
