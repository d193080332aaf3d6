//! Where a NRRD header says that its samples are: in the same file, in another, or in many.

use crate::error::{Error, Result};
use crate::volume::formats::nrrd::{Head, is_list};
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text::{self, Field};
use std::path::{Path, PathBuf};

impl<'a> Head<'a> {
    fn encoding(&self) -> Result<Encoding> {
        let field = self.need("encoding")?;
        match field.text.to_ascii_lowercase().as_str() {
            "raw" => Ok(Encoding::Raw),
            "gzip" | "gz" => Ok(Encoding::Gzip),
            name @ ("txt" | "text" | "ascii" | "hex" | "bzip2" | "bz2" | "zrl") => {
                Err(Error::unsupported(
                    self.path,
                    format!("the NRRD encoding `{name}`"),
                    "convert it with `unu save -f nrrd -e raw` (or gzip)",
                ))
            }
            _ => Err(field.wrong("raw or gzip")),
        }
    }

    /// Reads how and where the samples are stored.
    ///
    /// # Errors
    /// [`Error::Unsupported`] by name for encodings that are not read, [`Error::Format`] for fields that contradict
    /// each other.
    pub(crate) fn data(&self) -> Result<Data> {
        let encoding = self.encoding()?;
        let skip = |name: &'a str| self.get(name).map(|f| f.one::<i64>("a number")).transpose();
        let (lines, bytes) = (skip("line skip")?, skip("byte skip")?);
        let (files, base) = match self.get("data file") {
            Some(field) => (self.data_files(field)?, 0),
            None => match self.end {
                Some(end) => (vec![self.path.to_path_buf()], end),
                None => {
                    return Err(Error::format(
                        self.path,
                        "a header without an end",
                        "a blank line and the samples, or a field `data file`",
                    ));
                }
            },
        };
        let stated = base > 0 || lines.is_some() || bytes.is_some();
        let lines = u64::try_from(lines.unwrap_or(0))
            .map_err(|_| Error::format(self.path, "a `line skip` below 0", "0 or more"))?;
        let start = match u64::try_from(bytes.unwrap_or(0)) {
            Ok(bytes) => Start::At {
                base,
                lines,
                bytes,
                stated,
            },
            Err(_) if encoding != Encoding::Raw => {
                return Err(Error::format(
                    self.path,
                    "a `byte skip` below 0 with compressed samples",
                    "0 or more",
                ));
            }
            // -1: the samples are the file's last bytes; -2: one byte follows them; ...
            Err(_) => Start::End {
                spare: bytes.unwrap_or(-1).unsigned_abs() - 1,
            },
        };
        Ok(Data {
            files,
            start,
            encoding,
        })
    }

    fn data_files(&self, field: Field) -> Result<Vec<PathBuf>> {
        let words: Vec<&str> = field.text.split_whitespace().take(6).collect();
        let sizes = &self.sizes;
        let per_file = |word: Option<&&str>| {
            let subdim = match word {
                None => sizes.len() - 1,
                Some(word) => word.parse().unwrap_or(0),
            };
            let fits = (1..=sizes.len()).contains(&subdim);
            let expected = || field.wrong(format!("a subdimension of 1 to {}", sizes.len()));
            fits.then_some(subdim).ok_or_else(expected)
        };
        let names = if is_list(field.text) {
            let subdim = per_file(words.get(1))?;
            check_count(field, sizes, subdim, self.list.len() as u64)?;
            self.list.clone()
        } else if words.len() >= 4 && words[0].contains('%') {
            let subdim = per_file(words.get(4))?;
            let range = [1, 2, 3].map(|w| words[w].parse::<i64>());
            let [Ok(first), Ok(last), Ok(step)] = range else {
                return Err(field.wrong("a pattern, first and last number and step"));
            };
            let count = if subdim == sizes.len() && step != 0 {
                (i128::from(last) - i128::from(first))
                    .div_euclid(i128::from(step))
                    .clamp(0, i128::from(u32::MAX)) as u64
                    + 1
            } else {
                parts(sizes, subdim.min(sizes.len() - 1))
            };
            check_count(field, sizes, subdim, count)?;
            text::numbered(field, words[0], [first, last, step], count)?
        } else {
            vec![field.text.to_owned()]
        };
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Ok(names.into_iter().map(|name| folder.join(name)).collect())
    }
}

/// More data files than slices can be are refused before their names take up memory.
const MAX_FILES: u64 = 1 << 20;

/// Parts of `subdim` dimensions in a volume.
fn parts(sizes: &[u64], subdim: usize) -> u64 {
    sizes[subdim..]
        .iter()
        .fold(1, |n, size| n.saturating_mul(*size))
}

/// Checks that `count` files that each have `subdim` dimensions make up the volume: files of a row,
/// of a slice, or slabs of as many slices each.
fn check_count(field: Field, sizes: &[u64], subdim: usize, count: u64) -> Result<()> {
    let last = sizes[sizes.len() - 1];
    let need = parts(sizes, subdim);
    let (fits, expected) = match sizes.len() - subdim {
        0 => (
            count > 0 && last.is_multiple_of(count),
            format!("a number of files that divides the {last} slices"),
        ),
        1 => (count == need, format!("{need} files, one per slice")),
        2 => (count == need, format!("{need} files, one per row")),
        _ => (count == need, format!("{need} files")),
    };
    if fits && count > MAX_FILES {
        let what = format!("a volume in {count} files");
        return Err(Error::unsupported(
            field.path,
            what,
            "write slices or slabs",
        ));
    }
    if fits {
        return Ok(());
    }
    Err(Error::format(
        field.path,
        format!("{count} data files"),
        expected,
    ))
}
