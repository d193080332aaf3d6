//! Opens the volume of a conversion, and finds what is asked for of it.

use super::convert::{ConvertArgs, understood};
use super::input::Input;
use super::labels::{known_labels, labels_of_parts, read_labels};
use super::progress::Console;
use super::threshold::Threshold;
use crate::convert::parts::{Asked, check_plan};
use crate::convert::{self, ConvertOptions};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Opened;
use std::path::Path;

/// What a volume is opened for.
#[derive(Clone, Copy)]
pub enum Purpose<'a> {
    /// To be converted.
    Convert,
    /// To be converted in parts.
    Plan,
    /// To go on with a plan, which knows the threshold and the region.
    Known(&'a Asked),
}

/// A volume that is open, and what is asked for of it.
pub struct Prepared {
    /// The volume.
    pub opened: Opened,
    /// What is asked for.
    pub options: ConvertOptions,
    /// What is doubtful about it.
    pub doubts: Vec<String>,
    /// How it was understood, for people.
    pub understood: String,
    /// How the threshold was found, in brackets; empty if it was typed or is known.
    pub how: String,
}

impl Prepared {
    fn of(opened: Opened, options: ConvertOptions) -> Self {
        Prepared {
            opened,
            options,
            doubts: Vec::new(),
            understood: String::new(),
            how: String::new(),
        }
    }
}

impl ConvertArgs {
    /// The one directory to write, where a plan is made for it.
    ///
    /// # Errors
    /// [`Error::Usage`] for what no plan has.
    pub fn plain_out(&self) -> Result<&Path> {
        let given = [
            ("--out-dir", self.out_dir.is_some()),
            ("--lod", self.lod),
            ("--view", self.view),
            ("--resume", self.resume),
        ];
        match (given.into_iter().find(|(_, given)| *given), &self.out) {
            (None, Some(out)) => Ok(out),
            (option, _) => {
                let expected = match option {
                    Some(("--resume", _)) => {
                        "none: `alvis work` and `alvis merge` go on by themselves"
                    }
                    Some(("--lod" | "--view", _)) => {
                        "`alvis lod OUT` or `alvis view OUT` when the tile set is there"
                    }
                    _ => "one volume and one directory: each scan has a plan of its own",
                };
                let option = option.map_or("OUT", |(option, _)| option);
                Err(Error::usage(option, "it with a plan", expected))
            }
        }
    }

    /// Opens a volume and finds what is asked for of it.
    pub fn prepare(
        &self,
        input: Input,
        out: &Path,
        purpose: Purpose,
        console: &Console,
    ) -> Result<Prepared> {
        let path = input.path().to_path_buf();
        let (mut opened, stamp) = input.open(&self.options.options(), out)?;
        opened.doubt_size()?;
        console.listen();
        let opened = self.options.filters.apply(opened)?;
        let mut options = self.of_opened(&opened, stamp)?;
        if let Purpose::Known(known) = purpose {
            self.set_known(&mut options, &opened, known, console)?;
            return Ok(Prepared::of(opened, options));
        }
        let how = match self.threshold {
            Threshold::Value(_) => String::new(),
            Threshold::Method(method) => format!(" ({})", method.how()),
        };
        let in_region = self.options.region.roi.is_some();
        if !how.is_empty() || in_region || self.labels.is_some() {
            // these read the volume: not for a conversion that is refused then
            let volume = &*opened.volume;
            match purpose {
                Purpose::Plan => check_plan(volume, &options, in_region, out)?,
                _ => convert::check_before(volume, &options, in_region, out)?,
            }
        }
        let roi = self.set_found(&mut options, &opened, &path, console)?;
        let place = (&*opened.volume, opened.provenance.frame);
        options.labels = match (&self.labels, purpose) {
            (Some(path), Purpose::Plan) => {
                Some(labels_of_parts(path, place, options.memory, console)?)
            }
            (Some(path), _) => Some(read_labels(path, place, options.memory, console)?),
            (None, _) => None,
        };
        let (doubts, found) = roi.unzip();
        let understood = understood(&opened, &options, found, &how)?;
        Ok(Prepared {
            doubts: doubts.unwrap_or_default(),
            understood,
            how,
            ..Prepared::of(opened, options)
        })
    }

    /// Takes threshold, region and labels of a plan.
    fn set_known(
        &self,
        options: &mut ConvertOptions,
        opened: &Opened,
        known: &Asked,
        console: &Console,
    ) -> Result<()> {
        let (volume, region) = (&*opened.volume, &self.options.region);
        options.threshold = known.threshold;
        options.region = match &known.region {
            Some(stated) => Some(region.find_again(stated, volume, options.memory, console)?),
            None => None,
        };
        options.labels = match (&self.labels, &known.labels) {
            (Some(path), Some(sums)) => Some(known_labels(path, volume.header().dims, sums)?),
            _ => None,
        };
        Ok(())
    }

    /// Finds the region of interest, the threshold inside of it, and what it is filled with. What is doubtful about the
    /// region is told and returned, with the region in words.
    fn set_found(
        &self,
        options: &mut ConvertOptions,
        opened: &Opened,
        path: &Path,
        console: &Console,
    ) -> Result<Option<(Vec<String>, String)>> {
        let (volume, frame) = (&*opened.volume, opened.provenance.frame);
        let (crop, memory) = (options.crop.as_ref(), options.memory);
        let region = &self.options.region;
        let roi = region.find((volume, frame), crop, memory, console)?;
        let warnings = roi.iter().flat_map(|roi| roi.warnings());
        warnings.for_each(|warning| console.warn(warning));
        let inside = roi.as_ref().map(|roi| &roi.voxels);
        options.threshold = self.threshold.find(volume, inside, path, console)?;
        let Some(roi) = roi else {
            return Ok(None);
        };
        let told = (roi.warnings().to_vec(), roi.text());
        options.region = Some(roi.at_threshold(volume, options.threshold, crop, console)?);
        Ok(Some(told))
    }
}
