//! Birth numbers of components, and their rank among the components that survive.
//!
//! A component gets a number when it is first seen; numbers rise with the component's smallest voxel
//! (or lattice vertex). Where two meet, the younger number dies. What is left at the end, counted
//! from 1, are the final ids: the same whatever the slabs, bands and threads. One bit per provisional label is
//! kept, in a temporary file but for the newest, so memory does not grow with the volume.
//!
//! The file survives the process: what is done after a checkpoint is done again after a resume, and
//! then retires the same provisional labels again. So bits that have been cleared too early do no harm.

use crate::error::{Error, Result};
use crate::sys::spill_file::Mark;
use crate::sys::state_codec::{Decoder, Encoder};
use std::fs::{File, OpenOptions};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Words of bits per block: the unit of the rank index.
const BLOCK: usize = 512;
/// Words kept in memory before the older half goes to the file.
const RESIDENT: usize = 1 << 17;

/// The bits of all provisional labels so far: 1 for those still alive.
#[derive(Debug)]
pub struct ProvisionalLabels {
    file: File,
    path: PathBuf,
    state: ResidentLabels,
}

impl ProvisionalLabels {
    /// No provisional labels yet; the temporary file is made at `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(path: &Path) -> Result<Self> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(path)
            .map_err(|e| Error::io(path, "create", e))?;
        Ok(ProvisionalLabels {
            file,
            path: path.to_path_buf(),
            state: ResidentLabels::default(),
        })
    }

    /// What the file does not hold.
    pub fn resident(&self) -> &ResidentLabels {
        &self.state
    }

    /// Goes on with the file at `path` as it was saved; `None` if these are no provisional labels.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened.
    pub fn load(path: &Path, input: &mut Decoder) -> Result<Option<Self>> {
        let mut numbers = || Some((input.number()?, input.index()?, input.array()?));
        let Some((count, filed, tail)) = numbers() else {
            return Ok(None);
        };
        let tail: Vec<u64> = tail;
        if Some(count.div_ceil(64)) != (tail.len() as u64).checked_add(filed as u64) {
            return Ok(None);
        }
        let opened = OpenOptions::new().read(true).write(true).open(path);
        Ok(Some(ProvisionalLabels {
            file: opened.map_err(|e| Error::io(path, "open", e))?,
            path: path.to_path_buf(),
            state: ResidentLabels { count, filed, tail },
        }))
    }

    /// Adds labels that are given as bits, behind as many dead ones as fill a word; returns the number of the first.
    ///
    /// # Errors
    /// [`Error::Io`] if older bits cannot be written.
    pub fn append(&mut self, words: &[u64]) -> Result<u64> {
        let first = self.state.count.next_multiple_of(64);
        self.state.tail.extend_from_slice(words);
        self.state.count = first + 64 * words.len() as u64;
        self.file_old()?;
        Ok(first)
    }

    /// The bits of labels that are all in the file, some words at a time.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails, and what `each` returns.
    pub fn each_block(&self, mut each: impl FnMut(&mut [u64]) -> Result<()>) -> Result<()> {
        let mut block = vec![0u64; BLOCK];
        for start in (0..self.state.filed).step_by(BLOCK) {
            let words = &mut block[..BLOCK.min(self.state.filed - start)];
            self.read(start, words)?;
            each(words)?;
        }
        Ok(())
    }

    /// Gives out `n` new numbers and returns the first.
    ///
    /// # Errors
    /// [`Error::Io`] if older bits cannot be written.
    pub fn allocate(&mut self, n: usize) -> Result<u64> {
        let first = self.state.count;
        for _ in 0..n {
            if self.state.count.is_multiple_of(64) {
                self.state.tail.push(0);
            }
            *self.state.tail.last_mut().expect("just pushed") |= 1 << (self.state.count % 64);
            self.state.count += 1;
        }
        self.file_old()?;
        Ok(first)
    }

    /// Brings older bits to the file.
    fn file_old(&mut self) -> Result<()> {
        while self.state.tail.len() > RESIDENT {
            let old: Vec<u64> = self.state.tail.drain(..RESIDENT / 2).collect();
            self.write(self.state.filed, &old)?;
            self.state.filed += old.len();
        }
        Ok(())
    }

    /// Brings all of them to the file; returns how many there are, for [`ProvisionalLabels::spilled`].
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn spill(&mut self) -> Result<u64> {
        let tail = std::mem::take(&mut self.state.tail);
        self.write(self.state.filed, &tail)?;
        self.state.filed += tail.len();
        Ok(self.state.count)
    }

    /// How much the file holds, of labels that are all in it.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn mark(&self) -> Result<Mark> {
        let mut crc = crc32fast::Hasher::new();
        self.each_block(|words| {
            crc.update(bytemuck::cast_slice(words));
            Ok(())
        })?;
        Ok(Mark {
            len: self.state.spilled_bytes(),
            crc: crc.finalize(),
        })
    }

    /// So many that are in the file at `path`, to be read.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened.
    pub fn spilled(path: &Path, count: u64) -> Result<Self> {
        let opened = OpenOptions::new().read(true).open(path);
        Ok(ProvisionalLabels {
            file: opened.map_err(|e| Error::io(path, "open", e))?,
            path: path.to_path_buf(),
            state: ResidentLabels {
                count,
                filed: count.div_ceil(64) as usize,
                tail: Vec::new(),
            },
        })
    }

    /// Says that number `provisional_id` has become part of an older component.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn retire(&mut self, provisional_id: u64) -> Result<()> {
        let (word, bit) = (
            (provisional_id / 64) as usize,
            1u64 << (provisional_id % 64),
        );
        if word >= self.state.filed {
            self.state.tail[word - self.state.filed] &= !bit;
            return Ok(());
        }
        let mut buffer = [0u64];
        self.read(word, &mut buffer)?;
        self.write(word, &[buffer[0] & !bit])
    }

    /// The ids of what is alive, of labels that are all in the file: see [`ProvisionalLabels::spill`].
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn renumber(&self) -> Result<Ranks> {
        self.renumber_some(0..self.state.filed, 0)
    }

    /// The same of those in some words of the file, given how many are alive before these: labels are numbered from the
    /// first one of these words.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn renumber_some(&self, range: Range<usize>, alive_before: u64) -> Result<Ranks> {
        let mut before = Vec::with_capacity(range.len().div_ceil(BLOCK) + 1);
        let mut alive = alive_before;
        let mut block = vec![0u64; BLOCK];
        for start in range.clone().step_by(BLOCK) {
            before.push(alive);
            let words = &mut block[..BLOCK.min(range.end - start)];
            self.read(start, words)?;
            alive += words.iter().map(|w| u64::from(w.count_ones())).sum::<u64>();
        }
        Ok(Ranks {
            provisional: ProvisionalLabels {
                file: self
                    .file
                    .try_clone()
                    .map_err(|e| Error::io(&self.path, "open", e))?,
                path: self.path.clone(),
                state: self.state.clone(),
            },
            range,
            before,
            alive,
            cached: None,
            block,
            ones: Vec::with_capacity(BLOCK),
        })
    }

    fn read(&self, word: usize, out: &mut [u64]) -> Result<()> {
        self.file
            .read_exact_at(bytemuck::cast_slice_mut(out), 8 * word as u64)
            .map_err(|e| Error::io(&self.path, "read back", e))
    }

    fn write(&self, word: usize, words: &[u64]) -> Result<()> {
        self.file
            .write_all_at(bytemuck::cast_slice(words), 8 * word as u64)
            .map_err(|e| Error::io(&self.path, "write", e))
    }
}

/// Provisional labels but for the bits in the file.
#[derive(Debug, Clone, Default)]
pub struct ResidentLabels {
    count: u64,
    /// Words in the file.
    filed: usize,
    /// The words after those in the file.
    tail: Vec<u64>,
}

impl ResidentLabels {
    /// Writes it, for [`ProvisionalLabels::load`].
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        out.number(self.count)?;
        out.number(self.filed as u64)?;
        out.array(&self.tail)
    }

    /// Bytes of the file that count.
    pub fn spilled_bytes(&self) -> u64 {
        8 * self.filed as u64
    }
}

/// Final ids of provisional labels.
#[derive(Debug)]
pub struct Ranks {
    provisional: ProvisionalLabels,
    /// The words of the file that have them.
    range: Range<usize>,
    /// Provisional labels alive before each block.
    before: Vec<u64>,
    alive: u64,
    /// The block that is in memory.
    cached: Option<usize>,
    block: Vec<u64>,
    /// Provisional labels alive in it before each of its words.
    ones: Vec<u32>,
}

impl Ranks {
    /// The largest id.
    pub fn alive(&self) -> u64 {
        self.alive
    }

    /// The id, from 1, of a provisional label that is alive.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn id(&mut self, provisional_id: u64) -> Result<u64> {
        let word = (provisional_id / 64) as usize;
        let block = word / BLOCK;
        if self.cached != Some(block) {
            let start = self.range.start + block * BLOCK;
            let len = BLOCK.min(self.range.end - start);
            self.provisional.read(start, &mut self.block[..len])?;
            self.cached = Some(block);
            self.ones.clear();
            self.ones.extend(self.block[..len].iter().scan(0, |sum, w| {
                let before = *sum;
                *sum += w.count_ones();
                Some(before)
            }));
        }
        let within = word % BLOCK;
        let bits = self.block[within] & (!0 >> (63 - provisional_id % 64));
        Ok(self.before[block] + u64::from(self.ones[within] + bits.count_ones()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_parts_have_the_ids_of_all_of_them() {
        let dir = tempfile::tempdir().unwrap();
        let mut all = ProvisionalLabels::new(&dir.path().join("all")).unwrap();
        let (mut windows, mut dead) = (Vec::new(), Vec::new());
        for part in 0..40u64 {
            let path = dir.path().join(part.to_string());
            let mut labels = ProvisionalLabels::new(&path).unwrap();
            let count = part * part * 7 % 9000;
            labels.allocate(count as usize).unwrap();
            for label in (0..count).filter(|label| label * part % 5 == 1) {
                labels.retire(label).unwrap();
            }
            assert_eq!(labels.spill().unwrap(), count);
            let again = ProvisionalLabels::spilled(&path, count).unwrap();
            assert_eq!(again.mark().unwrap(), labels.mark().unwrap());
            let first = all.append(&[]).unwrap();
            again
                .each_block(|words| all.append(words).map(|_| ()))
                .unwrap();
            windows.push((first, count));
            dead.extend((count > 0).then_some(first + count / 2));
        }
        for &label in &dead {
            all.retire(label).unwrap();
        }
        all.spill().unwrap();
        let mut whole = all.renumber().unwrap();
        let mut before = 0;
        for (part, (first, count)) in windows.into_iter().enumerate() {
            let part = part as u64;
            let words = (first / 64) as usize..((first + count).div_ceil(64)) as usize;
            let mut ranks = all.renumber_some(words, before).unwrap();
            for label in (0..count).filter(|l| l * part % 5 != 1 && l != &(count / 2)) {
                let id = ranks.id(label).unwrap();
                assert_eq!(id, whole.id(first + label).unwrap());
                assert!(id > before);
            }
            before = ranks.alive();
        }
        assert_eq!(before, whole.alive());
    }

    #[test]
    fn ids_are_ranks_among_survivors_also_when_bits_are_on_disk() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("provisional");
        let mut provisional = ProvisionalLabels::new(&path).unwrap();
        let n = 64 * RESIDENT as u64 * 2 + 77;
        for _ in 0..8 {
            provisional.allocate((n / 8) as usize).unwrap();
        }
        let rest = (n % 8) as usize;
        assert_eq!(provisional.allocate(rest).unwrap(), n - rest as u64);
        assert!(provisional.state.filed > 0);
        let saved = dir.path().join("saved");
        let mut out = Encoder::create(&saved).unwrap();
        provisional.resident().save(&mut out).unwrap();
        out.finish().unwrap();
        // what comes after is lost, but for the bits that it cleared in the file
        provisional.allocate(64 * RESIDENT).unwrap();
        provisional.retire(1).unwrap();
        let mut input = Decoder::new(std::fs::read(&saved).unwrap()).unwrap();
        let mut provisional = ProvisionalLabels::load(&path, &mut input).unwrap().unwrap();
        assert!(input.is_empty());
        // every third dies, in no particular order
        for b in (0..n)
            .rev()
            .filter(|b| b % 3 == 1)
            .step_by(2)
            .chain((0..n).filter(|b| b % 3 == 1))
        {
            if b % 5 < 4 || b < 1000 {
                provisional.retire(b).unwrap();
            }
        }
        assert_eq!(provisional.spill().unwrap(), n);
        let dead = |b: u64| b % 3 == 1 && (b % 5 < 4 || b < 1000);
        let mut ranks = provisional.renumber().unwrap();
        let mut expected = 0;
        for b in 0..n {
            if !dead(b) {
                expected += 1;
                if b % 9973 == 0 || b < 5000 || b > n - 100 {
                    assert_eq!(ranks.id(b).unwrap(), expected, "{b}");
                }
            }
        }
        assert_eq!(ranks.alive(), expected);
    }
}
