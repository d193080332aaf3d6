//! `alvis split`: a tile set again, with its cells cut at another ratio.

use super::args::Common;
use super::convert::{ConvertArgs, SPLIT_H, SPLIT_MIN_RADIUS};
use super::input::Input;
use super::same_surface::{Difference, differences, differences_of_volume, renamed};
use super::{Cli, Command, Outcome, output, parse};
use crate::error::{Error, Result};
use crate::grid::{Fill, Origin, Shape, Unit};
use crate::manifest::{Manifest, PartsBy, Selection};
use clap::{Args, Parser, ValueHint};
use serde::Serialize;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Make a tile set again with its cells split at another ratio, and all else as it was
///
/// Where cells end, their surfaces end, and the sums over their voxels: tiles do not tell these for another ratio, so the
/// volume is read again. How many cells a ratio gives is known without it: `alvis cells OUT --split-curve`. The line of
/// `alvis convert` that this stands for is said before it begins. A volume with another surface is refused; one that differs
/// where only normals show it is not: `alvis verify OUT --against` finds that.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis cells OUT --split-curve\n  \
    alvis split OUT DEST --ratio 0.7 --against scan.mhd")]
pub struct SplitArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The directory to write
    #[arg(value_hint = ValueHint::DirPath)]
    dest: PathBuf,
    /// Cut where the opening is at most this part of the smaller one's radius, as convert's --split
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true, value_parser = parse::another_ratio)]
    ratio: u32,
    /// The volume that the tile set was made from
    #[arg(long, value_name = "INPUT", value_hint = ValueHint::FilePath)]
    against: Option<PathBuf>,
    /// The mask that was its region of interest, if it was a mask
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    mask: Option<PathBuf>,
    /// Limit of resident memory
    #[arg(long, value_name = "SIZE", default_value = "1GiB", value_parser = parse::bytes)]
    memory: u64,
    /// Replace a tile set that is in DEST
    #[arg(long)]
    force: bool,
    /// Go on if this was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    common: Common,
}

impl SplitArgs {
    /// Splits anew; `typed` is the command line that asks for it.
    pub fn run(self, typed: &[OsString]) -> Result<Outcome> {
        let manifest = Manifest::open(&self.out)?;
        let convert = self.conversion(&manifest)?;
        self.check_volume(&manifest, &convert)?;
        self.tell_what_changes(&manifest);
        convert.run_if(typed, &|made| self.accept(&manifest, made))
    }

    /// The conversion that makes it.
    fn conversion(&self, manifest: &Manifest) -> Result<ConvertArgs> {
        let name = &manifest.source.name;
        let Some(volume) = &self.against else {
            let expected = format!(
                "the volume as well, `--against {name}`: where cells of another ratio end no tile tells"
            );
            let found = match &manifest.cells {
                Some(_) => "a tile set alone",
                None => "a tile set alone, whose cells are not split yet",
            };
            return Err(Error::usage("--ratio", found, expected));
        };
        if manifest.is_part() {
            let expected = "the tile set that it was selected from: split that, then select";
            return Err(Error::usage("OUT", "a part of a tile set", expected));
        }
        if let Some(PartsBy::Labels { file, .. }) = &manifest.cells {
            let found = format!("a tile set whose cells are those of the labels {file}");
            let expected = "one whose cells are connected, or were split";
            return Err(Error::usage("OUT", found, expected));
        }
        let words = self.words(manifest, volume)?;
        if self.common.talks() {
            let line: Vec<String> = words.iter().map(|word| output::shell_word(word)).collect();
            output::note(&format!("the same as `{}`", line.join(" ")));
        }
        let cli = Cli::try_parse_from(words).map_err(|refusal| {
            // written by another program, or by hand
            let found = refusal.to_string().lines().next().unwrap_or("").to_owned();
            Error::usage("OUT", found, "an index with settings that convert takes")
        })?;
        match cli.command {
            Command::Convert(args) => Ok(args),
            _ => unreachable!("the words begin with convert"),
        }
    }

    /// The words of `alvis convert` that make it.
    fn words(&self, manifest: &Manifest, volume: &Path) -> Result<Vec<OsString>> {
        let mut words = Words(vec!["alvis".into(), "convert".into()]);
        words.0.push(volume.into());
        words.0.push(self.dest.clone().into());
        settings(&mut words, manifest);
        source(&mut words, manifest);
        words.put("split", f64::from(self.ratio) / 1000.0);
        if let Some(PartsBy::Split {
            h_256,
            min_radius_256,
            ..
        }) = manifest.cells
        {
            words.put("split-h", f64::from(h_256) / 256.0);
            words.put("split-min-radius", f64::from(min_radius_256) / 256.0);
        }
        self.region(&mut words, manifest)?;
        words.put("memory", self.memory);
        words.put_if("threads", self.common.threads);
        let flags = [
            ("force", self.force),
            ("resume", self.resume),
            ("json", self.common.json),
            ("quiet", self.common.quiet),
        ];
        for (name, is) in flags {
            words.flag(name, is);
        }
        Ok(words.0)
    }

    /// The region of interest.
    fn region(&self, words: &mut Words, manifest: &Manifest) -> Result<()> {
        let shape = manifest.region.as_ref().map(|region| &region.shape);
        match (shape, &self.mask) {
            (None | Some(Shape::Cylinder(_)), Some(mask)) => {
                let expected = "none: the region of the tile set is no mask";
                return Err(Error::usage("--mask", mask.display().to_string(), expected));
            }
            (Some(Shape::Mask { file, .. }), None) => {
                let expected = format!("`--mask {file}`: only what is in it counts in this set");
                return Err(Error::usage("--mask", "none", expected));
            }
            (None, None) => return Ok(()),
            (Some(Shape::Cylinder(cylinder)), None) => {
                let [x, y] = cylinder.centre;
                words.put("roi", format!("cylinder:{x},{y},{}", cylinder.radius));
            }
            (Some(Shape::Mask { .. }), Some(mask)) => {
                let mut word = OsString::from("--roi=mask:");
                word.push(mask);
                words.0.push(word);
            }
        }
        if manifest
            .region
            .as_ref()
            .is_some_and(|region| region.fill == Fill::Air)
        {
            words.put("roi-fill", "air");
        }
        Ok(())
    }

    /// Refuses a volume that is another one by what it says of itself, before anything is made of it.
    fn check_volume(&self, manifest: &Manifest, convert: &ConvertArgs) -> Result<()> {
        let options = convert.options.options();
        let opened = Input::Path(&convert.input).open(&options, &self.dest);
        let (opened, _) = opened.map_err(|error| self.of_other_size(error, manifest))?;
        let opened = convert.options.filters.apply(opened)?;
        self.refuse(&differences_of_volume(manifest, &opened)?)?;
        if let Some(renamed) = renamed(manifest, &opened) {
            self.note(&format!("warning: {renamed}"));
        }
        Ok(())
    }

    /// The size and type that a raw file does not have were taken from the index: nobody typed them.
    fn of_other_size(&self, error: Error, manifest: &Manifest) -> Error {
        let source = &manifest.source;
        match error {
            Error::Format { path, found, .. } if source.format == "raw" => {
                let found = format!("{}: {found}", path.display());
                let expected = format!(
                    "the volume that {} was made from: raw, {} voxels, {}, {} bytes before the first",
                    self.out.display(),
                    source.dims,
                    source.dtype,
                    source.offset
                );
                Error::usage("--against", found, expected)
            }
            other => other,
        }
    }

    /// Refuses a set that differs from the one that is split anew in what the ratio does not change.
    fn accept(&self, manifest: &Manifest, made: &Path) -> Result<()> {
        self.refuse(&differences(&self.out, manifest, made)?)
    }

    /// Says what of the tile set the new one has not, and what is taken that it does not state.
    fn tell_what_changes(&self, manifest: &Manifest) {
        let (out, dest) = (self.out.display(), output::shell(&self.dest));
        if manifest.lod.is_some() {
            self.note(&format!(
                "{out} has levels of detail, which the new set has not: where cells are split there are none"
            ));
        }
        let painted = |s: &Selection| s.colour_by.is_some() || !s.painted.is_empty();
        if manifest.selection.as_ref().is_some_and(painted) {
            self.note(&format!(
                "{out} is painted, which the new set is not: `alvis select {dest} PAINTED` with --colour-by or --paint paints it"
            ));
        }
        if manifest.cells.is_none() {
            self.note(&format!(
                "cells of {out} are not split yet: taken as by `alvis convert --split`, with its defaults --split-h {} and \
                 --split-min-radius {}",
                SPLIT_H, SPLIT_MIN_RADIUS
            ));
        }
    }

    fn refuse(&self, differences: &[Difference]) -> Result<()> {
        /// The most that are told.
        const MOST: usize = 5;
        if differences.is_empty() {
            return Ok(());
        }
        let told = &differences[..differences.len().min(MOST)];
        let text = |value: fn(&Difference) -> &str| {
            let each = told.iter().map(|d| format!("{} {}", d.what, value(d)));
            each.collect::<Vec<_>>().join("; ")
        };
        let volume = self.against.as_deref().unwrap_or(Path::new(""));
        let more = match differences.len() - told.len() {
            0 => String::new(),
            n => format!("; and {n} more that differ"),
        };
        let found = format!("{}, with {}{more}", volume.display(), text(|d| &d.found));
        let expected = format!(
            "the volume that {} was made from, with {}",
            self.out.display(),
            text(|d| &d.expected)
        );
        Err(
            Error::usage("--against", found, expected).with_hint(format!(
                "give the volume itself, as it was then; nothing was written to {}",
                self.dest.display()
            )),
        )
    }

    fn note(&self, text: &str) {
        if !self.common.quiet {
            output::note(text);
        }
    }
}

/// Words of a command line.
struct Words(Vec<OsString>);

impl Words {
    /// An option, in one word with its value, which may begin as an option does.
    fn put(&mut self, name: &str, value: impl ToString) {
        self.0
            .push(format!("--{name}={}", value.to_string()).into());
    }

    fn put_if(&mut self, name: &str, value: Option<impl ToString>) {
        if let Some(value) = value {
            self.put(name, value);
        }
    }

    fn put_json(&mut self, name: &str, value: &impl Serialize) {
        let text = serde_json::to_string(value).expect("plain data serialises");
        self.put(name, text.trim_matches('"'));
    }

    fn flag(&mut self, name: &str, is: bool) {
        if is {
            self.0.push(format!("--{name}").into());
        }
    }
}

/// What the tile set states of its surface, tables and tiles.
fn settings(words: &mut Words, manifest: &Manifest) {
    words.put("threshold", manifest.threshold);
    for filter in &manifest.filters {
        match filter.values() {
            values if values.is_empty() => words.flag(filter.name(), true),
            values => words.put(filter.name(), values),
        }
    }
    let [x, y, z] = manifest.grid.macrocube;
    words.put("macrocube", format!("{x},{y},{z}"));
    words.put_json("ambiguous", &manifest.ambiguous);
    words.flag("cap", manifest.cap);
    words.put_if("min-voxels", manifest.dust.map(|dust| dust.min_voxels));
    words.put_if(
        "crop",
        manifest.source.crop.as_ref().map(|crop| {
            let range = |r: &std::ops::Range<u32>| format!("{}:{}", r.start, r.end);
            [&crop.x, &crop.y, &crop.z].map(range).join(",")
        }),
    );
    words.flag("walls", manifest.tables.walls.is_some());
    words.put_if("table-unit", manifest.table_unit.map(Unit::name));
    words.put_if(
        "tables",
        manifest.tables.parquet.as_ref().map(|_| "csv,parquet"),
    );
    words.put_json("primitives", &manifest.primitives);
    words.put_json("encoding", &manifest.encoding);
    words.put_json("layout", &manifest.layout);
}

/// How the volume was opened.
fn source(words: &mut Words, manifest: &Manifest) {
    let source = &manifest.source;
    if source.format == "raw" {
        words.put("dims", source.dims.0.map(|n| n.to_string()).join(","));
        words.put("dtype", source.dtype.name());
        words.put("endian", source.endian.name());
        words.put("offset", source.offset);
    }
    let part = &source.part;
    words.put_if("series", part.series.as_ref());
    words.flag("resample", part.resample);
    words.put_if("dataset", part.dataset.as_ref());
    words.put_if("level", part.level);
    words.put_if("channel", part.channel);
    words.put_if("time", part.time);
    let stated = source.provenance;
    let by_option = stated.spacing.contains(&Origin::Option);
    if by_option {
        let spacing = super::against::unfiltered_spacing(manifest);
        words.put("spacing", spacing.map(|size| size.to_string()).join(","));
    }
    if by_option || stated.unit == Origin::Option {
        words.put("unit", manifest.placement.unit.name());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    #[test]
    fn a_value_that_begins_as_an_option_does_is_one_word() {
        let mut words = Words(Vec::new());
        words.put("threshold", -1.5);
        words.put_if("level", None::<u32>);
        words.flag("cap", false);
        words.flag("walls", true);
        let expected: [&OsStr; 2] = ["--threshold=-1.5".as_ref(), "--walls".as_ref()];
        assert_eq!(words.0, expected);
    }
}
