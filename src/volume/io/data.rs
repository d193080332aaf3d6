//! Files that hold the samples of a volume, and the byte source that they make.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::store::{self, File, is_remote};
use crate::volume::Io;
use crate::volume::io::byte_source::{ByteSource, FileSource, MapSource, Part, PartsSource};
use crate::volume::io::mmap::Map;
use crate::volume::io::stream::{StreamLayout, StreamSource};
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Where the samples are.
#[derive(Debug)]
pub(crate) struct Data {
    /// Files of equal share, in the order of the samples; at least one.
    pub(crate) files: Vec<PathBuf>,
    pub(crate) start: Start,
    pub(crate) encoding: Encoding,
}

/// Size and type of samples as files hold them, which may be others than those that are handed out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stored {
    /// Samples along each axis, the fastest first.
    pub(crate) dims: Dims,
    /// Bytes of a sample.
    pub(crate) bytes: u64,
    /// The name of its type.
    pub(crate) name: &'static str,
}

impl Stored {
    fn slice_bytes(&self) -> u64 {
        self.dims.slice_voxels() * self.bytes
    }
}

/// Where in each file the samples begin.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Start {
    /// `lines` lines and then `bytes` bytes after the first `base` bytes. For compressed data the
    /// bytes are counted in the decoded stream.
    At {
        base: u64,
        lines: u64,
        bytes: u64,
        /// Somebody said where the samples begin, so bytes after their end are harmless. Where
        /// nobody did, a file that is too long hints at a header of unknown size.
        stated: bool,
    },
    /// The samples end this many bytes before the file's end.
    End { spare: u64 },
}

impl Start {
    /// Right at the file's beginning, which nobody stated.
    pub(crate) const UNSTATED: Start = Start::At {
        base: 0,
        lines: 0,
        bytes: 0,
        stated: false,
    };

    /// Behind so many bytes, as somebody stated.
    pub(crate) const fn behind(bytes: u64) -> Start {
        Start::At {
            base: 0,
            lines: 0,
            bytes,
            stated: true,
        }
    }
}

/// How the samples are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Raw,
    Zlib,
    Gzip,
    /// A bare stream, with the checksum of what it unpacks to: a member of a zip archive.
    Deflate {
        crc: u32,
    },
    /// Amira's run lengths of bytes, so many packed bytes.
    ByteRle {
        packed: u64,
    },
}

/// Opens the data files of a volume.
pub(crate) fn source(stored: &Stored, data: &Data, io: Io) -> Result<Box<dyn ByteSource>> {
    // at most 2^48 samples of 8 bytes
    let total = stored.dims.voxels() * stored.bytes;
    let part_bytes = total / data.files.len() as u64;
    if data.encoding != Encoding::Raw {
        return compressed(stored, data, part_bytes);
    }
    let what = format!("{} of {}", stored.dims, stored.name);
    let parts = data
        .files
        .iter()
        .map(|path| {
            let offset = locate(path, data, part_bytes, &what)?;
            Ok(Part {
                path: path.clone(),
                offset,
            })
        })
        .collect::<Result<Vec<_>>>()?;
    if let [part] = &parts[..] {
        let file = open_file(&part.path)?;
        return Ok(match (io, file.local()) {
            (Io::Mmap, Some(file)) => Box::new(MapSource(Map::new(
                &part.path,
                file,
                part.offset,
                part_bytes,
            )?)),
            (Io::Mmap, None) => {
                return Err(Error::usage("--io", "mmap of a file in a bucket", "read"));
            }
            (Io::Read, _) => Box::new(FileSource {
                file: file.into(),
                path: part.path.clone(),
                offset: part.offset,
            }),
        });
    }
    Ok(Box::new(PartsSource { parts, part_bytes }))
}

/// Opens the compressed data files of a header.
fn compressed(stored: &Stored, data: &Data, part_bytes: u64) -> Result<Box<dyn ByteSource>> {
    let Start::At {
        base, lines, bytes, ..
    } = data.start
    else {
        // the parsers refuse it: where a compressed stream begins cannot be told from its end
        return Err(Error::unsupported(
            &data.files[0],
            "a compressed stream that is placed from the file's end",
            "",
        ));
    };
    let parts = data.files.iter().map(|path| {
        let len = file_len(path)?;
        let offset = skip_lines(path, base, lines)?;
        let most = len.saturating_sub(offset).saturating_mul(MAX_RATIO);
        if most < part_bytes.saturating_add(bytes) {
            return Err(Error::format(
                path,
                format!("{} compressed bytes", len.saturating_sub(offset)),
                format!(
                    "enough for {part_bytes} bytes of samples ({} of {})",
                    stored.dims, stored.name
                ),
            )
            .with_hint("the file is cut short, or the size or sample type is wrong"));
        }
        Ok(Part {
            path: path.clone(),
            offset,
        })
    });
    Ok(Box::new(StreamSource::new(StreamLayout {
        parts: parts.collect::<Result<_>>()?,
        encoding: data.encoding,
        skip: bytes,
        part_bytes,
        slice_bytes: stored.slice_bytes(),
    })))
}

/// Deflate cannot pack tighter: 258 bytes in 2 bits (<https://zlib.net/zlib_tech.html>). A header
/// that claims more is refused before anything is allocated for it.
const MAX_RATIO: u64 = 1032;

/// Opens a regular file for reading; anything else is refused, see [`file_len`].
pub(crate) fn open_file(path: &Path) -> Result<File> {
    // an object is no pipe, and is asked for once
    if !is_remote(path) {
        file_len(path)?;
    }
    File::open(path).map_err(|e| Error::io(path, "open", e))
}

/// The length of a regular file; anything else is refused before it is opened, since opening a pipe
/// can block for ever.
pub(crate) fn file_len(path: &Path) -> Result<u64> {
    let meta = store::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    if meta.is_file {
        return Ok(meta.len);
    }
    let found = if meta.is_dir {
        "a directory"
    } else {
        "a device or pipe"
    };
    Err(Error::format(path, found, "a file"))
}

/// What a user should know of a file whose header describes less than there is: whole slices more.
pub(crate) fn more_than_described(stored: &Stored, data: &Data) -> Result<Option<String>> {
    let (
        [path],
        Encoding::Raw,
        &Start::At {
            base, lines, bytes, ..
        },
    ) = (&data.files[..], &data.encoding, &data.start)
    else {
        return Ok(None);
    };
    let slice = stored.slice_bytes();
    let begin = skip_lines(path, base, lines)?.saturating_add(bytes);
    let end = begin.saturating_add(slice * u64::from(stored.dims.0[2]));
    let spare = file_len(path)?.saturating_sub(end);
    Ok((spare >= slice).then(|| {
        format!(
            "{spare} bytes behind the samples are not read: are {} of {} right?",
            stored.dims, stored.name
        )
    }))
}

/// The offset of the first sample in a data file that must hold `need` sample bytes.
fn locate(path: &Path, data: &Data, need: u64, what: &str) -> Result<u64> {
    let len = file_len(path)?;
    let (base, lines, bytes, stated) = match data.start {
        Start::End { spare } => {
            let offset = len.checked_sub(need).and_then(|n| n.checked_sub(spare));
            return offset.ok_or_else(|| {
                Error::format(
                    path,
                    format!("{len} bytes"),
                    format!("at least {need} bytes of samples and {spare} after them ({what})"),
                )
            });
        }
        Start::At {
            base,
            lines,
            bytes,
            stated,
        } => (base, lines, bytes, stated),
    };
    let base = skip_lines(path, base, lines)?;
    let offset = base.saturating_add(bytes);
    let end = offset.saturating_add(need);
    if len < end {
        return Err(Error::format(
            path,
            format!("{len} bytes"),
            format!("{end} bytes = {offset} before the samples + {need} of samples ({what})"),
        )
        .with_hint("the file is cut short, or the size or sample type is wrong"));
    }
    if len > end && !stated {
        let spare = len - end;
        return Err(Error::format(
            path,
            format!("{len} bytes, {spare} more than the samples need"),
            format!("{need} bytes of samples ({what})"),
        )
        .with_hint(format!(
            "if size and type are right, say where the samples begin: for a raw file --offset {spare} \
             skips as many bytes in front and --offset 0 ignores those behind; in a header use \
             `byte skip` (NRRD) or `HeaderSize` (MetaImage)"
        )));
    }
    Ok(offset)
}

/// The position after `lines` line ends, counted from `base`.
fn skip_lines(path: &Path, base: u64, lines: u64) -> Result<u64> {
    if lines == 0 {
        return Ok(base);
    }
    let mut reader = BufReader::new(open_file(path)?);
    let fail = |e| Error::io(path, "read", e);
    reader.seek(SeekFrom::Start(base)).map_err(fail)?;
    let mut position = base;
    for line in 0..lines {
        let n = reader.skip_until(b'\n').map_err(fail)?;
        if n == 0 {
            return Err(Error::format(
                path,
                format!("{line} lines"),
                format!("the {lines} lines to skip and the samples"),
            ));
        }
        position += n as u64;
    }
    Ok(position)
}
