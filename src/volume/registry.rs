//! The formats that are read. A format is a file or folder in `formats` that has its `FORMAT`, and a line here.

use crate::volume::format::{Format, listed};
use crate::volume::formats::{
    amiramesh, analyze, archive, bmp, dicom, hdf5, metaimage, mrc, nifti, npy, nrrd, png, scanco,
    sidecar, tiff, vti, zarr,
};

/// In the order in which a file is tried: the first that recognises it has it.
pub(crate) static FORMATS: &[Format] = &[
    nrrd::FORMAT,
    metaimage::FORMAT,
    tiff::FORMAT,
    npy::FORMAT,
    archive::FORMAT,
    vti::FORMAT,
    nifti::FORMAT,
    hdf5::FORMAT,
    dicom::FORMAT,
    zarr::FORMAT,
    png::FORMAT,
    bmp::FORMAT,
    sidecar::VGI,
    sidecar::NIKON,
    sidecar::ESRF,
    sidecar::PCR,
    scanco::ISQ,
    scanco::AIM,
    amiramesh::FORMAT,
    mrc::FORMAT,
    analyze::FORMAT,
];

/// The format of a name; raw samples, which have no header, are of none.
pub(crate) fn named(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}

/// What an input may be, for the help of commands.
pub fn input_help() -> String {
    let titles = |which: fn(&Format) -> bool| -> Vec<&str> {
        let formats = FORMATS.iter().filter(|format| which(format));
        formats.map(|format| format.title).collect()
    };
    let files = titles(|format| format.parse.is_some() && !format.folder);
    let slices = titles(|format| format.slices.is_some());
    let folders = titles(|format| format.folder);
    format!(
        "{} are recognised by what is in them. A folder may hold {} slices, or a {}. Anything else is read as raw \
         samples, for which --dims and --dtype are needed.",
        listed(&files, "and"),
        listed(&slices, "or"),
        listed(&folders, "or a"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The rows that the README has of the formats.
    fn rows() -> String {
        let row = |format: &Format| {
            let quoted = |words: Vec<String>| words.join(" ");
            let names = format.extensions.iter().map(|e| format!("`.{e}`"));
            let options = format.takes.iter().map(|c| format!("`{}`", c.option()));
            let cells = [quoted(names.collect()), quoted(options.collect())];
            format!("| {} | {} |\n", format.title, cells.join(" | "))
        };
        FORMATS.iter().map(row).collect()
    }

    #[test]
    fn the_readme_lists_them() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
        let text = std::fs::read_to_string(path).unwrap();
        let head = "| format | names of files | options that choose |\n|---|---|---|\n";
        let expected = format!("{head}{}", rows());
        let begin = text.find(head);
        let table = begin.map(|at| text[at..].split("\n\n").next().unwrap());
        assert_eq!(
            table.map(|table| format!("{}\n", table.trim_end())),
            Some(expected)
        );
    }

    #[test]
    fn a_name_is_that_of_one_format() {
        let names: BTreeSet<&str> = FORMATS.iter().map(|format| format.name).collect();
        assert_eq!(names.len(), FORMATS.len());
        for format in FORMATS {
            assert!(std::ptr::eq(named(format.name).unwrap(), format));
            assert!(format.parse.is_some() || format.slices.is_some());
            assert!(!format.title.is_empty() && !format.extensions.is_empty());
        }
        let placed = |format: &&Format| format.slices.is_some_and(|slices| slices.placed);
        assert_eq!(FORMATS.iter().filter(placed).count(), 1);
    }

    #[test]
    fn the_help_names_all_of_them() {
        let help = input_help();
        for format in FORMATS {
            assert!(help.contains(format.title), "{help}");
        }
        assert!(
            help.contains("DICOM, PNG or BMP slices, or a Zarr."),
            "{help}"
        );
    }
}
