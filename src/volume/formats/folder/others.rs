//! What a folder holds besides slices, and what to say where it holds no slices at all.

use crate::error::Error;
use crate::volume::format::{Format, listed};
use crate::volume::formats::foreign;
use crate::volume::io::blob::Blob;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

/// What a folder holds besides slices.
#[derive(Default)]
pub(crate) struct Others {
    /// Files that can be read by themselves.
    pub(crate) volumes: Vec<PathBuf>,
    /// Files of formats that are not read, with their names.
    pub(crate) foreign: Vec<(&'static str, PathBuf)>,
}

impl Others {
    /// What to say of those that have the extension of the slices.
    pub(crate) fn notes(&self, slices: &[Blob], format: &Format) -> Vec<String> {
        let slices: HashSet<_> = slices.iter().map(|s| s.path().extension()).collect();
        let like =
            |file: &&PathBuf| file.extension().is_some() && slices.contains(&file.extension());
        let foreign = self.foreign.iter().map(|(_, file)| file);
        let files = self.volumes.iter().chain(foreign).filter(like);
        files
            .map(|f| format!("{} is passed by: it is no {}", f.display(), format.title))
            .collect()
    }
}

/// The refusal of a folder without slices, with what it holds instead.
pub(crate) fn nothing(path: &Path, others: &Others, formats: &[Format]) -> Error {
    let shown = |files: &[PathBuf]| {
        let some: Vec<String> = files
            .iter()
            .take(5)
            .map(|f| f.display().to_string())
            .collect();
        let more = if files.len() > 5 { ", ..." } else { "" };
        format!("{}{more}", some.join(", "))
    };
    match (&others.volumes[..], &others.foreign[..]) {
        ([one], _) => Error::format(path, "a folder that holds one volume", "slices of a volume")
            .with_hint(format!("give {}", one.display())),
        ([_, _, ..], _) => {
            let found = format!("a folder of {} volumes", others.volumes.len());
            Error::format(path, found, "slices of a volume")
                .with_hint(format!("give one of {}", shown(&others.volumes)))
        }
        ([], [(_, one)]) => {
            Error::format(path, "a folder that holds one volume", "slices of a volume").with_hint(
                format!("give {}, for the way to its samples", one.display()),
            )
        }
        ([], [_, _, ..]) => {
            let mut kinds: BTreeMap<&str, Vec<&Path>> = BTreeMap::new();
            for (name, file) in &others.foreign {
                kinds.entry(name).or_default().push(file);
            }
            let most = kinds.iter().max_by_key(|(_, files)| files.len());
            let (name, first) = most.map_or(("", path), |(name, files)| (*name, files[0]));
            let what = format!("a folder of {name} files ({}, ...)", first.display());
            Error::unsupported(path, what, foreign::way_of(name))
        }
        ([], []) => {
            let slices = formats.iter().filter(|format| format.slices.is_some());
            let titles: Vec<&str> = slices.map(|format| format.title).collect();
            let found = format!("a folder without {} files", listed(&titles, "or"));
            Error::format(path, found, "slices of a volume")
                .with_hint("raw slices need --dims and --dtype; a .nhdr header can list them too")
        }
    }
}
