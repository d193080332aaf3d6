//! The cells of a slice, from the tiles' vertices in it.

use super::PreviewOptions;
use super::slice::Slice;
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, LATTICE, Tiling};
use crate::manifest::{Manifest, TileEntry, file_inside};
use crate::table::{Expr, Table};
use crate::tile::pieces::pieces;
use crate::tile::read::{ReadError, Tile};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::path::Path;

/// The colours of a slice.
pub struct Colours {
    width: u32,
    /// The cell of each voxel; 0 if it is above or of no known cell.
    cells: Vec<u64>,
    colour: BTreeMap<u64, [u8; 3]>,
}

impl Colours {
    /// The colour of a voxel.
    pub fn at(&self, [x, y]: [u32; 2]) -> Option<[u8; 3]> {
        let cell = self.cells[y as usize * self.width as usize + x as usize];
        self.colour.get(&cell).copied()
    }

    /// How many cells have a colour.
    pub fn count(&self) -> u64 {
        self.colour.len() as u64
    }
}

/// Finds the cells of a slice's below voxels, and their colours.
pub fn colours(
    dir: &Path,
    manifest: &Manifest,
    slice: &Slice,
    options: &PreviewOptions,
) -> Result<Colours> {
    let mut cells = vec![0; slice.values.len()];
    let tiling = Tiling {
        dims: manifest.grid.dims,
        macrocube: manifest.grid.macrocube,
    };
    let axis = slice.axis as usize;
    // the tile that has the slice's cubes has its vertices, the last one those of the end
    let index = (slice.at / tiling.macrocube[axis]).min(tiling.tiles()[axis] - 1);
    for layer in &manifest.layers {
        if axis == 2 && layer.z != index {
            continue;
        }
        for entry in manifest.shard_tiles(dir, layer)? {
            let entry = entry?;
            if entry.grid[axis] == index {
                seeds(dir, manifest, slice, &entry, &mut cells)?;
            }
        }
    }
    flood(manifest, slice, &mut cells);
    let ids: BTreeSet<u64> = cells.iter().copied().filter(|&id| id != 0).collect();
    let colour = match &options.colour_by {
        Some(column) => by_value(dir, manifest, column, options, &ids)?,
        None => ids.into_iter().map(|id| (id, by_id(id))).collect(),
    };
    Ok(Colours {
        width: slice.size[0],
        cells,
        colour,
    })
}

/// Writes the cell of each vertex in the slice to the voxel at the below end of its edge.
fn seeds(
    dir: &Path,
    manifest: &Manifest,
    slice: &Slice,
    entry: &TileEntry,
    cells: &mut [u64],
) -> Result<()> {
    let path = file_inside(dir, &entry.path, "read the tile")?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read the tile", e))?;
    let bad = |e: ReadError| Error::format(&path, e.to_string(), "a tile");
    let tile = Tile::read(&bytes).map_err(bad)?;
    let step = LATTICE as i32;
    let plane = slice.at as i32 * step;
    for piece in pieces(&tile, manifest.primitives).map_err(bad)? {
        if piece.ids.cell == 0 {
            continue;
        }
        for p in piece.lattice().map_err(bad)? {
            if p[slice.axis as usize] != plane {
                continue;
            }
            let at = slice.axis.plane().map(|a| p[a]);
            // an edge in the slice: its ends are the voxels beside the one fraction
            let low = at.map(|v| v.div_euclid(step));
            let high = at.map(|v| (v + step - 1).div_euclid(step));
            for end in [low, high] {
                let [Ok(x), Ok(y)] = end.map(u32::try_from) else {
                    continue;
                };
                if low == high || x >= slice.size[0] || y >= slice.size[1] {
                    continue;
                }
                if !slice.above([x, y], manifest.threshold) {
                    cells[y as usize * slice.size[0] as usize + x as usize] = piece.ids.cell;
                }
            }
        }
    }
    Ok(())
}

/// Spreads the cells over the below voxels that are connected in the slice: they are connected in
/// the volume too.
fn flood(manifest: &Manifest, slice: &Slice, cells: &mut [u64]) {
    let [width, height] = slice.size.map(i64::from);
    let diagonal = manifest.ambiguous == Ambiguous::Separate;
    let mut open: Vec<usize> = (0..cells.len()).filter(|&i| cells[i] != 0).collect();
    while let Some(i) = open.pop() {
        let (x, y) = (i as i64 % width, i as i64 / width);
        for (dx, dy) in [
            (-1, 0),
            (1, 0),
            (0, -1),
            (0, 1),
            (-1, -1),
            (1, -1),
            (-1, 1),
            (1, 1),
        ] {
            let (u, v) = (x + dx, y + dy);
            let skewed = dx != 0 && dy != 0;
            if (skewed && !diagonal) || u < 0 || v < 0 || u >= width || v >= height {
                continue;
            }
            let n = (v * width + u) as usize;
            let above = slice.above([u as u32, v as u32], manifest.threshold);
            if cells[n] == 0 && !above {
                cells[n] = cells[i];
                open.push(n);
            }
        }
    }
}

/// A colour that differs much from those of the next ids: hues in steps of the golden ratio, on the circle of
/// colours whose channels are squares of sines a third of a turn apart (the "sinebow").
fn by_id(id: u64) -> [u8; 3] {
    let turn = (id as f64 * 0.618_033_988_749_894_9).fract();
    [0.0, 1.0, 2.0].map(|third| {
        let sine = libm::sin(PI * (0.5 - turn + third / 3.0));
        (255.0 * sine * sine) as u8
    })
}

/// Colours by value; the map spans the values of all cells, so that slices compare.
fn by_value(
    dir: &Path,
    manifest: &Manifest,
    column: &str,
    options: &PreviewOptions,
    ids: &BTreeSet<u64>,
) -> Result<BTreeMap<u64, [u8; 3]>> {
    let mut table = Table::Cells.open(dir, manifest)?;
    let value = Expr::number("--colour-by", column, table.columns())?;
    let id = table.column("id").unwrap_or(0);
    let mut values = BTreeMap::new();
    let [mut min, mut max] = [f64::INFINITY, f64::NEG_INFINITY];
    while let Some(row) = table.next_row()? {
        if let Some(v) = value.value(&row)? {
            [min, max] = [min.min(v), max.max(v)];
            let id = row.whole(id)?;
            if ids.contains(&id) {
                values.insert(id, v);
            }
        }
    }
    let share = |v: f64| {
        if max > min {
            (v - min) / (max - min)
        } else {
            0.5
        }
    };
    Ok(values
        .into_iter()
        .map(|(id, v)| (id, options.map.at(share(v))))
        .collect())
}
