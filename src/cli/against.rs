//! The volume that a tile set was made from, opened again.

use super::args::open_stamped;
use super::filters::FilterArgs;
use crate::error::{Error, Result};
use crate::grid::Origin;
use crate::manifest::Manifest;
use crate::verify::SourceVolume;
use crate::volume::{self, Cropped, Headerless, OpenOptions, Stamp, Volume};
use std::path::Path;

/// The volume that a tile set was made from, what it says of itself as a whole, and what shows a change to it.
pub struct Against {
    /// Filtered and cut.
    pub volume: Box<dyn Volume>,
    /// What the input says of itself.
    pub source: SourceVolume,
    /// What shows a change to it.
    pub stamp: Stamp,
}

/// What a user says of the volume.
pub struct Asked<'a> {
    /// How it is opened.
    pub options: OpenOptions,
    /// Filters, if there are any; they have to be those of the tile set.
    pub filters: &'a FilterArgs,
    /// The option by which it was given, for messages.
    pub option: &'static str,
}

/// Opens the volume that a tile set was made from, filtered and cut as the manifest says. What a raw file does not say is taken
/// from the manifest unless the options say it, as is what was asked for of a file of the name that was converted.
/// Such a file is raw even if it begins as one with a header does.
pub fn open_against(directory: &Path, path: &Path, asked: Asked) -> Result<Against> {
    // an index that cannot be read is for the verifier to report
    let manifest = Manifest::open(directory).ok();
    let Some(manifest) = manifest else {
        let (opened, stamp) = open_stamped(path, &asked.options, directory)?;
        let opened = asked.filters.apply(opened)?;
        let source = SourceVolume::of(&opened);
        let volume = opened.volume;
        return Ok(Against {
            volume,
            source,
            stamp,
        });
    };
    let source = &manifest.source;
    let mut options = asked.options;
    let same_name = volume::file_name(path) == source.name;
    if same_name {
        options = options.or_part(&source.part);
        // what the file does not state had to be said to open it
        if source.provenance.spacing.contains(&Origin::Option) && options.spacing.is_none() {
            options.spacing = Some(unfiltered_spacing(&manifest));
            options.unit = options.unit.or(Some(manifest.placement.unit));
        }
    }
    if source.format == "raw" {
        options.headerless = Some(Headerless {
            dims: source.dims.0.map(u64::from),
            dtype: source.dtype,
            endian: source.endian,
            offset: source.offset,
        });
        if same_name {
            options = options.of_headerless();
        }
    }
    let (opened, stamp) = open_stamped(path, &options, directory)?;
    let opened = asked.filters.apply_as(&manifest, opened, asked.option)?;
    let (whole, volume) = (SourceVolume::of(&opened), opened.volume);
    let dims = volume.header().dims;
    let volume = match &source.crop {
        None => Ok(volume),
        Some(crop) if crop.dims_in(dims).is_err() => Err(Error::usage(
            asked.option,
            format!("{} of {dims} voxels", path.display()),
            format!(
                "a volume of {}, of which the tiles cover a part",
                manifest.filtered_dims()?
            ),
        )),
        Some(crop) => Ok(Box::new(Cropped::new(volume, crop)?) as Box<dyn Volume>),
    };
    Ok(Against {
        volume: volume?,
        source: whole,
        stamp,
    })
}

/// The size of a voxel before the filters of a tile set.
fn unfiltered_spacing(manifest: &Manifest) -> [f64; 3] {
    let factors = manifest.filters.iter().map(|filter| filter.factor());
    let factor: f64 = factors.map(f64::from).product();
    manifest.placement.spacing.map(|size| size / factor)
}
