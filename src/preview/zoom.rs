//! How large voxels are drawn.

use crate::error::{Error, Result};

/// The most pixels of a slice.
const MOST: u64 = 1 << 28;
/// Pixels that the longer side gets if no scale is given and the slice is smaller.
const COMFORT: f64 = 1024.0;
/// The most pixels per voxel and axis if no scale is given.
const LARGEST: f64 = 64.0;

/// The pixels of a slice's voxels: voxels in their true proportion, the finer axis magnified by a whole number.
#[derive(Debug, Clone, Copy)]
pub struct Zoom {
    /// Voxels to the right and down.
    pub voxels: [u32; 2],
    /// Pixels per voxel, at least 1.
    pub factor: [f64; 2],
}

/// What is to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct ZoomInput {
    /// Voxels to the right and down.
    pub voxels: [u32; 2],
    /// Their lengths.
    pub spacing: [f64; 2],
    /// Pixels per voxel along the finer axis.
    pub asked: Option<u32>,
    /// How often the slice is drawn side by side, at least 1.
    pub panels: u32,
}

impl ZoomInput {
    /// Pixels that the longer side gets if no scale is given: several panels share the width of one and a half.
    fn comfort(&self) -> f64 {
        match self.panels {
            0 | 1 => COMFORT,
            n => 1.5 * COMFORT / f64::from(n),
        }
    }

    /// True if all panels of such a slice are no more than the largest picture.
    fn fits(&self, zoom: &Zoom) -> bool {
        let [width, height] = zoom.exact();
        (1.0..=MOST as f64).contains(&(width * height * f64::from(self.panels)))
    }
}

impl Zoom {
    /// As many pixels per voxel as are asked for along the finer axis, or as fit 1024. Voxels are drawn as squares,
    /// and false is returned, if without a scale their true proportion would pass 2^28 pixels.
    ///
    /// # Errors
    /// [`Error::Usage`] if the picture would pass 2^28 pixels.
    pub fn new(input: ZoomInput) -> Result<(Zoom, bool)> {
        let zoom = Zoom::magnified(&input, proportion(input.spacing));
        if input.fits(&zoom) {
            return Ok((zoom, true));
        }
        let square = Zoom::magnified(&input, [1.0; 2]);
        if input.asked.is_none() && input.fits(&square) {
            return Ok((square, false));
        }
        let [width, height] = zoom.exact();
        let found = format!("{width:.0} x {height:.0} pixels");
        Err(Error::usage(
            "--scale",
            found,
            format!("1 to {MOST} pixels"),
        ))
    }

    fn magnified(input: &ZoomInput, ratio: [f64; 2]) -> Zoom {
        let voxels = input.voxels;
        let once = Zoom {
            voxels,
            factor: ratio,
        };
        let [width, height] = once.exact();
        let fitting = (input.comfort() / width.max(height).max(1.0)).floor();
        let scale = input.asked.map_or(fitting.clamp(1.0, LARGEST), f64::from);
        let factor = ratio.map(|r| r * scale);
        Zoom { voxels, factor }
    }

    fn exact(&self) -> [f64; 2] {
        std::array::from_fn(|i| (f64::from(self.voxels[i]) * self.factor[i]).round())
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.exact().map(|n| n as u32)
    }

    /// The voxel of a pixel along an axis: 0 to the right, 1 down.
    pub fn voxel(&self, axis: usize, pixel: u32) -> u32 {
        let at = (f64::from(pixel) + 0.5) / self.factor[axis];
        (at as u32).min(self.voxels[axis] - 1)
    }

    /// Where a point lies in pixels that is given in voxels, whose middles are whole numbers.
    pub fn point(&self, at: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| (at[i] + 0.5) * self.factor[i])
    }

    /// Pixels per voxel along the finer axis.
    pub fn finer(&self) -> f64 {
        self.factor[0].min(self.factor[1])
    }
}

/// How much longer voxels are along each axis than along the finer one.
fn proportion(spacing: [f64; 2]) -> [f64; 2] {
    let finer = spacing[0].min(spacing[1]);
    spacing.map(|s| {
        let ratio = s / finer;
        // 0.3 / 0.1 is a bit less than 3
        let whole = ratio.round();
        if (ratio - whole).abs() < 1e-6 * ratio {
            whole
        } else {
            ratio
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(voxels: [u32; 2], spacing: [f64; 2], asked: Option<u32>) -> Result<(Zoom, bool)> {
        Zoom::new(ZoomInput {
            voxels,
            spacing,
            asked,
            panels: 1,
        })
    }

    #[test]
    fn voxels_have_their_proportion() {
        let zoom = |voxels, spacing, asked| new(voxels, spacing, asked).unwrap().0;
        assert_eq!(zoom([40, 36], [0.05; 2], None).size(), [1000, 900]);
        assert_eq!(zoom([40, 36], [0.1, 0.3], Some(2)).size(), [80, 216]);
        assert_eq!(zoom([100, 10], [1.0, 1.4], Some(5)).size(), [500, 70]);
        assert_eq!(zoom([4, 4], [1.0; 2], None).size(), [256, 256]);
        assert_eq!(zoom([3000, 2000], [1.0; 2], None).size(), [3000, 2000]);
        let zoom = zoom([10, 7], [1.0, 2.3], Some(3));
        let rows: Vec<u32> = (0..zoom.size()[1]).map(|y| zoom.voxel(1, y)).collect();
        assert_eq!((rows[0], rows[rows.len() - 1]), (0, 6));
        let counts = (0..7).map(|n| rows.iter().filter(|r| **r == n).count());
        assert!(
            counts.into_iter().all(|n| n == 6 || n == 7 || n == 8),
            "{rows:?}"
        );
    }

    #[test]
    fn pictures_have_a_largest_size() {
        assert!(new([40, 36], [1.0; 2], Some(100_000)).is_err());
        assert!(new([40, 36], [1.0; 2], Some(0)).is_err());
        let (zoom, true_proportion) = new([40, 36], [1.0, 1e12], None).unwrap();
        assert!(!true_proportion && zoom.size() == [1000, 900]);
        assert!(new([40, 36], [1.0, 1e12], Some(1)).is_err());
    }
}
