//! The laws and tables of sets whose cells are parts of components.

use super::cells::{CellRow, CellTable, SHARE};
use super::components::check_components;
use super::necks::{NeckTable, check_pairs};
use super::sums::{Pairs, SortedBegins};
use crate::error::Result;
use crate::manifest::PartsBy;
use crate::verify::code::Code;
use crate::verify::components::ComponentRows;
use crate::verify::laws::{Found, FoundParts, Listed, Totals};
use crate::verify::ledger::{ByComponent, Group, Kind, Ledger, Rows};
use crate::verify::paint::Paints;
use crate::verify::report::Issues;
use crate::verify::spill::Spill;
use crate::verify::tables::Table;
use crate::verify::tile::Context;
use crate::verify::voxels::VoxelLedger;

/// Records of two numbers that a sort keeps in memory.
const PAIRS: usize = 1 << 13;

/// What pieces say of cells, sorted by these.
struct OfCells {
    sums: Rows,
    begins: SortedBegins,
    tiles: Pairs,
    /// The objects that each has a surface with, doubled, and one if the table has an Euler characteristic of that.
    objects: Pairs,
}

/// What the cells of components are, to be sorted by these.
pub(super) struct OfComponents {
    pub sums: ByComponent,
    pub tiles: Spill<2>,
    /// The objects that each has a surface with.
    pub objects: Spill<2>,
    /// Rows of cells.
    pub shares: Spill<SHARE>,
    pub cells: u64,
    pub necks: u64,
}

/// Checks all of it, as [`crate::verify::laws::check`] does where cells are the components. The set is no part of another.
///
/// # Errors
/// If temporary files cannot be written or read back.
pub(in crate::verify) fn check(
    mut ledger: Ledger,
    cx: &Context,
    found: &mut Found,
    issues: &mut Issues,
) -> Result<()> {
    let Some(parts) = ledger.take_parts()? else {
        return Ok(());
    };
    let connected = ledger.surfaces;
    let mut all = [Kind::Surface, Kind::Cell, Kind::Component, Kind::Object]
        .map(|kind| Listed::new(kind, cx));
    let [of_surfaces, of_cells, of_components, of_objects] = &mut all;
    let [by_surface, sums, by_object] = ledger.into_sorted()?;
    let (begins, tiles) = parts.into_sorted()?;
    let objects = Pairs::of(check_surfaces(by_surface, of_surfaces, cx)?)?;
    let of_cell = OfCells {
        sums,
        begins,
        tiles,
        objects,
    };
    let stated = &cx.manifest.totals;
    let mut bodies = ComponentRows::new(cx.manifest);
    // of a table that cannot be read nothing is said
    let mut counts = FoundParts {
        components: stated.components,
        connected,
        necks: stated.necks,
    };
    let mut cells = stated.cells;
    let by_cells = found.by_cells.take();
    if let Some(of) = check_cells(of_cell, by_cells, of_cells, cx)? {
        (cells, counts.necks) = (of.cells, of.necks);
        if let Some(count) = check_components(of, connected, of_components, &mut bodies, cx)? {
            counts.components = count;
        }
    }
    let alone = if connected == 0 { stated.objects } else { 0 };
    of_objects.check(by_object, cx, alone, &mut bodies)?;
    found.ids = [of_surfaces.laws.count, cells, of_objects.laws.count];
    found.parts = Some(counts);
    let mut sums = Issues::new(cx.max_issues);
    bodies.finish(&mut sums);
    Totals { found, sums }.report(all, cx, issues);
    Ok(())
}

/// Checks surfaces with their table; returns the objects of each cell, see [`OfCells::objects`].
fn check_surfaces(mut rows: Rows, listed: &mut Listed, cx: &Context) -> Result<Spill<2>> {
    let mut table = Table::open(cx, Kind::Surface, &mut listed.unopened);
    let mut paints = Paints::open(cx.root, cx.manifest, Kind::Surface, &mut listed.unopened);
    let mut unused = ComponentRows::new(cx.manifest);
    let mut objects = Spill::new(PAIRS);
    let (mut last, mut disorder) = ([0; 2], None);
    while let Some(group) = rows.next_group()? {
        let (id, ids) = (group.id, group.total.ids);
        if group.several_ids {
            let message = format!("pieces of surface {id} are of several cells or objects");
            listed.own.add(Code::SurfaceMixed, "tiles", message);
        }
        if last > [ids.cell, ids.object] {
            disorder.get_or_insert(id);
        }
        last = [ids.cell, ids.object];
        listed.laws.count(&group, true, &mut listed.own);
        listed.check_colour(&group, &mut paints, cx);
        let row = table
            .as_mut()
            .and_then(|table| table.check(&group, None, &mut unused, &mut listed.values));
        // without a row, nothing is said
        let euler = row.map_or(2, |row| u64::from(row[6].is_some()));
        objects.push([ids.cell, ids.object << 2 | euler])?;
    }
    if let Some(id) = disorder {
        let message =
            format!("found surface {id}, expected surfaces numbered by cell, then object");
        listed
            .values
            .add(Code::IdOrder, "index.json#/totals/surfaces", message);
    }
    if let Some(table) = &mut table {
        table.finish(0, &mut listed.values);
    }
    if let Some(paints) = &mut paints {
        paints.finish(&mut listed.values);
    }
    Ok(objects)
}

/// Checks cells and necks with their tables; returns what is of each component, if all rows can be read.
fn check_cells(
    mut of: OfCells,
    by_cells: Option<VoxelLedger>,
    listed: &mut Listed,
    cx: &Context,
) -> Result<Option<OfComponents>> {
    let split = matches!(cx.manifest.cells, Some(PartsBy::Split { .. }));
    let mut necks = NeckTable::read(cx, split, listed)?;
    let Some(mut table) = CellTable::open(cx, &mut listed.unopened) else {
        return Ok(None);
    };
    let mut paints = Paints::open(cx.root, cx.manifest, Kind::Cell, &mut listed.unopened);
    let mut by_cells = by_cells.map(VoxelLedger::into_sorted).transpose()?;
    let mut sums = ByComponent::new();
    let [mut tiles, mut objects] = [0; 2].map(|_| Spill::new(PAIRS));
    let mut cells = 0;
    while let Some(row) = table.next_row(&mut listed.values)? {
        cells += 1;
        let pieces = pieces_of(row.id, &mut of.sums, listed)?;
        let begins = of.begins.of(row.id)?;
        let own_necks = necks.of_cell(&row, listed)?;
        let known = necks.is_whole.then_some(&own_necks);
        table.check(&row, pieces.as_ref(), &begins, known, listed)?;
        if let Some(by_cells) = &mut by_cells {
            by_cells.compare(row.id, &row.values, &table.rows, &table.place(), listed)?;
        }
        let component = row.component().unwrap_or(0);
        let mut euler_fits = true;
        of.objects.each(row.id, |object| {
            let has_euler = object & 3;
            euler_fits &= has_euler == 2 || (has_euler == 1) == (row.necks() == Some(0.0));
            objects.push([component, object >> 2])
        })?;
        if !euler_fits {
            let message = format!(
                "euler_characteristic of surfaces of cell {}: expected one iff no cell touches it",
                row.id
            );
            listed.values.add(Code::TableValue, "surfaces.csv", message);
        }
        of.tiles
            .each(row.id, |tile| tiles.push([component, tile]))?;
        if let Some(pieces) = &pieces {
            sums.push(component, pieces)?;
        }
        check_colour(&row, pieces.as_ref(), &mut paints, listed, cx);
    }
    if !table.is_whole() {
        return Ok(None);
    }
    pieces_of(u64::MAX, &mut of.sums, listed)?;
    necks.finish(listed)?;
    check_unlabelled(table.last_voxels(), listed, cx);
    if let Some(by_cells) = by_cells {
        by_cells.finish(cx.manifest, listed)?;
    }
    if let Some(paints) = &mut paints {
        paints.finish(&mut listed.values);
    }
    check_pairs(necks.pairs, &necks.path, cx, listed)?;
    Ok(Some(OfComponents {
        sums,
        tiles,
        objects,
        shares: table.shares,
        cells,
        necks: necks.count,
    }))
}

/// The sums over the pieces of a cell; those of cells before have no row.
fn pieces_of(id: u64, sums: &mut Rows, listed: &mut Listed) -> Result<Option<Group>> {
    while let Some(other) = sums.peek().filter(|other| *other < id) {
        sums.next_group()?;
        let message = format!("found no row for cell {other}, which has pieces");
        listed.values.add(Code::TableRows, "cells.csv", message);
    }
    if sums.peek() != Some(id) {
        return Ok(None);
    }
    let group = sums.next_group()?;
    if let Some(group) = &group {
        listed.laws.count(group, false, &mut listed.own);
    }
    Ok(group)
}

/// Compares the colour of a cell's pieces with what its row makes of it.
fn check_colour(
    row: &CellRow,
    pieces: Option<&Group>,
    paints: &mut Option<Paints>,
    listed: &mut Listed,
    cx: &Context,
) {
    let expected = match paints {
        Some(own) => own.next(row.id),
        None => cx.manifest.selection.is_none().then_some(0),
    };
    match (expected, pieces) {
        (Some(expected), Some(pieces)) => {
            listed.compare_colour(pieces.total.colour, expected, row.id, cx);
        }
        (Some(_), None) => {}
        // the rows that follow are none of those that are looked for
        (None, _) => *paints = None,
    }
}

/// Compares the last cell with the voxels that have no label, of which it is made.
fn check_unlabelled(last: Option<f64>, listed: &mut Listed, cx: &Context) {
    let Some(PartsBy::Labels { unlabelled, .. }) = &cx.manifest.cells else {
        return;
    };
    if let Some(stated) = unlabelled
        && last != Some(*stated as f64)
    {
        let message = format!(
            "found {stated}, the last cell, which is that of voxels without a label, has {} voxels",
            last.unwrap_or(0.0)
        );
        let at = "index.json#/cells/unlabelled";
        listed.values.add(Code::ManifestValue, at, message);
    }
}
