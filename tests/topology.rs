//! The surface's topology: counts of 400 volumes that were worked out from the rule alone, the table
//! of cases by what it does, and the laws on grids that are known to be hard.
//!
//! The volumes come from the shared data (`ALVIS_DATA`, by default `../shared/data`).

mod common;

use alvis::convert::ConvertOptions;
use alvis::grid::{Ambiguous, Dims, Placement};
use alvis::volume::{MemoryVolume, OpenOptions, Volume, Voxel};
use common::set::{Surface, manifest, table, weld};
use common::volumes::{padded, volume};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

const RULES: [Ambiguous; 2] = [Ambiguous::Separate, Ambiguous::Join];

fn options(threshold: f64, ambiguous: Ambiguous, cap: bool) -> ConvertOptions {
    ConvertOptions {
        threshold,
        ambiguous,
        cap,
        macrocube: [3, 2, 4],
        threads: 1,
        ..ConvertOptions::default()
    }
}

fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// One conversion with everything that is compared.
struct Made {
    surface: Surface,
    totals: alvis::manifest::Totals,
    /// Sums of the Euler characteristics in the tables of objects and cells.
    euler: [i64; 2],
}

/// Converts, verifies against the volume, and checks the laws that hold for every volume.
fn make<T: Voxel>(volume: &MemoryVolume<T>, options: &ConvertOptions) -> Made {
    let (dir, _) = common::converted(volume, options);
    let report = common::verified(dir.path(), Some(volume));
    let surface = weld(dir.path());
    let totals = manifest(dir.path()).totals;
    assert_eq!(totals.surfaces + 1, totals.objects + totals.cells);
    let open = surface.open_edges();
    if options.cap {
        assert_eq!(open, BTreeSet::new());
    }
    let on_a_face = |edge: &[[i32; 3]; 2]| {
        (0..3).any(|a| {
            let last = 256 * (volume.header().dims.0[a] as i32 - 1);
            edge[0][a] == edge[1][a] && (edge[0][a] == 0 || edge[0][a] == last)
        })
    };
    assert!(open.iter().all(on_a_face), "a hole: {open:?}");
    for (name, found, stated, verified) in [
        (
            "triangles",
            surface.triangles.len() as u64,
            totals.triangles,
            report.triangles,
        ),
        (
            "vertices",
            surface.normals.len() as u64,
            totals.vertices,
            report.vertices,
        ),
        (
            "border edges",
            open.len() as u64,
            totals.border_edges,
            report.border_edges,
        ),
    ] {
        assert_eq!([stated, verified], [found; 2], "{name}");
    }
    assert_eq!(
        [totals.euler_characteristic, report.euler_characteristic],
        [surface.euler(); 2]
    );
    let above: Vec<bool> = volume
        .samples()
        .iter()
        .map(|v| v.to_f64() >= options.threshold)
        .collect();
    let dims = volume.header().dims.0.map(|n| n as usize);
    let counts = common::reference::components(dims, &above, options.ambiguous);
    assert_eq!((totals.objects, totals.cells), counts);
    let euler =
        ["objects.csv", "cells.csv"].map(|t| table(dir.path(), t).sum("euler_characteristic"));
    Made {
        surface,
        totals,
        euler,
    }
}

/// The laws for one volume: open and capped, and under both rules.
fn obeys_the_laws<T: Voxel>(volume: &MemoryVolume<T>, threshold: f64) {
    for rule in RULES {
        let open = make(volume, &options(threshold, rule, false));
        let components = open.surface.components() as u64;
        assert_eq!(components, open.totals.surfaces);
        let capped = make(volume, &options(threshold, rule, true));
        let ids = |t: &alvis::manifest::Totals| [t.objects, t.cells, t.surfaces];
        assert_eq!(
            ids(&open.totals),
            ids(&capped.totals),
            "ids are those of the open box"
        );
        for (triangle, ids) in &open.surface.triangles {
            assert_eq!(capped.surface.triangles.get(triangle), Some(ids));
        }
    }
}

/// A case of the golden volumes in one form: `open` or `padded_below`.
fn expect(made: &Made, form: &Value, ids_of_form: bool) {
    let t = &made.totals;
    let edges = (3 * t.triangles + t.border_edges) / 2;
    let mut pairs = vec![
        ("vertices", t.vertices as i64),
        ("triangles", t.triangles as i64),
        ("edges", edges as i64),
        ("border_edges", t.border_edges as i64),
        ("surfaces", made.surface.components() as i64),
        ("chi_surface", t.euler_characteristic),
        ("chi_object_6_18", made.euler[0]),
        ("objects6", t.objects as i64),
    ];
    if ids_of_form {
        pairs.extend([("cells18", t.cells as i64), ("surfaces", t.surfaces as i64)]);
    }
    for (name, found) in pairs {
        assert_eq!(Some(found), form[name].as_i64(), "{name}");
    }
}

/// A capped volume is the volume in a border of below: the same triangles, one voxel further.
fn expect_cap(case: &Value, dims: [u32; 3], bits: &[u8]) {
    let form = &case["padded_below"];
    let capped = make(
        &volume(dims, bits.to_vec()),
        &options(0.5, Ambiguous::Separate, true),
    );
    // the ids of a capped set are those of the open box, so its cells are not the padded volume's
    expect(&capped, form, false);
    let (outer, samples) = padded(dims, bits, 0);
    let whole = make(
        &volume(outer, samples),
        &options(0.5, Ambiguous::Separate, false),
    );
    expect(&whole, form, true);
    let moved = capped.surface.mapped(false, |p| p.map(|v| v + 256));
    assert!(moved == whole.surface.mapped(false, |p| p));
}

/// Joining is separating the complement and turning the triangles round.
fn expect_join(form: &Value, dims: [u32; 3], bits: &[u8], separate: &Made) {
    let complement = bits.iter().map(|b| 1 - b).collect();
    let join = make(
        &volume(dims, complement),
        &options(0.5, Ambiguous::Join, false),
    );
    assert!(join.surface.mapped(true, |p| p) == separate.surface.mapped(false, |p| p));
    assert_eq!(join.totals.volume6, -separate.totals.volume6);
    assert_eq!(Some(join.totals.cells), form["objects6"].as_u64());
    assert_eq!(Some(join.totals.objects), form["cells18"].as_u64());
    assert_eq!(join.euler, [separate.euler[1], separate.euler[0]]);
}

#[test]
fn golden_volumes_have_the_counts_of_the_rule() {
    let Some(data) = common::data("the golden volumes") else {
        return;
    };
    let text = std::fs::read_to_string(data.join("topology/golden_topology_6_18.jsonl")).unwrap();
    let mut count = 0;
    for (number, line) in text.lines().enumerate() {
        let case: Value = serde_json::from_str(line).unwrap();
        let dims = [0, 1, 2].map(|a| case["shape"][a].as_u64().unwrap() as u32);
        let bits: Vec<u8> = case["bits"]
            .as_str()
            .unwrap()
            .bytes()
            .map(|b| b - b'0')
            .collect();
        let run = || {
            let open = make(
                &volume(dims, bits.clone()),
                &options(0.5, Ambiguous::Separate, false),
            );
            expect(&open, &case["open"], true);
            expect_cap(&case, dims, &bits);
            expect_join(&case["open"], dims, &bits, &open);
        };
        std::panic::catch_unwind(run).unwrap_or_else(|_| panic!("golden volume {number}: {case}"));
        count += 1;
    }
    assert_eq!(count, 400);
}

/// Corner c of a cube is at (c & 1, c >> 1 & 1, c >> 2).
fn corners(case: u32) -> Vec<u8> {
    (0..8).map(|c| (case >> c & 1) as u8).collect()
}

/// What a set of triangles leaves open, as directed edges.
fn outline(triangles: &[[[i32; 3]; 3]]) -> BTreeSet<[[i32; 3]; 2]> {
    let edges = triangles
        .iter()
        .flat_map(|t| (0..3).map(|i| [t[i], t[(i + 1) % 3]]));
    let all: BTreeSet<_> = edges.collect();
    all.iter()
        .filter(|[a, b]| !all.contains(&[*b, *a]))
        .copied()
        .collect()
}

#[test]
fn each_of_the_256_cases_does_what_the_reference_table_does() {
    let Some(data) = common::data("the table of cases") else {
        return;
    };
    let table = json(&data.join("topology/mc_table_sep_6_18.json"));
    let middle = |e: usize| -> [i32; 3] {
        let edge = &table["edges"][e];
        let low = edge["lo"].as_u64().unwrap() as i32;
        let mut p = [low & 1, low >> 1 & 1, low >> 2].map(|v| 256 * v);
        p[edge["axis"].as_u64().unwrap() as usize] += 128;
        p
    };
    let mut triangles = 0;
    for case in 0..256u32 {
        let wanted: Vec<[[i32; 3]; 3]> = table["tris"][case as usize]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| [0, 1, 2].map(|i| middle(t[i].as_u64().unwrap() as usize)))
            .collect();
        let separate = make(
            &volume([2; 3], corners(case)),
            &options(0.5, Ambiguous::Separate, false),
        );
        let join = make(
            &volume([2; 3], corners(255 - case)),
            &options(0.5, Ambiguous::Join, false),
        );
        assert_eq!(
            separate.surface.triangles.len(),
            wanted.len(),
            "case {case}"
        );
        triangles += wanted.len();
        let open = outline(&wanted);
        assert!(!open.is_empty() || wanted.is_empty());
        // equal outlines have equal loops with equal orientation
        assert_eq!(separate.surface.open_edges(), open, "case {case}");
        let turned = open.iter().map(|[a, b]| [*b, *a]).collect();
        assert_eq!(join.surface.open_edges(), turned, "case {case}");
        assert!(join.surface.mapped(true, |p| p) == separate.surface.mapped(false, |p| p));
    }
    assert_eq!(triangles, 820);
}

#[test]
fn hard_cubes_obey_the_laws() {
    let Some(data) = common::data("the hard cubes") else {
        return;
    };
    let file = json(&data.join("topology/cgal_tmc_cases.json"));
    let cases = file["cases"].as_object().unwrap();
    assert_eq!(cases.len(), 27);
    for (name, case) in cases {
        let values: Vec<f64> = case["values"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_f64)
            .collect();
        let iso = case["iso"].as_f64().unwrap();
        // the file's corners have x slowest
        let turned = (0..8)
            .map(|c: usize| values[(c & 1) << 2 | c & 2 | c >> 2])
            .collect();
        println!("{name}");
        obeys_the_laws(&volume([2; 3], turned), iso);
        // exactly on a sample as well
        obeys_the_laws(&volume([2; 3], values.clone()), values[3]);
    }
}

/// Reads an `.iso` file: dims, three numbers of spacing, samples.
fn iso(path: &Path) -> MemoryVolume<f32> {
    let bytes = std::fs::read(path).unwrap();
    let word = |i: usize| <[u8; 4]>::try_from(&bytes[4 * i..4 * i + 4]).unwrap();
    let dims = [0, 1, 2].map(|i| u32::from_le_bytes(word(i)));
    let samples = (9..bytes.len() / 4)
        .map(|i| f32::from_le_bytes(word(i)))
        .collect();
    volume(dims, samples)
}

fn in_memory(path: &Path, options: &OpenOptions) -> MemoryVolume<f32> {
    let opened = alvis::volume::open(path, options).unwrap();
    let dims = opened.volume.header().dims;
    let [x, y, z] = dims.0.map(|n| 0..n);
    let mut bytes = vec![0; 4 * dims.voxels() as usize];
    opened.volume.read_box(x, y, z, &mut bytes).unwrap();
    let samples = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&b| f32::from_ne_bytes(b))
        .collect();
    MemoryVolume::new(dims, Placement::default(), samples).unwrap()
}

#[test]
fn grids_of_a_paper_on_topology_obey_the_laws() {
    let Some(data) = common::data("the grids of Custodio et al.") else {
        return;
    };
    let dir = data.join("topology/custodio_paper_results");
    let raw = OpenOptions {
        dims: Some([5; 3]),
        dtype: Some(alvis::volume::Dtype::F32),
        endian: Some(alvis::volume::Endian::Big),
        ..OpenOptions::default()
    };
    let figure6 = in_memory(&dir.join("figure6.raw"), &raw);
    // the same numbers, with x and z exchanged
    let turned = common::volumes::samples([5; 3], |[x, y, z]| {
        figure6.samples()[(z + 5 * (y + 5 * x)) as usize]
    });
    assert_eq!(turned, iso(&dir.join("figure6.iso")).samples());
    let header = OpenOptions::default();
    let figure7 = in_memory(&dir.join("figure7.nhdr"), &header);
    assert_eq!(figure7.samples(), iso(&dir.join("figure7.iso")).samples());
    let algorithm = in_memory(&dir.join("algorithm.nhdr"), &header);
    for grid in [
        figure6,
        figure7,
        algorithm,
        iso(&dir.join("algorithm1.iso")),
    ] {
        let mut levels: Vec<f64> = grid.samples().iter().map(|&v| f64::from(v)).collect();
        levels.sort_by(f64::total_cmp);
        levels.dedup();
        let step = levels.len().div_ceil(12);
        for level in levels.into_iter().step_by(step).chain([0.0, 1e-3, -0.25]) {
            obeys_the_laws(&grid, level);
        }
    }
}

#[test]
fn volumes_that_gave_others_holes_or_double_faces_obey_the_laws() {
    let Some(data) = common::data("the volumes of scikit-image") else {
        return;
    };
    let file = json(&data.join("topology/skimage_issue_volumes.json"));
    for key in ["issue_8109", "issue_8116"] {
        let Some(planes) = file[key].as_array() else {
            continue;
        };
        let count = |v: &Value| v.as_array().unwrap().len() as u32;
        let dims = [count(&planes[0][0]), count(&planes[0]), planes.len() as u32];
        let flat = planes
            .iter()
            .flat_map(|p| p.as_array().unwrap())
            .flat_map(|r| r.as_array().unwrap());
        let values: Vec<f64> = flat.filter_map(Value::as_f64).collect();
        let integers: Vec<i16> = values.iter().map(|&v| v as i16).collect();
        let mut levels = values.clone();
        levels.push(0.0);
        for level in levels {
            obeys_the_laws(&volume(dims, integers.clone()), level);
            obeys_the_laws(&volume(dims, values.clone()), level);
        }
    }
}

#[test]
fn levels_that_occur_in_the_data_leave_no_hole() {
    let mut random = common::volumes::Random(5);
    for _ in 0..20 {
        let dims = [0; 3].map(|_| 2 + (random.bits() % 5) as u32);
        let values: Vec<i8> = common::volumes::samples(dims, |_| (random.bits() % 5) as i8 - 2);
        for level in [-1.0, 0.0, 1.0, 0.5] {
            obeys_the_laws(&volume(dims, values.clone()), level);
        }
    }
}

#[test]
fn volumes_of_one_phase_have_no_surface_but_a_cap() {
    for (value, boxed) in [(0u8, false), (1, true)] {
        let flat = volume([4, 5, 6], vec![value; 120]);
        for rule in RULES {
            let open = make(&flat, &options(0.5, rule, false));
            assert_eq!(open.totals.triangles, 0);
            let capped = make(&flat, &options(0.5, rule, true));
            assert_eq!(capped.totals.triangles > 0, boxed);
            assert_eq!(
                capped.totals.euler_characteristic,
                if boxed { 2 } else { 0 }
            );
        }
    }
}

#[test]
fn not_a_number_is_below_and_infinities_are_what_they_say() {
    let dims = Dims([5, 4, 6]);
    let mut random = common::volumes::Random(11);
    let special = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.0,
        1.0,
        f32::MAX,
        f32::MIN_POSITIVE,
    ];
    let values: Vec<f32> = (0..dims.voxels())
        .map(|_| special[(random.bits() % 7) as usize])
        .collect();
    let nan = values.iter().filter(|v| v.is_nan()).count() as u64;
    let volume = volume(dims.0, values);
    let made = make(&volume, &options(0.5, Ambiguous::Separate, false));
    assert_eq!(made.totals.voxels_nan, nan);
    obeys_the_laws(&volume, 1.0);
}
