//! Files of each format that the suite opens.

use std::path::{Path, PathBuf};

/// Files of each format in tests/fixtures; `MADE` are written by [`made`].
pub(super) const FIXTURES: &[(&str, &[&str])] = &[
    ("nrrd", MADE),
    ("metaimage", MADE),
    (
        "tiff",
        &["u16_be_strips.tif", "i32_big_tiles.tif", "u16_lzw.tif"],
    ),
    (
        "numpy",
        &["i16_be.npy", "packed.npz", "fortran.npy", "f16_be.npy"],
    ),
    ("zip", &["png16.zip", "tiff.zip"]),
    ("vti", &["u16.vti", "f32_zlib.vti"]),
    ("nifti", &["u16_be.nii.gz", "i16_slope.nii", "u8_pair.hdr"]),
    ("hdf5", &["u16.h5", "i16_be.h5"]),
    (
        "dicom",
        &[
            "dicom/u16",
            "dicom/i16_jpeg.dcm",
            "dicom/tilted",
            "dicom/uneven",
        ],
    ),
    ("zarr", &["zarr/u16_gzip_shuffle", "zarr/u8_3_shards"]),
    ("png", &["png8"]),
    ("bmp", &["scanners/bmp"]),
    ("vgi", &["scanners/vg.vgi"]),
    ("xtekct", &["scanners/nikon.xtekct"]),
    ("pyhst", &["scanners/esrf.vol.info"]),
    ("pcr", &["scanners/ge.pcr"]),
    ("isq", &["scanners/i16.isq"]),
    (
        "amiramesh",
        &[
            "scanners/u16.am",
            "scanners/u8_rle.am",
            "scanners/f32_zip_be.am",
        ],
    ),
    (
        "mrc",
        &[
            "scanners/u16.mrc",
            "scanners/f16.mrc",
            "scanners/i16_zyx_be.mrc",
        ],
    ),
    ("analyze", &["scanners/i16.hdr"]),
    ("aim", &["scanners/i8.aim", "scanners/u16_v030.aim"]),
];
const MADE: &[&str] = &[];

/// Writes a volume of 5 x 4 x 3 as a format does it, plain and packed.
pub(super) fn made(format: &str, dir: &Path) -> Vec<PathBuf> {
    let samples: Vec<u8> = (0..60u16).flat_map(|v| (v * 77).to_be_bytes()).collect();
    let packed = |level| {
        let mut out = Vec::new();
        let mut encoder = flate2::read::GzEncoder::new(&samples[..], level);
        std::io::Read::read_to_end(&mut encoder, &mut out).unwrap();
        out
    };
    let files: Vec<(&str, &str, Vec<u8>)> = match format {
        "nrrd" => {
            let head = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 5 4 3\nendian: big\n";
            vec![
                (
                    "v.nrrd",
                    head,
                    [b"encoding: raw\n\n", &samples[..]].concat(),
                ),
                (
                    "p.nrrd",
                    head,
                    [&b"encoding: gzip\n\n"[..], &packed(Default::default())].concat(),
                ),
            ]
        }
        "metaimage" => {
            let head = "ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\nBinaryDataByteOrderMSB = True\n\
                        ElementType = MET_USHORT\nElementDataFile = LOCAL\n";
            vec![("v.mha", head, samples)]
        }
        other => panic!("no fixture of {other}, which is in the registry"),
    };
    let write = |(name, head, rest): (&str, &str, Vec<u8>)| {
        let path = dir.join(name);
        std::fs::write(&path, [head.as_bytes(), &rest].concat()).unwrap();
        path
    };
    files.into_iter().map(write).collect()
}
