//! What is asked for of levels, and whether those that are there are it.

use super::tileset_json::has_tileset;
use super::work::Identity;
use crate::error::{Error, Result};
use crate::manifest::{LEVELS, Levels, NodeShard, TILESET, check_json, tileset_path};
use crate::tileset::{LOD, TileSet};
use std::path::Path;

/// Pixels that an error may have: beyond these a viewer shows all tiles, or the root alone, however far away.
const PIXEL_ERRORS: [f64; 2] = [0.001, 1000.0];

/// What helps against damaged levels.
const ANEW: &str = "--force makes the levels of detail anew; the tiles stay as they are";

/// How levels are made.
#[derive(Debug, Clone, Copy)]
pub struct LodOptions {
    /// Share of the triangles that a level keeps of the one below; above 0 and at most 0.5.
    pub ratio: f64,
    /// The most levels, the tiles counted; at least 2. Without it there are as many as lead to one root.
    pub levels: Option<u32>,
    /// Pixels that an error may have on the screen of a viewer of 3D Tiles; 0.001 to 1000.
    pub pixel_error: f64,
    /// Most bytes of memory.
    pub memory: u64,
    /// Threads; 0 for one per core.
    pub threads: usize,
    /// Go on with what was interrupted, if its nodes are the same; levels that are finished stay then.
    pub resume: bool,
    /// Replace levels that are there, and those that were interrupted unless `resume` can go on with them.
    pub force: bool,
}

impl Default for LodOptions {
    fn default() -> Self {
        LodOptions {
            ratio: 0.125,
            levels: None,
            pixel_error: 1.0,
            memory: 1 << 30,
            threads: 0,
            resume: false,
            force: false,
        }
    }
}

/// Refuses options that are out of range.
///
/// # Errors
/// [`Error::Usage`].
pub fn check(options: &LodOptions) -> Result<()> {
    let wrong =
        |option: &str, found: String, expected: &str| Err(Error::usage(option, found, expected));
    let LodOptions {
        ratio,
        levels,
        pixel_error,
        ..
    } = *options;
    if !(ratio > 0.0 && ratio <= 0.5) {
        return wrong(
            "--ratio",
            ratio.to_string(),
            "a share above 0 and at most 1/2",
        );
    }
    if let Some(levels) = levels.filter(|&n| n < 2) {
        return wrong(
            "--levels",
            levels.to_string(),
            "2 or more, the tiles counted",
        );
    }
    let [least, most] = PIXEL_ERRORS;
    if !(least..=most).contains(&pixel_error) {
        let expected = format!("pixels from {least} to {most}");
        return wrong("--pixel-error", pixel_error.to_string(), &expected);
    }
    Ok(())
}

/// Refuses tiles over which there are no levels.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_tiles(set: &TileSet) -> Result<()> {
    let manifest = set.manifest();
    let refused = |found: &str, expected: &str| {
        let out = set.dir().display().to_string();
        Err(Error::usage(out, found, expected))
    };
    if manifest.cells.is_some() {
        return refused(
            "cells that are parts of components",
            "a tile set made without --split and --labels: levels of such a set would gape where cells touch",
        );
    }
    match manifest.totals.tiles {
        0 => refused("no tile", "a tile set with a surface"),
        _ => Ok(()),
    }
}

/// The levels that a set has, if they are not to be replaced: of those nothing is read, for they may be damaged.
///
/// # Errors
/// Those of [`TileSet::levels`].
pub fn kept_levels(set: &TileSet, options: &LodOptions) -> Result<Option<Levels>> {
    if options.force {
        return Ok(None);
    }
    set.levels()
        .map_err(|error| damaged(set, LEVELS, error, "an index of levels"))
}

/// What is said of a file of levels that cannot be taken.
fn damaged(set: &TileSet, path: &str, error: Error, expected: &str) -> Error {
    match error {
        Error::Io { .. } => {
            let found = format!("none that can be read ({error})");
            Error::format(set.dir().join(path), found, expected)
        }
        other => other,
    }
    .with_hint(ANEW)
}

/// Refuses levels that are there, unless they are those that are asked for and going on with them was: then nothing is to be
/// done.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_kept(levels: &Levels, set: &TileSet, options: &LodOptions) -> Result<()> {
    if options.resume && is_of(levels, options) {
        return Ok(());
    }
    let found = match options.resume {
        true => format!(
            "levels of detail there already, made with {}",
            named(
                levels.ratio,
                Some(levels.levels.len() as u32 + 1),
                levels.pixel_error
            )
        ),
        false => "levels of detail there already".to_owned(),
    };
    let expected = match options.resume {
        true => format!(
            "those of {}, or --force to make them anew",
            named(options.ratio, options.levels, options.pixel_error)
        ),
        false => "a tile set without them, or --force to make them anew".to_owned(),
    };
    Err(Error::usage(
        set.dir().display().to_string(),
        found,
        expected,
    ))
}

/// Refuses levels that are there and finished if files of theirs are not as the lists say: only their sizes are looked at.
///
/// # Errors
/// [`Error::Format`].
pub fn check_files(levels: &Levels, set: &TileSet) -> Result<()> {
    check_tree(set, TILESET)?;
    for level in &levels.levels {
        for layer in &level.layers {
            check_size(set, &layer.path, layer.bytes)?;
            let shard = NodeShard::open(set.dir(), level.level, layer);
            let shard = shard.map_err(|e| damaged(set, &layer.path, e, "a list of nodes"))?;
            for node in shard.nodes {
                check_size(set, &node.path, node.bytes)?;
                if has_tileset(level.level, levels.levels.len() as u32) {
                    check_tree(set, &tileset_path(level.level, node.grid))?;
                }
            }
        }
    }
    Ok(())
}

fn check_size(set: &TileSet, path: &str, bytes: u64) -> Result<()> {
    let file = set.dir().join(path);
    let found = match file.metadata() {
        Ok(found) if found.len() == bytes => return Ok(()),
        Ok(found) => format!("{} bytes", found.len()),
        Err(e) => format!("none that can be read ({e})"),
    };
    Err(Error::format(file, found, format!("{bytes} bytes")).with_hint(ANEW))
}

fn check_tree(set: &TileSet, path: &str) -> Result<()> {
    let expected = "a tree of the levels";
    check_json(set.dir(), path, expected).map_err(|e| damaged(set, path, e, expected))
}

/// Refuses to replace what has the names of levels and belongs to none of this set, unless by force.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_free(set: &TileSet, options: &LodOptions) -> Result<()> {
    if options.force || set.manifest().lod.is_some() {
        return Ok(());
    }
    let there = |name: &&str| set.dir().join(name).symlink_metadata().is_ok();
    match [TILESET, LOD].iter().find(|name| there(name)) {
        None => Ok(()),
        Some(name) => Err(Error::usage(
            set.dir().display().to_string(),
            format!("{name}, which is of no levels of this set"),
            "none; move it away, or give --force to replace it",
        )),
    }
}

/// Options as they are typed.
fn named(ratio: f64, count: Option<u32>, pixels: f64) -> String {
    let count = count.map_or("all".to_owned(), |n| n.to_string());
    format!("--ratio {ratio}, {count} levels and --pixel-error {pixels}")
}

/// Refuses to go on with levels that were interrupted, `begun`, if their nodes are not those that are wanted.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_begun(begun: &Identity, wanted: &Identity, out: &Path) -> Result<()> {
    if begun.has_nodes_of(wanted) {
        return Ok(());
    }
    let of = |i: &Identity| named(i.ratio, i.levels, i.pixel_error);
    let (found, expected) = if begun.index != wanted.index {
        (
            "of other tiles than those that are there now".to_owned(),
            "the tiles as they were".to_owned(),
        )
    } else if begun.version != wanted.version {
        (
            format!("begun by alvis {}", begun.version),
            format!("those of alvis {}", wanted.version),
        )
    } else {
        (
            format!("begun with {}", of(begun)),
            format!("those of {}", of(wanted)),
        )
    };
    Err(Error::usage(
        out.display().to_string(),
        format!("levels of detail that were interrupted, {found}"),
        format!("{expected}, or --force to begin anew"),
    ))
}

/// True if levels that are there are those that are asked for.
fn is_of(levels: &Levels, options: &LodOptions) -> bool {
    let count = levels.levels.len() as u32 + 1;
    let all = levels.levels.last().is_some_and(|l| l.grid == [1; 3]);
    levels.ratio == options.ratio
        && levels.pixel_error == options.pixel_error
        && options
            .levels
            .map_or(all, |most| count == most || count < most && all)
}
