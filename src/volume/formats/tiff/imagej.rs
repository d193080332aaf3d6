//! ImageJ's description of a stack: lines of `key=value`, as `ij.io.FileSaver` and `ij.io.TiffEncoder` write and
//! `ij.io.FileOpener` reads them (<https://github.com/imagej/ImageJ>). SCIFIO writes the same keys.

use crate::error::{Error, Result};
use crate::grid::length::{Length, tidy};
use crate::volume::formats::tiff::resolution::Resolution;
use crate::volume::formats::tiff::shaped::near;
use crate::volume::formats::tiff::stack::{About, Stack, other_count};
use crate::volume::stated::size::Step;
use crate::words::things;
use std::path::Path;

/// The lines of a description.
pub(crate) struct Text<'a>(&'a str);

impl<'a> Text<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        Text(text)
    }

    /// True for a description of this kind.
    pub(crate) fn is(text: &str) -> bool {
        text.starts_with("ImageJ=") || text.starts_with("SCIFIO=")
    }

    /// The value of a key; as Java's properties, the last of several counts.
    pub(crate) fn get(&self, key: &str) -> Option<&'a str> {
        let lines = self.0.lines().rev();
        let mut values = lines.filter_map(|line| {
            line.trim()
                .strip_prefix(key)?
                .trim_start()
                .strip_prefix('=')
        });
        values.next().map(str::trim)
    }

    pub(crate) fn number(&self, key: &str) -> Option<f64> {
        self.get(key)?.parse().ok().map(tidy)
    }

    fn whole(&self, key: &str) -> Option<u64> {
        // ImageJ reads them as numbers of any form
        let number = self.number(key).filter(|n| (1.0..1e15).contains(n));
        number.map(|n| n as u64)
    }

    /// All that the text says of sizes, to be compared.
    pub(crate) fn all_of_sizes(&self) -> String {
        let keys = ["unit", "yunit", "zunit", "spacing"];
        keys.map(|key| self.get(key).unwrap_or_default()).join("\n")
    }

    /// What the text says of `pages` pages of `first`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for other axes than slices, channels and times, [`Error::Format`] if the numbers
    /// contradict each other.
    pub(crate) fn stack(&self, path: &Path, pages: u64) -> Result<Stack> {
        let counts = ["slices", "channels", "frames"].map(|key| self.whole(key));
        let product = |counts: [u64; 3]| counts.iter().try_fold(1u64, |n, c| n.checked_mul(*c));
        let images = self.whole("images");
        let counts = match counts {
            [None, None, None] => [images.unwrap_or(pages), 1, 1],
            counts => counts.map(|n| n.unwrap_or(1)),
        };
        if product(counts) != Some(images.unwrap_or(pages)) {
            let [slices, channels, frames] = counts;
            let found = format!(
                "{}, {} and {}",
                things(slices, "slice"),
                things(channels, "channel"),
                things(frames, "frame")
            );
            let stated = slices.saturating_mul(channels).saturating_mul(frames);
            let hint = other_count(images.unwrap_or(pages), stated);
            let expected = match images {
                Some(images) => format!("{images} images, as ImageJ's description says"),
                None => format!("the {pages} pages that there are"),
            };
            return Err(Error::format(path, found, expected).with_hint(hint));
        }
        let order = self.get("order").unwrap_or("czt").to_ascii_lowercase();
        let order = if order == "default" { "czt" } else { &order };
        Stack::new(counts, order).ok_or_else(|| {
            let what = format!("ImageJ's order of pages \"{order}\"");
            Error::unsupported(path, what, "save it again in ImageJ")
        })
    }

    /// Sizes that the text states, of a stack or of one slice of it.
    pub(crate) fn sizes(&self, resolution: &Resolution, one_slice: bool, about: &mut About) {
        about.zero = self.zero();
        let unit = self.get("unit").unwrap_or_default();
        let length = Length::parse(unit);
        let depth = self.number("spacing").map(f64::abs).filter(|d| *d > 0.0);
        if length == Length::parse("inch") {
            let as_inch = Resolution {
                unit: 2,
                ..*resolution
            };
            if let Some(note) = as_inch.note_of_paper() {
                about.notes_of_size.push(note);
                return;
            }
        }
        let [mut x, mut y] = self.pixels(resolution, unit, about);
        let of_z = self.of_axis("zunit", unit);
        if unit.is_empty() && resolution.millimetres().is_some() {
            self.without_unit(resolution, depth, about);
            return;
        }
        if length.is_none() {
            // without a unit ImageJ's pixels are 1 wide, unless they are not square
            let plain = |s: &Option<Step>| s.as_ref().is_none_or(|s| s.size == 1.0);
            if plain(&x) && plain(&y) && depth.is_none() {
                return;
            }
            x = x.or(Some(Step::new(1.0, unit)));
            y = y.or(Some(Step::new(1.0, unit)));
        }
        let cube = [&x, &y]
            .iter()
            .all(|s| s.as_ref().is_some_and(|s| s.size == 1.0 && s.unit == unit));
        let z = match depth {
            Some(depth) => Some(Step::new(depth, of_z)),
            // 1 is what ImageJ does not write
            None if cube && !one_slice => Some(Step::new(1.0, of_z)),
            None => None,
        };
        if z.is_none() && x.is_some() && !one_slice {
            about.z_if_none = Some(Step::new(1.0, of_z));
        }
        about.steps = [x, y, z];
    }

    /// Sizes by a resolution that has a unit where the text has none. ImageJ itself takes such numbers without a unit.
    fn without_unit(&self, resolution: &Resolution, depth: Option<f64>, about: &mut About) {
        if let Some(note) = resolution.note_of_paper() {
            about.notes_of_size.push(note);
            if depth.is_some_and(|depth| depth != 1.0) {
                about.steps[2] = depth.map(|depth| Step::new(depth, ""));
            }
            return;
        }
        let of_tag = if resolution.unit == 2 { "inch" } else { "cm" };
        let [x, y] = resolution.in_unit("mm");
        let z = depth.map(|depth| Step::new(depth, of_tag));
        let advice = "give --spacing and --unit";
        if z.is_some() && !near(x.as_ref(), z.as_ref()) {
            about.of_size(format!(
                "TIFF's resolution is in {of_tag}, ImageJ's description states no unit, and its distance of slices \
                 does not fit {of_tag}: none is taken, {advice}"
            ));
            return;
        }
        about.of_size(format!(
            "TIFF's resolution is in {of_tag}, ImageJ's description states no unit: its numbers are taken in {of_tag}, \
             {advice} if that is wrong"
        ));
        about.steps = [x, y, z];
    }

    /// The voxel at the origin of ImageJ's coordinates, where the text states one.
    fn zero(&self) -> Option<[f64; 3]> {
        let all = ["xorigin", "yorigin", "zorigin"].map(|key| self.number(key));
        let stated = all.iter().any(|n| n.is_some_and(|n| n != 0.0));
        stated.then(|| all.map(|n| n.unwrap_or(0.0)))
    }

    /// The unit of an axis, where it has one of its own.
    fn of_axis<'b>(&'b self, key: &str, unit: &'b str) -> &'b str {
        self.get(key).filter(|u| !u.is_empty()).unwrap_or(unit)
    }

    /// Sizes of a pixel by the resolution, of which the text states the unit.
    fn pixels(&self, resolution: &Resolution, unit: &str, about: &mut About) -> [Option<Step>; 2] {
        let length = Length::parse(unit);
        let of_tag = match resolution.unit {
            2 => "inch",
            3 => "cm",
            _ => unit,
        };
        if length.is_some() && length != Length::parse(of_tag) {
            // centimetres in the tags and um in the text: ImageJ converts
            if of_tag == "cm" && length == Length::parse("um") {
                return resolution.in_unit(unit);
            }
            about.of_size(format!(
                "TIFF's resolution is in {of_tag}, ImageJ's description in {unit}: the numbers are taken as {unit}, as \
                 ImageJ does; give --spacing and --unit if that is wrong"
            ));
        }
        let [x, y] = resolution.per(unit);
        let named =
            |step: Option<Step>, key| step.map(|s| Step::new(s.size, self.of_axis(key, unit)));
        [named(x, "xunit"), named(y, "yunit")]
    }
}
