//! Numbers that the edge of the grid does not distort: large bodies are cut by it more often than small ones, so those
//! that are whole are too few and too small.

use super::Table;
use super::moments::Moments;
use super::outside::find;
use super::reader::{Row, TableReader};
use crate::error::Result;
use crate::grid::Placement;
use crate::manifest::Manifest;
use serde::Serialize;

/// What the correction of Miles and Lantuéjoul gives for the chosen rows, and when it does not apply.
///
/// A row that does not touch the border and whose box has b x b x b voxels could lie at (n - b - 1)^3 places of a grid of
/// n voxels along each axis without touching it. It stands for as many as the inverse of that number, in a voxel's
/// volume: the sum of these weights is the number of bodies by volume of the sample, and means with these weights are
/// those of the sample, whatever its sizes are, as long as the grid lies in the sample at random.
///
/// Source: R. E. Miles, "On the elimination of edge effects in planar sampling", in Stochastic Geometry, Wiley, 1974;
/// C. Lantuéjoul, "Computation of the histograms of the number of edges and neighbours of cells in a tessellation", in
/// Geometrical Probability and Biological Structures, Springer, 1978; J. Serra, Image Analysis and Mathematical
/// Morphology, Academic Press, 1982.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EdgeCorrection {
    /// `miles-lantuejoul`.
    pub method: &'static str,
    /// Whether it applies to the chosen rows of this set.
    pub applies: bool,
    /// If it does not, why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Rows that do not touch the border: they alone have weights.
    pub rows: u64,
    /// Unit of volumes; a density is by this unit.
    pub unit: String,
    /// Mean volume of these rows without weights; absent if there are none.
    pub mean_volume_whole: Option<f64>,
    /// Mean equivalent diameter with weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equivalent_diameter_mean: Option<f64>,
    /// Its standard deviation with weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equivalent_diameter_sd: Option<f64>,
    /// The longest box of these rows along an axis, as a share of the grid there, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longest_share: Option<f64>,
}

/// The two numbers, and what is to be said of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Corrected {
    pub number_density: Option<f64>,
    pub mean_volume: Option<f64>,
    pub correction: EdgeCorrection,
}

/// Where a table has what the weights need.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    /// The lower and the upper ends of boxes, along the world's axes.
    ends: [[usize; 3]; 2],
    id: usize,
    volume: usize,
    diameter: usize,
    unit: String,
}

impl Columns {
    /// Those of a table of cells or objects.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if one is missing.
    pub fn of(table: &TableReader) -> Result<Self> {
        let names = [["min_x", "min_y", "min_z"], ["max_x", "max_y", "max_z"]];
        let mut ends = [[0; 3]; 2];
        for (ends, names) in ends.iter_mut().zip(names) {
            for (end, name) in ends.iter_mut().zip(names) {
                *end = find(table, name)?;
            }
        }
        let volume = find(table, "volume")?;
        Ok(Columns {
            ends,
            id: find(table, "id")?,
            volume,
            diameter: find(table, "equivalent_diameter")?,
            unit: table.columns()[volume].unit.clone(),
        })
    }
}

/// The grid as far as weights need it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    /// Voxels along the world's axes, and the size of one.
    voxels: [f64; 3],
    spacing: [f64; 3],
}

impl Window {
    /// A grid of so many voxels; `None` if its axes are not those of the world, so that boxes do not tell how long bodies
    /// are along them.
    pub fn new(dims: [u32; 3], place: &Placement) -> Option<Self> {
        if place.is_rotated() {
            return None;
        }
        let axis = |r: usize| (0..3).find(|&a| place.directions[a][r] != 0.0);
        let axes = [axis(0)?, axis(1)?, axis(2)?];
        Some(Window {
            voxels: axes.map(|a| f64::from(dims[a])),
            spacing: axes.map(|a| place.spacing[a]),
        })
    }

    /// Voxels from outside to outside of a box of voxels' centres.
    fn lengths(&self, ends: [[f64; 3]; 2]) -> [f64; 3] {
        std::array::from_fn(|r| ((ends[1][r] - ends[0][r]) / self.spacing[r]).round() + 1.0)
    }

    /// Places at which a box of so many voxels touches no face of the grid.
    fn places(&self, lengths: [f64; 3]) -> f64 {
        (0..3)
            .map(|r| (self.voxels[r] - lengths[r] - 1.0).max(0.0))
            .product()
    }
}

/// Gathers the weights of rows; memory does not grow with their number.
#[derive(Debug)]
pub(super) struct Weights {
    window: Option<Window>,
    /// Of volumes.
    unit: String,
    density: f64,
    volume: Moments,
    volume_whole: Moments,
    diameter: Moments,
    rows: u64,
    longest: f64,
    /// The first row that reaches from one end of the grid to the other, and the axis.
    through: Option<(u64, usize)>,
    /// The first row that is whole and has no place to lie at, which no table of this program has.
    impossible: Option<u64>,
}

/// A row as the weights see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    pub id: u64,
    /// The ends of the box of its voxels' centres.
    pub ends: [[f64; 3]; 2],
    pub volume: f64,
    pub diameter: f64,
    pub at_border: bool,
}

impl Body {
    /// The body of a row; `None` if a number is missing.
    ///
    /// # Errors
    /// What reading returns.
    pub fn read(row: &Row, columns: &Columns, at_border: bool) -> Result<Option<Self>> {
        let mut ends = [[0.0; 3]; 2];
        for (ends, columns) in ends.iter_mut().zip(&columns.ends) {
            for (end, &column) in ends.iter_mut().zip(columns) {
                let Some(v) = row.number(column)? else {
                    return Ok(None);
                };
                *end = v;
            }
        }
        let (Some(volume), Some(diameter)) =
            (row.number(columns.volume)?, row.number(columns.diameter)?)
        else {
            return Ok(None);
        };
        Ok(Some(Body {
            id: row.whole(columns.id)?,
            ends,
            volume,
            diameter,
            at_border,
        }))
    }
}

impl Weights {
    /// For the rows of a set.
    pub fn of(manifest: &Manifest, columns: &Columns) -> Self {
        let window = Window::new(manifest.grid.dims.0, &manifest.measured());
        Self::new(window, columns.unit.clone())
    }

    fn new(window: Option<Window>, unit: String) -> Self {
        Weights {
            window,
            unit,
            density: 0.0,
            volume: Moments::default(),
            volume_whole: Moments::default(),
            diameter: Moments::default(),
            rows: 0,
            longest: 0.0,
            through: None,
            impossible: None,
        }
    }

    /// Adds a row.
    pub fn add(&mut self, body: &Body) {
        if !body.at_border {
            self.rows += 1;
            self.volume_whole.add(body.volume, 1.0);
        }
        let Some(window) = self.window else {
            return;
        };
        let lengths = window.lengths(body.ends);
        if body.at_border {
            let through = (0..3).find(|&r| lengths[r] >= window.voxels[r]);
            let found = through.map(|axis| (body.id, axis));
            self.through = self.through.or(found);
            return;
        }
        let places = window.places(lengths);
        if places < 1.0 {
            self.impossible = self.impossible.or(Some(body.id));
            return;
        }
        let weight = 1.0 / (places * window.spacing.iter().product::<f64>());
        self.density += weight;
        self.volume.add(body.volume, weight);
        self.diameter.add(body.diameter, weight);
        let shares = (0..3).map(|r| lengths[r] / window.voxels[r]);
        self.longest = shares.fold(self.longest, f64::max);
    }

    /// Why the weights mean nothing, if so; `which` names a row.
    fn reason(&self, manifest: &Manifest, which: Table, outside: u64) -> Option<String> {
        let one = which.singular();
        if let Some(region) = &manifest.region
            && region.outside(manifest.grid.dims) > 0
        {
            return Some(format!(
                "the region {} is no box: a conversion of a box inside of it (--crop) gives it",
                region.shape
            ));
        }
        if outside > 0 {
            return Some(
                "what counts as outside is in the grid, so the sample ends there: a conversion of a box inside of the \
                 sample (--crop) gives it"
                    .to_owned(),
            );
        }
        if self.window.is_none() {
            return Some(format!(
                "the axes of the grid are turned against those of the tables, so the box of a {one} does not tell how \
                 long it is along them"
            ));
        }
        if let Some((id, axis)) = self.through {
            return Some(format!(
                "{one} {id} reaches from one end of the grid to the other along {}: one as long as the grid is never \
                 whole in it; if it is none of those to be counted, --where leaves it out",
                ["x", "y", "z"][axis]
            ));
        }
        if let Some(id) = self.impossible {
            return Some(format!(
                "{one} {id} is as long as the grid and does not touch it"
            ));
        }
        (self.rows == 0).then(|| format!("no {one} is whole"))
    }

    /// The numbers of rows of `which` table; `outside` is how many cells were left out as air around the sample.
    pub fn finish(self, manifest: &Manifest, which: Table, outside: u64) -> Corrected {
        let reason = self.reason(manifest, which, outside);
        let applies = reason.is_none();
        let given = |v: f64| applies.then_some(v);
        Corrected {
            number_density: given(self.density),
            mean_volume: given(self.volume.mean()),
            correction: EdgeCorrection {
                method: "miles-lantuejoul",
                applies,
                reason,
                rows: self.rows,
                unit: self.unit,
                mean_volume_whole: (self.rows > 0).then(|| self.volume_whole.mean()),
                equivalent_diameter_mean: given(self.diameter.mean()),
                equivalent_diameter_sd: given(self.diameter.sd()),
                longest_share: given(self.longest),
            },
        }
    }
}

impl EdgeCorrection {
    /// What makes the numbers doubtful although they are given.
    pub(super) fn warning(&self, which: Table) -> Option<String> {
        let share = self.longest_share.filter(|&share| share > 0.5)?;
        Some(format!(
            "the longest whole {} takes {:.0} % of the grid along an axis: few places are left for it, so number density \
             and mean volume vary much from one such grid to the next",
            which.singular(),
            100.0 * share
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random numbers from 0 to 1: splitmix64.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut h = self.0;
            h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (h >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    const SIDE: u32 = 100;
    const LARGEST: f64 = 22.0;

    fn cube(v: f64) -> f64 {
        v * v * v
    }

    fn window() -> Window {
        Window::new([SIDE; 3], &Placement::default()).unwrap()
    }

    /// A ball as a table of a window has it; `None` if it has no voxel there.
    fn ball(id: u64, centre: [f64; 3], radius: f64) -> Option<Body> {
        let last = f64::from(SIDE) - 1.0;
        let low = centre.map(|c| (c - radius).ceil());
        let high = centre.map(|c| (c + radius).floor());
        let is_out = (0..3).any(|a| high[a] < 0.0 || low[a] > last);
        let at_border = (0..3).any(|a| low[a] <= 0.0 || high[a] >= last);
        (!is_out).then(|| Body {
            id,
            ends: [low.map(|v| v.max(0.0)), high.map(|v| v.min(last))],
            volume: cube(radius),
            diameter: 2.0 * radius,
            at_border,
        })
    }

    /// Windows in a sample of balls of all sizes: numbers by volume and means are those of the sample, where leaving out
    /// what is cut is wrong by tens of percent.
    #[test]
    fn windows_of_a_sample_give_its_density_and_its_mean() {
        let (windows, per_window) = (1500, 60);
        let reach = f64::from(SIDE) + 2.0 * (LARGEST + 1.0);
        let mut random = Random(7);
        let (mut sizes, mut diameters) = (Moments::default(), Moments::default());
        let mut found = [0.0; 3];
        let mut naive = [0.0; 2];
        for _ in 0..windows {
            let mut weights = Weights::new(Some(window()), String::new());
            for id in 0..per_window {
                let share = random.next();
                let radius = 4.0 + (LARGEST - 4.0) * share * share;
                let centre = [(); 3].map(|()| random.next() * reach - LARGEST - 1.0);
                sizes.add(cube(radius), 1.0);
                diameters.add(2.0 * radius, 1.0);
                if let Some(body) = ball(id, centre, radius) {
                    weights.add(&body);
                }
            }
            assert_eq!(weights.through, None);
            found[0] += weights.density;
            found[1] += weights.density * weights.volume.mean();
            found[2] += weights.density * weights.diameter.mean();
            naive[0] += weights.rows as f64;
            naive[1] += weights.rows as f64 * weights.volume_whole.mean();
        }
        let n = f64::from(windows);
        let density = per_window as f64 / cube(reach);
        let near = |found: f64, expected: f64| {
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        };
        near(found[0] / n, density);
        near(found[1] / found[0], sizes.mean());
        near(found[2] / found[0], diameters.mean());
        let whole = naive[0] / n / cube(f64::from(SIDE)) / density;
        let mean = naive[1] / naive[0] / sizes.mean();
        assert!(whole < 0.8 && mean < 0.85, "{whole} {mean}");
    }

    /// Over all places of a body that meet the grid, those at which it is whole count as one body in a voxel's volume.
    #[test]
    fn weights_are_one_over_all_places() {
        let mut weights = Weights::new(Some(window()), String::new());
        let (mut whole, radius) = (0, 6.0);
        for at in -8..i64::from(SIDE) + 8 {
            let body = ball(1, [at as f64, 50.0, 50.0], radius);
            let Some(body) = body else { continue };
            weights.add(&body);
            whole += u64::from(!body.at_border);
        }
        // 13 voxels long, 87 - 1 places along each axis
        assert_eq!(whole, 86);
        assert!((weights.density * 86.0 * 86.0 - 1.0).abs() < 1e-12);
        assert!((weights.longest - 0.13).abs() < 1e-12);
    }

    #[test]
    fn a_body_as_long_as_the_grid_is_told() {
        let mut weights = Weights::new(Some(window()), String::new());
        weights.add(&ball(1, [50.0; 3], 20.0).unwrap());
        weights.add(&ball(2, [50.0, 50.0, 10.0], 20.0).unwrap());
        assert_eq!(weights.through, None);
        weights.add(&ball(3, [50.0; 3], 80.0).unwrap());
        weights.add(&ball(4, [50.0; 3], 80.0).unwrap());
        assert_eq!(weights.through, Some((3, 0)));
    }

    #[test]
    fn axes_are_those_of_the_world() {
        let mut place = Placement {
            spacing: [0.5, 1.0, 2.0],
            ..Placement::default()
        };
        place.directions = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let window = Window::new([10, 20, 30], &place).unwrap();
        assert_eq!(window.voxels, [20.0, 30.0, 10.0]);
        assert_eq!(window.lengths([[0.0; 3], [3.0, 4.0, 1.0]]), [4.0, 3.0, 3.0]);
        let half = 0.5f64.sqrt();
        place.directions[0] = [half, half, 0.0];
        assert!(Window::new([10, 20, 30], &place).is_none());
    }
}
