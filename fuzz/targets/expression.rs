//! The language of `--where` and `--sort`: read, and evaluated on every row of a table.
#![no_main]
use alvis::table::{Expr, Table, TableReader};
use alvis_fuzz::Set;
use libfuzzer_sys::fuzz_target;
use std::sync::{LazyLock, Mutex};

static TABLE: LazyLock<(Set, Mutex<TableReader>)> = LazyLock::new(|| {
    let set = Set::new(Default::default(), false);
    let manifest = serde_json::from_value(set.manifest.clone()).unwrap();
    let table = Table::Cells.open(&set.dir, &manifest).unwrap();
    (set, Mutex::new(table))
});

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let mut table = TABLE.1.lock().unwrap();
    let columns = table.columns().to_vec();
    let found = [
        Expr::condition("--where", text, &columns),
        Expr::number("--sort", text, &columns),
    ];
    for expr in found.into_iter().flatten() {
        let mut fresh = table.reopen().unwrap();
        while let Some(row) = fresh.next_row().unwrap() {
            expr.test(&row).unwrap();
            let value = expr.value(&row).unwrap();
            assert!(value.is_none_or(f64::is_finite));
        }
    }
    drop(table.row_at(0));
});
