//! The part of glTF's JSON that a tile uses, as plain serde types: nothing is checked beyond types.
//!
//! Unknown members are ignored, as glTF demands of a reader. See the glTF 2.0 specification,
//! section 5, and the specifications of EXT_mesh_features, EXT_structural_metadata and
//! EXT_meshopt_compression.

use crate::grid::Unit;
use crate::measure::{MEASURES, Measured};
use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use std::collections::BTreeMap;

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Document {
    pub asset: Asset,
    pub scene: Option<usize>,
    #[serde(default)]
    pub scenes: Vec<Scene>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default, rename = "bufferViews")]
    pub buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
    #[serde(default)]
    pub materials: Vec<Material>,
    #[serde(default, rename = "extensionsUsed")]
    pub extensions_used: Vec<String>,
    #[serde(default, rename = "extensionsRequired")]
    pub extensions_required: Vec<String>,
    #[serde(default)]
    pub extensions: RootExtensions,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Material {
    #[serde(default)]
    pub name: String,
    #[serde(default, rename = "pbrMetallicRoughness")]
    pub surface: Surface,
}

/// What a material looks like.
#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct Surface {
    #[serde(rename = "baseColorFactor")]
    pub colour: Option<[f64; 4]>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Asset {
    pub version: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Scene {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Node {
    #[serde(default)]
    pub name: String,
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<IgnoredAny>,
    pub scale: Option<[f64; 3]>,
    #[serde(default)]
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    #[serde(default)]
    pub extras: Extras,
}

impl Node {
    /// True if it has a transform other than a matrix.
    pub fn has_trs(&self) -> bool {
        self.translation.is_some() || self.rotation.is_some() || self.scale.is_some()
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Mesh {
    #[serde(default)]
    pub name: String,
    #[serde(default)]
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Primitive {
    pub attributes: BTreeMap<String, usize>,
    pub indices: Option<usize>,
    pub material: Option<usize>,
    /// Absent is 4, a list of triangles.
    pub mode: Option<u32>,
    #[serde(default)]
    pub extensions: PrimitiveExtensions,
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct PrimitiveExtensions {
    #[serde(rename = "EXT_mesh_features")]
    pub mesh_features: Option<MeshFeatures>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct MeshFeatures {
    #[serde(rename = "featureIds")]
    pub feature_ids: Vec<FeatureId>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct FeatureId {
    #[serde(rename = "featureCount")]
    pub feature_count: u64,
    pub attribute: Option<u32>,
    #[serde(rename = "propertyTable")]
    pub property_table: Option<usize>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Accessor {
    #[serde(rename = "bufferView")]
    pub buffer_view: Option<usize>,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "componentType")]
    pub component_type: u32,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: String,
    #[serde(default)]
    pub normalized: bool,
    pub min: Option<Vec<f64>>,
    pub max: Option<Vec<f64>>,
    pub sparse: Option<IgnoredAny>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct BufferView {
    pub buffer: usize,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "byteLength")]
    pub byte_length: u64,
    #[serde(rename = "byteStride")]
    pub byte_stride: Option<u64>,
    pub target: Option<u32>,
    #[serde(default)]
    pub extensions: ViewExtensions,
}

impl BufferView {
    /// True if what it shows has to be decoded.
    pub fn is_compressed(&self) -> bool {
        self.extensions.meshopt.is_some()
    }

    /// Where its bytes begin in the chunk, compressed if they are, and how many they are.
    pub fn in_chunk(&self) -> [u64; 2] {
        match &self.extensions.meshopt {
            Some(stream) => [stream.byte_offset, stream.byte_length],
            None => [self.byte_offset, self.byte_length],
        }
    }
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: Option<Compressed>,
}

/// EXT_meshopt_compression of a view.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Compressed {
    pub buffer: usize,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "byteLength")]
    pub byte_length: u64,
    #[serde(rename = "byteStride")]
    pub byte_stride: u64,
    pub count: u64,
    pub mode: String,
    pub filter: Option<String>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Buffer {
    #[serde(rename = "byteLength")]
    pub byte_length: u64,
    pub uri: Option<IgnoredAny>,
    #[serde(default)]
    pub extensions: BufferExtensions,
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: Option<Fallback>,
}

/// EXT_meshopt_compression of a buffer.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Fallback {
    #[serde(default)]
    pub fallback: bool,
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct RootExtensions {
    #[serde(rename = "EXT_structural_metadata")]
    pub structural_metadata: Option<StructuralMetadata>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct StructuralMetadata {
    pub schema: Option<Schema>,
    #[serde(default, rename = "propertyTables")]
    pub property_tables: Vec<PropertyTable>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Schema {
    #[serde(default)]
    pub classes: BTreeMap<String, Class>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Class {
    #[serde(default)]
    pub description: String,
    #[serde(default)]
    pub properties: BTreeMap<String, ClassProperty>,
    #[serde(default)]
    pub extras: ClassExtras,
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(crate) struct ClassExtras {
    /// Unit of length of the measures.
    pub unit: Option<String>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct ClassProperty {
    #[serde(rename = "type")]
    pub kind: String,
    #[serde(rename = "componentType")]
    pub component_type: Option<String>,
    /// The value of rows that have none.
    #[serde(rename = "noData")]
    pub no_data: Option<serde_json::Value>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct PropertyTable {
    pub class: String,
    pub count: u64,
    #[serde(default)]
    pub properties: BTreeMap<String, PropertyValues>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct PropertyValues {
    pub values: usize,
}

/// The ids and measures of a node's `extras`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Extras {
    pub cell: Option<u64>,
    pub object: Option<u64>,
    pub surface: Option<u64>,
    pub triangles: Option<u64>,
    pub measured: Measured,
    /// What is wrong: a nested member, which programs would lose, or an id that is no whole number.
    pub bad: Option<String>,
}

impl<'de> Deserialize<'de> for Extras {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(ExtrasVisitor)
    }
}

struct ExtrasVisitor;

impl<'de> Visitor<'de> for ExtrasVisitor {
    type Value = Extras;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a flat object of numbers and strings")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Extras, A::Error> {
        let mut out = Extras::default();
        while let Some(key) = map.next_key::<std::borrow::Cow<'de, str>>()? {
            let value: Flat = map.next_value()?;
            let id = match key.as_ref() {
                "cell" => &mut out.cell,
                "object" => &mut out.object,
                "surface" => &mut out.surface,
                "triangles" => &mut out.triangles,
                name => {
                    match value {
                        Flat::Number(n) => {
                            if let Some(i) = MEASURES.iter().position(|m| *m == name) {
                                out.measured.values[i] = n;
                            }
                        }
                        Flat::Unit(unit) if name == "unit" => out.measured.unit = Some(unit),
                        Flat::Unit(_) | Flat::Other => {}
                        Flat::Bad => {
                            out.bad = Some(format!(
                                "{key} is nested, null or a boolean, expected numbers and strings only"
                            ));
                        }
                    }
                    continue;
                }
            };
            *id = match value {
                Flat::Number(n) => whole(n),
                _ => None,
            };
            if id.is_none() {
                out.bad = Some(format!("{key} is not a whole number from 0 to 2^53"));
            }
        }
        Ok(out)
    }
}

/// A whole number that an `f64` holds exactly, or `None`.
pub(crate) fn whole(n: f64) -> Option<u64> {
    const EXACT: f64 = 9_007_199_254_740_992.0;
    ((0.0..=EXACT).contains(&n) && n.fract() == 0.0).then_some(n as u64)
}

enum Flat {
    Number(f64),
    /// A string that is the short name of a unit.
    Unit(&'static str),
    Other,
    /// What extras may not have.
    Bad,
}

impl<'de> Deserialize<'de> for Flat {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Kind;
        impl<'de> Visitor<'de> for Kind {
            type Value = Flat;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number or a string")
            }
            fn visit_u64<E>(self, v: u64) -> Result<Flat, E> {
                Ok(Flat::Number(v as f64))
            }
            fn visit_i64<E>(self, v: i64) -> Result<Flat, E> {
                Ok(Flat::Number(v as f64))
            }
            fn visit_f64<E>(self, v: f64) -> Result<Flat, E> {
                Ok(Flat::Number(v))
            }
            fn visit_str<E>(self, text: &str) -> Result<Flat, E> {
                Ok(Unit::short_name(text).map_or(Flat::Other, Flat::Unit))
            }
            fn visit_bool<E>(self, _: bool) -> Result<Flat, E> {
                Ok(Flat::Bad)
            }
            fn visit_unit<E>(self) -> Result<Flat, E> {
                Ok(Flat::Bad)
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut s: A) -> Result<Flat, A::Error> {
                while s.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Flat::Bad)
            }
            fn visit_map<A: MapAccess<'de>>(self, mut m: A) -> Result<Flat, A::Error> {
                while m.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Flat::Bad)
            }
        }
        d.deserialize_any(Kind)
    }
}
