//! Porosity slice by slice, and of boxes.

use super::blocks::Blocks;
use super::boxes::{BoxPorosity, Content, porosity_of_boxes};
use super::pass::Told;
use crate::error::Result;
use crate::grid::{Cylinder, Dims, Fill, Shape};
use crate::manifest::Manifest;
use crate::volume::{RegionVoxels, row_words};
use serde::Serialize;

/// Porosity slice by slice, across each axis of the grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Profile {
    /// Unit of places along the axes.
    pub unit: &'static str,
    /// Slices across x, by rising x.
    pub x: AxisProfile,
    /// Slices across y.
    pub y: AxisProfile,
    /// Slices across z.
    pub z: AxisProfile,
}

/// Slices across one axis, the first of which is voxel 0 of the grid that the tiles cover.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisProfile {
    /// From one slice to the next.
    pub step: f64,
    /// Share of pores, 0 to 1; null where no voxel of the slice counts.
    pub porosity: Vec<Option<f64>>,
    /// Voxels that are pores.
    pub pores: Vec<u64>,
    /// Voxels that count: those of the region of interest, without air around the sample if that is left out.
    pub voxels: Vec<u64>,
    /// Mean of the slices' porosities.
    pub mean: Option<f64>,
    /// Their standard deviation, by their number.
    pub sd: Option<f64>,
}

/// Why slices and boxes of a set cannot be told, if so.
pub fn refusal(manifest: &Manifest) -> Option<String> {
    if manifest.is_part() {
        return Some(
            "porosity by slices and boxes: a part of a tile set lacks surfaces; the whole set tells it".to_owned(),
        );
    }
    let region = manifest.region.as_ref()?;
    let is_mask = matches!(region.shape, Shape::Mask { .. });
    (is_mask && region.outside(manifest.grid.dims) > 0).then(|| {
        "porosity by slices and boxes: the tiles do not hold which voxels of a slice the mask has inside; a region that \
         is a cylinder or a crop tells it"
            .to_owned()
    })
}

/// What was measured.
pub struct Measured {
    pub profile: Profile,
    pub boxes: Vec<BoxPorosity>,
    /// Why there are no boxes.
    pub note: Option<String>,
}

/// Voxels of the grid that count, and pores among them.
struct Share {
    slices: [Shares; 3],
    blocks: Shares,
}

#[derive(Default)]
struct Shares {
    all: Vec<i64>,
    pores: Vec<i64>,
}

/// Porosity by slices and boxes.
///
/// # Errors
/// Those of the region.
pub fn measured(manifest: &Manifest, told: &Told) -> Result<Measured> {
    let dims = manifest.grid.dims;
    let cylinder = match manifest.region.as_ref().map(|r| &r.shape) {
        Some(Shape::Cylinder(cylinder)) => Some(cylinder),
        _ => None,
    };
    let inside = match cylinder {
        Some(cylinder) => Some(InCylinder::new(manifest, cylinder, &told.blocks)?),
        None => None,
    };
    let air_outside = manifest
        .region
        .as_ref()
        .is_some_and(|r| r.fill == Fill::Air);
    let share = share(dims, told, inside.as_ref(), air_outside);
    let place = manifest.measured();
    let axis = |a: usize| axis_profile(&share.slices[a], place.spacing[a]);
    let profile = Profile {
        unit: place.unit.name(),
        x: axis(0),
        y: axis(1),
        z: axis(2),
    };
    if told.outside.is_some() {
        let note = "boxes would reach outside of the sample: a crop inside of it, or a region, tells their porosity";
        return Ok(Measured {
            profile,
            boxes: Vec::new(),
            note: Some(note.to_owned()),
        });
    }
    let content = Content {
        blocks: &told.blocks,
        all: &share.blocks.all,
        pores: &share.blocks.pores,
        within: match (cylinder, &inside) {
            (Some(cylinder), Some(inside)) => inside.square(cylinder, &told.blocks),
            _ => told.blocks.counts().map(|n| [0, n]),
        },
        spacing: place.spacing,
    };
    Ok(Measured {
        profile,
        boxes: porosity_of_boxes(&content),
        note: None,
    })
}

fn share(dims: Dims, told: &Told, inside: Option<&InCylinder>, air_outside: bool) -> Share {
    let n = dims.0.map(i64::from);
    let slices = std::array::from_fn(|a| {
        let whole = n.iter().product::<i64>() / n[a];
        let all = match inside {
            Some(inside) => inside.slices[a].clone(),
            None => vec![whole; n[a] as usize],
        };
        let volume = vec![whole; n[a] as usize];
        let outside = told.outside.as_ref().map(|o| &o.slices[a][..]);
        shares(&volume, all, &told.above.slices[a], outside, air_outside)
    });
    let counts = told.blocks.counts();
    let mut volume = Vec::with_capacity(told.above.blocks.len());
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            volume.extend((0..counts[0]).map(|x| told.blocks.voxels([x, y, z])));
        }
    }
    let all = match inside {
        Some(inside) => inside.blocks(&told.blocks),
        None => volume.clone(),
    };
    let outside = told.outside.as_ref().map(|o| &o.blocks[..]);
    Share {
        slices,
        blocks: shares(&volume, all, &told.above.blocks, outside, air_outside),
    }
}

/// Of parts of the grid of `volume` voxels each, of which `inside` are in the region and `above` are above: those that
/// count, and pores.
fn shares(
    volume: &[i64],
    inside: Vec<i64>,
    above: &[i64],
    outside: Option<&[i64]>,
    air_outside: bool,
) -> Shares {
    let mut shares = Shares::default();
    for (i, &inside) in inside.iter().enumerate() {
        let around = outside.map_or(0, |o| o[i]);
        let filled = if air_outside { volume[i] - inside } else { 0 };
        shares.all.push((inside - around).max(0));
        let pores = volume[i] - above[i] - filled - around;
        shares.pores.push(pores.max(0));
    }
    shares
}

fn axis_profile(shares: &Shares, step: f64) -> AxisProfile {
    let whole = |v: &[i64]| v.iter().map(|&n| n as u64).collect();
    let porosity: Vec<Option<f64>> = std::iter::zip(&shares.pores, &shares.all)
        .map(|(&pores, &all)| (all > 0).then(|| pores as f64 / all as f64))
        .collect();
    let known = || porosity.iter().flatten();
    let n = known().count() as f64;
    let mean = known().sum::<f64>() / n;
    let square = known().map(|p| (p - mean) * (p - mean)).sum::<f64>() / n;
    AxisProfile {
        step,
        pores: whole(&shares.pores),
        voxels: whole(&shares.all),
        mean: (n > 0.0).then_some(mean),
        sd: (n > 0.0).then(|| square.sqrt()),
        porosity,
    }
}

/// Voxels of the grid in a cylinder.
struct InCylinder {
    /// By the axis that slices lie across.
    slices: [Vec<i64>; 3],
    /// Of a slice, by blocks along x and y.
    in_slice: Vec<i64>,
    /// First voxel of the crop.
    start: [u32; 3],
    last: [u32; 3],
}

impl InCylinder {
    fn new(manifest: &Manifest, cylinder: &Cylinder, blocks: &Blocks) -> Result<Self> {
        let crop = manifest.source.crop.as_ref();
        let whole = manifest.filtered_dims()?;
        let region = RegionVoxels::cylinder(cylinder, whole)?.cropped(crop)?;
        let [nx, ny, nz] = manifest.grid.dims.0;
        let [bx, by, _] = blocks.counts();
        let (mut by_x, mut by_y) = (vec![0; nx as usize], vec![0; ny as usize]);
        let mut in_slice = vec![0; bx * by];
        let mut rows = Vec::new();
        for y in 0..ny {
            region.rows(y..y + 1, 0, &mut rows)?;
            debug_assert_eq!(rows.len(), row_words(nx));
            let block_y = blocks.of(1, y);
            for x in 0..nx {
                let inside = (rows[x as usize / 64] >> (x % 64) & 1) as i64;
                by_x[x as usize] += inside;
                by_y[y as usize] += inside;
                in_slice[blocks.of(0, x) + bx * block_y] += inside;
            }
        }
        let slice: i64 = by_x.iter().sum();
        let depth = |v: Vec<i64>| v.into_iter().map(|n| n * i64::from(nz)).collect();
        Ok(InCylinder {
            slices: [depth(by_x), depth(by_y), vec![slice; nz as usize]],
            in_slice,
            start: crop.map_or([0; 3], |c| c.start()),
            last: [nx - 1, ny - 1, nz - 1],
        })
    }

    /// Voxels inside of each block.
    fn blocks(&self, blocks: &Blocks) -> Vec<i64> {
        let depth = (0..blocks.counts()[2]).map(|z| blocks.length(2, z));
        depth
            .flat_map(|depth| self.in_slice.iter().map(move |n| n * depth))
            .collect()
    }

    /// Blocks of the largest square prism in the cylinder.
    fn square(&self, cylinder: &Cylinder, blocks: &Blocks) -> [[usize; 2]; 3] {
        let half = cylinder.radius * std::f64::consts::FRAC_1_SQRT_2;
        let counts = blocks.counts();
        std::array::from_fn(|a| {
            if a == 2 {
                return [0, counts[2]];
            }
            let centre = cylinder.centre[a] - f64::from(self.start[a]);
            let from = (centre - half).ceil().max(0.0);
            let to = (centre + half).floor().min(f64::from(self.last[a]));
            let first = (0..counts[a]).position(|b| f64::from(blocks.start(a, b)) >= from);
            let end = (1..=counts[a]).rfind(|&b| f64::from(blocks.start(a, b)) <= to + 1.0);
            match (first, end) {
                (Some(first), Some(end)) if first < end => [first, end],
                _ => [0, 0],
            }
        })
    }
}
