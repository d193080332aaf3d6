//! The checksums that an index states of its tables and of itself.

use serde_json::Value;
use std::path::Path;

fn crc(bytes: &[u8]) -> String {
    format!("crc32:{:08x}", crc32fast::hash(bytes))
}

/// The text of an index that states the checksums of these tables, and its own, as its last member; those that it
/// does not have it does not get.
pub fn sealed(mut index: Value, table: impl Fn(&str) -> Option<Vec<u8>>) -> Vec<u8> {
    let stated = index.get_mut("tables").and_then(|t| t.get_mut("checksums"));
    if let Some(all) = stated.and_then(Value::as_object_mut) {
        for name in [
            "cells",
            "objects",
            "surfaces",
            "components",
            "necks",
            "walls",
        ] {
            if let (Some(own), Some(bytes)) = (all.get_mut(name), table(&format!("{name}.csv"))) {
                *own = crc(&bytes).into();
            }
        }
    }
    let members = index.as_object_mut();
    let has_own = members.is_some_and(|m| m.remove("checksum").is_some());
    let text = serde_json::to_string_pretty(&index).unwrap();
    match text.strip_suffix("\n}") {
        Some(start) if has_own => {
            let with =
                |own: &str| format!("{start},\n  \"checksum\": \"{own}\"\n}}\n").into_bytes();
            let own = crc(&with("crc32:00000000"));
            with(&own)
        }
        _ => (text + "\n").into_bytes(),
    }
}

/// Makes the index in a directory agree with the tables there, and with itself.
pub fn seal(dir: &Path) {
    let path = dir.join("index.json");
    let Ok(bytes) = std::fs::read(&path) else {
        return;
    };
    // what is damaged stays so
    if let Ok(index @ Value::Object(_)) = serde_json::from_slice(&bytes) {
        let text = sealed(index, |name| std::fs::read(dir.join(name)).ok());
        std::fs::write(&path, text).unwrap();
    }
}
