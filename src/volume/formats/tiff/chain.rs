//! The chain of pages of a file: where each is and of which kind.

use crate::error::{Error, Result};
use crate::volume::adapters::values::Values;
use crate::volume::formats::tiff::ifd::{self, Directory};
use crate::volume::formats::tiff::page::Layout;
use crate::volume::formats::tiff::resolution::Resolution;
use crate::volume::formats::tiff::shaped::Shaped;
use crate::volume::formats::tiff::{foreign, imagej, scale};
use crate::volume::io::blob::{Blob, Bytes};
use crate::volume::{Dtype, Endian};
use std::path::Path;

/// More pages in one file are not looked at.
const MAX_PAGES: usize = 1 << 20;
/// Nor are more bytes of their descriptions, which may all be the same ones.
const MAX_TEXTS: u64 = 1 << 29;
/// Kinds beyond this are not told apart.
const MAX_KINDS: usize = 64;

/// Where a page is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PageAt {
    pub(crate) blob: u32,
    /// Index of its kind; [`THUMBNAIL`] or [`UNREADABLE`] if it is no slice.
    pub(crate) kind: u16,
    pub(crate) directory: u64,
    /// Where its samples begin if they are one uncompressed piece.
    pub(crate) piece: Option<u64>,
    /// Bytes by which its samples lie behind those of its directory.
    pub(crate) shift: u64,
}

/// A reduced image or a mask of another page.
pub(crate) const THUMBNAIL: u16 = u16::MAX;
/// A page of colours or of another sort that is not read.
pub(crate) const UNREADABLE: u16 = u16::MAX - 1;

/// What pages that may be slices of one volume have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kind {
    pub(crate) size: [u32; 2],
    pub(crate) dtype: Dtype,
    pub(crate) endian: Endian,
    pub(crate) orientation: u64,
    /// 0 is white.
    pub(crate) white_is_zero: bool,
}

/// Pages of a kind that say the same of their size and values, as the first does.
pub(crate) struct Group {
    pub(crate) kind: Kind,
    pub(crate) resolution: Resolution,
    /// What the description says of sizes.
    pub(crate) sizes: String,
    pub(crate) values: Option<Values>,
    /// The number of its first page.
    pub(crate) first: usize,
    /// The number of a page that says something else.
    pub(crate) other_resolution: Option<usize>,
    pub(crate) other_values: Option<usize>,
}

/// What the first page of a file says for those that follow.
#[derive(Default)]
struct OfFile {
    /// The number of the file; `None` before the first.
    blob: Option<u32>,
    sizes: String,
    values: Option<Values>,
}

/// What is known of the pages of one or more files.
#[derive(Default)]
pub(crate) struct Chain {
    pub(crate) pages: Vec<PageAt>,
    pub(crate) groups: Vec<Group>,
    /// Why the first page that is not read is not.
    pub(crate) unreadable: Option<Error>,
    /// Descriptions by tifffile, with the pages that they begin at.
    pub(crate) shaped: Vec<(usize, Shaped)>,
    /// Voxels of the largest chunk that must be decoded, and the most rows of one.
    pub(crate) largest: (u64, u32),
    /// What ImageJ or tifffile say of sizes and values on the first page of a file, for all that follow there.
    of_file: OfFile,
    /// Bytes of descriptions.
    texts: u64,
}

impl Chain {
    /// The directories of these files, one after the other.
    ///
    /// # Errors
    /// As of [`Chain::walk`].
    pub(crate) fn of(blobs: &[Blob]) -> Result<Chain> {
        let mut chain = Chain::default();
        for (i, blob) in (0..).zip(blobs) {
            chain.walk(&blob.open()?, i)?;
        }
        Ok(chain)
    }

    /// The pages that are no thumbnails.
    pub(crate) fn slices(&self) -> Vec<usize> {
        let all = 0..self.pages.len();
        all.filter(|&i| self.pages[i].kind != THUMBNAIL).collect()
    }

    /// Goes through the directories of a file.
    ///
    /// # Errors
    /// [`Error::Format`] for a damaged chain, [`Error::Unsupported`] for formats that are TIFF by their first bytes alone.
    pub(crate) fn walk(&mut self, bytes: &Bytes, blob: u32) -> Result<()> {
        let (file, mut next) = ifd::File::open(bytes)?;
        // a position is compared with one before it, further and further apart: a chain that goes round meets it
        let (mut mark, mut steps, mut until) = (0, 0u64, 1u64);
        while next != 0 {
            if next == mark {
                let what = format!("a directory that comes twice, at position {next}");
                return Err(Error::format(bytes.path(), what, "a chain that ends"));
            }
            if steps == until {
                (mark, steps, until) = (next, 0, until * 2);
            }
            steps += 1;
            let dir = file.directory(next)?;
            next = dir.next;
            self.page(bytes, blob, file.endian, &dir)?;
            if self.pages.len() > MAX_PAGES {
                let what = format!("more than {MAX_PAGES} pages");
                return Err(Error::format(bytes.path(), what, "fewer"));
            }
        }
        Ok(())
    }

    fn page(&mut self, bytes: &Bytes, blob: u32, endian: Endian, dir: &Directory) -> Result<()> {
        let mut at = PageAt {
            blob,
            kind: THUMBNAIL,
            directory: dir.position,
            piece: None,
            shift: 0,
        };
        // NewSubfileType, and SubfileType of older files
        if dir.number(254, 0)? & 5 == 0 && dir.number(255, 1)? != 2 {
            foreign::refuse(bytes.path(), dir)?;
            match Layout::parse(bytes, dir, endian) {
                Ok(layout) => {
                    at.piece = layout.in_one_piece();
                    at.kind = self.slice(bytes, blob, dir, &layout)?;
                }
                Err(error @ Error::Unsupported { .. }) => {
                    self.describe(bytes, dir, &dir.text_begin(270)?)?;
                    at.kind = UNREADABLE;
                    self.unreadable.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        self.pages.push(at);
        Ok(())
    }

    /// Looks at the description of a page, which begins like that; returns all that it says of sizes, and the series
    /// that tifffile describes.
    fn describe(
        &mut self,
        bytes: &Bytes,
        dir: &Directory,
        begin: &str,
    ) -> Result<(String, Option<Shaped>)> {
        self.texts += dir.count(270).min(bytes.len());
        if self.texts > MAX_TEXTS {
            let found = format!("more than {MAX_TEXTS} bytes of descriptions of pages");
            return Err(Error::format(bytes.path(), found, "fewer"));
        }
        if imagej::Text::is(begin) {
            return Ok((imagej::Text::new(&dir.text(270)?).all_of_sizes(), None));
        }
        if !Shaped::is_shaped(begin) {
            return Ok((String::new(), None));
        }
        let Some(shaped) = shaped(bytes.path(), dir, begin)? else {
            return Ok((String::new(), None));
        };
        let sizes = shaped.all_of_sizes();
        // slices that were written one by one are a stack
        let last = self.shaped.last();
        if !last.is_some_and(|(_, last)| last.planes() == 1 && last.shape == shaped.shape) {
            self.shaped.push((self.pages.len(), shaped.clone()));
        }
        Ok((sizes, Some(shaped)))
    }

    /// What a slice says of its sizes and values: by itself, or by the first page of its file.
    fn stated(
        &mut self,
        bytes: &Bytes,
        blob: u32,
        dir: &Directory,
        dtype: Dtype,
    ) -> Result<(String, Option<Values>)> {
        let begin = dir.text_begin(270)?;
        let imagej = imagej::Text::is(&begin);
        let (mut sizes, shaped) = self.describe(bytes, dir, &begin)?;
        let mut values = scale::values(bytes.path(), dir, dtype, imagej)?;
        let mut described = values.clone().filter(|_| imagej);
        if let Some(shaped) = &shaped {
            described = shaped.values(bytes.path(), dtype)?;
            values = scale::both(bytes.path(), values, described.clone())?;
        }
        if self.of_file.blob != Some(blob) || shaped.is_some() {
            self.of_file = OfFile {
                blob: Some(blob),
                sizes: sizes.clone(),
                values: described,
            };
        } else if sizes.is_empty() {
            sizes.clone_from(&self.of_file.sizes);
            values = values.or_else(|| self.of_file.values.clone());
        }
        Ok((sizes, values))
    }

    /// Takes a slice into account, and returns the index of its kind.
    fn slice(&mut self, bytes: &Bytes, blob: u32, dir: &Directory, layout: &Layout) -> Result<u16> {
        if !layout.is_direct() {
            let voxels = u64::from(layout.cut.width) * u64::from(layout.cut.rows);
            let (most, rows) = self.largest;
            self.largest = (most.max(voxels), rows.max(layout.cut.rows));
        }
        let number = self.pages.len();
        let (sizes, values) = self.stated(bytes, blob, dir, layout.dtype)?;
        let kind = Kind {
            size: layout.size,
            dtype: layout.dtype,
            endian: layout.endian,
            orientation: dir.number(274, 1)?,
            white_is_zero: dir.number(262, 1)? == 0,
        };
        let resolution = Resolution::read(dir)?;
        // pages are most often like the one before
        let like = |group: &Group| {
            (group.resolution, &group.sizes) == (resolution, &sizes) && group.values == values
        };
        let groups = self.groups.iter();
        if let Some(index) = groups.clone().rposition(|g| g.kind == kind && like(g)) {
            return Ok(index as u16);
        }
        let known = groups.clone().rposition(|group| group.kind == kind);
        let most = if known.is_some() { 1 } else { 2 } * MAX_KINDS;
        if self.groups.len() < most {
            self.groups.push(Group {
                kind,
                resolution,
                sizes,
                values,
                first: number,
                other_resolution: None,
                other_values: None,
            });
            return Ok(self.groups.len() as u16 - 1);
        }
        let Some(index) = known else {
            return Ok(UNREADABLE);
        };
        let group = &mut self.groups[index];
        if group.resolution != resolution || group.sizes != sizes {
            group.other_resolution.get_or_insert(number);
        }
        if group.values != values {
            group.other_values.get_or_insert(number);
        }
        Ok(index as u16)
    }
}

/// Descriptions by tifffile beyond this are refused.
const MAX_JSON: u64 = 16 << 20;

/// A description by tifffile; `None` if it is one by something else.
fn shaped(path: &Path, dir: &Directory, begin: &str) -> Result<Option<Shaped>> {
    let text = dir.bytes(270, MAX_JSON)?;
    let text = String::from_utf8_lossy(&text);
    let shaped = Shaped::parse(text.trim_end_matches('\0'));
    if shaped.is_none() && begin.starts_with("{\"shape\"") {
        let found = "a description that begins as tifffile's does, and is damaged";
        return Err(Error::format(
            path,
            found,
            "sound JSON with the shape of the series",
        ));
    }
    Ok(shaped)
}
