//! Text headers: bounded lines, numbers, numbered file names, axes.

use crate::error::{Error, Result};
use crate::store::File;
use crate::volume::io::data;
use std::borrow::Cow;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// No header is longer: one with a list of 65,536 file names of 200 bytes fits.
const MAX_HEADER: u64 = 16 << 20;

/// The lines of a header and the position behind the last one that was read.
pub(crate) struct Lines {
    reader: BufReader<File>,
    path: PathBuf,
    position: u64,
}

impl Lines {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Ok(Lines {
            reader: BufReader::new(data::open_file(path)?),
            path: path.to_path_buf(),
            position: 0,
        })
    }

    /// The next line without its end (LF or CRLF); `None` at the file's end.
    pub(crate) fn next(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        let room = MAX_HEADER - self.position;
        let n = (&mut self.reader)
            .take(room)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io(&self.path, "read", e))? as u64;
        self.position += n;
        if n == room {
            return Err(Error::format(
                &self.path,
                format!("a header of more than {MAX_HEADER} bytes"),
                "a text header in front of the samples",
            ));
        }
        if n == 0 {
            return Ok(None);
        }
        let text = decoded(&line);
        Ok(Some(text.trim_end_matches(['\n', '\r']).to_owned()))
    }

    /// Bytes read so far.
    pub(crate) fn position(&self) -> u64 {
        self.position
    }
}

/// Text of a header: UTF-8, whose mark may stand in front, or else what older programs write, Latin-1.
pub(crate) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match std::str::from_utf8(text) {
        Ok(text) => text.into(),
        Err(_) => text.iter().map(|&b| char::from(b)).collect(),
    }
}

/// A field of a header, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field<'a> {
    pub(crate) path: &'a Path,
    pub(crate) name: &'a str,
    pub(crate) text: &'a str,
}

impl Field<'_> {
    /// The error that this field is not what it should be.
    pub(crate) fn wrong(&self, expected: impl Into<String>) -> Error {
        let text: String = self.text.chars().take(80).collect();
        Error::format(self.path, format!("`{}: {text}`", self.name), expected)
    }

    /// One value.
    pub(crate) fn one<T: FromStr>(&self, expected: &str) -> Result<T> {
        let text = self.text.trim();
        text.parse().map_err(|_| self.wrong(expected))
    }

    /// Exactly `count` values between spaces.
    pub(crate) fn values<T: FromStr>(&self, count: usize) -> Result<Vec<T>> {
        let words = self.text.split_whitespace().take(count + 1);
        let values: Option<Vec<T>> = words.map(|word| word.parse().ok()).collect();
        values
            .filter(|v| v.len() == count)
            .ok_or_else(|| self.wrong(format!("{count} numbers")))
    }

    /// Of one value for each of `count` axes, those of three axes.
    pub(crate) fn of_axes<T: FromStr + Copy>(
        &self,
        count: usize,
        axes: [usize; 3],
    ) -> Result<[T; 3]> {
        let values = self.values::<T>(count)?;
        Ok(axes.map(|axis| values[axis]))
    }
}

/// The three axes that are left once those of one entry are; `None` if there are more or fewer. Three axes are
/// kept whatever their sizes.
pub(crate) fn kept_axes(sizes: &[u64]) -> Option<[usize; 3]> {
    let long = |axis: &usize| sizes.len() == 3 || sizes[*axis] != 1;
    let axes: Vec<usize> = (0..sizes.len()).filter(long).collect();
    axes.try_into().ok()
}

/// File names `pattern` with the numbers `first`, `first + step`, ... up to `last`, of which there
/// must be `count`.
pub(crate) fn numbered(
    field: Field,
    pattern: &str,
    [first, last, step]: [i64; 3],
    count: u64,
) -> Result<Vec<String>> {
    let steps = match step {
        0 => return Err(field.wrong("a step other than 0")),
        _ => (i128::from(last) - i128::from(first)).div_euclid(i128::from(step)),
    };
    if steps + 1 != i128::from(count) {
        let found = (steps + 1).max(0);
        return Err(field.wrong(format!(
            "the numbers of {count} files, as the size of the volume asks for, not of {found}"
        )));
    }
    let pattern = Pattern::parse(pattern)
        .ok_or_else(|| field.wrong("a file name with one number, such as slice_%04d.raw"))?;
    let names = (0..count as i128).map(|i| pattern.name(i128::from(first) + i * i128::from(step)));
    Ok(names.collect())
}

/// A file name with one printf number: `%d`, `%04d`, `%.3d`.
pub(crate) struct Pattern {
    before: String,
    after: String,
    width: usize,
    digits: usize,
    zeros: bool,
}

impl Pattern {
    /// Reads a name; `None` if it has no such number, or several.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        // a percent sign that stands for itself is written twice
        let text = text.replace("%%", "\0");
        let (before, rest) = text.split_once('%')?;
        let end = rest.find(['d', 'i', 'u'])?;
        let (format, after) = (&rest[..end], &rest[end + 1..]);
        let (width, digits) = match format.split_once('.') {
            Some((width, digits)) => (width, Some(digits)),
            None => (format, None),
        };
        let number = |text: &str| match text {
            "" => Some(0),
            _ => text.parse().ok().filter(|&n| n <= 64),
        };
        let plain = |text: &str| text.replace('\0', "%");
        (!after.contains('%')).then_some(())?;
        Some(Pattern {
            before: plain(before),
            after: plain(after),
            width: number(width)?,
            digits: number(digits.unwrap_or_default())?,
            zeros: width.starts_with('0') && digits.is_none(),
        })
    }

    /// True for a name that the pattern gives for some number from 0 up.
    pub(crate) fn matches(&self, name: &str) -> bool {
        let inside = name.strip_prefix(self.before.as_str());
        let digits = inside.and_then(|rest| rest.strip_suffix(self.after.as_str()));
        let number = digits.and_then(|digits| digits.trim_start().parse::<u64>().ok());
        number.is_some_and(|n| self.name(n.into()) == name)
    }

    fn name(&self, n: i128) -> String {
        let sign = if n < 0 { "-" } else { "" };
        let at_least = if self.zeros {
            self.width.saturating_sub(sign.len())
        } else {
            self.digits
        };
        let number = format!("{sign}{:0at_least$}", n.unsigned_abs());
        format!("{}{number:>2$}{}", self.before, self.after, self.width)
    }
}

/// Three axis vectors as lengths and directions, so that nothing is mirrored or scaled on the way.
/// Lengths may come out as 0 or not finite, which the caller checks after options had their say.
pub(crate) fn axes(field: Field, vectors: [[f64; 3]; 3]) -> Result<([f64; 3], [[f64; 3]; 3])> {
    let vectors = vectors.map(glam::DVec3::from);
    let lengths = vectors.map(|v| v.length());
    let directions: [_; 3] = std::array::from_fn(|a| vectors[a] / lengths[a]);
    let volume = directions[0].cross(directions[1]).dot(directions[2]);
    if volume.is_finite() && volume.abs() > 1e-6 {
        // adding 0 turns -0 into 0
        Ok((
            lengths,
            directions.map(|axis| (axis + glam::DVec3::ZERO).into()),
        ))
    } else {
        Err(field.wrong("three directions that do not lie in one plane"))
    }
}

/// Sizes behind a word, ` (4 x 2)`; nothing where there are none.
pub(crate) fn in_brackets(size: &[String]) -> String {
    match size.is_empty() {
        true => String::new(),
        false => format!(" ({})", size.join(" x ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_older_programs_is_latin_1() {
        assert_eq!(decoded("\u{b5}m, \u{3bc}m".as_bytes()), "\u{b5}m, \u{3bc}m");
        assert_eq!(decoded(b"\xb5m"), "\u{b5}m");
        assert_eq!(decoded(b"\xef\xbb\xbf[XTekCT]"), "[XTekCT]");
        assert_eq!(decoded(b""), "");
    }

    #[test]
    fn patterns_print_as_printf_does() {
        for (pattern, n, name) in [
            ("quarter.%d", 93, "quarter.93"),
            ("s_%04d.raw", 7, "s_0007.raw"),
            ("s_%04d.raw", -7, "s_-007.raw"),
            ("s_%4d.raw", 7, "s_   7.raw"),
            ("s_%.3d.raw", 12345, "s_12345.raw"),
            ("s_%6.3d", 12, "s_   012"),
            ("100%%_%03u", 1, "100%_001"),
        ] {
            assert_eq!(Pattern::parse(pattern).unwrap().name(n), name, "{pattern}");
        }
        let pattern = Pattern::parse("s_%04d.raw").unwrap();
        for (name, fits) in [
            ("s_0007.raw", true),
            ("s_12345.raw", true),
            ("s_7.raw", false),
            ("s_00007.raw", false),
            ("s_.raw", false),
            ("s_0007.tif", false),
        ] {
            assert_eq!(pattern.matches(name), fits, "{name}");
        }
        for bad in ["plain", "%s", "%d%d", "%999d", "%-3d", "%ld"] {
            assert!(Pattern::parse(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn axes_of_one_entry_go() {
        for (sizes, kept) in [
            (&[4, 1, 3][..], Some([0, 1, 2])),
            (&[4, 5, 3, 1], Some([0, 1, 2])),
            (&[1, 4, 5, 3], Some([1, 2, 3])),
            (&[4, 1, 5, 1, 3], Some([0, 2, 4])),
            (&[4, 5, 3, 2], None),
            (&[4, 5, 1, 1], None),
            (&[4, 5], None),
        ] {
            assert_eq!(kept_axes(sizes), kept, "{sizes:?}");
        }
    }

    #[test]
    fn numbers_must_match_the_count() {
        let field = Field {
            path: Path::new("f"),
            name: "data file",
            text: "p",
        };
        let names = |range, count| numbered(field, "%d", range, count);
        assert_eq!(names([3, 1, -1], 3).unwrap(), ["3", "2", "1"]);
        assert_eq!(names([0, 5, 2], 3).unwrap(), ["0", "2", "4"]);
        for bad in [[1, 4, 1], [1, 3, 0], [3, 1, 1], [i64::MIN, i64::MAX, 1]] {
            assert!(names(bad, 3).is_err(), "{bad:?}");
        }
    }
}
