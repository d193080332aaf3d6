//! Strips decode to exactly the triangles they were made from.

use super::*;
use proptest::prelude::*;
use std::collections::HashMap;

/// A piece as [`Stripifier::stripify`] wants it, by a table of directed edges; an edge that is not there
/// exactly once each way has no mate.
fn connected(triangles: &[[u32; 3]]) -> Vec<Triangle> {
    let mut edges: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for (t, v) in triangles.iter().enumerate() {
        for e in 0..3 {
            let edge = (v[e], v[(e + 1) % 3]);
            let half_edge = STRIDE * (t as u32 + 1) + e as u32;
            edges.entry(edge).or_default().push(half_edge);
        }
    }
    let single = |a, b| edges.get(&(a, b)).filter(|found| found.len() == 1);
    let mate = |a, b| match (single(a, b), single(b, a)) {
        (Some(_), Some(there)) => there[0],
        _ => NONE,
    };
    piece(triangles.iter().map(|&[a, b, c]| {
        let mates = [mate(a, b), mate(b, c), mate(c, a)];
        Triangle::new([a, b, c], mates)
    }))
}

/// Triangles behind the first, which may be anything.
fn piece(triangles: impl IntoIterator<Item = Triangle>) -> Vec<Triangle> {
    let none = [u32::MAX; 3];
    let none = Triangle::new(none, none);
    [none].into_iter().chain(triangles).collect()
}

/// Makes a strip with new scratch.
fn strip_of(stripifier: &mut Stripifier, triangles: &[[u32; 3]], out: &mut Vec<u32>) -> usize {
    stripifier.stripify(&mut connected(triangles), out)
}

fn sorted(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut all: Vec<_> = triangles.iter().map(|&t| rotated(t)).collect();
    all.sort_unstable();
    all
}

/// Makes the strip and proves it: same triangles, same orientation, no repeat, few entries.
fn proven(triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut out = Vec::new();
    let strips = strip_of(&mut Stripifier::default(), triangles, &mut out);
    assert_eq!(sorted(&unstrip(&out)), sorted(triangles));
    assert!(strips <= triangles.len());
    assert_eq!(strips == 0, triangles.is_empty());
    assert!(out.len() <= 5 * triangles.len());
    out
}

/// A w by h grid of squares in two triangles each; wraps to a torus if asked.
fn grid(w: u32, h: u32, torus: bool) -> Vec<[u32; 3]> {
    let (cols, rows) = if torus { (w, h) } else { (w + 1, h + 1) };
    let at = |x: u32, y: u32| (y % rows) * cols + x % cols;
    (0..h)
        .flat_map(|y| (0..w).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            if (x + y) % 3 == 0 {
                [[a, b, c], [b, d, c]]
            } else {
                [[a, b, d], [a, d, c]]
            }
        })
        .collect()
}

/// An octahedron, each triangle cut in four `levels` times.
fn sphere(levels: u32) -> Vec<[u32; 3]> {
    let mut triangles = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    let mut next = 6;
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    next += 1;
                    next - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    triangles
}

/// The faces of the voxels of a 6 x 6 x 6 volume whose bits are set, two triangles a face. Voxels
/// that touch along an edge only share non-manifold edges, which stay open.
fn blocks(solid: &[bool]) -> Vec<[u32; 3]> {
    let inside = |p: [i32; 3]| {
        p.iter().all(|c| (0..6).contains(c)) && solid[((p[2] * 6 + p[1]) * 6 + p[0]) as usize]
    };
    let vertex = |p: [i32; 3]| ((p[2] * 7 + p[1]) * 7 + p[0]) as u32;
    let mut triangles = Vec::new();
    for i in 0..216 {
        let p = [i % 6, i / 6 % 6, i / 36];
        for (axis, side) in (0..6).map(|f| (f / 2, (f % 2) as i32)) {
            let mut other = p;
            other[axis] += 2 * side - 1;
            if !inside(p) || inside(other) {
                continue;
            }
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let corner = |du: i32, dv: i32| {
                let mut q = p;
                q[axis] += side;
                q[u] += du;
                q[v] += dv;
                vertex(q)
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            let faces = [[a, b, c], [a, c, d]];
            triangles.extend(faces.map(|[a, b, c]| if side == 1 { [a, b, c] } else { [a, c, b] }));
        }
    }
    triangles
}

#[test]
fn small_pieces_take_the_fewest_entries() {
    assert_eq!(proven(&[]), [0u32; 0]);
    assert_eq!(proven(&[[7, 3, 5]]).len(), 3);
    assert_eq!(proven(&[[0, 1, 2], [2, 1, 3]]).len(), 4);
    // two apart: four repeats; two that share a vertex only may need two
    assert_eq!(proven(&[[0, 1, 2], [3, 4, 5]]).len(), 8);
    assert!(proven(&[[0, 1, 2], [0, 3, 4]]).len() <= 8);
    // one row of squares is one strip with one swap at most
    let row: Vec<_> = (0..9)
        .flat_map(|i| {
            [
                [2 * i, 2 * i + 2, 2 * i + 1],
                [2 * i + 1, 2 * i + 2, 2 * i + 3],
            ]
        })
        .collect();
    assert!(proven(&row).len() <= 21);
}

#[test]
fn closed_surfaces() {
    proven(&sphere(0));
    let ball = proven(&sphere(5));
    assert!(ball.len() * 100 < 8 * 1024 * 130, "{}", ball.len());
    proven(&grid(3, 3, true));
    let torus = proven(&grid(40, 30, true));
    assert!(torus.len() * 100 < 2 * 40 * 30 * 140, "{}", torus.len());
}

#[test]
fn rings_are_cut_open_once() {
    for n in 3..40 {
        let ring: Vec<_> = (0..n)
            .flat_map(|i| {
                let [a, b] = [2 * i, 2 * ((i + 1) % n)];
                [[a, b, a + 1], [a + 1, b, b + 1]]
            })
            .collect();
        assert!(proven(&ring).len() <= ring.len() + 3, "{n}");
        let wheel: Vec<_> = (0..n).map(|i| [n, i, (i + 1) % n]).collect();
        proven(&wheel);
    }
}

/// Walks all paths of a mesh by its mates, step by step; returns their number and how often they turn
/// to the same side twice.
fn walked(piece: &[Triangle]) -> (usize, usize) {
    let (mut greedy, mut repeated) = (greedy::Greedy::default(), piece.to_vec());
    let mut found = greedy.paths(&mut repeated);
    let mut taken = vec![false; piece.len()];
    let mut take = |h: u32| {
        let t = triangle::triangle(h) as usize;
        let edge = h - triangle::half_edge(t as u32);
        assert!(t > 0 && edge < 3 && !std::mem::replace(&mut taken[t], true));
    };
    let numbers: &[u32] = bytemuck::cast_slice(piece);
    let mate = |h: u32| numbers[h as usize];
    let (mut paths, mut swaps) = (0, 0);
    while let Some(path) = found.next() {
        paths += 1;
        take(path.exit);
        let Some(end) = path.end else {
            assert_eq!(path.steps().count(), 0);
            continue;
        };
        let mut entry = mate(path.exit);
        for (apex, left) in path.steps() {
            take(entry);
            let [t, e] = [entry / STRIDE, entry % STRIDE].map(|n| n as usize);
            assert_eq!(apex, piece[t].corners()[(e + 2) % 3]);
            let step = if left { 1 } else { 2 };
            entry = mate(triangle::half_edge(t as u32) + (e as u32 + step) % 3);
        }
        take(entry);
        assert_eq!(entry, end);
        let turns: Vec<bool> = path.steps().map(|(_, left)| left).collect();
        assert_eq!(turns.len(), path.turns());
        swaps += turns.windows(2).filter(|two| two[0] == two[1]).count();
    }
    assert!(taken[1..].iter().all(|&t| t), "a triangle is in no path");
    (paths, swaps)
}

/// Every path leads over neighbours, every triangle is in one, and all strips but one at most stand where
/// their first turn needs no swap.
fn entries_are_those_of_the_paths(triangles: &[[u32; 3]]) {
    let mut piece = connected(triangles);
    let (paths, swaps) = walked(&piece);
    let mut out = Vec::new();
    let strips = Stripifier::default().stripify(&mut piece, &mut out);
    assert_eq!(strips, paths);
    let fewest = (triangles.len() + 4 * strips + swaps).saturating_sub(2);
    assert!(
        [0, 1].contains(&(out.len() - fewest)),
        "{} for {fewest}",
        out.len()
    );
}

#[test]
fn strips_follow_paths_over_neighbours() {
    entries_are_those_of_the_paths(&[]);
    entries_are_those_of_the_paths(&[[0, 1, 2], [3, 4, 5]]);
    entries_are_those_of_the_paths(&sphere(4));
    let mut holes = grid(30, 30, true);
    holes.retain(|t| (t[0] * 7 + t[1] * 13 + t[2] * 31) % 11 != 0);
    entries_are_those_of_the_paths(&holes);
}

#[test]
fn a_path_goes_on_from_its_start_to_the_other_side() {
    // two rings and a bridge, on whose middle is the first triangle: none has fewer than two neighbours
    let bridge = [(6, 4), (4, 2), (2, 1), (1, 3), (3, 5), (5, 10)];
    let rings = [
        (6, 7),
        (7, 8),
        (8, 9),
        (9, 6),
        (10, 11),
        (11, 12),
        (12, 13),
        (13, 10),
    ];
    let mut all = vec![Triangle::default(); 14];
    let mut edges = [0usize; 14];
    for (a, b) in bridge.into_iter().chain(rings) {
        let edges = [a, b].map(|t: usize| {
            edges[t] += 1;
            (t, edges[t] - 1)
        });
        for ((t, e), (u, f)) in [(edges[0], edges[1]), (edges[1], edges[0])] {
            all[t].mates[e] = STRIDE * u as u32 + f as u32;
        }
    }
    for (t, triangle) in all.iter_mut().enumerate() {
        let first = 3 * t as u32;
        *triangle = Triangle::new([first, first + 1, first + 2], triangle.mates);
    }
    assert_eq!(walked(&all).0, 1);
}

#[test]
fn a_vertex_with_very_many_triangles() {
    let wheel: Vec<_> = (1..5000).map(|i| [0, i, i + 1]).collect();
    proven(&wheel);
    let every_other: Vec<_> = wheel.iter().copied().step_by(2).collect();
    proven(&every_other);
}

#[test]
fn the_strip_is_appended_whole_and_scratch_leaves_no_trace() {
    let mut stripifier = Stripifier::default();
    let big = grid(20, 20, false);
    for before in [vec![], vec![9], vec![9, 9]] {
        let mut out = before.clone();
        strip_of(&mut stripifier, &big, &mut out);
        assert_eq!(out[..before.len()], before);
        assert_eq!(out[before.len()..], proven(&big));
        let mut small = Vec::new();
        strip_of(&mut stripifier, &big[..3], &mut small);
        assert_eq!(small, proven(&big[..3]));
    }
}

#[test]
fn mates_must_be_half_edges() {
    let strip = |[a, b]: [[u32; 3]; 2]| {
        let mut out = Vec::new();
        let both = [([0, 1, 2], a), ([2, 1, 3], b)];
        let both = both.map(|(corners, mates)| Triangle::new(corners, mates));
        Stripifier::default().stripify(&mut piece(both), &mut out);
        out
    };
    assert_eq!(strip([[0, 16, 0], [9, 0, 0]]).len(), 4);
    for wrong in [24, 11, 15, 7, u32::MAX, u32::MAX - 7] {
        for edge in 0..3 {
            let mut mates = [[0; 3]; 2];
            mates[1][edge] = wrong;
            let caught = std::panic::catch_unwind(|| strip(mates));
            let told = *caught.unwrap_err().downcast::<&str>().unwrap();
            assert_eq!(told, "mates are half-edges of the piece", "{wrong}");
        }
    }
}

/// Whatever mates are, if they are half-edges, nothing beyond the piece is touched: tests compare all
/// indices.
fn strip_of_wrong_mates(picks: &[[u16; 3]]) {
    let triangles = picks.len() as u32;
    let mate = |pick: u16| {
        let pick = u32::from(pick);
        STRIDE * (1 + pick / 3 % triangles) + pick % 3
    };
    let wrong = picks.iter().zip(0..);
    let wrong = piece(wrong.map(|(p, t)| Triangle::new([t, t + 1, t + 2], p.map(mate))));
    // it may panic, or end with some strip
    let strip = || Stripifier::default().stripify(&mut wrong.clone(), &mut Vec::new());
    let caught = std::panic::catch_unwind(strip);
    let told = caught.err().and_then(|told| told.downcast::<String>().ok());
    assert!(told.is_none_or(|told| told.starts_with("index out of bounds")));
}

#[test]
fn unstrip_knows_parity_and_degenerates() {
    assert!(unstrip(&[]).is_empty());
    assert!(unstrip(&[1, 2]).is_empty());
    assert_eq!(unstrip(&[0, 1, 2, 3]), [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(unstrip(&[2, 0, 1, 1, 5, 5, 6, 7]), [[0, 1, 2], [5, 7, 6]]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn parts_of_grids(w in 1u32..14, h in 1u32..14, torus: bool, keep in 0.0..1.0f64, seed: u64) {
        let (w, h) = if torus { (w + 2, h + 2) } else { (w, h) };
        let mut state = seed | 1;
        let mut part = grid(w, h, torus);
        part.retain(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64 <= keep
        });
        proven(&part);
        entries_are_those_of_the_paths(&part);
    }

    #[test]
    fn shuffled_spheres(levels in 0u32..4, order in any::<[u8; 8]>()) {
        let mut ball = sphere(levels);
        let n = ball.len();
        for (i, &k) in order.iter().enumerate() {
            ball.rotate_left(usize::from(k) % n);
            ball.swap(i, n - 1 - i);
            ball[i].rotate_left(usize::from(k) % 3);
        }
        proven(&ball);
    }

    #[test]
    fn voxel_blocks(solid in prop::collection::vec(prop::bool::weighted(0.4), 216)) {
        let triangles = blocks(&solid);
        proven(&triangles);
        entries_are_those_of_the_paths(&triangles);
    }

    #[test]
    fn a_piece_has_the_same_strips_whatever_came_before(
        parts in prop::collection::vec((1u32..9, 1u32..9, any::<bool>(), 0.3..1.0f64), 0..9),
    ) {
        let mut stripifier = Stripifier::default();
        for (w, h, torus, keep) in parts {
            let (w, h) = if torus { (w + 2, h + 2) } else { (w, h) };
            let mut part = grid(w, h, torus);
            part.retain(|t| f64::from((t[0] * 7 + t[1] * 13 + t[2] * 31) % 101) <= 101.0 * keep);
            let mut out = Vec::new();
            strip_of(&mut stripifier, &part, &mut out);
            prop_assert_eq!(out, proven(&part));
        }
    }

    #[test]
    fn mates_that_are_not_mutual_do_no_harm(
        picks in prop::collection::vec(any::<[u16; 3]>(), 1..60),
    ) {
        strip_of_wrong_mates(&picks);
    }

    #[test]
    fn appended_strips_keep_their_triangles(
        parts in prop::collection::vec((1u32..5, 1u32..4, 0u32..30), 0..6),
    ) {
        let (mut whole, mut wanted) = (Vec::new(), Vec::new());
        for (w, h, offset) in parts {
            let triangles = grid(w, h, false);
            let before = whole.len();
            append_strip(&mut whole, &proven(&triangles), offset);
            prop_assert!(whole.len() <= before + 3 + proven(&triangles).len());
            wanted.extend(triangles.iter().map(|t| t.map(|v| v + offset)));
        }
        prop_assert_eq!(sorted(&unstrip(&whole)), sorted(&wanted));
    }
}
