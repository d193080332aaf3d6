//! The size of a voxel that attributes state, in HDF5 and Zarr.
//!
//! Three different numbers are taken where their order is stated: by the names of the axes, by an attribute beside
//! them, or by the one who writes an attribute of that name. A unit may be in the attribute's name, in its text, or in
//! an attribute beside it.

use crate::grid::length::Length;
use crate::volume::stated::size::Step;
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::name::Name;
use crate::volume::stated::written::quantity::{Sizes, cleaned, sizes};
use crate::volume::stated::written::unit::UnitBeside;
use crate::volume::stated::written::{Held, Written, axis_letter, plain};

/// Which axes of an array x, y and z are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    pub(crate) volume: [usize; 3],
    /// Axes of the array.
    pub(crate) axes: usize,
    /// The file names all of x, y and z, so that numbers for the axes are in that order.
    pub(crate) named: bool,
}

/// What attributes state.
#[derive(Debug, Default)]
pub(crate) struct SizeFound {
    /// Of x, y and z, if they state it.
    pub(crate) steps: Option<[Option<Step>; 3]>,
    pub(crate) notes: Vec<String>,
    /// What they state and is not taken.
    pub(crate) warnings: Vec<Warning>,
}

impl SizeFound {
    /// What to say if these attributes state another size than coordinates do, which are taken.
    pub(crate) fn contradicts(&self, taken: &[Option<Step>; 3]) -> Option<Warning> {
        let own = self.steps.as_ref().filter(|own| differ(own, taken))?;
        let sizes = own
            .iter()
            .flatten()
            .map(|step| format!("{} {}", step.size, step.unit));
        let sizes: Vec<String> = sizes.map(|size| size.trim().to_owned()).collect();
        Some(Warning::of_size(format!(
            "the {} ({}) contradicts the coordinates of the axes, which are taken: give --spacing and --unit if that \
             is wrong",
            self.notes.concat(),
            sizes.join(", ")
        )))
    }

    /// The same of a group that holds arrays of several sizes: of which it is cannot be told.
    pub(crate) fn of_several(self) -> Self {
        let what = self.notes.concat();
        SizeFound {
            warnings: vec![Warning::of_size(format!(
                "the {what}, which holds arrays of several sizes, is not taken: give --spacing and --unit"
            ))],
            ..SizeFound::default()
        }
    }
}

/// The size of a voxel by the attributes of the array, or of a group that it is in, which `of` says then.
pub(crate) fn size(written: &Written, grid: Grid, of: &str) -> SizeFound {
    let mut reader = Reader {
        written,
        grid,
        of,
        found: Vec::new(),
        parts: [const { None }; 3],
        warnings: Vec::new(),
    };
    for (name, held) in &written.0 {
        if let Some(known) = Name::of(name) {
            reader.look(&known, name, held);
        }
    }
    reader.end()
}

struct Reader<'a> {
    written: &'a Written,
    grid: Grid,
    of: &'a str,
    /// Steps along x, y and z, and the attribute that states them.
    found: Vec<([Option<Step>; 3], String)>,
    /// The same of one axis each.
    parts: [Option<(Step, String)>; 3],
    warnings: Vec<Warning>,
}

impl Reader<'_> {
    fn not_taken(&mut self, name: &str, held: &Held, why: &str) {
        let of = self.of;
        self.warnings.push(Warning::of_size(format!(
            "the attribute {name} ({held}){of} {why}: give --spacing and --unit if it is the size of a voxel"
        )));
    }

    /// Looks at an attribute whose name is that of a size.
    fn look(&mut self, known: &Name, name: &str, held: &Held) {
        let Some(sizes) = sizes(held) else {
            if known.sure {
                self.not_taken(name, held, "is not understood and not taken");
            }
            return;
        };
        // a number alone may be a scale of values, of which is told elsewhere
        if known.base == "scale" && sizes.len() == 1 && known.axis.is_none() {
            return;
        }
        let Some(sizes) = self.with_units(known, name, held, sizes) else {
            return;
        };
        let no_unit = "states no unit and is not taken";
        if sizes.iter().all(|(_, unit)| unit.is_empty()) && !known.sure {
            return self.not_taken(name, held, no_unit);
        }
        let step = |at: usize| sizes.get(at).map(|(size, unit)| Step::new(*size, unit));
        if let (Some(axis), 1) = (known.axis, sizes.len()) {
            self.parts[axis] = step(0).map(|step| (step, name.to_owned()));
            return;
        }
        // as in TIFF, where it is a number of pixels
        let per = |unit: &str| {
            ["in", "cm"]
                .map(Length::parse)
                .contains(&Length::parse(unit))
        };
        if known.base == "resolution" && sizes.iter().any(|(_, unit)| per(unit)) {
            let why = "may be voxels per inch or centimetre and is not taken";
            return self.not_taken(name, held, why);
        }
        let places = match self.places(known, &sizes) {
            Ok(places) => places,
            Err(why) => return self.not_taken(name, held, &why),
        };
        let steps = places.map(|at| at.and_then(step));
        if !known.sure && steps.iter().flatten().any(|step| step.unit.is_empty()) {
            return self.not_taken(name, held, no_unit);
        }
        self.found.push((steps, name.to_owned()));
    }

    /// Which of the numbers are those of x, y and z.
    fn places(&self, known: &Name, sizes: &Sizes) -> Result<[Option<usize>; 3], String> {
        let same = sizes.iter().all(|size| *size == sizes[0]);
        let (n, volume) = (sizes.len(), self.grid.volume);
        let order = self.order(known, n);
        match (n, order) {
            (1, _) => Ok([Some(0); 3]),
            (2, _) if same => Ok([Some(0), Some(1), None]),
            (3, _) if same => Ok([Some(0); 3]),
            (_, Some(order)) => Ok(order.map(Some)),
            // by the writers of this one, whatever the axes
            (3, None) if known.base == "elementsize" && known.unit == Some("um") => {
                Ok([Some(2), Some(1), Some(0)])
            }
            (3, None) if self.grid.named => {
                Ok(volume.map(|axis| Some(volume.iter().filter(|a| **a < axis).count())))
            }
            (n, None) if n == self.grid.axes && (self.grid.named || n > 3) => Ok(volume.map(Some)),
            (3, None) => Err(no_order(sizes)),
            _ => Err("has not one number for each axis and is not taken".into()),
        }
    }

    /// Places of x, y and z by an attribute beside the size that names the order of its numbers.
    fn order(&self, known: &Name, n: usize) -> Option<[usize; 3]> {
        let base = known.base.strip_suffix("scale").unwrap_or(&known.base);
        let held = ["order", "axes", "axisorder", "axis", "dims"]
            .iter()
            .find_map(|end| Some(self.written.like(&format!("{base}{end}"))?.1))
            .filter(|_| !base.is_empty())?;
        let Held::Texts(texts) = held else {
            return None;
        };
        let names: Vec<String> = match &texts[..] {
            [one] if plain(one).len() == n => plain(one).chars().map(String::from).collect(),
            [one] => one.split([',', ' ']).map(str::to_owned).collect(),
            many => many.to_vec(),
        };
        let at = |a| names.iter().position(|name| axis_letter(name) == Some(a));
        (names.len() == n).then_some([at(0)?, at(1)?, at(2)?])
    }

    /// The sizes with their units: those of the attribute's name or text, or of an attribute beside it.
    fn with_units(&mut self, known: &Name, name: &str, held: &Held, sizes: Sizes) -> Option<Sizes> {
        let own = |unit: &str| {
            sizes
                .iter()
                .map(|(size, _)| (*size, unit.to_owned()))
                .collect()
        };
        if let Some(unit) = known.unit {
            return Some(own(unit));
        }
        if sizes.iter().any(|(_, unit)| !unit.is_empty()) {
            return Some(sizes);
        }
        let base = known
            .base
            .trim_end_matches("dimensions")
            .trim_end_matches("value");
        let base = base.strip_suffix("scale").unwrap_or(base);
        let Some(UnitBeside {
            by,
            texts,
            of_anything,
        }) = self.written.unit_beside(&[&known.base, base])
        else {
            return Some(sizes);
        };
        let all_same = texts.iter().all(|text| *text == texts[0]);
        let units: Option<Vec<String>> = match texts.len() {
            // of those that are no axes of space, anything
            n if n == sizes.len() && !all_same => Some(
                texts
                    .iter()
                    .map(|text| cleaned(text).unwrap_or_else(|| text.clone()))
                    .collect(),
            ),
            _ if all_same => cleaned(&texts[0]).map(|unit| vec![unit; sizes.len()]),
            _ => None,
        };
        if let Some(units) = units {
            return Some(sizes.into_iter().map(|(size, _)| size).zip(units).collect());
        }
        let said = Held::Texts(texts);
        if !of_anything {
            self.not_taken(
                name,
                held,
                &format!("has a unit that is not known ({by}: {said}) and is not taken"),
            );
            return None;
        }
        if known.sure {
            self.warnings.push(Warning::of_size(format!(
                "the attribute {name} ({held}){} is taken without a unit, as {by} ({said}) is none of length: give \
                 --unit, or --spacing and --unit",
                self.of
            )));
        }
        Some(sizes)
    }

    /// What all attributes together state.
    fn end(mut self) -> SizeFound {
        if self.parts.iter().any(Option::is_some) {
            let names = self.parts.iter().flatten().map(|(_, name)| name.as_str());
            let names = names.collect::<Vec<_>>().join(", ");
            let steps = self.parts.map(|part| part.map(|(step, _)| step));
            self.found.push((steps, names));
        }
        // a size with a unit says more than one without
        self.found
            .sort_by_key(|(steps, _)| steps.iter().flatten().any(|step| step.unit.is_empty()));
        let mut found = self.found.into_iter();
        let Some((steps, name)) = found.next() else {
            return SizeFound {
                warnings: self.warnings,
                ..SizeFound::default()
            };
        };
        let of = self.of;
        let mut result = SizeFound {
            notes: vec![format!("size of a voxel by the attribute {name}{of}")],
            warnings: self.warnings,
            steps: Some(steps),
        };
        for (other, its) in found {
            if result
                .steps
                .as_ref()
                .is_some_and(|steps| differ(steps, &other))
            {
                result.steps = None;
                result.notes.clear();
                result.warnings.push(Warning::of_size(format!(
                    "the attributes {name} and {its}{of} state different sizes of a voxel, so that none is taken: give \
                     --spacing and --unit"
                )));
            }
        }
        result
    }
}

/// What to say of three numbers of which none is known to be that of x.
fn no_order(sizes: &Sizes) -> String {
    let what = "does not state which number is that of x and is not taken";
    if sizes.iter().any(|(_, unit)| *unit != sizes[0].1) {
        return what.into();
    }
    let list = |order: [usize; 3]| order.map(|at| sizes[at].0.to_string()).join(",");
    format!(
        "{what} (--spacing {} if they are in the order x, y, z, and --spacing {} if in that of the array, z, y, x)",
        list([0, 1, 2]),
        list([2, 1, 0])
    )
}

/// True if two sizes of a voxel are not the same.
fn differ(a: &[Option<Step>; 3], b: &[Option<Step>; 3]) -> bool {
    a.iter().zip(b).any(|pair| {
        let (Some(a), Some(b)) = pair else {
            return false;
        };
        let (x, y) = match (a.nanometres(), b.nanometres()) {
            (Some(x), Some(y)) => (x, y),
            _ => (a.size, b.size),
        };
        (x - y).abs() > 1e-6 * x.abs().max(y.abs())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid {
        volume: [2, 1, 0],
        axes: 3,
        named: false,
    };

    /// What JSON states of a grid, as `0.5 um, 0.25 um, 2 um` of x, y and z, and the first warning.
    fn of(json: serde_json::Value, grid: Grid) -> (String, String) {
        let mut written = Written::default();
        written.add_json("", &json);
        let found = size(&written, grid, "");
        let steps = found.steps.into_iter().flatten().flatten();
        let steps: Vec<String> = steps.map(|s| format!("{} {}", s.size, s.unit)).collect();
        let warning = found.warnings.first().map(|w| w.to_string());
        (steps.join(", "), warning.unwrap_or_default())
    }

    #[test]
    fn units_are_found_wherever_they_are() {
        use serde_json::json;
        for (json, expected) in [
            (json!({"voxel_size": 0.5, "voxel_size_unit": "um"}), "um"),
            (
                json!({"voxelSize": [0.5, 0.5, 0.5], "voxelSizeUnits": "um"}),
                "um",
            ),
            (
                json!({"pixel_size": 0.5, "pixel_size_units": "um/pixel"}),
                "um/pixel",
            ),
            (json!({"spacing": [0.5], "Spacing_Unit": "mm"}), "mm"),
            (
                json!({"VOXEL_SIZE": 0.5, "UNITS": "Micrometers"}),
                "Micrometers",
            ),
            (json!({"voxel_size": 0.5, "Unit": "[mm]"}), "mm"),
            (json!({"voxel_size": "0.5um"}), "um"),
            (json!({"voxel_size": "0.5 x 0.5 x 0.5 mm"}), "mm"),
            (
                json!({"scale": [0.5, 0.5, 0.5], "units": ["mm", "mm", "mm"]}),
                "mm",
            ),
            (
                json!({"pixelResolution": {"dimensions": [0.5, 0.5, 0.5], "unit": "nm"}}),
                "nm",
            ),
            (
                json!({"voxel_size_x": 0.5, "voxel_size_y": 0.5, "voxel_size_z": 0.5, "unit": "mm"}),
                "mm",
            ),
            (
                json!({"voxel_size": {"x": 0.5, "y": 0.5, "z": 0.5, "unit": "mm"}}),
                "mm",
            ),
            (json!({"voxel_size": 0.5}), ""),
            (json!({"voxel_size": 0.5, "units": "voxel"}), ""),
        ] {
            let unit = cleaned(expected).unwrap();
            let unit = format!("0.5 {unit}, 0.5 {unit}, 0.5 {unit}");
            assert_eq!(of(json.clone(), GRID), (unit, String::new()), "{json}");
        }
    }

    #[test]
    fn orders_are_stated_or_told() {
        use serde_json::json;
        let right = "0.5 um, 0.25 um, 2 um";
        let named = |volume| Grid {
            volume,
            named: true,
            ..GRID
        };
        for (json, grid) in [
            (json!({"element_size_um": [2, 0.25, 0.5]}), GRID),
            (json!({"voxel_size_um": [2, 0.25, 0.5]}), named([2, 1, 0])),
            (json!({"voxel_size_um": [0.5, 0.25, 2]}), named([0, 1, 2])),
            (
                json!({"voxel_size_um": [0.5, 0.25, 2], "voxel_size_order": "xyz"}),
                GRID,
            ),
            (
                json!({"voxel_size": {"x": 0.5, "y": 0.25, "z": 2}, "unit": "um"}),
                GRID,
            ),
            (
                json!({"transform": {"axes": ["z", "y", "x"], "scale": [2, 0.25, 0.5], "units": ["um", "um", "um"]}}),
                GRID,
            ),
            (
                json!({"scale": [1, 2, 0.25, 0.5], "units": ["s", "um", "um", "um"]}),
                Grid {
                    volume: [3, 2, 1],
                    axes: 4,
                    named: true,
                },
            ),
        ] {
            assert_eq!(
                of(json.clone(), grid),
                (right.into(), String::new()),
                "{json}"
            );
        }
        let (steps, warning) = of(json!({"voxel_size": [2, 0.25, 0.5], "unit": "um"}), GRID);
        assert_eq!(steps, "");
        assert!(
            warning.contains("--spacing 0.5,0.25,2") && warning.contains("--spacing 2,0.25,0.5"),
            "{warning}"
        );
    }

    #[test]
    fn what_is_not_taken_is_told() {
        use serde_json::json;
        for (json, says) in [
            (
                json!({"voxel_size": 0.5, "voxel_size_unit": "foo"}),
                "voxel_size_unit: \"foo\"",
            ),
            (json!({"voxel_size": "small"}), "not understood"),
            (
                json!({"voxel_size": [1, 2, 3, 4, 5]}),
                "not one number for each axis",
            ),
            (json!({"spacing": [0.5, 0.5, 0.5]}), "states no unit"),
            (json!({"resolution": 0.5, "units": "HU"}), "states no unit"),
            (
                json!({"resolution": 300, "resolution_unit": "inch"}),
                "voxels per inch",
            ),
            (
                json!({"voxel_size_um": 0.5, "pixel_size_um": 0.6}),
                "different sizes",
            ),
        ] {
            let (steps, warning) = of(json.clone(), GRID);
            assert_eq!(steps, "", "{json}");
            assert!(
                warning.contains(says) && warning.contains("--spacing"),
                "{json}: {warning}"
            );
        }
        let (steps, warning) = of(json!({"voxel_size": 0.5, "units": "HU"}), GRID);
        assert_eq!(steps, "0.5 , 0.5 , 0.5 ");
        assert!(warning.contains("without a unit"), "{warning}");
        let (steps, warning) = of(json!({"voxel_size_um": 0.5, "pixel_size_um": 0.5}), GRID);
        assert_eq!((&*steps, &*warning), ("0.5 um, 0.5 um, 0.5 um", ""));
    }
}
