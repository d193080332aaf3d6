//! The split in parts is that of the whole volume.

use super::*;
use crate::sys::spill_file::{Mark, SpillFile};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A part, and what it has left so far.
struct Part {
    options: SplitOptions,
    beside: Beside,
    dir: tempfile::TempDir,
    basins: Option<BasinsFound>,
}

impl Part {
    fn found(&self) -> &BasinsFound {
        self.basins.as_ref().unwrap()
    }
}

fn open<const N: usize>(dir: &Path, names: [&str; N], marks: [Mark; N]) -> [SpillFile; N] {
    std::array::from_fn(|i| SpillFile::open(&dir.join(names[i]), marks[i]).unwrap())
}

fn all<T: bytemuck::Pod>(spool: &SpillFile) -> Vec<T> {
    let mut all = Vec::new();
    let each = |record| {
        all.push(record);
        Ok(())
    };
    spool.each(each).unwrap();
    all
}

/// Parts with these slices, each cut in its own way, with what passing the others makes of their columns.
fn parts(solid: &Solid, whole: &SplitOptions, cuts: &[u32], random: &mut Random) -> Vec<Part> {
    let (reach, dims) = (whole.metric.reach(), whole.grid.dims);
    let [_, ny, _] = dims.0;
    let mut parts = Vec::new();
    let mut passages = Vec::new();
    for cut in cuts.windows(2) {
        let grid = SlabGrid {
            height: 1 + random.below((cut[1] - cut[0]) as usize) as u32,
            band: 1 + random.below(ny as usize) as u32,
            ..whole.grid.of_slices(cut[0]..cut[1])
        };
        let passage = Passage::of(&mut solid.clone(), grid, reach, &Quiet);
        passages.push(passage.unwrap());
        parts.push(Part {
            options: SplitOptions { grid, ..*whole },
            beside: Beside::unknown(dims, reach),
            dir: tempfile::tempdir().unwrap(),
            basins: None,
        });
    }
    for (at, part) in parts.iter_mut().enumerate() {
        let (before, behind) = (&passages[..at], &passages[at + 1..]);
        for other in before {
            pass(&mut part.beside.before, &other.up, other.slices, reach);
        }
        for other in behind.iter().rev() {
            pass(&mut part.beside.behind, &other.down, other.slices, reach);
        }
    }
    parts
}

/// What a split in parts gives, in the form of the reference, and the most trees that joining parts had in memory.
fn found_in_parts(solid: &Solid, whole: &SplitOptions, mut parts: Vec<Part>) -> (RefSplit, usize) {
    let work = tempfile::tempdir().unwrap();
    let dims = whole.grid.dims;
    for part in &mut parts {
        let (beside, dir) = (part.beside.clone(), part.dir.path());
        let basins = find_basins(&mut solid.clone(), &part.options, beside, dir, &Quiet);
        part.basins = Some(basins.unwrap());
    }
    let counts: Vec<u64> = parts.iter().map(|part| part.found().count).collect();
    let mut merger = BasinMerger::new(dims, &counts, work.path()).unwrap();
    let seam = |at: usize| &parts[at].found().seam;
    for at in 1..parts.len() {
        merger
            .join(at - 1, seam(at - 1), seam(at))
            .unwrap()
            .unwrap();
    }
    for at in 0..parts.len() {
        merger.note_peaks(at, seam(at)).unwrap();
    }
    let named: Vec<_> = (0..parts.len())
        .map(|at| merger.named(at, seam(at)).unwrap())
        .collect();
    let basins = merger.basins(&counts);
    let (first, names) = first_names(&counts);
    let known = |at: usize| {
        let below = match at.checked_sub(1) {
            Some(below) => slice_below(seam(below).clone(), named[below].clone()),
            None => SliceBelow::default(),
        };
        let own = named[at].clone();
        KnownBasins {
            files: open(parts[at].dir.path(), BASIN_FILES, parts[at].found().marks),
            names: BasinNames::of(first[at], counts[at], seam(at), own, below),
        }
    };
    let mut cells = CellMerger::new(whole.rule, whole.metric, names, work.path()).unwrap();
    let (mut begins, mut saddles, mut kept) = (BTreeSet::new(), Vec::new(), Vec::new());
    for (at, part) in parts.iter().enumerate() {
        let (beside, dir) = (part.beside.clone(), part.dir.path());
        let source = &mut solid.clone();
        let made = find_saddles(source, &part.options, beside, known(at), dir, &Quiet).unwrap();
        let [bits, links, told, trees, edges] = open(dir, JOIN_FILES, made.joins);
        for (word, bits) in all::<u64>(&bits).into_iter().enumerate() {
            let set = (0..64).filter(|bit| bits >> bit & 1 == 1);
            begins.extend(set.map(|bit| first[at] + 64 * word as u64 + bit));
        }
        let ([all_saddles, necks], cuts) = made.counts;
        cells.judge.add(all_saddles, necks, &cuts);
        let mut retire = |basin| {
            begins.remove(&basin);
            Ok(())
        };
        for link in all(&links) {
            cells.join(link, &mut retire).unwrap();
        }
        let mut each = |saddle| {
            saddles.push(saddle);
            Ok(())
        };
        let (trees, edges) = (all(&trees), all::<RestEdge>(&edges));
        let added = cells.add(&trees, edges.into_iter(), &mut retire, &mut each);
        added.unwrap();
        kept.push((made.kept, all::<u64>(&told)));
    }
    let begins: Vec<u64> = begins.into_iter().collect();
    let mut cell = |basin| {
        let first = cells.first_of(basin).unwrap();
        begins.binary_search(&first).unwrap() as u64 + 1
    };
    let mut of_voxels = vec![0; solid.voxels.len()];
    let mut necks: BTreeMap<[u64; 2], Neck> = BTreeMap::new();
    let mut take = |neck: Neck| {
        let known = necks
            .entry(neck.cells)
            .and_modify(|known| known.merge(&neck));
        known.or_insert(neck);
        Ok(())
    };
    for saddle in saddles {
        let [a, b] = saddle.basins.map(&mut cell);
        if a != b {
            take(Neck {
                cells: [a.min(b), a.max(b)],
                ..saddle.neck()
            })
            .unwrap();
        }
    }
    for (at, (marks, told)) in kept.into_iter().enumerate() {
        let (options, dir) = (&parts[at].options, parts[at].dir.path());
        let told: Vec<(u64, u64)> = told.into_iter().map(|name| (name, cell(name))).collect();
        let begun = |name| Ok(begins.binary_search(&name).unwrap() as u64 + 1);
        let files = open(dir, SADDLE_FILES, marks);
        let mut rows = rows_of(options, known(at), files, &told, begun, dir).unwrap();
        for slab in 0..options.grid.slabs() {
            let row = |y: u32, z: u32, pieces: &[PartPiece]| {
                let at = solid.index([0, y as usize, z as usize]);
                for piece in pieces {
                    of_voxels[at + piece.start as usize..=at + piece.last as usize]
                        .fill(piece.part);
                }
                Ok(())
            };
            rows.slab(slab, row).unwrap();
        }
        let below = |y: u32, z: u32, pieces: &[PartPiece]| {
            let at = solid.index([0, y as usize, z as usize]);
            for piece in pieces {
                let same = &of_voxels[at + piece.start as usize..=at + piece.last as usize];
                assert!(same.iter().all(|&part| part == piece.part));
            }
            Ok(())
        };
        rows.below(below).unwrap();
        rows.necks(dir, &mut take).unwrap();
    }
    let (curve, count) = cells.cells(basins);
    assert_eq!(count, begins.len() as u64);
    let neck = |neck: Neck| RefNeck {
        cells: neck.cells,
        voxel: neck.voxel,
        level: neck.level.into(),
        peak: neck.peak.into(),
        faces: neck.faces,
    };
    let found = RefSplit {
        parts: of_voxels,
        component: Vec::new(),
        necks: necks.into_values().map(neck).collect(),
        curve: curve.iter().map(|point| point.1).collect(),
        basins,
    };
    (found, cells.most_trees())
}

fn compare(seed: u64, volumes: usize) {
    let mut random = Random(seed);
    for k in 0..volumes {
        let solid = random_volume(&mut random, k);
        let mut case = random_case(&mut random);
        if k % 2 == 0 {
            case.weights = [1; 3];
        }
        let expected = RefSplit {
            component: Vec::new(),
            ..reference::split(&solid, &case)
        };
        let [.., nz] = solid.dims;
        let options = options(&case, solid.grid(1, 1), 1 + random.below(2));
        let mut cuts: Vec<u32> = (0..1 + random.below(4))
            .map(|_| random.below(nz) as u32)
            .chain([0, nz as u32])
            .collect();
        cuts.sort_unstable();
        cuts.dedup();
        let parts = parts(&solid, &options, &cuts, &mut random);
        let same = found_in_parts(&solid, &options, parts).0 == expected;
        assert!(
            same,
            "seed {seed}, volume {k}: {:?} {cuts:?} {options:?}",
            solid.dims
        );
    }
}

#[test]
fn random_volumes_in_parts_equal_the_definition_1() {
    compare(11, 600);
}

#[test]
fn random_volumes_in_parts_equal_the_definition_2() {
    compare(12, 600);
}

/// Walls with holes, of so many layers of cells.
fn layers_of_cells(layers: usize) -> Solid {
    let dims = [21, 21, 10 * layers];
    let mut random = Random(5);
    let mut solid = Solid {
        dims,
        voxels: vec![false; dims.iter().product()],
    };
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let wall = [x, y, z].iter().any(|v| v % 10 == 0);
                let at = solid.index([x, y, z]);
                solid.voxels[at] = wall && random.chance(0.9);
            }
        }
    }
    solid
}

#[test]
fn joining_more_parts_takes_no_more_memory() {
    let most = [6, 24].map(|layers| {
        let solid = layers_of_cells(layers);
        let options = SplitOptions::new(solid.grid(1, 1));
        // cells lie in two parts each, and in three
        let cuts: Vec<u32> = (0..2 * layers as u32)
            .map(|cut| 5 * cut + cut % 2)
            .chain([10 * layers as u32])
            .collect();
        let mut random = Random(1);
        let parts = parts(&solid, &options, &cuts, &mut random);
        let (found, most) = found_in_parts(&solid, &options, parts);
        assert!(found.necks.len() > 4 * layers);
        most
    });
    assert!(most[0] > 4 && most[1] < 2 * most[0], "{most:?}");
}

#[test]
fn parts_of_different_volumes_do_not_fit() {
    let [solid, mut other] = [6, 6].map(layers_of_cells);
    let options = SplitOptions::new(solid.grid(1, 1));
    let mut random = Random(1);
    let mut parts = parts(&solid, &options, &[0, 27, 60], &mut random);
    // what the upper part has below it is solid in the lower one
    let [nx, ny, _] = other.dims;
    other.voxels[26 * nx * ny..27 * nx * ny].fill(true);
    for (part, solid) in parts.iter_mut().zip([&other, &solid]) {
        let (beside, dir) = (part.beside.clone(), part.dir.path());
        let basins = find_basins(&mut solid.clone(), &part.options, beside, dir, &Quiet);
        part.basins = Some(basins.unwrap());
    }
    let work = tempfile::tempdir().unwrap();
    let [below, above] = [0, 1].map(|at| &parts[at].found().seam);
    let counts = [parts[0].found().count, parts[1].found().count];
    let mut merger = BasinMerger::new(options.grid.dims, &counts, work.path()).unwrap();
    let misfit = merger.join(0, below, above).unwrap().unwrap_err();
    assert!(misfit.contains(", 26 in one of them"), "{misfit}");
}

#[test]
fn a_seam_comes_back_unless_it_is_changed() {
    let solid = layers_of_cells(2);
    let options = SplitOptions::new(solid.grid(1, 1));
    let parts = parts(&solid, &options, &[0, 7, 13, 20], &mut Random(2));
    let part = &parts[1];
    let (beside, dir) = (part.beside.clone(), part.dir.path());
    let basins = find_basins(&mut solid.clone(), &part.options, beside, dir, &Quiet);
    let seam = basins.unwrap().seam;
    assert!(!seam.open.is_empty() && !seam.up.is_empty() && !seam.down.is_empty());
    let path = dir.join("seam");
    seam.write(&path).unwrap();
    assert_eq!(BasinSeam::read(&path).unwrap(), seam);
    let bytes = std::fs::read(&path).unwrap();
    for at in (0..bytes.len()).step_by(7) {
        let mut other = bytes.clone();
        other[at] ^= 16;
        std::fs::write(&path, other).unwrap();
        assert!(BasinSeam::read(&path).is_err(), "{at}");
    }
}
