//! The README and the command are in step: every command line in it can be typed, every option in it
//! exists, every command is in it, and the files that it points to are there.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn alvis<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(args)
        .output()
        .unwrap()
}

fn help(args: &[&str]) -> String {
    let output = alvis(&[args, &["--help"]].concat());
    assert!(output.status.success(), "{args:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// Names of the commands, by the help text.
fn commands() -> Vec<String> {
    let help = help(&[]);
    let list = help.split("Usage:").nth(1).unwrap();
    list.lines()
        .take_while(|l| *l != "Options:")
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next())
        .map(str::to_string)
        .collect()
}

/// Lines of the fenced blocks with this language.
fn code<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let mut lines = Vec::new();
    let mut inside = None;
    for line in text.lines() {
        match (line.strip_prefix("```"), inside) {
            (Some(name), None) => inside = Some(name),
            (Some(_), Some(_)) => inside = None,
            (None, Some(name)) if name == language => lines.push(line),
            _ => {}
        }
    }
    lines
}

/// The words of a command line up to a pipe, redirection or comment, as a shell has them.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '\'' => quoted = !quoted,
            '|' | '>' | '#' if !quoted => break,
            ' ' if !quoted => words.push(String::new()),
            _ => words.last_mut().unwrap().push(c),
        }
    }
    words.retain(|w| !w.is_empty());
    words
}

/// Words after the program's name, if the line runs alvis.
fn arguments(line: &str) -> Option<Vec<String>> {
    let line = line
        .strip_prefix("alvis ")
        .or_else(|| line.strip_prefix("cargo run --release -- "))?;
    Some(words(line))
}

#[test]
fn every_command_line_can_be_typed() {
    let text = read("README.md");
    let lines: Vec<_> = code(&text, "sh")
        .into_iter()
        .filter_map(|l| Some((l, arguments(l)?)))
        .collect();
    assert!(lines.len() > 15, "{lines:?}");
    for (line, args) in &lines {
        // --help at the end: what stands before it is parsed, and nothing is run
        let output = alvis(&[args.as_slice(), &["--help".to_string()]].concat());
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{line}: {errors}");
        // the parser stops at --help, so what is missing is looked for apart
        if args[0] == "convert" {
            assert!(args.contains(&"--threshold".to_string()), "{line}");
        }
    }
    let used: BTreeSet<_> = lines.iter().map(|(_, args)| args[0].clone()).collect();
    for command in commands() {
        let named = used.contains(&command) || text.contains(&format!("`alvis {command}"));
        assert!(named || command == "help", "the README misses {command}");
    }
}

#[test]
fn every_option_exists() {
    let mut known = help(&[])
        + &read("examples/render_tiles.py")
        + &read("examples/render_blender.py")
        + &read("examples/bench/main.rs")
        + " --release --example --bench --path --features";
    known += " --open";
    for command in commands().iter().filter(|c| *c != "help") {
        known += &help(&[command]);
    }
    let is_name = |c: char| c.is_ascii_lowercase() || c == '-';
    let names = |text: &str| -> BTreeSet<String> {
        text.match_indices("--")
            .filter(|(at, _)| !text[..*at].ends_with(is_name))
            .map(|(at, _)| &text[at + 2..])
            .map(|rest| rest.split(|c| !is_name(c)).next().unwrap().to_string())
            .filter(|name| name.contains(|c: char| c.is_ascii_lowercase()))
            .collect()
    };
    let known = names(&known);
    for file in ["README.md", "CHANGELOG.md"] {
        for option in names(&read(file)) {
            assert!(known.contains(&option), "{file}: --{option} does not exist");
        }
    }
}

#[test]
fn links_lead_somewhere() {
    let text = read("README.md");
    let targets = text.split("](").skip(1).filter_map(|t| t.split(')').next());
    let mut files = 0;
    // as a page of a repository names its headings
    let anchor = |line: &str| -> String {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title
            .chars()
            .filter(|c| c.is_alphanumeric() || "-_ ".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    let headings = |text: &str| -> BTreeSet<String> {
        let lines = text.lines().filter(|l| l.starts_with('#'));
        lines.map(anchor).collect()
    };
    for target in targets.filter(|t| !t.contains("://")) {
        let (path, heading) = target.split_once('#').unwrap_or((target, ""));
        if !path.is_empty() {
            assert!(root().join(path).exists(), "{target}");
            files += 1;
        }
        let page = if path.is_empty() { "README.md" } else { path };
        assert!(
            heading.is_empty() || headings(&read(page)).contains(heading),
            "{target}"
        );
    }
    assert!(files > 4);
}

#[test]
fn the_changelog_knows_this_version() {
    let text = read("CHANGELOG.md");
    let version = env!("CARGO_PKG_VERSION");
    assert!(text.contains("## [Unreleased]") || text.contains(&format!("## [{version}]")));
}

#[test]
fn words_are_split_as_a_shell_does() {
    assert_eq!(words("a 'b c>1' d # e"), ["a", "b c>1", "d"]);
    assert_eq!(words("man convert | man -l -"), ["man", "convert"]);
    assert_eq!(
        code("x\n```sh\na\nb\n```\n```text\nc\n```\n", "sh"),
        ["a", "b"]
    );
}
