//! The voxels that were filled as dust: found again in the volume, so that tiles can be compared with the others.
//!
//! Objects of fewer voxels than the size became below, then cells of fewer voxels, in what that left,
//! above. So the volume is labelled twice, slice by slice. Runs of voxels of a component that is still
//! small are kept until it is not, or has ended; those of small ones are sorted on disk, by the row of
//! macrocubes that they lie in, and the comparison takes them from there as it goes.
//!
//! Also in memory: the runs of two slices, the components that they belong to, and the runs of those
//! that have fewer voxels than the size so far.

use super::code::Code;
use super::region_edge::RegionEdge;
use super::report::Issues;
use super::slices::{Run, Slices, ends_of, row_of, run};
use super::spill::{Merge, Spill};
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Tiling};
use crate::manifest::{Dust, Manifest};
use crate::progress::Progress;
use crate::volume::{Volume, row_words};

/// Runs that a sort keeps in memory: 1 MiB.
const IN_MEMORY: usize = 1 << 16;

/// The voxels that were filled, row of macrocubes by row.
pub(super) struct Filled {
    /// By the row of macrocubes, then by run; those on a plane between two are there for each.
    all: Merge<2>,
    next: Option<[u64; 2]>,
    /// Of the row at hand, rising.
    runs: Vec<Run>,
    /// The same ones by slices, until they are taken.
    by_slice: Option<Merge<1>>,
}

/// The bits of voxels.
const BELOW: u8 = 0;
const ABOVE: u8 = 1;

/// Small components of one phase.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Count {
    components: u64,
    voxels: u64,
}

impl Filled {
    /// Looks for the dust of a volume, and compares how much there is with what the manifest states.
    ///
    /// # Errors
    /// The volume's, [`Error::Io`] if temporary files fail, [`Error::Interrupted`].
    pub fn find(
        volume: &dyn Volume,
        manifest: &Manifest,
        dust: &Dust,
        edge: RegionEdge,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<Self> {
        let tiling = manifest.tiling();
        let nz = manifest.grid.dims.0[2];
        progress.begin("dust", 2 * u64::from(nz));
        let mut by_row: Spill<2> = Spill::new(IN_MEMORY);
        let mut by_slice: Spill<1> = Spill::new(IN_MEMORY);
        let mut keep = |run: Run| -> Result<()> {
            by_slice.push([run])?;
            let [ys, zs] = row_of(run);
            for z in rows_with(&tiling, 2, zs) {
                for y in rows_with(&tiling, 1, ys) {
                    by_row.push([u64::from(z) << 32 | u64::from(y), run])?;
                }
            }
            Ok(())
        };
        let mut slices = Slices::new(volume, manifest.threshold, edge);
        let mut small: Spill<1> = Spill::new(IN_MEMORY);
        let of = |phase| Search {
            phase,
            ambiguous: manifest.ambiguous,
            least: dust.min_voxels,
        };
        let objects = find_small(&mut slices, of(ABOVE), progress, |run| {
            keep(run)?;
            small.push([run])
        })?;
        let mut small = small.into_sorted()?;
        slices.next = small.next()?;
        slices.filled = Some(small);
        let cells = find_small(&mut slices, of(BELOW), progress, &mut keep)?;
        compare(dust, [objects, cells], issues);
        let mut all = by_row.into_sorted()?;
        Ok(Filled {
            next: all.next()?,
            all,
            runs: Vec::new(),
            by_slice: Some(by_slice.into_sorted()?),
        })
    }

    /// The voxels that were filled, slice by slice; once.
    pub fn take_slices(&mut self) -> Option<Merge<1>> {
        self.by_slice.take()
    }

    /// Takes the runs of the row of macrocubes (y, z), which comes after those before.
    ///
    /// # Errors
    /// [`Error::Io`] if a temporary file cannot be read back.
    pub fn load(&mut self, [y, z]: [u32; 2]) -> Result<()> {
        let row = u64::from(z) << 32 | u64::from(y);
        self.runs.clear();
        while let Some([at, run]) = self.next.filter(|r| r[0] <= row) {
            if at == row {
                self.runs.push(run);
            }
            self.next = self.all.next()?;
        }
        Ok(())
    }

    /// Turns the bits of a row's voxels from `first` on that were filled.
    pub fn apply(&self, [y, z]: [u32; 2], first: usize, bits: &mut [u8]) {
        let at = |x: u32| self.runs.partition_point(|r| *r < run([y, z], [x, 0]));
        let end = self
            .runs
            .partition_point(|r| *r <= run([y, z], [0xFFFF; 2]));
        for ends in self.runs[at(0)..end].iter().map(|r| ends_of(*r)) {
            let from = (ends[0] as usize).max(first);
            let to = (ends[1] as usize + 1).min(first + bits.len());
            if from < to {
                bits[from - first..to - first]
                    .iter_mut()
                    .for_each(|b| *b ^= 1);
            }
        }
    }
}

/// The rows of macrocubes along an axis that have a voxel: two, if it lies on a plane between them.
fn rows_with(tiling: &Tiling, axis: usize, voxel: u32) -> std::ops::RangeInclusive<u32> {
    let size = tiling.macrocube[axis];
    let last = tiling.tiles()[axis] - 1;
    let upper = voxel / size;
    let lower = if voxel.is_multiple_of(size) {
        upper.saturating_sub(1)
    } else {
        upper
    };
    lower.min(last)..=upper.min(last)
}

/// A component that can still grow.
struct Component {
    voxels: u64,
    /// Its runs, as long as it is small.
    runs: Option<Vec<Run>>,
}

/// Compares what was found of objects and cells with what the manifest states.
fn compare(dust: &Dust, found: [Count; 2], issues: &mut Issues) {
    let stated = [
        Count {
            components: dust.objects,
            voxels: dust.object_voxels,
        },
        Count {
            components: dust.cells,
            voxels: dust.cell_voxels,
        },
    ];
    for (name, (found, stated)) in ["objects", "cells"]
        .into_iter()
        .zip(found.into_iter().zip(stated))
    {
        if found != stated {
            let message = format!(
                "stated {} {name} of {} voxels, the volume has {} of {} with fewer than {}",
                stated.components, stated.voxels, found.components, found.voxels, dust.min_voxels
            );
            issues.add(Code::Dust, format!("index.json#/dust/{name}"), message);
        }
    }
}

/// The runs of a slice: first and last voxel, and component, row by row.
#[derive(Default)]
struct Labelled {
    starts: Vec<usize>,
    runs: Vec<([u32; 2], u32)>,
}

impl Labelled {
    fn row(&self, y: u32) -> &[([u32; 2], u32)] {
        let y = y as usize;
        &self.runs[self.starts[y]..self.starts[y + 1]]
    }
}

/// The voxels of a row.
struct BitsOfRow<'a> {
    bits: &'a [u8],
    /// See [`Slices::inside`].
    inside: &'a [u64],
}

impl BitsOfRow<'_> {
    /// True if a run has a voxel outside of the region of interest.
    fn leaves(&self, [first, last]: [u32; 2]) -> bool {
        (first..=last).any(|x| self.inside[x as usize / 64] >> (x % 64) & 1 == 0)
    }
}

/// Components of one phase, labelled slice by slice.
struct Labels {
    search: Search,
    parent: Vec<u32>,
    components: Vec<Component>,
    before: Labelled,
}

/// The components that are looked for.
#[derive(Clone, Copy)]
struct Search {
    /// [`ABOVE`] for objects, [`BELOW`] for cells.
    phase: u8,
    ambiguous: Ambiguous,
    /// Components of fewer voxels are small.
    least: u64,
}

impl Search {
    /// True if components of the phase touch by edges as well as by faces.
    fn by_edges(self) -> bool {
        // separate: objects touch by faces, cells by edges as well; join: the other way round
        (self.phase == ABOVE) == (self.ambiguous == Ambiguous::Join)
    }
}

/// Finds the small components of a phase and hands out their runs.
fn find_small(
    slices: &mut Slices,
    search: Search,
    progress: &dyn Progress,
    mut each: impl FnMut(Run) -> Result<()>,
) -> Result<Count> {
    let [nx, ny, nz] = slices.dims();
    let mut labels = Labels {
        search,
        parent: Vec::new(),
        components: Vec::new(),
        before: Labelled {
            starts: vec![0; ny as usize + 1],
            runs: Vec::new(),
        },
    };
    let mut count = Count::default();
    for z in 0..nz {
        if progress.interrupted() {
            return Err(Error::Interrupted);
        }
        slices.read(z)?;
        let mut own = Labelled::default();
        for y in 0..ny {
            own.starts.push(own.runs.len());
            let start = y as usize * nx as usize;
            let bits = &slices.bits[start..start + nx as usize];
            let words = row_words(nx);
            let inside = &slices.inside[y as usize * words..][..words];
            let row = BitsOfRow { bits, inside };
            labels.add_row([y, z], &row, &mut own);
        }
        own.starts.push(own.runs.len());
        labels.end_slice(own, &mut count, &mut each)?;
        progress.advance(1);
    }
    labels.end_slice(
        Labelled {
            starts: vec![0; ny as usize + 1],
            runs: Vec::new(),
        },
        &mut count,
        &mut each,
    )?;
    Ok(count)
}

impl Labels {
    /// Labels the runs of a row of bits and joins them with those of the rows before.
    fn add_row(&mut self, [y, z]: [u32; 2], row: &BitsOfRow, own: &mut Labelled) {
        let (phase, by_edges) = (self.search.phase, self.search.by_edges());
        let first = own.runs.len();
        let mut x = 0;
        for chunk in row.bits.chunk_by(|a, b| a == b) {
            let ends = [x, x + chunk.len() as u32 - 1];
            x += chunk.len() as u32;
            if chunk[0] == phase {
                let label = self.create(run([y, z], ends), row.leaves(ends));
                own.runs.push((ends, label));
            }
        }
        let rows = self.before.starts.len() as u32 - 1;
        let near = u32::from(by_edges);
        let before = std::mem::take(&mut self.before);
        let (earlier, new) = own.runs.split_at(first);
        if y > 0 {
            let row = &earlier[own.starts[y as usize - 1]..];
            self.join(new, row, near);
        }
        self.join(new, before.row(y), near);
        if by_edges {
            for row in [y.wrapping_sub(1), y + 1].into_iter().filter(|r| *r < rows) {
                self.join(new, before.row(row), 0);
            }
        }
        self.before = before;
    }

    /// A component of one run. One that leaves the region of interest is never small.
    fn create(&mut self, run: Run, leaves: bool) -> u32 {
        let [first, last] = ends_of(run);
        let label = self.parent.len() as u32;
        let voxels = match leaves {
            true => u64::MAX,
            false => u64::from(last - first) + 1,
        };
        self.parent.push(label);
        self.components.push(Component {
            voxels,
            runs: (voxels < self.search.least).then(|| vec![run]),
        });
        label
    }

    /// Unites runs of two rows that are `near` voxels apart at most.
    fn join(&mut self, new: &[([u32; 2], u32)], old: &[([u32; 2], u32)], near: u32) {
        let mut next = 0;
        for ([first, last], label) in new {
            while old.get(next).is_some_and(|(o, _)| o[1] + near < *first) {
                next += 1;
            }
            let touching = old[next..].iter().take_while(|(o, _)| o[0] <= last + near);
            for (_, other) in touching {
                self.unite(*label, *other);
            }
        }
    }

    fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let up = self.parent[v as usize];
            self.parent[v as usize] = self.parent[up as usize];
            v = up;
        }
        v
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return;
        }
        // the shorter list of runs goes to the longer one
        let length = |v: u32| {
            self.components[v as usize]
                .runs
                .as_ref()
                .map_or(0, Vec::len)
        };
        let (keep, gone) = if length(a) >= length(b) {
            (a, b)
        } else {
            (b, a)
        };
        self.parent[gone as usize] = keep;
        let runs = self.components[gone as usize].runs.take();
        let voxels = self.components[gone as usize].voxels;
        let kept = &mut self.components[keep as usize];
        kept.voxels = kept.voxels.saturating_add(voxels);
        kept.runs = match (kept.runs.take(), runs) {
            (Some(mut all), Some(more)) if kept.voxels < self.search.least => {
                all.extend(more);
                Some(all)
            }
            _ => None,
        };
    }

    /// Hands out components that have no run in the new slice, and numbers the others again.
    fn end_slice(
        &mut self,
        mut own: Labelled,
        count: &mut Count,
        each: &mut impl FnMut(Run) -> Result<()>,
    ) -> Result<()> {
        const NONE: u32 = u32::MAX;
        let mut renamed = vec![NONE; self.parent.len()];
        let mut kept = Vec::new();
        for (_, label) in &mut own.runs {
            let root = self.root(*label) as usize;
            if renamed[root] == NONE {
                renamed[root] = kept.len() as u32;
                let none = Component {
                    voxels: 0,
                    runs: None,
                };
                kept.push(std::mem::replace(&mut self.components[root], none));
            }
            *label = renamed[root];
        }
        for ended in &mut self.components {
            // what was united with another one, or goes on, has no runs here
            if let Some(runs) = ended.runs.take() {
                count.components += 1;
                count.voxels += ended.voxels;
                runs.into_iter().try_for_each(&mut *each)?;
            }
        }
        self.parent = (0..kept.len() as u32).collect();
        self.components = kept;
        self.before = own;
        Ok(())
    }
}
