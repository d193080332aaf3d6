//! Zip archives: slices or one stack in TIFF, PNG or BMP, or one NumPy array (`.npz`).
//!
//! A NumPy array is streamed out of the archive. Pages must be read at any place, so compressed
//! members with pages are first unpacked to an unnamed file in the folder for temporary files
//! (`TMPDIR`), which goes away with the volume.

use crate::error::{Error, Result};
use crate::store;
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::{Format, Input, listed, title_of};
use crate::volume::formats::folder::{check_sequence, natural};
use crate::volume::formats::npy;
use crate::volume::io::blob::{Blob, Bytes};
use crate::volume::io::data::Encoding;
use crate::volume::options::OpenOptions;
use flate2::bufread::DeflateDecoder;
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zip::{CompressionMethod, ZipArchive};

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "zip",
    title: "zip",
    extensions: &["zip"],
    starts: is_zip,
    parse: Some(parse),
    ..Format::BASE
};

/// True if a file begins as a zip archive with members does.
pub(crate) fn is_zip(head: &[u8]) -> bool {
    head.starts_with(b"PK\x03\x04")
}

/// More members than slices can be.
const MAX_MEMBERS: usize = 1 << 17;

/// A file in the archive.
#[derive(Debug, Clone)]
struct Member {
    name: String,
    /// Where its bytes begin in the archive, and how many there are.
    start: u64,
    packed: u64,
    /// Bytes when unpacked.
    size: u64,
    crc: u32,
    deflated: bool,
}

/// Finds the volume in an archive.
///
/// # Errors
/// [`Error::Unsupported`] if it holds none or several, or is encrypted or packed in another way than
/// by Deflate; [`Error::Format`] if it is damaged; [`Error::Io`] if there is no room to unpack it.
fn parse(input: &Input, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let path = input.path;
    let archive = Blob::file(path)?.open()?;
    let members = members(path, &archive)?;
    let mut found = Found::new(input.formats);
    for member in members {
        found.add(path, &archive, member)?;
    }
    let Found {
        images,
        arrays,
        scans,
        ..
    } = found;
    // pictures beside slices are previews
    let count: usize = images.iter().map(|(_, members)| members.len()).sum();
    if scans > count + arrays.len() {
        let placed = input.formats.iter().find(|f| f.has_placed_slices());
        let title = placed.map_or("", |format| format.title);
        let what = format!("a zip of {scans} {title} files");
        return Err(Error::unsupported(
            path,
            what,
            "unpack it, and give the folder",
        ));
    }
    let mut kinds = images.iter().filter(|(_, members)| !members.is_empty());
    match (kinds.next(), kinds.next(), arrays.len()) {
        (Some((format, members)), None, 0) => {
            check_sequence(path, &names(members))?;
            let blobs = unpack(path, &archive, members.clone())?;
            format.parse_slices(path, blobs, Vec::new(), options)
        }
        (None, _, 1..) => numpy(path, arrays),
        (_, _, n) => {
            let counts = images
                .iter()
                .map(|(format, members)| format!("{} {}", members.len(), format.title));
            let counts: Vec<String> = counts.collect();
            let what = format!("a zip of {} and {n} NumPy files", counts.join(", "));
            let titles: Vec<&str> = images.iter().map(|(format, _)| format.title).collect();
            let titles = listed(&titles, "or");
            let hint =
                format!("a zip must hold one volume: a stack or slices in {titles}, or an array");
            Err(Error::unsupported(path, what, hint))
        }
    }
}

/// What the files of an archive are.
struct Found {
    formats: &'static [Format],
    /// Slices in the order of their names, by their formats.
    images: Vec<(&'static Format, Vec<Member>)>,
    /// Arrays with their first bytes.
    arrays: Vec<(Member, Vec<u8>)>,
    /// Slices that say where they lie.
    scans: usize,
}

impl Found {
    fn new(formats: &'static [Format]) -> Self {
        let ordered = formats.iter().filter(|f| f.has_ordered_slices());
        Found {
            formats,
            images: ordered.map(|format| (format, Vec::new())).collect(),
            arrays: Vec::new(),
            scans: 0,
        }
    }

    fn add(&mut self, path: &Path, archive: &Bytes, member: Member) -> Result<()> {
        let mut head = Vec::new();
        let damaged = |e| broken(path, &member, e);
        let most = npy::MAX_HEAD as u64;
        let mut reader = open(archive, &member).take(most);
        reader.read_to_end(&mut head).map_err(damaged)?;
        let mut placed = self.formats.iter().filter(|f| f.has_placed_slices());
        let image = self
            .images
            .iter_mut()
            .find(|(format, _)| (format.starts)(&head));
        if let Some((_, members)) = image {
            members.push(member);
        } else if npy::is_npy(&head) {
            self.arrays.push((member, head));
        } else if placed.any(|format| (format.starts)(&head)) {
            self.scans += 1;
        } else if let Some(title) = title_of(self.formats, &head) {
            let what = format!("a zip that holds {} ({title})", member.name);
            let hint = "unpack it, and give that file";
            return Err(Error::unsupported(path, what, hint));
        }
        Ok(())
    }
}

fn names(members: &[Member]) -> Vec<String> {
    members.iter().map(|m| m.name.clone()).collect()
}

/// The files of the archive in natural order.
fn members(path: &Path, archive: &Bytes) -> Result<Vec<Member>> {
    let wrong = |e: zip::result::ZipError| {
        Error::format(path, format!("a damaged zip archive ({e})"), "a whole one")
    };
    let reader = BufReader::new(archive.reader(0, archive.len()));
    let mut zip = ZipArchive::new(reader).map_err(wrong)?;
    if zip.len() > MAX_MEMBERS {
        let found = format!("a zip of {} members", zip.len());
        return Err(Error::format(path, found, format!("at most {MAX_MEMBERS}")));
    }
    let mut members = Vec::new();
    for i in 0..zip.len() {
        let file = zip.by_index_raw(i).map_err(wrong)?;
        let name = file.name().map_err(wrong)?.into_owned();
        let last = name.rsplit('/').next().unwrap_or_default();
        if [".zarray", ".zgroup", "zarr.json"].contains(&last) {
            return Err(Error::unsupported(
                path,
                "a Zarr in a zip file",
                "unpack it",
            ));
        }
        if last.is_empty() || last.starts_with('.') || name.starts_with("__MACOSX/") {
            continue;
        }
        let no = |what: &str| Error::unsupported(path, format!("{name}, {what},"), "unpack it");
        if file.encrypted() {
            return Err(no("encrypted in a zip"));
        }
        let deflated = match file.compression() {
            CompressionMethod::Stored => false,
            CompressionMethod::DEFLATE => true,
            method => return Err(no(&format!("packed by {method} in a zip"))),
        };
        let start = file.data_start().unwrap_or(u64::MAX);
        let (packed, size, crc) = (file.compressed_size(), file.size(), file.crc32());
        let end = start.checked_add(packed);
        if end.is_none_or(|end| end > archive.len()) || (!deflated && packed != size) {
            let found = format!("{name} of {packed} bytes at {start}");
            let expected = format!("a place in the {} bytes of the zip", archive.len());
            return Err(Error::format(path, found, expected));
        }
        members.push(Member {
            start,
            packed,
            size,
            crc,
            deflated,
            name: name.clone(),
        });
    }
    members.sort_by(|a, b| natural(&a.name, &b.name));
    Ok(members)
}

fn open(archive: &Bytes, member: &Member) -> Box<dyn Read> {
    let reader = archive.reader(member.start, member.packed);
    if member.deflated {
        Box::new(DeflateDecoder::new(reader))
    } else {
        Box::new(reader)
    }
}

fn broken(path: &Path, member: &Member, error: std::io::Error) -> Error {
    let found = format!("{} in the zip that is damaged ({error})", member.name);
    Error::format(path, found, format!("{} bytes unpacked", member.size))
}

/// The one three-dimensional array among the members.
fn numpy(path: &Path, arrays: Vec<(Member, Vec<u8>)>) -> Result<VolumeDescriptor> {
    let several = arrays.len() > 1;
    let mut found = Vec::new();
    let mut names = Vec::new();
    for (member, head) in &arrays {
        let array = npy::array(&path.join(&member.name), head);
        names.push(member.name.clone());
        match array {
            Ok(array) if several && !array.is_volume() => {}
            Err(Error::Unsupported { .. }) if several => {}
            array => found.push((member, array?)),
        }
    }
    let [(member, array)] = &found[..] else {
        let (count, names) = (found.len(), names.join(", "));
        let what = format!("a .npz of {count} arrays that could be the volume ({names})");
        return Err(Error::unsupported(
            path,
            what,
            "save the one to read as .npy",
        ));
    };
    let place = npy::Place {
        file: path.to_path_buf(),
        base: member.start,
        encoding: if member.deflated {
            Encoding::Deflate { crc: member.crc }
        } else {
            Encoding::Raw
        },
    };
    let descriptor = array.descriptor(path, place)?;
    let bytes = descriptor.dims.voxels() * descriptor.stored().bytes;
    if array.head + bytes > member.size {
        let found = format!("{} of {} bytes", member.name, member.size);
        let expected = format!("{} bytes, as its shape and type say", array.head + bytes);
        return Err(Error::format(path, found, expected));
    }
    Ok(descriptor)
}

/// Members as bytes that can be read at any place.
fn unpack(path: &Path, archive: &Bytes, members: Vec<Member>) -> Result<Vec<Blob>> {
    let dir = std::env::temp_dir();
    let fail = |e| Error::io(&dir, "unpack a zip archive", e);
    let wanted: u128 = members
        .iter()
        .filter(|m| m.deflated)
        .map(|m| u128::from(m.size))
        .sum();
    let stat = rustix::fs::statvfs(&dir).map_err(|e| fail(e.into()))?;
    if wanted > u128::from(stat.f_bavail) * u128::from(stat.f_frsize) {
        let what = format!("a zip that unpacks to {wanted} bytes, more than there is room for,");
        let hint = "unpack it yourself, or set TMPDIR to a folder on a larger disk";
        return Err(Error::unsupported(path, what, hint));
    }
    let mut file = tempfile::tempfile_in(&dir).map_err(fail)?;
    let mut places = Vec::new();
    let mut at = 0;
    for member in &members {
        if member.deflated {
            places.push(at);
            copy(path, archive, member, &mut file).map_err(|e| e.unwrap_or_else(fail))?;
            at += member.size;
        } else {
            places.push(member.start);
        }
    }
    let unpacked = Arc::new(store::File::from(file));
    let packed = archive.file();
    Ok(members
        .into_iter()
        .zip(places)
        .map(|(member, place)| {
            let file = if member.deflated { &unpacked } else { &packed };
            let shown: PathBuf = path.join(&member.name);
            Blob::part(shown, file.clone(), place, member.size)
        })
        .collect())
}

/// An error of the archive, or one of the system while writing.
enum Failure {
    Archive(Error),
    Disk(std::io::Error),
}

impl Failure {
    fn unwrap_or_else(self, fail: impl Fn(std::io::Error) -> Error) -> Error {
        match self {
            Failure::Archive(error) => error,
            Failure::Disk(error) => fail(error),
        }
    }
}

/// Unpacks a member and compares its size and checksum.
fn copy(
    path: &Path,
    archive: &Bytes,
    member: &Member,
    to: &mut File,
) -> std::result::Result<(), Failure> {
    let mut reader = open(archive, member).take(member.size.saturating_add(1));
    let mut buffer = vec![0; 1 << 18];
    let (mut done, mut crc) = (0, crc32fast::Hasher::new());
    loop {
        let n = reader
            .read(&mut buffer)
            .map_err(|e| Failure::Archive(broken(path, member, e)))?;
        if n == 0 {
            break;
        }
        crc.update(&buffer[..n]);
        done += n as u64;
        to.write_all(&buffer[..n]).map_err(Failure::Disk)?;
    }
    if done != member.size || crc.finalize() != member.crc {
        let error = std::io::Error::other(format!("{done} bytes, or another checksum"));
        return Err(Failure::Archive(broken(path, member, error)));
    }
    Ok(())
}
