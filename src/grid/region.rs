//! The region of interest of a volume: the part that counts, and what the rest is taken for.

use super::Dims;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;

/// What voxels outside of a region are taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fill {
    /// Above: pores that reach the edge of the region end there.
    #[default]
    Material,
    /// Below: what is outside is one cell with all that it touches.
    Air,
}

impl fmt::Display for Fill {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fill::Material => "material",
            Fill::Air => "air",
        })
    }
}

/// A cylinder along z through all slices of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cylinder {
    /// x and y of its axis, in voxels of the filtered volume before it is cropped; a voxel's middle has its numbers.
    pub centre: [f64; 2],
    /// In voxels; a voxel is inside if its middle is at most as far from the axis.
    pub radius: f64,
}

impl Cylinder {
    /// True if the middle of a voxel of these x and y is inside.
    pub fn holds(&self, x: u32, y: u32) -> bool {
        let [dx, dy] = [f64::from(x) - self.centre[0], f64::from(y) - self.centre[1]];
        dx * dx + dy * dy <= self.radius * self.radius
    }

    /// Refuses one that is none, or that holds no voxel of such a volume.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self, dims: Dims) -> Result<()> {
        let Cylinder { centre, radius } = self;
        let numbers = centre.iter().all(|c| c.is_finite()) && radius.is_finite();
        let [nx, ny, _] = dims.0;
        if numbers && *radius > 0.0 && (0..ny).any(|y| (0..nx).any(|x| self.holds(x, y))) {
            return Ok(());
        }
        let expected = format!(
            "x, y and a radius above 0 in voxels, of a cylinder that meets the volume of {dims} voxels"
        );
        Err(Error::usage("--roi", self.to_string(), expected))
    }
}

impl fmt::Display for Cylinder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.centre;
        write!(f, "cylinder:{x},{y},{}", self.radius)
    }
}

/// The form of a region.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "lowercase")]
pub enum Shape {
    /// A cylinder along z.
    Cylinder(Cylinder),
    /// The voxels of another volume of the same size that are not 0, nor NaN.
    Mask {
        /// The name of its file, without its directory.
        file: String,
        /// `crc32:` and 8 hexadecimal digits, of which voxels are inside: for each row, by z and y, a bit for each
        /// voxel from x = 0 on, the lowest bit of a byte first, padded to whole words of 64 bits with bits that are 0.
        checksum: String,
    },
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Shape::Cylinder(cylinder) => cylinder.fmt(f),
            Shape::Mask { file, .. } => write!(f, "mask:{file}"),
        }
    }
}

/// A region of interest, as the index of a tile set states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Its form.
    #[serde(flatten)]
    pub shape: Shape,
    /// What voxels outside are taken for.
    pub fill: Fill,
    /// Their sample.
    pub fill_value: f64,
    /// Voxels of the grid that are inside.
    pub voxels: u64,
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} with {} outside", self.shape, self.fill)
    }
}

impl Region {
    /// Voxels of a grid of this size that are outside.
    pub fn outside(&self, dims: Dims) -> u64 {
        dims.voxels().saturating_sub(self.voxels)
    }
}
