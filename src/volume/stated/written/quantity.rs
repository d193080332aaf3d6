//! Sizes and units in the texts of attributes.

use crate::grid::length::Length;
use crate::volume::stated::written::{Held, plain};

/// Numbers with a unit each; empty for one that has none.
pub(crate) type Sizes = Vec<(f64, String)>;

/// Numbers and units out of an attribute: `0.1 um`, `0.1 x 0.1 x 0.3 mm` or numbers alone.
pub(crate) fn sizes(held: &Held) -> Option<Sizes> {
    let texts = match held {
        Held::Numbers(all) => return Some(all.iter().map(|n| (*n, String::new())).collect()),
        Held::Texts(texts) => texts,
        Held::Other => return None,
    };
    let (mut numbers, mut units) = (Vec::new(), Vec::new());
    for text in texts {
        let text = text.replace(['[', ']', '(', ')', '{', '}', ',', ';', '*', '\u{d7}'], " ");
        for word in text
            .split_whitespace()
            .filter(|word| !word.eq_ignore_ascii_case("x"))
        {
            let end = (0..=word.len()).rev().find(|&end| {
                word.is_char_boundary(end) && word[..end].parse::<f64>().is_ok_and(f64::is_finite)
            });
            let (number, unit) = word.split_at(end.unwrap_or(0));
            numbers.extend(number.parse::<f64>().ok());
            if !unit.is_empty() {
                units.push(unit.to_owned());
            }
        }
    }
    let unit = match &units[..] {
        [] => String::new(),
        all => cleaned(&all.join(" ")).or_else(|| {
            let same = all.iter().all(|unit| *unit == all[0]);
            cleaned(&all[0]).filter(|_| same)
        })?,
    };
    (!numbers.is_empty()).then(|| numbers.into_iter().map(|n| (n, unit.clone())).collect())
}

/// The unit of length in a text such as `um`, `[um]`, `um/voxel` or `mm per pixel`; empty for voxels themselves.
pub(crate) fn cleaned(text: &str) -> Option<String> {
    let text = text.trim().trim_matches(['[', ']', '(', ')']).trim();
    let voxel = |word: &str| {
        matches!(
            plain(word).trim_end_matches('s'),
            "voxel" | "pixel" | "px" | "vx" | ""
        )
    };
    if voxel(text) {
        return Some(String::new());
    }
    let unit = match text.split_once('/').or_else(|| text.split_once(" per ")) {
        Some((unit, of)) if voxel(of) => unit.trim(),
        _ => text,
    };
    Length::parse(unit).map(|_| unit.to_owned())
}
