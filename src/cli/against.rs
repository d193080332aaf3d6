//! The volume that a tile set was made from, opened again.

use super::args::InputOptions;
use super::filters::FilterArgs;
use super::input::Input;
use super::region::RegionArgs;
use crate::error::{Error, Result};
use crate::grid::Origin;
use crate::manifest::{MANIFEST, Manifest};
use crate::progress::Progress;
use crate::verify::SourceVolume;
use crate::volume::{
    Cropped, Filled, Headerless, OpenOptions, Opened, RegionVoxels, Stamp, Volume,
};
use std::path::Path;

/// The volume that a tile set was made from, what it says of itself as a whole, and what shows a change to it.
pub struct Against {
    /// Filtered and cut, and filled outside of its region if that was asked for.
    pub volume: Box<dyn Volume>,
    /// The voxels of its region of interest, cut as it is.
    pub region: Option<RegionVoxels>,
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
    /// The region, if there is one; it has to be that of the tile set, and what is outside of it is filled. Nothing is
    /// filled without this.
    pub region: Option<&'a RegionArgs>,
    /// The option by which it was given, for messages.
    pub option: &'static str,
    /// Told of what takes long.
    pub progress: &'a dyn Progress,
}

impl<'a> Asked<'a> {
    /// What a command that takes all options of an input was asked for of its `--against`.
    pub fn of(input: &'a InputOptions, progress: &'a dyn Progress) -> Self {
        Asked {
            options: input.options(),
            filters: &input.filters,
            region: Some(&input.region),
            option: "--against",
            progress,
        }
    }
}

/// Opens the volume that a tile set was made from, filtered and cut as the manifest says. What a raw file does not say is taken
/// from the manifest unless the options say it, as is what was asked for of a file of the name that was converted.
/// Such a file is raw even if it begins as one with a header does.
///
/// # Errors
/// Those of opening it; [`Error::Usage`] if it is not the volume that the tiles were made from, as far as its size tells.
pub fn open_against(directory: &Path, input: Input, asked: Asked) -> Result<Against> {
    // an index that cannot be read is for the verifier to report
    let Ok(manifest) = Manifest::open(directory) else {
        let (opened, stamp) = input.open(&asked.options, directory)?;
        let opened = asked.filters.apply(opened)?;
        return Ok(Against {
            source: SourceVolume::of(&opened),
            volume: opened.volume,
            region: None,
            stamp,
        });
    };
    let path = input.path().to_path_buf();
    let (opened, stamp) = open_whole(directory, input, &manifest, &asked)?;
    let source = SourceVolume::of(&opened);
    let (volume, region) = filled(opened, &manifest, directory, &asked)?;
    let (dims, crop) = (volume.header().dims, manifest.source.crop.as_ref());
    if crop.is_some_and(|crop| crop.dims_in(dims).is_err()) {
        let whole = manifest.filtered_dims()?;
        let found = format!("{} of {dims} voxels", path.display());
        let expected = format!("a volume of {whole}, of which the tiles cover a part");
        return Err(Error::usage(asked.option, found, expected));
    }
    let region = region.map(|region| region.cropped(crop));
    Ok(Against {
        volume: Cropped::part(volume, crop)?,
        region: region.transpose()?,
        source,
        stamp,
    })
}

/// The same before it is cut and filled.
///
/// # Errors
/// As of [`open_against`].
pub fn open_whole(
    directory: &Path,
    input: Input,
    manifest: &Manifest,
    asked: &Asked,
) -> Result<(Opened, Stamp)> {
    let options = completed(asked.options.clone(), manifest, &input);
    let (opened, stamp) = input.open(&options, directory)?;
    let opened = asked.filters.apply_as(manifest, opened, asked.option)?;
    Ok((opened, stamp))
}

/// The options with what the manifest says where they do not.
fn completed(mut options: OpenOptions, manifest: &Manifest, input: &Input) -> OpenOptions {
    let source = &manifest.source;
    let same_name = input.name() == source.name;
    let is_file = matches!(input, Input::Path(_));
    if same_name {
        if is_file {
            options = options.or_part(&source.part);
        }
        // what the file does not state had to be said to open it
        if source.provenance.spacing.contains(&Origin::Option) && options.spacing.is_none() {
            options.spacing = Some(unfiltered_spacing(manifest));
            options.unit = options.unit.or(Some(manifest.placement.unit));
        }
    }
    if source.format == "raw" && is_file {
        options.headerless = Some(Headerless {
            dims: source.dims.0.map(u64::from),
            dtype: source.dtype,
            endian: source.endian,
            offset: source.offset,
            supposed: false,
        });
        if same_name {
            options = options.of_headerless();
        }
    }
    options
}

/// The volume with what is outside of the tile set's region filled, if that is asked for, and the region.
fn filled(
    opened: Opened,
    manifest: &Manifest,
    directory: &Path,
    asked: &Asked,
) -> Result<(Box<dyn Volume>, Option<RegionVoxels>)> {
    let volume = opened.volume;
    let Some(region) = asked.region else {
        return Ok((volume, None));
    };
    let region = region.find_as(manifest, &*volume, asked.option, asked.progress)?;
    match (region, &manifest.region) {
        (Some(voxels), Some(stated)) => {
            let filled = Filled::new(volume, voxels.clone(), stated.fill_value);
            let filled = filled.map_err(|error| match error {
                // nobody typed it
                Error::Usage { expected, .. } => {
                    let found = format!("region.fill_value of {}", stated.fill_value);
                    Error::format(directory.join(MANIFEST), found, expected)
                }
                other => other,
            })?;
            Ok((Box::new(filled), Some(voxels)))
        }
        (region, _) => Ok((volume, region)),
    }
}

/// The size of a voxel before the filters of a tile set.
pub(super) fn unfiltered_spacing(manifest: &Manifest) -> [f64; 3] {
    let factors = manifest.filters.iter().map(|filter| filter.factor());
    let factor: f64 = factors.map(f64::from).product();
    manifest.placement.spacing.map(|size| size / factor)
}
