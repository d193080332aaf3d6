//! What the page asks for, and where it comes from.
//!
//! Nothing that a client sends becomes the name of a file: tiles are looked up by numbers among those of the index,
//! tables by three names.

use super::mesh::Frame;
use super::nodes::NodeLookup;
use super::page;
use super::rows::{self, Asked};
use super::set::{self, Told};
use super::slice::{SlicePicture, Slices, Wanted};
use crate::error::{Error, Result};
use crate::http::{Answer, Body, Client, Handler, Method, Request, Status, Turns, same_secret};
use crate::manifest::{MANIFEST, Manifest, manifest_file};
use crate::preview::Axis;
use crate::store::{is_remote, stamps};
use crate::table::Table;
use crate::tileset::{TileLookup, TileSet};
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::thread::available_parallelism;

/// Answers that are made at once at most: each may hold a tile. With more than there are processors the first tile that a
/// page asks for would be made as late as the others.
const AT_ONCE: usize = 4;
/// Raised when what is sent of a tile changes.
const MESH_VERSION: u32 = 1;
const BINARY: &str = "application/octet-stream";
const JSON: &str = "application/json";

/// A tile set that is looked at.
#[derive(Debug)]
pub struct Shown {
    /// The tile set.
    pub set: TileSet,
    /// What the page is told of it.
    pub told: Told,
    /// The volume, if it is still there.
    pub slices: Option<Slices>,
}

/// Answers the page.
#[derive(Debug)]
pub struct Viewer {
    shown: Shown,
    lookup: TileLookup,
    nodes: NodeLookup,
    tree: Vec<u8>,
    frame: Frame,
    token: String,
    turns: Turns,
    slice_turns: Turns,
    index: IndexState,
}

/// 128 random bits as 32 digits.
///
/// # Errors
/// [`Error::Io`] if the system has none.
pub fn token() -> Result<String> {
    let mut bits = [0; 16];
    getrandom::fill(&mut bits).map_err(|e| Error::io("the system", "get random bits", e.into()))?;
    Ok(bits.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// What shows that the index is another one than before.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct IndexState {
    file: [u64; 2],
    bytes: u64,
    written: [i64; 2],
    /// The ETag of an object in a bucket.
    object: String,
}

impl IndexState {
    fn of(dir: &Path) -> Result<Self> {
        let path = manifest_file(dir, "read the index")?;
        if is_remote(&path) {
            let objects = stamps(&path).map_err(|e| Error::io(&path, "look at the index", e))?;
            return Ok(IndexState {
                object: objects.into_iter().map(|object| object.etag).collect(),
                ..IndexState::default()
            });
        }
        let meta = path
            .metadata()
            .map_err(|e| Error::io(&path, "look at the index", e))?;
        Ok(Self::from(&meta))
    }
}

impl From<&Metadata> for IndexState {
    fn from(meta: &Metadata) -> Self {
        IndexState {
            file: [meta.dev(), meta.ino()],
            bytes: meta.len(),
            written: [meta.mtime(), meta.mtime_nsec()],
            object: String::new(),
        }
    }
}

/// A file of the set as an index states it, and how its mesh is sent.
struct WantedFile<'a> {
    path: String,
    bytes: u64,
    checksum: String,
    frame: &'a Frame,
}

/// What answers that are made return where something is wrong.
type Made = Result<Answer, Answer>;

fn missing(what: impl std::fmt::Display) -> Answer {
    Answer::error(Status::NotFound, &format!("there is no {what}"))
}

impl Viewer {
    /// Reads the index; who has the token may ask.
    ///
    /// # Errors
    /// Those of [`TileLookup::read`], [`NodeLookup::read`] and [`NodeLookup::tree`]; [`Error::Format`] if the tile set was
    /// changed since it was opened.
    pub fn new(shown: Shown, token: String) -> Result<Self> {
        let dir = shown.set.dir();
        let index = IndexState::of(dir)?;
        if Manifest::open(dir)? != *shown.set.manifest() {
            let found = "another index than a moment ago";
            return Err(Error::format(dir.join(MANIFEST), found, "one that stays")
                .with_hint("wait until whoever writes there is done"));
        }
        let lookup = TileLookup::read(&shown.set)?;
        let nodes = NodeLookup::read(&shown.set)?;
        let frame = Frame::of(shown.set.manifest());
        Ok(Viewer {
            tree: nodes.tree(&shown.set, &lookup, &frame)?,
            lookup,
            nodes,
            frame,
            shown,
            token,
            turns: Turns::new(available_parallelism().map_or(2, |n| n.get().clamp(2, AT_ONCE))),
            slice_turns: Turns::new(1),
            index,
        })
    }

    fn may_ask(&self, request: &Request) -> bool {
        let sent = request.one("authorization");
        let sent = sent.and_then(|value| value.strip_prefix(b"Bearer "));
        sent.is_some_and(|sent| same_secret(sent, self.token.as_bytes()))
    }

    /// The data at a path.
    fn data(&self, request: &Request, client: &Client) -> Made {
        let set = &self.shown.set;
        if IndexState::of(set.dir()).ok().as_ref() != Some(&self.index) {
            let message = format!(
                "{}: the tile set was changed or removed while it was shown: end `alvis view` and start it again",
                set.dir().join(MANIFEST).display()
            );
            return Err(Answer::error(Status::Conflict, &message));
        }
        let is_needed = || !client.is_gone();
        if let ["slice", axis, file] = request.parts()[..] {
            // slices of some volumes take long, and tiles are not to wait for them
            let _turn = self.slice_turns.take(is_needed).ok_or(Error::Interrupted)?;
            return self.slice(request, [axis, file], &is_needed);
        }
        let _turn = self.turns.take(is_needed).ok_or(Error::Interrupted)?;
        match request.parts()[..] {
            ["set.json"] => {
                let description = set::description(set, &self.nodes, &self.shown.told)?;
                Ok(bytes(JSON, description.to_string().into_bytes()))
            }
            ["tree.bin"] => Ok(bytes(BINARY, self.tree.clone())),
            ["tile", level, z, y, x] => self.tile(request, [level, z, y, x]),
            ["table", name] => self.table(request, table(name)?),
            ["row", name, id] => {
                let table = table(name)?;
                let id = id.parse().map_err(|_| missing(format!("row {id}")))?;
                let row = rows::row(set, table, id)?;
                let row = row.ok_or_else(|| missing(format!("row {id} in the table of {name}")))?;
                Ok(bytes(JSON, row.to_string().into_bytes()))
            }
            ["query", name] => {
                let [condition, sort] = ["where", "sort"].map(|name| request.parameter(name));
                let given =
                    |text: &Option<String>| text.as_ref().is_some_and(|t| !t.trim().is_empty());
                let asked = Asked {
                    condition: condition.as_deref().filter(|_| given(&condition)),
                    sort: sort.as_deref().filter(|_| given(&sort)),
                    descending: request.parameter("descending").is_some_and(|v| v == "1"),
                };
                Ok(bytes(BINARY, rows::query(set, table(name)?, &asked)?))
            }
            _ => Err(missing(format!("{} here", request.path))),
        }
    }

    fn tile(&self, request: &Request, numbers: [&str; 4]) -> Made {
        let there_is_none = || missing(format!("tile {}", numbers.join("/")));
        let parsed = numbers.map(|n| n.parse::<u32>());
        let [Ok(level), Ok(z), Ok(y), Ok(x)] = parsed else {
            return Err(there_is_none());
        };
        let wanted = self.wanted(level, [x, y, z]).ok_or_else(there_is_none)?;
        let tag = format!("\"{}-{MESH_VERSION}\"", wanted.checksum);
        if has(request, &tag) {
            return Ok(Answer::bare(Status::NotModified).with("ETag", tag));
        }
        let (set, path) = (&self.shown.set, &wanted.path);
        let file = set.checked_bytes(path, wanted.bytes, &wanted.checksum)?;
        let mesh = wanted.frame.mesh([x, y, z], &file);
        let mesh = mesh.map_err(|e| Error::format(set.dir().join(path), e, "a tile"))?;
        Ok(bytes(BINARY, mesh).with("ETag", tag))
    }

    /// The file of a tile, or of a node of a level from 1 on.
    fn wanted(&self, level: u32, grid: [u32; 3]) -> Option<WantedFile<'_>> {
        if level == 0 {
            let tile = self.lookup.get(grid)?;
            return Some(WantedFile {
                path: self.lookup.path(tile),
                bytes: tile.bytes,
                checksum: tile.checksum(),
                frame: &self.frame,
            });
        }
        let (node, frame) = self.nodes.get(level, grid)?;
        Some(WantedFile {
            path: node.path.clone(),
            bytes: node.bytes,
            checksum: node.checksum.clone(),
            frame,
        })
    }

    fn table(&self, request: &Request, table: Table) -> Made {
        let names = request.parameter("columns").unwrap_or_default();
        let names: Vec<&str> = names.split(',').filter(|name| !name.is_empty()).collect();
        let columns = rows::columns(&self.shown.set, table, &names)?;
        let body = Body::Stream(Box::new(columns.file), columns.length);
        Ok(Answer::new(BINARY, body).with("Cache-Control", "no-store"))
    }

    fn slice(
        &self,
        request: &Request,
        [axis, file]: [&str; 2],
        is_needed: &dyn Fn() -> bool,
    ) -> Made {
        let slices = self.shown.slices.as_ref();
        let slices = slices.ok_or_else(|| {
            let message =
                "the volume that the tiles were made from was not found: give it as --volume";
            Answer::error(Status::NotFound, message)
        })?;
        let number = file.strip_suffix(".png").and_then(|n| n.parse().ok());
        let axis = match axis {
            "x" => Some(Axis::X),
            "y" => Some(Axis::Y),
            "z" => Some(Axis::Z),
            _ => None,
        };
        let (Some(axis), Some(at)) = (axis, number) else {
            return Err(missing(format!("{} here", request.path)));
        };
        let end = |name| {
            request
                .parameter(name)
                .and_then(|text| text.parse::<f64>().ok())
        };
        let range = match (end("low"), end("high")) {
            (Some(low), Some(high)) if low.is_finite() && high.is_finite() => Some([low, high]),
            _ => None,
        };
        let wanted = Wanted { axis, at, range };
        let SlicePicture { png, step, range } = slices.picture(wanted, is_needed)?;
        let answer = bytes("image/png", png).with("X-Step", step.to_string());
        Ok(answer
            .with("X-Low", range[0].to_string())
            .with("X-High", range[1].to_string()))
    }
}

impl Handler for Viewer {
    fn answer(&self, request: &Request, client: &Client) -> Answer {
        if !matches!(request.method, Method::Get | Method::Head) {
            let answer = Answer::error(Status::WrongMethod, "expected GET or HEAD");
            return answer.with("Allow", "GET, HEAD");
        }
        if let Some(file) = page::file(&request.path) {
            return file;
        }
        if !self.may_ask(request) {
            let message = "the token is missing or wrong: open the address that alvis printed, to its last digit";
            let answer = Answer::error(Status::Unauthorized, message);
            return answer.with("WWW-Authenticate", "Bearer");
        }
        match self.data(request, client) {
            Ok(answer) | Err(answer) => answer,
        }
    }
}

fn bytes(kind: &'static str, bytes: Vec<u8>) -> Answer {
    Answer::new(kind, Body::Bytes(bytes)).with("Cache-Control", "no-cache")
}

fn table(name: &str) -> Result<Table, Answer> {
    rows::table(name).ok_or_else(|| missing(format!("table of {name}")))
}

/// True if the client has what this tag is of.
fn has(request: &Request, tag: &str) -> bool {
    request.all("if-none-match").any(|tags| {
        let mut tags = tags.split(|&b| b == b',').map(<[u8]>::trim_ascii);
        tags.any(|t| t == tag.as_bytes())
    })
}
