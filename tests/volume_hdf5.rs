//! HDF5 and the formats in it: axes, sizes, values and what is no volume, as the writers of tests/fixtures/make_hdf5.py
//! state them.
#![cfg(feature = "hdf5")]

mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, OpenOptions, Opened, open};
use alvis::{Error, Result};
use std::path::Path;
use volume_common::all;

fn read(name: &str, options: &OpenOptions) -> Result<Opened> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/hdf5");
    open(&folder.join(name), options)
}

fn plain(name: &str) -> Opened {
    read(name, &OpenOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn refused(name: &str, options: &OpenOptions) -> String {
    match read(name, options) {
        Ok(opened) => panic!("{name}: {opened:?}"),
        Err(error) => error.to_string(),
    }
}

/// All samples as numbers, x fastest.
fn numbers(opened: &Opened) -> Vec<f64> {
    let bytes = all(&*opened.volume).unwrap();
    macro_rules! of {
        ($t:ty, $n:literal) => {{
            let all = bytes.as_chunks::<$n>().0.iter();
            all.map(|b| <$t>::from_ne_bytes(*b) as f64).collect()
        }};
    }
    match opened.volume.header().dtype {
        Dtype::U8 => of!(u8, 1),
        Dtype::I8 => of!(i8, 1),
        Dtype::U16 => of!(u16, 2),
        Dtype::I16 => of!(i16, 2),
        Dtype::U32 => of!(u32, 4),
        Dtype::I32 => of!(i32, 4),
        Dtype::F32 => of!(f32, 4),
        Dtype::F64 => of!(f64, 8),
    }
}

/// Sample (x, y, z) of an unsigned grid.
fn sample(x: usize, y: usize, z: usize) -> f64 {
    (x * 7 + y * 13 + z * 29) as f64
}

/// Every sample is as `value(x, y, z)` has it, NaN for NaN, in single precision at least.
fn check(name: &str, opened: &Opened, dtype: Dtype, value: impl Fn(usize, usize, usize) -> f64) {
    let header = opened.volume.header();
    assert_eq!(
        (header.dims.0, header.dtype),
        ([19, 17, 3], dtype),
        "{name}"
    );
    for (i, found) in numbers(opened).into_iter().enumerate() {
        let (x, y, z) = (i % 19, i / 19 % 17, i / 323);
        let expected = value(x, y, z);
        let same = found == expected
            || found as f32 == expected as f32
            || found.is_nan() && expected.is_nan();
        assert!(same, "{name} ({x}, {y}, {z}): {found}, expected {expected}");
    }
}

fn says(name: &str, lines: &[String], part: &str) {
    assert!(
        lines.iter().any(|line| line.contains(part)),
        "{name}: {lines:?}"
    );
}

/// Where voxel (2, 4, 1) lies.
fn place(name: &str, opened: &Opened, unit: Unit, at: [f64; 3]) {
    let place = opened.volume.header().placement;
    let found = place.world([2.0, 4.0, 1.0]);
    let near = found.iter().zip(at).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(
        place.unit == unit && near,
        "{name}: {found:?} {}",
        place.unit
    );
}

#[test]
fn numbers_of_any_width_are_read() {
    for (name, dtype, less) in [
        ("bits12.h5", Dtype::U16, 0.0),
        ("bits12_nbit.h5", Dtype::U16, 0.0),
        ("bits11_be.h5", Dtype::I16, 100.0),
        ("bits11_be_nbit.h5", Dtype::I16, 100.0),
        ("u24.h5", Dtype::U32, 0.0),
        ("i64.h5", Dtype::F64, 100.0),
        ("f16.h5", Dtype::F32, -0.5),
        ("scaleoffset_u16.h5", Dtype::U16, 0.0),
        ("scaleoffset_f32.h5", Dtype::F32, -0.5),
    ] {
        check(name, &plain(name), dtype, |x, y, z| sample(x, y, z) - less);
    }
    let mask = |x, y, z| f64::from(u8::from(sample(x, y, z) > 200.0));
    check("bool.h5", &plain("bool.h5"), Dtype::I8, mask);
    let eighth = |x, y, z| ((sample(x, y, z) + 0.5) / 8.0).round();
    check("bfloat16.h5", &plain("bfloat16.h5"), Dtype::F32, eighth);
    says("u24.h5", &plain("u24.h5").notes, "20 of 24 bits");
    says("i64.h5", &plain("i64.h5").notes, "64 bits");
    let error = refused("no_u64.h5", &OpenOptions::default());
    assert!(error.contains("the number 1152921504606846977"), "{error}");
}

#[test]
fn axes_are_those_of_the_names() {
    let grid = sample;
    check(
        "axistags_xyz.h5",
        &plain("axistags_xyz.h5"),
        Dtype::U16,
        grid,
    );
    let labels = plain("labels_yxz.h5");
    check("labels_yxz.h5", &labels, Dtype::I16, |x, y, z| {
        grid(x, y, z) - 100.0
    });
    says("labels_yxz.h5", &labels.notes, "axes y, x, z");
    let two = plain("labels_two.h5");
    check("labels_two.h5", &two, Dtype::U16, grid);
    says(
        "labels_two.h5",
        &two.warnings,
        "axes (x, y) names 2 axes of 3",
    );
    let bytes = |x, y, z| grid(x, y, z) % 256.0;
    check("one_entry.h5", &plain("one_entry.h5"), Dtype::U8, bytes);
    check(
        "openpmd_xyz.h5",
        &plain("openpmd_xyz.h5"),
        Dtype::F32,
        |x, y, z| grid(x, y, z) + 0.5,
    );
    check(
        "dream3d.dream3d",
        &plain("dream3d.dream3d"),
        Dtype::U16,
        grid,
    );
    let nexus = plain("nexus_xyz.nxs");
    check("nexus_xyz.nxs", &nexus, Dtype::U16, grid);
    says("nexus_xyz.nxs", &nexus.notes, "default of 2 volumes");
    let other = OpenOptions {
        dataset: Some("/entry/other".into()),
        ..OpenOptions::default()
    };
    check(
        "nexus other",
        &read("nexus_xyz.nxs", &other).unwrap(),
        Dtype::U16,
        |x, y, z| grid(x, y, 2 - z),
    );
}

#[test]
fn axes_that_cannot_be_told_are_refused() {
    for (name, part) in [
        ("no_theta.h5", "projections"),
        ("no_order.h5", "DimensionOrder"),
        ("no_order_f.h5", "order is F"),
        ("no_memory_order.h5", "MemoryOrder is Fortran"),
        ("no_order_group.h5", "array_order is F"),
        ("no_two_orders.h5", "DIMENSION_LABELS"),
        (
            "no_wavelength.h5",
            "wavelength, y, x, as the attribute axes says, of which none is z",
        ),
        ("no_four.h5", "3 x 17 x 19 x 2 of u8"),
        ("no_four.h5", "--channel"),
        ("no_complex.h5", "complex numbers"),
        ("no_bias.h5", "floats of 32"),
    ] {
        let error = read(name, &OpenOptions::default()).unwrap_err();
        assert!(
            matches!(error, Error::Unsupported { .. }),
            "{name}: {error}"
        );
        assert!(error.to_string().contains(part), "{name}: {error}");
    }
}

#[test]
fn projections_are_not_the_volume_of_a_file() {
    let error = refused("no_projections.h5", &OpenOptions::default());
    for line in [
        "/exchange/data: 3 x 17 x 19 of u16, no volume: these are projections",
        "/exchange/data_white: 3 x 17 x 19 of u16, no volume: these are images without the sample or",
    ] {
        assert!(error.contains(line), "{error}");
    }
}

#[test]
fn projections_of_nxtomo_are_no_volume() {
    let error = refused("no_tomo.nxs", &OpenOptions::default());
    let reason = "these are projections: there is one image_key beside them for each of 3";
    assert!(error.contains(reason), "{error}");
}

#[test]
fn a_channel_and_a_time_are_chosen() {
    let name = "channels_tzyxc.h5";
    let of = |channel, time| OpenOptions {
        channel,
        time,
        ..OpenOptions::default()
    };
    check(
        name,
        &read(name, &of(Some(1), Some(1))).unwrap(),
        Dtype::U16,
        sample,
    );
    check(
        name,
        &read(name, &of(Some(0), Some(1))).unwrap(),
        Dtype::U16,
        |_, _, _| 0.0,
    );
    for (channel, time, part) in [
        (None, Some(1), "--channel: found nothing, and 2 channels"),
        (Some(1), None, "--time: found nothing, and 2 times"),
        (Some(2), Some(1), "0 to 1"),
    ] {
        let error = refused(name, &of(channel, time));
        assert!(error.contains(part), "{error}");
    }
    for options in [of(Some(0), None), of(None, Some(0))] {
        let error = refused("f16.h5", &options);
        assert!(error.contains("several"), "{error}");
    }
}

#[test]
fn sizes_are_those_that_attributes_and_coordinates_state() {
    for (name, spacing, unit) in [
        ("size_um.h5", [0.5, 0.25, 2.0], Unit::Micrometre),
        ("size_um_integers.h5", [2.0, 1.0, 5.0], Unit::Micrometre),
        ("size_nm.h5", [500.0, 250.0, 2000.0], Unit::Nanometre),
        ("size_unit_beside.h5", [0.5; 3], Unit::Micrometre),
        ("size_unit_capitals.h5", [0.5; 3], Unit::Micrometre),
        ("size_text.h5", [0.5; 3], Unit::Micrometre),
        ("size_scale.h5", [0.5; 3], Unit::Micrometre),
        ("size_group.h5", [0.5; 3], Unit::Micrometre),
        ("size_dataset.h5", [0.5; 3], Unit::Micrometre),
        ("size_each_axis.h5", [0.5, 0.25, 2.0], Unit::Micrometre),
        ("size_json.h5", [0.5, 0.25, 2.0], Unit::Micrometre),
        ("packed_coordinates.nc", [0.5, 0.25, 2.0], Unit::Millimetre),
        ("axistags_xyz.h5", [0.5, 0.25, 2.0], Unit::Micrometre),
        ("dream3d.dream3d", [0.5, 0.25, 2.0], Unit::Voxel),
        ("openpmd_xyz.h5", [0.5e-6, 0.25e-6, 2e-6], Unit::Metre),
        ("nexus_xyz.nxs", [0.5, 0.25, 2.0], Unit::Millimetre),
        ("cf_yzx.nc", [0.5, 0.25, 2.0], Unit::Millimetre),
        ("falling.nc", [0.5, 0.25, 2.0], Unit::Millimetre),
        ("slices.mnc", [0.5, 0.25, 2.0], Unit::Millimetre),
    ] {
        let opened = plain(name);
        let place = opened.volume.header().placement;
        assert_eq!((place.spacing, place.unit), (spacing, unit), "{name}");
        assert_eq!(opened.provenance.spacing, [Origin::File; 3], "{name}");
    }
    place(
        "cf_yzx.nc",
        &plain("cf_yzx.nc"),
        Unit::Millimetre,
        [11.0, 21.0, -28.0],
    );
    // coordinates that fall: the place of each voxel is its own all the same
    for name in ["falling.nc", "nexus_xyz.nxs"] {
        let opened = plain(name);
        place(name, &opened, Unit::Millimetre, [11.0, 21.0, -32.0]);
        says(name, &opened.notes, "falls along z");
    }
    place(
        "dream3d.dream3d",
        &plain("dream3d.dream3d"),
        Unit::Voxel,
        [11.25, 21.125, -27.0],
    );
    let opened = plain("resolution.h5");
    assert_eq!(opened.provenance.spacing, [Origin::Default; 3]);
    says("resolution.h5", &opened.warnings, "resolution");
}

#[test]
fn sizes_that_cannot_be_told_are_not_taken_and_told() {
    let given = OpenOptions {
        spacing: Some([0.5, 0.25, 2.0]),
        unit: Some(Unit::Micrometre),
        ..OpenOptions::default()
    };
    for (name, says_so) in [
        ("size_no_order.h5", "--spacing 0.5,0.25,2 if"),
        ("size_bad_unit.h5", "voxel_size_unit: \"furlong\""),
        ("size_two.h5", "voxel_size_um and pixel_size_um"),
        ("size_groups.h5", "arrays of several sizes"),
        ("size_dpi.h5", "voxels per inch"),
    ] {
        let opened = plain(name);
        assert_eq!(opened.provenance.spacing, [Origin::Default; 3], "{name}");
        says(name, &opened.warnings, says_so);
        let opened = read(name, &given).unwrap();
        assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 2.0]);
        assert!(
            !opened.warnings.iter().any(|w| w.contains(says_so)),
            "{name}"
        );
    }
    says(
        "packed_coordinates.nc",
        &plain("packed_coordinates.nc").warnings,
        "voxel_size_mm (0.75 mm, 0.75 mm, 0.75 mm) contradicts the coordinates",
    );
    says(
        "size_group.h5",
        &plain("size_group.h5").warnings,
        "scale_factor (0.5) of the group / is not applied",
    );
}

#[test]
fn uneven_steps_need_a_size() {
    let given = OpenOptions {
        spacing: Some([0.5; 3]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    for name in ["no_uneven.nc", "no_irregular.mnc"] {
        let error = refused(name, &OpenOptions::default());
        assert!(
            error.contains("not evenly spaced") && error.contains("--spacing"),
            "{error}"
        );
        let opened = read(name, &given).unwrap();
        assert_eq!(opened.volume.header().placement.spacing, [0.5; 3]);
    }
}

#[test]
fn values_are_those_that_attributes_state() {
    let signed = |x, y, z| sample(x, y, z) - 100.0;
    let of = |x, y, z| signed(x, y, z) * 0.5;
    check(
        "scaling_factor.h5",
        &plain("scaling_factor.h5"),
        Dtype::F32,
        of,
    );
    for name in ["rescale.h5", "rescale_words.h5", "camel_scale.h5"] {
        check(name, &plain(name), Dtype::F32, |x, y, z| of(x, y, z) - 3.0);
        assert!(plain(name).scaled, "{name}");
    }
    assert!(!plain("size_um.h5").scaled);
    let packed = plain("cf_yzx.nc");
    check("cf_yzx.nc", &packed, Dtype::F32, |x, y, z| {
        match signed(x, y, z) {
            -100.0 => f64::NAN,
            v => v * 0.5 - 3.0,
        }
    });
    assert!(packed.values.unwrap().contains("scale_factor"));
    check(
        "unsigned.nc",
        &plain("unsigned.nc"),
        Dtype::U8,
        |x, y, z| sample(x, y, z) % 256.0,
    );
    let error = refused("no_nexus_scale.h5", &OpenOptions::default());
    assert!(error.contains("scaling_factor 0.5 and offset 3"), "{error}");
    let vague = plain("vague_scale.h5");
    check("vague_scale.h5", &vague, Dtype::U16, sample);
    says(
        "vague_scale.h5",
        &vague.warnings,
        "the attribute scale (0.5) is not applied",
    );
}

#[test]
fn values_of_any_convention_are_applied_or_told() {
    let signed = |x, y, z| sample(x, y, z) - 100.0;
    for (name, slope, intercept, by) in [
        ("intercept.h5", 1.0, -1000.0, "intercept"),
        ("fits_scale.h5", 0.5, -3.0, "BSCALE and BZERO"),
        ("calibration.h5", 0.5, -3.0, "calibration_slope"),
        ("openpmd_unit.h5", 0.5, 0.0, "unitSI"),
        ("nexus_factor.nxs", 0.5, 0.0, "scaling_factor"),
        ("nexus_offset.nxs", 1.0, -3.0, "offset"),
        (
            "nexus_named.nxs",
            0.5,
            -3.0,
            "ct_scaling_factor and ct_offset",
        ),
    ] {
        let opened = plain(name);
        check(name, &opened, Dtype::F32, |x, y, z| {
            slope * signed(x, y, z) + intercept
        });
        assert_eq!(opened.warnings, [""; 0], "{name}");
        assert!(opened.values.unwrap().contains(by), "{name}");
    }
    let vague = plain("vague_lists.h5");
    check("vague_lists.h5", &vague, Dtype::U16, sample);
    for part in [
        "calibration (1, 2) is not applied",
        "mu_scaling (4096) is not applied",
        "calibration_offset (3) is not applied",
    ] {
        says("vague_lists.h5", &vague.warnings, part);
    }
    for (name, part) in [
        ("no_nexus_fields.nxs", "scaling_factor 0.5 and offset -6"),
        ("no_nexus_fields.nxs", "ct_scaling_factor and ct_offset"),
        (
            "no_nexus_two.nxs",
            "ct_scaling_factor 0.25 and scaling_factor 0.5",
        ),
        ("no_nexus_list.nxs", "scaling_factor that is no number"),
    ] {
        let error = refused(name, &OpenOptions::default());
        assert!(error.contains(part), "{error}");
    }
}

/// Spacing, unit, origin and directions as the writers of images in HDF5 state them beside the array.
#[test]
fn images_of_itk_and_vtk_lie_where_they_say() {
    let columns = [[0.8, 0.6, 0.0], [-0.36, 0.48, 0.8], [0.48, -0.64, 0.6]];
    let usual = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mirrored = [[-1.0, 0.0, 0.0], usual[1], usual[2]];
    for (name, unit, origin, directions) in [
        (
            "itk_turned.h5",
            Unit::Millimetre,
            [10.0, 20.0, -30.0],
            columns,
        ),
        (
            "itk_mirrored.h5",
            Unit::Millimetre,
            [10.0, 20.0, -30.0],
            mirrored,
        ),
        // four voxels along x from the origin
        (
            "vtk_turned.vtkhdf",
            Unit::Voxel,
            [11.6, 21.2, -30.0],
            columns,
        ),
        (
            "vtk_cells.vtkhdf",
            Unit::Voxel,
            [10.25, 20.125, -29.0],
            usual,
        ),
    ] {
        let opened = plain(name);
        check(name, &opened, Dtype::U16, sample);
        let place = opened.volume.header().placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.5, 0.25, 2.0], unit),
            "{name}"
        );
        assert_eq!(
            (place.origin, place.directions),
            (origin, directions),
            "{name}"
        );
        assert_eq!(opened.provenance.spacing, [Origin::File; 3], "{name}");
        assert_eq!(opened.provenance.unit, Origin::Default, "{name}");
        assert_eq!(opened.provenance.origin, Origin::File, "{name}");
        assert_eq!(opened.warnings, [""; 0], "{name}");
    }
    let unsure = plain("turned_unsure.h5");
    says(
        "turned_unsure.h5",
        &unsure.warnings,
        "direction (-1, 0, 0, 0, 1, 0, 0, 0, 1) is not applied",
    );
    let channel = OpenOptions {
        channel: Some(1),
        ..OpenOptions::default()
    };
    let time = OpenOptions {
        time: Some(1),
        ..OpenOptions::default()
    };
    for (name, options) in [("itk_channels.h5", &channel), ("itk_times.h5", &time)] {
        let opened = read(name, options).unwrap();
        check(name, &opened, Dtype::U16, |x, y, z| sample(x, y, z) + 1.0);
        assert_eq!(opened.volume.header().placement.spacing, [0.5, 0.25, 2.0]);
    }
    for (name, part) in [
        ("no_itk_flat.h5", "one plane"),
        ("no_itk_sheared.h5", "--resample"),
        ("no_vtk_extent.vtkhdf", "WholeExtent of 0 18 0 16 0 2"),
    ] {
        let error = refused(name, &OpenOptions::default());
        assert!(error.contains(part), "{error}");
    }
}

/// Values from `low` to `5 low` for stored numbers from `from` to `to`.
fn of_minc(stored: f64, low: f64, [from, to]: [f64; 2]) -> f64 {
    low + (stored - from) / (to - from) * 4.0 * low
}

#[test]
fn images_of_minc_have_their_values_and_places() {
    let usual = [0.0, 400.0];
    let name = "slices.mnc";
    check(name, &plain(name), Dtype::F32, |x, y, z| {
        of_minc(sample(x, y, z), 1.0 + z as f64, usual)
    });
    place(name, &plain(name), Unit::Millimetre, [11.0, 21.0, -28.0]);
    let name = "rows.mnc";
    check(name, &plain(name), Dtype::F32, |x, y, z| {
        of_minc(sample(x, y, z), 1.0 + y as f64, usual)
    });
    place(name, &plain(name), Unit::Millimetre, [11.0, 21.0, -32.0]);
    let name = "columns.mnc";
    check(name, &plain(name), Dtype::F32, |x, y, z| {
        of_minc(sample(x, y, z), 1.0 + x as f64, usual)
    });
    // along y (0, 0.8, 0.6), along z (0, -0.6, 0.8)
    place(
        name,
        &plain(name),
        Unit::Millimetre,
        [11.0, 21.0 * 0.8 + 28.0 * 0.6, 21.0 * 0.6 - 28.0 * 0.8],
    );
    let name = "whole.mnc";
    check(name, &plain(name), Dtype::F32, |x, y, z| {
        of_minc(sample(x, y, z), 10.0, [0.0, 65_535.0])
    });
    let name = "times.mnc";
    let error = refused(name, &OpenOptions::default());
    assert!(
        error.contains("--time: found nothing, and 2 times"),
        "{error}"
    );
    let time = |time| OpenOptions {
        time: Some(time),
        ..OpenOptions::default()
    };
    for at in [0, 1] {
        let twice = 1.0 + f64::from(at);
        check(
            name,
            &read(name, &time(at)).unwrap(),
            Dtype::F32,
            |x, y, z| of_minc(sample(x, y, z), twice * (1.0 + z as f64), usual),
        );
    }
    let name = "range.mnc";
    let range = [50.0, 300.0];
    check(name, &plain(name), Dtype::F32, |x, y, z| {
        match sample(x, y, z) {
            v if !(50.0..=300.0).contains(&v) => f64::NAN,
            v => of_minc(v, 1.0 + z as f64, range),
        }
    });
}

#[test]
fn arrays_of_imaris_are_cut_to_the_image() {
    let name = "imaris.ims";
    let of = |level, channel| OpenOptions {
        level,
        channel,
        ..OpenOptions::default()
    };
    for (channel, more) in [(0, 0.0), (1, 1.0)] {
        let opened = read(name, &of(None, Some(channel))).unwrap();
        check(name, &opened, Dtype::U16, |x, y, z| sample(x, y, z) + more);
        let spacing = opened.volume.header().placement.spacing;
        assert_eq!(spacing, [0.5, 0.25, 2.0]);
        place(name, &opened, Unit::Micrometre, [11.25, 21.125, -27.0]);
        says(
            name,
            &opened.notes,
            "32 x 32 x 4 is padded: cut to 19 x 17 x 3",
        );
    }
    let coarse = read(name, &of(Some(1), Some(0))).unwrap();
    assert_eq!(coarse.volume.header().dims.0, [10, 9, 3]);
    assert_eq!(numbers(&coarse)[11], sample(2, 2, 0));
    says(name, &coarse.notes, "level 1 of 2");
    let named = OpenOptions {
        dataset: Some("DataSet/ResolutionLevel 0/TimePoint 0/Channel 1/Data".into()),
        ..OpenOptions::default()
    };
    check(name, &read(name, &named).unwrap(), Dtype::U16, |x, y, z| {
        sample(x, y, z) + 1.0
    });
    for (options, part) in [
        (
            of(None, None),
            "--channel: found nothing, and 2 channels in",
        ),
        (of(Some(2), Some(0)), "--level: found 2"),
        (
            OpenOptions {
                level: Some(0),
                ..named
            },
            "without --dataset",
        ),
    ] {
        let error = refused(name, &options);
        assert!(error.contains(part), "{error}");
    }
    let opened = plain("bdv.h5");
    check("bdv.h5", &opened, Dtype::U16, |x, y, z| {
        sample(x, y, z) + 40_000.0
    });
    says("bdv.h5", &opened.notes, "as BigDataViewer does");
    let error = refused("f16.h5", &of(Some(0), None));
    assert!(error.contains("--level"), "{error}");
}

#[test]
fn missing_chunks_are_counted() {
    for kind in ["old", "fixed", "extensible", "tree"] {
        let name = format!("partial_{kind}.h5");
        let opened = plain(&name);
        says(
            &name,
            &opened.notes,
            "6 of 8 chunks are missing and read as the fill value -7",
        );
        check(&name, &opened, Dtype::I16, |x, y, z| match y < 9 && z < 2 {
            true => sample(x, y, z) - 100.0,
            false => -7.0,
        });
    }
    says(
        "never.h5",
        &plain("never.h5").warnings,
        "no sample is there: all are the fill value",
    );
    assert!(
        !plain("bits12_nbit.h5")
            .notes
            .iter()
            .any(|n| n.contains("missing"))
    );
}

#[test]
fn blocks_in_front_are_passed_over() {
    let opened = plain("matlab.mat");
    check("matlab.mat", &opened, Dtype::U16, sample);
    says("matlab.mat", &opened.notes, "MATLAB");
    check(
        "block_8192.h5",
        &plain("block_8192.h5"),
        Dtype::U8,
        |x, y, z| sample(x, y, z) % 256.0,
    );
}

#[test]
fn what_is_no_volume_is_listed_with_its_reason() {
    let error = refused("no_volume.h5", &OpenOptions::default());
    for line in [
        "/outside: 3 x 17 x 19 of u16, no volume: its samples lie in other files",
        "/slice: 17 x 19 of u16, no volume: it is an image",
        "/colours: 3 x 4 x 5 x 3 of u8, no volume: 4 axes",
        "/angles: 7 of f64, no volume: it is a list",
        "/records: 3 x 4 x 5 of records of a, b, no volume",
        "/title: one element of text, no volume",
        "/virtual: not read: a virtual dataset",
        "/elsewhere: a link to /exchange/data of another file, u16.h5",
        "/nowhere: a link to /nothing, which is not there",
    ] {
        assert!(error.contains(line), "{line}: {error}");
    }
    for (name, part) in [
        ("elsewhere", "open u16.h5 with --dataset /exchange/data"),
        ("/nowhere", "which is not there"),
        ("virtual", "virtual dataset"),
        ("outside", "external storage"),
        ("colours", "DIMENSION_LABELS"),
        ("nothing", "/slice: 17 x 19"),
    ] {
        let options = OpenOptions {
            dataset: Some(name.into()),
            ..OpenOptions::default()
        };
        let error = refused("no_volume.h5", &options);
        assert!(error.contains(part), "{name}: {error}");
    }
}
