//! Colours of pieces: materials in the node layout, vertex colours in the merged one.

use super::document::material;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A colour as screens have it: sRGB, red first.
pub type Rgb = [u8; 3];

/// The materials of a tile, each once.
#[derive(Default)]
pub(super) struct Paints {
    known: BTreeMap<Option<Rgb>, usize>,
    pub materials: Vec<Value>,
}

impl Paints {
    /// The number of the material of a colour, or of the common grey.
    pub fn index(&mut self, colour: Option<Rgb>) -> usize {
        let next = self.materials.len();
        let index = *self.known.entry(colour).or_insert(next);
        if index == next {
            let mut paint = material();
            if let Some([r, g, b]) = colour {
                paint["name"] = format!("{PREFIX}{r:02x}{g:02x}{b:02x}").into();
                let [r, g, b] = [r, g, b].map(|v| (linear(v) * 1e6).round() / 1e6);
                paint["pbrMetallicRoughness"]["baseColorFactor"] = json!([r, g, b, 1.0]);
            }
            self.materials.push(paint);
        }
        index
    }
}

const PREFIX: &str = "colour_";

/// The colour that a material is named after.
pub(super) fn named(material: &str) -> Option<Rgb> {
    let digits = material.strip_prefix(PREFIX)?;
    let all_hex = digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_hexdigit());
    let number = u32::from_str_radix(digits, 16).ok().filter(|_| all_hex)?;
    let [_, r, g, b] = number.to_be_bytes();
    Some([r, g, b])
}

/// A channel of sRGB (IEC 61966-2-1) as light, 0 to 1: glTF's factors and vertex colours are linear.
pub fn linear(channel: u8) -> f64 {
    let v = f64::from(channel) / 255.0;
    if v <= 0.040_45 {
        v / 12.92
    } else {
        libm::pow((v + 0.055) / 1.055, 2.4)
    }
}

/// The common grey, 0.8, which is no colour of sRGB.
const GREY: [u16; 4] = [52_428, 52_428, 52_428, u16::MAX];

fn channel16(channel: u8) -> u16 {
    (linear(channel) * 65_535.0).round() as u16
}

/// A colour as a vertex has it: 16 bits, so that each sRGB colour stays one of its own.
pub(super) fn vertex_colour(colour: Option<Rgb>) -> [u8; 8] {
    let all = match colour {
        Some([r, g, b]) => [channel16(r), channel16(g), channel16(b), u16::MAX],
        None => GREY,
    };
    bytemuck::cast(all.map(u16::to_le_bytes))
}

/// The colour that a vertex has; the nearest one of sRGB.
pub(super) fn of_vertex(bytes: &[u8; 8]) -> Option<Rgb> {
    let (words, _) = bytes.as_chunks::<2>();
    let value = |i: usize| u16::from_le_bytes(words[i]);
    if (0..4).all(|i| value(i) == GREY[i]) {
        return None;
    }
    let nearest = |v: u16| (0..=255u8).min_by_key(|&c| channel16(c).abs_diff(v));
    Some([0, 1, 2].map(|i| nearest(value(i)).unwrap_or(0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_colour_comes_back() {
        for v in 0..=255u8 {
            let colour = [v, 255 - v, v / 2];
            assert_eq!(of_vertex(&vertex_colour(Some(colour))), Some(colour));
            let mut paints = Paints::default();
            paints.index(Some(colour));
            let name = paints.materials[0]["name"].as_str().unwrap();
            assert_eq!(named(name), Some(colour));
        }
        assert_eq!(of_vertex(&vertex_colour(None)), None);
        assert_eq!(named("surface"), None);
        assert_eq!(named("colour_+12345"), None);
    }
}
