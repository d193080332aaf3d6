//! Long files that go to the disk while they are written.
//!
//! What is written lies in the page cache until the system comes to it, and a cgroup's limit counts it. Where a disk is
//! busy that limit may be full of pages that nobody has begun to write: the system finds none to give back, and kills the
//! process. Pages on their way to the disk it waits for.

use std::borrow::BorrowMut;
use std::fs::File;
use std::io::{Read, Result, Write};

/// Bytes that are sent to the disk together.
const PIECE: u64 = 1 << 20;

/// A file that is written from its start on.
#[derive(Debug)]
pub struct WriteOut<F> {
    file: F,
    /// Bytes that are written.
    written: u64,
    /// Bytes that are on their way to the disk.
    sent: u64,
}

impl<F: BorrowMut<File>> WriteOut<F> {
    /// A file in which nothing is written yet.
    pub fn new(file: F) -> Self {
        WriteOut {
            file,
            written: 0,
            sent: 0,
        }
    }

    /// The file itself, at its end.
    pub fn into_inner(self) -> F {
        self.file
    }

    /// Adds what another file holds from its place on.
    ///
    /// # Errors
    /// The system's.
    pub fn append(&mut self, from: &mut File) -> Result<()> {
        loop {
            // between two files the system copies by itself
            match std::io::copy(&mut from.take(PIECE), self.file.borrow_mut())? {
                0 => return Ok(()),
                bytes => self.wrote(bytes),
            }
        }
    }

    fn wrote(&mut self, bytes: u64) {
        self.written += bytes;
        if self.written - self.sent >= PIECE {
            send(self.file.borrow(), self.sent, self.written - self.sent);
            self.sent = self.written;
        }
    }
}

impl<F: BorrowMut<File>> Write for WriteOut<F> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let done = self.file.borrow_mut().write(bytes)?;
        self.wrote(done as u64);
        Ok(done)
    }

    fn flush(&mut self) -> Result<()> {
        self.file.borrow_mut().flush()
    }
}

/// Begins to write pages of a file to the disk. A refusal changes nothing but when that happens.
#[cfg(target_os = "linux")]
fn send(file: &File, at: u64, bytes: u64) {
    let bytes = std::num::NonZeroU64::new(bytes);
    let _ = rustix::fs::fadvise(file, at, bytes, rustix::fs::Advice::DontNeed);
}

#[cfg(not(target_os = "linux"))]
fn send(_: &File, _: u64, _: u64) {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Seek;

    #[test]
    fn bytes_come_in_order_whatever_the_pieces() {
        let all: Vec<u8> = (0..5 * PIECE + 77).map(|i| (i % 251) as u8).collect();
        let (first, second) = all.split_at(2 * PIECE as usize + 5);
        let mut rest = tempfile::tempfile().unwrap();
        rest.write_all(second).unwrap();
        rest.rewind().unwrap();
        let mut out = WriteOut::new(tempfile::tempfile().unwrap());
        for part in first.chunks(300_001) {
            out.write_all(part).unwrap();
        }
        out.append(&mut rest).unwrap();
        assert_eq!(out.written, all.len() as u64);
        let mut file = out.into_inner();
        file.rewind().unwrap();
        let mut read = Vec::new();
        file.read_to_end(&mut read).unwrap();
        assert!(read == all);
    }
}
