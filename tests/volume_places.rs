//! NIfTI and VTK image data: which of several statements of a place and of several parts is taken, and what is told of
//! the others.

mod volume_common;

use alvis::Error;
use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, OpenOptions};
use volume_common::{all, floats, open_as, opened, says};

const EIGHT: [u8; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// A NIfTI-1 of `dim` with u8 samples that count up; numbers are put into the header by place.
fn nifti(dim: &[i16], shorts: &[(usize, i16)], floats: &[(usize, &[f32])], units: u8) -> Vec<u8> {
    let mut head = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (i, n) in [&[dim.len() as i16], dim].concat().into_iter().enumerate() {
        put(40 + 2 * i, &n.to_le_bytes());
    }
    for &(at, n) in [(70, 2), (72, 8)].iter().chain(shorts) {
        put(at, &n.to_le_bytes());
    }
    for (at, values) in [(108, &[352f32][..])].iter().chain(floats) {
        for (i, v) in values.iter().enumerate() {
            put(at + 4 * i, &v.to_le_bytes());
        }
    }
    put(123, &[units]);
    put(344, b"n+1\0");
    let voxels: i64 = dim.iter().map(|n| i64::from(*n)).product();
    head.extend((0..voxels).map(|v| v as u8));
    head
}

const QFORM: usize = 252;
const SFORM: usize = 254;
const PIXDIM: usize = 76;
const ROWS: usize = 280;

#[test]
fn nifti_takes_the_form_that_is_sound() {
    let read = |shorts: &[(usize, i16)], floats: &[(usize, &[f32])]| {
        let bytes = nifti(&[2, 2, 2], shorts, floats, 2);
        open_as("v.nii", &bytes, &OpenOptions::default()).unwrap()
    };
    let pixdim: (usize, &[f32]) = (PIXDIM, &[1.0, 0.05, 0.7, 11.0]);
    let flat: (usize, &[f32]) = (
        ROWS,
        &[-0.05, 0.0, 0.0, 5.0, 0.0, 0.7, 0.0, 6.0, 0.0, 0.0, 0.0, 7.0],
    );
    let half_turn: (usize, &[f32]) = (256, &[0.0, 0.0, 1.0, 1.0, 2.0, 3.1]);
    for (shorts, floats, directions, origin) in [
        (&[(SFORM, 1)][..], &[pixdim, flat][..], [1.0, 1.0], [0.0; 3]),
        (
            &[(SFORM, 1), (QFORM, 1)],
            &[pixdim, flat, half_turn],
            [-1.0, -1.0],
            [1.0, 2.0, 3.1],
        ),
        (
            &[(QFORM, 1)],
            &[pixdim, (256, &[2.0])],
            [1.0, 1.0],
            [0.0; 3],
        ),
    ] {
        let opened = read(shorts, floats);
        let place = opened.volume.header().placement;
        // decimals as the single-precision numbers read
        assert_eq!(
            (place.spacing, place.unit),
            ([0.05, 0.7, 11.0], Unit::Millimetre)
        );
        assert_eq!(place.origin, origin);
        for axis in 0..2 {
            assert!((place.directions[axis][axis] - directions[axis]).abs() < 1e-9);
        }
        assert!(
            says(&opened.warnings, "is not taken"),
            "{:?}",
            opened.warnings
        );
        assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
    }
    // nothing is sound: no size, and --spacing is the way out
    let bytes = nifti(&[2, 2, 2], &[(SFORM, 1)], &[], 2);
    let opened = open_as("v.nii", &bytes, &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().placement.unit, Unit::Voxel);
    assert!(says(&opened.warnings, "--spacing"));
    let options = OpenOptions {
        spacing: Some([0.7; 3]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    let opened = open_as("v.nii", &bytes, &options).unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [0.7; 3]);
}

#[test]
fn nifti_forms_that_contradict_each_other_are_told() {
    let rows = |x: f32| [x, 0.0, 0.0, 5.0, 0.0, 0.5, 0.0, 6.0, 0.0, 0.0, 0.5, 7.0];
    let pixdim: (usize, &[f32]) = (PIXDIM, &[1.0, 0.5, 0.5, 0.5]);
    let read = |rows: &[f32], shorts: &[(usize, i16)], quaternion: &[f32]| {
        let floats = [pixdim, (ROWS, rows), (256, quaternion)];
        open_as(
            "v.nii",
            &nifti(&[2, 2, 2], shorts, &floats, 2),
            &OpenOptions::default(),
        )
        .unwrap()
    };
    let both = [(SFORM, 1), (QFORM, 1)];
    let agree = read(&rows(0.5), &both, &[0.0, 0.0, 0.0, 5.0, 6.0, 7.0]);
    assert_eq!(agree.warnings, [""; 0]);
    for (rows, shorts, quaternion) in [
        (rows(0.6), &both[..], [0.0, 0.0, 0.0, 5.0, 6.0, 7.0]),
        (rows(-0.5), &both, [0.0, 0.0, 0.0, 5.0, 6.0, 7.0]),
        (rows(0.5), &both, [0.0, 0.0, 0.0, 5.0, 6.0, 8.0]),
        (rows(0.6), &both[..1], [0.0; 6]),
    ] {
        let opened = read(&rows, shorts, &quaternion);
        assert!(
            says(&opened.warnings, "contradict"),
            "{rows:?} {quaternion:?}"
        );
        assert_eq!(opened.volume.header().placement.origin, [5.0, 6.0, 7.0]);
    }
}

#[test]
fn nifti_units_and_scales() {
    let sized: (usize, &[f32]) = (PIXDIM, &[1.0, 0.5, 0.25, 2.0]);
    for (code, unit, from, warned) in [
        (1, Unit::Metre, Origin::File, false),
        (2 + 8, Unit::Millimetre, Origin::File, false),
        (3, Unit::Micrometre, Origin::File, false),
        (0, Unit::Millimetre, Origin::Default, false),
        (7, Unit::Millimetre, Origin::Default, true),
    ] {
        let opened = opened("v.nii", &[&nifti(&[2, 2, 2], &[], &[sized], code)]);
        assert_eq!(opened.volume.header().placement.unit, unit, "{code}");
        assert_eq!(
            (opened.provenance.unit, says(&opened.warnings, "not known")),
            (from, warned)
        );
    }
    let scaled = |slope: f32, inter: f32| {
        let scale: (usize, &[f32]) = (112, &[slope, inter]);
        nifti(&[2, 2, 2], &[], &[sized, scale], 2)
    };
    let opened = opened("v.nii", &[&scaled(0.1, 0.0)]);
    assert_eq!(
        opened.values.as_deref(),
        Some("0.1 * stored + 0 (scl_slope and scl_inter)")
    );
    assert_eq!(floats(&opened)[3], 0.3);
    // NaN is what nibabel leaves where nothing is scaled
    let plain = open_as(
        "v.nii",
        &scaled(f32::NAN, f32::NAN),
        &OpenOptions::default(),
    )
    .unwrap();
    assert_eq!(plain.values, None);
}

/// nibabel refuses such scales too.
#[test]
fn nifti_scales_that_are_no_numbers_are_refused_with_a_way_out() {
    let sized: (usize, &[f32]) = (PIXDIM, &[1.0, 0.5, 0.25, 2.0]);
    for scale in [[f32::INFINITY, 0.0], [2.0, f32::NAN], [2.0, f32::INFINITY]] {
        let bytes = nifti(&[2, 2, 2], &[], &[sized, (112, &scale)], 2);
        let error = open_as("v.nii", &bytes, &OpenOptions::default())
            .unwrap_err()
            .to_string();
        let way = "--dims 2,2,2 --dtype u8 --endian little --offset 352 --spacing 0.5,0.25,2";
        assert!(error.contains(way), "{error}");
        let options = OpenOptions {
            dims: Some([2; 3]),
            dtype: Some(Dtype::U8),
            offset: Some(352),
            spacing: Some([0.5, 0.25, 2.0]),
            unit: Some(Unit::Millimetre),
            ..OpenOptions::default()
        };
        let opened = open_as("v.nii", &bytes, &options).unwrap();
        assert_eq!(all(&*opened.volume).unwrap(), EIGHT);
    }
}

#[test]
fn nifti_times_and_components_are_chosen() {
    let bytes = nifti(&[2, 2, 2, 3, 2], &[], &[], 2);
    let part = |time, channel| OpenOptions {
        time,
        channel,
        ..OpenOptions::default()
    };
    for (time, channel, first) in [(0, 0, 0), (2, 0, 16), (1, 1, 32)] {
        let opened = open_as("v.nii", &bytes, &part(Some(time), Some(channel))).unwrap();
        let expected: Vec<u8> = (first..first + 8).collect();
        assert_eq!(all(&*opened.volume).unwrap(), expected);
        assert_eq!(opened.notes, [""; 0]);
    }
    for (time, channel, option) in [
        (None, Some(0), "--time"),
        (Some(3), Some(0), "--time"),
        (Some(0), None, "--channel"),
        (Some(0), Some(2), "--channel"),
    ] {
        let error = open_as("v.nii", &bytes, &part(time, channel)).unwrap_err();
        assert!(
            matches!(&error, Error::Usage { option: o, .. } if o == option),
            "{error}"
        );
    }
    // one time is no choice
    let one = nifti(&[2, 2, 2, 1, 1], &[], &[], 2);
    assert_eq!(all(&*opened("v.nii", &[&one]).volume).unwrap(), EIGHT);
    assert!(open_as("v.nii", &one, &part(Some(1), None)).is_err());
}

fn vti(attributes: &str, extent: &str, data: &str) -> Vec<u8> {
    format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"{extent}\" \
         {attributes}><Piece Extent=\"{extent}\">{data}</Piece></ImageData></VTKFile>"
    )
    .into_bytes()
}

fn array(name: &str, more: &str, first: u32) -> String {
    let values: Vec<String> = (first..first + 8).map(|v| v.to_string()).collect();
    format!(
        "<DataArray type=\"UInt8\" Name=\"{name}\" format=\"ascii\" {more}>{}</DataArray>",
        values.join(" ")
    )
}

#[test]
fn vti_cells_are_voxels_half_a_step_off() {
    // as VTK 9 writes image data with cell scalars
    let data = format!(
        "<PointData></PointData><CellData Scalars=\"v\">{}</CellData>",
        array("v", "", 0)
    );
    let place = "Origin=\"10 20 30\" Spacing=\"0.5 1 2\"";
    let opened = opened("v.vti", &[&vti(place, "4 6 0 2 0 2", &data)]);
    let header = opened.volume.header();
    assert_eq!(
        (header.dims.0, header.placement.spacing),
        ([2; 3], [0.5, 1.0, 2.0])
    );
    assert_eq!(header.placement.origin, [12.25, 20.5, 31.0]);
    assert_eq!(all(&*opened.volume).unwrap(), EIGHT);
}

#[test]
fn vti_arrays_are_chosen_by_name() {
    let ghost = array("vtkGhostType", "", 0);
    let two = format!(
        "<PointData Scalars=\"b\">{ghost}{}{}</PointData>",
        array("a", "", 0),
        array("b", "", 8)
    );
    let file = vti("", "0 1 0 1 0 1", &two);
    let dataset = |name: &str| OpenOptions {
        dataset: Some(name.into()),
        ..OpenOptions::default()
    };
    let active = opened("v.vti", &[&file]);
    assert_eq!(all(&*active.volume).unwrap()[0], 8);
    assert!(
        says(&active.notes, "PointData/a, PointData/b"),
        "{:?}",
        active.notes
    );
    // nothing is from the file that it does not state
    assert_eq!(active.provenance.spacing, [Origin::Default; 3]);
    for name in ["a", "PointData/a"] {
        assert_eq!(
            all(&*open_as("v.vti", &file, &dataset(name)).unwrap().volume).unwrap()[0],
            0
        );
    }
    let error = open_as("v.vti", &file, &dataset("c"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("--dataset") && error.contains("PointData/a"),
        "{error}"
    );
    let none = two.replace(" Scalars=\"b\"", "");
    let error = open_as(
        "v.vti",
        &vti("", "0 1 0 1 0 1", &none),
        &OpenOptions::default(),
    );
    assert!(error.unwrap_err().to_string().contains("--dataset"));
    let only = format!("<PointData>{ghost}</PointData>");
    let error = open_as(
        "v.vti",
        &vti("", "0 1 0 1 0 1", &only),
        &OpenOptions::default(),
    );
    assert!(error.unwrap_err().to_string().contains("without an array"));
}

#[test]
fn vti_axes_that_are_mirrored_or_sheared() {
    let data = format!("<PointData>{}</PointData>", array("v", "", 0));
    let negative = vti(
        "Origin=\"1 2 3\" Spacing=\"-0.5 1 2\"",
        "2 3 0 1 0 1",
        &data,
    );
    let place = opened("v.vti", &[&negative]).volume.header().placement;
    assert_eq!(
        (place.spacing, place.directions[0]),
        ([0.5, 1.0, 2.0], [-1.0, 0.0, 0.0])
    );
    assert_eq!(place.origin, [0.0, 2.0, 3.0]);
    let sheared = vti(
        "Direction=\"1 0 0 0 1 0.3 0 0 0.9539392\"",
        "0 1 0 1 0 1",
        &data,
    );
    let error = open_as("v.vti", &sheared, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a sheared grid"), "{error}");
    let three = array("v", "NumberOfComponents=\"3\"", 0);
    let three = vti(
        "",
        "0 1 0 1 0 1",
        &format!("<PointData>{three}</PointData>"),
    );
    let error = open_as("v.vti", &three, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("3 components"), "{error}");
}

/// A gantry tilt: each slice lies a voxel further along y than the one before.
#[test]
fn sheared_axes_are_brought_to_right_angles_if_asked() {
    let resample = OpenOptions {
        resample: true,
        ..OpenOptions::default()
    };
    let rows: (usize, &[f32]) = (
        ROWS,
        &[1.0, 0.0, 0.0, 5.0, 0.0, 0.5, 0.5, 6.0, 0.0, 0.0, 2.0, 7.0],
    );
    let tilted = nifti(&[2, 2, 2], &[(SFORM, 1)], &[rows], 2);
    let refused = open_as("v.nii", &tilted, &OpenOptions::default()).unwrap_err();
    assert!(refused.to_string().contains("--resample"), "{refused}");
    let opened = open_as("v.nii", &tilted, &resample).unwrap();
    let header = opened.volume.header();
    assert_eq!(header.dims.0, [2, 3, 2]);
    let place = header.placement;
    assert_eq!(
        (place.spacing, place.origin),
        ([1.0, 0.5, 2.0], [5.0, 6.0, 7.0])
    );
    assert_eq!(place.shear(), None);
    let expected = [0, 1, 2, 3, 0, 0, 0, 0, 4, 5, 6, 7];
    assert_eq!(all(&*opened.volume).unwrap(), expected);
    assert!(
        says(&opened.notes, "2 x 3 x 2 voxels") && says(&opened.notes, "slices is 0"),
        "{:?}",
        opened.notes
    );
    // without a shear there is nothing to do
    let straight = nifti(&[2, 2, 2], &[], &[(PIXDIM, &[1.0, 0.5, 0.25, 2.0])], 2);
    let same = open_as("v.nii", &straight, &resample).unwrap();
    assert_eq!(all(&*same.volume).unwrap(), EIGHT);
}
