//! What a store's answers are called in messages: in short, and without what is secret.

use std::io::{Error, ErrorKind};

/// Why a request has not been answered as it should.
#[derive(Debug)]
pub(super) enum Fault {
    Store(object_store::Error),
    /// An answer of so many bytes.
    Length {
        found: u64,
        expected: u64,
    },
    /// Another object is at the key than before.
    Changed,
}

impl From<object_store::Error> for Fault {
    fn from(error: object_store::Error) -> Self {
        match error {
            object_store::Error::Precondition { .. } => Fault::Changed,
            other => Fault::Store(other),
        }
    }
}

impl Fault {
    /// True for what may be another time when it is asked for again: overload, a connection that broke, a short answer.
    pub fn may_pass(&self) -> bool {
        match self {
            Fault::Length { .. } => true,
            Fault::Changed => false,
            Fault::Store(error @ object_store::Error::Generic { .. }) => {
                match status(&error.to_string()) {
                    Some(status) => status >= 500 || [408, 409, 429].contains(&status),
                    None => true,
                }
            }
            Fault::Store(_) => false,
        }
    }
}

/// The error of a request for `asked` that was made so many times; `secrets` do not stand in it.
pub(super) fn error(fault: &Fault, asked: &str, tries: u32, secrets: &[String]) -> Error {
    use object_store::Error as Store;
    let kind = match fault {
        Fault::Store(Store::NotFound { .. }) => ErrorKind::NotFound,
        Fault::Store(Store::AlreadyExists { .. }) => ErrorKind::AlreadyExists,
        Fault::Store(Store::PermissionDenied { .. } | Store::Unauthenticated { .. }) => {
            ErrorKind::PermissionDenied
        }
        _ => ErrorKind::Other,
    };
    let what = match fault {
        Fault::Length { found, expected } => format!("found {found} bytes, expected {expected}"),
        Fault::Changed => "another object was put in its place while it was read".to_owned(),
        Fault::Store(error) => answer(error),
    };
    let times = match tries {
        1 => String::new(),
        _ => format!(", {tries} times"),
    };
    let mut text = format!("asked for {asked}{times}: {what}");
    for secret in secrets.iter().filter(|s| !s.is_empty()) {
        text = text.replace(secret, "***");
    }
    if secrets.is_empty() && !matches!(kind, ErrorKind::NotFound | ErrorKind::AlreadyExists) {
        text += " (no credentials were found: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, or for \
                 what is public AWS_SKIP_SIGNATURE=true)";
    }
    Error::new(kind, text)
}

/// What a store answered: the status, and of a body in XML, which may repeat the request with its key and signature, no
/// more than its code and message; of a connection why there is none.
fn answer(error: &object_store::Error) -> String {
    let text = error.to_string();
    let parts: Vec<String> = ["Code", "Message"]
        .iter()
        .filter_map(|tag| inside(&text, tag))
        .collect();
    if let Some(status) = status(&text) {
        return match parts.is_empty() {
            true => format!("the answer {status}"),
            false => format!("the answer {status}, {}", parts.join(": ")),
        };
    }
    // the innermost reason, which names no address
    let mut reason: &dyn std::error::Error = error;
    while let Some(inner) = reason.source() {
        reason = inner;
    }
    let reason = reason.to_string();
    reason
        .split('<')
        .next()
        .unwrap_or_default()
        .trim()
        .to_owned()
}

/// The status of HTTP in the text of an error.
fn status(text: &str) -> Option<u16> {
    let (_, rest) = text.split_once("status code: ")?;
    rest.get(..3)?.parse().ok()
}

/// What stands in an element of XML.
fn inside(text: &str, tag: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("<{tag}>"))?;
    let (inside, _) = rest.split_once(&format!("</{tag}>"))?;
    Some(inside.chars().take(200).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generic(text: &str) -> Fault {
        Fault::Store(object_store::Error::Generic {
            store: "S3",
            source: text.to_owned().into(),
        })
    }

    #[test]
    fn what_is_asked_for_again() {
        let status = |n: u16| generic(&format!("non-2xx status code: {n} Some Words: <Error/>"));
        for (n, expected) in [
            (500, true),
            (503, true),
            (429, true),
            (409, true),
            (400, false),
            (403, false),
            (301, false),
        ] {
            assert_eq!(status(n).may_pass(), expected, "{n}");
        }
        assert!(generic("connection reset by peer").may_pass());
        assert!(
            Fault::Length {
                found: 4,
                expected: 8
            }
            .may_pass()
        );
        assert!(!Fault::Changed.may_pass());
    }

    #[test]
    fn secrets_and_signatures_are_not_told() {
        let fault = generic(
            "Server returned non-2xx status code: 403 Forbidden: <?xml?><Error><Code>SignatureDoesNotMatch</Code>\
             <Message>No match for AKIAKEY</Message><AWSAccessKeyId>AKIAKEY</AWSAccessKeyId>\
             <SignatureProvided>0123abcd</SignatureProvided></Error>",
        );
        let text = error(
            &fault,
            "bytes 0 to 8",
            1,
            &["AKIAKEY".into(), "hidden".into()],
        )
        .to_string();
        assert_eq!(
            text,
            "asked for bytes 0 to 8: the answer 403, SignatureDoesNotMatch: No match for ***"
        );
        let short = Fault::Length {
            found: 4,
            expected: 8,
        };
        assert_eq!(
            error(&short, "bytes 8 to 16", 8, &["x".repeat(9)]).to_string(),
            "asked for bytes 8 to 16, 8 times: found 4 bytes, expected 8"
        );
    }
}
