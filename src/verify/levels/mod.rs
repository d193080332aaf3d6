//! Levels of detail: that every level is as closed as the tiles are, that nothing is seen through between two levels,
//! and that the tree says of its nodes what they are.
//!
//! For each level, layer by layer of nodes:
//! 1. Every directed edge of a surface has its reverse in the node, in a node across the plane, or lies on a face of
//!    the volume that no cap closes ([`borders`]).
//! 2. The border of what lies below a node runs, within the stated distance of its own, under its fins, and these reach
//!    as far beyond it as all levels below may ([`fins`]).
//! 3. Surfaces, cells and objects are those of the nodes below, with their measures; none comes from nowhere.
//! 4. Each node stands for all that is below it: boxes hold those of the children, sums are as stated, and errors are how
//!    far its surfaces lie from those below: this is measured as it was when the node was made.
//! 5. `tileset.json` has the same tree with the same files, boxes and errors ([`tree`]).
//!
//! In memory are a layer's entries, a node with its children, and the edges in the planes between two layers.

mod borders;
mod entries;
mod error;
mod fins;
mod node;
mod read;
mod tree;

use super::closed::{self, Schema};
use super::code::Code;
use super::files::{self, Expected};
use super::foreign::foreign;
use super::report::Issues;
use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::lod::block_and_step;
use crate::manifest::{LEVELS, LEVELS_FORMAT, LEVELS_VERSION, Level, Levels, Manifest};
use crate::progress::Progress;
use crate::sys::direct_io::Buffer;
use borders::Borders;
use entries::{Below, Family, layer_below};
use node::Checker;
use std::path::Path;

/// What all checks of levels need.
pub(super) struct Set<'a> {
    pub root: &'a Path,
    pub manifest: &'a Manifest,
    pub tiling: Tiling,
}

/// Checks the levels of a set whose tiles have been checked, if it has any.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Io`] if a directory cannot be listed.
pub(super) fn check(
    root: &Path,
    manifest: &Manifest,
    progress: &dyn Progress,
    issues: &mut Issues,
) -> Result<()> {
    let Some(stated) = &manifest.lod else {
        return Ok(());
    };
    let set = Set {
        root,
        manifest,
        tiling: Tiling {
            dims: manifest.grid.dims,
            macrocube: manifest.grid.macrocube,
        },
    };
    if stated.path != LEVELS {
        let message = format!("found {}, expected {LEVELS}", stated.path);
        issues.add(Code::PathName, "index.json#/lod/path", message);
        return Ok(());
    }
    let expected = Expected {
        path: LEVELS,
        bytes: stated.bytes,
        checksum: &stated.checksum,
        at: "index.json#/lod",
    };
    let Some(levels) = set.json::<Levels>(&expected, &closed::LEVELS, issues) else {
        return Ok(());
    };
    let count = levels.levels.len() as u64 + 1;
    if u64::from(stated.levels) != count {
        let message = format!("found {}, expected {count}", stated.levels);
        issues.add(Code::LodValue, "index.json#/lod/levels", message);
    }
    if !set.check_levels(&levels, issues) {
        return Ok(());
    }
    set.foreign_files(&levels, issues)?;
    let mut found = Issues::new(issues.most());
    for (i, level) in levels.levels.iter().enumerate() {
        progress.begin(&format!("level {}", level.level), level.nodes);
        let below = i.checked_sub(1).map(|i| &levels.levels[i]);
        set.check_level(&Below { set: &set, below }, level, progress, &mut found)?;
    }
    // of nodes that are not what they say, the tree is neither
    if !found.any_error() {
        tree::check(&set, &levels, &mut found)?;
    }
    issues.append(found);
    Ok(())
}

impl Set<'_> {
    /// Reads a JSON file that an index names.
    fn json<T: serde::de::DeserializeOwned>(
        &self,
        file: &Expected,
        schema: &Schema,
        issues: &mut Issues,
    ) -> Option<T> {
        let mut bytes = Buffer::default();
        if !files::fetch(self.root, file, &mut bytes, issues) {
            return None;
        }
        files::compare(file, bytes.get(), issues);
        // what is no JSON is reported below
        for (pointer, message) in schema.walk(bytes.get()).unwrap_or_default() {
            issues.add(
                Code::ForeignMember,
                format!("{}#{pointer}", file.path),
                message,
            );
        }
        match serde_json::from_slice(bytes.get()) {
            Ok(value) => Some(value),
            Err(e) => {
                issues.add(Code::LodSyntax, file.path, e.to_string());
                None
            }
        }
    }

    /// Checks the index of levels by itself; false if nothing can be read by it.
    fn check_levels(&self, levels: &Levels, issues: &mut Issues) -> bool {
        if levels.format != LEVELS_FORMAT || levels.format_version != LEVELS_VERSION {
            let message = format!(
                "found format {} version {}, this program reads \"{LEVELS_FORMAT}\" version {LEVELS_VERSION}",
                levels.format, levels.format_version
            );
            issues.add(Code::LodSyntax, LEVELS, message);
            return false;
        }
        let mut sound = !levels.levels.is_empty();
        for (i, level) in levels.levels.iter().enumerate() {
            let number = i as u32 + 1;
            let tiles = self.tiling.tiles();
            let grid = tiles.map(|n| u64::from(n).div_ceil(1 << number.min(31)) as u32);
            let cubes = self
                .tiling
                .macrocube
                .map(|m| u64::from(m) << number.min(31));
            let step = level.step.is_power_of_two() && level.step <= 256;
            let rising = level.layers.windows(2).all(|w| w[0].z < w[1].z);
            let inside = level.layers.iter().all(|l| l.z < grid[2]);
            let is = level.level == number && level.grid == grid && level.macrocube == cubes;
            if !(is && step && rising && inside) {
                let message = format!(
                    "found level {} of {:?} nodes of {:?} cubes in steps of {}, expected level {number} of {grid:?} \
                     nodes of {cubes:?} cubes, steps of a power of 2 up to 256, and layers by rising z",
                    level.level, level.grid, level.macrocube, level.step
                );
                issues.add(Code::LodValue, format!("{LEVELS}#/levels/{i}"), message);
                sound = false;
            }
        }
        let is_share = levels.ratio > 0.0 && levels.ratio <= 0.5;
        let is_positive = levels.pixel_error > 0.0 && levels.pixel_error.is_finite();
        if !is_share || !is_positive {
            let message = format!(
                "found ratio {} and pixel_error {}, expected a share up to 1/2 and a number above 0",
                levels.ratio, levels.pixel_error
            );
            issues.add(Code::LodValue, LEVELS, message);
            sound = false;
        }
        if sound {
            self.check_blocks(levels, issues);
        }
        sound
    }

    /// Compares blocks and steps with those of the ratio.
    fn check_blocks(&self, levels: &Levels, issues: &mut Issues) {
        for (i, level) in levels.levels.iter().enumerate() {
            let below = i.checked_sub(1).map(|i| &levels.levels[i]);
            let found = [level.block, level.step];
            let expected = match block_and_step(self.manifest, below, levels.ratio) {
                Ok(expected) if expected == found => continue,
                Ok(expected) => format!("{expected:?}"),
                Err(e) => format!("none: {e}"),
            };
            let message = format!(
                "found block and step {found:?}, expected {expected} by the ratio and the level below"
            );
            issues.add(Code::LodValue, format!("{LEVELS}#/levels/{i}"), message);
        }
    }

    /// Looks for files below `lod` that the index does not name; those of a layer follow with its shard.
    fn foreign_files(&self, levels: &Levels, issues: &mut Issues) -> Result<()> {
        let level = |name: &str| {
            let number = name.parse::<usize>().ok()?;
            let level = levels.levels.get(number.checked_sub(1)?)?;
            (name == number.to_string()).then_some(level)
        };
        let top = |name: &str| ["index.json", "tilesets"].contains(&name) || level(name).is_some();
        foreign(self.root, "lod", top, issues)?;
        for level in &levels.levels {
            let known = |name: &str| {
                let layer = |l: &crate::manifest::Layer| {
                    let dir = format!("z{:04}", l.z);
                    name == dir || name == format!("{dir}.json")
                };
                level.layers.iter().any(layer)
            };
            foreign(self.root, &format!("lod/{}", level.level), known, issues)?;
        }
        Ok(())
    }

    fn check_level(
        &self,
        below: &Below,
        level: &Level,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<()> {
        let mut checker = Checker::new(self, level, below.below.is_none());
        let mut borders = Borders::new(level.level);
        for (i, layer) in level.layers.iter().enumerate() {
            let at = format!("{LEVELS}#/levels/{}/layers/{i}", level.level - 1);
            let Some(nodes) = entries::layer(self, level, layer, &at, issues) else {
                return Ok(());
            };
            self.foreign_nodes(level, layer.z, &nodes, issues)?;
            let Some(mut families) = layer_below(below, layer.z) else {
                return Ok(());
            };
            for node in &nodes {
                if progress.interrupted() {
                    return Err(Error::Interrupted);
                }
                let children = families
                    .remove(&[node.grid[1], node.grid[0]])
                    .unwrap_or_default();
                checker.check(node, &Family { below, children }, &mut borders, issues);
                progress.advance(1);
            }
            for orphans in families.values() {
                let message = "no node of the next level stands for it".to_owned();
                issues.add(Code::LodTree, &orphans[0].path, message);
            }
            // a layer further may still lie across the upper plane
            borders.end_layer(self.tiling, level.level, layer.z, issues);
        }
        self.check_layers(below, level, issues);
        borders.end(issues);
        checker.end(issues);
        Ok(())
    }

    /// Every layer below has one above it.
    fn check_layers(&self, below: &Below, level: &Level, issues: &mut Issues) {
        for z in below.layers() {
            if !level.layers.iter().any(|layer| layer.z == z / 2) {
                let message = format!(
                    "no node of level {} stands for layer {z} below",
                    level.level
                );
                issues.add(Code::LodTree, LEVELS, message);
            }
        }
    }

    fn foreign_nodes(
        &self,
        level: &Level,
        z: u32,
        nodes: &[crate::manifest::NodeEntry],
        issues: &mut Issues,
    ) -> Result<()> {
        let dir = format!("lod/{}/z{z:04}", level.level);
        let named = |name: &str| {
            let own = |n: &crate::manifest::NodeEntry| n.path.rsplit('/').next() == Some(name);
            nodes.iter().any(own)
        };
        foreign(self.root, &dir, named, issues)
    }
}
