//! Phantoms of foams with known bubbles, in the shared data (`ALVIS_DATA`, by default `../shared/data`).

use super::*;
use crate::grid::{Dtype, Fill};
use crate::volume::{Filled, OpenOptions, RegionVoxels, Volume};
use crate::volume::{fill_value, find_cylinder, open, statistics};
use std::path::PathBuf;

/// Voxels along each axis.
const SIDE: usize = 200;

fn data(name: &str) -> Option<PathBuf> {
    let dir = std::env::var_os("ALVIS_DATA").map_or_else(|| "../shared/data".into(), PathBuf::from);
    let path = dir.join("phantom").join(name);
    if !path.exists() {
        eprintln!(
            "SKIPPED: no {} (set ALVIS_DATA to its directory)",
            path.display()
        );
    }
    path.exists().then_some(path)
}

/// Bits of a volume of one or two bytes.
struct Bits<'a> {
    volume: &'a dyn Volume,
    threshold: f64,
}

impl BitSource for Bits<'_> {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
        let header = self.volume.header();
        let [nx, ny, _] = header.dims.0;
        let mut bytes = vec![0; header.dims.slice_voxels() as usize * header.dtype.bytes()];
        self.volume.read_box(0..nx, 0..ny, z..z + 1, &mut bytes)?;
        let values: Vec<u16> = match header.dtype {
            Dtype::U8 => bytes.iter().map(|&v| v.into()).collect(),
            _ => bytemuck::pod_collect_to_vec(&bytes),
        };
        words.fill(0);
        let rows = values.chunks(nx as usize);
        for (row, words) in rows.zip(words.chunks_mut(nx.div_ceil(64) as usize)) {
            for (x, &value) in row.iter().enumerate() {
                words[x / 64] |= u64::from(f64::from(value) >= self.threshold) << (x % 64);
            }
        }
        Ok(())
    }
}

/// Cells of all voxels of a volume with the usual rule.
fn labels(volume: &dyn Volume, threshold: f64) -> Vec<u64> {
    let dims = volume.header().dims;
    let dir = tempfile::tempdir().unwrap();
    let grid = SlabGrid::fitting(dims, 64 << 20, 2);
    let mut bits = Bits { volume, threshold };
    let mut split = split(&mut bits, &SplitOptions::new(grid), dir.path(), &Quiet).unwrap();
    let mut labels = vec![0; dims.voxels() as usize];
    for slab in 0..grid.slabs() {
        let rows = split.slab(slab, |y, z, pieces| {
            let at = dims.linear([0, y, z]) as usize;
            for piece in pieces {
                labels[at + piece.start as usize..=at + piece.last as usize].fill(piece.part);
            }
            Ok(())
        });
        rows.unwrap();
    }
    labels
}

/// Centre and radius.
type Ball = [f64; 4];

fn balls(name: &str) -> Option<Vec<Ball>> {
    let text = std::fs::read_to_string(data(name)?).unwrap();
    let ball = |line: &str| -> Ball {
        let numbers: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    Some(text.lines().skip(1).map(ball).collect())
}

/// How a bubble was found again.
struct Match {
    /// Voxels of both over voxels of either, of the cell with the most.
    overlap: f64,
    /// Difference of the volumes over the true one.
    error: f64,
    /// Cells that hold more than a fifth of it.
    cells: usize,
}

/// Compares cells with balls; a voxel of air is of the ball in which it is deepest, by the radical planes of the balls.
fn matches(labels: &[u64], balls: &[Ball]) -> Vec<Match> {
    let mut ball_of = vec![(0.0, usize::MAX); labels.len()];
    for (i, &[cx, cy, cz, radius]) in balls.iter().enumerate() {
        let near = |c: f64| {
            let range = (c - radius).max(0.0) as usize..(c + radius + 1.0) as usize;
            range.start..range.end.min(SIDE)
        };
        for z in near(cz) {
            for y in near(cy) {
                for x in near(cx) {
                    let d = [x as f64 - cx, y as f64 - cy, z as f64 - cz];
                    let depth = d.iter().map(|v| v * v).sum::<f64>() - radius * radius;
                    let at = &mut ball_of[(z * SIDE + y) * SIDE + x];
                    if depth < at.0 {
                        *at = (depth, i);
                    }
                }
            }
        }
    }
    let mut sizes = vec![0; *labels.iter().max().unwrap() as usize + 1];
    let mut shared = vec![std::collections::BTreeMap::<u64, usize>::new(); balls.len()];
    for (&label, &(_, ball)) in labels.iter().zip(&ball_of) {
        sizes[label as usize] += 1;
        if let Some(cells) = shared.get_mut(ball).filter(|_| label > 0) {
            *cells.entry(label).or_default() += 1;
        }
    }
    let found = |cells: std::collections::BTreeMap<u64, usize>| {
        let volume: usize = cells.values().sum();
        let overlap = |(&cell, &both): (&u64, &usize)| {
            let size = sizes[cell as usize];
            let error = (size as f64 - volume as f64).abs() / volume as f64;
            (both as f64 / (size + volume - both) as f64, error)
        };
        let best = cells
            .iter()
            .map(overlap)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap();
        Match {
            overlap: best.0,
            error: best.1,
            cells: cells.values().filter(|&&both| 5 * both > volume).count(),
        }
    };
    shared.into_iter().map(found).collect()
}

fn share(matches: &[Match], overlap: f64) -> f64 {
    let found = matches.iter().filter(|m| m.overlap > overlap).count();
    found as f64 / matches.len() as f64
}

fn foam(kind: &str) -> Option<Vec<Match>> {
    let path = data(&format!("foam_{kind}_200x200x200_uint8.raw.gz"))?;
    let options = OpenOptions {
        dims: Some([SIDE as u64; 3]),
        dtype: Some(Dtype::U8),
        ..OpenOptions::default()
    };
    let volume = open(&path, &options).unwrap().volume;
    let balls = balls(&format!("foam_{kind}_200_bubbles.csv"))?;
    Some(matches(&labels(&*volume, 130.0), &balls))
}

#[test]
fn bubbles_of_a_leaky_foam_are_found_again() {
    let Some(found) = foam("leaky") else { return };
    let [half, most] = [0.5, 0.8].map(|overlap| share(&found, overlap));
    assert!(half >= 0.99 && most >= 0.96, "{half} {most}");
    let twice = found.iter().filter(|m| m.cells > 1).count();
    assert_eq!(twice, 0, "bubbles that were split");
    let mut errors: Vec<f64> = found
        .iter()
        .filter(|m| m.overlap > 0.5)
        .map(|m| m.error)
        .collect();
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    assert!(median <= 0.0035, "{median}");
}

#[test]
fn bubbles_of_a_closed_foam_are_all_found() {
    let Some(found) = foam("closed") else { return };
    assert_eq!(share(&found, 0.8), 1.0);
    assert!(found.iter().all(|m| m.cells == 1));
}

#[test]
fn whole_bubbles_of_a_scan_with_artefacts_are_found() {
    let (Some(path), Some(balls)) = (
        data("foam_leaky_200_ct.nrrd"),
        balls("foam_leaky_200_bubbles.csv"),
    ) else {
        return;
    };
    let volume = open(&path, &OpenOptions::default()).unwrap().volume;
    let cylinder = find_cylinder(&*volume, 0..200, &Quiet).unwrap();
    let region = RegionVoxels::cylinder(&cylinder.cylinder, volume.header().dims).unwrap();
    let otsu = statistics(&*volume, Some(&region), &Quiet)
        .unwrap()
        .otsu
        .unwrap();
    let value = fill_value(&*volume, &region, otsu, Fill::Material, &Quiet).unwrap();
    let filled = Filled::new(volume, region, value).unwrap();
    let found = matches(&labels(&filled, otsu), &balls);
    let middle = (SIDE as f64 - 1.0) / 2.0;
    let is_whole = |[x, y, z, r]: &Ball| {
        libm::hypot(x - middle, y - middle) + r < 94.0 && z - r > 2.0 && z + r < 197.0
    };
    let whole: Vec<Match> = found
        .into_iter()
        .zip(&balls)
        .filter(|(_, ball)| is_whole(ball))
        .map(|m| m.0)
        .collect();
    assert!(whole.len() > 150, "{}", whole.len());
    assert!(share(&whole, 0.8) >= 0.99, "{}", share(&whole, 0.8));
}
