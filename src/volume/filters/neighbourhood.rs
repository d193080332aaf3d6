//! A volume of which each voxel is made of those of another volume within a radius.
//!
//! A box is made in strips of rows. Of a strip, as many slices as one voxel is made of are in memory, each as the
//! filter keeps it; slice by slice, the next one takes the place of the oldest. Of a compressed stream, which is read
//! forward, whole slices are kept from box to box instead.

use crate::error::Result;
use crate::sys::locks::lock;
use crate::volume::{Dtype, Header, Volume};
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;

/// Bytes of slices that a thread keeps of a strip, so that they stay in a near cache.
const NEAR: u64 = 1 << 20;
/// It may keep more so that a strip is not much lower than what is read for it, but no more than this, unless a row has
/// more.
const MOST: u64 = 32 << 20;
/// Slices of a stream that are kept beyond those of one voxel: boxes that follow each other share as many.
const LOOK_BACK: usize = 3;

/// A filter: what of a slice it keeps, and how it makes voxels of several slices.
pub trait Neighbourhood: Clone + Send + Sync + 'static {
    /// How far voxels that one is made of lie away along x, y and z.
    fn radius(&self) -> [u32; 3];

    /// The type of the values made of samples of a type.
    fn output(&self, input: Dtype) -> Dtype;

    /// Rows of a slice that a window keeps for so many rows of values.
    fn rows_kept(&self, rows: u64) -> u64;

    /// Bytes that it keeps for a row of `width` voxels of one slice.
    fn row_bytes(&self, input: Dtype, width: u64) -> RowBytes;

    /// Memory for `slots` slices of a region.
    fn window(&self, input: Dtype, region: Region, slots: usize) -> Box<dyn Window>;
}

/// Bytes for a row.
pub struct RowBytes {
    /// As a rule.
    pub usual: u64,
    /// If samples are missing.
    pub most: u64,
}

/// Slices of a region as a filter keeps them, in slots.
pub trait Window: Send {
    /// Where samples of a slice are put before it is taken: those that the region reads, x fastest.
    fn samples(&mut self) -> &mut [u8];

    /// Takes the slice whose samples were put there into a slot.
    fn take(&mut self, slot: usize);

    /// Fills `out` with values of a slice. `slots` are those of the slices that it is made of, in the order of z;
    /// `x` and `y` count from the region's first own voxel.
    fn put(&mut self, slots: &[usize], x: Range<usize>, y: Range<usize>, out: &mut [u8]);
}

/// A part of slices, over which a window runs along z, in voxels of the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Voxels along x and y whose values are made.
    pub own: [Range<u32>; 2],
    /// Voxels that these are made of, as far as the volume has them.
    pub read: [Range<u32>; 2],
    /// How far they lie away, along x and y.
    pub radius: [u32; 2],
}

impl Region {
    fn new(own: [Range<u32>; 2], radius: [u32; 3], header: &Header) -> Self {
        let read = [0, 1].map(|a| within(&own[a], radius[a], header.dims.0[a]));
        let radius = [radius[0], radius[1]];
        Region { own, read, radius }
    }

    /// Samples of a slice that are read.
    pub fn samples(&self) -> usize {
        self.width() * self.read[1].len()
    }

    /// Samples of a row that are read.
    pub fn width(&self) -> usize {
        self.read[0].len()
    }

    /// Copies of the first sample of a row that stand before it so that the first own voxel has all it is made of, and
    /// of the last one behind it.
    pub fn copies(&self) -> [usize; 2] {
        let [own, read] = [&self.own[0], &self.read[0]];
        [own.start - read.start, read.end - own.end].map(|n| (self.radius[0] - n) as usize)
    }

    /// The row, of those that are read, that voxels of own row `j` are made of: number `tap` of them in the order of y.
    pub fn row(&self, j: usize, tap: usize) -> usize {
        let [own, read] = [&self.own[1], &self.read[1]];
        let at = own.start as usize + j + tap;
        let first = (read.start + self.radius[1]) as usize;
        at.saturating_sub(first).min(read.len() - 1)
    }
}

/// A range and what lies within a radius of it, as far as there are `count`.
fn within(range: &Range<u32>, radius: u32, count: u32) -> Range<u32> {
    range.start.saturating_sub(radius)..range.end.saturating_add(radius).min(count)
}

/// A filtered volume.
pub struct Filtered<'a, F> {
    inner: Box<dyn Volume + 'a>,
    header: Header,
    filter: F,
    /// For an inner volume that is read forward: whole slices.
    forward: Option<Mutex<Option<Rolling>>>,
}

impl<'a, F: Neighbourhood> Filtered<'a, F> {
    /// Filters `inner`.
    pub(super) fn around(inner: Box<dyn Volume + 'a>, filter: F) -> Self {
        let mut header = inner.header().clone();
        header.dtype = filter.output(header.dtype);
        let forward = (!inner.random_access()).then(Mutex::default);
        Filtered {
            inner,
            header,
            filter,
            forward,
        }
    }

    /// Slices that a voxel is made of.
    fn taps(&self) -> usize {
        2 * self.filter.radius()[2] as usize + 1
    }

    fn input(&self) -> Dtype {
        self.inner.header().dtype
    }

    fn row_bytes(&self, width: usize) -> RowBytes {
        self.filter.row_bytes(self.input(), width as u64)
    }

    fn rolling(&self, own: [Range<u32>; 2], slots: usize) -> Rolling {
        let region = Region::new(own, self.filter.radius(), &self.header);
        Rolling {
            window: self.filter.window(self.input(), region.clone(), slots),
            region,
            held: vec![None; slots],
            radius: self.filter.radius()[2],
            slots: Vec::new(),
        }
    }

    /// Rows of a strip of a box of `width` by `rows` voxels.
    fn strip(&self, width: usize, rows: usize) -> usize {
        let row = self.row_bytes(width).usual * self.taps() as u64;
        let fitting = |bytes: u64| (bytes / row) as usize;
        let enough = 4 * self.filter.radius()[1] as usize;
        let most = fitting(NEAR).max(fitting(MOST).min(enough)).clamp(1, rows);
        // none much lower than the others
        rows.div_ceil(rows.div_ceil(most))
    }

    /// Bytes of a window for whole rows.
    fn window_bytes(&self, rows: usize, slots: usize) -> u64 {
        let [nx, ny, _] = self.header.dims.0.map(u64::from);
        let [rx, ry, _] = self.filter.radius().map(u64::from);
        let rows = rows as u64;
        let read = (rows + 2 * ry).min(ny) * nx * self.input().bytes() as u64;
        // rows on their way, of numbers of 8 bytes at most
        let passing = (2 * ry + 6) * (nx + 2 * rx) * 8;
        let kept = self.filter.rows_kept(rows) * self.row_bytes(nx as usize).most;
        slots as u64 * kept + read + passing
    }
}

impl<F: Neighbourhood> Volume for Filtered<'_, F> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let [nx, ny, _] = self.header.dims.0;
        let slice = out.len() / z.len();
        let [columns, rows] = [&x, &y].map(|r| r.start as usize..r.end as usize);
        if let Some(forward) = &self.forward {
            let mut forward = lock(forward);
            let whole = || self.rolling([0..nx, 0..ny], self.taps() + LOOK_BACK);
            let rolling = forward.get_or_insert_with(whole);
            for (k, out) in z.zip(out.chunks_exact_mut(slice)) {
                rolling.put(&*self.inner, k, [columns.clone(), rows.clone()], out)?;
            }
            return Ok(());
        }
        let row = slice / y.len();
        let step = self.strip(x.len(), y.len());
        for from in (0..y.len()).step_by(step) {
            let count = step.min(y.len() - from);
            let top = y.start + from as u32;
            let own = [x.clone(), top..top + count as u32];
            let mut rolling = self.rolling(own, self.taps());
            for (k, out) in z.clone().zip(out.chunks_exact_mut(slice)) {
                let out = &mut out[from * row..][..count * row];
                rolling.put(&*self.inner, k, [0..x.len(), 0..count], out)?;
            }
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(Filtered::around(inner, self.filter.clone()))
        }))
    }

    fn grain(&self) -> [u32; 3] {
        let [x, y, z] = self.inner.grain();
        let enough = 4 * self.filter.radius()[2];
        match self.forward {
            // whole slices are kept
            Some(_) => [x, y, z],
            // thick boxes read little beyond their own
            None => [x, y, z * enough.div_ceil(z).max(1)],
        }
    }

    fn held_bytes(&self) -> u64 {
        let [nx, ny, _] = self.header.dims.0.map(|n| n as usize);
        let own = match self.forward {
            Some(_) => self.window_bytes(ny, self.taps() + LOOK_BACK),
            None => {
                let each = self.window_bytes(self.strip(nx, ny), self.taps());
                rayon::current_num_threads() as u64 * each
            }
        };
        self.inner.held_bytes() + own
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.inner.mapped_bytes(self.slices(&z))
    }

    /// Those that nothing but what was measured has a share in. What was measured of a slice is convex, so that of all
    /// rows that the filter reaches to the outer ones have least.
    fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
        let own = self.inner.measured(y, z)?;
        if self.input().is_float() {
            // NaN has no share in anything
            return Some(own);
        }
        let [nx, ny, _] = self.header.dims.0;
        let [rx, ry, _] = self.filter.radius();
        let rows = [y.saturating_sub(ry), (y + ry).min(ny - 1)];
        let slices = self.slices(&(z..z + 1));
        let all = slices.flat_map(|z| rows.map(|y| self.inner.measured(y, z).unwrap_or(0..nx)));
        let row = all.reduce(|a, b| a.start.max(b.start)..a.end.min(b.end))?;
        // beyond the ends of the grid there is nothing, and no fill
        let start = if row.start == 0 { 0 } else { row.start + rx };
        let end = if row.end == nx {
            nx
        } else {
            row.end.saturating_sub(rx)
        };
        Some(start.min(end)..end)
    }

    fn prefetch(&self, z: Range<u32>) {
        self.inner.prefetch(self.slices(&z));
    }

    fn release(&self, z: Range<u32>) {
        // all but what the next slices need too
        let mut done = self.slices(&z);
        if z.end < self.header.dims.0[2] {
            done.end = z.end.saturating_sub(self.filter.radius()[2]);
        } else if let Some(forward) = &self.forward {
            *lock(forward) = None;
        }
        self.inner.release(done.start.min(done.end)..done.end);
    }
}

impl<F: Neighbourhood> Filtered<'_, F> {
    /// The slices that these are made of.
    fn slices(&self, z: &Range<u32>) -> Range<u32> {
        within(z, self.filter.radius()[2], self.header.dims.0[2])
    }
}

/// A window that runs along z.
struct Rolling {
    window: Box<dyn Window>,
    region: Region,
    /// The slice in each slot.
    held: Vec<Option<u32>>,
    /// How far slices that one is made of lie away.
    radius: u32,
    /// Slots of the slices that one is made of.
    slots: Vec<usize>,
}

impl Rolling {
    /// Fills `out` with a part of slice `k`, along x and y from the region's first own voxel on.
    fn put(
        &mut self,
        inner: &dyn Volume,
        k: u32,
        [x, y]: [Range<usize>; 2],
        out: &mut [u8],
    ) -> Result<()> {
        let last = inner.header().dims.0[2] - 1;
        self.slots.clear();
        for tap in 0..=2 * self.radius {
            let slice = (k + tap).saturating_sub(self.radius).min(last);
            let slot = self.load(inner, slice)?;
            self.slots.push(slot);
        }
        self.window.put(&self.slots, x, y, out);
        Ok(())
    }

    /// Reads a slice, unless it is there, and tells its slot.
    fn load(&mut self, inner: &dyn Volume, slice: u32) -> Result<usize> {
        let slot = slice as usize % self.held.len();
        if self.held[slot] != Some(slice) {
            self.held[slot] = None;
            let [x, y] = self.region.read.clone();
            inner.read_box(x, y, slice..slice + 1, self.window.samples())?;
            self.window.take(slot);
            self.held[slot] = Some(slice);
        }
        Ok(slot)
    }
}
