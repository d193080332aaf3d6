//! Joins components that go on in other parts of a volume: the algorithm of slabs, one level up.
//!
//! Two parts share a slice, in which both have found the same runs, and of each run the component. Parts come by rising z,
//! and no more is in memory than what is known of the components of one slice. Backwards, each gets what has come of it.

use crate::convert::label::{Arrival, Seam};
use crate::convert::memory::SLABS;
use crate::error::Result;
use crate::labels::UnionFind;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::spill_file::{Place, SpillFile};
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// In the place of a number: the component does not reach the part's last slice.
const ENDS: u32 = u32::MAX;

/// Where the arrays of a part lie.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Record {
    /// Of each component of the last slice of the part before: its class here.
    carried_in: [u64; 2],
    /// Of each component of this part's first slice: its class.
    arrivals: [u64; 2],
    /// Of each component of its last slice: its class.
    leaving: [u64; 2],
    /// Of each class: its number among those of the last slice, or [`ENDS`].
    next: [u64; 2],
    /// What is known of each class.
    known: [u64; 2],
}

/// What is known of the components of one part.
pub struct Contributions<K> {
    /// Of those of the first slice that end in the part: of each once, whichever arrivals it is.
    pub ended: fn(&Arrival) -> Option<K>,
    /// Of each of the last slice; `None` if nothing is known of it but what the parts before know.
    pub leaving: Vec<Option<K>>,
}

/// Why two parts do not fit each other, in words.
pub type Misfit = String;

/// Joins the components of parts.
pub struct Joiner<K> {
    spool: SpillFile,
    records: SpillFile,
    /// What is known of the components of the last slice so far.
    carried: Vec<K>,
    /// The component of each of its runs, and the checksum of its bits.
    high: Vec<u32>,
    bits: u32,
    parts: u32,
    held: MemoryReservation,
}

/// The nodes of a part: components that come over, then those that arrive, and their sets.
struct Classes {
    of_node: Vec<u32>,
    /// How many there are, of which the first ones hold components that come over.
    count: usize,
}

impl<K: Pod> Joiner<K> {
    /// Of no part yet; temporary files lie in `work`, and memory is taken from `memory`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(work: &Path, memory: &Arc<MemoryPool>) -> Result<Self> {
        Ok(Joiner {
            spool: SpillFile::new(work)?,
            records: SpillFile::new(work)?,
            carried: Vec::new(),
            high: Vec::new(),
            bits: 0,
            parts: 0,
            held: MemoryReservation::new(memory, SLABS),
        })
    }

    /// Bytes of memory to add a part: what comes over, the part's own, sets, classes and what is known of these.
    fn bytes(&self, seam: &Seam) -> u64 {
        let runs = self.high.len() + seam.high.len();
        let components = self.carried.len() + seam.arrivals.len() + seam.leaving.len();
        seam.bytes() + 4 * runs as u64 + (components * (size_of::<K>() * 2 + 64)) as u64
    }

    /// Why the next part does not fit the last one, with which it shares a slice.
    fn misfit(&self, seam: &Seam) -> Option<Misfit> {
        let (was, is) = (self.high.len(), seam.low.len());
        if was != is {
            return Some(format!(
                "{was} runs of voxels and {is} in the slice that they share"
            ));
        }
        (self.parts > 0 && self.bits != seam.bits[0]).then(|| {
            let [was, is] = [self.bits, seam.bits[0]];
            format!("bits with CRC-32 {was:08x} and {is:08x} in the slice that they share")
        })
    }

    /// Joins the nodes of the next part.
    fn classes(&self, seam: &Seam) -> Classes {
        let carried = self.carried.len() as u32;
        let nodes = self.carried.len() + seam.arrivals.len();
        let mut sets = UnionFind::default();
        sets.reset(nodes);
        for (&high, &low) in self.high.iter().zip(&seam.low) {
            sets.union(high, carried + low);
        }
        let mut first_of: HashMap<[u32; 2], u32> = HashMap::new();
        for (node, arrival) in (carried..).zip(&seam.arrivals) {
            let first = *first_of
                .entry([arrival.layer, arrival.class])
                .or_insert(node);
            sets.union(first, node);
        }
        let (of_node, count) = sets.into_numbers();
        Classes { of_node, count }
    }

    /// Adds the next part. `join` takes to what is known of a component what is known of another piece of it. The inner
    /// error tells why the part does not fit the one before.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`] if there is no memory for what is in a slice; what `join` returns.
    pub fn add(
        &mut self,
        seam: &Seam,
        contributions: Contributions<K>,
        mut join: impl FnMut(&mut K, &K) -> Result<()>,
    ) -> Result<std::result::Result<(), Misfit>> {
        if let Some(misfit) = self.misfit(seam) {
            return Ok(Err(misfit));
        }
        self.held.grow_to(self.bytes(seam))?;
        let Classes { of_node, count } = self.classes(seam);
        let (carried_in, arrivals) = of_node.split_at(self.carried.len());
        let mut known: Vec<Option<K>> = vec![None; count];
        let mut add = |known: &mut Option<K>, more: &K| match known {
            Some(known) => join(known, more),
            None => {
                *known = Some(*more);
                Ok(())
            }
        };
        for (&class, more) in carried_in.iter().zip(&self.carried) {
            add(&mut known[class as usize], more)?;
        }
        let mut leaving = vec![ENDS; seam.leaving.len()];
        let mut seen: HashMap<[u32; 2], ()> = HashMap::new();
        for (&class, arrival) in arrivals.iter().zip(&seam.arrivals) {
            let is_first = seen.insert([arrival.layer, arrival.class], ()).is_none();
            match arrival.leaves() {
                Some(at) => leaving[at as usize] = class,
                None if is_first => {
                    if let Some(more) = (contributions.ended)(arrival) {
                        add(&mut known[class as usize], &more)?;
                    }
                }
                None => {}
            }
        }
        for (class, more) in leaving.iter_mut().zip(&contributions.leaving) {
            if *class == ENDS {
                // it begins in this part
                *class = known.len() as u32;
                known.push(None);
            }
            if let Some(more) = more {
                add(&mut known[*class as usize], more)?;
            }
        }
        let Some(known) = known.into_iter().collect::<Option<Vec<K>>>() else {
            let text = "a component of the slice that they share in one of them alone";
            return Ok(Err(text.to_owned()));
        };
        self.keep(seam, [carried_in, arrivals, &leaving], known)?;
        Ok(Ok(()))
    }

    /// Spools what is known of a part, and goes on to its last slice.
    fn keep(&mut self, seam: &Seam, classes: [&[u32]; 3], known: Vec<K>) -> Result<()> {
        let [carried_in, arrivals, leaving] = classes;
        let mut next = vec![ENDS; known.len()];
        let mut carried = Vec::new();
        for &class in leaving {
            let next = &mut next[class as usize];
            if *next == ENDS {
                *next = carried.len() as u32;
                carried.push(known[class as usize]);
            }
        }
        let number = |&live: &u32| next[leaving[live as usize] as usize];
        self.high = seam.high.iter().map(number).collect();
        let spool = &mut self.spool;
        let record = Record {
            carried_in: spool.push(carried_in)?.numbers(),
            arrivals: spool.push(arrivals)?.numbers(),
            leaving: spool.push(leaving)?.numbers(),
            next: spool.push(&next)?.numbers(),
            known: spool.push(&known)?.numbers(),
        };
        self.records.push(&[record])?;
        self.carried = carried;
        self.bits = seam.bits[1];
        self.parts += 1;
        Ok(())
    }

    /// Hands out, from the last part back to the first, what comes of the components that arrive in each and of those that
    /// leave it; `end` tells that of what is known of a whole component.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what the two return.
    pub fn finish<V: Copy>(
        mut self,
        mut end: impl FnMut(&K) -> Result<V>,
        mut each: impl FnMut(u32, Vec<V>, Vec<V>) -> Result<()>,
    ) -> Result<()> {
        let mut later: Vec<V> = Vec::new();
        for part in (0..self.parts).rev() {
            let place = Place::<Record>::new(u64::from(part) * size_of::<Record>() as u64, 1);
            let record = self.records.get(&place)?[0];
            let known: Vec<K> = self.array(record.known)?;
            let mut of_class = Vec::with_capacity(known.len());
            for (next, known) in self.array::<u32>(record.next)?.into_iter().zip(&known) {
                of_class.push(match next {
                    ENDS => end(known)?,
                    next => later[next as usize],
                });
            }
            let mut of = |place| -> Result<Vec<V>> {
                let classes = self.array::<u32>(place)?;
                let classes = classes.into_iter();
                Ok(classes.map(|class| of_class[class as usize]).collect())
            };
            let (arrivals, leaving) = (of(record.arrivals)?, of(record.leaving)?);
            later = of(record.carried_in)?;
            each(part, arrivals, leaving)?;
        }
        Ok(())
    }

    fn array<T: Pod>(&mut self, [offset, len]: [u64; 2]) -> Result<Vec<T>> {
        self.spool.get(&Place::new(offset, len as usize))
    }
}
