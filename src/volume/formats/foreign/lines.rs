//! Headers of other programs that are text.

use crate::volume::Endian;
use crate::volume::formats::foreign::described::{Described, dtype_of, of_bits};
use std::path::{Path, PathBuf};

/// Words after keys, in lower case, in the order of the file.
struct Keys(Vec<(String, String)>);

impl Keys {
    /// Lines of `key = value` or `key: value`.
    fn of_lines(head: &[u8]) -> Self {
        let text = String::from_utf8_lossy(head);
        let pair = |line: &str| {
            let (key, value) = line.split_once(['=', ':'])?;
            Some((
                key.trim().to_lowercase(),
                value.trim().trim_end_matches(';').trim().to_owned(),
            ))
        };
        Keys(text.lines().filter_map(pair).collect())
    }

    fn get(&self, key: &str) -> Option<&str> {
        let found = self.0.iter().find(|(k, v)| k == key && !v.is_empty());
        found.map(|(_, value)| value.as_str())
    }

    fn number<T: std::str::FromStr>(&self, key: &str) -> Option<T> {
        self.get(key)?.split_whitespace().next()?.parse().ok()
    }

    fn numbers<T: std::str::FromStr>(&self, key: &str) -> Option<[T; 3]> {
        three(self.get(key)?)
    }

    fn each<T: std::str::FromStr>(&self, keys: [&str; 3]) -> Option<[T; 3]> {
        let [x, y, z] = keys.map(|key| self.number(key));
        Some([x?, y?, z?])
    }
}

/// Three numbers between spaces.
fn three<T: std::str::FromStr>(text: &str) -> Option<[T; 3]> {
    let values: Option<Vec<T>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    values?.try_into().ok()
}

/// A file named in a header, perhaps with folders of another machine.
fn beside(path: &Path, name: &str) -> PathBuf {
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    path.with_file_name(last.trim_matches('"'))
}

/// The `.raw.ini` of UnityVolumeRendering.
pub(crate) fn raw_ini(path: &Path, head: &[u8]) -> Option<Described> {
    let keys = Keys::of_lines(head);
    let dims = keys.each(["dimx", "dimy", "dimz"])?;
    let mut described = Described::new(
        path.with_extension(""),
        dims,
        dtype_of(keys.get("format")?)?,
    );
    described.offset = keys.number("skip").unwrap_or(0);
    if keys
        .get("endianness")
        .is_some_and(|e| e.to_lowercase().starts_with("big"))
    {
        described.endian = Endian::Big;
    }
    Some(described)
}

/// The `.dat` of volume renderers: `ObjectFileName`, `Resolution`, `Format`.
pub(crate) fn dat(path: &Path, head: &[u8]) -> Option<Described> {
    let keys = Keys::of_lines(head);
    let file = beside(path, keys.get("objectfilename")?);
    let mut described = Described::new(
        file,
        keys.numbers("resolution")?,
        dtype_of(keys.get("format")?)?,
    );
    described.remark = "a SliceThickness there has no unit".into();
    Some(described)
}

/// ESRF's EDF: a block of text between braces, filled up to 512 bytes, then samples.
pub(crate) fn edf(path: &Path, head: &[u8]) -> Option<Described> {
    let end = head.windows(2).position(|w| w == b"}\n")? + 2;
    let keys = Keys::of_lines(&head[..end]);
    let dims = keys.each(["dim_1", "dim_2", "dim_3"])?;
    let name = keys.get("datatype")?.to_lowercase();
    let long = |name: &str| name.replace("long", "int").replace("integer", "int");
    let mut described = Described::new(path.to_path_buf(), dims, dtype_of(&long(&name))?);
    described.offset = end as u64;
    if keys
        .get("byteorder")
        .is_some_and(|order| order.starts_with("High"))
    {
        described.endian = Endian::Big;
    }
    Some(described)
}

/// VTK's legacy format with structured points.
pub(crate) fn vtk(path: &Path, head: &[u8]) -> Option<Described> {
    let mut position = 0;
    let (mut keys, mut cells, mut scalars) = (Vec::new(), false, None);
    // samples begin behind the line of the table of colours, or behind that of the scalars
    for line in head.split_inclusive(|b| *b == b'\n') {
        let text = String::from_utf8_lossy(line).trim().to_owned();
        if scalars.is_some() && !text.starts_with("LOOKUP_TABLE") {
            break;
        }
        position += line.len() as u64;
        let (key, value) = text.split_once(' ').unwrap_or((&text, ""));
        match key {
            "CELL_DATA" => cells = true,
            "SCALARS" => scalars = Some(value.to_owned()),
            "LOOKUP_TABLE" => break,
            _ => keys.push((key.to_lowercase(), value.to_owned())),
        }
    }
    let keys = Keys(keys);
    let plain = keys.0.iter().any(|(key, _)| key == "binary");
    let points = keys.get("dataset") == Some("STRUCTURED_POINTS");
    let scalars = scalars.filter(|_| plain && points)?;
    let words: Vec<&str> = scalars.split_whitespace().collect();
    let dims: [u64; 3] = keys.numbers("dimensions")?;
    let dims = dims.map(|n| if cells { n.saturating_sub(1) } else { n });
    if words.get(2).is_some_and(|components| *components != "1") {
        return None;
    }
    let mut described = Described::new(path.to_path_buf(), dims, dtype_of(words.get(1)?)?);
    described.offset = position;
    described.endian = Endian::Big;
    if let Some(size) = keys
        .numbers::<f64>("spacing")
        .or_else(|| keys.numbers("aspect_ratio"))
    {
        let [x, y, z] = size;
        described.remark = format!(
            "a voxel is {x},{y},{z} in a unit that the file does not state: add --spacing and --unit"
        );
    }
    Some(described)
}

/// Sun's and GE's `.vff`: text up to a form feed, then samples with the most significant byte first.
pub(crate) fn vff(path: &Path, head: &[u8]) -> Option<Described> {
    let end = head.windows(2).position(|w| w == b"\x0c\n")? + 2;
    let keys = Keys::of_lines(&head[..end]);
    let kind = match keys.number::<u64>("bits")? {
        8 => "unsigned",
        _ => "signed",
    };
    let dtype = of_bits(kind, keys.number("bits")?)?;
    let mut described = Described::new(path.to_path_buf(), keys.numbers("size")?, dtype);
    described.offset = end as u64;
    described.endian = Endian::Big;
    if let Some(size) = keys.number::<f64>("elementsize") {
        let steps: [f64; 3] = keys.numbers("spacing").unwrap_or([1.0; 3]);
        described.spacing = Some((steps.map(|s| s * size), "mm"));
    }
    Some(described)
}
