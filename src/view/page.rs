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

    fn texts() -> impl Iterator<Item = (&'static str, &'static str)> {
        let text = |file: &PageFile| (file.name, std::str::from_utf8(file.bytes).unwrap());
        FILES.iter().map(text)
    }

    #[test]
    fn all_files_of_the_page_are_in_the_program() {
        let dir = std::fs::read_dir("src/view/page").unwrap();
        let there: BTreeSet<String> = dir
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        let listed: BTreeSet<String> = FILES.iter().map(|f| f.name.to_owned()).collect();
        assert_eq!(there, listed);
        for file in FILES {
            let ending = file.name.rsplit_once('.').unwrap().1;
            let kind = match ending {
                "html" => HTML,
                "js" => JS,
                "css" => CSS,
                other => panic!("{}: {other}", file.name),
            };
            assert_eq!(file.kind, kind, "{}", file.name);
            let answer = super::file(&format!("/{}", file.name));
            assert!(answer.is_some(), "{}", file.name);
        }
        assert!(super::file("/").is_some() && super::file("/../index.html").is_none());
    }

    /// What the answers' Content-Security-Policy would stop, and what would go elsewhere.
    #[test]
    fn the_page_has_nothing_from_elsewhere_and_no_code_in_texts() {
        for (name, text) in texts() {
            for bad in [
                "http://",
                "https://",
                "ws://",
                "wss://",
                "src=\"//",
                "href=\"//",
                "javascript:",
                "eval(",
                "Function(",
                "import(",
                "importScripts",
                "innerHTML",
                "outerHTML",
                "insertAdjacentHTML",
                "document.write",
                "style=\"",
                "<style",
                "@import",
                "sendBeacon",
                "WebSocket",
                "localStorage",
                "document.cookie",
                "serviceWorker",
            ] {
                assert!(!text.contains(bad), "{name} has {bad}");
            }
        }
        let (_, html) = texts().find(|(name, _)| *name == "index.html").unwrap();
        for tag in html.split('<').skip(1) {
            let handler = tag
                .split_whitespace()
                .find(|word| word.starts_with("on") && word.contains('='));
            assert_eq!(handler, None);
        }
        // each script is a file
        let scripts = html.split("<script").skip(1);
        assert!(scripts.clone().count() > 0);
        scripts.for_each(|script| {
            assert!(
                script.contains("src=") && script.contains("></script>"),
                "{script}"
            )
        });
    }

    /// Quoted names behind these words.
    fn named<'a>(text: &'a str, word: &'a str) -> impl Iterator<Item = &'a str> {
        text.split(word).skip(1).filter_map(|rest| {
            let quote = rest
                .trim_start()
                .chars()
                .next()
                .filter(|c| "\"'".contains(*c))?;
            rest.trim_start()[1..].split(quote).next()
        })
    }

    #[test]
    fn what_the_page_names_is_there_and_nothing_else_is() {
        let mut found = BTreeSet::from(["index.html".to_owned()]);
        for (name, text) in texts() {
            let words: &[&str] = match name.rsplit_once('.').unwrap().1 {
                "html" => &["src=", "href="],
                "js" => &["from ", "\nimport "],
                _ => &["url("],
            };
            for path in words.iter().flat_map(|word| named(text, word)) {
                if path.starts_with("data:") {
                    continue;
                }
                let file = path.strip_prefix("./").or(path.strip_prefix('/'));
                let file = file.unwrap_or_else(|| panic!("{name} names {path}"));
                assert!(FILES.iter().any(|f| f.name == file), "{name} names {path}");
                found.insert(file.to_owned());
            }
        }
        let all: BTreeSet<String> = FILES.iter().map(|f| f.name.to_owned()).collect();
        assert_eq!(found, all);
    }
}
