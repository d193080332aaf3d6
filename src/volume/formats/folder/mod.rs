//! A folder of slices: TIFF, PNG, BMP, DICOM, or headerless raw files.
//!
//! Slices of DICOM are in the order of their places. Others are in the natural order of their names (9
//! before 10). Where the names differ by one number only, these numbers must rise in equal steps: a missing
//! slice is refused rather than closed over, and so are the slices of several stacks, or a picture beside
//! them. Other files (notes, logs) are passed by.

mod list;
mod others;
mod sequence;
mod unread;

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::sys::atomic_file::directory;
use crate::volume::Dtype;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, Input, Unread, listed, title_of};
use crate::volume::formats::{foreign, skyscan};
use crate::volume::io::blob::Blob;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text::Pattern;
use crate::volume::options::OpenOptions;
use list::{below, list};
use others::{Others, nothing};
pub(crate) use sequence::{check_sequence, natural};
use std::path::{Path, PathBuf};
use unread::Names;

/// Opens the slices in a folder.
///
/// # Errors
/// [`Error::Format`] if slices are missing, damaged or differ, [`Error::Unsupported`] by name for
/// slices of other formats, [`Error::Usage`] if raw slices lack a size or type.
pub(crate) fn parse(
    path: &Path,
    formats: &'static [Format],
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let whole = formats.iter().find(|format| format.is_folder(path));
    if let Some(parse) = whole.and_then(|format| format.parse)
        && options.dims.is_none()
    {
        let input = Input {
            path,
            head: &[],
            formats,
        };
        return parse(&input, options);
    }
    if options.dims.is_none() {
        foreign::refuse_folder(path)?;
    }
    if is_n5(path)? && options.dims.is_none() {
        let hint = "convert it to Zarr, or save the array as NRRD, MetaImage or TIFF";
        return Err(Error::unsupported(path, "the N5 format", hint));
    }
    let (files, unread) = list(path)?;
    let folder = Folder {
        path,
        all: &files,
        formats,
        options,
    };
    folder.open(files.clone(), unread)
}

/// True for a folder of N5: its metadata name its version, or the blocks of an array.
fn is_n5(path: &Path) -> Result<bool> {
    let file = path.join("attributes.json");
    if !file.is_file() {
        return Ok(false);
    }
    let text = Blob::file(&file)?.head(1 << 16)?;
    let text = String::from_utf8_lossy(&text);
    Ok(text.contains("\"n5\"") || text.contains("\"blockSize\""))
}

/// Opens the slices with the numbers of a name such as `slice_%04d.tif`; `None` if the name is no
/// such pattern.
///
/// # Errors
/// As for a folder.
pub(crate) fn numbered(
    path: &Path,
    formats: &'static [Format],
    options: &OpenOptions,
) -> Option<Result<VolumeDescriptor>> {
    let pattern = Pattern::parse(&name(path))?;
    let inside = directory(path);
    Some(list(inside).and_then(|(all, mut unread)| {
        unread.retain(|u| pattern.matches(&name(&u.path)));
        let matching = all.iter().filter(|file| pattern.matches(&name(file)));
        let files: Vec<_> = matching.cloned().collect();
        if files.is_empty() {
            let found = format!("no file of that name in {}", inside.display());
            let expected = "files with numbers in place of the % and what follows it";
            return Err(Error::format(path, found, expected));
        }
        let folder = Folder {
            path,
            all: &all,
            formats,
            options,
        };
        folder.open(files, unread)
    }))
}

/// A folder of slices, and how it is to be opened.
struct Folder<'a> {
    /// The folder, or a pattern of names in it.
    path: &'a Path,
    /// All its files, also those beside the slices.
    all: &'a [PathBuf],
    formats: &'static [Format],
    options: &'a OpenOptions,
}

impl Folder<'_> {
    /// Opens these of its files as slices.
    fn open(&self, files: Vec<PathBuf>, mut unread: Vec<Unread>) -> Result<VolumeDescriptor> {
        if let (Some(dims), Some(dtype)) = (self.options.dims, self.options.dtype) {
            return raw(self.path, files, dims, dtype, self.options);
        }
        let Found {
            mut pictures,
            mut scans,
            mut others,
            unread: unknown,
        } = Found::among(files.clone(), self.formats)?;
        unread.extend(unknown);
        let previews = are_previews(&pictures)?;
        if self.path.is_dir() && (!scans.is_empty() || previews) {
            let (more, odd) = below(self.path, self.formats)?;
            scans.extend(more);
            unread.extend(odd);
        }
        join_previews(&mut pictures);
        // pictures beside the slices are previews
        let count: usize = pictures.iter().map(|(_, files)| files.len()).sum();
        if scans.len() > count
            && let Some(format) = self.placed()
        {
            return self.series(format, scans, unread, &others);
        }
        let slices = pictures.iter().flat_map(|(_, files)| files);
        unread::none_among(&unread, &Names::of(slices.map(PathBuf::as_path)))?;
        match &pictures[..] {
            [(format, files)] => self.ordered(format, files.clone()),
            [] => self.without_pictures(files, unread, &mut others),
            several => {
                let counts = several
                    .iter()
                    .map(|(format, files)| format!("{} {}", files.len(), format.title));
                let counts: Vec<String> = counts.collect();
                let found = format!("{} files", counts.join(" and "));
                Err(Error::format(self.path, found, "slices of one format"))
            }
        }
    }

    /// The format whose slices say where they lie.
    fn placed(&self) -> Option<&'static Format> {
        self.formats.iter().find(|f| f.has_placed_slices())
    }

    /// Opens files that are no pictures: raw slices if the options describe these, else the slices in folders below.
    fn without_pictures(
        &self,
        files: Vec<PathBuf>,
        mut unread: Vec<Unread>,
        others: &mut Others,
    ) -> Result<VolumeDescriptor> {
        let raw_options = self.options.of_headerless();
        if let (Some(dims), Some(dtype)) = (raw_options.dims, raw_options.dtype)
            && !files.is_empty()
            && others.foreign.is_empty()
        {
            return raw(self.path, files, dims, dtype, &raw_options);
        }
        if let Some(format) = self.placed()
            && self.path.is_dir()
        {
            let (scans, odd) = below(self.path, self.formats)?;
            unread.extend(odd);
            if !scans.is_empty() {
                return self.series(format, scans, unread, others);
            }
        }
        let folders = unread.into_iter().filter(|u| u.is_folder);
        let volumes = folders.filter(|u| self.formats.iter().any(|f| f.is_folder(&u.path)));
        others.volumes.extend(volumes.map(|u| u.path));
        Err(nothing(self.path, others, self.formats))
    }

    /// Opens slices that say where they lie, with what stands beside them under such names.
    fn series(
        &self,
        format: &Format,
        scans: Vec<Blob>,
        mut unread: Vec<Unread>,
        others: &Others,
    ) -> Result<VolumeDescriptor> {
        let names = Names::of(scans.iter().map(Blob::path));
        unread.retain(|u| u.is_named_like(&names));
        let notes = others.notes(&scans, format);
        let mut found = format.parse_slices(self.path, scans, unread, self.options)?;
        found.notes.extend(notes);
        Ok(found)
    }

    /// Opens slices of one format, with what NRecon puts beside them: a picture of the whole scan, and a log with the
    /// size of a voxel.
    fn ordered(&self, format: &Format, files: Vec<PathBuf>) -> Result<VolumeDescriptor> {
        let (previews, slices): (Vec<_>, Vec<_>) = files
            .into_iter()
            .partition(|file| skyscan::is_preview(&name(file)));
        // a folder of nothing else is of slices that have such names
        let (previews, files) = if slices.is_empty() {
            (slices, previews)
        } else {
            (previews, slices)
        };
        let names = names(&files);
        check_sequence(self.path, &names)?;
        let slices = blobs(&files)?;
        let mut descriptor = format.parse_slices(self.path, slices, Vec::new(), self.options)?;
        for preview in &previews {
            let note = format!(
                "{} is taken for a preview of the scan and passed by",
                name(preview)
            );
            descriptor.notes.push(note);
        }
        if let Some(log) = skyscan::find(self.all, &names)? {
            log.apply(&mut descriptor);
        }
        Ok(descriptor)
    }
}

/// Puts the previews of a scan to its slices, which may be of another format.
fn join_previews(pictures: &mut Vec<(&'static Format, Vec<PathBuf>)>) {
    let preview = |file: &PathBuf| skyscan::is_preview(&name(file));
    let alone = |(_, files): &(&Format, Vec<PathBuf>)| files.iter().all(preview);
    if pictures.iter().filter(|of| !alone(of)).count() == 1 {
        let previews: Vec<_> = pictures.extract_if(.., |of| alone(of)).collect();
        pictures[0]
            .1
            .extend(previews.into_iter().flat_map(|(_, files)| files));
    }
}

/// True if every format has one picture of one slice: alone that is no volume, and beside folders of slices a preview.
fn are_previews(pictures: &[(&'static Format, Vec<PathBuf>)]) -> Result<bool> {
    for (format, files) in pictures {
        if files.len() > 1 || !format.is_one_slice(&files[0])? {
            return Ok(false);
        }
    }
    Ok(!pictures.is_empty())
}

/// True for the list of its files that a disc of DICOM holds: it has no pixels.
fn is_index(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.eq_ignore_ascii_case("DICOMDIR"))
}

/// True for the first bytes of a slice that says where it lies.
fn is_placed(format: &Format, head: &[u8]) -> bool {
    format.has_placed_slices() && (format.starts)(head)
}

/// What files are.
#[derive(Default)]
struct Found {
    /// Slices in the order of their names, by their formats in the order of the registry.
    pictures: Vec<(&'static Format, Vec<PathBuf>)>,
    /// Slices that say where they lie.
    scans: Vec<Blob>,
    others: Others,
    /// Files of which no format is known.
    unread: Vec<Unread>,
}

impl Found {
    fn among(files: Vec<PathBuf>, formats: &'static [Format]) -> Result<Self> {
        let ordered: Vec<&Format> = formats.iter().filter(|f| f.has_ordered_slices()).collect();
        let mut found = Found {
            pictures: ordered.iter().map(|format| (*format, Vec::new())).collect(),
            ..Found::default()
        };
        for file in files {
            if is_index(&file) {
                continue;
            }
            let blob = Blob::file(&file)?;
            let head = blob.head(400)?;
            let mut pictures = found.pictures.iter_mut();
            if let Some((_, files)) = pictures.find(|(format, _)| (format.starts)(&head)) {
                files.push(file);
            } else if formats.iter().any(|format| is_placed(format, &head)) {
                found.scans.push(blob);
            } else if ordered.iter().any(|format| format.has_name(&file)) {
                let titles: Vec<&str> = ordered.iter().map(|format| format.title).collect();
                let expected = format!("a {}, as its name says", listed(&titles, "or"));
                return Err(
                    Error::format(file, unread::begins(&head), expected).with_hint(
                        "a slice is damaged: replace it, or take the file out of the folder",
                    ),
                );
            } else if title_of(formats, &head).is_some() {
                found.others.volumes.push(file);
            } else if let Some(name) = foreign::named(&file, &head) {
                found.others.foreign.push((name, file));
            } else {
                found.unread.push(Unread::file(file, &head));
            }
        }
        found.pictures.retain(|(_, files)| !files.is_empty());
        Ok(found)
    }
}

/// True for a file that is taken for a slice, in a folder of others.
pub(crate) fn is_slice(file: &Path, formats: &[Format]) -> bool {
    let head = Blob::file(file).and_then(|blob| blob.head(400));
    let slices = || formats.iter().filter(|format| format.slices.is_some());
    head.is_ok_and(|head| slices().any(|format| (format.starts)(&head)))
}

fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn names(files: &[PathBuf]) -> Vec<String> {
    files.iter().map(|f| name(f)).collect()
}

fn blobs(files: &[PathBuf]) -> Result<Vec<Blob>> {
    files.iter().map(|f| Blob::file(f)).collect()
}

/// Raw slices: the files that have the size of a slice, of which there must be as many as slices.
fn raw(
    path: &Path,
    files: Vec<PathBuf>,
    dims: [u64; 3],
    dtype: Dtype,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let dims = Dims::new(dims)?;
    let offset = options.offset.unwrap_or(0);
    let bytes = dims.slice_voxels() * dtype.bytes() as u64;
    let whole = offset.saturating_add(bytes);
    let mut slices = Vec::new();
    for file in files {
        let len = Blob::file(&file)?.len();
        if len == whole {
            slices.push(file);
        }
    }
    let nz = dims.0[2] as usize;
    if slices.len() != nz {
        return Err(Error::format(
            path,
            format!("{} files of {whole} bytes", slices.len()),
            format!("{nz}, one for each slice of {dims} of {dtype}"),
        )
        .with_hint(
            "--dims must give the number of slices last, --offset the header of each file",
        ));
    }
    check_sequence(path, &names(&slices))?;
    Ok(VolumeDescriptor {
        endian: options.endian,
        ..VolumeDescriptor::new(
            "raw",
            dims,
            dtype,
            Samples::Files(Data {
                files: slices,
                start: Start::At {
                    base: 0,
                    lines: 0,
                    bytes: offset,
                    stated: options.offset.is_some(),
                },
                encoding: Encoding::Raw,
            }),
        )
    })
}
