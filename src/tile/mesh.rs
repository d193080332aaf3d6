//! A whole tile as plain vectors, for programs that want its triangles and not its bytes.

use super::extras::of_pieces;
use super::node::node_extras;
use super::pieces::{Piece, pieces};
use super::read::{PieceIds, Tile};
use crate::gltf::container::{Fault, Result, fail};
use crate::gltf::{TRIANGLE_STRIP, TRIANGLES};
use crate::manifest::Primitives;
use serde_json::{Map, Value};

/// A tile, copied out of its file: the same for strips and lists, for node and merged layout and for
/// every encoding, but that quantized tiles have rounded normals.
#[derive(Debug, Clone, PartialEq)]
pub struct TileMesh {
    /// Voxel coordinates to metres, Y up; column-major, the same in every tile of a set.
    pub matrix: [f64; 16],
    /// The surface pieces, in the order of the shard's `groups`.
    pub pieces: Vec<SurfacePiece>,
}

/// One surface piece: all triangles of a tile between one cell and one object.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfacePiece {
    /// Cell, object, surface and the number of triangles, as the file states them.
    pub ids: PieceIds,
    /// `cell_17`, `cell_17_object_3` or `cap_object_3`; empty in the merged layout.
    pub name: String,
    /// Voxel coordinates: multiples of 1/256, exact.
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors in voxel coordinates that point from above to below, one for each position. As
    /// glTF demands, the inverse transpose of the matrix takes them to metres.
    pub normals: Vec<[f32; 3]>,
    /// Indices into `positions`, counter-clockwise seen from the below side; joints of strips are
    /// left out.
    pub triangles: Vec<[u32; 3]>,
    /// The ids again and the measures of the whole cell, by the names in `schema/extras.schema.json`.
    /// A measure that has no meaning for the cell is absent.
    pub extras: Map<String, Value>,
}

impl SurfacePiece {
    /// True for a part of a cap, which belongs to no cell.
    pub fn is_cap(&self) -> bool {
        self.ids.cell == 0
    }

    /// A measure by its name, in the unit that `unit` in the extras names: `volume`, `area`,
    /// `sphericity`. `None` if it is absent or a text.
    pub fn measure(&self, name: &str) -> Option<f64> {
        self.extras.get(name)?.as_f64()
    }

    /// The three positions of a triangle.
    ///
    /// # Panics
    /// If an index is not one of this piece's [`SurfacePiece::triangles`].
    pub fn corners(&self, triangle: [u32; 3]) -> [[f32; 3]; 3] {
        triangle.map(|i| self.positions[i as usize])
    }
}

impl TileMesh {
    /// Reads the bytes of a tile's file.
    ///
    /// # Errors
    /// [`super::read::ReadError`] with the kind and place of the first damage. Nothing is allocated
    /// that is not in proportion to the file.
    ///
    /// # Examples
    /// ```no_run
    /// let bytes = std::fs::read("foam/tiles/z0000/y0000_x0000.glb").unwrap();
    /// for piece in alvis::tile::TileMesh::read(&bytes)?.pieces {
    ///     println!("cell {}: {} triangles", piece.ids.cell, piece.triangles.len());
    /// }
    /// # Ok::<(), alvis::tile::read::ReadError>(())
    /// ```
    pub fn read(bytes: &[u8]) -> Result<Self> {
        Self::of(&Tile::read(bytes)?)
    }

    /// Copies a tile that has been read.
    ///
    /// # Errors
    /// As [`TileMesh::read`].
    pub(crate) fn of(tile: &Tile) -> Result<Self> {
        let kind = kind(tile)?;
        let (pieces, extras) = (pieces(tile, kind)?, of_pieces(tile)?);
        let pieces = pieces.into_iter().zip(extras);
        Ok(TileMesh {
            matrix: tile.matrix,
            pieces: pieces.map(|(p, extras)| whole(p, kind, extras)).collect(),
        })
    }
}

/// A node of a level of detail, copied out of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeMesh {
    /// Voxel coordinates to metres, Y up; column-major, the same in every tile and node of a set.
    pub matrix: [f64; 16],
    /// Its level, from 1 on.
    pub level: u32,
    /// How far its surfaces lie from those of the tiles, in voxels, as it is estimated.
    pub error: f64,
    /// The parts of surfaces, in the order of the rows of its table; caps come last.
    pub pieces: Vec<SurfacePiece>,
    /// Their fins: rectangles in the planes of the node that close what could be seen through beside finer nodes.
    pub fins: Vec<SurfacePiece>,
}

impl NodeMesh {
    /// Reads the bytes of a node's file.
    ///
    /// # Errors
    /// As [`TileMesh::read`].
    pub fn read(bytes: &[u8]) -> Result<Self> {
        Self::of(&Tile::read_node(bytes)?)
    }

    /// Copies a node that has been read.
    ///
    /// # Errors
    /// As [`TileMesh::read`].
    pub(crate) fn of(tile: &Tile) -> Result<Self> {
        let said = node_extras(tile)?;
        let kind = kind(tile)?;
        let (pieces, extras) = (pieces(tile, kind)?, of_pieces(tile)?);
        let all = pieces.into_iter().zip(extras);
        let mut pieces: Vec<SurfacePiece> = all.map(|(p, extras)| whole(p, kind, extras)).collect();
        let Some(surfaces) = pieces.len().checked_sub(said.fin_rows as usize) else {
            return fail(Fault::Extras, "/nodes/0/extras", "more fins than rows");
        };
        let fins = pieces.split_off(surfaces);
        Ok(NodeMesh {
            matrix: tile.matrix,
            level: said.level,
            error: said.error,
            pieces,
            fins,
        })
    }
}

fn whole(piece: Piece, kind: Primitives, extras: Map<String, Value>) -> SurfacePiece {
    SurfacePiece {
        triangles: piece.list(kind),
        ids: piece.ids,
        name: piece.name,
        positions: piece.positions,
        normals: piece.normals,
        extras,
    }
}

/// The kind of a tile's primitives, by the first of them.
fn kind(tile: &Tile) -> Result<Primitives> {
    match tile.primitives.first().map(|p| p.mode) {
        Some(TRIANGLE_STRIP) => Ok(Primitives::Strips),
        Some(TRIANGLES) => Ok(Primitives::Triangles),
        mode => fail(
            Fault::Structure,
            "/meshes/0/primitives/0/mode",
            format!("found mode {mode:?}, expected {TRIANGLE_STRIP} or {TRIANGLES}"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::{ConvertOptions, convert};
    use crate::grid::Dims;
    use crate::manifest::Primitives;
    use crate::phantom::{Phantom, Shape, render};
    use crate::progress::Quiet;
    use crate::tileset::TileSet;
    use crate::volume::Dtype;

    /// Tiles of a volume with very many pieces, or with few.
    fn tiles(density: Option<f64>, primitives: Primitives) -> Vec<TileMesh> {
        let shape = density.map_or(Shape::Sphere { radius: 9.0 }, |density| Shape::Noise {
            density,
        });
        let dims = Dims::new([26, 25, 24]).unwrap();
        let volume = render(&Phantom::new(shape), dims, Dtype::U8).unwrap();
        let options = ConvertOptions {
            threshold: volume.threshold(),
            primitives,
            ..ConvertOptions::default()
        };
        let dir = tempfile::tempdir().unwrap();
        convert(&volume, &options, dir.path(), &Quiet).unwrap();
        let set = TileSet::open(dir.path()).unwrap();
        set.tiles()
            .map(|t| set.read_tile(&t.unwrap()).unwrap())
            .collect()
    }

    /// Triangles by their corners, the smallest first.
    fn canonical(piece: &SurfacePiece) -> Vec<[[u32; 3]; 3]> {
        let mut all: Vec<_> = piece
            .triangles
            .iter()
            .map(|&t| {
                let t = piece.corners(t).map(|p| p.map(|c| (c * 256.0) as u32));
                let first = (0..3).min_by_key(|&i| t[i]).unwrap();
                std::array::from_fn(|i| t[(first + i) % 3])
            })
            .collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn strips_and_lists_are_the_same_triangles_in_both_layouts() {
        for density in [None, Some(0.1)] {
            let [strips, lists] =
                [Primitives::Strips, Primitives::Triangles].map(|p| tiles(density, p));
            assert_eq!(strips.len(), lists.len());
            for (a, b) in strips.iter().zip(&lists) {
                let merged = a.pieces.len() > crate::tile::MAX_NODES;
                assert_eq!(merged, density.is_some());
                assert_eq!(a.pieces.len(), b.pieces.len());
                for (a, b) in a.pieces.iter().zip(&b.pieces) {
                    assert_eq!(a.ids, b.ids);
                    assert_eq!(a.ids.triangles, a.triangles.len() as u64);
                    assert_eq!(a.extras, b.extras);
                    assert_eq!(a.positions.len(), a.normals.len());
                    assert_eq!(canonical(a), canonical(b));
                    assert_eq!(a.name.is_empty(), merged);
                }
            }
        }
    }

    #[test]
    fn triangles_face_the_below_side_and_measures_are_there() {
        let tiles = tiles(None, Primitives::Strips);
        let piece = &tiles[0].pieces[0];
        assert!(!piece.is_cap());
        let mut volume = 0.0;
        for &t in &piece.triangles {
            let [a, b, c] = piece
                .corners(t)
                .map(|p| glam::DVec3::from(p.map(f64::from)));
            let centre = glam::DVec3::new(12.5, 12.0, 11.5);
            volume += (a - centre).dot((b - centre).cross(c - centre)) / 6.0;
        }
        let ball = 4.0 / 3.0 * std::f64::consts::PI * (9.0 * 9.0 * 9.0);
        assert!((volume / ball - 1.0).abs() < 0.02, "{volume} {ball}");
        assert_eq!(piece.measure("cell"), Some(1.0));
        assert_eq!(piece.measure("touches_border"), Some(1.0));
        assert_eq!(piece.measure("mesh_volume"), None);
        assert_eq!(piece.measure("unit"), None);
    }

    #[test]
    fn rows_of_the_table_carry_the_measures() {
        let tiles = tiles(Some(0.9), Primitives::Strips);
        let pieces = &tiles[0].pieces;
        assert!(pieces.len() > crate::tile::MAX_NODES);
        for piece in pieces {
            assert_eq!(piece.measure("cell"), Some(piece.ids.cell as f64));
            assert_eq!(piece.measure("surface"), Some(piece.ids.surface as f64));
            assert!(piece.measure("volume").unwrap() >= 1.0);
            // an open cell has no volume inside its triangles
            let open = piece.measure("touches_border") == Some(1.0);
            assert_eq!(piece.measure("mesh_volume").is_none(), open);
        }
    }
}
