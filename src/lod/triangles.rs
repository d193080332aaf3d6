//! Triangles between the vertices of clusters: those without an area go, and two that are opposite cancel each other,
//! so that the directed edges of what is left are those of what was, moved.

use foldhash::fast::RandomState;
use std::collections::HashMap;

/// A triangle with its smallest corner first and the others rising.
#[derive(Debug, Clone, Copy)]
struct Sum {
    corners: [u32; 3],
    /// The next one with the same first corner.
    next: u32,
    /// How many more are oriented so than the other way.
    times: i32,
}

/// None.
const END: u32 = u32::MAX;

/// Triangles in the making.
#[derive(Debug)]
pub struct Sums {
    /// The last one with this first corner.
    heads: Vec<u32>,
    all: Vec<Sum>,
}

impl Sums {
    /// Of triangles between so many vertices, of which there may be about so many.
    pub fn new(vertices: usize, triangles: usize) -> Self {
        Sums {
            heads: vec![END; vertices],
            all: Vec::with_capacity(triangles),
        }
    }

    /// Adds a triangle of three different vertices.
    #[inline]
    pub fn add(&mut self, t: [u32; 3]) {
        let [a, b, c] = t;
        let first = a.min(b).min(c);
        let [x, y] = match first {
            f if f == a => [b, c],
            f if f == b => [c, a],
            _ => [a, b],
        };
        let (corners, way) = match x < y {
            true => ([first, x, y], 1),
            false => ([first, y, x], -1),
        };
        let mut at = self.heads[first as usize];
        while at != END {
            let sum = &mut self.all[at as usize];
            if sum.corners == corners {
                sum.times += way;
                return;
            }
            at = sum.next;
        }
        let next = std::mem::replace(&mut self.heads[first as usize], self.all.len() as u32);
        self.all.push(Sum {
            corners,
            next,
            times: way,
        });
    }

    /// What is left, in the order in which triangles came first.
    pub fn left(&self) -> Vec<[u32; 3]> {
        let mut left = Vec::with_capacity(self.all.len());
        for sum in &self.all {
            let [a, b, c] = sum.corners;
            let oriented = if sum.times > 0 { [a, b, c] } else { [a, c, b] };
            left.extend(std::iter::repeat_n(
                oriented,
                sum.times.unsigned_abs() as usize,
            ));
        }
        left
    }
}

/// What is left of triangles whose corners at one place of a surface are one.
pub fn distinct(
    mut triangles: Vec<[u32; 3]>,
    points: &[[i32; 3]],
    surface: impl Fn(u32) -> u32,
) -> Vec<[u32; 3]> {
    let mut first: HashMap<(u32, [i32; 3]), u32, RandomState> = HashMap::default();
    first.reserve(triangles.len() / 2);
    let mut known = vec![END; points.len()];
    for corner in triangles.as_flattened_mut() {
        let one = &mut known[*corner as usize];
        if *one == END {
            let key = (surface(*corner), points[*corner as usize]);
            *one = *first.entry(key).or_insert(*corner);
        }
        *corner = *one;
    }
    let mut sums = Sums::new(points.len(), triangles.len());
    for [a, b, c] in triangles {
        if a != b && b != c && a != c {
            sums.add([a, b, c]);
        }
    }
    sums.left()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// Directed edges, counted one way and against the other.
    fn boundary(triangles: &[[u32; 3]]) -> BTreeMap<(u32, u32), i32> {
        let mut sums = BTreeMap::new();
        for t in triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *sums.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        sums.retain(|_, sum| *sum != 0);
        sums
    }

    proptest! {
        /// Edges are left as they were, and no triangle beside its opposite.
        #[test]
        fn edges_stay(triangles in prop::collection::vec((0..6u32, 0..6u32, 0..6u32), 0..60)) {
            let proper = triangles.iter().map(|&(a, b, c)| [a, b, c]);
            let proper: Vec<_> = proper.filter(|[a, b, c]| a != b && b != c && a != c).collect();
            let mut sums = Sums::new(6, 0);
            proper.iter().for_each(|t| sums.add(*t));
            let left = sums.left();
            prop_assert_eq!(boundary(&left), boundary(&proper));
            for [a, b, c] in &left {
                prop_assert!(!left.contains(&[*a, *c, *b]));
            }
        }
    }
}
