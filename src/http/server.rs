//! Sockets and threads.

use super::answer::{Answer, Sending, Status};
use super::request::{HEAD_BYTES, Method, Parsed, Request, parse};
use super::rules::Rules;
use crate::error::{Error, Result};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Connections at once; browsers make six.
pub const CONNECTIONS: usize = 64;
/// In which the head of a request has to come.
const HEAD_TIME: Duration = Duration::from_secs(2);
/// How long a connection waits for its next request.
const IDLE_TIME: Duration = Duration::from_secs(15);
/// How long a client may take nothing of an answer.
const SEND_TIME: Duration = Duration::from_secs(30);
/// How long the rest of what a refused client sends is thrown away, so that it reads the answer.
const LINGER_TIME: Duration = Duration::from_millis(200);
/// How often somebody looks whether to stop.
const STOP_TIME: Duration = Duration::from_millis(50);

/// Who answers.
pub trait Handler: Send + Sync + 'static {
    /// The answer to a request that the rules allow.
    fn answer(&self, request: &Request, client: &Client) -> Answer;
}

/// Who waits for an answer.
#[derive(Debug)]
pub struct Client<'a>(&'a TcpStream);

impl Client<'_> {
    /// True if nobody waits any more: the page asks for something else, or is closed.
    pub fn is_gone(&self) -> bool {
        if self.0.set_nonblocking(true).is_err() {
            return true;
        }
        let next = self.0.peek(&mut [0]);
        let blocks = self.0.set_nonblocking(false);
        match next {
            Ok(bytes) => bytes == 0 || blocks.is_err(),
            Err(e) => e.kind() != ErrorKind::WouldBlock || blocks.is_err(),
        }
    }
}

/// A server that listens on this machine's own addresses alone.
#[derive(Debug)]
pub struct Server {
    listeners: Vec<TcpListener>,
    port: u16,
}

impl Server {
    /// Listens on a port of 127.0.0.1, and on that of ::1 where it can be had; 0 is one that is free.
    ///
    /// # Errors
    /// [`Error::Usage`] for `--port` if it is in use or not for this user.
    pub fn bind(port: u16) -> Result<Self> {
        let refused = |e: std::io::Error| {
            let found = match e.kind() {
                ErrorKind::AddrInUse => format!("{port}, which another program listens on"),
                _ => format!("{port}, which cannot be listened on ({e})"),
            };
            Error::usage("--port", found, "a port that is free")
                .with_hint("give another one, or none: then a free one is taken")
        };
        let first = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        let port = first.local_addr().map_err(refused)?.port();
        let second = TcpListener::bind((Ipv6Addr::LOCALHOST, port));
        let listeners = std::iter::once(first).chain(second).collect();
        Ok(Server { listeners, port })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Where it is: `http://127.0.0.1:8080`.
    pub fn address(&self) -> String {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, self.port));
        format!("http://{address}")
    }

    /// Answers until `stop` returns true. Threads that are still sending then end with the process.
    ///
    /// # Errors
    /// [`Error::Io`] if a thread cannot be started.
    pub fn run(self, rules: Rules, handler: impl Handler, stop: impl Fn() -> bool) -> Result<()> {
        let shared = Arc::new(Shared {
            rules,
            handler,
            open: AtomicUsize::new(0),
        });
        for listener in self.listeners {
            let shared = Arc::clone(&shared);
            spawn(move || shared.accept(&listener))
                .map_err(|e| Error::io("the server", "start a thread", e))?;
        }
        while !stop() {
            std::thread::sleep(STOP_TIME);
        }
        Ok(())
    }
}

fn spawn(work: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    std::thread::Builder::new()
        .name("http".to_owned())
        .spawn(work)
        .map(drop)
}

struct Shared<H> {
    rules: Rules,
    handler: H,
    /// Connections that are open.
    open: AtomicUsize,
}

/// A connection among those that are counted.
struct Counted<H>(Arc<Shared<H>>);

impl<H> Drop for Counted<H> {
    fn drop(&mut self) {
        self.0.open.fetch_sub(1, Ordering::AcqRel);
    }
}

impl<H: Handler> Shared<H> {
    fn accept(self: Arc<Self>, listener: &TcpListener) {
        loop {
            let Ok((stream, _)) = listener.accept() else {
                // out of files, or gone again
                std::thread::sleep(STOP_TIME);
                continue;
            };
            let before = self.open.fetch_add(1, Ordering::AcqRel);
            let counted = Counted(Arc::clone(&self));
            let mut connection = Connection {
                stream,
                unread: Vec::new(),
            };
            if before >= CONNECTIONS {
                let message = format!("{CONNECTIONS} connections are open already");
                let answer = Answer::error(Status::Busy, &message);
                // what was sent is not read, so the answer may be lost, but nobody waits for it here
                let _ = connection.stream.set_nonblocking(true);
                let _ = connection.send(answer, Sending::LAST);
                continue;
            }
            // where there is no thread for it, the connection closes
            let _ = spawn(move || {
                let counted = counted;
                counted.0.converse(&mut connection);
            });
        }
    }

    /// Answers what comes on a connection.
    fn converse(&self, connection: &mut Connection) {
        if connection.prepare().is_err() {
            return;
        }
        let mut patience = HEAD_TIME;
        loop {
            let request = match connection.request(patience) {
                Ok(request) => request,
                Err(None) => return,
                Err(Some((status, message))) => {
                    let answer = Answer::error(status, message);
                    if connection.send(answer, Sending::LAST).is_ok() {
                        connection.linger();
                    }
                    return;
                }
            };
            let answer = match self.rules.check(&request) {
                Ok(()) => self.handler.answer(&request, &Client(&connection.stream)),
                Err(answer) => answer,
            };
            let how = Sending {
                head_only: request.method == Method::Head,
                keeps_open: request.keeps_open,
            };
            if connection.send(answer, how).is_err() || !how.keeps_open {
                return;
            }
            patience = IDLE_TIME;
        }
    }
}

impl Sending {
    /// A whole answer, after which the connection closes.
    const LAST: Sending = Sending {
        head_only: false,
        keeps_open: false,
    };
}

struct Connection {
    stream: TcpStream,
    /// Bytes that came and were not looked at.
    unread: Vec<u8>,
}

/// Why there is no request: what to answer, or nothing if the client is gone.
type NoRequest = Option<(Status, &'static str)>;

impl Connection {
    fn prepare(&self) -> std::io::Result<()> {
        self.stream.set_nodelay(true)?;
        self.stream.set_write_timeout(Some(SEND_TIME))
    }

    /// The next request, which begins within `patience`, and is whole [`HEAD_TIME`] later.
    fn request(&mut self, patience: Duration) -> Result<Request, NoRequest> {
        let begun = !self.unread.is_empty();
        let patience = if begun { HEAD_TIME } else { patience };
        let mut deadline = Instant::now() + patience;
        loop {
            match parse(&self.unread) {
                Parsed::Whole(request, used) => {
                    self.unread.drain(..used);
                    return Ok(request);
                }
                Parsed::Refused(status, message) => return Err(Some((status, message))),
                Parsed::Partial => {}
            }
            if self.unread.len() >= HEAD_BYTES {
                let message = "the request line and the headers are longer than 8 KiB";
                return Err(Some((Status::HeadTooLarge, message)));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let message = "the request took longer than 2 seconds";
                let begun = !self.unread.is_empty();
                return Err(begun.then_some((Status::Timeout, message)));
            }
            let was_empty = self.unread.is_empty();
            if self.receive(left).map_err(|_| None)? && was_empty {
                deadline = Instant::now() + HEAD_TIME;
            }
        }
    }

    /// Takes what comes within a time; false if nothing did.
    ///
    /// # Errors
    /// The system's, and one if the client has closed.
    fn receive(&mut self, within: Duration) -> std::io::Result<bool> {
        let mut some = [0; HEAD_BYTES];
        let room = HEAD_BYTES - self.unread.len().min(HEAD_BYTES);
        self.stream.set_read_timeout(Some(within))?;
        match self.stream.read(&mut some[..room]) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                self.unread.extend_from_slice(&some[..n]);
                Ok(true)
            }
            Err(e) if e.kind() == ErrorKind::Interrupted => Ok(false),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(false),
            Err(e) => Err(e),
        }
    }

    fn send(&mut self, answer: Answer, how: Sending) -> std::io::Result<()> {
        answer.send(&mut self.stream, how)?;
        self.stream.flush()
    }

    /// Throws away what a refused client still sends: closing on it would take the answer back.
    fn linger(&mut self) {
        let end = Instant::now() + LINGER_TIME;
        let _ = self.stream.shutdown(Shutdown::Write);
        self.unread.clear();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() || self.receive(left).is_err() {
                return;
            }
            self.unread.clear();
        }
    }
}
