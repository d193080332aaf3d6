//! The text of an AmiraMesh header: keys in blocks of braces, and the arrays that follow it.

use crate::error::{Error, Result};
use crate::grid::Dims;
use std::path::Path;

/// What a header says.
#[derive(Debug, Default)]
pub(super) struct Header<'a> {
    /// Words behind keys, by the names of the blocks around them: `Parameters/BoundingBox`.
    entries: Vec<(String, Vec<&'a str>)>,
    pub(super) arrays: Vec<Array<'a>>,
}

/// An array: `Lattice { ushort Data } @1`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array<'a> {
    /// What it has an entry for each of: `Lattice`.
    pub(super) of: &'a str,
    pub(super) kind: &'a str,
    /// Numbers of each entry.
    pub(super) components: u32,
    pub(super) name: &'a str,
    /// The number behind the `@` that its entries follow.
    pub(super) mark: u32,
    pub(super) packing: Packing,
}

/// How the entries of an array are packed, and their packed bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Packing {
    None,
    ByteRle(u64),
    Zip(u64),
}

/// A part of the text.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Token<'a> {
    Word(&'a str),
    Open,
    Close,
    /// A line, or a part of it that a comma ends.
    End,
}

/// Splits text to tokens. Comments are left out; words between quotes are one.
fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    for line in text
        .lines()
        .filter(|line| !line.trim_start().starts_with('#'))
    {
        let mut rest = line;
        while let Some(first) = rest.chars().next() {
            let length = match first {
                '{' => {
                    found.push(Token::Open);
                    1
                }
                '}' => {
                    found.push(Token::Close);
                    1
                }
                ',' => {
                    found.push(Token::End);
                    1
                }
                '"' => {
                    let inside = rest[1..].split('"').next().unwrap_or_default();
                    found.push(Token::Word(inside));
                    (inside.len() + 2).min(rest.len())
                }
                c if c.is_whitespace() => c.len_utf8(),
                _ => {
                    let end = rest.find(|c: char| c.is_whitespace() || "{},\"".contains(c));
                    let word = &rest[..end.unwrap_or(rest.len())];
                    found.push(Token::Word(word));
                    word.len()
                }
            };
            rest = &rest[length..];
        }
        found.push(Token::End);
    }
    found
}

impl<'a> Header<'a> {
    pub(super) fn parse(text: &'a str) -> Self {
        let mut header = Header::default();
        let mut blocks: Vec<&str> = Vec::new();
        let mut words: Vec<&str> = Vec::new();
        for token in tokens(text) {
            match token {
                Token::Word(word) => words.push(word),
                Token::Open => blocks.push(words.drain(..).next().unwrap_or_default()),
                Token::End | Token::Close => {
                    if let [key, values @ ..] = &words[..] {
                        let at = [&blocks[..], &[*key]].concat().join("/");
                        header.entries.push((at, values.to_vec()));
                    }
                    words.clear();
                    if token == Token::Close {
                        blocks.pop();
                    }
                }
            }
        }
        header.arrays = text.lines().filter_map(array).collect();
        header
    }

    /// The words behind a key, the first if there are several.
    pub(super) fn get(&self, key: &str) -> Option<&[&'a str]> {
        let found = self.entries.iter().find(|(at, _)| at == key);
        found.map(|(_, words)| &words[..])
    }

    /// The number of voxels along each axis.
    pub(super) fn lattice(&self, path: &Path) -> Result<Dims> {
        let mut all = self.entries.iter().filter(|(at, _)| at == "define");
        let Some((_, words)) = all.find(|(_, words)| words.first() == Some(&"Lattice")) else {
            let what = "an AmiraMesh without a lattice";
            return Err(Error::unsupported(
                path,
                what,
                "give the file of the volume",
            ));
        };
        let shown = || Error::format(path, format!("`define {}`", words.join(" ")), "three sizes");
        let sizes: Option<Vec<u64>> = words[1..].iter().map(|w| w.parse().ok()).collect();
        let sizes: Option<[u64; 3]> = sizes.and_then(|s| s.try_into().ok());
        Dims::new(sizes.ok_or_else(shown)?).map_err(|e| e.of_header(path, "a lattice"))
    }
}

/// The array that a line declares, if it does.
fn array(line: &str) -> Option<Array<'_>> {
    let (of, rest) = line.trim().split_once('{')?;
    let (inside, rest) = rest.split_once('}')?;
    let mut words = inside.split_whitespace();
    let (kind, name) = (words.next()?, words.next()?);
    let (kind, components) = match kind.split_once('[') {
        Some((kind, count)) => (kind, count.trim_end_matches(']').parse().ok()?),
        None => (kind, 1),
    };
    let (mark, packing) = match rest.rsplit_once('@')?.1.split_once('(') {
        Some((mark, packing)) => (mark, packing.trim_end().strip_suffix(')')?),
        None => (rest.rsplit_once('@')?.1, ""),
    };
    let packing = match packing
        .split_once(',')
        .map(|(name, n)| (name.trim(), n.trim().parse().ok()))
    {
        Some(("HxByteRLE", Some(n))) => Packing::ByteRle(n),
        Some(("HxZip", Some(n))) => Packing::Zip(n),
        None if packing.is_empty() => Packing::None,
        _ => return None,
    };
    Some(Array {
        of: of.trim(),
        kind,
        components,
        name,
        mark: mark.trim().parse().ok()?,
        packing,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_in_their_blocks() {
        let text = "# AmiraMesh BINARY 2.1\ndefine Lattice 4 3 2\nParameters {\n  Units { Coordinates \"\u{b5}m\" }\n  \
                    Materials { A { Color 1 0 0, Id 1 } }\n  Note \"a { BoundingBox 1\",\n  BoundingBox 0 1 0 2 -1 \
                    3e0,\n}\nLattice { byte Labels } @1(HxByteRLE,77)\nLattice { float[3] Data } = @2\n";
        let header = Header::parse(text);
        assert_eq!(
            header.get("Parameters/Units/Coordinates"),
            Some(&["\u{b5}m"][..])
        );
        assert_eq!(header.get("Parameters/Materials/A/Id"), Some(&["1"][..]));
        let ends = header.get("Parameters/BoundingBox").unwrap();
        assert_eq!(ends, ["0", "1", "0", "2", "-1", "3e0"]);
        assert_eq!(header.lattice(Path::new("v")).unwrap().0, [4, 3, 2]);
        let [labels, data] = &header.arrays[..] else {
            panic!("{:?}", header.arrays)
        };
        assert_eq!(
            (labels.name, labels.packing, labels.mark),
            ("Labels", Packing::ByteRle(77), 1)
        );
        assert_eq!((data.components, data.kind, data.mark), (3, "float", 2));
        assert_eq!(
            tokens("a\"b"),
            [Token::Word("a"), Token::Word("b"), Token::End]
        );
    }
}
