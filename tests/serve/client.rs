//! A server that runs, and bytes to it and back.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

/// A command that serves; it is killed when the test ends.
pub struct Served {
    child: Child,
    pub port: u16,
    /// Nothing for `alvis serve`.
    pub token: String,
}

/// An answer.
#[derive(Debug)]
pub struct Reply {
    pub status: u16,
    /// With names in small letters.
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Reply {
    pub fn header(&self, name: &str) -> Option<&str> {
        let found = self.headers.iter().find(|(n, _)| n == name);
        found.map(|(_, value)| &value[..])
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    /// The beginning of what it says, for messages.
    pub fn text(&self) -> String {
        let some = &self.body[..self.body.len().min(300)];
        String::from_utf8_lossy(some).into_owned()
    }

    /// The message of an error.
    pub fn error(&self) -> String {
        assert_eq!(
            self.header("content-type"),
            Some("application/json"),
            "{}",
            self.text()
        );
        self.json()["error"].as_str().unwrap().to_owned()
    }

    /// Numbers of 32 bits.
    pub fn words(&self) -> Vec<u32> {
        let (words, rest) = self.body.as_chunks::<4>();
        assert!(rest.is_empty());
        words.iter().map(|w| u32::from_le_bytes(*w)).collect()
    }
}

/// Starts `alvis view DIR` without a browser.
pub fn view(dir: &Path, more: &[&str]) -> Served {
    let args = [&["view", "--no-open", "--quiet", "."], more].concat();
    Served::start(dir, &args)
}

impl Served {
    /// Runs a command in a directory that prints its address.
    pub fn start(dir: &Path, args: &[&str]) -> Served {
        let mut child = Command::new(env!("CARGO_BIN_EXE_alvis"))
            .args(args)
            .current_dir(dir)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let address = lines.next().expect("an address").unwrap();
        let rest = address.strip_prefix("http://127.0.0.1:").unwrap();
        let (port, rest) = rest.split_once('/').unwrap();
        Served {
            child,
            port: port.parse().unwrap(),
            token: rest.trim_start_matches('#').to_owned(),
        }
    }

    /// Interrupts it as Ctrl-C does.
    pub fn interrupt(mut self) -> ExitStatus {
        let pid = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        self.child.wait().unwrap()
    }

    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        stream
    }

    /// Sends bytes and reads what comes until the server closes.
    pub fn send(&self, bytes: &[u8]) -> Option<Reply> {
        let mut stream = self.connect();
        // a server that refuses may close before all is sent
        let _ = stream.write_all(bytes);
        let mut all = Vec::new();
        let _ = stream.read_to_end(&mut all);
        reply(&all)
    }

    /// A request with these lines behind the first one.
    pub fn ask(&self, method: &str, path: &str, lines: &str) -> Reply {
        let text = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n{lines}\r\n");
        self.send(text.as_bytes())
            .unwrap_or_else(|| panic!("no answer to {text}"))
    }

    pub fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}\r\n", self.port)
    }

    /// The lines that the page sends.
    pub fn lines(&self) -> String {
        format!("{}Authorization: Bearer {}\r\n", self.host(), self.token)
    }

    /// What the page gets.
    pub fn get(&self, path: &str) -> Reply {
        self.ask("GET", path, &self.lines())
    }

    pub fn json(&self, path: &str) -> Value {
        let reply = self.get(path);
        assert_eq!(reply.status, 200, "{path}: {}", reply.text());
        assert_eq!(reply.header("content-type"), Some("application/json"));
        reply.json()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Takes an answer apart.
fn reply(bytes: &[u8]) -> Option<Reply> {
    let end = bytes.windows(4).position(|w| w == b"\r\n\r\n")?;
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut lines = head.split("\r\n");
    let status = lines.next()?.strip_prefix("HTTP/1.1 ")?[..3]
        .parse()
        .unwrap();
    let header = |line: &str| {
        let (name, value) = line.split_once(": ").unwrap();
        (name.to_ascii_lowercase(), value.to_owned())
    };
    Some(Reply {
        status,
        headers: lines.map(header).collect(),
        body: bytes[end + 4..].to_vec(),
    })
}

/// Percent-encodes what queries may not have as it is.
pub fn encoded(text: &str) -> String {
    text.bytes().map(|b| format!("%{b:02X}")).collect()
}
