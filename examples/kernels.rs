//! Runs each hot kernel once on a fixed foam, for counting its instructions, and verifies its tiles.
//!
//! `tests/instructions/check.py` runs it under callgrind and compares with stored limits.

use alvis::convert::{ConvertOptions, convert};
use alvis::grid::Dims;
use alvis::kernels::Kernels;
use alvis::manifest::Primitives;
use alvis::phantom::{Phantom, render};
use alvis::progress::Quiet;
use alvis::verify::{VerifyOptions, verify};
use alvis::volume::{Dtype, Volume};

/// Converts a volume and proves that its surface has no hole.
fn check(volume: &dyn Volume) -> alvis::Result<bool> {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let options = ConvertOptions {
        threshold: 127.5,
        threads: 1,
        force: true,
        ..ConvertOptions::default()
    };
    convert(volume, &options, dir.path(), &Quiet)?;
    let options = VerifyOptions {
        threads: 1,
        ..VerifyOptions::default()
    };
    Ok(verify(dir.path(), &options, &Quiet)?.ok)
}

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
    assert!(check(&foam)?, "a foam's surface has no hole");
    Ok(())
}
