//! Volumes of other kinds than foams of whole numbers: rock, floats, signed numbers, little surface, noise, real scans.

use crate::input::Input;
use crate::run::{self, Alvis};
use alvis::volume::{OpenOptions, Volume, open};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Real scans below the directory of test data: what it is, its path, the threshold.
const SCANS: [(&str, &str, f64); 11] = [
    ("sandstone, a mask", "npy/berea_100_to_300.npz", 0.5),
    ("snow", "tiff/snow.tif", 22_800.5),
    ("snow as floats", "derived/snow_float32.tif", 0.348),
    ("bone", "tiff_slices/LHDL_3155_D_4_bc", 83.5),
    ("fibres", "tiff/100_fiberform.tif", 89.5),
    ("cement", "tiff/cement_128x128x128.tif", 74.5),
    ("engine", "nifti/engine.nii.gz", 79.5),
    ("head phantom", "nifti/CT_pitch.nii.gz", 88.5),
    ("brain, signed", "nrrd/brain1_image.nrrd", 393.5),
    ("thorax, sparse", "metaimage/LIDC2.mha", 58.5),
    ("lobster, sparse", "raw/lobster_301x324x56_uint8.raw", 39.5),
];
/// Scans are repeated along z until they have so many voxels: small ones are over before they can be measured.
const VOXELS: u64 = 64 << 20;
/// Standard deviation of the Gaussian that makes rock of white noise, in voxels.
const SIGMA: f32 = 3.0;

/// Made-up volumes.
pub fn made_up(dir: &Path) -> Result<Vec<Input>, String> {
    let phantom = |kind, dims, dtype| Input::phantom(dir, kind, dims, dtype);
    Ok(vec![
        rock(dir, [400; 3])?,
        phantom("foam", [400; 3], "f32")?,
        phantom("foam", [400; 3], "i16")?,
        phantom("torus", [512; 3], "u8")?,
        phantom("noise", [192; 3], "u8")?,
    ])
}

/// Those of the real scans that are below `data`, each repeated.
pub fn scans(data: &Path, dir: &Path) -> Result<Vec<Input>, String> {
    let there = SCANS.iter().filter(|(_, path, _)| data.join(path).exists());
    there
        .map(|(what, path, threshold)| {
            let out = dir.join(format!("scan_{}.raw", what.replace([' ', ','], "_")));
            let scan = Scan::open(&data.join(path), path)?;
            let (dims, dtype) = scan.repeat(&out)?;
            Ok(Input {
                what,
                path: out,
                dims,
                dtype,
                threshold: *threshold,
            })
        })
        .collect()
}

/// A scan to repeat.
struct Scan(Box<dyn Volume>);

impl Scan {
    /// Opens one; raw ones have their size and type in their name.
    fn open(file: &Path, name: &str) -> Result<Scan, String> {
        let mut options = OpenOptions::default();
        if name.ends_with(".raw") {
            options.dims = Some([301, 324, 56]);
            options.dtype = Some("u8".parse().map_err(|e| format!("{e}"))?);
        }
        let opened = open(file, &options).map_err(|e| e.to_string())?;
        Ok(Scan(opened.volume))
    }

    /// Writes it again and again as raw samples; returns the size of all and their type.
    fn repeat(&self, out: &Path) -> Result<([u32; 3], &'static str), String> {
        let header = self.0.header();
        let [nx, ny, nz] = header.dims.0;
        let times = VOXELS.div_ceil(header.dims.voxels()).max(1) as u32;
        let mut samples = vec![0; header.dims.voxels() as usize * header.dtype.bytes()];
        let read = self.0.read_box(0..nx, 0..ny, 0..nz, &mut samples);
        read.map_err(|e| e.to_string())?;
        let file = File::create(out).map_err(|e| format!("{}: {e}", out.display()))?;
        let mut file = BufWriter::new(file);
        for _ in 0..times {
            file.write_all(&samples).map_err(|e| e.to_string())?;
        }
        file.flush().map_err(|e| e.to_string())?;
        Ok(([nx, ny, nz * times], header.dtype.name()))
    }
}

/// White noise that is smoothed by [`SIGMA`] and cut at its middle, as bytes with the threshold there: walls and
/// pores of a few voxels, half a triangle to a voxel.
fn rock(dir: &Path, dims: [u32; 3]) -> Result<Input, String> {
    let [x, y, z] = dims;
    let input = Input {
        what: "rock",
        path: dir.join(format!("rock_{x}x{y}x{z}_u8.raw")),
        dims,
        dtype: "u8",
        threshold: 127.5,
    };
    if std::fs::metadata(&input.path).is_ok_and(|m| m.len() == input.voxels() as u64) {
        return Ok(input);
    }
    let noise = dir.join("white.raw");
    let (words, path) = (format!("{x},{y},{z}"), noise.display().to_string());
    let args = ["phantom", "noise", &path, "--dims", &words, "--force"];
    run::timed(Alvis::command(&[&args[..], &["--quiet"]].concat())?)?;
    let white = std::fs::read(&noise).map_err(|e| format!("{path}: {e}"))?;
    std::fs::remove_file(&noise).map_err(|e| format!("{path}: {e}"))?;
    let middle = white.iter().map(|&v| f64::from(v)).sum::<f64>() / white.len() as f64;
    let mut field: Vec<f32> = white
        .iter()
        .map(|&v| f32::from(v) - middle as f32)
        .collect();
    smooth(&mut field, dims.map(|n| n as usize));
    let square = field.iter().map(|&v| f64::from(v * v)).sum::<f64>() / field.len() as f64;
    // four deviations to either side of the threshold
    let scale = 32.0 / square.sqrt() as f32;
    let bytes: Vec<u8> = field
        .iter()
        .map(|&v| (v * scale + 127.5).round() as u8)
        .collect();
    std::fs::write(&input.path, bytes).map_err(|e| format!("{}: {e}", input.path.display()))?;
    Ok(input)
}

/// A Gaussian along each axis; what lies outside repeats.
fn smooth(field: &mut [f32], dims: [usize; 3]) {
    let reach = (4.0 * SIGMA) as usize;
    let weight = |i: usize| (-0.5 * ((i as f32 - reach as f32) / SIGMA).powi(2)).exp();
    let weights: Vec<f32> = (0..=2 * reach).map(weight).collect();
    let mut line = Vec::new();
    for axis in 0..3 {
        let (n, stride) = (dims[axis], dims[..axis].iter().product::<usize>());
        for start in (0..field.len()).filter(|i| i / stride % n == 0) {
            let around = (n - reach..2 * n + reach).map(|i| field[start + i % n * stride]);
            line.clear();
            line.extend(around);
            for i in 0..n {
                let products = line[i..].iter().zip(&weights).map(|(v, w)| v * w);
                field[start + i * stride] = products.sum();
            }
        }
    }
}
