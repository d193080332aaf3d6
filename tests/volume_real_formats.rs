//! Real files of the formats with pages, chunks and archives: the samples are those that tifffile 2026,
//! Pillow (of bone_7H3A_B1.tif, which tifffile refuses), nibabel, SimpleITK (of DICOM), zarr-python and
//! numpy read.

mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, Io, OpenOptions, open};
use volume_common::data;

struct Known {
    path: &'static str,
    format: &'static str,
    dims: [u32; 3],
    dtype: Dtype,
    crc: u32,
    spacing: [f64; 3],
    unit: Unit,
    from: Origin,
}

#[rustfmt::skip]
macro_rules! known {
    ($path:literal, $format:literal, $dims:expr, $dtype:ident, $crc:literal, $spacing:expr, $unit:ident, $from:ident) => {
        Known { path: $path, format: $format, dims: $dims, dtype: Dtype::$dtype, crc: $crc, spacing: $spacing, unit: Unit::$unit, from: Origin::$from }
    };
}

#[rustfmt::skip]
const FILES: &[Known] = &[
    // inches are a resolution for paper and are not believed
    known!("tiff/100_fiberform.tif", "tiff", [100, 100, 100], U8, 0x1d6d9783, [1.0; 3], Voxel, Default),
    known!("tiff/bone_7H3A_B1.tif", "tiff", [350, 250, 600], U8, 0x4d3464c0, [1.0; 3], Voxel, Default),
    known!("tiff/cement_128x128x128.tif", "tiff", [128, 128, 128], U8, 0xaf0e3d37, [1.0; 3], Voxel, Default),
    known!("tiff/electrode.tiff", "tiff", [256, 256, 256], U8, 0x4de91db7, [1.0; 3], Voxel, Default),
    known!("tiff/shell_225x128x128.tif", "tiff", [128, 128, 225], U8, 0x456db3c1, [1.0; 3], Micrometre, File),
    known!("tiff/snow.tif", "tiff", [100, 100, 100], U16, 0xca083f05, [1.0; 3], Voxel, Default),
    known!("derived/snow_float32.tif", "tiff", [100, 100, 100], F32, 0x44b041dc, [1.0; 3], Voxel, Default),
    known!("derived/cement_lzw_be.tif", "tiff", [128, 128, 128], U8, 0xaf0e3d37, [1.0; 3], Voxel, Default),
    known!("derived/cement_deflate_pred_tiled.tif", "tiff", [128, 128, 128], U8, 0xaf0e3d37, [1.0; 3], Voxel, Default),
    known!("tiff_slices/LHDL_3155_D_4_bc", "tiff", [200, 200, 200], U8, 0x99bbf631, [1.0; 3], Voxel, Default),
    known!("derived/snow_png16", "png", [100, 100, 100], U16, 0xca083f05, [1.0; 3], Voxel, Default),
    known!("tiff/ketton.zip", "tiff", [256, 256, 256], U8, 0x6f9cf292, [1.0; 3], Voxel, Default),
    known!("npy/berea_100_to_300.npz", "numpy", [200, 200, 200], U8, 0x0ebc0e16, [1.0; 3], Voxel, Default),
    known!("dicom/philips_head_phantom_5mm", "dicom", [512, 512, 28], I16, 0xd4676a93, [0.451_171_875, 0.451_171_875, 5.0], Millimetre, File),
    known!("derived/snow_v2.zarr", "zarr", [100, 100, 100], U16, 0xca083f05, [1.0; 3], Voxel, Default),
    known!("derived/snow_v3.zarr", "zarr", [100, 100, 100], U16, 0xca083f05, [1.0; 3], Voxel, Default),
    known!("derived/cement.ome.zarr", "zarr", [128, 128, 128], U8, 0xaf0e3d37, [1.0; 3], Voxel, File),
    known!("nifti/CT_pitch.nii.gz", "nifti", [175, 248, 58], U8, 0x03ab7932, [0.8125, 0.8125, 2.397_049_4], Millimetre, File),
    known!("nifti/engine.nii.gz", "nifti", [256, 256, 128], U8, 0x5db1123a, [1.0; 3], Millimetre, File),
    known!("nifti/mni_icbm152_t1_tal_nlin_sym_09a_converted.nii.gz", "nifti", [197, 233, 189], U8, 0x39d966c3, [1.0; 3], Millimetre, File),
];

#[test]
fn samples_and_places_are_those_of_other_readers() {
    let Some(dir) = data() else {
        return;
    };
    for file in FILES {
        for io in [Io::Mmap, Io::Read] {
            let options = OpenOptions {
                io,
                ..OpenOptions::default()
            };
            let opened = open(&dir.join(file.path), &options)
                .unwrap_or_else(|e| panic!("{}: {e}", file.path));
            let header = opened.volume.header();
            assert_eq!(
                (header.format, header.dims.0, header.dtype),
                (file.format, file.dims, file.dtype),
                "{}",
                file.path
            );
            let place = header.placement;
            let near = |(a, b): (f64, f64)| (a - b).abs() < 1e-5;
            assert!(
                place.spacing.into_iter().zip(file.spacing).all(near),
                "{}: {place:?}",
                file.path
            );
            assert_eq!(
                (place.unit, opened.provenance.spacing),
                (file.unit, [file.from; 3]),
                "{}",
                file.path
            );
            assert!(opened.volume.held_bytes() < 160 << 20);
            let bytes = volume_common::all(&*opened.volume).unwrap();
            if cfg!(target_endian = "little") {
                assert_eq!(crc32fast::hash(&bytes), file.crc, "{}", file.path);
            }
        }
    }
}

/// Boxes that cut strips and tiles anywhere are the same part of the whole.
#[test]
fn any_box_is_the_same_part_of_the_whole() {
    let Some(dir) = data() else {
        return;
    };
    for file in FILES {
        let volume = open(&dir.join(file.path), &OpenOptions::default())
            .unwrap()
            .volume;
        let [nx, ny, nz] = file.dims;
        let sample = file.dtype.bytes();
        let z = nz / 2..nz / 2 + 2;
        let slice = (nx * ny) as usize * sample;
        let mut whole = vec![0; 2 * slice];
        volume
            .read_box(0..nx, 0..ny, z.clone(), &mut whole)
            .unwrap();
        for (x, y) in [
            (0..nx, 0..1),
            (0..nx, 3..67),
            (0..nx, ny - 5..ny),
            (1..2, 0..ny),
            (60..70, 63..66),
            (nx - 1..nx, ny - 1..ny),
        ] {
            let mut out = vec![0; x.len() * y.len() * 2 * sample];
            volume
                .read_box(x.clone(), y.clone(), z.clone(), &mut out)
                .unwrap();
            let mut expected = Vec::new();
            for k in 0..2 {
                for j in y.clone() {
                    let at = k * slice + (j * nx + x.start) as usize * sample;
                    expected.extend_from_slice(&whole[at..at + x.len() * sample]);
                }
            }
            assert!(out == expected, "{} {x:?} {y:?}", file.path);
        }
    }
}
