//! Volumes whose slices are pages that are decoded one by one: TIFF, PNG and BMP.
//!
//! A page is cut into chunks (strips or tiles), the smallest parts that can be decoded. Threads
//! decode without a lock; chunks of which only a part was asked for stay in a bounded cache. A sweep, which
//! reads a slab band by band, has them decoded once, see [`Unpacked`].

use crate::error::Result;
use crate::volume::io::chunk_cache::{self, ChunkCache};
use crate::volume::io::decoded_once::{Parts, Shared, Unpacked};
use crate::volume::{Header, Volume};
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Chunks of at most this many rows are decoded in any order; larger ones take turns.
const FINE_ROWS: u32 = 64;
/// Larger chunks are refused: each is decoded in memory.
pub(crate) const MAX_CHUNK: u64 = 1 << 30;

/// How a page is cut, in voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cut {
    /// Voxels per row of a chunk: the page's width, or that of a tile.
    pub(crate) width: u32,
    /// Rows of a chunk, at least 1.
    pub(crate) rows: u32,
    /// Chunks at the edge are padded to full size (tiles); otherwise the last one is lower.
    pub(crate) padded: bool,
}

/// The pages of a volume, one per slice.
pub(crate) trait Pages: Send + Sync {
    /// Finds page `k`.
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>>;

    /// Voxels of the largest chunk of any page, and the most rows of one. 0 rows if pages are not
    /// compressed, so that rows are read as they are.
    fn largest(&self) -> (u64, u32);

    /// Files that pages lie in besides those that were opened.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// A page that can be decoded.
pub(crate) trait Page {
    /// How it is cut.
    fn cut(&self) -> Cut;

    /// Decodes chunk `index` (counted along x first) into `out`, in the machine's byte order.
    fn decode(&self, index: u32, out: &mut [u8]) -> Result<()>;

    /// Reads whole rows if they are stored as they are. Returns false, with `out` untouched, if not.
    fn rows(&self, _y: Range<u32>, _out: &mut [u8]) -> Result<bool> {
        Ok(false)
    }
}

/// A volume of pages.
pub(crate) struct PagedVolume {
    header: Header,
    pages: Box<dyn Pages>,
    /// Chunks by page and index.
    cache: ChunkCache<(u32, u32)>,
    /// Bytes of the largest chunk.
    chunk: u64,
    random: bool,
}

impl PagedVolume {
    pub(crate) fn new(header: Header, pages: Box<dyn Pages>) -> Self {
        let sample = header.dtype.bytes() as u64;
        let total = header.dims.voxels() * sample;
        let (voxels, rows) = pages.largest();
        let chunk = if rows == 0 { 0 } else { voxels * sample };
        let budget = (header.dims.slice_voxels() * sample * 4)
            .clamp(chunk_cache::LEAST, chunk_cache::MOST)
            .max(chunk)
            .min(total.max(chunk));
        PagedVolume {
            random: rows <= FINE_ROWS || total <= budget,
            cache: ChunkCache::new(if rows == 0 { 0 } else { budget }),
            header,
            pages,
            chunk,
        }
    }

    /// Fills the part `x` by `y` of slice `k`.
    fn read_slice(&self, k: u32, x: &Range<u32>, y: &Range<u32>, out: &mut [u8]) -> Result<()> {
        let page = self.pages.page(k)?;
        let [nx, ny, _] = self.header.dims.0;
        let sample = self.header.dtype.bytes();
        let whole = *x == (0..nx);
        if whole && page.rows(y.clone(), out)? {
            return Ok(());
        }
        if !whole && self.cut_from_rows(&*page, x, y, out)? {
            return Ok(());
        }
        let row = x.len() * sample;
        let cut = page.cut();
        let across = nx.div_ceil(cut.width);
        for cy in y.start / cut.rows..=(y.end - 1) / cut.rows {
            let top = cy * cut.rows;
            let rows = if cut.padded {
                cut.rows
            } else {
                cut.rows.min(ny - top)
            };
            let bytes = rows as usize * cut.width as usize * sample;
            let own = y.start.max(top)..y.end.min(top.saturating_add(rows));
            let at = (own.start - y.start) as usize * row;
            if whole && cut.width == nx && own.len() == rows as usize {
                page.decode(cy * across, &mut out[at..at + bytes])?;
                continue;
            }
            for cx in x.start / cut.width..=(x.end - 1) / cut.width {
                let left = cx * cut.width;
                let chunk = self.chunk(&*page, (k, cy * across + cx), bytes)?;
                let cols = x.start.max(left)..x.end.min(left.saturating_add(cut.width));
                let len = cols.len() * sample;
                for j in own.clone() {
                    let from = ((j - top) as usize * cut.width as usize
                        + (cols.start - left) as usize)
                        * sample;
                    let to =
                        (j - y.start) as usize * row + (cols.start - x.start) as usize * sample;
                    out[to..to + len].copy_from_slice(&chunk[from..from + len]);
                }
            }
        }
        Ok(())
    }

    /// Fills the part `x` by `y` of a page out of whole rows; false if the page cannot give these.
    fn cut_from_rows(
        &self,
        page: &dyn Page,
        x: &Range<u32>,
        y: &Range<u32>,
        out: &mut [u8],
    ) -> Result<bool> {
        let sample = self.header.dtype.bytes();
        let row = x.len() * sample;
        let full_row = self.header.dims.0[0] as usize * sample;
        // as many rows at a time as make up a buffer of a fair size
        let step = ((1 << 20) / full_row).max(1);
        let mut buffer = vec![0; full_row * step.min(y.len())];
        for (i, out) in out.chunks_mut(row * step).enumerate() {
            let start = y.start + (i * step) as u32;
            let rows = (out.len() / row) as u32;
            let buffer = &mut buffer[..rows as usize * full_row];
            if !page.rows(start..start + rows, buffer)? {
                return Ok(false);
            }
            for (out, from) in out.chunks_exact_mut(row).zip(buffer.chunks_exact(full_row)) {
                out.copy_from_slice(&from[x.start as usize * sample..][..row]);
            }
        }
        Ok(true)
    }

    /// A chunk out of the cache, or decoded and put there.
    fn chunk(&self, page: &dyn Page, key: (u32, u32), bytes: usize) -> Result<Arc<Vec<u8>>> {
        if let Some(chunk) = self.cache.get(key) {
            return Ok(chunk);
        }
        let mut chunk = vec![0; bytes];
        page.decode(key.1, &mut chunk)?;
        let chunk = Arc::new(chunk);
        self.cache.insert(key, chunk.clone());
        Ok(chunk)
    }
}

impl Parts for PagedVolume {
    fn largest(&self) -> u64 {
        self.chunk
    }

    fn parts_of(&self, asked: &[Range<u32>; 3]) -> Result<Vec<Shared>> {
        let [nx, ny, _] = self.header.dims.0;
        let mut all = Vec::new();
        for k in asked[2].clone() {
            let Cut {
                width,
                rows,
                padded,
            } = self.pages.page(k)?.cut();
            let span = |a: usize, n: u32| asked[a].start / n..(asked[a].end - 1) / n + 1;
            for cy in span(1, rows) {
                let top = cy * rows;
                let end = top.saturating_add(rows);
                let y = top..if padded { end } else { end.min(ny) };
                for cx in span(0, width) {
                    let x = cx * width..(cx * width).saturating_add(width);
                    let index = [cy * nx.div_ceil(width) + cx, 0, k];
                    all.push(Shared::new(index, [x, y.clone(), k..k + 1], asked));
                }
            }
        }
        Ok(all)
    }

    fn decode(&self, shared: &Shared, out: &mut [u8]) -> Result<()> {
        let [index, _, k] = shared.index;
        self.pages.page(k)?.decode(index, out)
    }

    fn end(&self, [_, _, k]: [u32; 3]) -> u32 {
        k + 1
    }
}

impl Volume for PagedVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let slice = out.len() / z.len();
        out.par_chunks_exact_mut(slice)
            .enumerate()
            .try_for_each(|(i, out)| self.read_slice(z.start + i as u32, &x, &y, out))
    }

    fn random_access(&self) -> bool {
        self.random
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let total = self.header.dims.voxels() * self.header.dtype.bytes() as u64;
        // pages that are not packed are read as they are
        if self.chunk == 0 || total <= self.cache.budget() {
            return Ok(None);
        }
        self.cache.clear();
        Ok(Some(Box::new(Unpacked::new(self, dir)?)))
    }

    fn held_bytes(&self) -> u64 {
        // besides the cache and tags, every thread decodes one chunk and has a buffer of its own
        let threads = rayon::current_num_threads() as u64;
        self.cache.budget() + (2 << 20) + threads * (self.chunk + (1 << 20))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::{Dtype, Endian};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Pages of which voxel (x, y, z) has the value x + 10 y + 100 z, cut in ways that take turns.
    struct Counting {
        size: [u32; 2],
        cuts: Vec<Cut>,
        decoded: Arc<AtomicUsize>,
    }

    struct CountingPage<'a>(&'a Counting, u32);

    impl Pages for Counting {
        fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
            Ok(Box::new(CountingPage(self, k)))
        }

        fn largest(&self) -> (u64, u32) {
            let voxels = |c: &Cut| u64::from(c.width) * u64::from(c.rows);
            let most = self.cuts.iter().map(voxels).max();
            (
                most.unwrap(),
                self.cuts.iter().map(|c| c.rows).max().unwrap(),
            )
        }
    }

    impl Page for CountingPage<'_> {
        fn cut(&self) -> Cut {
            self.0.cuts[self.1 as usize % self.0.cuts.len()]
        }

        fn decode(&self, index: u32, out: &mut [u8]) -> Result<()> {
            self.0.decoded.fetch_add(1, Ordering::Relaxed);
            let Cut {
                width,
                rows,
                padded,
            } = self.cut();
            let across = self.0.size[0].div_ceil(width);
            let (left, top) = (index % across * width, index / across * rows);
            let mut values = out.as_chunks_mut::<4>().0.iter_mut();
            for j in top..top + rows {
                if !padded && j >= self.0.size[1] {
                    break;
                }
                for i in left..left + width {
                    *values.next().unwrap() = (i + 10 * j + 100 * self.1).to_ne_bytes();
                }
            }
            assert!(values.next().is_none());
            Ok(())
        }
    }

    /// A volume of them.
    pub(crate) fn counting(
        [nx, ny, nz]: [u32; 3],
        cuts: &[(u32, u32, bool)],
    ) -> (PagedVolume, Arc<AtomicUsize>) {
        let cut = |&(width, rows, padded): &(u32, u32, bool)| Cut {
            // strips are as wide as the page, and no higher
            width: if padded { width } else { nx },
            rows: if padded { rows } else { rows.min(ny) },
            padded,
        };
        let pages = Counting {
            size: [nx, ny],
            cuts: cuts.iter().map(cut).collect(),
            decoded: Arc::default(),
        };
        let header = Header {
            format: "test",
            dims: Dims([nx, ny, nz]),
            dtype: Dtype::U32,
            endian: Endian::NATIVE,
            placement: Placement::default(),
        };
        let decoded = pages.decoded.clone();
        (PagedVolume::new(header, Box::new(pages)), decoded)
    }

    #[test]
    fn a_sweep_decodes_pages_once() {
        let (volume, decoded) = counting([6, 90, 40], &[(6, 30, false)]);
        let dir = tempfile::tempdir().unwrap();
        let once = Unpacked::new(&volume, dir.path()).unwrap();
        for slab in 0..4 {
            let z = 10 * slab..(10 * slab + 12).min(40);
            for y in [0..40, 20..60, 40..90] {
                let mut out = vec![0; 4 * 6 * y.len() * z.len()];
                once.read_box(0..6, y, z.clone(), &mut out).unwrap();
            }
            once.release(z.start..z.end - 2);
        }
        assert_eq!(decoded.load(Ordering::Relaxed), 3 * 40);
    }
}
