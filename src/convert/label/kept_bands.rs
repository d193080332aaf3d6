//! What is kept of all bands between labelling and meshing: their bits and the local components of their runs, and of
//! volumes that are slow to read, filtered or packed ones, the samples that meshing needs.

use crate::checkpoint::{Marks, Scratch};
use crate::error::Result;
use crate::labels::{Bits, NeededRows, RowKinds, Span, Voxels};
use crate::sys::spill_file::{Place, SpillFile};
use crate::volume::{Volume, Voxel};
use bytemuck::{Pod, Zeroable};

/// Names of the files.
pub const BANDS: &str = "bands";
const BAND_PLACES: &str = "band-places";

/// Where what is kept of a band lies.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub struct KeptBand {
    /// Where its rows' kinds begin, of which there is a byte for each.
    kinds: u64,
    /// Where the words of its mixed rows begin.
    words: u64,
    mixed: u64,
    /// Where the labels of its runs begin.
    labels: u64,
    runs: u64,
    /// Where the rows of samples that meshing needs begin, if they are kept.
    samples: u64,
    has_samples: u64,
    /// Its local components: if they have more numbers than fit, labels are of four bytes and not of two.
    components: u64,
    /// 1 if the surface crosses any edge of it.
    has_surface: u64,
}

impl KeptBand {
    /// True if the surface crosses any edge of the band.
    pub fn has_surface(&self) -> bool {
        self.has_surface == 1
    }

    /// Its runs.
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// Its local components.
    pub fn components(&self) -> u64 {
        self.components
    }

    fn is_wide(&self) -> bool {
        self.components > 1 << 16
    }
}

/// What is kept of all bands.
#[derive(Debug)]
pub struct KeptBands {
    data: SpillFile,
    /// A [`KeptBand`] of each band, by layer, then y.
    places: SpillFile,
}

impl KeptBands {
    /// Of none yet.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(files: &Scratch) -> Result<Self> {
        Ok(KeptBands {
            data: SpillFile::create(&files.path(BANDS))?,
            places: SpillFile::create(&files.path(BAND_PLACES))?,
        })
    }

    /// Those of files that `open` opens; `None` if there are none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn opened(open: impl Fn(&str) -> Result<Option<SpillFile>>) -> Result<Option<Self>> {
        let (data, places) = (open(BANDS)?, open(BAND_PLACES)?);
        Ok(data
            .zip(places)
            .map(|(data, places)| KeptBands { data, places }))
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        marks.add(files, BANDS, self.data.mark()?);
        marks.add(files, BAND_PLACES, self.places.mark()?);
        Ok(())
    }

    /// Keeps the bits of a band, and the labels of its runs, of so many components; also the `samples` that meshing needs
    /// if there are any.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn keep<T: Voxel>(
        &mut self,
        bits: &Bits,
        of_run: &[u32],
        components: usize,
        samples: Option<&Voxels<T>>,
    ) -> Result<KeptBand> {
        let (kinds, mixed) = RowKinds::of(bits);
        let mut kept = KeptBand {
            runs: of_run.len() as u64,
            components: components as u64,
            mixed: mixed.len() as u64,
            has_surface: u64::from(kinds.has_surface()),
            ..KeptBand::default()
        };
        if !kept.has_surface() {
            // one component, of one phase
            kept.kinds = self.data.push(&kinds.0[..1])?.offset();
            return Ok(kept);
        }
        kept.kinds = self.data.push(&kinds.0)?.offset();
        kept.words = self.data.push(&mixed)?.offset();
        kept.labels = match kept.is_wide() {
            true => self.data.push(of_run)?.offset(),
            false => {
                let narrow: Vec<u16> = of_run.iter().map(|&label| label as u16).collect();
                self.data.push(&narrow)?.offset()
            }
        };
        if let Some(samples) = samples {
            let mut place = self.data.here::<T>();
            let needed = NeededRows::of(&kinds, &bits.span, &samples.span);
            for rows in &needed.parts {
                self.data.extend(&mut place, samples.of_rows(rows))?;
            }
            (kept.samples, kept.has_samples) = (place.offset(), 1);
        }
        Ok(kept)
    }

    /// Adds the bands of the next layer.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add_layer(&mut self, bands: impl Iterator<Item = KeptBand>) -> Result<()> {
        self.places.push_all(bands).map(|_| ())
    }

    /// The band of this number.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn get(&self, number: u64) -> Result<KeptBand> {
        let place = Place::new(number * size_of::<KeptBand>() as u64, 1);
        Ok(self.places.read(&place)?[0])
    }

    /// The kinds of the rows of a band over `span`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn kinds(&self, kept: &KeptBand, span: &Span) -> Result<RowKinds> {
        let rows = span.rows() * span.slices();
        if !kept.has_surface() {
            let kind: Vec<u8> = self.data.read(&Place::new(kept.kinds, 1))?;
            return Ok(RowKinds(vec![kind[0]; rows]));
        }
        Ok(RowKinds(self.data.read(&Place::new(kept.kinds, rows))?))
    }

    /// Reads the rows of samples that meshing needs of a band over `span`, from the volume if they are not kept.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; those of [`Volume::read_box`].
    pub fn samples<T: Voxel>(
        &self,
        kept: &KeptBand,
        volume: &dyn Volume,
        needed: &NeededRows,
        span: Span,
        out: &mut Voxels<T>,
    ) -> Result<()> {
        let (nx, mut at) = (span.nx, kept.samples);
        out.load_rows(span, needed, |rows, out| {
            if kept.has_samples == 0 {
                return volume.read_box(0..nx, rows.y.clone(), rows.z.clone(), out);
            }
            self.data.read_into(at, out)?;
            at += out.len() as u64;
            Ok(())
        })
    }

    /// The words of its mixed rows.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mixed(&self, kept: &KeptBand) -> Result<Vec<u64>> {
        self.data.read(&Place::new(kept.words, kept.mixed as usize))
    }

    /// The words of some of its mixed rows, of so many words each.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mixed_rows(
        &self,
        kept: &KeptBand,
        rows: std::ops::Range<usize>,
        row_words: usize,
    ) -> Result<Vec<u64>> {
        let first = kept.words + (8 * rows.start * row_words) as u64;
        self.data.read(&Place::new(first, rows.len() * row_words))
    }

    /// Hands out the labels of its runs, in their order.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn labels(&self, kept: &KeptBand, mut each: impl FnMut(u32)) -> Result<()> {
        if kept.is_wide() {
            let all: Vec<u32> = self
                .data
                .read(&Place::new(kept.labels, kept.runs as usize))?;
            all.into_iter().for_each(each);
        } else {
            let all: Vec<u16> = self
                .data
                .read(&Place::new(kept.labels, kept.runs as usize))?;
            all.into_iter().for_each(|label| each(label.into()));
        }
        Ok(())
    }
}
