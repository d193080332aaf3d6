//! Cuts the cells of a volume at their necks, and prints how many there are, how long it took and what it needed: a
//! program to measure by.
//!
//! `split VOLUME THRESHOLD|otsu [KEY=VALUE ...]` with `ratio`, `h`, `threads`, `memory` (MiB), `height` and `band` (of
//! blocks, for trying), `dims` and `dtype` of raw files, `roi=cylinder`, `labels=FILE` (cells of all voxels as u32),
//! `necks=FILE` (as CSV), `repeat=N` (so many voxels along each axis, of the volume beside itself).

use alvis::grid::{Dims, Dtype, Fill};
use alvis::progress::Quiet;
use alvis::split::{BitSource, Metric, SlabGrid, Split, SplitOptions, split};
use alvis::volume::{Filled, OpenOptions, RegionVoxels, Volume};
use alvis::volume::{fill_value, find_cylinder, open, statistics};
use bytemuck::Pod;
use std::collections::BTreeMap;
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A volume's bits, of which it may be repeated along all axes.
struct Bits<'a> {
    volume: &'a dyn Volume,
    threshold: f64,
    dims: Dims,
}

impl Bits<'_> {
    /// Which voxels are solid, of samples of this type.
    fn solid<T: Pod + Into<f64>>(&self, bytes: &[u8]) -> Vec<bool> {
        let samples = bytemuck::pod_collect_to_vec::<u8, T>(bytes);
        let is_solid = |sample: T| sample.into() >= self.threshold;
        samples.into_iter().map(is_solid).collect()
    }
}

impl BitSource for Bits<'_> {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> alvis::Result<()> {
        let header = self.volume.header();
        let [nx, ny, nz] = header.dims.0;
        let slice = header.dims.slice_voxels() as usize;
        let mut bytes = vec![0; slice * header.dtype.bytes()];
        let z = z % nz;
        self.volume.read_box(0..nx, 0..ny, z..z + 1, &mut bytes)?;
        let solid = match header.dtype {
            Dtype::U8 => self.solid::<u8>(&bytes),
            Dtype::I8 => self.solid::<i8>(&bytes),
            Dtype::U16 => self.solid::<u16>(&bytes),
            Dtype::I16 => self.solid::<i16>(&bytes),
            Dtype::U32 => self.solid::<u32>(&bytes),
            Dtype::I32 => self.solid::<i32>(&bytes),
            Dtype::F32 => self.solid::<f32>(&bytes),
            Dtype::F64 => self.solid::<f64>(&bytes),
        };
        words.fill(0);
        let row_words = self.dims.0[0].div_ceil(64) as usize;
        for (y, row) in words.chunks_mut(row_words).enumerate() {
            let solid = &solid[y % ny as usize * nx as usize..][..nx as usize];
            for x in 0..self.dims.0[0] as usize {
                row[x / 64] |= u64::from(solid[x % nx as usize]) << (x % 64);
            }
        }
        Ok(())
    }
}

/// The highest resident memory so far, in MiB.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    let kib = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok());
    kib.unwrap_or(0) >> 10
}

fn opened(path: &Path, words: &BTreeMap<&str, &str>) -> Result<Box<dyn Volume>> {
    let mut options = OpenOptions::default();
    if let Some(dims) = words.get("dims") {
        let dims: Vec<u64> = dims
            .split(',')
            .map(str::parse)
            .collect::<std::result::Result<_, _>>()?;
        options.dims = Some(dims.try_into().map_err(|_| "dims=X,Y,Z")?);
    }
    if let Some(dtype) = words.get("dtype") {
        options.dtype = Some(dtype.parse()?);
    }
    let volume = open(path, &options)?.volume;
    if words.get("roi") != Some(&"cylinder") {
        return Ok(volume);
    }
    let slices = 0..volume.header().dims.0[2];
    let cylinder = find_cylinder(&*volume, slices, &Quiet)?.cylinder;
    println!("cylinder: {cylinder:?}");
    let region = RegionVoxels::cylinder(&cylinder, volume.header().dims)?;
    let otsu = statistics(&*volume, Some(&region), &Quiet)?
        .otsu
        .ok_or("one value")?;
    let value = fill_value(&*volume, &region, otsu, Fill::Material, &Quiet)?;
    Ok(Box::new(Filled::new(volume, region, value)?))
}

/// The number of a word, or another one.
fn number(words: &BTreeMap<&str, &str>, key: &str, default: f64) -> Result<f64> {
    Ok(words.get(key).map_or(Ok(default), |word| word.parse())?)
}

/// Options of the split.
fn asked(words: &BTreeMap<&str, &str>, dims: Dims, spacing: [f64; 3]) -> Result<SplitOptions> {
    let number = |key, default| number(words, key, default);
    let threads = number("threads", 2.0)? as usize;
    let mut grid = SlabGrid::fitting(dims, (number("memory", 256.0)? as u64) << 20, threads);
    grid.height = number("height", grid.height.into())? as u32;
    grid.band = number("band", grid.band.into())? as u32;
    let mut options = SplitOptions::new(grid);
    options.threads = threads;
    options.metric = Metric::of_spacing(spacing, Metric::REACH);
    options.rule.ratio_permille = (1000.0 * number("ratio", 0.8)?).round() as u32;
    options.rule.h_256 = (256.0 * number("h", 0.5)?).round() as u32;
    Ok(options)
}

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, threshold, rest @ ..] = &words[..] else {
        return Err("which volume, which threshold?".into());
    };
    let pairs = rest
        .iter()
        .map(|word| word.split_once('=').ok_or("KEY=VALUE"));
    let words = pairs.collect::<std::result::Result<BTreeMap<_, _>, _>>()?;
    let volume = opened(Path::new(path), &words)?;
    let threshold = match &threshold[..] {
        "otsu" => statistics(&*volume, None, &Quiet)?
            .otsu
            .ok_or("one value")?,
        threshold => threshold.parse()?,
    };
    let header = volume.header();
    let dims = match words.get("repeat") {
        Some(n) => Dims::new([n.parse()?; 3])?,
        None => header.dims,
    };
    let options = asked(&words, dims, header.placement.spacing)?;
    let grid = options.grid;
    println!("{dims}, threshold {threshold}, {options:?}");
    let mut bits = Bits {
        volume: &*volume,
        threshold,
        dims,
    };
    let dir = std::env::temp_dir();
    let started = Instant::now();
    let mut made = split(&mut bits, &options, &dir, &Told(started))?;
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{:?}, {} bytes of rows, curve {:?}",
        made.counts(),
        made.stored_bytes(),
        made.curve()
    );
    println!(
        "{seconds:.3} s, {:.1} ns a voxel, peak {} MiB",
        seconds * 1e9 / dims.voxels() as f64,
        peak_memory()
    );
    if let Some(file) = words.get("labels") {
        write_labels(&mut made, grid, File::create(file)?)?;
    }
    if let Some(file) = words.get("necks") {
        write_necks(&mut made, &options, File::create(file)?)?;
    }
    Ok(())
}

/// Writes the cell of each voxel, 0 where it is solid.
fn write_labels(made: &mut Split, grid: SlabGrid, file: File) -> Result<()> {
    let mut file = BufWriter::new(file);
    let [nx, ny, _] = grid.dims.0.map(|n| n as usize);
    for slab in 0..grid.slabs() {
        let slices = grid.slab(slab);
        let mut labels = vec![0u32; slices.len() * ny * nx];
        made.slab(slab, |y, z, pieces| {
            let at = ((z - slices.start) as usize * ny + y as usize) * nx;
            for piece in pieces {
                let [start, last] = [piece.start, piece.last].map(|x| at + usize::from(x));
                labels[start..=last].fill(piece.part as u32);
            }
            Ok(())
        })?;
        for label in labels {
            file.write_all(&label.to_le_bytes())?;
        }
    }
    Ok(file.flush()?)
}

/// Writes the necks as a table.
fn write_necks(made: &mut Split, options: &SplitOptions, file: File) -> Result<()> {
    let mut file = BufWriter::new(file);
    writeln!(file, "cell_a,cell_b,neck_radius,ratio,x,y,z,neck_area")?;
    let [nx, ny, _] = options.grid.dims.0.map(u64::from);
    let mut failed = Ok(());
    made.necks(|neck| {
        let [a, b] = neck.cells;
        let [x, y, z] = [neck.voxel % nx, neck.voxel / nx % ny, neck.voxel / nx / ny];
        let (radius, ratio) = (neck.radius(&options.metric), neck.ratio());
        let area = neck.area([1.0; 3]);
        let ratio = ratio.map_or(String::new(), |ratio| format!("{ratio:.4}"));
        let line = writeln!(file, "{a},{b},{radius:.3},{ratio},{x},{y},{z},{area:.2}");
        failed = std::mem::replace(&mut failed, Ok(())).and(line);
        Ok(())
    })?;
    failed?;
    Ok(file.flush()?)
}

/// Says when each pass begins.
struct Told(Instant);

impl alvis::progress::Progress for Told {
    fn begin(&self, stage: &str, _total: u64) {
        println!("{:.3} s: {stage}", self.0.elapsed().as_secs_f64());
    }
}
