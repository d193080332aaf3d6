//! The head of a request, from bytes that anybody may have sent.

use super::answer::Status;

/// Bytes of a request line and its headers at most.
pub const HEAD_BYTES: usize = 8 << 10;
/// Headers at most; browsers send some twenty.
const HEADERS: usize = 64;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The thing.
    Get,
    /// What would be said of it.
    Head,
    /// What a page of another origin may ask for.
    Options,
    /// Anything else.
    Other,
}

/// A request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// What is asked for.
    pub method: Method,
    /// The path as it was sent, from its first `/` on and without the query.
    pub path: String,
    query: String,
    /// Names in small letters, and values.
    headers: Vec<(String, Vec<u8>)>,
    /// True if the client may ask for more on the same connection.
    pub keeps_open: bool,
}

/// What bytes are.
#[derive(Debug, PartialEq, Eq)]
pub enum Parsed {
    /// The beginning of a request.
    Partial,
    /// A request, and the bytes of it.
    Whole(Request, usize),
    /// None that is answered.
    Refused(Status, &'static str),
}

/// Reads the request that bytes begin with.
pub fn parse(bytes: &[u8]) -> Parsed {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut raw = httparse::Request::new(&mut headers);
    let used = match raw.parse(bytes) {
        Ok(httparse::Status::Complete(used)) => used,
        Ok(httparse::Status::Partial) => return Parsed::Partial,
        Err(httparse::Error::TooManyHeaders) => {
            return Parsed::Refused(Status::HeadTooLarge, "too many headers");
        }
        Err(_) => return Parsed::Refused(Status::BadRequest, "this is no HTTP request"),
    };
    let (Some(method), Some(target), Some(version)) = (raw.method, raw.path, raw.version) else {
        return Parsed::Refused(Status::BadRequest, "this is no HTTP request");
    };
    if !target.starts_with('/') {
        return Parsed::Refused(Status::BadRequest, "expected a path that begins with /");
    }
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let headers = raw.headers.iter();
    let headers = headers.map(|h| (h.name.to_ascii_lowercase(), h.value.to_vec()));
    let mut request = Request {
        method: match method {
            "GET" => Method::Get,
            "HEAD" => Method::Head,
            "OPTIONS" => Method::Options,
            _ => Method::Other,
        },
        path: path.to_owned(),
        query: query.to_owned(),
        headers: headers.collect(),
        keeps_open: false,
    };
    // what follows would be read as the next request
    let bodies = request.all("content-length").any(|length| length != b"0");
    if bodies || request.all("transfer-encoding").next().is_some() {
        return Parsed::Refused(Status::BodyTooLarge, "expected a request without a body");
    }
    let closes = |value: &[u8]| value.eq_ignore_ascii_case(b"close");
    request.keeps_open = version == 1 && !request.all("connection").any(closes);
    Parsed::Whole(request, used)
}

impl Request {
    /// The values of all headers of a name in small letters.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a [u8]> {
        let named = self.headers.iter().filter(move |(n, _)| n == name);
        named.map(|(_, value)| &value[..])
    }

    /// The value of a header that there may be once; `None` if there is none, or several.
    pub fn one<'a>(&'a self, name: &'a str) -> Option<&'a [u8]> {
        let mut all = self.all(name);
        all.next().filter(|_| all.next().is_none())
    }

    /// The value of a parameter of the query; of several the first.
    pub fn parameter(&self, name: &str) -> Option<String> {
        let mut all = form_urlencoded::parse(self.query.as_bytes());
        all.find_map(|(n, value)| (n == name).then(|| value.into_owned()))
    }

    /// The parts of the path between its `/`.
    pub fn parts(&self) -> Vec<&str> {
        self.path.split('/').skip(1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn whole(text: &str) -> Request {
        match parse(text.as_bytes()) {
            Parsed::Whole(request, used) if used == text.len() => request,
            other => panic!("{text:?}: {other:?}"),
        }
    }

    #[test]
    fn a_request_is_read() {
        let text =
            "GET /row/cells/3?where=a+%3E%201&x= HTTP/1.1\r\nHost: a\r\nX: 1\r\nx: 2\r\n\r\n";
        let request = whole(text);
        assert_eq!(request.method, Method::Get);
        assert_eq!(request.parts(), ["row", "cells", "3"]);
        assert_eq!(request.parameter("where").as_deref(), Some("a > 1"));
        assert_eq!(request.parameter("x").as_deref(), Some(""));
        assert_eq!(request.parameter("y"), None);
        assert_eq!(request.one("host"), Some(&b"a"[..]));
        assert_eq!(request.one("x"), None);
        assert_eq!(request.all("x").count(), 2);
        assert!(request.keeps_open);
        assert!(!whole("HEAD / HTTP/1.1\r\nConnection: Close\r\n\r\n").keeps_open);
        assert!(!whole("PUT / HTTP/1.0\r\n\r\n").keeps_open);
        assert_eq!(parse(&text.as_bytes()[..text.len() - 1]), Parsed::Partial);
    }

    #[test]
    fn what_is_no_request_is_refused() {
        for (text, status) in [
            ("GET http://a/ HTTP/1.1\r\n\r\n", Status::BadRequest),
            ("GET * HTTP/1.1\r\n\r\n", Status::BadRequest),
            ("GET / HTTP/2.0\r\n\r\n", Status::BadRequest),
            ("GET / HTTP/1.1\r\n folded\r\n\r\n", Status::BadRequest),
            (
                "GET / HTTP/1.1\r\nContent-Length: 4\r\n\r\n",
                Status::BodyTooLarge,
            ),
            (
                "GET / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
                Status::BodyTooLarge,
            ),
            (
                &format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(HEADERS + 1)),
                Status::HeadTooLarge,
            ),
        ] {
            let Parsed::Refused(found, _) = parse(text.as_bytes()) else {
                panic!("{text:?}");
            };
            assert_eq!(found, status, "{text:?}");
        }
    }

    /// Bytes of requests, and others between them.
    fn bytes() -> impl Strategy<Value = Vec<u8>> {
        let word = prop::sample::select(vec![
            "GET ",
            "/",
            "tile/0",
            "?a=%4",
            " HTTP/1.1",
            "\r\n",
            "\n",
            "\r",
            "Host: ",
            "a",
            ":",
            " ",
            "%00",
            "Content-Length: 0",
            "\0",
            "\u{ff}",
        ]);
        let part = prop_oneof![
            4 => word.prop_map(|w| w.as_bytes().to_vec()),
            1 => prop::collection::vec(any::<u8>(), 0..8),
        ];
        prop::collection::vec(part, 0..40).prop_map(|parts| parts.concat())
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in bytes()) {
            if let Parsed::Whole(request, used) = parse(&bytes) {
                prop_assert!(0 < used && used <= bytes.len());
                prop_assert!(request.path.starts_with('/') && !request.path.contains('?'));
                let _ = (request.parts(), request.parameter("a"));
                // what was whole stays so, whatever follows
                let longer = [&bytes[..], b"GET"].concat();
                prop_assert_eq!(parse(&longer), Parsed::Whole(request, used));
            }
        }
    }
}
