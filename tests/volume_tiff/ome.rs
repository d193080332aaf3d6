//! OME-TIFF.

use super::writer::{Page, described};
use super::{asking, plain, put, read, refusal, slices};
use alvis::grid::{Origin, Unit};
use alvis::volume::{OpenOptions, open};

const HEAD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- <Pixels SizeZ=\"9\"/> -->";

fn image(id: u32, order: &str, zct: [u32; 3], more: &str, data: &str) -> String {
    let [z, c, t] = zct;
    format!(
        "<Image ID=\"Image:{id}\" Name=\"scan {id}\"><Pixels ID=\"Pixels:{id}\" DimensionOrder=\"{order}\" \
         Type=\"uint16\" SizeX=\"4\" SizeY=\"3\" SizeZ=\"{z}\" SizeC=\"{c}\" SizeT=\"{t}\" {more}>{data}</Pixels></Image>"
    )
}

fn document(inside: &str) -> String {
    format!(
        "{HEAD}<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" UUID=\"urn:uuid:1\">{inside}<Note>\
         <![CDATA[<Pixels SizeZ=\"8\"]]></Note></OME>"
    )
}

fn stack(count: u32, inside: &str) -> Vec<Page> {
    described(0..count, &document(inside))
}

#[test]
fn planes_are_where_the_metadata_say() {
    let all = "<TiffData/>";
    let opened = plain(&stack(6, &image(0, "XYZCT", [6, 1, 1], "", all))).unwrap();
    assert_eq!(slices(&opened), [0, 1, 2, 3, 4, 5]);
    assert_eq!(opened.provenance.spacing, [Origin::Default; 3]);
    for (order, zct, channel, time, expected) in [
        ("XYZCT", [3, 2, 2], Some(1), Some(1), [9, 10, 11]),
        ("XYCZT", [3, 2, 2], Some(1), Some(1), [7, 9, 11]),
        ("XYTCZ", [3, 2, 2], Some(1), Some(0), [2, 6, 10]),
    ] {
        let pages = stack(12, &image(0, order, zct, "", all));
        let opened = read(&pages, &asking(None, channel, time)).unwrap();
        assert_eq!(slices(&opened), expected, "{order}");
        assert!(refusal(plain(&pages)).contains("2 channels"));
    }
    let data = |of: &dyn Fn(u32) -> u32| {
        let one = |z: u32| format!("<TiffData IFD=\"{}\" FirstZ=\"{z}\"/>", of(z));
        (0..6).map(one).collect::<String>()
    };
    let backward = image(0, "XYZCT", [6, 1, 1], "", &data(&|z| 5 - z));
    assert_eq!(
        slices(&plain(&stack(6, &backward)).unwrap()),
        [5, 4, 3, 2, 1, 0]
    );
    let parts =
        "<TiffData IFD=\"3\" PlaneCount=\"3\"/><TiffData IFD=\"0\" FirstZ=\"3\" PlaneCount=\"3\"/>";
    let parts = image(0, "XYZCT", [6, 1, 1], "", parts);
    assert_eq!(
        slices(&plain(&stack(6, &parts)).unwrap()),
        [3, 4, 5, 0, 1, 2]
    );
    let more = plain(&stack(7, &parts)).unwrap();
    assert_eq!(slices(&more), [3, 4, 5, 0, 1, 2]);
    assert!(more.notes[0].contains("of the 7 pages"), "{more:?}");
    let movie = plain(&stack(6, &image(0, "XYZCT", [1, 1, 6], "", all))).unwrap();
    assert_eq!(slices(&movie).len(), 6);
    assert!(movie.notes[0].contains("6 times"), "{movie:?}");
}

#[test]
fn images_are_chosen_by_number_name_or_id() {
    let inside = image(
        0,
        "XYZCT",
        [3, 1, 1],
        "",
        "<TiffData IFD=\"0\" PlaneCount=\"3\"/>",
    ) + &image(
        1,
        "XYZCT",
        [3, 1, 1],
        "",
        "<TiffData IFD=\"3\" PlaneCount=\"3\"/>",
    );
    let pages = stack(6, &inside);
    let error = refusal(plain(&pages));
    assert!(
        error.contains("2 series") && error.contains("1: 4 x 3 x 3, scan 1, Image:1"),
        "{error}"
    );
    for name in ["1", "scan 1", "Image:1"] {
        assert_eq!(
            slices(&read(&pages, &asking(Some(name), None, None)).unwrap()),
            [3, 4, 5]
        );
    }
    assert!(read(&pages, &asking(Some("scan 2"), None, None)).is_err());
}

#[test]
fn metadata_that_do_not_fit_are_refused() {
    let all = "<TiffData/>";
    for (pages, inside, says) in [
        (5, image(0, "XYZCT", [6, 1, 1], "", all), "5 pages"),
        (7, image(0, "XYZCT", [6, 1, 1], "", all), "7 pages"),
        (
            6,
            image(
                0,
                "XYZCT",
                [6, 1, 1],
                "",
                "<TiffData IFD=\"1\" PlaneCount=\"6\"/>",
            ),
            "a page 6",
        ),
        (
            6,
            image(
                0,
                "XYZCT",
                [6, 1, 1],
                "",
                "<TiffData IFD=\"0\" PlaneCount=\"4\"/>",
            ),
            "without a page for 2",
        ),
        (
            6,
            image(
                0,
                "XYZCT",
                [6, 1, 1],
                "",
                "<TiffData IFD=\"0\"/><TiffData IFD=\"1\"/>",
            ),
            "two pages for slice 0",
        ),
        (
            6,
            image(0, "XYZCT", [6, 1, 1], "", ""),
            "without a page for 6",
        ),
        (6, image(0, "ZXYCT", [6, 1, 1], "", all), "ZXYCT"),
        (6, image(0, "XYZCT", [0, 1, 1], "", all), "SizeZ=\"0\""),
        (
            6,
            image(0, "XYZCT", [6, 1, 1], "", all).replace("SizeX=\"4\"", "SizeX=\"5\""),
            "pages of 4 x 3",
        ),
        (6, "<Image/>".into(), "without an image"),
        (
            6,
            "<BinaryOnly MetadataFile=\"a.companion.ome\"/>".into(),
            "a.companion.ome",
        ),
        (
            6,
            image(0, "XYZCT", [6, 1, 1], "", all) + "<ModuloAlongZ Type=\"phase\"/>",
            "phase",
        ),
        (6, "<Image>".into(), "damaged XML"),
        (
            6,
            image(0, "XYZCT", [6, 1, 1], "PhysicalSizeX=\"&foo;\"", all),
            "damaged XML",
        ),
    ] {
        let error = refusal(plain(&stack(pages, &inside)));
        assert!(error.contains(says), "{inside}: {error}");
    }
}

#[test]
fn pages_in_several_files() {
    let dir = tempfile::tempdir().unwrap();
    let data = |z: u32| {
        let file = z / 3;
        format!(
            "<TiffData IFD=\"{}\" FirstZ=\"{z}\" PlaneCount=\"1\"><UUID FileName=\"sub/p{file}.tif\">urn:uuid:{file}\
             </UUID></TiffData>",
            z % 3
        )
    };
    let data: String = (0..6).map(data).collect();
    let text = |uuid: u32| {
        let text = document(&image(0, "XYZCT", [6, 1, 1], "", &data));
        text.replace("UUID=\"urn:uuid:1\"", &format!("UUID=\"urn:uuid:{uuid}\""))
    };
    for uuid in 0..2 {
        put(
            dir.path(),
            &format!("p{uuid}.tif"),
            &described(3 * uuid..3 * uuid + 3, &text(uuid)),
        );
    }
    let read = |name: &str| open(&dir.path().join(name), &OpenOptions::default());
    assert_eq!(slices(&read("p0.tif").unwrap()), [0, 1, 2, 3, 4, 5]);
    assert_eq!(slices(&read("p1.tif").unwrap()), [0, 1, 2, 3, 4, 5]);
    assert_eq!(slices(&read("").unwrap()), [0, 1, 2, 3, 4, 5]);
    std::fs::rename(dir.path().join("p1.tif"), dir.path().join("q.tif")).unwrap();
    assert!(refusal(read("p0.tif")).contains("p1.tif, which is not there"));
}

#[test]
fn a_file_that_is_named_by_another_name_or_uuid() {
    let of = |root: &str, uuid: &str| {
        let alone = format!("<TiffData IFD=\"0\" PlaneCount=\"3\"><UUID{uuid}</UUID></TiffData>");
        let text = document(&image(0, "XYZCT", [3, 1, 1], "", &alone));
        plain(&described(0..3, &text.replace("UUID=\"urn:uuid:1\"", root)))
    };
    // its own UUID, however it is written, whatever the file's name is now
    let root = "UUID=\"urn:uuid:0A-1\"";
    for own in [
        " FileName=\"old.tif\">urn:uuid:0a-1",
        " FileName=\"old.tif\">0A-1",
        ">URN:UUID:0A-1",
    ] {
        let opened = of(root, own).unwrap();
        assert_eq!(slices(&opened), [0, 1, 2], "{own}");
        assert!(opened.warnings.is_empty(), "{opened:?}");
    }
    let other = refusal(of(root, " FileName=\"old.tif\">urn:uuid:0b-1"));
    assert!(
        other.contains("old.tif") && other.contains("0b-1") && other.contains("0a-1"),
        "{other}"
    );
    assert!(refusal(of(root, ">urn:uuid:0b-1")).contains("0b-1"));
    // without a UUID of its own it may have been renamed
    let renamed = of("", " FileName=\"old.tif\">urn:uuid:0b-1").unwrap();
    assert_eq!(slices(&renamed), [0, 1, 2]);
    assert!(renamed.warnings[0].contains("old.tif"), "{renamed:?}");
}

#[test]
fn a_folder_of_slices_that_describe_themselves() {
    let dir = tempfile::tempdir().unwrap();
    let sizes = "PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"2\"";
    let write = |z: u32, sizes: &str| {
        let text = document(&image(0, "XYZCT", [1, 1, 1], sizes, "<TiffData/>"));
        put(dir.path(), &format!("s{z}.tif"), &described([z], &text));
    };
    (0..3).for_each(|z| write(z, sizes));
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(slices(&opened), [0, 1, 2]);
    assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.5, 2.0]);
    write(1, &sizes.replace("0.5", "0.25"));
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [1.0; 3]);
    assert!(opened.warnings[0].contains("s1.tif"), "{opened:?}");
}

#[test]
fn sizes_of_voxels() {
    let size = |axis: char, size: &str, unit: &str| match unit {
        "" => format!(" PhysicalSize{axis}=\"{size}\""),
        _ => format!(" PhysicalSize{axis}=\"{size}\" PhysicalSize{axis}Unit=\"{unit}\""),
    };
    for (x, y, z, spacing, unit) in [
        (
            ("5.0", "&#181;m"),
            ("5.0", "&#xB5;m"),
            ("10.0", "µm"),
            [5.0, 5.0, 10.0],
            Unit::Micrometre,
        ),
        (
            ("5", ""),
            ("5", "um"),
            ("0.010", "mm"),
            [5.0, 5.0, 10.0],
            Unit::Micrometre,
        ),
        (
            ("5000", "Å"),
            ("5000", "Å"),
            ("1e4", "Å"),
            [500.0, 500.0, 1000.0],
            Unit::Nanometre,
        ),
        (
            ("500000", "pm"),
            ("500", "nm"),
            ("1000", "nm"),
            [500.0, 500.0, 1000.0],
            Unit::Nanometre,
        ),
        (
            ("0.001", "in"),
            ("0.001", "in"),
            ("1", "mm"),
            [0.0254, 0.0254, 1.0],
            Unit::Millimetre,
        ),
        (
            ("0.05000000074505806", "mm"),
            ("50", "µm"),
            ("0.1", "mm"),
            [0.05, 0.05, 0.1],
            Unit::Millimetre,
        ),
        (
            ("2", "pixel"),
            ("2", "pixel"),
            ("3", "pixel"),
            [2.0, 2.0, 3.0],
            Unit::Voxel,
        ),
    ] {
        let more = size('X', x.0, x.1) + &size('Y', y.0, y.1) + &size('Z', z.0, z.1);
        let text = document(&image(0, "XYZCT", [3, 1, 1], &more, "<TiffData/>"));
        let quoted = text.replace('"', "'");
        let prefixed = text
            .replace('<', "<ome:")
            .replace("<ome:/", "</ome:")
            .replace("xmlns=", "xmlns:ome=");
        let prefixed = prefixed.replace("<ome:?", "<?").replace("<ome:!", "<!");
        for text in [text, quoted, prefixed] {
            let opened = plain(&described(0..3, &text)).unwrap();
            let place = opened.volume.header().placement;
            assert_eq!((place.spacing, place.unit), (spacing, unit), "{text}");
            assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
            assert!(opened.warnings.is_empty());
        }
    }
    let flat = size('X', "5", "") + &size('Y', "5", "");
    let opened = plain(&stack(
        3,
        &image(0, "XYZCT", [3, 1, 1], &flat, "<TiffData/>"),
    ))
    .unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [5.0; 3]);
    assert_eq!(
        opened.provenance.spacing,
        [Origin::File, Origin::File, Origin::Assumed]
    );
    assert!(opened.warnings[0].contains("--spacing"), "{opened:?}");
    for unclear in [
        size('X', "5", "reference frame") + &size('Y', "5", "reference frame"),
        size('X', "5", ""),
        size('X', "0", "") + &size('Y', "0", ""),
        size('X', "a", "") + &size('Y', "5", ""),
    ] {
        let opened = plain(&stack(
            3,
            &image(0, "XYZCT", [3, 1, 1], &unclear, "<TiffData/>"),
        ))
        .unwrap();
        assert_eq!(opened.provenance.spacing, [Origin::Default; 3], "{unclear}");
        assert!(opened.warnings[0].contains("--spacing"), "{opened:?}");
    }
}
