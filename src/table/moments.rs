//! Weighted mean and standard deviation.

/// Gathers values with weights, by the stable update of West (CACM 22, 1979).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Moments {
    weight: f64,
    mean: f64,
    square: f64,
}

impl Moments {
    /// Of all values.
    pub fn of(values: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut all = Moments::default();
        values.for_each(|(value, weight)| all.add(value, weight));
        all
    }

    /// Adds a value; one whose weight is not above 0 does not count.
    pub fn add(&mut self, value: f64, weight: f64) {
        if weight.is_nan() || weight <= 0.0 {
            return;
        }
        let before = self.weight;
        self.weight += weight;
        let away = value - self.mean;
        // the mean of one value is that value, and no rounding makes a square negative
        self.mean = match before > 0.0 {
            true => self.mean + away * weight / self.weight,
            false => value,
        };
        self.square += away * away * (weight * (before / self.weight));
    }

    /// 0 without values.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// That of the values themselves, by the sum of weights; not a number without values.
    pub fn sd(&self) -> f64 {
        (self.square / self.weight).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Diameters and volumes whose products and quotients are rounded.
    fn sizes() -> impl Iterator<Item = (f64, f64)> {
        (1..2000).map(|i| {
            (
                libm::cbrt(f64::from(i)) * 1.240_700_981_798_8,
                f64::from(i) * 0.1,
            )
        })
    }

    #[test]
    fn one_value_and_equal_values_do_not_vary() {
        for (value, weight) in sizes() {
            for n in [1, 2, 3, 10] {
                let all = Moments::of(std::iter::repeat_n((value, weight), n));
                assert_eq!((all.mean(), all.sd()), (value, 0.0), "{n} of {value}");
            }
        }
    }

    #[test]
    fn values_that_are_nearly_equal_vary_a_little() {
        for (value, weight) in sizes() {
            let next = value.next_up();
            for values in [
                [value, next, next],
                [next, value, value],
                [value, next, value],
            ] {
                let all = Moments::of(values.into_iter().zip([weight, 0.7 * weight, 3.1 * weight]));
                assert!(
                    all.sd() >= 0.0 && all.sd() <= next - value,
                    "{values:?}: {}",
                    all.sd()
                );
            }
        }
    }

    /// As by two passes.
    #[test]
    fn values_far_from_zero_keep_their_spread() {
        let values = [4.0, 7.0, 13.0, 16.0].map(|v| (1e9 + v, 1.0));
        let sd = Moments::of(values.into_iter()).sd();
        assert!((sd - 22.5_f64.sqrt()).abs() < 1e-12, "{sd}");
        let all: Vec<_> = sizes().collect();
        let weight: f64 = all.iter().map(|v| v.1).sum();
        let mean = all.iter().map(|v| v.0 * v.1).sum::<f64>() / weight;
        let square: f64 = all
            .iter()
            .map(|v| v.1 * ((v.0 - mean) * (v.0 - mean)))
            .sum();
        let found = Moments::of(all.iter().copied());
        assert!((found.mean() - mean).abs() < 1e-12 * mean);
        assert!((found.sd() - (square / weight).sqrt()).abs() < 1e-12 * mean);
    }
}
