//! `alvis::view`: tiles in a view, against points tested one by one; order, phases and budget.

mod common;
#[path = "../examples/feed_viewer.rs"]
mod feed_viewer;

use alvis::convert::ConvertOptions;
use alvis::grid::{Dims, Placement, Unit};
use alvis::manifest::TileEntry;
use alvis::tileset::TileSet;
use alvis::view::{Depth, TileIndex, View};
use alvis::volume::MemoryVolume;
use common::volumes::foam;
use glam::dcamera::rh::proj::{directx, opengl};
use glam::dcamera::rh::view::{look_at_mat4, look_to_mat4};
use glam::{DMat4, DVec3};
use proptest::prelude::*;
use std::sync::LazyLock;

/// The index of a set that has been read; its files are gone, since nothing removes what a static keeps.
static SET: LazyLock<(TileSet, TileIndex)> = LazyLock::new(|| {
    let dir = made();
    let set = TileSet::open(dir.path()).unwrap();
    let index = TileIndex::read(&set).unwrap();
    (set, index)
});

/// A foam in millimetres, turned and mirrored, in 216 tiles.
fn made() -> tempfile::TempDir {
    let dims = [37, 37, 37];
    let placement = Placement {
        spacing: [0.5, 0.75, 1.25],
        unit: Unit::Millimetre,
        origin: [-3.0, 10.5, 0.25],
        directions: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    };
    let volume = MemoryVolume::new(Dims(dims), placement, foam(dims, 1)).unwrap();
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [6; 3],
        ..ConvertOptions::default()
    };
    common::converted(&volume, &options).0
}

/// Voxel coordinates to the space of loaded tiles.
fn place() -> DMat4 {
    DMat4::from_cols_array(&SET.0.manifest().transform)
}

/// A camera at a place in voxel coordinates, looking at another.
fn camera(from: [f64; 3], to: [f64; 3], angle: f64, depth: Depth) -> (DMat4, View) {
    let [from, to] = [from, to].map(|p| place().transform_point3(p.into()));
    let camera = look_at_mat4(from, to, DVec3::new(0.1, 1.0, 0.2).normalize());
    let (near, far) = (1e-4, 0.05);
    let lens = match depth {
        Depth::ZeroToOne => directx::perspective(angle, 1.5, near, far),
        Depth::MinusOneToOne => opengl::perspective(angle, 1.5, near, far),
    };
    let all = lens * camera;
    (all, View::new(all, depth, SET.0.manifest()))
}

/// True if a voxel position is drawn, by the definition of clip space.
fn drawn(all: DMat4, depth: Depth, p: [f64; 3]) -> bool {
    let clip = all * place().transform_point3(p.into()).extend(1.0);
    let low = match depth {
        Depth::ZeroToOne => 0.0,
        Depth::MinusOneToOne => -clip.w,
    };
    clip.x.abs() <= clip.w && clip.y.abs() <= clip.w && (low..=clip.w).contains(&clip.z)
}

/// Points of a box.
fn points(entry: &TileEntry) -> impl Iterator<Item = [f64; 3]> {
    let (low, high) = (entry.bounds.min, entry.bounds.max);
    (0..125).map(move |i| {
        let share = [i % 5, i / 5 % 5, i / 25].map(|s| f64::from(s) / 4.0);
        std::array::from_fn(|a| low[a] + share[a] * (high[a] - low[a]))
    })
}

fn paths<'a>(tiles: impl Iterator<Item = &'a TileEntry>) -> Vec<&'a str> {
    tiles.map(|t| t.path.as_str()).collect()
}

fn place_in(range: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-range..36.0 + range)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every tile with a point in the view is picked, and hardly another one; the eye is where the camera
    /// is; tiles come nearest first.
    #[test]
    fn tiles_are_those_of_points_in_the_view(
        from in place_in(30.0),
        to in place_in(0.0),
        angle in 0.2..2.0f64,
        gl: bool,
    ) {
        let depth = if gl { Depth::MinusOneToOne } else { Depth::ZeroToOne };
        prop_assume!((0..3).map(|a| (from[a] - to[a]).abs()).sum::<f64>() > 1.0);
        let (all, view) = camera(from, to, angle, depth);
        let eye = view.eye().unwrap();
        prop_assert!((0..3).all(|a| (eye[a] - from[a]).abs() < 1e-4), "{:?} {:?}", eye, from);
        let index = &SET.1;
        let picked: Vec<&TileEntry> = index.completion(&view, 1, u64::MAX).collect();
        let found = paths(picked.iter().copied());
        let (mut must, mut may) = (0, 0);
        for entry in index.tiles() {
            let seen = points(entry).filter(|&p| drawn(all, depth, p)).count();
            prop_assert_eq!(seen > 0, points(entry).any(|p| view.contains(p)), "{}", &entry.path);
            if found.contains(&entry.path.as_str()) {
                may += usize::from(seen == 0);
            } else {
                prop_assert_eq!(seen, 0, "{} is missing", &entry.path);
            }
            must += usize::from(seen > 0);
        }
        prop_assert_eq!(found.len(), must + may);
        // boxes at the rim of the view, and boxes that the view passes between the points tested
        prop_assert!(may <= 24 + must, "{} beside {}", may, must);
        let near = |t: &TileEntry| -> f64 {
            let eye = place().transform_point3(from.into());
            let point = |p| place().transform_point3(DVec3::from(p)).distance(eye);
            points(t).map(point).fold(f64::INFINITY, f64::min)
        };
        // among tiles of one phase, none comes after one that is clearly farther away
        let around = index.interactive(&view, 1, u64::MAX).count();
        for phase in [&picked[..around], &picked[around..]] {
            let mut farthest = 0.0f64;
            for t in phase {
                let box_size = 6.0 * 0.00125;
                prop_assert!(near(t) + box_size >= farthest, "{}", &t.path);
                farthest = farthest.max(view.distance(&t.bounds));
                prop_assert!(view.distance(&t.bounds) <= near(t) + 1e-9);
            }
        }
    }

    /// The first phase is what lies around the viewing point, and the second begins with it; a budget cuts
    /// both short and is never passed.
    #[test]
    fn phases_and_budgets(from in place_in(4.0), to in place_in(0.0), reach in 0u32..4, share in 0.0..1.2f64) {
        prop_assume!((0..3).map(|a| (from[a] - to[a]).abs()).sum::<f64>() > 1.0);
        let (_, view) = camera(from, to, 1.2, Depth::ZeroToOne);
        let index = &SET.1;
        let around = paths(index.interactive(&view, reach, u64::MAX));
        let all: Vec<&TileEntry> = index.completion(&view, reach, u64::MAX).collect();
        prop_assert!(paths(all.iter().copied()).starts_with(&around));
        for (i, t) in all.iter().enumerate() {
            let off = |a: usize| ((from[a] / 6.0).floor() - f64::from(t.grid[a])).abs();
            let inside = (0..3).all(|a| off(a) <= f64::from(reach));
            prop_assert_eq!(inside, i < around.len(), "{}", &t.path);
        }
        let sum = all.iter().map(|t| t.triangles).sum::<u64>();
        let budget = (sum as f64 * share) as u64;
        let mut picked = index.completion(&view, reach, budget);
        let some: Vec<&TileEntry> = picked.by_ref().collect();
        prop_assert_eq!(paths(some.iter().copied()), paths(all[..some.len()].iter().copied()));
        prop_assert_eq!(picked.waiting(), all.len() - some.len());
        prop_assert!(picked.next().is_none());
        let used = some.iter().map(|t| t.triangles).sum::<u64>();
        prop_assert!(used <= budget);
        if let Some(next) = all.get(some.len()) {
            prop_assert!(used + next.triangles > budget);
        }
    }
}

#[test]
fn a_parallel_view_is_sorted_by_depth_and_strange_views_do_not_fail() {
    let (set, index) = &*SET;
    let eye = look_to_mat4(DVec3::new(0.0, 0.0, 0.1), DVec3::NEG_Z, DVec3::Y);
    let lens = directx::orthographic(-1.0, 1.0, -1.0, 1.0, 0.0, 1.0);
    let view = View::new(lens * eye, Depth::ZeroToOne, set.manifest());
    assert_eq!(view.eye(), None);
    assert_eq!(index.interactive(&view, 5, u64::MAX).count(), 0);
    let tiles: Vec<&TileEntry> = index.completion(&view, 0, u64::MAX).collect();
    assert_eq!(tiles.len(), index.tiles().len());
    assert!(tiles.is_sorted_by(|a, b| view.distance(&a.bounds) <= view.distance(&b.bounds)));
    assert!(view.distance(&tiles[0].bounds) < view.distance(&tiles[tiles.len() - 1].bounds));
    for strange in [DMat4::ZERO, DMat4::NAN, DMat4::IDENTITY * f64::INFINITY] {
        let view = View::new(strange, Depth::MinusOneToOne, set.manifest());
        let _ = index.completion(&view, 1, u64::MAX).count();
    }
}

#[test]
fn the_example_feeds_a_viewer() {
    let dir = made();
    let frames = feed_viewer::run(dir.path()).unwrap();
    let last = frames.last().unwrap();
    assert!(last.tiles > 0 && last.missing == 0, "{frames:?}");
    assert!(frames.iter().any(|f| f.read < f.tiles), "{frames:?}");
    assert!(feed_viewer::run("nothing".as_ref()).is_err());
}
