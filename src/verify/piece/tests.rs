//! Batches against the code that takes positions and triangles one by one.

use super::*;
use crate::verify::places::bounds;
use proptest::prelude::*;

const REGION: Region = Region {
    lo: [0, 2 * 256, 4 * 256],
    hi: [4 * 256, 4 * 256, 6 * 256],
    end: [4 * 256, 9 * 256, 6 * 256],
};

/// A position, mostly sound: a voxel, an axis, how far along it, and what to spoil.
fn position() -> impl Strategy<Value = [f32; 3]> {
    let spoil = prop_oneof![60 => Just(0), 1 => 1..8];
    ([0..5i32, 2..5, 4..7], 0..3usize, 1..256i32, spoil).prop_map(|(voxel, axis, along, spoil)| {
        let mut p = voxel.map(|c| c as f32);
        p[axis] = (p[axis] - 1.0).max(REGION.lo[axis] as f32 / 256.0) + along as f32 / 256.0;
        match spoil {
            1 => p[axis] = f32::NAN,
            2 => p[axis] = f32::INFINITY,
            3 => p[axis] += 1.0 / 512.0,
            4 => p[axis] = p[axis].round(),
            5 => p[(axis + 1) % 3] += 0.5,
            6 => p[0] -= 7.0,
            7 => p[2] = 1e30,
            _ => {}
        }
        p
    })
}

fn findings(tallies: &[Tally]) -> Vec<(u64, [i32; 3])> {
    tallies.iter().map(|t| (t.count, t.first)).collect()
}

fn piece(positions: &[[f32; 3]]) -> Piece {
    Piece {
        positions: positions.to_vec(),
        ..Piece::default()
    }
}

/// Points in a few cubes, with the axes of their lattice edges.
fn points() -> impl Strategy<Value = Vec<([i32; 3], u8)>> {
    let coordinate = || prop_oneof![9 => 0..257i32, 1 => 0..1000];
    let point = prop::array::uniform3(coordinate());
    prop::collection::vec((point, 0..3u8), 3..40)
}

fn vertex(&(p, axis): &([i32; 3], u8)) -> Vertex {
    let along = std::array::from_fn(|a| i32::from(a == usize::from(axis)));
    [p[0], p[1], p[2], code(p.map(|c| c >> 8), along)]
}

/// Takes triangles in batches, and one by one.
fn sum_both_ways(
    points: &[([i32; 3], u8)],
    triangles: &[[u32; 3]],
) -> [(Piece, Edges, Sums, [Tally; 2]); 2] {
    let scale = [0.3, 1.0, 1.7];
    [true, false].map(|batched| {
        let mut piece = Piece {
            points: points.iter().map(vertex).collect(),
            state: points.iter().map(|p| p.1).collect(),
            triangles: triangles.to_vec(),
            ..Piece::default()
        };
        let (mut sums, mut bad) = (Sums::default(), Default::default());
        let mut edges = Edges::default();
        edges.begin(points.len());
        if batched {
            dispatch!(piece.sum_batches(scale, &REGION, &mut edges, &mut sums, &mut bad));
        } else {
            for &t in triangles {
                piece.sum_triangle(t, scale, &mut edges, &mut sums, &mut bad);
            }
        }
        edges.balance(&mut piece.state);
        (piece, edges, sums, bad)
    })
}

proptest! {
    #[test]
    fn positions_are_located_as_one_by_one(
        positions in prop::collection::vec(position(), 0..80),
        cap in any::<bool>(),
    ) {
        let (mut fast, mut slow) = (piece(&positions), piece(&positions));
        (fast.cap, slow.cap) = (cap, cap);
        let (mut found, mut expected) = Default::default();
        let owned = dispatch!(fast.locate_batches(&REGION, &mut found));
        prop_assert_eq!(owned, slow.locate_each(&positions, &REGION, &mut expected));
        prop_assert_eq!(findings(&found), findings(&expected));
        prop_assert_eq!(&fast.points, &slow.points);
        prop_assert_eq!(fast.state, slow.state);

        let box_of = |fold: fn(i32, i32) -> i32, first| {
            std::array::from_fn(|a| slow.points.iter().map(|p| p[a]).fold(first, fold))
        };
        let slow = [box_of(i32::min, i32::MAX), box_of(i32::max, i32::MIN)];
        prop_assert_eq!(bounds(&fast.points), slow);
    }

    #[test]
    fn triangles_are_summed_as_one_by_one(
        points in points(),
        picks in prop::collection::vec([any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<prop::sample::Index>()], 0..100),
        offset in 0..60_000i32,
        sound in any::<bool>(),
    ) {
        let moved = |p: [i32; 3]| p.map(|c| offset * 256 + if sound { c.min(256) } else { c });
        let points: Vec<_> = points.into_iter().map(|(p, axis)| (moved(p), axis)).collect();
        let mut triangles: Vec<_> = picks.iter().map(|t| t.map(|i| i.index(points.len()) as u32)).collect();
        if sound {
            let has_area = |&t: &[u32; 3]| {
                let [p, q, r] = t.map(|i| points[i as usize].0.map(f64::from));
                (0..3).any(|a| {
                    let b = (a + 1) % 3;
                    (q[a] - p[a]) * (r[b] - p[b]) != (q[b] - p[b]) * (r[a] - p[a])
                })
            };
            triangles.retain(has_area);
        }
        let [(fast, edges, sums, found), (slow, slow_edges, expected, flaws)] = sum_both_ways(&points, &triangles);
        prop_assert_eq!(sums.area.to_bits(), expected.area.to_bits());
        prop_assert_eq!(sums.volume6, expected.volume6);
        prop_assert_eq!(findings(&found), findings(&flaws));
        prop_assert_eq!(edges.entered(), slow_edges.entered());
        prop_assert_eq!(&fast.state, &slow.state);
        let both = |s: &u8| s & (UP | DOWN) == UP | DOWN;
        prop_assert_eq!(fast.contradicts(), slow.state.iter().any(both));
    }
}
