//! Components across bands and slabs.
//!
//! Per slab, the local components of all bands and the components that came over from the slab
//! before are joined to *classes*. Only the labels of the last slice's runs and the records of
//! components that touch it are kept for the next slab; components inside one band have left memory
//! before and take some 50 bytes each, for numbering, until the slab is done.

use crate::error::Result;
use crate::labels::band_boundary::{BandComponents, BandFaces};
use crate::labels::provisional::ProvisionalLabels;
use crate::labels::union_find::UnionFind;
use crate::measure::VoxelSums;
use crate::sys::state_codec::{Decoder, Encoder};

/// Bytes of memory per local component while a slab is joined and until it is done: set, class of the
/// set and of the component, order, numbers, phase, place of its record and of its live class.
const BYTES_PER_COMPONENT: u64 = 4 + 4 + 4 + 24 + 16 + 1 + 4 + 4;

/// A component that can still grow.
#[derive(Debug, Clone, Copy)]
pub struct LiveComponent {
    /// Its number, see [`ProvisionalLabels`]. Objects and cells are numbered apart.
    pub provisional_id: u64,
    /// Its number among the components of both phases, see [`SlabComponents::surfaces`].
    pub surface: u64,
    /// True for an object.
    pub above: bool,
    /// Sums of its voxels so far.
    pub sums: VoxelSums,
}

/// The classes of one slab.
#[derive(Debug, Clone, Default)]
pub struct SlabComponents {
    /// Per band, the class of each local component.
    pub of_local: Vec<Vec<u32>>,
    /// Number of each class, see [`ProvisionalLabels`]. First come those that came over, by provisional label, then new ones
    /// by smallest voxel. Objects and cells are numbered apart.
    pub provisional: Vec<u64>,
    /// Number of each class among the components of both phases, by the smallest lattice key of an edge that leaves it.
    pub surfaces: Vec<u64>,
    /// 1 for objects, 0 for cells, per class.
    pub above: Vec<u8>,
    /// Sums so far of the classes that are not one whole component of a band.
    pub open: Vec<(u32, VoxelSums)>,
    /// For each component live at the end of the slab before: its class here.
    pub carried_in: Vec<u32>,
    /// Classes that touch the last slice, by rising number: live in the next slab.
    pub live: Vec<u32>,
}

impl SlabComponents {
    /// The sums of classes that do not grow beyond this slab, but for those whole in a band; of all classes if this is the
    /// last slab that is joined.
    pub fn finished(&self, is_last: bool) -> impl Iterator<Item = (u32, &VoxelSums)> {
        let open = self.open.iter().map(|(class, sums)| (*class, sums));
        open.filter(move |&(class, _)| is_last || !self.grows(class))
    }

    /// True if a class is live in the next slab.
    fn grows(&self, class: u32) -> bool {
        self.live.binary_search(&class).is_ok()
    }
}

/// The sweep's state between slabs.
#[derive(Debug, Default)]
pub struct CarriedComponents {
    /// Live component (index into `live`) of each run of the last slice, rows in order.
    last_slice: Vec<u32>,
    live: Vec<LiveComponent>,
    sets: UnionFind,
}

/// The numbers of objects and of cells, and those of both together.
///
/// Objects and cells are a tree in which neighbours share a surface: each component but that of the grid's first voxel
/// has one surface to a neighbour that begins before it, and all its others to those that begin behind it. So a surface
/// is known by the later of the two, and has its number: components are numbered by the smallest lattice key of all edges
/// that leave them.
#[derive(Debug)]
pub struct PhaseLabels {
    /// Of objects.
    pub objects: ProvisionalLabels,
    /// Of cells.
    pub cells: ProvisionalLabels,
    /// Of components of both phases.
    pub surfaces: ProvisionalLabels,
}

impl PhaseLabels {
    /// Those of objects, or of cells.
    pub fn of(&mut self, above: bool) -> &mut ProvisionalLabels {
        if above {
            &mut self.objects
        } else {
            &mut self.cells
        }
    }
}

/// A component that begins in a slab.
struct NewComponent {
    /// Its smallest voxel.
    first: u64,
    /// The smallest lattice key of the edges that leave it.
    key: u64,
    root: u32,
}

/// Numbers components by their smallest keys; of two that share an edge, the one that begins first comes first.
fn number_surfaces(new: &[NewComponent], labels: &mut PhaseLabels) -> Result<Vec<u64>> {
    let mut order: Vec<u32> = (0..new.len() as u32).collect();
    // behind the first slice, keys follow the smallest voxels
    order.sort_by_key(|&i| (new[i as usize].key, new[i as usize].first));
    let first = labels.surfaces.allocate(new.len())?;
    let mut numbers = vec![0; new.len()];
    for (number, i) in (first..).zip(order) {
        numbers[i as usize] = number;
    }
    Ok(numbers)
}

/// What is known of one band.
#[derive(Debug, Clone, Copy)]
pub struct BandInput<'a> {
    /// What it shares with others.
    pub edges: &'a BandFaces,
    /// Its components.
    pub components: &'a BandComponents,
}

impl CarriedComponents {
    /// The components that can still grow.
    pub fn live(&self) -> impl Iterator<Item = &LiveComponent> {
        self.live.iter()
    }

    /// The live component of each run of the last slice, rows in order.
    pub fn last_slice(&self) -> &[u32] {
        &self.last_slice
    }

    /// Writes the state.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        let live = || self.live.iter();
        out.array(&self.last_slice)?;
        out.records(live().len(), live().map(|l| l.provisional_id))?;
        out.records(live().len(), live().map(|l| l.surface))?;
        out.records(live().len(), live().map(|l| u8::from(l.above)))?;
        out.records(live().len(), live().map(|l| l.sums))
    }

    /// The state that was written; `None` if this is none.
    pub fn load(input: &mut Decoder) -> Option<Self> {
        let last_slice: Vec<u32> = input.array()?;
        let provisional: Vec<u64> = input.array()?;
        let surfaces: Vec<u64> = input.array()?;
        let above: Vec<u8> = input.array()?;
        let sums: Vec<VoxelSums> = input.array()?;
        let n = provisional.len();
        let sound = above.len() == n
            && surfaces.len() == n
            && sums.len() == n
            && last_slice.iter().all(|&live| (live as usize) < n);
        let live = provisional.into_iter().zip(surfaces).zip(above).zip(sums);
        let live = live.map(|(((provisional_id, surface), above), sums)| LiveComponent {
            provisional_id,
            surface,
            above: above == 1,
            sums,
        });
        sound.then(|| CarriedComponents {
            last_slice,
            live: live.collect(),
            sets: UnionFind::default(),
        })
    }

    /// Bytes of memory that [`CarriedComponents::join`] will take, and its result, at most.
    pub fn bytes(&self, bands: &[BandInput]) -> u64 {
        let live = self.live.len() as u64;
        let sum = |get: fn(&BandInput) -> usize| bands.iter().map(get).sum::<usize>() as u64;
        let components = sum(|b| b.components.len()) + live;
        let open = sum(|b| b.components.open().len()) + live;
        let last_slice = sum(|b| b.edges.last_slice.len());
        let stay_live = open.min(last_slice) * size_of::<LiveComponent>() as u64;
        let sums = open * size_of::<(u32, VoxelSums)>() as u64;
        components * BYTES_PER_COMPONENT + sums + stay_live + 4 * last_slice
    }

    /// Joins one slab's bands, given by rising y, to classes and moves on to the next slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the provisional labels' file fails.
    pub fn join(
        &mut self,
        bands: &[BandInput],
        provisional: &mut PhaseLabels,
    ) -> Result<SlabComponents> {
        let mut first_node = vec![self.live.len() as u32];
        for band in bands {
            let next = *first_node.last().expect("not empty") + band.components.len() as u32;
            first_node.push(next);
        }
        self.sets
            .reset(*first_node.last().expect("not empty") as usize);
        self.merge_bands(bands, &first_node);
        self.merge_previous_slab(bands, &first_node);
        let mut slab = self.number(bands, &first_node, provisional)?;
        let record_of = self.add_open(bands, &mut slab);
        self.keep_last_slice(bands, &record_of, &mut slab);
        Ok(slab)
    }

    fn merge_bands(&mut self, bands: &[BandInput], first_node: &[u32]) {
        for (b, pair) in bands.windows(2).enumerate() {
            let (low, high) = (&pair[0].edges.last_row, &pair[1].edges.first_row);
            debug_assert_eq!(low.len(), high.len());
            for (&low, &high) in low.iter().zip(high) {
                self.sets
                    .union(first_node[b] + low, first_node[b + 1] + high);
            }
        }
    }

    fn merge_previous_slab(&mut self, bands: &[BandInput], first_node: &[u32]) {
        if self.last_slice.is_empty() {
            return;
        }
        let mut at = 0;
        for (b, band) in bands.iter().enumerate() {
            if b > 0 {
                at -= band.edges.head_runs_first; // the shared row once more
            }
            for &local in &band.edges.first_slice {
                self.sets.union(self.last_slice[at], first_node[b] + local);
                at += 1;
            }
        }
        debug_assert_eq!(at, self.last_slice.len());
    }

    /// Numbers the sets: carried components keep the order of their provisional labels, new ones follow by their
    /// smallest voxel, whatever the bands.
    fn number(
        &mut self,
        bands: &[BandInput],
        first_node: &[u32],
        provisional: &mut PhaseLabels,
    ) -> Result<SlabComponents> {
        let nodes = *first_node.last().expect("not empty") as usize;
        let mut class_of_root = vec![u32::MAX; nodes];
        let mut slab = self.number_carried(&mut class_of_root, provisional)?;
        let new = self.new_roots(bands, &mut class_of_root);
        slab.surfaces.extend(number_surfaces(&new, provisional)?);
        for NewComponent { root, .. } in new {
            class_of_root[root as usize] = slab.provisional.len() as u32;
            let band = first_node.partition_point(|&f| f <= root) - 1;
            let above = bands[band]
                .components
                .is_above((root - first_node[band]) as usize);
            slab.provisional.push(provisional.of(above).allocate(1)?);
            slab.above.push(u8::from(above));
        }
        let mut classes = |nodes: std::ops::Range<u32>| {
            nodes
                .map(|n| class_of_root[self.sets.find(n) as usize])
                .collect()
        };
        slab.carried_in = classes(0..self.live.len() as u32);
        slab.of_local = first_node
            .windows(2)
            .map(|pair| classes(pair[0]..pair[1]))
            .collect();
        Ok(slab)
    }

    /// Numbers the sets of components that come over.
    fn number_carried(
        &mut self,
        class_of_root: &mut [u32],
        provisional: &mut PhaseLabels,
    ) -> Result<SlabComponents> {
        let carried = self.live.len() as u32;
        let mut slab = SlabComponents::default();
        // live components are sorted by provisional label and are the smallest nodes, hence roots of their sets
        for node in 0..carried {
            let root = self.sets.find(node);
            let live = self.live[node as usize];
            if root == node {
                let class = slab.provisional.len() as u32;
                class_of_root[node as usize] = class;
                slab.provisional.push(live.provisional_id);
                slab.surfaces.push(live.surface);
                slab.above.push(u8::from(live.above));
                slab.open.push((class, live.sums));
            } else {
                provisional.of(live.above).retire(live.provisional_id)?;
                let class = class_of_root[root as usize];
                slab.open[class as usize].1.merge(&live.sums);
                let older = &mut slab.surfaces[class as usize];
                provisional.surfaces.retire(live.surface.max(*older))?;
                *older = live.surface.min(*older);
            }
        }
        Ok(slab)
    }

    /// The other sets by their smallest voxels. Leaves numbers of its own in `place_of_root`.
    fn new_roots(&mut self, bands: &[BandInput], place_of_root: &mut [u32]) -> Vec<NewComponent> {
        let carried = self.live.len() as u32;
        let mut fresh: Vec<NewComponent> = Vec::new();
        let firsts = bands.iter().flat_map(|b| b.components.firsts());
        for (node, (first, key)) in (carried..).zip(firsts) {
            let root = self.sets.find(node);
            if root < carried {
                continue;
            }
            if root == node {
                place_of_root[root as usize] = fresh.len() as u32;
                fresh.push(NewComponent { first, key, root });
            } else {
                let entry = &mut fresh[place_of_root[root as usize] as usize];
                entry.first = entry.first.min(first);
                entry.key = entry.key.min(key);
            }
        }
        fresh.sort_unstable_by_key(|new| new.first);
        fresh
    }

    /// Adds the sums of the bands' open components to their classes. Returns where each class's sums
    /// are in [`SlabComponents::open`].
    fn add_open(&self, bands: &[BandInput], slab: &mut SlabComponents) -> Vec<u32> {
        let mut record_of = vec![u32::MAX; slab.provisional.len()];
        for (i, (class, _)) in slab.open.iter().enumerate() {
            record_of[*class as usize] = i as u32;
        }
        // growing by doubling would take much more for a moment
        let mut classes = slab.open.len() as u32;
        for (band, of_local) in bands.iter().zip(&slab.of_local) {
            for (local, _) in band.components.open() {
                let record = &mut record_of[of_local[*local as usize] as usize];
                if *record == u32::MAX {
                    *record = classes;
                    classes += 1;
                }
            }
        }
        slab.open.reserve_exact(classes as usize - slab.open.len());
        for (band, of_local) in bands.iter().zip(&slab.of_local) {
            for (local, sums) in band.components.open() {
                let class = of_local[*local as usize];
                let record = record_of[class as usize] as usize;
                if record == slab.open.len() {
                    slab.open.push((class, *sums));
                } else {
                    slab.open[record].1.merge(sums);
                }
            }
        }
        record_of
    }

    /// Keeps the classes of the last slice's runs, renumbered among the live ones.
    fn keep_last_slice(
        &mut self,
        bands: &[BandInput],
        record_of: &[u32],
        slab: &mut SlabComponents,
    ) {
        self.last_slice.clear();
        for (b, band) in bands.iter().enumerate() {
            let skip = if b > 0 { band.edges.head_runs_last } else { 0 };
            let classes = &slab.of_local[b];
            let labels = band.edges.last_slice.iter().skip(skip);
            self.last_slice.extend(labels.map(|&l| classes[l as usize]));
        }
        let mut live_index = vec![u32::MAX; slab.provisional.len()];
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
        let live = slab.live.iter().map(|&class| LiveComponent {
            provisional_id: slab.provisional[class as usize],
            surface: slab.surfaces[class as usize],
            above: slab.above[class as usize] == 1,
            sums: slab.open[record_of[class as usize] as usize].1,
        });
        self.live = live.collect();
    }
}
