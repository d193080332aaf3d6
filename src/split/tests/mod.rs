//! The split against its definition, on shapes whose cells are known, and on phantoms.

mod in_parts;
mod phantoms;
mod reference;
mod shapes;

use super::distance::{Block, DistanceBuffers, Level, levels};
use super::*;
use crate::grid::Dims;
use crate::progress::Quiet;
use proptest::prelude::*;
use reference::{Case, RefNeck, RefSplit, Solid};

/// Numbers that look random (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }

    fn chance(&mut self, share: f64) -> bool {
        (self.next() >> 11) as f64 / ((1u64 << 53) as f64) < share
    }
}

impl BitSource for Solid {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
        words.fill(0);
        let [nx, ny, _] = self.dims;
        for y in 0..ny {
            for x in 0..nx {
                let bit = u64::from(self.voxels[self.index([x, y, z as usize])]);
                words[y * nx.div_ceil(64) + x / 64] |= bit << (x % 64);
            }
        }
        Ok(())
    }
}

impl Solid {
    fn grid(&self, height: usize, band: usize) -> SlabGrid {
        SlabGrid {
            dims: Dims(self.dims.map(|n| n as u32)),
            slices: [0, self.dims[2] as u32],
            height: height as u32,
            band: band as u32,
        }
    }
}

/// What a split gives, in the form of the reference.
fn found(solid: &Solid, options: &SplitOptions) -> RefSplit {
    let dir = tempfile::tempdir().unwrap();
    let mut split = split(&mut solid.clone(), options, dir.path(), &Quiet).unwrap();
    let mut parts = vec![0; solid.voxels.len()];
    for slab in 0..options.grid.slabs() {
        let rows = split.slab(slab, |y, z, pieces| {
            assert!(pieces.is_sorted_by(|a, b| {
                a.last < b.start && (a.part != b.part || a.last + 1 < b.start)
            }));
            for piece in pieces {
                let at = solid.index([0, y as usize, z as usize]);
                parts[at + piece.start as usize..=at + piece.last as usize].fill(piece.part);
            }
            Ok(())
        });
        rows.unwrap();
    }
    let mut necks = Vec::new();
    let each = |neck: Neck| {
        necks.push(RefNeck {
            cells: neck.cells,
            voxel: neck.voxel,
            level: neck.level.into(),
            peak: neck.peak.into(),
            faces: neck.faces,
        });
        Ok(())
    };
    split.necks(each).unwrap();
    let counts = split.counts();
    let component = (1..=counts.parts).map(|part| split.component(part).unwrap());
    let component: Vec<u64> = component.collect();
    assert_eq!(
        component.iter().max().copied().unwrap_or(0),
        counts.components
    );
    RefSplit {
        parts,
        component,
        necks,
        curve: split.curve().iter().map(|point| point.1).collect(),
        basins: counts.basins,
    }
}

fn options(case: &Case, grid: SlabGrid, threads: usize) -> SplitOptions {
    SplitOptions {
        rule: NeckRule {
            ratio_permille: case.permille as u32,
            h_256: case.h_256 as u32,
            min_radius_256: case.min_radius_256 as u32,
        },
        ambiguous: case.ambiguous,
        metric: Metric::new(case.weights.map(|w| w as u32), case.reach as u8),
        grid,
        threads,
    }
}

fn random_volume(random: &mut Random, kind: usize) -> Solid {
    let dims = match kind % 8 {
        7 => [
            60 + random.below(75),
            1 + random.below(5),
            1 + random.below(5),
        ],
        _ => [(); 3].map(|()| 1 + random.below(12)),
    };
    let n = dims.iter().product();
    let mut solid = Solid {
        dims,
        voxels: Vec::new(),
    };
    let density = random.one_of(&[0.005, 0.02, 0.1, 0.3, 0.6]);
    solid.voxels = match kind % 3 {
        0 => (0..n).map(|_| random.chance(density)).collect(),
        1 if random.chance(0.1) => vec![false; n],
        1 => {
            // blobs: solid where neighbours of an earlier draw are
            let draw: Vec<bool> = (0..n).map(|_| random.chance(0.5)).collect();
            let [nx, ny, nz] = dims;
            let least = random.one_of(&[13, 14, 16]);
            let count = |x: usize, y: usize, z: usize| {
                let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
                let (mut all, mut set) = (0, 0);
                for z in near(z, nz) {
                    for y in near(y, ny) {
                        for x in near(x, nx) {
                            all += 1;
                            set += usize::from(draw[solid.index([x, y, z])]);
                        }
                    }
                }
                27 * set >= least * all
            };
            (0..n)
                .map(|i| count(i % nx, i / nx % ny, i / nx / ny))
                .collect()
        }
        // walls with holes
        _ => {
            let [nx, ny, _] = dims;
            let pitch = 3 + random.below(5);
            let wall = |i: usize| {
                [i % nx, i / nx % ny, i / nx / ny]
                    .iter()
                    .any(|v| v % pitch == 0)
            };
            (0..n).map(|i| wall(i) && random.chance(0.9)).collect()
        }
    };
    solid
}

fn random_case(random: &mut Random) -> Case {
    Case {
        weights: [(); 3].map(|()| random.one_of(&[1, 1, 1, 1, 2, 4, 7])),
        unit: 1,
        reach: random.one_of(&[2, 3, 5, 9, 255]),
        ambiguous: random.one_of(&[Ambiguous::Separate, Ambiguous::Join]),
        permille: random.one_of(&[300, 600, 800, 900, 1000]),
        h_256: random.one_of(&[0, 128, 256, 512]),
        min_radius_256: random.one_of(&[0, 0, 256]),
    }
}

fn compare(seed: u64, volumes: usize) {
    let mut random = Random(seed);
    let (mut cut, mut joined) = (0, 0);
    for k in 0..volumes {
        let solid = random_volume(&mut random, k);
        let mut case = random_case(&mut random);
        if k % 2 == 0 {
            case.weights = [1; 3];
        }
        let expected = reference::split(&solid, &case);
        cut += expected.necks.iter().filter(|neck| neck.peak > 0).count();
        joined += expected.basins - expected.component.len() as u64;
        let [_, ny, nz] = solid.dims;
        let grid = solid.grid(1 + random.below(nz + 1), 1 + random.below(ny + 1));
        let options = options(&case, grid, 1 + random.below(3));
        let same = found(&solid, &options) == expected;
        assert!(
            same,
            "seed {seed}, volume {k}: {dims:?} {options:?}",
            dims = solid.dims
        );
    }
    assert!(
        cut > volumes && joined as usize > volumes,
        "{cut} cut, {joined} joined"
    );
}

#[test]
fn random_volumes_equal_the_definition_whatever_the_cut_1() {
    compare(1, 1000);
}

#[test]
fn random_volumes_equal_the_definition_whatever_the_cut_2() {
    compare(2, 1000);
}

#[test]
fn random_volumes_equal_the_definition_whatever_the_cut_3() {
    compare(3, 1000);
}

#[test]
fn caps_beyond_two_bytes_are_as_exact() {
    let mut random = Random(4);
    for k in 0..40 {
        let solid = random_volume(&mut random, k);
        let spacing = random.one_of(&[[1.0, 1.0, 2.5], [0.7, 0.5, 0.5], [1.0, 1.3, 4.0]]);
        let mut case = random_case(&mut random);
        let metric = Metric::of_spacing(spacing, case.reach as u8);
        case.weights = metric.weights().map(u64::from);
        case.unit = u64::from(metric.unit());
        let grid = solid.grid(1 + random.below(4), 1 + random.below(4));
        let options = SplitOptions {
            metric,
            ..options(&case, grid, 1)
        };
        assert_eq!(
            found(&solid, &options),
            reference::split(&solid, &case),
            "{k}"
        );
    }
}

proptest! {
    #[test]
    fn any_volume_equals_the_definition(
        dims in (1usize..9, 1usize..9, 1usize..9), seed in any::<u64>(), share in 0.0f64..0.7,
        cut in (1usize..9, 1usize..9), join: bool,
    ) {
        let dims: [usize; 3] = dims.into();
        let mut random = Random(seed);
        let n = dims.iter().product();
        let solid = Solid { dims, voxels: (0..n).map(|_| random.chance(share)).collect() };
        let ambiguous = if join { Ambiguous::Join } else { Ambiguous::Separate };
        let case = Case { ambiguous, ..random_case(&mut random) };
        let options = options(&case, solid.grid(cut.0, cut.1), 1);
        prop_assert_eq!(found(&solid, &options), reference::split(&solid, &case));
    }
}

/// Levels of all blocks of a volume, and whether what is around blocks has the levels of the volume.
fn levels_of<T: Level>(solid: &Solid, metric: &Metric, grid: SlabGrid) -> Vec<u64> {
    let dir = tempfile::tempdir().unwrap();
    let mut source = solid.clone();
    let reach = metric.reach();
    let beside = Beside::unknown(grid.dims, reach);
    let bits = bits::SolidBits::gather(&mut source, grid, reach, beside, dir.path(), &Quiet);
    let bits = bits.unwrap();
    let mut all = vec![None; solid.voxels.len()];
    let mut buffers = DistanceBuffers::default();
    for block in grid.blocks() {
        let Block { y, z, .. } = block.clone();
        let levels = levels::<T>(&bits, metric, &block, &mut buffers).unwrap();
        for k in z.start.saturating_sub(1)..(z.end + 1).min(grid.dims.0[2]) {
            for j in y.start.saturating_sub(1)..(y.end + 1).min(grid.dims.0[1]) {
                let row = levels.row((j + 1 - y.start) as usize, (k + 1 - z.start) as usize);
                for (x, level) in row.iter().enumerate() {
                    let at = solid.index([x, j as usize, k as usize]);
                    let level = u64::from(level.get());
                    assert_eq!(*all[at].get_or_insert(level), level);
                }
            }
        }
    }
    all.into_iter().map(Option::unwrap).collect()
}

#[test]
fn levels_of_blocks_are_those_of_the_volume() {
    let mut random = Random(5);
    for k in 0..200 {
        let solid = random_volume(&mut random, k);
        let case = random_case(&mut random);
        let metric = Metric::new(case.weights.map(|w| w as u32), case.reach as u8);
        let expected = solid.levels(&case);
        // every solid voxel tried, where there are few
        let voxels = || {
            (0..solid.voxels.len()).map(|i| {
                let [nx, ny, _] = solid.dims;
                (i, [i % nx, i / nx % ny, i / nx / ny])
            })
        };
        for (i, here) in voxels().step_by(17) {
            let solids = voxels().filter(|&(j, _)| solid.voxels[j]);
            let squares = solids.map(|(_, there)| -> u64 {
                (0..3)
                    .map(|a| case.weights[a] * here[a].abs_diff(there[a]).pow(2) as u64)
                    .sum()
            });
            let cap = case.reach * case.reach;
            assert_eq!(expected[i], squares.min().unwrap_or(cap).min(cap));
        }
        let grid = solid.grid(1 + random.below(6), 1 + random.below(6));
        assert_eq!(levels_of::<u16>(&solid, &metric, grid), expected, "{k}");
        assert_eq!(levels_of::<u32>(&solid, &metric, grid), expected, "{k}");
    }
}

#[test]
fn a_higher_ratio_only_splits_further() {
    let mut random = Random(6);
    for k in 0..100 {
        let solid = random_volume(&mut random, k);
        let case = random_case(&mut random);
        let mut coarser: Option<Vec<u64>> = None;
        for permille in [300, 500, 700, 800, 1000] {
            let case = Case { permille, ..case };
            let finer = found(&solid, &options(&case, solid.grid(4, 4), 1)).parts;
            let mut inside = std::collections::BTreeMap::new();
            for (&fine, &coarse) in finer.iter().zip(coarser.iter().flatten()) {
                assert_eq!(*inside.entry(fine).or_insert(coarse), coarse);
            }
            coarser = Some(finer);
        }
    }
}

#[test]
fn options_out_of_range_are_refused() {
    let solid = Solid {
        dims: [2; 3],
        voxels: vec![false; 8],
    };
    for ratio_permille in [0, 1001] {
        let mut options = SplitOptions::new(solid.grid(1, 1));
        options.rule.ratio_permille = ratio_permille;
        let dir = tempfile::tempdir().unwrap();
        let error = split(&mut solid.clone(), &options, dir.path(), &Quiet).unwrap_err();
        assert!(error.to_string().contains("--split"), "{error}");
    }
}
