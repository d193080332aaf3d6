//! What the Python package `alvis` is made of: `alvis._native`, which the package wraps.
//!
//! Text that goes to and fro is that of the command: words of a command line in, the JSON of `--json` out
//! ([`alvis::cli::call`]), so that nothing is said twice. Arrays go as NumPy arrays, tables by the Arrow C interface.

mod arrow;
mod call;
mod errors;
mod progress;
mod table;
mod tileset;
mod volume;

/// Functions and types that the package wraps.
#[pyo3::pymodule(gil_used = false)]
mod _native {
    #[pymodule_export]
    use crate::call::{call, command};
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::tileset::{Entry, Piece, TileSet};

    /// The version of alvis.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
