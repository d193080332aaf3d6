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
        self.weight += weight;
        let away = value - self.mean;
        self.mean += away * weight / self.weight;
        self.square += weight * away * (value - self.mean);
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
