//! Pieces of rows in files, block by block, and which basins they belong to.

use super::SlabGrid;
use super::ascent::{Piece, RowPieces};
use super::basins::{SlabClasses, renamed};
use super::metric::Peak;
use super::numbers::Numbers;
use crate::error::Result;
use crate::sys::locks::lock;
use crate::sys::spill_file::{Mark, Place, SpillFile};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Pieces of the rows of blocks, in an unnamed file.
#[derive(Debug)]
pub struct PieceFile {
    file: Mutex<SpillFile>,
    blocks: Vec<(Place<u32>, Place<Piece>)>,
}

impl PieceFile {
    /// An empty file in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(dir: &Path) -> Result<Self> {
        Ok(PieceFile {
            file: Mutex::new(SpillFile::new(dir)?),
            blocks: Vec::new(),
        })
    }

    /// The same in a file of this name.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn create(path: &Path) -> Result<Self> {
        Ok(PieceFile {
            file: Mutex::new(SpillFile::create(path)?),
            blocks: Vec::new(),
        })
    }

    /// Appends those of a block.
    pub fn push(&mut self, rows: &RowPieces) -> Result<()> {
        let mut file = lock(&self.file);
        let places = (file.push(&rows.rows)?, file.push(&rows.pieces)?);
        drop(file);
        self.blocks.push(places);
        Ok(())
    }

    /// Some rows of a block.
    pub fn rows(&self, block: usize, rows: Range<usize>) -> Result<RowPieces> {
        let (offsets, pieces) = &self.blocks[block];
        let mut file = lock(&self.file);
        let at = offsets.offset() + 4 * rows.start as u64;
        let mut rows = file.get(&Place::<u32>::new(at, rows.len() + 1))?;
        let [first, end] = [rows[0], *rows.last().expect("one more than rows")];
        let at = pieces.offset() + (first as usize * size_of::<Piece>()) as u64;
        let pieces = file.get(&Place::<Piece>::new(at, (end - first) as usize))?;
        rows.iter_mut().for_each(|row| *row -= first);
        Ok(RowPieces { rows, pieces })
    }

    /// All rows of a block.
    pub fn block(&self, block: usize) -> Result<RowPieces> {
        let [_, rows] = self.blocks[block].0.numbers();
        self.rows(block, 0..rows as usize - 1)
    }

    /// Bytes on the disk.
    pub fn bytes(&self) -> u64 {
        lock(&self.file).here::<u8>().offset()
    }
}

/// A basin in a slab.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SlabBasin {
    /// Its number.
    pub number: u64,
    /// Its maximum, if that lies in the slab.
    peak_voxel: u64,
    /// The level of that, or 0.
    peak_level: u32,
    /// 1 if it touches the last slice.
    live: u32,
}

impl SlabBasin {
    fn new(number: u64) -> Self {
        SlabBasin {
            number,
            peak_voxel: 0,
            peak_level: 0,
            live: 0,
        }
    }

    fn add(&mut self, peak: Option<Peak>, live: bool) {
        if let Some(peak) = peak {
            (self.peak_voxel, self.peak_level) = (peak.voxel, peak.level);
        }
        self.live |= u32::from(live);
    }

    /// Its maximum, if that lies in the slab.
    pub fn peak(&self) -> Option<Peak> {
        (self.peak_level > 0).then_some(Peak {
            level: self.peak_level,
            voxel: self.peak_voxel,
        })
    }

    /// True if it touches the last slice.
    pub fn is_live(&self) -> bool {
        self.live == 1
    }
}

/// Names of the files of a store that is kept.
pub const STORE: [&str; 3] = ["basin-pieces", "basin-tables", "basin-places"];

/// Where the pieces and the basins of a store lie in their files.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct StoredBlock {
    rows: [u64; 2],
    pieces: [u64; 2],
}

/// The pieces of all blocks, and the basins of each slab.
#[derive(Debug)]
pub struct Store {
    grid: SlabGrid,
    dir: PathBuf,
    pieces: PieceFile,
    basins: Mutex<SpillFile>,
    of_slab: Vec<Place<SlabBasin>>,
    /// The slab that waits for the one behind it.
    waiting: Option<(PieceFile, SlabClasses)>,
}

impl Store {
    /// Nothing yet; files are made in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(grid: SlabGrid, dir: &Path) -> Result<Self> {
        Ok(Store {
            grid,
            dir: dir.to_path_buf(),
            pieces: PieceFile::new(dir)?,
            basins: Mutex::new(SpillFile::new(dir)?),
            of_slab: Vec::new(),
            waiting: None,
        })
    }

    /// The same in files with names, see [`STORE`], in `dir`; what is not to stay lies beside them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn create(grid: SlabGrid, dir: &Path) -> Result<Self> {
        let [pieces, ..] = STORE;
        Ok(Store {
            pieces: PieceFile::create(&dir.join(pieces))?,
            ..Store::new(grid, dir)?
        })
    }

    /// Writes what is needed to open it again, once it is finished; returns what its files hold.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&mut self) -> Result<[Mark; 3]> {
        let [_, tables, places] = STORE.map(|name| self.dir.join(name));
        let mut named = SpillFile::create(&tables)?;
        let mut of_places = SpillFile::create(&places)?;
        let mut of_slab = Vec::new();
        for place in &self.of_slab {
            let all = lock(&self.basins).get(place)?;
            of_slab.push(named.push(&all)?.numbers());
        }
        of_places.push(&of_slab)?;
        let blocks = self.pieces.blocks.iter().map(|(rows, pieces)| StoredBlock {
            rows: rows.numbers(),
            pieces: pieces.numbers(),
        });
        of_places.push_all(blocks)?;
        let pieces = lock(&self.pieces.file).mark()?;
        Ok([pieces, named.mark()?, of_places.mark()?])
    }

    /// Opens one that was saved, cut like this.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn open(
        grid: SlabGrid,
        dir: &Path,
        [pieces, tables, mut places]: [SpillFile; 3],
    ) -> Result<Self> {
        let slabs = grid.slabs() as usize;
        let of_slab: Vec<[u64; 2]> = places.get(&Place::new(0, slabs))?;
        let blocks = slabs * grid.bands() as usize;
        let blocks: Vec<StoredBlock> = places.get(&Place::new(16 * slabs as u64, blocks))?;
        let place = |[offset, len]: [u64; 2]| Place::new(offset, len as usize);
        Ok(Store {
            grid,
            dir: dir.to_path_buf(),
            pieces: PieceFile {
                file: Mutex::new(pieces),
                blocks: blocks
                    .into_iter()
                    .map(
                        |StoredBlock {
                             rows,
                             pieces: [offset, len],
                         }| {
                            (place(rows), Place::new(offset, len as usize))
                        },
                    )
                    .collect(),
            },
            basins: Mutex::new(tables),
            of_slab: of_slab
                .into_iter()
                .map(|[offset, len]| Place::new(offset, len as usize))
                .collect(),
            waiting: None,
        })
    }

    /// Takes the pieces of a slab, of bands by rising y, as they were made. They wait until the slab behind it is
    /// there: most of the ways that leave the slab are known to be one then, and so are their pieces.
    pub fn push(
        &mut self,
        raw: PieceFile,
        classes: SlabClasses,
        numbers: &mut Numbers,
    ) -> Result<()> {
        let before = self.waiting.replace((raw, classes));
        before.map_or(Ok(()), |(raw, classes)| {
            self.settle(&raw, &classes, numbers)
        })
    }

    /// Writes a slab's basins, as far as they are known to be different, and its pieces with these.
    fn settle(
        &mut self,
        raw: &PieceFile,
        classes: &SlabClasses,
        numbers: &mut Numbers,
    ) -> Result<()> {
        let roots = classes
            .classes
            .iter()
            .map(|class| numbers.find(class.number));
        let roots = roots.collect::<Result<Vec<u64>>>()?;
        let mut all = roots.clone();
        all.sort_unstable();
        all.dedup();
        let place = |root: &u64| all.binary_search(root).expect("one of all") as u32;
        let of_class: Vec<u32> = roots.iter().map(place).collect();
        let mut basins: Vec<SlabBasin> = all.iter().map(|&number| SlabBasin::new(number)).collect();
        for (class, &basin) in classes.classes.iter().zip(&of_class) {
            basins[basin as usize].add(class.peak, class.live);
        }
        let named = lock(&self.basins).push(&basins)?;
        self.of_slab.push(named);
        for (band, of_end) in classes.of_end.iter().enumerate() {
            let rows = raw.block(band)?;
            let basin = |end: u32| of_class[of_end[end as usize] as usize];
            self.pieces.push(&renamed(&rows, basin))?;
        }
        Ok(())
    }

    /// Takes what waits for a slab that does not come, and numbers basins from 0 by their first voxels: `numbers`, until
    /// now those of classes, are those of basins then. Returns how many there are.
    pub fn finish(&mut self, numbers: &mut Numbers) -> Result<u64> {
        if let Some((raw, classes)) = self.waiting.take() {
            self.settle(&raw, &classes, numbers)?;
        }
        let basins = numbers.number_sets()?;
        let mut named = SpillFile::new(&self.dir)?;
        let mut file = lock(&self.basins);
        for place in &mut self.of_slab {
            let mut all = file.get(place)?;
            for basin in &mut all {
                basin.number = numbers.get(basin.number)?;
            }
            *place = named.push(&all)?;
        }
        *file = named;
        Ok(basins)
    }

    /// How the slices are cut.
    pub fn grid(&self) -> SlabGrid {
        self.grid
    }

    /// How many slabs there are.
    pub fn slabs(&self) -> u32 {
        self.grid.slabs()
    }

    /// The basins of a slab; pieces are of these by their place. One may stand at several places.
    pub fn basins(&self, slab: u32) -> Result<Vec<SlabBasin>> {
        lock(&self.basins).get(&self.of_slab[slab as usize])
    }

    /// The pieces of a block.
    pub fn block(&self, slab: u32, band: u32) -> Result<RowPieces> {
        self.pieces.block(self.at(slab, band))
    }

    /// The pieces of a row.
    pub fn row(&self, y: u32, z: u32) -> Result<RowPieces> {
        let ([slab, slice], band) = (self.grid.slab_of(z), y / self.grid.band);
        let rows = self.grid.rows(band);
        let row = slice as usize * rows.len() + (y - rows.start) as usize;
        self.pieces.rows(self.at(slab, band), row..row + 1)
    }

    fn at(&self, slab: u32, band: u32) -> usize {
        slab as usize * self.grid.bands() as usize + band as usize
    }

    /// Bytes on the disk.
    pub fn bytes(&self) -> u64 {
        self.pieces.bytes() + lock(&self.basins).here::<u8>().offset()
    }
}
