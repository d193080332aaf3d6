//! Which of the files' frames are the volume.

use crate::error::{Error, Result};
use crate::volume::formats::dicom::agree;
use crate::volume::formats::dicom::cell::Cell;
use crate::volume::formats::dicom::frame::{Frame, Image, Series};
use crate::words::counted;
use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Frames of one series, size, kind and orientation.
#[derive(Debug)]
pub(crate) struct Candidate {
    pub(crate) series: Series,
    /// What `--series` takes: the series' number, with a letter where it falls into several parts.
    pub(crate) key: String,
    pub(crate) size: [u32; 2],
    pub(crate) cell: Cell,
    pub(crate) frames: Vec<Frame>,
}

/// The most series that a message lists.
const LISTED: usize = 30;

impl Candidate {
    /// One line of a list.
    fn line(&self) -> String {
        let Series {
            uid,
            description,
            modality,
            ..
        } = &self.series;
        let [x, y] = self.size;
        let mut line = format!("{}: {x} x {y} x {}", self.key, self.frames.len());
        for text in [modality, description, uid] {
            if !text.is_empty() {
                let _ = write!(line, ", {text}");
            }
        }
        line
    }
}

/// Files of one instance: one of them counts.
#[derive(Debug, Default)]
pub(crate) struct Twice {
    count: usize,
    /// The first such pair.
    first: Option<[PathBuf; 2]>,
}

impl Twice {
    /// What to say of them, if there are any.
    pub(crate) fn note(&self) -> Option<String> {
        let [one, other] = self.first.as_ref()?;
        let files = counted(self.count as u64, "file comes", "files come");
        Some(format!(
            "{files} twice, as {} and {}: one of each counts",
            one.display(),
            other.display()
        ))
    }
}

/// Sorts frames into candidates, by the series' number. A file that comes twice counts once; the
/// files left out are returned too.
pub(crate) fn candidates(images: &[Image]) -> (Vec<Candidate>, Twice) {
    let mut out: Vec<Candidate> = Vec::new();
    let (mut seen, mut twice) = (HashMap::new(), Twice::default());
    for image in images {
        let own = image.blob.path();
        if !image.instance.is_empty()
            && let Some(other) = seen.insert(&image.instance, own)
        {
            twice.count += 1;
            twice
                .first
                .get_or_insert([other.to_path_buf(), own.to_path_buf()]);
            continue;
        }
        for frame in &image.frames {
            // a series' frames follow each other
            let takes = |c: &&mut Candidate| {
                let first = &c.frames[0];
                let of = (&images[first.file as usize], first);
                image.series.same(&of.0.series) && agree::difference(of, (image, frame)).is_none()
            };
            let found = out.iter_mut().rev().find(takes);
            match found {
                Some(candidate) => candidate.frames.push(frame.clone()),
                None => out.push(Candidate {
                    series: image.series.clone(),
                    key: String::new(),
                    size: image.size,
                    cell: image.cell,
                    frames: vec![frame.clone()],
                }),
            }
        }
    }
    let number = |c: &Candidate| c.series.number.parse::<i64>().unwrap_or(i64::MAX);
    out.sort_by(|a, b| (number(a), &a.series).cmp(&(number(b), &b.series)));
    name(&mut out);
    (out, twice)
}

/// Gives every candidate a key of its own.
fn name(candidates: &mut [Candidate]) {
    let names: Vec<String> = candidates
        .iter()
        .enumerate()
        .map(|(i, c)| match c.series.number.as_str() {
            "" => format!("#{}", i + 1),
            number => number.to_owned(),
        })
        .collect();
    for (i, candidate) in candidates.iter_mut().enumerate() {
        let before = names[..i].iter().filter(|n| **n == names[i]).count();
        let alone = names.iter().filter(|n| **n == names[i]).count() == 1;
        candidate.key = match alone {
            true => names[i].clone(),
            false => format!("{}.{}", names[i], before + 1),
        };
    }
}

/// The candidate that `wanted` names, or the only one of at least two slices.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several or none of that name, [`Error::Format`] if
/// there is none at all.
pub(crate) fn choose(
    path: &Path,
    mut candidates: Vec<Candidate>,
    images: &[Image],
    wanted: Option<&str>,
) -> Result<Candidate> {
    let fits = |c: &Candidate| match wanted {
        Some(name) => c.key == name || c.series.uid == name || c.series.description == name,
        None => c.frames.len() > 1,
    };
    let mut found: Vec<usize> = (0..candidates.len())
        .filter(|&i| fits(&candidates[i]))
        .collect();
    if found.len() > 1 && wanted.is_some() {
        // a scout in the same series is not what is meant
        found.retain(|&i| candidates[i].frames.len() > 1);
    }
    match found[..] {
        [one] if candidates[one].frames.len() > 1 => Ok(candidates.swap_remove(one)),
        [] if wanted.is_none() => {
            let found = format!("{} DICOM images of one slice", candidates.len());
            let first = candidates.first().map(|c| c.frames[0].clone());
            let others =
                first.map(|first| agree::left_out(&first, std::slice::from_ref(&first), images));
            if let Some(other) = others.iter().flatten().next() {
                let [tag, found, expected] = &other.differs;
                let found = format!("{tag} {found}");
                let expected = format!("{expected}, as another slice of its series states");
                return Err(Error::format(Path::new(&other.name), found, expected)
                    .with_hint("slices of one volume state the same"));
            }
            Err(
                Error::format(path, found, "at least 2 slices of one series")
                    .with_hint("give the folder that holds the slices"),
            )
        }
        _ => Err(several(path, &candidates, images, wanted)),
    }
}

fn several(path: &Path, candidates: &[Candidate], images: &[Image], wanted: Option<&str>) -> Error {
    let lines = candidates.iter().filter(|c| c.frames.len() > 1);
    let of = |c: &Candidate| images[c.frames[0].file as usize].series.clone();
    // what tells parts of one series apart
    let part = |c: &Candidate| {
        let like = |other: &&Candidate| of(other).same(&of(c));
        let first = &candidates.iter().find(like)?.frames[0];
        let whole = |frame| (&images[first.file as usize], frame);
        let own = (&images[c.frames[0].file as usize], &c.frames[0]);
        let [tag, found, _] = agree::difference(whole(first), own)?;
        Some(format!(", {tag} {found}"))
    };
    let line = |c: &Candidate| format!("\n  {}{}", c.line(), part(c).unwrap_or_default());
    let lines: Vec<String> = lines.map(line).collect();
    let count = lines.len();
    let found = match wanted {
        Some(name) => format!("\"{name}\""),
        None => format!("nothing, and {count} series in {}", path.display()),
    };
    let more = match count.saturating_sub(LISTED) {
        0 => String::new(),
        n => format!("\n  and {n} more"),
    };
    let list = lines[..count.min(LISTED)].concat();
    Error::usage(
        "--series",
        found,
        format!("the number in front, the description or the UID of one of{list}{more}"),
    )
}
