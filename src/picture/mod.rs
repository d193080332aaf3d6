//! Colours, and pictures with text, written as PNG.

mod colour;
mod font;
mod legend;
pub mod ticks;

pub use colour::{Map, hex, parse_colour};
pub use font::{fitted, width as text_width};
pub use legend::{BarArea, ColourBar, printed_unit};

use crate::sys::atomic_file::NewFile;
use image::{DynamicImage, ImageFormat, ImageReader, Rgb, RgbImage};
use std::io::{Cursor, Error, Result};
use std::path::Path;

/// Colour of text and lines.
pub const INK: [u8; 3] = [32, 32, 32];
/// Colour of lines around what may be as light as the paper.
const FRAME: [u8; 3] = [144; 3];

/// A picture in 8-bit sRGB.
#[derive(Debug, Clone, PartialEq)]
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

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.pixels.dimensions().into()
    }

    /// The colour of a pixel, which must be in the picture.
    #[cfg(test)]
    pub fn at(&self, [x, y]: [u32; 2]) -> [u8; 3] {
        self.pixels.get_pixel(x, y).0
    }

    /// Lays a colour over a pixel that covers a share of it; one outside the picture is ignored.
    pub fn blend(&mut self, [x, y]: [i64; 2], colour: [u8; 3], share: f64) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
            return;
        };
        if let Some(Rgb(pixel)) = self.pixels.get_pixel_mut_checked(x, y) {
            *pixel = std::array::from_fn(|i| {
                let [old, new] = [pixel[i], colour[i]].map(f64::from);
                (old + (new - old) * share).round() as u8
            });
        }
    }

    /// Fills a rectangle, given by its upper left corner and its size; what is outside the picture is ignored.
    pub fn fill(&mut self, [left, top]: [u32; 2], [width, height]: [u32; 2], colour: [u8; 3]) {
        for y in top..top.saturating_add(height) {
            for x in left..left.saturating_add(width) {
                self.set([x, y], colour);
            }
        }
    }

    /// Draws a line around a rectangle, given by its upper left corner and its size, which do not touch the picture's rim.
    pub fn frame(&mut self, [left, top]: [u32; 2], [width, height]: [u32; 2]) {
        for y in [top - 1, top + height] {
            self.fill([left - 1, y], [width + 2, 1], FRAME);
        }
        for x in [left - 1, left + width] {
            self.fill([x, top], [1, height], FRAME);
        }
    }

    /// Writes a text with its upper left corner at a place, in lines of `size` pixels. Letters that are neither Latin
    /// nor common signs are drawn as `?`.
    pub fn text(&mut self, corner: [f64; 2], text: &str, size: u32, colour: [u8; 3]) {
        font::letters(corner, text, size, |at, share| {
            self.blend(at, colour, share)
        });
    }

    /// Says how a PNG file differs from this picture; `None` if it does not. Of a file that is larger than this
    /// picture no more than its header is decoded.
    pub fn differs(&self, png: &[u8]) -> Option<String> {
        let (width, height) = self.pixels.dimensions();
        let reader = || ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
        match reader().into_dimensions() {
            Err(e) => return Some(format!("it is no PNG: {e}")),
            Ok(found) if found != (width, height) => {
                let [x, y] = [found.0, found.1];
                return Some(format!(
                    "found {x} x {y} pixels, expected {width} x {height}"
                ));
            }
            Ok(_) => {}
        }
        let found = match reader().decode() {
            Err(e) => return Some(format!("it cannot be decoded: {e}")),
            Ok(DynamicImage::ImageRgb8(found)) => found,
            Ok(other) => return Some(format!("found {:?}, expected 8-bit RGB", other.color())),
        };
        if !plain_chunks(png) {
            return Some("it holds more than a header and pixels".to_owned());
        }
        let mut pairs = found.enumerate_pixels().zip(self.pixels.pixels());
        let ((x, y, found), expected) = pairs.find(|((_, _, found), own)| found != own)?;
        Some(format!(
            "pixel {x}, {y} is {:?}, expected {:?}",
            found.0, expected.0
        ))
    }

    /// Writes a PNG file, whole or not at all.
    ///
    /// # Errors
    /// The system's.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut file = NewFile::create(path)?;
        std::io::Write::write_all(&mut file, &self.png()?)?;
        file.keep(true)
    }

    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// The encoder's.
    pub fn png(&self) -> Result<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        self.pixels
            .write_to(&mut bytes, ImageFormat::Png)
            .map_err(Error::other)?;
        Ok(bytes.into_inner())
    }

    /// The picture with `most` pixels along its longer side, if it has more: means of pixels.
    pub fn shrunk(self, most: u32) -> Self {
        let longer = self.size().into_iter().max().unwrap_or(0);
        if longer <= most {
            return self;
        }
        let [width, height] = self.size().map(|n| {
            let scaled = u64::from(n) * u64::from(most) / u64::from(longer);
            (scaled as u32).max(1)
        });
        Picture {
            pixels: image::imageops::thumbnail(&self.pixels, width, height),
        }
    }
}

/// True if a PNG has the chunks IHDR, IDAT and IEND alone, one behind the other up to its end.
fn plain_chunks(png: &[u8]) -> bool {
    let mut rest = png.get(8..).unwrap_or_default();
    let mut last: &[u8] = b"";
    while let Some((head, body)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let kind = &head[4..];
        // the body and its checksum
        let Some(next) = length.checked_add(4).and_then(|n| body.get(n..)) else {
            return false;
        };
        match (kind, last) {
            (b"IHDR", b"") | (b"IDAT", b"IHDR" | b"IDAT") | (b"IEND", b"IDAT") => {}
            _ => return false,
        }
        (last, rest) = (kind, next);
    }
    last == b"IEND" && rest.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_in_the_picture() {
        let mut picture = Picture::new([20, 10], [255; 3]);
        picture.text([12.0, -2.0], "Wµ1", 16, [0; 3]);
        let dark = picture.pixels.pixels().filter(|p| p.0[0] < 128).count();
        assert!(dark > 5 && dark < 100, "{dark}");
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        picture.save(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), picture.pixels);
        assert!(picture.save(&dir.path().join("no/a.png")).is_err());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_picture_is_told_from_others() {
        let legend = |max: f64| {
            let bar = ColourBar {
                title: "a",
                ends: [0.0, max],
                colour: &|v| [(v * 255.0) as u8; 3],
            };
            bar.picture()
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        legend(1.0).save(&path).unwrap();
        let png = std::fs::read(&path).unwrap();
        assert_eq!(legend(1.0).differs(&png), None);
        let text = |found: Option<String>| found.unwrap_or_default();
        assert!(text(legend(2.0).differs(&png)).starts_with("pixel"));
        assert!(text(Picture::new([3, 3], [0; 3]).differs(&png)).contains("expected 3 x 3"));
        for broken in [&png[..0], b"GIF89a", &png[..png.len() / 2]] {
            assert!(legend(1.0).differs(broken).is_some());
        }
        // a chunk that shows nothing, and bytes behind the end
        let mut more = png.clone();
        more.splice(33..33, *b"\0\0\0\x01tEXtx\0\0\0\0");
        assert!(legend(1.0).differs(&more).is_some());
        assert!(legend(1.0).differs(&[&png[..], b"x"].concat()).is_some());
    }
}
