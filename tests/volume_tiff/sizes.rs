//! Sizes of voxels by TIFF's own tags, ImageJ and tifffile.

use super::writer::{Page, Tag, described, page, resolved, text, with};
use super::{imagej, plain, put, read};
use alvis::grid::{Origin, Unit};
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

/// A description by tifffile with these members.
fn members(members: &str) -> Vec<Page> {
    described(
        0..3,
        &format!("{{\"shape\": [3, 3, 4], \"axes\": \"ZYX\", {members}}}"),
    )
}

#[test]
fn members_of_tifffile_that_state_sizes() {
    let um = Unit::Micrometre;
    for (text, spacing, unit, from) in [
        (
            r#""voxel_size": [0.5, 0.5, 0.5], "unit": "um""#,
            [0.5; 3],
            um,
            [Origin::File; 3],
        ),
        (r#""voxel_size_um": 0.5"#, [0.5; 3], um, [Origin::File; 3]),
        (r#""VoxelSizeUm": 0.5"#, [0.5; 3], um, [Origin::File; 3]),
        (r#""pixel_size": 0.5, "unit": "um""#, [0.5; 3], um, FLAT),
        (
            r#""pixel_size": 0.5, "spacing": 2, "unit": "um""#,
            [0.5, 0.5, 2.0],
            um,
            [Origin::File; 3],
        ),
        (
            r#""spacing": {"x": 0.4, "y": 0.5, "z": 2.0}, "units": "um""#,
            [0.4, 0.5, 2.0],
            um,
            [Origin::File; 3],
        ),
        (
            r#""voxel_size_x": 0.4, "voxel_size_y": 0.5, "z_spacing": 2, "unit": "um""#,
            [0.4, 0.5, 2.0],
            um,
            [Origin::File; 3],
        ),
        (
            r#""voxel_size": [0.5, 0.5, 0.5]"#,
            [0.5; 3],
            Unit::Voxel,
            [Origin::File; 3],
        ),
        (
            r#""PhysicalSizeX": 0.4, "PhysicalSizeY": 0.5, "PhysicalSizeZ": 2000, "PhysicalSizeZUnit": "nm""#,
            [0.4, 0.5, 2.0],
            um,
            [Origin::File; 3],
        ),
    ] {
        let opened = plain(&members(text)).unwrap();
        assert_eq!(size(&opened), (spacing, unit, from), "{text}");
        let warned = usize::from(from == FLAT);
        assert_eq!(opened.warnings.len(), warned, "{opened:?}");
    }
    // numbers that differ, in an order that the axes name
    let opened = plain(&members(r#""spacing": [2, 0.5, 0.4], "unit": "um""#)).unwrap();
    assert_eq!(size(&opened), ([0.4, 0.5, 2.0], um, [Origin::File; 3]));
    assert!(
        opened.warnings[0].contains("order of its axes, ZYX"),
        "{opened:?}"
    );
    let unnamed = r#"{"shape": [3, 3, 4], "spacing": [2, 0.5, 0.4], "unit": "um"}"#;
    for (pages, named) in [
        (described(0..3, unnamed), "\"spacing\" ([2,0.5,0.4])"),
        (members(r#""resolution": 0.5"#), "\"resolution\" (0.5)"),
        (
            members(r#""voxel_size": "0.5 um""#),
            "\"voxel_size\" (\"0.5 um\")",
        ),
        (members(r#""voxel_size": 0.5, "spacing": 2"#), "differ"),
        (members(r#""voxel_size": 0.5, "unit": "HU""#), "\"HU\""),
    ] {
        let opened = plain(&pages).unwrap();
        assert_eq!(size(&opened), NOT_STATED, "{named}");
        assert!(opened.warnings[0].contains(named), "{opened:?}");
        let options = OpenOptions {
            spacing: Some([0.5; 3]),
            unit: Some(um),
            ..OpenOptions::default()
        };
        assert!(
            read(&pages, &options).unwrap().warnings.is_empty(),
            "{named}"
        );
    }
    let nothing = plain(&members(r#""software": "x 1.0", "step": null"#)).unwrap();
    assert!(nothing.warnings.is_empty(), "{nothing:?}");
}

#[test]
fn imagej_without_a_unit_and_tiff_with_one() {
    let of = |unit: u16, per: u32, text: &str| {
        plain(&resolved(imagej(3, text), unit, [per, 1], [per, 1])).unwrap()
    };
    for (opened, expected, warning) in [
        (
            of(3, 1000, ""),
            ([0.01; 3], Unit::Millimetre, FLAT),
            "in cm",
        ),
        (
            of(2, 254, ""),
            ([0.1; 3], Unit::Millimetre, FLAT),
            "in inch",
        ),
        (
            of(3, 1000, "spacing=0.002\n"),
            ([0.01, 0.01, 0.02], Unit::Millimetre, [Origin::File; 3]),
            "in cm",
        ),
        (of(3, 1000, "spacing=20\n"), NOT_STATED, "none is taken"),
    ] {
        assert_eq!(size(&opened), expected);
        assert!(opened.warnings[0].contains(warning), "{opened:?}");
    }
    assert_eq!(size(&of(2, 72, "")), NOT_STATED);
}

#[test]
fn origin_by_imagej() {
    let text = "unit=um\nspacing=0.3\nxorigin=3\nyorigin=-2\nzorigin=1\n";
    let pages = resolved(imagej(3, text), 1, [10, 1], [10, 1]);
    let opened = plain(&pages).unwrap();
    let place = opened.volume.header().placement;
    // a multiple of 0.1 without noise
    assert_eq!(place.origin, [-0.3, 0.2, -0.3]);
    assert_eq!(opened.provenance.origin, Origin::File);
    let options = OpenOptions {
        spacing: Some([0.5; 3]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    for opened in [
        read(&pages, &options).unwrap(),
        plain(&imagej(3, "xorigin=3\n")).unwrap(),
    ] {
        assert_eq!(opened.volume.header().placement.origin, [0.0; 3]);
        assert!(opened.notes[0].contains("voxel 3, "), "{opened:?}");
    }
}

#[test]
fn tags_of_other_programs_are_named_or_read() {
    let pages = || (0..3).map(page).collect();
    let opened = plain(&with(pages(), 33550, text("0.5"))).unwrap();
    assert!(opened.notes[0].contains("ModelPixelScale"), "{opened:?}");
    // Zeiss' LSM: ten numbers of 32 bits, of them one channel and one time, and three sizes in metres
    let mut lsm = [1u32; 10].map(u32::to_le_bytes).concat();
    for size in [0.5e-6f64, 0.25e-6, 2e-6] {
        lsm.extend(size.to_le_bytes());
    }
    let opened = plain(&with(pages(), 34412, Tag::Text(lsm))).unwrap();
    let expected = ([0.5e-6, 0.25e-6, 2e-6], Unit::Metre, [Origin::File; 3]);
    assert_eq!(size(&opened), expected);
}
