//! Random numbers as pure functions of a seed and a place, so that any part of a phantom can be made
//! on its own and by any number of threads.

/// The increment of splitmix64, 2^64 divided by the golden ratio.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finalizer of splitmix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", OOPSLA 2014, variant 13 of Stafford's mixers).
#[inline]
pub fn mix(mut h: u64) -> u64 {
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

/// A hash of a seed and three integers.
#[inline]
pub fn hash3(seed: u64, [i, j, k]: [i64; 3]) -> u64 {
    let h = mix(seed.wrapping_add(GAMMA).wrapping_add(i as u64));
    let h = mix(h.wrapping_add(GAMMA).wrapping_add(j as u64));
    mix(h.wrapping_add(GAMMA).wrapping_add(k as u64))
}

/// One row of voxels as a stream of 64-bit numbers, one for each x.
#[derive(Debug, Clone, Copy)]
pub struct RowStream(u64);

impl RowStream {
    /// The row (y, z) of the stream named by `seed`.
    pub fn new(seed: u64, y: u32, z: u32) -> Self {
        RowStream(mix(
            mix(seed ^ 0x5851_f42d_4c95_7f2d) ^ (u64::from(z) << 32 | u64::from(y))
        ))
    }

    /// The number of voxel x.
    #[inline]
    pub fn at(self, x: u32) -> u64 {
        mix(self.0.wrapping_add(u64::from(x).wrapping_mul(GAMMA)))
    }

    /// A number of mean 0 and variance 1 for voxel x: the sum of four uniform ones, which is close
    /// to normal and never beyond 2 sqrt(3), so that noise cannot pierce a wall by bad luck.
    #[inline]
    pub fn normal(self, x: u32) -> f32 {
        const LANES: u64 = 0x0000_ffff_0000_ffff;
        const MEAN: i32 = 2 * 0xffff;
        // the standard deviation of a uniform 16-bit number is 65536 / sqrt(12)
        const SIGMA: f32 = 65_536.0 / 1.732_050_8;
        let h = self.at(x);
        let pairs = (h & LANES) + ((h >> 16) & LANES);
        let sum = ((pairs + (pairs >> 32)) & 0x3_ffff) as i32;
        (sum - MEAN) as f32 * (1.0 / SIGMA)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_has_mean_0_variance_1_and_a_bound() {
        let (mut sum, mut squares, mut n) = (0.0f64, 0.0f64, 0.0f64);
        for y in 0..64 {
            let row = RowStream::new(7, y, 3);
            for x in 0..1024 {
                let v = f64::from(row.normal(x));
                assert!(v.abs() < 3.465);
                sum += v;
                squares += v * v;
                n += 1.0;
            }
        }
        assert!((sum / n).abs() < 0.02, "{}", sum / n);
        assert!((squares / n - 1.0).abs() < 0.02, "{}", squares / n);
    }

    #[test]
    fn neighbours_are_not_correlated() {
        let mut products = [0.0f64; 3];
        let n = 100_000;
        for i in 0..n {
            let (x, y) = (i % 1000, i / 1000);
            let at = |x, y, z| f64::from(RowStream::new(1, y, z).normal(x));
            let here = at(x, y, 0);
            products[0] += here * at(x + 1, y, 0);
            products[1] += here * at(x, y + 1, 0);
            products[2] += here * at(x, y, 1);
        }
        assert!(products.iter().all(|p| (p / f64::from(n)).abs() < 0.015));
    }
}
