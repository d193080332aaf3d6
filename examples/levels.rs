//! What levels of detail lose and cost: for each level of a tile set the triangles, borders, cells, edges of more than two
//! triangles and triangles against their normals, and how far the vertices of the tiles lie from it; the time that
//! meshoptimizer alone takes to bring the nodes of level 1 to the same counts; and, of a volume that is given, the
//! processor time of its conversion and of the levels, in one thread.
//!
//! ```sh
//! alvis lod OUT && cargo run --release --example levels -- OUT
//! cargo run --release --example levels -- OUT foam.mhd --threshold 128
//! ```

use alvis::cli::call::{Call, call};
use alvis::lod::{LodOptions, lod};
use alvis::manifest::Level;
use alvis::progress::Quiet;
use alvis::tile::{NodeMesh, SurfacePiece};
use alvis::tileset::TileSet;
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify_with_locks, typed_to_bytes};
use std::collections::{HashMap, HashSet};

/// One of so many vertices of the tiles is measured.
const SAMPLE: usize = 41;

type Point = [f32; 3];

fn main() -> alvis::Result<()> {
    let mut words = std::env::args().skip(1);
    let out = words.next().expect("the directory of a tile set");
    let rest: Vec<String> = words.collect();
    if !rest.is_empty() {
        make(&out, rest)?;
    }
    let set = TileSet::open(&out)?;
    let levels = set.levels()?.expect("levels: `alvis lod` makes them");
    let samples = samples(&set)?;
    let tiles = set.manifest().totals;
    println!(
        "level 0: {} triangles, {} cells, {} bytes",
        tiles.triangles, tiles.cells, tiles.bytes
    );
    for level in &levels.levels {
        measure(&set, level, &samples)?;
    }
    let sum = |of: fn(&Level) -> u64| levels.levels.iter().map(of).sum::<u64>() as f64;
    println!(
        "all levels: {:.4} of the triangles, with fins {:.4}, {:.4} of the bytes",
        sum(|l| l.triangles) / tiles.triangles as f64,
        sum(|l| l.triangles + l.fin_triangles) / tiles.triangles as f64,
        sum(|l| l.bytes) / tiles.bytes as f64
    );
    let (seconds, triangles) = collapsed_alone(&set, &levels.levels[0])?;
    println!("edge collapse alone to level 1: {seconds:.2} s of one thread, {triangles} triangles");
    Ok(())
}

/// Converts a volume, `words` being its path and options, and adds levels.
fn make(out: &str, words: Vec<String>) -> alvis::Result<()> {
    let fixed = ["--for", "web", "--threads", "1", "--force"];
    let mut all = vec!["convert".to_owned(), words[0].clone(), out.to_owned()];
    all.extend(fixed.map(String::from));
    all.extend(words[1..].iter().cloned());
    let start = process_cpu();
    call(Call {
        words: all.into_iter().map(Into::into).collect(),
        volume: None,
        again: "",
        progress: &Quiet,
    })?;
    let converted = process_cpu() - start;
    let options = LodOptions {
        threads: 1,
        force: true,
        ..LodOptions::default()
    };
    let start = process_cpu();
    lod(out.as_ref(), &options, &Quiet)?;
    let levels = process_cpu() - start;
    println!(
        "CPU: convert {converted:.2} s, levels {levels:.2} s, {:.2} times as much",
        levels / converted
    );
    Ok(())
}

/// Some vertices of the tiles, each with its surface.
fn samples(set: &TileSet) -> alvis::Result<Vec<(u64, Point)>> {
    let mut all = Vec::new();
    for tile in set.tiles() {
        for piece in set.read_tile(&tile?)?.pieces {
            let surface = piece.ids.surface;
            all.extend(
                piece
                    .positions
                    .iter()
                    .step_by(SAMPLE)
                    .map(|p| (surface, *p)),
            );
        }
    }
    Ok(all)
}

/// The triangles of a level by surface and the cubes of space that their boxes touch.
#[derive(Default)]
struct Grid {
    triangles: Vec<[Point; 3]>,
    cubes: HashMap<(u64, [i32; 3]), Vec<u32>>,
    side: f32,
}

impl Grid {
    fn cube(&self, p: Point) -> [i32; 3] {
        p.map(|v| (v / self.side).floor() as i32)
    }

    fn add(&mut self, surface: u64, t: [Point; 3]) {
        let number = self.triangles.len() as u32;
        self.triangles.push(t);
        let end = |pick: fn(f32, f32) -> f32| -> Point {
            std::array::from_fn(|a| pick(pick(t[0][a], t[1][a]), t[2][a]))
        };
        let (low, high) = (self.cube(end(f32::min)), self.cube(end(f32::max)));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    self.cubes
                        .entry((surface, [x, y, z]))
                        .or_default()
                        .push(number);
                }
            }
        }
    }

    /// Distance of a point to a surface; none if that is gone within some cubes.
    fn distance(&self, surface: u64, p: Point) -> Option<f32> {
        let [x, y, z] = self.cube(p);
        let mut best = f32::INFINITY;
        for ring in 0..16i32 {
            if best <= (ring - 1) as f32 * self.side {
                break;
            }
            for dz in -ring..=ring {
                for dy in -ring..=ring {
                    for dx in -ring..=ring {
                        if dx.abs().max(dy.abs()).max(dz.abs()) != ring {
                            continue;
                        }
                        let near = self.cubes.get(&(surface, [x + dx, y + dy, z + dz]));
                        for &t in near.into_iter().flatten() {
                            best = best.min(to_triangle(p, &self.triangles[t as usize]));
                        }
                    }
                }
            }
        }
        best.is_finite().then_some(best)
    }
}

/// Christer Ericson: Real-Time Collision Detection, 5.1.5.
fn to_triangle(p: Point, [a, b, c]: &[Point; 3]) -> f32 {
    let minus = |u: &Point, v: &Point| -> Point { std::array::from_fn(|i| u[i] - v[i]) };
    let dot = |u: Point, v: Point| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (ab, ac) = (minus(b, a), minus(c, a));
    let at = |s: f32, t: f32| -> f32 {
        let q: Point = std::array::from_fn(|i| a[i] + s * ab[i] + t * ac[i]);
        let d = minus(&p, &q);
        dot(d, d).sqrt()
    };
    let ap = minus(&p, a);
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(0.0, 0.0);
    }
    let bp = minus(&p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return at(1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return at(d1 / (d1 - d3), 0.0);
    }
    let cp = minus(&p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return at(0.0, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(1.0 - w, w);
    }
    let all = va + vb + vc;
    at(vb / all, vc / all)
}

/// Counts over the nodes of a level.
#[derive(Default)]
struct Counts {
    edges: u64,
    crowded: u64,
    against: u64,
    cells: HashSet<u64>,
}

impl Counts {
    fn add(&mut self, node: &NodeMesh) {
        for piece in &node.pieces {
            self.cells.insert(piece.ids.cell);
            let mut edges: HashMap<[[u32; 3]; 2], u32> = HashMap::new();
            for t in &piece.triangles {
                let corners = piece.corners(*t);
                for k in 0..3 {
                    let ends = [corners[k], corners[(k + 1) % 3]].map(|p| p.map(f32::to_bits));
                    let key = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                    *edges.entry(key).or_default() += 1;
                }
                self.against += u64::from(is_against(piece, *t));
            }
            self.edges += edges.len() as u64;
            self.crowded += edges.values().filter(|n| **n > 2).count() as u64;
        }
        self.cells.remove(&0);
    }
}

/// True for a triangle that faces away from all of its normals.
fn is_against(piece: &SurfacePiece, t: [u32; 3]) -> bool {
    let [a, b, c] = piece.corners(t).map(glam::Vec3::from);
    let face = (b - a).cross(c - a);
    t.iter()
        .all(|&v| face.dot(piece.normals[v as usize].into()) < 0.0)
}

fn measure(set: &TileSet, level: &Level, samples: &[(u64, Point)]) -> alvis::Result<()> {
    let mut grid = Grid {
        side: 2.0 * (1 << level.level) as f32,
        ..Grid::default()
    };
    let mut counts = Counts::default();
    for node in set.nodes(level) {
        let node = set.read_node(&node?)?;
        counts.add(&node);
        for piece in &node.pieces {
            for t in &piece.triangles {
                grid.add(piece.ids.surface, piece.corners(*t));
            }
        }
    }
    let found = samples
        .iter()
        .map(|(surface, p)| grid.distance(*surface, *p));
    let mut distances: Vec<f32> = found.clone().flatten().collect();
    let gone = found.filter(Option::is_none).count();
    distances.sort_by(f32::total_cmp);
    let at = |share: f64| distances[((distances.len() - 1) as f64 * share) as usize];
    let mean = distances.iter().map(|d| f64::from(*d)).sum::<f64>() / distances.len() as f64;
    println!(
        "level {}: {} nodes, {} triangles, fins {:.3}, border edges {:.4}, {} cells, {} bytes",
        level.level,
        level.nodes,
        level.triangles,
        level.fin_triangles as f64 / level.triangles as f64,
        level.border_edges as f64 / level.triangles as f64,
        counts.cells.len(),
        level.bytes
    );
    println!(
        "  voxels off: mean {mean:.3}, 99.9 % {:.3}, most {:.3}, {gone} of {} gone; stated {:.3}, curves {:.3}",
        at(0.999),
        at(1.0),
        samples.len(),
        level.error_max,
        level.curve_tolerance
    );
    println!(
        "  {} of {} edges have more than two triangles, {:.4} % of triangles face against their normals",
        counts.crowded,
        counts.edges,
        100.0 * counts.against as f64 / level.triangles as f64
    );
    Ok(())
}

/// CPU seconds of this process, in hundredths.
fn process_cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // behind the name, which may hold blanks
    let rest = text.rsplit(')').next().unwrap_or_default();
    let ticks = rest.split_whitespace().skip(11).take(2);
    ticks.filter_map(|n| n.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// CPU seconds of this thread.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
    nanoseconds.unwrap_or(0.0) / 1e9
}

/// The time of simplifying the children of each node of level 1, joined, to its triangles, with its planes locked.
fn collapsed_alone(set: &TileSet, level: &Level) -> alvis::Result<(f64, usize)> {
    let tiles: HashMap<[u32; 3], _> = set
        .tiles()
        .map(|tile| tile.map(|t| (t.grid, t)))
        .collect::<alvis::Result<_>>()?;
    let (mut seconds, mut triangles) = (0.0, 0);
    for node in set.nodes(level) {
        let node = node?;
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let (mut places, mut indices) = (Vec::new(), Vec::new());
        for child in 0..8u32 {
            let at = [0, 1, 2].map(|a| 2 * node.grid[a] + (child >> a & 1));
            let Some(tile) = tiles.get(&at) else {
                continue;
            };
            for piece in set.read_tile(tile)?.pieces {
                let mut number = |p: &Point| {
                    *known.entry(p.map(f32::to_bits)).or_insert_with(|| {
                        places.push(*p);
                        places.len() as u32 - 1
                    })
                };
                let map: Vec<u32> = piece.positions.iter().map(&mut number).collect();
                let corners = piece.triangles.as_flattened();
                indices.extend(corners.iter().map(|&v| map[v as usize]));
            }
        }
        let locked: Vec<bool> = places
            .iter()
            .map(|p| (0..3).any(|a| p[a].rem_euclid(level.macrocube[a] as f32) == 0.0))
            .collect();
        let start = cpu();
        let vertices = VertexDataAdapter::new(typed_to_bytes(&places), 12, 0).expect("vertices");
        let left = simplify_with_locks(
            &indices,
            &vertices,
            &locked,
            3 * node.triangles as usize,
            f32::MAX,
            SimplifyOptions::ErrorAbsolute,
            None,
        );
        seconds += cpu() - start;
        triangles += left.len() / 3;
    }
    Ok((seconds, triangles))
}
