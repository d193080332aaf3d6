//! A folder of slices: TIFF, PNG, DICOM, or headerless raw files.
//!
//! Slices of DICOM are in the order of their places. Others are in the natural order of their names (9
//! before 10). Where the names differ by one number only, these numbers must rise in equal steps: a missing
//! slice is refused rather than closed over, and so are the slices of several stacks, or a picture beside
//! them. Other files (notes, logs) are passed by.

mod list;
mod others;
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
use std::cmp::Ordering;
use std::collections::BTreeMap;
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
    these(path, files.clone(), &files, unread, formats, options)
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
    let folder = directory(path);
    Some(list(folder).and_then(|(all, mut unread)| {
        unread.retain(|u| pattern.matches(&name(&u.path)));
        let matching = all.iter().filter(|file| pattern.matches(&name(file)));
        let files: Vec<_> = matching.cloned().collect();
        if files.is_empty() {
            let found = format!("no file of that name in {}", folder.display());
            let expected = "files with numbers in place of the % and what follows it";
            return Err(Error::format(path, found, expected));
        }
        these(path, files, &all, unread, formats, options)
    }))
}

/// Opens these of all files of a folder as slices.
fn these(
    path: &Path,
    files: Vec<PathBuf>,
    all: &[PathBuf],
    mut unread: Vec<Unread>,
    formats: &'static [Format],
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    if let (Some(dims), Some(dtype)) = (options.dims, options.dtype) {
        return raw(path, files, dims, dtype, options);
    }
    let Found {
        pictures,
        mut scans,
        mut others,
        unread: unknown,
    } = Found::among(files.clone(), formats)?;
    unread.extend(unknown);
    let placed = formats.iter().find(|f| f.has_placed_slices());
    let previews = are_previews(&pictures)?;
    if path.is_dir() && (!scans.is_empty() || previews) {
        let (more, odd) = below(path, formats)?;
        scans.extend(more);
        unread.extend(odd);
    }
    // pictures beside the slices are previews
    let count: usize = pictures.iter().map(|(_, files)| files.len()).sum();
    if scans.len() > count
        && let Some(format) = placed
    {
        return series(path, format, scans, (unread, &others), options);
    }
    let slices = pictures.iter().flat_map(|(_, files)| files);
    unread::none_among(&unread, &Names::of(slices.map(PathBuf::as_path)))?;
    match &pictures[..] {
        [(format, files)] => ordered(path, format, files.clone(), all, options),
        [] => {
            let raw_options = options.of_headerless();
            if let (Some(dims), Some(dtype)) = (raw_options.dims, raw_options.dtype)
                && !files.is_empty()
                && others.foreign.is_empty()
            {
                return raw(path, files, dims, dtype, &raw_options);
            }
            if let Some(format) = placed
                && path.is_dir()
            {
                let (scans, odd) = below(path, formats)?;
                unread.extend(odd);
                if !scans.is_empty() {
                    return series(path, format, scans, (unread, &others), options);
                }
            }
            let folders = unread.into_iter().filter(|u| u.is_folder);
            let volumes = folders.filter(|u| formats.iter().any(|f| f.is_folder(&u.path)));
            others.volumes.extend(volumes.map(|u| u.path));
            Err(nothing(path, &others, formats))
        }
        several => {
            let counts = several
                .iter()
                .map(|(format, files)| format!("{} {}", files.len(), format.title));
            let counts: Vec<String> = counts.collect();
            let found = format!("{} files", counts.join(" and "));
            Err(Error::format(path, found, "slices of one format"))
        }
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

/// Slices that say where they lie, with what stands beside them under such names.
fn series(
    path: &Path,
    format: &Format,
    scans: Vec<Blob>,
    (mut unread, others): (Vec<Unread>, &Others),
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let names = Names::of(scans.iter().map(Blob::path));
    unread.retain(|u| u.is_named_like(&names));
    let notes = others.notes(&scans, format);
    let mut found = format.parse_slices(path, scans, unread, options)?;
    found.notes.extend(notes);
    Ok(found)
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

/// Slices of one format, with what NRecon puts beside them: a picture of the whole scan, and a log with the size of a
/// voxel.
fn ordered(
    path: &Path,
    format: &Format,
    files: Vec<PathBuf>,
    all: &[PathBuf],
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
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
    check_sequence(path, &names)?;
    let mut recipe = format.parse_slices(path, blobs(&files)?, Vec::new(), options)?;
    for preview in &previews {
        let note = format!(
            "{} is taken for a preview of the scan and passed by",
            name(preview)
        );
        recipe.notes.push(note);
    }
    if let Some(log) = skyscan::find(all, &names)? {
        log.apply(&mut recipe);
    }
    Ok(recipe)
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

/// Splits a name into text and numbers by turns, text first.
fn parts(name: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let (mut rest, mut digits) = (name, false);
    while !rest.is_empty() {
        let end = rest.find(|c: char| c.is_ascii_digit() != digits);
        let (now, later) = rest.split_at(end.unwrap_or(rest.len()));
        parts.push(now);
        (rest, digits) = (later, !digits);
    }
    parts
}

/// The order of names in which numbers count as numbers: 9 before 10.
pub(crate) fn natural(a: &str, b: &str) -> Ordering {
    let (x, y) = (parts(a), parts(b));
    for (i, (p, q)) in x.iter().zip(&y).enumerate() {
        let order = if i % 2 == 1 {
            let [p, q] = [p, q].map(|n| n.trim_start_matches('0'));
            p.len().cmp(&q.len()).then(p.cmp(q))
        } else {
            p.cmp(q)
        };
        if order.is_ne() {
            return order;
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}

/// Refuses names, in natural order, that are not those of one stack, or that count with a gap.
///
/// Names that share nothing are taken as they are, and so are those in which several numbers differ, as a date and
/// a time do: there is no single count to check.
pub(crate) fn check_sequence(path: &Path, names: &[String]) -> Result<()> {
    let split: Vec<_> = names.iter().map(|n| parts(n)).collect();
    let mut kinds: BTreeMap<Vec<&str>, Vec<usize>> = BTreeMap::new();
    for (i, parts) in split.iter().enumerate() {
        kinds.entry(texts(parts)).or_default().push(i);
    }
    if kinds.len() > 1 && kinds.len() < names.len() {
        let mut kinds: Vec<_> = kinds.into_values().collect();
        kinds.sort_by_key(|of| std::cmp::Reverse(of.len()));
        let like = |of: &[usize]| format!("{} like {}", of.len(), names[of[0]]);
        return Err(stacks(path, &like(&kinds[0]), &like(&kinds[1])));
    }
    let Some(first) = split.first().filter(|_| kinds.len() == 1) else {
        return Ok(());
    };
    let counts = (1..first.len()).step_by(2);
    let varying: Vec<_> = counts
        .filter(|&at| split.iter().any(|parts| parts[at] != first[at]))
        .collect();
    match varying[..] {
        [] => Ok(()),
        [at] => check_count(path, names, split.iter().map(|parts| parts[at])),
        [.., a, b] if b == a + 2 && first[a + 1] == "." => Ok(()),
        [.., at] => {
            let mut seen = BTreeMap::new();
            for (name, parts) in names.iter().zip(&split) {
                if let Some(other) = seen.insert(parts[at], name) {
                    return Err(stacks(path, other, name));
                }
            }
            Ok(())
        }
    }
}

/// The texts of a name, without what follows its last number as extensions do.
fn texts<'a>(parts: &[&'a str]) -> Vec<&'a str> {
    let texts = parts.iter().copied().step_by(2);
    let mut texts: Vec<_> = texts.collect();
    if texts.len() > 1 && texts.last().is_some_and(|last| last.starts_with('.')) {
        texts.pop();
    }
    texts
}

fn stacks(path: &Path, one: &str, other: &str) -> Error {
    let found = format!("files of several stacks: {one}, {other}");
    let expected = "slices of one, whose names differ by a number that counts them";
    Error::format(path, found, expected).with_hint(
        "take the others out; of a folder, the slices of one can be given as FOLDER/slice_%04d.tif",
    )
}

/// Refuses numbers, in rising order, that do not rise in equal steps.
fn check_count<'a>(
    path: &Path,
    names: &[String],
    numbers: impl Iterator<Item = &'a str>,
) -> Result<()> {
    let numbers: Option<Vec<u128>> = numbers.map(|n| n.parse().ok()).collect();
    let Some(numbers) = numbers else {
        return Ok(());
    };
    let step = numbers[1] - numbers[0];
    for (i, pair) in numbers.windows(2).enumerate() {
        if pair[1] - pair[0] != step || step == 0 {
            return Err(Error::format(
                path,
                format!("{} after {}", names[i + 1], names[i]),
                format!(
                    "numbers that rise by {step}, as from {} to {}",
                    names[0], names[1]
                ),
            )
            .with_hint(
                "a slice is missing or comes twice: complete the folder or rename the files",
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_count_as_people_do() {
        let mut names = ["s10", "s9", "s1", "s01b", "s2", "10", "9", "t", "s"].map(String::from);
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(
            names,
            ["9", "10", "s", "s1", "s01b", "s2", "s9", "s10", "t"]
        );
    }

    #[test]
    fn gaps_are_found() {
        let check = |names: &[&str]| {
            let names: Vec<_> = names.iter().map(|n| n.to_string()).collect();
            check_sequence(Path::new("d"), &names).is_ok()
        };
        assert!(check(&["a9.tif", "a10.tif", "a11.tif"]));
        assert!(check(&["7B_000", "7B_010", "7B_020"]));
        assert!(check(&["x", "y", "z9"]) && check(&[]) && check(&["1"]));
        assert!(!check(&["a1", "a2", "a4"]));
        assert!(!check(&["a1.tif", "a01.tif"]), "the same number twice");
        assert!(check(&["a1.tif", "a2.TIFF"]) && !check(&["a1.tif", "a3.TIFF", "a4.tif"]));
    }

    #[test]
    fn slices_are_those_of_one_stack() {
        let check = |names: &[&str]| {
            let mut names: Vec<_> = names.iter().map(|n| n.to_string()).collect();
            names.sort_by(|a, b| natural(a, b));
            check_sequence(Path::new("d"), &names)
        };
        for names in [
            &["top_1.tif", "top_2.tif", "bot_1.tif", "bot_2.tif"][..],
            &["a_0001.tif", "a_0002.tif", "overview.tif"],
            &["1_0001.tif", "1_0002.tif", "2_0001.tif", "2_0002.tif"],
            &["a/1.png", "a/2.png", "b/1.png", "whole.png"],
        ] {
            let error = check(names).unwrap_err().to_string();
            assert!(error.contains("several stacks"), "{error}");
        }
        for names in [
            &["front.tif", "middle.tif", "rear.tif"][..],
            &["z0.00.tif", "z0.25.tif", "z0.75.tif", "z1.00.tif"],
            &[
                "20240131_235958.tif",
                "20240131_235959.tif",
                "20240201_000001.tif",
            ],
            &["a_1_of_9.tif"],
        ] {
            check(names).unwrap();
        }
    }
}
