//! Levels of detail: laws of surfaces on random volumes, the same bytes whatever threads and memory, interrupted work.

mod common;

use alvis::Error;
use alvis::convert::ConvertOptions;
use alvis::grid::Dims;
use alvis::lod::{LodOptions, lod};
use alvis::manifest::{Encoding, NodeEntry};
use alvis::phantom::{Phantom, Shape, render};
use alvis::progress::{Progress, Quiet};
use alvis::tile::SurfacePiece;
use alvis::tileset::TileSet;
use alvis::volume::{Dtype, Volume};
use common::{assert_same_files, converted, files, options};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

fn volume(shape: Shape, dims: [u64; 3]) -> Box<dyn Volume> {
    let dims = Dims::new(dims).unwrap();
    Box::new(render(&Phantom::new(shape), dims, Dtype::U8).unwrap())
}

fn made(dir: &Path, options: &LodOptions) -> alvis::lod::LodReport {
    let options = LodOptions {
        threads: 1,
        ..*options
    };
    lod(dir, &options, &Quiet).unwrap()
}

type Point = [i32; 3];

fn point(p: [f32; 3]) -> Point {
    p.map(|v| {
        assert_eq!((v * 256.0).fract(), 0.0, "{v} is not on the lattice");
        (v * 256.0) as i32
    })
}

/// What the edges of a level say: each counted one way and against the other, by its surface; a cap's, if both is
/// wanted, with those of all others.
#[derive(Default)]
struct Edges(BTreeMap<(u64, [Point; 2]), i64>);

impl Edges {
    fn add(&mut self, pieces: &[SurfacePiece], together: bool) {
        for piece in pieces {
            let surface = if together { 0 } else { piece.ids.surface };
            for t in &piece.triangles {
                let corners = piece.corners(*t).map(point);
                for k in 0..3 {
                    let (a, b) = (corners[k], corners[(k + 1) % 3]);
                    assert_ne!(a, b, "a triangle without an area");
                    let way = if a < b { 1 } else { -1 };
                    *self.0.entry((surface, [a.min(b), a.max(b)])).or_default() += way;
                }
            }
        }
    }

    /// The edges without a mate.
    fn open(&self) -> impl Iterator<Item = [Point; 2]> {
        self.0.iter().filter(|e| *e.1 != 0).map(|e| e.0.1)
    }
}

/// Every directed edge of each level has its mate, or lies on a face of the volume that no cap closes.
fn is_closed(set: &TileSet) {
    let manifest = set.manifest();
    let end = manifest.grid.dims.0.map(|n| (n as i32 - 1) * 256);
    for level in &set.levels().unwrap().unwrap().levels {
        let mut edges = Edges::default();
        for node in set.nodes(level) {
            let mesh = set.read_node(&node.unwrap()).unwrap();
            edges.add(&mesh.pieces, manifest.cap);
        }
        assert!(!edges.0.is_empty());
        for [a, b] in edges.open() {
            let on_face = (0..3).any(|i| a[i] == b[i] && (a[i] == 0 || a[i] == end[i]));
            assert!(
                on_face && !manifest.cap,
                "level {}: {a:?} {b:?} has no mate",
                level.level
            );
        }
    }
}

#[test]
fn closed_surfaces_stay_closed_on_every_level() {
    let shapes = [
        (Shape::Noise { density: 0.3 }, [21, 18, 24]),
        (Shape::Noise { density: 0.5 }, [17, 25, 20]),
        (Shape::Sphere { radius: 9.0 }, [24, 24, 24]),
        (Shape::Gyroid { period: 8.0 }, [40, 33, 35]),
    ];
    for (shape, dims) in shapes {
        for (macrocube, cap) in [([4, 4, 4], false), ([8, 5, 7], true), ([3, 16, 6], true)] {
            let volume = volume(shape, dims);
            let options = ConvertOptions {
                cap,
                threshold: 128.0,
                ..options(macrocube)
            };
            let (dir, _) = converted(&*volume, &options);
            made(dir.path(), &LodOptions::default());
            is_closed(&TileSet::open(dir.path()).unwrap());
        }
    }
}
