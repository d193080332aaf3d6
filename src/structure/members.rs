//! Which cells of a set count in what its structure is told of.

use super::SurfaceOf;
use crate::error::Result;
use crate::sys::id_set::IdSet;
use crate::table::{Outside, TableReader, each_cell};
use crate::tileset::TileSet;

/// Which cells count, and how large they are together.
pub(super) struct Members {
    pub surface_of: SurfaceOf,
    /// Cells whose surface does not count.
    pub left_out: IdSet,
    /// Cells that are air around the sample, and their voxels.
    pub outside: IdSet,
    pub outside_voxels: u64,
    /// The first of their openings to a cell that is not outside, and that cell: their surface ends there.
    pub opening: Option<[u64; 2]>,
    /// Volume of those that count, in the grid of cubes that the surface lies in.
    pub volume: f64,
}

impl Members {
    /// Those of a set; one pass over the table of cells, and one over that of necks if some are outside.
    ///
    /// # Errors
    /// What reading returns.
    pub fn read(set: &TileSet, outside: Outside) -> Result<Self> {
        let manifest = set.manifest();
        let dims = manifest.grid.dims;
        let in_region = manifest
            .region
            .as_ref()
            .is_some_and(|region| region.outside(dims) > 0);
        let mut members = Members {
            surface_of: match (in_region, outside) {
                (true, _) => SurfaceOf::WholeCells,
                (false, Outside::BorderCell) => SurfaceOf::CellsWithoutOutside,
                (false, Outside::None) => SurfaceOf::Cells,
            },
            left_out: IdSet::default(),
            outside: IdSet::default(),
            outside_voxels: 0,
            opening: None,
            volume: 0.0,
        };
        let mut any_cut = false;
        each_cell(set.dir(), manifest, outside, |cell| {
            if cell.outside {
                members.outside.insert(cell.id);
                members.outside_voxels = members.outside_voxels.saturating_add(cell.voxels);
            }
            if cell.outside || (in_region && cell.at_border) {
                members.left_out.insert(cell.id);
                return;
            }
            members.volume += cell.volume;
            any_cut |= cell.at_border;
        })?;
        if any_cut {
            // the surface lies between the middles of voxels, half a voxel inside of their outer sides
            let shares = dims.0.map(|n| f64::from(n - 1) / f64::from(n));
            members.volume *= shares.iter().product::<f64>();
        }
        members.opening = opening(set, &members.outside)?;
        Ok(members)
    }

    /// What a user should know of the cells that count.
    pub fn note(&self) -> Option<String> {
        let note = "the surface of cells at the border runs along the edge of the region as well: anisotropy is of whole \
                    cells";
        (self.surface_of == SurfaceOf::WholeCells).then(|| note.to_owned())
    }

    /// True if some cells count as outside, and their surface bounds them.
    pub fn bound_outside(&self) -> bool {
        self.outside.len() > 0 && self.opening.is_none()
    }

    /// Why porosity by slices cannot be told without the cells that count as outside, if so: no tile tells where these
    /// end.
    pub fn refusal(&self) -> Option<String> {
        let [outside, other] = self.opening?;
        Some(format!(
            "porosity by slices and boxes: cell {outside}, which counts as outside, is open to cell {other}, and no tile \
             tells where it ends; a conversion of the sample alone (--roi cylinder, or --crop) tells it, or one without \
             --split or --labels"
        ))
    }
}

/// The first opening between a cell of `outside` and another one, by the table of necks.
fn opening(set: &TileSet, outside: &IdSet) -> Result<Option<[u64; 2]>> {
    let Some(path) = set.manifest().tables.necks.as_ref() else {
        return Ok(None);
    };
    if outside.len() == 0 {
        return Ok(None);
    }
    let mut table = TableReader::open_keyed(&set.path(path)?, "cell_a")?;
    let (a, b) = (table.own_column("cell_a")?, table.own_column("cell_b")?);
    while let Some(row) = table.next_row()? {
        let (a, b) = (row.whole(a)?, row.whole(b)?);
        match (outside.contains(a), outside.contains(b)) {
            (true, false) => return Ok(Some([a, b])),
            (false, true) => return Ok(Some([b, a])),
            _ => {}
        }
    }
    Ok(None)
}
