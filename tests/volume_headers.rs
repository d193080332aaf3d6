//! What headers mean, and which are refused. Expected placements and samples are those that
//! SimpleITK 2 reads from the same bytes, unless a comment says otherwise.

mod volume_common;

use alvis::grid::{Origin, Placement, Unit};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, Header, OpenOptions, open, statistics};
use alvis::{Error, Result};
use volume_common::{all, floats, gzip, open_as, opened, says};

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
        (
            "TransformMatrix = 1 0 0 0 1 0 0 0.3 0.9539392\n",
            "a sheared grid",
        ),
        ("ElementToIntensityFunctionSlope = 0\n", "other than 0"),
        ("ElementToIntensityFunctionOffset = nan\n", "finite"),
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
    let units = "Space Units: \"mm\" \"mm\" \"mm\"\nspace: left-posterior-superior\r\n";
    let p = nrrd(&format!("spacings: 1 1 1\n{units}"));
    assert_eq!(p.unwrap().placement.unit, Unit::Millimetre);
    // a unit without a size says nothing of voxels
    assert_eq!(nrrd(units).unwrap().placement, Placement::default());
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
        ("spacings: 0 1 1\n", "above 0"),
        (
            "spacings: 1 1 1\nunits: \"mm\" \"mm\"\n",
            "a unit for each axis",
        ),
        ("labels: \"z\" \"y\" \"x\"\n", "call its axes z, y, x"),
        (
            "space directions: (1,0,0) (0,1,0) (0,0.3,1)\n",
            "a sheared grid",
        ),
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

#[test]
fn nrrd_units_are_those_of_each_axis() {
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n";
    let with = |fields: &str| {
        opened(
            "v.nrrd",
            &[head.as_bytes(), fields.as_bytes(), b"\n", &EIGHT],
        )
    };
    let mixed = with(
        "space dimension: 3\nspace directions: (0.05,0,0) (0,70,0) (0,0,0.1)\n\
         space units: \"mm\" \"um\" \"mm\"\nspace origin: (1,2000,3)\n",
    );
    let place = mixed.volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([0.05, 0.07, 0.1], Unit::Millimetre)
    );
    assert_eq!(
        (place.origin, mixed.provenance.unit),
        ([1.0, 2.0, 3.0], Origin::File)
    );
    let mixed = with("spacings: 4 4 0.03\nunits: \"nm\" \"nm\" \"um\"\n");
    let place = mixed.volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([4.0, 4.0, 30.0], Unit::Nanometre)
    );
    let partly = with("spacings: 2 2 nan\nunits: \"mm\" \"mm\" \"mm\"\n");
    assert_eq!(partly.volume.header().placement.spacing, [2.0; 3]);
    assert_eq!(partly.provenance.spacing[2], Origin::Assumed);
    assert!(says(&partly.warnings, "--spacing"));
    for fields in [
        "spacings: 1 nan 1\n",
        "spacings: 1 1 1\nunits: \"furlong\" \"furlong\" \"furlong\"\n",
        "space directions: (9,0,0) (0,9,0) (0,0,9)\nspace units: \"mm\" \"mm\" \"furlong\"\n",
        "axis mins: 0 0 0\naxis maxs: 9 9 9\n",
    ] {
        let unclear = with(fields);
        assert_eq!(
            unclear.volume.header().placement.spacing,
            [1.0; 3],
            "{fields}"
        );
        assert_eq!(unclear.provenance.spacing, [Origin::Default; 3], "{fields}");
        assert!(says(&unclear.warnings, "--spacing"), "{fields}");
    }
}

#[test]
fn nrrd_says_what_it_does_not_apply_or_turns_round() {
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n";
    let with = |fields: &str| {
        opened(
            "v.nrrd",
            &[head.as_bytes(), fields.as_bytes(), b"\n", &EIGHT],
        )
    };
    assert!(says(
        &with("old min: -5\nold max: 5\n").warnings,
        "quantized from values of -5 to 5"
    ));
    assert!(says(&with("kinds: domain domain time\n").warnings, "time"));
    let left = "space directions: (2,0,0) (0,1,0) (0,0,1)\nspace origin: (1,2,3)\n";
    for space in ["LAS", "3D-left-handed"] {
        let opened = with(&format!("space: {space}\n{left}"));
        let place = opened.volume.header().placement;
        assert_eq!(place.directions[0], [-1.0, 0.0, 0.0]);
        assert_eq!(
            (place.spacing, place.origin),
            ([2.0, 1.0, 1.0], [-1.0, 2.0, 3.0])
        );
        assert!(says(&opened.notes, "left-handed"));
    }
}

#[test]
fn axes_of_one_entry_are_left_out() {
    for (sizes, fields) in [
        (
            "2 2 2 1",
            "space directions: (1,0,0) (0,2,0) (0,0,3) none\nkinds: space space space list\n",
        ),
        (
            "1 2 2 2",
            "space directions: none (1,0,0) (0,2,0) (0,0,3)\nkinds: vector space space space\n",
        ),
        // as ITK writes four axes
        (
            "1 2 2 2",
            "space dimension: 4\nspace directions: (9,0,0,0) (0,1,0,0) (0,0,2,0) (0,0,0,3)\nspace origin: (7,0,0,0)\n",
        ),
        (
            "1 2 2 2",
            "spacings: nan 1 2 3\nlabels: \"c\" \"x\" \"y\" \"z\"\n",
        ),
    ] {
        let head = format!("NRRD0004\ntype: uchar\ndimension: 4\nsizes: {sizes}\nencoding: raw\n");
        let opened = opened(
            "v.nrrd",
            &[head.as_bytes(), fields.as_bytes(), b"\n", &EIGHT],
        );
        assert_eq!(
            opened.volume.header().placement.spacing,
            [1.0, 2.0, 3.0],
            "{fields}"
        );
        assert_eq!(all(&*opened.volume).unwrap(), EIGHT);
    }
    for (size, matrix, spacing, offset) in [
        (
            "2 2 2 1",
            "1 0 0 0 0 -1 0 0 0 0 1 0 0 0 0 1",
            "1 2 3 9",
            "4 5 6 7",
        ),
        (
            "1 2 2 2",
            "1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1",
            "9 1 2 3",
            "7 4 5 6",
        ),
    ] {
        let head = format!(
            "NDims = 4\nDimSize = {size}\nElementType = MET_UCHAR\nTransformMatrix = {matrix}\nOffset = \
             {offset}\nElementSpacing = {spacing}\nElementDataFile = LOCAL\n"
        );
        let place = opened("v.mha", &[head.as_bytes(), &EIGHT])
            .volume
            .header()
            .placement;
        assert_eq!(
            (place.spacing, place.origin),
            ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]),
            "{size}"
        );
        assert_eq!(place.directions[1], [0.0, -1.0, 0.0], "{size}");
    }
    for shape in ["1, 2, 2, 2", "2, 2, 2, 1", "1, 2, 1, 2, 2"] {
        let opened = opened("v.npy", &[&npy(shape, false), &EIGHT]);
        assert_eq!(opened.volume.header().dims.0, [2; 3], "{shape}");
        assert_eq!(all(&*opened.volume).unwrap(), EIGHT);
    }
    let several = open_as("v.npy", &npy("2, 2, 2, 3", false), &OpenOptions::default());
    assert!(several.unwrap_err().to_string().contains("array[..., 0]"));
}

fn npy(shape: &str, fortran: bool) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let dict = format!("{{'descr': '|u1', 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    let head = [b"\x93NUMPY\x01\0", &(dict.len() as u16).to_le_bytes()[..]].concat();
    [head, dict.into_bytes()].concat()
}

#[test]
fn fortran_order_is_read_as_numpy_indexes_it() {
    // entry [z, y, x] of what counts up in the order of the file is z + 2 y + 4 x
    let bytes = [npy("2, 2, 2", true), (0..8).collect()].concat();
    let found = opened("v.npy", &[&bytes]);
    assert_eq!(all(&*found.volume).unwrap(), [0, 4, 2, 6, 1, 5, 3, 7]);
    assert!(says(&found.warnings, "if it is indexed [x, y, z]"));
}

#[test]
fn metaimage_intensities_and_units() {
    let head = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
    let with = |fields: &str| {
        opened(
            "v.mha",
            &[
                head.as_bytes(),
                fields.as_bytes(),
                b"ElementDataFile = LOCAL\n",
                &EIGHT,
            ],
        )
    };
    let scaled =
        with("ElementToIntensityFunctionSlope = 0.5\nElementToIntensityFunctionOffset = -3\n");
    assert_eq!(
        floats(&scaled),
        [-3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5]
    );
    assert!(scaled.values.unwrap().starts_with("0.5 * stored - 3"));
    let plain = with("ElementToIntensityFunctionSlope = 1\nElementMin = 3\nElementMax = 4\n");
    assert_eq!(
        (plain.values, plain.volume.header().dtype),
        (None, Dtype::U8)
    );
    let inch = with("ElementSpacing = 1 1 2\nOffset = 1 0 0\nDistanceUnits = inch\n");
    let place = inch.volume.header().placement;
    assert_eq!((place.spacing, place.origin[0]), ([25.4, 25.4, 50.8], 25.4));
    for unknown in ["?", ""] {
        let opened = with(&format!(
            "ElementSpacing = 1 1 2\nDistanceUnits = {unknown}\n"
        ));
        assert_eq!(opened.volume.header().placement.unit, Unit::Millimetre);
        assert_eq!(opened.provenance.unit, Origin::Default);
    }
    let furlong = with("ElementSpacing = 1 1 2\nDistanceUnits = furlong\n");
    assert_eq!(furlong.volume.header().placement.spacing, [1.0; 3]);
    assert!(says(&furlong.warnings, "furlong"));
    let flat = with("ElementSpacing = 0.5 0.25\n");
    assert_eq!(flat.volume.header().placement.spacing, [0.5, 0.25, 0.5]);
    assert_eq!(flat.provenance.spacing[2], Origin::Assumed);
    assert!(says(&flat.warnings, "--spacing"));
}

#[test]
fn sheared_axes_of_text_headers_are_resampled() {
    let options = OpenOptions {
        resample: true,
        ..OpenOptions::default()
    };
    let nrrd = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\
                space directions: (1,0,0) (0,1,0) (0,1,2)\n\n";
    let meta = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementSpacing = 1 1 1\n\
                TransformMatrix = 1 0 0 0 1 0 0 1 2\nElementDataFile = LOCAL\n";
    for (name, head) in [("v.nrrd", nrrd), ("v.mha", meta)] {
        let bytes = [head.as_bytes(), &EIGHT].concat();
        let opened = open_as(name, &bytes, &options).unwrap();
        let place = opened.volume.header().placement;
        assert!((place.spacing[2] - 2.0).abs() < 1e-12, "{place:?}");
        assert_eq!(place.spacing[..2], [1.0, 1.0]);
        let expected = [0, 1, 2, 3, 0, 0, 0, 0, 4, 5, 6, 7];
        assert_eq!(all(&*opened.volume).unwrap(), expected, "{name}");
        // the zeros that fill the grid up do not count
        let found = statistics(&*opened.volume, None, &Quiet).unwrap();
        assert_eq!((found.voxels, found.otsu), (8, Some(3.5)));
        assert!(says(&opened.notes, "leave out"), "{:?}", opened.notes);
    }
}

#[test]
fn a_spacing_that_cannot_be_is_told_as_the_file_has_it() {
    let error = meta("ElementSpacing = .1 .1 0\n").unwrap_err().to_string();
    assert!(error.contains("[0.1, 0.1, 0.0]"), "{error}");
}

#[test]
fn lists_are_no_volumes_and_scales_of_no_meaning_are_told() {
    let error = nrrd("kinds: list domain domain\n").unwrap_err().to_string();
    assert!(error.contains("components"), "{error}");
    let dir = tempfile::tempdir().unwrap();
    let warnings = |name: &str, head: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, [head.as_bytes(), &EIGHT].concat()).unwrap();
        open(&path, &OpenOptions::default()).unwrap().warnings
    };
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n";
    let meta = "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
    let nrrd = |keys: &str| warnings("v.nrrd", &format!("{head}{keys}\n"));
    let meta = |keys: &str| warnings("v.mha", &format!("{meta}{keys}ElementDataFile = LOCAL\n"));
    let told = nrrd("RescaleSlope:=2\nRescaleIntercept:=-1024\n");
    assert!(
        says(&told, "RescaleSlope 2") && says(&told, "not applied"),
        "{told:?}"
    );
    let told = meta("RescaleSlope = 2\n");
    assert!(says(&told, "not applied"), "{told:?}");
    for none in [
        nrrd("RescaleSlope:=1\nRescaleIntercept:=0\nnote:=2\n"),
        meta("RescaleSlope = 1\n"),
        meta("ElementToIntensityFunctionSlope = 2\n"),
    ] {
        assert!(!says(&none, "not applied"), "{none:?}");
    }
}

#[test]
fn one_slice_and_axes_that_point_back_are_told_plainly() {
    let flat = "NDims = 3\nDimSize = 2 2 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let error = read("v.mha", &[flat.as_bytes(), &EIGHT])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("`DimSize` of 2 x 2 x 1") && error.matches("expected").count() == 1,
        "{error}"
    );
    let flat = "NDims = 2\nDimSize = 4 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let error = read("v.mha", &[flat.as_bytes(), &EIGHT])
        .unwrap_err()
        .to_string();
    assert!(error.contains("2 dimensions (4 x 2)"), "{error}");
    let back = "TransformMatrix = -1 -0 -0 -0 -1 -0 -0 -0 1\nElementSpacing = 1 1 -1\n";
    let axes = meta(back).unwrap().placement.directions;
    assert!(
        axes.as_flattened()
            .iter()
            .all(|v| *v != 0.0 || v.is_sign_positive()),
        "{axes:?}"
    );
}
