//! The page, which the program carries.

use crate::http::{Answer, Body};

/// A file of the page.
struct PageFile {
    name: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
}

macro_rules! page_files {
    ($($name:literal: $kind:expr),* $(,)?) => {
        [$(PageFile {
            name: $name,
            kind: $kind,
            bytes: include_bytes!(concat!("page/", $name)),
        }),*]
    };
}

const HTML: &str = "text/html; charset=utf-8";

/// All files in `src/view/page`.
const FILES: &[PageFile] = &page_files! {
    "index.html": HTML,
};

/// The file of the page at a path; the page itself is at `/`.
pub fn file(path: &str) -> Option<Answer> {
    let name = match path.strip_prefix('/')? {
        "" => "index.html",
        name => name,
    };
    let file = FILES.iter().find(|file| file.name == name)?;
    // another version of the program may be at the same address
    Some(Answer::new(file.kind, Body::Fixed(file.bytes)).with("Cache-Control", "no-store"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn all_files_of_the_page_are_in_the_program() {
        let dir = std::fs::read_dir("src/view/page").unwrap();
        let there: BTreeSet<String> = dir
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        let listed: BTreeSet<String> = FILES.iter().map(|f| f.name.to_owned()).collect();
        assert_eq!(there, listed);
        for file in FILES {
            let kind = file.name.rsplit_once('.').unwrap().1;
            assert!(
                matches!(
                    (kind, file.kind.split(';').next().unwrap()),
                    ("html", "text/html") | ("js", "text/javascript") | ("css", "text/css")
                ),
                "{}",
                file.name
            );
        }
    }
}
