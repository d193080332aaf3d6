//! `alvis phantom`: a made-up volume as a file.

use super::args::{Common, dtype_parser};
use super::{Outcome, output, parse};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::phantom::{Foam, Phantom, PhantomVolume, Shape, Written, render, write};
use crate::volume::{Dtype, Volume};
use clap::{Args, ValueEnum, ValueHint};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// What a phantom shows, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// Metal with closed cells
    Foam,
    /// A ball in the middle
    Sphere,
    /// A ring in the x-y plane
    Torus,
    /// A cube along the axes
    Cube,
    /// An ellipsoid along the axes
    Ellipsoid,
    /// The gyroid surface, one labyrinth on either side
    Gyroid,
    /// White noise, every voxel on its own
    Noise,
}

/// Make a volume to try things on: foam, bodies of known measures, noise
///
/// The file type follows the name: .raw, .mhd (with a .raw beside it), .mha or .nrrd. The same
/// options give the same bytes. Air is at 20 % of the type's range and metal at 80 % (0.2 and 0.8 for
/// floats); the threshold to convert with is half-way and is printed. All lengths are in voxels.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis phantom foam foam.mhd\n  \
    alvis phantom foam scan.raw --dims 300,200,150 --dtype u16 --noise 0.05\n  \
    alvis phantom sphere ball.nrrd --dims 64,64,64 --radius 20 --spacing 0.1 --unit mm")]
pub struct PhantomArgs {
    /// What it shows
    kind: Kind,
    /// The file to write
    #[arg(value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Size in voxels
    #[arg(long, value_name = "X,Y,Z", default_value = "256,256,256", value_parser = parse::dims)]
    dims: [u64; 3],
    /// Type of the samples
    #[arg(long, value_name = "TYPE", default_value = "u8", value_parser = dtype_parser())]
    dtype: Dtype,
    /// Standard deviation of the noise, as a share of the contrast
    #[arg(long, value_name = "SIGMA", default_value = "0", value_parser = parse::finite)]
    noise: f64,
    /// Names the random numbers
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// Size of a voxel to write into the header, one number or three
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing, requires = "unit")]
    spacing: Option<[f64; 3]>,
    /// Unit of the spacing: voxel, m, cm, mm, um or nm
    #[arg(long, value_name = "UNIT", value_parser = parse::unit, requires = "spacing")]
    unit: Option<Unit>,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    shape: ShapeArgs,
    #[command(flatten)]
    common: Common,
}

/// Options that belong to some kinds only.
#[derive(Debug, Args)]
#[command(next_help_heading = "Shape")]
struct ShapeArgs {
    /// foam: one cell per PITCH^3 [default: 24]; gyroid: its period [default: 48]
    #[arg(long, value_name = "PITCH", value_parser = parse::finite)]
    pitch: Option<f64>,
    /// foam: thinnest wall between two cells [default: 3]
    #[arg(long, value_name = "WALL", value_parser = parse::finite)]
    wall: Option<f64>,
    /// foam: mean radius of the spheres that round the cells, in pitches; 0.25 to 1, polyhedra from
    /// 0.7 on [default: 0.42]
    #[arg(long, value_name = "RADIUS", value_parser = parse::finite)]
    bubble: Option<f64>,
    /// sphere, torus: radius [default: 0.4, 0.3 of the shortest side]
    #[arg(long, value_name = "RADIUS", value_parser = parse::finite)]
    radius: Option<f64>,
    /// torus: radius of the tube [default: 0.1 of the shortest side]
    #[arg(long, value_name = "RADIUS", value_parser = parse::finite)]
    tube: Option<f64>,
    /// cube: edge [default: 0.5 of the shortest side]
    #[arg(long, value_name = "EDGE", value_parser = parse::finite)]
    edge: Option<f64>,
    /// ellipsoid: semi-axes [default: 0.4 of each side]
    #[arg(long, value_name = "A,B,C", value_parser = parse::lengths)]
    semi_axes: Option<[f64; 3]>,
    /// noise: probability of metal [default: 0.5]
    #[arg(long, value_name = "P", value_parser = parse::finite)]
    density: Option<f64>,
}

impl ShapeArgs {
    /// The shape, refusing options of other kinds.
    fn shape(&self, kind: Kind, dims: Dims) -> Result<Shape> {
        self.refuse_foreign(kind)?;
        let sides = dims.0.map(f64::from);
        let shortest = sides[0].min(sides[1]).min(sides[2]);
        let foam = Foam::default();
        Ok(match kind {
            Kind::Foam => Shape::Foam(Foam {
                pitch: self.pitch.unwrap_or(foam.pitch),
                wall: self.wall.unwrap_or(foam.wall),
                bubble: self.bubble.unwrap_or(foam.bubble),
            }),
            Kind::Sphere => Shape::Sphere {
                radius: self.radius.unwrap_or(0.4 * shortest),
            },
            Kind::Torus => Shape::Torus {
                radius: self.radius.unwrap_or(0.3 * shortest),
                tube: self.tube.unwrap_or(0.1 * shortest),
            },
            Kind::Cube => Shape::Cube {
                edge: self.edge.unwrap_or(0.5 * shortest),
            },
            Kind::Ellipsoid => Shape::Ellipsoid {
                semi_axes: self.semi_axes.unwrap_or(sides.map(|s| 0.4 * s)),
            },
            Kind::Gyroid => Shape::Gyroid {
                period: self.pitch.unwrap_or(48.0),
            },
            Kind::Noise => Shape::Noise {
                density: self.density.unwrap_or(0.5),
            },
        })
    }

    fn refuse_foreign(&self, kind: Kind) -> Result<()> {
        use Kind::{Cube, Ellipsoid, Foam, Gyroid, Noise, Sphere, Torus};
        let rules: [(&str, bool, &[Kind]); 8] = [
            ("--pitch", self.pitch.is_some(), &[Foam, Gyroid]),
            ("--wall", self.wall.is_some(), &[Foam]),
            ("--bubble", self.bubble.is_some(), &[Foam]),
            ("--radius", self.radius.is_some(), &[Sphere, Torus]),
            ("--tube", self.tube.is_some(), &[Torus]),
            ("--edge", self.edge.is_some(), &[Cube]),
            ("--semi-axes", self.semi_axes.is_some(), &[Ellipsoid]),
            ("--density", self.density.is_some(), &[Noise]),
        ];
        for (option, given, kinds) in rules {
            if given && !kinds.contains(&kind) {
                let names: Vec<String> = kinds.iter().map(|k| k.name()).collect();
                let found = format!("it with {}", kind.name());
                return Err(Error::usage(option, found, names.join(" or ")));
            }
        }
        Ok(())
    }
}

impl Kind {
    fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(String::new, |v| v.get_name().to_string())
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report<'a> {
    path: String,
    data: Option<String>,
    kind: String,
    dims: Dims,
    dtype: Dtype,
    #[serde(flatten)]
    placement: &'a Placement,
    seed: u64,
    noise: f64,
    threshold: f64,
    bytes: u64,
    seconds: f64,
}

impl PhantomArgs {
    pub fn run(self) -> Result<Outcome> {
        let start = Instant::now();
        let console = self.common.start();
        let dims = Dims::new(self.dims)?;
        let phantom = Phantom {
            shape: self.shape.shape(self.kind, dims)?,
            noise: self.noise,
            seed: self.seed,
        };
        let mut placement = Placement::default();
        placement.spacing = self.spacing.unwrap_or(placement.spacing);
        placement.unit = self.unit.unwrap_or(placement.unit);
        let volume = render(&phantom, dims, self.dtype)?.with_placement(placement)?;
        let written = write(&volume, &self.out, self.force, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&Report {
                path: written.path.display().to_string(),
                data: written.data.as_ref().map(|d| d.display().to_string()),
                kind: self.kind.name(),
                dims,
                dtype: self.dtype,
                placement: &placement,
                seed: self.seed,
                noise: self.noise,
                threshold: volume.threshold(),
                bytes: written.bytes,
                seconds: start.elapsed().as_secs_f64(),
            })?;
        } else if self.common.talks() {
            output::print(&summary(&volume, &written, start.elapsed().as_secs_f64()))?;
        }
        Ok(Outcome::Done)
    }
}

/// What was written, and the command that converts it.
fn summary(volume: &PhantomVolume, written: &Written, seconds: f64) -> String {
    let header = volume.header();
    let path = written.path.display();
    let mut next = format!(
        "alvis convert {} OUT --threshold {}",
        output::shell(&written.path),
        volume.threshold()
    );
    let is_raw = written.data.is_none()
        && written
            .path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("raw"));
    if is_raw {
        let [nx, ny, nz] = header.dims.0;
        next += &format!(" --dims {nx},{ny},{nz} --dtype {}", header.dtype);
        if header.dtype.bytes() > 1 {
            next += &format!(" --endian {}", header.endian);
        }
        if header.placement != Placement::default() {
            let spacing = header.placement.spacing.map(|s| s.to_string()).join(",");
            next += &format!(" --spacing {spacing} --unit {}", header.placement.unit);
        }
    }
    output::table(&[
        (
            "written",
            format!("{path}: {}, {}", header.dims, header.dtype),
        ),
        (
            "size",
            format!("{} in {seconds:.1} s", output::bytes(written.bytes)),
        ),
        ("threshold", volume.threshold().to_string()),
        ("to convert", next),
    ])
}
