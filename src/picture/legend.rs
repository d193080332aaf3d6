//! Colour bars: the legend of colours by value, as a picture and as SVG, and as a part of larger pictures.

use super::font::{fitted, width};
use super::ticks::{Tick, ticks};
use super::{FRAME, INK, Picture, hex};
use std::fmt::Write;

/// Size of a legend as a picture of its own.
const SIZE: [u32; 2] = [640, 120];
/// Its bar.
const BAR: BarArea = BarArea {
    left: 48,
    top: 12,
    width: 544,
    size: 24,
};
/// Stops of the gradient in the SVG.
const STOPS: u32 = 64;
/// Height of the letters of a line of 1 pixel: CSS counts without the space between lines.
const EM: f64 = 0.859;

/// The most ticks that are tried.
const TICKS: u32 = 8;

/// What a colour bar shows.
pub struct ColourBar<'a> {
    /// What the colours mean, with its unit.
    pub title: &'a str,
    /// The values of the first and the last colour.
    pub ends: [f64; 2],
    /// The colour of a share from 0 to 1.
    pub colour: &'a dyn Fn(f64) -> [u8; 3],
}

/// Where a colour bar is drawn: the title above it, the ticks with their values below. Values may reach out by half of
/// their width to both sides.
#[derive(Debug, Clone, Copy)]
pub struct BarArea {
    /// Left end of the bar, in pixels of the picture.
    pub left: u32,
    /// Upper end of the title.
    pub top: u32,
    /// Width of the bar.
    pub width: u32,
    /// Height of a line of text.
    pub size: u32,
}

impl BarArea {
    /// Upper end of the bar.
    pub fn bar_top(&self) -> u32 {
        self.top + self.size + self.size / 4
    }

    /// Height of the bar.
    pub fn bar_height(&self) -> u32 {
        self.size + self.size / 4
    }

    /// Height of a tick.
    fn tick(&self) -> u32 {
        self.size / 4
    }

    /// Upper end of the values.
    pub fn values_top(&self) -> u32 {
        self.bar_top() + self.bar_height() + self.tick() + self.size / 8
    }

    /// Lower end of all.
    pub fn bottom(&self) -> u32 {
        self.values_top() + self.size
    }

    /// As many ticks as have room for their values.
    fn ticks(&self, ends: [f64; 2]) -> Vec<Tick> {
        let fit = |ticks: &Vec<Tick>| {
            ticks.windows(2).all(|pair| {
                let apart = (pair[1].share - pair[0].share) * f64::from(self.width);
                let halves =
                    (width(&pair[0].label, self.size) + width(&pair[1].label, self.size)) / 2.0;
                halves + f64::from(self.size) / 2.0 <= apart
            })
        };
        let tried = (1..=TICKS).rev().map(|most| ticks(ends, most));
        tried.clone().find(fit).unwrap_or_else(|| ticks(ends, 1))
    }
}

/// A title as it is drawn: units with `µ` and raised digits.
fn printed(title: &str) -> String {
    let title: String = title
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    match title.strip_suffix(']').and_then(|t| t.rsplit_once('[')) {
        Some((name, unit)) => format!("{name}[{}]", printed_unit(unit)),
        None => title,
    }
}

/// A unit as it is drawn: `µm³` for `um^3`.
pub fn printed_unit(unit: &str) -> String {
    let unit = match unit.strip_prefix("um") {
        Some(rest) => format!("µm{rest}"),
        None => unit.to_owned(),
    };
    unit.replace("^2", "²").replace("^3", "³")
}

impl ColourBar<'_> {
    /// The legend as a picture of its own.
    pub fn picture(&self) -> Picture {
        let mut picture = Picture::new(SIZE, [255; 3]);
        self.draw(&mut picture, BAR);
        picture
    }

    /// Draws it into a picture.
    pub fn draw(&self, picture: &mut Picture, area: BarArea) {
        let title = fitted(&printed(self.title), f64::from(area.width), area.size);
        picture.text(
            [f64::from(area.left), f64::from(area.top)],
            &title,
            area.size,
            INK,
        );
        // a frame, for colours that are near to that of the paper
        picture.frame([area.left, area.bar_top()], [area.width, area.bar_height()]);
        for x in 0..area.width {
            // one pixel is the first and the last at once
            let colour = (self.colour)(f64::from(x) / f64::from((area.width - 1).max(1)));
            for y in 0..area.bar_height() {
                picture.set([area.left + x, area.bar_top() + y], colour);
            }
        }
        for tick in area.ticks(self.ends) {
            let x = tick.share * f64::from(area.width.saturating_sub(1));
            let foot = area.bar_top() + area.bar_height();
            for y in 0..area.tick() {
                picture.set([area.left + x.round() as u32, foot + y], INK);
            }
            let left = f64::from(area.left) + x - width(&tick.label, area.size) / 2.0;
            picture.text(
                [left, f64::from(area.values_top())],
                &tick.label,
                area.size,
                INK,
            );
        }
    }

    /// The legend as SVG, of the same measures, with text as text.
    pub fn svg(&self) -> String {
        let [width, height] = SIZE;
        let ink = hex(INK);
        let title = escaped(&fitted(
            &printed(self.title),
            f64::from(BAR.width),
            BAR.size,
        ));
        let base = |top: u32| f64::from(top) + f64::from(BAR.size) * 0.8;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, sans-serif\" \
             font-size=\"{:.1}\" fill=\"{ink}\">\n<defs><linearGradient id=\"map\">\n",
            f64::from(BAR.size) * EM
        );
        for stop in 0..=STOPS {
            let share = f64::from(stop) / f64::from(STOPS);
            let colour = hex((self.colour)(share));
            let _ = writeln!(svg, "<stop offset=\"{share}\" stop-color=\"{colour}\"/>");
        }
        let _ = write!(
            svg,
            "</linearGradient></defs>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
             <text x=\"{}\" y=\"{:.1}\">{title}</text>\n\
             <rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"url(#map)\" stroke=\"{}\"/>\n",
            BAR.left,
            base(BAR.top),
            BAR.left,
            BAR.bar_top(),
            BAR.width,
            BAR.bar_height(),
            hex(FRAME)
        );
        for tick in BAR.ticks(self.ends) {
            let x = f64::from(BAR.left) + tick.share * f64::from(BAR.width);
            let foot = BAR.bar_top() + BAR.bar_height();
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {foot}v{}\" stroke=\"{ink}\"/>\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                BAR.tick(),
                base(BAR.values_top()),
                tick.label
            );
        }
        svg + "</svg>\n"
    }
}

/// A text as XML has it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar<'a>(
        title: &'a str,
        ends: [f64; 2],
        colour: &'a dyn Fn(f64) -> [u8; 3],
    ) -> ColourBar<'a> {
        ColourBar {
            title,
            ends,
            colour,
        }
    }

    #[test]
    fn units_are_printed_as_people_do() {
        assert_eq!(printed("volume [um^3]"), "volume [µm³]");
        assert_eq!(printed("area [mm^2]"), "area [mm²]");
        assert_eq!(printed("volume ^ 2\n"), "volume ^ 2 ");
    }

    #[test]
    fn a_legend_has_its_colours_and_values() {
        let grey = |share: f64| [(share * 255.0) as u8; 3];
        let picture = bar("a", [0.0, 1.0], &grey).picture();
        assert_eq!(picture.size(), SIZE);
        let y = BAR.bar_top() + 5;
        assert_eq!(picture.at([BAR.left, y]), [0; 3]);
        assert_eq!(picture.at([BAR.left + BAR.width - 1, y]), [255; 3]);
        assert!(picture != bar("a", [0.0, 2.0], &grey).picture());
        let svg = bar("a < b & c", [0.0, 1.0], &grey).svg();
        assert!(
            svg.contains("a &lt; b &amp; c") && svg.contains(">0.4<"),
            "{svg}"
        );
        assert_eq!(quick_xml_events(&svg), Ok(()));
    }

    /// Reads XML to its end.
    fn quick_xml_events(text: &str) -> Result<(), String> {
        let mut reader = quick_xml::Reader::from_str(text);
        loop {
            match reader.read_event() {
                Ok(quick_xml::events::Event::Eof) => return Ok(()),
                Ok(_) => {}
                Err(e) => return Err(e.to_string()),
            }
        }
    }

    #[test]
    fn any_title_and_values_are_drawn() {
        let black = |_: f64| [0; 3];
        for ends in [
            [f64::MIN, f64::MAX],
            [1.0, 1.0],
            [5.0, -5.0],
            [-1e-300, 1e300],
            [123_456.5, 123_457.0],
        ] {
            for title in ["", &"long ".repeat(200), "字 [um^3]"] {
                let bar = bar(title, ends, &black);
                assert_eq!(bar.picture().size(), SIZE);
                assert!(bar.svg().ends_with("</svg>\n"));
            }
        }
    }
}
