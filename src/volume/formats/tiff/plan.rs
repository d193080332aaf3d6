//! From what a file says of itself to the pages that are the slices.

use crate::error::{Error, Result};
use crate::grid::MAX_DIM;
use crate::volume::adapters::values::{Linear, Scale};
use crate::volume::formats::tiff::chain::{Chain, Group, Kind, PageAt, UNREADABLE};
use crate::volume::formats::tiff::ifd::File;
use crate::volume::formats::tiff::imagej::Text;
use crate::volume::formats::tiff::shaped::Shaped;
use crate::volume::formats::tiff::stack::{About, Chosen, Stack, choose, other_count};
use crate::volume::formats::tiff::{foreign, ome, ome_pages};
use crate::volume::io::blob::{Blob, Bytes};
use crate::volume::options::OpenOptions;
use std::collections::HashMap;
use std::path::Path;

/// The slices that are asked for.
pub(crate) struct Plan {
    pub(crate) blobs: Vec<Blob>,
    pub(crate) pages: Vec<PageAt>,
    pub(crate) chain: Chain,
    pub(crate) about: About,
    /// All slices have the byte order of the first.
    pub(crate) one_order: bool,
    /// Files were found by what the one that was opened says.
    pub(crate) named: bool,
}

impl Plan {
    /// Reads what the files say and chooses among it.
    pub(crate) fn make(path: &Path, mut blobs: Vec<Blob>, options: &OpenOptions) -> Result<Plan> {
        if let [blob] = &mut blobs[..] {
            *blob = blob.held()?;
        }
        let none = || Error::format(path, "a TIFF without an image", "a stack of slices");
        let bytes = blobs.first().ok_or_else(none)?.open()?;
        let (file, first) = File::open(&bytes)?;
        if first == 0 {
            return Err(none());
        }
        let dir = file.directory(first)?;
        let text = dir.text(270)?;
        if ome::is_ome(&text)
            && let Some(document) = ome::read(path, &dir)?
        {
            return ome_pages::plan(path, blobs, &dir, &document, options);
        }
        let chain = Chain::of(&blobs)?;
        let slices = chain.slices();
        if slices.is_empty() {
            return Err(none());
        }
        if blobs.len() > 1 {
            return of_files(path, blobs, chain, &slices, &text, options);
        }
        of_pages(path, blobs, chain, &slices, &text, options)
    }

    pub(crate) fn new(blobs: Vec<Blob>, pages: Vec<PageAt>, chain: Chain) -> Plan {
        Plan {
            blobs,
            pages,
            chain,
            about: About::default(),
            one_order: true,
            named: false,
        }
    }

    /// The group of the first slice.
    pub(crate) fn group(&self) -> Option<&Group> {
        self.chain.groups.get(self.pages.first()?.kind as usize)
    }

    /// What all slices have in common.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Unsupported`] if they have not.
    pub(crate) fn kind(&mut self, path: &Path) -> Result<Kind> {
        let mut first = None::<Kind>;
        for (i, page) in self.pages.iter().enumerate() {
            let Some(group) = self.chain.groups.get(page.kind as usize) else {
                return Err(self.chain.unreadable.take().unwrap_or_else(|| {
                    let found = format!("a page of another sort as slice {}", i + 1);
                    Error::format(path, found, "a slice like the others")
                }));
            };
            let kind = group.kind;
            let of = *first.get_or_insert(kind);
            if (kind.size, kind.dtype) != (of.size, of.dtype) {
                let ([x, y], [nx, ny]) = (kind.size, of.size);
                return Err(Error::format(
                    self.blobs[page.blob as usize].path(),
                    format!("{x} x {y} of {} as slice {}", kind.dtype, i + 1),
                    format!("{nx} x {ny} of {}, as the first slice is", of.dtype),
                ));
            }
            let says = [
                (kind.orientation, of.orientation),
                (kind.white_is_zero.into(), of.white_is_zero.into()),
            ];
            for ((own, first), tag) in says.into_iter().zip(["Orientation", "WhiteIsZero"]) {
                if own != first {
                    return Err(Error::format(
                        self.blobs[page.blob as usize].path(),
                        format!("slice {} with {tag} {own}", i + 1),
                        format!("{first}, as the first slice has"),
                    )
                    .with_hint("save the slices anew, all in the same way"));
                }
            }
            self.one_order &= kind.endian == of.endian;
        }
        let none = || Error::format(path, "a TIFF without an image", "a stack of slices");
        let kind = first.ok_or_else(none)?;
        self.agree(path)?;
        Ok(kind)
    }

    /// Slices that state sizes or values must state the same.
    fn agree(&mut self, path: &Path) -> Result<()> {
        let used: Vec<_> = self
            .chain
            .groups
            .iter()
            .enumerate()
            .filter(|(i, _)| self.pages.iter().any(|page| page.kind as usize == *i))
            .map(|(_, group)| group)
            .collect();
        let Some(first) = self.group() else {
            return Ok(());
        };
        let other = |differs: &dyn Fn(&Group) -> Option<usize>, same: &dyn Fn(&Group) -> bool| {
            let found = used.iter().find_map(|g| differs(g));
            found.or(used.iter().find(|g| !same(g)).map(|g| g.first))
        };
        let values = other(&|g| g.other_values, &|g| g.values == first.values);
        let resolution = other(&|g| g.other_resolution, &|g| {
            (g.resolution, &g.sizes) == (first.resolution, &first.sizes)
        });
        if let Some(page) = values {
            let scale = |g: &Group| {
                g.values
                    .as_ref()
                    .map_or(Scale::All(Linear::SAME), |v| v.scale.clone())
            };
            let scales = used
                .iter()
                .any(|g| scale(g) != scale(first) || g.other_values.is_some());
            let (what, hint) = match scales {
                true => (
                    "a scale of grey values",
                    "save the slices as 32-bit numbers, with their scales applied",
                ),
                false => (
                    "a number for no data (GDAL_NODATA or the like)",
                    "state it for all pages, or for none",
                ),
            };
            let what = format!("{what} that is another for some slices (as page {page})");
            return Err(Error::unsupported(path, what, hint));
        }
        self.about.values = first.values.clone();
        if let Some(page) = resolution
            && self.about.steps[0].is_some()
            && self.about.of_tags
        {
            self.about.steps = [const { None }; 3];
            self.about.z_if_none = None;
            self.about.of_size(format!(
                "the slices state sizes of pixels that differ (as page {page} does from the first), which are not \
                 taken: give --spacing and --unit"
            ));
        }
        Ok(())
    }

    /// Which way the samples are turned round along x and y.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for pages of which the rows are columns.
    pub(crate) fn orientation(&mut self, path: &Path, orientation: u64) -> Result<[bool; 2]> {
        let (mirrored, how) = match orientation {
            2 => ([true, false], "the first column is on the right"),
            3 => (
                [true, true],
                "the first row is at the bottom, its first pixel on the right",
            ),
            4 => ([false, true], "the first row is at the bottom"),
            5..=8 => {
                let what =
                    format!("TIFF with Orientation {orientation}, of which the rows are columns,");
                let hint = "save it anew with Orientation 1 (top left)";
                return Err(Error::unsupported(path, what, hint));
            }
            _ => return Ok([false; 2]),
        };
        let note = format!("Orientation {orientation} of this TIFF is heeded: {how}");
        self.about.notes.push(note);
        Ok(mirrored)
    }
}

/// Files of a folder, one slice each.
pub(crate) fn of_files(
    path: &Path,
    blobs: Vec<Blob>,
    chain: Chain,
    slices: &[usize],
    text: &str,
    options: &OpenOptions,
) -> Result<Plan> {
    let pages: Vec<PageAt> = slices.iter().map(|&i| chain.pages[i]).collect();
    if let Some(pair) = pages.windows(2).find(|pair| pair[0].blob == pair[1].blob) {
        // a pattern, which is no file by itself, names the parts of one volume
        if path.file_name().is_some() && !path.exists() {
            return of_parts(path, blobs, chain, text, options);
        }
        let blob = pair[0].blob;
        let count = pages.iter().filter(|page| page.blob == blob).count();
        let found = format!("{} files, of which one holds {count} pages", blobs.len());
        return Err(Error::format(blobs[blob as usize].path(), found, "one slice in each file").with_hint(
            "give the one file to read; if the files are parts of one volume, name them by a pattern, as in \
             FOLDER/part_%d.tif",
        ));
    }
    choose(path, &[Stack::slices(pages.len() as u64, [0; 2])], options)?;
    let series = chain.shaped.first().map(|(_, shaped)| shaped.clone());
    let mut plan = Plan::new(blobs, pages, chain);
    plan.sizes(text, series.as_ref(), true);
    Ok(plan)
}

/// Files of several slices, one after the other.
fn of_parts(
    path: &Path,
    blobs: Vec<Blob>,
    chain: Chain,
    text: &str,
    options: &OpenOptions,
) -> Result<Plan> {
    let mut pages = Vec::new();
    for (i, blob) in (0..).zip(&blobs) {
        // each by what it says of itself
        let part = Plan::make(blob.path(), vec![blob.clone()], options)?;
        let own = chain.pages.iter().filter(|page| page.blob == i);
        let kinds: HashMap<u64, u16> = own.map(|page| (page.directory, page.kind)).collect();
        pages.extend(part.pages.iter().map(|page| PageAt {
            blob: i,
            kind: kinds.get(&page.directory).copied().unwrap_or(UNREADABLE),
            ..*page
        }));
    }
    let slices = pages.len();
    if slices > MAX_DIM as usize {
        return Err(Error::format(
            path,
            format!("{slices} pages"),
            format!("at most {MAX_DIM}"),
        ));
    }
    let series = chain.shaped.first().map(|(_, shaped)| shaped.clone());
    let mut plan = Plan::new(blobs, pages, chain);
    plan.sizes(text, series.as_ref(), false);
    plan.about.notes.push(format!(
        "the pages of {} files, {slices} together, are taken as slices of one volume",
        plan.blobs.len()
    ));
    Ok(plan)
}

/// The pages of one file.
fn of_pages(
    path: &Path,
    blobs: Vec<Blob>,
    chain: Chain,
    slices: &[usize],
    text: &str,
    options: &OpenOptions,
) -> Result<Plan> {
    let bytes = blobs[0].open()?;
    let count = slices.len() as u64;
    let first = chain.groups.first().map(|group| group.kind);
    let (mut stacks, mut starts) = (Vec::new(), vec![0]);
    let truncated;
    if let (Some(kind), true) = (first, Text::is(text)) {
        let mut stack = Text::new(text).stack(path, count)?;
        stack.size = Some(kind.size);
        truncated = count == 1;
        stacks.push(stack);
    } else if let (Some(kind), Some((0, _))) = (first, chain.shaped.first()) {
        (stacks, starts) = of_shapes(path, &chain, slices, kind)?;
        truncated = count == 1 && chain.shaped[0].1.truncated;
    } else {
        return of_kinds(path, blobs, chain, slices, text, options);
    }
    let chosen = choose(path, &stacks, options)?;
    let stack = &stacks[chosen.stack];
    let total = stack.pages();
    let wrong_count = (stacks.len() == 1 && total != count) || starts[chosen.stack] + total > count;
    let pages = if truncated && total > 1 {
        one_directory(&bytes, &chain, slices[0], total, &chosen)?
    } else if wrong_count {
        let told = format!("{total}, as its description says");
        return Err(
            Error::format(path, format!("a TIFF of {count} pages"), told)
                .with_hint(other_count(count, starts[chosen.stack] + total)),
        );
    } else {
        let page = |z| slices[(starts[chosen.stack] + chosen.page(z)) as usize];
        (0..chosen.slices).map(|z| chain.pages[page(z)]).collect()
    };
    let start = slices[starts[chosen.stack] as usize];
    let series = chain.shaped.iter().rfind(|(page, _)| *page <= start);
    let series = series.map(|(_, shaped)| shaped.clone());
    let mut plan = Plan::new(blobs, pages, chain);
    plan.movie(&chosen);
    plan.sizes(text, series.as_ref(), false);
    Ok(plan)
}

/// The series that tifffile describes, and the page that each begins at, counted without thumbnails.
fn of_shapes(
    path: &Path,
    chain: &Chain,
    slices: &[usize],
    first: Kind,
) -> Result<(Vec<Stack>, Vec<u64>)> {
    let (mut stacks, mut starts) = (Vec::new(), Vec::new());
    let at = |page: usize| slices.partition_point(|&i| i < page) as u64;
    let ends = chain.shaped.iter().skip(1).map(|(page, _)| at(*page));
    for ((page, shaped), end) in chain.shaped.iter().zip(ends.chain([slices.len() as u64])) {
        let start = at(*page);
        let kind = chain.pages[*page].kind;
        if kind == UNREADABLE {
            let mut stack = Stack::slices(end - start, [0; 2]);
            (stack.size, stack.names) = (None, vec!["not of grey values".into()]);
            stacks.push(stack);
            starts.push(start);
            continue;
        }
        let kind = chain.groups.get(kind as usize).map_or(first, |g| g.kind);
        let mut stack = shaped.stack(path, kind.size)?;
        let (planes, pages) = (stack.pages(), end - start);
        let truncated = shaped.truncated && slices.len() == 1;
        if planes == 1 {
            // pages that were written one by one
            stack = Stack::slices(pages, kind.size);
        } else if planes != pages && !truncated {
            let found = format!("{pages} pages of a shape of {:?}", shaped.shape);
            let expected = format!("{planes}, as tifffile's description says");
            return Err(Error::format(path, found, expected).with_hint(other_count(pages, planes)));
        }
        stacks.push(stack);
        starts.push(start);
    }
    Ok((stacks, starts))
}

/// Pages of which nothing is said: those of one size and type are a stack.
fn of_kinds(
    path: &Path,
    blobs: Vec<Blob>,
    mut chain: Chain,
    slices: &[usize],
    text: &str,
    options: &OpenOptions,
) -> Result<Plan> {
    if options.series.is_none() && slices.iter().any(|&i| chain.pages[i].kind == UNREADABLE) {
        return Err(chain.unreadable.take().unwrap_or_else(|| {
            Error::format(path, "pages of very many sizes and types", "slices of one")
        }));
    }
    let of = |page: &PageAt| {
        let kind = chain.groups.get(page.kind as usize).map(|g| g.kind);
        kind.map(|kind| (kind.size, kind.dtype))
    };
    let mut kinds = Vec::new();
    for group in &chain.groups {
        let kind = (group.kind.size, group.kind.dtype);
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let taken = |kind| {
        slices
            .iter()
            .map(|&i| chain.pages[i])
            .filter(move |page| of(page) == Some(kind))
    };
    let stacks: Vec<Stack> = kinds
        .iter()
        .map(|&kind| {
            let mut stack = Stack::slices(taken(kind).count() as u64, kind.0);
            stack.names.push(kind.1.to_string());
            stack
        })
        .collect();
    let chosen = choose(path, &stacks, options)?;
    let pages = taken(kinds[chosen.stack]).collect();
    let mut plan = Plan::new(blobs, pages, chain);
    plan.sizes(text, None, false);
    Ok(plan)
}

impl Plan {
    /// Says that times are taken as slices.
    pub(crate) fn movie(&mut self, chosen: &Chosen) {
        if chosen.movie {
            let slices = chosen.slices;
            self.about.notes.push(format!(
                "a sequence of {slices} times of one slice is taken as {slices} slices"
            ));
        }
    }

    /// Sizes in tags of other programs on the first slice: taken, or named.
    pub(crate) fn other_metadata(&mut self) -> Result<()> {
        let Some(first) = self.pages.first() else {
            return Ok(());
        };
        let bytes = self.blobs[first.blob as usize].open()?;
        let (file, _) = File::open(&bytes)?;
        let dir = file.directory(first.directory)?;
        let stated = self.about.steps.iter().any(Option::is_some);
        match foreign::lsm_size(&dir)? {
            Some(steps) if !stated => self.about.steps = steps.map(Some),
            _ => self
                .about
                .notes_of_size
                .extend(foreign::unread(&dir, stated)),
        }
        Ok(())
    }

    /// Sizes by ImageJ's or tifffile's description, or by TIFF's own tags.
    pub(crate) fn sizes(&mut self, text: &str, series: Option<&Shaped>, one_slice: bool) {
        let Some(resolution) = self.group().map(|group| group.resolution) else {
            return;
        };
        self.about.of_tags = true;
        if Text::is(text) {
            Text::new(text).sizes(&resolution, one_slice, &mut self.about);
        } else if let Some(shaped) = series {
            shaped.sizes(&resolution, &mut self.about);
        } else {
            let (steps, note) = resolution.steps();
            self.about.steps = steps;
            self.about.notes_of_size.extend(note);
        }
    }
}

/// ImageJ writes stacks beyond 4 GiB, and tifffile truncated series, with the directory of the first page alone; the
/// other pages follow it without a gap.
fn one_directory(
    bytes: &Bytes,
    chain: &Chain,
    page: usize,
    total: u64,
    chosen: &Chosen,
) -> Result<Vec<PageAt>> {
    let at = chain.pages[page];
    let group = chain.groups.get(at.kind as usize);
    let (Some(first), Some(group)) = (at.piece, group) else {
        let found = format!("one page, in compressed or separate parts, for {total} images");
        return Err(Error::format(bytes.path(), found, "a page for every image"));
    };
    let [x, y] = group.kind.size.map(u64::from);
    let page_bytes = x * y * group.kind.dtype.bytes() as u64;
    let end = total
        .checked_mul(page_bytes)
        .and_then(|n| n.checked_add(first));
    if chosen.slices > u64::from(MAX_DIM) || end.is_none_or(|end| end > bytes.len()) {
        let found = format!("{} bytes", bytes.len());
        let need = format!("{total} images of {page_bytes} bytes from position {first} on");
        return Err(Error::format(bytes.path(), found, need)
            .with_hint("the file is cut short, or lost its pages when it was saved"));
    }
    let shifts = (0..chosen.slices).map(|z| chosen.page(z) * page_bytes);
    Ok(shifts
        .map(|shift| PageAt {
            piece: Some(first + shift),
            shift,
            ..at
        })
        .collect())
}
