//! Cells and objects as bodies of voxels: rows of their tables beside what the surfaces say.
//!
//! Surfaces give the box around a body, the number of its voxels and all their moments, but for what
//! lies at the volume's own faces: see [`super::inside`]. The one body that is not known then is what
//! all others leave of the grid. Of several, the sums are compared.

use super::code::Code;
use super::inside::{Moments, Span};
use super::ledger::{Group, Kind};
use super::piece::Sums;
use super::report::Issues;
use crate::grid::{Extent, Placement};
use crate::manifest::Manifest;
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
const CENTROID: usize = 8;
const MIN: usize = 11;
const MAX: usize = 14;
const AXES: usize = 17;
const ELONGATION: usize = 20;
const FLATNESS: usize = 21;
const ORIENTATION: usize = 22;
const EULER: usize = 25;
pub(super) const BORDER: usize = 26;
pub(super) const TILES: usize = 27;

/// Relative error of numbers that follow from others in the row by a formula, or from whole numbers.
const ROUNDING: f64 = 1e-11;

/// A row; a field that is empty is `None`.
pub(super) type Row = [Option<f64>];

/// What is wrong with a row.
pub(super) type Wrong = Vec<String>;

/// Notes a value that is not as it should be.
pub(super) fn compare(name: &str, stated: Option<f64>, found: f64, error: f64, wrong: &mut Wrong) {
    let close = |s: f64| (s - found).abs() <= error;
    if !stated.is_some_and(close) {
        let stated = stated.map_or("nothing".to_owned(), |s| s.to_string());
        wrong.push(format!("{name} {stated}, the surface has {found}"));
    }
}

/// A row whose moments are not known by its own surfaces.
struct Open {
    kind: Kind,
    /// The table and line, for messages.
    at: String,
    row: Vec<Option<f64>>,
}

/// Checks the rows of cells and objects, and what all of them are together.
pub(super) struct Solids<'a> {
    manifest: &'a Manifest,
    /// Where the grid lies, in the tables' unit.
    grid: Placement,
    /// Of all bodies that are known.
    known: Moments,
    /// The first body that is not.
    open: Option<Open>,
    opens: u64,
    /// Voxels and voxels times centroid, as stated, of those that are not known.
    open_voxels: f64,
    open_first: [f64; 3],
    /// Rows, voxels and Euler characteristics, as stated, of cells and of objects.
    rows: [u64; 2],
    voxels: [f64; 2],
    euler: f64,
    /// The same of all surfaces, as found.
    surfaces_euler: i64,
}

impl<'a> Solids<'a> {
    pub fn new(manifest: &'a Manifest) -> Self {
        Solids {
            manifest,
            grid: manifest.measured(),
            known: Moments::default(),
            open: None,
            opens: 0,
            open_voxels: 0.0,
            open_first: [0.0; 3],
            rows: [0; 2],
            voxels: [0.0; 2],
            euler: 0.0,
            surfaces_euler: 0,
        }
    }

    /// Checks a row beside the surfaces of its body; `at` names it. `partial` says that some of its
    /// surfaces may be missing.
    pub fn check(
        &mut self,
        (kind, row, at): (Kind, &Row, &str),
        group: &Group,
        partial: bool,
        wrong: &mut Wrong,
    ) {
        let cell = kind == Kind::Cell;
        self.rows[usize::from(!cell)] += 1;
        self.voxels[usize::from(!cell)] += row[VOXELS].unwrap_or(f64::NAN);
        self.euler += row[EULER].unwrap_or(f64::NAN);
        if cell {
            self.surfaces_euler += euler_of(&group.total.sums);
        }
        self.formulas(row, wrong);
        if partial {
            return;
        }
        let inside = &group.total.sums.inside;
        let touches = row[BORDER] == Some(1.0);
        if !touches {
            let euler = euler_of(&group.total.sums) as f64 / 2.0;
            compare("euler_characteristic", row[EULER], euler, 0.0, wrong);
        }
        let span = if cell { &inside.below } else { &inside.above };
        let place = match self.grid.is_rotated() {
            true => self.place_rotated(row, (span, &inside.far[usize::from(!cell)]), touches),
            false => self.place(row, span, touches),
        };
        let Some(span) = place else {
            wrong.push("its box is not that of its surfaces".to_owned());
            return;
        };
        let dims = self.manifest.grid.dims.0;
        let [low, high] = [0, 1].map(|side| {
            [0, 1, 2].map(|a| match side {
                0 => span.lo[a] == 0,
                _ => u32::from(span.hi[a]) + 1 == dims[a],
            })
        });
        if (low.contains(&true) || high.contains(&true)) != touches {
            wrong.push("touches_border is not what its box says".to_owned());
        }
        let moments = match (low[0], high[0]) {
            (true, true) => {
                self.keep(kind, row, at);
                return;
            }
            (false, true) => inside.moments(cell, Some(dims[0])),
            (_, false) => inside.moments(cell, None),
        };
        self.known = self.known.without(&Moments::default().without(&moments));
        self.moments(row, &moments, wrong);
    }

    fn keep(&mut self, kind: Kind, row: &Row, at: &str) {
        self.opens += 1;
        let voxels = row[VOXELS].unwrap_or(f64::NAN);
        self.open_voxels += voxels;
        for a in 0..3 {
            self.open_first[a] += voxels * row[CENTROID + a].unwrap_or(f64::NAN);
        }
        let (at, row) = (at.to_owned(), row.to_vec());
        self.open.get_or_insert(Open { kind, at, row });
    }

    /// The box of voxels that the row states, if it is the surfaces' box, or reaches from there to
    /// faces of the volume.
    fn place(&self, row: &Row, own: &Span, touches: bool) -> Option<Span> {
        let end = self.manifest.grid.dims.0.map(|n| (n - 1) as u16);
        let bare = own.lo[0] > own.hi[0];
        let choices = if touches { 0..64u32 } else { 0..1 };
        choices.filter(|c| !bare || *c == 63).find_map(|c| {
            let pick = |bit: usize, own: u16, face: u16| if c >> bit & 1 == 1 { face } else { own };
            let span = Span {
                lo: std::array::from_fn(|a| pick(a, own.lo[a], 0)),
                hi: std::array::from_fn(|a| pick(3 + a, own.hi[a], end[a])),
            };
            if !self.covers(own, &span) {
                return None;
            }
            let ends = [span.lo, span.hi].map(|end| end.map(f64::from));
            let [min, max] = self.grid.box_around(ends);
            let near = |a: usize, at: usize, found: [f64; 3]| {
                row[at + a].is_some_and(|v| (v - found[a]).abs() <= self.error(found[a]))
            };
            (0..3)
                .all(|a| near(a, MIN, min) && near(a, MAX, max))
                .then_some(span)
        })
    }

    /// The same where a box of voxels is no box in the world. The outermost voxel of a body along an axis of the world
    /// is at the end of a vertex's lattice edge, or the body reaches as far as the grid does.
    fn place_rotated(
        &self,
        row: &Row,
        (own, far): (&Span, &Extent),
        touches: bool,
    ) -> Option<Span> {
        let end = self.manifest.grid.dims.0.map(|n| (n - 1) as u16);
        let [around, ends] = [
            far.world(&self.grid),
            self.grid.box_around([[0.0; 3], end.map(f64::from)]),
        ];
        let bare = own.lo[0] > own.hi[0];
        let mut span = *own;
        for side in 0..2 {
            for r in 0..3 {
                let stated = row[[MIN, MAX][side] + r]?;
                let near = |found: f64| (stated - found).abs() <= self.error(found);
                if !bare && near(around[side][r]) {
                    continue;
                }
                if !touches || !near(ends[side][r]) {
                    return None;
                }
                // where the grid ends along this axis of the world, it ends along each of its own that lead there
                for a in 0..3 {
                    let rises = self.grid.directions[a][r];
                    if rises != 0.0 && (rises > 0.0) == (side == 1) {
                        span.hi[a] = end[a];
                    } else if rises != 0.0 {
                        span.lo[a] = 0;
                    }
                }
            }
        }
        self.covers(own, &span).then_some(span)
    }

    /// Without a vertex near it, a face of the volume is reached only where it is covered from edge to edge.
    fn covers(&self, own: &Span, span: &Span) -> bool {
        let dims = self.manifest.grid.dims.0;
        let spans = |a: usize| span.lo[a] == 0 && u32::from(span.hi[a]) + 1 == dims[a];
        let moved = |a: usize| (span.lo[a], span.hi[a]) != (own.lo[a], own.hi[a]);
        (0..3).all(|a| !moved(a) || (0..3).all(|b| b == a || spans(b)))
    }

    /// The error that a coordinate may have.
    fn error(&self, found: f64) -> f64 {
        let steps = self.grid.spacing;
        ROUNDING * (found.abs() + steps.into_iter().fold(0.0, f64::max))
    }

    /// What follows from other fields of the row.
    fn formulas(&self, row: &Row, wrong: &mut Wrong) {
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
        let forward = way.contains(&largest) || way.iter().any(|v| *v > largest - 1e-9);
        // a NaN compares false
        let unit = (length - 1.0).abs() <= 1e-9;
        if !(unit && forward) {
            wrong.push(
                "orientation is not a unit vector with a positive largest component".to_owned(),
            );
        }
    }

    /// What follows from the moments of the body.
    fn moments(&self, row: &Row, moments: &Moments, wrong: &mut Wrong) {
        let count = moments.voxels as f64;
        compare("voxels", row[VOXELS], count, 0.0, wrong);
        if moments.voxels <= 0 {
            return;
        }
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
        let minor = |i: usize, j: usize| m[i][i] * m[j][j] - m[i][j] * m[j][i];
        let minors = minor(0, 1) + minor(0, 2) + minor(1, 2);
        let determinant = m[0][0] * minor(1, 2) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
        let invariants = [
            (a + b + c, trace, trace),
            (a * b + a * c + b * c, minors, trace * trace),
            (a * b * c, determinant, trace * trace * trace),
        ];
        // the invariants of the matrix are those of its eigenvalues; a NaN compares false
        let close =
            |(stated, found, scale): &(f64, f64, f64)| (stated - found).abs() <= ROUNDING * scale;
        if !invariants.iter().all(close) {
            wrong.push(format!(
                "axes {:?} are not those of its voxels",
                &row[AXES..AXES + 3]
            ));
        }
        let way: [f64; 3] = std::array::from_fn(|i| row[ORIENTATION + i].unwrap_or(f64::NAN));
        let along = |i: usize| {
            let image: f64 = (0..3).map(|j| m[i][j] * way[j]).sum();
            (image - a * way[i]).abs() <= ROUNDING * trace
        };
        if !(0..3).all(along) {
            wrong.push(format!(
                "orientation {way:?} is not the direction of the longest axis"
            ));
        }
    }

    /// Checks what all rows are together, once all have been seen.
    pub fn finish(&self, values: &mut Issues, sums: &mut Issues) {
        let totals = &self.manifest.totals;
        if self.rows != [totals.cells, totals.objects] {
            return;
        }
        if self.voxels[1] != totals.voxels_above as f64 {
            let message = format!(
                "found {}, the objects have {} voxels",
                totals.voxels_above, self.voxels[1]
            );
            sums.add(
                Code::TotalsMismatch,
                "index.json#/totals/voxels_above",
                message,
            );
        }
        if self.manifest.is_part() {
            return;
        }
        let rest = Moments::of_grid(self.manifest.grid.dims.0).without(&self.known);
        let mut wrong = Vec::new();
        match (&self.open, self.opens) {
            (Some(open), 1) => {
                self.moments(&open.row, &rest, &mut wrong);
                if !wrong.is_empty() {
                    let message = format!("{}: {}", open.kind.name(), wrong.join("; "));
                    values.add(Code::TableValue, &open.at, message);
                }
            }
            _ => self.several(&rest, values),
        }
        // the curves in which bodies meet on the volume's faces count nothing, the faces 2
        let expected = (self.surfaces_euler + 1) as f64;
        if self.euler != expected {
            let message = format!(
                "the Euler characteristics of cells and objects add up to {}, expected {expected}",
                self.euler
            );
            values.add(Code::TableValue, &self.manifest.tables.cells, message);
        }
    }

    /// Several bodies reach both faces across x: their sums are what the others leave.
    fn several(&self, rest: &Moments, values: &mut Issues) {
        let count = rest.voxels as f64;
        let mut wrong = Vec::new();
        compare("voxels", Some(self.open_voxels), count, 0.0, &mut wrong);
        if self.opens > 0 && rest.voxels > 0 {
            let mean = self.grid.world(rest.mean());
            for a in 0..3 {
                let stated = Some(self.open_first[a] / self.open_voxels);
                let name = COLUMNS[CENTROID + a].0;
                compare(
                    name,
                    stated,
                    mean[a],
                    10.0 * self.error(mean[a]),
                    &mut wrong,
                );
            }
        }
        if !wrong.is_empty() {
            let message = format!(
                "{} bodies that reach both faces across x, together: {}",
                self.opens,
                wrong.join("; ")
            );
            values.add(Code::TableValue, &self.manifest.tables.cells, message);
        }
    }
}

/// Vertices - edges + triangles.
pub(super) fn euler_of(sums: &Sums) -> i64 {
    sums.vertices as i64 - (sums.edges + sums.border) as i64 + sums.triangles as i64
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
