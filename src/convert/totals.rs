//! The sums of a tile set.

use crate::convert::ConvertOptions;
use crate::convert::resolve::Components;
use crate::convert::scan::state::ScanOutput;
use crate::error::Result;
use crate::manifest::{Dust, Totals};

/// What was left out, if that was asked for.
pub fn dust_of(options: &ConvertOptions, scanned: &ScanOutput) -> Option<Dust> {
    let [objects, cells] = scanned.dust;
    (options.min_voxels > 1).then_some(Dust {
        min_voxels: options.min_voxels,
        objects: objects.0,
        object_voxels: objects.1,
        cells: cells.0,
        cell_voxels: cells.1,
    })
}

/// The totals that the scan knows.
pub fn scanned_totals(scanned: &ScanOutput) -> Totals {
    Totals {
        cap_triangles: scanned.caps.triangles,
        vertices: scanned.caps.vertices,
        volume6: scanned.caps.volume6,
        voxels_nan: scanned.nan,
        ..Totals::default()
    }
}

/// Adds what follows from the components: their numbers, and the sums of their surfaces.
pub fn sum_components(components: &Components, cap: bool, totals: &mut Totals) -> Result<()> {
    totals.objects = components.objects.len();
    totals.cells = components.cells.len();
    totals.surfaces = components.surfaces.len();
    for i in 0..components.objects.len() {
        totals.voxels_above += components.objects.get(i)?.voxels.voxels;
    }
    for i in 0..components.surfaces.len() {
        let mesh = components.surfaces.get(i)?.mesh;
        totals.vertices += mesh.vertices;
        totals.volume6 += mesh.volume6;
        totals.border_edges += mesh.border_edges;
    }
    if cap {
        totals.border_edges = 0;
    }
    let edges = (3 * totals.triangles + totals.border_edges) / 2;
    totals.euler_characteristic = totals.vertices as i64 - edges as i64 + totals.triangles as i64;
    Ok(())
}
