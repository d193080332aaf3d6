//! Foams with few walls: beside a filled field of view, on a holder, in a tube; slices that show nothing.

use super::foams::{NX, NY, Random, SAMPLE, Solid, assert_inside, within};
use super::*;

/// A foam of which about 88 % is pores: walls between the cells of a Voronoi tessellation, whose seeds lie in a grid, moved at
/// random.
fn sparse(slices: usize) -> Solid {
    /// The side of the grid of seeds, and how thick walls are.
    const PITCH: f64 = 16.0;
    const THICK: f64 = 0.6;
    let cells = [NX, NY, slices].map(|n| (n as f64 / PITCH) as usize + 3);
    let mut random = Random(1);
    let mut seed = |i: usize| {
        let at = [
            i % cells[0],
            i / cells[0] % cells[1],
            i / cells[0] / cells[1],
        ];
        at.map(|cell| (cell as f64 - 1.0 + random.next()) * PITCH)
    };
    let seeds: Vec<[f64; 3]> = (0..cells.iter().product()).map(&mut seed).collect();
    let share = |at: [f64; 3]| {
        let cell = at.map(|v| (v / PITCH) as usize);
        let near = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|d: usize| d));
        let ways = near.map(|d| {
            let [x, y, z] = [0, 1, 2].map(|a| (cell[a] + d[a]).min(cells[a] - 1));
            let seed = seeds[(z * cells[1] + y) * cells[0] + x];
            (0..3)
                .map(|a| (seed[a] - at[a]) * (seed[a] - at[a]))
                .sum::<f64>()
                .sqrt()
        });
        let mut ways: Vec<f64> = ways.collect();
        ways.sort_unstable_by(f64::total_cmp);
        (0.5 + (THICK - (ways[1] - ways[0])) / 2.0).clamp(0.0, 1.0)
    };
    Solid::any_pore(1, slices).with(|at, _| share(at))
}

/// The same with other samples where `of` says some.
fn changed(volume: &MemoryVolume<u16>, of: impl Fn([f64; 3]) -> Option<u16>) -> MemoryVolume<u16> {
    let header = volume.header();
    let [nx, ny, nz] = header.dims.0;
    let mut samples = vec![0u16; (nx * ny * nz) as usize];
    let out = bytemuck::cast_slice_mut(&mut samples);
    volume.read_box(0..nx, 0..ny, 0..nz, out).unwrap();
    let at = |i: usize| {
        let i = i as u32;
        [i % nx, i / nx % ny, i / nx / ny].map(f64::from)
    };
    let all = samples.iter_mut().enumerate();
    all.for_each(|(i, v)| *v = of(at(i)).unwrap_or(*v));
    MemoryVolume::new(header.dims, header.placement, samples).unwrap()
}

/// The air beside a sparse foam is far brighter than the fill, which is not the air.
#[test]
fn a_sparse_foam_in_a_filled_field_of_view_is_found() {
    let foam = sparse(24).inside(|_| SAMPLE);
    let share: f64 = foam.sum() / (24.0 * std::f64::consts::PI * SAMPLE[2] * SAMPLE[2]);
    assert!((0.08..0.15).contains(&share), "{share}");
    let scan = foam.scan();
    for fill in [None, Some(0), Some(500), Some(900), Some(9000)] {
        let volume = changed(&scan, |[x, y, _]| {
            fill.filter(|_| libm::hypot(x - 49.5, y - 47.5) > 47.0)
        });
        let found = find(&volume).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
        assert!(told(&found, "field of view").is_empty(), "{found:?}");
    }
}

/// A sample that fills the field of view is taken, and told to be all of it.
#[test]
fn what_ends_where_the_scan_does_is_told() {
    let view = [49.5, 47.5, 45.0];
    let volume = changed(&sparse(24).scan(), |[x, y, _]| {
        (within([x, y], view) < 0.5).then_some(0)
    });
    let found = find(&volume).unwrap();
    assert_inside(&found, view, 0.0);
    assert_eq!(told(&found, "field of view").len(), 1, "{found:?}");
}

/// A few bright slices at an end are not the sample where the others show it, however few its walls are.
#[test]
fn a_holder_of_a_sparse_foam_is_left_out() {
    let foam = sparse(40).inside(|_| SAMPLE);
    for (slices, radius) in [
        (0, 0.0),
        (2, 40.0),
        (4, 40.0),
        (8, 40.0),
        (8, 22.0),
        (12, 36.0),
    ] {
        let disc = [SAMPLE[0], SAMPLE[1], radius];
        let scan = foam.with(|[x, y, z], v| match z < f64::from(slices) {
            true => within([x, y], disc),
            false => v,
        });
        let found = find(&scan.scan()).unwrap();
        assert_inside(&found, SAMPLE, 0.0);
        assert_eq!(found.slices, slices..40, "{found:?}");
        let crop = format!("--crop :,:,{slices}:40");
        let n = told(&found, &crop).len();
        assert_eq!(n, usize::from(slices > 0), "{found:?}");
    }
}

/// Slices of one value do not spoil the cylinder; those between others are told as such, and none of the others is said to show
/// air.
#[test]
fn slices_of_one_value_are_told() {
    let scan = Solid::any_pore(3, 40).inside(|_| SAMPLE).scan();
    for value in [0, 1400, 60_000] {
        for (from, to, shown) in [
            (20, 21, 0..40),
            (10, 13, 0..40),
            (0, 1, 1..40),
            (37, 40, 0..37),
        ] {
            let volume = changed(&scan, |[_, _, z]| {
                (f64::from(from)..f64::from(to))
                    .contains(&z)
                    .then_some(value)
            });
            let found = find(&volume).unwrap();
            assert_inside(&found, SAMPLE, 0.0);
            assert_eq!(found.slices, shown, "{found:?}");
            assert_eq!(found.warnings.len(), 1, "{found:?}");
            assert_eq!(told(&found, "one value").len(), 1, "{found:?}");
        }
    }
    // a few slices of a scan that was filled up
    let volume = changed(&scan, |[_, _, z]| (!(24.0..33.0).contains(&z)).then_some(0));
    let found = find(&volume).unwrap();
    assert_inside(&found, SAMPLE, 0.0);
    assert_eq!(found.slices, 24..33);
}

/// A tube that is taken for the sample, for there is hardly any air between: the cylinder to give ends where the sample does.
#[test]
fn the_sample_is_told_in_a_tube_that_is_near() {
    let [x, y, radius] = SAMPLE;
    let (from, to) = ([x, y, radius + 2.0], [x, y, radius + 5.0]);
    for foam in [5, 6].map(|seed| Solid::any_pore(seed, 24)) {
        let scan = foam.with(|[x, y, _], v| {
            v * within([x, y], SAMPLE) + within([x, y], to) - within([x, y], from)
        });
        let found = find(&scan.scan()).unwrap();
        assert_eq!(found.warnings.len(), 1, "{found:?}");
        let inner = found.others.first().unwrap();
        let text = format!("give --roi {inner} for what is inside");
        assert_eq!(told(&found, &text).len(), 1, "{found:?}");
        assert!((inner.radius + 1.0 - radius).abs() < 1.1, "{found:?}");
    }
}

/// Of a lattice most slices show single struts alone, and few show many.
#[test]
fn a_holder_of_a_lattice_is_left_out() {
    let strut = |v: f64| v.rem_euclid(12.0) < 3.0;
    let lattice = Solid::any_pore(1, 40).with(|at, _| {
        let along = at.iter().filter(|v| strut(**v)).count();
        if along >= 2 { 1.0 } else { 0.0 }
    });
    let lattice = lattice.inside(|_| SAMPLE);
    for slices in [0, 2, 4] {
        let disc = [SAMPLE[0], SAMPLE[1], 40.0];
        let scan = lattice.with(|[x, y, z], v| match z < f64::from(slices) {
            true => within([x, y], disc),
            false => v,
        });
        let found = find(&scan.scan()).unwrap();
        let [x, y] = found.cylinder.centre;
        assert!(libm::hypot(x - SAMPLE[0], y - SAMPLE[1]) < 1.0, "{found:?}");
        let less = SAMPLE[2] - found.cylinder.radius;
        assert!((0.3..2.5).contains(&less), "{found:?}");
    }
}
