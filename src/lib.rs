//! Turns CT volumes larger than memory into glTF tiles.
//!
//! A volume is a grid of samples. Where they cross a threshold there is a surface, which this library
//! cuts out by marching cubes and writes as a directory of GLB files, one per *macrocube* of 64 x 64 x
//! 64 cubes, with an index and tables of what the surface bounds. Memory stays below a limit of the
//! caller's choice however deep the volume is. The `alvis` command is a thin layer over this library.
//!
//! # Words
//! A voxel is *above* if its value is at least the threshold. A connected set of above voxels is an
//! *object* (the metal of a foam), one of below voxels a *cell* (a pore; outside air is one too), and
//! a connected set of triangles a *surface*, which borders exactly one object and one cell. Objects,
//! cells and surfaces are numbered from 1, each for themselves.
//!
//! # A tour
//! The examples run as they stand: the volume is made up.
//!
//! ## Get a volume
//! [`volume::open`] opens a file, [`volume::MemoryVolume`] takes samples that are in memory already,
//! and a type of your own can implement [`volume::Volume`]. [`phantom`] makes volumes to try things
//! on. [`volume::statistics`] finds the range, a histogram and Otsu's threshold.
//!
//! ```
//! use alvis::grid::{Dims, Placement};
//! use alvis::progress::Quiet;
//! use alvis::volume::{MemoryVolume, statistics};
//!
//! let dims = Dims::new([20, 20, 20])?;
//! let samples: Vec<u8> = (0..dims.voxels()).map(|i| if i % 20 < 10 { 40 } else { 200 }).collect();
//! let volume = MemoryVolume::new(dims, Placement::default(), samples)?;
//! let found = statistics(&volume, None, &Quiet)?;
//! assert_eq!(found.range, Some([40.0, 200.0]));
//! let otsu = found.otsu.expect("there are two values");
//! assert!(40.0 < otsu && otsu <= 200.0);
//! # Ok::<(), alvis::Error>(())
//! ```
//!
//! ## Convert it
//! [`convert::convert`] does all of it; [`convert::ConvertOptions`] has what can be chosen.
//! [`convert::predicted_memory`] says beforehand what it will need.
//!
//! ```
//! use alvis::grid::Dims;
//! use alvis::phantom::{Phantom, render};
//! use alvis::convert::{ConvertOptions, convert};
//! use alvis::progress::Quiet;
//! use alvis::volume::Dtype;
//!
//! # let dir = tempfile::tempdir().unwrap();
//! # let out = dir.path().join("foam");
//! let volume = render(&Phantom::default(), Dims::new([48, 48, 48])?, Dtype::U8)?;
//! let options = ConvertOptions {
//!     threshold: volume.threshold(),
//!     macrocube: [32; 3],
//!     memory: 256 << 20, // a limit in bytes
//!     ..ConvertOptions::default()
//! };
//! let made = convert(&volume, &options, &out, &Quiet)?;
//! assert!(made.totals.cells > 1);
//! assert_eq!(made.totals.surfaces + 1, made.totals.objects + made.totals.cells);
//! # Ok::<(), alvis::Error>(())
//! ```
//!
//! ## Prove that the surface has no hole
//! [`verify::verify`] rebuilds the surface from the files. Given the volume, it also proves that the
//! surface is that of the volume. Whatever is wrong with the tiles is an [`verify::Issue`] in its
//! report, not an error.
//!
//! ```
//! # use alvis::grid::Dims;
//! # use alvis::phantom::{Phantom, render};
//! # use alvis::convert::{ConvertOptions, convert};
//! # use alvis::volume::Dtype;
//! use alvis::progress::Quiet;
//! use alvis::verify::{VerifyOptions, verify};
//!
//! # let dir = tempfile::tempdir().unwrap();
//! # let out = dir.path().join("foam");
//! # let volume = render(&Phantom::default(), Dims::new([40, 40, 40])?, Dtype::U8)?;
//! # let threshold = volume.threshold();
//! # convert(&volume, &ConvertOptions { threshold, ..Default::default() }, &out, &Quiet)?;
//! let options = VerifyOptions {
//!     against: Some(&volume), // None: by the tiles alone
//!     ..VerifyOptions::default()
//! };
//! let report = verify(&out, &options, &Quiet)?;
//! assert!(report.ok, "{:?}", report.issues);
//! # Ok::<(), alvis::Error>(())
//! ```
//!
//! ## Read the tiles
//! [`tileset::TileSet`] opens a directory, reads the manifest and walks over its layers and tiles.
//! [`tile::TileMesh`] is one tile as plain vectors: positions in voxel coordinates, normals,
//! triangles, ids and the measures of each piece's cell. The matrix takes voxel coordinates to metres.
//!
//! ```
//! # use alvis::grid::Dims;
//! # use alvis::phantom::{Phantom, render};
//! # use alvis::convert::{ConvertOptions, convert};
//! # use alvis::progress::Quiet;
//! # use alvis::volume::Dtype;
//! use alvis::tileset::TileSet;
//!
//! # let dir = tempfile::tempdir().unwrap();
//! # let out = dir.path().join("foam");
//! # let volume = render(&Phantom::default(), Dims::new([64, 64, 64])?, Dtype::U8)?;
//! # let (threshold, macrocube) = (volume.threshold(), [32; 3]);
//! # convert(&volume, &ConvertOptions { threshold, macrocube, ..Default::default() }, &out, &Quiet)?;
//! let set = TileSet::open(&out)?;
//! for layer in &set.manifest().layers {
//!     println!("layer {}: {} tiles in {}", layer.z, layer.tiles, layer.path);
//! }
//! let mut triangles = 0;
//! for shard in set.shards() {
//!     for entry in shard?.tiles {
//!         let tile = set.read_tile(&entry)?;
//!         for piece in &tile.pieces {
//!             triangles += piece.triangles.len() as u64;
//!             if let Some(sphericity) = piece.measure("sphericity") {
//!                 println!("{}: cell {}, {sphericity:.2}", entry.path, piece.ids.cell);
//!             }
//!         }
//!     }
//! }
//! assert_eq!(triangles, set.manifest().totals.triangles);
//! # Ok::<(), alvis::Error>(())
//! ```
//!
//! Programs in other languages read the same files: the index is JSON with schemas in `schema/`, the
//! tables are CSV, and [`tile`] says how a GLB is laid out.
//!
//! ## Ask the tables
//! [`table`] reads the tables of cells, objects and surfaces and answers conditions such as
//! `sphericity > 0.9 and not touches_border`. [`select`](transform::select) writes the tiles of such cells, or
//! a copy in colours, [`repack`](transform::repack) writes the same tiles for other programs, smaller ones for
//! the web, and [`preview`](mod@preview) draws a slice of the volume with the cells in it. [`structure`] tells porosity
//! by slices and boxes and how the surface is oriented, [`report`] puts all of it on a page.
//!
//! ## Hand the surface on
//! [`export`](mod@export) sews tiles into one mesh: GLB, PLY, STL or OBJ. [`view`] picks the tiles that a
//! camera sees, for viewers that draw them.
//!
//! # Progress and stopping
//! Long work takes a [`progress::Progress`], which is told what happens and can ask to stop;
//! [`progress::Quiet`] says nothing.
//!
//! # Errors
//! [`Error`] says where, what was found, what was expected and what to do. Work that fails leaves
//! nothing behind under a final name.

// what a table, a tile or a picture says must not depend on how the program was linked: see clippy.toml
#![warn(clippy::disallowed_methods)]

mod checkpoint;
pub mod cli;
pub mod compare;
pub mod convert;
pub mod error;
pub mod export;
mod gltf;
pub mod grid;
mod http;
#[doc(hidden)]
pub mod kernels;
mod labels;
pub mod lod;
pub mod manifest;
mod measure;
pub mod phantom;
mod picture;
pub mod preview;
pub mod progress;
pub mod report;
mod serve;
pub mod split;
mod store;
mod strip;
pub mod structure;
mod surface;
mod sys;
pub mod table;
pub mod tile;
pub mod tileset;
pub mod transform;
pub mod verify;
pub mod view;
pub mod volume;
mod words;

pub use error::{Error, Result};
