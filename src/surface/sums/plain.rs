//! For any processor: corners are gathered number by number, arithmetic runs over arrays.

use crate::measure::AreaScale;
use crate::strip::Triangle;
use crate::surface::sums::{AT_ONCE, STEPS, Sums};
use crate::sys::unchecked::Unchecked;

/// Triangles at once. With eight, compilers keep the gathered corners in registers, and the arithmetic on them
/// one by one.
const LANES: usize = 32;

/// One value for each of them.
type Lanes<T> = [T; LANES];

/// The sums of up to [`AT_ONCE`] triangles.
///
/// # Safety
/// The vertices' numbers are three for each corner named, at least.
pub unsafe fn sum(faces: &[Triangle], vertices: &[f32], area: &AreaScale) -> Sums<LANES> {
    debug_assert!(faces.len() <= AT_ONCE);
    // SAFETY: as promised
    let vertices = unsafe { Unchecked::new(vertices.as_chunks().0) };
    let mut sums = Sums {
        volume6: [0.0; LANES],
        twice_area: [0.0; LANES],
    };
    let (batches, rest) = faces.as_chunks();
    for batch in batches {
        sums.add(batch, vertices, area);
    }
    if !rest.is_empty() {
        // three times the same corner have neither volume nor area
        let mut batch = [Triangle::default(); LANES];
        batch[..rest.len()].copy_from_slice(rest);
        sums.add(&batch, vertices, area);
    }
    sums
}

impl Sums<LANES> {
    fn add(&mut self, faces: &Lanes<Triangle>, vertices: Unchecked<[f32; 3]>, area: &AreaScale) {
        let [mut a, mut b, mut c] = [[[0.0; LANES]; 3]; 3];
        for (i, face) in faces.iter().enumerate() {
            let [p, q, r] = face.corners();
            for (corner, vertex) in [(&mut a, p), (&mut b, q), (&mut c, r)] {
                let [x, y, z] = vertices.at(vertex as usize);
                (corner[0][i], corner[1][i], corner[2][i]) = (x, y, z);
            }
        }
        let [mut u, mut v, mut n] = [[[0.0; LANES]; 3]; 3];
        for k in 0..3 {
            for i in 0..LANES {
                u[k][i] = b[k][i] - a[k][i];
                v[k][i] = c[k][i] - a[k][i];
            }
        }
        for k in 0..3 {
            let (l, m) = ((k + 1) % 3, (k + 2) % 3);
            for i in 0..LANES {
                n[k][i] = u[l][i] * v[m][i] - u[m][i] * v[l][i];
            }
        }
        for i in 0..LANES {
            // a . (b x c) = a . ((b - a) x (c - a))
            let product = |k: usize| f64::from(a[k][i]) * f64::from(n[k][i]);
            self.volume6[i] += product(0) + product(1) + product(2);
        }
        const SQUARED: f32 = (STEPS * STEPS) as f32;
        for i in 0..LANES {
            let n = [n[0][i], n[1][i], n[2][i]].map(|n| n * SQUARED);
            self.twice_area[i] += area.twice_area(n);
        }
    }
}
