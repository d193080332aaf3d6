//! The order of slices by their names, and whether these count slices of one stack without a gap.

use crate::error::{Error, Result};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

/// Splits a name into text and numbers by turns, text first.
pub(crate) fn parts(name: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let (mut rest, mut digits) = (name, false);
    while !rest.is_empty() {
        let end = rest.find(|c: char| c.is_ascii_digit() != digits);
        let (now, later) = rest.split_at(end.unwrap_or(rest.len()));
        parts.push(now);
        (rest, digits) = (later, !digits);
    }
    parts
}

/// The order of names in which numbers count as numbers: 9 before 10.
pub(crate) fn natural(a: &str, b: &str) -> Ordering {
    let (x, y) = (parts(a), parts(b));
    for (i, (p, q)) in x.iter().zip(&y).enumerate() {
        let order = if i % 2 == 1 {
            let [p, q] = [p, q].map(|n| n.trim_start_matches('0'));
            p.len().cmp(&q.len()).then(p.cmp(q))
        } else {
            p.cmp(q)
        };
        if order.is_ne() {
            return order;
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}

/// Refuses names, in natural order, that are not those of one stack, or that count with a gap.
///
/// Names that share nothing are taken as they are, and so are those in which several numbers differ, as a date and
/// a time do: there is no single count to check.
pub(crate) fn check_sequence(path: &Path, names: &[String]) -> Result<()> {
    let split: Vec<_> = names.iter().map(|n| parts(n)).collect();
    let mut kinds: BTreeMap<Vec<&str>, Vec<usize>> = BTreeMap::new();
    for (i, parts) in split.iter().enumerate() {
        kinds.entry(texts(parts)).or_default().push(i);
    }
    if kinds.len() > 1 && kinds.len() < names.len() {
        let mut kinds: Vec<_> = kinds.into_values().collect();
        kinds.sort_by_key(|of| std::cmp::Reverse(of.len()));
        let like = |of: &[usize]| format!("{} like {}", of.len(), names[of[0]]);
        return Err(stacks(path, &like(&kinds[0]), &like(&kinds[1])));
    }
    let Some(first) = split.first().filter(|_| kinds.len() == 1) else {
        return Ok(());
    };
    let counts = (1..first.len()).step_by(2);
    let varying: Vec<_> = counts
        .filter(|&at| split.iter().any(|parts| parts[at] != first[at]))
        .collect();
    match varying[..] {
        [] => Ok(()),
        [at] => check_count(path, names, split.iter().map(|parts| parts[at])),
        [.., a, b] if b == a + 2 && first[a + 1] == "." => Ok(()),
        [.., at] => {
            let mut seen = BTreeMap::new();
            for (name, parts) in names.iter().zip(&split) {
                if let Some(other) = seen.insert(parts[at], name) {
                    return Err(stacks(path, other, name));
                }
            }
            Ok(())
        }
    }
}

/// The texts of a name, without what follows its last number as extensions do.
pub(crate) fn texts<'a>(parts: &[&'a str]) -> Vec<&'a str> {
    let texts = parts.iter().copied().step_by(2);
    let mut texts: Vec<_> = texts.collect();
    if texts.len() > 1 && texts.last().is_some_and(|last| last.starts_with('.')) {
        texts.pop();
    }
    texts
}

fn stacks(path: &Path, one: &str, other: &str) -> Error {
    let found = format!("files of several stacks: {one}, {other}");
    let expected = "slices of one, whose names differ by a number that counts them";
    Error::format(path, found, expected).with_hint(
        "take the others out; of a folder, the slices of one can be given as FOLDER/slice_%04d.tif",
    )
}

/// Refuses numbers, in rising order, that do not rise in equal steps.
fn check_count<'a>(
    path: &Path,
    names: &[String],
    numbers: impl Iterator<Item = &'a str>,
) -> Result<()> {
    let numbers: Option<Vec<u128>> = numbers.map(|n| n.parse().ok()).collect();
    let Some(numbers) = numbers else {
        return Ok(());
    };
    let step = numbers[1] - numbers[0];
    for (i, pair) in numbers.windows(2).enumerate() {
        if pair[1] - pair[0] != step || step == 0 {
            return Err(Error::format(
                path,
                format!("{} after {}", names[i + 1], names[i]),
                format!(
                    "numbers that rise by {step}, as from {} to {}",
                    names[0], names[1]
                ),
            )
            .with_hint(
                "a slice is missing or comes twice: complete the folder or rename the files",
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_count_as_people_do() {
        let mut names = ["s10", "s9", "s1", "s01b", "s2", "10", "9", "t", "s"].map(String::from);
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(
            names,
            ["9", "10", "s", "s1", "s01b", "s2", "s9", "s10", "t"]
        );
    }

    #[test]
    fn gaps_are_found() {
        let check = |names: &[&str]| {
            let names: Vec<_> = names.iter().map(|n| n.to_string()).collect();
            check_sequence(Path::new("d"), &names).is_ok()
        };
        assert!(check(&["a9.tif", "a10.tif", "a11.tif"]));
        assert!(check(&["7B_000", "7B_010", "7B_020"]));
        assert!(check(&["x", "y", "z9"]) && check(&[]) && check(&["1"]));
        assert!(!check(&["a1", "a2", "a4"]));
        assert!(!check(&["a1.tif", "a01.tif"]), "the same number twice");
        assert!(check(&["a1.tif", "a2.TIFF"]) && !check(&["a1.tif", "a3.TIFF", "a4.tif"]));
    }

    #[test]
    fn slices_are_those_of_one_stack() {
        let check = |names: &[&str]| {
            let mut names: Vec<_> = names.iter().map(|n| n.to_string()).collect();
            names.sort_by(|a, b| natural(a, b));
            check_sequence(Path::new("d"), &names)
        };
        for names in [
            &["top_1.tif", "top_2.tif", "bot_1.tif", "bot_2.tif"][..],
            &["a_0001.tif", "a_0002.tif", "overview.tif"],
            &["1_0001.tif", "1_0002.tif", "2_0001.tif", "2_0002.tif"],
            &["a/1.png", "a/2.png", "b/1.png", "whole.png"],
        ] {
            let error = check(names).unwrap_err().to_string();
            assert!(error.contains("several stacks"), "{error}");
        }
        for names in [
            &["front.tif", "middle.tif", "rear.tif"][..],
            &["z0.00.tif", "z0.25.tif", "z0.75.tif", "z1.00.tif"],
            &[
                "20240131_235958.tif",
                "20240131_235959.tif",
                "20240201_000001.tif",
            ],
            &["a_1_of_9.tif"],
        ] {
            check(names).unwrap();
        }
    }
}
