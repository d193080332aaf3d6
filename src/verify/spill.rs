//! Sorting more records than should stay in memory: sorted runs in unnamed temporary files, merged.

use crate::error::{Error, Result};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};

/// Runs of about the same length that are merged to one. A record is written once for each power of
/// this, and as many files are open for each: far fewer than a process may open.
const FAN_IN: usize = 32;

/// Collects records of N words, compared word by word from the left, and hands them out sorted; keeps at most
/// `limit` of them in memory.
pub(super) struct Spill<const N: usize> {
    buffer: Vec<[u64; N]>,
    limit: usize,
    /// Runs of `limit` records, of [`FAN_IN`] times as many, and so on.
    runs: Vec<Vec<File>>,
}

impl<const N: usize> Spill<N> {
    pub fn new(limit: usize) -> Self {
        Spill {
            buffer: Vec::new(),
            limit: limit.max(1),
            runs: Vec::new(),
        }
    }

    pub fn push(&mut self, record: [u64; N]) -> Result<()> {
        self.buffer.push(record);
        if self.buffer.len() >= self.limit {
            self.write_run()?;
        }
        Ok(())
    }

    fn write_run(&mut self) -> Result<()> {
        self.buffer.sort_unstable();
        let mut records = self.buffer.iter().copied();
        let mut run = write(|| Ok(records.next()))?;
        self.buffer.clear();
        for level in 0.. {
            if level == self.runs.len() {
                self.runs.push(Vec::new());
            }
            self.runs[level].push(run);
            if self.runs[level].len() < FAN_IN {
                break;
            }
            let mut all = Merge::<N>::new(Vec::new(), self.runs[level].drain(..))?;
            run = write(|| all.next())?;
        }
        Ok(())
    }

    /// The records in order.
    pub fn into_sorted(mut self) -> Result<Merge<N>> {
        self.buffer.sort_unstable();
        Merge::new(
            std::mem::take(&mut self.buffer),
            self.runs.drain(..).flatten(),
        )
    }
}

/// Writes records to an unnamed temporary file, to be read from its start.
fn write<const N: usize>(mut next: impl FnMut() -> Result<Option<[u64; N]>>) -> Result<File> {
    const ACTION: &str = "write a temporary file in";
    let file = tempfile::tempfile().map_err(|e| io(e, ACTION))?;
    let mut out = BufWriter::new(file);
    while let Some(record) = next()? {
        out.write_all(bytemuck::cast_slice(&record))
            .map_err(|e| io(e, ACTION))?;
    }
    let mut file = out.into_inner().map_err(|e| io(e.into_error(), ACTION))?;
    file.rewind().map_err(|e| io(e, ACTION))?;
    Ok(file)
}

/// Merges sorted runs.
pub(super) struct Merge<const N: usize> {
    /// The next record of each source; the source's number decides between equal ones.
    heap: BinaryHeap<Reverse<([u64; N], usize)>>,
    memory: std::vec::IntoIter<[u64; N]>,
    files: Vec<BufReader<File>>,
}

impl<const N: usize> Merge<N> {
    /// `memory` and each file are sorted.
    fn new(memory: Vec<[u64; N]>, files: impl Iterator<Item = File>) -> Result<Self> {
        let mut merge = Merge {
            heap: BinaryHeap::new(),
            memory: memory.into_iter(),
            files: files.map(BufReader::new).collect(),
        };
        for source in 0..=merge.files.len() {
            merge.refill(source)?;
        }
        Ok(merge)
    }

    /// The next record.
    pub fn next(&mut self) -> Result<Option<[u64; N]>> {
        let Some(Reverse((record, source))) = self.heap.pop() else {
            return Ok(None);
        };
        self.refill(source)?;
        Ok(Some(record))
    }

    fn refill(&mut self, source: usize) -> Result<()> {
        let next = match self.files.get_mut(source) {
            None => self.memory.next(),
            Some(file) => {
                let mut record = [0; N];
                match file.read_exact(bytemuck::cast_slice_mut(&mut record)) {
                    Ok(()) => Some(record),
                    Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => None,
                    Err(e) => return Err(io(e, "read back a temporary file in")),
                }
            }
        };
        if let Some(record) = next {
            self.heap.push(Reverse((record, source)));
        }
        Ok(())
    }
}

fn io(source: std::io::Error, action: &'static str) -> Error {
    Error::io(std::env::temp_dir(), action, source)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_merge_to_what_a_sort_gives() {
        let record = |i: u64| {
            let mut r = [0; 3];
            r[0] = i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56;
            r[1] = i;
            r
        };
        for limit in [1, 7, 64, 1000] {
            let mut spill = Spill::new(limit);
            let mut expected: Vec<[u64; 3]> = (0..1200).map(record).collect();
            for r in &expected {
                spill.push(*r).unwrap();
            }
            expected.sort_unstable();
            let mut merge = spill.into_sorted().unwrap();
            let mut found = Vec::new();
            while let Some(r) = merge.next().unwrap() {
                found.push(r);
            }
            assert_eq!(found, expected);
        }
    }
}
