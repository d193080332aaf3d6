//! Colours, and small pictures with text, written as PNG.

mod colour;

pub use colour::{Map, hex, parse_colour};

use crate::sys::atomic_file::NewFile;
use font8x8::UnicodeFonts;
use image::{ImageFormat, Rgb, RgbImage};
use std::io::{Error, Result};
use std::path::Path;

/// Width and height of a letter before it is scaled.
const LETTER: u32 = 8;

/// A picture in 8-bit sRGB.
#[derive(Debug, Clone)]
pub struct Picture {
    pixels: RgbImage,
}

impl Picture {
    /// A picture of one colour.
    pub fn new([width, height]: [u32; 2], colour: [u8; 3]) -> Self {
        Picture {
            pixels: RgbImage::from_pixel(width, height, Rgb(colour)),
        }
    }

    /// Sets a pixel; one outside the picture is ignored.
    pub fn set(&mut self, [x, y]: [u32; 2], colour: [u8; 3]) {
        if let Some(pixel) = self.pixels.get_pixel_mut_checked(x, y) {
            *pixel = Rgb(colour);
        }
    }

    /// Pixels that a text takes from left to right.
    pub fn text_width(text: &str, scale: u32) -> u32 {
        text.chars().count() as u32 * LETTER * scale
    }

    /// Writes a text with its upper left corner at a pixel. Letters beyond ASCII are left blank.
    pub fn text(&mut self, [left, top]: [u32; 2], text: &str, scale: u32, colour: [u8; 3]) {
        for (i, letter) in text.chars().enumerate() {
            let Some(rows) = font8x8::BASIC_FONTS.get(letter) else {
                continue;
            };
            let left = left + i as u32 * LETTER * scale;
            for y in 0..LETTER * scale {
                for x in 0..LETTER * scale {
                    if rows[(y / scale) as usize] >> (x / scale) & 1 == 1 {
                        self.set([left + x, top + y], colour);
                    }
                }
            }
        }
    }

    /// Writes a PNG file, whole or not at all.
    ///
    /// # Errors
    /// The system's.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut file = NewFile::create(path)?;
        let mut bytes = std::io::Cursor::new(Vec::new());
        self.pixels
            .write_to(&mut bytes, ImageFormat::Png)
            .map_err(Error::other)?;
        std::io::Write::write_all(&mut file, bytes.get_ref())?;
        file.keep(true)
    }
}

/// A number in about four digits.
pub fn number(v: f64) -> String {
    if v == 0.0 {
        return "0".to_string();
    }
    let size = libm::log10(v.abs()).floor();
    if !(-4.0..6.0).contains(&size) {
        return format!("{v:.2e}");
    }
    let digits = (3.0 - size).max(0.0) as usize;
    let text = format!("{v:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 1.0, -0.25, 1234.5, 0.000_123_456, 123_456.0, 1e7, 1e-9].map(number);
        let expected = [
            "0",
            "1",
            "-0.25",
            "1234",
            "0.0001235",
            "123456",
            "1.00e7",
            "1.00e-9",
        ];
        assert_eq!(texts, expected);
    }

    #[test]
    fn text_stays_in_the_picture() {
        let mut picture = Picture::new([20, 10], [255; 3]);
        picture.text([12, 4], "Wµ1", 2, [0; 3]);
        let dark = picture.pixels.pixels().filter(|p| p.0 == [0; 3]).count();
        assert!(dark > 5 && dark < 100, "{dark}");
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        picture.save(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), picture.pixels);
        assert!(picture.save(&dir.path().join("no/a.png")).is_err());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
