//! A conversion that was interrupted goes on where it was, and ends as if nothing had happened.

mod command;
mod common;

use alvis::convert::{ConvertOptions, NeckRule, convert, interrupted};
use alvis::grid::{Ambiguous, Crop};
use alvis::manifest::{Encoding, Layout};
use alvis::progress::{Progress, Quiet};
use alvis::volume::{OpenOptions, Volume, open};
use command::{fails, ok};
use common::volumes::{Random, foam, late_joins, noise, placed};
use common::{assert_same_files, copy_all, files, options};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const WORK: &str = ".alvis-partial";

/// Asks to stop after so many looks, and remembers what was said.
struct StopAfter {
    looks: AtomicU64,
    said: Mutex<Vec<String>>,
}

impl StopAfter {
    fn new(looks: u64) -> Self {
        StopAfter {
            looks: AtomicU64::new(looks),
            said: Mutex::default(),
        }
    }
}

impl Progress for StopAfter {
    fn interrupted(&self) -> bool {
        let step = |n: u64| n.checked_sub(1);
        self.looks
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, step)
            .is_err()
    }

    fn warn(&self, message: &str) {
        self.said.lock().unwrap().push(message.to_string());
    }
}

/// Stops at every place where a conversion can be stopped, and goes on, once or again and again.
fn stop_everywhere(what: &str, volume: &dyn Volume, options: &ConvertOptions) {
    stop_in_steps(what, volume, options, |looks| looks / 6 + 2);
}

/// The same, where `step` tells how far a conversion of so many places gets that is stopped again and again.
fn stop_in_steps(
    what: &str,
    volume: &dyn Volume,
    options: &ConvertOptions,
    step: impl Fn(u64) -> u64,
) {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole");
    let counting = StopAfter::new(u64::MAX);
    let report = convert(volume, options, &whole, &counting).unwrap();
    let looks = u64::MAX - counting.looks.load(Ordering::Relaxed);
    let expected = files(&whole);
    let resume = ConvertOptions {
        resume: true,
        // what changes no byte may change
        memory: options.memory + 1_000_000,
        threads: 3 - options.threads.min(2),
        ..options.clone()
    };
    let mut kept = 0;
    for stop in 0..looks {
        let out = dir.path().join(format!("stop{stop}"));
        let stopped = convert(volume, options, &out, &StopAfter::new(stop));
        assert!(
            matches!(stopped, Err(alvis::Error::Interrupted)),
            "{what}: {stop}"
        );
        assert!(!out.join("index.json").exists());
        let at = interrupted(&out);
        assert_eq!(at.is_some(), out.exists(), "{what}: {stop}");
        let again = convert(volume, &resume, &out, &Quiet).unwrap();
        assert_eq!(
            again.resumed_layers,
            at.map_or(0, |k| k.done),
            "{what}: {stop}"
        );
        assert!(again.resumed_layers >= kept, "{what}: {stop}");
        kept = again.resumed_layers;
        assert_eq!(
            (again.totals, again.bytes_written),
            (report.totals, report.bytes_written)
        );
        assert_same_files(&files(&out), &expected, &format!("{what}: {stop}"));
        std::fs::remove_dir_all(&out).unwrap();
    }
    assert!(kept > 0, "{what}");
    // again and again, each time a little further
    let out = dir.path().join("steps");
    let mut times = 0;
    while convert(volume, &resume, &out, &StopAfter::new(step(looks))).is_err() {
        times += 1;
        assert!(times < looks, "{what}: it does not come to an end");
    }
    // not more than once with steps of more than half the way
    assert!(times > u64::from(2 * step(looks) <= looks), "{what}");
    assert_same_files(&files(&out), &expected, what);
    eprintln!("{what}: stopped at {looks} places, and {times} times in a row");
}

#[test]
fn every_layer_of_every_kind() {
    let dims = [30, 26, 29];
    let foam = placed(dims, foam(dims, 5));
    let base = options([15, 13, 3]);
    stop_everywhere("foam", &foam, &base);
    let crop = Crop {
        x: 1..29,
        y: 2..26,
        z: 3..20,
    };
    let cut = ConvertOptions {
        cap: true,
        crop: Some(crop),
        ambiguous: Ambiguous::Join,
        ..base.clone()
    };
    stop_everywhere("cut", &foam, &cut);
    let dust = ConvertOptions {
        min_voxels: 20,
        macrocube: [15, 13, 6],
        ..base.clone()
    };
    stop_everywhere("dust", &foam, &dust);
    let split = ConvertOptions {
        split: Some(NeckRule::default()),
        keep_samples: true,
        macrocube: [9, 8, 5],
        ..base.clone()
    };
    let few = [18, 16, 15];
    let small_foam = placed(few, common::volumes::foam(few, 5));
    // splitting begins anew each time
    stop_in_steps("split", &small_foam, &split, |looks| looks * 3 / 4);
    let walls = ConvertOptions {
        walls: true,
        parquet: true,
        macrocube: [18, 16, 5],
        ..base.clone()
    };
    // so do walls
    stop_in_steps("walls", &small_foam, &walls, |looks| looks * 3 / 4);
    let web = ConvertOptions {
        encoding: Encoding::Meshopt,
        layout: Layout::Merged,
        ..base.clone()
    };
    stop_everywhere("web", &foam, &web);
    let (dims, values) = late_joins();
    let joins = placed(dims, values);
    let small = [20, 19, 18];
    let noise = placed(small, noise(small, 3));
    for (form, what) in [(&base, "plain"), (&web, "web")] {
        let with = |macrocube| ConvertOptions {
            macrocube,
            ..form.clone()
        };
        let of = |volume| format!("{volume}, {what}");
        stop_everywhere(&of("late joins"), &joins, &with([16, 8, 4]));
        stop_everywhere(&of("noise"), &noise, &with([7, 6, 5]));
    }
}

#[test]
fn inputs_that_are_read_forwards_only() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let foam = "phantom foam v.raw --dims 24,22,20 --pitch 9 --force --quiet";
    // one band is read in one go; with several the input is unpacked first
    for macrocube in [[64, 64, 4], [10, 10, 5]] {
        ok(here, &words(foam));
        let raw = std::fs::read(here.join("v.raw")).unwrap();
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, &raw).unwrap();
        std::fs::write(here.join("v.raw.gz"), packed.finish().unwrap()).unwrap();
        let open_options = OpenOptions {
            dims: Some([24, 22, 20]),
            dtype: Some(alvis::volume::Dtype::U8),
            ..OpenOptions::default()
        };
        let opened = open(&here.join("v.raw.gz"), &open_options).unwrap();
        assert!(!opened.volume.random_access());
        stop_everywhere("gzip", &*opened.volume, &options(macrocube));
    }
}

/// A foam on disk, of which a conversion takes some tenths of a second.
const FOAM: &str = "phantom foam foam.mhd --dims 96,96,96 --pitch 14 --quiet";
const CONVERT: &str = "convert foam.mhd out --threshold 128 --macrocube 48,48,2 --threads 2";
/// The same time for noise: what is apart in a layer is joined in the next.
const NOISE: [u32; 3] = [32, 24, 96];
const CONVERT_NOISE: &str = "convert noise.raw out --dims 32,24,96 --dtype u8 --threshold 128 --macrocube 48,48,2 \
                             --threads 2";
const LAYERS: u64 = 48;
/// Layers that are labelled, and then meshed.
const OF_BOTH: u64 = 2 * LAYERS;

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

/// What a killed conversion has left on the disk.
#[derive(Debug)]
struct Left {
    stage: &'static str,
    /// Layers of which a tile, or the shard, has been begun.
    tiles: u64,
    shards: u64,
}

fn left(out: &Path) -> Left {
    let work = out.join(WORK);
    let count = |dir: &str| std::fs::read_dir(work.join(dir)).map_or(0, |d| d.count() as u64);
    let has_tile = |z: u64| count(&format!("tiles/z{z:04}")) > 0;
    let tiles = (0..LAYERS)
        .rev()
        .find(|&z| has_tile(z))
        .map_or(0, |z| z + 1);
    // the shard of a layer that is done again lies beside the one from before
    let begun = |z: &u64| {
        let shard = work.join(format!("index/z{z:04}.json"));
        shard.exists() || shard.with_extension("json.new").exists()
    };
    let shards = (0..LAYERS).filter(begun).count() as u64;
    let stage = match (
        out.join("index.json").exists(),
        work.join("moving").exists(),
    ) {
        (true, _) => "after the manifest",
        (_, true) => "moving in",
        _ if shards == LAYERS => "tables",
        _ if shards > 0 => "index",
        _ if tiles == LAYERS && interrupted(out).is_some_and(|k| k.done == k.of) => "resolving ids",
        _ if tiles > 0 => "tiles",
        _ => "before the first tile",
    };
    Left {
        stage,
        tiles,
        shards,
    }
}

/// Numbers of layers of the sweeps and of the index that a conversion said it goes on with.
fn said(errors: &str) -> Option<(u64, u64)> {
    let line = errors
        .lines()
        .find_map(|l| l.strip_prefix("warning: resuming: "))?;
    if let Some(all) = line.strip_prefix("all ") {
        let n = all.split(' ').next()?.parse().ok()?;
        return Some((n, LAYERS));
    }
    let done = line.split(' ').next()?.parse().ok()?;
    let index = line.split(", and ").nth(1);
    let index = index.and_then(|t| t.split(' ').next()?.parse().ok());
    Some((done, index.unwrap_or(0)))
}

/// Runs conversions that are killed at random moments until `kills` have hit, each going on with what
/// the one before has left, and compares every one that comes to its end.
fn kill_at_random(convert: &str, more: &str, kills: u64, seed: u64) {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    std::fs::write(here.join("noise.raw"), noise(NOISE, 1)).unwrap();
    let line = format!("{convert}{more}");
    let start = Instant::now();
    ok(here, &words(&line));
    let time = start.elapsed();
    let out = here.join("out");
    let expected = files(&out);
    std::fs::remove_dir_all(&out).unwrap();
    let sweeps = if more.contains("--min-voxels") { 4 } else { 2 };
    let mut random = Random(seed);
    let mut stages = std::collections::BTreeMap::<&str, u64>::new();
    let (mut hits, mut ends, mut redone) = (0, 0, [0u64; 2]);
    let mut before: Option<Left> = None;
    while hits < kills {
        let errors = std::fs::File::create(here.join("errors")).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_alvis"))
            .args(words(&line))
            .arg("--resume")
            .current_dir(here)
            .stdout(Stdio::null())
            .stderr(errors)
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs_f64(
            time.as_secs_f64() * 0.7 * random.unit(),
        ));
        let ended = child.try_wait().unwrap();
        child.kill().unwrap();
        let status = ended.unwrap_or(child.wait().unwrap());
        let text = std::fs::read_to_string(here.join("errors")).unwrap();
        if let (Some(left), Some((swept, index))) = (&before, said(&text)) {
            let swept = swept.saturating_sub((sweeps - 1) * LAYERS);
            let lost = [
                left.tiles.saturating_sub(swept),
                left.shards.saturating_sub(index),
            ];
            // two layers of a sweep may be open at once
            assert!(lost[0] <= 2 && lost[1] <= 1, "{left:?}: {text}");
            redone[0] += lost[0];
            redone[1] += lost[1];
        } else if let Some(left) = &before
            && ended.is_some()
            && !text.contains("nothing to resume")
        {
            assert!(left.tiles <= 2, "{left:?}: {text}");
        }
        if status.success() {
            assert_same_files(&files(&out), &expected, more);
            std::fs::remove_dir_all(&out).unwrap();
            (before, ends) = (None, ends + 1);
            continue;
        }
        assert_eq!(status.code(), None, "{text}");
        hits += 1;
        let now = left(&out);
        *stages.entry(now.stage).or_default() += 1;
        before = Some(now);
    }
    eprintln!(
        "{hits} kills, {ends} conversions came to their end; of the layers begun {} of the sweep and {} of \
         the index were done again: {stages:?}",
        redone[0], redone[1]
    );
    ok(here, &words(&format!("{line} --resume")));
    assert_same_files(&files(&out), &expected, more);
    assert!(ends > 0 && stages.len() > 1);
}

#[test]
fn kills_at_any_moment() {
    kill_at_random(CONVERT, "", 140, 1);
}

#[test]
fn kills_of_conversions_that_encode_tiles() {
    kill_at_random(CONVERT, " --for web", 40, 2);
}

#[test]
fn kills_of_conversions_of_noise() {
    kill_at_random(CONVERT_NOISE, " --for web", 40, 4);
}

#[test]
fn kills_of_conversions_that_find_small_components_first() {
    kill_at_random(CONVERT, " --min-voxels 30", 40, 3);
}

/// Runs a conversion until it has finished some layers, and kills it.
fn half_done(here: &Path, line: &str) {
    for _ in 0..20 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_alvis"))
            .args(words(line))
            .arg("--quiet")
            .current_dir(here)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let out = here.join("out");
        let kept = || interrupted(&out).map_or(0, |k| k.done);
        while child.try_wait().unwrap().is_none() && kept() < 4 {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        if child.wait().unwrap().code().is_none() && kept() > 0 {
            return;
        }
        let _ = std::fs::remove_dir_all(&out);
    }
    panic!("the conversion ends too fast");
}

#[test]
fn a_whole_set_with_an_unfinished_conversion_beside_it_is_told_from_a_new_one() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    let replace = format!("{} --force", CONVERT.replace("128", "120"));
    half_done(here, &replace);
    let (work, aside) = (here.join("out").join(WORK), here.join("aside"));
    std::fs::rename(&work, &aside).unwrap();
    ok(here, &words(CONVERT));
    let verify = || command::alvis(here, &["verify", "out"]);
    let said = |output: &std::process::Output| String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!said(&verify()).contains("not finished"));
    // as it lies when a conversion is killed that was to replace the set
    std::fs::rename(&aside, &work).unwrap();
    let verified = verify();
    assert_eq!(verified.status.code(), Some(0));
    assert!(said(&verified).contains("not finished"));
    // without --force the whole set stays, and it is said what goes on in place of it
    let refused = fails(here, &words(&CONVERT.replace("128", "120 --resume")));
    assert!(refused.contains("--force beside --resume"), "{refused}");
    let stays = command::alvis(here, &words(&format!("{CONVERT} --resume")));
    assert_eq!(stays.status.code(), Some(0));
    assert!(said(&stays).contains("with --force and --resume"));
    let refused = fails(here, &["lod", "out"]);
    assert!(refused.contains("typed again with --resume"), "{refused}");
    ok(here, &words(&format!("{replace} --resume")));
    assert!(!said(&verify()).contains("not finished"));
}

/// A conversion that was begun by force in place of the same set goes on by force; else that set stays, and what was begun
/// goes, for it would have been the same.
#[test]
fn a_conversion_in_place_of_the_same_set_goes_on_or_is_dropped() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    let out = here.join("out");
    let (work, aside) = (out.join(WORK), here.join("aside"));
    half_done(here, CONVERT);
    std::fs::rename(&work, &aside).unwrap();
    let with_levels = format!("{CONVERT} --lod");
    ok(here, &words(&with_levels));
    let expected = files(&out);
    for before in [&with_levels[..], CONVERT] {
        for (more, goes_on) in [(" --force --resume", true), (" --resume", false)] {
            ok(here, &words(&format!("{before} --force")));
            copy_all(&aside, &work);
            let again = command::alvis(here, &words(&format!("{with_levels}{more}")));
            let said = String::from_utf8_lossy(&again.stderr).into_owned();
            assert_eq!(again.status.code(), Some(0), "{said}");
            assert_eq!(said.contains("resuming: "), goes_on, "{said}");
            assert_eq!(said.contains("was removed"), !goes_on, "{said}");
            assert_same_files(&files(&out), &expected, more);
            let verified = command::alvis(here, &["verify", "out"]);
            let said = String::from_utf8_lossy(&verified.stderr);
            assert!(
                verified.status.success() && !said.contains("warning"),
                "{said}"
            );
        }
    }
}

#[test]
fn another_conversion_is_refused_with_what_differs() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    half_done(here, CONVERT);
    let kept = interrupted(&here.join("out"));
    for (option, was, is) in [
        ("--cap", "was false", "is true"),
        ("--ambiguous join", "was separate", "is join"),
        ("--min-voxels 9", "was 1", "is 9"),
        ("--crop :,:,0:50", "was none", "is 0..96,0..96,0..50"),
        ("--primitives triangles", "was strips", "is triangles"),
        ("--encoding quantized", "was float", "is quantized"),
        ("--layout merged", "was auto", "is merged"),
        (
            "--spacing 2 --unit voxel",
            "was [1.0, 1.0, 1.0]",
            "is [2.0, 2.0, 2.0]",
        ),
        ("--unit mm --spacing 1", "was voxel", "is mm"),
        ("--invert", "filters was nothing", "is invert"),
    ] {
        let message = fails(here, &words(&format!("{CONVERT} --resume {option}")));
        let name = option.split(' ').next().filter(|name| *name != "--invert");
        for part in [
            name.unwrap_or("filters"),
            was,
            is,
            "--force instead of --resume",
            "out: ",
        ] {
            assert!(message.contains(part), "{option}: {part}: {message}");
        }
    }
    for (old, new) in [
        ("--threshold 128", "--threshold 127"),
        ("--macrocube 48,48,2", "--macrocube 48,48,3"),
    ] {
        let message = fails(
            here,
            &words(&format!("{} --resume", CONVERT.replace(old, new))),
        );
        assert!(
            message.contains(old.split(' ').next().unwrap()),
            "{message}"
        );
    }
    let raw = here.join("foam.raw");
    let before = std::fs::metadata(&raw).unwrap().modified().unwrap();
    let file = std::fs::File::options().write(true).open(&raw).unwrap();
    file.set_modified(before + Duration::from_secs(1)).unwrap();
    let message = fails(here, &words(&format!("{CONVERT} --resume")));
    assert!(
        message.contains("last change of the input was"),
        "{message}"
    );
    file.set_modified(before).unwrap();
    assert_eq!(
        interrupted(&here.join("out")),
        kept,
        "a refusal leaves all as it was"
    );
    // these change nothing
    let other = "--memory 300MB --io mmap --json --quiet --force --resume";
    let line = format!("{} {other}", CONVERT.replace("--threads 2", "--threads 1"));
    let report = command::json(&ok(here, &words(&line)));
    assert_eq!(report["resumed_layers"], kept.unwrap().done);
    ok(here, &words(&CONVERT.replace(" out ", " whole ")));
    assert_same_files(
        &files(&here.join("out")),
        &files(&here.join("whole")),
        "options",
    );
}

#[test]
fn a_whole_set_of_an_input_that_changed_since_is_not_taken_for_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    std::fs::write(here.join("a.raw"), noise([8; 3], 1)).unwrap();
    let line = "convert a.raw out --dims 8,8,8 --dtype u8 --threshold 128 --quiet";
    ok(here, &words(line));
    let before = files(&here.join("out"));
    ok(here, &words(&format!("{line} --resume")));
    std::fs::write(here.join("a.raw"), noise([8; 3], 2)).unwrap();
    let made = std::fs::metadata(here.join("out/index.json")).unwrap();
    let file = std::fs::File::options()
        .write(true)
        .open(here.join("a.raw"));
    let later = made.modified().unwrap() + Duration::from_nanos(1);
    file.unwrap().set_modified(later).unwrap();
    let message = fails(here, &words(&format!("{line} --resume")));
    assert!(message.contains("--force"), "{message}");
    assert_same_files(&files(&here.join("out")), &before, "a refusal");
    ok(here, &words(&format!("{line} --resume --force")));
    assert!(files(&here.join("out")) != before);
}

#[test]
#[cfg(feature = "zarr")]
fn another_array_of_the_same_input_is_another_conversion() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    for (name, seed) in [("a", 1), ("b", 2)] {
        let array = here.join("two.zarr").join(name);
        std::fs::create_dir_all(&array).unwrap();
        let meta = r#"{"zarr_format": 2, "shape": [8, 8, 8], "chunks": [8, 8, 8], "dtype": "|u1",
            "compressor": null, "fill_value": 0, "order": "C", "filters": null}"#;
        std::fs::write(array.join(".zarray"), meta).unwrap();
        std::fs::write(array.join("0.0.0"), noise([8; 3], seed)).unwrap();
    }
    let group = here.join("two.zarr").join(".zgroup");
    std::fs::write(group, r#"{"zarr_format": 2}"#).unwrap();
    let line = "convert two.zarr out --threshold 128 --quiet --dataset";
    ok(here, &words(&format!("{line} a")));
    let before = files(&here.join("out"));
    let index = command::json(std::str::from_utf8(&before["index.json"]).unwrap());
    assert_eq!(index["source"]["dataset"], "a");
    ok(here, &words(&format!("{line} a --resume")));
    fails(here, &words(&format!("{line} b --resume")));
    assert_same_files(&files(&here.join("out")), &before, "a refusal");
}

/// The foam as a folder of slices and as a Zarr array of many chunks.
fn in_many_files(here: &Path) {
    let raw = std::fs::read(here.join("foam.raw")).unwrap();
    std::fs::create_dir(here.join("slices")).unwrap();
    for (z, slice) in raw.chunks(96 * 96).enumerate() {
        std::fs::write(here.join(format!("slices/s{z:03}.raw")), slice).unwrap();
    }
    std::fs::create_dir(here.join("foam.zarr")).unwrap();
    let meta = r#"{"zarr_format":2,"shape":[96,96,96],"chunks":[8,96,96],"dtype":"|u1","order":"C",
        "compressor":null,"filters":null,"fill_value":0}"#;
    std::fs::write(here.join("foam.zarr/.zarray"), meta).unwrap();
    for (z, chunk) in raw.chunks(8 * 96 * 96).enumerate() {
        std::fs::write(here.join(format!("foam.zarr/{z}.0.0")), chunk).unwrap();
    }
}

#[test]
fn inputs_of_many_files() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    in_many_files(here);
    for (input, part) in [
        ("slices --dims 96,96,96 --dtype u8", "slices/s070.raw"),
        ("foam.zarr", "foam.zarr/7.0.0"),
    ] {
        let line = CONVERT.replace("foam.mhd out", &format!("{input} out"));
        half_done(here, &line);
        let kept = interrupted(&here.join("out")).unwrap();
        let path = here.join(part);
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        let before = file.metadata().unwrap().modified().unwrap();
        // one that is not the last to have changed
        for moment in [
            before - Duration::from_secs(9),
            before + Duration::from_secs(9),
        ] {
            file.set_modified(moment).unwrap();
            let message = fails(here, &words(&format!("{line} --resume")));
            assert!(message.contains("files of the input was"), "{message}");
        }
        file.set_modified(before).unwrap();
        let resume = format!("{line} --resume --json --quiet");
        let report = command::json(&ok(here, &words(&resume)));
        assert_eq!(report["resumed_layers"], kept.done, "{input}");
        ok(here, &words(&line.replace(" out ", " whole ")));
        let whole = files(&here.join("whole"));
        assert_same_files(&files(&here.join("out")), &whole, input);
        for made in ["out", "whole"] {
            std::fs::remove_dir_all(here.join(made)).unwrap();
        }
    }
}

#[test]
fn without_resume_it_is_refused_or_begun_anew_by_force() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    half_done(here, CONVERT);
    let kept = interrupted(&here.join("out")).unwrap();
    // nobody else takes the directory
    ok(here, &words(&CONVERT.replace(" out ", " whole ")));
    let message = fails(here, &words("select whole out --where volume>0"));
    assert!(message.contains("--force"), "{message}");
    for threshold in ["--threshold otsu", "--threshold 128"] {
        let message = fails(here, &words(&CONVERT.replace("--threshold 128", threshold)));
        let done = format!("{} of {OF_BOTH} layers are done", kept.done);
        for part in [&done, "--resume", "--force"] {
            assert!(message.contains(part), "{message}");
        }
    }
    assert_eq!(interrupted(&here.join("out")).unwrap(), kept);
    let output = command::alvis(here, &words(&format!("{CONVERT} --force")));
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    let line = format!("dropping {} of {OF_BOTH} layers", kept.done);
    assert!(errors.contains(&line), "{errors}");
    let expected = files(&here.join("out"));

    // all is there: nothing is done
    let report = command::json(&ok(
        here,
        &words(&format!("{CONVERT} --resume --json --quiet")),
    ));
    assert_eq!(report["resumed_layers"], OF_BOTH);
    let plain = fails(here, &words(CONVERT));
    assert!(plain.contains("--force"), "{plain}");
    let other = fails(here, &words(&format!("{CONVERT} --cap --resume")));
    assert!(other.contains("--force"), "{other}");
    assert_same_files(&files(&here.join("out")), &expected, "complete");

    // nothing is there: it converts
    std::fs::remove_dir_all(here.join("out")).unwrap();
    let fresh = command::json(&ok(
        here,
        &words(&format!("{CONVERT} --resume --json --quiet")),
    ));
    assert_eq!(fresh["resumed_layers"], 0);
    assert_same_files(&files(&here.join("out")), &expected, "fresh");
    for key in ["tiles", "triangles", "bytes_written", "surfaces"] {
        assert_eq!(fresh[key], report[key], "{key}");
    }
}

#[test]
fn damaged_states_are_never_gone_on_with() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    ok(here, &words(&CONVERT.replace(" out ", " whole ")));
    let expected = files(&here.join("whole"));
    half_done(here, CONVERT);
    let out = here.join("out");
    let state = files(&out);
    let mut tried = 0;
    for (name, bytes) in &state {
        let part = name.strip_prefix(&format!("{WORK}/")).unwrap();
        if !(part.starts_with("spools/") || part == "checkpoint" || part == "conversion.json") {
            continue;
        }
        for damage in 0..3 {
            let mut bad = bytes.clone();
            match damage {
                0 => bad.truncate(bytes.len() / 2),
                1 => bad
                    .iter_mut()
                    .skip(bytes.len() / 3)
                    .take(1)
                    .for_each(|b| *b ^= 4),
                _ => bad.fill(0),
            }
            if bad == *bytes {
                continue;
            }
            let _ = std::fs::remove_dir_all(&out);
            for (name, bytes) in &state {
                let path = out.join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, bytes).unwrap();
            }
            std::fs::write(out.join(name), bad).unwrap();
            let report = ok(here, &words(&format!("{CONVERT} --resume --json --quiet")));
            assert_eq!(
                command::json(&report)["resumed_layers"],
                0,
                "{name}: {damage}"
            );
            assert_same_files(&files(&out), &expected, name);
            tried += 1;
        }
    }
    assert!(tried > 9, "{tried}");
}

#[test]
fn ctrl_c_keeps_what_is_done_and_says_how_to_go_on() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    ok(here, &words(&CONVERT.replace(" out ", " whole ")));
    for signal in [libc::SIGINT, libc::SIGTERM] {
        let mut process = Command::new(env!("CARGO_BIN_EXE_alvis"))
            .args(words(CONVERT))
            .current_dir(here)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map(Owned)
            .unwrap();
        while interrupted(&here.join("out")).is_none() {
            assert!(process.0.try_wait().unwrap().is_none(), "it ended too fast");
            std::thread::sleep(Duration::from_millis(1));
        }
        let id = process.0.id() as libc::pid_t;
        // SAFETY: the process is this one's child and has not been waited for.
        let sent = unsafe { libc::kill(id, signal) };
        assert_eq!(sent, 0);
        let mut errors = String::new();
        let mut pipe = process.0.stderr.take().unwrap();
        std::io::Read::read_to_string(&mut pipe, &mut errors).unwrap();
        assert_eq!(process.0.wait().unwrap().code(), Some(2), "{errors}");
        let kept = interrupted(&here.join("out")).unwrap();
        let message = errors.lines().last().unwrap();
        let done = format!(
            "stopped on request: {} of {OF_BOTH} layers are done",
            kept.done
        );
        assert!(message.contains(&done), "{errors}");
        // the very command is typed
        let (_, next) = message.split_once("`alvis ").unwrap();
        let (next, _) = next.split_once('`').unwrap();
        assert_eq!(next, format!("{CONVERT} --resume"));
        ok(here, &words(&format!("{next} --quiet")));
        let expected = files(&here.join("whole"));
        assert_same_files(&files(&here.join("out")), &expected, "after a signal");
        std::fs::remove_dir_all(here.join("out")).unwrap();
    }
}

/// A process that does not outlive the test, however that ends.
struct Owned(Child);

impl Drop for Owned {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Owned {
    /// Stops all threads of the process, and returns when they have stopped.
    fn stop(&self) {
        let id = self.0.id() as libc::pid_t;
        let mut status = 0;
        // SAFETY: the process is this one's child and has not been waited for; `status` outlives the call.
        unsafe {
            assert_eq!(libc::kill(id, libc::SIGSTOP), 0);
            assert_eq!(libc::waitpid(id, &mut status, libc::WUNTRACED), id);
        }
        assert!(libc::WIFSTOPPED(status), "it ended too fast");
    }
}

#[test]
fn a_second_conversion_is_refused_while_the_first_lives() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    ok(here, &words(FOAM));
    let out = here.join("out");
    let first = Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(words(CONVERT))
        .arg("--quiet")
        .current_dir(here)
        .stdout(Stdio::null())
        .spawn();
    let mut first = Owned(first.unwrap());
    while interrupted(&out).is_none() {
        assert!(first.0.try_wait().unwrap().is_none(), "it ended too fast");
        std::thread::sleep(Duration::from_millis(1));
    }
    // stopped, but alive
    first.stop();
    let kept = interrupted(&out);
    for more in ["", " --resume", " --force"] {
        let message = fails(here, &words(&format!("{CONVERT}{more}")));
        assert!(
            message.contains("another run of alvis is writing there"),
            "{message}"
        );
    }
    assert_eq!(interrupted(&out), kept);
    drop(first);
    let report = command::json(&ok(
        here,
        &words(&format!("{CONVERT} --resume --json --quiet")),
    ));
    assert_eq!(report["resumed_layers"], kept.unwrap().done);
    ok(here, &words(&CONVERT.replace(" out ", " whole ")));
    assert_same_files(
        &files(&out),
        &files(&here.join("whole")),
        "after the first died",
    );
}
