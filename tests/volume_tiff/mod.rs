//! TIFF: which pages are the volume, how large its voxels are and what its samples stand for, by what each of several
//! programs writes.

mod ome;
mod sizes;
mod writer;

use crate::volume_common::all;
use alvis::Result;
use alvis::volume::{Dtype, OpenOptions, Opened, open};
use std::path::Path;
use writer::{Page, Tag, described, file, page, text, with};

/// Opens a file of these pages.
fn read(pages: &[Page], options: &OpenOptions) -> Result<Opened> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    std::fs::write(&path, file(pages)).unwrap();
    open(&path, options)
}

fn plain(pages: &[Page]) -> Result<Opened> {
    read(pages, &OpenOptions::default())
}

fn asking(series: Option<&str>, channel: Option<u32>, time: Option<u32>) -> OpenOptions {
    OpenOptions {
        series: series.map(String::from),
        channel,
        time,
        ..OpenOptions::default()
    }
}

/// The error's text.
fn refusal(result: Result<Opened>) -> String {
    match result {
        Ok(opened) => panic!("{:?}", opened.volume.header()),
        Err(error) => error.to_string(),
    }
}

/// The slices of a volume by the numbers that [`page`] gave them, whose voxels are all in their places.
fn slices(opened: &Opened) -> Vec<u32> {
    let [nx, ny, nz] = opened.volume.header().dims.0;
    assert_eq!((nx, ny, opened.volume.header().dtype), (4, 3, Dtype::U16));
    let values: Vec<u16> = bytemuck::pod_collect_to_vec(&all(&*opened.volume).unwrap());
    let mut found = Vec::new();
    for z in 0..nz {
        let slice = &values[12 * z as usize..][..12];
        let number = u32::from(slice[0]) / 100;
        let known: Vec<u16> = bytemuck::pod_collect_to_vec(&page(number).samples);
        assert_eq!(
            slice,
            known.iter().map(|v| u16::from_le(*v)).collect::<Vec<_>>()
        );
        found.push(number);
    }
    found
}

fn floats(opened: &Opened) -> Vec<f32> {
    assert_eq!(opened.volume.header().dtype, Dtype::F32);
    bytemuck::pod_collect_to_vec(&all(&*opened.volume).unwrap())
}

fn imagej(slices: u32, more: &str) -> Vec<Page> {
    let head = format!("ImageJ=1.53t\nimages={slices}\nslices={slices}\n{more}");
    described(0..slices, &head)
}

#[test]
fn directories_behind_the_samples_are_no_cause_for_a_note() {
    let opened = plain(&(0..40).map(page).collect::<Vec<_>>()).unwrap();
    assert_eq!(slices(&opened), (0..40).collect::<Vec<_>>());
    assert!(
        opened.notes.is_empty() && opened.warnings.is_empty(),
        "{opened:?}"
    );
}

#[test]
fn shapes_by_tifffile() {
    let of = |shape: &str, axes: &str| {
        let axes = if axes.is_empty() {
            String::new()
        } else {
            format!(", \"axes\": \"{axes}\"")
        };
        described(0..6, &format!("{{\"shape\": {shape}{axes}}}"))
    };
    for (shape, axes) in [
        ("[6, 3, 4]", ""),
        ("[6, 3, 4]", "ZYX"),
        ("[1, 6, 1, 3, 4, 1]", "TZCYXS"),
        ("[6, 3, 4]", "IYX"),
    ] {
        let opened = plain(&of(shape, axes)).unwrap();
        assert_eq!(slices(&opened), [0, 1, 2, 3, 4, 5], "{shape}");
        assert!(opened.notes.is_empty(), "{opened:?}");
    }
    assert_eq!(
        slices(&plain(&described(0..6, "shape=(6, 3, 4)")).unwrap()).len(),
        6
    );
    let movie = plain(&of("[6, 3, 4]", "TYX")).unwrap();
    assert_eq!(slices(&movie).len(), 6);
    assert!(movie.notes[0].contains("6 times"), "{movie:?}");
    for (axes, channel, time, expected) in [
        ("TZYX", None, Some(1), [3, 4, 5]),
        ("CZYX", Some(1), None, [3, 4, 5]),
        ("TQYX", None, Some(0), [0, 1, 2]),
    ] {
        let pages = of("[2, 3, 3, 4]", axes);
        let opened = read(&pages, &asking(None, channel, time)).unwrap();
        assert_eq!(slices(&opened), expected, "{axes}");
        let error = refusal(plain(&pages));
        assert!(
            error.contains("and 2 ") && error.contains("0 to 1"),
            "{error}"
        );
    }
    let opened = read(&of("[3, 2, 3, 4]", "ZCYX"), &asking(None, Some(1), None)).unwrap();
    assert_eq!(slices(&opened), [1, 3, 5]);
    for (shape, axes, says) in [
        ("[2, 3, 3, 4]", "", "an axis without a name"),
        ("[2, 3, 3, 4]", "PZYX", "2 entries along the axis P"),
        ("[6, 3, 4]", "YXZ", "not y by x"),
        ("[6, 3, 4]", "CYX", "6 channels"),
        ("[7, 3, 4]", "ZYX", "6 pages"),
        ("[5, 3, 4]", "ZYX", "6 pages"),
        ("[6, 4, 3]", "ZYX", "pages of 4 x 3"),
        ("[6, 3, 4]", "ZZYX", "an axis for every number"),
    ] {
        let error = refusal(plain(&of(shape, axes)));
        assert!(error.contains(says), "{shape} {axes}: {error}");
    }
}

#[test]
fn series_by_tifffile() {
    let json = "{\"shape\": [3, 3, 4]}";
    let two = [described(0..3, json), described(3..6, json)].concat();
    let error = refusal(plain(&two));
    assert!(
        error.contains("2 series") && error.contains("1: 4 x 3 x 3"),
        "{error}"
    );
    assert_eq!(
        slices(&read(&two, &asking(Some("1"), None, None)).unwrap()),
        [3, 4, 5]
    );
    assert!(read(&two, &asking(Some("2"), None, None)).is_err());
    // slices that were written one by one are a series each
    let single = |z: u32| format!("{{\"shape\": [3, 4], \"slice\": {z}}}");
    let loose: Vec<Page> = (0..5).flat_map(|z| described([z], &single(z))).collect();
    assert_eq!(slices(&plain(&loose).unwrap()), [0, 1, 2, 3, 4]);
    // a picture in colours behind a volume
    let mut colours = described([9], "{\"shape\": [3, 4, 3]}");
    colours[0].tags.push((262, Tag::Short(2)));
    let both = [described(0..3, json), colours].concat();
    let error = refusal(plain(&both));
    assert!(error.contains("1: 1, not of grey values"), "{error}");
    let first = read(&both, &asking(Some("0"), None, None)).unwrap();
    assert_eq!(slices(&first), [0, 1, 2]);
    assert!(refusal(read(&both, &asking(Some("1"), None, None))).contains("RGB"));
    let error = refusal(plain(&[two, loose].concat()));
    assert!(
        error.contains("3 series") && error.contains("2: 4 x 3 x 5"),
        "{error}"
    );
    // one directory for all, the samples behind it
    let mut one = described([0], "{\"shape\": [3, 3, 4], \"truncated\": true}");
    one[0].tags.push((273, Tag::Long(8)));
    one[0].tags.push((279, Tag::Long(24)));
    one[0].samples = (0..3).flat_map(|z| page(z).samples).collect();
    one[0].tags.push((258, Tag::Short(16)));
    assert_eq!(slices(&plain(&one).unwrap()), [0, 1, 2]);
}

#[test]
fn pages_of_several_sizes_are_several_stacks() {
    let mut small = page(9);
    small.size = [3, 4];
    let mut pages: Vec<Page> = (0..3).map(page).collect();
    pages.insert(1, small.clone());
    let error = refusal(plain(&pages));
    assert!(
        error.contains("0: 4 x 3 x 3") && error.contains("1: 3 x 4 x 1"),
        "{error}"
    );
    assert_eq!(
        slices(&read(&pages, &asking(Some("0"), None, None)).unwrap()),
        [0, 1, 2]
    );
    // a reduced image, in both ways to say it, is no slice
    for tag in [(254, Tag::Long(1)), (255, Tag::Short(2))] {
        pages[1] = small.clone();
        pages[1].tags.push(tag);
        assert_eq!(slices(&plain(&pages).unwrap()), [0, 1, 2]);
    }
    let deep = with((0..3).map(page).collect(), 32997, Tag::Long(4));
    assert!(refusal(plain(&deep)).contains("ImageDepth"));
}

#[test]
fn hyperstacks_by_imagej() {
    let of = |more: &str| described(0..12, &format!("ImageJ=1.53t\nimages=12\n{more}"));
    let pages = of("channels=2\nslices=3\nframes=2\nhyperstack=true\n");
    let opened = read(&pages, &asking(None, Some(1), Some(1))).unwrap();
    assert_eq!(slices(&opened), [7, 9, 11]);
    let error = refusal(read(&pages, &asking(None, None, Some(1))));
    assert!(
        error.contains("--channel") && error.contains("2 channels"),
        "{error}"
    );
    let opened = read(
        &of("order=zct\nchannels=2\nslices=6\n"),
        &asking(None, Some(1), None),
    )
    .unwrap();
    assert_eq!(slices(&opened), [6, 7, 8, 9, 10, 11]);
    let movie = plain(&of("frames=12\n")).unwrap();
    assert_eq!(slices(&movie).len(), 12);
    assert!(movie.notes[0].contains("12 times"), "{movie:?}");
    for (more, says) in [
        ("slices=5\n", "12 images"),
        ("channels=12\n", "12 channels"),
        ("order=abc\nslices=12\n", "\"abc\""),
    ] {
        let error = refusal(plain(&of(more)));
        assert!(error.contains(says), "{more}: {error}");
    }
    for images in [11, 13] {
        let text = format!("ImageJ=1.53t\nimages={images}\nslices={images}\n");
        assert!(refusal(plain(&described(0..12, &text))).contains("12 pages"));
    }
}

#[test]
fn options_that_name_nothing_are_refused() {
    let pages: Vec<Page> = (0..3).map(page).collect();
    for options in [
        asking(Some("1"), None, None),
        asking(None, Some(1), None),
        asking(None, None, Some(1)),
    ] {
        assert!(read(&pages, &options).is_err());
    }
    assert!(read(&pages, &asking(Some("0"), Some(0), Some(0))).is_ok());
}

#[test]
fn calibrations_by_imagej() {
    let line = "unit=mm\nspacing=0.5\ncf=0\nc0=-32768.0\nc1=2.0\nvunit=Gray Value\n";
    let opened = plain(&imagej(3, line)).unwrap();
    let values = floats(&opened);
    assert_eq!(
        values[..5],
        [-32768.0, -32766.0, -32764.0, -32762.0, -32748.0]
    );
    assert!(opened.values.unwrap().contains("2 * stored - 32768"));
    // signed numbers are unsigned ones, 32768 larger, to ImageJ
    let signed = with(imagej(3, line), 339, Tag::Short(2));
    assert_eq!(floats(&plain(&signed).unwrap())[..2], [32768.0, 32770.0]);
    for none in [
        "cf=20\nvunit=x\n",
        "cf=0\nc0=0\nc1=1\nvunit=x\n",
        "vunit=x\n",
    ] {
        assert_eq!(
            slices(&plain(&imagej(3, none)).unwrap()),
            [0, 1, 2],
            "{none}"
        );
    }
    for (text, says) in [
        ("cf=1\nc0=1\nc1=2\nc2=3\nvunit=x\n", "polynomial"),
        ("cf=4\nc0=1\nc1=2\nvunit=x\n", "exponential"),
        ("cf=21\nvunit=x\n", "uncalibrated optical density"),
        ("cf=33\nvunit=x\n", "unknown"),
        ("cf=0\nvunit=x\n", "without c0"),
        ("cf=0\nc0=1\nc1=2\nvunit=x\nzeroclip=true\n", "zeroclip"),
    ] {
        let error = refusal(plain(&imagej(3, text)));
        assert!(error.contains(says) && error.contains("32-bit"), "{error}");
    }
}

#[test]
fn scales_by_gdal() {
    let items = "<GDALMetadata>\n<Item name=\"OFFSET\" sample=\"0\" role=\"offset\">-10</Item>\n\
                 <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.5</Item>\n</GDALMetadata>";
    let pages = with((0..3).map(page).collect(), 42112, text(items));
    let opened = plain(&with(pages.clone(), 42113, text("2"))).unwrap();
    let values = floats(&opened);
    assert_eq!(values[..2], [-10.0, -9.5]);
    assert!(values[2].is_nan() && opened.values.unwrap().contains("stored 2 is no value"));
    let mut other = pages;
    other[1].tags = vec![(42112, text(&items.replace("0.5", "0.25")))];
    assert!(refusal(plain(&other)).contains("another for some slices"));
    assert!(
        plain(&with((0..3).map(page).collect(), 42113, text("nan")))
            .unwrap()
            .values
            .is_none()
    );
}

#[test]
fn a_number_for_nothing_on_one_page_alone_is_no_scale() {
    let mut pages: Vec<Page> = (0..3).map(page).collect();
    pages[0].tags.push((42113, text("2")));
    let error = refusal(plain(&pages));
    assert!(
        error.contains("GDAL_NODATA") && !error.contains("a scale"),
        "{error}"
    );
}

#[test]
fn scales_by_members_of_tifffile() {
    let of = |members: &str| described(0..3, &format!("{{\"shape\": [3, 3, 4], {members}}}"));
    for (members, first) in [
        ("\"scale_factor\": 0.5, \"add_offset\": -10", [-10.0, -9.5]),
        ("\"slope\": 2, \"intercept\": 1", [1.0, 3.0]),
        ("\"RescaleSlope\": 2, \"RescaleIntercept\": -1", [-1.0, 1.0]),
    ] {
        let opened = plain(&of(members)).unwrap();
        assert_eq!(floats(&opened)[..2], first, "{members}");
        assert!(opened.warnings.is_empty(), "{opened:?}");
    }
    let filled = plain(&of("\"_FillValue\": 1")).unwrap();
    assert!(floats(&filled)[1].is_nan());
    for (members, name) in [
        ("\"scale\": 0.25", "\"scale\" (0.25)"),
        ("\"calibration\": [1, 2]", "\"calibration\" ([1,2])"),
    ] {
        let opened = plain(&of(members)).unwrap();
        assert!(opened.warnings[0].contains(name), "{opened:?}");
    }
    for members in [
        "\"slope\": 0",
        "\"slope\": \"x\"",
        "\"slope\": 2, \"scale_factor\": 3",
    ] {
        let error = refusal(plain(&of(members)));
        assert!(error.contains("slope"), "{error}");
    }
    // the scale of GDAL's tags beside one of the description
    let both = with(of("\"slope\": 2"), 42113, text("2"));
    assert!(refusal(plain(&both)).contains("GDAL's tags"));
    // each of two series has its own
    let mut two = of("\"slope\": 2");
    two.extend(of("\"slope\": 3"));
    for (series, value) in [("0", 2.0), ("1", 3.0)] {
        let opened = read(&two, &asking(Some(series), None, None)).unwrap();
        assert_eq!(floats(&opened)[1], value);
    }
}

#[test]
fn orientations() {
    let turned = |orientation, turn: fn(u16, u16) -> [u16; 2]| {
        let opened = plain(&with(
            (0..3).map(page).collect(),
            274,
            Tag::Short(orientation),
        ))
        .unwrap();
        assert!(
            opened.notes[0].contains(&format!("Orientation {orientation}")),
            "{opened:?}"
        );
        let values: Vec<u16> = bytemuck::pod_collect_to_vec(&all(&*opened.volume).unwrap());
        for (i, value) in (0u16..).zip(values) {
            let [x, y] = turn(i % 4, i / 4 % 3);
            assert_eq!(value, x + 10 * y + 100 * (i / 12), "{orientation}");
        }
    };
    turned(2, |x, y| [3 - x, y]);
    turned(3, |x, y| [3 - x, 2 - y]);
    turned(4, |x, y| [x, 2 - y]);
    assert!(
        plain(&with((0..3).map(page).collect(), 274, Tag::Short(1)))
            .unwrap()
            .notes
            .is_empty()
    );
    for orientation in 5..=8 {
        let pages = with((0..3).map(page).collect(), 274, Tag::Short(orientation));
        assert!(refusal(plain(&pages)).contains("rows are columns"));
    }
    let mut mixed: Vec<Page> = (0..3).map(page).collect();
    mixed[1].tags.push((274, Tag::Short(4)));
    let error = refusal(plain(&mixed));
    assert!(error.contains("slice 2 with Orientation 4"), "{error}");
    let dir = tempfile::tempdir().unwrap();
    for (i, page) in mixed.into_iter().enumerate() {
        std::fs::write(dir.path().join(format!("s{i}.tif")), file(&[page])).unwrap();
    }
    assert!(refusal(open(dir.path(), &OpenOptions::default())).contains("s1.tif"));
}

#[test]
fn other_formats_in_tiff_are_named() {
    for (tag, value, says) in [
        (33629, text("planes"), "STK"),
        (34361, text("head"), "FluoView"),
        (65420, Tag::Long(1), "NDPI"),
        (33445, Tag::Long(2), "square roots"),
        (
            270,
            text("<?xml version=\"1.0\"?><scn xmlns=\"x\"/>"),
            "SCN",
        ),
        (305, text("SI.VERSION_MAJOR = 2016"), "ScanImage"),
    ] {
        let error = refusal(plain(&with((0..3).map(page).collect(), tag, value)));
        assert!(error.contains(says), "{error}");
    }
    let lsm = |times: u32| {
        let head: Vec<u8> = [0x0040_0494, 512, 4, 3, 3, 1, times]
            .into_iter()
            .flat_map(u32::to_le_bytes)
            .collect();
        with((0..3).map(page).collect(), 34412, Tag::Text(head))
    };
    assert_eq!(slices(&plain(&lsm(1)).unwrap()), [0, 1, 2]);
    assert!(refusal(plain(&lsm(2))).contains("LSM"));
}

fn put(dir: &Path, name: &str, pages: &[Page]) {
    std::fs::write(dir.join(name), file(pages)).unwrap();
}

#[test]
fn folders_hold_one_volume() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, z: [u32; 3], text: &str| put(dir.path(), name, &described(z, text));
    write("a1.tif", [0, 1, 2], "");
    write("a2.tif", [3, 4, 5], "");
    let error = refusal(open(dir.path(), &OpenOptions::default()));
    assert!(
        error.contains("2 files, of which one holds 3 pages"),
        "{error}"
    );
    assert!(error.contains("%d.tif"), "{error}");
    // the way out
    let parts = dir.path().join("a%d.tif");
    let opened = open(&parts, &OpenOptions::default()).unwrap();
    assert_eq!(slices(&opened), [0, 1, 2, 3, 4, 5]);
    assert!(opened.notes[0].contains("2 files"), "{opened:?}");
    let scaled =
        "ImageJ=1.53t\nimages=3\nslices=3\nunit=mm\nspacing=2\ncf=0\nc0=1\nc1=2\nvunit=x\n";
    write("a1.tif", [0, 1, 2], scaled);
    assert!(refusal(open(&parts, &OpenOptions::default())).contains("another for some slices"));
    write("a2.tif", [3, 4, 5], scaled);
    let opened = open(&parts, &OpenOptions::default()).unwrap();
    assert_eq!(floats(&opened)[..2], [1.0, 3.0]);
    assert!(opened.values.is_some() && opened.volume.header().dims.0[2] == 6);
    write("a2.tif", [3, 4, 5], "ImageJ=1.53t\nimages=3\nchannels=3\n");
    assert!(refusal(open(&parts, &OpenOptions::default())).contains("3 channels"));
}

/// Slices and the log of NRecon, in a folder.
fn scan(dir: &Path, log: &str) -> Result<Opened> {
    let text = format!("[Acquisition]\r\nPixel Size (um)=9\r\n[Reconstruction]\r\n{log}");
    std::fs::write(dir.join("foam__rec.log"), text).unwrap();
    open(dir, &OpenOptions::default())
}

#[test]
fn logs_of_nrecon() {
    let dir = tempfile::tempdir().unwrap();
    for z in 0..3 {
        put(dir.path(), &format!("foam__rec010{z}.tif"), &[page(z)]);
    }
    let mut preview = page(0);
    preview.size = [3, 4];
    put(dir.path(), "foam__rec_spr.tif", &[preview]);
    let same = "Result Image Width (pixels)=4\r\nResult Image Height (pixels)=3\r\nPixel Size (um)=17.51000\r\n";
    let opened = scan(dir.path(), same).unwrap();
    assert_eq!(slices(&opened), [0, 1, 2]);
    let place = opened.volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([17.51; 3], alvis::grid::Unit::Micrometre)
    );
    assert_eq!(opened.provenance.spacing, [alvis::grid::Origin::File; 3]);
    assert!(opened.warnings.is_empty(), "{opened:?}");
    let notes = opened.notes.join("\n");
    assert!(
        notes.contains("foam__rec_spr.tif") && notes.contains("foam__rec.log"),
        "{notes}"
    );
    // every second section was kept
    let opened = scan(dir.path(), &format!("{same}Section to Section Step=2\r\n")).unwrap();
    assert_eq!(
        opened.volume.header().placement.spacing,
        [17.51, 17.51, 35.02]
    );
    // other slices than those of the log
    let opened = scan(dir.path(), &same.replace("=4", "=8")).unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [1.0; 3]);
    assert!(opened.warnings[0].contains("17.51"), "{opened:?}");
    // by a pattern, the log is found too
    scan(dir.path(), same).unwrap();
    let opened = open(
        &dir.path().join("foam__rec%04d.tif"),
        &OpenOptions::default(),
    )
    .unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [17.51; 3]);
}
