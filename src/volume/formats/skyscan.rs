//! The log that Bruker's (SkyScan's) NRecon writes beside its slices: `key=value` lines in sections, with the size of a
//! voxel in `Pixel Size (um)` of `[Reconstruction]`.

use crate::error::{Error, Result};
use crate::grid::Origin;
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::io::text::decoded;
use crate::volume::stated::size::{self, Step};
use crate::volume::stated::warning::Warning;
use std::io::Read;
use std::path::PathBuf;

/// Logs are shorter.
const MAX_LOG: u64 = 1 << 20;

/// What a log says of the slices.
#[derive(Debug, PartialEq)]
pub(crate) struct Log {
    name: String,
    /// Size of a pixel, in um; what stands there if that is no size.
    pixel: std::result::Result<f64, String>,
    /// Slices from one that was kept to the next.
    step: f64,
    /// The same by the numbers in the names of slices, where these have some.
    step_of_names: Option<f64>,
    /// Width and height of the slices.
    size: [Option<u64>; 2],
}

/// True for the name of the picture of the whole scan that NRecon puts beside the slices.
pub(crate) fn is_preview(name: &str) -> bool {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    stem.to_ascii_lowercase().ends_with("_spr")
}

/// The log of slices of these names, among the files beside them: that of the same name without its number, or the only
/// one.
///
/// # Errors
/// [`Error::Io`] if a log cannot be read.
pub(crate) fn find(files: &[PathBuf], names: &[String]) -> Result<Option<Log>> {
    let Some(first) = names.first() else {
        return Ok(None);
    };
    let mut found = Vec::new();
    let logs = files.iter().filter(|file| {
        file.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("log"))
    });
    for file in logs.take(100) {
        let fail = |e| Error::io(file, "read", e);
        let mut text = Vec::new();
        let log = std::fs::File::open(file).map_err(fail)?;
        log.take(MAX_LOG).read_to_end(&mut text).map_err(fail)?;
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        if let Some(log) = Log::parse(&name, &decoded(&text)) {
            let stem = file
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            found.push((first.starts_with(&stem), log));
        }
    }
    // a longer name that fits says more than one that is a part of it
    found.sort_by_key(|(fits, log)| (!*fits, std::cmp::Reverse(log.name.len())));
    let alone = found.len() == 1;
    let best = found.into_iter().next().filter(|(fits, _)| *fits || alone);
    Ok(best.map(|(_, mut log)| {
        if let [Some(first), Some(second)] = [0, 1].map(|i| names.get(i).and_then(|n| section(n))) {
            let step = second.saturating_sub(first) as f64;
            log.step_of_names = Some(step).filter(|step| *step > 0.0);
        }
        log
    }))
}

/// The number at the end of a name, in front of its extension.
fn section(name: &str) -> Option<u64> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[stem.len() - digits..].parse().ok()
}

impl Log {
    /// Reads a log; `None` if it is of something else.
    fn parse(name: &str, text: &str) -> Option<Self> {
        let mut inside = false;
        let mut values = Vec::new();
        for line in text.lines().map(str::trim) {
            if line.starts_with('[') {
                inside = line.eq_ignore_ascii_case("[reconstruction]");
            } else if inside && let Some((key, value)) = line.split_once('=') {
                values.push((key.trim(), value.trim()));
            }
        }
        let get = |key: &str| {
            values
                .iter()
                .find(|(k, _)| *k == key)
                .map(|(_, value)| *value)
        };
        let number = |text: &str| {
            // a comma is what some countries write; groups of thousands are in no log
            let number = text.replacen(',', ".", 1).parse::<f64>().ok();
            number.filter(|n| n.is_finite() && *n > 0.0)
        };
        let whole = |key: &str| get(key)?.parse().ok();
        Some(Log {
            name: name.to_owned(),
            pixel: get("Pixel Size (um)").map(|text| number(text).ok_or(text.to_owned()))?,
            step: get("Section to Section Step")
                .and_then(number)
                .unwrap_or(1.0),
            step_of_names: None,
            size: [
                whole("Result Image Width (pixels)"),
                whole("Result Image Height (pixels)"),
            ],
        })
    }

    /// Takes the size of a voxel from the log.
    pub(crate) fn apply(&self, descriptor: &mut VolumeDescriptor) {
        let name = &self.name;
        let pixel = match &self.pixel {
            Ok(pixel) => pixel,
            Err(text) => {
                descriptor.warnings.push(Warning::of_size(format!(
                    "{name} states {text:?} as the size of pixels in um, which is no size: it is not taken, give \
                     --spacing and --unit"
                )));
                return;
            }
        };
        // names count sections: of those that were thinned out later the log knows nothing
        let of_names = self.step_of_names.unwrap_or(self.step);
        let step = self.step.max(of_names);
        let of_slices = [descriptor.dims.0[0], descriptor.dims.0[1]].map(u64::from);
        let same = (0..2).all(|a| self.size[a].is_none_or(|n| n == of_slices[a]));
        if let ([Some(x), Some(y)], false) = (self.size, same) {
            let [nx, ny] = of_slices;
            descriptor.warnings.push(Warning::of_size(format!(
                "{name} states a size of {pixel} um of pixels, but of slices of {x} x {y}, and these are {nx} x {ny}: \
                 it is not taken, give --spacing and --unit"
            )));
            return;
        }
        let steps = [*pixel, *pixel, pixel * step].map(|size| Some(Step::new(size, "um")));
        let by_log = size::voxel_size(steps);
        let own = descriptor.placement;
        let stated = descriptor.provenance.spacing[0] == Origin::File
            && descriptor.provenance.unit == Origin::File;
        descriptor
            .warnings
            .retain(|warning| *warning != size::assumed_z());
        by_log.apply(&mut descriptor.placement, &mut descriptor.provenance);
        descriptor.notes.push(format!(
            "the size of a voxel is that of {name}: {pixel} um{}",
            match step {
                1.0 => String::new(),
                step => format!(", and {step} times that from slice to slice"),
            }
        ));
        if of_names < self.step {
            descriptor.warnings.push(Warning::of_size(format!(
                "{name} states {} sections from slice to slice, the numbers of the slices rise by {of_names}: {} um along z \
                 is taken, give --spacing and --unit if that is wrong",
                self.step,
                pixel * step
            )));
        }
        if stated {
            let length = crate::grid::length::Length::from(own.unit);
            let slices = length.convert(own.spacing[0], descriptor.placement.unit);
            if (slices / pixel - 1.0).abs() > 1e-3 {
                descriptor.warnings.push(Warning::of_size(format!(
                    "the slices state pixels of {slices} um, {name} {pixel} um, which is taken: give --spacing and \
                     --unit if that is wrong"
                )));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;
    use crate::volume::Dtype;
    use crate::volume::descriptor::Samples;
    use crate::volume::io::data::{Data, Encoding, Start};

    fn volume() -> VolumeDescriptor {
        let samples = Samples::Files(Data {
            files: Vec::new(),
            start: Start::behind(0),
            encoding: Encoding::Raw,
        });
        VolumeDescriptor::new("folder", Dims([4, 4, 2]), Dtype::U8, samples)
    }

    #[test]
    fn logs_state_the_size_of_the_reconstruction() {
        let text = "[Acquisition]\r\nImage Pixel Size (um)=   9.00\r\nPixel Size (um)=8\r\n[Reconstruction]\r\n\
                    Section to Section Step=2\r\nResult Image Width (pixels)=28\r\nPixel Size (um)=17.51000\r\n";
        let log = Log::parse("a.log", text).unwrap();
        assert_eq!(
            (log.pixel, log.step, log.size),
            (Ok(17.51), 2.0, [Some(28), None])
        );
        let comma = Log::parse("a.log", "[Reconstruction]\nPixel Size (um)=6,840\n");
        assert_eq!(comma.unwrap().pixel, Ok(6.84));
        for no_size in ["0", "-3", "unknown", ""] {
            let text = format!("[Reconstruction]\nPixel Size (um)={no_size}\n");
            let mut volume = volume();
            Log::parse("a.log", &text).unwrap().apply(&mut volume);
            assert_eq!(volume.provenance.spacing[0], Origin::Default, "{no_size}");
            assert!(volume.warnings[0].contains(&format!("{no_size:?}")));
        }
        let file = |step: f64, names: [&str; 2]| {
            let dir = tempfile::tempdir().unwrap();
            let log = dir.path().join("a__rec.log");
            let text =
                format!("[Reconstruction]\nPixel Size (um)=10\nSection to Section Step={step}\n");
            std::fs::write(&log, text).unwrap();
            let found = find(&[log], &names.map(str::to_owned)).unwrap().unwrap();
            let mut volume = volume();
            found.apply(&mut volume);
            let z = volume.placement.spacing[2];
            (
                z,
                volume.notes[0].contains("from slice to slice"),
                volume.warnings.len(),
            )
        };
        assert_eq!(
            file(1.0, ["a__rec0001.bmp", "a__rec0002.bmp"]),
            (10.0, false, 0)
        );
        assert_eq!(
            file(2.0, ["a__rec0001.bmp", "a__rec0003.bmp"]),
            (20.0, true, 0)
        );
        assert_eq!(
            file(1.0, ["a__rec0001.bmp", "a__rec0003.bmp"]),
            (20.0, true, 0)
        );
        assert_eq!(
            file(3.0, ["a__rec0001.bmp", "a__rec0002.bmp"]),
            (30.0, true, 1)
        );
        assert_eq!(file(3.0, ["a.bmp", "b.bmp"]), (30.0, true, 0));
        for other in ["", "Pixel Size (um)=3\n", "[Reconstruction]\nx\n"] {
            assert_eq!(Log::parse("a.log", other), None, "{other}");
        }
        assert_eq!(section("foam__rec0100.tif"), Some(100));
        assert_eq!(section("foam.tif"), None);
        assert!(is_preview("foam__rec_spr.bmp") && !is_preview("spr_0001.tif"));
    }
}
