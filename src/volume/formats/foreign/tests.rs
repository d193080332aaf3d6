use crate::error::Result;
use crate::volume::{OpenOptions, open};
use std::path::Path;

const VOXELS: usize = 28 * 20 * 12;

fn message(folder: &Path, name: &str) -> String {
    let done = open(&folder.join(name), &OpenOptions::default());
    done.unwrap_err().to_string()
}

fn put(folder: &Path, name: &str, parts: &[&[u8]]) {
    std::fs::write(folder.join(name), parts.concat()).unwrap();
}

/// Opens a file with the options that a message gives, as the command line takes them.
fn follow(folder: &Path, said: &str) -> Result<crate::volume::Opened> {
    let words = said
        .split('`')
        .nth(1)
        .unwrap()
        .split(' ')
        .collect::<Vec<_>>();
    assert_eq!(words[..2], ["alvis", "info"], "{said}");
    let mut options = OpenOptions::default();
    for pair in words[3..].chunks(2) {
        let numbers = || pair[1].split(',');
        match pair[0] {
            "--dims" => {
                let dims: Vec<u64> = numbers().map(|n| n.parse().unwrap()).collect();
                options.dims = Some(dims.try_into().unwrap());
            }
            "--spacing" => {
                let size: Vec<f64> = numbers().map(|n| n.parse().unwrap()).collect();
                options.spacing = Some(size.try_into().unwrap());
            }
            "--dtype" => options.dtype = Some(pair[1].parse().unwrap()),
            "--endian" => options.endian = Some(pair[1].parse().unwrap()),
            "--offset" => options.offset = Some(pair[1].parse().unwrap()),
            "--unit" => options.unit = Some(pair[1].parse().unwrap()),
            other => panic!("{other} in {said}"),
        }
    }
    open(
        &folder.join(Path::new(words[2]).file_name().unwrap()),
        &options,
    )
}

/// Samples of 16 bits that count up.
fn samples(big: bool) -> Vec<u8> {
    let word = |n: usize| match big {
        true => (n as u16).to_be_bytes(),
        false => (n as u16).to_le_bytes(),
    };
    (0..VOXELS).flat_map(word).collect()
}

/// One volume in formats that have a header of their own in front of the samples or beside them.
fn put_with_headers(at: &Path) {
    let vtk = "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 28 20 12\nSPACING 1 1 \
               1\nPOINT_DATA 6720\nSCALARS d unsigned_short\nLOOKUP_TABLE default\n";
    put(at, "a.vtk", &[vtk.as_bytes(), &samples(true)]);
    let vtk = "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 29 21 13\nSPACING 1 1 \
               1\nCELL_DATA 6720\nSCALARS d unsigned_short 1\nLOOKUP_TABLE default\n";
    put(at, "cells.vtk", &[vtk.as_bytes(), &samples(true)]);
}

/// The same volume as raw samples, with what scanners and programs write beside them.
fn put_raw_with_notes(at: &Path) {
    put(at, "unity.raw", &[b"abcd", &samples(false)]);
    let unity = "dimx:28\ndimy:20\ndimz:12\nskip:4\nformat:uint16\n";
    put(at, "unity.raw.ini", &[unity.as_bytes()]);
    let edf = "{\nHeaderID = EH:000001:000000:000000 ;\nByteOrder = HighByteFirst ;\nDataType = UnsignedShort ;\n\
               Dim_1 = 28 ;\nDim_2 = 20 ;\nDim_3 = 12 ;\n}\n";
    put(at, "a.edf", &[edf.as_bytes(), &samples(true)]);
    put(at, "scan_28x20x12_16bit.raw", &[&samples(false)]);
    put(at, "test.28x20x12.raw", &[&samples(false)]);
    put(at, "foo_28x20x12_uint16.raw", &[&samples(false)]);
}

#[test]
fn the_options_in_a_message_read_the_samples() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    put_with_headers(at);
    put_raw_with_notes(at);
    for (name, spacing) in [
        ("a.vtk", [1.0; 3]),
        ("cells.vtk", [1.0; 3]),
        ("unity.raw", [1.0; 3]),
        ("unity.raw.ini", [1.0; 3]),
        ("a.edf", [1.0; 3]),
        ("scan_28x20x12_16bit.raw", [1.0; 3]),
        ("test.28x20x12.raw", [1.0; 3]),
        ("foo_28x20x12_uint16.raw", [1.0; 3]),
    ] {
        let said = message(at, name);
        let opened = follow(at, &said).unwrap_or_else(|e| panic!("{said}\n{e}"));
        let header = opened.volume.header();
        assert_eq!(header.dims.0, [28, 20, 12], "{said}");
        assert_eq!(header.placement.spacing, spacing, "{said}");
        let mut out = vec![0; 2 * VOXELS];
        opened
            .volume
            .read_box(0..28, 0..20, 0..12, &mut out)
            .unwrap();
        let counts = out
            .as_chunks::<2>()
            .0
            .iter()
            .map(|w| u16::from_ne_bytes(*w));
        assert!(counts.eq(0..VOXELS as u16), "{said}");
    }
}

#[test]
fn every_format_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let tar: &[u8] = &[&[b'x'; 257][..], b"ustar"].concat();
    let bmp: &[u8] = &[b"BM", &[0; 12][..], &[40, 0, 0, 0], &[0; 20]].concat();
    for (file, begin, name) in [
        ("a", &b"CDF\x01"[..], "NetCDF-3"),
        ("a", b"CDF\x02", "NetCDF-3"),
        ("a.txm", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "OLE"),
        ("a.vdb", b" BDV\0\0\0\0", "OpenVDB"),
        ("a.bmp", bmp, "BMP"),
        ("a", b"\xff\xd8\xff\xe0", "JPEG"),
        ("a", b"\0\0\0\x0cjP  \r\n", "JPEG 2000"),
        ("a", b"GIF89a", "GIF"),
        ("a", tar, "tar"),
        ("a", b"7z\xbc\xaf\x27\x1c", "7z"),
        ("a", b"Rar!\x1a\x07\0", "RAR"),
        ("a", b"\xfd7zXZ\0", "xz"),
        ("a", b"BZh91AY&SY", "bzip2"),
        ("a", b"\x28\xb5\x2f\xfd", "Zstandard"),
        ("a.dm3", b"\0\0\0\x03\0\0", "DM3"),
        ("a.dm4", b"\0\0\0\x04\0\0", "DM4"),
        ("a.lif", b"\x70\0\0\0", "LIF"),
        ("a.czi", b"ZISRAWFILE", "CZI"),
        ("a.nd2", b"\xda\xce\xbe\x0a", "ND2"),
        ("a.ply", b"ply\nformat", "PLY"),
        ("a.stl", b"solid x\nfacet normal", "STL"),
        ("a.aim", b"\x14\0\0\0", "Scanco AIM"),
        ("a.vgl", b"{project}", "Volume Graphics .vgl"),
        ("a", b"\x0e\x03\x13\x01", "HDF4"),
        ("a.pgm", b"P5\n4 4\n255\n", "PNM"),
        ("a.his", b"x", "HIS"),
        ("2dseq", b"x", "ParaVision"),
        ("a.mat", b"MATLAB 5.0 MAT-file", "MATLAB 5"),
        (
            "info",
            b"{\"num_channels\": 1, \"scales\": []}",
            "Neuroglancer",
        ),
        (
            "a.vtu",
            b"<VTKFile type=\"UnstructuredGrid\">",
            "UnstructuredGrid",
        ),
    ] {
        let samples = if file == "a.vtu" { &b""[..] } else { &[0; 700] };
        put(dir.path(), file, &[begin, samples]);
        let said = message(dir.path(), file);
        assert!(
            said.contains(name) && said.contains("not supported"),
            "{said}"
        );
        assert!(!said.contains("raw samples"), "{said}");
        std::fs::remove_file(dir.path().join(file)).unwrap();
    }
}

#[test]
fn samples_that_are_not_there_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let ini = "dimx:28\ndimy:20\ndimz:12\nskip:0\nformat:uint16\n";
    put(dir.path(), "a.raw.ini", &[ini.as_bytes()]);
    assert!(message(dir.path(), "a.raw.ini").contains("not there"));
    put(dir.path(), "a.raw", &[&[0; 100]]);
    assert!(message(dir.path(), "a.raw").contains("the file has 100 bytes, not 13440"));
    // nothing is suggested where nothing fits
    put(dir.path(), "b_28x20x12.raw", &[&[0; 100]]);
    let said = message(dir.path(), "b_28x20x12.raw");
    assert!(
        !said.contains("suggests") && said.contains("--dims and --dtype"),
        "{said}"
    );
}

#[test]
fn what_is_packed_by_gzip_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let pack = |name: &str, bytes: &[u8]| {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, bytes).unwrap();
        std::fs::write(dir.path().join(name), packed.finish().unwrap()).unwrap();
    };
    for (name, begin, what) in [
        ("v.nrrd.gz", &b"NRRD0004\n"[..], "NRRD"),
        ("v.tif.gz", b"II*\0\x08\0\0\0", "TIFF"),
        ("v.tar.gz", b"any", "tar"),
    ] {
        pack(name, begin);
        let said = message(dir.path(), name);
        assert!(said.contains(what) && said.contains("unpack it"), "{said}");
    }
    // gunzip alone leaves a tar, which is not read either; this one is told by its content
    pack("v.tgz", &[&[b'x'; 257][..], b"ustar", &[0; 300]].concat());
    for name in ["v.tar.gz", "v.tgz"] {
        let said = message(dir.path(), name);
        assert!(
            said.contains("`tar -xf`") && !said.contains("gunzip"),
            "{said}"
        );
    }
    pack("v.raw.gz", &[7; 100]);
    assert!(message(dir.path(), "v.raw.gz").contains("--dims and --dtype"));
}

#[test]
fn folders_say_which_file_to_give() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    put(at, "v.raw", &[&[0; 8]]);
    put(at, "v.mhd", &[b"NDims = 3\nDimSize = 2 2 2\n"]);
    assert!(message(at, ".").contains("give ") && message(at, ".").contains("v.mhd"));
    put(at, "w.nrrd", &[b"NRRD0004\n"]);
    let said = message(at, ".");
    assert!(
        said.contains("a folder of 2 volumes") && said.contains("w.nrrd"),
        "{said}"
    );
    let nested = at.join("nested");
    std::fs::create_dir_all(nested.join("scan.zarr")).unwrap();
    put(&nested.join("scan.zarr"), "zarr.json", &[b"{}"]);
    std::fs::create_dir(nested.join("notes")).unwrap();
    let said = message(at, "nested");
    assert!(
        said.contains("a folder that holds one volume") && said.contains("scan.zarr"),
        "{said}"
    );
}

#[test]
fn whole_numbers_of_64_bits_in_vtk_have_a_way() {
    let dir = tempfile::tempdir().unwrap();
    let text = "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 1 0 1 0 1\" \
                Origin=\"0 0 0\" Spacing=\"1 1 1\"><Piece Extent=\"0 1 0 1 0 1\"><PointData Scalars=\"v\"><DataArray \
                type=\"Int64\" Name=\"v\" format=\"ascii\">1 2 3 4 5 6 7 8</DataArray></PointData></Piece></ImageData>\
                </VTKFile>";
    put(dir.path(), "v.vti", &[text.as_bytes()]);
    let said = message(dir.path(), "v.vti");
    assert!(
        said.contains("of type Int64 is not supported: save it as Int32"),
        "{said}"
    );
}
