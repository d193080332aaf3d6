//! Eigenvalues of symmetric 3 x 3 matrices.

/// Eigenvalues, largest first, with their unit eigenvectors, of the symmetric matrix `m`, by cyclic
/// Jacobi rotations (Golub and Van Loan, Matrix Computations, section 8.5).
pub fn eigen_symmetric(mut m: [[f64; 3]; 3]) -> [(f64, [f64; 3]); 3] {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // convergence is quadratic: a handful of sweeps reaches rounding error
    for _ in 0..32 {
        let off: f64 = m[0][1].abs() + m[0][2].abs() + m[1][2].abs();
        let diagonal: f64 = m[0][0].abs() + m[1][1].abs() + m[2][2].abs();
        if off <= 1e-15 * diagonal || !off.is_finite() {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut m, &mut v, p, q);
        }
    }
    let mut out = [0, 1, 2].map(|i| (m[i][i], [v[0][i], v[1][i], v[2][i]]));
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out
}

/// One rotation in the plane (p, q) that makes `m[p][q]` zero.
fn rotate(m: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if m[p][q] == 0.0 {
        return;
    }
    let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
    // Square roots round alike everywhere, which a library's hypot does not. A theta whose square is
    // infinite means no rotation, for the matrix is diagonal but for rounding.
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..3 {
        let (a, b) = (m[k][p], m[k][q]);
        (m[k][p], m[k][q]) = (c * a - s * b, s * a + c * b);
    }
    for k in 0..3 {
        let (a, b) = (m[p][k], m[q][k]);
        (m[p][k], m[q][k]) = (c * a - s * b, s * a + c * b);
        let (a, b) = (v[k][p], v[k][q]);
        (v[k][p], v[k][q]) = (c * a - s * b, s * a + c * b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vectors_are_orthonormal_and_rebuild_the_matrix(e in prop::array::uniform6(-10.0..10.0f64)) {
            let m = [[e[0], e[3], e[4]], [e[3], e[1], e[5]], [e[4], e[5], e[2]]];
            let pairs = eigen_symmetric(m);
            prop_assert!(pairs[0].0 >= pairs[1].0 && pairs[1].0 >= pairs[2].0);
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| pairs[i].1[k] * pairs[j].1[k]).sum();
                    prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                    let rebuilt: f64 = pairs.iter().map(|(l, v)| l * v[i] * v[j]).sum();
                    prop_assert!((rebuilt - m[i][j]).abs() < 1e-11);
                }
            }
        }
    }
}
