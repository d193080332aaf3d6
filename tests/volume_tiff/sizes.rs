//! Sizes of voxels by TIFF's own tags, ImageJ and tifffile.

use super::writer::{Page, Tag, described, page, resolved, with};
use super::{imagej, plain, put, read};
use alvis::grid::Unit;
use alvis::manifest::Origin;
use alvis::volume::{OpenOptions, Opened, open};

const FLAT: [Origin; 3] = [Origin::File, Origin::File, Origin::Assumed];

/// Spacing, unit and where the spacing is from.
fn size(opened: &Opened) -> ([f64; 3], Unit, [Origin; 3]) {
    let place = opened.volume.header().placement;
    (place.spacing, place.unit, opened.provenance.spacing)
}

fn pages() -> Vec<Page> {
    (0..3).map(page).collect()
}

const NOT_STATED: ([f64; 3], Unit, [Origin; 3]) = ([1.0; 3], Unit::Voxel, [Origin::Default; 3]);

#[test]
fn tiff_has_no_distance_of_slices() {
    for (unit, x, y, spacing) in [
        (2, [254, 1], [254, 1], [0.1, 0.1, 0.1]),
        (3, [100, 1], [200, 1], [0.1, 0.05, 0.1]),
        (3, [20_000_000, 100_000], [20_000_000, 100_000], [0.05; 3]),
        // 0.13 mm in pixels per inch, as libtiff writes an f32
        (
            2,
            [819_502_464, 4_194_304],
            [819_502_464, 4_194_304],
            [0.13; 3],
        ),
    ] {
        let opened = plain(&resolved(pages(), unit, x, y)).unwrap();
        assert_eq!(size(&opened), (spacing, Unit::Millimetre, FLAT));
        let warning = &opened.warnings[0];
        assert!(
            warning.contains("distance of slices") && warning.contains("--spacing"),
            "{warning}"
        );
    }
    // what was asked for is given
    let options = OpenOptions {
        spacing: Some([0.1, 0.1, 0.5]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    for pixels in [254, 300] {
        let opened = read(&resolved(pages(), 2, [pixels, 1], [pixels, 1]), &options).unwrap();
        assert_eq!(size(&opened).2, [Origin::Option; 3]);
        assert!(opened.warnings.is_empty() && opened.notes.is_empty());
    }
    // without a unit it is the shape of pixels alone
    let opened = plain(&resolved(pages(), 1, [2, 1], [4, 1])).unwrap();
    assert_eq!(size(&opened), ([0.5, 0.25, 0.5], Unit::Voxel, FLAT));
    for (unit, x) in [
        (1, [254, 1]),
        (2, [1, 1]),
        (3, [1, 1]),
        (2, [0, 1]),
        (2, [1, 0]),
    ] {
        assert_eq!(
            size(&plain(&resolved(pages(), unit, x, x)).unwrap()),
            NOT_STATED
        );
    }
    let paper = plain(&resolved(pages(), 2, [300, 1], [300, 1])).unwrap();
    assert_eq!(size(&paper), NOT_STATED);
    assert!(paper.notes[0].contains("300 dots per inch"), "{paper:?}");
}

#[test]
fn slices_that_contradict_each_other() {
    let dir = tempfile::tempdir().unwrap();
    for (z, pixels) in [254, 254, 508].into_iter().enumerate() {
        put(
            dir.path(),
            &format!("s{z}.tif"),
            &resolved(vec![page(z as u32)], 2, [pixels, 1], [pixels, 1]),
        );
    }
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(size(&opened), NOT_STATED);
    assert!(opened.warnings[0].contains("differ"), "{opened:?}");
    let options = OpenOptions {
        spacing: Some([0.1; 3]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    assert_eq!(
        open(dir.path(), &options)
            .unwrap()
            .volume
            .header()
            .placement
            .spacing,
        [0.1; 3]
    );
}

#[test]
fn slices_that_describe_themselves() {
    let dir = tempfile::tempdir().unwrap();
    let write = |texts: [&str; 3]| {
        for (z, text) in (0..).zip(texts) {
            let pages = resolved(described([z], text), 2, [100, 13], [100, 13]);
            put(dir.path(), &format!("s{z}.tif"), &pages);
        }
        open(dir.path(), &OpenOptions::default()).unwrap()
    };
    // pixels per inch by tifffile's default, and another unit: a distance of slices would tell
    let um = "{\"shape\": [3, 4], \"unit\": \"um\"}";
    let opened = write([um; 3]);
    assert_eq!(size(&opened), NOT_STATED);
    assert!(opened.warnings[0].contains("inch"), "{opened:?}");
    let spaced = "{\"shape\": [3, 4], \"unit\": \"um\", \"spacing\": 0.2, \"slice\": 1}";
    assert_eq!(size(&write([spaced; 3])).0, [0.13, 0.13, 0.2]);
    let imagej = "ImageJ=1.53t\nunit=um\n";
    let opened = write([imagej; 3]);
    assert_eq!(size(&opened), ([0.13; 3], Unit::Micrometre, FLAT));
    for texts in [
        [imagej, imagej, "ImageJ=1.53t\nunit=mm\n"],
        [imagej, "", imagej],
        [spaced, um, spaced],
    ] {
        let opened = write(texts);
        assert_eq!(size(&opened), NOT_STATED, "{texts:?}");
        assert!(
            opened.warnings.iter().any(|w| w.contains("differ")),
            "{opened:?}"
        );
    }
}

#[test]
fn units_by_imagej() {
    let of = |text: &str, per: u32| {
        plain(&resolved(imagej(3, text), 1, [per, 1], [2 * per, 1])).unwrap()
    };
    for (text, spacing, unit) in [
        ("unit=um\nspacing=0.3\n", [0.1, 0.05, 0.3], Unit::Micrometre),
        (
            "unit=\\u00B5m\nspacing=-0.3\n",
            [0.1, 0.05, 0.3],
            Unit::Micrometre,
        ),
        ("unit=cm\nspacing=0.3\n", [0.1, 0.05, 0.3], Unit::Centimetre),
        (
            "unit=inch\nspacing=0.3\n",
            [2.54, 1.27, 7.62],
            Unit::Millimetre,
        ),
        (
            "unit=um\nyunit=nm\nzunit=mm\nspacing=0.3\n",
            [0.1, 0.00005, 300.0],
            Unit::Micrometre,
        ),
        ("unit=pixel\nspacing=3\n", [0.1, 0.05, 3.0], Unit::Voxel),
        ("spacing=3\n", [0.1, 0.05, 3.0], Unit::Voxel),
    ] {
        let opened = of(text, 10);
        assert_eq!(size(&opened), (spacing, unit, [Origin::File; 3]), "{text}");
        assert!(opened.warnings.is_empty(), "{opened:?}");
    }
    // 1 is what ImageJ does not write, and what others leave out
    let opened = of("unit=um\n", 10);
    assert_eq!(size(&opened), ([0.1, 0.05, 1.0], Unit::Micrometre, FLAT));
    assert!(opened.warnings[0].contains("as ImageJ does"), "{opened:?}");
    let cube = plain(&resolved(imagej(3, "unit=um\n"), 1, [1, 1], [1, 1])).unwrap();
    assert_eq!(size(&cube), ([1.0; 3], Unit::Micrometre, [Origin::File; 3]));
    let plain_pixels = plain(&resolved(imagej(3, ""), 1, [1, 1], [1, 1])).unwrap();
    assert_eq!(size(&plain_pixels), NOT_STATED);
    assert_eq!(
        size(&plain(&imagej(3, "spacing=3\n")).unwrap()).0,
        [1.0, 1.0, 3.0]
    );
    let unknown = of("unit=foo\nspacing=3\n", 10);
    assert_eq!(size(&unknown), NOT_STATED);
    assert!(unknown.warnings[0].contains("\"foo\""), "{unknown:?}");
    // sizes that ImageJ cut at a millionth
    let cut = resolved(
        imagej(3, "unit=um\nspacing=7\n"),
        1,
        [7_692_307, 1_000_000],
        [142_857, 1_000_000],
    );
    assert_eq!(size(&plain(&cut).unwrap()).0, [0.13, 7.0, 7.0]);
}

#[test]
fn tags_that_contradict_imagej() {
    let of = |unit: u16, per: u32, text: &str| {
        plain(&resolved(imagej(3, text), unit, [per, 1], [per, 1])).unwrap()
    };
    let opened = of(3, 100_000, "unit=um\nspacing=0.3\n");
    assert_eq!(size(&opened).0, [0.1, 0.1, 0.3], "ImageJ converts cm to um");
    assert!(opened.warnings.is_empty());
    let opened = of(2, 10, "unit=mm\nspacing=0.3\n");
    assert_eq!(size(&opened).0, [0.1, 0.1, 0.3]);
    assert!(
        opened.warnings[0].contains("inch") && opened.warnings[0].contains("mm"),
        "{opened:?}"
    );
    let opened = of(2, 300, "unit=inch\n");
    assert_eq!(size(&opened), NOT_STATED);
    assert!(opened.notes[0].contains("300 dots"), "{opened:?}");
}

#[test]
fn units_by_tifffile() {
    let of = |unit: u16, per: [u32; 2], more: &str| {
        let text = format!("{{\"shape\": [3, 3, 4], \"axes\": \"ZYX\"{more}}}");
        plain(&resolved(described(0..3, &text), unit, per, per)).unwrap()
    };
    let um = ", \"spacing\": 0.2, \"unit\": \"um\"";
    for (unit, per) in [
        (1, [100, 13]),
        (2, [100, 13]),
        (2, [2_540_000, 13]),
        (3, [1_000_000, 13]),
    ] {
        let opened = of(unit, per, um);
        let expected = ([0.13, 0.13, 0.2], Unit::Micrometre, [Origin::File; 3]);
        assert_eq!(size(&opened), expected, "{unit} {per:?}");
        assert_eq!(
            opened.warnings.is_empty(),
            (unit, per) != (2, [100, 13]),
            "{opened:?}"
        );
    }
    // neither reading can be told from the other, or nothing but the distance of slices is stated
    for (unit, per, more) in [
        (2, [100, 13], ", \"unit\": \"um\""),
        (1, [1, 1], um),
        (3, [100, 1], ", \"spacing\": 0.2"),
    ] {
        let opened = of(unit, per, more);
        assert_eq!(size(&opened), NOT_STATED, "{more}");
        assert!(opened.warnings[0].contains("--spacing"), "{opened:?}");
    }
    let physical = ", \"PhysicalSizeX\": 0.5, \"PhysicalSizeY\": 0.5, \"PhysicalSizeZ\": 2, \"PhysicalSizeXUnit\": \"nm\", \
                    \"PhysicalSizeYUnit\": \"nm\", \"PhysicalSizeZUnit\": \"nm\"";
    assert_eq!(
        size(&of(1, [1, 1], physical)),
        ([0.5, 0.5, 2.0], Unit::Nanometre, [Origin::File; 3])
    );
    assert_eq!(
        size(&of(3, [100, 1], "")),
        ([0.1; 3], Unit::Millimetre, FLAT)
    );
    assert_eq!(size(&of(1, [1, 1], "")), NOT_STATED);
    let inch = of(2, [254, 1], "");
    assert_eq!(size(&inch), ([0.1; 3], Unit::Millimetre, FLAT));
    assert!(inch.warnings[0].contains("told no unit"), "{inch:?}");
    let single = with(
        described(0..3, "{\"shape\": [3, 3, 4]}"),
        296,
        Tag::Short(2),
    );
    assert_eq!(size(&plain(&single).unwrap()), NOT_STATED);
}
