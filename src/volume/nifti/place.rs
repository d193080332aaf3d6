//! Where a NIfTI image lies: sform, qform or spacing alone.

use super::Head;
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::manifest::{Origin, Provenance};
use glam::DVec3;

impl Head<'_> {
    /// Spacing, directions, origin and unit.
    ///
    /// # Errors
    /// [`Error::Format`] if a form is no map at all.
    pub(super) fn place(&self) -> Result<(Placement, Provenance)> {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        let units = if self.long {
            self.i32(500)
        } else {
            self.bytes[123].into()
        };
        let unit = match units & 7 {
            1 => Some(Unit::Metre),
            2 => Some(Unit::Millimetre),
            3 => Some(Unit::Micrometre),
            _ => None,
        };
        // the format's coordinates are in millimetres where nothing else is said
        place.unit = unit.unwrap_or(Unit::Millimetre);
        from.unit = unit.map_or(Origin::Default, |_| Origin::File);
        let spacing = [1, 2, 3].map(|i| self.pixdim(i).abs());
        if spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
            place.spacing = spacing;
            from.spacing = [Origin::File; 3];
        }
        if self.code(254, 348) > 0 {
            (from.spacing, from.origin) = ([Origin::File; 3], Origin::File);
            let row = |i: usize| {
                [0, 1, 2, 3].map(|c| self.real(280 + 16 * i + 4 * c, 400 + 32 * i + 8 * c))
            };
            self.affine([row(0), row(1), row(2)], &mut place)?;
        } else if self.code(252, 344) > 0 {
            from.origin = Origin::File;
            self.quaternion(&mut place)?;
        }
        Ok((place, from))
    }

    /// The sform: rows of a map from voxels to the world.
    fn affine(&self, rows: [[f64; 4]; 3], place: &mut Placement) -> Result<()> {
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        let axes = [column(0), column(1), column(2)];
        let lengths = axes.map(DVec3::length);
        let finite = rows.as_flattened().iter().all(|v| v.is_finite());
        if !finite || lengths.iter().any(|&l| l == 0.0 || !l.is_finite()) {
            let found = format!("an sform with the rows {rows:?}");
            return Err(Error::format(
                self.path,
                found,
                "three axes of finite length",
            ));
        }
        let unit = [0, 1, 2].map(|a| axes[a] / lengths[a]);
        place.spacing = lengths;
        place.directions = unit.map(<[f64; 3]>::from);
        place.origin = column(3).into();
        Ok(())
    }

    /// The qform: a rotation as the last three parts of a unit quaternion, and the sign of the third
    /// axis in `pixdim[0]`.
    fn quaternion(&self, place: &mut Placement) -> Result<()> {
        let part = |i: usize| self.real(256 + 4 * i, 352 + 8 * i);
        let [b, c, d] = [part(0), part(1), part(2)];
        let square = b * b + c * c + d * d;
        let origin = [part(3), part(4), part(5)];
        // a little above 1 by rounding stands for half a turn
        if square.is_nan() || square > 1.0 + 1e-4 || !origin.iter().all(|v| v.is_finite()) {
            let found = format!("a qform with quaternion {b}, {c}, {d} and origin {origin:?}");
            return Err(Error::format(
                self.path,
                found,
                "a unit quaternion and finite numbers",
            ));
        }
        let (a, scale) = if square < 1.0 {
            ((1.0 - square).sqrt(), 1.0)
        } else {
            (0.0, 1.0 / square.sqrt())
        };
        let rotation = glam::DQuat::from_xyzw(b * scale, c * scale, d * scale, a).normalize();
        let third = if self.pixdim(0) < 0.0 { -1.0 } else { 1.0 };
        place.directions = [DVec3::X, DVec3::Y, DVec3::Z * third].map(|v| (rotation * v).into());
        place.origin = origin;
        Ok(())
    }
}
