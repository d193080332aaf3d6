//! A region of interest: the same surface as of a volume that was filled outside beforehand, and components that the edge
//! of the region cuts are those of the border.

mod common;

use alvis::convert::{ConvertOptions, RegionOfInterest};
use alvis::grid::{Ambiguous, Crop, Cylinder, Dims, Fill, Shape};
use alvis::progress::Quiet;
use alvis::split::NeckRule;
use alvis::verify::{Code, VerifyOptions, verify};
use alvis::volume::{Cropped, Filled, MemoryVolume, RegionVoxels, Volume, fill_value};
use common::seal::seal;
use common::set::{Table, manifest, table, weld};
use common::volumes::{Random, foam, noise, samples, volume};
use common::{assert_same_files, converted, files, options, reference, verified};
use proptest::prelude::*;
use std::path::Path;

#[derive(Debug, Clone)]
struct Case {
    dims: [u32; 3],
    is_foam: bool,
    seed: u64,
    /// A mask, else a cylinder.
    is_mask: bool,
    fill: Fill,
    rule: Ambiguous,
    cap: bool,
    crop: bool,
}

impl Case {
    fn samples(&self) -> Vec<u8> {
        match self.is_foam {
            true => foam(self.dims, self.seed),
            false => noise(self.dims, self.seed),
        }
    }

    fn cylinder(&self) -> Cylinder {
        let mut random = Random(self.seed);
        let [nx, ny, _] = self.dims.map(f64::from);
        Cylinder {
            centre: [nx, ny].map(|n| n * (0.3 + 0.4 * random.unit())),
            radius: 1.0 + nx.min(ny) * 0.6 * random.unit(),
        }
    }

    /// A mask of lumps and holes, as samples.
    fn mask(&self) -> Vec<u8> {
        let wave = |v: u32, k: f64| (f64::from(v) * k + self.seed as f64).sin();
        let mask = samples(self.dims, |[x, y, z]| {
            u8::from(wave(x, 0.5) + wave(y, 0.4) + wave(z, 0.6) < 0.9) * 3
        });
        match mask.contains(&3) {
            true => mask,
            false => vec![3; mask.len()],
        }
    }

    fn region(&self, dir: &Path) -> (Shape, RegionVoxels) {
        let dims = Dims(self.dims);
        if !self.is_mask {
            let cylinder = self.cylinder();
            let voxels = RegionVoxels::cylinder(&cylinder, dims).unwrap();
            return (Shape::Cylinder(cylinder), voxels);
        }
        let mask = volume(self.dims, self.mask());
        let (voxels, checksum) = RegionVoxels::of_mask(&mask, dims, dir, &Quiet).unwrap();
        let file = "mask.raw".to_owned();
        (Shape::Mask { file, checksum }, voxels)
    }

    fn holds(&self, [x, y, z]: [u32; 3]) -> bool {
        let [nx, ny, _] = self.dims;
        match self.is_mask {
            true => self.mask()[(x + nx * (y + ny * z)) as usize] != 0,
            false => self.cylinder().holds(x, y),
        }
    }

    fn crop(&self) -> Option<Crop> {
        let [nx, ny, nz] = self.dims;
        let crop = Crop {
            x: 1..nx,
            y: 2..ny - 1,
            z: 0..nz - 1,
        };
        self.crop.then_some(crop)
    }
}

/// A component is cut if a voxel of it and one of the other phase share a face, and one of the two is outside; or an edge,
/// if the one outside is not of the phase that goes on across edges.
fn cut(dims: [u32; 3], above: &[bool], inside: &[bool], case: &Case, ids: &[u64]) -> [Vec<u64>; 2] {
    let n = dims.map(|n| n as i64);
    let joined = case.rule == Ambiguous::Join;
    let mut found = [Vec::new(), Vec::new()];
    for i in 0..above.len() {
        let at = [
            i as i64 % n[0],
            i as i64 / n[0] % n[1],
            i as i64 / n[0] / n[1],
        ];
        for step in (0..27).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]) {
            let next: [i64; 3] = std::array::from_fn(|a| at[a] + step[a]);
            if (0..3).any(|a| !(0..n[a]).contains(&next[a])) {
                continue;
            }
            let j = (next[0] + n[0] * (next[1] + n[1] * next[2])) as usize;
            let meets = match step.iter().filter(|s| **s != 0).count() {
                1 => !(inside[i] && inside[j]),
                2 => above[i] == joined && inside[i] && !inside[j],
                _ => false,
            };
            if meets && above[i] != above[j] {
                for v in [i, j] {
                    found[usize::from(above[v])].push(ids[v]);
                }
            }
        }
    }
    found
}

/// Columns that follow from whether a component touches the border.
const OF_BORDER: [&str; 4] = ["touches_border", "mesh_volume", "sphericity", "form_factor"];

fn without_border(mut table: Table) -> Table {
    for name in OF_BORDER
        .into_iter()
        .filter(|n| table.names.contains(&n.to_string()))
        .collect::<Vec<_>>()
    {
        table = table.without(name);
    }
    table
}

fn cases() -> impl Strategy<Value = Case> {
    let dims = [5u32..20, 5u32..18, 4u32..14].prop_map(|d| d);
    let any_fill = prop::sample::select(vec![Fill::Material, Fill::Air]);
    let rule = prop::sample::select(vec![Ambiguous::Separate, Ambiguous::Join]);
    let flags = prop::array::uniform4(any::<bool>());
    (dims, 0..1000u64, any_fill, rule, flags).prop_map(|(dims, seed, fill, rule, flags)| Case {
        dims,
        is_foam: flags[0],
        seed,
        is_mask: flags[1],
        fill,
        rule,
        cap: flags[2],
        crop: flags[3],
    })
}

fn check(case: &Case) -> Result<(), TestCaseError> {
    let temp = tempfile::tempdir().unwrap();
    let whole = volume(case.dims, case.samples());
    let (shape, voxels) = case.region(temp.path());
    let value = fill_value(&whole, &voxels, 128.0, case.fill, &Quiet).unwrap();
    prop_assert_eq!(value >= 128.0, case.fill == Fill::Material);
    let crop = case.crop();
    let region = RegionOfInterest::new(shape, voxels.clone(), crop.as_ref(), case.fill, value);
    let Ok(region) = region else {
        // nothing of it is in the crop
        return Ok(());
    };
    let plain = ConvertOptions {
        ambiguous: case.rule,
        cap: case.cap,
        crop: crop.clone(),
        ..options([4, 5, 3])
    };
    let of_region = ConvertOptions {
        region: Some(region),
        ..plain.clone()
    };
    let (own, report) = converted(&whole, &of_region);
    // filled beforehand, voxel by voxel
    let mut i = 0;
    let source = case.samples();
    let filled = samples(case.dims, |at| {
        i += 1;
        if case.holds(at) {
            source[i - 1]
        } else {
            value as u8
        }
    });
    let filled = volume(case.dims, filled);
    let (other, _) = converted(&filled, &plain);
    prop_assert_eq!(weld(own.path()), weld(other.path()));

    let crop = crop.unwrap_or(Crop::whole(Dims(case.dims)));
    let [x, y, z] = crop.start();
    let dims = crop.dims_in(Dims(case.dims)).unwrap().0;
    let [nx, ny, _] = case.dims;
    let sample = |[i, j, k]: [u32; 3]| {
        let mut out = [0u8];
        let at = [i + x, j + y, k + z];
        let range = |a: usize| at[a]..at[a] + 1;
        filled
            .read_box(range(0), range(1), range(2), &mut out)
            .unwrap();
        out[0] >= 128
    };
    let above = samples(dims, sample);
    let mask = case.mask();
    let inside = samples(dims, |[i, j, k]| match case.is_mask {
        true => mask[(i + x + nx * (j + y + ny * (k + z))) as usize] != 0,
        false => case.cylinder().holds(i + x, j + y),
    });
    let count = inside.iter().filter(|v| **v).count() as u64;
    prop_assert_eq!(report.region.unwrap().voxels, count);
    let ids = reference::ids(dims.map(|n| n as usize), &above, case.rule);
    let cut = cut(dims, &above, &inside, case, &ids);
    for (phase, name) in ["cells.csv", "objects.csv"].into_iter().enumerate() {
        let [own, other] = [own.path(), other.path()].map(|dir| table(dir, name));
        prop_assert_eq!(without_border(own.clone()), without_border(other.clone()));
        let rows = own.column("id").zip(own.column("touches_border"));
        let rows = rows
            .zip(other.column("touches_border"))
            .zip(own.column("mesh_volume"));
        for (((id, touches), before), mesh_volume) in rows {
            let is_cut = cut[phase].contains(&id.parse().unwrap());
            let expected = if is_cut { "1" } else { before };
            prop_assert_eq!(touches, expected, "{} of {}", id, name);
            prop_assert!(touches == "0" || mesh_volume.is_empty());
        }
    }
    prop_assert_eq!(
        table(own.path(), "surfaces.csv"),
        table(other.path(), "surfaces.csv")
    );

    verified(own.path(), None);
    let against = Filled::new(Box::new(&whole), voxels.clone(), value).unwrap();
    let against = Cropped::new(Box::new(against), &crop).unwrap();
    let region = voxels.cropped(Some(&crop)).unwrap();
    let options = VerifyOptions {
        against: Some(&against),
        region: Some(&region),
        ..VerifyOptions::default()
    };
    let report = verify(own.path(), &options, &Quiet).unwrap();
    prop_assert!(report.ok, "{:#?}", report.issues);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 160, ..ProptestConfig::default() })]

    #[test]
    fn it_is_the_same_as_filling_the_volume_beforehand(case in cases()) {
        check(&case)?;
    }
}

/// Cells that are split are cut as components are, and where one goes on in another outside of the region: the verifier
/// finds by itself which are, voxel by voxel, and what is stated otherwise.
fn check_split(case: &Case) -> Result<(), TestCaseError> {
    let temp = tempfile::tempdir().unwrap();
    let whole = volume(case.dims, case.samples());
    let (shape, voxels) = case.region(temp.path());
    let value = fill_value(&whole, &voxels, 128.0, case.fill, &Quiet).unwrap();
    let region = RegionOfInterest::new(shape, voxels.clone(), None, case.fill, value).unwrap();
    let split = ConvertOptions {
        ambiguous: case.rule,
        region: Some(region),
        split: Some(NeckRule {
            ratio_permille: 900,
            h_256: 0,
            min_radius_256: 0,
        }),
        ..options([4, 5, 3])
    };
    let (out, _) = converted(&whole, &split);
    let against = Filled::new(Box::new(&whole), voxels.clone(), value).unwrap();
    let options = VerifyOptions {
        against: Some(&against),
        region: Some(&voxels),
        ..VerifyOptions::default()
    };
    let report = verify(out.path(), &options, &Quiet).unwrap();
    prop_assert!(report.ok, "{:#?}", report.issues);
    let path = out.path().join("cells.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let border = names.iter().position(|name| *name == "touches_border");
    let other = |(row, line): (usize, &str)| {
        let mut fields: Vec<&str> = line.split(',').collect();
        if row > 0 {
            let field = &mut fields[border.unwrap()];
            *field = if *field == "1" { "0" } else { "1" };
        }
        fields.join(",") + "\n"
    };
    let turned: String = text.lines().enumerate().map(other).collect();
    std::fs::write(&path, turned).unwrap();
    seal(out.path());
    let report = verify(out.path(), &options, &Quiet).unwrap();
    let found = report
        .issues
        .iter()
        .filter(|issue| issue.message.contains("by its voxels it is"));
    let cells = text.lines().count() - 1;
    prop_assert_eq!(found.count() > 0, cells > 0, "{:#?}", report.issues);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn cells_that_are_split_are_cut_too(case in cases()) {
        check_split(&case)?;
    }
}

/// Flips the components of a phase that have few voxels and none outside; returns how many they are, and their voxels.
fn clean(case: &Case, above: &mut [bool], inside: &[bool], few: u64, phase: bool) -> (u64, u64) {
    let ids = reference::ids(case.dims.map(|n| n as usize), above, case.rule);
    let mut of: std::collections::BTreeMap<u64, Vec<usize>> = Default::default();
    for i in (0..above.len()).filter(|&i| above[i] == phase) {
        of.entry(ids[i]).or_default().push(i);
    }
    let is_small = |v: &&Vec<usize>| (v.len() as u64) < few && v.iter().all(|&i| inside[i]);
    let small: Vec<&Vec<usize>> = of.values().filter(is_small).collect();
    let voxels = small.iter().map(|v| v.len() as u64).sum();
    small
        .iter()
        .copied()
        .flatten()
        .for_each(|&i| above[i] = !phase);
    (small.len() as u64, voxels)
}

fn check_dust(case: &Case, few: u64) -> Result<(), TestCaseError> {
    let temp = tempfile::tempdir().unwrap();
    let whole = volume(case.dims, case.samples());
    let (shape, voxels) = case.region(temp.path());
    let value = fill_value(&whole, &voxels, 128.0, case.fill, &Quiet).unwrap();
    let region = RegionOfInterest::new(shape, voxels.clone(), None, case.fill, value).unwrap();
    let of_region = ConvertOptions {
        ambiguous: case.rule,
        cap: case.cap,
        min_voxels: few,
        region: Some(region),
        ..options([4, 5, 3])
    };
    let (own, report) = converted(&whole, &of_region);
    let (source, mask) = (case.samples(), case.mask());
    let mut i = 0;
    let inside = samples(case.dims, |[x, y, _]| {
        i += 1;
        match case.is_mask {
            true => mask[i - 1] != 0,
            false => case.cylinder().holds(x, y),
        }
    });
    let mut above: Vec<bool> = inside
        .iter()
        .zip(&source)
        .map(|(is_inside, v)| (if *is_inside { f64::from(*v) } else { value }) >= 128.0)
        .collect();
    let before = above.clone();
    let objects = clean(case, &mut above, &inside, few, true);
    let cells = clean(case, &mut above, &inside, few, false);
    let changed = (0..above.len()).filter(|&i| above[i] != before[i]);
    prop_assert!(changed.clone().all(|i| inside[i]));
    let dust = manifest(own.path()).dust.unwrap();
    prop_assert_eq!((dust.objects, dust.object_voxels), objects);
    prop_assert_eq!((dust.cells, dust.cell_voxels), cells);
    let count = above.iter().filter(|above| **above).count() as u64;
    prop_assert_eq!(report.totals.voxels_above, count);
    let against = Filled::new(Box::new(&whole), voxels.clone(), value).unwrap();
    let options = VerifyOptions {
        against: Some(&against),
        region: Some(&voxels),
        ..VerifyOptions::default()
    };
    let report = verify(own.path(), &options, &Quiet).unwrap();
    prop_assert!(report.ok, "{:#?}", report.issues);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 80, ..ProptestConfig::default() })]

    #[test]
    fn what_is_outside_is_never_too_small(case in cases(), few in 2u64..40) {
        check_dust(&Case { crop: false, ..case }, few)?;
    }
}

/// A foam or noise, and what to convert it with: a region.
fn set_of(is_foam: bool, is_mask: bool, min_voxels: u64) -> (MemoryVolume<u8>, ConvertOptions) {
    let case = Case {
        dims: [40, 37, 30],
        is_foam,
        seed: 5,
        is_mask,
        fill: Fill::Material,
        rule: Ambiguous::Separate,
        cap: false,
        crop: false,
    };
    let whole = volume(case.dims, case.samples());
    let temp = std::env::temp_dir();
    let (shape, voxels) = case.region(&temp);
    let region = RegionOfInterest::new(shape, voxels, None, case.fill, 190.0).unwrap();
    let options = ConvertOptions {
        region: Some(region),
        min_voxels,
        ..options([8, 8, 8])
    };
    (whole, options)
}

/// A limit that is told before the region is found is one that works with it.
#[test]
fn the_smallest_limit_is_the_same_before_the_region_is_found() {
    let (whole, options) = set_of(true, false, 0);
    let of_region = ConvertOptions {
        memory: 1 << 20,
        ..options
    };
    let before = ConvertOptions {
        region: None,
        ..of_region.clone()
    };
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("out");
    let refused = [
        alvis::convert::check_before(&whole, &before, true, &out),
        alvis::convert::convert(&whole, &of_region, &out, &Quiet).map(|_| ()),
    ];
    let needed = refused.map(|made| match made {
        Err(alvis::Error::Memory { needed, .. }) => needed,
        other => panic!("{other:?}"),
    });
    assert_eq!(needed[0], needed[1]);
}

#[test]
fn bytes_do_not_depend_on_threads_or_memory() {
    for (is_mask, min_voxels) in [(false, 0), (true, 0), (true, 9)] {
        let (whole, options) = set_of(true, is_mask, min_voxels);
        let (first, _) = converted(&whole, &options);
        let needed = alvis::convert::predicted_memory(
            &whole,
            &ConvertOptions {
                memory: 1 << 60,
                ..options.clone()
            },
        );
        assert!(needed.unwrap() > 0);
        for (threads, memory) in [(3, 1 << 30), (2, 48 << 20)] {
            let other = ConvertOptions {
                threads,
                memory,
                ..options.clone()
            };
            let (second, _) = converted(&whole, &other);
            let what = format!("mask {is_mask}, dust {min_voxels}, {threads} threads");
            assert_same_files(&files(first.path()), &files(second.path()), &what);
        }
        verified(first.path(), None);
    }
}

/// Codes of what is found in a set whose index was changed; checksums agree with it.
fn codes(dir: &Path, change: impl Fn(&mut serde_json::Value)) -> Vec<Code> {
    let path = dir.join("index.json");
    let before = std::fs::read(&path).unwrap();
    let mut index = serde_json::from_slice(&before).unwrap();
    change(&mut index);
    std::fs::write(&path, serde_json::to_vec(&index).unwrap()).unwrap();
    common::seal::seal(dir);
    let report = verify(dir, &VerifyOptions::default(), &Quiet).unwrap();
    std::fs::write(&path, before).unwrap();
    report.issues.iter().map(|issue| issue.code).collect()
}

#[test]
fn a_region_that_is_stated_wrongly_is_found() {
    let (whole, mut options) = set_of(false, false, 0);
    // a tenth of the noise: cells of a few voxels
    options.threshold = 25.0;
    let (set, _) = converted(&whole, &options);
    let dir = set.path();
    assert_eq!(codes(dir, |_| ()), []);
    let radius = manifest(dir).region.unwrap();
    let Shape::Cylinder(Cylinder { radius, .. }) = radius.shape else {
        panic!("a cylinder");
    };
    let found = codes(dir, |index| {
        index["region"]["radius"] = (radius - 3.0).into()
    });
    assert!(found.contains(&Code::ManifestValue), "{found:?}");
    // cells are cut that the tables say are not, or the other way round
    assert!(found.contains(&Code::TableValue), "{found:?}");
    let found = codes(dir, |index| index["region"]["voxels"] = 17.into());
    assert_eq!(found, [Code::ManifestValue]);
    let found = codes(dir, |index| index["region"]["fill"] = "air".into());
    // the sample of the fill, and how many voxels are inside at least; and what the edge cuts across edges of voxels
    let of_manifest = found.iter().filter(|c| **c == Code::ManifestValue);
    assert_eq!(of_manifest.count(), 2, "{found:?}");
    let other = found
        .iter()
        .find(|c| ![Code::ManifestValue, Code::TableValue].contains(c));
    assert_eq!(other, None);
    let found = codes(dir, |index| index["region"]["fill_value"] = 20.0.into());
    assert_eq!(found, [Code::ManifestValue]);
    let found = codes(dir, |index| index["region"]["more"] = 20.0.into());
    assert!(found.contains(&Code::ForeignMember), "{found:?}");
    let found = codes(dir, |index| {
        index.as_object_mut().unwrap().remove("region");
    });
    assert!(found.contains(&Code::TableValue), "{found:?}");
}

/// Without the mask its number of voxels is not known, but not all numbers can be.
#[test]
fn a_mask_cannot_have_any_number_of_voxels() {
    let (whole, options) = set_of(true, true, 0);
    let (set, report) = converted(&whole, &options);
    let dir = set.path();
    let voxels = manifest(dir).region.unwrap().voxels;
    let (all, below) = (40 * 37 * 30, 40 * 37 * 30 - report.totals.voxels_above);
    assert!(below < voxels && voxels < all);
    for (stated, is_found) in [
        (voxels, false),
        (below, false),
        (below - 1, true),
        (all, true),
    ] {
        let found = codes(dir, |index| index["region"]["voxels"] = stated.into());
        assert_eq!(
            found.contains(&Code::ManifestValue),
            is_found,
            "{stated}: {found:?}"
        );
    }
    // one that holds everything is told by its checksum, and has no edge in the grid
    let mask = volume([40, 37, 30], vec![1; all as usize]);
    let temp = std::env::temp_dir();
    let (voxels, checksum) =
        RegionVoxels::of_mask(&mask, Dims([40, 37, 30]), &temp, &Quiet).unwrap();
    let shape = Shape::Mask {
        file: "all.raw".to_owned(),
        checksum,
    };
    let region = RegionOfInterest::new(shape, voxels, None, Fill::Material, 190.0).unwrap();
    let options = ConvertOptions {
        region: Some(region),
        ..options
    };
    let (set, _) = converted(&whole, &options);
    verified(set.path(), None);
    let found = codes(set.path(), |index| {
        index["region"]["voxels"] = (all - 1).into()
    });
    assert_eq!(found, [Code::ManifestValue]);
}

#[test]
fn without_the_mask_any_component_may_be_at_its_edge() {
    let (whole, options) = set_of(true, true, 0);
    let (set, _) = converted(&whole, &options);
    let dir = set.path();
    verified(dir, None);
    let text = std::fs::read_to_string(dir.join("cells.csv")).unwrap();
    let whole_cells = table(dir, "cells.csv");
    let at = whole_cells
        .names
        .iter()
        .position(|n| n == "touches_border")
        .unwrap();
    assert!(whole_cells.column("touches_border").any(|v| v == "0"));
    // one that touches a face of the grid is said not to: that is found in any case
    let face = whole_cells
        .rows
        .iter()
        .position(|row| row[at] == "1")
        .unwrap();
    let lines: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let mut fields: Vec<&str> = line.split(',').collect();
            if i == face + 1 {
                fields[at] = "0";
            }
            fields.join(",")
        })
        .collect();
    std::fs::write(dir.join("cells.csv"), lines.join("\n") + "\n").unwrap();
    common::seal::seal(dir);
    let region = options.region.as_ref().unwrap();
    let against = Filled::new(Box::new(&whole), region.voxels.clone(), 190.0).unwrap();
    let with_mask = VerifyOptions {
        against: Some(&against),
        region: Some(&region.voxels),
        ..VerifyOptions::default()
    };
    let report = verify(dir, &with_mask, &Quiet).unwrap();
    let codes: Vec<Code> = report.issues.iter().map(|issue| issue.code).collect();
    assert!(codes.contains(&Code::TableValue), "{codes:?}");
}
