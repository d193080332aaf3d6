//! The smallest closed surface that stands for another one.

use glam::DVec3;

/// A tetrahedron between those of a closed surface's places that lie furthest apart, oriented as it is; `None` if all lie
/// in a plane.
pub fn tetrahedron(triangles: &[[u32; 3]], points: &[[i32; 3]]) -> Option<Vec<[u32; 3]>> {
    let place = |v: u32| DVec3::from(points[v as usize].map(f64::from));
    // the first of several
    let furthest = |away: &dyn Fn(DVec3) -> f64| {
        let mut best = (0, 0.0);
        for v in 0..points.len() as u32 {
            let distance = away(place(v));
            if distance > best.1 {
                best = (v, distance);
            }
        }
        (best.1 > 0.0).then_some(best.0)
    };
    let a = (0..points.len() as u32).min_by_key(|&v| points[v as usize])?;
    let p = place(a);
    let b = furthest(&|q| q.distance_squared(p))?;
    let along = place(b) - p;
    let c = furthest(&|q| along.cross(q - p).length_squared())?;
    let normal = along.cross(place(c) - p);
    let d = furthest(&|q| normal.dot(q - p).abs())?;
    let volume: f64 = triangles
        .iter()
        .map(|t| {
            let [q, r, s] = t.map(|v| place(v) - p);
            q.dot(r.cross(s))
        })
        .sum();
    let (b, c) = match normal.dot(place(d) - p) * volume < 0.0 {
        true => (c, b),
        false => (b, c),
    };
    Some(vec![[a, c, b], [a, b, d], [b, c, d], [c, a, d]])
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Six times the volume that triangles enclose, and whether each edge has its reverse.
    pub fn solid(points: &[[i32; 3]], triangles: &[[u32; 3]]) -> (f64, bool) {
        let place = |v: u32| DVec3::from(points[v as usize].map(f64::from));
        let volume = triangles.iter().map(|t| {
            let [p, q, r] = t.map(place);
            p.dot(q.cross(r))
        });
        let edges = || {
            triangles
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        };
        (
            volume.sum(),
            edges().all(|(a, b)| edges().any(|e| e == (b, a))),
        )
    }

    #[test]
    fn a_tetrahedron_stands_for_a_surface_and_faces_as_it_does() {
        let axis = |i: usize| {
            let mut p = [2000, 3000, 4000];
            p[i / 2] += if i.is_multiple_of(2) { 400 } else { -400 };
            p
        };
        let points: Vec<[i32; 3]> = (0..6).map(axis).collect();
        let upper = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]];
        let lower = upper.map(|[a, b, _]| [b, a, 5]);
        let mut triangles = [upper, lower].concat();
        for _ in 0..2 {
            let own = tetrahedron(&triangles, &points).unwrap();
            let (volume, closed) = solid(&points, &own);
            assert!(closed && volume * solid(&points, &triangles).0 > 0.0);
            triangles.iter_mut().for_each(|t| t.swap(0, 1));
        }
        assert_eq!(tetrahedron(&triangles, &points[..4]), None);
    }
}
