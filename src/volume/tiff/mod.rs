//! TIFF and BigTIFF stacks: one file of many pages, or many files in the order of their names.
//!
//! Grey values are handed out as they are stored: where 0 is white (WhiteIsZero) they are not
//! inverted, since a scan's numbers mean more than their display, which a note says; colour maps are
//! not applied. f16 is handed out as f32.
//! Thumbnails and masks (NewSubfileType 1 and 4) are no slices.

mod codec;
mod ifd;
mod page;
mod text;

use super::blob::{Blob, Bytes};
use super::layout::{Data, Encoding, Recipe, Samples, Start};
use super::paged::{Page, Pages};
use super::{Dtype, Endian};
use crate::error::{Error, Result};
use crate::grid::{Dims, MAX_DIM};
use page::{Layout, TiffPage};
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use text::Stack;

/// True if a file begins as TIFF or BigTIFF does.
pub(super) fn is_tiff(head: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| head.starts_with(*magic))
}

/// Where a page is.
#[derive(Debug, Clone, Copy)]
struct PageAt {
    blob: u32,
    directory: u64,
    /// Where its samples begin if they are one uncompressed piece.
    piece: Option<u64>,
}

/// What all pages have in common.
struct Found {
    pages: Vec<PageAt>,
    /// Size and type of the first page; its byte order too.
    first: Option<([u32; 2], Dtype, Endian)>,
    /// All pages have the byte order of the first.
    one_order: bool,
    stack: Stack,
    /// Voxels of the largest chunk that must be decoded, and the most rows of one.
    largest: (u64, u32),
}

/// Reads the tags of every page of these files, in their order.
///
/// # Errors
/// [`Error::Unsupported`] by name for what this reader does not decode, [`Error::Format`] for pages
/// that differ in size or type, or that the files cannot hold.
pub(super) fn parse(path: &Path, mut blobs: Vec<Blob>) -> Result<Recipe> {
    if let [blob] = &mut blobs[..] {
        *blob = blob.held()?;
    }
    let mut found = Found {
        pages: Vec::new(),
        first: None,
        one_order: true,
        stack: Stack::default(),
        largest: (0, 0),
    };
    for (i, blob) in blobs.iter().enumerate() {
        walk(&blob.open()?, i as u32, &mut found)?;
    }
    let Some((size, dtype, endian)) = found.first else {
        return Err(Error::format(
            path,
            "a TIFF without an image",
            "a stack of slices",
        ));
    };
    let page_bytes = u64::from(size[0]) * u64::from(size[1]) * dtype.bytes() as u64;
    let mut slices = found.pages.len() as u64;
    let images = found.stack.images.filter(|_| blobs.len() == 1);
    if let (Some(images), 1) = (images, slices)
        && images > 1
    {
        let bytes = blobs[0].open()?;
        one_directory(&bytes, images, page_bytes, found.pages[0].piece)?;
        slices = images;
    } else if let Some(images) = images.filter(|&n| n != slices) {
        let told = format!("{images} images, as ImageJ's description says");
        return Err(
            Error::format(path, format!("a TIFF of {slices} pages"), told)
                .with_hint("the file is cut short or was changed"),
        );
    }
    if slices < 2 {
        return Err(
            Error::format(path, "a TIFF of one page", "a stack of at least 2 slices")
                .with_hint("give the folder that holds the slices"),
        );
    }
    let dims = Dims::new([size[0].into(), size[1].into(), slices])
        .map_err(|e| Error::format(path, format!("pages with {e}"), "a volume of that size"))?;
    let stack = std::mem::take(&mut found.stack);
    Ok(Recipe {
        endian: Some(endian),
        placement: stack.placement,
        provenance: stack.provenance,
        notes: stack.notes,
        ..Recipe::new("tiff", dims, dtype, samples(blobs, found, page_bytes)?)
    })
}

/// ImageJ writes stacks beyond 4 GiB with the directory of the first page alone; the others follow
/// it without a gap.
fn one_directory(bytes: &Bytes, images: u64, page_bytes: u64, piece: Option<u64>) -> Result<()> {
    let Some(first) = piece else {
        let found = format!("one page, in compressed or separate parts, for {images} images");
        return Err(Error::format(bytes.path(), found, "a page for every image"));
    };
    let end = images
        .checked_mul(page_bytes)
        .and_then(|n| n.checked_add(first));
    if images > u64::from(MAX_DIM) || end.is_none_or(|end| end > bytes.len()) {
        let found = format!("{} bytes", bytes.len());
        let need = format!("{images} images of {page_bytes} bytes from position {first} on");
        return Err(Error::format(bytes.path(), found, need)
            .with_hint("the file is cut short, or lost its pages when it was saved"));
    }
    Ok(())
}

/// Goes through the directories of a file.
fn walk(bytes: &Bytes, blob: u32, found: &mut Found) -> Result<()> {
    let (file, mut next) = ifd::File::open(bytes)?;
    let mut seen = HashSet::new();
    while next != 0 {
        if !seen.insert(next) {
            let what = format!("a directory that comes twice, at position {next}");
            return Err(Error::format(bytes.path(), what, "a chain that ends"));
        }
        let dir = file.directory(next)?;
        next = dir.next;
        if dir.number(254, 0)? & 5 != 0 {
            continue;
        }
        let layout = Layout::parse(bytes, &dir, file.endian)?;
        let like = (layout.size, layout.dtype);
        match found.first {
            None => {
                found.stack = text::stack(bytes.path(), &dir)?;
                found.first = Some((layout.size, layout.dtype, layout.endian));
            }
            Some((size, dtype, _)) if (size, dtype) != like => {
                let page = found.pages.len() + 1;
                let ([x, y], [nx, ny]) = (layout.size, size);
                return Err(Error::format(
                    bytes.path(),
                    format!("{x} x {y} of {} as slice {page}", layout.dtype),
                    format!("{nx} x {ny} of {dtype}, as the first slice is"),
                ));
            }
            Some((_, _, endian)) => found.one_order &= endian == layout.endian,
        }
        if !layout.is_direct() {
            let voxels = u64::from(layout.cut.width) * u64::from(layout.cut.rows);
            let (most, rows) = found.largest;
            found.largest = (most.max(voxels), rows.max(layout.cut.rows));
        }
        found.pages.push(PageAt {
            blob,
            directory: dir.position,
            piece: layout.in_one_piece(),
        });
        if found.pages.len() > MAX_DIM as usize || seen.len() > 2 * MAX_DIM as usize {
            let what = format!("more than {MAX_DIM} pages");
            return Err(Error::format(
                bytes.path(),
                what,
                format!("at most {MAX_DIM}"),
            ));
        }
    }
    Ok(())
}

/// Samples in one piece are read as those of a raw file, others page by page.
fn samples(blobs: Vec<Blob>, found: Found, page_bytes: u64) -> Result<Samples> {
    let joined = found
        .pages
        .windows(2)
        .all(|pair| pair[0].piece.and_then(|p| p.checked_add(page_bytes)) == pair[1].piece);
    if let ([blob], Some(first), true, true) =
        (&blobs[..], found.pages[0].piece, joined, found.one_order)
    {
        return Ok(if blob.is_whole() {
            Samples::Files(Data {
                files: vec![blob.path().to_path_buf()],
                start: Start::At {
                    base: 0,
                    lines: 0,
                    bytes: first,
                    stated: true,
                },
                encoding: Encoding::Raw,
            })
        } else {
            Samples::Bytes(Box::new(blob.samples(first)?))
        });
    }
    Ok(Samples::Pages(Box::new(TiffPages {
        blobs,
        pages: found.pages,
        largest: found.largest,
        recent: Mutex::default(),
    })))
}

/// The pages of a stack.
struct TiffPages {
    blobs: Vec<Blob>,
    pages: Vec<PageAt>,
    largest: (u64, u32),
    /// Tags that were read last, so that bands do not read them anew.
    recent: Mutex<HashMap<u32, Arc<Layout>>>,
}

/// Chunks whose positions are kept, at 16 bytes each.
const RECENT: usize = 128 << 10;

impl Pages for TiffPages {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        let recent = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let at = self.pages[k as usize];
        let bytes = self.blobs[at.blob as usize].open()?;
        let known = recent().get(&k).cloned();
        let layout = match known {
            Some(layout) => layout,
            None => {
                let (file, _) = ifd::File::open(&bytes)?;
                let dir = file.directory(at.directory)?;
                let layout = Arc::new(Layout::parse(&bytes, &dir, file.endian)?);
                let mut recent = recent();
                let kept: usize = recent.values().map(|l| l.chunks()).sum();
                if kept + layout.chunks() > RECENT {
                    recent.clear();
                }
                recent.insert(k, layout.clone());
                layout
            }
        };
        Ok(Box::new(TiffPage { bytes, layout }))
    }

    fn largest(&self) -> (u64, u32) {
        self.largest
    }
}
