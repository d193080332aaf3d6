//! Table 5.1 of the paper that this project comes from, made again: one foam at its six resolutions.
//!
//! ```sh
//! cargo run --release --example paper_table
//! ```
//!
//! The paper (A. Neubauer and A. Kanitsar, ALVIS, CESCG 2000) measured on a Pentium II of 350 MHz with
//! 196 MB. Its columns are seconds for marching cubes, for the segmentation of surfaces and for that of
//! cells, MB of memory, and triangles per second for each. Here the same three are timed one by one on
//! one core: marching cubes with normals; surfaces as what lies between one object and one cell; objects
//! and cells with their voxel sums. Beside them stands the whole conversion, from the file to tiles and
//! tables on disk, on all cores, with its peak of memory.

use alvis::convert::{ConvertOptions, convert};
use alvis::grid::Dims;
use alvis::kernels::Kernels;
use alvis::phantom::{Foam, Phantom, Shape, render};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, MemoryVolume, Volume};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// A row of the paper's table; its last one has no times for the segmentations.
struct Paper {
    dims: [u32; 3],
    triangles: f64,
    megabytes: f64,
    marching_cubes: f64,
    surfaces: Option<f64>,
    cells: Option<f64>,
}

const fn row(
    dims: [u32; 3],
    triangles: f64,
    megabytes: f64,
    marching_cubes: f64,
    segmentation: Option<[f64; 2]>,
) -> Paper {
    let (surfaces, cells) = match segmentation {
        Some([surfaces, cells]) => (Some(surfaces), Some(cells)),
        None => (None, None),
    };
    Paper {
        dims,
        triangles,
        megabytes,
        marching_cubes,
        surfaces,
        cells,
    }
}

const PAPER: [Paper; 6] = [
    row([89, 89, 108], 635_606.0, 28.0, 17.0, Some([19.0, 31.0])),
    row([104, 104, 126], 876_500.0, 34.0, 22.0, Some([25.0, 45.0])),
    row([125, 125, 152], 1_307_108.0, 42.0, 32.0, Some([40.0, 75.0])),
    row(
        [156, 156, 190],
        2_098_104.0,
        60.0,
        50.0,
        Some([70.0, 125.0]),
    ),
    row(
        [208, 208, 253],
        3_925_790.0,
        98.0,
        88.0,
        Some([175.0, 310.0]),
    ),
    row([313, 313, 380], 8_884_916.0, 208.0, 360.0, None),
];

/// Pitch and wall of the foam's cells, as shares of the volume's width.
const PITCH: f64 = 8.0 / 89.0;
const WALL: f64 = 2.0 / 89.0;

/// What one resolution took.
struct Measured {
    triangles: f64,
    marching_cubes: f64,
    surfaces: f64,
    cells: f64,
    convert: f64,
    megabytes: f64,
}

/// The foam at one resolution.
fn foam(dims: [u32; 3]) -> alvis::Result<MemoryVolume<u8>> {
    let width = f64::from(dims[0]);
    let shape = Shape::Foam(Foam {
        pitch: PITCH * width,
        wall: WALL * width,
        ..Foam::default()
    });
    let dims = Dims::new(dims.map(u64::from))?;
    let phantom = render(&Phantom::new(shape), dims, Dtype::U8)?;
    let mut samples = vec![0; dims.voxels() as usize];
    let [nx, ny, nz] = dims.0;
    phantom.read_box(0..nx, 0..ny, 0..nz, &mut samples)?;
    MemoryVolume::new(dims, phantom.header().placement, samples)
}

/// The shortest of three times.
fn best(mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..3).map(time).fold(f64::INFINITY, f64::min)
}

/// Converts in a process of its own, whose peak of memory is that of the conversion and the volume.
fn convert_apart(number: usize) -> Result<[f64; 2], String> {
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let output = Command::new(program)
        .arg(number.to_string())
        .output()
        .map_err(|e| e.to_string())?;
    let text = String::from_utf8_lossy(&output.stdout);
    let numbers: Vec<f64> = text.split_whitespace().flat_map(str::parse).collect();
    let message = || String::from_utf8_lossy(&output.stderr).into_owned();
    numbers.try_into().map_err(|_| message())
}

fn convert_here(number: usize) -> alvis::Result<()> {
    let volume = foam(PAPER[number].dims)?;
    let dir = std::env::temp_dir().join(format!("alvis-paper-{}", std::process::id()));
    let options = ConvertOptions {
        threshold: 127.5,
        ..ConvertOptions::default()
    };
    let made = convert(&volume, &options, &dir, &Quiet);
    let _ = std::fs::remove_dir_all(&dir);
    let made = made?;
    println!("{} {}", made.seconds, made.peak_rss_bytes as f64 / 1e6);
    Ok(())
}

fn measure(number: usize) -> Result<Measured, String> {
    let volume = foam(PAPER[number].dims).map_err(|e| e.to_string())?;
    let mut kernels = Kernels::new(&volume, 128).map_err(|e| e.to_string())?;
    let [seconds, megabytes] = convert_apart(number)?;
    Ok(Measured {
        triangles: kernels.triangles() as f64,
        cells: best(|| {
            kernels.classify();
            kernels.label();
        }),
        surfaces: best(|| {
            kernels.surfaces();
        }),
        marching_cubes: best(|| kernels.mesh()),
        convert: seconds,
        megabytes,
    })
}

/// Seconds, triangles per second, and how many times the paper's rate that is.
fn cell(seconds: f64, triangles: f64, paper: Option<f64>) -> String {
    let rate = triangles / seconds;
    let times = paper.map_or("-".into(), |paper| format!("{:.0}", rate / paper));
    format!("{seconds:.4} | {rate:.3e} | {times}")
}

fn main() -> ExitCode {
    if let Some(number) = std::env::args().nth(1).and_then(|n| n.parse().ok()) {
        return match convert_here(number) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    println!(
        "| volume | triangles | paper's | marching cubes s | triangles/s | times paper's | surfaces s \
         | triangles/s | times paper's | cells s | triangles/s | times paper's | conversion s | MB | \
         paper's MB |"
    );
    println!("|{}", "---|".repeat(15));
    for (number, paper) in PAPER.iter().enumerate() {
        let ours = match measure(number) {
            Ok(ours) => ours,
            Err(message) => {
                eprintln!("paper_table: {message}");
                return ExitCode::from(2);
            }
        };
        let [x, y, z] = paper.dims;
        let rate = |seconds: Option<f64>| seconds.map(|s| paper.triangles / s);
        println!(
            "| {x} x {y} x {z} | {} | {} | {} | {} | {} | {:.3} | {:.0} | {} |",
            ours.triangles,
            paper.triangles,
            cell(
                ours.marching_cubes,
                ours.triangles,
                rate(Some(paper.marching_cubes))
            ),
            cell(ours.surfaces, ours.triangles, rate(paper.surfaces)),
            cell(ours.cells, ours.triangles, rate(paper.cells)),
            ours.convert,
            ours.megabytes,
            paper.megabytes
        );
    }
    ExitCode::SUCCESS
}
