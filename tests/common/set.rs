//! A whole tile set, welded again.

use super::glb::{self, Triangle};
use alvis::manifest::{Manifest, Shard};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

/// Cell, object and surface of a triangle; cell and surface are 0 for a cap.
pub type Ids = [u64; 3];

/// The surface of a tile set, welded by lattice position.
#[derive(Debug, PartialEq)]
pub struct Surface {
    pub triangles: BTreeMap<Triangle, Ids>,
    /// Bits of the normal of each vertex.
    pub normals: HashMap<[i32; 3], [u32; 3]>,
}

/// A table as header and rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Names without units.
    pub names: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn column(&self, name: &str) -> impl Iterator<Item = &str> {
        let at = self.names.iter().position(|n| n == name).unwrap();
        self.rows.iter().map(move |row| row[at].as_str())
    }

    pub fn sum(&self, name: &str) -> i64 {
        self.column(name).map(|v| v.parse::<i64>().unwrap()).sum()
    }

    pub fn without(&self, name: &str) -> Table {
        let at = self.names.iter().position(|n| n == name).unwrap();
        let mut table = self.clone();
        table.names.remove(at);
        table.rows.iter_mut().for_each(|row| drop(row.remove(at)));
        table
    }
}

pub fn manifest(dir: &Path) -> Manifest {
    serde_json::from_slice(&std::fs::read(dir.join("index.json")).unwrap()).unwrap()
}

pub fn table(dir: &Path, name: &str) -> Table {
    let text = std::fs::read_to_string(dir.join(name)).unwrap();
    let mut lines = text
        .lines()
        .map(|l| l.split(',').map(str::to_string).collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let names = header
        .iter()
        .map(|n| n.split(' ').next().unwrap().to_string());
    Table {
        names: names.collect(),
        rows: lines.collect(),
    }
}

/// The entries of all shards in order.
pub fn shards(dir: &Path) -> Vec<Shard> {
    let read =
        |path: &str| serde_json::from_slice(&std::fs::read(dir.join(path)).unwrap()).unwrap();
    manifest(dir).layers.iter().map(|l| read(&l.path)).collect()
}

/// Reads and welds all tiles; panics if a triangle occurs twice, or a vertex has two normals.
pub fn weld(dir: &Path) -> Surface {
    let mut surface = Surface {
        triangles: BTreeMap::new(),
        normals: HashMap::new(),
    };
    for entry in shards(dir).iter().flat_map(|s| &s.tiles) {
        let pieces = glb::read(&std::fs::read(dir.join(&entry.path)).unwrap());
        assert_eq!(pieces.len(), entry.groups.len(), "{}", entry.path);
        for (piece, group) in pieces.iter().zip(&entry.groups) {
            let ids = [piece.cell, piece.object, piece.surface];
            assert_eq!(
                ids,
                [group.cell, group.object, group.surface],
                "{}",
                entry.path
            );
            assert_eq!(
                piece.triangles.len() as u64,
                group.triangles,
                "{}",
                entry.path
            );
            assert_eq!(piece.stated_triangles, group.triangles, "{}", entry.path);
            for &t in &piece.triangles {
                assert_eq!(surface.triangles.insert(t, ids), None, "{t:?} twice");
            }
            for (&p, &n) in &piece.normals {
                let known = *surface.normals.entry(p).or_insert(n);
                assert_eq!(known, n, "{}: two normals at {p:?}", entry.path);
            }
        }
    }
    surface
}

impl Surface {
    /// Directed edges that have no reverse. Panics if one occurs twice.
    pub fn open_edges(&self) -> BTreeSet<[[i32; 3]; 2]> {
        let mut edges = BTreeSet::new();
        for t in self.triangles.keys() {
            for i in 0..3 {
                assert!(edges.insert([t[i], t[(i + 1) % 3]]), "an edge twice: {t:?}");
            }
        }
        edges
            .iter()
            .filter(|[a, b]| !edges.contains(&[*b, *a]))
            .copied()
            .collect()
    }

    /// Number of connected components, by shared vertices.
    pub fn components(&self) -> usize {
        let mut number = HashMap::new();
        let mut parent: Vec<usize> = Vec::new();
        fn root(parent: &mut [usize], mut v: usize) -> usize {
            while parent[v] != v {
                parent[v] = parent[parent[v]];
                v = parent[v];
            }
            v
        }
        for t in self.triangles.keys() {
            let corners = t.map(|p| {
                *number.entry(p).or_insert_with(|| {
                    parent.push(parent.len());
                    parent.len() - 1
                })
            });
            for c in &corners[1..] {
                let (a, b) = (root(&mut parent, corners[0]), root(&mut parent, *c));
                parent[a] = b;
            }
        }
        (0..parent.len()).filter(|&v| parent[v] == v).count()
    }

    /// Vertices - edges + triangles.
    pub fn euler(&self) -> i64 {
        let open = self.open_edges().len();
        let edges = (3 * self.triangles.len() + open) / 2;
        self.normals.len() as i64 - edges as i64 + self.triangles.len() as i64
    }

    /// The triangles with every vertex moved, the other way round if `flip`.
    pub fn mapped(&self, flip: bool, map: impl Fn([i32; 3]) -> [i32; 3]) -> BTreeSet<Triangle> {
        let turn = |t: Triangle| if flip { [t[0], t[2], t[1]] } else { t };
        self.triangles
            .keys()
            .map(|&t| glb::canonical(turn(t).map(&map)))
            .collect()
    }
}
