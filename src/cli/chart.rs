//! A histogram in Unicode bars.

pub use crate::picture::ticks::place;
use crate::picture::ticks::ticks;

/// Rows of bars; each row has eight steps.
const ROWS: usize = 8;
const STEPS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// Columns before the bars: those of counts, and the axis.
const COUNT: usize = 5;
const GUTTER: usize = COUNT + 2;
/// Columns of text per tick.
const PER_TICK: usize = 12;

/// A place on the axis, and what it is.
pub struct Mark {
    /// Drawn on the axis, and before the text below it.
    pub sign: char,
    /// 0 is the left end of the bars and 1 the right one.
    pub share: f64,
    /// Said below the axis.
    pub text: String,
}

/// The most columns that bars have in so many columns of text.
pub fn columns(width: usize) -> usize {
    width.saturating_sub(GUTTER).min(128)
}

/// Draws counts of equal bins as bars on a logarithmic scale, in at most `width` columns, with an axis of counts, one of
/// values between `ends`, the outer edges of the bins, and marks on it, of which the first are on top. No bins give an
/// empty text.
pub fn draw(bins: &[f64], ends: [f64; 2], marks: &[Mark], width: usize) -> String {
    let columns = bins.len().min(columns(width));
    if columns == 0 {
        return String::new();
    }
    let sums: Vec<f64> = (0..columns)
        .map(|c| {
            let at = |c: usize| c * bins.len() / columns;
            bins[at(c)..at(c + 1)].iter().sum()
        })
        .collect();
    let tallest = sums.iter().copied().fold(0.0, f64::max);
    let heights: Vec<usize> = sums.iter().map(|&n| height(n, tallest)).collect();
    let counts = counts(tallest);
    let mut text = String::new();
    for row in (0..ROWS).rev() {
        let line: String = heights
            .iter()
            .map(|h| STEPS[h.saturating_sub(row * 8).min(8)])
            .collect();
        let (label, axis) = match &counts[row] {
            Some(label) => (label.as_str(), '┤'),
            None => ("", '│'),
        };
        text += format!("{label:>COUNT$} {axis}{line}").trim_end();
        text += "\n";
    }
    text + &axis(ends, marks, columns)
}

/// The axis of values: its line, the values, and what is marked.
fn axis(ends: [f64; 2], marks: &[Mark], columns: usize) -> String {
    let at = |share: f64| ((share * columns as f64) as usize).min(columns - 1);
    let mut line = vec!['─'; columns];
    let mut values = String::new();
    for tick in ticks(ends, (columns / PER_TICK).max(2) as u32) {
        let column = at(tick.share);
        let label = tick.label;
        let length = label.chars().count();
        let before = (GUTTER + column).saturating_sub(length / 2);
        let before = before.min((GUTTER + columns).saturating_sub(length));
        let filled = values.chars().count();
        // a value that would touch the one before it is left out
        if filled == 0 || before > filled {
            line[column] = '┬';
            values += &format!("{:1$}{label}", "", before - filled);
        }
    }
    let mut said = String::new();
    let inside = |mark: &&Mark| (0.0..=1.0).contains(&mark.share);
    for mark in marks.iter().filter(inside).rev() {
        line[at(mark.share)] = mark.sign;
        said = format!("{:COUNT$} {} {}\n{said}", "", mark.sign, mark.text);
    }
    let line: String = line.into_iter().collect();
    format!("{:COUNT$} └{line}\n{values}\n{said}", "")
}

/// Eighths of a row; something that occurs is always seen.
fn height(n: f64, tallest: f64) -> usize {
    if n == 0.0 {
        return 0;
    }
    let share = libm::log1p(n) / libm::log1p(tallest);
    ((share * (ROWS * 8) as f64).round() as usize).max(1)
}

/// The powers of ten that the rows reach, from below.
fn counts(tallest: f64) -> [Option<String>; ROWS] {
    const SIZES: [&str; 6] = ["", "k", "M", "G", "T", "P"];
    let mut found = [const { None::<String> }; ROWS];
    let mut power = 1.0;
    for k in 0..3 * SIZES.len() {
        if power > tallest {
            break;
        }
        let row = (height(power, tallest).max(1) - 1) / 8;
        let label = format!("1{}{}", "0".repeat(k % 3), SIZES[k / 3]);
        found[row].get_or_insert(label);
        power *= 10.0;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(ends: [f64; 2], value: f64) -> Mark {
        Mark {
            sign: '▲',
            share: place(ends, value),
            text: "half".into(),
        }
    }

    #[test]
    fn bars_are_logarithmic_and_fit() {
        let mut bins = vec![0.0; 256];
        bins[0] = 1e6;
        bins[128] = 1e3;
        bins[255] = 1.0;
        let ends = [0.0, 256.0];
        let text = draw(&bins, ends, &[mark(ends, 128.0)], 64 + GUTTER);
        let lines: Vec<Vec<char>> = text.lines().map(|l| l.chars().collect()).collect();
        assert_eq!(lines.len(), ROWS + 3);
        assert!(lines.iter().all(|l| l.len() <= 64 + GUTTER), "{text}");
        let column = |c: usize| {
            (0..ROWS)
                .filter(|r| lines[*r].get(c + GUTTER) == Some(&'█'))
                .count()
        };
        assert_eq!((column(0), column(1), column(32)), (8, 0, 4), "{text}");
        assert_eq!(
            lines[ROWS].iter().position(|c| *c == '▲'),
            Some(GUTTER + 32)
        );
        assert_eq!(lines[ROWS - 1].len(), GUTTER + 64);
        assert!(text.starts_with("   1M ┤"), "{text}");
        assert!(
            text.contains("   1k ┤") && text.contains("▲ half"),
            "{text}"
        );
        let values: Vec<&str> = text
            .lines()
            .nth(ROWS + 1)
            .unwrap()
            .split_whitespace()
            .collect();
        assert_eq!(values, ["0", "100", "200"]);
    }

    #[test]
    fn odd_histograms_are_drawn() {
        assert_eq!(draw(&[], [0.0, 1.0], &[], 80), "");
        assert_eq!(draw(&[1.0, 2.0], [0.0, 1.0], &[], 1), "");
        for width in [GUTTER + 1, 20, 1000] {
            let ends = [3.0, 3.0];
            let one = draw(&[5.0], ends, &[mark(ends, 3.0)], width);
            assert!(one.contains('█') && one.contains('▲'));
            let ends = [f64::MIN, f64::MAX];
            for value in [f64::NAN, 0.0, f64::INFINITY] {
                draw(&[0.0; 256], ends, &[mark(ends, value)], width);
                draw(&[1e300; 256], ends, &[mark(ends, value)], width);
            }
        }
    }

    #[test]
    fn the_first_mark_is_on_top() {
        let at = |sign, share| Mark {
            sign,
            share,
            text: format!("at {share}"),
        };
        let marks = [at('▲', 0.5), at('p', 0.5), at('l', 0.25), at('t', 2.0)];
        let text = draw(&[1.0; 8], [0.0, 8.0], &marks, 8 + GUTTER);
        let axis = text.lines().nth(ROWS).unwrap();
        assert!(
            axis.contains('▲') && axis.contains('l') && !axis.contains('p'),
            "{text}"
        );
        let said: Vec<_> = text.lines().skip(ROWS + 2).map(str::trim).collect();
        assert_eq!(said, ["▲ at 0.5", "p at 0.5", "l at 0.25"]);
    }
}
