//! Passes over a volume: range, histogram, thresholds, and how large a surface will be.

pub(crate) mod estimate;
mod histogram;
mod peaks;
pub(crate) mod statistics;
pub(crate) mod threshold;
mod walk;
