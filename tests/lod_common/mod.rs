//! Pictures of levels of detail from inside of closed pores: whoever stands in one sees its wall wherever he looks, or
//! there is a crack.

pub mod picture;

use alvis::tileset::TileSet;
use picture::Drawn;
use std::collections::{BTreeMap, HashMap};

/// So far around a pore, in voxels, it is drawn: what is seen beyond it is seen through a crack.
const NEAR: f64 = 8.0;

/// A tile, of level 0, or a node of a level, by its place in the grid of that.
pub type Place = (u32, [u32; 3]);

/// What is drawn of all tiles and nodes of a set.
pub struct Drawings {
    /// Surfaces, and fins.
    parts: HashMap<Place, [Vec<Drawn>; 2]>,
    /// The place of the root.
    root: Place,
}

/// A pore that does not touch a face of the volume.
#[derive(Debug)]
pub struct Pore {
    pub cell: u64,
    /// The mean of the vertices of its wall.
    pub middle: [f64; 3],
    pub low: [f64; 3],
    pub high: [f64; 3],
}

fn drawn(pieces: &[alvis::tile::SurfacePiece]) -> Vec<Drawn> {
    let of_piece = |piece: &alvis::tile::SurfacePiece| -> Vec<Drawn> {
        let cell = piece.ids.cell;
        let corners = piece.triangles.iter().map(|t| piece.corners(*t));
        corners.map(|c| Drawn::new(cell, c)).collect()
    };
    pieces.iter().flat_map(of_piece).collect()
}

impl Drawings {
    /// Of a set with levels up to one root.
    pub fn of(set: &TileSet) -> Self {
        let mut parts = HashMap::new();
        for tile in set.tiles() {
            let tile = tile.unwrap();
            let pieces = set.read_tile(&tile).unwrap().pieces;
            parts.insert((0, tile.grid), [drawn(&pieces), Vec::new()]);
        }
        let levels = set.levels().unwrap().unwrap().levels;
        for level in &levels {
            for node in set.nodes(level) {
                let node = node.unwrap();
                let mesh = set.read_node(&node).unwrap();
                let both = [drawn(&mesh.pieces), drawn(&mesh.fins)];
                parts.insert((level.level, node.grid), both);
            }
        }
        let root = (levels.len() as u32, [0; 3]);
        assert!(parts.contains_key(&root));
        Drawings { parts, root }
    }

    /// The tiles and nodes of a cut: from the root on, each is refined or not as is said.
    pub fn cut(&self, mut refines: impl FnMut(Place) -> bool) -> Vec<Place> {
        let (mut open, mut cut) = (vec![self.root], Vec::new());
        while let Some((level, grid)) = open.pop() {
            if level == 0 || !refines((level, grid)) {
                cut.push((level, grid));
                continue;
            }
            let child = |c: u32| (level - 1, [0, 1, 2].map(|a| 2 * grid[a] + (c >> a & 1)));
            let children = (0..8).map(child);
            open.extend(children.filter(|place| self.parts.contains_key(place)));
        }
        cut
    }

    /// What is drawn of a cut around a pore, with fins or without.
    pub fn scene(&self, cut: &[Place], pore: &Pore, fins: bool) -> Vec<Drawn> {
        let kinds = if fins { 2 } else { 1 };
        let of = |place: &Place| self.parts[place][..kinds].iter().flatten().copied();
        let is_near = |t: &Drawn| {
            let beyond = |a: usize| {
                let all = t.corners.map(|c| c[a]);
                let (low, high) = (pore.low[a] - NEAR, pore.high[a] + NEAR);
                all.iter().all(|v| *v < low) || all.iter().all(|v| *v > high)
            };
            !(0..3).any(beyond)
        };
        cut.iter().flat_map(of).filter(is_near).collect()
    }

    /// Moves what a node draws in the plane across an axis to the mean of its neighbours inside, as if the node decided
    /// by itself where its border lies.
    pub fn place_by_inside(&mut self, place: Place, axis: usize, plane: f64) {
        let [surfaces, _] = self.parts.get_mut(&place).unwrap();
        let key = |p: [f64; 3]| p.map(f64::to_bits);
        let mut inside: HashMap<(u64, [u64; 3]), ([f64; 3], f64)> = HashMap::new();
        for t in surfaces.iter() {
            for p in t.corners.into_iter().filter(|p| p[axis] == plane) {
                let (sum, count) = inside.entry((t.cell, key(p))).or_default();
                for q in t.corners.into_iter().filter(|q| q[axis] != plane) {
                    *count += 1.0;
                    (0..3).for_each(|a| sum[a] += q[a]);
                }
            }
        }
        for t in surfaces {
            for p in &mut t.corners {
                if let Some((sum, count)) = inside.get(&(t.cell, key(*p))).filter(|i| i.1 > 0.0) {
                    *p = sum.map(|v| v / count);
                    p[axis] = plane;
                }
            }
        }
    }

    /// The pores that lie inside of the volume, by their tiles.
    pub fn pores(&self, dims: [u32; 3]) -> Vec<Pore> {
        let mut all: BTreeMap<u64, (Pore, f64)> = BTreeMap::new();
        let tiles = self.parts.iter().filter(|p| p.0.0 == 0);
        // in an order of their own, so that sums are the same each time
        let tiles: BTreeMap<_, _> = tiles.collect();
        for t in tiles.values().flat_map(|p| &p[0]) {
            let (pore, count) = all.entry(t.cell).or_insert_with(|| {
                let pore = Pore {
                    cell: t.cell,
                    middle: [0.0; 3],
                    low: [f64::INFINITY; 3],
                    high: [f64::NEG_INFINITY; 3],
                };
                (pore, 0.0)
            });
            for p in t.corners {
                *count += 1.0;
                for a in 0..3 {
                    pore.middle[a] += p[a];
                    pore.low[a] = pore.low[a].min(p[a]);
                    pore.high[a] = pore.high[a].max(p[a]);
                }
            }
        }
        let inside =
            |p: &Pore| (0..3).all(|a| p.low[a] > 1.0 && p.high[a] < f64::from(dims[a]) - 2.0);
        let mean = |(mut pore, count): (Pore, f64)| {
            pore.middle = pore.middle.map(|v| v / count);
            pore
        };
        all.into_values().map(mean).filter(inside).collect()
    }
}
