//! What the labels of a part of a volume tell those of the parts below and above it: which components reach the slice that
//! it shares with each.
//!
//! A component that has voxels in the slice where a part begins was seen by the part before, so it is no new one: it
//! arrives. Since components are numbered by their smallest voxels, those that arrive have the first numbers of the
//! part, and all others have the numbers in the order that they have in the whole volume.

use crate::convert::label::band::SealedBand;
use crate::error::{Error, Result};
use crate::labels::SlabComponents;
use crate::sys::state_codec::{Decoder, Encoder};
use bytemuck::{Pod, Zeroable};
use std::collections::BTreeMap;
use std::path::Path;

/// In the place of a layer: the component reaches the slice where the part ends.
const GOES_ON: u32 = u32::MAX;

/// A component of the slice where a part begins.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct Arrival {
    /// The slab where it ends; see [`Arrival::leaves`].
    pub layer: u32,
    /// Its class there.
    pub class: u32,
    /// 1 for an object, 0 for a cell.
    pub above: u64,
    /// Voxels of that class, in a search for small components.
    pub voxels: u64,
}

impl Arrival {
    /// The place among [`Seam::leaving`] of one that reaches the slice where the part ends.
    pub fn leaves(&self) -> Option<u32> {
        (self.layer == GOES_ON).then_some(self.class)
    }
}

/// A component of the slice where a part ends.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct Leaving {
    /// Its number among those of its phase in the part.
    pub provisional: u64,
    /// Its number among those of both phases.
    pub surface: u64,
    /// 1 for an object, 0 for a cell.
    pub above: u64,
    /// Its voxels in the part, in a search for small components.
    pub voxels: u64,
}

/// What a part shares with the one before and the one behind it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Seam {
    /// CRC-32 of the bits of the slice where the part begins, and of the one where it ends.
    pub bits: [u32; 2],
    /// Place in `arrivals` of each run of the first slice, rows in order; none of the volume's own first slice.
    pub low: Vec<u32>,
    /// Components of the first slice.
    pub arrivals: Vec<Arrival>,
    /// Place in `leaving` of each run of the last slice; none of the volume's own last slice.
    pub high: Vec<u32>,
    /// Components of the last slice.
    pub leaving: Vec<Leaving>,
}

impl Seam {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let runs = self.low.len() + self.high.len();
        let ends = size_of_val(&self.arrivals[..]) + size_of_val(&self.leaving[..]);
        (4 * runs + ends) as u64
    }

    /// Takes the components of the first slice of the part's first slab, whose classes they are before all others.
    pub fn begin(&mut self, sealed: &[SealedBand], classes: &SlabComponents) {
        for (b, (band, of_local)) in sealed.iter().zip(&classes.of_local).enumerate() {
            // the shared row once
            let skip = if b > 0 { band.edges.head_runs_first } else { 0 };
            let labels = band.edges.first_slice.iter().skip(skip);
            self.low
                .extend(labels.map(|&local| of_local[local as usize]));
        }
        let count = self.low.iter().max().map_or(0, |&last| last + 1);
        self.arrivals = (0..count)
            .map(|class| Arrival {
                layer: GOES_ON,
                class,
                above: classes.above[class as usize].into(),
                voxels: 0,
            })
            .collect();
        self.bits[0] = crc_of(sealed.iter().map(|band| band.slices[0]));
    }

    /// Follows them through a slab: `is_first` where [`Seam::begin`] has found them.
    pub fn follow(&mut self, layer: u32, classes: &SlabComponents, is_first: bool) {
        for arrival in self.arrivals.iter_mut().filter(|a| a.layer == GOES_ON) {
            let class = match is_first {
                true => arrival.class,
                false => classes.carried_in[arrival.class as usize],
            };
            match classes.live.binary_search(&class) {
                Ok(live) => arrival.class = live as u32,
                Err(_) => (arrival.layer, arrival.class) = (layer, class),
            }
        }
    }

    /// Notes how many voxels the classes have in which components of the first slice end.
    pub fn note_voxels(&mut self, layer: u32, voxels: &[u64]) {
        for arrival in self.arrivals.iter_mut().filter(|a| a.layer == layer) {
            arrival.voxels = voxels[arrival.class as usize];
        }
    }

    /// Takes the components of the last slice.
    pub fn end(&mut self, high: &[u32], leaving: impl Iterator<Item = Leaving>) {
        self.high = high.to_vec();
        self.leaving = leaving.collect();
    }

    /// Writes it to a file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut out = Encoder::create(path)?;
        out.array(&self.bits)?;
        out.array(&self.low)?;
        out.array(&self.arrivals)?;
        out.array(&self.high)?;
        out.array(&self.leaving)?;
        out.finish()
    }

    /// Reads it from a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the file is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
        let seam = Decoder::new(bytes).and_then(|mut input| {
            let bits: Vec<u32> = input.array()?;
            Some(Seam {
                bits: bits.try_into().ok()?,
                low: input.array()?,
                arrivals: input.array()?,
                high: input.array()?,
                leaving: input.array()?,
            })
        });
        let sound = seam.filter(|seam| {
            let within = |runs: &[u32], count: usize| runs.iter().all(|&at| (at as usize) < count);
            let leaving = seam.leaving.len();
            let ends = |a: &Arrival| a.leaves().is_none_or(|at| (at as usize) < leaving);
            within(&seam.low, seam.arrivals.len())
                && within(&seam.high, leaving)
                && seam.arrivals.iter().all(ends)
        });
        sound.ok_or_else(|| {
            Error::format(
                path,
                "other bytes than were written",
                "what a part has in common with others",
            )
        })
    }
}

/// What is known of the components of a part that go on in others: nothing where there is no other.
#[derive(Debug, Clone)]
pub struct Beyond<V> {
    /// Of those that arrive and end in the part, by layer: their classes there.
    ended: BTreeMap<u32, Vec<(u32, V)>>,
    /// Of those that reach the part's last slice.
    pub leaving: Vec<V>,
}

impl<V> Default for Beyond<V> {
    fn default() -> Self {
        Beyond {
            ended: BTreeMap::new(),
            leaving: Vec::new(),
        }
    }
}

impl<V: Copy> Beyond<V> {
    /// What is known of those of a seam that arrive and that leave.
    pub fn of(seam: &Seam, arrivals: &[V], leaving: Vec<V>) -> Self {
        let mut ended: BTreeMap<u32, Vec<(u32, V)>> = BTreeMap::new();
        for (arrival, &known) in seam.arrivals.iter().zip(arrivals) {
            if arrival.leaves().is_none() {
                let of_layer = ended.entry(arrival.layer).or_default();
                of_layer.push((arrival.class, known));
            }
        }
        Beyond { ended, leaving }
    }

    /// The classes of a slab in which components that arrived end.
    pub fn ended(&self, layer: u32) -> &[(u32, V)] {
        self.ended.get(&layer).map_or(&[], Vec::as_slice)
    }
}

/// CRC-32 of some checksums.
pub fn crc_of(checksums: impl Iterator<Item = u32>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    checksums.for_each(|crc| hasher.update(&crc.to_le_bytes()));
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two components arrive of which one leaves, and one more leaves.
    fn seam() -> Seam {
        let arrival = |layer, class| Arrival {
            layer,
            class,
            above: 1,
            voxels: 3,
        };
        Seam {
            bits: [5, 6],
            low: vec![0, 1, 1],
            arrivals: vec![arrival(7, 2), arrival(GOES_ON, 1)],
            high: vec![1, 0],
            leaving: vec![Leaving::default(); 2],
        }
    }

    #[test]
    fn a_seam_comes_back_unless_it_is_changed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("seam");
        seam().write(&path).unwrap();
        assert_eq!(Seam::read(&path).unwrap(), seam());
        let bytes = std::fs::read(&path).unwrap();
        for at in 0..bytes.len() {
            let mut other = bytes.clone();
            other[at] ^= 16;
            std::fs::write(&path, other).unwrap();
            assert!(Seam::read(&path).is_err(), "{at}");
        }
        // whole, but of components that are not there
        let mut other = seam();
        other.high[0] = 2;
        other.write(&path).unwrap();
        assert!(Seam::read(&path).is_err());
    }

    #[test]
    fn components_that_arrive_are_followed_to_where_they_end() {
        let mut seam = Seam {
            arrivals: vec![
                Arrival {
                    layer: GOES_ON,
                    ..Arrival::default()
                };
                3
            ],
            ..Seam::default()
        };
        for (class, arrival) in (0..).zip(&mut seam.arrivals) {
            arrival.class = class;
        }
        // the second one ends at once, the others are one in the next slab
        let first = SlabComponents {
            live: vec![0, 2, 4],
            ..SlabComponents::default()
        };
        seam.follow(3, &first, true);
        let second = SlabComponents {
            carried_in: vec![0, 0, 1],
            live: vec![1],
            ..SlabComponents::default()
        };
        seam.follow(4, &second, false);
        seam.note_voxels(4, &[70, 80]);
        let ends: Vec<_> = seam.arrivals.iter().map(|a| (a.layer, a.class)).collect();
        assert_eq!(ends, [(4, 0), (3, 1), (4, 0)]);
        let voxels: Vec<_> = seam.arrivals.iter().map(|a| a.voxels).collect();
        assert_eq!(voxels, [70, 0, 70]);
        let beyond = Beyond::of(&seam, &["a", "b", "a"], Vec::new());
        assert_eq!(beyond.ended(3), [(1, "b")]);
        assert_eq!(beyond.ended(4), [(0, "a"), (0, "a")]);
        assert!(beyond.ended(5).is_empty());
    }
}
