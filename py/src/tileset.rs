//! A tile set: its index, and tiles as NumPy arrays.

use crate::errors::exception;
use crate::table::Table;
use alvis::manifest::TileEntry;
use alvis::tile::SurfacePiece;
use alvis::tileset as library;
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use std::path::PathBuf;

/// A tile set that is open for reading.
#[pyclass(frozen, module = "alvis._native")]
pub struct TileSet(library::TileSet);

/// What the index says of a tile.
#[pyclass(frozen, module = "alvis._native")]
pub struct Entry(TileEntry);

/// A surface piece of a tile.
#[pyclass(frozen, module = "alvis._native")]
pub struct Piece {
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    cell: u64,
    #[pyo3(get)]
    object: u64,
    #[pyo3(get)]
    surface: u64,
    #[pyo3(get)]
    positions: Py<PyArray2<f32>>,
    #[pyo3(get)]
    normals: Py<PyArray2<f32>>,
    #[pyo3(get)]
    triangles: Py<PyArray2<u32>>,
    #[pyo3(get)]
    measures: Py<PyDict>,
}

/// Rows of three as an array, without a copy.
fn rows<T: Element>(py: Python<'_>, rows: Vec<[T; 3]>) -> PyResult<Py<PyArray2<T>>> {
    let count = rows.len();
    let flat = PyArray1::from_vec(py, rows.into_flattened());
    Ok(flat.reshape([count, 3])?.unbind())
}

impl Piece {
    fn of(py: Python<'_>, piece: SurfacePiece) -> PyResult<Self> {
        let measures = PyDict::new(py);
        for (name, value) in &piece.extras {
            match value {
                Value::Number(number) if number.is_u64() => {
                    measures.set_item(name, number.as_u64())?;
                }
                Value::Number(number) => measures.set_item(name, number.as_f64())?,
                Value::String(text) => measures.set_item(name, text)?,
                _ => {}
            }
        }
        Ok(Piece {
            name: piece.name,
            cell: piece.ids.cell,
            object: piece.ids.object,
            surface: piece.ids.surface,
            positions: rows(py, piece.positions)?,
            normals: rows(py, piece.normals)?,
            triangles: rows(py, piece.triangles)?,
            measures: measures.unbind(),
        })
    }
}

#[pymethods]
impl Entry {
    /// Macrocube index, x first.
    #[getter]
    fn grid(&self) -> [u32; 3] {
        self.0.grid
    }

    /// Path below the directory of the set.
    #[getter]
    fn path(&self) -> &str {
        &self.0.path
    }

    /// Smallest and largest coordinates of the vertices, in voxels, x first.
    #[getter]
    fn bounds(&self) -> [[f64; 3]; 2] {
        [self.0.bounds.min, self.0.bounds.max]
    }

    /// Vertices in the file.
    #[getter]
    fn vertices(&self) -> u64 {
        self.0.vertices
    }

    /// Triangles in the file.
    #[getter]
    fn triangles(&self) -> u64 {
        self.0.triangles
    }

    /// True if a piece of it belongs to one of the cells and one of the objects, where such are given.
    fn has(&self, cell: Option<u64>, object: Option<u64>) -> bool {
        self.0.groups.iter().any(|group| {
            cell.is_none_or(|id| id == group.cell) && object.is_none_or(|id| id == group.object)
        })
    }
}

#[pymethods]
impl TileSet {
    /// Opens the tile set in a directory.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let opened = py.detach(|| library::TileSet::open(&path));
        opened.map(TileSet).map_err(|error| exception(py, &error))
    }

    /// The manifest as JSON.
    fn manifest(&self) -> String {
        serde_json::to_string(self.0.manifest()).unwrap_or_default()
    }

    /// Voxel coordinates to world coordinates in the set's unit, row by row.
    fn world_from_voxel(&self) -> [[f64; 4]; 4] {
        let place = &self.0.manifest().placement;
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|a| place.step(a));
        let row = |i: usize| [x[i], y[i], z[i], place.origin[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// The numbers of the layers that have tiles.
    fn layers(&self) -> Vec<u32> {
        self.0
            .manifest()
            .layers
            .iter()
            .map(|layer| layer.z)
            .collect()
    }

    /// The tiles of a layer, the nth of those that have any.
    fn layer(&self, py: Python<'_>, n: usize) -> PyResult<Vec<Entry>> {
        let manifest = self.0.manifest();
        let layer = manifest.layers.get(n);
        let layer = layer.ok_or_else(|| PyIndexError::new_err("no such layer"))?;
        let read = py.detach(|| {
            let tiles = manifest.shard_tiles(self.0.dir(), layer)?;
            tiles
                .map(|tile| tile.map(Entry))
                .collect::<alvis::Result<_>>()
        });
        read.map_err(|error| exception(py, &error))
    }

    /// The pieces of a tile; its file must have the size and checksum of the entry.
    fn read(&self, py: Python<'_>, entry: &Entry) -> PyResult<Vec<Piece>> {
        let tile = py.detach(|| self.0.read_tile(&entry.0));
        let tile = tile.map_err(|error| exception(py, &error))?;
        let pieces = tile.pieces.into_iter();
        pieces.map(|piece| Piece::of(py, piece)).collect()
    }

    /// The table of this name; `None` if the set has none.
    fn table(&self, py: Python<'_>, name: &str) -> PyResult<Option<Table>> {
        let tables = &self.0.manifest().tables;
        let path = match name {
            "cells" => Some(&tables.cells),
            "objects" => Some(&tables.objects),
            "surfaces" => Some(&tables.surfaces),
            "components" => tables.components.as_ref(),
            "necks" => tables.necks.as_ref(),
            "walls" => tables.walls.as_ref(),
            _ => None,
        };
        let Some(path) = path else { return Ok(None) };
        let key = if matches!(name, "necks" | "walls") {
            "cell_a"
        } else {
            "id"
        };
        let opened = py.detach(|| self.0.path(path).and_then(|path| Table::open(path, key)));
        opened.map(Some).map_err(|error| exception(py, &error))
    }
}
