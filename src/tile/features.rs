//! The property table of a merged tile (EXT_mesh_features and EXT_structural_metadata).

use super::read::{MEASURES, Measured, PieceIds};
use crate::gltf::buffer_views::Buffers;
use crate::gltf::container::{Fault, ReadError};
use crate::gltf::read_json::{ClassProperty, Document, Primitive, whole};
use crate::grid::Unit;
use serde_json::{Map, Value};

/// Where the table is, for messages.
const TABLE: &str = "/extensions/EXT_structural_metadata/propertyTables/0";

fn fail<T>(place: &str, message: impl Into<String>) -> Result<T, ReadError> {
    Err(ReadError {
        fault: Fault::Structure,
        place: place.to_owned(),
        message: message.into(),
    })
}

/// Reads the id columns of the table that feature id set 0 of `prim` points to, one row per piece.
pub(super) fn rows(
    doc: &Document,
    buffers: &Buffers,
    prim: &Primitive,
) -> Result<Vec<PieceIds>, ReadError> {
    const AT: &str = "/extensions/EXT_structural_metadata";
    let set = prim.extensions.mesh_features.as_ref();
    let set = match set.map(|m| m.feature_ids.as_slice()) {
        Some([one]) if one.attribute == Some(0) => one,
        _ => {
            return fail(
                "/meshes/0/primitives/0/extensions/EXT_mesh_features",
                "expected one feature id set with attribute 0",
            );
        }
    };
    let meta = doc.extensions.structural_metadata.as_ref();
    let table = meta
        .zip(set.property_table)
        .and_then(|(m, t)| m.property_tables.get(t));
    let (Some(meta), Some(table)) = (meta, table) else {
        return fail(AT, "expected the property table that the feature ids name");
    };
    let class = meta
        .schema
        .as_ref()
        .and_then(|s| s.classes.get(&table.class));
    let Some(class) = class else {
        return fail(AT, format!("its schema has no class {:?}", table.class));
    };
    if set.feature_count != table.count {
        return fail(
            AT,
            format!("{} features, {} rows", set.feature_count, table.count),
        );
    }
    let column = |name: &str| -> Result<Vec<u64>, ReadError> {
        let found = class.properties.get(name).zip(table.properties.get(name));
        let Some((property, values)) = found else {
            return fail(AT, format!("the table has no column {name:?}"));
        };
        numbers(
            property,
            buffers.view(doc, values.values)?.get(),
            table.count,
        )
        .map_or_else(|what| fail(AT, format!("column {name:?}: {what}")), Ok)
    };
    let (cell, object) = (column("cell")?, column("object")?);
    let (surface, triangles) = (column("surface")?, column("triangles")?);
    let row = |i: usize| PieceIds {
        cell: cell[i],
        object: object[i],
        surface: surface[i],
        triangles: triangles[i],
    };
    Ok((0..cell.len()).map(row).collect())
}

/// The measures in table 0 for each of `count` rows; a column that is not there has no values.
///
/// # Errors
/// If a column is not as it should be, or has a value that is no finite number.
pub(super) fn measured(
    doc: &Document,
    buffers: &Buffers,
    count: usize,
) -> Result<Vec<Measured>, ReadError> {
    let mut out = vec![Measured::default(); count];
    let found = doc.extensions.structural_metadata.as_ref().and_then(|m| {
        let table = m.property_tables.first()?;
        Some((table, m.schema.as_ref()?.classes.get(&table.class)?))
    });
    let Some((table, class)) = found else {
        return Ok(out);
    };
    for (i, name) in MEASURES.into_iter().enumerate() {
        let column = class.properties.get(name).zip(table.properties.get(name));
        let Some((property, values)) = column else {
            continue;
        };
        let bytes = buffers.view(doc, values.values)?;
        let cells = cells(property, bytes.get(), table.count)
            .or_else(|what| fail(TABLE, format!("column {name:?}: {what}")))?;
        for (row, value) in out.iter_mut().zip(cells) {
            if property.no_data.as_ref() != Some(&value) {
                row.values[i] = value.as_f64().unwrap_or(f64::NAN);
            }
        }
    }
    let unit = class.extras.unit.as_deref().and_then(Unit::short_name);
    let voxels = |row: &Measured| !row.values[0].is_nan();
    for row in out.iter_mut().filter(|r| voxels(r)) {
        row.unit = unit;
    }
    Ok(out)
}

/// Reads all columns of table 0, one map per row, as the nodes' `extras` would have them: values
/// that the schema calls missing are left out, and rows with measures have their `unit`. Whether ids
/// and table fit together is checked by [`rows`].
pub(super) fn extras(
    doc: &Document,
    buffers: &Buffers,
) -> Result<Vec<Map<String, Value>>, ReadError> {
    let found = doc.extensions.structural_metadata.as_ref().and_then(|m| {
        let table = m.property_tables.first()?;
        Some((table, m.schema.as_ref()?.classes.get(&table.class)?))
    });
    let Some((table, class)) = found else {
        return fail(TABLE, "expected a table and its class");
    };
    let mut rows = Vec::new();
    for (name, values) in &table.properties {
        let Some(property) = class.properties.get(name) else {
            return fail(TABLE, format!("its class has no property {name:?}"));
        };
        let bytes = buffers.view(doc, values.values)?;
        let column = match cells(property, bytes.get(), table.count) {
            Ok(column) => column,
            Err(what) => return fail(TABLE, format!("column {name:?}: {what}")),
        };
        // the first column's bytes bound the number of rows
        rows.resize_with(column.len(), Map::new);
        for (row, value) in rows.iter_mut().zip(column) {
            if property.no_data.as_ref() != Some(&value) {
                row.insert(name.clone(), value);
            }
        }
    }
    // a count of voxels is a whole number on nodes, as long as Blender takes it for one
    for row in &mut rows {
        let small = |v: &u64| *v <= i32::MAX as u64;
        if let Some(count) = row
            .get("voxels")
            .and_then(Value::as_f64)
            .and_then(whole)
            .filter(small)
        {
            row.insert("voxels".into(), count.into());
        }
    }
    if let Some(unit) = &class.extras.unit {
        for row in rows.iter_mut().filter(|r| r.contains_key("voxels")) {
            row.insert("unit".into(), unit.clone().into());
        }
    }
    Ok(rows)
}

/// Decodes a column of `count` numbers of any kind.
fn cells(property: &ClassProperty, bytes: &[u8], count: u64) -> Result<Vec<Value>, String> {
    let component = property.component_type.as_deref().unwrap_or("");
    let decode: fn(&[u8]) -> Option<Value> = match component {
        "UINT8" => |b| Some(u8::from_le_bytes(b.try_into().ok()?).into()),
        "INT32" => |b| Some(i32::from_le_bytes(b.try_into().ok()?).into()),
        "UINT32" => |b| Some(u32::from_le_bytes(b.try_into().ok()?).into()),
        "UINT64" => |b| Some(u64::from_le_bytes(b.try_into().ok()?).into()),
        // what has no value is noData, which JSON has a number for
        "FLOAT64" => |b| {
            let value = f64::from_le_bytes(b.try_into().ok()?);
            value.is_finite().then(|| value.into())
        },
        _ => return Err(format!("component type {component:?} is not one of alvis")),
    };
    let size = match component {
        "UINT8" => 1,
        "INT32" | "UINT32" => 4,
        _ => 8,
    };
    if property.kind != "SCALAR" || count.checked_mul(size) != Some(bytes.len() as u64) {
        return Err(format!(
            "found {} and {} bytes for {count} rows, expected SCALAR of {size} bytes",
            property.kind,
            bytes.len()
        ));
    }
    bytes
        .chunks_exact(size as usize)
        .map(|b| decode(b).ok_or_else(|| "a value is no finite number".to_owned()))
        .collect()
}

/// Decodes a column of `count` numbers; the column's bytes bound what is allocated.
fn numbers(property: &ClassProperty, bytes: &[u8], count: u64) -> Result<Vec<u64>, String> {
    let component = property.component_type.as_deref().unwrap_or("");
    let size = match component {
        "UINT32" | "INT32" | "FLOAT32" => 4,
        "UINT64" | "INT64" | "FLOAT64" => 8,
        _ => 0,
    };
    if property.kind != "SCALAR" || size == 0 {
        return Err(format!(
            "found {} of {component:?}, expected SCALAR of 32 or 64 bits",
            property.kind
        ));
    }
    if count.checked_mul(size) != Some(bytes.len() as u64) {
        return Err(format!(
            "found {} bytes for {count} rows of {size} bytes",
            bytes.len()
        ));
    }
    let value = |b: &[u8]| -> Option<u64> {
        match component {
            "UINT32" => Some(u32::from_le_bytes(b.try_into().ok()?).into()),
            "INT32" => i32::from_le_bytes(b.try_into().ok()?).try_into().ok(),
            "FLOAT32" => whole(f32::from_le_bytes(b.try_into().ok()?).into()),
            "UINT64" => Some(u64::from_le_bytes(b.try_into().ok()?)),
            "INT64" => i64::from_le_bytes(b.try_into().ok()?).try_into().ok(),
            _ => whole(f64::from_le_bytes(b.try_into().ok()?)),
        }
    };
    bytes
        .chunks_exact(size as usize)
        .map(|b| value(b).ok_or_else(|| "a value is not a whole number from 0".to_owned()))
        .collect()
}
