//! Memory for what goes between us and the disk, in huge pages where the system has them.
//!
//! For each transfer past the page cache the system looks up and holds every page of the buffer,
//! of which huge ones are few. What stays in memory gains nothing by them.

use memmap2::{MmapMut, MmapOptions};
use std::io::Result;
use std::ops::{Deref, DerefMut, Range};

/// Bytes of a huge page of most processors. Where they have others, memory only begins more evenly.
const HUGE: usize = 2 << 20;

/// Zeroed memory that begins at a page.
#[derive(Debug, Default)]
pub struct Pages {
    map: Option<MmapMut>,
    /// What of the map is in use.
    range: Range<usize>,
}

/// Bytes in huge pages, where `used` are sure to be used: a page of which a third is, is taken whole.
const fn huge(used: usize) -> usize {
    match used % HUGE {
        rest if rest < HUGE / 3 => used - rest,
        rest => used.saturating_add(HUGE - rest),
    }
}

/// Bytes of memory that is made for so many bytes, of which `used` are sure to be used.
pub const fn held(bytes: usize, used: usize) -> usize {
    let huge = huge(used);
    if bytes > huge { bytes } else { huge }
}

impl Pages {
    /// So many bytes, of which `used` are sure to be used, and more if that takes no more pages. None of
    /// them is touched yet.
    ///
    /// # Errors
    /// The system's, if it has not as much memory.
    pub fn new(bytes: usize, used: usize) -> Result<Self> {
        let (bytes, huge) = (held(bytes, used), huge(used));
        if bytes == 0 {
            return Ok(Pages::default());
        }
        // what is before the first huge page is never touched
        let before = if huge > 0 { HUGE } else { 0 };
        let map = MmapOptions::new()
            .len(bytes.saturating_add(before))
            .map_anon()?;
        let start = match before {
            0 => 0,
            _ => map.as_ptr().align_offset(HUGE),
        };
        #[cfg(target_os = "linux")]
        if huge > 0 {
            // if it has none of them, small ones do
            let _ = map.advise_range(memmap2::Advice::HugePage, start, huge);
        }
        Ok(Pages {
            map: Some(map),
            range: start..start + bytes,
        })
    }

    /// Makes room for `bytes`, see [`Pages::new`]; the first `kept` of them stay as they are, the others mean
    /// nothing. Without memory, the process ends.
    pub fn grow(&mut self, bytes: usize, used: usize, kept: usize) {
        if self.len() >= bytes {
            return;
        }
        if kept == 0 {
            *self = Pages::default();
        }
        let mut more = Pages::new(bytes, used).unwrap_or_else(|_| {
            let layout = std::alloc::Layout::array::<u8>(bytes);
            std::alloc::handle_alloc_error(layout.expect("a length that some system may have"))
        });
        more[..kept].copy_from_slice(&self[..kept]);
        *self = more;
    }
}

impl Deref for Pages {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.map {
            Some(map) => &map[self.range.clone()],
            None => bytemuck::cast_slice(&[0u64; 0]),
        }
    }
}

impl DerefMut for Pages {
    fn deref_mut(&mut self) -> &mut [u8] {
        match &mut self.map {
            Some(map) => &mut map[self.range.clone()],
            // at a multiple of 8, as all others
            None => bytemuck::cast_slice_mut(&mut [0u64; 0]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_zero_and_huge_pages_begin_where_they_must() {
        const THIRD: usize = HUGE / 3;
        for used in [0, 1, 4096, THIRD - 1, THIRD, HUGE, 3 * HUGE + 1] {
            for bytes in [used, used + 1, 2 * used + THIRD] {
                let mut pages = Pages::new(bytes, used).unwrap();
                assert_eq!(pages.len(), held(bytes, used));
                assert!((bytes..=bytes + 2 * THIRD + 2).contains(&pages.len()));
                assert!(pages.iter().all(|&b| b == 0));
                let address = pages.as_ptr().addr();
                assert!(used < THIRD || address.is_multiple_of(HUGE), "{used}");
                pages.fill(7);
                assert!(pages.iter().all(|&b| b == 7));
            }
        }
    }

    #[test]
    fn bytes_that_are_kept_stay_when_there_are_more() {
        let known: Vec<u8> = (0..1_000_000).map(|i| (i % 251) as u8).collect();
        let mut pages = Pages::default();
        for (bytes, kept) in [(5, 0), (1_000_000, 5), (3, 3), (3_000_000, 1_000_000)] {
            pages.grow(bytes, bytes, kept);
            assert!(pages.len() >= bytes && pages[..kept] == known[..kept]);
            let known = &known[..pages.len().min(known.len())];
            pages[..known.len()].copy_from_slice(known);
        }
    }

    #[test]
    fn what_no_system_has_is_refused() {
        assert!(Pages::new(usize::MAX / 4, 0).is_err());
        assert!(Pages::new(usize::MAX, usize::MAX).is_err());
        assert_eq!(held(usize::MAX, usize::MAX), usize::MAX);
    }
}
