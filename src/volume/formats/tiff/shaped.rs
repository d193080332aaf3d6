//! What tifffile writes into ImageDescription: the shape of a series, and what its axes are, as JSON
//! (<https://github.com/cgohlke/tifffile>).

use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::grid::length::Length;
use crate::volume::Dtype;
use crate::volume::adapters::values::Values;
use crate::volume::formats::tiff::members::Members;
use crate::volume::formats::tiff::resolution::Resolution;
use crate::volume::formats::tiff::stack::{About, Stack};
use crate::volume::stated::size::Step;
use serde_json::{Map, Value};
use std::path::Path;

/// The description of a series.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shaped {
    pub(crate) shape: Vec<u64>,
    /// A letter for every axis; empty if it is not stated.
    axes: String,
    pub(crate) truncated: bool,
    json: Map<String, Value>,
}

impl Shaped {
    /// True for the beginning of such a text.
    pub(crate) fn is_shaped(begin: &str) -> bool {
        begin.starts_with('{') || begin.starts_with("shape=(")
    }

    /// Reads a description; `None` if it is something else.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        if let Some(shape) = text.strip_prefix("shape=(") {
            let numbers = shape.split(')').next()?.split(',').map(str::trim);
            let shape = numbers.filter(|n| !n.is_empty()).map(|n| n.parse().ok());
            return Some(Shaped {
                shape: shape.collect::<Option<_>>()?,
                axes: String::new(),
                truncated: false,
                json: Map::new(),
            });
        }
        let mut json: Map<String, Value> = serde_json::from_str(text).ok()?;
        let shape = json.remove("shape")?;
        let shape = shape.as_array()?.iter().map(Value::as_u64);
        let axes = json
            .remove("axes")
            .and_then(|v| v.as_str().map(str::to_uppercase));
        Some(Shaped {
            shape: shape.collect::<Option<_>>()?,
            axes: axes.unwrap_or_default(),
            truncated: json.remove("truncated") == Some(Value::Bool(true)),
            json,
        })
    }

    /// The shape of all pages together, without samples of one entry behind x.
    fn leading(&self) -> &[u64] {
        let all = &self.shape[..];
        let samples = self.axes.ends_with('S')
            || (all.len() > 2 && all.last() == Some(&1) && !self.axes.ends_with('X'));
        let end = if samples {
            all.len().saturating_sub(3)
        } else {
            all.len().saturating_sub(2)
        };
        &all[..end]
    }

    /// Number of pages.
    pub(crate) fn planes(&self) -> u64 {
        self.leading()
            .iter()
            .fold(1, |n, len| n.saturating_mul(*len))
    }

    /// What the shape says of pages of this size.
    ///
    /// # Errors
    /// [`Error::Format`] if the shape and the pages, or the shape and its axes, contradict each other;
    /// [`Error::Unsupported`] for pages that are not planes of y and x.
    pub(crate) fn stack(&self, path: &Path, size: [u32; 2]) -> Result<Stack> {
        let text = format!(
            "a shape of {:?} with the axes \"{}\"",
            self.shape, self.axes
        );
        let leading = self.leading();
        let plane = &self.shape[leading.len()..];
        let rows = plane.first().copied().unwrap_or(0);
        let columns = plane.get(1).copied().unwrap_or(0);
        if [columns, rows] != size.map(u64::from) {
            let [x, y] = size;
            let expected = format!("one of pages of {x} x {y}, as they are");
            return Err(Error::format(
                path,
                format!("{text} in the description by tifffile"),
                expected,
            )
            .with_hint("the file was changed: save it again"));
        }
        let count = self.axes.chars().count();
        if count != 0 && count != self.shape.len() {
            return Err(Error::format(path, text, "an axis for every number"));
        }
        let axes: Vec<char> = match count {
            0 => vec!['Q'; leading.len()],
            _ => self.axes.chars().collect(),
        };
        if count != 0 && axes[leading.len()..leading.len() + 2] != ['Y', 'X'] {
            let hint = "save it with the axes ZYX, slices first";
            return Err(Error::unsupported(
                path,
                format!("{text}, of which pages are not y by x,"),
                hint,
            ));
        }
        Ok(stack(&axes, leading, size))
    }

    fn members(&self) -> Members<'_> {
        Members {
            json: &self.json,
            axes: &self.axes,
        }
    }

    /// All that the description says of sizes, to be compared.
    pub(crate) fn all_of_sizes(&self) -> String {
        self.members().of_sizes()
    }

    /// The values that samples of `stored` stand for.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the member's name if its meaning cannot be told.
    pub(crate) fn values(&self, path: &Path, stored: Dtype) -> Result<Option<Values>> {
        self.members().values(path, stored)
    }

    /// Sizes that the description states.
    pub(crate) fn sizes(&self, resolution: &Resolution, about: &mut About) {
        self.members().vague(about);
        let unit = self.json.get("unit").and_then(Value::as_str);
        let unit = unit.unwrap_or_default();
        let [x, y, z] = self.members().steps(about);
        if x.is_some() || y.is_some() {
            about.steps = [x, y, z];
            compare(resolution, about);
            return;
        }
        if unit.is_empty() && z.is_none() {
            let (steps, note) = resolution.steps();
            if resolution.unit == 2 && steps[0].is_some() {
                about.of_size(
                    "TIFF's resolution is in inch, which tifffile also puts where it is told no unit: give --spacing \
                     and --unit if that is wrong",
                );
            }
            about.steps = steps;
            about.notes_of_size.extend(note);
            return;
        }
        let one = |r: Option<crate::volume::formats::tiff::ifd::Ratio>| {
            r.is_none_or(|r| r.above == r.below)
        };
        let [x, y] = match resolution.unit {
            // tifffile puts 1 where it is given none
            _ if one(resolution.x) && one(resolution.y) => [None, None],
            2 => self.inches(resolution, unit, z.as_ref(), about),
            3 => resolution.in_unit(unit),
            _ => resolution.per(unit),
        };
        about.steps = [x, y, z];
    }

    /// Pixels per inch beside another unit. Inch is what tifffile puts where it is given none, so that they may be
    /// pixels per that unit: the distance of slices tells, since a voxel is not a hundred times as long as wide.
    fn inches(
        &self,
        resolution: &Resolution,
        unit: &str,
        depth: Option<&Step>,
        about: &mut About,
    ) -> [Option<Step>; 2] {
        let (by_inch, in_unit) = (resolution.in_unit(unit), resolution.per(unit));
        let Some(length) = Length::parse(unit) else {
            return by_inch;
        };
        let near = |steps: &[Option<Step>; 2]| near(steps[0].as_ref(), depth);
        if Some(length) == Length::parse("inch") {
            return in_unit;
        }
        match (near(&by_inch), near(&in_unit)) {
            (true, false) => by_inch,
            (false, true) => {
                about.of_size(format!(
                    "TIFF's resolution is in inch, tifffile's description in {unit}: its numbers are taken as {unit}, \
                     which fits the distance of slices; give --spacing and --unit if that is wrong"
                ));
                in_unit
            }
            _ => {
                about.of_size(format!(
                    "TIFF's resolution is in inch, tifffile's description in {unit}: none is taken, give --spacing \
                     and --unit"
                ));
                [None, None]
            }
        }
    }
}

/// True if a voxel is not a hundred times as long as wide, as far as that is known.
pub(crate) fn near(x: Option<&Step>, z: Option<&Step>) -> bool {
    let in_nm = |s: &Step| Length::parse(&s.unit).map(|l| l.convert(s.size, Unit::Nanometre));
    let sizes = (x.and_then(in_nm), z.and_then(in_nm));
    matches!(sizes, (Some(x), Some(z)) if (0.01..100.0).contains(&(x / z)))
}

/// Says that TIFF's own tags state other sizes than the description, which are not taken.
fn compare(resolution: &Resolution, about: &mut About) {
    let Some(x) = &about.steps[0] else {
        return;
    };
    let by_tags = resolution.millimetres();
    let Some([own, _]) = by_tags.filter(|_| resolution.of_paper().is_none()) else {
        return;
    };
    let Some(length) = Length::parse(&x.unit) else {
        return;
    };
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 0.01;
    let per = resolution.per("")[0]
        .as_ref()
        .is_some_and(|s| close(s.size, x.size));
    // tifffile puts inch where it is told no unit
    let as_inch = resolution.unit == 2 && per;
    if !as_inch && !close(own, length.convert(x.size, Unit::Millimetre)) {
        let note = format!(
            "TIFF's own resolution states pixels of {own} mm, tifffile's description {} {}, which is taken",
            x.size, x.unit
        );
        about.notes_of_size.push(note);
    }
}

/// Slices, channels and times of pages with these axes, the slowest first.
fn stack(axes: &[char], leading: &[u64], size: [u32; 2]) -> Stack {
    let mut counts = [1; 3];
    let (mut order, mut other) = (String::new(), None);
    let long: Vec<_> = axes
        .iter()
        .zip(leading)
        .filter(|(_, len)| **len != 1)
        .collect();
    let named = |axis: char| long.iter().any(|(a, _)| **a == axis);
    for (axis, len) in long.iter().rev() {
        let at = match axis {
            'Z' => 0,
            'C' => 1,
            'T' => 2,
            // a single axis of pages, but of colours, is that of slices
            _ if long.len() == 1 => 0,
            // of several without a name, the fastest
            'I' | 'Q' | 'D' if !named('Z') => 0,
            _ => 3,
        };
        if at == 3 || counts[at] != 1 {
            let name = match axis {
                'Q' => "entries along an axis without a name".to_owned(),
                _ => format!("entries along the axis {axis}"),
            };
            other = Some((name, **len));
            continue;
        }
        counts[at] = **len;
        order.push(['z', 'c', 't'][at]);
    }
    for axis in ['z', 'c', 't'] {
        if !order.contains(axis) {
            order.push(axis);
        }
    }
    let mut stack = Stack::new(counts, &order).unwrap_or_else(|| Stack::slices(0, size));
    stack.size = Some(size);
    stack.other = other;
    stack
}
