//! The table of formats that are known and not read. The first that fits a file counts.

use crate::volume::formats::foreign::Kind;
use crate::volume::formats::foreign::described::Described;
use crate::volume::formats::foreign::lines::{dat, edf, raw_ini, vff, vtk};
use std::path::Path;

/// Nothing is known of where samples lie.
fn nowhere(_: &Path, _: &[u8]) -> Option<Described> {
    None
}

/// True if a file's name ends so, in whatever case.
fn ends(path: &Path, endings: &[&str]) -> bool {
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    endings.iter().any(|ending| name.ends_with(ending))
}

fn has(head: &[u8], at: usize, magic: &[u8]) -> bool {
    head.get(at..).is_some_and(|rest| rest.starts_with(magic))
}

fn contains(head: &[u8], words: &[u8]) -> bool {
    head.windows(words.len()).any(|w| w == words)
}

/// A text that has all of these words.
fn text(head: &[u8], words: &[&str]) -> bool {
    let text = String::from_utf8_lossy(head).to_lowercase();
    words.iter().all(|word| text.contains(word))
}

const TO_TIFF: &str =
    "save its slices as TIFF from the program that wrote it, or with ImageJ (Fiji)";
const TO_NRRD: &str = "convert it to NRRD or MetaImage, as with 3D Slicer or SimpleITK";
const TO_PNG: &str = "convert its slices to PNG or TIFF, as with ImageMagick's `mogrify -format png FILES`, and \
                      give the folder";
const LOSSY: &str = "JPEG has changed its grey values: save the slices anew as PNG or TIFF, or convert these with \
                     `mogrify -format png *.jpg` and give the folder";
const FIJI: &str = "save it as TIFF with Fiji (Bio-Formats)";
const UNPACK: &str = "unpack it and give what is in it";
const MESH: &str = "it holds a surface, not a volume: give the volume that it was made of";

macro_rules! kinds {
    ($($name:literal, $is:expr, $read:expr, $way:expr;)*) => {
        &[$(Kind { name: $name, is: $is, read: $read, way: $way }),*]
    };
}

/// By content, where a format has a mark; the weaker the mark, the further down.
pub(crate) const KINDS: &[Kind] = kinds! {
    "PNG (of one slice)", |_, h| has(h, 0, b"\x89PNG\r\n\x1a\n"), nowhere, "give the folder of the slices";
    "HDF5", |_, h| has(h, 0, b"\x89HDF\r\n\x1a\n"), nowhere, TO_NRRD;
    "DICOM", |_, h| has(h, 128, b"DICM"), nowhere, TO_NRRD;
    "legacy VTK", |_, h| has(h, 0, b"# vtk DataFile"), vtk, "save it as .vti, as with ParaView";
    "Scanco AIM (of another version)", |p, h| has(h, 0, b"AIMDATA_V0") || ends(p, &[".aim", ".aim;1"]), nowhere,
        "convert it with itk-ioscanco or Fiji";
    "NetCDF-3 (also of MINC 1)", |_, h| [1, 2, 5].iter().any(|v| has(h, 0, &[b'C', b'D', b'F', *v])), nowhere,
        "convert it to NetCDF-4 with `nccopy -k nc4`, or MINC 1 to MINC 2 with `mincconvert -2`";
    "OLE (of Zeiss .txm and .txrm, of Olympus .oib)", |_, h| has(h, 0, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"), nowhere,
        "save slices as TIFF or DICOM from Zeiss' reconstructor, or read it with dxchange's read_txrm and save it as \
         .npy or TIFF";
    "OpenVDB", |_, h| has(h, 0, b" BDV\0\0\0\0"), nowhere,
        "save its grid as a dense array, as with pyopenvdb's copyToArray and numpy.save";
    "BMP (of one slice)", |_, h| has(h, 0, b"BM") && [12, 40, 52, 56, 64, 108, 124].iter().any(|n| has(h, 14, &[*n, 0, 0, 0])),
        nowhere, "give the folder of the slices";
    "JPEG", |_, h| has(h, 0, b"\xff\xd8\xff"), nowhere, LOSSY;
    "JPEG 2000", |_, h| has(h, 0, b"\0\0\0\x0cjP  ") || has(h, 0, b"\xff\x4f\xff\x51"), nowhere,
        "convert its slices to TIFF, as with `opj_decompress`, and give the folder";
    "GIF", |_, h| has(h, 0, b"GIF87a") || has(h, 0, b"GIF89a"), nowhere,
        "its pixels are colours of a table: save slices as PNG or TIFF from where they came from";
    "tar", |p, h| has(h, 257, b"ustar") || ends(p, &[".tar"]), nowhere, UNPACK;
    "7z", |_, h| has(h, 0, b"7z\xbc\xaf\x27\x1c"), nowhere, UNPACK;
    "RAR", |_, h| has(h, 0, b"Rar!\x1a\x07"), nowhere, UNPACK;
    "xz", |_, h| has(h, 0, b"\xfd7zXZ\0"), nowhere, "unpack it with `unxz -k`";
    "bzip2", |_, h| has(h, 0, b"BZh") && has(h, 4, b"1AY&SY"), nowhere, "unpack it with `bunzip2 -k`";
    "Zstandard", |_, h| has(h, 0, b"\x28\xb5\x2f\xfd"), nowhere, "unpack it with `unzstd -k`";
    "LZ4", |_, h| has(h, 0, b"\x04\x22\x4d\x18"), nowhere, "unpack it with `unlz4 -k`";
    "CZI (Zeiss ZEN)", |_, h| has(h, 0, b"ZISRAWFILE"), nowhere, FIJI;
    "ND2 (Nikon)", |p, h| has(h, 0, b"\xda\xce\xbe\x0a") || ends(p, &[".nd2"]), nowhere, FIJI;
    "LIF (Leica)", |p, h| has(h, 0, b"\x70\0\0\0") && ends(p, &[".lif"]), nowhere, FIJI;
    "DM3 or DM4 (Gatan)", |p, h| ends(p, &[".dm3", ".dm4"]) && (has(h, 0, &[0, 0, 0, 3]) || has(h, 0, &[0, 0, 0, 4])),
        nowhere, FIJI;
    "GIPL", |_, h| has(h, 252, &[0xef, 0xff, 0xe9, 0xb0]) || has(h, 252, &[0x2a, 0xe3, 0x89, 0xb8]), nowhere, TO_NRRD;
    "Bio-Rad .pic", |p, h| has(h, 54, &[0x39, 0x30]) && ends(p, &[".pic"]), nowhere, FIJI;
    "FreeSurfer .mgh", |p, h| has(h, 0, &[0, 0, 0, 1]) && ends(p, &[".mgh"]) || ends(p, &[".mgz"]), nowhere,
        "convert it to NIfTI, as with `mri_convert` or nibabel";
    "MATLAB 5", |_, h| has(h, 0, b"MATLAB 5.0 MAT-file"), nowhere,
        "save it with `save('v.mat', '-v7.3')`, which is HDF5, or as TIFF";
    "HDF4", |_, h| has(h, 0, b"\x0e\x03\x13\x01"), nowhere, "convert it to HDF5 with `h4toh5`";
    "WebP", |_, h| has(h, 0, b"RIFF") && has(h, 8, b"WEBP"), nowhere, TO_PNG;
    "PNM", |_, h| has(h, 0, b"P5\n") || has(h, 0, b"P2\n") || has(h, 0, b"P5 "), nowhere, TO_PNG;
    "OpenEXR", |_, h| has(h, 0, b"\x76\x2f\x31\x01"), nowhere, TO_PNG;
    "Photoshop", |_, h| has(h, 0, b"8BPS"), nowhere, TO_PNG;
    "CBF", |_, h| has(h, 0, b"###CBF"), nowhere, "save it as TIFF or .npy, as with fabio";
    "PerkinElmer HIS", |p, _| ends(p, &[".his"]), nowhere, FIJI;
    "ParaVision 2dseq", |p, _| p.file_name().is_some_and(|name| name == "2dseq"), nowhere,
        "convert it to NIfTI, as with brkraw";
    "FITS", |_, h| has(h, 0, b"SIMPLE  ="), nowhere, "save its array with astropy and numpy.save";
    "glTF", |_, h| has(h, 0, b"glTF"), nowhere, MESH;
    "PLY", |_, h| has(h, 0, b"ply\n") || has(h, 0, b"ply\r\n"), nowhere, MESH;
    "STL", |p, h| ends(p, &[".stl"]) || has(h, 0, b"solid ") && contains(h, b"facet normal"), nowhere, MESH;
    "OBJ", |p, h| ends(p, &[".obj"]) && (contains(h, b"\nv ") || has(h, 0, b"v ")), nowhere, MESH;
    "VFF", |_, h| has(h, 0, b"ncaa"), vff, TO_NRRD;
    "EDF (ESRF)", |_, h| has(h, 0, b"{") && (text(h, &["dim_1", "datatype", "byteorder"]) || text(h, &["edf_"]) || text(h, &["headerid", "eh:"])), edf,
        "save it as TIFF or .npy, as with fabio";
    "ICS", |_, h| text(&h[..h.len().min(64)], &["ics_version"]), nowhere, FIJI;
    "INRIMAGE", |_, h| has(h, 0, b"#INRIMAGE-4#{"), nowhere, TO_NRRD;
    "ENVI", |_, h| has(h, 0, b"ENVI") && text(h, &["samples", "lines"]), nowhere, TO_NRRD;
    "Parquet", |_, h| has(h, 0, b"PAR1"), nowhere, "it holds a table, not a volume";
    "PDF", |_, h| has(h, 0, b"%PDF"), nowhere, "it holds no volume";
    "Neuroglancer Precomputed", |_, h| has(h, 0, b"{") && text(h, &["\"scales\"", "\"num_channels\""]), nowhere,
        "save it as Zarr or .npy, as with cloud-volume";
    "VG (Volume Graphics .vgl)", |p, _| ends(p, &[".vgl"]), nowhere,
        "it is a project: give the .vgi beside its samples, or save slices as TIFF from VGSTUDIO";
    "Nikon .xtekVolume", |p, _| ends(p, &[".xtekvolume"]), nowhere,
        "give the .xtekct beside its samples, or save slices as TIFF";
    "raw.ini", |p, h| ends(p, &[".ini"]) && text(h, &["dimx", "dimy", "dimz"]), raw_ini, TO_NRRD;
    "DAT (volume renderers)", |_, h| text(h, &["objectfilename", "resolution"]), dat, TO_NRRD;
    "Philips PAR", |p, _| ends(p, &[".par"]), nowhere, "convert it with dcm2niix";
    "EZRT .rek", |p, _| ends(p, &[".rek"]), nowhere, TO_TIFF;
    "SkyScan log", |p, h| ends(p, &[".log"]) && text(h, &["[reconstruction]"]), nowhere,
        "give the folder of its slices";
    "XML", |_, h| has(h, 0, b"<?xml"), nowhere, "give the file that it describes";
};
