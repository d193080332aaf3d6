//! What a tile may be read in spite of, though no tile of this program has it: parts of the JSON and of the
//! BIN chunk that nothing uses, or that say of others what these are not.

use super::paint::{linear, named};
use super::read::Tile;
use crate::gltf::read_json::{Document, Primitive};
use crate::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use std::collections::BTreeSet;

/// JSON pointers, and what is unusual there.
pub(super) type Found = Vec<(String, String)>;

impl Tile<'_> {
    /// Looks for what does not fit together though each is as it should be: extensions, accessors, views,
    /// materials, the property table's description, and bytes that no view has.
    pub(crate) fn unusual(&self) -> Found {
        let doc = &self.document;
        let mut found = Found::new();
        extensions(doc, self.is_merged(), &mut found);
        accessors(doc, &mut found);
        views(doc, &mut found);
        materials(doc, &mut found);
        description(doc, &mut found);
        self.padding(&mut found);
        found
    }
}

/// The primitives, one of each mesh.
fn primitives(doc: &Document) -> impl Iterator<Item = &Primitive> {
    doc.meshes.iter().flat_map(|m| &m.primitives)
}

fn extensions(doc: &Document, merged: bool, found: &mut Found) {
    let mut expected = doc.extensions_required.clone();
    if merged {
        expected.extend(["EXT_mesh_features", "EXT_structural_metadata"].map(str::to_owned));
    }
    let used = &doc.extensions_used;
    if *used != expected {
        let message = format!("found {used:?}, expected {expected:?}");
        found.push(("/extensionsUsed".into(), message));
    }
}

fn accessors(doc: &Document, found: &mut Found) {
    // of each accessor whether it is used, and whether for positions
    let mut uses = vec![(false, false); doc.accessors.len()];
    for prim in primitives(doc) {
        let named = prim
            .attributes
            .iter()
            .map(|(name, at)| (name == "POSITION", at));
        for (position, &at) in named.chain(prim.indices.iter().map(|at| (false, at))) {
            if let Some(used) = uses.get_mut(at) {
                *used = (true, used.1 || position);
            }
        }
    }
    for (i, (accessor, (used, position))) in doc.accessors.iter().zip(uses).enumerate() {
        if !used {
            found.push((format!("/accessors/{i}"), "no primitive uses it".into()));
        } else if (accessor.min.is_some() || accessor.max.is_some()) && !position {
            let message = "found min or max, which positions alone have";
            found.push((format!("/accessors/{i}"), message.into()));
        }
    }
}

/// What a view is for: the target that it states, if it does, and whether it states a stride.
type Role = (Option<u32>, bool);

fn views(doc: &Document, found: &mut Found) {
    let mut roles: Vec<Option<Role>> = vec![None; doc.buffer_views.len()];
    let mut is_for = |view: Option<usize>, role: Role, found: &mut Found| {
        let Some((view, slot)) = view.and_then(|v| Some((v, roles.get_mut(v)?))) else {
            return;
        };
        if slot.replace(role).is_some_and(|other| other != role) {
            let message = "vertices, indices and columns share it";
            found.push((format!("/bufferViews/{view}"), message.into()));
        }
    };
    let view_of = |accessor: usize| doc.accessors.get(accessor).and_then(|a| a.buffer_view);
    for prim in primitives(doc) {
        for &accessor in prim.attributes.values() {
            is_for(view_of(accessor), (Some(ARRAY_BUFFER), true), found);
        }
        if let Some(indices) = prim.indices {
            is_for(view_of(indices), (Some(ELEMENT_ARRAY_BUFFER), false), found);
        }
    }
    let tables = doc
        .extensions
        .structural_metadata
        .iter()
        .flat_map(|m| &m.property_tables);
    for column in tables.flat_map(|t| t.properties.values()) {
        is_for(Some(column.values), (None, false), found);
    }
    let mut compressed = false;
    for (i, (view, role)) in doc.buffer_views.iter().zip(&roles).enumerate() {
        compressed |= view.is_compressed();
        let stated = (view.target, view.byte_stride.is_some());
        let message = match role {
            None => "nothing uses it".to_owned(),
            Some(role) if *role != stated => format!(
                "found target {:?} {} a stride, expected {:?} {} one",
                view.target,
                if stated.1 { "with" } else { "without" },
                role.0,
                if role.1 { "with" } else { "without" }
            ),
            Some(_) => continue,
        };
        found.push((format!("/bufferViews/{i}"), message));
    }
    if doc.buffers.len() != 1 + usize::from(compressed) {
        let message = format!(
            "found {}, with compressed views: {compressed}",
            doc.buffers.len()
        );
        found.push(("/buffers".into(), message));
    }
}

/// How far a factor may be from a colour, which it is rounded from.
const ROUNDED: f64 = 1e-6;

fn materials(doc: &Document, found: &mut Found) {
    let used: BTreeSet<usize> = primitives(doc).filter_map(|p| p.material).collect();
    if primitives(doc).any(|p| p.material.is_none()) {
        found.push(("/meshes".into(), "a primitive has no material".into()));
    }
    let painted = primitives(doc).any(|p| p.attributes.contains_key("COLOR_0"));
    let mut names = BTreeSet::new();
    for (i, material) in doc.materials.iter().enumerate() {
        let grey = [0.8, 0.8, 0.8, 1.0];
        let expected = match named(&material.name) {
            _ if painted => [1.0; 4],
            Some(colour) => {
                let [r, g, b] = colour.map(linear);
                [r, g, b, 1.0]
            }
            None => grey,
        };
        let factor = material.surface.colour.unwrap_or([f64::NAN; 4]);
        // grey and white are no rounded ones
        let exact = painted || named(&material.name).is_none();
        let error = if exact { 0.0 } else { ROUNDED };
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= error;
        let message = if !used.contains(&i) {
            "no primitive uses it".to_owned()
        } else if !names.insert(&material.name) {
            format!("a second one is named {}", material.name)
        } else if named(&material.name).is_none() && material.name != "surface" {
            format!(
                "found the name {:?}, expected surface or colour_rrggbb",
                material.name
            )
        } else if !factor.iter().zip(&expected).all(near) {
            format!("found the factor {factor:?}, expected {expected:?} by its name")
        } else {
            continue;
        };
        found.push((format!("/materials/{i}"), message));
    }
}

fn description(doc: &Document, found: &mut Found) {
    const AT: &str = "/extensions/EXT_structural_metadata/schema/classes/piece/description";
    let schema = doc
        .extensions
        .structural_metadata
        .iter()
        .filter_map(|m| m.schema.as_ref());
    for class in schema.flat_map(|s| s.classes.values()) {
        let unit = class.extras.unit.as_deref().unwrap_or("voxel");
        let expected = format!("Surface pieces; lengths in {unit}");
        if class.description != expected {
            let message = format!("found {:?}, expected {expected:?}", class.description);
            found.push((AT.into(), message));
        }
    }
}
