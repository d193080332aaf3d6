//! The options that say in which form tiles are written.

use crate::manifest::{Encoding, Form, Layout, Primitives};
use clap::{Args, ValueEnum};

/// A program that tiles are meant for, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum ProgramArg {
    /// Strips, floats, a node with extras for each piece: Blender and most others
    Blender,
    /// Triangle lists: MeshLab reads no strips
    Meshlab,
    /// Strips, meshopt, merged: viewers on the web; smallest, cells by feature ids and a table
    Web,
}

/// Kind of primitives, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum PrimitivesArg {
    /// Triangle strips: smaller
    Strips,
    /// Triangle lists: the only kind that MeshLab reads
    Triangles,
}

impl From<PrimitivesArg> for Primitives {
    fn from(arg: PrimitivesArg) -> Self {
        match arg {
            PrimitivesArg::Strips => Primitives::Strips,
            PrimitivesArg::Triangles => Primitives::Triangles,
        }
    }
}

/// Way of storing numbers, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum EncodingArg {
    /// 32-bit floats: every program reads them
    Float,
    /// Positions in 16 bits, exact; normals in 8 bits, up to 0.9 degrees off (KHR_mesh_quantization)
    Quantized,
    /// The same, compressed (EXT_meshopt_compression)
    Meshopt,
}

/// Way of keeping pieces apart, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum LayoutArg {
    /// Nodes up to 500 pieces in a tile, else merged
    Auto,
    /// A node with extras for each piece
    Nodes,
    /// One mesh for all pieces of a tile, with feature ids and a property table
    Merged,
}

/// The form of tiles. Positions are exact in each.
#[derive(Debug, Clone, Copy, Args)]
#[command(next_help_heading = "Form of the tiles")]
pub struct FormArgs {
    /// Short for the other three options, as a program needs them; these go before it
    #[arg(long = "for", value_name = "PROGRAM")]
    program: Option<ProgramArg>,
    /// Strips or triangle lists
    #[arg(long, value_name = "KIND")]
    primitives: Option<PrimitivesArg>,
    /// How positions, normals and indices are stored
    #[arg(long, value_name = "WAY")]
    encoding: Option<EncodingArg>,
    /// How the pieces of a tile are kept apart
    #[arg(long, value_name = "WAY")]
    layout: Option<LayoutArg>,
}

impl FormArgs {
    /// True if nothing was asked for.
    pub fn is_empty(&self) -> bool {
        self.program.is_none()
            && self.primitives.is_none()
            && self.encoding.is_none()
            && self.layout.is_none()
    }

    /// The form asked for; what was not said is as in `otherwise`.
    pub fn form(&self, otherwise: Form) -> Form {
        let base = match self.program {
            Some(ProgramArg::Blender) => Form::BLENDER,
            Some(ProgramArg::Meshlab) => Form::MESHLAB,
            Some(ProgramArg::Web) => Form::WEB,
            None => otherwise,
        };
        Form {
            primitives: self.primitives.map_or(base.primitives, Primitives::from),
            encoding: self.encoding.map_or(base.encoding, |e| match e {
                EncodingArg::Float => Encoding::Float,
                EncodingArg::Quantized => Encoding::Quantized,
                EncodingArg::Meshopt => Encoding::Meshopt,
            }),
            layout: self.layout.map_or(base.layout, |l| match l {
                LayoutArg::Auto => Layout::Auto,
                LayoutArg::Nodes => Layout::Nodes,
                LayoutArg::Merged => Layout::Merged,
            }),
        }
    }
}
