//! Numbers and counts as people read them.

/// A number in so many digits that say something; whole numbers stay whole, and very small and very large ones have an
/// exponent.
pub fn rounded(v: f64, digits: usize) -> String {
    if v.fract() == 0.0 && v.abs() < 1e15 {
        return v.to_string();
    }
    if !(1e-4..1e9).contains(&v.abs()) {
        return format!("{v:.*e}", digits - 1);
    }
    let before = libm::log10(v.abs()).floor() as i32 + 1;
    format!("{v:.*}", (digits as i32 - before).max(0) as usize)
}

/// A measure as tables for people have it: in four digits.
pub fn measure(v: f64) -> String {
    rounded(v, 4)
}

/// The same without zeros at the end, for text in which numbers do not stand one below the other.
pub fn number(v: f64, digits: usize) -> String {
    let text = rounded(v, digits);
    let (mantissa, exponent) = match text.find('e') {
        Some(at) => text.split_at(at),
        None => (text.as_str(), ""),
    };
    match mantissa.contains('.') {
        true => {
            let short = mantissa.trim_end_matches('0').trim_end_matches('.');
            format!("{short}{exponent}")
        }
        false => text,
    }
}

/// A number in the digits that it is read from; very small and very large ones with an exponent, and not with hundreds of
/// zeros.
pub fn exact(v: f64) -> String {
    match v == 0.0 || (1e-5..1e16).contains(&v.abs()) {
        true => v.to_string(),
        false => format!("{v:e}"),
    }
}

/// A share in percent, to a tenth; one that is not 0 never reads 0.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent > 0.0 && percent < 0.05 {
        true => format!("{} %", number(percent, 2)),
        false => format!("{percent:.1} %"),
    }
}

/// A text in one line: names of files may have breaks of lines in them, which are told as `\n`.
pub fn one_line(text: &str) -> String {
    let told = |c: char| match c.is_control() {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    text.chars().map(told).collect()
}

/// `12,345,678`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// `1 cell`, `1,470 cells`: the plural has an s.
pub fn things(n: u64, name: &str) -> String {
    format!("{} {name}{}", count(n), if n == 1 { "" } else { "s" })
}

/// `1 slice has`, `2 slices have`: the words for one and for several are given.
pub fn counted(n: u64, one: &str, several: &str) -> String {
    format!("{} {}", count(n), if n == 1 { one } else { several })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_say_something() {
        for (value, aligned, short) in [
            (0.903_63, "0.9036", "0.9036"),
            (4.5, "4.500", "4.5"),
            (-12.345_67, "-12.35", "-12.35"),
            (-0.25, "-0.2500", "-0.25"),
            (98_765.4, "98765", "98765"),
            (1470.0, "1470", "1470"),
            (0.012_345_6, "0.01235", "0.01235"),
            (0.000_123_456, "0.0001235", "0.0001235"),
            (1.23456e-7, "1.235e-7", "1.235e-7"),
            (1.5e20, "1.500e20", "1.5e20"),
            (0.0, "0", "0"),
        ] {
            assert_eq!((&*rounded(value, 4), &*number(value, 4)), (aligned, short));
        }
        let texts = [0.5, 1234.56789, 65535.0, -77.0].map(|v| number(v, 6));
        assert_eq!(texts, ["0.5", "1234.57", "65535", "-77"]);
        assert_eq!(number(f64::NAN, 6), "NaN");
    }

    #[test]
    fn counts_are_grouped() {
        let texts = [0, 7, 999, 1000, 123_456, 1_234_567].map(count);
        assert_eq!(texts, ["0", "7", "999", "1,000", "123,456", "1,234,567"]);
        let texts = [0, 1, 2, 1470].map(|n| things(n, "cell"));
        assert_eq!(texts, ["0 cells", "1 cell", "2 cells", "1,470 cells"]);
        let texts = [1, 2000].map(|n| counted(n, "file is", "files are"));
        assert_eq!(texts, ["1 file is", "2,000 files are"]);
    }
}
