//! What `alvis cells` tells of pairs of cells, the openings and the walls between them, and how many cells there are at
//! other ratios.

use super::{Outcome, output};
use crate::error::{Error, Result};
use crate::manifest::{Manifest, PartsBy, file_inside};
use crate::table::TableReader;
use serde_json::json;
use std::path::Path;

/// A table of pairs of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pairs {
    Necks,
    Walls,
}

impl Pairs {
    /// Its rows, in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Pairs::Necks => "necks",
            Pairs::Walls => "walls",
        }
    }

    /// How many there are, in words.
    pub fn all(self, manifest: &Manifest) -> String {
        match self {
            Pairs::Necks => output::things(manifest.totals.necks, "opening"),
            Pairs::Walls => output::things(manifest.totals.walls, "wall"),
        }
    }

    /// Opens it.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none; as of [`TableReader::open`].
    pub fn open(self, dir: &Path, manifest: &Manifest) -> Result<TableReader> {
        let tables = &manifest.tables;
        let (path, without) = match self {
            Pairs::Necks => (&tables.necks, none(dir)),
            Pairs::Walls => (&tables.walls, no_walls(dir)),
        };
        let path = path.as_ref().ok_or(without)?;
        TableReader::open_keyed(&file_inside(dir, path, "open the table")?, "cell_a")
    }
}

fn no_walls(dir: &Path) -> Error {
    let found = format!("{}, which has no table of walls", dir.display());
    Error::usage("--walls", found, "a tile set made by alvis convert --walls")
}

/// There are no openings, and none could be.
fn none(dir: &Path) -> Error {
    let found = format!(
        "{}, whose cells are connected components, so that none is open to another",
        dir.display()
    );
    let expected = "a tile set made by alvis convert with --split or --labels";
    Error::usage("--necks", found, expected)
}

/// Other ratios give no other cells.
fn no_curve(dir: &Path, manifest: &Manifest) -> Error {
    let cells = match &manifest.cells {
        Some(PartsBy::Labels { file, .. }) => format!("the labels of {file}"),
        _ => "connected components".to_owned(),
    };
    let found = format!("{}, whose cells are {cells}", dir.display());
    let expected = "a tile set made by alvis convert with --split";
    let error = Error::usage("--split-curve", found, expected);
    match &manifest.cells {
        None => error.with_hint(format!(
            "`alvis split {} DEST --ratio 0.8 --against {}` makes one with all else as it is here",
            dir.display(),
            manifest.source.name
        )),
        Some(_) => error,
    }
}

/// Prints how many cells other ratios give, and, by `warn`, that there are no clear necks.
///
/// # Errors
/// [`Error::Usage`] if the cells were not split.
pub fn print_curve(
    dir: &Path,
    manifest: &Manifest,
    as_json: bool,
    warn: impl FnOnce(&str),
) -> Result<Outcome> {
    let Some(
        parts @ PartsBy::Split {
            ratio_permille,
            curve,
            ..
        },
    ) = &manifest.cells
    else {
        return Err(no_curve(dir, manifest));
    };
    if let Some(warning) = parts.warning(manifest.totals.cells, manifest.region.is_some()) {
        warn(&warning);
    }
    let ratio = |permille: u64| permille as f64 / 1000.0;
    let own = u64::from(*ratio_permille);
    if as_json {
        let points = curve
            .iter()
            .map(|&[permille, cells]| json!({"ratio": ratio(permille), "cells": cells}));
        output::print_json(&json!({
            "ratio": ratio(own),
            "cells": manifest.totals.cells,
            "components": manifest.totals.components,
            "split_curve": points.collect::<Vec<_>>(),
        }))?;
        return Ok(Outcome::Done);
    }
    let mut text = String::from(" ratio       cells\n");
    for &[permille, cells] in curve {
        let mark = if permille == own {
            "  <- these tiles"
        } else {
            ""
        };
        text += &format!("{:6.2} {:>11}{mark}\n", ratio(permille), cells);
    }
    output::print(&text)?;
    Ok(Outcome::Done)
}
