//! The files of a tile set for other programs, as `alvis serve` has them.
//!
//! Only files that the index lists are sent. The path that a client sends is compared with theirs, and is never a
//! part of the name of a file.

use crate::error::{Error, Result};
use crate::http::{Answer, Body, Client, Handler, Method, Request, Rules, Status};
use crate::manifest::{LEGEND_SVG, MANIFEST, Manifest, level_file};
use crate::store::File;
use crate::tileset::{TileLookup, TileSet};
use std::io::{Seek, SeekFrom};
use std::ops::Range;

/// Answers with files.
#[derive(Debug)]
pub struct Files {
    set: TileSet,
    lookup: TileLookup,
    rules: Rules,
}

/// A file that the index lists.
struct Listed {
    path: String,
    /// Bytes of it, where the index tells.
    bytes: Option<u64>,
    /// Its checksum, where the index tells.
    checksum: Option<String>,
}

impl Files {
    /// Reads the index.
    ///
    /// # Errors
    /// Those of [`TileLookup::read`].
    pub fn new(set: TileSet, rules: Rules) -> Result<Self> {
        Ok(Files {
            lookup: TileLookup::read(&set)?,
            set,
            rules,
        })
    }

    fn listed(&self, path: &str) -> Option<Listed> {
        let path = path.strip_prefix('/')?;
        let alone = |path: &str| Listed {
            path: path.to_owned(),
            bytes: None,
            checksum: None,
        };
        let Manifest {
            tables,
            layers,
            selection,
            lod,
            ..
        } = self.set.manifest();
        let colours = selection.as_ref().and_then(|s| s.colour_by.as_ref());
        let legend = colours.map(|colours| [colours.legend.as_str(), LEGEND_SVG]);
        let legend = legend.into_iter().flatten();
        let mut others = [MANIFEST].into_iter().chain(tables.files()).chain(legend);
        if let Some(own) = others.find(|own| *own == path) {
            return Some(alone(own));
        }
        if lod.is_some()
            && let Some(own) = level_file(path)
        {
            let file = self.set.path(&own).ok()?;
            return File::open(&file).is_ok().then(|| alone(&own));
        }
        if let Some(layer) = layers.iter().find(|layer| layer.path == path) {
            return Some(Listed {
                path: layer.path.clone(),
                bytes: Some(layer.bytes),
                checksum: Some(layer.checksum.clone()),
            });
        }
        let tile = self.lookup.by_path(path)?;
        Some(Listed {
            path: self.lookup.path(tile),
            bytes: Some(tile.bytes),
            checksum: Some(tile.checksum()),
        })
    }

    fn file(&self, request: &Request, listed: &Listed) -> Result<Answer> {
        let tag = listed.checksum.as_ref().map(|sum| format!("\"{sum}\""));
        if let Some(tag) = &tag
            && request.one("if-none-match") == Some(tag.as_bytes())
        {
            return Ok(Answer::bare(Status::NotModified).with("ETag", tag));
        }
        let path = self.set.path(&listed.path)?;
        let failed = |e| Error::io(&path, "read the file", e);
        let mut file = File::open(&path).map_err(failed)?;
        let length = file.len().map_err(failed)?;
        if let Some(bytes) = listed.bytes.filter(|&bytes| bytes != length) {
            let expected = format!("{bytes} bytes as in the index");
            return Err(Error::format(&path, format!("{length} bytes"), expected));
        }
        let wanted = match range(request, length) {
            Wanted::Whole => 0..length,
            Wanted::Part(part) => part,
            Wanted::Nothing => {
                let answer = Answer::error(Status::WrongRange, "the file ends before that range");
                return Ok(answer.with("Content-Range", format!("bytes */{length}")));
            }
        };
        file.seek(SeekFrom::Start(wanted.start)).map_err(failed)?;
        let bytes = wanted.end - wanted.start;
        let body = Body::Stream(Box::new(file), bytes);
        let mut answer = Answer::new(kind(&listed.path), body)
            .with("Cache-Control", "no-cache")
            .with("Accept-Ranges", "bytes");
        if bytes < length {
            answer.status = Status::Partial;
            let of = format!("bytes {}-{}/{length}", wanted.start, wanted.end - 1);
            answer = answer.with("Content-Range", of);
        }
        Ok(match tag {
            Some(tag) => answer.with("ETag", tag),
            None => answer,
        })
    }

    /// The answer to a request of any page that may ask.
    fn plain(&self, request: &Request) -> Answer {
        match request.method {
            Method::Get | Method::Head => {}
            Method::Options => return Answer::bare(Status::NoContent),
            Method::Other => {
                let answer = Answer::error(Status::WrongMethod, "expected GET, HEAD or OPTIONS");
                return answer.with("Allow", "GET, HEAD, OPTIONS");
            }
        }
        let Some(listed) = self.listed(&request.path) else {
            let message = format!(
                "the index lists no file {}: begin with /{MANIFEST}",
                request.path
            );
            return Answer::error(Status::NotFound, &message);
        };
        self.file(request, &listed).unwrap_or_else(Answer::from)
    }
}

impl Handler for Files {
    fn answer(&self, request: &Request, _: &Client) -> Answer {
        let answer = self.plain(request).with("Vary", "Origin");
        let Some(origin) = self.rules.other_origin(request) else {
            return answer;
        };
        let answer = answer.with("Access-Control-Allow-Origin", origin).with(
            "Access-Control-Expose-Headers",
            "Content-Length, Content-Range, ETag",
        );
        if request.method != Method::Options {
            return answer;
        }
        let answer = answer
            .with("Access-Control-Allow-Methods", "GET, HEAD, OPTIONS")
            .with("Access-Control-Allow-Headers", "Range, If-None-Match");
        match request.one("access-control-request-private-network") {
            Some(b"true") => answer.with("Access-Control-Allow-Private-Network", "true"),
            _ => answer,
        }
    }
}

/// The type of a file of a tile set, by its name.
fn kind(path: &str) -> &'static str {
    match path.rsplit_once('.').map(|(_, ending)| ending) {
        Some("glb") => "model/gltf-binary",
        Some("json") => "application/json",
        Some("csv") => "text/csv; charset=utf-8",
        Some("parquet") => "application/vnd.apache.parquet",
        Some("png") => "image/png",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}

/// Which bytes of a file are wanted.
#[derive(Debug, PartialEq, Eq)]
enum Wanted {
    Whole,
    Part(Range<u64>),
    Nothing,
}

/// The one range that a request asks for. One that is not understood, or several, stand for the whole file, as
/// RFC 9110 allows.
fn range(request: &Request, length: u64) -> Wanted {
    let text = request
        .one("range")
        .filter(|_| request.all("if-range").next().is_none());
    let text = text.and_then(|bytes| std::str::from_utf8(bytes).ok());
    let ends = text.and_then(|text| text.strip_prefix("bytes=")?.split_once('-'));
    let number = |text: &str| {
        text.parse::<u64>()
            .ok()
            .filter(|_| text.bytes().all(|b| b.is_ascii_digit()))
    };
    let part = match ends {
        None => return Wanted::Whole,
        Some(("", last)) => number(last).map(|n| length.saturating_sub(n)..length),
        Some((first, "")) => number(first).map(|first| first..length),
        Some((first, last)) => {
            let end = number(last).map(|last| last.saturating_add(1).min(length));
            let of = number(first).zip(end);
            // one that ends before it begins is none
            of.filter(|(first, end)| first < end || *first >= length)
                .map(|(first, end)| first..end)
        }
    };
    match part {
        None => Wanted::Whole,
        Some(part) if part.start >= part.end => Wanted::Nothing,
        Some(part) => Wanted::Part(part),
    }
}
