//! Tile sets whose cells are parts of components, by labels: sound ones, and one broken for each way to be wrong.

use crate::edit::{Place, Set};
use crate::glb::Tile;
use crate::{check, codes, compare, noise};
use alvis::grid::{Dims, Placement};
use alvis::progress::Quiet;
use alvis::verify::{Code, LabelVolume, Report, VerifyOptions, verify};
use alvis::volume::MemoryVolume;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Samples and labels of a small volume.
pub(crate) struct Scan {
    pub(crate) dims: [usize; 3],
    pub(crate) samples: Vec<u8>,
    pub(crate) labels: Vec<u16>,
    pub(crate) threshold: u8,
}

impl Scan {
    /// Waves with noise, and labels in blocks whose ids have gaps; with `holes` some voxels have none.
    pub(crate) fn new(seed: u64, dims: [usize; 3], block: usize, holes: bool) -> Self {
        let place = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
        let n = dims.iter().product();
        let shift = noise(seed, 1 << 40) * 6.0;
        let sample = |i: usize| {
            let [x, y, z] = place(i).map(|c| c as f32);
            let wave = (0.8 * x + shift).sin() + (0.7 * y).sin() + (0.9 * z + shift).cos();
            (110.0 + 30.0 * wave + 70.0 * (noise(seed, i as u64) - 0.5)) as u8
        };
        let label = |i: usize| {
            let [x, y, z] = place(i).map(|c| c / block);
            let number = (x + 5 * (y + 7 * z)) as u64;
            // some blocks share a label, so that a cell may be in several places
            let own = 3 + 4 * (noise(seed ^ 77, number) * 50.0) as u16;
            if holes && number.is_multiple_of(5) {
                0
            } else {
                own
            }
        };
        Scan {
            dims,
            threshold: 128,
            samples: (0..n).map(sample).collect(),
            labels: (0..n).map(label).collect(),
        }
    }

    /// Hollows, most of them apart from each other, each of two cells; voxels of some have no label.
    pub(crate) fn pockets() -> Self {
        let dims = [22, 20, 18];
        let mut scan = Scan::new(5, dims, 5, false);
        for (i, v) in scan.samples.iter_mut().enumerate() {
            let p = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]];
            let wave: f32 = p.map(|c| (0.8 * c as f32).sin()).iter().sum();
            *v = (158.0 + 30.0 * wave + 10.0 * noise(5, i as u64)) as u8;
            // of the period along each axis, from the middle between two hollows on, in halves along x
            let period = |c: usize| (c as f32 + 5.9) / 7.854;
            let half = (2.0 * period(p[0])) as u16;
            let [y, z] = [p[1], p[2]].map(|c| period(c) as u16);
            scan.labels[i] = match (y, z) {
                (0, 0) => 0,
                _ => 3 + 4 * (half + 9 * (y + 4 * z)),
            };
        }
        scan
    }

    /// Writes it to a directory and converts it to `out` there, with labels or without.
    pub(crate) fn convert(&self, dir: &Path, out: &str, labels: bool, more: &[&str]) {
        fs::write(dir.join("scan.raw"), &self.samples).unwrap();
        let bytes: Vec<u8> = self.labels.iter().flat_map(|l| l.to_le_bytes()).collect();
        fs::write(dir.join("labels.raw"), bytes).unwrap();
        let dims = self.dims.map(|n| n.to_string()).join(",");
        let threshold = self.threshold.to_string();
        let mut command = Command::new(env!("CARGO_BIN_EXE_alvis"));
        command.current_dir(dir).args(["convert", "scan.raw", out]);
        command.args(["--dims", &dims, "--dtype", "u8", "--threshold", &threshold]);
        if !more.contains(&"--spacing") {
            command.args(["--spacing", "0.5,0.75,1.25"]);
        }
        command.args(["--unit", "mm", "--quiet"]);
        if labels {
            command.args(["--labels", "labels.raw"]);
        }
        let done = command.args(more).output().unwrap();
        let errors = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{more:?}: {errors}");
    }

    pub(crate) fn compare(&self, dir: &Path) -> Report {
        let field = crate::cubes::Field {
            dims: self.dims,
            values: self.samples.iter().map(|v| f32::from(*v)).collect(),
            threshold: self.threshold.into(),
        };
        compare(dir, &field)
    }

    /// That of the labels, as the index has it.
    fn checksum(&self) -> String {
        let mut crc = crc32fast::Hasher::new();
        for row in self.labels.chunks(self.dims[0]) {
            for (x, label) in row.iter().enumerate() {
                if x == 0 || row[x - 1] != *label {
                    crc.update(&(x as u64).to_le_bytes());
                    crc.update(&u64::from(*label).to_le_bytes());
                }
            }
        }
        format!("crc32:{:08x}", crc.finalize())
    }

    /// The same with the labels of a file of this name.
    fn compare_labelled(&self, dir: &Path, name: &str) -> alvis::Result<Report> {
        let dims = Dims(self.dims.map(|n| n as u32));
        let of = Placement::default();
        let samples = MemoryVolume::new(dims, of, self.samples.clone()).unwrap();
        let labels = MemoryVolume::new(dims, of, self.labels.clone()).unwrap();
        let options = VerifyOptions {
            against: Some(&samples),
            labels: Some(LabelVolume {
                name,
                volume: &labels,
            }),
            ..VerifyOptions::default()
        };
        verify(dir, &options, &Quiet)
    }
}

/// What the labels are is proved in all forms, and what labels differ in is told.
#[test]
fn cells_are_held_against_their_labels() {
    let forms: [&[&str]; 4] = [
        &["--macrocube", "5"],
        &["--macrocube", "4,30,3", "--cap", "--min-voxels", "4"],
        &["--macrocube", "6", "--for", "web"],
        &[
            "--macrocube",
            "5",
            "--ambiguous",
            "join",
            "--crop",
            "2:15,1:12,3:14",
        ],
    ];
    for (seed, form) in (20u64..).zip(forms) {
        let dir = tempfile::tempdir().unwrap();
        let scan = Scan::new(seed, [17, 14, 15], 2 + seed as usize % 4, seed % 2 == 1);
        scan.convert(dir.path(), "own", true, form);
        let mut line = vec!["verify", "own", "--against", "scan.raw"];
        line.extend(["--labels", "labels.raw"]);
        let output = Command::new(env!("CARGO_BIN_EXE_alvis"))
            .current_dir(dir.path())
            .args(&line)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{form:?}: {said}");
        assert!(said.contains("the cells are those of the labels"), "{said}");
    }
    let dir = tempfile::tempdir().unwrap();
    let scan = Scan::pockets();
    scan.convert(dir.path(), "own", true, &["--macrocube", "8"]);
    scan.convert(dir.path(), "plain", false, &["--macrocube", "8"]);
    let own = dir.path().join("own");
    let report = scan.compare_labelled(&own, "labels.raw").unwrap();
    assert!(
        report.ok && report.labels && report.issues.is_empty(),
        "{report:#?}"
    );
    assert!(report.unproved.is_empty(), "{:?}", report.unproved);
    // where cells touch follows from the labels alone
    let copy = dir.path().join("copy");
    let edited = |edit: &dyn Fn(&mut Vec<Vec<String>>)| {
        copy_all(&own, &copy);
        edit_table(&Set(&copy), "necks.csv", edit);
        Set(&copy).seal();
        let unseen = check(&copy).ok;
        let report = scan.compare_labelled(&copy, "labels.raw").unwrap();
        fs::remove_dir_all(&copy).unwrap();
        (unseen, codes(&report))
    };
    for (at, by) in [(4, 0.01), (5, 0.01), (6, 0.01), (7, 0.75)] {
        let mut unseen = 0;
        for number in 0..6 {
            let found = edited(&|rows| {
                let mut touching = rows.iter_mut().filter(|row| row[7] != "0");
                let row = touching.nth(number).unwrap();
                row[at] = (row[at].parse::<f64>().unwrap() + by).to_string();
            });
            unseen += u32::from(found.0);
            assert_eq!(found.1, BTreeSet::from([Code::TableValue]), "{at}");
        }
        // openings lie across x, where both boxes end
        assert!(unseen > 0 || at == 4, "{at}");
    }
    let renamed = scan.compare_labelled(&own, "others.raw").unwrap();
    assert!(renamed.ok && codes(&renamed).iter().eq([&Code::SourceMismatch]));
    let refused = scan.compare_labelled(&dir.path().join("plain"), "labels.raw");
    assert!(refused.unwrap_err().to_string().contains("--labels"));
    // other labels, of which the index states the checksum
    let below = |i: usize| scan.samples[i] < scan.threshold;
    let steps = [1, scan.dims[0], scan.dims[0] * scan.dims[1]];
    let place = |i: usize| [i % 22, i / 22 % 20, i / 440];
    let inner = |i: usize| (place(i).iter().zip(scan.dims)).all(|(p, n)| *p > 0 && p + 1 < n);
    let is_seen = |i: usize| steps.iter().any(|s| !below(i + s) || !below(i - s));
    let all = || (0..scan.samples.len()).filter(|&i| scan.labels[i] != 0);
    let inside = || all().filter(|&i| below(i) && inner(i));
    let hidden = inside().find(|&i| !is_seen(i)).unwrap();
    let label = scan.labels[hidden];
    let another = inside().map(|i| scan.labels[i]).find(|&l| l != label);
    let another = another.unwrap();
    let relabelled = |voxels: &[usize], label: u16| {
        let mut other = Scan::pockets();
        voxels.iter().for_each(|&i| other.labels[i] = label);
        assert_ne!(other.labels, scan.labels);
        let unsealed = other.compare_labelled(&own, "labels.raw").unwrap();
        assert!(codes(&unsealed).contains(&Code::SourceMismatch));
        let copy = dir.path().join("copy");
        copy_all(&own, &copy);
        let set = Set(&copy);
        set.manifest(|manifest| manifest["cells"]["checksum"] = other.checksum().into());
        set.seal();
        let report = other.compare_labelled(&copy, "labels.raw").unwrap();
        fs::remove_dir_all(copy).unwrap();
        codes(&report)
    };
    let is = |found: BTreeSet<Code>, expected: &[Code]| found.iter().eq(expected);
    assert_eq!(scan.checksum(), set_checksum(&own));
    let in_material = all().find(|&i| !below(i)).unwrap();
    assert!(is(relabelled(&[in_material], another), &[]));
    assert!(is(relabelled(&[hidden], another), &[Code::TableValue]));
    // a cell that no table has
    let found = relabelled(&[hidden], 2);
    assert!(is(found, &[Code::TableRows, Code::TableValue]));
    // a voxel at which triangles begin
    let mut at_walls = inside().filter(|&i| is_seen(i) && scan.labels[i] == label);
    assert!(at_walls.any(|i| is(relabelled(&[i], another), &[Code::CellMixed])));
    let of_label: Vec<usize> = all().filter(|&i| scan.labels[i] == label).collect();
    assert!(is(relabelled(&of_label, label + 1), &[Code::CellMixed]));
}

fn set_checksum(dir: &Path) -> String {
    let text = fs::read(dir.join("index.json")).unwrap();
    let index: serde_json::Value = serde_json::from_slice(&text).unwrap();
    index["cells"]["checksum"].as_str().unwrap().to_owned()
}

/// Whatever the form, the cut and the labels, the set is sound, and its surface that of the set without labels.
#[test]
fn sound_sets_pass_in_all_forms() {
    let forms: [&[&str]; 8] = [
        &["--macrocube", "5"],
        &["--macrocube", "4,30,3", "--cap"],
        &["--macrocube", "30,4,5", "--for", "meshlab"],
        &["--macrocube", "6", "--encoding", "quantized"],
        &["--macrocube", "7", "--for", "web"],
        &[
            "--macrocube",
            "5",
            "--ambiguous",
            "join",
            "--layout",
            "merged",
        ],
        &["--macrocube", "5", "--crop", "2:15,1:12,3:14"],
        &["--macrocube", "40", "--primitives", "triangles", "--cap"],
    ];
    for (seed, form) in (0u64..).zip(forms) {
        let dir = tempfile::tempdir().unwrap();
        let scan = Scan::new(seed, [17, 14, 15], 2 + seed as usize % 4, seed % 2 == 1);
        scan.convert(dir.path(), "own", true, form);
        scan.convert(dir.path(), "plain", false, form);
        let own = check(&dir.path().join("own"));
        assert!(own.ok && own.issues.is_empty(), "{form:?}: {own:#?}");
        let plain = check(&dir.path().join("plain"));
        assert!(plain.ok, "{form:?}: {plain:#?}");
        let sums = |r: &Report| (r.objects, r.triangles, r.vertices, r.volume6);
        assert_eq!(sums(&own), sums(&plain), "{form:?}");
        assert_eq!(own.components, Some(plain.cells));
        assert!(own.cells > 10 && own.tile_vertices > plain.tile_vertices);
        if !form.contains(&"--crop") {
            let report = scan.compare(&dir.path().join("own"));
            assert!(
                report.ok && report.issues.is_empty(),
                "{form:?}: {report:#?}"
            );
        }
    }
}

#[test]
fn cells_that_are_split_pass() {
    for (seed, form) in [(3, "nodes"), (4, "merged")] {
        let dir = tempfile::tempdir().unwrap();
        let scan = Scan::new(seed, [24, 20, 18], 3, false);
        let more = ["--split", "--macrocube", "7", "--layout", form];
        scan.convert(dir.path(), "own", false, &more);
        let report = check(&dir.path().join("own"));
        assert!(report.ok && report.issues.is_empty(), "{report:#?}");
        assert!(Some(report.cells) > report.components);
    }
}

#[test]
fn volumes_of_one_phase_pass() {
    for value in [0, 255] {
        let dir = tempfile::tempdir().unwrap();
        let mut scan = Scan::new(9, [9, 8, 7], 3, true);
        scan.samples.fill(value);
        scan.convert(dir.path(), "own", true, &[]);
        let report = check(&dir.path().join("own"));
        assert!(report.ok && report.issues.is_empty(), "{report:#?}");
        assert_eq!((report.surfaces, report.cells > 1), (0, value == 0));
    }
}

/// A copy of a sound set, to be broken.
pub(crate) struct Sound {
    pub(crate) dir: tempfile::TempDir,
}

impl Sound {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let scan = Scan::pockets();
        scan.convert(dir.path(), "own", true, &["--macrocube", "8"]);
        let report = check(&dir.path().join("own"));
        assert!(report.ok && report.components > Some(5), "{report:#?}");
        Sound { dir }
    }

    /// The codes that a broken copy yields; `edit` returns false if nothing was there to be broken.
    pub(crate) fn broken(&self, edit: impl FnOnce(&Set) -> bool) -> Option<BTreeSet<Code>> {
        self.broken_by(None, edit)
    }

    /// The same where it is compared with a volume, if there is one.
    pub(crate) fn broken_by(
        &self,
        scan: Option<&Scan>,
        edit: impl FnOnce(&Set) -> bool,
    ) -> Option<BTreeSet<Code>> {
        let copy = tempfile::tempdir().unwrap();
        let to = copy.path().join("own");
        copy_all(&self.dir.path().join("own"), &to);
        let set = Set(&to);
        let edited = edit(&set);
        set.seal();
        let report = || scan.map_or_else(|| check(&to), |scan| scan.compare(&to));
        edited.then(|| codes(&report()))
    }

    /// Tries all tiles until one yields exactly a code.
    fn yields(&self, code: Code, edit: impl Fn(&mut Tile) -> bool) {
        let set = self.dir.path().join("own");
        let mut others = Vec::new();
        for number in 0..Set(&set).places().len() {
            let found = self.broken(|set| {
                let place: Place = set.places()[number].clone();
                let mut tile = set.tile(&place);
                let edited = edit(&mut tile);
                if edited {
                    set.put(&place, &tile);
                }
                edited
            });
            match found {
                Some(found) if found.iter().eq([&code]) => return,
                found => others.extend(found),
            }
        }
        panic!("no tile yields {} alone: {others:?}", code.name());
    }

    /// Breaks a table and compares the codes.
    pub(crate) fn table(
        &self,
        name: &str,
        edit: impl Fn(&mut Vec<Vec<String>>),
        expected: &[Code],
    ) {
        let found = self.broken(|set| {
            edit_table(set, name, &edit);
            true
        });
        let expected: BTreeSet<Code> = expected.iter().copied().collect();
        assert_eq!(found, Some(expected), "{name}");
    }
}

fn copy_all(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        match path.is_dir() {
            true => copy_all(&path, &target),
            false => _ = fs::copy(&path, &target).unwrap(),
        }
    }
}

/// Changes the rows of a table, the header left out.
pub(crate) fn edit_table(set: &Set, name: &str, edit: impl FnOnce(&mut Vec<Vec<String>>)) {
    let path = set.0.join(name);
    let text = fs::read_to_string(&path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let split = |line: &str| line.split(',').map(str::to_owned).collect();
    let mut rows: Vec<Vec<String>> = lines.map(split).collect();
    edit(&mut rows);
    let rows = rows.iter().map(|row| row.join(",") + "\n");
    fs::write(path, header + "\n" + &rows.collect::<String>()).unwrap();
}

/// Pieces behind each other that share a vertex.
fn parts(tile: &Tile) -> Vec<[usize; 2]> {
    let pairs = (1..tile.pieces.len()).map(|i| [i - 1, i]);
    pairs.filter(|pair| shared(tile, *pair).is_some()).collect()
}

/// A vertex that both of two pieces have.
fn shared(tile: &Tile, [a, b]: [usize; 2]) -> Option<[usize; 2]> {
    let of = |i: usize| tile.pieces[i].positions.iter().enumerate();
    of(a).find_map(|(v, p)| Some([v, of(b).find(|(_, q)| p == *q)?.0]))
}

#[test]
fn a_seam_that_differs_is_found() {
    let sound = Sound::new();
    sound.yields(Code::SeamDiffers, |tile| {
        let seams = parts(tile).into_iter();
        let seam = seams
            .filter_map(|pair| Some((pair, shared(tile, pair)?)))
            .next();
        let Some(([_, piece], [_, vertex])) = seam else {
            return false;
        };
        let p = &mut tile.pieces[piece].positions[vertex];
        let axis = (0..3).find(|&a| p[a].fract() != 0.0).unwrap();
        p[axis] += if p[axis].fract() < 0.5 { 1.0 } else { -1.0 } / 256.0;
        true
    });
    sound.yields(Code::SeamDiffers, |tile| {
        let seams = parts(tile).into_iter();
        let seam = seams
            .filter_map(|pair| Some((pair, shared(tile, pair)?)))
            .next();
        let Some(([piece, _], [vertex, _])) = seam else {
            return false;
        };
        let n = &mut tile.pieces[piece].normals[vertex];
        *n = n.map(|c| -c);
        true
    });
}

#[test]
fn parts_out_of_order_are_found() {
    Sound::new().yields(Code::PartOrder, |tile| {
        let Some([a, b]) = parts(tile).pop() else {
            return false;
        };
        tile.pieces.swap(a, b);
        true
    });
}

/// By which lattice edge vertices are first: z, y, x, axis.
fn key(p: [f32; 3]) -> [i32; 4] {
    let axis = (0..3).find(|&a| p[a].fract() != 0.0).unwrap();
    [
        p[2].floor() as i32,
        p[1].floor() as i32,
        p[0].floor() as i32,
        axis as i32,
    ]
}

#[test]
fn a_triangle_in_another_part_is_found() {
    Sound::new().yields(Code::CellMixed, |tile| {
        for [a, b] in parts(tile) {
            let piece = &tile.pieces[a];
            let first = |t: &[u32; 3]| {
                t.map(|v| key(piece.positions[v as usize]))
                    .into_iter()
                    .min()
            };
            // one with all its vertices in the other part, and a vertex that begins another triangle, too
            let goes = piece.triangles.iter().position(|t| {
                let others = piece
                    .triangles
                    .iter()
                    .filter(|o| first(o) == first(t))
                    .count();
                let used = |v: &u32| piece.triangles.iter().filter(|o| o.contains(v)).count() > 1;
                others > 1 && t.iter().all(used)
            });
            let Some(goes) = goes else { continue };
            let t = tile.pieces[a].triangles.remove(goes);
            let corners = t.map(|v| {
                let piece = &tile.pieces[a];
                (piece.positions[v as usize], piece.normals[v as usize])
            });
            let other = &mut tile.pieces[b];
            let moved = corners.map(|(p, n)| {
                let known = other.positions.iter().position(|q| *q == p);
                known.unwrap_or_else(|| {
                    other.positions.push(p);
                    other.normals.push(n);
                    other.positions.len() - 1
                }) as u32
            });
            other.triangles.push(moved);
            return true;
        }
        false
    });
}

/// Triangles of one cell in the place of those of another: what they carry and where they stand is as before.
#[test]
fn cells_that_are_exchanged_are_found() {
    Sound::new().yields(Code::TableValue, |tile| {
        let Some([a, b]) = parts(tile).pop() else {
            return false;
        };
        let (first, second) = tile.pieces.split_at_mut(b);
        let (one, other) = (&mut first[a], &mut second[0]);
        std::mem::swap(&mut one.positions, &mut other.positions);
        std::mem::swap(&mut one.normals, &mut other.normals);
        std::mem::swap(&mut one.triangles, &mut other.triangles);
        true
    });
}

#[test]
fn names_of_nodes_follow_from_surfaces_of_the_component() {
    let sound = Sound::new();
    let found = sound.broken(|set| {
        let place = set.places()[0].clone();
        set.edit_tile(&place, |tile| {
            let piece = &mut tile.pieces[0];
            let [cell, object] = ["cell", "object"].map(|k| piece.extras[k].as_u64().unwrap());
            let long = format!("cell_{cell}_object_{object}");
            piece.name = match piece.name == long {
                true => format!("cell_{cell}"),
                false => long,
            };
        });
        true
    });
    assert_eq!(found, Some(BTreeSet::from([Code::NodeName])));
}

/// Columns of `cells.csv`.
const VOXELS: usize = 1;
const AREA: usize = 4;
const CENTROID: usize = 8;
const MAX_Z: usize = 16;
const AXIS: usize = 17;
const EULER: usize = 25;
const TILES: usize = 27;
const COMPONENT: usize = 28;
const NECKS: usize = 29;
const LARGEST_NECK: usize = 30;

/// Cells with necks and a component that are not in the first slice alone, nor in the first column.
fn usual(rows: &[Vec<String>]) -> Vec<usize> {
    let inside = |r: &Vec<String>| r[CENTROID] != "0" && r[MAX_Z] != "0";
    let open = |r: &Vec<String>| r[NECKS] != "0" && !r[COMPONENT].is_empty() && inside(r);
    (0..rows.len()).filter(|&at| open(&rows[at])).collect()
}

#[test]
fn wrong_rows_of_cells_are_found() {
    let sound = Sound::new();
    let value = &[Code::TableValue];
    let carried = &[Code::TableValue, Code::CarriedMeasure];
    type Edit = fn(&mut Vec<String>);
    let more = |r: &mut Vec<String>| {
        r[CENTROID] = (r[CENTROID].parse::<f64>().unwrap() * 1.000_001).to_string();
    };
    let edits: [(Edit, &[Code]); 12] = [
        (|r| r[COMPONENT].clear(), value),
        (|r| r[COMPONENT] = "1000".into(), value),
        (
            |r| r[COMPONENT] = if r[COMPONENT] == "2" { "1" } else { "2" }.into(),
            value,
        ),
        (|r| r[NECKS] = "77".into(), value),
        (|r| r[LARGEST_NECK] = "1.5".into(), value),
        (|r| r[TILES] = "99".into(), value),
        (|r| r[MAX_Z] = "0".into(), value),
        (|r| r[AXIS] = "1000".into(), value),
        (more, value),
        (|r| r[EULER] = "1".into(), carried),
        (|r| r[AREA] = "12.5".into(), carried),
        (|r| r[VOXELS] = "12".into(), carried),
    ];
    // of a cell beside one with voxels in several components, less is known
    let of_some = |edit: Edit, expected: &[Code]| {
        let expected: BTreeSet<Code> = expected.iter().copied().collect();
        (0..20).any(|number| {
            let found = sound.broken(|set| {
                edit_table(set, "cells.csv", |rows| {
                    if let Some(at) = usual(rows).get(number) {
                        edit(&mut rows[*at]);
                    }
                });
                true
            });
            found.as_ref() == Some(&expected)
        })
    };
    for (number, (edit, expected)) in edits.into_iter().enumerate() {
        assert!(of_some(edit, expected), "edit {number}");
    }
    sound.table("cells.csv", |rows| rows.swap(2, 3), &[Code::TableRows]);
}

/// Voxels that one cell has lost to another of its component keep all sums but the centroid.
#[test]
fn voxels_in_another_cell_are_found() {
    let sound = Sound::new();
    let found = sound.broken(|set| {
        edit_table(set, "cells.csv", |rows| {
            let same = |i: usize, j: usize| i != j && rows[i][COMPONENT] == rows[j][COMPONENT];
            let all = usual(rows);
            let pair = all
                .iter()
                .find_map(|&i| Some((i, *all.iter().find(|j| same(i, **j))?)));
            let (at, same) = pair.unwrap();
            for (i, more) in [(at, 1), (same, -1)] {
                let voxels = rows[i][VOXELS].parse::<i64>().unwrap() + more;
                rows[i][VOXELS] = voxels.to_string();
            }
        });
        true
    });
    assert!(found.unwrap().contains(&Code::TableValue));
}

#[test]
fn wrong_rows_of_necks_are_found() {
    let sound = Sound::new();
    let value = &[Code::TableValue];
    // one with a place
    fn open(rows: &mut [Vec<String>]) -> &mut Vec<String> {
        rows.iter_mut().find(|row| !row[4].is_empty()).unwrap()
    }
    let count = &[Code::TableValue, Code::TotalsMismatch];
    sound.table("necks.csv", |rows| _ = rows.remove(1), count);
    sound.table("necks.csv", |rows| open(rows)[2] = "0.5".into(), value);
    sound.table("necks.csv", |rows| open(rows)[4].clear(), value);
    sound.table("necks.csv", |rows| open(rows)[6] = "1000".into(), value);
    sound.table("necks.csv", |rows| open(rows)[7] = "-1".into(), value);
    sound.table("necks.csv", |rows| rows.swap(1, 2), &[Code::TableRows]);
    sound.table("necks.csv", |rows| rows[1].swap(0, 1), &[Code::TableRows]);
    let twice = |rows: &mut Vec<Vec<String>>| rows.insert(1, rows[1].clone());
    sound.table(
        "necks.csv",
        twice,
        &[Code::TableRows, Code::TableValue, Code::TotalsMismatch],
    );
    let unknown = |rows: &mut Vec<Vec<String>>| {
        let mut row = rows.last().unwrap().clone();
        row[1] = "60000".into();
        rows.push(row);
    };
    sound.table(
        "necks.csv",
        unknown,
        &[Code::TableRows, Code::TableValue, Code::TotalsMismatch],
    );
    sound.table(
        "necks.csv",
        |rows| rows[0][0] = "x".into(),
        &[Code::TableSyntax],
    );
}

/// A neck between cells of two components, which both tables count.
#[test]
fn necks_between_components_are_found() {
    let found = Sound::new().broken(|set| {
        let mut pair = [0u64; 2];
        edit_table(set, "cells.csv", |rows| {
            let known = |r: &&mut Vec<String>| !r[COMPONENT].is_empty();
            let mut of: BTreeMap<String, &mut Vec<String>> = BTreeMap::new();
            for row in rows.iter_mut().filter(known) {
                of.entry(row[COMPONENT].clone()).or_insert(row);
            }
            let mut two: Vec<_> = of.into_values().take(2).collect();
            for row in &mut two {
                row[NECKS] = (row[NECKS].parse::<u64>().unwrap() + 1).to_string();
            }
            let id = |row: &[String]| row[0].parse().unwrap();
            pair = [id(two[0]), id(two[1])];
            pair.sort_unstable();
        });
        edit_table(set, "necks.csv", |rows| {
            let id = |row: &Vec<String>| [0, 1].map(|i| row[i].parse::<u64>().unwrap());
            let at = rows.partition_point(|row| id(row) < pair);
            let row = [
                &pair[0].to_string(),
                &pair[1].to_string(),
                "",
                "",
                "",
                "",
                "",
                "0",
            ];
            rows.insert(at, row.map(str::to_owned).to_vec());
        });
        set.manifest(|m| {
            m["totals"]["necks"] = (m["totals"]["necks"].as_u64().unwrap() + 1).into()
        });
        true
    });
    assert_eq!(found, Some(BTreeSet::from([Code::TableValue])));
}

#[test]
fn wrong_components_are_found() {
    let sound = Sound::new();
    let value = &[Code::TableValue];
    sound.table("components.csv", |rows| rows[0][VOXELS] = "9".into(), value);
    sound.table("components.csv", |rows| rows[0][TILES] = "99".into(), value);
    sound.table("components.csv", |rows| _ = rows.pop(), &[Code::TableRows]);
}

#[test]
fn wrong_surfaces_are_found() {
    let sound = Sound::new();
    let value = &[Code::TableValue];
    sound.table("surfaces.csv", |rows| rows[0][1] = "9999".into(), value);
    sound.table("surfaces.csv", |rows| rows[0][4] = "9999".into(), value);
    sound.table("surfaces.csv", |rows| rows[0][7] = "9999".into(), value);
    // an Euler characteristic where others touch the cell, and none where they do not
    let euler = |empty: bool| {
        move |rows: &mut Vec<Vec<String>>| {
            let row = rows
                .iter_mut()
                .find(|row| row[6].is_empty() == empty)
                .unwrap();
            row[6] = if empty { "2".into() } else { String::new() };
        }
    };
    sound.table("surfaces.csv", euler(true), value);
    sound.table("surfaces.csv", euler(false), value);
}

#[test]
fn wrong_indexes_are_found() {
    let sound = Sound::new();
    let expect = |edit: fn(&mut serde_json::Value), expected: &[Code]| {
        let found = sound.broken(|set| {
            set.manifest(edit);
            true
        });
        let expected: BTreeSet<Code> = expected.iter().copied().collect();
        assert_eq!(found, Some(expected));
    };
    expect(
        |m| m["cells"]["unlabelled"] = 7.into(),
        &[Code::ManifestValue],
    );
    expect(
        |m| m["cells"]["file"] = "a/b".into(),
        &[Code::ManifestValue],
    );
    expect(
        |m| m["totals"]["components"] = 99.into(),
        &[Code::TotalsMismatch],
    );
    expect(
        |m| m["totals"]["cells"] = 999.into(),
        &[Code::TotalsMismatch],
    );
    expect(
        |m| m["tables"]["necks"] = "neck.csv".into(),
        &[Code::MissingFile],
    );
    let remove = |m: &mut serde_json::Value| {
        m["tables"].as_object_mut().unwrap().remove("components");
    };
    expect(remove, &[Code::ManifestValue]);
}

/// What only sets of parts have is foreign to others.
#[test]
fn other_sets_have_no_components() {
    let dir = tempfile::tempdir().unwrap();
    Scan::new(6, [12, 11, 10], 4, false).convert(dir.path(), "own", false, &[]);
    let own = dir.path().join("own");
    fs::write(own.join("necks.csv"), "").unwrap();
    assert!(codes(&check(&own)).iter().eq([&Code::ForeignFile]));
    Set(&own).manifest(|m| m["tables"]["necks"] = "necks.csv".into());
    assert!(codes(&check(&own)).contains(&Code::ManifestValue));
}
