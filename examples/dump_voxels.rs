//! Reads any volume that alvis reads and writes its samples as they are in memory: x fastest, in the
//! machine's byte order. Size and type go to stderr.
//!
//! ```sh
//! cargo run --release --example dump_voxels -- INPUT [dims=X,Y,Z dtype=u16] [series=NAME] [resample] > samples.raw
//! cargo run --release --example dump_voxels -- INPUT "filter=clamp 10,200" "filter=downsample 2" > samples.raw
//! ```

use alvis::grid::Filter;
use alvis::volume::{OpenOptions, open};
use std::io::Write;
use std::path::Path;

/// What can go wrong.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Options and filters from words such as `dtype=u16`.
fn options(words: &[String]) -> Result<(OpenOptions, Vec<Filter>)> {
    let mut options = OpenOptions::default();
    let mut filters = Vec::new();
    for word in words {
        let (key, value) = word.split_once('=').unwrap_or((word, ""));
        match key {
            "dims" => {
                let numbers: Vec<u64> = value
                    .split(',')
                    .map(str::parse)
                    .collect::<std::result::Result<_, _>>()?;
                options.dims = Some(numbers.try_into().map_err(|_| "dims=X,Y,Z")?);
            }
            "dtype" => options.dtype = Some(value.parse()?),
            "endian" => options.endian = Some(value.parse()?),
            "series" => options.series = Some(value.into()),
            "dataset" => options.dataset = Some(value.into()),
            "level" => options.level = Some(value.parse()?),
            "offset" => options.offset = Some(value.parse()?),
            "channel" => options.channel = Some(value.parse()?),
            "time" => options.time = Some(value.parse()?),
            "resample" => options.resample = true,
            "filter" => filters.push(value.parse()?),
            _ => return Err(format!("an option {word}").into()),
        }
    }
    Ok((options, filters))
}

/// Writes the samples of the volume at `path` slice by slice; returns what its header says.
pub fn run(path: &Path, words: &[String], out: &mut impl Write) -> Result<String> {
    let (options, filters) = options(words)?;
    let opened = open(path, &options)?;
    let volume = opened.filter(&filters)?.volume;
    let header = volume.header();
    let [nx, ny, nz] = header.dims.0;
    let mut slice = vec![0; header.dims.slice_voxels() as usize * header.dtype.bytes()];
    for k in 0..nz {
        volume.read_box(0..nx, 0..ny, k..k + 1, &mut slice)?;
        out.write_all(&slice)?;
    }
    Ok(format!(
        "{} of {}, {}",
        header.dims, header.dtype, header.format
    ))
}

#[allow(dead_code)] // the tests call `run`
fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (input, options) = words.split_first().ok_or("which volume?")?;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    eprintln!("{}", run(Path::new(input), options, &mut out)?);
    out.flush()?;
    Ok(())
}
