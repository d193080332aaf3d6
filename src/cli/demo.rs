//! `alvis demo`: everything once, on a foam phantom.

use super::args::Common;
use super::form::PrimitivesArg;
use super::progress::Console;
use super::{Outcome, convert as convert_command, output, verify};
use crate::convert::{ConvertOptions, ConvertReport, check_output, convert};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::phantom::{Phantom, render, write};
use crate::preview::{PreviewOptions, preview};
use crate::tileset::refuse_bucket;
use crate::verify::{Report as VerifyReport, VerifyOptions};
use crate::volume::{Dtype, OpenOptions, open};
use clap::{Args, ValueHint};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Names that a demo makes in its directory.
const VOLUME: &str = "foam.mhd";
const SAMPLES: &str = "foam.raw";
const TILES: &str = "foam";
const SLICE: &str = "slice.png";
/// Size of its voxels in mm.
const SPACING: f64 = 0.05;

/// Make a foam phantom, convert it, verify the result and say what to look at
///
/// The directory gets foam.mhd with foam.raw, the tile set foam/ and slice.png, a slice with its cells
/// in colour. An earlier demo in it is replaced.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis demo\n  \
    alvis demo small --size 64\n  \
    alvis demo lists --primitives triangles")]
pub struct DemoArgs {
    /// The directory to write
    #[arg(default_value = "alvis-demo", value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// Edge of the phantom in voxels
    #[arg(long, value_name = "N", default_value = "256",
        value_parser = clap::value_parser!(u32).range(16..=2048))]
    size: u32,
    /// Strips, or the triangle lists that MeshLab needs
    #[arg(long, value_name = "KIND", default_value = "strips")]
    primitives: PrimitivesArg,
    #[command(flatten)]
    common: Common,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    volume: String,
    slice: String,
    tiles: String,
    threshold: f64,
    convert: ConvertReport,
    verify: VerifyReport,
}

impl DemoArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        prepare(&self.out)?;
        let report = self.make(&console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&text(&report))?;
        }
        Ok(if report.verify.ok {
            Outcome::Done
        } else {
            Outcome::Issues
        })
    }

    fn make(&self, console: &Console) -> Result<Report> {
        let (path, tiles) = (self.out.join(VOLUME), self.out.join(TILES));
        let dims = Dims::new([u64::from(self.size); 3])?;
        let phantom = Phantom {
            noise: 0.05,
            ..Phantom::default()
        };
        let made = render(&phantom, dims, Dtype::U8)?.with_placement(Placement {
            spacing: [SPACING; 3],
            unit: Unit::Millimetre,
            ..Placement::default()
        })?;
        console.note(&format!("making {}: foam, {dims} voxels", path.display()));
        write(&made, &path, true, console)?;
        let opened = open(&path, &OpenOptions::default())?;
        let options = ConvertOptions {
            threshold: made.threshold(),
            threads: self.common.threads.map_or(0, usize::from),
            primitives: self.primitives.into(),
            force: true,
            source_name: opened.name.clone(),
            source_part: opened.part.clone(),
            provenance: opened.provenance,
            ..ConvertOptions::default()
        };
        console.note(&format!("converting it to {}", tiles.display()));
        let convert = convert(&*opened.volume, &options, &tiles, console)?;
        console.note("verifying the tiles against the volume");
        let options = VerifyOptions {
            against: Some(&*opened.volume),
            ..VerifyOptions::default()
        };
        let verify = crate::verify::verify(&tiles, &options, console)?;
        let slice = self.out.join(SLICE);
        console.note(&format!("drawing its middle slice to {}", slice.display()));
        let options = PreviewOptions {
            tiles: Some(tiles.clone()),
            colour_by: Some("equivalent_diameter".into()),
            ..PreviewOptions::default()
        };
        preview(&*opened.volume, &slice, &options)?;
        Ok(Report {
            volume: path.display().to_string(),
            slice: slice.display().to_string(),
            tiles: tiles.display().to_string(),
            threshold: made.threshold(),
            convert,
            verify,
        })
    }
}

/// Makes the directory; refuses one in which something else lives.
fn prepare(out: &Path) -> Result<()> {
    refuse_bucket(out)?;
    std::fs::create_dir_all(out).map_err(|e| Error::io(out, "create the directory", e))?;
    let earlier = is_demo(out);
    let entries = std::fs::read_dir(out).map_err(|e| Error::io(out, "read", e))?;
    for entry in entries {
        let name = entry.map_err(|e| Error::io(out, "read", e))?.file_name();
        let own = [VOLUME, SAMPLES, TILES, SLICE].iter().any(|&n| name == n);
        if !own || !earlier {
            let found = format!("{} with {} in it", out.display(), name.display());
            let expected = "a new directory or an earlier demo";
            return Err(Error::usage("OUT", found, expected));
        }
    }
    if earlier {
        check_output(&out.join(TILES), true)?;
    }
    Ok(())
}

/// True if a demo has made the volume in this directory, of whatever size.
fn is_demo(out: &Path) -> bool {
    let opened = open(&out.join(VOLUME), &OpenOptions::default());
    opened.is_ok_and(|opened| {
        let header = opened.volume.header();
        let size = header.dims.0[0];
        header.dims.0 == [size; 3]
            && header.dtype == Dtype::U8
            && header.placement.spacing == [SPACING; 3]
            && header.placement.unit == Unit::Millimetre
    })
}

fn text(report: &Report) -> String {
    let Report {
        volume,
        slice,
        tiles,
        ..
    } = report;
    let issues = if report.verify.ok {
        String::new()
    } else {
        format!("To see the issues:    alvis verify {tiles} --against {volume}\n")
    };
    let typed = output::shell(Path::new(tiles));
    let meshlab = if report.convert.totals.strips > 0 {
        "run the demo with --primitives triangles first"
    } else {
        "File > Import Mesh, then choose a tile"
    };
    format!(
        "{}{}{issues}\n\
         {volume} is the volume, {tiles} the tile set.\n\
         Look at a slice:      {slice}\n\
         Look at the cells:    {tiles}/cells.csv\n\
         In Blender:           File > Import > glTF 2.0, then choose tiles in {tiles}/tiles\n\
         In any glTF viewer:   open a file of {tiles}/tiles\n\
         In MeshLab:           {meshlab}\n\
         With your own scan:   alvis info SCAN; alvis convert SCAN OUT --threshold otsu\n\
         Move through it:      alvis view {typed}\n",
        convert_command::summary(&report.convert),
        verify::verdict(&report.verify),
    )
}
