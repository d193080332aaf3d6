//! The programs in `examples/` do what they say.

#[path = "../examples/convert_and_verify.rs"]
mod convert_and_verify;
#[path = "../examples/read_tiles.rs"]
mod read_tiles;

use alvis::manifest::TileSet;

#[test]
fn examples_convert_verify_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let (made, report) = convert_and_verify::run(dir.path()).unwrap();
    assert!(report.ok && report.against, "{:?}", report.issues);
    assert_eq!(made.totals.triangles, report.triangles);

    let cells = read_tiles::run(dir.path()).unwrap();
    assert_eq!(cells.len() as u64, report.cells);
    let triangles: u64 = cells.values().map(|c| c.triangles).sum();
    assert_eq!(triangles, made.totals.triangles);
    let metres = TileSet::open(dir.path())
        .unwrap()
        .manifest()
        .placement
        .unit
        .metres();
    let mut closed = 0;
    for (id, cell) in &cells {
        let Some(stated) = cell.stated else { continue };
        closed += 1;
        let stated = stated * metres.powi(3);
        assert!(
            (cell.volume / stated - 1.0).abs() < 1e-6,
            "cell {id}: {cell:?}, {stated}"
        );
    }
    assert!(closed > 0);
}

#[test]
fn examples_report_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let error = read_tiles::run(dir.path()).unwrap_err().to_string();
    assert!(error.contains("index.json"), "{error}");
}
