//! OME-XML in ImageDescription: which pages, of this file or others, make which image, and how large its voxels are
//! (<https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/specification.html>).

use crate::error::{Error, Result};
use crate::grid::MAX_DIM;
use crate::volume::formats::tiff::ifd::Directory;
use crate::volume::formats::tiff::stack::{Chosen, Stack};
use crate::volume::formats::tiff::xml::{self, Element};
use crate::volume::stated::size::Step;
use std::collections::HashMap;
use std::path::Path;

/// Planes that are put in their places; more are the same ones again and again.
const MAX_PLANES: u64 = 1 << 26;
/// More images in one file are not looked at.
const MAX_IMAGES: usize = 1 << 16;

/// What the metadata say of an image.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    pub(crate) stack: Stack,
    order: Vec<usize>,
    /// Sizes along x, y and z.
    pub(crate) steps: [Option<Step>; 3],
}

/// The images of a file.
#[derive(Debug, Default)]
pub(crate) struct Document {
    /// In the form of [`Named::uuid`].
    pub(crate) uuid: String,
    pub(crate) images: Vec<Image>,
}

/// The pages of one channel and time.
#[derive(Debug)]
pub(crate) struct Planes {
    /// The file and the number of the page of each slice.
    pub(crate) pages: Vec<(u32, u64)>,
    /// Files; the first, without a name, is the one that was opened.
    pub(crate) files: Vec<Named>,
    /// All pages of the file are meant, in their order.
    pub(crate) all: bool,
    /// Some image has pages in the file that was opened.
    pub(crate) own: bool,
}

/// How OME-XML names a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct Named {
    /// Empty if it is named by its UUID alone.
    pub(crate) name: String,
    /// In small letters, without `urn:uuid:`; empty if none is stated.
    pub(crate) uuid: String,
}

/// A UUID in small letters, without what may stand around it.
fn plain_uuid(text: &str) -> String {
    let text = text.trim().to_lowercase();
    let text = text.strip_prefix("urn:").unwrap_or(&text);
    let text = text.strip_prefix("uuid:").unwrap_or(text);
    text.trim_matches(['{', '}', ' ']).to_owned()
}

/// True for a text that may be OME-XML.
pub(crate) fn is_ome(text: &str) -> bool {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with('<') && (text.contains("<OME") || text.contains(":OME"))
}

/// Reads the images of a file; `None` if its XML is not OME's.
///
/// # Errors
/// [`Error::Format`] for damaged XML or impossible sizes, [`Error::Unsupported`] for metadata in another file.
pub(crate) fn read(path: &Path, dir: &Directory) -> Result<Option<Document>> {
    let (mut document, mut names) = (Document::default(), Vec::new());
    let (mut root, mut binary_only) = (None, None);
    each(path, dir, |element| {
        if element.text.is_some() {
            return Ok(());
        }
        match element.name {
            _ if root.is_none() => {
                root = Some(element.name == "OME");
                document.uuid = plain_uuid(element.get("UUID").unwrap_or_default());
            }
            "Image" => {
                names = ["Name", "ID"]
                    .map(|key| element.get(key).unwrap_or_default().to_owned())
                    .to_vec()
            }
            "Pixels" if document.images.len() == MAX_IMAGES => {
                let found = format!("OME-XML of more than {MAX_IMAGES} images");
                return Err(Error::format(path, found, "fewer"));
            }
            "Pixels" => document
                .images
                .push(Image::read(path, element, names.clone())?),
            "BinaryOnly" => binary_only = element.get("MetadataFile").map(str::to_owned),
            "ModuloAlongZ" => {
                let kind = element.get("Type").unwrap_or("another axis");
                let what = format!(
                    "an OME-TIFF of which the slices are also those of {kind} (ModuloAlongZ)"
                );
                return Err(Error::unsupported(
                    path,
                    what,
                    "save the one volume as a stack of slices",
                ));
            }
            _ => {}
        }
        Ok(())
    })?;
    if let Some(file) = binary_only {
        let what = format!("OME-TIFF with its metadata in another file ({file})");
        let hint = "save it anew with Bio-Formats as one OME-TIFF";
        return Err(Error::unsupported(path, what, hint));
    }
    match (root, document.images.is_empty()) {
        (Some(true), false) => Ok(Some(document)),
        (Some(true), true) => Err(Error::format(
            path,
            "OME-XML without an image",
            "an element Pixels",
        )),
        _ => Ok(None),
    }
}

fn each(path: &Path, dir: &Directory, see: impl FnMut(&Element) -> Result<()>) -> Result<()> {
    match dir.text_reader(270) {
        Some(reader) => xml::elements(path, reader, see),
        None => Ok(()),
    }
}

impl Image {
    fn read(path: &Path, pixels: &Element, names: Vec<String>) -> Result<Self> {
        let side = |key: &str| match pixels.whole(key) {
            Some(n) if (1..=u64::from(MAX_DIM)).contains(&n) => Ok(n),
            _ => {
                let found = format!(
                    "OME-XML with {key}=\"{}\"",
                    pixels.get(key).unwrap_or_default()
                );
                Err(Error::format(
                    path,
                    found,
                    format!("a number from 1 to {MAX_DIM}"),
                ))
            }
        };
        let text = pixels.get("DimensionOrder").unwrap_or("XYZCT");
        let stack = text.strip_prefix("XY").and_then(|order| {
            let counts = [
                side("SizeZ").ok()?,
                side("SizeC").ok()?,
                side("SizeT").ok()?,
            ];
            Stack::new(counts, order)
        });
        // an error of a size says more than one of the order
        let sizes = ["SizeX", "SizeY", "SizeZ", "SizeC", "SizeT"];
        let [x, y, ..] = sizes.map(side);
        let size = [x? as u32, y? as u32];
        sizes
            .iter()
            .skip(2)
            .try_for_each(|key| side(key).map(drop))?;
        let Some(mut stack) = stack else {
            let found = format!("OME-XML with the DimensionOrder {text}");
            return Err(Error::format(
                path,
                found,
                "XY and then Z, C and T in any order",
            ));
        };
        stack.names = names;
        stack.size = Some(size);
        let order = text
            .bytes()
            .skip(2)
            .filter_map(|axis| b"ZCT".iter().position(|a| *a == axis));
        let steps = ["X", "Y", "Z"].map(|axis| {
            let text = pixels.get(&format!("PhysicalSize{axis}"))?;
            let unit = pixels
                .get(&format!("PhysicalSize{axis}Unit"))
                .unwrap_or("um");
            Some(Step::of_text(text, unit))
        });
        Ok(Image {
            stack,
            order: order.collect(),
            steps,
        })
    }

    /// Where a plane comes in the order of the image.
    fn index(&self, zct: [u64; 3]) -> u64 {
        let (mut index, mut stride) = (0, 1);
        for &axis in &self.order {
            index += zct[axis] * stride;
            stride *= self.stack.counts[axis];
        }
        index
    }

    /// Slice, channel and time of a plane.
    fn place(&self, mut index: u64) -> [u64; 3] {
        let mut zct = [0; 3];
        for &axis in &self.order {
            zct[axis] = index % self.stack.counts[axis];
            index /= self.stack.counts[axis];
        }
        zct
    }
}

/// An element TiffData.
#[derive(Default)]
struct TiffData {
    ifd: Option<u64>,
    first: [u64; 3],
    count: Option<u64>,
    file: Named,
}

impl TiffData {
    fn read(element: &Element) -> Self {
        let first = ["FirstZ", "FirstC", "FirstT"].map(|key| element.whole(key).unwrap_or(0));
        TiffData {
            ifd: element.whole("IFD"),
            first,
            count: element.whole("PlaneCount").or(element.whole("NumPlanes")),
            ..TiffData::default()
        }
    }
}

/// Finds the pages of one channel and time.
struct Finder<'a> {
    image: &'a Image,
    chosen: &'a Chosen,
    pages: Vec<Option<(u32, u64)>>,
    /// Planes that were looked at.
    steps: u64,
    /// Pages that lie elsewhere than where another element puts them.
    twice: Option<u64>,
    all: bool,
}

impl Finder<'_> {
    /// The page of each slice.
    fn finish(self, path: &Path) -> Result<Vec<(u32, u64)>> {
        let wrong = |found: String| {
            let expected = format!("a page for each of {} slices", self.chosen.slices);
            Err(Error::format(path, found, expected).with_hint("save it anew with Bio-Formats"))
        };
        if self.steps > MAX_PLANES {
            return wrong(format!("OME-XML that names more than {MAX_PLANES} pages"));
        }
        if let Some(slice) = self.twice {
            return wrong(format!("OME-XML with two pages for slice {slice}"));
        }
        if let Some(first) = self.pages.iter().position(Option::is_none) {
            let missing = self.pages.iter().filter(|page| page.is_none()).count();
            return wrong(format!(
                "OME-XML without a page for {missing} slices, the first of them {first}"
            ));
        }
        Ok(self.pages.into_iter().flatten().collect())
    }

    /// The slice that a plane is, if it is one of those asked for.
    fn slice(&self, [z, c, t]: [u64; 3]) -> Option<u64> {
        let (slice, time) = if self.chosen.movie { (t, 0) } else { (z, t) };
        (c == self.chosen.channel && time == self.chosen.time).then_some(slice)
    }

    fn put(&mut self, slice: u64, page: (u32, u64)) {
        match self.pages.get_mut(slice as usize) {
            Some(place @ None) => *place = Some(page),
            Some(Some(other)) if *other != page => self.twice = Some(slice),
            _ => {}
        }
    }

    fn take(&mut self, data: &TiffData, file: u32) {
        let total = self.image.stack.pages();
        let counts = self.image.stack.counts;
        if (0..3).any(|a| data.first[a] >= counts[a]) {
            return;
        }
        let start = self.image.index(data.first);
        let most = total - start;
        let count = data
            .count
            .unwrap_or(if data.ifd.is_some() { 1 } else { most })
            .min(most);
        self.all |= data.ifd.is_none() && data.count.is_none();
        let ifd = data.ifd.unwrap_or(0);
        let slices = self.chosen.slices;
        self.steps = self.steps.saturating_add(count.min(slices));
        if self.steps > MAX_PLANES {
            return;
        }
        // whichever is less to go through
        if count <= slices {
            for i in 0..count {
                if let Some(slice) = self.slice(self.image.place(start + i)) {
                    self.put(slice, (file, ifd.saturating_add(i)));
                }
            }
            return;
        }
        for slice in 0..slices {
            let (c, t) = (self.chosen.channel, self.chosen.time);
            let zct = if self.chosen.movie {
                [0, c, slice]
            } else {
                [slice, c, t]
            };
            let index = self.image.index(zct);
            if (start..start + count).contains(&index) {
                self.put(slice, (file, ifd.saturating_add(index - start)));
            }
        }
    }
}

impl Document {
    /// The pages of the slices that are asked for.
    ///
    /// # Errors
    /// [`Error::Format`] if the metadata do not say where each slice is, or say it twice.
    pub(crate) fn planes(&self, path: &Path, dir: &Directory, chosen: &Chosen) -> Result<Planes> {
        let image = &self.images[chosen.stack];
        let mut finder = Finder {
            image,
            chosen,
            pages: vec![None; chosen.slices as usize],
            steps: 0,
            twice: None,
            all: false,
        };
        let (mut files, mut known) = (vec![Named::default()], HashMap::new());
        let (mut pixels, mut data, mut any_own) = (0usize, TiffData::default(), false);
        each(path, dir, |element| {
            match (element.name, element.text) {
                ("Pixels", None) => pixels += 1,
                ("TiffData", None) => data = TiffData::read(element),
                ("UUID", None) => {
                    data.file.name = element.get("FileName").unwrap_or_default().to_owned()
                }
                ("UUID", Some(text)) => data.file.uuid = plain_uuid(text),
                ("TiffData", Some(_)) => {
                    let own = match (data.file.uuid.is_empty(), self.uuid.is_empty()) {
                        (false, false) => data.file.uuid == self.uuid,
                        _ => data.file.name.is_empty(),
                    };
                    any_own |= own;
                    let file = match own {
                        true => 0,
                        false => {
                            let key = match data.file.name.is_empty() {
                                true => data.file.uuid.clone(),
                                false => data.file.name.clone(),
                            };
                            *known.entry(key).or_insert_with(|| {
                                files.push(data.file.clone());
                                files.len() as u32 - 1
                            })
                        }
                    };
                    if pixels == chosen.stack + 1 {
                        finder.take(&data, file);
                    }
                }
                _ => {}
            }
            Ok(())
        })?;
        Ok(Planes {
            all: finder.all,
            pages: finder.finish(path)?,
            files,
            own: any_own,
        })
    }
}
