//! Components across bands and slabs.
//!
//! Per slab, the local components of all bands and the components that came over from the slab
//! before are joined to *classes*. Only the labels of the last slice's runs and the records of
//! components that touch it are kept for the next slab.

use crate::error::Result;
use crate::measure::VoxelSums;
use crate::segment::births::Births;
use crate::segment::label::Labels;
use crate::segment::runs::Runs;
use crate::segment::unionfind::UnionFind;
use crate::slab::Bits;

/// What the joining of bands needs to know of one band.
#[derive(Debug, Clone, Default)]
pub struct BandEdges {
    /// Local components of the runs of the band's first row, all slices.
    first_row: Vec<u32>,
    /// The same of its last row, which is the next band's first.
    last_row: Vec<u32>,
    /// Local components of the runs of the first slice, all rows.
    first_slice: Vec<u32>,
    /// The same of the last slice, which is the next slab's first.
    last_slice: Vec<u32>,
    /// Runs of the first row in the first slice.
    head_runs_first: usize,
    /// Runs of the first row in the last slice.
    head_runs_last: usize,
}

impl BandEdges {
    /// Takes the outer rows' and slices' labels of a band of a grid of `slices` slices. Slices at the
    /// grid's ends are shared with no slab, so theirs are left out.
    pub fn of(bits: &Bits, runs: &Runs, labels: &Labels, grid_slices: u32) -> Self {
        let shared_first = bits.span.z.start > 0;
        let shared_last = bits.span.z.end < grid_slices;
        let (rows, slices) = (bits.span.rows(), bits.span.slices());
        let run_of_row = |row: usize| -> usize {
            runs.word_run
                .get(row * bits.row_words)
                .map_or(runs.count, |&r| r as usize)
        };
        let row_labels = |s: usize, r: usize| {
            let row = s * rows + r;
            &labels.of_run[run_of_row(row)..run_of_row(row + 1)]
        };
        let slice_labels =
            |s: usize| &labels.of_run[run_of_row(s * rows)..run_of_row((s + 1) * rows)];
        let column = |r: usize| {
            (0..slices)
                .flat_map(|s| row_labels(s, r))
                .copied()
                .collect()
        };
        BandEdges {
            first_row: column(0),
            last_row: column(rows - 1),
            first_slice: if shared_first {
                slice_labels(0).to_vec()
            } else {
                Vec::new()
            },
            last_slice: if shared_last {
                slice_labels(slices - 1).to_vec()
            } else {
                Vec::new()
            },
            head_runs_first: row_labels(0, 0).len(),
            head_runs_last: if shared_last {
                row_labels(slices - 1, 0).len()
            } else {
                0
            },
        }
    }
}

/// A component that can still grow, or has just finished.
#[derive(Debug, Clone, Copy)]
pub struct ClassRecord {
    /// Its number, see [`Births`]. Objects and cells are numbered apart.
    pub birth: u64,
    /// Phase.
    pub above: bool,
    /// Sums of its voxels so far.
    pub sums: VoxelSums,
}

/// The classes of one slab.
#[derive(Debug, Clone, Default)]
pub struct SlabClasses {
    /// Per band, the class of each local component.
    pub of_local: Vec<Vec<u32>>,
    /// All classes: first those that came over, by birth, then new ones by smallest voxel.
    pub records: Vec<ClassRecord>,
    /// For each component live at the end of the slab before: its class here.
    pub from_previous: Vec<u32>,
    /// Classes that touch the last slice, by rising number: live in the next slab.
    pub live: Vec<u32>,
}

/// The sweep's state between slabs.
#[derive(Debug, Default)]
pub struct Classes {
    /// Live component (index into `live`) of each run of the last slice, rows in order.
    last_slice: Vec<u32>,
    live: Vec<ClassRecord>,
    sets: UnionFind,
}

/// The numbers of objects and of cells.
#[derive(Debug)]
pub struct PhaseBirths {
    /// Of objects.
    pub objects: Births,
    /// Of cells.
    pub cells: Births,
}

impl PhaseBirths {
    fn of(&mut self, above: bool) -> &mut Births {
        if above {
            &mut self.objects
        } else {
            &mut self.cells
        }
    }
}

impl Classes {
    /// Joins one slab's bands, given by rising y, to classes and moves on to the next slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the births' file fails.
    pub fn join(
        &mut self,
        edges: &[&BandEdges],
        labels: &[&[super::LocalComponent]],
        births: &mut PhaseBirths,
    ) -> Result<SlabClasses> {
        let mut first_node = vec![self.live.len() as u32];
        for l in labels {
            first_node.push(first_node.last().expect("not empty") + l.len() as u32);
        }
        self.sets
            .reset(*first_node.last().expect("not empty") as usize);
        self.join_bands(edges, &first_node);
        self.join_previous(edges, &first_node);
        let mut slab = self.number(labels, &first_node, births)?;
        self.keep_last_slice(edges, &mut slab);
        Ok(slab)
    }

    fn join_bands(&mut self, edges: &[&BandEdges], first_node: &[u32]) {
        for (b, pair) in edges.windows(2).enumerate() {
            debug_assert_eq!(pair[0].last_row.len(), pair[1].first_row.len());
            for (&low, &high) in pair[0].last_row.iter().zip(&pair[1].first_row) {
                self.sets
                    .union(first_node[b] + low, first_node[b + 1] + high);
            }
        }
    }

    fn join_previous(&mut self, edges: &[&BandEdges], first_node: &[u32]) {
        if self.last_slice.is_empty() {
            return;
        }
        let mut at = 0;
        for (b, band) in edges.iter().enumerate() {
            if b > 0 {
                at -= band.head_runs_first; // the shared row once more
            }
            for &local in &band.first_slice {
                self.sets.union(self.last_slice[at], first_node[b] + local);
                at += 1;
            }
        }
        debug_assert_eq!(at, self.last_slice.len());
    }

    /// Numbers the sets: carried components keep the order of their births, new ones follow by their
    /// smallest voxel, whatever the bands.
    fn number(
        &mut self,
        labels: &[&[super::LocalComponent]],
        first_node: &[u32],
        births: &mut PhaseBirths,
    ) -> Result<SlabClasses> {
        let nodes = *first_node.last().expect("not empty") as usize;
        let carried = self.live.len() as u32;
        let mut class_of_root = vec![u32::MAX; nodes];
        let mut records: Vec<ClassRecord> = Vec::new();
        // live components are sorted by birth and are the smallest nodes, hence roots of their sets
        for node in 0..carried {
            let root = self.sets.find(node);
            let record = self.live[node as usize];
            if root == node {
                class_of_root[node as usize] = records.len() as u32;
                records.push(record);
            } else {
                let into = &mut records[class_of_root[root as usize] as usize];
                births.of(record.above).kill(record.birth)?;
                into.sums.merge(&record.sums);
            }
        }
        let mut fresh: Vec<(u64, u32)> = Vec::new();
        let components = labels.iter().flat_map(|l| l.iter());
        for (node, component) in (carried..).zip(components) {
            let root = self.sets.find(node);
            if root < carried {
                continue;
            }
            if root == node {
                class_of_root[root as usize] = fresh.len() as u32;
                fresh.push((component.first, root));
            } else {
                let entry = &mut fresh[class_of_root[root as usize] as usize];
                entry.0 = entry.0.min(component.first);
            }
        }
        fresh.sort_unstable();
        for &(_, root) in &fresh {
            class_of_root[root as usize] = records.len() as u32;
            let band = first_node.partition_point(|&f| f <= root) - 1;
            let above = labels[band][(root - first_node[band]) as usize].above;
            let birth = births.of(above).give(1)?;
            records.push(ClassRecord {
                birth,
                above,
                sums: VoxelSums::default(),
            });
        }
        let mut of_local = Vec::with_capacity(labels.len());
        for (b, components) in labels.iter().enumerate() {
            let mut classes = Vec::with_capacity(components.len());
            for (node, component) in (first_node[b]..).zip(components.iter()) {
                let class = class_of_root[self.sets.find(node) as usize];
                records[class as usize].sums.merge(&component.sums);
                classes.push(class);
            }
            of_local.push(classes);
        }
        let from_previous = (0..carried)
            .map(|n| class_of_root[self.sets.find(n) as usize])
            .collect();
        Ok(SlabClasses {
            of_local,
            records,
            from_previous,
            live: Vec::new(),
        })
    }

    /// Keeps the classes of the last slice's runs, renumbered among the live ones.
    fn keep_last_slice(&mut self, edges: &[&BandEdges], slab: &mut SlabClasses) {
        self.last_slice.clear();
        for (b, band) in edges.iter().enumerate() {
            let skip = if b > 0 { band.head_runs_last } else { 0 };
            let classes = &slab.of_local[b];
            self.last_slice
                .extend(band.last_slice[skip..].iter().map(|&l| classes[l as usize]));
        }
        let mut live_index = vec![u32::MAX; slab.records.len()];
        for &class in &self.last_slice {
            live_index[class as usize] = 0;
        }
        for (class, index) in live_index.iter_mut().enumerate() {
            if *index == 0 {
                *index = slab.live.len() as u32;
                slab.live.push(class as u32);
            }
        }
        for class in &mut self.last_slice {
            *class = live_index[*class as usize];
        }
        self.live = slab
            .live
            .iter()
            .map(|&c| slab.records[c as usize])
            .collect();
    }
}
