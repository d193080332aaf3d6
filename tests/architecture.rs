//! The folders of `src`, and those of `src/volume`, import each other only as the tables in ARCHITECTURE.md say.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// What a folder or a file at the top of `src` imports from others.
type Imports = BTreeMap<String, BTreeSet<String>>;

/// The rows of the table below a heading: a name, and what it may import.
fn allowed(heading: &str) -> Vec<(String, BTreeSet<String>)> {
    let text = fs::read_to_string("ARCHITECTURE.md").unwrap();
    let below = text.split(&format!("\n## {heading}\n")).nth(1).unwrap();
    let section = below.split("\n## ").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    let quoted = |cell: &str| -> Vec<String> {
        let parts = cell.split('`').skip(1).step_by(2);
        parts.map(String::from).collect()
    };
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').collect();
        let name = quoted(cells[1]).remove(0);
        (name, quoted(cells[3]).into_iter().collect())
    })
    .collect()
}

/// Text without comments and what only tests see: inline test modules stand at the end of a file.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let tests = ["", "pub(crate) "].map(|shared| format!("\n{shared}mod tests {{"));
    let before = |text, begin: &String| str::split(text, begin.as_str()).next().unwrap();
    let text = tests.iter().fold(&text[..], before);
    let lines = text.lines().map(|line| line.split("//").next().unwrap());
    lines.collect::<Vec<_>>().join("\n")
}

/// First names after `crate::`, or another path, also of `crate::{a, b}`; `super` is left to who stays in a folder.
fn named(code: &str, path: &str) -> BTreeSet<String> {
    let word = |text: &str| {
        let end = text.find(|c: char| c != '_' && !c.is_alphanumeric());
        text[..end.unwrap_or(text.len())].to_string()
    };
    let mut names = BTreeSet::new();
    for rest in code.split(path).skip(1) {
        match rest.strip_prefix('{') {
            Some(group) => {
                let mut depth = 0;
                let end = |c: char| {
                    depth += i32::from(c == '{') - i32::from(c == '}');
                    depth < 0
                };
                let inside = &group[..group.find(end).unwrap_or(0)];
                names.extend(inside.split(',').map(|part| word(part.trim())));
            }
            None => _ = names.insert(word(rest)),
        }
    }
    names
}

/// Adds the names after these paths in the files of a folder; in folders of it, those after the first of the paths.
fn collect(dir: &Path, top: Option<&str>, paths: &[&str], found: &mut Imports) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let own = top.unwrap_or(stem);
        if stem == "tests" {
            continue;
        }
        if path.is_dir() {
            collect(&path, Some(own), &paths[..1], found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let code = code(&path);
            let names = paths.iter().flat_map(|path| named(&code, path));
            found.entry(own.to_string()).or_default().extend(names);
        }
    }
}

/// What each folder and file at the top of `src` imports from the others.
fn imports() -> Imports {
    let mut found = Imports::new();
    collect(Path::new("src"), None, &["crate::"], &mut found);
    found.retain(|name, _| name != "lib" && name != "main");
    let all: BTreeSet<String> = found.keys().cloned().collect();
    for (name, names) in &mut found {
        names.retain(|other| all.contains(other) && other != name);
    }
    found
}

/// Where the names come from that `src/volume/mod.rs` hands on.
fn handed_on() -> BTreeMap<String, String> {
    let text = code(Path::new("src/volume/mod.rs"));
    let uses = text.lines().filter(|line| line.starts_with("pub"));
    let uses = uses.filter_map(|line| line.split_once("use ")?.1.strip_suffix(';'));
    let mut names = BTreeMap::new();
    for path in uses.filter(|path| !path.starts_with("crate")) {
        let (module, _) = path.split_once("::").unwrap();
        let (_, last) = path.rsplit_once("::").unwrap();
        for name in last.trim_matches(['{', '}']).split(',') {
            let name = name.rsplit(" as ").next().unwrap().trim();
            names.insert(name.to_string(), module.to_string());
        }
    }
    names
}

/// What each folder and file of `src/volume` imports from the others.
fn imports_in_volume() -> Imports {
    let mut found = Imports::new();
    let paths = ["crate::volume::", "super::"];
    collect(Path::new("src/volume"), None, &paths, &mut found);
    found.retain(|name, _| name != "mod" && name != "conformance");
    let all: BTreeSet<String> = found.keys().cloned().collect();
    let handed_on = handed_on();
    for (name, names) in &mut found {
        let from = |other: &String| handed_on.get(other).unwrap_or(other).clone();
        *names = names.iter().map(from).collect();
        names.retain(|other| all.contains(other) && other != name);
    }
    found
}

#[test]
fn folders_import_what_the_table_says_and_only_downwards() {
    check("Folders", &imports());
}

#[test]
fn so_do_those_inside_volume() {
    assert_eq!(handed_on()["Opened"], "options");
    check("Inside `volume`", &imports_in_volume());
}

fn check(heading: &str, found: &Imports) {
    let table = allowed(heading);
    let names: BTreeSet<&String> = table.iter().map(|(name, _)| name).collect();
    assert_eq!(
        names,
        found.keys().collect(),
        "rows of ARCHITECTURE.md, and the files"
    );
    let mut below = BTreeSet::new();
    for (name, allowed) in &table {
        let upwards: Vec<_> = allowed.difference(&below).collect();
        assert!(
            upwards.is_empty(),
            "{name} stands below {upwards:?} in ARCHITECTURE.md"
        );
        assert_eq!(
            &found[name], allowed,
            "what {name} imports, and its row in ARCHITECTURE.md"
        );
        below.insert(name.clone());
    }
}

#[test]
fn the_verifier_shares_nothing_with_what_it_verifies() {
    let makers = [
        "labels",
        "surface",
        "strip",
        "measure",
        "convert",
        "export",
        "checkpoint",
    ];
    let shared: Vec<&str> = makers
        .into_iter()
        .filter(|m| imports()["verify"].contains(*m))
        .collect();
    assert!(shared.is_empty(), "verify imports {shared:?}");
}

/// The files of code in a folder and in those below it.
fn sources(dir: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| match path.is_dir() {
        true => sources(&path),
        false => vec![path],
    });
    let is_code = |path: &PathBuf| path.extension().is_some_and(|e| e == "rs");
    files.filter(is_code).collect()
}

/// All else asks the codec of an encoding.
#[test]
fn encodings_of_tiles_are_named_by_their_type_their_options_and_their_codecs() {
    let form = Path::new("src/manifest/form.rs");
    let text = code(form);
    let arms = text.split("pub enum Encoding {").nth(1).unwrap();
    let arms = arms.split('}').next().unwrap().split(',');
    let names = arms.filter_map(|arm| arm.split_whitespace().last());
    let names: Vec<String> = names.map(|name| format!("Encoding::{name}")).collect();
    assert!(
        names.contains(&"Encoding::Meshopt".to_string()),
        "{names:?}"
    );
    let own = |path: &PathBuf| {
        path == form || path.ends_with("cli/form.rs") || path.starts_with("src/tile/codec")
    };
    for path in sources(Path::new("src")).iter().filter(|path| !own(path)) {
        let code = code(path);
        let named: Vec<&String> = names.iter().filter(|name| code.contains(*name)).collect();
        assert!(named.is_empty(), "{} names {named:?}", path.display());
    }
}

#[test]
fn imports_are_found_wherever_they_stand() {
    let code = "use crate::{grid::{Dims, Tiling}, error};\nlet a = crate::sys::files::b();\n$crate::tile::c!()";
    let expected = ["error", "grid", "sys", "tile"].map(String::from);
    assert!(BTreeSet::from(expected).is_subset(&named(code, "crate::")));
}
