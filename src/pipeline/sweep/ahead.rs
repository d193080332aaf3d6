//! The bands of the next slab, prepared while one is meshed.

use crate::error::{Error, Result};
use crate::pipeline::band::{Band, BandSource};
use crate::volume::Voxel;
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard};

/// Prepares the bands of a slab one by one, in the memory of bands that are done with: so there is room for
/// one slab and a few bands instead of two slabs. Besides, each page of memory that is touched first costs
/// time.
///
/// To prepare the others only when no tile is left, so that a thread that has none does not wait for another's,
/// took 0.5 to 0.9 % less: threads wait little there.
pub struct Ahead<'a, T> {
    source: &'a BandSource<'a, T>,
    layer: u32,
    bands: u32,
    keep: bool,
    state: Mutex<State<T>>,
}

type Bands<T> = Vec<Band<T>>;

struct State<T> {
    /// The next band to prepare.
    next: u32,
    prepared: Vec<(u32, Band<T>)>,
    /// Memory for others.
    spare: Bands<T>,
    failed: Option<Error>,
}

impl<'a, T: Voxel + Default> Ahead<'a, T> {
    /// Will prepare `bands` bands of `layer`, in the memory of `spare` first. That of bands beyond is kept,
    /// or else given back at once.
    pub fn new(
        source: &'a BandSource<'a, T>,
        (layer, bands): (u32, u32),
        spare: Bands<T>,
        keep: bool,
    ) -> Self {
        let state = State {
            next: 0,
            prepared: Vec::with_capacity(bands as usize),
            spare,
            failed: None,
        };
        Ahead {
            source,
            layer,
            bands,
            keep,
            state: Mutex::new(state),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().expect("no thread panicked")
    }

    /// Prepares the first `count` bands in memory that nobody has to give yet.
    pub fn begin(&self, count: u32) {
        let one = |_| {
            let spare = self.lock().spare.pop();
            self.prepare_in(spare.unwrap_or_else(|| self.source.band()));
        };
        let count = count.min(self.bands);
        (0..count).into_par_iter().with_max_len(1).for_each(one);
    }

    /// Prepares the next band, if there is one, in the memory of a band that is done with.
    pub fn prepare_in(&self, mut band: Band<T>) {
        let mut state = self.lock();
        if state.next == self.bands || state.failed.is_some() {
            if self.keep {
                state.spare.push(band);
            } else {
                // it takes the system a while to have it back
                drop(state);
                drop(band);
            }
            return;
        }
        let index = state.next;
        state.next += 1;
        drop(state);
        let prepared = self.source.prepare(index, self.layer, &mut band);
        let mut state = self.lock();
        match prepared {
            Ok(()) => state.prepared.push((index, band)),
            Err(error) => {
                state.failed.get_or_insert(error);
            }
        }
    }

    /// The bands, if all of them are prepared, and memory for others.
    ///
    /// # Errors
    /// Those of [`BandSource::prepare`].
    pub fn finish(self) -> Result<(Option<Bands<T>>, Bands<T>)> {
        let State {
            mut prepared,
            spare,
            failed,
            ..
        } = self.state.into_inner().expect("no thread panicked");
        if let Some(error) = failed {
            return Err(error);
        }
        prepared.sort_unstable_by_key(|(index, _)| *index);
        let all = self.bands > 0 && prepared.len() == self.bands as usize;
        let bands = prepared.into_iter().map(|(_, band)| band);
        Ok((all.then(|| bands.collect()), spare))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Ambiguous, Dims, Tiling};
    use crate::pipeline::budget::Budget;
    use crate::volume::MemoryVolume;

    #[test]
    fn each_band_is_prepared_once_and_the_rest_is_memory() {
        let dims = Dims([20, 50, 30]);
        let samples = (0..dims.voxels()).map(|i| (i * i % 251) as u8).collect();
        let volume = MemoryVolume::new(dims, Default::default(), samples).unwrap();
        let source = |budget| BandSource {
            volume: &volume,
            ceil: Some(100u8),
            rule: Ambiguous::Separate,
            tiling: Tiling {
                dims,
                macrocube: [8; 3],
            },
            filters: &[],
            budget,
        };
        let enough = Budget::new(1 << 30, 0);
        let source_of_all = source(&enough);
        let bands = source_of_all.tiling.tiles()[1];
        for (keep, begun) in [(false, 0), (true, 2), (true, 100)] {
            let ahead = Ahead::new(&source_of_all, (1, bands), Vec::new(), keep);
            ahead.begin(begun);
            let rest = bands - begun.min(bands) + 3;
            (0..rest).for_each(|_| ahead.prepare_in(source_of_all.band()));
            let (prepared, spare) = ahead.finish().unwrap();
            assert_eq!(spare.len(), if keep { 3 } else { 0 });
            let prepared = prepared.unwrap();
            assert_eq!(prepared.len(), bands as usize);
            for (ty, band) in (0..).zip(&prepared) {
                let mut alone = source_of_all.band();
                source_of_all.prepare(ty, 1, &mut alone).unwrap();
                assert_eq!(band.bits.words, alone.bits.words);
                assert_eq!(band.labels.of_run, alone.labels.of_run);
            }
            // too few for all of them
            let ahead = Ahead::new(&source_of_all, (1, bands), prepared, keep);
            ahead.begin(bands - 1);
            assert!(ahead.finish().unwrap().0.is_none());
        }
        // memory for two bands, not for more
        let mut two = [source_of_all.band(), source_of_all.band()];
        for (ty, band) in (0..).zip(&mut two) {
            source_of_all.prepare(ty, 1, band).unwrap();
        }
        let little = Budget::new(two.iter().map(|band| band.held.bytes()).sum(), 0);
        let source_of_two = source(&little);
        let ahead = Ahead::new(&source_of_two, (1, bands), Vec::new(), true);
        ahead.begin(bands);
        assert!(matches!(ahead.finish(), Err(Error::TooDense { .. })));
    }
}
