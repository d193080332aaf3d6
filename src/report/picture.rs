//! The picture of a report: a slice through the middle, with its cells in colour.

use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype, Endian, Shape};
use crate::manifest::Manifest;
use crate::preview::{PreviewOptions, render};
use crate::structure::SliceBits;
use crate::volume::{Header, RegionVoxels, Stamp, Volume};
use std::ops::Range;
use std::path::Path;

/// The most pixels along the longer side.
const PIXELS: u32 = 1400;
/// The most voxels of a slice that is drawn: it takes some 16 bytes for each.
pub const VOXELS: u64 = 1 << 24;

/// A picture and what it shows.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The bytes of a PNG.
    pub png: Vec<u8>,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// What it shows.
    pub caption: String,
}

/// The volume that a tile set was made from.
pub struct SourceVolume<'a> {
    /// Filtered as the tiles' was, and not cropped.
    pub volume: &'a dyn Volume,
    /// Its region of interest.
    pub region: Option<RegionVoxels>,
    /// What shows a change to it.
    pub stamp: Stamp,
}

/// Draws the slice of the volume at voxel `z` of the tile set in `dir`.
///
/// # Errors
/// Those of [`crate::preview::preview`].
pub fn of_volume(dir: &Path, shown: Shown, source: &SourceVolume) -> Result<Picture> {
    let options = PreviewOptions {
        region: source.region.clone(),
        input: source.stamp.clone(),
        ..options(dir, shown)
    };
    drawn(
        source.volume,
        &options,
        "Grey values of the scan, and cells",
    )
}

/// Draws a slice of which the tiles told the voxels.
///
/// # Errors
/// Those of [`crate::preview::preview`].
pub fn of_tiles(
    dir: &Path,
    manifest: &Manifest,
    shown: Shown,
    bits: &SliceBits,
) -> Result<Picture> {
    let volume = Phases::new(manifest, bits)?;
    let region = match manifest.region.as_ref().map(|r| &r.shape) {
        Some(Shape::Cylinder(cylinder)) => {
            Some(RegionVoxels::cylinder(cylinder, manifest.filtered_dims()?)?)
        }
        _ => None,
    };
    let options = PreviewOptions {
        window: Some(volume.window()),
        phases_only: true,
        region,
        ..options(dir, shown)
    };
    drawn(
        &volume,
        &options,
        "Material (light) and cells, as the tiles have them",
    )
}

/// What a picture shows.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// The slice across z.
    pub z: u32,
    /// Cells have colours by their diameter, not by their ids: there are some that have one.
    pub by_size: bool,
}

fn options(dir: &Path, shown: Shown) -> PreviewOptions {
    let by_size = || "equivalent_diameter".to_owned();
    PreviewOptions {
        at: Some(shown.z),
        tiles: Some(dir.to_path_buf()),
        colour_by: shown.by_size.then(by_size),
        ..PreviewOptions::default()
    }
}

fn drawn(volume: &dyn Volume, options: &PreviewOptions, shows: &str) -> Result<Picture> {
    let (picture, report) = render(volume, options)?;
    let colours = match options.colour_by {
        Some(_) => "colours by their equivalent diameter; cells that the border cuts are hatched",
        None => "colours that tell them apart",
    };
    let picture = picture.shrunk(PIXELS);
    let failed = |e| Error::io("report", "make the picture", e);
    Ok(Picture {
        size: picture.size(),
        png: picture.png().map_err(failed)?,
        caption: format!(
            "{shows}: slice {} across z, through the middle. Cells have {colours}.",
            report.at
        ),
    })
}

/// A volume of one slice: samples above and below the threshold of a tile set, as the tiles have the phases.
struct Phases<'a> {
    header: Header,
    /// First voxel of the crop.
    start: [u32; 3],
    bits: &'a SliceBits,
    /// The samples of the two phases, below and above.
    samples: [f64; 2],
}

impl<'a> Phases<'a> {
    fn new(manifest: &Manifest, bits: &'a SliceBits) -> Result<Self> {
        let t = manifest.threshold;
        let away = (t.abs() / 2.0).max(1.0);
        Ok(Phases {
            header: Header {
                format: "memory",
                dims: Dims::new(manifest.filtered_dims()?.0.map(u64::from))?,
                dtype: Dtype::F64,
                endian: Endian::NATIVE,
                placement: manifest.placement,
            },
            start: manifest.source.crop.as_ref().map_or([0; 3], |c| c.start()),
            bits,
            samples: [t - away, t + away],
        })
    }

    /// Samples that are black and white, such that material is light grey.
    fn window(&self) -> [f64; 2] {
        let [below, above] = self.samples;
        [below - (above - below), above + 0.35 * (above - below)]
    }
}

impl Volume for Phases<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let voxels = z.flat_map(|_| {
            let x = x.clone();
            y.clone().flat_map(move |j| x.clone().map(move |i| [i, j]))
        });
        for ([i, j], sample) in voxels.zip(out.chunks_exact_mut(size_of::<f64>())) {
            let at = [i.wrapping_sub(self.start[0]), j.wrapping_sub(self.start[1])];
            let value = self.samples[usize::from(self.bits.above(at))];
            sample.copy_from_slice(&value.to_ne_bytes());
        }
        Ok(())
    }
}
