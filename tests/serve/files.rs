//! `alvis serve`: plain files for other programs.

use super::client::Served;
use super::command::{fails, foam_tiles, ok};

const ORIGIN: &str = "http://localhost:5173";

fn served(more: &[&str]) -> (tempfile::TempDir, Served) {
    let dir = foam_tiles(&[]);
    let served = Served::start(dir.path(), &[&["serve", "tiles", "--quiet"], more].concat());
    (dir, served)
}

/// Makes `painted` of `tiles`.
fn paint(dir: &std::path::Path) {
    let words = "select tiles painted --colour-by volume --quiet";
    ok(dir, &words.split(' ').collect::<Vec<_>>());
}

#[test]
fn files_of_the_set_are_served_as_they_are() {
    let (dir, served) = served(&[]);
    let host = served.host();
    assert_eq!(served.token, "");
    for (path, kind) in [
        ("index.json", "application/json"),
        ("index/z0000.json", "application/json"),
        ("cells.csv", "text/csv; charset=utf-8"),
        ("objects.csv", "text/csv; charset=utf-8"),
        ("surfaces.csv", "text/csv; charset=utf-8"),
        ("tiles/z0000/y0000_x0000.glb", "model/gltf-binary"),
        ("tiles/z0001/y0002_x0002.glb", "model/gltf-binary"),
    ] {
        let bytes = std::fs::read(dir.path().join("tiles").join(path)).unwrap();
        let reply = served.ask("GET", &format!("/{path}"), &host);
        assert_eq!(reply.status, 200, "{path}");
        assert!(reply.body == bytes, "{path}");
        assert_eq!(reply.header("content-type"), Some(kind));
        assert_eq!(reply.header("x-content-type-options"), Some("nosniff"));
        assert!(reply.header("content-security-policy").is_some());
        let head = served.ask("HEAD", &format!("/{path}"), &host);
        assert_eq!((head.status, head.body.len()), (200, 0));
        assert_eq!(
            head.header("content-length"),
            Some(&bytes.len().to_string()[..])
        );
        if let Some(tag) = reply.header("etag") {
            let lines = format!("{host}If-None-Match: {tag}\r\n");
            assert_eq!(served.ask("GET", &format!("/{path}"), &lines).status, 304);
        }
    }
    assert_eq!(served.ask("POST", "/index.json", &host).status, 405);
}

/// Tables as Parquet, of parts and of walls, levels of detail with their tilesets, and drawings of colours.
#[test]
fn what_some_sets_have_is_served() {
    let dir = foam_tiles(&["--walls", "--tables", "csv,parquet", "--for", "web"]);
    ok(dir.path(), &["lod", "tiles", "--quiet"]);
    paint(dir.path());
    for (set, all) in [
        (
            "tiles",
            &[
                "walls.csv",
                "cells.parquet",
                "walls.parquet",
                "tileset.json",
                "lod/index.json",
                "lod/1/z0000.json",
                "lod/1/z0000/y0000_x0000.glb",
            ][..],
        ),
        ("painted", &["legend.png", "legend.svg"]),
    ] {
        let served = Served::start(dir.path(), &["serve", set, "--quiet"]);
        for path in all {
            let bytes = std::fs::read(dir.path().join(set).join(path)).unwrap();
            let reply = served.ask("GET", &format!("/{path}"), &served.host());
            assert_eq!(reply.status, 200, "{path}");
            assert!(reply.body == bytes, "{path}");
        }
        for path in [
            "lod",
            "lod/9/z0000.json",
            "lod/1/z00000.json",
            "lod/1/../index.json",
            "lod/01/z0000.json",
            "lod/tilesets/3_z0_y0_x0",
        ] {
            let reply = served.ask("GET", &format!("/{path}"), &served.host());
            assert_eq!(reply.status, 404, "{path}");
        }
    }
}

#[test]
fn nothing_else_is_served() {
    let (dir, served) = served(&[]);
    let tiles = dir.path().join("tiles");
    std::fs::write(tiles.join("notes.txt"), "secret").unwrap();
    std::fs::write(dir.path().join("notes.txt"), "secret").unwrap();
    let second = tiles.join("tiles/z0000/y0000_x0001.glb");
    std::fs::remove_file(&second).unwrap();
    std::os::unix::fs::symlink(dir.path().join("notes.txt"), &second).unwrap();
    for (path, status) in [
        ("/", 404),
        ("/notes.txt", 404),
        ("/../notes.txt", 404),
        ("/tiles", 404),
        ("/tiles/", 404),
        ("/tiles/z0000", 404),
        ("/tiles/../index.json", 404),
        ("/tiles/z0000/../../notes.txt", 404),
        ("/tiles/z0000/y0000_x0099.glb", 404),
        ("/tiles/z0000/y+000_x0000.glb", 404),
        ("/tiles/z0/y0_x0.glb", 404),
        ("//index.json", 404),
        ("/%69ndex.json", 404),
        ("/index.json/", 404),
        ("/tiles/z0000/y0000_x0001.glb", 500),
    ] {
        let reply = served.ask("GET", path, &served.host());
        assert_eq!(reply.status, status, "{path}");
        assert!(!reply.error().contains("secret\n"), "{path}");
    }
}

#[test]
fn ranges_are_parts_of_a_file() {
    let (dir, served) = served(&[]);
    let path = "tiles/z0000/y0000_x0000.glb";
    let bytes = std::fs::read(dir.path().join("tiles").join(path)).unwrap();
    let n = bytes.len();
    let ask = |range: &str| {
        let lines = format!("{}Range: {range}\r\n", served.host());
        served.ask("GET", &format!("/{path}"), &lines)
    };
    for (range, part) in [
        ("bytes=0-3", 0..4),
        ("bytes=20-", 20..n),
        ("bytes=-5", n - 5..n),
        (&format!("bytes=4-{}", 2 * n), 4..n),
        (&format!("bytes={}-", n - 1), n - 1..n),
    ] {
        let reply = ask(range);
        assert_eq!(reply.status, 206, "{range}");
        assert!(reply.body == bytes[part.clone()], "{range}");
        let stated = format!("bytes {}-{}/{n}", part.start, part.end - 1);
        assert_eq!(reply.header("content-range"), Some(&stated[..]));
    }
    for whole in [
        "bytes=0-",
        "bytes=-9999999",
        "bytes=5-4",
        "bytes=a-b",
        "bytes=+1-3",
        "bytes=0-1,4-5",
        "items=0-3",
        "bytes=-",
        "bytes=99999999999999999999-",
    ] {
        let reply = ask(whole);
        assert_eq!(reply.status, 200, "{whole}");
        assert!(reply.body == bytes, "{whole}");
    }
    for none in [
        format!("bytes={n}-"),
        "bytes=-0".to_owned(),
        format!("bytes={n}-{}", n + 4),
    ] {
        let reply = ask(&none);
        assert_eq!(reply.status, 416, "{none}");
        assert_eq!(
            reply.header("content-range"),
            Some(&format!("bytes */{n}")[..])
        );
    }
}

#[test]
fn only_pages_of_the_origins_that_are_given_may_read() {
    let (_dir, served) = served(&[
        "--allow-origin",
        ORIGIN,
        "--allow-origin",
        "https://a.example",
    ]);
    let host = served.host();
    let ask =
        |method: &str, lines: &str| served.ask(method, "/index.json", &format!("{host}{lines}"));
    for origin in [ORIGIN, "https://a.example"] {
        let reply = ask(
            "GET",
            &format!("Origin: {origin}\r\nSec-Fetch-Site: cross-site\r\n"),
        );
        assert_eq!(reply.status, 200);
        assert_eq!(reply.header("access-control-allow-origin"), Some(origin));
        assert_eq!(reply.header("vary"), Some("Origin"));
    }
    let asked =
        "Access-Control-Request-Method: GET\r\nAccess-Control-Request-Private-Network: true\r\n";
    let before = ask("OPTIONS", &format!("Origin: {ORIGIN}\r\n{asked}"));
    assert_eq!((before.status, before.body.len()), (204, 0));
    assert_eq!(
        before.header("access-control-allow-private-network"),
        Some("true")
    );
    assert!(
        before
            .header("access-control-allow-methods")
            .unwrap()
            .contains("GET")
    );
    // programs that are no browser
    let plain = ask("GET", "");
    assert_eq!(plain.status, 200);
    assert!(plain.header("access-control-allow-origin").is_none());
    for other in [
        "Origin: https://b.example\r\n",
        "Origin: null\r\n",
        "Sec-Fetch-Site: cross-site\r\n",
    ] {
        for method in ["GET", "OPTIONS"] {
            let reply = ask(method, other);
            assert_eq!(reply.status, 403, "{other}");
            assert!(reply.header("access-control-allow-origin").is_none());
        }
    }
    let rebound = format!("Host: evil.example:{}\r\nOrigin: {ORIGIN}\r\n", served.port);
    assert_eq!(served.ask("GET", "/index.json", &rebound).status, 403);
}

#[test]
fn origins_that_no_browser_sends_are_refused() {
    let dir = foam_tiles(&[]);
    for bad in [
        "*",
        "null",
        "a.example",
        "https://a.example/",
        "https://A.example",
    ] {
        let message = fails(dir.path(), &["serve", "tiles", "--allow-origin", bad]);
        assert!(message.contains("https://viewer.example"), "{message}");
    }
}

#[test]
fn legends_of_painted_sets_are_served() {
    let dir = foam_tiles(&[]);
    paint(dir.path());
    let served = Served::start(dir.path(), &["serve", "painted", "--quiet"]);
    let index = served.ask("GET", "/index.json", &served.host()).json();
    let legend = index["selection"]["colour_by"]["legend"].as_str().unwrap();
    let reply = served.ask("GET", &format!("/{legend}"), &served.host());
    assert_eq!(reply.header("content-type"), Some("image/png"));
}
