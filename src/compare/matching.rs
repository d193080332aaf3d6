//! Which boxes of two sets belong together.

use std::collections::HashMap;

/// The least overlap of two boxes that are those of one cell: a cell that is gone is not found again in a few voxels of
/// noise where it was.
pub const LEAST_OVERLAP: f64 = 0.1;
/// Cubes of the index that a box may lie in; larger boxes are looked at by all others.
const MOST_CUBES: f64 = 64.0;

/// A box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    pub min: [f64; 3],
    pub max: [f64; 3],
}

impl Extent {
    /// The smallest box around both.
    pub fn around(self, other: Extent) -> Extent {
        Extent {
            min: std::array::from_fn(|i| self.min[i].min(other.min[i])),
            max: std::array::from_fn(|i| self.max[i].max(other.max[i])),
        }
    }

    fn sides(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.max[i] - self.min[i])
    }

    fn volume(&self) -> f64 {
        self.sides().into_iter().product()
    }

    fn diagonal(&self) -> f64 {
        self.sides().into_iter().map(|s| s * s).sum::<f64>().sqrt()
    }

    /// The volume of what both have, by that of what either has.
    fn overlap(&self, other: &Extent) -> f64 {
        let both: f64 = (0..3)
            .map(|i| (self.max[i].min(other.max[i]) - self.min[i].max(other.min[i])).max(0.0))
            .product();
        both / (self.volume() + other.volume() - both)
    }
}

/// Where a cell lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    pub extent: Extent,
    pub centroid: [f64; 3],
}

impl Place {
    /// Moved and stretched along each axis as the box `from` to the box `to`.
    pub fn laid_over(&self, from: Extent, to: Extent) -> Place {
        let (old, new) = (from.sides(), to.sides());
        let point = |p: [f64; 3]| {
            std::array::from_fn(|i| to.min[i] + (p[i] - from.min[i]) / old[i] * new[i])
        };
        Place {
            extent: Extent {
                min: point(self.extent.min),
                max: point(self.extent.max),
            },
            centroid: point(self.centroid),
        }
    }

    /// How well two cells match, 0 to 1: the overlap of the boxes, less the farther the centroids are from each other;
    /// 0 from half of the boxes' mean diagonal on, and below [`LEAST_OVERLAP`].
    fn score(&self, other: &Place) -> f64 {
        let apart = (0..3)
            .map(|i| self.centroid[i] - other.centroid[i])
            .map(|d| d * d)
            .sum::<f64>()
            .sqrt();
        let reach = (self.extent.diagonal() + other.extent.diagonal()) / 4.0;
        match self.extent.overlap(&other.extent) {
            overlap if overlap < LEAST_OVERLAP => 0.0,
            overlap => overlap * (1.0 - apart / reach).max(0.0),
        }
    }
}

/// A pair by the positions in the two lists, and how much the boxes overlap, above 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    pub a: usize,
    pub b: usize,
    pub overlap: f64,
}

/// Pairs of cells, each in one at most, by rising position in `a`: the best pair first, then the best one of those that
/// are left, and so on; of equals that of smaller positions.
pub fn match_boxes(a: &[Place], b: &[Place]) -> Vec<Match> {
    let index = Index::new(b);
    let mut pairs = Vec::new();
    let mut near = Vec::new();
    for (i, place) in a.iter().enumerate() {
        index.near(&place.extent, &mut near);
        for &j in &near {
            let score = place.score(&b[j]);
            if score > 0.0 {
                pairs.push((score, i, j));
            }
        }
    }
    pairs.sort_by(|p, q| q.0.total_cmp(&p.0).then((p.1, p.2).cmp(&(q.1, q.2))));
    let (mut used_a, mut used_b) = (vec![false; a.len()], vec![false; b.len()]);
    let mut matches = Vec::new();
    for (_, i, j) in pairs {
        if !used_a[i] && !used_b[j] {
            (used_a[i], used_b[j]) = (true, true);
            let overlap = a[i].extent.overlap(&b[j].extent);
            matches.push(Match {
                a: i,
                b: j,
                overlap,
            });
        }
    }
    matches.sort_by_key(|m| m.a);
    matches
}

/// Boxes by the cubes of space that they lie in.
struct Index {
    /// Side of a cube.
    side: f64,
    cubes: HashMap<[i64; 3], Vec<usize>>,
    /// Those that lie in very many cubes.
    large: Vec<usize>,
    all: usize,
}

impl Index {
    fn new(places: &[Place]) -> Index {
        let mut diagonals: Vec<f64> = places.iter().map(|p| p.extent.diagonal()).collect();
        diagonals.sort_by(f64::total_cmp);
        let median = diagonals.get(diagonals.len() / 2).copied();
        let mut index = Index {
            side: median.filter(|d| d.is_normal()).unwrap_or(1.0),
            cubes: HashMap::new(),
            large: Vec::new(),
            all: places.len(),
        };
        for (i, place) in places.iter().enumerate() {
            match index.cubes_of(&place.extent) {
                Some(cubes) => cubes.for_each(|cube| index.cubes.entry(cube).or_default().push(i)),
                None => index.large.push(i),
            }
        }
        index
    }

    /// The cubes that a box lies in; `None` if these are very many.
    fn cubes_of(&self, extent: &Extent) -> Option<impl Iterator<Item = [i64; 3]> + use<>> {
        let at = |v: f64| (v / self.side).floor();
        let low = extent.min.map(at);
        let high = extent.max.map(at);
        let count: f64 = (0..3).map(|i| high[i] - low[i] + 1.0).product();
        let [x, y, z] = std::array::from_fn(|i| low[i] as i64..=high[i] as i64);
        (count <= MOST_CUBES).then(|| {
            z.flat_map(move |z| {
                let x = x.clone();
                y.clone()
                    .flat_map(move |y| x.clone().map(move |x| [x, y, z]))
            })
        })
    }

    /// Those that may touch a box, by rising position.
    fn near(&self, extent: &Extent, found: &mut Vec<usize>) {
        found.clear();
        match self.cubes_of(extent) {
            Some(cubes) => {
                found.extend(&self.large);
                found.extend(cubes.filter_map(|cube| self.cubes.get(&cube)).flatten());
                found.sort_unstable();
                found.dedup();
            }
            None => found.extend(0..self.all),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place(centre: [f64; 3], half: [f64; 3]) -> Place {
        Place {
            extent: Extent {
                min: std::array::from_fn(|i| centre[i] - half[i]),
                max: std::array::from_fn(|i| centre[i] + half[i]),
            },
            centroid: centre,
        }
    }

    /// All pairs without an index.
    fn slow(a: &[Place], b: &[Place]) -> Vec<(usize, usize)> {
        let mut left: Vec<(usize, usize)> = (0..a.len())
            .flat_map(|i| (0..b.len()).map(move |j| (i, j)))
            .collect();
        let mut found = Vec::new();
        loop {
            left.retain(|&(i, j)| found.iter().all(|&(p, q)| p != i && q != j));
            let mut best: Option<(f64, (usize, usize))> = None;
            for &(i, j) in &left {
                let score = a[i].score(&b[j]);
                if score > 0.0 && best.is_none_or(|(s, _)| score > s) {
                    best = Some((score, (i, j)));
                }
            }
            let Some((_, pair)) = best else { break };
            found.push(pair);
        }
        found.sort_unstable();
        found
    }

    fn places() -> impl Strategy<Value = Vec<Place>> {
        let one = (
            prop::array::uniform3(0.0f64..30.0),
            prop::array::uniform3(0.5f64..4.0),
            0u8..20,
        );
        let one = one.prop_map(|(centre, half, large)| {
            place(
                centre,
                if large == 0 {
                    half.map(|h| 8.0 * h)
                } else {
                    half
                },
            )
        });
        prop::collection::vec(one, 0..40)
    }

    proptest! {
        #[test]
        fn the_index_finds_all_pairs(a in places(), b in places()) {
            let fast: Vec<_> = match_boxes(&a, &b).iter().map(|m| (m.a, m.b)).collect();
            prop_assert_eq!(fast, slow(&a, &b));
        }

        #[test]
        fn cells_match_themselves(a in places()) {
            let matches = match_boxes(&a, &a);
            prop_assert_eq!(matches.len(), a.len());
            for m in matches {
                prop_assert!(m.a == m.b && (m.overlap - 1.0).abs() < 1e-9);
            }
        }

        #[test]
        fn a_compressed_body_is_laid_over(a in places(), factor in 0.5f64..2.0, moved in -9.0f64..9.0) {
            let map = |v: f64| factor * v + moved;
            let b: Vec<Place> = a.iter().map(|p| {
                let mut p = *p;
                (p.extent.min[2], p.extent.max[2]) = (map(p.extent.min[2]), map(p.extent.max[2]));
                p.centroid[2] = map(p.centroid[2]);
                p
            }).collect();
            let around = |places: &[Place]| places.iter().map(|p| p.extent).reduce(Extent::around);
            let (Some(to), Some(from)) = (around(&a), around(&b)) else { return Ok(()) };
            let over: Vec<Place> = b.iter().map(|p| p.laid_over(from, to)).collect();
            let matches = match_boxes(&a, &over);
            prop_assert_eq!(matches.len(), a.len());
            for m in matches {
                prop_assert!(m.a == m.b && (m.overlap - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn nothing_matches_nothing() {
        assert!(match_boxes(&[], &[]).is_empty());
        let one = [place([0.0; 3], [1.0; 3])];
        assert!(match_boxes(&one, &[]).is_empty());
        // side by side
        assert!(match_boxes(&one, &[place([2.0, 0.0, 0.0], [1.0; 3])]).is_empty());
        // a speck where a cell was
        assert!(match_boxes(&one, &[place([0.1; 3], [0.1; 3])]).is_empty());
        let half = match_boxes(&one, &[place([1.0, 0.0, 0.0], [1.0; 3])]);
        assert!((half[0].overlap - 1.0 / 3.0).abs() < 1e-12);
    }
}
