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

/// Size, type, spacing and unit of a header, whose note says whether the type follows from the length.
fn is(name: &str, text: &str, bytes: usize, dtype: Dtype, spacing: [f64; 3]) {
    let opened = opened(name, text, bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
    let header = opened.volume.header();
    assert_eq!((header.dims.0, header.dtype), ([6, 5, 4], dtype), "{name}");
    let (big, place) = (name == "v.vol.info", header.placement);
    let unit = if big {
        Unit::Micrometre
    } else {
        Unit::Millimetre
    };
    assert_eq!((place.spacing, place.unit), (spacing, unit), "{name}");
    assert_eq!(opened.provenance.spacing, [Origin::File; 3], "{name}");
    let endian = if big { Endian::Big } else { Endian::Little };
    assert_eq!(header.endian, endian, "{name}");
    assert_eq!(opened.warnings, [""; 0], "{name}");
    let told = |note: &String| note.contains("by the length of");
    let expected = big || name == "v.xtekct";
    assert_eq!(
        opened.notes.iter().any(told),
        expected,
        "{name}: {:?}",
        opened.notes
    );
}

#[test]
fn sizes_types_and_units_are_those_of_the_header() {
    is("v.vgi", VGI, 4, Dtype::F32, [0.1, 0.2, 0.5]);
    is("v.vgl", VGI, 4, Dtype::F32, [0.1, 0.2, 0.5]);
    is("v.xtekct", NIKON, 4, Dtype::F32, [0.02, 0.02, 0.04]);
    is("v.xtekct", NIKON, 2, Dtype::U16, [0.02, 0.02, 0.04]);
    is("v.vol.info", ESRF, 4, Dtype::F32, [0.55; 3]);
    is("v.vol.info", ESRF, 1, Dtype::U8, [0.55; 3]);
    is("v.pcr", PCR, 2, Dtype::U16, [0.017; 3]);
    let opened = opened("v.vgi", VGI, 4).unwrap();
    assert!(
        opened.notes[0].contains("shows samples as u16"),
        "{:?}",
        opened.notes
    );
}

/// A header with one part of it exchanged is refused with these words.
fn refused(name: &str, text: &str, [from, to]: [&str; 2], bytes: usize, says: &str) {
    assert!(text.contains(from), "{from}");
    let said = refusal(name, &text.replacen(from, to, 1), bytes);
    assert!(said.contains(says), "{name}, {says}: {said}");
}

#[test]
fn vgi_that_contradicts_itself_or_is_no_plain_volume_is_refused() {
    let no = |change, bytes, says| refused("v.vgi", VGI, change, bytes, says);
    no(
        ["\nSize = 6", "\nSize = 7"],
        4,
        "7 5 4, the size of the file",
    );
    no(["mirror = 0 0", "mirror = 0 1"], 4, "turned round");
    no(["= raw", "= tiff"], 4, "tiff files");
    no(["v.vol", "D:\\x\\w.vol"], 4, "w.vol there");
    no(["= 32", "= 12"], 4, "12 bits");
    no(["= float", "= complex"], 4, "complex");
    no(["Name", "Comment"], 4, "no `Name` in [file1]");
    no(
        ["{volumep", "[file2]\nName = b.vol\n{volumep"],
        4,
        "2 files",
    );
    no(
        [
            "{volume1}",
            "{volume2}\n[representation]\nsize = 1 1 1\n{volume1}",
        ],
        4,
        "2 volumes",
    );
    no(
        ["SkipHeader", "RegionOfInterestEnd = 4 4 3\nSkip"],
        4,
        "a region of interest",
    );
    no(["unit", "unit"], 2, "240 bytes");
    no(["[representation]", "text"], 2, "section [representation]");
    // the way out reads the samples
    no(
        ["SkipHeader", "RegionOfInterestEnd = 4 4 3\nSkip"],
        4,
        "--dims 6,5,4 --dtype f32",
    );
}

#[test]
fn other_headers_that_contradict_themselves_are_refused() {
    let nikon = |change, bytes, says| refused("v.xtekct", NIKON, change, bytes, says);
    nikon(["VoxelsY", "Y"], 4, "no `VoxelsY` in [xtekct]");
    nikon(["VoxelsY=5", "VoxelsY=5\nVoxelsY=6"], 4, "of 5 and of 6");
    nikon(["v\n", "v\n"], 3, "360 bytes");
    nikon(["[XTekCT]", "text"], 4, "section [XTekCT]");
    refused(
        "v.vol.info",
        ESRF,
        ["HIGHBYTEFIRST", "mixed"],
        4,
        "LOWBYTEFIRST",
    );
    refused(
        "v.vol.info",
        ESRF,
        ["NUM_Z = 4", "NUM_Z = 0"],
        4,
        "2 to 65536",
    );
    refused("w.vol.info", ESRF, ["NUM", "NUM"], 4, "w.vol there");
    refused("v.pcr", PCR, ["Format=5", "Format=10"], 2, "which is u16");
    refused("v.pcr", PCR, ["Format", "Format"], 4, "which is f32");
    refused(
        "v.pcr",
        PCR,
        ["Volume_SizeX", "X"],
        2,
        "section [VolumeData]",
    );
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

#[test]
fn samples_are_found_whatever_the_case_of_their_name() {
    let dir = tempfile::tempdir().unwrap();
    let header = dir.path().join("K.vol.info");
    std::fs::write(&header, ESRF).unwrap();
    std::fs::write(dir.path().join("K.VOL"), vec![1; 4 * VOXELS]).unwrap();
    let opened = open(&header, &OpenOptions::default()).unwrap();
    assert!(opened.files[0].ends_with("K.VOL"), "{:?}", opened.files);
    // which of two is meant is not guessed
    std::fs::write(dir.path().join("k.Vol"), vec![1; 4 * VOXELS]).unwrap();
    let error = open(&header, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("without samples"), "{error}");
}
