//! More than ten thousand single faults in real tile sets: the verifier finds each that changes the
//! surface, an id or a measure. Faults that it does not find are judged by reading both sets without
//! it: they must say the same.
//!
//! A member that the format does not have is found whatever it says. Faults with a name, of tile sets whose
//! sums and checksums agree with them, are in `named`, with those that the volume alone shows.
//!
//! Half of the faults leave checksums as they are; for the other half an adversary has mended sizes and
//! checksums, so that the laws alone can find them. Those compare numbers up to a millionth, and say
//! nothing of normals.

#[path = "../common/mod.rs"]
mod common;
mod faults;
mod judge;
mod named;
mod random;

use alvis::convert::{ConvertOptions, convert};
use alvis::grid::{Ambiguous, Dims, Placement, Unit};
use alvis::manifest::Form;
use alvis::progress::Quiet;
use alvis::verify::{VerifyOptions, verify};
use alvis::volume::MemoryVolume;
use faults::{Files, Kind};
use judge::Essence;
use random::Random;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Faults in all.
const FAULTS: u64 = 10_240;

/// Metal with pores: inside, cut by faces and corners, and one with a grain of metal in it. Only the
/// metal reaches both faces across x.
fn volume(grow: f32) -> MemoryVolume<u8> {
    let [nx, ny, nz] = [14, 12, 11];
    let pores = [
        [4.1, 4.3, 3.9, 2.7],
        [9.6, 7.2, 6.4, 2.9],
        [0.2, 9.8, 8.7, 2.2],
        [13.1, 2.0, 2.3, 2.1],
        [7.4, 0.3, 9.9, 1.9],
        [3.3, 8.6, 0.4, 1.6],
    ];
    let mut samples = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let at = |p: &[f32; 4]| {
                    let d = [x as f32 - p[0], y as f32 - p[1], z as f32 - p[2]];
                    d.iter().map(|v| v * v).sum::<f32>().sqrt()
                };
                let mut value = pores
                    .iter()
                    .map(|p| at(p) - p[3] - grow)
                    .fold(9.0, f32::min);
                value = value.max(0.9 - at(&pores[1]));
                samples.push((128.0 + 20.0 * value).clamp(0.0, 255.0) as u8);
            }
        }
    }
    let place = Placement {
        spacing: [0.5, 0.75, 0.25],
        unit: Unit::Millimetre,
        origin: [10.0, -3.0, 0.125],
        ..Placement::default()
    };
    MemoryVolume::new(Dims::new([nx, ny, nz]).unwrap(), place, samples).unwrap()
}

/// A tile set, and two others of the same volume: of another threshold, and of another volume.
struct Subject {
    name: &'static str,
    files: Files,
    others: [Files; 2],
    essence: Essence,
}

fn subjects(dir: &Path) -> Vec<Subject> {
    let form = |form: Form| ConvertOptions {
        primitives: form.primitives,
        encoding: form.encoding,
        layout: form.layout,
        threshold: 128.0,
        macrocube: [7, 6, 5],
        ..ConvertOptions::default()
    };
    let many = ConvertOptions {
        macrocube: [4, 4, 4],
        ..form(Form::MESHLAB)
    };
    let capped = ConvertOptions {
        cap: true,
        ambiguous: Ambiguous::Join,
        ..form(Form::BLENDER)
    };
    let merged = ConvertOptions {
        layout: alvis::manifest::Layout::Merged,
        ..form(Form::BLENDER)
    };
    let all = [
        ("blender", form(Form::BLENDER)),
        ("web", form(Form::WEB)),
        ("many lists", many),
        ("capped", capped),
        ("merged", merged),
    ];
    let make = |name: &str, grow: f32, options: &ConvertOptions| {
        let dir = dir.join(name);
        convert(&volume(grow), options, &dir, &Quiet).unwrap();
        dir
    };
    let one = |(name, options): (&'static str, ConvertOptions)| {
        let own = make(name, 0.0, &options);
        let threshold = ConvertOptions {
            threshold: 131.0,
            ..options.clone()
        };
        let replays = [
            make(&format!("{name} threshold"), 0.0, &threshold),
            make(&format!("{name} volume"), 0.3, &options),
        ];
        Subject {
            name,
            files: common::files(&own),
            others: replays.map(|d| common::files(&d)),
            essence: Essence::read(&own).unwrap(),
        }
    };
    all.into_iter().map(one).collect()
}

/// A directory that holds some files, and knows which, so that few are written.
struct Place {
    dir: PathBuf,
    holds: Files,
}

impl Place {
    fn put(&mut self, files: &Files) {
        for name in self.holds.keys().filter(|n| !files.contains_key(*n)) {
            let path = self.dir.join(name);
            std::fs::remove_file(&path).unwrap();
            // a directory that is left empty goes with its last file
            let _ = std::fs::remove_dir(path.parent().unwrap());
        }
        for (name, bytes) in files {
            if self.holds.get(name) != Some(bytes) {
                let path = self.dir.join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, bytes).unwrap();
            }
        }
        self.holds = files.clone();
    }
}

/// What became of the faults of a kind: found, harmless, and such that changed nothing.
type Counts = BTreeMap<(bool, Kind), [u64; 3]>;

/// Applies fault `i`; an error says what was missed.
fn one(i: u64, subjects: &[Subject], places: &mut [Place], counts: &mut Counts) -> Option<String> {
    let at = (i % subjects.len() as u64) as usize;
    let (subject, place) = (&subjects[at], &mut places[at]);
    let turn = i / subjects.len() as u64;
    let (mended, kind) = (turn % 2 == 1, Kind::turn(turn / 2));
    let mut files = subject.files.clone();
    let mut random = Random::new(i);
    let told = faults::apply(kind, &mut files, &subject.others, &mut random);
    let changed = files != subject.files;
    if mended {
        faults::mend(&mut files);
    }
    place.put(&files);
    let options = VerifyOptions {
        threads: 1,
        max_issues: 5,
        ..VerifyOptions::default()
    };
    // no readable manifest is an error
    let ok = verify(&place.dir, &options, &Quiet).is_ok_and(|r| r.ok);
    let count = counts.entry((mended, kind)).or_default();
    if !changed {
        count[2] += 1;
        return (!ok).then(|| format!("fault {i} in {}: {told}: nothing changed", subject.name));
    }
    if !ok {
        count[0] += 1;
        return None;
    }
    count[1] += 1;
    let mended_away = mended && {
        let mut sound = subject.files.clone();
        faults::mend(&mut sound);
        sound == files
    };
    if kind == Kind::MemberAdded && !mended_away {
        return Some(format!("fault {i} in {}: {told}: missed", subject.name));
    }
    let error = if mended { 1e-6 } else { 0.0 };
    match Essence::read(&place.dir) {
        Ok(found) if found.same(&subject.essence, error) => None,
        Ok(_) => Some(format!("fault {i} in {}: {told}: missed", subject.name)),
        Err(e) => Some(format!(
            "fault {i} in {}: {told}: not seen: {e}",
            subject.name
        )),
    }
}

#[test]
fn every_fault_that_changes_a_tile_set_is_found() {
    let shm = Path::new("/dev/shm");
    let temporary = if shm.is_dir() {
        tempfile::tempdir_in(shm)
    } else {
        tempfile::tempdir()
    }
    .unwrap();
    let subjects = subjects(temporary.path());
    let next = AtomicU64::new(0);
    let (all, missed) = (Mutex::new(Counts::new()), Mutex::new(Vec::new()));
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for worker in 0..workers {
            let (subjects, next, all, missed) = (&subjects, &next, &all, &missed);
            let dir = temporary.path().join(format!("worker {worker}"));
            scope.spawn(move || {
                let place = |s: usize| Place {
                    dir: dir.join(s.to_string()),
                    holds: Files::new(),
                };
                let mut places: Vec<Place> = (0..subjects.len()).map(place).collect();
                let mut counts = Counts::new();
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= FAULTS {
                        break;
                    }
                    if let Some(text) = one(i, subjects, &mut places, &mut counts) {
                        missed.lock().unwrap().push(text);
                    }
                }
                let mut all = all.lock().unwrap();
                for (key, count) in counts {
                    let sum = all.entry(key).or_default();
                    (0..3).for_each(|k| sum[k] += count[k]);
                }
            });
        }
    });
    let mut missed = missed.into_inner().unwrap();
    missed.sort();
    report(&all.into_inner().unwrap());
    assert!(
        missed.is_empty(),
        "{} missed:\n{}",
        missed.len(),
        missed.join("\n")
    );
}

/// Prints the counts past the capture of test output.
fn report(counts: &Counts) {
    let mut text = String::from("faults by kind: found, harmless, nothing changed\n");
    let mut sums = [0; 3];
    for mended in [false, true] {
        for kind in Kind::ALL {
            let c = counts.get(&(mended, kind)).copied().unwrap_or_default();
            (0..3).for_each(|k| sums[k] += c[k]);
            let how = if mended { "mended" } else { "plain" };
            text += &format!(
                "  {how:6} {:12} {:5} {:5} {:5}\n",
                format!("{kind:?}"),
                c[0],
                c[1],
                c[2]
            );
        }
    }
    text += &format!("  in all {:18} {:5} {:5}\n", sums[0], sums[1], sums[2]);
    assert!(sums[0] > FAULTS / 2, "hardly any fault was found");
    let _ = std::io::stderr().write_all(text.as_bytes());
}
