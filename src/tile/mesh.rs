//! A whole tile as plain vectors, for programs that want its triangles and not its bytes.

use super::read::{PieceIds, Pieces, Primitive, Tile};
use crate::gltf::buffer_views::Buffers;
use crate::gltf::container::{Fault, Glb, Result, fail};
use crate::gltf::read_json::{Document, whole};
use serde::Deserialize;
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
        let tile = Tile::read(bytes)?;
        let glb = Glb::split(bytes)?;
        let mut pieces = Vec::new();
        let mut extras = node_extras(glb.json)?;
        for primitive in &tile.primitives {
            let triangles = triangles(primitive)?;
            match &primitive.pieces {
                Pieces::One(ids) => pieces.push(SurfacePiece {
                    ids: *ids,
                    name: primitive.name.clone(),
                    positions: primitive.positions.iter().collect(),
                    normals: primitive.normals.unit().collect(),
                    triangles,
                    extras: std::mem::take(&mut extras[primitive.node]),
                }),
                Pieces::Merged(rows, ids) => {
                    let table = table(&glb)?;
                    pieces.extend(split(primitive, rows.get(), ids, &triangles)?);
                    for (piece, row) in pieces.iter_mut().zip(table) {
                        piece.extras = row;
                    }
                }
            }
        }
        Ok(TileMesh {
            matrix: tile.matrix,
            pieces,
        })
    }
}

fn bad_json<T>(error: &serde_json::Error) -> Result<T> {
    fail(Fault::Json, "", error.to_string())
}

/// The `extras` of every node, empty where there are none.
pub(super) fn node_extras(json: &[u8]) -> Result<Vec<Map<String, Value>>> {
    #[derive(Deserialize)]
    struct Nodes {
        nodes: Vec<Node>,
    }
    #[derive(Deserialize)]
    struct Node {
        #[serde(default)]
        extras: Map<String, Value>,
    }
    match serde_json::from_slice::<Nodes>(json) {
        Ok(doc) => Ok(doc.nodes.into_iter().map(|n| n.extras).collect()),
        Err(e) => bad_json(&e),
    }
}

/// The triangles of a primitive with their corners counter-clockwise. Triangle k of a strip is
/// (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k (glTF 2.0, section 3.7.2.1).
fn triangles(primitive: &Primitive) -> Result<Vec<[u32; 3]>> {
    let place = || format!("/meshes/{}/primitives/0", primitive.node.saturating_sub(1));
    let mut indices = Vec::new();
    primitive.indices.read_into(&mut indices);
    let n = primitive.positions.len() as u64;
    if let Some(i) = indices.iter().find(|&&i| u64::from(i) >= n) {
        let message = format!("found index {i}, expected indices below {n}");
        return fail(Fault::Accessor, place(), message);
    }
    match primitive.mode {
        4 if indices.len() % 3 == 0 => Ok(indices.as_chunks::<3>().0.to_vec()),
        5 => Ok(indices
            .windows(3)
            .enumerate()
            .filter(|(_, t)| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
            .map(|(k, t)| match k % 2 {
                0 => [t[0], t[1], t[2]],
                _ => [t[1], t[0], t[2]],
            })
            .collect()),
        mode => {
            let message = format!(
                "found mode {mode} with {} indices, expected 5, or 4 with a multiple of 3",
                indices.len()
            );
            fail(Fault::Structure, place(), message)
        }
    }
}

/// Splits a merged primitive by the rows of its vertices. Names and extras stay empty.
fn split(
    primitive: &Primitive,
    rows: &[[u8; 4]],
    ids: &[PieceIds],
    triangles: &[[u32; 3]],
) -> Result<Vec<SurfacePiece>> {
    const PLACE: &str = "/meshes/0/primitives/0";
    let mut pieces: Vec<SurfacePiece> = ids
        .iter()
        .map(|&ids| SurfacePiece {
            ids,
            name: String::new(),
            positions: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
            extras: Map::new(),
        })
        .collect();
    let mut place_of = Vec::with_capacity(rows.len());
    let vertices = primitive.positions.iter().zip(primitive.normals.unit());
    for (row, (position, normal)) in rows.iter().zip(vertices) {
        let value = f32::from_le_bytes(*row);
        let row = whole(value.into()).and_then(|r| usize::try_from(r).ok());
        let Some((row, piece)) = row.and_then(|r| Some((r, pieces.get_mut(r)?))) else {
            let message = format!("found feature id {value}, expected one below {}", ids.len());
            return fail(Fault::Accessor, PLACE, message);
        };
        place_of.push((row, piece.positions.len() as u32));
        piece.positions.push(position);
        piece.normals.push(normal);
    }
    for t in triangles {
        let [a, b, c] = t.map(|i| place_of[i as usize]);
        if a.0 != b.0 || b.0 != c.0 {
            let message = format!("found triangle {t:?} between two pieces, expected one piece");
            return fail(Fault::Structure, PLACE, message);
        }
        pieces[a.0].triangles.push([a.1, b.1, c.1]);
    }
    Ok(pieces)
}

/// The rows of a merged tile's property table.
pub(super) fn table(glb: &Glb) -> Result<Vec<Map<String, Value>>> {
    match serde_json::from_slice::<Document>(glb.json) {
        Ok(doc) => super::features::extras(&doc, &Buffers::plain(glb.bin)),
        Err(e) => bad_json(&e),
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
