//! Reads a volume through filters as a conversion does, and prints how long it takes: a program to measure by.
//!
//! `filters VOLUME [THREADS [FILTER ...]]`, filters in the order in which they act, as in `'smooth 1' 'median 1'`.

use alvis::grid::Filter;
use alvis::volume::{OpenOptions, Volume, open};
use std::error::Error;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

/// Cubes of a macrocube along an axis.
const SIDE: u32 = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((path, words)) = words.split_first() else {
        return Err("which volume?".into());
    };
    let (threads, filters) = match words.split_first() {
        Some((threads, filters)) => (threads.parse()?, filters),
        None => (2, words),
    };
    let filters = filters.iter().map(|text| text.parse::<Filter>());
    let filters = filters.collect::<alvis::Result<Vec<_>>>()?;
    let volume = open(Path::new(path), &OpenOptions::default())?;
    let volume = volume.filter(&filters)?.volume;
    let started = Instant::now();
    let sum = sweep(&*volume, threads)?;
    println!(
        "{:.3} s, sum of bytes {sum}",
        started.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Reads all bands, each with the voxels that gradients need, and sums their bytes.
fn sweep(volume: &dyn Volume, threads: usize) -> Result<u64, Box<dyn Error>> {
    let [nx, ny, nz] = volume.header().dims.0;
    let bands = (ny - 1).div_ceil(SIDE);
    let next = AtomicU32::new(0);
    let range = |i: u32, n: u32| (i * SIDE).saturating_sub(1)..(i * SIDE + SIDE + 2).min(n);
    let work = || -> alvis::Result<u64> {
        let (mut sum, mut out) = (0, Vec::new());
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= bands * (nz - 1).div_ceil(SIDE) {
                return Ok(sum);
            }
            let (y, z) = (range(i % bands, ny), range(i / bands, nz));
            let voxels = nx as usize * y.len() * z.len();
            out.resize(voxels * volume.header().dtype.bytes(), 0);
            volume.read_box(0..nx, y, z, &mut out)?;
            sum += out.iter().map(|&byte| u64::from(byte)).sum::<u64>();
        }
    };
    let sums = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined.collect::<Result<Vec<_>, _>>()
    });
    let sums = sums.map_err(|_| "a thread panicked")?;
    Ok(sums.into_iter().sum::<alvis::Result<u64>>()?)
}
