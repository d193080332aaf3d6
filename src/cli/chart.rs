//! A histogram in Unicode bars.

/// Rows of bars; each row has eight steps.
const ROWS: usize = 8;
const STEPS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// The most columns that bars have in so many columns of text.
pub fn columns(width: usize) -> usize {
    width.saturating_sub(2).min(128)
}

/// Draws counts of equal bins as bars on a logarithmic scale, in at most `width` columns, with the ends of their
/// range below and a mark: 0 is the left end of the bars and 1 the right one. No bins give an empty text.
pub fn draw(bins: &[f64], range: [f64; 2], mark: Option<f64>, width: usize) -> String {
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
    let mut text = String::new();
    for row in (0..ROWS).rev() {
        let line: String = heights
            .iter()
            .map(|h| STEPS[h.saturating_sub(row * 8).min(8)])
            .collect();
        text += &format!("  {}\n", line.trim_end());
    }
    if let Some(mark) = mark.filter(|mark| (0.0..=1.0).contains(mark)) {
        let column = ((mark * columns as f64) as usize).min(columns - 1);
        text += &format!("  {:column$}▲\n", "");
    }
    let [low, high] = range.map(number);
    let gap = columns.saturating_sub(low.len() + high.len()).max(1);
    text + &format!("  {low}{:gap$}{high}\n", "")
}

/// Where a value lies on an axis: 0 is `low` and 1 is `high`. 0 if these are the same.
pub fn place([low, high]: [f64; 2], value: f64) -> f64 {
    // halves, since the distance of two finite numbers may not be finite
    match high > low {
        true => (value / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0),
        false => 0.0,
    }
}

/// Eighths of a row; something that occurs is always seen.
fn height(n: f64, tallest: f64) -> usize {
    if n == 0.0 {
        return 0;
    }
    let share = libm::log1p(n) / libm::log1p(tallest);
    ((share * (ROWS * 8) as f64).round() as usize).max(1)
}

/// A number in up to 6 digits.
pub fn number(v: f64) -> String {
    if v == 0.0 || (1e-3..1e9).contains(&v.abs()) {
        let digits = if v.abs() >= 1000.0 { 2 } else { 5 };
        let text = format!("{v:.digits$}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        text.to_string()
    } else {
        format!("{v:.4e}")
    }
}

/// A number in four digits that say something, for people; whole numbers stay whole.
pub fn rounded(v: f64) -> String {
    const DIGITS: i32 = 4;
    if v.fract() == 0.0 && v.abs() < 1e15 {
        return v.to_string();
    }
    if !(1e-4..1e9).contains(&v.abs()) {
        return format!("{v:.*e}", DIGITS as usize - 1);
    }
    let before = libm::log10(v.abs()).floor() as i32 + 1;
    format!("{v:.*}", (DIGITS - before).max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_logarithmic_and_fit() {
        let mut bins = vec![0.0; 256];
        bins[0] = 1e6;
        bins[128] = 1e3;
        bins[255] = 1.0;
        let text = draw(&bins, [0.0, 255.0], Some(place([0.0, 255.0], 127.5)), 66);
        let lines: Vec<Vec<char>> = text.lines().map(|l| l.chars().collect()).collect();
        assert_eq!(lines.len(), ROWS + 2);
        assert!(lines.iter().all(|l| l.len() <= 66), "{text}");
        let column = |c: usize| {
            (0..ROWS)
                .filter(|r| lines[*r].get(c + 2) == Some(&'█'))
                .count()
        };
        assert_eq!((column(0), column(1), column(32)), (8, 0, 4), "{text}");
        assert_eq!(lines[ROWS].iter().position(|c| *c == '▲'), Some(2 + 32));
        assert_eq!(lines[ROWS - 1].len(), 66);
    }

    #[test]
    fn odd_histograms_are_drawn() {
        assert_eq!(draw(&[], [0.0, 1.0], None, 80), "");
        assert_eq!(draw(&[1.0, 2.0], [0.0, 1.0], None, 1), "");
        for width in [3, 10, 1000] {
            let one = draw(&[5.0], [3.0, 3.0], Some(place([3.0, 3.0], 3.0)), width);
            assert!(one.contains('█') && one.contains('▲'));
            let ends = [f64::MIN, f64::MAX];
            for value in [f64::NAN, 0.0, f64::INFINITY] {
                draw(&[0.0; 256], ends, Some(place(ends, value)), width);
            }
        }
    }

    #[test]
    fn people_read_four_digits() {
        for (value, text) in [
            (0.903_63, "0.9036"),
            (4.5, "4.500"),
            (-12.345_67, "-12.35"),
            (98_765.4, "98765"),
            (1470.0, "1470"),
            (0.012_345_6, "0.01235"),
            (1.23456e-7, "1.235e-7"),
            (1.5e20, "1.500e20"),
            (0.0, "0"),
        ] {
            assert_eq!(rounded(value), text);
        }
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, -77.0, 0.5, 1234.56789, 65535.0, 1e12, 1e-9].map(number);
        let expected = [
            "0",
            "-77",
            "0.5",
            "1234.57",
            "65535",
            "1.0000e12",
            "1.0000e-9",
        ];
        assert_eq!(texts, expected);
    }
}
