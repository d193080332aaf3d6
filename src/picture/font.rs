//! Letters: DejaVu Sans, which the program carries, so that pictures are the same on every machine.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use std::sync::LazyLock;

/// Latin-1 and a few signs; see `font/LICENSE`.
static FACE: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    let file = include_bytes!("font/DejaVuSans-latin.ttf");
    FontRef::try_from_slice(file).expect("the font is part of the program")
});

/// What is drawn of a character: itself, or `?` if the font does not have it.
fn drawn(letter: char) -> char {
    let known = FACE.glyph_id(letter) != FACE.glyph_id('\u{10ffff}');
    if known || letter == ' ' { letter } else { '?' }
}

/// Pixels from the left end of a text to its right one, in lines of `size` pixels.
pub fn width(text: &str, size: u32) -> f64 {
    let face = FACE.as_scaled(PxScale::from(size as f32));
    let advance = |letter| face.h_advance(face.glyph_id(drawn(letter)));
    f64::from(text.chars().map(advance).sum::<f32>())
}

/// Calls `put` with the pixels of a text and the share that letters cover of each, from 0 to 1. The line begins at
/// `left` and is `size` pixels high from `top` on.
pub fn letters([left, top]: [f64; 2], text: &str, size: u32, mut put: impl FnMut([i64; 2], f64)) {
    let scale = PxScale::from(size as f32);
    let face = FACE.as_scaled(scale);
    let mut pen = left as f32;
    for letter in text.chars() {
        let id = face.glyph_id(drawn(letter));
        let place = point(pen, top as f32 + face.ascent());
        pen += face.h_advance(id);
        let Some(outline) = face.outline_glyph(id.with_scale_and_position(scale, place)) else {
            continue;
        };
        let corner = outline.px_bounds().min;
        outline.draw(|x, y, share| {
            let at = [
                corner.x as i64 + i64::from(x),
                corner.y as i64 + i64::from(y),
            ];
            put(at, f64::from(share).clamp(0.0, 1.0));
        });
    }
}

/// A text, cut and ended with `…` if it is wider than so many pixels.
pub fn fitted(text: &str, most: f64, size: u32) -> String {
    if width(text, size) <= most {
        return text.to_owned();
    }
    let mut cut = String::new();
    for letter in text.chars() {
        cut.push(letter);
        if width(&cut, size) + width("…", size) > most {
            cut.pop();
            break;
        }
    }
    cut + "…"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_have_widths_and_pixels() {
        assert!(width("W", 20) > width("i", 20) && width("WW", 20) > 1.9 * width("W", 20));
        for letter in "Wgµ²³×°·≥−é".chars() {
            assert_eq!(drawn(letter), letter);
        }
        assert_eq!(drawn('字'), '?');
        let mut sum = 0.0;
        letters([3.0, 2.0], "l", 20, |[x, y], share| {
            assert!((3..10).contains(&x) && (2..22).contains(&y), "{x} {y}");
            sum += share;
        });
        // a stem of some 1.5 by 13 pixels
        assert!((15.0..30.0).contains(&sum), "{sum}");
    }

    #[test]
    fn long_texts_are_cut() {
        assert_eq!(fitted("volume", 200.0, 20), "volume");
        let cut = fitted(&"volume ".repeat(1000), 200.0, 20);
        assert!(cut.ends_with('…') && width(&cut, 20) <= 200.0, "{cut}");
        assert_eq!(fitted("volume", 0.0, 20), "…");
    }
}
