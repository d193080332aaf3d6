//! The sums of a tile set.

use crate::convert::ConvertOptions;
use crate::convert::cells::Opening;
use crate::convert::components::Components;
use crate::convert::label::LeftOut;
use crate::convert::walls::JudgedWall;
use crate::error::Result;
use crate::manifest::{Dust, Totals};
use crate::measure::MeshSums;
use crate::tileset::with_euler_characteristic;

/// What was left out, if that was asked for.
pub fn dust_of(options: &ConvertOptions, [objects, cells]: LeftOut) -> Option<Dust> {
    (options.min_voxels > 1).then_some(Dust {
        min_voxels: options.min_voxels,
        objects: objects.0,
        object_voxels: objects.1,
        cells: cells.0,
        cell_voxels: cells.1,
    })
}

/// The sums that labelling and meshing know.
#[derive(Debug, Clone, Copy)]
pub struct ScannedSums {
    /// Over all caps.
    pub caps: MeshSums,
    /// NaN samples.
    pub nan: u64,
}

impl ScannedSums {
    /// The totals: those of the tiles that are `written`, and what follows from the components, closed at the faces of
    /// the volume with `cap`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn totals(&self, written: Totals, components: &Components, cap: bool) -> Result<Totals> {
        let mut totals = Totals {
            cap_triangles: self.caps.triangles,
            vertices: self.caps.vertices,
            volume6: self.caps.volume6,
            voxels_nan: self.nan,
            objects: components.places.objects.own,
            cells: components.own_cells(),
            necks: components
                .given
                .as_ref()
                .map_or(0, |given| given.cells.openings.records::<Opening>()),
            walls: components
                .walls
                .as_ref()
                .map_or(0, |known| known.walls.records::<JudgedWall>()),
            components: components
                .given
                .as_ref()
                .map_or(0, |given| given.places.own),
            surfaces: components.places.surfaces.own,
            ..written
        };
        for i in 0..components.places.objects.own {
            totals.voxels_above += components.objects.get(i)?.voxels.voxels;
        }
        for i in 0..components.places.surfaces.own {
            let mesh = components.surfaces.get(i)?.mesh;
            totals.vertices += mesh.vertices;
            totals.volume6 += mesh.volume6;
            totals.border_edges += mesh.border_edges;
        }
        if cap {
            totals.border_edges = 0;
        }
        Ok(with_euler_characteristic(totals))
    }
}

/// The sums of two parts of a volume together.
pub fn together(a: Totals, b: &Totals) -> Totals {
    with_euler_characteristic(Totals {
        tiles: a.tiles + b.tiles,
        triangles: a.triangles + b.triangles,
        vertices: a.vertices + b.vertices,
        tile_vertices: a.tile_vertices + b.tile_vertices,
        strips: a.strips + b.strips,
        strip_indices: a.strip_indices + b.strip_indices,
        objects: a.objects + b.objects,
        cells: a.cells + b.cells,
        components: a.components + b.components,
        necks: a.necks + b.necks,
        walls: a.walls + b.walls,
        surfaces: a.surfaces + b.surfaces,
        border_edges: a.border_edges + b.border_edges,
        euler_characteristic: 0,
        cap_triangles: a.cap_triangles + b.cap_triangles,
        bytes: a.bytes + b.bytes,
        voxels_above: a.voxels_above + b.voxels_above,
        voxels_nan: a.voxels_nan + b.voxels_nan,
        volume6: a.volume6 + b.volume6,
    })
}
