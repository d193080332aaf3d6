//! Real volumes, exported: as many triangles as the verifier counted, and closed. The numbers of the
//! lobster are those that trimesh 5.2 and pymeshlab 2025.7 find in the PLY, STL, OBJ and GLB files.

mod common;
mod export_common;

use alvis::convert::ConvertOptions;
use alvis::export::{ExportOptions, Simplify, export};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, OpenOptions, open};
use common::{converted, data, verified};
use export_common::read;

#[test]
fn the_lobster_is_closed_in_every_format() {
    let Some(data) = data("the_lobster_is_closed_in_every_format") else {
        return;
    };
    let how = OpenOptions {
        dims: Some([301, 324, 56]),
        dtype: Some(Dtype::U8),
        ..OpenOptions::default()
    };
    let opened = open(&data.join("raw/lobster_301x324x56_uint8.raw"), &how).unwrap();
    let options = ConvertOptions {
        threshold: 40.0,
        ..ConvertOptions::default()
    };
    let (dir, _) = converted(&*opened.volume, &options);
    let report = verified(dir.path(), None);
    assert_eq!((report.triangles, report.vertices), (322_876, 161_320));
    assert_eq!(
        (report.border_edges, report.euler_characteristic),
        (0, -118)
    );
    for format in ["a.ply", "a.obj", "a.glb", "a.stl", "b.ply"] {
        let file = dir.path().join(format);
        let options = ExportOptions {
            simplify: (format == "b.ply").then_some(Simplify::Ratio(0.2)),
            ..ExportOptions::default()
        };
        let made = export(dir.path(), &file, &options, &Quiet).unwrap();
        let mesh = match format {
            "a.stl" => read(&file).joined(),
            _ => read(&file),
        };
        let edges = mesh.edges();
        assert_eq!((edges.open, edges.euler), (0, -118), "{format}");
        if format == "b.ply" {
            assert!(made.triangles < 322_876 * 3 / 10, "{}", made.triangles);
        } else {
            assert_eq!(
                (made.triangles, mesh.vertices.len()),
                (322_876, 161_320),
                "{format}"
            );
        }
    }
}
