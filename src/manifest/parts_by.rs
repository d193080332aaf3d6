//! What cells are, where they are parts of the components of below voxels.

use crate::words::things;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Value of `version` in [`PartsBy::Split`]: rules of other versions give other cells.
pub const SPLIT_VERSION: u32 = 1;

/// What cells are, where they are parts of the components of below voxels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "lowercase")]
pub enum PartsBy {
    /// A volume of labels of the same size: the cell of a voxel below has the number of its label.
    Labels {
        /// The name of its file, without its directory.
        file: String,
        /// `crc32:` and 8 hexadecimal digits: for each row of the volume, by z and y, of each stretch of voxels with the
        /// same label its first x and the label, eight bytes each, the lowest first.
        checksum: String,
        /// Voxels below with label 0, which are one cell; its id is one above the largest label. Absent if there is none.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        unlabelled: Option<u64>,
    },
    /// Necks: see [`crate::split`].
    Split {
        /// [`SPLIT_VERSION`].
        version: u32,
        /// Cut where the radius of the opening is at most so many thousandths of that of the smaller cell.
        ratio_permille: u32,
        /// Not where the radius falls by less than this, in 1/256 of the finest voxel.
        h_256: u32,
        /// Nor where the smaller radius is less than this, in the same unit.
        min_radius_256: u32,
        /// Weights of squared steps along x, y and z.
        weights: [u32; 3],
        /// The weight of a step along the finest axis.
        unit: u32,
        /// Steps along the finest axis from which on distances are not told apart.
        reach: u8,
        /// Cells for other ratios: thousandths, and how many.
        curve: Vec<[u64; 2]>,
    },
}

/// Share of the cells by which their number may differ between two ratios, a twentieth above and below the one that was asked
/// for, without a word: with necks it hardly changes at all.
const STEEP: f64 = 0.1;

impl PartsBy {
    /// What a user should know of a set with so many cells of this kind.
    ///
    /// `in_region` if there is a region of interest, which leaves out air around the sample.
    pub(crate) fn warning(&self, cells: u64, in_region: bool) -> Option<String> {
        match self {
            PartsBy::Labels { unlabelled, .. } => unlabelled.map(|voxels| {
                format!(
                    "{} below the threshold with label 0: together one more cell, with the largest id",
                    things(voxels, "voxel")
                )
            }),
            PartsBy::Split {
                ratio_permille,
                curve,
                ..
            } => {
                let own = u64::from(*ratio_permille);
                let below = curve.iter().rev().find(|point| point[0] + 50 <= own)?;
                let above = curve.iter().find(|point| point[0] >= own + 50)?;
                let differ = above[1].saturating_sub(below[1]) as f64;
                (differ > STEEP * cells as f64).then(|| no_necks(*below, *above, in_region))
            }
        }
    }
}

/// The warning of a structure without clear necks, by two points of its curve.
fn no_necks(below: [u64; 2], above: [u64; 2], in_region: bool) -> String {
    let around = match in_region {
        true => "",
        false => {
            "; of a round sample in air, of which the air is split too, --roi cylinder leaves that out"
        }
    };
    format!(
        "the number of cells hangs on the ratio: {} at {}, {} at {}; this structure has no clear necks{around} (all ratios: \
         `alvis cells OUT --split-curve`)",
        below[1],
        below[0] as f64 / 1000.0,
        above[1],
        above[0] as f64 / 1000.0
    )
}

/// What cells are, in words.
impl fmt::Display for PartsBy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PartsBy::Labels {
                file, unlabelled, ..
            } => {
                write!(f, "by the labels of {file}")?;
                match unlabelled {
                    Some(n) => write!(f, "; {} without one", things(*n, "voxel")),
                    None => Ok(()),
                }
            }
            PartsBy::Split {
                ratio_permille,
                h_256,
                min_radius_256,
                ..
            } => {
                let [h, radius] = [h_256, min_radius_256].map(|n| f64::from(*n) / 256.0);
                write!(
                    f,
                    "split at necks: ratio {}, h {h}, min radius {radius}",
                    f64::from(*ratio_permille) / 1000.0
                )
            }
        }
    }
}
