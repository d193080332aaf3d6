//! The voxel grid: its size, its place in space and the macrocubes that cover it.
//!
//! Voxel (i, j, k) is a sample at integer coordinates, x fastest. A *cube* (i, j, k) has the 8
//! voxels (i..i+1, j..j+1, k..k+1) as corners. A *macrocube* is a block of cubes; its file is a tile.

mod dtype;
mod extent;
mod filter;
pub(crate) mod length;
mod provenance;
mod region;

pub(crate) use dtype::with_voxel_type;
pub use dtype::{Dtype, Endian, Slope, Voxel};
pub use extent::Extent;
pub use filter::{
    Filter, Filtered, MAX_FILTERS, Sigma, check_filters, filtered_dims, filtered_dtype,
    filters_text,
};
pub use provenance::{Frame, Origin, Part, Provenance};
pub use region::{Cylinder, Fill, Region, Shape};

use crate::error::{Error, Result};
pub(crate) use crate::grid::length::Length;
use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Vertices lie on a lattice of this many steps per voxel.
pub const LATTICE: u32 = 256;

/// A coordinate in lattice steps as the `f32` of files, in voxels: exact.
pub fn coordinate(steps: i32) -> f32 {
    steps as f32 / LATTICE as f32
}

/// The most voxels per axis: 65,536 x 256 lattice steps still fit an `f32` exactly.
pub const MAX_DIM: u32 = 65_536;

/// The number of voxels per axis, x first. Every axis has 2 to [`MAX_DIM`] voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Dims(pub [u32; 3]);

impl Dims {
    /// Checks the range of every axis.
    ///
    /// # Errors
    /// [`Error::Usage`] if an axis has fewer than 2 or more than [`MAX_DIM`] voxels.
    pub fn new(dims: [u64; 3]) -> Result<Self> {
        if dims.iter().all(|&n| (2..=u64::from(MAX_DIM)).contains(&n)) {
            Ok(Dims(dims.map(|n| n as u32)))
        } else {
            Err(Error::usage(
                "dims",
                format!("{} x {} x {}", dims[0], dims[1], dims[2]),
                format!("2 to {MAX_DIM} voxels along each axis"),
            ))
        }
    }

    /// Number of voxels; at most 2^48.
    pub fn voxels(self) -> u64 {
        self.0.iter().map(|&n| u64::from(n)).product()
    }

    /// The x by y voxels of one slice.
    pub fn slice_voxels(self) -> u64 {
        u64::from(self.0[0]) * u64::from(self.0[1])
    }

    /// The linear index of voxel (i, j, k), x fastest.
    pub fn linear(self, [i, j, k]: [u32; 3]) -> u64 {
        let [nx, ny, _] = self.0.map(u64::from);
        u64::from(i) + nx * (u64::from(j) + ny * u64::from(k))
    }
}

impl std::fmt::Display for Dims {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {} x {}", self.0[0], self.0[1], self.0[2])
    }
}

/// The unit of spacing and origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Unit {
    /// No physical size is known: one voxel step of spacing 1 is one glTF unit.
    #[default]
    #[serde(rename = "voxel")]
    Voxel,
    /// Metre.
    #[serde(rename = "m")]
    Metre,
    /// Centimetre.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetre.
    #[serde(rename = "mm")]
    Millimetre,
    /// Micrometre.
    #[serde(rename = "um")]
    Micrometre,
    /// Nanometre.
    #[serde(rename = "nm")]
    Nanometre,
}

impl Unit {
    /// Metres per unit; 1 for [`Unit::Voxel`], whose glTF unit is the voxel.
    pub fn metres(self) -> f64 {
        match self {
            Unit::Voxel | Unit::Metre => 1.0,
            Unit::Centimetre => 1e-2,
            Unit::Millimetre => 1e-3,
            Unit::Micrometre => 1e-6,
            Unit::Nanometre => 1e-9,
        }
    }

    /// The short name itself, if a unit has it.
    pub(crate) fn short_name(text: &str) -> Option<&'static str> {
        let text = serde::de::value::StrDeserializer::<serde::de::value::Error>::new(text);
        Unit::deserialize(text).ok().map(Unit::name)
    }

    /// The short name, as in the manifest and in table headers.
    pub fn name(self) -> &'static str {
        match self {
            Unit::Voxel => "voxel",
            Unit::Metre => "m",
            Unit::Centimetre => "cm",
            Unit::Millimetre => "mm",
            Unit::Micrometre => "um",
            Unit::Nanometre => "nm",
        }
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Unit {
    type Err = Error;

    /// Accepts the short names, the English words, and the micro sign.
    fn from_str(text: &str) -> Result<Self> {
        match text.trim().trim_matches('"').to_ascii_lowercase().as_str() {
            "voxel" | "voxels" | "px" | "pixel" | "pixels" => Ok(Unit::Voxel),
            "m" | "metre" | "meter" | "metres" | "meters" => Ok(Unit::Metre),
            "cm" | "centimetre" | "centimeter" | "centimetres" | "centimeters" => {
                Ok(Unit::Centimetre)
            }
            "mm" | "millimetre" | "millimeter" | "millimetres" | "millimeters" => {
                Ok(Unit::Millimetre)
            }
            "um" | "µm" | "μm" | "micron" | "microns" | "micrometre" | "micrometer"
            | "micrometres" | "micrometers" => Ok(Unit::Micrometre),
            "nm" | "nanometre" | "nanometer" | "nanometres" | "nanometers" => Ok(Unit::Nanometre),
            _ => Err(Error::usage("unit", text, "voxel, m, cm, mm, um or nm")),
        }
    }
}

/// Where the grid lies: spacing, unit, origin and directions of its axes.
///
/// World position of voxel (i, j, k) = origin + directions · (spacing * (i, j, k)), Z up, in `unit`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// Size of one voxel step per axis, in `unit`; finite and above 0.
    pub spacing: [f64; 3],
    /// Unit of spacing and origin.
    pub unit: Unit,
    /// World position of voxel (0, 0, 0), in `unit`.
    pub origin: [f64; 3],
    /// Unit vectors along the x, y and z axis of the grid, in world coordinates. A determinant of
    /// -1 is a mirrored grid and is kept as it is.
    pub directions: [[f64; 3]; 3],
}

impl Default for Placement {
    fn default() -> Self {
        Placement {
            spacing: [1.0; 3],
            unit: Unit::Voxel,
            origin: [0.0; 3],
            directions: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        }
    }
}

impl Placement {
    /// Checks that spacing is positive and finite and everything else finite.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the field.
    pub fn check(&self) -> Result<()> {
        if !self.spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err(Error::usage(
                "spacing",
                format!("{:?}", self.spacing),
                "three finite numbers above 0",
            ));
        }
        let finite = self
            .origin
            .iter()
            .chain(self.directions.as_flattened())
            .all(|v| v.is_finite());
        if !finite {
            return Err(Error::usage(
                "origin",
                format!("{:?}, directions {:?}", self.origin, self.directions),
                "finite numbers",
            ));
        }
        Ok(())
    }

    /// The cosines between the axes x and y, x and z, y and z if these are not at right angles but for rounding.
    /// Measures hold for axes at right angles only.
    pub fn shear(&self) -> Option<[f64; 3]> {
        let axes = self.directions.map(DVec3::from);
        let cosines = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| axes[a].dot(axes[b]));
        cosines
            .iter()
            .any(|c| c.abs() > MAX_SHEAR)
            .then_some(cosines)
    }

    /// World position of a point in voxel coordinates, in `unit`, Z up.
    pub fn world(&self, voxel: [f64; 3]) -> [f64; 3] {
        (DVec3::from(self.origin) + DVec3::from(self.step(voxel))).into()
    }

    /// The way from voxel (0, 0, 0) to a point in voxel coordinates, in `unit`, Z up. Along each axis of the grid
    /// every component rises, falls or stays, whatever is rounded.
    pub fn step(&self, voxel: [f64; 3]) -> [f64; 3] {
        let axes = DMat3::from_cols_array_2d(&self.directions);
        (axes * (DVec3::from(self.spacing) * DVec3::from(voxel))).into()
    }

    /// True if an axis of the world runs along two axes of the grid or more: a box of voxels is then no box in the
    /// world.
    pub fn is_rotated(&self) -> bool {
        (0..3).any(|r| self.directions.iter().filter(|axis| axis[r] != 0.0).count() > 1)
    }

    /// The box in world coordinates, lower and upper ends, around a box of voxels: of its eight corners.
    pub fn box_around(&self, ends: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        let mut out = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in 0..8usize {
            let p = self.world(std::array::from_fn(|a| ends[corner >> a & 1][a]));
            for r in 0..3 {
                out[0][r] = out[0][r].min(p[r]);
                out[1][r] = out[1][r].max(p[r]);
            }
        }
        out
    }

    /// The matrix from voxel coordinates to glTF's metres with Y up, column-major as glTF has it:
    /// world (x, y, z) becomes (x, z, -y).
    pub fn gltf_matrix(&self) -> [f64; 16] {
        let axes =
            DMat3::from_cols_array_2d(&self.directions) * DMat3::from_diagonal(self.spacing.into());
        let z_up_to_y_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let scale = self.unit.metres();
        let linear = z_up_to_y_up * axes * scale;
        let shift = z_up_to_y_up * DVec3::from(self.origin) * scale;
        let mut out = DMat4::from_mat3(linear);
        out.w_axis = shift.extend(1.0);
        // adding 0 turns -0 into 0, which reads better in JSON
        out.to_cols_array().map(|v| v + 0.0)
    }

    /// The same place with its lengths in another unit.
    ///
    /// # Errors
    /// [`Error::Usage`] if one of the two units is [`Unit::Voxel`], which is no length, and the other is one.
    pub fn in_unit(&self, unit: Unit) -> Result<Self> {
        if (unit == Unit::Voxel) != (self.unit == Unit::Voxel) {
            return Err(Error::usage(
                "--table-unit",
                format!("{unit} for a volume in {}", self.unit),
                "a unit of length, for a volume whose voxels have a size: give --spacing and --unit",
            ));
        }
        let convert = |v: f64| Length::from(self.unit).convert(v, unit);
        let place = Placement {
            spacing: self.spacing.map(convert),
            unit,
            origin: self.origin.map(convert),
            ..*self
        };
        place.check()?;
        Ok(place)
    }

    /// The placement of the part of the grid that starts at voxel `start`.
    pub fn shifted(&self, start: [u32; 3]) -> Self {
        Placement {
            origin: self.world(start.map(f64::from)),
            ..*self
        }
    }
}

/// The most that the cosine between two axes may differ from 0: rounding in single precision stays below.
const MAX_SHEAR: f64 = 1e-4;

/// Which voxels an ambiguous face joins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ambiguous {
    /// The two above corners are separated: objects are 6-connected, cells 18-connected.
    #[default]
    Separate,
    /// The two above corners are joined: objects are 18-connected, cells 6-connected.
    Join,
}

/// A box of voxels to convert instead of the whole volume: half-open voxel ranges.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Crop {
    /// Voxels along x.
    pub x: Range<u32>,
    /// Voxels along y.
    pub y: Range<u32>,
    /// Voxels along z.
    pub z: Range<u32>,
}

impl Crop {
    /// The whole volume.
    pub fn whole(dims: Dims) -> Self {
        let [x, y, z] = dims.0.map(|n| 0..n);
        Crop { x, y, z }
    }

    /// First voxel.
    pub fn start(&self) -> [u32; 3] {
        [self.x.start, self.y.start, self.z.start]
    }

    /// Size of the box.
    ///
    /// # Errors
    /// [`Error::Usage`] if the box leaves `dims` or has fewer than 2 voxels along an axis.
    pub fn dims_in(&self, dims: Dims) -> Result<Dims> {
        let ranges = [&self.x, &self.y, &self.z];
        let fits = ranges
            .iter()
            .zip(dims.0)
            .all(|(r, n)| r.end <= n && r.start.saturating_add(2) <= r.end);
        if !fits {
            return Err(Error::usage(
                "--crop",
                self.to_string(),
                format!("at least 2 voxels per axis inside {dims}"),
            ));
        }
        Ok(Dims(ranges.map(|r| r.end - r.start)))
    }
}

/// As `--crop` takes it.
impl std::fmt::Display for Crop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Crop { x, y, z } = self;
        write!(
            f,
            "{}:{},{}:{},{}:{}",
            x.start, x.end, y.start, y.end, z.start, z.end
        )
    }
}

/// How macrocubes cover a grid. Tile (tx, ty, tz) has the cubes tx*mx..(tx+1)*mx along x, and so on,
/// cut at the grid's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tiling {
    /// The grid.
    pub dims: Dims,
    /// Cubes per macrocube and axis, as asked for; at least 1.
    pub macrocube: [u32; 3],
}

impl Tiling {
    /// Number of macrocubes per axis.
    pub fn tiles(self) -> [u32; 3] {
        std::array::from_fn(|a| (self.dims.0[a] - 1).div_ceil(self.macrocube[a]))
    }

    /// The cubes of tile index `t` along `axis`.
    pub fn cubes(self, axis: usize, t: u32) -> Range<u32> {
        let m = u64::from(self.macrocube[axis]);
        let end = u64::from(self.dims.0[axis] - 1);
        let at = |t: u64| (t * m).min(end) as u32;
        at(u64::from(t))..at(u64::from(t) + 1)
    }

    /// Lowest voxel of a macrocube.
    pub fn lowest(self, grid: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| self.cubes(a, grid[a]).start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dims_refuse_what_the_lattice_cannot_hold() {
        assert!(Dims::new([2, 2, 2]).is_ok());
        assert!(Dims::new([65_536, 2, 2]).is_ok());
        for bad in [
            [1, 2, 2],
            [0, 0, 0],
            [65_537, 2, 2],
            [u64::MAX, u64::MAX, u64::MAX],
        ] {
            assert!(Dims::new(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn tiles_cover_every_cube_once() {
        for (n, m) in [
            (2, 1),
            (2, 64),
            (65, 64),
            (66, 64),
            (129, 64),
            (10, 3),
            (5, u32::MAX),
        ] {
            let tiling = Tiling {
                dims: Dims([n, 2, 2]),
                macrocube: [m, 1, 1],
            };
            let mut next = 0;
            for t in 0..tiling.tiles()[0] {
                let cubes = tiling.cubes(0, t);
                assert_eq!(cubes.start, next);
                assert!(cubes.end > cubes.start);
                next = cubes.end;
            }
            assert_eq!(next, n - 1);
        }
    }

    #[test]
    fn gltf_matrix_turns_z_up_to_y_up_in_metres() {
        let place = Placement {
            spacing: [1.0, 2.0, 3.0],
            unit: Unit::Millimetre,
            origin: [10.0, 20.0, 30.0],
            ..Placement::default()
        };
        let m = DMat4::from_cols_array(&place.gltf_matrix());
        let p = m.transform_point3(DVec3::new(1.0, 1.0, 1.0));
        assert!(
            p.abs_diff_eq(DVec3::new(0.011, 0.033, -0.022), 1e-12),
            "{p}"
        );
    }
}
