//! The pages that OME-XML names, in the file that was opened and others.

use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::grid::length::Length;
use crate::volume::formats::tiff::chain::{Chain, PageAt};
use crate::volume::formats::tiff::ifd::{Directory, File};
use crate::volume::formats::tiff::ome;
use crate::volume::formats::tiff::plan::{Plan, of_files};
use crate::volume::formats::tiff::stack::{Stack, choose, other_count};
use crate::volume::io::blob::Blob;
use crate::volume::options::OpenOptions;
use std::path::Path;

/// The image that OME-XML describes.
pub(crate) fn plan(
    path: &Path,
    blobs: Vec<Blob>,
    dir: &Directory,
    document: &ome::Document,
    options: &OpenOptions,
) -> Result<Plan> {
    let images = &document.images;
    let (mut plan, alike) = if blobs.len() > 1 && images.len() == 1 && images[0].stack.pages() == 1
    {
        self_described(path, blobs, document, options)?
    } else {
        (described(path, blobs, dir, document, options)?, true)
    };
    plan.about.of_tags = false;
    if plan.about.steps.iter().any(Option::is_some) {
        plan.compare();
    } else if alike {
        plan.sizes("", None, false);
    }
    Ok(plan)
}

/// Slices that describe themselves, each alone, and whether they state the same sizes.
fn self_described(
    path: &Path,
    blobs: Vec<Blob>,
    document: &ome::Document,
    options: &OpenOptions,
) -> Result<(Plan, bool)> {
    let chain = Chain::of(&blobs)?;
    let slices = chain.slices();
    let other = other_steps(&blobs, document)?;
    let alike = other.is_none();
    let mut plan = of_files(path, blobs, chain, &slices, "", options)?;
    match other {
        None => plan.about.steps = document.images[0].steps.clone(),
        Some(name) => plan.about.of_size(format!(
            "OME-XML of {name} states sizes that are not those of the first slice: none is taken, give --spacing and \
             --unit"
        )),
    }
    Ok((plan, alike))
}

/// One of the images of a document, whose pages may be in several files.
fn described(
    path: &Path,
    blobs: Vec<Blob>,
    dir: &Directory,
    document: &ome::Document,
    options: &OpenOptions,
) -> Result<Plan> {
    let stacks = document.images.iter().map(|image| image.stack.clone());
    let stacks: Vec<Stack> = stacks.collect();
    let chosen = choose(path, &stacks, options)?;
    let planes = document.planes(path, dir, &chosen)?;
    let image = &document.images[chosen.stack];
    let alone = blobs.len() == 1 && blobs[0].is_whole();
    let found = ome_pages(path, blobs, document, &planes, &image.stack)?;
    let mut plan = Plan::new(found.blobs, found.pages, found.chain);
    plan.about.warnings.extend(found.renamed.map(|name| {
        format!(
            "OME-XML says that its pixels are in the file {name}, which is not there: those of this file are taken, as \
             if it had been renamed"
        )
        .into()
    }));
    plan.named = alone && plan.blobs.iter().any(|blob| blob.path() != path);
    plan.movie(&chosen);
    plan.about.steps = image.steps.clone();
    plan.check_size(path, image.stack.size)?;
    if stacks.len() == 1 && plan.blobs.len() == 1 {
        plan.more_pages(image.stack.pages());
    }
    Ok(plan)
}

/// The name of a file whose OME-XML states other sizes than that of the first, or of more than a slice.
fn other_steps(blobs: &[Blob], document: &ome::Document) -> Result<Option<String>> {
    for blob in &blobs[1..] {
        let bytes = blob.open()?;
        let (file, first) = File::open(&bytes)?;
        let dir = file.directory(first)?;
        let own = match ome::is_ome(&dir.text(270)?) {
            true => ome::read(blob.path(), &dir)?,
            false => None,
        };
        let steps = |document: &ome::Document| document.images[0].steps.clone();
        if own.as_ref().map(steps).as_ref() != Some(&document.images[0].steps) {
            let name = blob.path().file_name().unwrap_or_default();
            return Ok(Some(name.to_string_lossy().into_owned()));
        }
    }
    Ok(None)
}

/// The files that OME-XML names, with their pages.
struct Found {
    blobs: Vec<Blob>,
    chain: Chain,
    /// Those of the slices.
    pages: Vec<PageAt>,
    /// The name in OME-XML of the one file that was opened, if it is taken by another.
    renamed: Option<String>,
}

/// The pages that OME-XML names, in this file and others.
fn ome_pages(
    path: &Path,
    given: Vec<Blob>,
    document: &ome::Document,
    planes: &ome::Planes,
    stack: &Stack,
) -> Result<Found> {
    let mut used: Vec<u32> = planes.pages.iter().map(|(file, _)| *file).collect();
    used.sort_unstable();
    used.dedup();
    let (mut chain, mut blobs, mut bases) = (Chain::default(), Vec::new(), Vec::new());
    let mut renamed = None;
    for &file in &used {
        let (blob, by_another_name) = named(path, &given, planes, file, &document.uuid)?;
        if by_another_name {
            renamed = Some(planes.files[file as usize].name.clone());
        }
        bases.push(chain.pages.len());
        chain.walk(&blob.open()?, blobs.len() as u32)?;
        blobs.push(blob);
    }
    bases.push(chain.pages.len());
    if given.len() > 1 && planes.files.len() < given.len() {
        let found = format!(
            "{} files, of which OME-XML of the first names {}",
            given.len(),
            planes.files.len()
        );
        return Err(Error::format(path, found, "files of one OME-TIFF"));
    }
    if document.images.len() == 1 && planes.all && used.len() == 1 {
        check_count(path, &chain, stack)?;
    }
    let page = |&(file, ifd): &(u32, u64)| {
        let at = used.partition_point(|&f| f < file);
        let number = usize::try_from(ifd)
            .ok()
            .and_then(|ifd| bases[at].checked_add(ifd));
        let number = number.filter(|n| *n < bases[at + 1]).ok_or_else(|| {
            let (blob, pages): (&Blob, usize) = (&blobs[at], bases[at + 1] - bases[at]);
            let found = format!("a TIFF of {pages} pages");
            let expected = format!("a page {ifd} (from 0 on), as its OME-XML says");
            Error::format(blob.path(), found, expected)
                .with_hint("the file was cut short or changed")
        });
        number.map(|n| chain.pages[n])
    };
    let pages = planes.pages.iter().map(page).collect::<Result<_>>()?;
    Ok(Found {
        blobs,
        chain,
        pages,
        renamed,
    })
}

/// Checks that a file has the pages of its one image and no others.
fn check_count(path: &Path, chain: &Chain, stack: &Stack) -> Result<()> {
    let count = chain.slices().len() as u64;
    if count == stack.pages() {
        return Ok(());
    }
    let told = format!("{}, as its OME-XML says", stack.pages());
    Err(
        Error::format(path, format!("a TIFF of {count} pages"), told)
            .with_hint(other_count(count, stack.pages())),
    )
}

/// The file of this number in OME-XML, and whether it is the one that was opened, taken by another name.
fn named(
    path: &Path,
    given: &[Blob],
    planes: &ome::Planes,
    file: u32,
    uuid: &str,
) -> Result<(Blob, bool)> {
    let told = &planes.files[file as usize];
    let name = Path::new(&told.name).file_name();
    if file == 0 {
        return Ok((given[0].clone(), false));
    }
    let like = |blob: &&Blob| blob.path().file_name() == name;
    if let Some(blob) = given.iter().find(like) {
        return Ok((blob.clone(), false));
    }
    if let (Some(name), true) = (name, given[0].is_whole()) {
        let beside = given[0].path().with_file_name(name);
        if beside.is_file() {
            return Ok((Blob::file(&beside)?, false));
        }
    }
    // the only file that is named may be this one, by the name that it had
    let other = !uuid.is_empty() && !told.uuid.is_empty();
    if planes.files.len() == 2 && !planes.own && given.len() == 1 && !other {
        return Ok((given[0].clone(), true));
    }
    let mut found = "OME-XML that says that its pixels are in ".to_owned();
    found += &match told.name.as_str() {
        "" => format!("a file of the UUID {} without a name", told.uuid),
        name => format!("the file {name}, which is not there"),
    };
    if other && !told.name.is_empty() {
        found += &format!(" (its UUID is {}, that of this file {uuid})", told.uuid);
    }
    let expected = "all files of the OME-TIFF beside each other, by the names that it states";
    Err(Error::format(path, found, expected))
}

impl Plan {
    /// Says that the metadata name fewer pages than there are.
    fn more_pages(&mut self, named: u64) {
        let pages = self.chain.slices().len() as u64;
        if pages > named {
            self.about.notes.push(format!(
                "of the {pages} pages of this TIFF, OME-XML names {named}, which are read"
            ));
        }
    }

    /// Says that TIFF's own tags state other sizes than OME-XML, which are not taken.
    fn compare(&mut self) {
        let resolution = self.group().map(|group| group.resolution);
        let Some((resolution, Some(x))) = resolution.zip(Some(self.about.steps[0].as_ref())) else {
            return;
        };
        let by_tags = resolution
            .millimetres()
            .filter(|_| resolution.of_paper().is_none());
        if let (Some([own, _]), Some(length)) = (by_tags, Length::parse(&x.unit))
            && (own / length.convert(x.size, Unit::Millimetre) - 1.0).abs() > 0.01
        {
            self.about.notes.push(format!(
                "TIFF's own resolution states pixels of {own} mm, OME-XML {} {}, which is taken",
                x.size, x.unit
            ));
        }
    }

    fn check_size(&self, path: &Path, stated: Option<[u32; 2]>) -> Result<()> {
        let (Some(kind), Some([x, y])) = (self.group().map(|group| group.kind), stated) else {
            return Ok(());
        };
        if kind.size != [x, y] {
            let [nx, ny] = kind.size;
            let expected = format!("{x} x {y}, as OME-XML says");
            return Err(Error::format(
                path,
                format!("pages of {nx} x {ny}"),
                expected,
            ));
        }
        Ok(())
    }
}
