//! Cells that labels give: whole trees of files, of many volumes. Parts read the labels of their own slices.

use super::bytes::{cropped_cylinders, of_seed, random_dims, shapes, sparse};
use super::{in_parts, plan};
use crate::common::volumes::{Random, foam, late_joins, placed, samples, volume};
use crate::common::{assert_same_files, converted, files, options};
use alvis::convert::parts::{Merged, merge_parts, work_on_part};
use alvis::convert::{CellRows, ConvertOptions, LabelRows, LabelSums, LabelVolume, Labels};
use alvis::grid::{Ambiguous, Dims, Placement};
use alvis::manifest::{Encoding, Layout, PartsBy};
use alvis::progress::Quiet;
use alvis::volume::{MemoryVolume, Volume};
use std::sync::Arc;

/// The labels, read before, and the same to be read by parts.
pub fn given(dims: [u32; 3], labels: Vec<u32>) -> [Labels; 2] {
    let dims = Dims(dims);
    let labels = MemoryVolume::new(dims, Placement::default(), labels).unwrap();
    let dir = std::env::temp_dir();
    let (rows, checksum) = CellRows::of_labels(&labels, dims, &dir, &Quiet).unwrap();
    let sums = LabelSums::of(&labels, dims, &Quiet).unwrap();
    assert_eq!(
        sums,
        LabelSums {
            largest: rows.largest(),
            checksum
        }
    );
    let file = "labels.npy".to_owned();
    let on_demand = LabelVolume {
        volume: Arc::new(labels),
        largest: sums.largest,
        stamp: Default::default(),
    };
    [rows.into(), LabelRows::OnDemand(Box::new(on_demand))].map(|rows| Labels {
        file: file.clone(),
        checksum: sums.checksum.clone(),
        rows,
    })
}

/// Compares 1, 2, 3, 7 parts and one for each layer with the single run; returns how many cells and openings there are.
pub fn same_in_parts(
    volume: &dyn Volume,
    labels: Vec<u32>,
    options: &ConvertOptions,
    what: &str,
) -> [u64; 2] {
    let crop = options.crop.as_ref();
    let slices = crop.map_or(volume.header().dims.0[2], |crop| crop.z.end - crop.z.start);
    let [read, on_demand] = given(volume.header().dims.0, labels).map(|labels| ConvertOptions {
        labels: Some(labels),
        ..options.clone()
    });
    let (whole, report) = converted(volume, &read);
    let whole = files(whole.path());
    let layers = (slices - 1).div_ceil(options.macrocube[2]);
    let mut counts = vec![1, 2, 3, 7, layers];
    counts.retain(|&parts| parts <= layers);
    counts.dedup();
    for parts in counts {
        let what = format!("{what} in {parts} of {layers}, {:?}", report.totals);
        assert_same_files(&whole, &in_parts(volume, &on_demand, parts), &what);
    }
    [report.totals.cells, report.totals.necks]
}

/// Labels in blocks of voxels, in no order; some of them none.
pub fn blocks(dims: [u32; 3], size: u32, seed: u64) -> Vec<u32> {
    samples(dims, |place| {
        let [x, y, z] = place.map(|v| u64::from(v / size));
        let mixed = (x + 31 * y + 997 * z + seed).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> 59) as u32 * 1000 / 7
    })
}

/// Labels that lie in many places each, and far from each other.
pub fn scattered(dims: [u32; 3], seed: u64) -> Vec<u32> {
    let mut random = Random(seed);
    samples(dims, |_| (random.bits() % 11) as u32)
}

#[test]
fn two_parts_of_a_labelled_foam_are_the_single_run() {
    let dims = [30, 26, 40];
    let volume = placed(dims, foam(dims, 3));
    let options = options([16, 9, 7]);
    let [cells, necks] = same_in_parts(&volume, blocks(dims, 7, 1), &options, "labelled foam");
    assert!(cells > 20 && necks > 50, "{cells} cells, {necks} necks");
}

#[test]
fn parts_of_labelled_foams_are_the_single_run() {
    let dims = [30, 27, 44];
    let volume = placed(dims, foam(dims, 4));
    let options = options([16, 9, 6]);
    for (labels, what) in [
        (blocks(dims, 5, 2), "blocks"),
        (scattered(dims, 4), "scattered"),
        (samples(dims, |[_, _, z]| 60 - z), "slices, from above"),
        (samples(dims, |[x, ..]| x / 9 + 1), "columns"),
        (samples(dims, |_| 5), "all one"),
    ] {
        same_in_parts(&volume, labels, &options, what);
    }
    let join = ConvertOptions {
        ambiguous: Ambiguous::Join,
        ..options
    };
    same_in_parts(&volume, blocks(dims, 17, 3), &join, "large blocks");
}

#[test]
fn parts_of_labelled_noise_are_the_single_run() {
    for (share, seed) in [(0.1, 1), (0.5, 2), (0.9, 3)] {
        let dims = [23, 19, 36];
        let volume = volume(dims, sparse(dims, share, seed));
        for labels in [blocks(dims, 4, seed), scattered(dims, seed)] {
            let what = format!("labelled noise of {share}");
            same_in_parts(&volume, labels, &options([7, 7, 7]), &what);
        }
    }
}

#[test]
fn parts_of_labelled_shapes_are_the_single_run() {
    let dims = [24, 24, 40];
    for (values, what) in shapes(dims) {
        let labels = blocks(dims, 9, 5);
        same_in_parts(&volume(dims, values), labels, &options([8, 8, 8]), what);
    }
    let (dims, values) = late_joins();
    let labels = blocks(dims, 3, 6);
    same_in_parts(
        &volume(dims, values),
        labels,
        &options([16, 16, 5]),
        "late joins",
    );
    for height in [1, 2, 3] {
        let dims = [17, 13, 11];
        let volume = volume(dims, foam(dims, 9));
        let what = format!("layers of {height}");
        same_in_parts(&volume, scattered(dims, 8), &options([5, 7, height]), &what);
    }
}

#[test]
fn parts_of_labels_with_all_options_are_the_single_run() {
    let dims = [30, 28, 40];
    let volume = placed(dims, foam(dims, 6));
    for (encoding, layout, regions) in cropped_cylinders(dims)
        .into_iter()
        .zip([
            (Encoding::default(), Layout::Merged),
            (Encoding::Meshopt, Layout::Auto),
        ])
        .map(|(regions, (encoding, layout))| (encoding, layout, regions))
    {
        let options = ConvertOptions {
            min_voxels: 4,
            cap: true,
            parquet: true,
            encoding,
            layout,
            ..regions
        };
        for labels in [blocks(dims, 6, 1), scattered(dims, 2)] {
            same_in_parts(&volume, labels, &options, "labelled region");
        }
    }
}

#[test]
fn parts_of_random_labelled_volumes_are_the_single_run() {
    let mut openings = 0;
    for seed in 0..24u64 {
        let mut random = Random(seed);
        let dims = random_dims(&mut random);
        let values = match seed % 3 {
            0 => foam(dims, seed),
            _ => sparse(dims, random.unit(), seed),
        };
        let volume = of_seed(seed, dims, values);
        let options = ConvertOptions {
            cap: seed % 3 == 0,
            min_voxels: seed % 4 * 3,
            ..options([0; 3].map(|_| 1 + (random.bits() % 9) as u32))
        };
        let labels = match seed % 2 {
            0 => blocks(dims, 1 + (random.bits() % 6) as u32, seed),
            _ => scattered(dims, seed),
        };
        let what = format!("labelled seed {seed}");
        let [_, necks] = same_in_parts(&volume, labels, &options, &what);
        openings += necks;
    }
    assert!(openings > 200, "{openings}");
}

/// What is in no cell is one more, and counted.
#[test]
fn voxels_in_no_cell_are_counted_over_all_parts() {
    let dims = [20, 18, 24];
    let volume = placed(dims, foam(dims, 9));
    let labels = samples(dims, |[x, ..]| u32::from(x > 9));
    let [_, on_demand] = given(dims, labels);
    let options = ConvertOptions {
        labels: Some(on_demand),
        ..options([8, 8, 6])
    };
    let (whole, _) = converted(&volume, &options);
    let manifest = crate::common::set::manifest(whole.path());
    let Some(PartsBy::Labels { unlabelled, .. }) = manifest.cells else {
        panic!("{:?}", manifest.cells);
    };
    assert!(
        unlabelled.is_some_and(|voxels| voxels > 1000),
        "{unlabelled:?}"
    );
    let made = in_parts(&volume, &options, 4);
    assert_same_files(&files(whole.path()), &made, "in no cell");
}

#[test]
fn a_pore_with_a_label_below_0_is_refused_by_its_part() {
    let dims = [20, 18, 24];
    let volume = placed(dims, foam(dims, 9));
    let mut labels = vec![1i16; 20 * 18 * 24];
    let mut values = vec![0; labels.len()];
    volume.read_box(0..20, 0..18, 0..24, &mut values).unwrap();
    let (pore, wall) = (20 * 18 * 15, 20 * 18 * 3);
    let at = |first: usize, below: bool| {
        first
            + values[first..]
                .iter()
                .position(|&v| (v < 128) == below)
                .unwrap()
    };
    let (pore, wall) = (at(pore, true), at(wall, false));
    (labels[pore], labels[wall]) = (-3, -4);
    let [read, _] = given(dims, vec![1; labels.len()]);
    let labels = LabelVolume {
        volume: Arc::new(MemoryVolume::new(Dims(dims), Placement::default(), labels).unwrap()),
        largest: 1,
        stamp: Default::default(),
    };
    let options = ConvertOptions {
        labels: Some(Labels {
            rows: LabelRows::OnDemand(Box::new(labels)),
            ..read
        }),
        ..options([8, 8, 6])
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path();
    plan(&volume, &options, out, 4);
    let work = |part| work_on_part(&volume, &options, out, part, &Quiet);
    (0..4).for_each(|part| work(part).unwrap());
    assert!(matches!(
        merge_parts(&volume, &options, out, &Quiet),
        Ok(Merged::ToRun("mesh", _))
    ));
    work(0).unwrap();
    let refused = work(2).unwrap_err().to_string();
    let place = [pore % 20, pore / 20 % 18, pore / 360]
        .map(|v| v.to_string())
        .join(", ");
    let expected = format!("label -3 at voxel {place}, which is below");
    assert!(refused.contains(&expected), "{refused}");
}
