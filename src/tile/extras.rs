//! The numbers that ride on a tile's nodes.

use super::read::PieceIds;
use crate::gltf::read_json::whole;
use crate::grid::Unit;
use crate::measure::Measures;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value};

/// `extras` of a node: ids, the piece's triangles in this tile, and measures of the whole cell, in
/// the unit named. Quantities without meaning are left out; caps have ids and `triangles` alone.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<&'static str>,
    /// Voxels of the cell. Beyond 2^31 - 1 it is written with a fraction, for Blender makes a text of
    /// a larger integer.
    #[serde(
        skip_serializing_if = "Option::is_none",
        serialize_with = "small_integer"
    )]
    pub voxels: Option<u64>,
    /// Volume of the cell's voxels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<f64>,
    /// Volume inside the cell's triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh_volume: Option<f64>,
    /// Area of the cell's triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub area: Option<f64>,
    /// Diameter of the ball with the cell's volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equivalent_diameter: Option<f64>,
    /// Wadell's sphericity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sphericity: Option<f64>,
    /// 36 pi V^2 / A^3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub form_factor: Option<f64>,
    /// Second semi-axis over the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elongation: Option<f64>,
    /// Third semi-axis over the second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flatness: Option<f64>,
    /// Euler characteristic of the cell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub euler_characteristic: Option<i64>,
    /// 1 if the cell touches the grid's outer faces, else 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub touches_border: Option<u8>,
}

fn small_integer<S: Serializer>(value: &Option<u64>, s: S) -> Result<S::Ok, S::Error> {
    match *value {
        Some(v) if v > i32::MAX as u64 => s.serialize_f64(v as f64),
        Some(v) => s.serialize_u64(v),
        None => s.serialize_none(),
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
            voxels: None,
            volume: None,
            mesh_volume: None,
            area: None,
            equivalent_diameter: None,
            sphericity: None,
            form_factor: None,
            elongation: None,
            flatness: None,
            euler_characteristic: None,
            touches_border: None,
        }
    }

    /// What a tile's node or table has, with the ids and triangles that were read from there already.
    pub fn read(ids: &PieceIds, found: &Map<String, Value>) -> Self {
        let number = |name: &str| found.get(name).and_then(Value::as_f64);
        let unit = found.get("unit").map(Unit::deserialize);
        Extras {
            unit: unit.and_then(Result::ok).map(Unit::name),
            voxels: number("voxels").and_then(whole),
            volume: number("volume"),
            mesh_volume: number("mesh_volume"),
            area: number("area"),
            equivalent_diameter: number("equivalent_diameter"),
            sphericity: number("sphericity"),
            form_factor: number("form_factor"),
            elongation: number("elongation"),
            flatness: number("flatness"),
            euler_characteristic: found.get("euler_characteristic").and_then(Value::as_i64),
            touches_border: number("touches_border").map(|v| v as u8),
            ..Extras::ids(ids.cell, ids.object, ids.surface, ids.triangles)
        }
    }

    /// Adds the cell's measures; values that are not finite are left out.
    pub fn with_measures(self, m: &Measures, unit: &'static str) -> Self {
        let finite = |v: f64| v.is_finite().then_some(v);
        Extras {
            unit: Some(unit),
            voxels: Some(m.voxels),
            volume: finite(m.volume),
            mesh_volume: m.mesh_volume.and_then(finite),
            area: finite(m.area),
            equivalent_diameter: finite(m.equivalent_diameter),
            sphericity: m.sphericity.and_then(finite),
            form_factor: m.form_factor.and_then(finite),
            elongation: finite(m.elongation),
            flatness: finite(m.flatness),
            euler_characteristic: Some(m.euler_characteristic),
            touches_border: Some(u8::from(m.touches_border)),
            ..self
        }
    }

    /// Extras that take at least as many bytes of JSON as any: what a tile's JSON chunk has to hold
    /// is known only at the end, but its room is needed at the start.
    pub fn widest() -> Self {
        let widest = -f64::MIN_POSITIVE;
        Extras {
            cell: u64::MAX,
            object: u64::MAX,
            surface: u64::MAX,
            triangles: u64::MAX,
            unit: Some("voxel"),
            voxels: Some(u64::MAX),
            volume: Some(widest),
            mesh_volume: Some(widest),
            area: Some(widest),
            equivalent_diameter: Some(widest),
            sphericity: Some(widest),
            form_factor: Some(widest),
            elongation: Some(widest),
            flatness: Some(widest),
            euler_characteristic: Some(i64::MIN),
            touches_border: Some(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn widest_number() -> usize {
        serde_json::to_string(&Extras::widest().volume)
            .unwrap()
            .len()
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
            voxels: Some(1 << 31),
            ..Extras::ids(1, 1, 1, 1)
        };
        assert!(
            serde_json::to_string(&extras)
                .unwrap()
                .contains("\"voxels\":2147483648.0")
        );
    }
}
