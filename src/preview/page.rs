//! What stands around a slice: caption, scale bar and legends.

use super::draw::hatched;
use crate::picture::ticks::Round;
use crate::picture::{BarArea, ColourBar, INK, Picture, fitted, printed_unit, text_width};

/// Colour of the paper.
const PAPER: [u8; 3] = [255; 3];
/// The least width of what stands above and below a small slice, in pixels.
const NARROW: u32 = 560;
/// Pixels between slices side by side.
pub const GAP: u32 = 12;
/// The widths of a colour bar.
const BAR_WIDTH: [u32; 2] = [160, 420];

/// A coloured square and what it means.
pub struct Key {
    /// Its colour; hatched without one.
    pub colour: Option<[u8; 3]>,
    /// What it means.
    pub text: String,
}

/// A colour bar with its title and values.
pub struct Bar {
    /// What the colours mean.
    pub title: String,
    /// The values of the first and the last colour.
    pub ends: [f64; 2],
    /// The colour of a share.
    pub colour: Box<dyn Fn(f64) -> [u8; 3]>,
}

/// A scale bar.
struct ScaleBar {
    pixels: u32,
    label: String,
}

/// What is drawn around a slice.
#[derive(Default)]
pub struct Page {
    /// Texts above it, which are spread over lines.
    pub caption: Vec<String>,
    /// Where a slice is drawn several times side by side, what stands above each; otherwise none.
    pub titles: Vec<String>,
    /// Legends below it.
    pub bars: Vec<Bar>,
    /// Colours that stand for one thing.
    pub keys: Vec<Key>,
    /// Length of a pixel along x of the picture, and its unit.
    pub pixel: Option<(f64, &'static str)>,
}

/// A text or a square with a text, at its place in the picture.
struct Placed<T> {
    at: [u32; 2],
    what: T,
}

/// Where everything is.
pub struct Layout {
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Upper left pixels of the slices.
    pub corners: Vec<[u32; 2]>,
    /// The size of each.
    slice: [u32; 2],
    /// Height of a line of text.
    line: u32,
    caption: Vec<Placed<String>>,
    scale_bar: Option<Placed<ScaleBar>>,
    bars: Vec<BarArea>,
    keys: Vec<[u32; 2]>,
}

/// Places things of given widths in lines from the left, `line` pixels apart, none beyond `right` if it need not be;
/// returns their places, and the lower end of the last line.
fn flow(widths: impl Iterator<Item = u32>, area: Flow) -> (Vec<[u32; 2]>, u32) {
    let [mut x, mut y] = [area.left, area.top];
    let mut places = Vec::new();
    for width in widths {
        if x > area.left && x + width > area.right {
            [x, y] = [area.left, y + area.line];
        }
        places.push([x, y]);
        x += width + area.gap;
    }
    let bottom = if places.is_empty() {
        area.top
    } else {
        y + area.line
    };
    (places, bottom)
}

/// Where things are placed.
#[derive(Clone, Copy)]
struct Flow {
    left: u32,
    right: u32,
    top: u32,
    line: u32,
    gap: u32,
}

/// The pixels of a text, rounded up.
fn whole_width(text: &str, size: u32) -> u32 {
    text_width(text, size).ceil() as u32
}

/// Upper left pixels of slices side by side, from that of the first.
pub fn side_by_side(first: [u32; 2], width: u32, panels: usize) -> Vec<[u32; 2]> {
    (0..panels as u32)
        .map(|i| [first[0] + i * (width + GAP), first[1]])
        .collect()
}

impl Page {
    /// Finds a place for everything around a slice of so many pixels.
    pub fn layout(&self, slice: [u32; 2]) -> Layout {
        let panels = self.titles.len().max(1);
        let across = panels as u32 * (slice[0] + GAP) - GAP;
        let content = across.max(NARROW);
        let line = (content / 56).clamp(16, 48);
        let margin = line;
        let area = Flow {
            left: margin,
            right: margin + content,
            top: margin / 2,
            line: line + line / 4,
            gap: 3 * line / 2,
        };
        let widths = self.caption.iter().map(|text| whole_width(text, line));
        let (places, top) = flow(widths, area);
        let caption = places.into_iter().zip(&self.caption);
        let caption = caption.map(|(at, text)| Placed {
            at,
            what: text.clone(),
        });
        let title = if self.titles.is_empty() { 0 } else { area.line };
        let corner = [margin, top + margin / 2 + title];
        let below = corner[1] + slice[1] + margin / 2;
        let (scale_bar, bars, bottom) = self.panels(slice[0], Flow { top: below, ..area });
        let area = Flow {
            top: bottom,
            gap: 2 * line,
            ..area
        };
        let widths = self.keys.iter().map(|key| key_width(key, line));
        let (keys, bottom) = flow(widths, area);
        Layout {
            size: [content + 2 * margin, bottom + margin / 2],
            corners: side_by_side(corner, slice[0], panels),
            slice,
            line,
            caption: caption.collect(),
            scale_bar,
            bars,
            keys,
        }
    }

    /// Places the scale bar and the legends; returns the lower end of them.
    fn panels(&self, slice: u32, area: Flow) -> (Option<Placed<ScaleBar>>, Vec<BarArea>, u32) {
        let line = area.line * 4 / 5;
        let bar = |left, top, width| BarArea {
            left,
            top,
            width,
            size: line,
        };
        // values reach out on both sides
        let beside = 2 * line;
        let width = ((area.right - area.left) * 13 / 50).clamp(BAR_WIDTH[0], BAR_WIDTH[1]);
        let scale_bar = self.scale_bar(slice);
        let first = scale_bar
            .as_ref()
            .map(|b| whole_width(&b.label, line).max(b.pixels));
        let widths = first
            .into_iter()
            .chain(self.bars.iter().map(|_| width + 2 * beside));
        let height = bar(0, 0, 1).bottom() + line / 2;
        let panels = Flow {
            line: height,
            gap: line,
            ..area
        };
        let (places, bottom) = flow(widths, panels);
        let mut places = places.into_iter();
        let scale_bar = scale_bar.and_then(|what| {
            Some(Placed {
                at: places.next()?,
                what,
            })
        });
        let bars = places.map(|[x, y]| bar(x + beside, y, width)).collect();
        (scale_bar, bars, bottom)
    }

    /// The longest bar of a round length that takes no more than a quarter of the slice.
    fn scale_bar(&self, slice: u32) -> Option<ScaleBar> {
        let (length, unit) = self.pixel?;
        let round = Round::below(length * f64::from(slice) / 4.0)?;
        let pixels = (round.value() / length).round() as u32;
        let text = round.text();
        let unit = match (unit, text.as_str()) {
            ("voxel", "1") => "voxel".to_owned(),
            ("voxel", _) => "voxels".to_owned(),
            (unit, _) => printed_unit(unit),
        };
        let label = format!("{text} {unit}");
        (pixels > 0).then_some(ScaleBar { pixels, label })
    }

    /// A picture of the page with room for the slice.
    pub fn draw(&self, layout: &Layout) -> Picture {
        let mut picture = Picture::new(layout.size, PAPER);
        let line = layout.line;
        for &corner in &layout.corners {
            picture.frame(corner, layout.slice);
        }
        for (title, &[left, top]) in self.titles.iter().zip(&layout.corners) {
            let title = fitted(title, f64::from(layout.slice[0]), line);
            let at = [left, top - line - line / 4].map(f64::from);
            picture.text(at, &title, line, INK);
        }
        for Placed { at, what } in &layout.caption {
            picture.text(at.map(f64::from), what, line, INK);
        }
        if let Some(Placed {
            at: [left, top],
            what: bar,
        }) = &layout.scale_bar
        {
            let area = BarArea {
                left: *left,
                top: *top,
                width: bar.pixels,
                size: line,
            };
            let thick = line / 3;
            let middle = area.bar_top() + (area.bar_height() - thick) / 2;
            picture.fill([*left, middle], [bar.pixels, thick], INK);
            let at = [*left, area.values_top()].map(f64::from);
            picture.text(at, &bar.label, line, INK);
        }
        for (bar, &area) in self.bars.iter().zip(&layout.bars) {
            let bar = ColourBar {
                title: &bar.title,
                ends: bar.ends,
                colour: &bar.colour,
            };
            bar.draw(&mut picture, area);
        }
        for (key, &[left, top]) in self.keys.iter().zip(&layout.keys) {
            let square = line * 4 / 5;
            let down = (line - square) / 2;
            for y in 0..square {
                for x in 0..square {
                    let colour = key.colour.unwrap_or_else(|| hatched([x, y]));
                    picture.set([left + x, top + down + y], colour);
                }
            }
            let at = [left + line + line / 4, top].map(f64::from);
            picture.text(at, &key.text, line, INK);
        }
        picture
    }
}

/// The pixels of a key.
fn key_width(key: &Key, line: u32) -> u32 {
    line + line / 4 + whole_width(&key.text, line)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Page {
        Page {
            caption: vec![
                "z = 3".into(),
                "40 × 36 voxels".into(),
                "x to the right".repeat(3),
            ],
            titles: Vec::new(),
            bars: vec![Bar {
                title: "volume [mm^3]".into(),
                ends: [0.0, 1.0],
                colour: Box::new(|s| [(255.0 * s) as u8; 3]),
            }],
            keys: vec![Key {
                colour: None,
                text: "cut".into(),
            }],
            pixel: Some((0.05, "mm")),
        }
    }

    #[test]
    fn nothing_covers_the_slice() {
        for slice in [[1, 1], [40, 2000], [1000, 900], [5000, 10]] {
            for panels in [0, 2, 3] {
                let titles = (0..panels)
                    .map(|i| format!("threshold {i}, half of it is above"))
                    .collect();
                let page = Page { titles, ..page() };
                let layout = page.layout(slice);
                assert!(layout.size[0] >= slice[0] && layout.size[1] > slice[1]);
                assert_eq!(layout.corners.len(), panels.max(1));
                let picture = page.draw(&layout);
                let mut end = 0;
                for &[left, top] in &layout.corners {
                    assert!(left > end && left + slice[0] < layout.size[0]);
                    end = left + slice[0];
                    for y in top..top + slice[1] {
                        for x in left..left + slice[0] {
                            assert_eq!(picture.at([x, y]), PAPER);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_scale_bar_has_a_round_length() {
        let bar = page().scale_bar(1000).unwrap();
        // a quarter of 50 mm is 12.5
        assert_eq!((bar.label.as_str(), bar.pixels), ("10 mm", 200));
        let voxels = Page {
            pixel: Some((0.5, "voxel")),
            ..Page::default()
        };
        assert_eq!(voxels.scale_bar(8).unwrap().label, "1 voxel");
        assert_eq!(voxels.scale_bar(64).unwrap().label, "5 voxels");
        assert!(Page::default().scale_bar(64).is_none());
    }
}
