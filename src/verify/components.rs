//! The components, cells and objects, as bodies of voxels: rows of their tables are compared with the surfaces.

use super::bodies::Body;
use super::code::Code;
use super::inside::{Inside, Moments, Span};
use super::ledger::Kind;
use super::report::Issues;
use super::voxels::CellVoxels;
use crate::grid::{Extent, Fill, Placement};
use crate::manifest::Manifest;
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Columns of the tables of cells and objects, with the power of the unit of length that each has.
pub(super) const COLUMNS: [(&str, u32); 28] = [
    ("id", 0),
    ("voxels", 0),
    ("volume", 3),
    ("mesh_volume", 3),
    ("area", 2),
    ("equivalent_diameter", 1),
    ("sphericity", 0),
    ("form_factor", 0),
    ("centroid_x", 1),
    ("centroid_y", 1),
    ("centroid_z", 1),
    ("min_x", 1),
    ("min_y", 1),
    ("min_z", 1),
    ("max_x", 1),
    ("max_y", 1),
    ("max_z", 1),
    ("axis_a", 1),
    ("axis_b", 1),
    ("axis_c", 1),
    ("elongation", 0),
    ("flatness", 0),
    ("orientation_x", 0),
    ("orientation_y", 0),
    ("orientation_z", 0),
    ("euler_characteristic", 0),
    ("touches_border", 0),
    ("tiles", 0),
];

/// The place of a column in a row.
pub(super) const VOXELS: usize = 1;
pub(super) const VOLUME: usize = 2;
pub(super) const MESH_VOLUME: usize = 3;
pub(super) const AREA: usize = 4;
const DIAMETER: usize = 5;
const SPHERICITY: usize = 6;
const FORM_FACTOR: usize = 7;
pub(super) const CENTROID: usize = 8;
const MIN: usize = 11;
const MAX: usize = 14;
const AXES: usize = 17;
const ELONGATION: usize = 20;
const FLATNESS: usize = 21;
const ORIENTATION: usize = 22;
pub(super) const EULER: usize = 25;
pub(super) const BORDER: usize = 26;
pub(super) const TILES: usize = 27;

/// Relative error of numbers that follow from others in the row by a formula, or from whole numbers.
pub(super) const ROUNDING: f64 = 1e-11;

/// Error of what follows from eigenvalues and eigenvectors, in units of the matrix's trace: they are as exact as
/// rounding allows, with some tens of operations on numbers up to the trace, however they are computed.
const EIGEN: f64 = 1e-13;

/// A row; a field that is empty is `None`.
pub(super) type Row = [Option<f64>];

/// The faults of a row.
pub(super) type Wrong = Vec<String>;

/// Notes a value that is not as it should be.
pub(super) fn compare(name: &str, stated: Option<f64>, found: f64, error: f64, wrong: &mut Wrong) {
    let close = |s: f64| (s - found).abs() <= error;
    if !stated.is_some_and(close) {
        let stated = stated.map_or("nothing".to_owned(), |s| s.to_string());
        wrong.push(format!("{name} {stated}, the surface has {found}"));
    }
}

/// Checks the rows of cells and objects, and what all of them are together.
pub(super) struct ComponentRows<'a> {
    manifest: &'a Manifest,
    /// Where the grid lies, in the tables' unit.
    pub(super) grid: Placement,
    /// Rows of cells, or of the components that cells are parts of, and of objects.
    rows: [u64; 2],
    /// Voxels of objects, as stated.
    above: f64,
}

impl<'a> ComponentRows<'a> {
    pub fn new(manifest: &'a Manifest) -> Self {
        ComponentRows {
            manifest,
            grid: manifest.measured(),
            rows: [0; 2],
            above: 0.0,
        }
    }

    /// Checks what a row says by itself.
    pub fn check_row(&mut self, kind: Kind, row: &Row, wrong: &mut Wrong) {
        self.rows[usize::from(!kind.is_below())] += 1;
        if kind == Kind::Object {
            self.above += row[VOXELS].unwrap_or(f64::NAN);
        }
        self.formulas(row, wrong);
        // what holds voxels outside of the region of interest stays, and these are all of one phase
        let fill = self.manifest.region.as_ref().map(|region| region.fill);
        let may_leave = match kind {
            Kind::Cell | Kind::Component => fill == Some(Fill::Air),
            _ => fill == Some(Fill::Material),
        };
        if let Some(dust) = &self.manifest.dust
            && !may_leave
            && row[VOXELS].is_none_or(|v| v < dust.min_voxels as f64)
            // what is all of the volume stays
            && row[VOXELS] != Some(self.manifest.grid.dims.voxels() as f64)
        {
            let least = dust.min_voxels;
            wrong.push(format!(
                "it has fewer voxels than the {least} of what was left out as dust"
            ));
        }
    }

    /// Compares a row with its body.
    pub fn check_body(&self, row: &Row, body: &Body, wrong: &mut Wrong) {
        compare("euler_characteristic", row[EULER], body.euler, 0.0, wrong);
        let voxels = CellVoxels {
            moments: body.moments,
            span: body.span,
            far: body.far,
        };
        self.check_voxels(row, &voxels, wrong);
    }

    /// Compares a row with all of its voxels.
    pub fn check_voxels(&self, row: &Row, voxels: &CellVoxels, wrong: &mut Wrong) {
        let stated = stated_box(row);
        let found = self.box_of(&voxels.span, voxels.far);
        let near = |side: usize, a: usize| {
            (stated[side][a] - found[side][a]).abs() <= self.error(found[side][a])
        };
        if !(0..3).all(|a| near(0, a) && near(1, a)) {
            wrong.push("its box is not that of its voxels".to_owned());
        }
        self.moments(row, &voxels.moments, wrong);
    }

    /// True if the row's box holds the voxels of a cell or an object along its surfaces, which may be some of all.
    pub fn holds(&self, kind: Kind, row: &Row, inside: &Inside) -> bool {
        let stated = stated_box(row);
        let found = match kind {
            Kind::Cell | Kind::Component => self.box_of(&inside.below, inside.far[0]),
            _ => self.box_of(&inside.above, inside.far[1]),
        };
        (0..3).all(|a| {
            stated[0][a] <= found[0][a] + self.error(found[0][a])
                && stated[1][a] >= found[1][a] - self.error(found[1][a])
        })
    }

    /// The box in world coordinates around voxels, given that around them in the grid, and how far they reach along
    /// the axes of the world if these are others.
    pub(super) fn box_of(&self, span: &Span, far: Extent) -> [[f64; 3]; 2] {
        match self.grid.is_rotated() {
            true => far.world(&self.grid),
            false => {
                let ends = [span.lo, span.hi];
                self.grid.box_around(ends.map(|end| end.map(f64::from)))
            }
        }
    }

    /// The error that a coordinate may have.
    pub(super) fn error(&self, found: f64) -> f64 {
        let steps = self.grid.spacing;
        ROUNDING * (found.abs() + steps.into_iter().fold(0.0, f64::max))
    }

    /// Checks the fields that follow from others of the row.
    pub(super) fn formulas(&self, row: &Row, wrong: &mut Wrong) {
        let size: f64 = self.grid.spacing.iter().product();
        let mut follows = |at: usize, found: Option<f64>| {
            let name = COLUMNS[at].0;
            match found.filter(|f| f.is_finite()) {
                Some(f) => compare(name, row[at], f, ROUNDING * f.abs(), wrong),
                None if row[at].is_some() => {
                    wrong.push(format!("{name}: found a value, expected none"));
                }
                None => {}
            }
        };
        let volume = row[VOXELS].map(|n| n * size);
        follows(VOLUME, volume);
        follows(DIAMETER, volume.map(|v| libm::cbrt(6.0 * v / PI)));
        let form = row[MESH_VOLUME]
            .zip(row[AREA])
            .map(|(v, a)| 36.0 * PI * v * v / (a * a * a));
        follows(FORM_FACTOR, form);
        follows(SPHERICITY, form.map(libm::cbrt));
        let ratio = |i: usize| row[i].zip(row[i + 1]).map(|(a, b)| b / a);
        follows(ELONGATION, ratio(AXES));
        follows(FLATNESS, ratio(AXES + 1));
        let above_0 = |at: usize| row[at].is_some_and(|v| v > 0.0);
        if !(above_0(VOXELS) && (AXES..AXES + 3).all(above_0)) {
            wrong.push("voxels and axes must be above 0".to_owned());
        }
        if !(row[AXES] >= row[AXES + 1] && row[AXES + 1] >= row[AXES + 2]) {
            wrong.push("axes are not in falling order".to_owned());
        }
        for a in 0..3 {
            let slack = self.error(row[CENTROID + a].unwrap_or(0.0));
            let between = row[CENTROID + a].is_some_and(|c| {
                row[MIN + a].is_some_and(|m| m <= c + slack)
                    && row[MAX + a].is_some_and(|m| m >= c - slack)
            });
            if !between {
                wrong.push("the centroid lies outside the box".to_owned());
            }
        }
        let way: [f64; 3] = std::array::from_fn(|a| row[ORIENTATION + a].unwrap_or(f64::NAN));
        let length = way.iter().map(|v| v * v).sum::<f64>();
        let largest = way.iter().fold(0f64, |l, v| l.max(v.abs()));
        let forward = way.contains(&largest) || way.iter().any(|v| *v > largest - ROUNDING);
        // a NaN compares false
        let unit = (length - 1.0).abs() <= 10.0 * EIGEN;
        if !(unit && forward) {
            wrong.push(
                "orientation is not a unit vector with a positive largest component".to_owned(),
            );
        }
    }

    /// Checks the fields that follow from the moments of the body.
    fn moments(&self, row: &Row, moments: &Moments, wrong: &mut Wrong) {
        let count = moments.voxels as f64;
        compare("voxels", row[VOXELS], count, 0.0, wrong);
        let place = &self.grid;
        let mean = place.world(moments.mean());
        for a in 0..3 {
            let at = CENTROID + a;
            compare(COLUMNS[at].0, row[at], mean[a], self.error(mean[a]), wrong);
        }
        let m = to_world(place, &moments.covariance());
        let squares: [f64; 3] =
            std::array::from_fn(|a| row[AXES + a].map_or(f64::NAN, |v| v * v / 5.0));
        let [a, b, c] = squares;
        let trace = m[0][0] + m[1][1] + m[2][2];
        let way: [f64; 3] = std::array::from_fn(|i| row[ORIENTATION + i].unwrap_or(f64::NAN));
        let shorter = across(&m, way);
        // the longest axis is that of its direction, see below; a NaN compares false
        let close = |stated: f64, found: f64| (stated - found).abs() <= EIGEN * trace;
        let sum = close(a + shorter[0] + shorter[1], trace);
        if !(sum && close(b, shorter[0]) && close(c, shorter[1])) {
            wrong.push(format!(
                "axes {:?} are not those of its voxels",
                &row[AXES..AXES + 3]
            ));
        }
        let along = |i: usize| {
            let image: f64 = (0..3).map(|j| m[i][j] * way[j]).sum();
            (image - a * way[i]).abs() <= EIGEN * trace
        };
        if !(0..3).all(along) {
            wrong.push(format!(
                "orientation {way:?} is not the direction of the longest axis"
            ));
        }
    }

    /// Checks what all rows are together, once all have been seen.
    pub fn finish(&self, sums: &mut Issues) {
        let totals = &self.manifest.totals;
        let below = match self.manifest.cells {
            Some(_) => totals.components,
            None => totals.cells,
        };
        if self.rows == [below, totals.objects] && self.above != totals.voxels_above as f64 {
            let message = format!(
                "found {}, the objects have {} voxels",
                totals.voxels_above, self.above
            );
            let at = "index.json#/totals/voxels_above";
            sums.add(Code::TotalsMismatch, at, message);
        }
    }
}

/// The lower and upper ends of the box that a row states.
pub(super) fn stated_box(row: &Row) -> [[f64; 3]; 2] {
    [MIN, MAX].map(|at| std::array::from_fn(|a| row[at + a].unwrap_or(f64::NAN)))
}

/// The eigenvalues of a symmetric matrix across its eigenvector `way`, of length 1: the larger one, then the other.
/// Those of two axes that are nearly as long are as exact as others, which the roots of a polynomial are not.
fn across(m: &[[f64; 3]; 3], way: [f64; 3]) -> [f64; 2] {
    let by_size = |a: &usize, b: &usize| way[*a].abs().total_cmp(&way[*b].abs());
    let least = (0..3).min_by(by_size).unwrap_or(0);
    let mut axis = DVec3::ZERO;
    axis[least] = 1.0;
    let way = DVec3::from(way);
    let u = way.cross(axis).normalize();
    let w = way.cross(u);
    let m = DMat3::from_cols_array_2d(m);
    let (p, q, r) = (u.dot(m * u), w.dot(m * w), u.dot(m * w));
    let (half, apart) = ((p + q) / 2.0, (p - q) / 2.0);
    let root = (apart * apart + r * r).sqrt();
    [half + root, half - root]
}

/// A matrix of second moments in voxels, turned to world coordinates.
fn to_world(place: &Placement, m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let step = |i: usize, r: usize| place.directions[i][r] * place.spacing[i];
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let mut sum = 0.0;
            for i in 0..3 {
                for j in 0..3 {
                    sum += step(i, r) * m[i][j] * step(j, c);
                }
            }
            sum
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::COMPONENT_COLUMNS;

    /// The verifier has a list of its own, so that a column that the producer forgets is missed.
    #[test]
    fn columns_are_those_of_the_producer() {
        let theirs = COMPONENT_COLUMNS.iter().map(|c| (c.name, c.power));
        let all: Vec<_> = std::iter::once(("id", 0)).chain(theirs).collect();
        assert_eq!(COLUMNS[..], all);
    }
}
