//! Bodies of air whose number of cells is plain.

use super::*;

/// Air where the function of the place says so, in a box.
fn cells(dims: [usize; 3], ratio: u32, h_256: u32, air: impl Fn([f64; 3]) -> bool) -> u64 {
    let mut voxels = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                voxels.push(!air([x as f64, y as f64, z as f64]));
            }
        }
    }
    let solid = Solid { dims, voxels };
    let mut options = SplitOptions::new(solid.grid(16, 16));
    options.rule.ratio_permille = ratio;
    options.rule.h_256 = h_256;
    found(&solid, &options).component.len() as u64
}

/// Length of `p` from the point or, along a unit vector, from the line.
fn from(p: [f64; 3], centre: [f64; 3], along: Option<[f64; 3]>) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|a| p[a] - centre[a]);
    let square: f64 = d.iter().map(|v| v * v).sum();
    let part = along.map_or(0.0, |u| (0..3).map(|a| u[a] * d[a]).sum::<f64>());
    (square - part * part).max(0.0).sqrt()
}

#[test]
fn convex_bodies_are_one_cell() {
    for ratio in [700, 800, 900] {
        let one = |dims, air: &dyn Fn([f64; 3]) -> bool, what: &str| {
            assert_eq!(cells(dims, ratio, 128, air), 1, "{what}, ratio {ratio}");
        };
        one(
            [12; 3],
            &|p| from(p, [5.3, 5.6, 5.1], None) < 3.3,
            "small ball",
        );
        one(
            [46; 3],
            &|p| from(p, [22.4, 22.1, 22.7], None) < 20.0,
            "ball",
        );
        let ellipsoid = |centre: [f64; 3], axes: [f64; 3]| {
            move |p: [f64; 3]| {
                (0..3)
                    .map(|a| (p[a] - centre[a]) / axes[a])
                    .map(|v| v * v)
                    .sum::<f64>()
                    < 1.0
            }
        };
        one(
            [64, 34, 24],
            &ellipsoid([31.2, 16.4, 11.7], [30.0, 15.0, 10.0]),
            "flat ellipsoid",
        );
        one(
            [76, 20, 20],
            &ellipsoid([37.1, 9.6, 9.3], [36.0, 8.0, 8.0]),
            "long ellipsoid",
        );
        let inside = |p: [f64; 3], n: [f64; 3]| (0..3).all(|a| p[a] >= 1.0 && p[a] < n[a] - 1.0);
        one([40, 20, 14], &|p| inside(p, [40.0, 20.0, 14.0]), "box");
        let slab = |p: [f64; 3]| (0.6 * p[0] + 0.8 * p[2] - 24.0).abs() < 5.0;
        one(
            [40, 30, 30],
            &|p| slab(p) && inside(p, [40.0, 30.0, 30.0]),
            "slanting slab",
        );

        one([30, 20, 12], &|p| (2.0..9.0).contains(&p[2]), "open slab");
        one([20, 20, 20], &|_| true, "all air");
        one(
            [12, 12, 40],
            &|p| from(p, [5.2, 5.7, 0.0], Some([0.0, 0.0, 1.0])) < 4.0,
            "tube",
        );
    }
}

#[test]
fn a_bent_body_is_one_cell() {
    let arm = |p: [f64; 3]| (1.0..9.0).contains(&p[1]) && p[0] >= 1.0 && p[0] < 30.0;
    let other = |p: [f64; 3]| (1.0..9.0).contains(&p[0]) && p[1] >= 1.0 && p[1] < 30.0;
    let air = |p: [f64; 3]| (arm(p) || other(p)) && (1.0..9.0).contains(&p[2]);
    for ratio in [700, 800, 900] {
        assert_eq!(cells([32, 32, 10], ratio, 128, air), 1, "ratio {ratio}");
    }
}

#[test]
fn two_balls_with_a_tube_are_two_cells_and_one_neck() {
    let air = |p: [f64; 3]| {
        from(p, [11.2, 11.6, 11.4], None) < 9.0
            || from(p, [34.3, 11.1, 11.8], None) < 9.0
            || from(p, [0.0, 11.3, 11.5], Some([1.0, 0.0, 0.0])) < 3.0 && p[0] > 11.0 && p[0] < 34.0
    };
    for ratio in [500, 700, 800, 900] {
        assert_eq!(cells([46, 23, 23], ratio, 128, air), 2, "ratio {ratio}");
    }
    assert_eq!(cells([46, 23, 23], 300, 128, air), 1);
}

#[test]
fn slanting_tubes_and_slabs_are_one_cell_where_the_radius_may_fall_by_a_voxel() {
    let along = [0.8, 0.48, 0.36];
    for (radius, h_256) in [(6.0, 128), (2.5, 256)] {
        let air = |p: [f64; 3]| from(p, [30.0, 18.0, 15.0], Some(along)) < radius;
        for ratio in [600, 700] {
            assert_eq!(
                cells([60, 36, 30], ratio, h_256, air),
                1,
                "radius {radius}, {ratio}"
            );
        }
    }
    let slab = |p: [f64; 3]| (0.6 * p[0] + 0.8 * p[2] - 24.0).abs() < 5.0;
    assert_eq!(cells([40, 30, 30], 700, 256, slab), 1);
}

#[test]
fn volumes_without_air_or_of_one_voxel() {
    assert_eq!(cells([5, 4, 3], 800, 128, |_| false), 0);
    assert_eq!(cells([1, 1, 1], 800, 128, |_| false), 0);
    assert_eq!(cells([1, 1, 1], 800, 128, |_| true), 1);
}
