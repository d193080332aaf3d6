//! The cells, objects or surfaces of a slice, from the tiles' vertices in it.

use super::PreviewOptions;
use super::slice::Slice;
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, LATTICE};
use crate::manifest::{Manifest, Paint, Selection, TileEntry, file_inside};
use crate::picture::ticks::place;
use crate::picture::{Map, parse_colour};
use crate::store;
use crate::table::{Chosen, Column, Expr, Table};
use crate::tile::Rgb;
use crate::tile::pieces::pieces;
use crate::tile::read::{ReadError, Tile};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap, HashMap};
use std::f64::consts::PI;
use std::path::Path;

/// How a voxel is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Style {
    /// As its sample.
    Sample,
    /// In the colour of its cell or object.
    Colour(Rgb),
    /// Of one whose value means nothing, such as the volume of a cell that the volume's faces cut.
    NoValue,
}

/// What the colours mean.
pub enum Meaning {
    /// They tell cells, objects or surfaces apart.
    Ids,
    /// They follow values.
    Values {
        /// The column or expression, with its unit.
        title: String,
        /// Values of the first and the last colour.
        ends: [f64; 2],
        /// The colours between.
        map: Map,
    },
    /// They are those that the tile set is painted in: conditions and colours.
    Painted(Vec<(String, Rgb)>),
}

/// The colours of a slice.
pub struct Colours {
    /// What has colours.
    pub table: Table,
    seen: Seen,
    styles: BTreeMap<u64, Style>,
    /// What they mean; colours by value may be painted over.
    pub meanings: Vec<Meaning>,
}

impl Colours {
    /// How a voxel is drawn.
    pub fn at(&self, [x, y]: [u32; 2]) -> Style {
        let id = self.seen.ids[self.seen.place([x, y])];
        self.styles.get(&id).copied().unwrap_or(Style::Sample)
    }

    /// How the outline is drawn between two neighbouring voxels, where the surface crosses.
    pub fn between(&self, ends: [[u32; 2]; 2]) -> Style {
        let id = self.seen.edges.get(&self.seen.edge(ends));
        let style = id.and_then(|id| self.styles.get(id)).copied();
        style.unwrap_or(Style::Sample)
    }

    /// How many of the slice have a colour.
    pub fn coloured(&self) -> u64 {
        let coloured = |style: &&Style| matches!(style, Style::Colour(_));
        self.styles.values().filter(coloured).count() as u64
    }

    /// Values of the first and the last colour, if colours follow values.
    pub fn range(&self) -> Option<[f64; 2]> {
        self.meanings.iter().find_map(|meaning| match meaning {
            Meaning::Values { ends, .. } => Some(*ends),
            _ => None,
        })
    }

    /// How many have no value that means something.
    pub fn without_value(&self) -> u64 {
        let without = |style: &&Style| **style == Style::NoValue;
        self.styles.values().filter(without).count() as u64
    }
}

/// Finds the cells of a slice's below voxels, the objects of its above ones, or the surfaces between them, and their
/// colours: by value if that is asked for, else those of the tiles if these are painted so, else by id.
pub fn colours(
    dir: &Path,
    manifest: &Manifest,
    slice: &Slice,
    options: &PreviewOptions,
) -> Result<Colours> {
    let mut seen = Seen {
        table: table(manifest, options),
        width: slice.size[0],
        ids: vec![0; slice.values.len()],
        edges: HashMap::new(),
        painted: BTreeMap::new(),
    };
    let tiling = manifest.tiling();
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
                seeds(dir, manifest, slice, &entry, &mut seen)?;
            }
        }
    }
    match &options.labels {
        Some(labels) => seen.ids = labels.ids(dir, manifest, slice, seen.table)?,
        None => flood(manifest, slice, &mut seen),
    }
    let all = seen.ids.iter().chain(seen.edges.values()).copied();
    let ids: BTreeSet<u64> = all.filter(|&id| id != 0).collect();
    let asked = Chosen {
        table: seen.table,
        ..options.chosen.clone()
    };
    let chosen = match asked.is_all() {
        true => ids,
        false => matching(dir, manifest, &asked, &ids)?,
    };
    let (styles, meanings) = match (&options.colour_by, &manifest.selection) {
        (Some(column), _) => by_value(dir, manifest, column, &asked, options, &chosen)?,
        (None, Some(selection)) if is_painted(selection) && selection.last.table == seen.table => {
            as_painted(dir, manifest, selection, &chosen, &seen.painted)?
        }
        _ => {
            let style = |&id: &u64| (id, Style::Colour(by_id(id)));
            (chosen.iter().map(style).collect(), vec![Meaning::Ids])
        }
    };
    Ok(Colours {
        table: seen.table,
        seen,
        styles,
        meanings,
    })
}

/// The table that is asked for; of tiles that are painted that of the colours, unless anything is asked for.
pub fn table(manifest: &Manifest, options: &PreviewOptions) -> Table {
    let asked = options.chosen.table;
    let nothing = options.chosen == Chosen::default() && options.colour_by.is_none();
    let painted = manifest.selection.as_ref().filter(|s| is_painted(s));
    match painted.filter(|_| nothing) {
        Some(selection) => selection.last.table,
        None => asked,
    }
}

/// What the tiles have in a slice.
struct Seen {
    table: Table,
    /// Voxels to the right.
    width: u32,
    /// The cell or the object of each voxel, 0 if it has none or that is unknown.
    ids: Vec<u64>,
    /// The surface of each edge of the slice's grid that one crosses, if surfaces are asked for.
    edges: HashMap<usize, u64>,
    /// Those with a colour of their own in the tiles.
    painted: BTreeMap<u64, Rgb>,
}

impl Seen {
    fn place(&self, [x, y]: [u32; 2]) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// The number of the edge between two neighbouring voxels: two times that of the lower one, and one more if it runs
    /// down.
    fn edge(&self, [a, b]: [[u32; 2]; 2]) -> usize {
        2 * self.place(a).min(self.place(b)) + usize::from(a[1] != b[1])
    }
}

/// Writes the cell or object of each vertex in the slice to the voxel at that end of its edge, the surface to its edge.
fn seeds(
    dir: &Path,
    manifest: &Manifest,
    slice: &Slice,
    entry: &TileEntry,
    seen: &mut Seen,
) -> Result<()> {
    let path = file_inside(dir, &entry.path, "read the tile")?;
    let bytes = store::read(&path).map_err(|e| Error::io(&path, "read the tile", e))?;
    let bad = |e: ReadError| Error::format(&path, e.to_string(), "a tile");
    let tile = Tile::read(&bytes).map_err(bad)?;
    let step = LATTICE as i32;
    let plane = slice.at as i32 * step;
    for piece in pieces(&tile, manifest.primitives).map_err(bad)? {
        if piece.ids.cell == 0 {
            continue;
        }
        let id = piece.ids.of(seen.table);
        if let Some(colour) = piece.colour {
            seen.painted.insert(id, colour);
        }
        for p in piece.lattice().map_err(bad)? {
            if p[slice.axis as usize] != plane {
                continue;
            }
            let at = slice.axis.plane().map(|a| p[a]);
            // an edge in the slice: its ends are the voxels beside the one fraction
            let low = at.map(|v| v.div_euclid(step));
            let high = at.map(|v| (v + step - 1).div_euclid(step));
            let voxel = |end: [i32; 2]| {
                let [x, y] = end.map(|v| u32::try_from(v).ok());
                let (x, y) = (x?, y?);
                (low != high && x < slice.size[0] && y < slice.size[1]).then_some([x, y])
            };
            let (Some(low), Some(high)) = (voxel(low), voxel(high)) else {
                continue;
            };
            if seen.table == Table::Surfaces {
                seen.edges.insert(seen.edge([low, high]), id);
                continue;
            }
            for end in [low, high] {
                if slice.above(end, manifest.threshold) == (seen.table == Table::Objects) {
                    let at = seen.place(end);
                    seen.ids[at] = id;
                }
            }
        }
    }
    Ok(())
}

/// Spreads cells over the below voxels, or objects over the above ones, that are connected in the slice: they are
/// connected in the volume too. Where cells are parts of components, see [`hollows`].
fn flood(manifest: &Manifest, slice: &Slice, seen: &mut Seen) {
    let [width, height] = slice.size.map(i64::from);
    let objects = seen.table == Table::Objects;
    let diagonal = objects == (manifest.ambiguous == Ambiguous::Join);
    let of_walls = seen.ids.clone();
    let ids = &mut seen.ids;
    let mut distances = vec![0; ids.len()];
    // voxels to go on from, by their distance from the wall that gave them their number
    let start = |i: usize| Reverse((0, i, i));
    let mut open: BinaryHeap<_> = (0..ids.len()).filter(|&i| ids[i] != 0).map(start).collect();
    let place = |i: usize| [i as i64 % width, i as i64 / width];
    while let Some(Reverse((distance, i, from))) = open.pop() {
        let ([x, y], [from_x, from_y]) = (place(i), place(from));
        if ids[i] == 0 {
            ids[i] = ids[from];
            distances[i] = distance;
        } else if i != from {
            continue;
        }
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
            if ids[n] == 0 && above == objects {
                let off = [u - from_x, v - from_y];
                open.push(Reverse((off[0] * off[0] + off[1] * off[1], n, from)));
            }
        }
    }
    if manifest.cells.is_some() && seen.table == Table::Cells {
        hollows(width as usize, &distances, &of_walls, ids);
    }
}

/// Gives each voxel of a slice the cell that has most of the walls around the hollow that it lies in. Tiles tell which cell
/// a wall is of and not what is between, so a voxel goes up to where walls are farther away, as cells are split.
///
/// `distances` are those from the walls, squared, `of_walls` the cells there; `ids` are those of the nearest walls.
fn hollows(width: usize, distances: &[i64], of_walls: &[u64], ids: &mut [u64]) {
    let height = ids.len() / width;
    let mut order: Vec<usize> = (0..ids.len()).filter(|&i| ids[i] != 0).collect();
    order.sort_by_key(|&i| (Reverse(distances[i]), i));
    let mut middle: Vec<usize> = (0..ids.len()).collect();
    for &i in &order {
        let [x, y] = [i % width, i / width];
        let around = (y.saturating_sub(1)..(y + 2).min(height))
            .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u));
        // the farthest from walls, of equal ones the first
        let up = around
            .filter(|&n| ids[n] != 0)
            .min_by_key(|&n| (Reverse(distances[n]), n))
            .expect("itself at least");
        if (Reverse(distances[up]), up) < (Reverse(distances[i]), i) {
            middle[i] = middle[up];
        }
    }
    let mut votes: BTreeMap<(usize, u64), usize> = BTreeMap::new();
    for (i, &cell) in of_walls.iter().enumerate().filter(|(_, cell)| **cell != 0) {
        *votes.entry((middle[i], cell)).or_default() += 1;
    }
    let mut winners: HashMap<usize, (usize, u64)> = HashMap::new();
    for ((hollow, cell), count) in votes {
        let best = winners.entry(hollow).or_insert((count, cell));
        if count > best.0 {
            *best = (count, cell);
        }
    }
    for i in order {
        if let Some((_, cell)) = winners.get(&middle[i]) {
            ids[i] = *cell;
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

/// True if the tiles have colours.
fn is_painted(selection: &Selection) -> bool {
    selection.colour_by.is_some() || !selection.painted.is_empty()
}

/// Those of some ids that are chosen.
fn matching(
    dir: &Path,
    manifest: &Manifest,
    chosen: &Chosen,
    ids: &BTreeSet<u64>,
) -> Result<BTreeSet<u64>> {
    let mut table = chosen.table.open(dir, manifest)?;
    let query = chosen.query(&table)?;
    let id = table.own_column("id")?;
    let mut found = BTreeSet::new();
    while let Some(row) = table.next_row()? {
        let id = row.whole(id)?;
        if ids.contains(&id) && query.keeps(&row)? {
            found.insert(id);
        }
    }
    Ok(found)
}

type Styled = (BTreeMap<u64, Style>, Vec<Meaning>);

/// The colours of painted tiles. Where these follow values, what has none is grey in the tiles.
fn as_painted(
    dir: &Path,
    manifest: &Manifest,
    selection: &Selection,
    ids: &BTreeSet<u64>,
    painted: &BTreeMap<u64, Rgb>,
) -> Result<Styled> {
    let mut meanings = Vec::new();
    let mut without = Style::Sample;
    if let Some(by) = &selection.colour_by {
        let columns = selection.last.table.open(dir, manifest)?;
        meanings.push(Meaning::Values {
            title: titled(&by.column, columns.columns()),
            ends: [by.min, by.max],
            map: Map::named(&by.map)?,
        });
        without = Style::NoValue;
    }
    if !selection.painted.is_empty() {
        let rule = |p: &Paint| Ok((p.condition.clone(), parse_colour("painted", &p.colour)?));
        let rules: Result<Vec<_>> = selection.painted.iter().map(rule).collect();
        meanings.push(Meaning::Painted(rules?));
    }
    let style = |&id: &u64| (id, painted.get(&id).map_or(without, |&c| Style::Colour(c)));
    Ok((ids.iter().map(style).collect(), meanings))
}

/// A column or expression with its unit.
fn titled(column: &str, columns: &[Column]) -> String {
    let known = columns.iter().find(|c| c.name == column.trim());
    known.map_or_else(|| column.trim().to_owned(), Column::header)
}

/// True if a column means something for what the volume's faces cut; most measures do not.
fn holds_at_border(column: &str) -> bool {
    const HOLD: [&str; 5] = [
        "id",
        "cell",
        "object",
        "touches_border",
        "not touches_border",
    ];
    HOLD.contains(&column.trim())
}

/// Colours by value. Unless a range is given, the map spans the values of all rows of the table that mean something
/// and are chosen, so that slices compare.
fn by_value(
    dir: &Path,
    manifest: &Manifest,
    column: &str,
    asked: &Chosen,
    options: &PreviewOptions,
    ids: &BTreeSet<u64>,
) -> Result<Styled> {
    let mut table = asked.table.open(dir, manifest)?;
    let query = asked.query(&table)?;
    let columns = table.columns();
    let value = Expr::number("--colour-by", column, columns)?;
    let title = titled(column, columns);
    let id = table.own_column("id")?;
    let border = table
        .column("touches_border")
        .filter(|_| !holds_at_border(column));
    let mut values = BTreeMap::new();
    let [mut min, mut max] = [f64::INFINITY, f64::NEG_INFINITY];
    while let Some(row) = table.next_row()? {
        let cut = border.map(|c| row.number(c)).transpose()?.flatten() == Some(1.0);
        if let (Some(v), true, false) = (value.value(&row)?, query.keeps(&row)?, cut) {
            [min, max] = [min.min(v), max.max(v)];
            let id = row.whole(id)?;
            if ids.contains(&id) {
                values.insert(id, v);
            }
        }
    }
    // no value at all: any range will do
    let found = if min > max { [0.0, 1.0] } else { [min, max] };
    let ends = options.range.unwrap_or(found);
    let share = |v: f64| {
        if ends[0] == ends[1] {
            0.5
        } else {
            place(ends, v)
        }
    };
    let style = |&id: &u64| {
        let colour = values.get(&id).map(|&v| options.map.at(share(v)));
        (id, colour.map_or(Style::NoValue, Style::Colour))
    };
    let map = options.map;
    let meaning = Meaning::Values { title, ends, map };
    Ok((ids.iter().map(style).collect(), vec![meaning]))
}
