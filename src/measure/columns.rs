//! What the tables say of each cell, object and surface: a row for each column, in the order of the files.
//!
//! The CSV files, the extras of tiles and their property tables are made from these lists. The verifier keeps lists of
//! its own, so that a fault here is not hidden there.

use crate::measure::{Measures, SurfaceRecord};

/// A value of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Field {
    /// A count or an id.
    Count(u64),
    /// A whole number that may be below zero.
    Signed(i64),
    /// True or false, written as 1 or 0.
    Flag(bool),
    /// Any number; not finite where it has no meaning.
    Real(f64),
}

impl Field {
    /// The value, if it has a meaning.
    pub fn meaningful(self) -> Option<Field> {
        match self {
            Field::Real(v) if !v.is_finite() => None,
            field => Some(field),
        }
    }
}

/// Where the values of a column come from, and so their kind.
#[derive(Debug, Clone, Copy)]
pub enum Get<T> {
    /// See [`Field::Count`].
    Count(fn(&T) -> u64),
    /// See [`Field::Signed`].
    Signed(fn(&T) -> Option<i64>),
    /// See [`Field::Flag`].
    Flag(fn(&T) -> bool),
    /// See [`Field::Real`].
    Real(fn(&T) -> f64),
}

impl<T> Get<T> {
    /// The value of a row.
    pub fn of(&self, row: &T) -> Field {
        match self {
            Get::Count(get) => Field::Count(get(row)),
            Get::Signed(get) => get(row).map_or(Field::Real(f64::NAN), Field::Signed),
            Get::Flag(get) => Field::Flag(get(row)),
            Get::Real(get) => Field::Real(get(row)),
        }
    }
}

/// A column of a table.
#[derive(Debug, Clone, Copy)]
pub struct Column<T> {
    /// Its name, in the tables' headers and in tiles.
    pub name: &'static str,
    /// The power of the unit of length that its values have: 3 for a volume.
    pub power: u32,
    /// Tiles carry it, too.
    pub in_tiles: bool,
    /// Its values.
    pub get: Get<T>,
}

const fn in_table<T>(name: &'static str, power: u32, get: Get<T>) -> Column<T> {
    Column {
        name,
        power,
        in_tiles: false,
        get,
    }
}

const fn in_tiles<T>(name: &'static str, power: u32, get: Get<T>) -> Column<T> {
    Column {
        name,
        power,
        in_tiles: true,
        get,
    }
}

fn or_nan(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// Columns of `cells.csv` and `objects.csv` behind the id.
pub const COMPONENT_COLUMNS: [Column<Measures>; 27] = [
    in_tiles("voxels", 0, Get::Count(|m| m.voxels)),
    in_tiles("volume", 3, Get::Real(|m| m.volume)),
    in_tiles("mesh_volume", 3, Get::Real(|m| or_nan(m.mesh_volume))),
    in_tiles("area", 2, Get::Real(|m| m.area)),
    in_tiles(
        "equivalent_diameter",
        1,
        Get::Real(|m| m.equivalent_diameter),
    ),
    in_tiles("sphericity", 0, Get::Real(|m| or_nan(m.sphericity))),
    in_tiles("form_factor", 0, Get::Real(|m| or_nan(m.form_factor))),
    in_table("centroid_x", 1, Get::Real(|m| m.centroid[0])),
    in_table("centroid_y", 1, Get::Real(|m| m.centroid[1])),
    in_table("centroid_z", 1, Get::Real(|m| m.centroid[2])),
    in_table("min_x", 1, Get::Real(|m| m.min[0])),
    in_table("min_y", 1, Get::Real(|m| m.min[1])),
    in_table("min_z", 1, Get::Real(|m| m.min[2])),
    in_table("max_x", 1, Get::Real(|m| m.max[0])),
    in_table("max_y", 1, Get::Real(|m| m.max[1])),
    in_table("max_z", 1, Get::Real(|m| m.max[2])),
    in_table("axis_a", 1, Get::Real(|m| m.axes[0])),
    in_table("axis_b", 1, Get::Real(|m| m.axes[1])),
    in_table("axis_c", 1, Get::Real(|m| m.axes[2])),
    in_tiles("elongation", 0, Get::Real(|m| m.elongation)),
    in_tiles("flatness", 0, Get::Real(|m| m.flatness)),
    in_table("orientation_x", 0, Get::Real(|m| m.orientation[0])),
    in_table("orientation_y", 0, Get::Real(|m| m.orientation[1])),
    in_table("orientation_z", 0, Get::Real(|m| m.orientation[2])),
    in_tiles(
        "euler_characteristic",
        0,
        Get::Signed(|m| m.euler_characteristic),
    ),
    in_tiles("touches_border", 0, Get::Flag(|m| m.touches_border)),
    in_table("tiles", 0, Get::Count(|m| m.tiles)),
];

/// What more is known of a cell where cells are parts of components, or walls were asked for.
#[derive(Debug, Clone, Copy, Default)]
pub struct MoreOfCell {
    /// The component; `None` for a cell with voxels in several.
    pub component: Option<u64>,
    /// Cells that it has an opening or a large enough wall to.
    pub neighbours: u64,
    /// Other cells of its component that it touches: openings.
    pub necks: u64,
    /// Radius of the widest of these, if that was looked for.
    pub largest_neck: Option<f64>,
    /// Median thickness of its walls by area.
    pub wall_thickness: Option<f64>,
}

/// Columns of `cells.csv` behind the others: those of cells that are `parts` of components, and those of `walls`.
pub fn more_columns(parts: bool, walls: bool) -> Vec<Column<MoreOfCell>> {
    let all: [(bool, Column<MoreOfCell>); 5] = [
        (
            parts,
            in_table(
                "component",
                0,
                Get::Signed(|c| c.component.map(|id| id as i64)),
            ),
        ),
        (
            walls,
            in_table("neighbours", 0, Get::Count(|c| c.neighbours)),
        ),
        (parts, in_table("necks", 0, Get::Count(|c| c.necks))),
        (
            parts,
            in_table("largest_neck", 1, Get::Real(|c| or_nan(c.largest_neck))),
        ),
        (
            walls,
            in_table("wall_thickness", 1, Get::Real(|c| or_nan(c.wall_thickness))),
        ),
    ];
    let kept = all.into_iter().filter(|(is_there, _)| *is_there);
    kept.map(|(_, column)| column).collect()
}

/// Where two cells of one component touch, in the unit of length.
#[derive(Debug, Clone, Copy)]
pub struct NeckRow {
    /// The cells.
    pub cells: [u64; 2],
    /// Radius of the narrowest place on the widest way between them, if that was looked for.
    pub radius: Option<f64>,
    /// That over the radius of the smaller cell.
    pub ratio: Option<f64>,
    /// The narrowest place, or the middle of the faces that they share; none where they touch at edges of voxels alone.
    pub place: Option<[f64; 3]>,
    /// The area of the opening.
    pub area: f64,
}

/// Columns of `necks.csv`.
pub const NECK_COLUMNS: [Column<NeckRow>; 8] = [
    in_table("cell_a", 0, Get::Count(|n| n.cells[0])),
    in_table("cell_b", 0, Get::Count(|n| n.cells[1])),
    in_table("neck_radius", 1, Get::Real(|n| or_nan(n.radius))),
    in_table("ratio", 0, Get::Real(|n| or_nan(n.ratio))),
    in_table("x", 1, Get::Real(|n| or_nan(n.place.map(|p| p[0])))),
    in_table("y", 1, Get::Real(|n| or_nan(n.place.map(|p| p[1])))),
    in_table("z", 1, Get::Real(|n| or_nan(n.place.map(|p| p[2])))),
    in_table("neck_area", 2, Get::Real(|n| n.area)),
];

/// The wall between two cells, in the unit of length.
#[derive(Debug, Clone, Copy)]
pub struct WallRow {
    /// The cells.
    pub cells: [u64; 2],
    /// Area of what its chords stand for.
    pub area: f64,
    /// Median of its thickness at its chords by the area that they stand for.
    pub thickness: f64,
    /// Chords.
    pub chords: u64,
    /// More than half of its area is thinner than a scan resolves.
    pub thin: bool,
    /// It makes its cells neighbours.
    pub neighbour: bool,
}

/// Columns of `walls.csv`.
pub const WALL_COLUMNS: [Column<WallRow>; 7] = [
    in_table("cell_a", 0, Get::Count(|w| w.cells[0])),
    in_table("cell_b", 0, Get::Count(|w| w.cells[1])),
    in_table("wall_area", 2, Get::Real(|w| w.area)),
    in_table("wall_thickness", 1, Get::Real(|w| w.thickness)),
    in_table("chords", 0, Get::Count(|w| w.chords)),
    in_table("thin", 0, Get::Flag(|w| w.thin)),
    in_table("neighbour", 0, Get::Flag(|w| w.neighbour)),
];

/// A surface, and its area in the square of the unit.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceRow {
    /// Its sums.
    pub record: SurfaceRecord,
    /// Area of its triangles.
    pub area: f64,
    /// Vertices less edges plus triangles; `None` where other cells of the component cut it off.
    pub euler_characteristic: Option<i64>,
}

/// Columns of `surfaces.csv` behind the id.
pub const SURFACE_COLUMNS: [Column<SurfaceRow>; 9] = [
    in_table("cell", 0, Get::Count(|s| s.record.cell)),
    in_table("object", 0, Get::Count(|s| s.record.object)),
    in_table("triangles", 0, Get::Count(|s| s.record.mesh.triangles)),
    in_table("vertices", 0, Get::Count(|s| s.record.mesh.vertices)),
    in_table("area", 2, Get::Real(|s| s.area)),
    in_table(
        "euler_characteristic",
        0,
        Get::Signed(|s| s.euler_characteristic),
    ),
    in_table(
        "border_edges",
        0,
        Get::Count(|s| s.record.mesh.border_edges),
    ),
    in_table("touches_border", 0, Get::Count(|s| s.record.touches_border)),
    in_table("tiles", 0, Get::Count(|s| s.record.tiles)),
];

/// How many columns tiles carry.
pub const CARRIED: usize = {
    let (mut i, mut count) = (0, 0);
    while i < COMPONENT_COLUMNS.len() {
        count += COMPONENT_COLUMNS[i].in_tiles as usize;
        i += 1;
    }
    count
};

/// The columns that tiles carry.
pub const CARRIED_COLUMNS: [Column<Measures>; CARRIED] = {
    let mut all = [COMPONENT_COLUMNS[0]; CARRIED];
    let (mut i, mut count) = (0, 0);
    while i < COMPONENT_COLUMNS.len() {
        if COMPONENT_COLUMNS[i].in_tiles {
            all[count] = COMPONENT_COLUMNS[i];
            count += 1;
        }
        i += 1;
    }
    all
};

/// Names of the measures that a piece carries, as in the table of cells.
pub const MEASURES: [&str; CARRIED] = {
    let mut names = [""; CARRIED];
    let mut i = 0;
    while i < CARRIED {
        names[i] = CARRIED_COLUMNS[i].name;
        i += 1;
    }
    names
};
