//! Chords of walls: pairs of vertices that follow each other on a line, from one cell to another.

use super::slant::{Slant, by_normal};
use crate::error::Result;
use crate::grid::Placement;
use crate::verify::first::voxel_key;
use crate::verify::marks::axis;
use crate::verify::piece::{Piece, Region, Vertex, position};
use crate::verify::rim::cell_is_low;
use crate::verify::spill::{Merge, Spill};

/// Records that each sort keeps in memory: a quarter of a mebibyte.
const IN_MEMORY: usize = 1 << 12;
/// Lattice steps of a voxel.
const STEPS: f64 = 256.0;
/// Bins that the thickness of a voxel of the finest axis is counted in.
pub(super) const BINS: f64 = 64.0;
/// The greatest thickness of a wall, in these voxels.
pub(super) const WIDEST: f64 = 32.0;
/// Chords that measure less are thin, in voxels of their axis.
pub(super) const THIN: f64 = 2.0;
/// Parts of the smallest face of a voxel that areas are summed up in.
pub(super) const AREA_PARTS: f64 = 65_536.0;
/// What a cosine of 1 is written as.
const ONE: f64 = 65_536.0;

/// How walls are measured.
#[derive(Debug, Clone, Copy)]
pub(in crate::verify) struct WallScale {
    /// The finest spacing, and that over the spacing of each axis.
    pub finest: f64,
    pub finest_over: [f64; 3],
    /// The area of the smallest face of a voxel, and that of the face across each axis by it.
    pub smallest_face: f64,
    pub faces: [f64; 3],
}

impl WallScale {
    /// Of voxels of this size.
    pub fn new(spacing: [f64; 3]) -> Self {
        let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let voxel: f64 = spacing.iter().product();
        let areas = spacing.map(|s| voxel / s);
        let smallest_face = areas.into_iter().fold(f64::INFINITY, f64::min);
        WallScale {
            finest,
            finest_over: spacing.map(|s| finest / s),
            smallest_face,
            faces: areas.map(|area| area / smallest_face),
        }
    }

    /// Of the grid of a set.
    pub fn of(place: &Placement) -> Self {
        WallScale::new(place.spacing)
    }
}

/// A vertex, where a line crosses the surface.
#[derive(Debug, Clone, Copy)]
pub(in crate::verify) struct Crossing {
    pub point: Vertex,
    /// The line leaves what is above there.
    pub leaves: bool,
    pub normal: [f32; 3],
    /// The cell at its end below; 0 as long as it is not known.
    pub cell: u64,
}

impl Crossing {
    /// Those of a piece of a cell that the tile is the first to have.
    pub fn of<'a>(
        piece: &'a Piece,
        cell: u64,
        region: &'a Region,
    ) -> impl Iterator<Item = Self> + 'a {
        let all = piece.points.iter().zip(&piece.state).zip(&piece.normals);
        let own = all.filter(|((point, _), _)| region.owns(position(**point)));
        own.map(move |((point, state), normal)| Crossing {
            point: *point,
            leaves: !cell_is_low(*state),
            normal: *normal,
            cell,
        })
    }

    pub fn axis(&self) -> usize {
        usize::from(axis(self.point[3]))
    }

    /// The voxel below.
    pub fn voxel_below(&self) -> [i32; 3] {
        let mut voxel = position(self.point).map(|c| c >> 8);
        voxel[self.axis()] += i32::from(self.leaves);
        voxel
    }

    /// The same as [`voxel_key`].
    fn below(&self) -> u64 {
        voxel_key(self.voxel_below())
    }

    fn end(&self, slant: &Slant) -> End {
        let axis = self.axis();
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|a| (self.point[a] >> 8) as u64);
        let whole = |[least, greatest]: [f64; 2]| [(least * ONE).floor(), (greatest * ONE).ceil()];
        End {
            line: (axis as u64) << 32 | u << 16 | v,
            position: self.point[axis] as u64,
            leaves: self.leaves,
            cell: self.cell,
            cosine: whole(slant.cosine).map(|v| v as u32),
            share: whole(slant.share).map(|v| v as u32),
        }
    }
}

/// The end of a chord.
#[derive(Debug, Clone, Copy)]
struct End {
    /// Its axis, and the place of the line among those along this.
    line: u64,
    /// Where on the line, in lattice steps.
    position: u64,
    leaves: bool,
    cell: u64,
    /// Bounds of the cosine of the normal to the axis, and of the share that this has of a wall.
    cosine: [u32; 2],
    share: [u32; 2],
}

/// Words of [`End`].
const END: usize = 5;

impl End {
    fn pack(&self) -> [u64; END] {
        let both = |bounds: [u32; 2]| u64::from(bounds[0]) << 32 | u64::from(bounds[1]);
        [
            self.line,
            self.position << 1 | u64::from(self.leaves),
            self.cell,
            both(self.cosine),
            both(self.share),
        ]
    }

    fn unpack([line, position, cell, cosine, share]: [u64; END]) -> Self {
        let bounds = |word: u64| [(word >> 32) as u32, word as u32];
        End {
            line,
            position: position >> 1,
            leaves: position & 1 == 1,
            cell,
            cosine: bounds(cosine),
            share: bounds(share),
        }
    }
}

/// Chords of two cells that lie in the same bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Chords {
    /// The cells, the smaller one first.
    pub cells: [u64; 2],
    /// The least and the greatest bin of their thickness.
    pub bins: [u32; 2],
    /// They count beyond doubt.
    pub certain: bool,
    /// They may be thin, and are so beyond doubt.
    pub thin: [bool; 2],
    pub count: u64,
    /// Bounds of the area that they stand for, in [`AREA_PARTS`].
    pub area: [u64; 2],
}

/// Words of [`Chords`], and how many of them are the same for chords that are added up.
const CHORDS: usize = 7;
const KEY: usize = 4;

impl Chords {
    fn pack(&self) -> [u64; CHORDS] {
        let [a, b] = self.cells;
        let [least, greatest] = self.bins.map(u64::from);
        let [may, is] = self.thin.map(u64::from);
        let flags = u64::from(self.certain) << 2 | may << 1 | is;
        let [low, high] = self.area;
        [a, b, least << 32 | greatest, flags, self.count, low, high]
    }

    fn unpack([a, b, bins, flags, count, low, high]: [u64; CHORDS]) -> Self {
        Chords {
            cells: [a, b],
            bins: [(bins >> 32) as u32, bins as u32],
            certain: flags & 4 != 0,
            thin: [flags & 2 != 0, flags & 1 != 0],
            count,
            area: [low, high],
        }
    }
}

/// What two ends that follow each other are.
enum Pair {
    /// No chord that counts.
    None,
    /// A chord, if its cells differ, of which one is not known.
    Unknown,
    Chord(Chords),
}

/// The chord from where a line enters what is above to where it leaves it next.
fn pair(enters: &End, leaves: &End, scale: &WallScale) -> Pair {
    let known = enters.cell != 0 && leaves.cell != 0;
    let has_none = enters.share[1] == 0 || leaves.share[1] == 0;
    if has_none || (known && enters.cell == leaves.cell) {
        return Pair::None;
    }
    let axis = (enters.line >> 32) as usize;
    let length = (leaves.position - enters.position) as f64 / STEPS;
    let cosine = |i: usize| (f64::from(enters.cosine[i]) + f64::from(leaves.cosine[i])) / 2.0 / ONE;
    let cosines = [cosine(0), cosine(1)];
    let thickness = cosines.map(|c| c * length / scale.finest_over[axis] * BINS);
    if thickness[0] >= WIDEST * BINS {
        return Pair::None;
    }
    if !known {
        return Pair::Unknown;
    }
    let share = |i: usize| (f64::from(enters.share[i]) + f64::from(leaves.share[i])) / 2.0 / ONE;
    let area = [share(0) / cosines[1], share(1) / cosines[0]];
    let area = area.map(|area| AREA_PARTS * scale.faces[axis] * area);
    Pair::Chord(Chords {
        cells: [enters.cell.min(leaves.cell), enters.cell.max(leaves.cell)],
        bins: thickness.map(|t| t as u32),
        certain: enters.share[0] > 0 && leaves.share[0] > 0 && thickness[1] < WIDEST * BINS,
        thin: [0, 1].map(|i| cosines[i] * length < THIN),
        count: 1,
        area: [(area[0] - 0.5).floor().max(1.0), (area[1] + 1.0).ceil()].map(|v| v as u64),
    })
}

/// What a tile has of chords.
#[derive(Default)]
pub(in crate::verify) struct TileChords {
    chords: Vec<[u64; CHORDS]>,
    /// Ends of those that go on in other tiles.
    ends: Vec<[u64; END]>,
    /// Chords whose cells are not both known.
    unknown: u64,
}

/// The chords of a tile. Cells that are not known are those of `begins`: voxels, as [`voxel_key`], by rising numbers, with the
/// cells whose triangles begin there. `by_volume` are slants by the samples of the volume, if there is one.
pub(in crate::verify) fn of_tile(
    crossings: &[Crossing],
    begins: &[(u64, u64)],
    by_volume: Option<&[Slant]>,
    scale: &WallScale,
) -> TileChords {
    let cell = |crossing: &Crossing| match crossing.cell {
        0 => begins
            .binary_search_by_key(&crossing.below(), |begin| begin.0)
            .map_or(0, |i| begins[i].1),
        cell => cell,
    };
    let end = |(i, crossing): (usize, &Crossing)| {
        let slant = match by_volume {
            Some(slants) => slants[i],
            None => by_normal(crossing.normal, crossing.axis(), scale),
        };
        let cell = cell(crossing);
        Crossing { cell, ..*crossing }.end(&slant)
    };
    let mut ends: Vec<End> = crossings.iter().enumerate().map(end).collect();
    ends.sort_unstable_by_key(|end| (end.line, end.position));
    let mut out = TileChords::default();
    for line in ends.chunk_by(|a, b| a.line == b.line) {
        if line[0].leaves {
            out.ends.push(line[0].pack());
        }
        for two in line
            .windows(2)
            .filter(|two| !two[0].leaves && two[1].leaves)
        {
            match pair(&two[0], &two[1], scale) {
                Pair::None => {}
                Pair::Unknown => out.unknown += 1,
                Pair::Chord(chord) => out.chords.push(chord.pack()),
            }
        }
        if let Some(last) = line.last().filter(|last| !last.leaves) {
            out.ends.push(last.pack());
        }
    }
    out.chords.sort_unstable();
    out.chords.dedup_by(|next, kept| add(kept, next));
    out
}

/// Adds up chords of the same cells in the same bins; false if they are not.
fn add(kept: &mut [u64; CHORDS], next: &[u64; CHORDS]) -> bool {
    let same = kept[..KEY] == next[..KEY];
    if same {
        (KEY..CHORDS).for_each(|i| kept[i] += next[i]);
    }
    same
}

/// Collects the chords of all tiles.
pub(in crate::verify) struct WallLedger {
    scale: WallScale,
    chords: Spill<CHORDS>,
    ends: Spill<END>,
    unknown: u64,
}

impl WallLedger {
    pub fn new(scale: WallScale) -> Self {
        WallLedger {
            scale,
            chords: Spill::new(IN_MEMORY),
            ends: Spill::new(IN_MEMORY),
            unknown: 0,
        }
    }

    /// Adds those of a tile.
    ///
    /// # Errors
    /// If a temporary file cannot be written, or read back, here and below.
    pub fn add(&mut self, tile: TileChords) -> Result<()> {
        self.unknown += tile.unknown;
        tile.chords
            .into_iter()
            .try_for_each(|chords| self.chords.push(chords))?;
        tile.ends
            .into_iter()
            .try_for_each(|end| self.ends.push(end))
    }

    /// The chords of all pairs of cells, by these.
    pub(super) fn into_sorted(mut self) -> Result<SortedChords> {
        let mut ends = self.ends.into_sorted()?;
        let mut before: Option<End> = None;
        while let Some(end) = ends.next()?.map(End::unpack) {
            let enters = before.replace(end);
            let enters = enters.filter(|b| b.line == end.line && !b.leaves && end.leaves);
            match enters.map_or(Pair::None, |enters| pair(&enters, &end, &self.scale)) {
                Pair::None => {}
                Pair::Unknown => self.unknown += 1,
                Pair::Chord(chord) => self.chords.push(chord.pack())?,
            }
        }
        let mut merge = self.chords.into_sorted()?;
        Ok(SortedChords {
            next: merge.next()?.map(Chords::unpack),
            merge,
            unknown: self.unknown,
        })
    }
}

/// Chords by their cells.
pub(super) struct SortedChords {
    merge: Merge<CHORDS>,
    next: Option<Chords>,
    /// Chords of which a cell is not known.
    pub unknown: u64,
}

impl SortedChords {
    /// The cells of the next ones.
    pub fn peek(&self) -> Option<[u64; 2]> {
        self.next.map(|chords| chords.cells)
    }

    /// The next ones.
    pub fn next(&mut self) -> Result<Option<Chords>> {
        let next = self.next.take();
        if next.is_some() {
            self.next = self.merge.next()?.map(Chords::unpack);
        }
        Ok(next)
    }
}
