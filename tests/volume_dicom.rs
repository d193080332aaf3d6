//! What DICOM states of values and places: applied, or refused by name. The order of frames and their distance are
//! those that vtk-dicom and SimpleITK give the same files.

mod volume_common;
#[path = "volume_common/dicom.rs"]
mod writer;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, OpenOptions, Opened, open};
use alvis::{Error, Result};
use std::path::Path;
use volume_common::{all, floats, says, tiff_page};
use writer::Set;

const PIXELS: [u16; 6] = [0, 1, 2, 3, 4, 5];

/// The elements in front of the image's own: instance, series, number and place.
fn front(instance: &str, number: &str, place: Option<&str>, step: &[(u32, &str)]) -> Set {
    let mut set = Set::default()
        .text(0x0008_0018, "UI", instance)
        .text(0x0008_0060, "CS", "CT");
    for (tag, value) in step {
        set = set.text(*tag, "DS", value);
    }
    set = set
        .text(0x0020_000e, "UI", "1.2.3")
        .text(0x0020_0011, "IS", "7");
    set = set.text(0x0020_0013, "IS", number);
    match place {
        Some(place) => {
            set.text(0x0020_0032, "DS", place)
                .text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")
        }
        None => set,
    }
}

/// The image's own elements behind its size: pixels of 0.5 x 0.25 mm, stored in 16 bits.
fn back(rescale: Option<[&str; 2]>) -> Set {
    let set = Set::default()
        .text(0x0028_0030, "DS", "0.25\\0.5")
        .short(0x0028_0100, 16)
        .short(0x0028_0101, 16)
        .short(0x0028_0102, 15)
        .short(0x0028_0103, 0);
    match rescale {
        Some([intercept, slope]) => {
            set.text(0x0028_1052, "DS", intercept)
                .text(0x0028_1053, "DS", slope)
        }
        None => set,
    }
}

fn mapping(slope: f64, intercept: f64) -> Set {
    Set::default()
        .short(0x0040_9211, 65535)
        .short(0x0040_9216, 0)
        .double(0x0040_9224, intercept)
        .double(0x0040_9225, slope)
}

/// Writes slices at these heights, 2 mm apart, with the same elements behind.
fn slices(dir: &Path, behind: &[Set]) {
    for (k, behind) in behind.iter().enumerate() {
        let front = front(
            &format!("1.{k}"),
            &k.to_string(),
            Some(&format!("0\\0\\{}", 2 * k)),
            &[],
        );
        std::fs::write(
            dir.join(format!("I{k}")),
            Set::file(&front, &PIXELS, 1, behind),
        )
        .unwrap();
    }
}

/// A volume and the folder that its files are in, which are opened when they are read.
struct Kept {
    opened: Opened,
    _folder: tempfile::TempDir,
}

impl std::ops::Deref for Kept {
    type Target = Opened;

    fn deref(&self) -> &Opened {
        &self.opened
    }
}

impl std::fmt::Debug for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.opened.fmt(f)
    }
}

fn of(behind: &[Set]) -> Result<Kept> {
    let folder = tempfile::tempdir().unwrap();
    slices(folder.path(), behind);
    let opened = open(folder.path(), &OpenOptions::default())?;
    Ok(Kept {
        opened,
        _folder: folder,
    })
}

fn given() -> OpenOptions {
    OpenOptions {
        spacing: Some([0.5, 0.25, 3.0]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    }
}

#[test]
fn real_world_values_are_applied_where_the_rescale_is_none() {
    let one = back(Some(["0", "1"])).items(0x0040_9096, &[mapping(0.5, -3.0)]);
    let opened = of(&[one.clone(), one]).unwrap();
    let expected = [-3.0, -2.5, -2.0, -1.5, -1.0, -0.5];
    assert_eq!(floats(&opened), [expected, expected].concat());
    assert_eq!(
        opened.values.as_deref(),
        Some("0.5 * stored - 3 (RealWorldValueMapping)")
    );
    // a scale of its own for each slice
    let of_slice = |slope| back(None).items(0x0040_9096, &[mapping(slope, 0.0)]);
    let opened = of(&[of_slice(0.5), of_slice(0.25)]).unwrap();
    assert_eq!(floats(&opened)[5..8], [2.5, 0.0, 0.25]);
    assert!(opened.values.as_ref().unwrap().contains("each of 2 slices"));
    // the rescale goes first, and is told too
    let both = back(Some(["-1024", "1"])).items(0x0040_9096, &[mapping(0.5, -3.0)]);
    let opened = of(&[both.clone(), both]).unwrap();
    assert_eq!(opened.volume.header().dtype, Dtype::I32);
    assert!(says(&opened.notes, "RealWorldValueMapping is not applied"));
    assert!(
        opened
            .values
            .as_ref()
            .unwrap()
            .contains("1 * stored - 1024")
    );
    let part = back(None).items(
        0x0040_9096,
        &[Set::default()
            .short(0x0040_9211, 100)
            .short(0x0040_9216, 0)
            .double(0x0040_9224, 0.0)
            .double(0x0040_9225, 2.0)],
    );
    assert!(says(
        &of(&[part.clone(), part]).unwrap().notes,
        "a part of the stored numbers"
    ));
}

#[test]
fn real_world_values_in_groups_of_frames() {
    let place = |z: u32| Set::default().text(0x0020_0032, "DS", &format!("0\\0\\{z}"));
    let frame = |z, slope: f64| {
        Set::default()
            .items(0x0020_9113, &[place(z)])
            .items(0x0040_9096, &[mapping(slope, 1.0)])
    };
    let turn = Set::default().text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0");
    let behind = back(None)
        .items(0x5200_9229, &[Set::default().items(0x0020_9116, &[turn])])
        .items(0x5200_9230, &[frame(4, 0.5), frame(2, 0.25)]);
    let front = front("1.1", "1", None, &[]);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dcm");
    std::fs::write(
        &path,
        Set::file(&front, &[PIXELS, PIXELS].concat(), 2, &behind),
    )
    .unwrap();
    let opened = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(floats(&opened)[5..8], [2.25, 1.0, 1.5]);
    assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 2.0]);
}

#[test]
fn values_that_are_no_one_scale_are_refused_by_name() {
    let table = Set::default().double(0x0040_9212, 1.0);
    let several = [mapping(0.5, 0.0), mapping(0.5, 1.0)];
    for (behind, part) in [
        (back(None).items(0x0040_9096, &[table]), "a table of values"),
        (back(None).items(0x0040_9096, &several), "several scales"),
        (
            back(None).items(0x0028_3000, &[Set::default().short(0x0028_3002, 1)]),
            "Modality LUT",
        ),
    ] {
        let error = of(&[behind.clone(), behind]).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    let zero = back(None).items(0x0040_9096, &[mapping(0.0, 1.0)]);
    assert!(of(&[zero.clone(), zero]).is_err());
    let twice = back(None).items(0x0040_9096, &[mapping(0.5, 1.0), mapping(0.5, 1.0)]);
    assert_eq!(floats(&of(&[twice.clone(), twice]).unwrap())[2], 2.0);
}

/// A file of three frames; `place` and `step` stand at the top, `behind` with the image.
fn cone_beam(
    place: Option<&str>,
    step: &[(u32, &str)],
    behind: Set,
    options: &OpenOptions,
) -> Result<Kept> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dcm");
    let pixels: Vec<u16> = (0..18).collect();
    let bytes = Set::file(&front("1.1", "1", place, step), &pixels, 3, &behind);
    std::fs::write(&path, bytes).unwrap();
    let opened = open(&path, options)?;
    Ok(Kept {
        opened,
        _folder: folder,
    })
}

const BETWEEN: (u32, &str) = (0x0018_0088, "-0.3");
const THICK: (u32, &str) = (0x0018_0050, "0.4");

#[test]
fn frames_that_share_a_position_are_slices_in_order() {
    let none = OpenOptions::default();
    for place in [Some("-4\\-3\\2"), None] {
        for (step, z, from) in [
            (&[THICK, BETWEEN][..], 0.3, Origin::File),
            (&[THICK], 0.4, Origin::Assumed),
        ] {
            let opened = cone_beam(place, step, back(None), &none).unwrap();
            let header = opened.volume.header();
            assert_eq!(header.dims.0, [3, 2, 3]);
            let spacing = header.placement.spacing;
            assert_eq!(spacing, [0.5, 0.25, z]);
            let origin = place.map_or([0.0; 3], |_| [-4.0, -3.0, 2.0]);
            assert_eq!(header.placement.origin, origin);
            assert_eq!(opened.provenance.spacing[2], from);
            assert_eq!(says(&opened.warnings, "thickness"), from == Origin::Assumed);
            let words = all(&*opened.volume).unwrap();
            let words = words
                .as_chunks::<2>()
                .0
                .iter()
                .map(|w| u16::from_ne_bytes(*w));
            assert!(words.eq(0..18));
            // what the user says goes, without a warning
            let opened = cone_beam(place, step, back(None), &given()).unwrap();
            assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 3.0]);
            assert_eq!(opened.warnings, [""; 0]);
        }
        let error = cone_beam(place, &[], back(None), &none)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("--spacing") && !error.contains("at one place"),
            "{error}"
        );
        let opened = cone_beam(place, &[], back(None), &given()).unwrap();
        assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 3.0]);
    }
}

#[test]
fn a_dose_lies_at_its_offsets_and_is_scaled() {
    let behind = back(None)
        .text(0x3004_000c, "DS", "0\\2.5\\5")
        .text(0x3004_000e, "DS", "0.001");
    let opened = cone_beam(Some("1\\2\\3"), &[THICK], behind, &OpenOptions::default()).unwrap();
    let place = opened.volume.header().placement;
    assert_eq!(
        (place.spacing, place.origin),
        ([0.5, 0.25, 2.5], [1.0, 2.0, 3.0])
    );
    assert_eq!(opened.warnings, [""; 0]);
    assert_eq!(
        opened.values.as_deref(),
        Some("0.001 * stored + 0 (DoseGridScaling)")
    );
    let short = back(None).text(0x3004_000c, "DS", "0\\2.5");
    assert!(cone_beam(Some("1\\2\\3"), &[], short, &OpenOptions::default()).is_err());
}

#[test]
fn files_without_positions_are_in_the_order_of_their_numbers_on_demand() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, number: &str, place: Option<&str>, value: u16| {
        let front = front(&format!("1.{name}"), number, place, &[]);
        std::fs::write(
            dir.path().join(name),
            Set::file(&front, &[value; 6], 1, &back(None)),
        )
        .unwrap();
    };
    let read = |options: &OpenOptions| open(dir.path(), options);
    for place in [None, Some("0\\0\\0")] {
        // names run the other way
        for (name, number) in [("a", "12"), ("b", "11"), ("c", "10")] {
            write(name, number, place, number.parse().unwrap());
        }
        let error = read(&OpenOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("InstanceNumber") && error.contains("--spacing"),
            "{error}"
        );
        let opened = read(&given()).unwrap();
        let bytes = all(&*opened.volume).unwrap();
        assert_eq!([bytes[0], bytes[12], bytes[24]], [10, 11, 12]);
        assert!(says(&opened.warnings, "InstanceNumber"));
        assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 3.0]);
        // numbers that count nothing
        write("c", "11", place, 9);
        assert!(read(&given()).is_err());
        write("c", "9", place, 9);
        assert!(read(&given()).is_err());
    }
}

#[test]
fn a_slice_that_comes_twice_is_told_by_its_pixels() {
    let dir = tempfile::tempdir().unwrap();
    slices(dir.path(), &[back(None), back(None), back(None)]);
    let again = |pixels: &[u16]| {
        let front = front("1.99", "9", Some("0\\0\\2"), &[]);
        std::fs::write(
            dir.path().join("J"),
            Set::file(&front, pixels, 1, &back(None)),
        )
        .unwrap();
    };
    again(&PIXELS);
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().dims.0, [3, 2, 3]);
    assert!(
        says(&opened.notes, "each place counts once"),
        "{:?}",
        opened.notes
    );
    again(&[9; 6]);
    let error = open(dir.path(), &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("I1") && error.contains("/J"), "{error}");
}

#[test]
fn series_in_folders_beside_a_file_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("S1");
    std::fs::create_dir(&deep).unwrap();
    slices(&deep, &[back(None), back(None)]);
    // beside the folder a slice of the same series, at the place of another and of other pixels
    let beside = Set::file(
        &front("1.50", "1", Some("0\\0\\0"), &[]),
        &[9; 6],
        1,
        &back(None),
    );
    let other = back(None);
    let beside_path = dir.path().join("beside");
    std::fs::write(&beside_path, &beside).unwrap();
    let error = open(dir.path(), &OpenOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("at one place"),
        "one series: {error}"
    );
    // another series above: both are listed
    std::fs::remove_file(&beside_path).unwrap();
    for k in 0..2 {
        let front = front(&format!("2.{k}"), "1", Some(&format!("0\\0\\{k}")), &[]);
        let mut bytes = Set::file(&front, &PIXELS, 1, &other);
        let at = bytes.windows(6).position(|w| w == b"1.2.3\0").unwrap();
        bytes[at + 4] = b'4';
        std::fs::write(dir.path().join(format!("J{k}")), bytes).unwrap();
    }
    let error = open(dir.path(), &OpenOptions::default()).unwrap_err();
    assert!(
        matches!(&error, Error::Usage { option, .. } if option == "--series"),
        "{error}"
    );
    // a picture beside the folders is a preview
    for k in 0..2 {
        std::fs::remove_file(dir.path().join(format!("J{k}"))).unwrap();
    }
    let png = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/png8/s8.png");
    std::fs::copy(png, dir.path().join("preview.png")).unwrap();
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().dims.0, [3, 2, 2]);
}

/// Slices of one series, one of them with other elements in front and behind.
fn with_another(name: &str, other: &Set, behind: &Set) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    slices(dir.path(), &[back(None), back(None), back(None)]);
    std::fs::write(dir.path().join(name), Set::file(other, &PIXELS, 1, behind)).unwrap();
    dir
}

/// The elements behind the size of an image with these pixels and bits.
fn behind(spacing: &str, stored: u16, signed: u16) -> Set {
    Set::default()
        .text(0x0028_0030, "DS", spacing)
        .short(0x0028_0100, 16)
        .short(0x0028_0101, stored)
        .short(0x0028_0102, stored - 1)
        .short(0x0028_0103, signed)
}

#[test]
fn a_slice_that_differs_is_refused_by_name() {
    for (spacing, stored, signed, tag, found, expected) in [
        ("0.25\\0.6", 16, 0, "PixelSpacing", "0.25\\0.6", "0.25\\0.5"),
        ("0.25\\0.5", 12, 0, "BitsStored", "12", "16"),
        ("0.25\\0.5", 16, 1, "PixelRepresentation", "1", "0"),
    ] {
        let front = front("1.9", "9", Some("0\\0\\6"), &[]);
        let dir = with_another("I9", &front, &behind(spacing, stored, signed));
        let error = open(dir.path(), &OpenOptions::default())
            .unwrap_err()
            .to_string();
        for word in ["I9", tag, found, expected, "--series 7.1"] {
            assert!(error.contains(word), "{error}");
        }
        let options = OpenOptions {
            series: Some("7.1".into()),
            ..OpenOptions::default()
        };
        let opened = open(dir.path(), &options).unwrap();
        assert_eq!(opened.volume.header().dims.0, [3, 2, 3]);
        assert!(says(&opened.notes, "1 other image is left out"));
    }
    // one without a place
    let dir = with_another("I9", &front("1.9", "9", None, &[]), &back(None));
    let error = open(dir.path(), &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("I9") && error.contains("ImagePositionPatient"),
        "{error}"
    );
}

#[test]
fn a_slice_that_looks_another_way_is_left_out_with_a_note() {
    let scout = Set::default()
        .text(0x0008_0018, "UI", "1.9")
        .text(0x0008_0060, "CS", "CT")
        .text(0x0020_000e, "UI", "1.2.3")
        .text(0x0020_0011, "IS", "7")
        .text(0x0020_0032, "DS", "0\\0\\0")
        .text(0x0020_0037, "DS", "1\\0\\0\\0\\0\\-1");
    let dir = with_another("scout", &scout, &back(None));
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert!(
        says(&opened.notes, "1 other image is left out")
            && says(
                &opened.notes,
                "scout (ImageOrientationPatient 1\\0\\0\\0\\0\\-1"
            ),
        "{:?}",
        opened.notes
    );
}

#[test]
fn slices_that_state_their_values_in_other_elements_are_refused() {
    let scaled = || back(Some(["-1024", "1"]));
    let unit = |unit: &str| scaled().text(0x0028_1054, "LO", unit);
    let slope_alone = back(None).text(0x0028_1053, "DS", "1");
    let mapped = back(None).items(0x0040_9096, &[mapping(2.0, 0.0)]);
    for (others, odd, tag) in [
        (scaled(), back(None), "RescaleSlope not stated"),
        (scaled(), slope_alone, "RescaleIntercept not stated"),
        (back(None), scaled(), "RescaleSlope stated"),
        (mapped, back(None), "RealWorldValueMapping not stated"),
        (unit("HU"), unit("US"), "RescaleType US"),
    ] {
        let error = of(&[others.clone(), odd, others]).unwrap_err().to_string();
        assert!(error.contains("I1") && error.contains(tag), "{error}");
    }
    // numbers of one kind may differ from slice to slice
    let opened = of(&[scaled(), back(Some(["-1024", "2"])), scaled()]).unwrap();
    assert!(opened.values.as_ref().unwrap().contains("each of 3 slices"));
}

/// Slices in files of a name with an extension, and what opening their folder says of one that is no slice.
fn with_damage(damage: impl FnOnce(&Path)) -> Result<Kept> {
    let folder = tempfile::tempdir().unwrap();
    slices(folder.path(), &[back(None), back(None), back(None)]);
    for k in 0..3 {
        let to = folder.path().join(format!("s{k}.dcm"));
        std::fs::rename(folder.path().join(format!("I{k}")), to).unwrap();
    }
    damage(folder.path());
    let opened = open(folder.path(), &OpenOptions::default())?;
    Ok(Kept {
        opened,
        _folder: folder,
    })
}

#[test]
fn a_slice_cut_anywhere_is_named_wherever_it_lies() {
    let whole = with_damage(|_| {}).unwrap();
    assert_eq!(whole.volume.header().dims.0, [3, 2, 3]);
    let bytes = Set::file(
        &front("1.2", "2", Some("0\\0\\4"), &[]),
        &PIXELS,
        1,
        &back(None),
    );
    for which in 0..3 {
        for len in 0..bytes.len() {
            let name = format!("s{which}.dcm");
            let cut = |dir: &Path| {
                let own = std::fs::read(dir.join(&name)).unwrap();
                std::fs::write(dir.join(&name), &own[..len]).unwrap();
            };
            let error = with_damage(cut).unwrap_err().to_string();
            assert!(
                error.contains(&name) && error.contains("cut short"),
                "{len}: {error}"
            );
        }
    }
}

#[cfg(unix)]
#[test]
fn a_slice_that_is_no_file_is_named() {
    let gone = |dir: &Path| dir.join("s2.dcm");
    let link = |dir: &Path| {
        std::fs::remove_file(gone(dir)).unwrap();
        std::os::unix::fs::symlink("nowhere", gone(dir)).unwrap();
    };
    let error = with_damage(link).unwrap_err().to_string();
    assert!(
        error.contains("s2.dcm") && error.contains("leads nowhere"),
        "{error}"
    );
    let folder = |dir: &Path| {
        std::fs::remove_file(gone(dir)).unwrap();
        std::fs::create_dir(gone(dir)).unwrap();
    };
    let error = with_damage(folder).unwrap_err().to_string();
    assert!(
        error.contains("s2.dcm") && error.contains("a folder"),
        "{error}"
    );
    // what is plainly something else is a note, and what is named otherwise no slice
    let volume = |dir: &Path| {
        std::fs::write(dir.join("s9.dcm"), b"NRRD0004\n").unwrap();
        std::fs::write(dir.join("DICOMDIR"), b"").unwrap();
        std::fs::write(dir.join("notes.txt"), b"of the scan").unwrap();
    };
    let opened = with_damage(volume).unwrap();
    assert_eq!(opened.volume.header().dims.0, [3, 2, 3]);
    assert!(says(&opened.notes, "s9.dcm"), "{:?}", opened.notes);
    assert!(!says(&opened.notes, "notes.txt"), "{:?}", opened.notes);
}

#[test]
fn a_report_beside_slices_is_a_note_and_a_copy_is_named() {
    let report = |dir: &Path| {
        let set = Set::default().text(0x0002_0010, "UI", "1.2.840.10008.1.2.1");
        let set = set.text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.88.11");
        let bytes = [&[0; 128][..], b"DICM", set.bytes()].concat();
        std::fs::write(dir.join("report.dcm"), bytes).unwrap();
        std::fs::copy(dir.join("s1.dcm"), dir.join("copy.dcm")).unwrap();
    };
    let opened = with_damage(report).unwrap();
    assert!(says(&opened.notes, "report.dcm"), "{:?}", opened.notes);
    let note = opened.notes.iter().find(|n| n.contains("twice")).unwrap();
    assert!(
        note.contains("1 file comes") && note.contains("copy.dcm") && note.contains("s1.dcm"),
        "{note}"
    );
}

#[test]
fn frames_at_one_place_are_read_as_stored_on_demand() {
    let place = Set::default().items(
        0x0020_9113,
        &[Set::default().text(0x0020_0032, "DS", "-4\\-3\\2")],
    );
    let groups = vec![place; 3];
    let axes = Set::default().items(
        0x0020_9116,
        &[Set::default().text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")],
    );
    let behind = back(None)
        .items(0x5200_9229, &[axes])
        .items(0x5200_9230, &groups);
    for step in [&[][..], &[THICK], &[BETWEEN]] {
        let error = cone_beam(None, step, behind.clone(), &OpenOptions::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("at one place") && error.contains("--spacing X,Y,Z"),
            "{error}"
        );
        let opened = cone_beam(None, step, behind.clone(), &given()).unwrap();
        let header = opened.volume.header();
        assert_eq!(header.dims.0, [3, 2, 3]);
        assert_eq!(header.placement.spacing, [0.5, 0.25, 3.0]);
        assert_eq!(header.placement.origin, [-4.0, -3.0, 2.0]);
        assert!(
            says(&opened.warnings, "order in which they are stored"),
            "{:?}",
            opened.warnings
        );
        let words = all(&*opened.volume).unwrap();
        let words = words.as_chunks::<2>().0.iter();
        assert!(words.map(|w| u16::from_ne_bytes(*w)).eq(0..18));
    }
}

#[test]
fn a_film_is_no_volume_unless_the_user_says_so() {
    let film = |place| {
        let set = Set::default().pointer(0x0028_0009, 0x0018_1063);
        cone_beam(
            place,
            &[BETWEEN],
            set.with(&back(None)),
            &OpenOptions::default(),
        )
    };
    for place in [None, Some("0\\0\\0")] {
        let error = film(place).unwrap_err().to_string();
        assert!(
            error.contains("FrameTime") && error.contains("--spacing"),
            "{error}"
        );
        let set = Set::default().pointer(0x0028_0009, 0x0018_1063);
        let opened = cone_beam(place, &[BETWEEN], set.with(&back(None)), &given()).unwrap();
        assert!(says(&opened.warnings, "FrameTime"), "{:?}", opened.warnings);
    }
    // a pointer to places is none to times
    let set = Set::default().pointer(0x0028_0009, 0x0020_9057);
    let opened = cone_beam(
        None,
        &[BETWEEN],
        set.with(&back(None)),
        &OpenOptions::default(),
    );
    assert_eq!(opened.unwrap().warnings, [""; 0]);
}

#[test]
fn series_in_folders_beside_one_page_of_tiff_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("S1");
    std::fs::create_dir(&deep).unwrap();
    slices(&deep, &[back(None), back(None)]);
    std::fs::write(dir.path().join("x.tif"), tiff_page([1; 6])).unwrap();
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().dims.0, [3, 2, 2]);
}
