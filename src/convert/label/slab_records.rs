//! What labelling leaves of its slabs, in a file.

use crate::convert::layers::Layers;
use crate::error::Result;
use crate::measure::VoxelSums;
use crate::sys::spill_file::{Mark, Place, SpillFile};

/// Numbers that tell of a slab: its layer, and two for each place.
const NUMBERS: usize = 1 + 2 * 7;

/// What labelling leaves of one slab.
#[derive(Debug)]
pub struct SlabRecord {
    /// z index of its macrocubes.
    pub layer: u32,
    /// Number of each class.
    pub provisional: Place<u64>,
    /// See [`SlabComponents`](crate::labels::SlabComponents).
    pub surfaces: Place<u64>,
    /// 1 for objects, 0 for cells, per class.
    pub above: Place<u8>,
    /// See [`SlabComponents`](crate::labels::SlabComponents).
    pub live: Place<u32>,
    /// See [`SlabComponents`](crate::labels::SlabComponents).
    pub carried_in: Place<u32>,
    /// Where the sums of components that end in this slab lie, some at a time, and their classes: see
    /// [`SlabRecord::ended`].
    pub finished: Place<[u64; 4]>,
    /// Where the classes of the local components of each band lie.
    pub of_local: Place<[u64; 2]>,
}

/// Some components that end in a slab.
#[derive(Debug, Clone, Copy)]
pub struct EndedComponents {
    /// Where their sums lie.
    pub sums: Place<VoxelSums>,
    /// Where their classes lie, in the same order.
    pub classes: Place<u32>,
}

impl SlabRecord {
    /// The components that end in this slab, some at a time.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn ended(&self, spool: &mut SpillFile) -> Result<Vec<EndedComponents>> {
        let parts = spool.get(&self.finished)?.into_iter();
        let place = |[sums, many, classes, of]: [u64; 4]| EndedComponents {
            sums: Place::new(sums, many as usize),
            classes: Place::new(classes, of as usize),
        };
        Ok(parts.map(place).collect())
    }

    /// All of it as numbers.
    fn numbers(&self) -> [u64; NUMBERS] {
        let places = [
            self.provisional.numbers(),
            self.surfaces.numbers(),
            self.above.numbers(),
            self.live.numbers(),
            self.carried_in.numbers(),
            self.finished.numbers(),
            self.of_local.numbers(),
        ];
        let mut numbers = places.as_flattened().iter();
        std::array::from_fn(|i| match i {
            0 => u64::from(self.layer),
            _ => *numbers.next().expect("two for each place"),
        })
    }

    /// The slab of these numbers; `None` if there is none.
    fn of(numbers: &[u64; NUMBERS]) -> Option<Self> {
        fn place<T>(numbers: &mut impl Iterator<Item = u64>) -> Option<Place<T>> {
            let (offset, len) = (numbers.next()?, numbers.next()?);
            Some(Place::new(offset, len.try_into().ok()?))
        }
        let numbers = &mut numbers.iter().copied();
        Some(SlabRecord {
            layer: numbers.next()?.try_into().ok()?,
            provisional: place(numbers)?,
            surfaces: place(numbers)?,
            above: place(numbers)?,
            live: place(numbers)?,
            carried_in: place(numbers)?,
            finished: place(numbers)?,
            of_local: place(numbers)?,
        })
    }
}

/// The slabs of a sweep, by rising z, in a file: a volume may have as many as slices.
#[derive(Debug)]
pub struct Slabs {
    records: SpillFile,
    /// The layer of the first one.
    first: u32,
    len: u32,
}

impl Slabs {
    /// Of an empty spool: those from layer `first` on.
    pub fn new(records: SpillFile, first: u32) -> Self {
        let len = 0;
        Slabs {
            records,
            first,
            len,
        }
    }

    /// Those from layer `first` on that a spool holds; `None` if it holds anything else.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(mut records: SpillFile, first: u32) -> Result<Option<Self>> {
        let all = records.everything::<[u64; NUMBERS]>();
        let Some(all) = all else {
            return Ok(None);
        };
        let (mut len, mut sound) = (0, true);
        records.for_each(&all, |numbers| {
            sound &= SlabRecord::of(&numbers).is_some_and(|slab| slab.layer == first + len);
            len += 1;
            Ok(())
        })?;
        Ok(sound.then_some(Slabs {
            records,
            first,
            len,
        }))
    }

    /// See [`SpillFile::mark`].
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self) -> Result<Mark> {
        self.records.mark()
    }

    /// Their layers.
    pub fn layers(&self) -> Layers {
        let (first, end) = (self.first, self.end());
        Layers { first, end }
    }

    /// The layer of the next one.
    pub fn end(&self) -> u32 {
        self.first + self.len
    }

    /// Adds the next one.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn push(&mut self, slab: &SlabRecord) -> Result<()> {
        self.records.push(&[slab.numbers()])?;
        self.len += 1;
        Ok(())
    }

    /// That of a layer, which is one of them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn get(&mut self, layer: u32) -> Result<SlabRecord> {
        let slab = u64::from(layer - self.first);
        let place = Place::new(slab * size_of::<[u64; NUMBERS]>() as u64, 1);
        let numbers = self.records.get::<[u64; NUMBERS]>(&place)?;
        Ok(SlabRecord::of(&numbers[0]).expect("it was written so"))
    }
}
