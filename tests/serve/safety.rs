//! Who is answered, and what nobody can do to the server.

use super::client::{Served, view};
use super::command::foam_tiles;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

/// Connections at once, by the documentation of the server.
const CONNECTIONS: usize = 64;

fn served() -> (tempfile::TempDir, Served) {
    let dir = foam_tiles(&[]);
    let served = view(&dir.path().join("tiles"), &[]);
    (dir, served)
}

#[test]
fn it_listens_on_the_loopback_addresses_alone() {
    let (_dir, served) = served();
    assert_eq!(served.ask("GET", "/", &served.host()).status, 200);
    // an address of another interface of this machine, which no packet has to reach
    let outward = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
    if outward.connect("192.0.2.1:9").is_ok() {
        let own = outward.local_addr().unwrap().ip();
        if !own.is_loopback() {
            let refused =
                TcpStream::connect_timeout(&(own, served.port).into(), Duration::from_secs(5));
            assert!(refused.is_err(), "{own}");
        }
    }
    // the port is free on that interface
    assert!(TcpListener::bind(("127.0.0.2", served.port)).is_ok());
    if let Ok(mut six) = TcpStream::connect(("::1", served.port)) {
        let text = format!(
            "GET / HTTP/1.1\r\nHost: [::1]:{}\r\nConnection: close\r\n\r\n",
            served.port
        );
        six.write_all(text.as_bytes()).unwrap();
        let mut answer = String::new();
        six.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
    }
}

#[test]
fn only_its_own_names_are_answered_whatever_is_asked() {
    let (_dir, served) = served();
    let (port, token) = (served.port, served.token.clone());
    let bearer = format!("Authorization: Bearer {token}\r\n");
    let own = format!("Host: 127.0.0.1:{port}\r\n");
    for path in ["/", "/set.json", "/nothing", "/tile/0/0/0/0"] {
        for host in [
            String::new(),
            "Host:\r\n".to_owned(),
            "Host: 127.0.0.1\r\n".to_owned(),
            format!("Host: 127.0.0.1:{}\r\n", port ^ 1),
            format!("Host: 127.0.0.1:0{port}\r\n"),
            format!("Host: evil.example:{port}\r\n"),
            format!("Host: evil.example\r\n{own}"),
            format!("{own}{own}"),
            format!("{own}Host: evil.example\r\n"),
            format!("Host: 127.0.0.1:{port}@evil.example\r\n"),
            format!("X-Forwarded-Host: 127.0.0.1:{port}\r\nHost: evil.example\r\n"),
        ] {
            let reply = served.ask("GET", path, &format!("{host}{bearer}"));
            assert_eq!(reply.status, 403, "{path} {host}");
            assert!(reply.error().contains("Host"), "{host}");
        }
    }
    // a target that names another host, or a request of HTTP/1.0 without one
    let absolute = format!(
        "GET http://evil.example/set.json HTTP/1.1\r\n{own}{bearer}Connection: close\r\n\r\n"
    );
    assert_eq!(served.send(absolute.as_bytes()).unwrap().status, 400);
    let old = format!("GET /set.json HTTP/1.0\r\n{bearer}\r\n");
    assert_eq!(served.send(old.as_bytes()).unwrap().status, 403);
    for host in ["127.0.0.1", "localhost", "[::1]"] {
        let reply = served.ask(
            "GET",
            "/set.json",
            &format!("Host: {host}:{port}\r\n{bearer}"),
        );
        assert_eq!(reply.status, 200, "{host}");
    }
}

#[test]
fn pages_of_others_are_refused() {
    let (_dir, served) = served();
    let lines = served.lines();
    let own = format!("http://127.0.0.1:{}", served.port);
    for (more, status) in [
        (
            format!("Origin: {own}\r\nSec-Fetch-Site: same-origin\r\n"),
            200,
        ),
        ("Sec-Fetch-Site: none\r\n".to_owned(), 200),
        ("Origin: null\r\n".to_owned(), 403),
        ("Origin: http://evil.example\r\n".to_owned(), 403),
        (format!("Origin: http://localhost:{}\r\n", served.port), 403),
        (format!("Origin: {own}/\r\n"), 403),
        (format!("Origin: https{}\r\n", &own[4..]), 403),
        (
            format!("Origin: {own}\r\nOrigin: http://evil.example\r\n"),
            403,
        ),
        ("Sec-Fetch-Site: cross-site\r\n".to_owned(), 403),
        ("Sec-Fetch-Site: same-site\r\n".to_owned(), 403),
        ("Sec-Fetch-Site: \r\n".to_owned(), 403),
    ] {
        for path in ["/", "/set.json"] {
            let reply = served.ask("GET", path, &format!("{lines}{more}"));
            assert_eq!(reply.status, status, "{path} {more}");
            assert!(reply.header("access-control-allow-origin").is_none());
        }
    }
}

#[test]
fn data_needs_the_token_and_the_page_does_not() {
    let (_dir, served) = served();
    let (host, token) = (served.host(), &served.token);
    assert_eq!(token.len(), 32);
    assert!(token.bytes().all(|b| b.is_ascii_hexdigit()));
    assert_eq!(served.ask("GET", "/", &host).status, 200);
    let mut wrong = token.clone();
    let last = if wrong.pop() == Some('0') { '1' } else { '0' };
    wrong.push(last);
    for path in [
        "/set.json",
        "/tree.bin",
        "/tile/0/0/0/0",
        "/table/cells",
        "/row/cells/1",
        "/query/cells",
        "/slice/z/0.png",
        "/nothing",
    ] {
        for line in [
            String::new(),
            format!("Authorization: Bearer {wrong}\r\n"),
            "Authorization: Bearer \r\n".to_owned(),
            format!("Authorization: Bearer {token}0\r\n"),
            format!("Authorization: Bearer {}\r\n", &token[1..]),
            format!("Authorization: Basic {token}\r\n"),
            format!("Authorization: {token}\r\n"),
            format!("Authorization: Bearer {token}\r\nAuthorization: Bearer {token}\r\n"),
            format!("Cookie: token={token}\r\n"),
        ] {
            let reply = served.ask("GET", path, &format!("{host}{line}"));
            assert_eq!(reply.status, 401, "{path} {line}");
            assert!(!reply.error().contains(token));
        }
        let asked = format!("{path}?token={token}");
        assert_eq!(served.ask("GET", &asked, &host).status, 401);
    }
    // each start has its own
    let dir = foam_tiles(&[]);
    assert_ne!(view(&dir.path().join("tiles"), &[]).token, *token);
}

#[test]
fn every_answer_says_what_pages_may_do_with_it() {
    let (_dir, served) = served();
    let lines = served.lines();
    let long = format!("{lines}X: {}\r\n", "a".repeat(9000));
    for (status, reply) in [
        (200, served.ask("GET", "/", &lines)),
        (200, served.get("/set.json")),
        (200, served.get("/tile/0/0/0/0")),
        (400, served.get("/query/cells?where=nonsense")),
        (400, served.send(b"\x16\x03\x01\r\n\r\n").unwrap()),
        (401, served.ask("GET", "/set.json", &served.host())),
        (403, served.ask("GET", "/", "")),
        (404, served.get("/nothing")),
        (405, served.ask("POST", "/set.json", &lines)),
        (
            413,
            served.ask("GET", "/", &format!("{lines}Content-Length: 3\r\n")),
        ),
        (431, served.ask("GET", "/", &long)),
    ] {
        assert_eq!(reply.status, status);
        let policy = reply.header("content-security-policy").unwrap();
        for part in [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "connect-src 'self'",
            "img-src 'self' blob: data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ] {
            assert!(policy.split("; ").any(|p| p == part), "{status}: {policy}");
        }
        assert_eq!(reply.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(
            reply.header("cross-origin-resource-policy"),
            Some("same-origin")
        );
        assert_eq!(reply.header("referrer-policy"), Some("no-referrer"));
        assert!(reply.header("server").is_none());
        if status != 200 {
            assert!(!reply.error().is_empty());
        }
    }
}

#[test]
fn long_heads_and_bodies_are_refused() {
    let (_dir, served) = served();
    let lines = served.lines();
    let filled = |bytes: usize| {
        let begin = format!("GET / HTTP/1.1\r\nConnection: close\r\n{lines}X: ");
        format!("{begin}{}\r\n\r\n", "a".repeat(bytes - begin.len() - 4))
    };
    assert_eq!(served.send(filled(8 << 10).as_bytes()).unwrap().status, 200);
    assert_eq!(
        served
            .send(filled((8 << 10) + 1).as_bytes())
            .unwrap()
            .status,
        431
    );
    assert_eq!(served.send(filled(1 << 20).as_bytes()).unwrap().status, 431);
    let target = format!("/{}", "a".repeat(9000));
    assert_eq!(served.ask("GET", &target, &lines).status, 431);
    assert_eq!(
        served
            .ask("GET", "/", &format!("{lines}{}", "A: b\r\n".repeat(100)))
            .status,
        431
    );
    for body in [
        "Content-Length: 1\r\n",
        "Transfer-Encoding: chunked\r\n",
        "Content-Length: x\r\n",
    ] {
        assert_eq!(
            served.ask("GET", "/", &format!("{lines}{body}")).status,
            413,
            "{body}"
        );
    }
    for method in [
        "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "get",
    ] {
        let reply = served.ask(method, "/set.json", &lines);
        assert_eq!(reply.status, 405, "{method}");
        assert_eq!(reply.header("allow"), Some("GET, HEAD"));
    }
    assert_eq!(served.get("/set.json").status, 200);
}

#[test]
fn slow_and_silent_clients_are_dropped_and_keep_nobody_waiting() {
    let (_dir, served) = served();
    let begin = format!("GET /set.json HTTP/1.1\r\n{}", served.lines());
    // half of a request, one letter after the other, and none at all
    let mut half = served.connect();
    half.write_all(&begin.as_bytes()[..20]).unwrap();
    let mut silent = served.connect();
    let mut slow = served.connect();
    let drip = std::thread::spawn(move || {
        let mut answer = Vec::new();
        for byte in begin.bytes().cycle().take(600) {
            if slow.write_all(&[byte]).is_err() {
                break;
            }
            std::thread::sleep(Duration::from_millis(20));
            slow.set_nonblocking(true).unwrap();
            let mut some = [0; 4096];
            match slow.read(&mut some) {
                Ok(0) => return answer,
                Ok(n) => answer.extend_from_slice(&some[..n]),
                Err(_) => {}
            }
            slow.set_nonblocking(false).unwrap();
        }
        answer
    });
    for _ in 0..20 {
        assert_eq!(served.get("/set.json").status, 200);
    }
    let mut answer = String::new();
    half.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
    assert_eq!(silent.read(&mut [0; 16]).unwrap(), 0);
    let answer = String::from_utf8(drip.join().unwrap()).unwrap();
    assert!(
        answer.is_empty() || answer.starts_with("HTTP/1.1 4"),
        "{answer}"
    );
}

#[test]
fn so_many_connections_and_no_more() {
    let (_dir, served) = served();
    let text = format!("GET / HTTP/1.1\r\n{}\r\n", served.host());
    // answered once, these stay open for the next request
    let mut open: Vec<TcpStream> = Vec::new();
    for _ in 0..CONNECTIONS {
        let mut stream = served.connect();
        stream.write_all(text.as_bytes()).unwrap();
        let mut some = [0; 12];
        stream.read_exact(&mut some).unwrap();
        assert_eq!(&some, b"HTTP/1.1 200");
        open.push(stream);
    }
    let mut more = served.connect();
    let mut answer = String::new();
    more.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 503 "), "{answer}");
    open.clear();
    // the threads of those notice in no time, but not at once
    let answered = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        let reply = served.send(
            format!(
                "GET / HTTP/1.1\r\nConnection: close\r\n{}\r\n",
                served.host()
            )
            .as_bytes(),
        );
        reply.is_some_and(|reply| reply.status == 200)
    });
    assert!(answered);
}

#[test]
fn requests_follow_each_other_on_a_connection() {
    let (_dir, served) = served();
    let lines = served.lines();
    let one = |path: &str| format!("GET {path} HTTP/1.1\r\n{lines}\r\n");
    let last = format!("GET /nothing HTTP/1.1\r\n{lines}Connection: close\r\n\r\n");
    let mut stream = served.connect();
    let all = [one("/"), one("/set.json"), last].concat();
    stream.write_all(all.as_bytes()).unwrap();
    let mut answers = String::new();
    stream.read_to_string(&mut answers).unwrap();
    let statuses: Vec<&str> = answers
        .split("HTTP/1.1 ")
        .skip(1)
        .map(|a| &a[..3])
        .collect();
    assert_eq!(statuses, ["200", "200", "404"]);
}

#[test]
fn any_bytes_leave_the_server_as_it_was() {
    let (_dir, served) = served();
    let sound = format!("GET /tile/0/0/0/0?a=b HTTP/1.1\r\n{}\r\n", served.lines());
    let mut state = 0x1234_5678_9abc_def1u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize % below
    };
    for round in 0..300 {
        let mut bytes = sound.clone().into_bytes();
        for _ in 0..1 + random(4) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes[at] = random(256) as u8,
                1 => bytes.insert(at, random(256) as u8),
                2 if bytes.len() > 1 => drop(bytes.remove(at)),
                _ => bytes.truncate(at.max(1)),
            }
        }
        if round % 10 == 0 {
            bytes = (0..1 + random(64)).map(|_| random(256) as u8).collect();
        }
        let mut stream = served.connect();
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 "));
    }
    assert_eq!(served.get("/set.json").status, 200);
}

#[test]
fn no_path_becomes_the_name_of_a_file() {
    let (dir, served) = served();
    std::fs::write(dir.path().join("tiles/secret.txt"), "secret").unwrap();
    std::fs::write(dir.path().join("secret.txt"), "secret").unwrap();
    for path in [
        "/secret.txt",
        "/../secret.txt",
        "/..%2fsecret.txt",
        "/index.json",
        "/cells.csv",
        "/index.html",
        "/tiles/z0000/y0000_x0000.glb",
        "/tile/0/0/0/../../../secret.txt",
        "/tile/0/0/0/0/../secret.txt",
        "/tile/0/0/0/%2e%2e",
        "/tile/0/0/0/-1",
        "/tile/0/0/0/99999999999",
        "/tile/1/0/0/0",
        "/tile/0/9/9/9",
        "/table/../secret.txt",
        "/table/secret.txt",
        "/table/cells.csv",
        "/row/cells/../1",
        "/slice/z/../0.png",
        "//etc/passwd",
        "/%00",
        "/.",
    ] {
        let reply = served.get(path);
        let text = String::from_utf8_lossy(&reply.body);
        if path == "/index.html" {
            assert!(text.contains("<html"), "{text}");
            continue;
        }
        assert_eq!(reply.status, 404, "{path}");
        assert!(
            !text.contains("secret\n") && text.starts_with("{\"error\""),
            "{path}: {text}"
        );
    }
}

/// Tiles that lie elsewhere, by a link or by their path in the index.
#[test]
fn tiles_outside_of_the_set_are_refused() {
    let dir = foam_tiles(&[]);
    let tile = dir.path().join("tiles/tiles/z0000/y0000_x0000.glb");
    std::fs::rename(&tile, dir.path().join("elsewhere.glb")).unwrap();
    std::os::unix::fs::symlink(dir.path().join("elsewhere.glb"), &tile).unwrap();
    let shard = dir.path().join("tiles/index/z0000.json");
    let text = std::fs::read_to_string(&shard).unwrap();
    let text = text.replace("tiles/z0000/y0000_x0001.glb", "tiles/../../elsewhere.glb");
    std::fs::write(&shard, text).unwrap();
    let served = view(&dir.path().join("tiles"), &[]);
    for path in ["/tile/0/0/0/0", "/tile/0/0/0/1"] {
        let reply = served.get(path);
        assert_eq!(reply.status, 500, "{path}");
        assert!(reply.error().contains("expected a"), "{}", reply.error());
    }
    assert_eq!(served.get("/tile/0/0/1/0").status, 200);
}
