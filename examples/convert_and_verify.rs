//! The library from end to end: make a volume, convert it, prove that the surface has no hole.
//!
//! ```sh
//! cargo run --release --example convert_and_verify -- DIRECTORY
//! ```

use alvis::convert::{ConvertOptions, ConvertReport, convert};
use alvis::grid::{Dims, Placement, Unit};
use alvis::phantom::{Phantom, render};
use alvis::progress::Quiet;
use alvis::verify::{Report, VerifyOptions, verify};
use alvis::volume::{Dtype, Volume};
use std::path::Path;
use std::process::ExitCode;

/// Converts a foam of 96 x 96 x 96 voxels of 0.05 mm into `dir` and verifies the tiles against it.
///
/// A scan of your own takes the place of the phantom: `alvis::volume::open(path, &options)?.volume`,
/// or a `MemoryVolume` of samples that you have in memory.
pub fn run(dir: &Path) -> alvis::Result<(ConvertReport, Report)> {
    let volume =
        render(&Phantom::default(), Dims::new([96; 3])?, Dtype::U8)?.with_placement(Placement {
            spacing: [0.05; 3],
            unit: Unit::Millimetre,
            ..Placement::default()
        })?;
    let options = ConvertOptions {
        threshold: volume.threshold(),
        macrocube: [32; 3],
        memory: 256 << 20,
        source_name: "foam".to_string(),
        force: true,
        ..ConvertOptions::default()
    };
    let made = convert(&volume, &options, dir, &Quiet)?;
    let against: &dyn Volume = &volume;
    let options = VerifyOptions {
        against: Some(against),
        ..VerifyOptions::default()
    };
    let report = verify(dir, &options, &Quiet)?;
    Ok((made, report))
}

// a test includes this file for `run` alone
#[cfg_attr(test, allow(dead_code))]
fn main() -> ExitCode {
    let Some(dir) = std::env::args_os().nth(1) else {
        eprintln!("usage: convert_and_verify DIRECTORY");
        return ExitCode::from(2);
    };
    match run(Path::new(&dir)) {
        Ok((made, report)) => {
            println!(
                "{} tiles, {} triangles, {} cells",
                made.totals.tiles, made.totals.triangles, made.totals.cells
            );
            for issue in &report.issues {
                println!("{}: {}", issue.path, issue.message);
            }
            println!("{}", if report.ok { "no hole" } else { "not sound" });
            ExitCode::from(u8::from(!report.ok))
        }
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}
