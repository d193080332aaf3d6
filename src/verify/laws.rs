//! What holds between all surfaces, the manifest's sums, and the tables.

use super::against::Voxels;
use super::code::Code;
use super::ledger::{Group, Kind, Laws, Ledger, Rows};
use super::paint::{self, Paints};
use super::report::Issues;
use super::solids::Solids;
use super::tables::Table;
use super::tile::{Context, Counts};
use crate::error::Result;
use crate::manifest::{Manifest, Primitives};
use rayon::ThreadPool;

/// What was counted.
#[derive(Default)]
pub(super) struct Found {
    /// True if the set is a part.
    pub part: bool,
    pub counts: Counts,
    pub tiles: u64,
    pub strips: u64,
    pub euler: i64,
    /// Surfaces, cells, objects.
    pub ids: [u64; 3],
    /// Of the volume, if there is one.
    pub voxels: Option<Voxels>,
}

/// Checks all of it, stage by stage: what follows from a finding of an earlier stage is not said.
///
/// # Errors
/// If the ledger's temporary files cannot be read back.
pub(super) fn check(
    ledger: Ledger,
    (cx, pool): (&Context, &ThreadPool),
    found: &mut Found,
    issues: &mut Issues,
) -> Result<()> {
    let c = found.counts;
    found.euler = c.vertices as i64 - c.edges as i64 + c.triangles as i64;
    found.ids[0] = ledger.surfaces;
    let surfaces = ledger.surfaces;
    let [mut of_surfaces, mut of_cells, mut of_objects] =
        Kind::ALL.map(|kind| Listed::new(kind, cx));
    let stated = &cx.manifest.totals;
    let mut solids = Solids::new(cx.manifest);
    let [cells, objects] =
        [stated.cells, stated.objects].map(|n| if surfaces == 0 { n } else { 0 });
    let [by_surface, by_cell, by_object] = ledger.into_sorted()?;
    // beside the others, which count bodies together: there are about as many
    let (first, others) = pool.join(
        || of_surfaces.check(by_surface, cx, 0, &mut Solids::new(cx.manifest)),
        || {
            of_cells.check(by_cell, cx, cells, &mut solids)?;
            of_objects.check(by_object, cx, objects, &mut solids)
        },
    );
    first.and(others)?;
    found.ids = [surfaces, of_cells.laws.count, of_objects.laws.count];
    let [mut own, mut values, mut unopened] = [0; 3].map(|_| Issues::new(cx.max_issues));
    let all = [of_surfaces, of_cells, of_objects].map(|listed| {
        own.append(listed.own);
        values.append(listed.values);
        unopened.append(listed.unopened);
        listed.laws
    });
    let mut sums = Issues::new(cx.max_issues);
    solids.finish(&mut sums);
    if !issues.broken() {
        issues.append(own);
    }
    // a part has gaps in its ids, and lacks objects or cells that whole surfaces would count
    let whole = !cx.manifest.is_part();
    if whole && !issues.broken() {
        all.iter().for_each(|l| l.finish(issues));
    }
    let [_, cells, objects] = found.ids;
    if whole && !issues.broken() && surfaces > 0 && surfaces + 1 != cells + objects {
        let message = format!(
            "found {surfaces} surfaces, {objects} objects and {cells} cells, expected surfaces + 1 = objects + cells"
        );
        issues.add(Code::Law, "index.json#/totals", message);
    }
    if !issues.broken() {
        all.iter().for_each(|l| l.check_order(issues));
        totals(cx.manifest, found, issues);
        issues.append(sums);
        issues.append(values);
    }
    issues.append(unopened);
    Ok(())
}

/// What is found of all surfaces, cells or objects, and of their table.
struct Listed {
    laws: Laws,
    own: Issues,
    values: Issues,
    /// Why the table could not be opened.
    unopened: Issues,
}

impl Listed {
    fn new(kind: Kind, cx: &Context) -> Self {
        let none = || Issues::new(cx.max_issues);
        Listed {
            laws: Laws::new(kind),
            own: none(),
            values: none(),
            unopened: none(),
        }
    }

    /// Checks what the surfaces say and the table's rows, of which `alone` are of no surface.
    fn check(
        &mut self,
        mut rows: Rows,
        cx: &Context,
        alone: u64,
        solids: &mut Solids,
    ) -> Result<()> {
        let mut table = Table::open(cx.root, cx.manifest, self.laws.kind, &mut self.unopened);
        let kind = self.laws.kind;
        let mut paints = match kind {
            Kind::Cell => Paints::open(cx.root, cx.manifest, &mut self.unopened),
            _ => None,
        };
        while let Some(group) = rows.next_group()? {
            let body = group.body(kind, cx);
            // an object of a part may have lost surfaces, and seem to be any other body
            let known = body.as_ref().filter(|_| !may_be_cut(cx.manifest, kind));
            self.laws.add(&group, known, &mut self.own);
            if kind == Kind::Cell {
                self.check_colour(&group, &mut paints, cx);
            }
            if let Some(table) = &mut table {
                table.check((&group, body.as_ref()), solids, &mut self.values);
            }
        }
        if let Some(table) = &mut table {
            // a volume of one phase: its one cell or object is the whole grid
            let whole = alone == 1 && !cx.manifest.is_part();
            if whole {
                let group = Group::alone();
                let body = group.body(kind, cx);
                table.check((&group, body.as_ref()), solids, &mut self.values);
            }
            table.finish(alone - u64::from(whole), &mut self.values);
        }
        if let Some(paints) = &paints {
            paints.finish(&mut self.values);
        }
        Ok(())
    }

    /// Compares the colour of a cell's pieces with what its row in the table makes of it.
    fn check_colour(&mut self, group: &Group, paints: &mut Option<Paints>, cx: &Context) {
        let expected = match paints {
            Some(paints) => paints.next(group.id),
            // without a selection there is no colour; one that cannot be read is an issue already
            None => cx.manifest.selection.is_none().then_some(0),
        };
        let found = group.total.colour;
        match expected {
            Some(expected) if expected != found => {
                let (found, expected) = (paint::name(found), paint::name(expected));
                let message = format!(
                    "pieces of cell {} have {found}, expected {expected}",
                    group.id
                );
                self.values.add(Code::Paint, "tiles", message);
            }
            // the rows that follow are none of those that are looked for
            None => *paints = None,
            _ => {}
        }
    }
}

/// True if some surfaces of a body may be missing: an object's in a part without caps. A part keeps caps only
/// if it has all surfaces of its objects.
pub(super) fn may_be_cut(manifest: &Manifest, kind: Kind) -> bool {
    kind == Kind::Object && manifest.is_part() && !manifest.cap
}

/// Compares the manifest's sums with those of the tiles.
fn totals(manifest: &Manifest, found: &Found, issues: &mut Issues) {
    let (t, c) = (&manifest.totals, &found.counts);
    let strips = manifest.primitives == Primitives::Strips;
    let [surfaces, cells, objects] = found.ids;
    let wide = i128::from;
    let mut pairs = vec![
        ("tiles", wide(t.tiles), wide(found.tiles)),
        ("triangles", wide(t.triangles), wide(c.triangles)),
        ("vertices", wide(t.vertices), wide(c.vertices)),
        (
            "tile_vertices",
            wide(t.tile_vertices),
            wide(c.tile_vertices),
        ),
        ("strips", wide(t.strips), wide(found.strips)),
        (
            "strip_indices",
            wide(t.strip_indices),
            wide(if strips { c.indices } else { 0 }),
        ),
        ("border_edges", wide(t.border_edges), wide(c.border_edges)),
        (
            "euler_characteristic",
            t.euler_characteristic.into(),
            found.euler.into(),
        ),
        (
            "cap_triangles",
            wide(t.cap_triangles),
            wide(c.cap_triangles),
        ),
        ("bytes", wide(t.bytes), wide(c.bytes)),
        ("volume6", t.volume6, c.volume6),
        ("surfaces", wide(t.surfaces), wide(surfaces)),
    ];
    if surfaces > 0 {
        pairs.push(("cells", wide(t.cells), wide(cells)));
        pairs.push(("objects", wide(t.objects), wide(objects)));
    } else if !manifest.is_part() {
        // a volume of one phase has a cell or an object, but no surface that would show which
        let regions = wide(t.objects) + wide(t.cells);
        pairs.push(("objects", regions, 1));
    }
    if let Some(voxels) = &found.voxels {
        pairs.push(("voxels_above", wide(t.voxels_above), wide(voxels.above)));
        pairs.push(("voxels_nan", wide(t.voxels_nan), wide(voxels.nan)));
    } else {
        // by the tiles alone there is a limit only
        let below = wide(manifest.grid.dims.voxels()) - wide(t.voxels_above);
        let most = if manifest.filtered_dtype().is_float() {
            below.max(0)
        } else {
            0
        };
        let nan = wide(t.voxels_nan);
        pairs.push(("voxels_nan", nan, nan.min(most)));
    }
    for (name, stated, sum) in pairs {
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
