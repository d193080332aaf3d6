//! What is answered, with what pages may do with it.

use std::io::{Read, Result, Write};

/// What every answer says.
///
/// Nothing comes from elsewhere: no script that is not a file of this server, nothing inside the page. What is no
/// script is not taken for one, no page of another origin shows it as a picture or runs it, and where links lead does
/// not learn of the address.
const ALWAYS: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
     img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
     X-Content-Type-Options: nosniff\r\n\
     Cross-Origin-Resource-Policy: same-origin\r\n\
     Cross-Origin-Opener-Policy: same-origin\r\n\
     Referrer-Policy: no-referrer\r\n";

/// How a request ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// 200.
    Ok,
    /// 204: nothing to say.
    NoContent,
    /// 206: a part of it.
    Partial,
    /// 304: what the client has is still right.
    NotModified,
    /// 400.
    BadRequest,
    /// 401: the token is missing or wrong.
    Unauthorized,
    /// 403: who asks is not to.
    Forbidden,
    /// 404.
    NotFound,
    /// 405.
    WrongMethod,
    /// 408: the request took too long.
    Timeout,
    /// 409: the files are others than before.
    Conflict,
    /// 413: a body.
    BodyTooLarge,
    /// 416: no such part.
    WrongRange,
    /// 431: the headers are too long.
    HeadTooLarge,
    /// 500: the files are damaged.
    Failed,
    /// 503: too many connections.
    Busy,
}

impl Status {
    fn line(self) -> &'static str {
        match self {
            Status::Ok => "200 OK",
            Status::NoContent => "204 No Content",
            Status::Partial => "206 Partial Content",
            Status::NotModified => "304 Not Modified",
            Status::BadRequest => "400 Bad Request",
            Status::Unauthorized => "401 Unauthorized",
            Status::Forbidden => "403 Forbidden",
            Status::NotFound => "404 Not Found",
            Status::WrongMethod => "405 Method Not Allowed",
            Status::Timeout => "408 Request Timeout",
            Status::Conflict => "409 Conflict",
            Status::BodyTooLarge => "413 Content Too Large",
            Status::WrongRange => "416 Range Not Satisfiable",
            Status::HeadTooLarge => "431 Request Header Fields Too Large",
            Status::Failed => "500 Internal Server Error",
            Status::Busy => "503 Service Unavailable",
        }
    }

    /// True if the answer has no body, nor a length of one.
    fn is_bare(self) -> bool {
        matches!(self, Status::NoContent | Status::NotModified)
    }
}

/// What an answer carries.
pub enum Body {
    /// Bytes that were made.
    Bytes(Vec<u8>),
    /// Bytes of the program.
    Fixed(&'static [u8]),
    /// So many bytes that are read as they are sent.
    Stream(Box<dyn Read + Send>, u64),
}

impl Body {
    fn length(&self) -> u64 {
        match self {
            Body::Bytes(bytes) => bytes.len() as u64,
            Body::Fixed(bytes) => bytes.len() as u64,
            Body::Stream(_, length) => *length,
        }
    }
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes", self.length())
    }
}

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// How it ended.
    pub status: Status,
    /// More headers.
    headers: Vec<(&'static str, String)>,
    body: Body,
}

/// How an answer is sent.
#[derive(Debug, Clone, Copy)]
pub struct Sending {
    /// Without its body.
    pub head_only: bool,
    /// The connection stays open for the next one.
    pub keeps_open: bool,
}

impl Answer {
    /// What was asked for, of a type as `Content-Type` has it.
    pub fn new(kind: &'static str, body: Body) -> Self {
        Answer {
            status: Status::Ok,
            headers: vec![("Content-Type", kind.to_owned())],
            body,
        }
    }

    /// An answer without a body.
    pub fn bare(status: Status) -> Self {
        Answer {
            status,
            headers: Vec::new(),
            body: Body::Fixed(b""),
        }
    }

    /// JSON that says what is wrong.
    pub fn error(status: Status, message: &str) -> Self {
        let text = serde_json::json!({ "error": message }).to_string();
        let answer = Answer::new("application/json", Body::Bytes(text.into_bytes()));
        let answer = answer.with("Cache-Control", "no-store");
        Answer { status, ..answer }
    }

    /// With one more header. Line ends in a value are left out.
    pub fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        let mut value = value.into();
        value.retain(|c| !c.is_control());
        self.headers.push((name, value));
        self
    }

    /// Sends it.
    ///
    /// # Errors
    /// The system's; the client may have got a part.
    pub fn send(self, out: &mut impl Write, how: Sending) -> Result<()> {
        let mut head = format!("HTTP/1.1 {}\r\n{ALWAYS}", self.status.line());
        for (name, value) in &self.headers {
            head += &format!("{name}: {value}\r\n");
        }
        if !self.status.is_bare() {
            head += &format!("Content-Length: {}\r\n", self.body.length());
        }
        head += if how.keeps_open {
            "\r\n"
        } else {
            "Connection: close\r\n\r\n"
        };
        out.write_all(head.as_bytes())?;
        if how.head_only || self.status.is_bare() {
            return Ok(());
        }
        match self.body {
            Body::Bytes(bytes) => out.write_all(&bytes),
            Body::Fixed(bytes) => out.write_all(bytes),
            Body::Stream(from, length) => {
                let sent = std::io::copy(&mut from.take(length), out)?;
                match sent == length {
                    true => Ok(()),
                    // the length was told already: the connection ends, which tells the client
                    false => Err(std::io::ErrorKind::UnexpectedEof.into()),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(answer: Answer, head_only: bool) -> String {
        let mut out = Vec::new();
        let how = Sending {
            head_only,
            keeps_open: false,
        };
        answer.send(&mut out, how).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn an_answer_is_one_and_no_header_makes_another() {
        let answer = || Answer::new("text/plain", Body::Fixed(b"abc")).with("ETag", "a\r\nX: y");
        let text = sent(answer(), false);
        assert!(text.starts_with("HTTP/1.1 200 OK\r\n"));
        assert!(text.contains("\r\nETag: aX: y\r\n") && text.contains("\r\nContent-Length: 3\r\n"));
        assert!(text.ends_with("\r\n\r\nabc"));
        assert!(sent(answer(), true).ends_with("Connection: close\r\n\r\n"));
        let bare = sent(Answer::bare(Status::NotModified), false);
        assert!(!bare.contains("Content-Length") && bare.contains("nosniff"));
        let error = sent(Answer::error(Status::Failed, "a \"b\"\n"), false);
        assert!(error.ends_with(r#"{"error":"a \"b\"\n"}"#), "{error}");
    }

    #[test]
    fn a_stream_that_ends_early_is_an_error() {
        let answer = Answer::new("text/plain", Body::Stream(Box::new(&b"ab"[..]), 3));
        let how = Sending {
            head_only: false,
            keeps_open: true,
        };
        assert!(answer.send(&mut Vec::new(), how).is_err());
    }
}
