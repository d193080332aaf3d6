//! How it starts and ends, and what becomes of sets that change meanwhile.

use super::client::{Served, view};
use super::command::{alvis, fails, foam_tiles, ok};
use std::net::TcpListener;
use std::path::Path;

#[test]
fn an_interrupt_is_its_end_and_no_failure() {
    let dir = foam_tiles(&[]);
    let served = view(&dir.path().join("tiles"), &[]);
    assert_eq!(served.get("/set.json").status, 200);
    assert_eq!(served.interrupt().code(), Some(0));
    let served = Served::start(dir.path(), &["serve", "tiles", "--quiet"]);
    // with a connection that waits
    let _open = served.connect();
    assert_eq!(served.interrupt().code(), Some(0));
}

#[test]
fn a_port_in_use_is_one_message() {
    let dir = foam_tiles(&[]);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    for command in [&["view", "tiles", "--no-open"][..], &["serve", "tiles"]] {
        let message = fails(dir.path(), &[command, &["--port", &port]].concat());
        assert!(
            message.contains("--port") && message.contains(&port),
            "{message}"
        );
        assert!(message.contains("give another one"), "{message}");
    }
    drop(taken);
    let served = view(&dir.path().join("tiles"), &["--port", &port]);
    assert_eq!(served.port.to_string(), port);
}

#[test]
fn what_is_no_tile_set_is_told_as_by_other_commands() {
    let dir = foam_tiles(&[]);
    for place in ["nothing", "tiles/index", "foam.mhd", "."] {
        let expected = fails(dir.path(), &["cells", place]);
        assert_eq!(fails(dir.path(), &["view", place, "--no-open"]), expected);
        assert_eq!(fails(dir.path(), &["serve", place]), expected);
    }
    let shard = dir.path().join("tiles/index/z0000.json");
    let text = std::fs::read_to_string(&shard).unwrap();
    for (from, to) in [
        ("\"grid\":[0,0,0]", "\"grid\":[9,0,0]"),
        ("\"grid\":[1,0,0]", "\"grid\":[0,0,0]"),
        ("\"checksum\":\"crc32:", "\"checksum\":\"crc32:+"),
        ("{", "["),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from}");
        std::fs::write(&shard, changed).unwrap();
        let message = fails(dir.path(), &["view", "tiles", "--no-open"]);
        assert!(message.contains("index"), "{message}");
    }
}

#[test]
fn the_address_is_one_line_and_the_help_goes_elsewhere() {
    let dir = foam_tiles(&[]);
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_alvis"))
        .args(["view", "tiles", "--no-open"])
        .current_dir(dir.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1500));
    let pid = child.id().to_string();
    // one that is not there yet would end by the signal
    std::process::Command::new("kill")
        .args(["-TERM", &pid])
        .status()
        .unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(
        text.starts_with("http://127.0.0.1:") && text.contains("/#"),
        "{text}"
    );
    let notes = String::from_utf8(output.stderr).unwrap();
    assert!(notes.contains("Ctrl-C"), "{notes}");
}

#[test]
fn a_conversion_can_end_with_a_look_at_it() {
    let dir = foam_tiles(&[]);
    // its summary would come before the address
    let args = "convert foam.mhd other --threshold otsu --quiet --view";
    let served = Served::start(dir.path(), &args.split(' ').collect::<Vec<_>>());
    let told = served.json("/set.json");
    assert_eq!(told["name"], "other");
    assert_eq!(told["command"]["where"], "other");
    assert_eq!(told["slices"], true);
    assert_eq!(served.interrupt().code(), Some(0));
    let both = alvis(
        dir.path(),
        &[
            "convert",
            "foam.mhd",
            "x",
            "--threshold",
            "1",
            "--view",
            "--json",
        ],
    );
    assert_eq!(both.status.code(), Some(2));
}

/// The message of what is answered, which has this status.
fn refused(served: &Served, path: &str, status: u16) -> String {
    let reply = served.get(path);
    assert_eq!(reply.status, status, "{path}: {}", reply.text());
    reply.error()
}

#[test]
fn damage_is_told_and_the_rest_goes_on() {
    let dir = foam_tiles(&[]);
    let tiles = dir.path().join("tiles");
    let served = view(&tiles, &[]);
    let tile = |name: &str| tiles.join("tiles/z0000").join(name);
    let first = tile("y0000_x0000.glb");
    let bytes = std::fs::read(&first).unwrap();
    // another byte, a shorter file, none, a folder
    let mut other = bytes.clone();
    *other.last_mut().unwrap() ^= 1;
    std::fs::write(&first, &other).unwrap();
    let message = refused(&served, "/tile/0/0/0/0", 500);
    assert!(
        message.contains("y0000_x0000.glb") && message.contains("checksum"),
        "{message}"
    );
    std::fs::write(&first, &bytes[..bytes.len() / 2]).unwrap();
    assert!(refused(&served, "/tile/0/0/0/0", 500).contains("bytes"));
    std::fs::remove_file(&first).unwrap();
    assert!(refused(&served, "/tile/0/0/0/0", 500).contains("y0000_x0000.glb"));
    std::fs::create_dir(&first).unwrap();
    refused(&served, "/tile/0/0/0/0", 500);
    assert_eq!(served.get("/tile/0/0/0/1").status, 200);

    let table = tiles.join("cells.csv");
    let text = std::fs::read_to_string(&table).unwrap();
    let rows = text.lines().count() - 1;
    let cut = text.lines().take(rows).collect::<Vec<_>>().join("\n");
    std::fs::write(&table, cut).unwrap();
    let message = refused(&served, "/table/cells?columns=volume", 500);
    assert!(
        message.contains("cells.csv") && message.contains("rows"),
        "{message}"
    );
    std::fs::write(&table, format!("{text}{}", text.lines().last().unwrap())).unwrap();
    refused(&served, "/table/cells", 500);
    std::fs::write(&table, text.replacen("\n1,", "\nx,", 1)).unwrap();
    refused(&served, "/table/cells", 500);
    refused(&served, "/row/cells/2", 500);
    refused(&served, "/query/cells?where=volume%3E0", 500);
    std::fs::remove_file(&table).unwrap();
    refused(&served, "/set.json", 500);
    assert_eq!(served.get("/query/objects?where=volume%3E0").status, 200);
}

/// Tiles whose checksums fit, and that are none.
#[test]
fn files_that_are_no_tiles_are_told() {
    let dir = foam_tiles(&[]);
    let tiles = dir.path().join("tiles");
    let file = tiles.join("tiles/z0000/y0000_x0000.glb");
    let mut bytes = std::fs::read(&file).unwrap();
    let shard = tiles.join("index/z0000.json");
    let text = std::fs::read_to_string(&shard).unwrap();
    let sum = |bytes: &[u8]| format!("crc32:{:08x}", crc32fast::hash(bytes));
    let before = sum(&bytes);
    let name = b"\"name\":\"alvis\"";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
    bytes[at + name.len() - 2] = b'x';
    std::fs::write(&file, &bytes).unwrap();
    std::fs::write(&shard, text.replace(&before, &sum(&bytes))).unwrap();
    let served = view(&tiles, &[]);
    let message = refused(&served, "/tile/0/0/0/0", 500);
    assert!(
        message.contains("y0000_x0000.glb") && message.contains("expected a tile"),
        "{message}"
    );
}

#[test]
fn a_set_that_is_made_anew_or_removed_is_told() {
    let dir = foam_tiles(&[]);
    let tiles = dir.path().join("tiles");
    let served = view(&tiles, &[]);
    let all = [
        "/set.json",
        "/tree.bin",
        "/tile/0/0/0/0",
        "/table/cells",
        "/row/cells/1",
        "/query/cells",
    ];
    all.iter()
        .for_each(|path| assert_eq!(served.get(path).status, 200, "{path}"));
    let again = "convert foam.mhd tiles --threshold 100 --macrocube 8 --force --quiet";
    ok(dir.path(), &again.split(' ').collect::<Vec<_>>());
    for path in all {
        let message = refused(&served, path, 409);
        assert!(
            message.contains("index.json") && message.contains("alvis view"),
            "{message}"
        );
    }
    let served = view(&tiles, &[]);
    remove(&tiles);
    all.iter()
        .for_each(|path| drop(refused(&served, path, 409)));
    assert_eq!(served.ask("GET", "/", &served.host()).status, 200);
}

fn remove(dir: &Path) {
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn ten_thousand_tiles_are_served() {
    let dir = tempfile::tempdir().unwrap();
    let phantom = "phantom noise noise.mhd --density 0.5 --dims 45,45,45 --quiet";
    ok(dir.path(), &phantom.split(' ').collect::<Vec<_>>());
    let convert = "convert noise.mhd tiles --threshold otsu --macrocube 2 --quiet";
    ok(dir.path(), &convert.split(' ').collect::<Vec<_>>());
    let served = view(&dir.path().join("tiles"), &[]);
    let tiles = served.json("/set.json")["tiles"].as_u64().unwrap();
    assert!(tiles > 10_000, "{tiles}");
    let tree = served.get("/tree.bin").words();
    assert_eq!(tree.len() as u64, 4 + 10 * tiles);
    for node in tree[4..].as_chunks::<10>().0.iter().step_by(499) {
        let reply = served.get(&format!("/tile/0/{}/{}/{}", node[3], node[2], node[1]));
        assert_eq!(reply.status, 200);
        assert!(reply.body.len() <= node[5] as usize);
    }
}
