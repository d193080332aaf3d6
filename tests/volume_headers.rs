//! What headers mean, and which are refused. Expected placements and samples are those that
//! SimpleITK 2 reads from the same bytes, unless a comment says otherwise.

mod volume_common;

use alvis::grid::{Placement, Unit};
use alvis::volume::{Header, OpenOptions, open};
use alvis::{Error, Result};
use volume_common::{all, gzip};

const EIGHT: [u8; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

fn read(name: &str, parts: &[&[u8]]) -> Result<(Header, Vec<u8>)> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, parts.concat()).unwrap();
    let volume = open(&path, &OpenOptions::default())?.volume;
    let samples = all(&*volume)?;
    Ok((volume.header().clone(), samples))
}

fn nrrd(fields: &str) -> Result<Header> {
    let head = format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\n{fields}");
    let encoding = if fields.contains("encoding") {
        ""
    } else {
        "encoding: raw\n"
    };
    let (header, samples) = read(
        "v.nrrd",
        &[head.as_bytes(), encoding.as_bytes(), b"\n", &EIGHT],
    )?;
    assert_eq!(samples, EIGHT);
    Ok(header)
}

fn meta(fields: &str) -> Result<Header> {
    let head = format!(
        "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n{fields}ElementDataFile = LOCAL\n"
    );
    let (header, samples) = read("v.mha", &[head.as_bytes(), &EIGHT])?;
    assert_eq!(samples, EIGHT);
    Ok(header)
}

#[test]
fn metaimage_placement() {
    let p = meta("").unwrap().placement;
    assert_eq!(p, Placement::default());
    let p = meta("ElementSpacing = -2 1 1\n").unwrap().placement;
    assert_eq!(
        (p.spacing, p.directions[0]),
        ([2.0, 1.0, 1.0], [-1.0, 0.0, 0.0])
    );
    let p = meta("ElementSize : 1 2 3\r\n").unwrap().placement;
    assert_eq!((p.spacing, p.unit), ([1.0, 2.0, 3.0], Unit::Millimetre));
    let rotated = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 1 2 3\nElementSpacing = 1 2 3\n";
    let p = meta(rotated).unwrap().placement;
    assert_eq!(p.world([1.0, 1.0, 1.0]), [1.0 - 2.0, 2.0 + 1.0, 3.0 + 3.0]);
    // a scaled matrix keeps the world: the scale goes to the spacing
    let p = meta("Rotation = 2 0 0 0 1 0 0 0 1\n").unwrap().placement;
    assert_eq!((p.spacing[0], p.directions[0]), (2.0, [1.0, 0.0, 0.0]));
    let p = meta("ElementSpacing = 1 1 1\nDistanceUnits = um\n")
        .unwrap()
        .placement;
    assert_eq!(p.unit, Unit::Micrometre);
}

#[test]
fn metaimage_refuses() {
    for (fields, part) in [
        ("NDims = 2\n", "2 dimensions"),
        ("ElementNumberOfChannels = 3\n", "3 channels"),
        ("BinaryData = False\n", "stored as text"),
        ("ElementType = MET_LONG_LONG\n", "MET_LONG_LONG"),
        ("ElementType = float\n", "a type such as"),
        ("ObjectType = Tube\n", "Tube"),
        ("DimSize = 2 2\n", "3 numbers"),
        ("DimSize = 2 2 1\n", "2 to 65536"),
        ("DimSize = 2 2 9\n", "36 of samples"),
        ("TransformMatrix = 1 0 0 1 0 0 0 0 1\n", "one plane"),
        ("ElementSpacing = 0 1 1\n", "above 0"),
        ("Offset = nan 1 1\n", "finite"),
        ("HeaderSize = 3\n", "HeaderSize"),
        ("HeaderSize = -2\n", "HeaderSize"),
        ("CompressedData = maybe\n", "True or False"),
        ("CompressedData = True\n", "stream that is damaged"),
        (
            "BinaryDataByteOrderMSB = True\nElementByteOrderMSB = False\n",
            "one byte order",
        ),
    ] {
        let error = meta(fields).unwrap_err().to_string();
        assert!(error.contains(part), "{fields}{error}");
    }
}

#[test]
fn metaimage_counts_header_size_from_the_files_beginning() {
    let head = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nHeaderSize = 200\nElementDataFile = LOCAL\n";
    let mut bytes = head.as_bytes().to_vec();
    bytes.resize(200, b'x');
    let (_, samples) = read("v.mha", &[&bytes, &EIGHT]).unwrap();
    assert_eq!(samples, EIGHT);
}

#[test]
fn nrrd_placement() {
    assert_eq!(nrrd("").unwrap().placement, Placement::default());
    let p = nrrd("spacings: -2 1 1\n").unwrap().placement;
    assert_eq!(
        (p.spacing, p.directions[0]),
        ([2.0, 1.0, 1.0], [-1.0, 0.0, 0.0])
    );
    assert_eq!(
        nrrd("spacings: nan NaN nan\n").unwrap().placement,
        Placement::default()
    );
    // ITK turns RAS to LPS; this reader keeps the file's world
    let p =
        nrrd("space: RAS\nspace directions: (0,2,0) (1, 0, 0) (0,0,3)\nspace origin: (1,2,3)\n");
    let p = p.unwrap().placement;
    assert_eq!(
        (p.spacing, p.origin, p.unit),
        ([2.0, 1.0, 3.0], [1.0, 2.0, 3.0], Unit::Millimetre)
    );
    assert_eq!(p.world([1.0, 1.0, 1.0]), [2.0, 4.0, 6.0]);
    let p = nrrd("spacings: 1 1 1\nunits: \"um\" \"um\" \"um\"\n")
        .unwrap()
        .placement;
    assert_eq!(p.unit, Unit::Micrometre);
    let p = nrrd("Space Units: \"mm\" \"mm\" \"mm\"\nspace: left-posterior-superior\r\n");
    assert_eq!(p.unwrap().placement.unit, Unit::Millimetre);
    let p = nrrd("units: \"\" \"\" \"\"\nKinds: domain domain space\ncentering: cell\n");
    assert!(
        p.is_err(),
        "centering is no field of the format, centerings is"
    );
    assert!(nrrd("centerings: cell cell cell\nkinds: domain domain space\n").is_ok());
}

#[test]
fn nrrd_refuses() {
    for (fields, part) in [
        ("foo: 1\n", "a field of the NRRD format"),
        ("endain: big\n", "a field of the NRRD format"),
        ("type: uchar\n", "every field once"),
        ("no colon\n", "`field: value`"),
        ("encoding: bzip2\n", "bzip2"),
        ("encoding: hex\n", "hex"),
        ("encoding: ascii\n", "ascii"),
        ("encoding: zip\n", "raw or gzip"),
        ("encoding: gzip\n", "compressed stream that ends"),
        ("encoding: gzip\nbyte skip: -1\n", "byte skip"),
        ("endian: middle\n", "little or big"),
        ("line skip: -1\n", "line skip"),
        ("line skip: 99\n", "lines to skip"),
        ("byte skip: 1\n", "8 of samples"),
        ("byte skip: 9223372036854775807\n", "8 of samples"),
        ("byte skip: -9223372036854775808\n", "after them"),
        ("space directions: (1,0,0) (0,1,0) none\n", "outside space"),
        ("space directions: (1,0,0) (0,1,0)\n", "three vectors"),
        ("space directions: (1,0,0) (0,1,0) (1,1,0)\n", "one plane"),
        (
            "space directions: (1,0,0) (0,1,0) (0,0,inf)\n",
            "three vectors",
        ),
        ("space origin: (1,2)\n", "one vector"),
        ("spacings: 1 nan 1\n", "above 0"),
        ("spacings: 0 1 1\n", "above 0"),
        ("units: \"mm\" \"mm\" \"um\"\n", "same unit"),
        ("kinds: RGB-color domain domain\n", "components"),
        ("data file: gone.raw\n", "gone.raw"),
        ("data file: s.%d 1 3 1\n", "2 files"),
        ("data file: s.%d 1 2 0\n", "other than 0"),
        ("data file: s.%s 1 2 1\n", "one number"),
        ("data file: s.%d 1 2 1 4\n", "subdimension"),
        (
            "data file: s.%d -9223372036854775808 9223372036854775807 1 3\n",
            "divides",
        ),
        ("encoding: raw\ndata file: LIST\na\nb\nc\n", "2 files"),
    ] {
        let error = nrrd(fields).unwrap_err().to_string();
        assert!(error.contains(part), "{fields}{error}");
    }
    for (head, part) in [
        ("NRRD0009\n", "NRRD0001 to"),
        ("NRRD0004\ntype: uchar\n\n", "no field `dimension`"),
        ("NRRD0004\ntype: uchar\ndimension: 4\n\n", "4 dimensions"),
        (
            "NRRD0004\ntype: long long\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n",
            "long long",
        ),
        (
            "NRRD0004\ntype: block\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n",
            "block",
        ),
        (
            "NRRD0004\ntype: short\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n",
            "--endian",
        ),
        (
            "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n",
            "without an end",
        ),
    ] {
        let error = read("v.nrrd", &[head.as_bytes()]).unwrap_err().to_string();
        assert!(error.contains(part), "{head}{error}");
    }
}

#[test]
fn data_files_in_order() {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in [("s.0", &EIGHT[..4]), ("s.1", &EIGHT[4..])] {
        std::fs::write(dir.path().join(name), bytes).unwrap();
    }
    let swapped = [4, 5, 6, 7, 0, 1, 2, 3];
    let nhdr = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: ";
    let mhd = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = ";
    let absolute = format!("LIST\n{0}/s.0\n{0}/s.1\n", dir.path().display());
    for (head, file, expected) in [
        (nhdr, "s.%d 0 1 1", EIGHT),
        (nhdr, "s.%d 1 0 -1", swapped),
        (nhdr, "s.%d 0 1 1 3", EIGHT),
        (nhdr, "LIST 2\ns.1\ns.0\n", swapped),
        (nhdr, absolute.as_str(), EIGHT),
        (mhd, "s.%d 0 1 1", EIGHT),
        (mhd, "s.%d 0 1", EIGHT),
        (mhd, "s.%d 0", EIGHT),
        (mhd, "LIST\ns.1\ns.0\n", swapped),
        (mhd, "LIST 2D\ns.1\ns.0\n", swapped),
    ] {
        let path = dir.path().join("v");
        std::fs::write(&path, format!("{head}{file}")).unwrap();
        let opened = open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(all(&*opened.volume).unwrap(), expected, "{file}");
    }
    // a file per slice that is too long hides a header of its own
    std::fs::write(dir.path().join("s.1"), [0; 5]).unwrap();
    std::fs::write(dir.path().join("v"), format!("{nhdr}s.%d 0 1 1\n")).unwrap();
    let error = open(&dir.path().join("v"), &OpenOptions::default()).unwrap_err();
    assert!(
        matches!(&error, Error::Format { path, .. } if path.ends_with("s.1")),
        "{error}"
    );
}

#[test]
fn other_formats_are_named() {
    let error = read("v.dat", &[&b"# vtk DataFile Version 3.0\n"[..]]).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("legacy VTK"), "{error}");
    let error = read("v.dat", &[&b"\x89HDF\r\n\x1a\n"[..]]).unwrap_err();
    assert!(error.to_string().contains("HDF5"), "{error}");
    for name in ["v.nrrd", "v.nhdr", "v.MHA", "v.mhd"] {
        let error = read(name, &[b"\x1f\x8bnot that"]).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{error}");
    }
    assert!(read("v", &[]).is_err());
}

#[test]
fn gzip_and_skips() {
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: gz\nbyte skip: 3\n\n";
    let packed = gzip(&[b"abc", &EIGHT[..]].concat());
    assert_eq!(
        read("v.nrrd", &[head.as_bytes(), &packed]).unwrap().1,
        EIGHT
    );
    let short = gzip(b"ab");
    let error = read("v.nrrd", &[head.as_bytes(), &short])
        .unwrap_err()
        .to_string();
    assert!(error.contains("stream of 2 bytes"), "{error}");
}
