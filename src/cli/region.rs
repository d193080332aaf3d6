//! The options of the region of interest: the same for every command that reads a volume.

use crate::cli::input::{check_read, open_beside};
use crate::cli::same_place::{parts_of_other, same_place};
use crate::convert::{RegionOfInterest, check_read_beside};
use crate::error::{Error, Result};
use crate::grid::{Crop, Cylinder, Dims, Dtype, Endian, Fill, Frame, Placement, Region, Shape};
use crate::manifest::Manifest;
use crate::progress::Progress;
use crate::volume::{
    self, FoundCylinder, Headerless, OpenOptions, RegionVoxels, Volume, file_name, fill_value,
    find_cylinder,
};
use crate::words::percent;
use clap::{Args, ValueEnum};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A region, as typed.
#[derive(Debug, Clone, PartialEq)]
pub enum RegionArg {
    /// The round sample of the scan, to be found.
    Found,
    /// This cylinder.
    Cylinder(Cylinder),
    /// The voxels of this volume that are not 0.
    Mask(PathBuf),
}

/// What is outside, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum FillArg {
    /// Above: pores end at the edge of the region
    Material,
    /// Below: what is outside is one cell with all that it touches
    Air,
}

/// The part of a volume that counts.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Region of interest, in voxels of the filtered volume")]
pub struct RegionArgs {
    /// Only the part of the volume in this region counts: `cylinder` (the round sample of the scan, found by itself),
    /// `cylinder:CX,CY,R` along z, or `mask:FILE`
    ///
    /// A cylinder goes through all slices; its axis and radius are in voxels, and a voxel is inside if its middle is. The
    /// one that is found ends inside of the rim of the sample, by a voxel or so unless that is tilted; it is looked for in
    /// whole slices, with --crop in those of the crop. A mask is any volume of the same size and place that
    /// alvis reads (raw: of type u8); voxels that are not 0 are inside. Histogram, thresholds and porosity are of what is
    /// inside, cells that the edge of the region cuts are border cells. Which voxels of a mask are inside is kept in a
    /// temporary file, an eighth of a byte for each.
    #[arg(long, value_name = "REGION", value_parser = region)]
    pub roi: Option<RegionArg>,
    /// What voxels outside of the region are taken for [default: material]
    #[arg(long, value_name = "PHASE")]
    pub roi_fill: Option<FillArg>,
}

/// The option `--roi`.
fn region(text: &str) -> Result<RegionArg, String> {
    let expected = || "expected cylinder, cylinder:CX,CY,R in voxels, or mask:FILE".to_owned();
    match text.split_once(':') {
        None if text == "cylinder" => Ok(RegionArg::Found),
        Some(("mask", path)) if !path.is_empty() => Ok(RegionArg::Mask(path.into())),
        Some(("cylinder", numbers)) => {
            let numbers = numbers
                .split(',')
                .map(|n| n.trim().parse::<f64>().ok().filter(|n| n.is_finite()))
                .collect::<Option<Vec<f64>>>();
            match numbers.as_deref() {
                Some(&[x, y, radius]) if radius > 0.0 => Ok(RegionArg::Cylinder(Cylinder {
                    centre: [x, y],
                    radius,
                })),
                _ => Err(expected()),
            }
        }
        _ => Err(expected()),
    }
}

/// A region of a volume, and what is outside.
#[derive(Debug, Clone)]
pub struct Roi {
    /// Its form.
    pub shape: Shape,
    /// Its voxels.
    pub voxels: RegionVoxels,
    /// What voxels outside are taken for.
    pub fill: Fill,
    /// How many they are.
    pub count: u64,
    /// What is known of it if it was found in the scan.
    pub found: Option<FoundCylinder>,
    /// What the user should know of it.
    pub warnings: Vec<String>,
}

/// A form, with what tells one mask from another of the same name.
fn with_checksum(shape: &Shape) -> String {
    match shape {
        Shape::Cylinder(_) => shape.to_string(),
        Shape::Mask { checksum, .. } => format!("{shape} ({checksum})"),
    }
}

impl RegionArgs {
    /// Names of the options that are given.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        let given = [
            ("roi", self.roi.is_some()),
            ("roi-fill", self.roi_fill.is_some()),
        ];
        given.into_iter().filter(|g| g.1).map(|g| g.0)
    }

    fn fill(&self) -> Fill {
        match self.roi_fill {
            Some(FillArg::Air) => Fill::Air,
            _ => Fill::Material,
        }
    }

    /// Refuses `--roi-fill` without a region.
    fn check(&self) -> Result<()> {
        match (&self.roi, self.roi_fill) {
            (None, Some(_)) => Err(Error::usage(
                "--roi-fill",
                "no --roi with it",
                "--roi as well: what is outside of that region is filled",
            )),
            _ => Ok(()),
        }
    }

    /// The region of a volume, of which `crop` is what counts at all; `None` if all of it counts. A mask is read in at most
    /// `memory` bytes.
    ///
    /// # Errors
    /// Those of [`find_cylinder`] and [`RegionVoxels::of_mask`], and of opening the mask; [`Error::Memory`].
    pub fn find(
        &self,
        (volume, frame): (&dyn Volume, Frame),
        crop: Option<&Crop>,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Option<Roi>> {
        self.check()?;
        let header = volume.header();
        let dims = header.dims;
        let Some(asked) = &self.roi else {
            return Ok(None);
        };
        let mut found = None;
        let (shape, voxels) = match asked {
            RegionArg::Mask(path) => {
                let place = Some((&header.placement, frame));
                read_mask(path, (volume, place), memory, progress)?
            }
            RegionArg::Found => {
                let cylinder = find_cylinder(volume, slices(dims, crop), progress)?;
                let of = of_cylinder(cylinder.cylinder, dims)?;
                found = Some(cylinder);
                of
            }
            RegionArg::Cylinder(cylinder) => of_cylinder(*cylinder, dims)?,
        };
        let count = voxels.count()?;
        let mut warnings = found
            .as_ref()
            .map_or(Vec::new(), |found| found.warnings.clone());
        if count == dims.voxels() {
            warnings.push(format!(
                "all of the volume's voxels are in the region {shape}: it leaves nothing out"
            ));
        }
        Ok(Some(Roi {
            shape,
            count,
            voxels,
            fill: self.fill(),
            found,
            warnings,
        }))
    }

    /// The region that was found before in a volume, and is asked for again.
    ///
    /// # Errors
    /// [`Error::Usage`] if a mask is not what it was; as of [`RegionArgs::find`].
    pub fn find_again(
        &self,
        stated: &Region,
        volume: &dyn Volume,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<RegionOfInterest> {
        let header = volume.header();
        let voxels = match (&stated.shape, &self.roi) {
            (Shape::Mask { .. }, Some(RegionArg::Mask(path))) => {
                let (found, voxels) = read_mask(path, (volume, None), memory, progress)?;
                if found != stated.shape {
                    let expected = format!("the mask as it was: {}", with_checksum(&stated.shape));
                    return Err(Error::usage("--roi", with_checksum(&found), expected));
                }
                voxels
            }
            (Shape::Cylinder(cylinder), _) => RegionVoxels::cylinder(cylinder, header.dims)?,
            (Shape::Mask { .. }, _) => {
                return Err(Error::usage("--roi", "no mask", "that of the region"));
            }
        };
        let stated = stated.clone();
        Ok(RegionOfInterest { stated, voxels })
    }

    /// The voxels of the region of a tile set in its volume, which has been filtered and not cropped; `None` if all of it
    /// counts. `option` is that by which the tile set or the volume was given.
    ///
    /// # Errors
    /// [`Error::Usage`] if another region is asked for, or a mask is needed that is not given; as of
    /// [`RegionArgs::find`].
    pub fn find_as(
        &self,
        manifest: &Manifest,
        volume: &dyn Volume,
        option: &str,
        progress: &dyn Progress,
    ) -> Result<Option<RegionVoxels>> {
        self.check()?;
        let dims = volume.header().dims;
        let stated = manifest.region.as_ref();
        let other = |found: String| {
            let expected = match stated {
                Some(region) => format!("that of the tiles: {region}"),
                None => "none, as the tiles have".to_owned(),
            };
            Error::usage("--roi", found, expected)
        };
        if let (Some(fill), Some(region)) = (self.roi_fill, stated)
            && self.fill() != region.fill
        {
            return Err(other(format!("{fill:?} outside").to_lowercase()));
        }
        match (stated.map(|region| &region.shape), &self.roi) {
            (None, None) => Ok(None),
            (Some(Shape::Cylinder(cylinder)), asked) => {
                if let Some(RegionArg::Cylinder(asked)) = asked
                    && asked != cylinder
                {
                    return Err(other(asked.to_string()));
                }
                if let Some(RegionArg::Mask(path)) = asked {
                    return Err(other(format!("mask:{}", path.display())));
                }
                if *asked == Some(RegionArg::Found) {
                    let range = slices(dims, manifest.source.crop.as_ref());
                    let found = find_cylinder(volume, range, progress)?.cylinder;
                    if found != *cylinder {
                        return Err(other(format!("{found}, which the scan shows")));
                    }
                }
                RegionVoxels::cylinder(cylinder, dims).map(Some)
            }
            (Some(Shape::Mask { checksum, .. }), Some(RegionArg::Mask(path))) => {
                let (found, voxels) = read_mask(path, (volume, None), u64::MAX, progress)?;
                match found {
                    Shape::Mask { checksum: own, .. } if own == *checksum => Ok(Some(voxels)),
                    _ => Err(other(format!(
                        "{}, with other voxels inside",
                        path.display()
                    ))),
                }
            }
            (Some(Shape::Mask { file, .. }), None) => Err(Error::usage(
                option,
                "a volume without the mask of its region",
                format!("it together with --roi mask:FILE, of the mask {file}"),
            )),
            (_, Some(asked)) => Err(other(match asked {
                RegionArg::Found => "cylinder".to_owned(),
                RegionArg::Cylinder(cylinder) => cylinder.to_string(),
                RegionArg::Mask(path) => format!("mask:{}", path.display()),
            })),
        }
    }
}

/// The slices in which a cylinder is looked for.
fn slices(dims: Dims, crop: Option<&Crop>) -> Range<u32> {
    let all = 0..dims.0[2];
    crop.map_or(all.clone(), |crop| {
        crop.z.start.min(all.end - 1)..crop.z.end.min(all.end)
    })
}

fn of_cylinder(cylinder: Cylinder, dims: Dims) -> Result<(Shape, RegionVoxels)> {
    let voxels = RegionVoxels::cylinder(&cylinder, dims)?;
    Ok((Shape::Cylinder(cylinder), voxels))
}

/// An error of a mask that cannot be opened, with what is special about masks: nothing is said of their type.
fn of_mask(error: Error, path: &Path, dims: Dims) -> Error {
    let name = file_name(path).to_lowercase();
    let packed = name.strip_suffix(".gz").is_some_and(|inner| {
        let headed = [".nrrd", ".mhd", ".mha", ".tif", ".tiff", ".npy", ".vti"];
        headed.iter().any(|ending| inner.ends_with(ending))
    });
    if packed && matches!(error, Error::Format { .. }) {
        let expected = "a mask that is not packed as a whole, or .nii.gz";
        let found = format!("the mask {}, packed by gzip", path.display());
        return Error::usage("--roi", found, expected).with_hint("unpack it first, by gunzip");
    }
    let bytes = path.metadata().map_or(0, |found| found.len());
    let each = bytes / dims.voxels();
    match parts_of_other(error, "--roi", "the mask", path) {
        Error::Format { .. } if [2, 4, 8].contains(&each) && bytes == each * dims.voxels() => {
            let found = format!(
                "the mask {} with {each} bytes for each voxel",
                path.display()
            );
            let expected = "one byte for each where a mask is raw (u8)";
            let hint = "give one of another type a header, as .mhd or .nrrd";
            Error::usage("--roi", found, expected).with_hint(hint)
        }
        // zeros and ones cannot be interpolated
        Error::Unsupported { ref hint, .. } if hint.contains("--resample") => {
            let found = format!(
                "the mask {}, on axes or steps that are not regular",
                path.display()
            );
            let expected = format!("a mask on the grid of the volume, of {dims} voxels");
            Error::usage("--roi", found, expected)
                .with_hint("of a volume that --resample interpolates, that is the grid that `alvis info` tells")
        }
        error => error,
    }
}

/// Opens and reads a mask for a volume, and in this place unless its checksum tells that it is the right one, in at most
/// so many bytes of memory.
fn read_mask(
    path: &Path,
    (volume, place): (&dyn Volume, Option<(&Placement, Frame)>),
    memory: u64,
    progress: &dyn Progress,
) -> Result<(Shape, RegionVoxels)> {
    let dims = volume.header().dims;
    let options = OpenOptions {
        headerless: Some(Headerless {
            dims: dims.0.map(u64::from),
            dtype: Dtype::U8,
            endian: Endian::Little,
            offset: 0,
            supposed: true,
        }),
        ..OpenOptions::default()
    };
    let opened = || volume::open(path, &options);
    let (opened, stamp) = open_beside(path, opened).map_err(|e| of_mask(e, path, dims))?;
    if let Some(place) = place.filter(|_| dims == opened.volume.header().dims) {
        same_place("--roi", "the mask", path, &opened, place)?;
    }
    let mask = opened.volume;
    check_read_beside(volume, &*mask, "--roi", memory)?;
    let kept_in = std::env::temp_dir();
    let (voxels, checksum) = RegionVoxels::of_mask(&*mask, dims, &kept_in, progress)?;
    check_read(&stamp, progress)?;
    let file = file_name(path);
    Ok((Shape::Mask { file, checksum }, voxels))
}

impl Roi {
    /// The region of a conversion at a threshold, of which what is outside is filled.
    ///
    /// # Errors
    /// Those of [`fill_value`] and [`RegionOfInterest::new`].
    pub fn at_threshold(
        self,
        volume: &dyn Volume,
        threshold: f64,
        crop: Option<&Crop>,
        progress: &dyn Progress,
    ) -> Result<RegionOfInterest> {
        let value = fill_value(volume, &self.voxels, threshold, self.fill, progress)?;
        RegionOfInterest::new(self.shape, self.voxels, crop, self.fill, value)
    }

    /// The share of the volume that is inside, 0 to 1.
    pub fn share(&self) -> f64 {
        self.count as f64 / self.voxels.dims().voxels() as f64
    }

    /// What the user should know of it.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// What it is, for people.
    pub fn text(&self) -> String {
        let how = if self.found.is_some() { " (found)" } else { "" };
        text(&self.shape, how, self.share(), self.fill)
    }
}

/// A region for people, of which `how` tells where it comes from.
fn text(shape: &Shape, how: &str, share: f64, fill: Fill) -> String {
    let shape = match shape {
        Shape::Cylinder(Cylinder {
            centre: [x, y],
            radius,
        }) => format!("cylinder along z, axis at x {x}, y {y}, radius {radius} voxels"),
        Shape::Mask { file, .. } => format!("mask {file}"),
    };
    format!(
        "{shape}{how}; {} of the voxels, {fill} outside",
        percent(share)
    )
}

/// The region of a tile set of a grid of this size, for people.
pub fn region_text(region: &Region, dims: Dims) -> String {
    let share = region.voxels as f64 / dims.voxels() as f64;
    text(&region.shape, "", share, region.fill)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_read() {
        assert_eq!(region("cylinder"), Ok(RegionArg::Found));
        assert_eq!(region("mask:a:b"), Ok(RegionArg::Mask("a:b".into())));
        let cylinder = Cylinder {
            centre: [10.5, -2.0],
            radius: 7.0,
        };
        assert_eq!(
            region("cylinder:10.5,-2, 7"),
            Ok(RegionArg::Cylinder(cylinder))
        );
        assert_eq!(cylinder.to_string(), "cylinder:10.5,-2,7");
        for bad in [
            "",
            "mask",
            "mask:",
            "sphere",
            "cylinder:",
            "cylinder:1,2",
            "cylinder:1,2,0",
            "cylinder:1,2,-3",
            "cylinder:1,nan,3",
            "cylinder:1,2,3,4",
        ] {
            assert!(region(bad).unwrap_err().contains("mask:FILE"), "{bad}");
        }
    }
}
