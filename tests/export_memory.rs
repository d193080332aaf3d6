//! `alvis export --memory`: surfaces larger than the limit, in a memory cgroup of that size where the
//! machine lets the test make one.
#![cfg(target_os = "linux")]

mod cgroup;

use cgroup::{MIB, alvis, on_disk, report};
use std::path::Path;

/// A gyroid with much surface, and its tiles.
fn gyroid(dir: &Path, dims: &str, macrocube: &str) {
    let make = [
        "phantom", "gyroid", "a.mhd", "--dims", dims, "--pitch", "14", "--quiet",
    ];
    assert!(alvis(dir, None, &make).status.success());
    let convert = [
        "convert",
        "a.mhd",
        "set",
        "--threshold",
        "128",
        "--macrocube",
        macrocube,
        "--quiet",
    ];
    let made = alvis(dir, None, &convert);
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
}

fn args<'a>(file: &'a str, memory: &'a str) -> Vec<&'a str> {
    let mut args = vec!["export", "set", file, "--memory", memory];
    args.extend(["--quiet", "--json", "--threads", "2"]);
    args
}

#[test]
fn a_surface_larger_than_the_limit_stays_inside_it() {
    let dir = on_disk();
    gyroid(dir.path(), "240,240,160", "32");
    let limit = 40 * MIB;
    for (file, more) in [
        ("a.ply", &[][..]),
        ("a.obj", &[]),
        ("a.glb", &[]),
        ("a.stl", &[]),
        ("b.ply", &["--simplify", "0.9", "--where", "id > 0"]),
    ] {
        let args = [&args(file, "40MiB")[..], more].concat();
        let made = report(dir.path(), Some(limit), &args);
        assert!(made["bytes"].as_u64().unwrap() > limit, "{file}: {made}");
        let peak = made["peak_rss_bytes"].as_u64().unwrap();
        assert!(peak <= limit, "{file}: {peak}");
        if file != "a.ply" {
            std::fs::remove_file(dir.path().join(file)).unwrap();
        }
    }
    let index = std::fs::read(dir.path().join("set/index.json")).unwrap();
    let index: serde_json::Value = serde_json::from_slice(&index).unwrap();
    let count = |name: &str| index["totals"][name].as_u64().unwrap();
    let (vertices, triangles) = (count("vertices"), count("triangles"));
    let bytes = std::fs::read(dir.path().join("a.ply")).unwrap();
    let head = String::from_utf8_lossy(&bytes[..600]);
    let end = head.find("end_header\n").unwrap() + 11;
    assert!(
        head.contains(&format!("element vertex {vertices}\n")),
        "{head}"
    );
    assert!(
        head.contains(&format!("element face {triangles}\n")),
        "{head}"
    );
    assert_eq!(
        bytes.len() as u64,
        end as u64 + 24 * vertices + 21 * triangles
    );
}

#[test]
fn the_smallest_limit_is_named_and_works() {
    let dir = on_disk();
    gyroid(dir.path(), "100,100,100", "64");
    let refused = alvis(dir.path(), None, &args("a.obj", "4MiB"));
    assert_eq!(refused.status.code(), Some(2));
    assert!(!dir.path().join("a.obj").exists());
    let message = String::from_utf8(refused.stderr).unwrap();
    let (_, rest) = message
        .split_once("the smallest limit that works is ")
        .unwrap_or_else(|| panic!("{message}"));
    let smallest = rest.split([':', '\n']).next().unwrap();
    let limit = smallest
        .strip_suffix("MiB")
        .unwrap()
        .parse::<u64>()
        .unwrap()
        << 20;
    let made = report(dir.path(), Some(limit), &args("a.obj", smallest));
    assert!(made["peak_rss_bytes"].as_u64().unwrap() <= limit, "{made}");
}
