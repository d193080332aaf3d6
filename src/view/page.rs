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
const JS: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";

/// All files in `src/view/page`.
const FILES: &[PageFile] = &page_files! {
    "app.js": JS,
    "blocks.js": JS,
    "camera.js": JS,
    "choice.js": JS,
    "colouring.js": JS,
    "colours.js": JS,
    "command.js": JS,
    "director.js": JS,
    "dom.js": JS,
    "format.js": JS,
    "furniture.js": JS,
    "gestures.js": JS,
    "gpu.js": JS,
    "histogram.js": JS,
    "index.html": HTML,
    "info.js": JS,
    "keys.js": JS,
    "link.js": JS,
    "list.js": JS,
    "look.js": JS,
    "main.js": JS,
    "messages.js": JS,
    "picture.js": JS,
    "rim.js": JS,
    "save.js": JS,
    "section.js": JS,
    "server.js": JS,
    "shaders.js": JS,
    "state.js": JS,
    "things.js": JS,
    "top.js": JS,
    "tree.js": JS,
    "vector.js": JS,
    "view.css": CSS,
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
