use crate::grid::{Origin, Unit};
use crate::volume::{Dtype, Endian, OpenOptions, Opened, open};
use std::path::Path;

const VOXELS: usize = 6 * 5 * 4;

const VGI: &str = "{volume1}\n[representation]\nsize = 6 5 4\nmirror = 0 0 0 0\ndatatype = unsigned \
                   integer\nbitsperelement = 16\n[file1]\nSkipHeader = 0\nFileFormat = raw\nSize = 6 5 4\nName = \
                   v.vol\nDatatype = float\nBitsPerElement = 32\n{volumeprimitive12}\n[geometry]\nresolution = 0.1 0.2 \
                   0.5\nunit = mm\n";
const NIKON: &str = "[XTekCT]\nName=v\nVoxelsX=6\nVoxelsY=5\nVoxelsZ=4\nVoxelSizeX=0.02\nVoxelSizeY=0.02\nVoxelSizeZ=\
                     0.04\n";
const ESRF: &str =
    "NUM_X = 6\nNUM_Y = 5\nNUM_Z = 4\nvoxelSize = 5.5e-01\nBYTEORDER = HIGHBYTEFIRST\n";
const PCR: &str =
    "[VolumeData]\nVolume_SizeX=6\nVolume_SizeY=5\nVolume_SizeZ=4\nVoxelSizeRec=0.017\nFormat=5\n";

/// Opens a header beside a file `v.vol` of so many bytes for each voxel.
fn opened(name: &str, text: &str, bytes: usize) -> crate::error::Result<Opened> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("v.vol"), vec![1; bytes * VOXELS]).unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    open(&path, &OpenOptions::default())
}

fn refusal(name: &str, text: &str, bytes: usize) -> String {
    opened(name, text, bytes).unwrap_err().to_string()
}

#[test]
fn sizes_types_and_units_are_those_of_the_header() {
    for (name, text, bytes, dtype, spacing, unit) in [
        (
            "v.vgi",
            VGI,
            4,
            Dtype::F32,
            [0.1, 0.2, 0.5],
            Unit::Millimetre,
        ),
        (
            "v.vgl",
            VGI,
            4,
            Dtype::F32,
            [0.1, 0.2, 0.5],
            Unit::Millimetre,
        ),
        (
            "v.xtekct",
            NIKON,
            4,
            Dtype::F32,
            [0.02, 0.02, 0.04],
            Unit::Millimetre,
        ),
        (
            "v.xtekct",
            NIKON,
            2,
            Dtype::U16,
            [0.02, 0.02, 0.04],
            Unit::Millimetre,
        ),
        (
            "v.vol.info",
            ESRF,
            4,
            Dtype::F32,
            [0.55; 3],
            Unit::Micrometre,
        ),
        (
            "v.vol.info",
            ESRF,
            1,
            Dtype::U8,
            [0.55; 3],
            Unit::Micrometre,
        ),
        ("v.pcr", PCR, 2, Dtype::U16, [0.017; 3], Unit::Millimetre),
    ] {
        let opened = opened(name, text, bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        let header = opened.volume.header();
        assert_eq!((header.dims.0, header.dtype), ([6, 5, 4], dtype), "{name}");
        let place = header.placement;
        assert_eq!((place.spacing, place.unit), (spacing, unit), "{name}");
        assert_eq!(opened.provenance.spacing, [Origin::File; 3], "{name}");
        let big = name == "v.vol.info";
        assert_eq!(
            header.endian,
            if big { Endian::Big } else { Endian::Little }
        );
        assert_eq!(opened.warnings, [""; 0], "{name}");
        // what follows from the length is told
        let told = opened
            .notes
            .iter()
            .any(|note| note.contains("by the length of"));
        assert_eq!(
            told,
            big || name == "v.xtekct",
            "{name}: {:?}",
            opened.notes
        );
    }
    let opened = opened("v.vgi", VGI, 4).unwrap();
    assert!(
        opened.notes[0].contains("shows samples as u16"),
        "{:?}",
        opened.notes
    );
}

#[test]
fn what_contradicts_itself_is_refused() {
    for (name, text, bytes, says) in [
        ("v.vgi", VGI.replace("Size = 6", "Size = 7"), 4, "6 5 4"),
        (
            "v.vgi",
            VGI.replace("mirror = 0 0", "mirror = 0 1"),
            4,
            "turned round",
        ),
        ("v.vgi", VGI.replace("= raw", "= tiff"), 4, "tiff files"),
        (
            "v.vgi",
            VGI.replace("v.vol", "D:\\x\\w.vol"),
            4,
            "w.vol there",
        ),
        ("v.vgi", VGI.replace("= 32", "= 12"), 4, "12 bits"),
        ("v.vgi", VGI.replace("= float", "= complex"), 4, "complex"),
        (
            "v.vgi",
            VGI.replace("Name", "Comment"),
            4,
            "no `Name` in [file1]",
        ),
        (
            "v.vgi",
            format!("{VGI}[file2]\nName = b.vol\n"),
            4,
            "2 files",
        ),
        (
            "v.vgi",
            format!("{{volume2}}\n[representation]\nsize = 1 1 1\n{VGI}"),
            4,
            "2 volumes",
        ),
        (
            "v.vgi",
            VGI.replace("SkipHeader", "RegionOfInterestEnd = 4 4 3\nSkip"),
            4,
            "region",
        ),
        ("v.vgi", VGI.into(), 2, "240 bytes"),
        ("v.vgi", "text".into(), 2, "section [representation]"),
        (
            "v.xtekct",
            NIKON.replace("VoxelsY", "Y"),
            4,
            "no `VoxelsY` in [xtekct]",
        ),
        (
            "v.xtekct",
            NIKON.replace("VoxelsY=5", "VoxelsY=5\nVoxelsY=6"),
            4,
            "of 5 and of 6",
        ),
        ("v.xtekct", NIKON.into(), 3, "360 bytes"),
        ("v.xtekct", "text".into(), 3, "section [XTekCT]"),
        (
            "v.vol.info",
            ESRF.replace("HIGHBYTEFIRST", "mixed"),
            4,
            "LOWBYTEFIRST",
        ),
        (
            "v.vol.info",
            ESRF.replace("NUM_Z = 4", "NUM_Z = 0"),
            4,
            "2 to 65536",
        ),
        ("w.vol.info", ESRF.into(), 4, "w.vol there"),
        (
            "v.pcr",
            PCR.replace("=5\nVoxel", "=5\nVoxel")
                .replace("Format=5", "Format=10"),
            2,
            "which is u16",
        ),
        ("v.pcr", PCR.into(), 4, "which is f32"),
        ("v.pcr", "[VolumeData]\n".into(), 4, "section [VolumeData]"),
    ] {
        let said = refusal(name, &text, bytes);
        assert!(said.contains(says), "{name}, {says}: {said}");
    }
    // the way out reads the samples
    let said = refusal(
        "v.vgi",
        &VGI.replace("SkipHeader", "RegionOfInterestEnd = 4 4 3\nSkip"),
        4,
    );
    assert!(said.contains("--dims 6,5,4 --dtype f32"), "{said}");
}

#[test]
fn what_is_unclear_is_told() {
    let other = opened("v.pcr", &PCR.replace("Format=5", "Format=6\nMin=-7"), 2).unwrap();
    assert_eq!(other.volume.header().dtype, Dtype::I16);
    assert!(
        other.notes[0].contains("Format 6 is not known"),
        "{:?}",
        other.notes
    );
    let scaled = opened("v.vgi", &VGI.replace("unit", "scale = 1 1 2\nunit"), 4).unwrap();
    assert!(
        scaled.warnings[0].contains("scale of 1 1 2"),
        "{:?}",
        scaled.warnings
    );
    let bare = opened("v.vgi", &VGI.replace("unit = mm", ""), 4).unwrap();
    assert_eq!(bare.provenance.unit, Origin::Default);
    // keys of other sections, and the section behind others
    let late = format!("[Other]\nVolume_SizeX=9\n{}\n{PCR}", "x=1\n".repeat(2000));
    assert_eq!(
        opened("v.pcr", &late, 2).unwrap().volume.header().dims.0,
        [6, 5, 4]
    );
}

#[test]
fn the_file_with_the_samples_says_which_header_to_give() {
    for (name, text) in [
        ("v.vgi", VGI),
        ("v.xtekct", NIKON),
        ("v.vol.info", ESRF),
        ("v.pcr", PCR),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let bytes = if name == "v.pcr" { 2 } else { 4 };
        std::fs::write(dir.path().join("v.vol"), vec![1; bytes * VOXELS]).unwrap();
        std::fs::write(dir.path().join(name), text).unwrap();
        let raw: &Path = &dir.path().join("v.vol");
        let said = open(raw, &OpenOptions::default()).unwrap_err().to_string();
        assert!(
            said.contains(name) && said.contains("which says size and type"),
            "{said}"
        );
    }
}
