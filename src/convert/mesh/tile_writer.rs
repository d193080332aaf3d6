//! Tiles on disk during a conversion: their geometry first, what comes before it at the end.

use crate::convert::resolve::{ComponentId, Ids};
use crate::error::Result;
use crate::grid::Tiling;
use crate::measure::MeshSums;
use crate::strip::Stripifier;
use crate::surface::{Piece, TileMesh};
use crate::sys::background_writer::{BackgroundWriters, Job};
use crate::sys::direct_io;
use crate::sys::files::write_body;
use crate::sys::spill_file::{Place, SpillFile};
use crate::tile::{
    Body, Encoded, EncodedBody, EncodedLayout, FloatBody, PieceRange, Refused, TileHead,
    WidestNodes, aligned, encode, head_bytes, refused, tile_path, too_large, widest_description,
};
use bytemuck::{Pod, Zeroable};
use std::borrow::Cow;
use std::path::PathBuf;

/// A tile as meshing left it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct TileRecord {
    /// Bytes of its geometry as floats.
    pub body_bytes: u64,
    /// Bytes of its geometry in the file.
    pub bin_bytes: u64,
    /// Macrocube index.
    pub grid: [u32; 3],
    /// Vertices.
    pub vertices: u32,
    /// Where its pieces lie in the spool.
    pub pieces_at: u64,
    /// Number of pieces.
    pub pieces: u32,
    /// Bytes of the JSON chunk.
    pub room: u32,
    /// CRC-32 of the geometry in the file.
    pub crc: u32,
    /// How it is encoded.
    pub layout: EncodedLayout,
    reserved: u32,
}

impl TileRecord {
    /// Its pieces, from the spool that meshing left.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn pieces(&self, spool: &mut SpillFile) -> Result<Vec<WrittenPiece>> {
        spool.get(&Place::new(self.pieces_at, self.pieces as usize))
    }
}

/// A piece of a tile.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct WrittenPiece {
    /// Where it lies in the body.
    pub body: PieceRange,
    /// What it is part of.
    pub ids: Ids,
    /// The component that the cell is, or is part of; 0 for a cap.
    pub component: u64,
    reserved: u64,
    /// Its sums.
    pub sums: MeshSums,
}

impl WrittenPiece {
    /// True for a piece that closes the surface outside the volume.
    pub fn is_cap(&self) -> bool {
        self.ids.cell == 0
    }
}

/// Writes the geometry of tiles.
pub struct TileWriter {
    /// Directory that will become the tile set.
    pub dir: PathBuf,
    /// What all tiles have in common.
    pub head: TileHead,
    /// How wide their JSON can become.
    pub widest: WidestNodes,
    /// The macrocubes.
    pub tiling: Tiling,
}

impl TileWriter {
    /// Writes one tile's geometry and leaves room for what comes before it, which says how large components are: that
    /// is known when all are meshed. Long ones are written by the writers if there are any.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Usage`] if the tile would pass 4 GiB or reaches too far.
    pub fn write(
        &self,
        mesh: &mut TileMesh,
        grid: [u32; 3],
        stripifier: &mut Stripifier,
        writers: Option<&BackgroundWriters>,
    ) -> Result<(TileRecord, Body)> {
        let body = Body::write(mesh, self.head.form.primitives, stripifier);
        let (layout, room) = self
            .encode(mesh, grid, &body)
            .map_err(|e| refused(e, grid, self.tiling))?;
        let bytes = mesh.chunk.bytes();
        let (crc, bin_bytes) = (crc32fast::hash(bytes), bytes.len() as u64);
        let long = bytes.len() >= direct_io::WORTH;
        let path = self.dir.join(tile_path(grid));
        let start = head_bytes(aligned(room, 8), bin_bytes).ok_or_else(|| too_large(grid))?;
        match writers.filter(|_| long) {
            Some(writers) => {
                let body = mesh.chunk.take();
                mesh.chunk.give(writers.put(Job { path, start, body })?);
            }
            None => write_body(&path, start, bytes)?,
        }
        let record = TileRecord {
            body_bytes: body.bytes,
            bin_bytes,
            grid,
            vertices: body.vertices,
            pieces_at: 0,
            pieces: body.pieces.len() as u32,
            room: room as u32,
            crc,
            layout,
            reserved: 0,
        };
        Ok((record, body))
    }

    /// What comes before the geometry of all tiles.
    pub fn heads(&self) -> Heads<'_> {
        Heads {
            head: &self.head,
            widest: &self.widest,
        }
    }

    /// Encodes the geometry in its place; returns how, and the bytes of the JSON chunk.
    fn encode(
        &self,
        mesh: &mut TileMesh,
        grid: [u32; 3],
        body: &Body,
    ) -> std::result::Result<(EncodedLayout, usize), Refused> {
        let (head, low) = (&self.head, self.tiling.lowest(grid));
        let floats = FloatBody {
            body,
            bytes: mesh.chunk.bytes(),
        };
        let Encoded { bytes, layout } = encode(head, low, floats, None)?;
        if let Cow::Owned(bytes) = bytes {
            mesh.chunk.replace(&bytes);
        }
        let bytes = mesh.chunk.bytes().len();
        let encoded = EncodedBody {
            body,
            layout: &layout,
        };
        let room = self.heads().room(low, encoded, bytes)?;
        Ok((layout, room))
    }
}

/// What comes before the geometry of all tiles, and how long it can become.
#[derive(Clone, Copy)]
pub struct Heads<'a> {
    /// What all tiles have in common.
    pub head: &'a TileHead,
    /// How wide their JSON can become.
    pub widest: &'a WidestNodes,
}

impl Heads<'_> {
    /// Bytes of the JSON chunk of a tile whose encoded geometry takes so many `bytes`: room for any nodes, before what
    /// may go past the page cache.
    ///
    /// # Errors
    /// [`Refused::TooWide`].
    pub fn room(
        self,
        low: [u32; 3],
        encoded: EncodedBody,
        bytes: usize,
    ) -> std::result::Result<usize, Refused> {
        let widest = widest_description(self.widest, low, encoded)?;
        let step = if bytes >= direct_io::WORTH {
            direct_io::SECTOR
        } else {
            8
        };
        Ok(aligned(widest, step))
    }
}

impl WrittenPiece {
    /// A piece, where it lies in the body, and what its classes are.
    pub fn new(piece: &Piece, body: PieceRange, components: &[ComponentId]) -> Self {
        let object = components[piece.object as usize];
        let mut ids = match piece.is_cap() {
            true => Ids::of_cap(object),
            false => Ids::of(object, components[piece.cell as usize]),
        };
        let component = ids.cell;
        if piece.given > 0 {
            ids.cell = piece.given;
        }
        WrittenPiece {
            body,
            ids,
            component,
            reserved: 0,
            sums: piece.sums,
        }
    }
}
