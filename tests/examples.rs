//! The programs in `examples/` do what they say.

#[path = "../examples/convert_and_verify.rs"]
mod convert_and_verify;
#[path = "../examples/dump_voxels.rs"]
mod dump_voxels;
#[path = "../examples/read_tiles.rs"]
mod read_tiles;

use alvis::tileset::TileSet;

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
fn samples_are_written_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    let bytes: Vec<u8> = (0..48).collect();
    std::fs::write(&path, &bytes).unwrap();
    let words = ["dims=3,4,2", "dtype=u16"].map(String::from);
    let mut out = Vec::new();
    let said = dump_voxels::run(&path, &words, &mut out).unwrap();
    assert_eq!((out, said.as_str()), (bytes, "3 x 4 x 2 of u16, raw"));
    assert!(dump_voxels::run(&path, &[], &mut Vec::new()).is_err());
    let words = [
        "dims=4,4,3",
        "dtype=u8",
        "filter=clamp 10,40",
        "filter=invert",
    ]
    .map(String::from);
    let mut out = Vec::new();
    dump_voxels::run(&path, &words, &mut out).unwrap();
    assert_eq!([out[0], out[10], out[11], out[47]], [245, 245, 244, 215]);
}

#[test]
fn examples_report_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let error = read_tiles::run(dir.path()).unwrap_err().to_string();
    assert!(error.contains("index.json"), "{error}");
}
