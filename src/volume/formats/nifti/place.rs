//! Where a NIfTI image lies: sform, qform or spacing alone.

use crate::grid::{Frame, Origin, Placement, Provenance, Unit};
use crate::volume::formats::nifti::Head;
use crate::volume::stated::size::{Step, VoxelSize, voxel_size};
use crate::volume::stated::warning::Warning;
use glam::DVec3;

/// A map from voxels to the world.
#[derive(Debug, Clone, Copy)]
struct Form {
    /// Length of a step along each axis.
    lengths: [f64; 3],
    /// Unit vectors.
    axes: [DVec3; 3],
    origin: [f64; 3],
}

impl Head<'_> {
    /// Spacing, directions, origin and unit: of the sform if it is sound, else of the qform, else of `pixdim` alone.
    /// What is passed over, or contradicts another, is a warning.
    pub(crate) fn place(&self, warnings: &mut Vec<Warning>) -> (Placement, Provenance) {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        let (unit, known) = self.unit();
        let pixdim = [1, 2, 3].map(|i| self.pixdim(i).abs());
        let size = voxel_size(pixdim.map(|size| Some(Step::new(size, unit))));
        let (sform, qform) = (self.sform(), self.qform(&size));
        let sound = |form: &Option<Result<Form, String>>| matches!(form, Some(Ok(_)));
        let taken = match (sound(&sform), sound(&qform)) {
            (true, _) => "sform",
            (false, true) => "qform",
            (false, false) => "pixdim",
        };
        for (name, form) in [("sform", &sform), ("qform", &qform)] {
            if let Some(Err(what)) = form {
                warnings.push(format!("the {name} is not taken, but {taken}: {what}").into());
            }
        }
        let (sform, qform) = (sform.and_then(Result::ok), qform.and_then(Result::ok));
        let contradiction =
            sform.and_then(|sform| self.contradiction(&sform, qform.as_ref(), &size));
        warnings.extend(contradiction.map(Warning::from));
        match sform.or(qform) {
            Some(form) => {
                place.spacing = form.lengths;
                // adding 0 turns -0 into 0
                place.directions = form.axes.map(|axis| (axis + DVec3::ZERO).into());
                place.origin = form.origin;
                (from.spacing, from.origin) = ([Origin::File; 3], Origin::File);
                from.frame = Frame::Ras;
            }
            None => {
                size.apply(&mut place, &mut from);
                warnings.extend(size.warning);
            }
        }
        if from.spacing[0] == Origin::File {
            place.unit = match unit {
                "m" => Unit::Metre,
                "um" => Unit::Micrometre,
                // also the unit of the format's coordinates where nothing is said
                _ => Unit::Millimetre,
            };
            from.unit = if unit.is_empty() {
                Origin::Default
            } else {
                Origin::File
            };
        }
        if !known {
            warnings.push(Warning::of_size(format!(
                "the file states its unit of length by a code that is not known ({}), millimetres are assumed: give \
                 --spacing and --unit if that is wrong",
                self.unit_code()
            )));
        }
        (place, from)
    }

    fn unit_code(&self) -> i64 {
        let units = match self.long {
            true => self.i32(500),
            false => self.bytes[123].into(),
        };
        units & 7
    }

    /// The unit that the file states, empty if none, and whether its code is one of the format.
    fn unit(&self) -> (&'static str, bool) {
        match self.unit_code() {
            0 => ("", true),
            1 => ("m", true),
            2 => ("mm", true),
            3 => ("um", true),
            _ => ("", false),
        }
    }

    /// The sform, if there is one, or why it is no map.
    fn sform(&self) -> Option<Result<Form, String>> {
        if self.code(254, 348) <= 0 {
            return None;
        }
        let row =
            |i: usize| [0, 1, 2, 3].map(|c| self.real(280 + 16 * i + 4 * c, 400 + 32 * i + 8 * c));
        let rows = [row(0), row(1), row(2)];
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        let axes = [column(0), column(1), column(2)];
        let lengths = axes.map(DVec3::length);
        let unit = [0, 1, 2].map(|a| axes[a] / lengths[a]);
        let flat = unit[0].cross(unit[1]).dot(unit[2]).abs() < 1e-6;
        if flat
            || !rows
                .as_flattened()
                .iter()
                .chain(&lengths)
                .all(|v| v.is_finite())
            || lengths.contains(&0.0)
        {
            return Some(Err({
                let rows = rows.map(|row| numbers(&row));
                format!("its rows ({}) are no three axes of space", rows.join("; "))
            }));
        }
        // the square root of single-precision numbers has noise that pixdim has not
        let near = |l: f64, p: f64| (l - p).abs() <= 1e-6 * p;
        let lengths = std::array::from_fn(|a| match self.pixdim(a + 1).abs() {
            p if near(lengths[a], p) => p,
            _ => lengths[a],
        });
        Some(Ok(Form {
            lengths,
            axes: unit,
            origin: column(3).into(),
        }))
    }

    /// The qform, if there is one, or why it is no map: a rotation as the last three parts of a unit quaternion, and
    /// the sign of the third axis in `pixdim[0]`.
    fn qform(&self, size: &VoxelSize) -> Option<Result<Form, String>> {
        if self.code(252, 344) <= 0 {
            return None;
        }
        let part = |i: usize| self.real(256 + 4 * i, 352 + 8 * i);
        let [b, c, d] = [part(0), part(1), part(2)];
        let square = b * b + c * c + d * d;
        let origin = [part(3), part(4), part(5)];
        let Some(lengths) = size.spacing else {
            return Some(Err("pixdim states no size of a voxel".into()));
        };
        // a little above 1 by rounding stands for half a turn
        if square.is_nan() || square > 1.0 + 1e-4 || !origin.iter().all(|v| v.is_finite()) {
            return Some(Err(format!(
                "its quaternion ({}) and origin ({}) are no turn and place",
                numbers(&[b, c, d]),
                numbers(&origin)
            )));
        }
        let (a, scale) = if square < 1.0 {
            ((1.0 - square).sqrt(), 1.0)
        } else {
            (0.0, 1.0 / square.sqrt())
        };
        let rotation = glam::DQuat::from_xyzw(b * scale, c * scale, d * scale, a).normalize();
        let third = if self.pixdim(0) < 0.0 { -1.0 } else { 1.0 };
        Some(Ok(Form {
            lengths,
            axes: [DVec3::X, DVec3::Y, DVec3::Z * third].map(|v| rotation * v),
            origin,
        }))
    }

    /// What to say if the sform, which is taken, and qform or `pixdim` give different places or sizes.
    fn contradiction(
        &self,
        sform: &Form,
        qform: Option<&Form>,
        size: &VoxelSize,
    ) -> Option<String> {
        let (other, lengths) = match (qform, size.spacing) {
            (Some(qform), _) => ("qform", qform.lengths),
            (None, Some(spacing)) => ("pixdim", spacing),
            (None, None) => return None,
        };
        let far = |a: f64, b: f64| (a - b).abs() > 1e-3 * a.max(b);
        let longer = (0..3).any(|a| far(sform.lengths[a], lengths[a]));
        let turned = |q: &Form| (0..3).any(|a| sform.axes[a].dot(q.axes[a]) < 0.9999);
        let step = sform.lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let away = |q: &Form| (0..3).any(|a| (sform.origin[a] - q.origin[a]).abs() > 0.1 * step);
        if !longer && !qform.is_some_and(|q| turned(q) || away(q)) {
            return None;
        }
        let show = |form: Option<&Form>| {
            form.map_or(String::new(), |form| {
                let axes = form
                    .axes
                    .map(|axis| format!("({})", numbers(&axis.to_array())));
                format!(
                    " along {} from ({})",
                    axes.join(", "),
                    numbers(&form.origin)
                )
            })
        };
        Some(format!(
            "sform and {other} contradict each other: the sform states voxels of {}{}, the {other} of {}{}: the sform is \
             taken",
            by_x(sform.lengths),
            show(qform.and(Some(sform))),
            by_x(lengths),
            show(qform)
        ))
    }
}

/// A number for people, without the noise of its last digits.
fn short(v: f64) -> String {
    let rounded = format!("{v:.5e}").parse::<f64>().unwrap_or(v);
    // adding 0 turns -0 into 0
    (if rounded.abs() < 1e-9 { 0.0 } else { rounded } + 0.0).to_string()
}

fn numbers(all: &[f64]) -> String {
    let words: Vec<String> = all.iter().map(|v| short(*v)).collect();
    words.join(", ")
}

fn by_x(size: [f64; 3]) -> String {
    size.map(short).join(" x ")
}
