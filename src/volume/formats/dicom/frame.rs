//! What a DICOM file says of its frames.

use crate::error::{Error, Result};
use crate::grid::MAX_DIM;
use crate::volume::formats::dicom::cell::Cell;
use crate::volume::formats::dicom::element::{self, Elements, Header};
use crate::volume::formats::dicom::syntax::Syntax;
use crate::volume::formats::dicom::tag;
use crate::volume::io::blob::Blob;
use std::path::{Path, PathBuf};

/// The physical value of a stored number s is slope * s + intercept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rescale {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

/// Where a frame lies, in millimetres of the patient's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    /// Centre of the first pixel.
    pub(crate) position: [f64; 3],
    /// Unit vectors along a row (x) and along a column (y).
    pub(crate) axes: [[f64; 3]; 2],
}

/// One slice.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    /// Index of the file.
    pub(crate) file: u32,
    /// Number of the frame in its file.
    pub(crate) index: u32,
    pub(crate) plane: Option<Plane>,
    /// Distance of pixels along x and y.
    pub(crate) pixel: Option<[f64; 2]>,
    pub(crate) rescale: Rescale,
    /// What the file states of values.
    pub(crate) stated: Stated,
    /// Where the file states the scale; empty if stored numbers are the values.
    pub(crate) scaled_by: &'static str,
    /// What a user should know of it.
    pub(crate) remark: Option<&'static str>,
}

/// Which elements on values are there, and the units that they state.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Stated {
    /// RescaleSlope, RescaleIntercept, RealWorldValueMapping, DoseGridScaling.
    pub(crate) scale: [bool; 4],
    /// RescaleType, Units, MeasurementUnitsCodeSequence, DoseUnits; empty if not stated.
    pub(crate) units: [String; 4],
}

/// How the frames of a file without a position for each follow each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Step {
    /// The file states their distance, or a position for each.
    Stated,
    /// As far as the slices are thick, in millimetres.
    Thickness(f64),
    Unknown,
}

/// What a sound file is.
pub(crate) enum Found {
    Image(Box<Image>),
    /// No image, as a report, or one that was cut off before its pixels.
    NoPixels {
        path: PathBuf,
        class: String,
    },
}

/// A file with pixels.
#[derive(Debug)]
pub(crate) struct Image {
    pub(crate) blob: Blob,
    /// What kind of object it is (SOPClassUID); may be empty.
    pub(crate) class: String,
    pub(crate) instance: String,
    pub(crate) series: Series,
    pub(crate) size: [u32; 2],
    pub(crate) cell: Cell,
    pub(crate) syntax: Syntax,
    /// Position of the pixels in the data set, and their bytes unless in fragments.
    pub(crate) pixels: (u64, Option<u64>),
    /// Where the packed data set begins, if it is packed as a whole.
    pub(crate) deflated: Option<u64>,
    /// The stored numbers, first and last, of voxels outside of what was scanned.
    pub(crate) padding: Option<[i64; 2]>,
    /// Distance of slices where no positions tell it.
    pub(crate) between: Option<f64>,
    /// How that is known, for a file of several frames.
    pub(crate) step: Step,
    /// Its frames follow each other in time, and no position is of one frame alone.
    pub(crate) in_time: bool,
    /// Small numbers are bright (MONOCHROME1).
    pub(crate) inverse: bool,
    /// A view to plan the scan by (LOCALIZER in ImageType).
    pub(crate) localizer: bool,
    /// The file's number in its series.
    pub(crate) number: Option<i64>,
    pub(crate) frames: Vec<Frame>,
}

/// What names a series.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Series {
    pub(crate) number: String,
    pub(crate) uid: String,
    pub(crate) description: String,
    pub(crate) modality: String,
}

/// A header and how its faults are told.
pub(crate) struct Context<'a> {
    pub(crate) path: &'a Path,
    pub(crate) set: &'a Elements,
}

impl Image {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Format`] for damage, [`Error::Unsupported`] by name for colours, odd sizes of pixels
    /// and encodings that are not decoded.
    pub(crate) fn read(blob: Blob, file: u32) -> Result<Found> {
        let header = element::read(&blob)?;
        let Some((kind, position, len)) = header.pixels else {
            return Ok(Found::NoPixels {
                path: blob.path().to_path_buf(),
                class: header.class,
            });
        };
        let at = Context {
            path: blob.path(),
            set: &header.elements,
        };
        let size = [at.extent(tag::COLUMNS)?, at.extent(tag::ROWS)?];
        let cell = Cell::read(&at, kind, header.endian)?;
        let syntax = Syntax::find(blob.path(), &header.syntax)?;
        if syntax.is_packed() == len.is_some() {
            let found = format!("pixels in the transfer syntax {}", header.syntax);
            let how = ["fragments", "one piece"][usize::from(len.is_none())];
            return Err(Error::format(blob.path(), found, format!("them in {how}")));
        }
        let count = at.count()?;
        at.check_length(&header, size, cell, count, blob.len())?;
        let mut frames = at.frames(file, count)?;
        let (between, step) = at.step();
        let stepped = at.spread(&mut frames, between)?;
        let step = if stepped { step } else { Step::Stated };
        let in_time = stepped && count > 1 && at.points_to_time();
        let set = &header.elements;
        Ok(Found::Image(Box::new(Image {
            class: header.class.clone(),
            instance: set.text(tag::SOP_INSTANCE),
            series: Series::read(set),
            size,
            cell,
            syntax,
            pixels: (position, len),
            deflated: header.deflated,
            padding: at.padding(cell),
            between,
            step,
            in_time,
            inverse: set.text(tag::PHOTOMETRIC).starts_with("MONOCHROME1"),
            localizer: set.text(tag::IMAGE_TYPE).contains("LOCALIZER"),
            number: set.number(tag::INSTANCE_NUMBER).map(|n| n as i64),
            frames,
            blob,
        })))
    }
}

impl Series {
    fn read(set: &Elements) -> Series {
        Series {
            number: set.text(tag::SERIES_NUMBER),
            uid: set.text(tag::SERIES_UID),
            description: set.text(tag::SERIES_DESCRIPTION),
            modality: set.text(tag::MODALITY),
        }
    }
}

impl Context<'_> {
    pub(crate) fn wrong(&self, found: String, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn extent(&self, tag: u32) -> Result<u32> {
        let side = if tag == tag::ROWS { "Rows" } else { "Columns" };
        match self.set.short(tag) {
            Some(n) if n > 0 && u32::from(n) <= MAX_DIM => Ok(n.into()),
            found => Err(self.wrong(format!("{side} of {found:?}"), "a number of pixels")),
        }
    }

    fn count(&self) -> Result<u32> {
        let text = self.set.text(tag::FRAMES);
        match text.trim() {
            "" => Ok(1),
            text => match text.parse() {
                Ok(n @ 1..=MAX_DIM) => Ok(n),
                _ => Err(self.wrong(format!("\"{text}\" frames"), "1 to 65536")),
            },
        }
    }

    /// The stored numbers, first and last, of voxels outside of what was scanned.
    fn padding(&self, cell: Cell) -> Option<[i64; 2]> {
        let first = self.set.short(tag::PADDING).filter(|_| !cell.float)?;
        let last = self.set.short(tag::PADDING_LIMIT).unwrap_or(first);
        let mut ends = [first, last].map(|v| match cell.signed {
            true => i64::from(v as i16),
            false => i64::from(v),
        });
        ends.sort();
        Some(ends)
    }

    /// Pixels in one piece must be all there.
    fn check_length(
        &self,
        header: &Header,
        size: [u32; 2],
        cell: Cell,
        count: u32,
        file: u64,
    ) -> Result<()> {
        let Some((_, position, Some(len))) = header.pixels else {
            return Ok(());
        };
        let slice = u64::from(size[0]) * u64::from(size[1]) * cell.bytes as u64;
        let need = slice * u64::from(count);
        // what is packed is found short when it is unpacked; no byte unpacks to more than 1032
        let there = match header.deflated {
            Some(_) => file.saturating_mul(1032),
            None => file.saturating_sub(position),
        };
        if len < need || need > there {
            let found = format!("{} bytes of pixels", len.min(there));
            let [x, y] = size;
            let expected = format!(
                "{need}, for {count} frames of {x} x {y} of {} bytes",
                cell.bytes
            );
            return Err(Error::format(self.path, found, expected)
                .with_hint("the file is cut short or damaged"));
        }
        Ok(())
    }

    fn frames(&self, file: u32, count: u32) -> Result<Vec<Frame>> {
        let shared = self.set.items(tag::SHARED).first();
        let each = self.set.items(tag::PER_FRAME);
        if !each.is_empty() && each.len() != count as usize {
            let found = format!("{count} frames and the places of {}", each.len());
            return Err(self.wrong(found, "one place for each"));
        }
        if self.set.has(tag::LOOKUP) {
            let what = "a DICOM image with a table of values (Modality LUT)";
            return Err(Error::unsupported(
                self.path,
                what,
                "convert it to plain values",
            ));
        }
        (0..count)
            .map(|index| {
                let groups = Groups {
                    own: each.get(index as usize),
                    shared,
                    top: self.set,
                };
                let scale = self.scale(&groups)?;
                Ok(Frame {
                    file,
                    index,
                    plane: self.plane(&groups)?,
                    pixel: self.pixel(&groups)?,
                    rescale: scale.rescale,
                    stated: self.stated(&groups),
                    scaled_by: scale.by,
                    remark: scale.remark,
                })
            })
            .collect()
    }

    /// True if the frames are told apart by their time.
    fn points_to_time(&self) -> bool {
        let of = |tag| self.set.pointer(tag);
        matches!(
            of(tag::FRAME_POINTER),
            Some(tag::FRAME_TIME | tag::FRAME_TIME_VECTOR)
        )
    }

    /// Distance of frames without a position for each, and how it is known.
    fn step(&self) -> (Option<f64>, Step) {
        let shared = self.set.items(tag::SHARED).first();
        let groups = Groups {
            own: None,
            shared,
            top: self.set,
        };
        let number = |tag: u32| {
            let set = groups.find(tag::PIXEL_MEASURES, tag)?;
            set.number(tag).map(f64::abs).filter(|v| *v > 0.0)
        };
        match (number(tag::SPACING_BETWEEN_SLICES), number(tag::THICKNESS)) {
            (Some(between), _) => (Some(between), Step::Stated),
            (None, Some(thick)) => (Some(thick), Step::Thickness(thick)),
            (None, None) => (None, Step::Unknown),
        }
    }

    /// Frames that share one position follow each other along the normal: at the offsets that the file states, else
    /// at equal steps, of 1 mm where none is known. True if a step is all that tells where they lie.
    fn spread(&self, frames: &mut [Frame], step: Option<f64>) -> Result<bool> {
        let each = self.set.items(tag::PER_FRAME);
        let own = each
            .iter()
            .any(|group| !group.items(tag::PLANE_POSITION).is_empty());
        if own || frames.len() < 2 {
            return Ok(false);
        }
        let offsets = match self.set.has(tag::FRAME_OFFSETS) {
            false => None,
            true => match self.set.list(tag::FRAME_OFFSETS) {
                Some(offsets) if offsets.len() == frames.len() => Some(offsets),
                found => {
                    let found = found.map_or(0, |offsets| offsets.len());
                    let found = format!("{} frames and the offsets of {found}", frames.len());
                    return Err(self.wrong(found, "one offset for each"));
                }
            },
        };
        for (k, frame) in frames.iter_mut().enumerate() {
            let Some(plane) = &mut frame.plane else {
                return Ok(true);
            };
            let [row, column] = plane.axes.map(glam::DVec3::from);
            let normal = row.cross(column);
            let depth = match &offsets {
                None => k as f64 * step.unwrap_or(1.0),
                // from the first frame along the normal, or else as z of the patient
                Some(all) if all[0] == 0.0 => all[k],
                Some(all) => (all[k] - all[0]) * normal.z.signum(),
            };
            plane.position = (glam::DVec3::from(plane.position) + normal * depth).into();
        }
        Ok(offsets.is_none())
    }

    fn plane(&self, groups: &Groups) -> Result<Option<Plane>> {
        let position = groups.find(tag::PLANE_POSITION, tag::POSITION);
        let axes = groups.find(tag::PLANE_ORIENTATION, tag::ORIENTATION);
        let (Some(position), Some(axes)) = (position, axes) else {
            return Ok(None);
        };
        let place = position.numbers::<3>(tag::POSITION);
        let turn = axes.numbers::<6>(tag::ORIENTATION);
        let (Some(position), Some([a, b, c, d, e, f])) = (place, turn) else {
            let found = "a position or orientation of the image that is no numbers";
            return Err(self.wrong(found.into(), "3 and 6 finite numbers"));
        };
        let [row, column] = [glam::DVec3::new(a, b, c), glam::DVec3::new(d, e, f)];
        let unit = |v: glam::DVec3| (v.length() - 1.0).abs() < 1e-2;
        if !unit(row) || !unit(column) || row.dot(column).abs() > 1e-3 {
            let found = format!("the orientation {a}, {b}, {c}, {d}, {e}, {f}");
            return Err(self.wrong(found, "two unit vectors at right angles"));
        }
        let row = row.normalize();
        let column = (column - row * row.dot(column)).normalize();
        Ok(Some(Plane {
            position,
            axes: [row.into(), column.into()],
        }))
    }

    fn pixel(&self, groups: &Groups) -> Result<Option<[f64; 2]>> {
        let Some(set) = groups.find(tag::PIXEL_MEASURES, tag::PIXEL_SPACING) else {
            return Ok(None);
        };
        match set.numbers::<2>(tag::PIXEL_SPACING) {
            // from row to row comes first
            Some([y, x]) if x > 0.0 && y > 0.0 => Ok(Some([x, y])),
            _ => {
                let found = format!("PixelSpacing \"{}\"", set.text(tag::PIXEL_SPACING));
                Err(self.wrong(found, "two numbers above 0"))
            }
        }
    }
}

/// The places in which a frame's properties may stand.
pub(crate) struct Groups<'a> {
    own: Option<&'a Elements>,
    shared: Option<&'a Elements>,
    top: &'a Elements,
}

impl<'a> Groups<'a> {
    /// The set that has `tag`, in the functional group `group` or at the top.
    pub(crate) fn find(&self, group: u32, tag: u32) -> Option<&'a Elements> {
        let inside = |set: &'a Elements| set.items(group).first().filter(|s| s.has(tag));
        let own = self.own.and_then(inside);
        let shared = || self.shared.and_then(inside);
        own.or_else(shared)
            .or(Some(self.top).filter(|s| s.has(tag)))
    }

    /// The items of a group that is a sequence of them.
    pub(crate) fn items(&self, group: u32) -> &'a [Elements] {
        let places = [self.own, self.shared, Some(self.top)];
        let found = places.into_iter().flatten().map(|set| set.items(group));
        found
            .into_iter()
            .find(|items| !items.is_empty())
            .unwrap_or(&[])
    }
}

impl Rescale {
    /// Numbers are values.
    pub(crate) const NONE: Rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };

    /// The value of a stored number.
    pub(crate) fn value(self, stored: f64) -> f64 {
        self.slope * stored + self.intercept
    }
}
