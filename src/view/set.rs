//! What the page is told of a tile set before it draws: `/set.json`.

use super::nodes::NodeLookup;
use crate::error::Result;
use crate::grid::LATTICE;
use crate::manifest::{Form, Manifest};
use crate::measure::{COMPONENT_COLUMNS, Get, SURFACE_COLUMNS};
use crate::table::Table;
use crate::tileset::TileSet;
use serde_json::{Value, json};

/// What the page is told that is not in the tile set.
#[derive(Debug, Clone)]
pub struct Told {
    /// The tile set as a shell takes it.
    pub place: String,
    /// Bytes of tiles that the page may keep on the graphics card.
    pub gpu_memory: u64,
    /// Slices of the volume can be had.
    pub slices: bool,
}

/// `/set.json`.
///
/// # Errors
/// Those of reading the heads of tables.
pub fn description(set: &TileSet, nodes: &NodeLookup, told: &Told) -> Result<Value> {
    let manifest = set.manifest();
    let Manifest {
        placement, totals, ..
    } = manifest;
    let filters: Vec<String> = manifest.filters.iter().map(ToString::to_string).collect();
    let mut tables = serde_json::Map::new();
    for table in Table::ALL {
        tables.insert(table.name().to_owned(), columns(set, table)?);
    }
    let mut levels = vec![json!({
        "level": 0,
        "nodes": totals.tiles,
        "triangles": totals.triangles,
        "error": 0,
    })];
    levels.extend(nodes.levels().map(|level| {
        json!({
            "level": level.level,
            "nodes": level.nodes,
            "triangles": level.triangles,
            "error": level.error_max,
        })
    }));
    Ok(json!({
        "name": name(set),
        "dims": manifest.grid.dims.0,
        "macrocube": manifest.grid.macrocube,
        "spacing": placement.spacing,
        "unit": placement.unit,
        "table_unit": manifest.measured().unit,
        "origin": placement.origin,
        "directions": placement.directions,
        "threshold": manifest.threshold,
        "filters": filters,
        "region": manifest.region.as_ref().map(ToString::to_string),
        "source": manifest.source.name,
        "tiles": totals.tiles,
        "triangles": totals.triangles,
        "cells": totals.cells,
        "objects": totals.objects,
        "surfaces": totals.surfaces,
        "cap": manifest.cap,
        "buried": are_buried(set),
        "form": form(manifest),
        "lattice": LATTICE,
        "levels": levels,
        "tables": tables,
        "slices": told.slices,
        "command": {"where": told.place},
        "gpu_memory": told.gpu_memory,
        "version": env!("CARGO_PKG_VERSION"),
    }))
}

/// The name of the directory.
fn name(set: &TileSet) -> String {
    let whole = set.dir().canonicalize();
    let whole = whole.unwrap_or_else(|_| set.dir().to_path_buf());
    let name = whole.file_name().unwrap_or(whole.as_os_str());
    name.to_string_lossy().into_owned()
}

/// The form as `--for` names it, or that of its encoding.
fn form(manifest: &Manifest) -> &'static str {
    match Form::of(manifest) {
        Form::MESHLAB => "meshlab",
        form if form.encoding == Form::WEB.encoding => "web",
        form if form.encoding == Form::BLENDER.encoding => "blender",
        _ => "quantized",
    }
}

/// True if all cells lie inside of material, which hides them from all sides. A table that cannot be read tells of none;
/// that it cannot is told where its values are asked for.
fn are_buried(set: &TileSet) -> bool {
    let manifest = set.manifest();
    let totals = &manifest.totals;
    // what the border cuts is open there, and a cap is a surface of its own
    if manifest.cap || totals.cells == 0 || totals.border_edges > 0 {
        return false;
    }
    let none_touches = || -> Result<bool> {
        let mut reader = Table::Cells.open(set.dir(), manifest)?;
        let touches = reader.own_column("touches_border")?;
        while let Some(row) = reader.next_row()? {
            if row.number(touches)? != Some(0.0) {
                return Ok(false);
            }
        }
        Ok(true)
    };
    none_touches().unwrap_or(false)
}

/// Rows and columns of a table.
fn columns(set: &TileSet, table: Table) -> Result<Value> {
    let reader = table.open(set.dir(), set.manifest())?;
    let column = |c: &crate::table::Column| json!({"name": c.name, "unit": c.unit, "whole": is_whole(table, &c.name)});
    let columns: Vec<Value> = reader.columns().iter().map(column).collect();
    Ok(json!({"rows": table.total(set.manifest()), "columns": columns}))
}

/// True if the values of a column are whole numbers.
fn is_whole(table: Table, name: &str) -> bool {
    let real = match table {
        Table::Surfaces => {
            let column = SURFACE_COLUMNS.iter().find(|c| c.name == name);
            column.map(|c| matches!(c.get, Get::Real(_)))
        }
        Table::Cells | Table::Objects => {
            let column = COMPONENT_COLUMNS.iter().find(|c| c.name == name);
            column.map(|c| matches!(c.get, Get::Real(_)))
        }
    };
    real.map_or(name == "id", |real| !real)
}
