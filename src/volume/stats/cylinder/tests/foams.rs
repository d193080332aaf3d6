//! Random foams, in which pores open the rim of a sample in every slice.

use super::super::*;
use super::{find, told};
use crate::grid::{Dims, Placement};
use crate::progress::Quiet;
use crate::volume::MemoryVolume;

pub(super) const NX: usize = 100;
pub(super) const NY: usize = 96;
/// x, y and radius of the sample.
pub(super) const SAMPLE: [f64; 3] = [49.3, 46.8, 36.0];

/// Numbers from 0 to 1 (D. Knuth, The Art of Computer Programming 2, 3.3.4).
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = self.0.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// How much of each voxel is solid, 0 to 1.
pub(super) struct Solid {
    slices: usize,
    share: Vec<f32>,
}

impl Solid {
    /// A foam of which about half is pores, of a radius of 2 to 5 voxels; of all pores that may be there, those that `is`
    /// says, by their middle and radius.
    fn foam(seed: u64, slices: usize, is: impl Fn([f64; 3], f64) -> bool) -> Self {
        let mut random = Random(seed);
        let dims = [NX, NY, slices];
        let mut share = vec![1.0f32; NX * NY * slices];
        let beyond = 8.0;
        let room: f64 = dims.iter().map(|n| *n as f64 + 2.0 * beyond).product();
        for _ in 0..(room / 330.0) as usize {
            let at = dims.map(|n| random.next() * (n as f64 + 2.0 * beyond) - beyond);
            let radius = 2.0 + 3.0 * random.next();
            if !is(at, radius) {
                continue;
            }
            let near = |a: usize| {
                let [from, to] = [-1.0, 1.0].map(|by| at[a] + by * (radius + 1.0));
                from.max(0.0) as usize..(to.max(-1.0) + 1.0).min(dims[a] as f64) as usize
            };
            for z in near(2) {
                for y in near(1) {
                    for x in near(0) {
                        let [dx, dy, dz] = [x as f64 - at[0], y as f64 - at[1], z as f64 - at[2]];
                        let off = (dx * dx + dy * dy + dz * dz).sqrt() - radius;
                        let share = &mut share[x + NX * (y + NY * z)];
                        *share = share.min((off + 0.5).clamp(0.0, 1.0) as f32);
                    }
                }
            }
        }
        Solid { slices, share }
    }

    pub(super) fn any_pore(seed: u64, slices: usize) -> Self {
        Solid::foam(seed, slices, |_, _| true)
    }

    /// Voxels that are solid.
    pub(super) fn sum(&self) -> f64 {
        self.share.iter().map(|v| f64::from(*v)).sum()
    }

    /// What is left of it, of a share at a place, and what is there besides.
    pub(super) fn with(&self, of: impl Fn([f64; 3], f64) -> f64) -> Self {
        let place = |i: usize| [i % NX, i / NX % NY, i / NX / NY].map(|v| v as f64);
        let share = self.share.iter().enumerate();
        let share = share.map(|(i, v)| of(place(i), f64::from(*v)).clamp(0.0, 1.0) as f32);
        Solid {
            slices: self.slices,
            share: share.collect(),
        }
    }

    /// Only what is in a disc in each slice.
    pub(super) fn inside(&self, disc: impl Fn(f64) -> [f64; 3]) -> Self {
        self.with(|[x, y, z], v| v * within([x, y], disc(z)))
    }

    /// The means of `2 n + 1` voxels along each axis, three times, which is nearly a Gaussian filter.
    fn blurred(mut self, n: usize) -> Self {
        let lengths = [(1, NX), (NX, NY), (NX * NY, self.slices)];
        for (step, length) in lengths.into_iter().cycle().take(9) {
            let mean = |i: usize| {
                let at = i / step % length;
                let start = i - at * step;
                let near = (0..=2 * n).map(|j| (at + j).saturating_sub(n).min(length - 1));
                let sum: f32 = near.map(|at| self.share[start + at * step]).sum();
                sum / (2 * n + 1) as f32
            };
            self.share = (0..self.share.len()).map(mean).collect();
        }
        self
    }

    /// The scan of it, with noise.
    pub(super) fn scan(&self) -> MemoryVolume<u16> {
        let mut random = Random(99);
        let sample = |v: &f32| 1000.0 + 4000.0 * f64::from(*v) + 800.0 * random.next();
        let samples = self.share.iter().map(sample).map(|v| v as u16).collect();
        let dims = Dims([NX as u32, NY as u32, self.slices as u32]);
        MemoryVolume::new(dims, Placement::default(), samples).unwrap()
    }
}

/// The share of a voxel in a disc.
pub(super) fn within([x, y]: [f64; 2], [cx, cy, r]: [f64; 3]) -> f64 {
    (r + 0.5 - libm::hypot(x - cx, y - cy)).clamp(0.0, 1.0)
}

/// The cylinder ends about a voxel, and so much more, inside of the sample.
pub(super) fn assert_inside(found: &FoundCylinder, [cx, cy, r]: [f64; 3], more: f64) {
    let [x, y] = found.cylinder.centre;
    let aside = libm::hypot(x - cx, y - cy);
    let less = r - found.cylinder.radius - more;
    assert!(aside < 0.7 && (0.6..1.6).contains(&less), "{found:#?}");
}

#[test]
fn foams_are_found_and_nothing_is_said_of_them() {
    for (seed, slices) in [(1, 40), (2, 60)] {
        let foam = Solid::any_pore(seed, slices);
        let found = find(&foam.inside(|_| SAMPLE).scan()).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
        assert_eq!(found.warnings, [""; 0], "{seed}");
        assert_eq!((found.slices, found.tilt), (0..slices as u32, 0.0));
    }
    // a few slices of it
    let volume = Solid::any_pore(4, 40).inside(|_| SAMPLE).scan();
    for from in [0, 10, 25] {
        let found = find_cylinder(&volume, from..from + 14, &Quiet).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
    }
}

/// The slices vote by their number, and not by how much is bright in them.
#[test]
fn a_holder_in_few_slices_of_a_foam_is_no_sample() {
    let foam = Solid::any_pore(5, 40).inside(|_| SAMPLE);
    let discs = [[49.3, 46.8, 44.0], [49.3, 46.8, 400.0], [45.0, 50.0, 41.0]];
    for (disc, slices) in discs.into_iter().zip([3, 3, 10]) {
        let first = 40 - slices;
        let holder = foam.with(|[x, y, z], v| match z < f64::from(first) {
            true => v,
            false => within([x, y], disc),
        });
        let found = find(&holder.scan()).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
        assert_eq!(found.slices, 0..first);
        assert_eq!(found.warnings.len(), 1, "{found:#?}");
        let text = format!("slices {first} to 39 show something wider");
        assert!(found.warnings[0].contains(&text), "{found:#?}");
    }
    let low = foam.with(|[_, _, z], v| if z < 9.0 { 0.0 } else { v });
    let found = find(&low.scan()).unwrap();
    assert_inside(&found, SAMPLE, 0.0);
    assert_eq!(
        told(&found, "slices 0 to 8 show air").len(),
        1,
        "{found:#?}"
    );
}

#[test]
fn of_two_foams_none_is_taken() {
    for seed in [6, 7] {
        let foam = Solid::any_pore(seed, 40);
        for discs in [
            [[24.0, 30.0, 20.0], [72.0, 62.0, 20.0]],
            [[30.0, 34.0, 25.0], [80.0, 74.0, 14.0]],
        ] {
            let two = foam.with(|[x, y, _], v| {
                v * discs.iter().map(|disc| within([x, y], *disc)).sum::<f64>()
            });
            let message = find(&two.scan()).unwrap_err().to_string();
            assert!(message.contains("two of them, cylinder:"), "{message}");
        }
    }
}

/// A body that is not round is told, and so is one that is elsewhere in other slices.
#[test]
fn other_bodies_are_told() {
    let foam = Solid::any_pore(8, 40);
    let disc = [32.0, 34.0, 26.0];
    let bar = foam.with(|[x, y, _], v| {
        let is_bar = (70.0..90.0).contains(&x) && (20.0..80.0).contains(&y);
        v * (within([x, y], disc) + f64::from(u8::from(is_bar)))
    });
    let found = find(&bar.scan()).unwrap();
    assert_inside(&found, disc, 0.0);
    let text = "something of a size like it that is not round, about x 8";
    assert_eq!(told(&found, text).len(), 1, "{found:#?}");
    let moved = foam.inside(|z| if z < 23.0 { disc } else { [70.0, 62.0, 26.0] });
    let found = find(&moved.scan()).unwrap();
    assert_inside(&found, disc, 0.0);
    let text = "slices 23 to 39 show air there and something else";
    assert_eq!(told(&found, text).len(), 1, "{found:#?}");
}

#[test]
fn a_foam_in_a_tube_is_found_in_all_slices() {
    for seed in [10, 11] {
        let tube = Solid::any_pore(seed, 50).with(|[x, y, _], v| {
            let disc = |r: f64| within([x, y], [48.0, 47.0, r]);
            v * disc(30.0) + disc(43.0) - disc(38.0)
        });
        let found = find(&tube.scan()).unwrap();
        assert_inside(&found, [48.0, 47.0, 30.0], 0.0);
        assert_eq!(found.slices, 0..50);
        assert_eq!(found.warnings.len(), 1, "{found:#?}");
        assert_eq!(told(&found, "a tube around it").len(), 1, "{found:#?}");
    }
}

/// A tilted or tapered foam is not refused: the cylinder lies in it in all slices, and that is told.
#[test]
fn tilt_and_taper_of_a_foam_are_told() {
    let [cx, cy, r] = SAMPLE;
    for seed in [14, 15] {
        let foam = Solid::any_pore(seed, 60);
        let tilted = foam.inside(|z| [cx + 0.07 * (z - 29.5), cy, r]);
        let found = find(&tilted.scan()).unwrap();
        assert!((found.tilt - 4.0).abs() < 0.6, "{found:#?}");
        assert_inside(&found, SAMPLE, 2.1);
        assert_eq!(found.warnings.len(), 1, "{found:#?}");
        let cone = foam.inside(|z| [cx, cy, r - 5.0 * z / 59.0]);
        let found = find(&cone.scan()).unwrap();
        assert_inside(&found, [cx, cy, r - 5.0], 0.0);
        assert_eq!(found.warnings.len(), 1, "{found:#?}");
        assert_eq!(told(&found, "is tapered").len(), 1, "{found:#?}");
    }
}

#[test]
fn a_flat_side_of_a_foam_is_told() {
    let [cx, _, r] = SAMPLE;
    let foam = Solid::any_pore(17, 60).inside(|_| SAMPLE);
    for off in [4.0, 9.0] {
        let flat = foam.with(|[x, _, _], v| v * (cx + r - off + 0.5 - x).clamp(0.0, 1.0));
        let found = find(&flat.scan()).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
        let warnings = told(&found, "empty at the side of x 84, y 4");
        assert_eq!(warnings.len(), 1, "{found:#?}");
        let inside = warnings[0].split("--roi cylinder:").nth(1).unwrap();
        let inside = inside.split([',', ' ']).nth(2).unwrap();
        let inside: f64 = inside.parse().unwrap();
        assert!(
            (r - off - 4.0..r - off + 0.5).contains(&inside),
            "{off}: {found:#?}"
        );
    }
}

/// Pores that get rarer towards the rim are of one body, also if it is blurred, where the rim is not found further outside.
#[test]
fn a_skin_is_no_other_body_and_a_blur_does_not_widen_it() {
    let [cx, cy, r] = SAMPLE;
    let is_in = |at: [f64; 3], radius: f64| libm::hypot(at[0] - cx, at[1] - cy) + radius < r - 1.0;
    for blur in [0, 1, 2] {
        let foam = Solid::foam(18, 60, is_in).inside(|_| SAMPLE);
        let scan = foam.blurred(blur).scan();
        let found = find(&scan).unwrap();
        assert!(
            (r - 4.0..r - 0.6).contains(&found.cylinder.radius),
            "{blur}: {found:#?}"
        );
        assert_eq!(found.warnings, [""; 0], "{blur}");
    }
}
