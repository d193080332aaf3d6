//! Passes over a volume: range, histogram, thresholds, and how large a surface will be.

pub(crate) mod estimate;
mod histogram;
pub(crate) mod statistics;
mod walk;
