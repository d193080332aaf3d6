//! `min_voxels` leaves out small components: the same as converting a volume without them.

use alvis::convert::{ConvertOptions, convert};
use alvis::grid::{Ambiguous, Dims, Placement};
use alvis::manifest::{Dust, Manifest};
use alvis::progress::Quiet;
use alvis::verify::{VerifyOptions, verify};
use alvis::volume::MemoryVolume;
use proptest::prelude::*;

#[derive(Debug, Clone)]
struct Case {
    dims: [u32; 3],
    above: Vec<bool>,
    rule: Ambiguous,
    cap: bool,
    min_voxels: u64,
}

impl Case {
    fn volume(&self, above: &[bool]) -> MemoryVolume<u8> {
        let samples = above.iter().map(|&a| if a { 200 } else { 10 }).collect();
        MemoryVolume::new(Dims(self.dims), Placement::default(), samples).unwrap()
    }

    /// Flips all components of a phase that have fewer voxels; returns how many and their voxels.
    fn fill(&self, bits: &mut [bool], phase: bool) -> (u64, u64) {
        let [nx, ny, nz] = self.dims.map(|n| n as i32);
        let at = |[x, y, z]: [i32; 3]| (x + nx * (y + ny * z)) as usize;
        let reach = if phase == (self.rule == Ambiguous::Join) {
            2
        } else {
            1
        };
        let mut seen = vec![false; bits.len()];
        let mut filled = (0, 0);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let start = at([x, y, z]);
                    if seen[start] || bits[start] != phase {
                        continue;
                    }
                    seen[start] = true;
                    let mut component = vec![[x, y, z]];
                    let mut next = 0;
                    while let Some(&v) = component.get(next) {
                        next += 1;
                        for d in 0..27i32 {
                            let d = [d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1];
                            let n: [i32; 3] = std::array::from_fn(|a| v[a] + d[a]);
                            let inside = (0..3).all(|a| n[a] >= 0 && n[a] < self.dims[a] as i32);
                            let steps: i32 = d.iter().map(|s| s.abs()).sum();
                            if inside && steps <= reach && !seen[at(n)] && bits[at(n)] == phase {
                                seen[at(n)] = true;
                                component.push(n);
                            }
                        }
                    }
                    if (component.len() as u64) < self.min_voxels {
                        filled = (filled.0 + 1, filled.1 + component.len() as u64);
                        component.iter().for_each(|&v| bits[at(v)] = !phase);
                    }
                }
            }
        }
        filled
    }
}

fn run(case: &Case, above: &[bool], min_voxels: u64) -> Manifest {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("set");
    let options = ConvertOptions {
        threshold: 100.0,
        macrocube: [4, 3, 5],
        ambiguous: case.rule,
        cap: case.cap,
        min_voxels,
        threads: 2,
        ..ConvertOptions::default()
    };
    convert(&case.volume(above), &options, &out, &Quiet).unwrap();
    let volume = case.volume(&case.above);
    let against = VerifyOptions {
        against: Some(&volume),
        ..VerifyOptions::default()
    };
    if above == case.above {
        let report = verify(&out, &against, &Quiet).unwrap();
        assert!(report.ok, "{:?}", report.issues);
    }
    serde_json::from_slice(&std::fs::read(out.join("index.json")).unwrap()).unwrap()
}

fn cases() -> impl Strategy<Value = Case> {
    let rule = prop_oneof![Just(Ambiguous::Separate), Just(Ambiguous::Join)];
    (
        [3u32..11, 3u32..11, 3u32..11],
        rule,
        any::<bool>(),
        2u64..9,
        0.1..0.9,
    )
        .prop_flat_map(|(dims, rule, cap, min_voxels, p)| {
            let n = dims.iter().product::<u32>() as usize;
            prop::collection::vec(prop::bool::weighted(p), n).prop_map(move |above| Case {
                dims,
                above,
                rule,
                cap,
                min_voxels,
            })
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn equals_converting_the_cleaned_volume(case in cases()) {
        let mut clean = case.above.clone();
        let objects = case.fill(&mut clean, true);
        let cells = case.fill(&mut clean, false);
        let filtered = run(&case, &case.above, case.min_voxels);
        let reference = run(&case, &clean, 0);
        let dust = Dust {
            min_voxels: case.min_voxels,
            objects: objects.0,
            object_voxels: objects.1,
            cells: cells.0,
            cell_voxels: cells.1,
        };
        prop_assert_eq!(filtered.dust, Some(dust));
        prop_assert_eq!(reference.dust, None);
        // normals differ where dust was near, and with them nothing that is counted
        prop_assert_eq!(filtered.totals, reference.totals);
    }
}

/// Voxels that are no number are below the threshold, but no longer where they are left out.
#[test]
fn voxels_that_are_no_number_may_be_left_out() {
    let dims = Dims([6, 5, 7]);
    let mut samples = vec![200.0f32; 210];
    for (i, sample) in samples.iter_mut().enumerate().step_by(11) {
        *sample = if i % 2 == 0 { f32::NAN } else { 10.0 };
    }
    let volume = MemoryVolume::new(dims, Placement::default(), samples).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [4; 3],
        min_voxels: 100,
        ..Default::default()
    };
    let made = convert(&volume, &options, dir.path(), &Quiet).unwrap();
    assert_eq!((made.totals.voxels_nan, made.totals.cells), (10, 0));
    let report = verify(dir.path(), &VerifyOptions::default(), &Quiet).unwrap();
    assert!(report.ok, "{:?}", report.issues);
}
