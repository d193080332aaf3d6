//! The fields of a NRRD header that place it in space.

use crate::error::{Error, Result};
use crate::grid::{Frame, Origin, Placement, Provenance, Unit};
use crate::volume::formats::nrrd::Head;
use crate::volume::io::text::{self, Field};
use crate::volume::stated::size::{Step, VoxelSize, voxel_size};
use crate::volume::stated::warning::Warning;

/// Where the volume lies, and what a user should know of that.
#[derive(Default)]
pub(crate) struct Place {
    pub(crate) placement: Placement,
    pub(crate) provenance: Provenance,
    pub(crate) notes: Vec<String>,
    pub(crate) warnings: Vec<Warning>,
}

impl Head<'_> {
    /// Spacing, directions, origin and unit.
    pub(crate) fn place(&self) -> Result<Place> {
        let mut place = Place::default();
        if let Some(field) = self.get("space directions") {
            self.directions(field, &mut place)?;
        } else if let Some(field) = self.get("spacings") {
            self.spacings(field, &mut place)?;
        } else if self.get("axis mins").is_some() || self.get("axis maxs").is_some() {
            place.warnings.push(Warning::of_size(
                "the file states its size by axis mins and axis maxs alone, which are not taken: give --spacing \
                 and --unit",
            ));
        } else if let Some(origin) = self.origin()? {
            place.placement.origin = origin;
            place.provenance.origin = Origin::File;
        }
        // the anatomical spaces are those of DICOM and its relatives, which measure in millimetres
        let sized = place.provenance.spacing.contains(&Origin::File);
        if sized && place.provenance.unit != Origin::File && self.is_anatomical() {
            place.placement.unit = Unit::Millimetre;
        }
        Ok(place)
    }

    /// Axes as vectors in a space of its own, whose three coordinates each have a unit.
    fn directions(&self, field: Field, place: &mut Place) -> Result<()> {
        let mut vectors = self.vectors(field)?;
        let mut origin = self.origin()?.unwrap_or_default();
        let units = self.space_units()?;
        let measure = voxel_size(units.map(|unit| Some(Step::new(1.0, unit))));
        if let Some(unit) = measure.unit {
            let convert = |v: &mut f64, c: usize| {
                if let Some(length) = measure.of_file[c] {
                    *v = length.convert(*v, unit);
                }
            };
            for vector in vectors.iter_mut().chain([&mut origin]) {
                vector
                    .iter_mut()
                    .enumerate()
                    .for_each(|(c, v)| convert(v, c));
            }
            place.placement.unit = unit;
            place.provenance.unit = Origin::File;
        }
        if self.is_left_handed() {
            for vector in vectors.iter_mut().chain([&mut origin]) {
                // subtracted, so that 0 does not become -0
                vector[0] = 0.0 - vector[0];
            }
            let note = "the file's space is left-handed: its x is turned round, so that nothing is mirrored";
            place.notes.push(note.into());
        }
        let (lengths, directions) = text::axes(field, vectors)?;
        place.placement.directions = directions;
        match measure.warning {
            None => {
                place.placement.spacing = lengths;
                place.placement.origin = origin;
                place.provenance.spacing = [Origin::File; 3];
                place.provenance.origin = Origin::File;
                place.provenance.frame = self.frame();
            }
            Some(warning) => place.warnings.push(warning),
        }
        Ok(())
    }

    /// A step along each axis; one that is below 0 runs the other way.
    fn spacings(&self, field: Field, place: &mut Place) -> Result<()> {
        let spacings: [f64; 3] = field.of_axes(self.sizes.len(), self.axes)?;
        let mut units = self.units("units", self.axes)?;
        if units.iter().all(String::is_empty) {
            units = self.space_units()?;
        }
        // NaN is the format's way to say that a spacing is not known
        let [x, y, z] = std::array::from_fn(|a| {
            let size = spacings[a].abs();
            (!size.is_nan()).then(|| Step::new(size, units[a].clone()))
        });
        let size = match voxel_size([x, y, z]) {
            // a size that cannot be is refused below, with the way out
            VoxelSize { spacing: None, .. }
                if spacings.iter().any(|s| *s == 0.0 || s.is_infinite()) =>
            {
                VoxelSize {
                    spacing: Some(spacings.map(f64::abs)),
                    from: [Origin::File; 3],
                    ..VoxelSize::default()
                }
            }
            size => size,
        };
        size.apply(&mut place.placement, &mut place.provenance);
        for (axis, s) in spacings.into_iter().enumerate() {
            place.placement.directions[axis][axis] = if s < 0.0 { -1.0 } else { 1.0 };
        }
        if let Some(origin) = self.origin()? {
            place.placement.origin = match (size.unit, size.of_file[0]) {
                (Some(unit), Some(length)) => origin.map(|v| length.convert(v, unit)),
                _ => origin,
            };
            place.provenance.origin = Origin::File;
        }
        place.warnings.extend(size.warning);
        Ok(())
    }

    fn origin(&self) -> Result<Option<[f64; 3]>> {
        let Some(field) = self.get("space origin") else {
            return Ok(None);
        };
        match &vectors_in(field.text).unwrap_or_default()[..] {
            [Some(origin)] => match self.in_space(origin) {
                Some(origin) => Ok(Some(origin)),
                None => Err(field.wrong("one vector of 3 numbers: (x,y,z)")),
            },
            _ => Err(field.wrong("one vector of 3 numbers: (x,y,z)")),
        }
    }

    /// A vector of a space of three coordinates, or of one for each axis, of which those of the volume are kept.
    fn in_space(&self, vector: &[f64]) -> Option<[f64; 3]> {
        match vector.len() {
            3 => vector.try_into().ok(),
            n if n == self.sizes.len() => Some(self.axes.map(|axis| vector[axis])),
            _ => None,
        }
    }

    /// The vectors of the volume's axes; an axis without direction cannot be one of them.
    fn vectors(&self, field: Field) -> Result<[[f64; 3]; 3]> {
        let all = vectors_in(field.text).unwrap_or_default();
        let of = |axis: usize| all.get(axis)?.as_deref();
        let vector = |axis: usize| self.in_space(of(axis)?);
        if all.len() == self.sizes.len()
            && self
                .axes
                .iter()
                .any(|axis| of(*axis).is_some() && vector(*axis).is_none())
        {
            return Err(field.wrong("three vectors of 3 numbers: (x,y,z) (x,y,z) (x,y,z)"));
        }
        match self.axes.map(vector) {
            [Some(x), Some(y), Some(z)] if all.len() == self.sizes.len() => Ok([x, y, z]),
            _ if all.len() == self.sizes.len() => Err(Error::unsupported(
                field.path,
                "a NRRD with an axis outside space (`none`)",
                "volumes have 3 axes in space and one number per voxel",
            )),
            _ => Err(field.wrong("three vectors of 3 numbers: (x,y,z) (x,y,z) (x,y,z)")),
        }
    }

    /// The units of three axes in a field; empty where it states none.
    fn units(&self, name: &'static str, axes: [usize; 3]) -> Result<[String; 3]> {
        let Some(field) = self.get(name) else {
            return Ok(Default::default());
        };
        let names: Vec<&str> = if field.text.contains('"') {
            field.text.split('"').skip(1).step_by(2).collect()
        } else {
            field.text.split_whitespace().collect()
        };
        if names.len() <= axes[2] {
            return Err(field.wrong("a unit for each axis"));
        }
        Ok(axes.map(|axis| match names[axis] {
            "???" | "none" => String::new(),
            name => name.to_owned(),
        }))
    }

    /// The units of the coordinates of space.
    fn space_units(&self) -> Result<[String; 3]> {
        let of_all = self
            .get("space dimension")
            .and_then(|f| f.text.trim().parse().ok());
        match of_all == Some(self.sizes.len()) {
            true => self.units("space units", self.axes),
            false => self.units("space units", [0, 1, 2]),
        }
    }

    fn space(&self) -> String {
        let text = self.get("space").map_or("", |field| field.text);
        text.trim().to_ascii_lowercase()
    }

    /// True for the spaces of DICOM and its relatives.
    fn is_anatomical(&self) -> bool {
        let names = [
            "right-anterior-superior",
            "left-anterior-superior",
            "left-posterior-superior",
            "scanner-xyz",
            "ras",
            "las",
            "lps",
        ];
        names.contains(&self.space().as_str())
    }

    /// Which way the axes of space run, when those of a left hand are turned.
    fn frame(&self) -> Frame {
        match self.space().as_str() {
            "left-posterior-superior" | "lps" => Frame::Lps,
            "right-anterior-superior" | "ras" | "left-anterior-superior" | "las" => Frame::Ras,
            _ => Frame::Unstated,
        }
    }

    /// True for the spaces whose axes are those of a left hand.
    fn is_left_handed(&self) -> bool {
        ["left-anterior-superior", "las", "3d-left-handed"].contains(&self.space().as_str())
    }
}

/// `none` or `(x,y,z)`, any number of times.
fn vectors_in(text: &str) -> Option<Vec<Option<Vec<f64>>>> {
    let mut rest = text.trim_start();
    let mut vectors = Vec::new();
    while !rest.is_empty() {
        let after = if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            after
        } else {
            let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
            let numbers: Option<Vec<f64>> =
                inside.split(',').map(|n| n.trim().parse().ok()).collect();
            let vector = numbers?;
            vector.iter().all(|v| v.is_finite()).then_some(())?;
            vectors.push(Some(vector));
            after
        };
        rest = after.trim_start();
    }
    Some(vectors)
}
