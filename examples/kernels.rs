//! Runs each hot kernel once on a fixed foam, for counting its instructions.
//!
//! `tests/instructions/check.py` runs it under callgrind and compares with stored limits.

use alvis::grid::Dims;
use alvis::kernels::Kernels;
use alvis::manifest::Primitives;
use alvis::phantom::{Phantom, render};
use alvis::volume::Dtype;

fn main() -> alvis::Result<()> {
    let foam = render(&Phantom::default(), Dims::new([130; 3])?, Dtype::U8)?;
    let mut kernels = Kernels::new(&foam, 128)?;
    kernels.classify();
    let components = kernels.label();
    let pieces = kernels.surfaces();
    kernels.mesh();
    let entries = kernels.strips();
    let bytes = kernels.bodies(Primitives::Triangles);
    println!(
        "{} voxels, {components} components, {pieces} pieces, {} triangles, {entries} entries, {bytes} bytes",
        kernels.voxels(),
        kernels.triangles()
    );
    Ok(())
}
