//! The split by its definition, on a whole volume and slowly. It shares nothing with what it is compared with.

use crate::grid::Ambiguous;
use std::collections::BTreeMap;

/// Voxels by z, y and x: true where solid.
#[derive(Debug, Clone)]
pub struct Solid {
    pub dims: [usize; 3],
    pub voxels: Vec<bool>,
}

/// How to split.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub weights: [u64; 3],
    /// Level of a step of 1.
    pub unit: u64,
    pub reach: u64,
    pub ambiguous: Ambiguous,
    pub permille: u64,
    pub h_256: u64,
    pub min_radius_256: u64,
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct RefNeck {
    pub cells: [u64; 2],
    pub voxel: u64,
    pub level: u64,
    pub peak: u64,
    pub faces: [i64; 3],
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefSplit {
    /// Cell of each voxel, 0 where solid.
    pub parts: Vec<u64>,
    /// Component of each cell.
    pub component: Vec<u64>,
    pub necks: Vec<RefNeck>,
    /// Cells for ratios of 500, 550 ... 950.
    pub curve: Vec<u64>,
    pub basins: u64,
}

impl Solid {
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    fn place(&self, i: usize) -> [i64; 3] {
        let [nx, ny, _] = self.dims;
        [i % nx, i / nx % ny, i / nx / ny].map(|v| v as i64)
    }

    fn beside(&self, i: usize, step: [i64; 3]) -> Option<usize> {
        let place = self.place(i);
        let to: [i64; 3] = std::array::from_fn(|a| place[a] + step[a]);
        let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&to[a]));
        inside.then(|| self.index(to.map(|v| v as usize)))
    }

    /// Least weighted squares of distances, axis by axis, each by trying all.
    pub fn levels(&self, case: &Case) -> Vec<u64> {
        let far = u64::MAX / 4;
        let mut levels: Vec<u64> = self
            .voxels
            .iter()
            .map(|&s| if s { 0 } else { far })
            .collect();
        for axis in 0..3 {
            let before = levels.clone();
            for (i, level) in levels.iter_mut().enumerate() {
                let here = self.place(i)[axis];
                for there in 0..self.dims[axis] as i64 {
                    let mut step = [0; 3];
                    step[axis] = there - here;
                    let square = case.weights[axis] * (there - here).unsigned_abs().pow(2);
                    *level = (before[self.beside(i, step).unwrap()] + square).min(*level);
                }
            }
        }
        let cap = case.unit * case.reach * case.reach;
        levels.into_iter().map(|level| level.min(cap)).collect()
    }
}

fn root(n: u128) -> u128 {
    let mut r = (n as f64).sqrt() as u128;
    while r * r > n {
        r -= 1;
    }
    while (r + 1) * (r + 1) <= n {
        r += 1;
    }
    r
}

fn steps(rule: Ambiguous) -> Vec<[i64; 3]> {
    let most = if rule == Ambiguous::Separate { 2 } else { 1 };
    let mut all = Vec::new();
    for z in -1..=1i64 {
        for y in -1..=1i64 {
            for x in -1..=1i64 {
                if (1..=most).contains(&(x * x + y * y + z * z)) {
                    all.push([x, y, z]);
                }
            }
        }
    }
    all
}

/// The voxel that each voxel of air goes up to, itself at a maximum.
fn ups(solid: &Solid, levels: &[u64], case: &Case) -> Vec<usize> {
    let greater = |a: usize, b: usize| levels[a] > levels[b] || levels[a] == levels[b] && a < b;
    let r = |level: u64| root(u128::from(level) << 20);
    let up = |i: usize| {
        let (mut best, mut slope) = (i, (0u128, 1u128));
        for step in steps(case.ambiguous) {
            let Some(j) = solid.beside(i, step) else {
                continue;
            };
            if levels[j] == 0 || !greater(j, i) {
                continue;
            }
            let length: u64 = (0..3)
                .map(|a| case.weights[a] * step[a].pow(2) as u64)
                .sum();
            let rise = (r(levels[j]) - r(levels[i])).pow(2);
            let [this, that] = [rise * slope.1, slope.0 * u128::from(length)];
            if this > that || this == that && (best == i || greater(j, best)) {
                (best, slope) = (j, (rise, u128::from(length)));
            }
        }
        best
    };
    (0..levels.len())
        .map(|i| if levels[i] > 0 { up(i) } else { i })
        .collect()
}

/// Numbers of equal values, from 1 in the order in which they first come; 0 stays.
fn ranks(values: &[u64]) -> Vec<u64> {
    let mut seen = BTreeMap::from([(0, 0)]);
    let mut rank = |v: u64| {
        let new = seen.len() as u64;
        *seen.entry(v).or_insert(new)
    };
    values.iter().map(|&v| rank(v)).collect()
}

#[derive(Clone, Copy)]
struct Meeting {
    /// Level and index of the lower voxel, index of the upper one.
    saddle: (u64, usize, usize),
    basins: [usize; 2],
    peak: u64,
}

fn joins(case: &Case, permille: u64, meeting: &Meeting) -> bool {
    let radius = |level: u64| root((u128::from(level) << 16) / u128::from(case.unit)) as u64;
    let (saddle, peak) = (meeting.saddle.0, meeting.peak);
    saddle * 1_000_000 > permille * permille * peak
        || radius(peak) - radius(saddle) < case.h_256
        || radius(peak) < case.min_radius_256
}

/// Splits a volume.
pub fn split(solid: &Solid, case: &Case) -> RefSplit {
    let levels = solid.levels(case);
    let up = ups(solid, &levels, case);
    let top = |mut i: usize| {
        while up[i] != i {
            i = up[i];
        }
        i
    };
    let basin: Vec<usize> = (0..levels.len()).map(top).collect();
    let mut saddles: BTreeMap<[usize; 2], (u64, usize, usize)> = BTreeMap::new();
    // greater: the level, then smaller indices
    let key = |s: &(u64, usize, usize)| (s.0, usize::MAX - s.1, usize::MAX - s.2);
    for i in 0..levels.len() {
        for step in steps(case.ambiguous) {
            let Some(j) = solid.beside(i, step) else {
                continue;
            };
            if levels[i] == 0 || levels[j] == 0 || basin[i] == basin[j] {
                continue;
            }
            let lower = levels[i] < levels[j] || levels[i] == levels[j] && i > j;
            let (low, high) = if lower { (i, j) } else { (j, i) };
            let pair = [basin[i].min(basin[j]), basin[i].max(basin[j])];
            let new = (levels[low], low, high);
            let known = saddles.entry(pair).or_insert(new);
            if key(&new) > key(known) {
                *known = new;
            }
        }
    }
    let mut order: Vec<_> = saddles.into_iter().collect();
    order.sort_by_key(|(_, saddle)| std::cmp::Reverse(key(saddle)));
    let air: Vec<usize> = (0..levels.len()).filter(|&i| levels[i] > 0).collect();
    let peaks: Vec<usize> = air.iter().copied().filter(|&i| up[i] == i).collect();
    let itself = || -> BTreeMap<usize, usize> { peaks.iter().map(|&p| (p, p)).collect() };
    let (mut tree, mut cell) = (itself(), itself());
    let mut meetings = Vec::new();
    for (basins, saddle) in order {
        let [a, b] = basins.map(|basin| tree[&basin]);
        if a == b {
            continue;
        }
        // trees are named by their peaks
        let a_higher = levels[a] > levels[b] || levels[a] == levels[b] && a < b;
        let (high, low) = if a_higher { (a, b) } else { (b, a) };
        let peak = levels[low];
        let meeting = Meeting {
            saddle,
            basins,
            peak,
        };
        if joins(case, case.permille, &meeting) {
            let [a, b] = basins.map(|basin| cell[&basin]);
            cell.values_mut().filter(|c| **c == b).for_each(|c| *c = a);
        }
        tree.values_mut()
            .filter(|t| **t == low)
            .for_each(|t| *t = high);
        meetings.push(meeting);
    }
    let of = |names: &BTreeMap<usize, usize>| -> Vec<u64> {
        let name = |i: usize| {
            if levels[i] > 0 {
                names[&basin[i]] as u64 + 1
            } else {
                0
            }
        };
        ranks(&(0..levels.len()).map(name).collect::<Vec<_>>())
    };
    let (parts, components) = (of(&cell), of(&tree));
    let mut component = BTreeMap::new();
    air.iter()
        .for_each(|&i| _ = component.insert(parts[i], components[i]));
    let trees = components.iter().max().copied().unwrap_or(0);
    let curve = (0..10).map(|i| 500 + 50 * i).map(|permille| {
        trees
            + meetings
                .iter()
                .filter(|m| !joins(case, permille, m))
                .count() as u64
    });
    RefSplit {
        curve: curve.collect(),
        necks: necks(solid, &levels, &parts, case, &meetings),
        component: component.into_values().collect(),
        basins: peaks.len() as u64,
        parts,
    }
}

fn necks(
    solid: &Solid,
    levels: &[u64],
    parts: &[u64],
    case: &Case,
    meetings: &[Meeting],
) -> Vec<RefNeck> {
    let sorted = |[a, b]: [u64; 2]| [a.min(b), a.max(b)];
    let cut = meetings.iter().filter(|m| !joins(case, case.permille, m));
    let cut = cut.map(|m| (sorted(m.basins.map(|basin| parts[basin])), m));
    let cut: BTreeMap<[u64; 2], &Meeting> = cut.collect();
    // the greatest saddle of all pairs of cells that touch
    let mut saddles: BTreeMap<[u64; 2], (u64, usize)> = BTreeMap::new();
    for i in 0..levels.len() {
        for step in steps(case.ambiguous) {
            let Some(j) = solid.beside(i, step) else {
                continue;
            };
            if levels[i] == 0 || levels[j] == 0 || parts[i] == parts[j] {
                continue;
            }
            let lower = levels[i] < levels[j] || levels[i] == levels[j] && i > j;
            let low = if lower { i } else { j };
            let known = saddles
                .entry(sorted([parts[i], parts[j]]))
                .or_insert((levels[low], low));
            if (levels[low], usize::MAX - low) > (known.0, usize::MAX - known.1) {
                *known = (levels[low], low);
            }
        }
    }
    assert!(cut.keys().all(|cells| saddles.contains_key(cells)));
    let mut all: Vec<RefNeck> = saddles
        .into_iter()
        .map(|(cells, (level, low))| {
            let meeting = cut.get(&cells);
            assert!(meeting.is_none_or(|m| (m.saddle.0, m.saddle.1) == (level, low)));
            let mut faces = [0; 3];
            for i in 0..parts.len() {
                for axis in 0..3 {
                    let mut step = [0; 3];
                    step[axis] = 1;
                    if let Some(j) = solid.beside(i, step) {
                        faces[axis] += i64::from([parts[i], parts[j]] == cells);
                        faces[axis] -= i64::from([parts[j], parts[i]] == cells);
                    }
                }
            }
            RefNeck {
                cells,
                voxel: low as u64,
                level,
                peak: meeting.map_or(0, |m| m.peak),
                faces,
            }
        })
        .collect();
    all.sort();
    all
}
