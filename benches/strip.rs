//! Entries per triangle and speed of the strip kernel on marching cubes of a foam, beside meshopt's.
//!
//! `cargo bench --bench strip -- [VOXELS] [NOISE]`; needs `topology/mc_table_sep_6_18.json` below
//! ALVIS_DATA (default `../shared/data`).

use alvis::kernels::strip::{self, STRIDE, Triangle};
use std::collections::HashMap;
use std::time::Instant;

/// Cubes along a macrocube's edge.
const MACROCUBE: usize = 64;
/// Mean distance of the foam's cells, in voxels.
const PITCH: f32 = 40.0;
/// Runs of which each piece's shortest counts: other work on the machine disturbs a run.
const RUNS: usize = 7;

/// Lattice edge of each table entry: its lower corner and axis.
const EDGES: [([usize; 3], usize); 12] = [
    ([0, 0, 0], 0),
    ([0, 1, 0], 0),
    ([0, 0, 1], 0),
    ([0, 1, 1], 0),
    ([0, 0, 0], 1),
    ([1, 0, 0], 1),
    ([0, 0, 1], 1),
    ([1, 0, 1], 1),
    ([0, 0, 0], 2),
    ([1, 0, 0], 2),
    ([0, 1, 0], 2),
    ([1, 1, 0], 2),
];

type Table = Vec<Vec<[usize; 3]>>;

/// A connected surface within a macrocube.
struct Piece {
    triangles: Vec<[u32; 3]>,
    /// As the strip kernel wants them.
    connected: Vec<Triangle>,
    vertices: usize,
}

/// A number in 0..1 that depends on `x` alone (the finaliser of splitmix64).
fn unit(x: u64) -> f32 {
    let mut x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1u32 << 24) as f32
}

/// Walls of three voxels or less between the cells of jittered seeds: above 0 inside a wall.
fn foam(n: usize, noise: f32) -> Vec<f32> {
    let seed = |c: [i32; 3]| -> [f32; 3] {
        let id = c.iter().fold(0u64, |id, &c| id << 20 | (c + 8) as u64);
        std::array::from_fn(|a| (c[a] as f32 + unit(id * 3 + a as u64)) * PITCH)
    };
    let value = |i: usize| {
        let p = [i % n, i / n % n, i / n / n].map(|c| c as f32);
        let home = p.map(|c| (c / PITCH) as i32);
        let (mut nearest, mut second) = (f32::MAX, f32::MAX);
        for k in 0..27 {
            let s = seed([
                home[0] + k % 3 - 1,
                home[1] + k / 3 % 3 - 1,
                home[2] + k / 9 - 1,
            ]);
            let d = (0..3).map(|a| (s[a] - p[a]).powi(2)).sum::<f32>();
            second = second.min(d.max(nearest));
            nearest = nearest.min(d);
        }
        // the sum of four uniform numbers, scaled to a standard deviation of `noise`
        let bell = (0..4)
            .map(|k| unit(i as u64 * 4 + k + (1 << 50)))
            .sum::<f32>()
            - 2.0;
        3.0 - (second.sqrt() - nearest.sqrt()) + noise * 3f32.sqrt() * bell
    };
    (0..n * n * n).map(value).collect()
}

fn read_table() -> Option<Table> {
    let data = std::env::var("ALVIS_DATA").unwrap_or_else(|_| "../shared/data".into());
    let text = std::fs::read_to_string(data + "/topology/mc_table_sep_6_18.json").ok()?;
    let json: serde_json::Value = serde_json::from_str(&text).ok()?;
    serde_json::from_value(json["tris"].clone()).ok()
}

/// The pieces of all macrocubes; a triangle is given by its vertices' lattice edges.
fn pieces(volume: &[f32], n: usize, table: &Table) -> Vec<Piece> {
    let tiles = (n - 1).div_ceil(MACROCUBE);
    let range = |t: usize| t * MACROCUBE..((t + 1) * MACROCUBE).min(n - 1);
    let mut out = Vec::new();
    for tile in 0..tiles.pow(3) {
        let mut triangles: Vec<[u64; 3]> = Vec::new();
        for z in range(tile / tiles / tiles) {
            for y in range(tile / tiles % tiles) {
                for x in range(tile % tiles) {
                    let at = |[i, j, k]: [usize; 3]| ((z + k) * n + y + j) * n + x + i;
                    let above = |c: usize| volume[at([c & 1, c >> 1 & 1, c >> 2])] >= 0.0;
                    let case: usize = (0..8).map(|c| usize::from(above(c)) << c).sum();
                    triangles.extend(
                        table[case]
                            .iter()
                            .map(|t| t.map(|e| (at(EDGES[e].0) * 3 + EDGES[e].1) as u64)),
                    );
                }
            }
        }
        split(&triangles, &mut out);
    }
    out
}

/// Cuts triangles to connected pieces, in the order of their first triangles.
fn split(triangles: &[[u64; 3]], out: &mut Vec<Piece>) {
    let edge = |h: usize| (triangles[h / 3][h % 3], triangles[h / 3][(h + 1) % 3]);
    let edges: HashMap<_, _> = (0..3 * triangles.len()).map(|h| (edge(h), h)).collect();
    let mate = |h: usize| edges.get(&(edge(h).1, edge(h).0)).copied();
    let mut place = vec![None; triangles.len()];
    for first in 0..triangles.len() {
        if place[first].is_some() {
            continue;
        }
        let mut members = vec![first];
        place[first] = Some(0);
        let mut next = 0;
        while next < members.len() {
            let half_edge = 3 * members[next];
            for u in (0..3).filter_map(|e| Some(mate(half_edge + e)? / 3)) {
                if place[u].is_none() {
                    place[u] = Some(0);
                    members.push(u);
                }
            }
            next += 1;
        }
        members.sort_unstable();
        for (i, &t) in members.iter().enumerate() {
            place[t] = Some(i);
        }
        let mut keys: Vec<u64> = members.iter().flat_map(|&t| triangles[t]).collect();
        keys.sort_unstable();
        keys.dedup();
        let index = |key: u64| keys.binary_search(&key).map_or(0, |i| i as u32);
        let local = |h: usize| STRIDE * (place[h / 3].unwrap_or(0) as u32 + 1) + (h % 3) as u32;
        let across = |h: usize| mate(h).map_or(strip::NONE, local);
        let mut piece = Piece {
            triangles: members.iter().map(|&t| triangles[t].map(index)).collect(),
            connected: vec![Triangle::default()],
            vertices: keys.len(),
        };
        for (&t, &[a, b, c]) in members.iter().zip(&piece.triangles) {
            let h = 3 * t;
            let mates = [across(h), across(h + 1), across(h + 2)];
            piece.connected.push(Triangle::new([a, b, c], mates));
        }
        out.push(piece);
    }
}

/// Triangles that a strip draws: windows of three different indices.
fn triangles_of(strip: &[u32]) -> usize {
    let drawn = |w: &&[u32]| w[0] != w[1] && w[1] != w[2] && w[2] != w[0];
    strip.windows(3).filter(drawn).count()
}

/// Runs one way over all pieces and prints what it makes of them. Every run goes through all pieces, so that
/// neither caches nor branch predictors know one from its last run.
fn measure(name: &str, pieces: &mut [Piece], mut way: impl FnMut(&mut Piece, &mut Vec<u32>)) {
    let mut out = Vec::new();
    let mut best = vec![f64::MAX; pieces.len()];
    let (mut entries, mut triangles) = (0, 0);
    for run in 0..RUNS {
        for (piece, best) in pieces.iter_mut().zip(&mut best) {
            out.clear();
            let start = Instant::now();
            way(piece, &mut out);
            *best = best.min(start.elapsed().as_secs_f64());
            if run == 0 {
                assert_eq!(triangles_of(&out), piece.triangles.len());
                triangles += piece.triangles.len();
                entries += out.len();
            }
        }
    }
    let seconds: f64 = best.iter().sum();
    println!(
        "{name:32} {:.4} entries/triangle {:6.1} Mtriangle/s",
        entries as f64 / triangles as f64,
        triangles as f64 / seconds / 1e6
    );
}

fn main() {
    let numbers: Vec<f32> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let n = numbers.first().map_or(193, |&n| n as usize).max(2);
    let noise = numbers.get(1).copied().unwrap_or(0.1);
    let Some(table) = read_table() else {
        println!("skipped: no topology/mc_table_sep_6_18.json below ALVIS_DATA");
        return;
    };
    let mut pieces = pieces(&foam(n, noise), n, &table);
    let triangles: usize = pieces.iter().map(|p| p.triangles.len()).sum();
    println!(
        "{n}^3 voxels, noise {noise}: {triangles} triangles in {} pieces",
        pieces.len()
    );
    let mut stripifier = strip::Stripifier::default();
    measure("alvis", &mut pieces, |piece, out| {
        stripifier.stripify(&mut piece.connected, out);
    });
    // restart index 0 asks for degenerates; the optimised order is what its manual tells to give it
    measure("meshopt stripify", &mut pieces, |piece, out| {
        let indices = piece.triangles.as_flattened();
        out.extend(meshopt::stripify(indices, piece.vertices, 0).expect("a strip"));
    });
    let name = "meshopt vertex cache + stripify";
    measure(name, &mut pieces, |piece, out| {
        let indices = piece.triangles.as_flattened();
        let ordered = meshopt::optimize_vertex_cache_strip(indices, piece.vertices);
        out.extend(meshopt::stripify(&ordered, piece.vertices, 0).expect("a strip"));
    });
}
