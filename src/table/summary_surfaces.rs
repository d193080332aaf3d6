//! What the table of surfaces sums up to.

use super::outside::find;
use super::query::Query;
use super::spread::Spread;
use super::summary::{Border, PorosityOf};
use super::{Row, Table};
use crate::error::Result;
use crate::manifest::Manifest;
use serde::Serialize;
use std::path::Path;

/// Sums over the chosen rows of the table of surfaces.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SurfaceSummary {
    /// Rows chosen.
    pub count: u64,
    /// Rows of the table.
    pub of: u64,
    /// Rows chosen, by the name of the table.
    pub surfaces: u64,
    /// Those that do not touch the border.
    pub surfaces_whole: u64,
    /// Those that do, and may go on outside.
    pub surfaces_border: u64,
    /// The same, with their share.
    pub border: Border,
    /// Triangles of all rows chosen.
    pub triangles: u64,
    /// Their area.
    pub area: f64,
    /// Its unit.
    pub area_unit: String,
    /// That area by the volume of what [`SurfaceSummary::specific_surface_of`] says.
    pub specific_surface: Option<f64>,
    /// Its unit.
    pub specific_surface_unit: String,
    /// What the area is divided by: the grid or the region of interest.
    pub specific_surface_of: PorosityOf,
    /// How large the surfaces are that do not touch the border; absent if there is none.
    pub areas: Option<Spread>,
    /// What makes the numbers doubtful.
    pub warnings: Vec<String>,
}

/// What is gathered from rows.
#[derive(Default)]
struct Rows {
    count: u64,
    of: u64,
    border: u64,
    triangles: u64,
    area: f64,
    /// Of those that do not touch the border.
    areas: Vec<f64>,
}

/// Sums up the rows of surfaces that `query` keeps, whatever its order. Memory: 8 bytes per row that does not touch the
/// border.
///
/// # Errors
/// What reading returns.
pub fn summarise_surfaces(
    dir: &Path,
    manifest: &Manifest,
    query: &Query,
) -> Result<SurfaceSummary> {
    let mut table = Table::Surfaces.open(dir, manifest)?;
    let [area, triangles] = [find(&table, "area")?, find(&table, "triangles")?];
    let border = find(&table, "touches_border")?;
    let unit = table.columns()[area].unit.clone();
    let mut rows = Rows::default();
    while let Some(row) = table.next_row()? {
        rows.of += 1;
        if query.keeps(&row)? {
            rows.add(&row, [area, triangles, border])?;
        }
    }
    rows.areas.sort_by(f64::total_cmp);
    let outside = manifest.region.as_ref();
    let outside = outside.map_or(0, |region| region.outside(manifest.grid.dims));
    let place = manifest.measured();
    let voxels = (manifest.grid.dims.voxels() - outside) as f64;
    let volume = voxels * place.spacing.iter().product::<f64>();
    Ok(SurfaceSummary {
        count: rows.count,
        of: rows.of,
        surfaces: rows.count,
        surfaces_whole: rows.count - rows.border,
        surfaces_border: rows.border,
        border: Border {
            count: rows.border,
            share: (rows.count > 0).then(|| rows.border as f64 / rows.count as f64),
        },
        triangles: rows.triangles,
        area: rows.area,
        area_unit: unit,
        specific_surface: (volume > 0.0).then(|| rows.area / volume),
        specific_surface_unit: format!("1/{}", place.unit),
        specific_surface_of: match manifest.region {
            Some(_) => PorosityOf::Region,
            None => PorosityOf::Grid,
        },
        areas: Spread::of(&rows.areas),
        warnings: warning(manifest).into_iter().collect(),
    })
}

impl Rows {
    fn add(&mut self, row: &Row, [area, triangles, border]: [usize; 3]) -> Result<()> {
        let area = row.number(area)?.unwrap_or(0.0);
        self.count += 1;
        self.area += area;
        self.triangles = self.triangles.saturating_add(row.whole(triangles)?);
        match row.number(border)?.is_some_and(|v| v != 0.0) {
            true => self.border += 1,
            false => self.areas.push(area),
        }
        Ok(())
    }
}

/// What a user should know of the areas.
fn warning(manifest: &Manifest) -> Option<String> {
    manifest.region.as_ref()?;
    Some(
        "the edge of the region of interest is part of the surface where it cuts what is filled from what is not: areas \
         of surfaces at the border hold that, too"
            .to_owned(),
    )
}
