//! The laws and tables of sets whose cells are parts of components.

use super::cells::CellTable;
use super::necks::{NeckTable, check_pairs, check_several};
use super::shares::check_shares;
use super::sums::{CellSpill, Pairs, SortedCells};
use crate::error::Result;
use crate::manifest::PartsBy;
use crate::verify::code::Code;
use crate::verify::components::ComponentRows;
use crate::verify::laws::{Found, Listed, Totals};
use crate::verify::ledger::{ByComponent, Group, Kind, Ledger, Rows};
use crate::verify::paint::Paints;
use crate::verify::report::Issues;
use crate::verify::spill::Spill;
use crate::verify::tables::Table;
use crate::verify::tile::Context;

/// Records of two numbers that a sort keeps in memory.
pub(super) const PAIRS: usize = 1 << 13;

/// What is sorted by component.
struct OfComponents {
    surfaces: ByComponent,
    cells: CellSpill,
    tiles: Spill<2>,
}

/// Checks all of it, as [`crate::verify::laws::check`] does where cells are the components.
///
/// # Errors
/// If temporary files cannot be written or read back.
pub(in crate::verify) fn check(
    mut ledger: Ledger,
    cx: &Context,
    found: &mut Found,
    issues: &mut Issues,
) -> Result<()> {
    let Some(parts) = ledger.parts.take() else {
        return Ok(());
    };
    let surfaces = ledger.surfaces;
    let mut all = [Kind::Surface, Kind::Component, Kind::Object].map(|kind| Listed::new(kind, cx));
    let [of_surfaces, of_components, of_objects] = &mut all;
    let [by_surface, _, by_object] = ledger.into_sorted()?;
    let (cells, tiles) = parts.into_sorted()?;
    let mut bodies = ComponentRows::new(cx.manifest);
    let by_component = check_surfaces(by_surface, cells, tiles, of_surfaces, cx)?;
    let stated = &cx.manifest.totals;
    let [components, objects] =
        [stated.components, stated.objects].map(|n| if surfaces == 0 { n } else { 0 });
    let mut rows = Listed::new(Kind::Cell, cx);
    found.components = Some(stated.components);
    found.ids[1] = stated.cells;
    // else the table of surfaces is wrong, and which component has what is not known
    if let Some(by_component) = by_component {
        let by_cell = check_components(by_component, components, of_components, &mut bodies, cx)?;
        found.components = Some(of_components.laws.count);
        if let Some(count) = check_cells(by_cell, &mut rows, cx)? {
            found.ids[1] = count;
        }
    }
    of_objects.check(by_object, cx, objects, &mut bodies)?;
    (found.ids[0], found.ids[2]) = (surfaces, of_objects.laws.count);
    let mut sums = Issues::new(cx.max_issues);
    bodies.finish(&mut sums);
    let laws = Totals { found, sums };
    let [of_surfaces, of_components, of_objects] = all;
    laws.report([of_surfaces, of_components, of_objects, rows], cx, issues);
    Ok(())
}

/// Checks surfaces with their table, and sorts what is of each by the component that the table has. `None` if it lacks some.
fn check_surfaces(
    mut rows: Rows,
    mut cells: SortedCells,
    mut tiles: Pairs,
    listed: &mut Listed,
    cx: &Context,
) -> Result<Option<OfComponents>> {
    let mut table = Table::open(cx, Kind::Surface, &mut listed.unopened);
    let mut paints = Paints::open(cx.root, cx.manifest, Kind::Surface, &mut listed.unopened);
    let mut unused = ComponentRows::new(cx.manifest);
    let mut out = OfComponents {
        surfaces: ByComponent::new(),
        cells: CellSpill::new(),
        tiles: Spill::new(PAIRS),
    };
    let mut are_known = true;
    while let Some(group) = rows.next_group()? {
        listed.laws.add(&group, None, &mut listed.own);
        listed.check_colour(&group, &mut paints, cx);
        let stated = table
            .as_mut()
            .and_then(|table| table.check(&group, None, &mut unused, &mut listed.values));
        let component = stated.filter(|id| *id >= 1.0).map_or(0, |id| id as u64);
        are_known &= component > 0;
        out.surfaces.push(component, &group)?;
        while let Some((cell, sums)) = cells.next_of(group.id)? {
            out.cells.push([component, cell], &sums)?;
        }
        tiles.each(group.id, |tile| out.tiles.push([component, tile]))?;
    }
    if let Some(table) = &mut table {
        table.finish(0, &mut listed.values);
    }
    if let Some(paints) = &mut paints {
        paints.finish(&mut listed.values);
    }
    Ok(are_known.then_some(out))
}

/// Checks components with their table, of which `without_surface` is that of a volume of one phase, and sorts what is of
/// each cell by the cell and the component.
fn check_components(
    sorted: OfComponents,
    without_surface: u64,
    listed: &mut Listed,
    bodies: &mut ComponentRows,
    cx: &Context,
) -> Result<SortedCells> {
    let mut table = Table::open(cx, Kind::Component, &mut listed.unopened);
    let mut rows = sorted.surfaces.into_sorted()?;
    let mut cells = sorted.cells.into_sorted()?;
    let mut tiles = Pairs::of(sorted.tiles)?;
    let mut by_cell = CellSpill::new();
    while let Some(mut group) = rows.next_group()? {
        let mut count = 0;
        tiles.each(group.id, |_| {
            count += 1;
            Ok(())
        })?;
        group.total.cell_tiles = count;
        while let Some((cell, mut sums)) = cells.next_of(group.id)? {
            sums.surfaces = group.parts;
            by_cell.push([cell, group.id], &sums)?;
        }
        let body = group.body(Kind::Component, cx);
        listed.laws.add(&group, body.as_ref(), &mut listed.own);
        if let Some(table) = &mut table {
            table.check(&group, body.as_ref(), bodies, &mut listed.values);
        }
    }
    if let Some(table) = &mut table {
        let whole = without_surface == 1 && !cx.manifest.is_part();
        if whole {
            let group = Group::single_phase();
            let body = group.body(Kind::Component, cx);
            table.check(&group, body.as_ref(), bodies, &mut listed.values);
        }
        table.finish(without_surface - u64::from(whole), &mut listed.values);
    }
    by_cell.into_sorted()
}

/// Checks cells with their table, and the tables with each other; returns how many rows there are, if all can be read.
fn check_cells(mut by_cell: SortedCells, listed: &mut Listed, cx: &Context) -> Result<Option<u64>> {
    let split = matches!(cx.manifest.cells, Some(PartsBy::Split { .. }));
    let mut necks = NeckTable::read(cx, split, listed)?;
    let Some(mut table) = CellTable::open(cx, &mut listed.unopened) else {
        return Ok(None);
    };
    let mut paints = Paints::open(cx.root, cx.manifest, Kind::Cell, &mut listed.unopened);
    // components of cells that have several
    let mut shown = Spill::new(PAIRS);
    let mut count = 0;
    while let Some(row) = table.next_row(&mut listed.values)? {
        count += 1;
        let pieces = pieces_of(row.id, &mut by_cell, listed)?;
        let own_necks = necks.of_cell(&row, listed)?;
        let known = necks.is_whole.then_some(&own_necks);
        table.check(&row, &pieces, known, listed)?;
        if row.component().is_none() {
            shown.push([row.id, 0])?;
            let components = pieces.iter().map(|(component, _)| *component);
            components
                .into_iter()
                .try_for_each(|component| shown.push([row.id, component]))?;
        }
        check_colour(row.id, &pieces, &mut paints, listed, cx);
    }
    if !table.is_whole() {
        return Ok(None);
    }
    pieces_of(u64::MAX, &mut by_cell, listed)?;
    necks.finish(listed)?;
    check_unlabelled(table.last_voxels(), listed, cx);
    if let Some(paints) = &mut paints {
        paints.finish(&mut listed.values);
    }
    check_pairs(necks.pairs, &necks.path, &mut shown, cx, listed)?;
    if necks.is_whole && cx.manifest.totals.surfaces > 0 {
        check_several(shown, listed)?;
    }
    check_shares(table.shares, cx, listed)?;
    Ok(Some(count))
}

/// What the pieces of a cell say: of each component.
pub(super) type PiecesOf = Vec<(u64, super::sums::CellSums)>;

/// The pieces of a cell; those of cells before have no row.
fn pieces_of(id: u64, by_cell: &mut SortedCells, listed: &mut Listed) -> Result<PiecesOf> {
    while let Some(other) = by_cell.peek().filter(|other| *other < id) {
        while by_cell.next_of(other)?.is_some() {}
        let message = format!("found no row for cell {other}, which has pieces");
        listed.values.add(Code::TableRows, "cells.csv", message);
    }
    let mut pieces = Vec::new();
    while let Some(of_component) = by_cell.next_of(id)? {
        pieces.push(of_component);
    }
    Ok(pieces)
}

/// Compares the colour of a cell's pieces with what its row makes of it.
fn check_colour(
    id: u64,
    pieces: &PiecesOf,
    paints: &mut Option<Paints>,
    listed: &mut Listed,
    cx: &Context,
) {
    let expected = match paints {
        Some(own) => own.next(id),
        None => cx.manifest.selection.is_none().then_some(0),
    };
    let Some(expected) = expected else {
        // the rows that follow are none of those that are looked for
        *paints = None;
        return;
    };
    for (_, sums) in pieces {
        listed.compare_colour(sums.colour, expected, id, cx);
    }
}

/// Compares the last cell with the voxels that have no label, of which it is made.
fn check_unlabelled(last: Option<f64>, listed: &mut Listed, cx: &Context) {
    let Some(PartsBy::Labels { unlabelled, .. }) = &cx.manifest.cells else {
        return;
    };
    if let Some(stated) = unlabelled
        && last != Some(*stated as f64)
        && !cx.manifest.is_part()
    {
        let message = format!(
            "found {stated}, the last cell, which is that of voxels without a label, has {} voxels",
            last.unwrap_or(0.0)
        );
        let at = "index.json#/cells/unlabelled";
        listed.values.add(Code::ManifestValue, at, message);
    }
}
