//! TIFF and BigTIFF stacks: one file of many pages, or many files in the order of their names.
//!
//! Which pages are the slices is what OME-XML, ImageJ or tifffile say in ImageDescription, or else all pages of one
//! size and type. Grey values are handed out as they are stored, or by the scale that the file states: where 0 is white
//! (WhiteIsZero) they are not inverted, since a scan's numbers mean more than their display, which a note says; colour
//! maps are not applied. f16 is handed out as f32.
//! Thumbnails and masks (NewSubfileType 1 and 4) are no slices.

mod chain;
mod codec;
mod foreign;
mod ifd;
mod imagej;
mod members;
mod ome;
mod ome_pages;
mod page;
mod pages;
mod plan;
mod resolution;
mod scale;
mod shaped;
mod stack;
mod xml;

use crate::error::{Error, Result};
use crate::grid::{Dims, Origin};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, Slices};
use crate::volume::io::blob::Blob;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::options::{Choice, OpenOptions};
use pages::TiffPages;
use plan::Plan;
use std::path::Path;
use std::sync::Mutex;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "tiff",
    title: "TIFF",
    extensions: &["tif", "tiff"],
    takes: &[Choice::Series, Choice::Channel, Choice::Time],
    starts: is_tiff,
    parse: Some(|input, options| parse(input.path, vec![Blob::file(input.path)?], options)),
    slices: Some(Slices {
        parse: |path, blobs, _, options| parse(path, blobs, options),
        is_single,
        placed: false,
    }),
    ..Format::BASE
};

/// True if a file begins as TIFF or BigTIFF does.
pub(crate) fn is_tiff(head: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| head.starts_with(*magic))
}

/// True for a file of one page, which is a slice and no volume.
///
/// # Errors
/// [`Error::Format`] if it is damaged.
pub(crate) fn is_single(path: &Path) -> Result<bool> {
    let chain = chain::Chain::of(&[Blob::file(path)?])?;
    Ok(chain.pages.len() == 1)
}

/// Reads the tags of every page of these files, in their order, and finds the slices that are asked for.
///
/// # Errors
/// [`Error::Unsupported`] by name for what this reader does not decode, [`Error::Format`] for pages
/// that differ in size or type, or that the files cannot hold, [`Error::Usage`] with the list of what there is if that is
/// more than one volume.
pub(crate) fn parse(
    path: &Path,
    blobs: Vec<Blob>,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let mut plan = Plan::make(path, blobs, options)?;
    let kind = plan.kind(path)?;
    let slices = plan.pages.len() as u64;
    if slices < 2 {
        return Err(
            Error::format(path, "a TIFF of one page", "a stack of at least 2 slices")
                .with_hint("give the folder that holds the slices"),
        );
    }
    let [x, y] = kind.size;
    let dims = Dims::new([x.into(), y.into(), slices]).map_err(|e| e.of_header(path, "pages"))?;
    let mirrored = plan.orientation(path, kind.orientation)?;
    if kind.white_is_zero {
        let note =
            "0 is white in this TIFF (WhiteIsZero): values are as they are stored, not inverted";
        plan.about.notes.push(note.into());
    }
    plan.other_metadata()?;
    let size = plan.about.size();
    let mut about = std::mem::take(&mut plan.about);
    if options.spacing.is_none() {
        about.notes.append(&mut about.notes_of_size);
    }
    let page_bytes = u64::from(x) * u64::from(y) * kind.dtype.bytes() as u64;
    let mut descriptor = VolumeDescriptor {
        endian: Some(kind.endian),
        values: about.values,
        mirrored,
        notes: about.notes,
        warnings: about.warnings,
        ..VolumeDescriptor::new("tiff", dims, kind.dtype, samples(plan, page_bytes)?)
    };
    size.apply(&mut descriptor.placement, &mut descriptor.provenance);
    match (about.zero, size.spacing, options.spacing) {
        (Some(zero), Some(spacing), None) => {
            // adding 0 turns -0 into 0
            let origin = [0, 1, 2].map(|a| 0.0 - zero[a] * spacing[a]);
            // products of decimals, without the noise of their last digits
            let short = |v: f64| format!("{v:.13e}").parse().unwrap_or(v);
            descriptor.placement.origin = origin.map(|v| short(v) + 0.0);
            descriptor.provenance.origin = Origin::File;
        }
        (Some([x, y, z]), ..) => descriptor.notes.push(format!(
            "ImageJ's origin of coordinates, at voxel {x}, {y}, {z}, is not used, since the file states no size of a \
             voxel or --spacing another: voxel 0 lies at 0"
        )),
        (None, ..) => {}
    }
    Ok(descriptor)
}

/// Samples in one piece are read as those of a raw file, others page by page.
fn samples(plan: Plan, page_bytes: u64) -> Result<Samples> {
    let Plan { blobs, pages, .. } = plan;
    let joined = pages.windows(2).all(|pair| {
        let next = pair[0].piece.and_then(|p| p.checked_add(page_bytes));
        next == pair[1].piece && pair[0].blob == pair[1].blob
    });
    let blob = &blobs[pages[0].blob as usize];
    if let (Some(first), true, true) = (pages[0].piece, joined, plan.one_order) {
        return Ok(if blob.is_whole() {
            Samples::Files(Data {
                files: vec![blob.path().to_path_buf()],
                start: Start::behind(first),
                encoding: Encoding::Raw,
            })
        } else {
            Samples::Bytes(Box::new(blob.samples(first)?))
        });
    }
    Ok(Samples::Pages(Box::new(TiffPages {
        blobs,
        pages,
        named: plan.named,
        largest: plan.chain.largest,
        recent: Mutex::default(),
    })))
}
