//! Passes over a volume: range, histogram, thresholds, and how large a surface will be.

mod columns;
pub(crate) mod cylinder;
pub(crate) mod estimate;
pub(crate) mod fill_value;
mod histogram;
pub(crate) mod inside;
mod mask;
mod peaks;
pub(crate) mod statistics;
pub(crate) mod threshold;
mod walk;
