//! Who may ask: looked at before anything else of a request is.

use super::answer::{Answer, Status};
use super::request::Request;

/// What requests have to be to be answered.
#[derive(Debug, Clone)]
pub struct Rules {
    /// What `Host` may be.
    hosts: Vec<String>,
    /// Origins of other pages that may ask.
    origins: Vec<String>,
}

impl Rules {
    /// Of a server on a port of this machine, that answers pages of these origins as well as its own.
    pub fn new(port: u16, origins: Vec<String>) -> Self {
        let names = ["127.0.0.1", "localhost", "[::1]"];
        let mut hosts: Vec<String> = names.map(|name| format!("{name}:{port}")).into();
        if port == 80 {
            // which browsers leave out
            hosts.extend(names.map(String::from));
        }
        Rules { hosts, origins }
    }

    /// The origin of another page that may ask, if it is one that asks.
    pub fn other_origin<'a>(&self, request: &'a Request) -> Option<&'a str> {
        let origin = std::str::from_utf8(request.one("origin")?).ok()?;
        self.origins.iter().any(|o| o == origin).then_some(origin)
    }

    /// Refuses a request that does not come from the user of this machine: to another name, which a page may have
    /// given this address, or from a page that is not this server's.
    ///
    /// # Errors
    /// The answer.
    pub fn check(&self, request: &Request) -> Result<(), Answer> {
        let host = request.one("host");
        let Some(host) = self.hosts.iter().find(|h| Some(h.as_bytes()) == host) else {
            let found: Vec<_> = request.all("host").map(String::from_utf8_lossy).collect();
            let found = found.join(" and ");
            let message = format!(
                "Host: found `{found}`, expected one of {}: open the address that alvis printed; through a tunnel, \
                 use the same port at both ends",
                self.hosts.join(", ")
            );
            return Err(Answer::error(Status::Forbidden, &message));
        };
        if self.other_origin(request).is_some() {
            return Ok(());
        }
        let own = format!("http://{host}");
        if request.all("origin").any(|origin| origin != own.as_bytes()) {
            let message = format!("Origin: expected {own}: pages of other origins may not ask");
            return Err(Answer::error(Status::Forbidden, &message));
        }
        let other = |site: &[u8]| !matches!(site, b"same-origin" | b"none");
        if request.all("sec-fetch-site").any(other) {
            let message = "Sec-Fetch-Site: expected same-origin or none: type the address, or copy it, into the \
                           browser: pages of other origins may not ask";
            return Err(Answer::error(Status::Forbidden, message));
        }
        Ok(())
    }
}

/// True if a text that was sent is the secret one. Takes as long whatever they have in common.
pub fn same_secret(sent: &[u8], secret: &[u8]) -> bool {
    let differ = |(a, b): (&u8, &u8)| std::hint::black_box(a ^ b);
    let differences = sent.iter().zip(secret).map(differ);
    sent.len() == secret.len() && differences.fold(0, |any, d| std::hint::black_box(any | d)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::request::{Parsed, parse};

    fn allowed(headers: &str) -> bool {
        let text = format!("GET / HTTP/1.1\r\n{headers}\r\n");
        let Parsed::Whole(request, _) = parse(text.as_bytes()) else {
            panic!("{text}");
        };
        let rules = Rules::new(8080, vec!["https://a.example".to_owned()]);
        rules.check(&request).is_ok()
    }

    #[test]
    fn only_the_own_names_and_pages_may_ask() {
        for good in [
            "Host: 127.0.0.1:8080\r\n",
            "Host: localhost:8080\r\n",
            "host: [::1]:8080\r\n",
            "Host: localhost:8080\r\nOrigin: http://localhost:8080\r\nSec-Fetch-Site: same-origin\r\n",
            "Host: localhost:8080\r\nSec-Fetch-Site: none\r\n",
            "Host: localhost:8080\r\nOrigin: https://a.example\r\nSec-Fetch-Site: cross-site\r\n",
        ] {
            assert!(allowed(good), "{good}");
        }
        for bad in [
            "",
            "Host: \r\n",
            "Host: 127.0.0.1\r\n",
            "Host: 127.0.0.1:8081\r\n",
            "Host: 127.0.0.1:80800\r\n",
            "Host: a.example:8080\r\n",
            "Host: localhost:8080.a.example\r\n",
            "Host: LOCALHOST:8080, a\r\n",
            "Host: localhost:8080\r\nHost: localhost:8080\r\n",
            "Host: localhost:8080\r\nHost: a.example\r\n",
            "Host: a.example\r\nOrigin: https://a.example\r\n",
            "Host: localhost:8080\r\nOrigin: http://127.0.0.1:8080\r\n",
            "Host: localhost:8080\r\nOrigin: null\r\n",
            "Host: localhost:8080\r\nOrigin: https://b.example\r\n",
            "Host: localhost:8080\r\nOrigin: https://a.example\r\nOrigin: https://b.example\r\n",
            "Host: localhost:8080\r\nSec-Fetch-Site: cross-site\r\n",
            "Host: localhost:8080\r\nSec-Fetch-Site: same-site\r\n",
        ] {
            assert!(!allowed(bad), "{bad}");
        }
    }

    #[test]
    fn secrets_are_compared_whole() {
        assert!(same_secret(b"abc", b"abc"));
        for other in [&b""[..], b"ab", b"abcd", b"abd", b"Abc"] {
            assert!(!same_secret(other, b"abc"));
        }
    }
}
