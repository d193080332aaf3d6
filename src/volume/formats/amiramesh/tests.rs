use crate::error::Result;
use crate::grid::{Origin, Unit};
use crate::volume::{Dtype, Endian, OpenOptions, Opened, open};
use std::io::Write;
use std::path::Path;

const DIMS: &str = "define Lattice 4 3 2\n";
const PLACE: &str = "Parameters {\n Units {\n  Coordinates \"mm\"\n }\n BoundingBox 1 1.3 2 2.4 3 3.5,\n CoordType \
                     \"uniform\"\n}\n";
const DATA: &str = "Lattice { ushort Data } @1\n";

/// A file of these parts.
fn amira(kind: &str, place: &str, arrays: &str, samples: &[u8]) -> Vec<u8> {
    let head = format!(
        "# AmiraMesh {kind} 2.1\n\n{DIMS}\n{place}\n{arrays}\n# Data section follows\n@1\n"
    );
    [head.as_bytes(), samples].concat()
}

fn little(place: &str, arrays: &str, samples: &[u8]) -> Vec<u8> {
    amira("BINARY-LITTLE-ENDIAN", place, arrays, samples)
}

/// Samples of 16 bits that count up.
fn samples() -> Vec<u8> {
    (0..24u16).flat_map(|v| (v * 300).to_le_bytes()).collect()
}

/// A file in a directory, which it needs as long as it is read.
fn opened_in(dir: &Path, bytes: &[u8], dataset: Option<&str>) -> Result<Opened> {
    let path = dir.join("v.am");
    std::fs::write(&path, bytes).unwrap();
    let options = OpenOptions {
        dataset: dataset.map(str::to_owned),
        ..OpenOptions::default()
    };
    open(&path, &options)
}

fn opened(bytes: &[u8], dataset: Option<&str>) -> Result<Opened> {
    opened_in(tempfile::tempdir().unwrap().path(), bytes, dataset)
}

/// The samples of a file.
fn all(bytes: &[u8], dataset: Option<&str>) -> Result<Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    read(&opened_in(dir.path(), bytes, dataset)?)
}

fn read(opened: &Opened) -> Result<Vec<u8>> {
    let mut out = vec![0; 24 * opened.volume.header().dtype.bytes()];
    opened.volume.read_box(0..4, 0..3, 0..2, &mut out)?;
    Ok(out)
}

#[test]
fn samples_as_they_are_in_both_orders() {
    let counts: Vec<u8> = (0..24u16).flat_map(|v| (v * 300).to_ne_bytes()).collect();
    let big: Vec<u8> = (0..24u16).flat_map(|v| (v * 300).to_be_bytes()).collect();
    for (bytes, endian) in [
        (little(PLACE, DATA, &samples()), Endian::Little),
        (amira("3D BINARY", PLACE, DATA, &big), Endian::Big),
    ] {
        let opened = opened(&bytes, None).unwrap();
        let header = opened.volume.header();
        assert_eq!(
            (header.dims.0, header.dtype, header.endian),
            ([4, 3, 2], Dtype::U16, endian)
        );
        let place = header.placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.1, 0.2, 0.5], Unit::Millimetre)
        );
        assert_eq!(place.origin, [1.0, 2.0, 3.0]);
        assert_eq!(opened.provenance.unit, Origin::File);
        assert_eq!(read(&opened).unwrap(), counts);
    }
}

/// As programs of Windows write them: lines end with CRLF, and the sign of micrometres is that of Latin-1.
#[test]
fn headers_of_other_systems_are_read() {
    let place = PLACE.replace("mm", "\u{b5}m");
    let [plain, two] = [
        DATA,
        "Lattice { ushort First } @1\nLattice { ushort Data } @2\n",
    ]
    .map(|arrays| little(&place, arrays, &[]));
    let of_windows = |head: &[u8]| -> Vec<u8> {
        let text = std::str::from_utf8(head).unwrap().replace('\n', "\r\n");
        text.chars().map(|c| c as u8).collect()
    };
    let plain = [of_windows(&plain), samples()].concat();
    let second = [&[7; 48][..], b"\r\n@2\r\n", &samples()].concat();
    let two = [of_windows(&two), second].concat();
    for (bytes, dataset) in [(plain, None), (two, Some("Data"))] {
        assert_eq!(all(&bytes, dataset).unwrap(), samples());
        let opened = opened(&bytes, dataset).unwrap();
        assert_eq!(opened.volume.header().placement.unit, Unit::Micrometre);
    }
}

#[test]
fn packed_samples_are_unpacked() {
    let labels: Vec<u8> = [vec![0; 10], (1..=7).collect(), vec![9; 7]].concat();
    let runs = [&[10, 0, 0x87][..], &[1, 2, 3, 4, 5, 6, 7], &[7, 9]].concat();
    let mut zip = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    zip.write_all(&labels).unwrap();
    let zip = zip.finish().unwrap();
    for (name, packed) in [("HxByteRLE", &runs), ("HxZip", &zip)] {
        let array = format!("Lattice {{ byte Labels }} @1({name},{})\n", packed.len());
        let bytes = little(PLACE, &array, packed);
        let whole = all(&[&bytes[..], b"\n"].concat(), None).unwrap();
        assert_eq!(whole, labels, "{name}");
        assert!(all(&bytes[..bytes.len() - 4], None).is_err(), "{name}");
    }
    // run lengths of more than the header says
    let array = format!(
        "Lattice {{ byte Labels }} @1(HxByteRLE,{})\n",
        runs.len() + 2
    );
    let long = little(PLACE, &array, &[&runs[..], &[5, 5]].concat());
    assert!(all(&long, None).is_err());
}

#[test]
fn one_of_several_arrays_is_chosen() {
    let arrays = "Lattice { byte Labels } @1(HxByteRLE,2)\nLattice { ushort Data } @2\n";
    let bytes = little(
        PLACE,
        arrays,
        &[&[24, 3][..], b"\n\n@2\n", &samples(), b"\n"].concat(),
    );
    assert_eq!(all(&bytes, Some("Labels")).unwrap(), [3; 24]);
    assert_eq!(all(&bytes, Some("Data")).unwrap(), samples());
    for wrong in [None, Some("Other")] {
        let said = opened(&bytes, wrong).unwrap_err().to_string();
        assert!(said.contains("Labels or Data"), "{said}");
    }
    let moved = little(
        PLACE,
        arrays,
        &[&[24, 3, 0][..], b"\n@2\n", &samples()].concat(),
    );
    let said = opened(&moved, Some("Data")).unwrap_err().to_string();
    assert!(said.contains("no `@2`"), "{said}");
}

#[test]
fn what_is_no_regular_grid_is_refused() {
    let with = |place: &str, arrays: &str| little(place, arrays, &samples());
    for (bytes, says) in [
        (
            with(&PLACE.replace("uniform", "rectilinear"), DATA),
            "rectilinear",
        ),
        (with(&PLACE.replace(" 3.5", ""), DATA), "6 numbers"),
        (
            with(PLACE, "Lattice { float[3] Data } @1\n"),
            "3 numbers for each voxel",
        ),
        (with(PLACE, "Lattice { complex Data } @1\n"), "`complex`"),
        (
            with(PLACE, "Nodes { float Data } @1\n"),
            "without samples on a lattice",
        ),
        (
            with(PLACE, "Lattice { ushort Data } @1(HxOther,5)\n"),
            "without samples on a lattice",
        ),
        (little(PLACE, DATA, &samples()[..40]), "cut short"),
        (amira("ASCII", PLACE, DATA, b"1 2 3"), "are text"),
        (
            amira("MIXED", PLACE, DATA, &samples()),
            "BINARY-LITTLE-ENDIAN or BINARY",
        ),
        (
            b"# AmiraMesh BINARY 2.1\nnVertices 7\n".to_vec(),
            "no samples",
        ),
        (
            b"# AmiraMesh BINARY 2.1\nnVertices 7\n@1\n".to_vec(),
            "without a lattice",
        ),
    ] {
        let said = opened(&bytes, None).unwrap_err().to_string();
        assert!(said.contains(says), "{says}: {said}");
    }
    let said = opened(&with(&PLACE.replace("uniform", "curvilinear"), DATA), None);
    let said = said.unwrap_err().to_string();
    assert!(said.contains("--dims 4,3,2 --dtype u16 --offset"), "{said}");
}

#[test]
fn a_matrix_turns_and_moves_the_volume() {
    let matrix = "TransformationMatrix 0 2 0 0 -2 0 0 0 0 0 2 0 10 20 30 1\n BoundingBox";
    let turned = little(&PLACE.replace("BoundingBox", matrix), DATA, &samples());
    let place = opened(&turned, None).unwrap().volume.header().placement;
    assert_eq!(place.spacing, [0.2, 0.4, 1.0]);
    assert_eq!(
        place.directions,
        [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    );
    assert_eq!(place.origin, [6.0, 22.0, 36.0]);
    let no_unit = little(&PLACE.replace("Units", "Other"), DATA, &samples());
    let bare = opened(&no_unit, None).unwrap();
    assert_eq!(
        (bare.provenance.unit, bare.provenance.spacing),
        (Origin::Default, [Origin::File; 3])
    );
    let nowhere = opened(&little("", DATA, &samples()), None).unwrap();
    assert_eq!(nowhere.provenance.spacing, [Origin::Default; 3]);
}
