//! `alvis export --simplify`: fewer triangles, and still the same surface: no hole, no edge of more than
//! two triangles, the same border and Euler characteristic, near the original.

mod common;
mod export_common;

use alvis::convert::ConvertOptions;
use alvis::export::{ExportOptions, ExportReport, Simplify, export};
use alvis::grid::{Ambiguous, Dims, Unit};
use alvis::phantom::{Foam, Phantom, Shape, render};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, Volume};
use common::volumes::{foam, noise, placed, volume};
use common::{converted, set, verified};
use export_common::{Mesh, read};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

fn simplified(dir: &Path, how: Option<Simplify>) -> (ExportReport, Mesh) {
    let options = ExportOptions {
        simplify: how,
        force: true,
        ..ExportOptions::default()
    };
    let file = dir.join("a.ply");
    let report = export(dir, &file, &options, &Quiet).unwrap();
    (report, read(&file))
}

fn point(v: [f64; 3]) -> [i32; 3] {
    v.map(|c| (c * 256.0) as i32)
}

/// Open edges as directed pairs of places.
fn border(mesh: &Mesh) -> BTreeSet<[[i32; 3]; 2]> {
    let mut open = BTreeSet::new();
    for t in &mesh.triangles {
        for i in 0..3 {
            let [a, b] = [t[i], t[(i + 1) % 3]].map(|v| point(mesh.vertices[v]));
            if !open.remove(&[b, a]) {
                open.insert([a, b]);
            }
        }
    }
    open
}

/// V - E + F of the triangles of each (cell, object).
fn euler(mesh: &Mesh) -> BTreeMap<(u64, u64), i64> {
    let mut vertices: BTreeMap<_, BTreeSet<usize>> = BTreeMap::new();
    let mut edges: BTreeMap<_, BTreeSet<[usize; 2]>> = BTreeMap::new();
    let mut faces: BTreeMap<_, i64> = BTreeMap::new();
    for (i, t) in mesh.triangles.iter().enumerate() {
        let id = (mesh.cells[i], mesh.objects[i]);
        *faces.entry(id).or_default() += 1;
        vertices.entry(id).or_default().extend(t);
        let sides = [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let sides = sides.map(|[a, b]| [a.min(b), a.max(b)]);
        edges.entry(id).or_default().extend(sides);
    }
    let sum = |(id, n): (_, i64)| (id, n + vertices[&id].len() as i64 - edges[&id].len() as i64);
    faces.into_iter().map(sum).collect()
}

/// Checks several strengths on one tile set of unit voxels; returns the fewest triangles, as a share.
fn check(name: &str, volume: &dyn Volume, options: ConvertOptions) -> f64 {
    let options = ConvertOptions {
        threshold: 128.0,
        ..options
    };
    let (dir, _) = converted(volume, &options);
    verified(dir.path(), None);
    let (_, whole) = simplified(dir.path(), None);
    let (edges, borders, shapes) = (whole.edges(), border(&whole), euler(&whole));
    let known: BTreeSet<[i32; 3]> = whole.vertices.iter().map(|v| point(*v)).collect();
    let mut least = f64::INFINITY;
    for how in [
        Simplify::Ratio(1.0),
        Simplify::Ratio(0.5),
        Simplify::Ratio(0.02),
        Simplify::Voxels(0.05),
        Simplify::Voxels(2.0),
    ] {
        let (report, mesh) = simplified(dir.path(), Some(how));
        let what = format!("{name}, {how:?}");
        assert_eq!(report.triangles_before, Some(whole.triangles.len() as u64));
        assert_eq!(report.triangles, mesh.triangles.len() as u64);
        // panics at an edge of more than two triangles
        assert_eq!(mesh.edges(), edges, "{what}");
        assert_eq!(border(&mesh), borders, "{what}");
        assert_eq!(euler(&mesh), shapes, "{what}");
        let twice: BTreeSet<_> = mesh
            .triangles
            .iter()
            .map(|t| {
                let mut t = *t;
                t.sort_unstable();
                t
            })
            .collect();
        assert_eq!(twice.len(), mesh.triangles.len(), "{what}");
        assert!(
            mesh.vertices.iter().all(|v| known.contains(&point(*v))),
            "{what}"
        );
        if how == Simplify::Ratio(1.0) {
            assert_eq!(mesh, whole, "{what}");
        }
        if let Simplify::Voxels(most) = how {
            assert!(report.error.unwrap() <= most * 1.0001, "{what}: {report:?}");
        }
        least = least.min(mesh.triangles.len() as f64 / whole.triangles.len() as f64);
    }
    least
}

fn options(macrocube: u32, cap: bool) -> ConvertOptions {
    ConvertOptions {
        macrocube: [macrocube; 3],
        cap,
        ..ConvertOptions::default()
    }
}

#[test]
fn foams_stay_whole() {
    let dims = Dims::new([60, 56, 52]).unwrap();
    let phantom = Phantom::new(Shape::Foam(Foam {
        pitch: 13.0,
        ..Foam::default()
    }));
    let smooth = render(&phantom, dims, Dtype::U8).unwrap();
    let least = check("foam", &smooth, options(30, false));
    assert!(least < 0.4, "{least}");
    let least = check("foam, capped", &smooth, options(20, true));
    assert!(least < 0.5, "{least}");
    let dims = [33, 30, 28];
    let ragged = volume(dims, foam(dims, 6));
    check("ragged foam", &ragged, options(11, false));
    let join = ConvertOptions {
        ambiguous: Ambiguous::Join,
        ..options(14, true)
    };
    check("ragged foam, capped", &ragged, join);
}

#[test]
fn noise_and_labyrinths_stay_whole() {
    let dims = [17, 18, 19];
    check("noise", &volume(dims, noise(dims, 1)), options(7, false));
    check(
        "noise, capped",
        &volume(dims, noise(dims, 2)),
        options(64, true),
    );
    check(
        "noise, small macrocubes",
        &volume(dims, noise(dims, 3)),
        options(1, true),
    );
    let gyroid = Phantom::new(Shape::Gyroid { period: 16.0 });
    let labyrinth = render(&gyroid, Dims::new([48; 3]).unwrap(), Dtype::U8).unwrap();
    let least = check("gyroid", &labyrinth, options(64, true));
    assert!(least < 0.3, "{least}");
}

/// Distance of a point to a triangle, by the nearest of many points in it.
fn near(p: glam::DVec3, [a, b, c]: [glam::DVec3; 3]) -> f64 {
    const N: i32 = 12;
    let mut least = f64::INFINITY;
    for i in 0..=N {
        for j in 0..=N - i {
            let [u, v] = [i, j].map(|k| f64::from(k) / f64::from(N));
            least = least.min(p.distance(a + (b - a) * u + (c - a) * v));
        }
    }
    least
}

#[test]
fn the_error_is_one_of_length() {
    let dims = [32; 3];
    let ball: Vec<u8> = common::volumes::samples(dims, |p| {
        let off = p.map(|v| f64::from(v) - 15.7);
        let r = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt();
        (128.0 + 20.0 * (11.0 - r)).clamp(0.0, 255.0) as u8
    });
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [16; 3],
        ..ConvertOptions::default()
    };
    let (dir, _) = converted(&placed(dims, ball), &options);
    let (_, whole) = simplified(dir.path(), None);
    let how = Simplify::Length(50.0, Unit::Micrometre);
    let (report, mesh) = simplified(dir.path(), Some(how));
    assert!(report.error.unwrap() <= 0.05);
    assert!(
        mesh.triangles.len() * 3 < whole.triangles.len() * 2,
        "{report:?}"
    );
    let corners: Vec<_> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| glam::DVec3::from(mesh.vertices[v])))
        .collect();
    // the estimate is of quadrics, not a bound
    for v in whole.vertices.iter().step_by(7) {
        let p = glam::DVec3::from(*v);
        let d = corners
            .iter()
            .map(|t| near(p, *t))
            .fold(f64::INFINITY, f64::min);
        assert!(d < 0.25, "{p}: {d}");
    }
    assert_eq!(
        set::manifest(dir.path()).totals.triangles,
        whole.triangles.len() as u64
    );
}
