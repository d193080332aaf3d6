//! Levels of detail as the page gets them, compared with the nodes as other programs read them.

use super::client::{Served, view};
use super::command::{fails, foam_tiles, ok};
use super::data::{Mesh, expected};
use alvis::manifest::NodeEntry;
use alvis::tileset::TileSet;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

const FIN: u8 = 2;
const FIN_IN_CELL: u8 = 4;

/// A node of `/tree.bin`.
#[derive(Debug, Clone, Copy)]
struct Told {
    level: u32,
    grid: [u32; 3],
    triangles: u32,
    bytes: u32,
    error: f32,
    children: [u32; 2],
}

fn told(served: &Served) -> Vec<Told> {
    let words = served.get("/tree.bin").words();
    let (nodes, rest) = words[4..].as_chunks::<10>();
    assert!(rest.is_empty() && nodes.len() == words[2] as usize);
    let node = |n: &[u32; 10]| {
        assert_eq!(n[9], 1);
        Told {
            level: n[0],
            grid: [n[1], n[2], n[3]],
            triangles: n[4],
            bytes: n[5],
            error: f32::from_bits(n[6]),
            children: [n[7], n[8]],
        }
    };
    nodes.iter().map(node).collect()
}

/// All are there once, the coarsest first, each below the one that it is a part of, with a smaller error.
fn check_tree(nodes: &[Told], set: &TileSet, entries: &BTreeMap<(u32, [u32; 3]), NodeEntry>) {
    let tiles = set.manifest().totals.tiles as usize;
    assert_eq!(nodes.len(), tiles + entries.len());
    assert_eq!(nodes.iter().filter(|n| n.level == 0).count(), tiles);
    assert!(nodes.is_sorted_by_key(|n| std::cmp::Reverse(n.level)));
    let top = nodes[0].level;
    let mut next = nodes.iter().filter(|n| n.level == top).count() as u32;
    for parent in nodes {
        let [first, count] = parent.children;
        assert_eq!(count == 0, parent.level == 0, "{parent:?}");
        if count == 0 {
            continue;
        }
        assert_eq!(first, next, "{parent:?}");
        next += count;
        for child in &nodes[first as usize..next as usize] {
            assert_eq!(child.level + 1, parent.level);
            assert_eq!(child.grid.map(|n| n / 2), parent.grid);
            assert!(child.error < parent.error, "{child:?} {parent:?}");
        }
    }
    assert_eq!(next as usize, nodes.len());
}

/// A node's surfaces are those of its file, its fins lie in the volume and know on which side the cell is.
fn check_node(mesh: &mut Mesh, set: &TileSet, entry: &NodeEntry) {
    let node = set.read_node(entry).unwrap();
    let all = mesh.triangles.len() as u64;
    let flags = mesh.flags.clone();
    mesh.triangles.retain(|t| flags[t[0] as usize] & FIN == 0);
    assert_eq!(all - mesh.triangles.len() as u64, entry.fin_triangles);
    assert!(mesh.drawn() == expected(&node.pieces), "{}", entry.path);
    let corners: Vec<usize> = (0..flags.len()).filter(|&i| flags[i] & FIN != 0).collect();
    let manifest = set.manifest();
    let out = if manifest.cap { 128 } else { 0 };
    for &i in &corners {
        for a in 0..3 {
            let last = (manifest.grid.dims.0[a] as i32 - 1) * 256;
            let at = mesh.points[i][a];
            assert!((-out..=last + out).contains(&at), "{at} of {last}");
        }
    }
    let whole: Vec<_> = node.fins.iter().flat_map(|f| &f.positions).collect();
    assert_eq!(whole.len(), corners.len());
    let normals: Vec<_> = node.fins.iter().flat_map(|f| &f.normals).collect();
    let normals = normals.as_chunks::<4>().0;
    let fins = corners.as_chunks::<4>().0.iter().zip(whole.as_chunks().0);
    for ((fin, as_written), normals) in fins.zip(normals) {
        let inside = fin.map(|i| flags[i] & FIN_IN_CELL != 0);
        assert_eq!(inside.iter().filter(|&&is| is).count(), 2);
        // from the middle of those in material to the middle of those in the cell
        let as_written: &[&[f32; 3]; 4] = as_written;
        let sign = |k: usize| if inside[k] { 1.0 } else { -1.0 };
        let across: [f64; 3] = std::array::from_fn(|a| {
            let corners = as_written.iter().enumerate();
            corners.map(|(k, c)| sign(k) * f64::from(c[a])).sum()
        });
        let normal: [f64; 3] =
            std::array::from_fn(|a| normals.iter().map(|n| f64::from(n[a])).sum());
        let along: f64 = (0..3).map(|a| across[a] * normal[a]).sum();
        let length = across.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(
            along > -1e-3 * length,
            "{along} of {length} in {}",
            entry.path
        );
    }
}

fn compare(dir: &Path) {
    let set = TileSet::open(dir).unwrap();
    let levels = set.levels().unwrap().unwrap();
    let mut entries = BTreeMap::new();
    for level in &levels.levels {
        for entry in set.nodes(level) {
            let entry = entry.unwrap();
            entries.insert((level.level, entry.grid), entry);
        }
    }
    let served = view(dir, &[]);
    let nodes = told(&served);
    check_tree(&nodes, &set, &entries);
    for node in nodes.iter().filter(|n| n.level > 0) {
        let entry = &entries[&(node.level, node.grid)];
        assert_eq!(
            u64::from(node.triangles),
            entry.triangles + entry.fin_triangles
        );
        assert_eq!(node.error, entry.error as f32);
        let [x, y, z] = node.grid;
        let reply = served.get(&format!("/tile/{}/{z}/{y}/{x}", node.level));
        assert!(reply.body.len() <= node.bytes as usize, "{}", entry.path);
        check_node(&mut Mesh::read(&reply), &set, entry);
    }
    let description = served.json("/set.json");
    let told = description["levels"].as_array().unwrap();
    assert_eq!(told.len(), levels.levels.len() + 1);
    for (level, told) in levels.levels.iter().zip(&told[1..]) {
        assert_eq!(told["nodes"], level.nodes);
        assert_eq!(told["error"], level.error_max);
    }
    for wrong in ["/tile/9/0/0/0", "/tile/1/99/0/0", "/tile/4294967295/0/0/0"] {
        assert_eq!(served.get(wrong).status, 404, "{wrong}");
    }
}

#[test]
fn nodes_of_all_levels_are_served_as_a_tree() {
    for more in [
        &["--macrocube", "8"][..],
        &["--macrocube", "8", "--cap", "--for", "web"],
        &["--encoding", "quantized"],
    ] {
        let dir = foam_tiles(&[]);
        let args = ["convert", "foam.mhd", "set", "--threshold", "otsu"];
        ok(dir.path(), &[&args[..], &["--quiet"], more].concat());
        ok(dir.path(), &["lod", "set", "--quiet"]);
        compare(&dir.path().join("set"));
        // several coarsest nodes
        let few = ["lod", "set", "--levels", "2", "--force", "--quiet"];
        ok(dir.path(), &few);
        compare(&dir.path().join("set"));
    }
}

/// Lists that were changed are one message, and nothing is served.
#[test]
fn lists_of_nodes_that_do_not_fit_are_told() {
    let dir = foam_tiles(&[]);
    ok(dir.path(), &["lod", "tiles", "--quiet"]);
    let lod = dir.path().join("tiles/lod");
    let refused = |file: &Path, change: &dyn Fn(&mut Value)| {
        let text = std::fs::read_to_string(file).unwrap();
        let mut value: Value = serde_json::from_str(&text).unwrap();
        change(&mut value);
        std::fs::write(file, value.to_string()).unwrap();
        let message = fails(dir.path(), &["view", "tiles", "--no-open", "--quiet"]);
        std::fs::write(file, text).unwrap();
        assert!(message.contains("lod/index.json"), "{message}");
    };
    let list = lod.join("1/z0000.json");
    refused(&list, &|list| {
        drop(list["nodes"].as_array_mut().unwrap().remove(0))
    });
    refused(&list, &|list| {
        list["nodes"][0]["grid"] = json!([4_000_000_000_u32, 0, 0])
    });
    let index = lod.join("index.json");
    refused(&index, &|index| index["levels"][0]["step"] = json!(1 << 30));
    refused(&index, &|index| index["levels"][0]["step"] = json!(3));
}
