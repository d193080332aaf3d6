//! Round numbers: where an axis has its ticks, and the length of a scale bar.

use crate::words::number;

/// A number of one digit times a power of ten, or a multiple of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Round {
    digits: i64,
    exponent: i32,
}

impl Round {
    /// The largest of 1, 2 and 5 times a power of ten that is not above `length`; `None` if `length` is not above 0 or
    /// not finite.
    pub fn below(length: f64) -> Option<Round> {
        let exponent = exponent(length)?;
        [5, 2, 1]
            .map(|digits| Round { digits, exponent })
            .into_iter()
            .find(|round| round.value() <= length)
    }

    /// The smallest of 1, 2 and 5 times a power of ten that is not below `length`; else as `below`.
    fn above(length: f64) -> Option<Round> {
        let exponent = exponent(length)?;
        let next = Round {
            digits: 1,
            exponent: exponent + 1,
        };
        [1, 2, 5]
            .map(|digits| Round { digits, exponent })
            .into_iter()
            .find(|round| round.value() >= length)
            .or(Some(next))
            .filter(|round| round.value().is_finite())
    }

    /// Its value.
    pub fn value(self) -> f64 {
        // read from its decimal digits, which rounds once
        let text = format!("{}e{}", self.digits, self.exponent);
        text.parse().unwrap_or(f64::NAN)
    }

    /// Its digits, without a power of ten if it is of a common size.
    pub fn text(self) -> String {
        let Round { digits, exponent } = self;
        let sign = if digits < 0 { "-" } else { "" };
        let text = digits.unsigned_abs().to_string();
        let size = text.len() as i32 - 1 + exponent;
        if digits == 0 {
            "0".to_owned()
        } else if !(-4..7).contains(&size) {
            let (first, rest) = text.split_at(1);
            let rest = rest.trim_end_matches('0');
            let point = if rest.is_empty() { "" } else { "." };
            format!("{sign}{first}{point}{rest}e{size}")
        } else if exponent >= 0 {
            format!("{sign}{text}{}", "0".repeat(exponent as usize))
        } else {
            let decimals = exponent.unsigned_abs() as usize;
            let text = format!("{text:0>width$}", width = decimals + 1);
            let (whole, part) = text.split_at(text.len() - decimals);
            format!("{sign}{whole}.{part}")
        }
    }
}

/// The power of ten of the first digit of a length above 0.
fn exponent(length: f64) -> Option<i32> {
    if !(length.is_finite() && length > 0.0) {
        return None;
    }
    let text = format!("{length:e}");
    text.split_once('e')?.1.parse().ok()
}

/// A tick of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// Where it stands: 0 is the first end of the axis and 1 the second one.
    pub share: f64,
    /// Its value.
    pub label: String,
}

/// Where a value lies on an axis: 0 is `first` and 1 is `last`, which may be the smaller one. 0 if these are the same.
pub fn place([first, last]: [f64; 2], value: f64) -> f64 {
    // halves, since the distance of two finite numbers may not be finite
    let wide = last / 2.0 - first / 2.0;
    match wide == 0.0 {
        true => 0.0,
        false => (value / 2.0 - first / 2.0) / wide,
    }
}

/// Ticks at round values of an axis, at most so many and one more, from its first end to its last. An axis of one value,
/// or of values that differ too little to be told apart, has one in its middle.
pub fn ticks(ends: [f64; 2], most: u32) -> Vec<Tick> {
    let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
    let middle = || {
        let label = number(low / 2.0 + high / 2.0, 4);
        vec![Tick { share: 0.5, label }]
    };
    let each = (high / f64::from(most.max(1))) - (low / f64::from(most.max(1)));
    let Some(step) = Round::above(each) else {
        return middle();
    };
    let [from, to] = [(low / step.value()).ceil(), (high / step.value()).floor()];
    // beyond 2^50 steps from 0 neighbours are hardly told apart
    if from.abs().max(to.abs()) > (1u64 << 50) as f64 {
        return middle();
    }
    let at = |n: i64| Round {
        digits: n * step.digits,
        ..step
    };
    let mut found: Vec<Tick> = (from as i64..=to as i64)
        .map(|n| Tick {
            share: place(ends, at(n).value()).clamp(0.0, 1.0),
            label: at(n).text(),
        })
        .collect();
    if ends[0] > ends[1] {
        found.reverse();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ends: [f64; 2], most: u32) -> Vec<String> {
        ticks(ends, most).into_iter().map(|t| t.label).collect()
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(
            labels([0.0, 1.0], 5),
            ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(labels([25.0, 230.0], 5), ["50", "100", "150", "200"]);
        assert_eq!(labels([-0.013, 0.021], 4), ["-0.01", "0", "0.01", "0.02"]);
        assert_eq!(labels([0.0, 3e9], 4), ["0", "1e9", "2e9", "3e9"]);
        assert_eq!(labels([1.0, 1.5e-7], 2), ["1.0", "0.5"]);
        let shares: Vec<f64> = ticks([10.0, 0.0], 2).iter().map(|t| t.share).collect();
        assert_eq!(shares, [0.0, 0.5, 1.0]);
    }

    #[test]
    fn odd_axes_have_few_ticks() {
        assert_eq!(labels([3.5, 3.5], 5), ["3.5"]);
        for ends in [
            [f64::MIN, f64::MAX],
            [0.0, f64::MIN_POSITIVE / 1e10],
            [0.0, 5e-324],
            [1e16, 1e16 + 2.0],
            [f64::NAN, 1.0],
            [0.0, f64::INFINITY],
        ] {
            for most in [0, 1, 7] {
                let found = ticks(ends, most);
                assert!(
                    found.len() <= most.max(1) as usize + 1,
                    "{ends:?} {found:?}"
                );
                assert!(
                    found.iter().all(|t| (0.0..=1.0).contains(&t.share)),
                    "{ends:?}"
                );
            }
        }
    }

    #[test]
    fn lengths_are_rounded_down() {
        let text = |v| Round::below(v).map(Round::text);
        let expected = [
            ("0.05", 0.07),
            ("20", 49.9),
            ("1", 1.0),
            ("5e8", 9e8),
            ("0.0002", 0.0003),
        ];
        for (round, length) in expected {
            assert_eq!(text(length).as_deref(), Some(round));
        }
        assert!(
            [0.0, -1.0, f64::NAN, f64::INFINITY]
                .iter()
                .all(|&v| text(v).is_none())
        );
    }
}
