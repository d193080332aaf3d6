//! What a viewer of your own does with a tile set: it flies a camera past the surface, and for each frame
//! asks which tiles to draw, reads those that it has not yet, and forgets those that it needs no more.
//! Nothing is drawn here; a line for each frame tells what would be.
//!
//! ```sh
//! cargo run --release --example feed_viewer -- DIRECTORY
//! ```

use alvis::tile::TileMesh;
use alvis::tileset::TileSet;
use alvis::view::{Depth, Picked, TileIndex, View};
use glam::dcamera::rh::{proj::directx, view::look_to_mat4};
use glam::{DMat4, DVec3};
use std::collections::HashMap;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// Frames of the flight; the camera rests in the last one.
const FRAMES: u32 = 8;
/// Macrocubes around the viewing point that are drawn while the camera moves.
const REACH: u32 = 1;
/// Triangles that the graphics card draws fast enough while the camera moves, and when it rests.
const BUDGETS: [u64; 2] = [1_000_000, 20_000_000];

/// What was drawn in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Tiles drawn.
    pub tiles: usize,
    /// Triangles in them.
    pub triangles: u64,
    /// Tiles that had to be read for it.
    pub read: usize,
    /// Tiles in the view for which there was no budget.
    pub missing: usize,
}

/// Flies through the tile set in `dir`.
pub fn run(dir: &Path) -> Result<Vec<Frame>, Box<dyn Error>> {
    let set = TileSet::open(dir)?;
    let index = TileIndex::read(&set)?;
    // the grid's lowest and highest corner, in the metres of the tiles
    let place = DMat4::from_cols_array(&set.manifest().transform);
    let end = set.manifest().grid.dims.0.map(|n| f64::from(n - 1));
    let [low, high] = [DVec3::ZERO, end.into()].map(|p| place.transform_point3(p));
    let size = (high - low).length();
    let mut loaded: HashMap<String, TileMesh> = HashMap::new();
    let mut frames = Vec::new();
    for frame in 0..FRAMES {
        let share = f64::from(frame) / f64::from(FRAMES);
        let eye = low.lerp(high, share);
        let camera = look_to_mat4(eye, (high - low).normalize(), DVec3::Y);
        let lens = directx::perspective(1.0, 16.0 / 9.0, 1e-3 * size, 2.0 * size);
        let view = View::new(lens * camera, Depth::ZeroToOne, set.manifest());
        let moving = frame + 1 < FRAMES;
        let picked = if moving {
            index.interactive(&view, REACH, BUDGETS[0])
        } else {
            index.completion(&view, REACH, BUDGETS[1])
        };
        frames.push(draw(&set, picked, &mut loaded)?);
    }
    Ok(frames)
}

/// Reads what is missing and drops what is not drawn.
fn draw(
    set: &TileSet,
    mut picked: Picked,
    loaded: &mut HashMap<String, TileMesh>,
) -> Result<Frame, Box<dyn Error>> {
    let mut before = std::mem::take(loaded);
    let mut frame = Frame {
        tiles: 0,
        triangles: 0,
        read: 0,
        missing: 0,
    };
    for entry in picked.by_ref() {
        let tile = match before.remove(&entry.path) {
            Some(tile) => tile,
            None => {
                frame.read += 1;
                set.read_tile(entry)?
            }
        };
        // here a viewer would draw the tile's pieces, nearest tile first
        frame.tiles += 1;
        frame.triangles += entry.triangles;
        loaded.insert(entry.path.clone(), tile);
    }
    frame.missing = picked.waiting();
    Ok(frame)
}

// a test includes this file for `run` alone
#[cfg_attr(test, allow(dead_code))]
fn main() -> ExitCode {
    let Some(dir) = std::env::args_os().nth(1) else {
        eprintln!("usage: feed_viewer DIRECTORY");
        return ExitCode::from(2);
    };
    match run(Path::new(&dir)) {
        Ok(frames) => {
            for (i, frame) in frames.iter().enumerate() {
                let Frame {
                    tiles,
                    triangles,
                    read,
                    missing,
                } = frame;
                println!(
                    "frame {i}: {tiles} tiles with {triangles} triangles, {read} of them read, \
                     {missing} in view left out"
                );
            }
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}
