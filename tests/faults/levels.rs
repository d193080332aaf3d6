//! Levels of detail, and a conversion that ends with them, are killed before a change of a file: whatever command is named
//! then leads to the set that was to be made, and none leads back to one that named it.

use super::power::Tree;
use super::{WORK, shim, shimmed, text};
use crate::command::{alvis, ok};
use std::path::{Path, PathBuf};
use std::process::Output;

const CONVERT: &str =
    "convert foam.raw out --dims 24,22,20 --dtype u8 --threshold 128 --macrocube 13,12,7 --lod";
/// Operations that change what lies on the disk.
const CHANGES: [&str; 8] = [
    "create",
    "write",
    "mkdir",
    "rename",
    "unlink",
    "unlinkat",
    "rmdir",
    "ftruncate",
];

struct Case {
    shim: &'static Path,
    here: PathBuf,
    _dir: tempfile::TempDir,
    /// The set with its levels.
    expected: Tree,
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

/// What is said but for progress, which there is on a slow machine.
fn warnings(output: &Output) -> String {
    let is_meant = |l: &&str| l.starts_with("warning: ") || l.starts_with("alvis: ");
    text(output).lines().filter(is_meant).collect()
}

impl Case {
    fn new(test: &str) -> Option<Self> {
        let shim = shim(test)?;
        let dir = tempfile::tempdir().unwrap();
        let here = dir.path().canonicalize().unwrap();
        ok(
            &here,
            &words("phantom foam foam.raw --dims 24,22,20 --pitch 9 --quiet"),
        );
        ok(&here, &words(CONVERT));
        Some(Case {
            shim,
            expected: Tree::read(&here.join("out")),
            here,
            _dir: dir,
        })
    }

    fn out(&self) -> PathBuf {
        self.here.join("out")
    }

    fn run(&self, line: &str) -> Output {
        alvis(&self.here, &words(line))
    }

    /// What lies in `out` when a command is killed before each `step`th change, with the name of that; each once.
    fn stops(&self, line: &str, before: &Tree, step: usize) -> Vec<(String, Tree)> {
        let log = self.here.with_extension("log");
        let _ = std::fs::remove_file(&log);
        before.write(&self.out());
        let counted = shimmed(self.shim, &self.here, line)
            .env("SHIM_LOG", &log)
            .output()
            .unwrap();
        assert!(counted.status.success(), "{}", text(&counted));
        assert_eq!(Tree::read(&self.out()), self.expected);
        let operations = std::fs::read_to_string(&log).unwrap();
        std::fs::remove_file(&log).unwrap();
        let is_change = |l: &&str| CHANGES.contains(&l.split(' ').nth(1).unwrap());
        let mut stops: Vec<(String, Tree)> = Vec::new();
        for operation in operations.lines().filter(is_change).step_by(step) {
            before.write(&self.out());
            let killed = shimmed(self.shim, &self.here, line)
                .env("SHIM_AT", operation.split(' ').next().unwrap())
                .env("SHIM_KILL", "1")
                .output()
                .unwrap();
            assert_eq!(killed.status.code(), None, "{}", text(&killed));
            let left = Tree::read(&self.out());
            if stops.iter().all(|(_, known)| *known != left) {
                stops.push((operation.to_owned(), left));
            }
        }
        stops
    }

    /// Checks that a command leads from what was left to the whole set with its levels, and that nothing is said of it then.
    fn leads_to_the_set(&self, left: &Tree, line: &str, at: &str) {
        left.write(&self.out());
        let output = self.run(line);
        let what = format!("{at}: {line}: {}", text(&output));
        assert!(output.status.success(), "{what}");
        assert!(Tree::read(&self.out()) == self.expected, "{what}");
        let verified = self.run("verify out");
        assert!(verified.status.success(), "{what}");
        assert_eq!(warnings(&verified), "", "{what}");
    }

    /// What `verify` says of a set; it is no fault of the set that something was interrupted beside it.
    fn verify_says(&self, left: &Tree, at: &str) -> String {
        left.write(&self.out());
        let output = self.run("verify out");
        let said = warnings(&output);
        // while tiles are moved in there is no set
        let code = if left.files.contains_key("index.json") {
            0
        } else {
            2
        };
        assert_eq!(output.status.code(), Some(code), "{at}: {said}");
        said
    }
}

#[test]
fn levels_go_on_wherever_they_were_killed() {
    let Some(case) = Case::new("levels_go_on_wherever_they_were_killed") else {
        return;
    };
    // in place of others, which were damaged since
    let mut damaged = case.expected.clone();
    damaged
        .files
        .get_mut("lod/1/z0000/y0000_x0000.glb")
        .unwrap()[30] ^= 1;
    let mut said = [0; 3];
    let stops = case.stops("lod out --force --threads 1", &case.expected, 1);
    for (number, (at, left)) in stops.into_iter().enumerate() {
        let message = case.verify_says(&left, &at);
        let named = message.contains("`alvis lod out --resume`");
        let moving = message.contains("not all in place");
        assert!(named || message.is_empty(), "{at}: {message}");
        said[usize::from(named) + usize::from(moving)] += 1;
        case.leads_to_the_set(&left, "lod out --resume", &at);
        // every third, for the others differ in what is dropped alone
        if number % 3 == 0 {
            case.leads_to_the_set(&left, "lod out --force", &at);
        }
    }
    eprintln!("of {said:?} nothing was said, that they go on, that they are moved in");
    assert!(said.iter().all(|n| *n > 3), "{said:?}");
    for (at, left) in case.stops("lod out --force --threads 1", &damaged, 9) {
        case.leads_to_the_set(&left, "lod out --force", &at);
    }
}

/// Kills a conversion in place of a set.
fn conversions(test: &str, before: impl Fn(&Case) -> Tree, step: usize) {
    let Some(case) = Case::new(test) else { return };
    let before = before(&case);
    let line = format!("{CONVERT} --force --threads 1");
    let is_same = before.files["tiles/z0000/y0000_x0000.glb"]
        == case.expected.files["tiles/z0000/y0000_x0000.glb"];
    let mut said = [0; 4];
    for (at, left) in case.stops(&line, &before, step) {
        let message = case.verify_says(&left, &at);
        case.leads_to_the_set(&left, &format!("{line} --resume"), &at);
        case.leads_to_the_set(&left, &line, &at);
        if is_same {
            case.leads_to_the_set(&left, &format!("{CONVERT} --resume"), &at);
        }
        let is_new = left.files.get("tiles/z0000/y0000_x0000.glb")
            == case.expected.files.get("tiles/z0000/y0000_x0000.glb");
        let conversion = message.contains("`alvis convert`");
        let levels = message.contains("`alvis lod out --resume`");
        match (conversion, levels) {
            (true, _) => {
                for option in ["--resume", "--force"] {
                    left.write(&case.out());
                    let output = case.run(&format!("lod out {option}"));
                    // finished levels need nothing; all else names the conversion
                    let refused = text(&output).contains("`alvis convert`");
                    assert!(
                        output.status.success() || refused,
                        "{at}: {}",
                        text(&output)
                    );
                }
                said[0] += 1;
            }
            (_, true) => {
                case.leads_to_the_set(&left, "lod out --resume", &at);
                said[1] += 1;
            }
            _ => {
                assert_eq!(message, "", "{at}");
                if is_new {
                    case.leads_to_the_set(&left, "lod out --resume", &at);
                    case.leads_to_the_set(&left, "lod out --force", &at);
                    said[2] += 1;
                } else {
                    said[3] += 1;
                }
            }
        }
    }
    eprintln!(
        "{test}: of {said:?} verify named convert, lod, nothing beside the new set, nothing beside the old one"
    );
    assert!(said[0] > 3 && said[1] > 1 && said[2] > 0, "{said:?}");
}

#[test]
fn a_conversion_with_levels_goes_on_in_place_of_the_same_set() {
    let test = "a_conversion_with_levels_goes_on_in_place_of_the_same_set";
    let plain = |case: &Case| {
        let line = CONVERT.replace(" --lod", " --force");
        ok(&case.here, &words(&line));
        Tree::read(&case.out())
    };
    conversions(test, |case| case.expected.clone(), 13);
    conversions(test, plain, 13);
}

#[test]
fn a_conversion_with_levels_goes_on_in_place_of_another_set() {
    let test = "a_conversion_with_levels_goes_on_in_place_of_another_set";
    let other = |case: &Case| {
        let line = format!("{} --force", CONVERT.replace("128", "120"));
        ok(&case.here, &words(&line));
        Tree::read(&case.out())
    };
    conversions(test, other, 13);
}

/// A conversion takes the place of a set whose levels were being moved in: nothing of these comes into place later.
#[test]
fn a_conversion_drops_levels_that_were_being_moved_in() {
    let Some(case) = Case::new("a_conversion_drops_levels_that_were_being_moved_in") else {
        return;
    };
    let line = format!("{CONVERT} --force --threads 1");
    let stops = case.stops("lod out --force --threads 1", &case.expected, 1);
    let moving = stops.into_iter().filter(|(_, left)| {
        let has = |name: &str| left.files.contains_key(&format!("{WORK}/{name}"));
        has("lod-moving") && has("index.json")
    });
    let moving: Vec<_> = moving.collect();
    assert!(moving.len() > 5);
    for (first, left) in moving.iter().step_by(5) {
        for (at, left) in case.stops(&line, left, 11) {
            let at = format!("{first}, {at}");
            case.verify_says(&left, &at);
            case.leads_to_the_set(&left, &format!("{line} --resume"), &at);
        }
    }
}
