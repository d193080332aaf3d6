//! The laws that hold between all surfaces, the manifest's sums, and the tables.

use super::against::Voxels;
use super::code::Code;
use super::components::ComponentRows;
use super::contacts::ContactLedger;
use super::ledger::{Group, Kind, Laws, Ledger, Rows};
use super::paint::{self, Colour, Paints};
use super::parts;
use super::report::Issues;
use super::tables::Table;
use super::tile::{Context, Counts};
use super::voxels::VoxelLedger;
use crate::error::Result;
use crate::manifest::{Manifest, Primitives};
use crate::table;
use rayon::ThreadPool;

/// The counts of a whole tile set.
#[derive(Default)]
pub(super) struct Found {
    /// True if the set is a part.
    pub part: bool,
    /// What of the index is not proved.
    pub unproved: Vec<String>,
    pub counts: Counts,
    pub tiles: u64,
    pub strips: u64,
    pub euler: i64,
    /// Surfaces, cells, objects.
    pub ids: [u64; 3],
    /// What there is more where cells are parts of components.
    pub parts: Option<FoundParts>,
    /// Of the volume, if there is one.
    pub voxels: Option<Voxels>,
    /// Voxels below by cells, if it is known of each which cell it is of.
    pub by_cells: Option<VoxelLedger>,
    /// Where cells touch, by labels.
    pub contacts: Option<ContactLedger>,
}

/// The counts of a set whose cells are parts of components.
#[derive(Debug, Clone, Copy)]
pub(super) struct FoundParts {
    pub components: u64,
    /// Connected components of triangles.
    pub connected: u64,
    pub necks: u64,
}

/// Checks all of it, stage by stage: what follows from a finding of an earlier stage is not said.
///
/// # Errors
/// If the ledger's temporary files cannot be read back.
pub(super) fn check(
    ledger: Ledger,
    cx: &Context,
    pool: &ThreadPool,
    found: &mut Found,
    issues: &mut Issues,
) -> Result<()> {
    let c = found.counts;
    found.euler = c.vertices as i64 - c.edges as i64 + c.triangles as i64;
    if cx.manifest.may_gape() {
        // what ends where left-out cells touched bounds no body, and its tables are those of the whole
        let stated = &cx.manifest.totals;
        found.ids = [stated.surfaces, stated.cells, stated.objects];
        return Ok(());
    }
    if cx.manifest.cells.is_some() {
        return parts::check(ledger, cx, found, issues);
    }
    let surfaces = ledger.surfaces;
    let [mut of_surfaces, mut of_cells, mut of_objects] =
        Kind::ALL.map(|kind| Listed::new(kind, cx));
    let stated = &cx.manifest.totals;
    let mut components = ComponentRows::new(cx.manifest);
    let [cells, objects] =
        [stated.cells, stated.objects].map(|n| if surfaces == 0 { n } else { 0 });
    let [by_surface, by_cell, by_object] = ledger.into_sorted()?;
    // at the same time as cells and objects: there are about as many surfaces as of both together
    let (first, others) = pool.join(
        || of_surfaces.check(by_surface, cx, 0, &mut ComponentRows::new(cx.manifest)),
        || {
            of_cells.check(by_cell, cx, cells, &mut components)?;
            of_objects.check(by_object, cx, objects, &mut components)
        },
    );
    first.and(others)?;
    found.ids = [surfaces, of_cells.laws.count, of_objects.laws.count];
    let mut sums = Issues::new(cx.max_issues);
    components.finish(&mut sums);
    let totals = Totals { found, sums };
    totals.report([of_surfaces, of_cells, of_objects], cx, issues);
    Ok(())
}

/// What was found in all, to be compared with the manifest.
pub(super) struct Totals<'a> {
    pub found: &'a Found,
    /// Findings on sums over tables.
    pub sums: Issues,
}

impl Totals<'_> {
    /// Adds all findings, stage by stage.
    pub fn report<const N: usize>(self, all: [Listed; N], cx: &Context, issues: &mut Issues) {
        let found = self.found;
        let [mut own, mut values, mut unopened] = [0; 3].map(|_| Issues::new(cx.max_issues));
        let all = all.map(|listed| {
            own.append(listed.own);
            values.append(listed.values);
            unopened.append(listed.unopened);
            listed.laws
        });
        if !issues.broken() {
            issues.append(own);
        }
        // a part has gaps in its ids, and lacks objects or cells that whole surfaces would count
        let whole = !cx.manifest.is_part();
        if whole && !issues.broken() {
            all.iter().for_each(|l| l.finish(issues));
        }
        if whole && !issues.broken() {
            law(found, issues);
        }
        if !issues.broken() {
            all.iter().for_each(|l| l.check_order(issues));
            totals(cx.manifest, found, issues);
            issues.append(self.sums);
            issues.append(values);
        }
        issues.append(unopened);
    }
}

/// Surfaces and what they bound are a tree.
fn law(found: &Found, issues: &mut Issues) {
    let [surfaces, cells, objects] = found.ids;
    let (surfaces, below, name) = match found.parts {
        Some(parts) => (parts.connected, parts.components, "components"),
        None => (surfaces, cells, "cells"),
    };
    if surfaces > 0 && surfaces + 1 != below + objects {
        let message = format!(
            "found {surfaces} surfaces, {objects} objects and {below} {name}, expected surfaces + 1 = objects + {name}"
        );
        issues.add(Code::Law, "index.json#/totals", message);
    }
}

/// The findings on all surfaces, cells or objects, and on their table.
pub(super) struct Listed {
    pub laws: Laws,
    pub own: Issues,
    pub values: Issues,
    /// Why the table could not be opened.
    pub unopened: Issues,
}

impl Listed {
    pub fn new(kind: Kind, cx: &Context) -> Self {
        let none = || Issues::new(cx.max_issues);
        Listed {
            laws: Laws::new(kind),
            own: none(),
            values: none(),
            unopened: none(),
        }
    }

    /// Checks what the surfaces say and the table's rows, of which `without_surface` are those of a single-phase volume.
    pub fn check(
        &mut self,
        mut rows: Rows,
        cx: &Context,
        without_surface: u64,
        components: &mut ComponentRows,
    ) -> Result<()> {
        let mut table = Table::open(cx, self.laws.kind, &mut self.unopened);
        let kind = self.laws.kind;
        let mut paints = Paints::open(cx.root, cx.manifest, kind, &mut self.unopened);
        while let Some(group) = rows.next_group()? {
            let body = group.body(kind, cx);
            // what is of a part may have lost surfaces, and seem to be any other body
            let known = body.as_ref().filter(|_| !may_be_cut(cx.manifest, kind));
            self.laws.add(&group, known, &mut self.own);
            self.check_colour(&group, &mut paints, cx);
            if let Some(table) = &mut table {
                table.check(&group, body.as_ref(), components, &mut self.values);
            }
        }
        if let Some(table) = &mut table {
            // a volume of one phase: its one cell or object is the whole grid
            let whole = without_surface == 1 && !cx.manifest.is_part();
            if whole {
                let group = Group::single_phase();
                let body = group.body(kind, cx);
                table.check(&group, body.as_ref(), components, &mut self.values);
            }
            table.finish(without_surface - u64::from(whole), &mut self.values);
        }
        if let Some(paints) = &mut paints {
            // they have a row and no piece
            (1..=without_surface).for_each(|id| _ = paints.next(id));
            paints.finish(&mut self.values);
        }
        Ok(())
    }

    /// Compares the colour of pieces with what the row of their cell, object or surface makes of it.
    pub fn check_colour(&mut self, group: &Group, paints: &mut Option<Paints>, cx: &Context) {
        let expected = match paints {
            Some(paints) => paints.next(group.id),
            // without a selection there is no colour; one that cannot be read is an issue already
            None => cx.manifest.selection.is_none().then_some(0),
        };
        match expected {
            Some(expected) => self.compare_colour(group.total.colour, expected, group.id, cx),
            // the rows that follow are none of those that are looked for
            None => *paints = None,
        }
    }

    /// Compares the colour of the pieces of a cell, an object or a surface with the one expected, if these are painted.
    pub fn compare_colour(&mut self, found: Colour, expected: Colour, id: u64, cx: &Context) {
        let kind = self.laws.kind;
        if expected != found && paint::paints(cx.manifest, kind) {
            let (found, expected) = (paint::name(found), paint::name(expected));
            let message = format!(
                "pieces of {} {id} have {found}, expected {expected}",
                kind.name()
            );
            self.values.add(Code::Paint, "tiles", message);
        }
    }
}

/// True if some surfaces of a body may be missing: a cell's if anything but cells was chosen, an object's if anything but
/// objects was, and there are no caps. A part keeps caps only if it has all surfaces of its objects.
pub(super) fn may_be_cut(manifest: &Manifest, kind: Kind) -> bool {
    let (whole, closed) = match kind {
        Kind::Cell | Kind::Component => (table::Table::Cells, false),
        Kind::Object => (table::Table::Objects, manifest.cap),
        Kind::Surface | Kind::Neck | Kind::Wall => return false,
    };
    let selection = manifest.selection.as_ref();
    // a last step that only paints says nothing of what is there, unless it is all that is known
    let others = selection.is_some_and(|s| {
        let all = || s.before.is_empty();
        s.steps()
            .any(|step| step.table != whole && (step.chooses() || all()))
    });
    manifest.is_part() && !closed && others
}

/// A sum as the manifest states it, and as it is found.
struct Total {
    name: &'static str,
    stated: i128,
    sum: i128,
}

/// The sums over what tiles hold.
fn sums_of_tiles(manifest: &Manifest, found: &Found) -> Vec<Total> {
    let (t, c) = (&manifest.totals, &found.counts);
    let strips = manifest.primitives == Primitives::Strips;
    let indices = if strips { c.indices } else { 0 };
    let of = |name, stated: u64, sum: u64| Total {
        name,
        stated: stated.into(),
        sum: sum.into(),
    };
    vec![
        of("tiles", t.tiles, found.tiles),
        of("triangles", t.triangles, c.triangles),
        of("vertices", t.vertices, c.vertices),
        of("tile_vertices", t.tile_vertices, c.tile_vertices),
        of("strips", t.strips, found.strips),
        of("strip_indices", t.strip_indices, indices),
        of("border_edges", t.border_edges, c.border_edges),
        Total {
            name: "euler_characteristic",
            stated: t.euler_characteristic.into(),
            sum: found.euler.into(),
        },
        of("cap_triangles", t.cap_triangles, c.cap_triangles),
        of("bytes", t.bytes, c.bytes),
        Total {
            name: "volume6",
            stated: t.volume6,
            sum: c.volume6,
        },
    ]
}

/// The numbers of surfaces, objects and cells, and the sums over voxels.
fn sums_of_volume(manifest: &Manifest, found: &Found) -> Vec<Total> {
    let t = &manifest.totals;
    let [surfaces, cells, objects] = found.ids;
    let of = |name, stated: u64, sum: u64| Total {
        name,
        stated: stated.into(),
        sum: sum.into(),
    };
    let mut totals = vec![of("surfaces", t.surfaces, surfaces)];
    let (below, name, stated) = match found.parts {
        Some(parts) => (parts.components, "components", t.components),
        None => (cells, "cells", t.cells),
    };
    if let Some(parts) = found.parts {
        totals.push(of("cells", t.cells, cells));
        totals.push(of("necks", t.necks, parts.necks));
    }
    if surfaces > 0 {
        totals.push(of(name, stated, below));
        totals.push(of("objects", t.objects, objects));
    } else if !manifest.is_part() {
        // a single-phase volume has a cell or an object, but no surface that would show which
        totals.push(Total {
            name: "objects",
            stated: i128::from(t.objects) + i128::from(stated),
            sum: 1,
        });
    }
    if let Some(voxels) = &found.voxels {
        totals.push(of("voxels_above", t.voxels_above, voxels.above));
        totals.push(of("voxels_nan", t.voxels_nan, voxels.nan));
    } else {
        // by the tiles alone there is a limit only
        let below = manifest.grid.dims.voxels().saturating_sub(t.voxels_above);
        // of cells that were left out as dust, too, which are above by now
        let dust = manifest.dust.map_or(0, |dust| dust.cell_voxels);
        let most = match manifest.filtered_dtype().is_float() {
            true => below.saturating_add(dust),
            false => 0,
        };
        totals.push(of("voxels_nan", t.voxels_nan, t.voxels_nan.min(most)));
    }
    totals
}

/// Compares the manifest's sums with those of the tiles.
fn totals(manifest: &Manifest, found: &Found, issues: &mut Issues) {
    let pairs = [
        sums_of_tiles(manifest, found),
        sums_of_volume(manifest, found),
    ];
    for Total { name, stated, sum } in pairs.into_iter().flatten() {
        if stated != sum {
            let message = format!("found {sum}, stated {stated}");
            issues.add(
                Code::TotalsMismatch,
                format!("index.json#/totals/{name}"),
                message,
            );
        }
    }
}
