//! Where an MRC lies: the cell and its angles, the origin.

use crate::error::Result;
use crate::grid::{Origin, Placement, Provenance};
use crate::volume::formats::mrc::Head;
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::stated::warning::Warning;

/// The unit of the format's lengths.
const UNIT: &str = "angstrom";

impl Head<'_> {
    /// Spacing, directions and origin of a volume whose columns, rows and sections are these axes.
    pub(super) fn place(
        &self,
        axes: [usize; 3],
        warnings: &mut Vec<Warning>,
    ) -> Result<(Placement, Provenance)> {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        let (counts, cell) = (self.three(28), self.reals(40));
        // a stack of pictures has one interval for all its sections
        let stack = self.i32(88) == 0 && counts[2] == 1;
        if stack {
            warnings.push(
                "the header describes a stack of pictures (ISPG 0, MZ 1), as a tilt series is: its sections may be no \
                 slices of a volume"
                    .into(),
            );
        }
        let step = |a: usize| {
            let stated = counts[a] > 0 && cell[a] != 0.0 && !(stack && a == 2);
            // quotients of numbers in single precision have noise
            let size = || crate::grid::length::shortest((cell[a] / f64::from(counts[a])) as f32);
            stated.then(|| Step::new(size(), UNIT))
        };
        let size = voxel_size([step(0), step(1), step(2)]);
        size.apply(&mut place, &mut from);
        let angles = self.reals(52);
        if angles.iter().any(|angle| *angle != 0.0 && *angle != 90.0) {
            place.directions = self.directions(angles)?;
        }
        if let (Some(unit), Some(length)) = (size.unit, size.of_file[0]) {
            place.origin = match self.stated_origin() {
                Some(origin) => origin.map(|v| length.convert(v, unit)),
                None => {
                    let mut start = [0.0; 3];
                    for (first, axis) in self.three(16).into_iter().zip(axes) {
                        start[axis] = f64::from(first);
                    }
                    place.world(start)
                }
            };
            from.origin = Origin::File;
        }
        warnings.extend(size.warning);
        Ok((place, from))
    }

    /// The origin of the header, if it is not at 0. IMOD's points the other way, unless a flag says that it does not.
    fn stated_origin(&self) -> Option<[f64; 3]> {
        let origin = self.reals(196);
        let turned = self.imod().is_some_and(|flags| flags & 4 == 0);
        let sound = origin.iter().all(|v| v.is_finite()) && origin != [0.0; 3];
        // adding 0 turns -0 into 0
        sound.then(|| origin.map(|v| if turned { 0.0 - v } else { v + 0.0 }))
    }

    /// Unit vectors along the axes of a cell of these angles, between its axes y z, x z and x y.
    fn directions(&self, angles: [f64; 3]) -> Result<[[f64; 3]; 3]> {
        // of a right angle the cosine is 0, which its radians do not give
        let cosine = |angle: f64| match angle {
            90.0 => 0.0,
            other => libm::cos(other.to_radians()),
        };
        let [a, b, c] = angles.map(cosine);
        let sine = (1.0 - c * c).sqrt();
        let y = (a - b * c) / sine;
        let z = (1.0 - b * b - y * y).sqrt();
        if !(z.is_finite() && z > 1e-6) {
            let [a, b, c] = angles;
            let found = format!("a cell of angles {a}, {b} and {c}");
            return Err(self.wrong(found, "three axes that do not lie in one plane"));
        }
        Ok([[1.0, 0.0, 0.0], [c, sine, 0.0], [b, y, z]])
    }
}
