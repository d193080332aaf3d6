//! Which saddles are necks, at the ratio that was asked for and at those of the curve.

use super::graph::{NeckRule, TreeSaddle};
use super::metric::Metric;

/// Ratios of the split curve, in thousandths: 0.5, 0.55, ... 0.95.
pub const CURVE: [u32; 10] = [500, 550, 600, 650, 700, 750, 800, 850, 900, 950];

/// Judges saddles, and counts.
#[derive(Debug, Clone)]
pub struct Judge {
    rule: NeckRule,
    metric: Metric,
    /// Saddles.
    pub saddles: u64,
    /// Necks among them.
    pub necks: u64,
    /// Necks at each ratio of the curve.
    pub cuts: [u64; CURVE.len()],
}

impl Judge {
    /// By this rule.
    pub fn new(rule: NeckRule, metric: Metric) -> Self {
        Judge {
            rule,
            metric,
            saddles: 0,
            necks: 0,
            cuts: [0; CURVE.len()],
        }
    }

    /// Adds what was counted elsewhere.
    pub fn add(&mut self, saddles: u64, necks: u64, cuts: &[u64]) {
        self.saddles += saddles;
        self.necks += necks;
        for (sum, cuts) in self.cuts.iter_mut().zip(cuts) {
            *sum += cuts;
        }
    }

    /// True if the basins at a saddle are one cell.
    pub fn joins(&mut self, saddle: &TreeSaddle) -> bool {
        let joins = |rule: NeckRule| rule.joins(&self.metric, saddle.level, saddle.peak);
        for (cuts, ratio_permille) in self.cuts.iter_mut().zip(CURVE) {
            *cuts += u64::from(!joins(NeckRule {
                ratio_permille,
                ..self.rule
            }));
        }
        let one = joins(self.rule);
        self.saddles += 1;
        self.necks += u64::from(!one);
        one
    }
}

/// The number of cells at each ratio of the curve, in thousandths, of so many components that are cut as often.
pub fn curve(components: u64, cuts: &[u64; CURVE.len()]) -> [(u32, u64); CURVE.len()] {
    std::array::from_fn(|i| (CURVE[i], components + cuts[i]))
}
