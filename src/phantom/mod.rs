//! Made-up volumes of any size: closed-cell foam and bodies whose surface is known.
//!
//! Every voxel is a function of the phantom's parameters and its place, so a phantom is a
//! [`Volume`] that needs no memory: any box of it can be made on its own, with the same bytes as in
//! the whole. [`write()`] puts it into a file.

mod foam;
mod random;
mod sample;
mod shapes;
pub(crate) mod write;

pub use write::{Written, write};

use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use crate::volume::{Dtype, Endian, Header, Volume};
use foam::FoamField;
use random::RowStream;
use rayon::prelude::*;
use shapes::{Body, BodyRows, GyroidRows, NoiseRows};
use std::ops::Range;

/// A closed-cell foam. Lengths are in voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foam {
    /// One cell per pitch^3 on average; 8 to 4096.
    pub pitch: f64,
    /// The thinnest wall between two cells; at least 2, at most a third of the pitch.
    pub wall: f64,
    /// Mean radius, in pitches, of the spheres that round the cells; 0.25 to 1. Below 0.5 cells are
    /// balls with flats where they meet, from 0.7 on they are polyhedra.
    pub bubble: f64,
}

impl Default for Foam {
    fn default() -> Self {
        Foam {
            pitch: 24.0,
            wall: 3.0,
            bubble: 0.42,
        }
    }
}

/// What a phantom shows. Lengths are in voxels, so spacing does not change the samples; bodies lie
/// in the middle of the volume and may reach beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Metal with closed cells.
    Foam(Foam),
    /// A ball.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A ring in the x-y plane.
    Torus {
        /// Radius of the circle in the middle of the tube.
        radius: f64,
        /// Radius of the tube.
        tube: f64,
    },
    /// A cube along the axes.
    Cube {
        /// Its edge.
        edge: f64,
    },
    /// An ellipsoid along the axes.
    Ellipsoid {
        /// Semi-axes along x, y, z.
        semi_axes: [f64; 3],
    },
    /// The gyroid surface: metal and air are one labyrinth each.
    Gyroid {
        /// Length of its unit cell; at least 8.
        period: f64,
    },
    /// White noise: every voxel is metal or air on its own.
    Noise {
        /// Probability of metal, 0 to 1.
        density: f64,
    },
}

/// A shape, the noise on it, and the seed of all its random numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phantom {
    /// What it shows.
    pub shape: Shape,
    /// Standard deviation of the noise as a share of the contrast between air and metal; 0 to 1.
    /// Up to 0.096 no sample leaves the type's range.
    pub noise: f64,
    /// Names the random numbers; the same seed gives the same bytes.
    pub seed: u64,
}

impl Default for Phantom {
    fn default() -> Self {
        Phantom {
            shape: Shape::Foam(Foam::default()),
            noise: 0.0,
            seed: 1,
        }
    }
}

impl Phantom {
    /// A shape without noise.
    pub fn new(shape: Shape) -> Self {
        Phantom {
            shape,
            ..Phantom::default()
        }
    }

    /// Checks the range of every parameter.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the option.
    pub fn check(&self) -> Result<()> {
        in_range("--noise", self.noise, 0.0, 1.0)?;
        // the largest bodies that are of use in the largest volume
        let length = |option, v| in_range(option, v, 0.5, 262_144.0);
        match self.shape {
            Shape::Foam(foam) => {
                in_range("--pitch", foam.pitch, 8.0, 4096.0)?;
                in_range("--bubble", foam.bubble, 0.25, 1.0)?;
                in_range("--wall", foam.wall, 2.0, foam.pitch / 3.0)
            }
            Shape::Sphere { radius } => length("--radius", radius),
            Shape::Torus { radius, tube } => {
                length("--radius", radius)?;
                in_range("--tube", tube, 0.5, radius)
            }
            Shape::Cube { edge } => length("--edge", edge),
            Shape::Ellipsoid { semi_axes } => {
                semi_axes.iter().try_for_each(|&a| length("--semi-axes", a))
            }
            Shape::Gyroid { period } => in_range("--pitch", period, 8.0, 262_144.0),
            Shape::Noise { density } => in_range("--density", density, 0.0, 1.0),
        }
    }
}

fn in_range(option: &str, value: f64, low: f64, high: f64) -> Result<()> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(Error::usage(
            option,
            value.to_string(),
            format!("{low} to {high}"),
        ))
    }
}

/// Makes greys row by row for one box; 0 is air, 1 metal. Rows of one slice come one after another.
trait Rows {
    /// Fills the row (y, z) of the box.
    fn row(&mut self, y: u32, z: u32, grey: &mut [f32]);
}

/// A phantom of a size and sample type, made while it is read.
#[derive(Debug, Clone)]
pub struct PhantomVolume {
    phantom: Phantom,
    header: Header,
    field: Field,
}

/// A shape with what is computed once for all boxes.
#[derive(Debug, Clone)]
enum Field {
    Foam(FoamField),
    Body(Body),
    Gyroid(f64),
    Noise(f64),
}

/// A phantom as a volume without spacing.
///
/// # Errors
/// As [`Phantom::check`].
pub fn render(phantom: &Phantom, dims: Dims, dtype: Dtype) -> Result<PhantomVolume> {
    phantom.check()?;
    let field = match phantom.shape {
        Shape::Foam(foam) => Field::Foam(FoamField::new(foam, phantom.seed)),
        Shape::Sphere { radius } => Field::Body(Body::Sphere(radius)),
        Shape::Torus { radius, tube } => Field::Body(Body::Torus(radius, tube)),
        Shape::Cube { edge } => Field::Body(Body::Cube(edge / 2.0)),
        Shape::Ellipsoid { semi_axes } => Field::Body(Body::Ellipsoid(semi_axes)),
        Shape::Gyroid { period } => Field::Gyroid(period),
        Shape::Noise { density } => Field::Noise(density),
    };
    Ok(PhantomVolume {
        phantom: *phantom,
        header: Header {
            format: "phantom",
            dims,
            dtype,
            endian: Endian::NATIVE,
            placement: Placement::default(),
        },
        field,
    })
}

impl PhantomVolume {
    /// The same volume at another place.
    ///
    /// # Errors
    /// As [`Placement::check`].
    pub fn with_placement(mut self, placement: Placement) -> Result<Self> {
        placement.check()?;
        self.header.placement = placement;
        Ok(self)
    }

    /// The value half-way between air and metal, where the surface lies.
    pub fn threshold(&self) -> f64 {
        sample::threshold(self.header.dtype)
    }

    fn rows(&self, x: &Range<u32>, y: Range<u32>, z: Range<u32>) -> Box<dyn Rows> {
        match &self.field {
            Field::Foam(field) => Box::new(field.rows(x.clone(), y, z)),
            Field::Gyroid(period) => Box::new(GyroidRows::new(*period, x.clone())),
            Field::Noise(density) => Box::new(NoiseRows {
                density: *density,
                seed: self.phantom.seed,
                x: x.start,
            }),
            Field::Body(body) => Box::new(BodyRows {
                body: *body,
                dims: self.header.dims,
                x: x.start,
            }),
        }
    }

    /// Edge, along y and z, of the blocks that one thread makes: a few cells, so that the cells
    /// around a block are few against those in it.
    fn block_edge(&self) -> u32 {
        match self.phantom.shape {
            Shape::Foam(foam) => (2.5 * foam.pitch).clamp(16.0, 128.0) as u32,
            _ => 32,
        }
    }
}

/// Rows that one thread makes: all of one band of y in some slices.
struct Block<'a> {
    y: Range<u32>,
    z: Range<u32>,
    /// For each slice the bytes of the band's rows.
    slices: Vec<&'a mut [u8]>,
}

impl Volume for PhantomVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let row_bytes = x.len() * self.header.dtype.bytes();
        blocks(out, row_bytes, y, z, self.block_edge())
            .into_par_iter()
            .for_each_init(Vec::new, |grey, block| {
                grey.resize(x.len(), 0.0);
                self.fill(&x, block, grey);
            });
        Ok(())
    }
}

impl PhantomVolume {
    /// Makes the rows of a block; `grey` is scratch memory for one row.
    fn fill(&self, x: &Range<u32>, block: Block, grey: &mut [f32]) {
        let dtype = self.header.dtype;
        let mut rows = self.rows(x, block.y.clone(), block.z.clone());
        for (z, slice) in block.z.zip(block.slices) {
            for (y, out) in (block.y.clone()).zip(slice.chunks_mut(grey.len() * dtype.bytes())) {
                rows.row(y, z, grey);
                let noise = (self.phantom.noise > 0.0).then(|| {
                    let stream = RowStream::new(self.phantom.seed, y, z);
                    (stream, self.phantom.noise as f32)
                });
                sample::write_row(dtype, grey, noise, x.start, out);
            }
        }
    }
}

/// Cuts the bytes of a box into blocks of at most `edge` rows by `edge` slices.
fn blocks(
    out: &mut [u8],
    row_bytes: usize,
    y: Range<u32>,
    z: Range<u32>,
    edge: u32,
) -> Vec<Block<'_>> {
    let slice_bytes = row_bytes * y.len();
    let mut blocks = Vec::new();
    let mut z0 = z.start;
    for slab in out.chunks_mut(slice_bytes * edge as usize) {
        let z1 = z0 + (slab.len() / slice_bytes) as u32;
        let first = blocks.len();
        for y0 in y.clone().step_by(edge as usize) {
            blocks.push(Block {
                y: y0..y.end.min(y0.saturating_add(edge)),
                z: z0..z1,
                slices: Vec::with_capacity(z1.abs_diff(z0) as usize),
            });
        }
        for slice in slab.chunks_mut(slice_bytes) {
            let bands = slice.chunks_mut(row_bytes * edge as usize);
            for (block, band) in blocks[first..].iter_mut().zip(bands) {
                block.slices.push(band);
            }
        }
        z0 = z1;
    }
    blocks
}
