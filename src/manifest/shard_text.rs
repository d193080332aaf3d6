//! The text of a shard, read tile by tile: a parser of JSON that holds one entry of the list at a time.

use super::TileEntry;
use serde::de::DeserializeOwned;
use std::io::BufRead;

/// Why the text of a shard cannot be read on.
#[derive(Debug)]
pub(crate) enum ShardFault {
    /// The system's.
    Io(std::io::Error),
    /// It is no shard.
    Json(String),
}

impl From<std::io::Error> for ShardFault {
    fn from(error: std::io::Error) -> Self {
        ShardFault::Io(error)
    }
}

/// What comes next in a shard's text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    Start,
    /// A tile, the end of the list, or, behind another tile, a comma.
    Tile,
    End,
}

/// Reads the text of a shard, one tile at a time.
#[derive(Debug)]
pub(crate) struct ShardText<R> {
    input: R,
    next: Next,
    /// The value at hand.
    text: Vec<u8>,
    z: Option<u32>,
    /// Tiles so far, once their list has begun.
    tiles: Option<u64>,
}

type Parsed<T> = std::result::Result<T, ShardFault>;

fn json<T>(message: impl Into<String>) -> Parsed<T> {
    Err(ShardFault::Json(message.into()))
}

impl<R: BufRead> ShardText<R> {
    /// From the beginning of its file.
    pub fn new(input: R) -> Self {
        ShardText {
            input,
            next: Next::Start,
            text: Vec::new(),
            z: None,
            tiles: None,
        }
    }

    /// The layer, as soon as the text has told it; at the end it has.
    pub fn z(&self) -> Option<u32> {
        self.z
    }

    /// The input, wherever it is.
    pub fn into_input(self) -> R {
        self.input
    }

    /// The next tile; `None` after the last one, when the text has been read to its end.
    ///
    /// # Errors
    /// [`ShardFault`]; there is nothing to read after that.
    pub fn next_tile(&mut self) -> Parsed<Option<TileEntry>> {
        let found = self.advance();
        if !matches!(found, Ok(Some(_))) {
            self.next = Next::End;
        }
        found
    }

    fn advance(&mut self) -> Parsed<Option<TileEntry>> {
        match self.next {
            Next::End => return Ok(None),
            Next::Start => {
                self.expect(b'{')?;
                if self.peek()? == Some(b'}') {
                    return json("missing field `z`");
                }
                if !self.members()? {
                    return Ok(None);
                }
            }
            Next::Tile => {}
        }
        let tiles = self.tiles.unwrap_or(0);
        match self.peek()? {
            Some(b']') => {
                self.take();
                // what comes behind the list
                return match self.peek()? {
                    Some(b',') => {
                        self.take();
                        self.members()?;
                        Ok(None)
                    }
                    _ => self.end().map(|()| None),
                };
            }
            Some(b',') if tiles > 0 => self.take(),
            Some(_) if tiles == 0 => {}
            Some(_) => return json(format!("expected `,` or `]` behind tile {}", tiles - 1)),
            None => return json("EOF while parsing a list"),
        }
        self.value()?;
        self.tiles = Some(tiles + 1);
        match serde_json::from_slice(&self.text) {
            Ok(tile) => Ok(Some(tile)),
            Err(e) => json(format!("tile {tiles}: {e}")),
        }
    }

    /// Reads members up to the list of tiles, true, or up to the end.
    fn members(&mut self) -> Parsed<bool> {
        loop {
            if self.peek()? != Some(b'"') {
                return json("expected the name of a member");
            }
            self.value()?;
            let name: String = self.parse("the name of a member")?;
            self.expect(b':')?;
            match name.as_str() {
                "tiles" if self.tiles.is_some() => return json("duplicate field `tiles`"),
                "tiles" => {
                    self.expect(b'[')?;
                    (self.tiles, self.next) = (Some(0), Next::Tile);
                    return Ok(true);
                }
                "z" if self.z.is_some() => return json("duplicate field `z`"),
                "z" => {
                    self.value()?;
                    self.z = Some(self.parse("z")?);
                }
                _ => {
                    self.value()?;
                    self.parse::<serde::de::IgnoredAny>(&name)?;
                }
            }
            if self.peek()? != Some(b',') {
                return self.end().map(|()| false);
            }
            self.take();
        }
    }

    /// Reads the end of the object, and nothing may follow.
    fn end(&mut self) -> Parsed<()> {
        self.expect(b'}')?;
        if self.peek()?.is_some() {
            return json("trailing characters");
        }
        match (self.z, self.tiles) {
            (None, _) => json("missing field `z`"),
            (_, None) => json("missing field `tiles`"),
            _ => Ok(()),
        }
    }

    fn parse<T: DeserializeOwned>(&self, what: &str) -> Parsed<T> {
        serde_json::from_slice(&self.text).map_err(|e| ShardFault::Json(format!("{what}: {e}")))
    }

    /// The next byte that is no white space.
    fn peek(&mut self) -> Parsed<Option<u8>> {
        loop {
            let bytes = fill(&mut self.input)?;
            if bytes.is_empty() {
                return Ok(None);
            }
            let blank = |b: &&u8| matches!(b, b' ' | b'\n' | b'\r' | b'\t');
            let blanks = bytes.iter().take_while(blank).count();
            let found = bytes.get(blanks).copied();
            self.input.consume(blanks);
            if found.is_some() {
                return Ok(found);
            }
        }
    }

    /// Goes on behind the byte that was seen.
    fn take(&mut self) {
        self.input.consume(1);
    }

    fn expect(&mut self, wanted: u8) -> Parsed<()> {
        match self.peek()? {
            Some(found) if found == wanted => {
                self.take();
                Ok(())
            }
            Some(_) => json(format!("expected `{}`", char::from(wanted))),
            None => json(format!("EOF where `{}` was expected", char::from(wanted))),
        }
    }

    /// Reads the text of the next value, of which only the brackets are looked at.
    fn value(&mut self) -> Parsed<()> {
        self.text.clear();
        let mut scan = match self.peek()? {
            Some(first) => Scan::new(first),
            None => return json("EOF while parsing a value"),
        };
        loop {
            let bytes = fill(&mut self.input)?;
            if bytes.is_empty() {
                return match scan.is_bare() {
                    true => Ok(()),
                    false => json("EOF while parsing a value"),
                };
            }
            let (used, over) = scan.take(bytes);
            self.text.extend_from_slice(&bytes[..used]);
            self.input.consume(used);
            if over {
                return Ok(());
            }
        }
    }
}

/// What is in the input's buffer, or next in the input; empty at its end.
fn fill(input: &mut impl BufRead) -> std::io::Result<&[u8]> {
    // a borrow that is returned from a loop would last for the others, too
    while let Err(e) = input.fill_buf() {
        if e.kind() != std::io::ErrorKind::Interrupted {
            return Err(e);
        }
    }
    input.fill_buf()
}

/// Finds where a value of JSON ends.
struct Scan {
    /// Brackets that are open.
    depth: u64,
    in_string: bool,
    escaped: bool,
    /// Neither brackets nor quotes: it ends before what cannot be a part of it.
    bare: bool,
}

impl Scan {
    fn new(first: u8) -> Self {
        Scan {
            depth: 0,
            in_string: false,
            escaped: false,
            bare: !matches!(first, b'{' | b'[' | b'"'),
        }
    }

    fn is_bare(&self) -> bool {
        self.bare
    }

    /// How many of these bytes belong to the value, and whether it ends there.
    fn take(&mut self, bytes: &[u8]) -> (usize, bool) {
        if self.bare {
            let ends =
                |b: &u8| matches!(b, b',' | b']' | b'}' | b':' | b' ' | b'\n' | b'\r' | b'\t');
            let end = bytes.iter().position(ends);
            return (end.unwrap_or(bytes.len()), end.is_some());
        }
        for (i, b) in bytes.iter().enumerate() {
            if self.in_string {
                match b {
                    _ if self.escaped => self.escaped = false,
                    b'\\' => self.escaped = true,
                    b'"' => self.in_string = false,
                    _ => continue,
                }
            } else {
                match b {
                    b'"' => self.in_string = true,
                    b'{' | b'[' => self.depth += 1,
                    b'}' | b']' => self.depth = self.depth.saturating_sub(1),
                    _ => continue,
                }
            }
            if self.depth == 0 && !self.in_string {
                return (i + 1, true);
            }
        }
        (bytes.len(), false)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::manifest::{Bounds, Group, Shard, entry_text};
    use proptest::prelude::*;
    use std::io::BufReader;

    /// An entry with a path that brackets and quotes are in.
    pub fn tile(x: u32, pieces: u64) -> TileEntry {
        TileEntry {
            path: format!("tiles/z0000/y0000_x{x:04}.glb \"]}}\\"),
            grid: [x, 0, 0],
            bounds: Bounds {
                min: [0.0, 0.5, 1.0],
                max: [1e-9, 2.0, 3.25],
            },
            vertices: 3,
            triangles: 1,
            strips: 1,
            indices: 3,
            bytes: 1000,
            checksum: "crc32:00000000".into(),
            groups: (0..pieces)
                .map(|cell| Group {
                    cell,
                    object: 1,
                    surface: cell,
                    vertices: 3,
                    triangles: 1,
                })
                .collect(),
        }
    }

    /// What is read of a text, with a buffer of so many bytes.
    fn read(text: &[u8], buffer: usize) -> std::result::Result<Shard, String> {
        let mut parser = ShardText::new(BufReader::with_capacity(buffer, text));
        let mut tiles = Vec::new();
        loop {
            match parser.next_tile() {
                Ok(Some(tile)) => tiles.push(tile),
                Ok(None) => break,
                Err(ShardFault::Json(e)) => return Err(e),
                Err(ShardFault::Io(e)) => panic!("{e}"),
            }
        }
        let z = parser.z().expect("it is known at the end");
        Ok(Shard { z, tiles })
    }

    /// Texts that are shards, and others, are taken and refused as a parser of all of it does.
    #[test]
    fn texts_are_taken_as_a_whole_parser_takes_them() {
        let entry = String::from_utf8(entry_text(&tile(1, 2))).unwrap();
        let good = format!("{{\"z\":3,\"tiles\":[{entry},{entry}]}}");
        let mut texts = vec![
            good.clone(),
            format!(
                " {{ \"tiles\" :\n[ {entry} ,\t{entry} ] , \"more\": [1, {{\"a\": \"]\"}}], \"z\" : 3 }} \n"
            ),
            "{\"z\":3,\"tiles\":[]}".into(),
            "{\"\\u007a\":3,\"tiles\":[]}".into(),
        ];
        let accepted = texts.len();
        for bad in [
            "",
            " ",
            "{",
            "{}",
            "[]",
            "3",
            "{\"z\":3}",
            "{\"tiles\":[]}",
            "{\"z\":3,\"tiles\":[],}",
            "{\"z\":3,\"z\":3,\"tiles\":[]}",
            "{\"z\":3,\"tiles\":[],\"tiles\":[]}",
            "{\"z\":-3,\"tiles\":[]}",
            "{\"z\":3,\"tiles\":{}}",
            "{\"z\":3,\"tiles\":[]}x",
            "{\"z\":3,\"tiles\":[}",
            "{\"z\":3 \"tiles\":[]}",
            "{\"z\":3,\"tiles\":[1]}",
            "{\"z\":3,\"tiles\":[{}]}",
            "{z:3,\"tiles\":[]}",
            "{\"z\":3,\"tiles\":[,]}",
            "{\"z\":3,\"tiles\":[],\"a\":}",
            "{\"z\":3,\"tiles\":[],\"a\":[1}}",
            "{\"z\":3,\"tiles\":[],\"a\":tru}",
            "{\"z\":3,,\"tiles\":[]}",
            "{\"z\":03,\"tiles\":[]}",
            "{\"z\":3,\"tiles\":[]]",
            "{\"z\":3,\"tiles\":null}",
        ] {
            texts.push(bad.into());
        }
        texts.push(good.replace("},{", "}{"));
        texts.push(good.replace("},{", "},,{"));
        texts.push(good.replace("}]}", "},]}"));
        texts.extend((0..good.len()).map(|n| good[..n].to_string()));
        for (i, text) in texts.iter().enumerate() {
            let whole = serde_json::from_str::<Shard>(text);
            assert_eq!(whole.is_ok(), i < accepted, "{text}");
            for buffer in [1, 7, 1 << 16] {
                let found = read(text.as_bytes(), buffer);
                assert_eq!(
                    found.as_ref().ok(),
                    whole.as_ref().ok(),
                    "{text}: {found:?}"
                );
            }
        }
    }

    proptest! {
        /// As a parser of all of it, whichever byte is another.
        #[test]
        fn damage_is_seen(at in 0..10_000usize, byte in prop::sample::select(&b"{}[],:\"\\ 0az\n-."[..])) {
            let shard = Shard { z: 3, tiles: vec![tile(0, 1), tile(1, 2)] };
            let mut text = serde_json::to_vec(&shard).unwrap();
            let at = at % text.len();
            text[at] = byte;
            let whole = serde_json::from_slice::<Shard>(&text).ok();
            prop_assert_eq!(read(&text, 64).ok(), whole);
        }
    }
}
