//! The metadata of an array: `.zarray` of version 2, `zarr.json` of version 3.
//!
//! <https://zarr-specs.readthedocs.io/en/latest/v2/v2.0.html> and
//! <https://zarr-specs.readthedocs.io/en/latest/v3/core/index.html>.

use crate::error::{Error, Result};
use crate::volume::Endian;
use crate::volume::formats::zarr::codec::Packing;
use crate::volume::formats::zarr::kind::{Class, Kind};
use serde_json::Value;
use std::path::Path;

/// How the samples of a chunk are written.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Coding {
    pub(crate) endian: Endian,
    /// Stored axis i is axis `order[i]` of the array.
    pub(crate) order: Vec<usize>,
    pub(crate) packing: Vec<Packing>,
}

/// Chunks in one file with a table of their places.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shards {
    /// Chunks per shard along each axis.
    pub(crate) count: Vec<u64>,
    /// The table has a checksum behind it.
    pub(crate) checked: bool,
    pub(crate) at_end: bool,
}

/// How the files of chunks are named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkKey {
    /// In front of the numbers of a chunk; may be empty.
    pub(crate) front: &'static str,
    /// Between them.
    pub(crate) separator: char,
}

impl ChunkKey {
    pub(crate) const fn new(front: &'static str, separator: char) -> Self {
        ChunkKey { front, separator }
    }
}

/// What is known of an array.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Array {
    pub(crate) shape: Vec<u64>,
    /// Voxels of a chunk that is decoded as a whole.
    pub(crate) chunk: Vec<u64>,
    /// The type of a sample.
    pub(crate) kind: Kind,
    /// The sample of chunks that are not there; `None` if the metadata do not say, which reads as 0.
    pub(crate) fill: Option<f64>,
    pub(crate) coding: Coding,
    pub(crate) shards: Option<Shards>,
    pub(crate) key: ChunkKey,
    /// Names of the axes, if stated; an axis without one is empty.
    pub(crate) names: Vec<String>,
    /// What others have noted of it: an object, or null.
    pub(crate) attributes: Value,
    /// 2 or 3.
    pub(crate) version: u8,
}

/// Reads metadata with messages that say where.
pub(crate) struct Meta<'a> {
    pub(crate) path: &'a Path,
    pub(crate) json: &'a Value,
}

impl Meta<'_> {
    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn no(&self, what: impl Into<String>) -> Error {
        let hint = "write it anew with the codecs of Zarr itself: blosc, zstd, gzip or zlib";
        Error::unsupported(self.path, what, hint)
    }

    fn sizes(&self, json: &Value, name: &str) -> Result<Vec<u64>> {
        let list = json.as_array().filter(|l| (1..=8).contains(&l.len()));
        let sizes: Option<Vec<u64>> = list.and_then(|l| l.iter().map(Value::as_u64).collect());
        let limit = 1 << 40;
        match sizes {
            Some(sizes) if sizes.iter().all(|&n| n <= limit) => Ok(sizes),
            _ => Err(self.wrong(format!("`{name}` of {json}"), "1 to 8 whole numbers")),
        }
    }

    /// Names of axes, one for each, if there is a list of them.
    fn names(&self, json: &Value, axes: usize) -> Result<Vec<String>> {
        let Some(list) = json.as_array() else {
            return Ok(Vec::new());
        };
        if list.len() != axes {
            let found = format!("the names {json} of {axes} axes");
            return Err(self.wrong(found, "a name for each axis"));
        }
        let name = |n: &Value| n.as_str().unwrap_or_default().to_owned();
        Ok(list.iter().map(name).collect())
    }

    fn chunks(&self, json: &Value, shape: &[u64]) -> Result<Vec<u64>> {
        let chunk = self.sizes(json, "chunks")?;
        if chunk.len() != shape.len() || chunk.contains(&0) {
            let expected = "a size for each axis of the array";
            return Err(self.wrong(format!("chunks of {chunk:?} for {shape:?}"), expected));
        }
        Ok(chunk)
    }

    /// An array of version 2 with its attributes.
    pub(crate) fn version_2(&self, attributes: Value) -> Result<Array> {
        let json = self.json;
        let shape = self.sizes(&json["shape"], "shape")?;
        let chunk = self.chunks(&json["chunks"], &shape)?;
        let found = json["dtype"].as_str();
        let found = found.filter(|name| name.starts_with(['<', '>', '|']));
        let (kind, endian) = found
            .and_then(|name| Kind::with_order(name, Endian::Little))
            .ok_or_else(|| self.no_kind(&json["dtype"]))?;
        let order = match json["order"].as_str() {
            Some("C") => (0..shape.len()).collect(),
            Some("F") => (0..shape.len()).rev().collect(),
            _ => return Err(self.wrong(format!("`order` {}", json["order"]), "C or F")),
        };
        let mut packing = Vec::new();
        let mut plain = (kind, endian);
        let filters = json["filters"].as_array().into_iter().flatten();
        let compressor = Some(&json["compressor"]).filter(|c| !c.is_null());
        for step in filters.chain(compressor) {
            let id = step["id"].as_str().unwrap_or_default();
            packing.push(self.step(id, step, &mut plain)?);
        }
        let separator = match json["dimension_separator"].as_str() {
            Some("/") => '/',
            _ => '.',
        };
        Ok(Array {
            fill: self.fill(&json["fill_value"], kind)?,
            names: self.names(&attributes["_ARRAY_DIMENSIONS"], shape.len())?,
            shape,
            chunk,
            kind,
            coding: Coding {
                endian,
                order,
                packing,
            },
            shards: None,
            key: ChunkKey::new("", separator),
            attributes,
            version: 2,
        })
    }

    fn no_kind(&self, found: &Value) -> Error {
        let name = found.as_str().map_or(found.to_string(), str::to_owned);
        let hint = "convert it to a type of at most 32 bits or to f64";
        Error::unsupported(self.path, format!("a Zarr array of type {name}"), hint)
    }

    /// A step of packing by its name, and the type of what it makes.
    fn step(&self, name: &str, set: &Value, plain: &mut (Kind, Endian)) -> Result<Packing> {
        let step = Packing::find(name, set, *plain);
        let step = step.ok_or_else(|| self.no(format!("the Zarr codec `{name}` with {set}")))?;
        if let Packing::Filter(filter) = &step {
            *plain = filter.stored();
        }
        Ok(step)
    }

    /// An array of version 3.
    pub(crate) fn version_3(&self) -> Result<Array> {
        let json = self.json;
        let shape = self.sizes(&json["shape"], "shape")?;
        self.understood()?;
        let grid = &json["chunk_grid"];
        if grid["name"] != "regular" {
            return Err(self.no(format!("the Zarr chunk grid {}", grid["name"])));
        }
        let outer = self.chunks(&grid["configuration"]["chunk_shape"], &shape)?;
        let kind = json["data_type"].as_str().and_then(Kind::find);
        let kind = kind.ok_or_else(|| self.no_kind(&json["data_type"]))?;
        let key = &json["chunk_key_encoding"];
        let separator = key["configuration"]["separator"].as_str();
        let key = match (key["name"].as_str().or(key.as_str()), separator) {
            (Some("default"), Some("/") | None) => ChunkKey::new("c", '/'),
            (Some("default"), Some(".")) => ChunkKey::new("c", '.'),
            (Some("v2"), Some(".") | None) => ChunkKey::new("", '.'),
            (Some("v2"), Some("/")) => ChunkKey::new("", '/'),
            _ => return Err(self.no(format!("the Zarr chunk names {key}"))),
        };
        let transformers = json["storage_transformers"].as_array();
        if transformers.is_some_and(|t| !t.is_empty()) {
            return Err(self.no("a Zarr storage transformer"));
        }
        let (coding, shards, chunk) = self.codecs(&json["codecs"], outer, kind)?;
        Ok(Array {
            fill: self.fill(&json["fill_value"], kind)?,
            names: self.names(&json["dimension_names"], shape.len())?,
            shape,
            chunk,
            kind,
            coding,
            shards,
            key,
            attributes: json["attributes"].clone(),
            version: 3,
        })
    }

    /// Refuses members that are not of version 3, unless they say that they may be passed over.
    fn understood(&self) -> Result<()> {
        const KNOWN: [&str; 12] = [
            "zarr_format",
            "node_type",
            "shape",
            "data_type",
            "chunk_grid",
            "chunk_key_encoding",
            "fill_value",
            "codecs",
            "attributes",
            "storage_transformers",
            "dimension_names",
            "consolidated_metadata",
        ];
        let members = self.json.as_object().into_iter().flatten();
        let mut others = members.filter(|(name, value)| {
            !KNOWN.contains(&name.as_str()) && value["must_understand"] != false
        });
        match others.next() {
            Some((name, _)) => Err(self.no(format!("a Zarr array with `{name}`"))),
            None => Ok(()),
        }
    }

    /// The steps of version 3, and the chunks inside of shards of this size.
    fn codecs(
        &self,
        json: &Value,
        outer: Vec<u64>,
        kind: Kind,
    ) -> Result<(Coding, Option<Shards>, Vec<u64>)> {
        let steps = json.as_array().map(Vec::as_slice).unwrap_or_default();
        let name = |step: &Value| {
            let name = step["name"].as_str().or(step.as_str());
            name.unwrap_or_default().to_owned()
        };
        if let [step] = steps
            && name(step) == "sharding_indexed"
        {
            let set = &step["configuration"];
            let inner = self.chunks(&set["chunk_shape"], &outer)?;
            if outer.iter().zip(&inner).any(|(a, b)| a % b != 0) {
                let found = format!("chunks of {inner:?} in shards of {outer:?}");
                return Err(self.wrong(found, "whole chunks"));
            }
            let coding = self.coding(&set["codecs"], outer.len(), kind)?;
            let word = Kind {
                class: Class::Unsigned,
                size: 8,
            };
            let index = self.coding(&set["index_codecs"], outer.len() + 1, word)?;
            let fixed = index.packing.iter().all(|p| *p == Packing::Crc32c);
            if !fixed || index.packing.len() > 1 || index.endian != Endian::Little {
                return Err(self.no("a compressed table of shards"));
            }
            let at_end = match set["index_location"].as_str() {
                None | Some("end") => true,
                Some("start") => false,
                Some(other) => return Err(self.wrong(other, "start or end")),
            };
            let shards = Shards {
                count: outer.iter().zip(&inner).map(|(a, b)| a / b).collect(),
                checked: !index.packing.is_empty(),
                at_end,
            };
            return Ok((coding, Some(shards), inner));
        }
        Ok((self.coding(json, outer.len(), kind)?, None, outer))
    }

    /// Steps without shards.
    fn coding(&self, json: &Value, axes: usize, kind: Kind) -> Result<Coding> {
        let mut order: Vec<usize> = (0..axes).collect();
        let (mut endian, mut packing) = (None, Vec::new());
        let steps = json.as_array().map(Vec::as_slice).unwrap_or_default();
        let name = |step: &'_ Value| {
            let name = step["name"].as_str().or(step.as_str());
            name.unwrap_or_default().to_owned()
        };
        // filters, too, work on numbers in the order that comes after them
        let bytes = steps.iter().find(|step| name(step) == "bytes");
        let stated = bytes.map(|step| match step["configuration"]["endian"].as_str() {
            Some("big") => Endian::Big,
            _ => Endian::Little,
        });
        let Some(stated) = stated else {
            let names: Vec<String> = steps.iter().map(name).collect();
            return Err(self.no(format!(
                "the Zarr codecs `{}` without `bytes`",
                names.join("`, `")
            )));
        };
        let mut plain = (kind, stated);
        for step in steps {
            let (name, set) = (name(step), &step["configuration"]);
            match (&name[..], endian) {
                ("transpose", None) => {
                    let next = self.order(&set["order"], axes, &packing)?;
                    order = next.into_iter().map(|axis| order[axis]).collect();
                }
                ("bytes", None) => endian = Some(stated),
                _ => {
                    let mut step = self.step(&name, set, &mut plain)?;
                    if let Packing::Filter(filter) = &mut step {
                        *filter = filter.in_order(stated);
                        plain.1 = stated;
                    }
                    // numbers come before bytes
                    if matches!(step, Packing::Filter(_)) == endian.is_some() {
                        return Err(
                            self.wrong(format!("the codec `{name}` in that place"), "another")
                        );
                    }
                    packing.push(step);
                }
            }
        }
        Ok(Coding {
            endian: stated,
            order,
            packing,
        })
    }

    /// The order of axes that a step of that kind states, behind the steps so far.
    fn order(&self, json: &Value, axes: usize, before: &[Packing]) -> Result<Vec<usize>> {
        let given = self.sizes(json, "order")?;
        let mut sorted = given.clone();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..axes as u64) {
            let found = format!("the order {given:?}");
            return Err(self.wrong(found, "every axis once"));
        }
        let ordered = |step: &Packing| matches!(step, Packing::Filter(filter) if filter.ordered());
        if before.iter().any(ordered) {
            return Err(self.no("the Zarr codec `transpose` behind `delta`"));
        }
        Ok(given.iter().map(|&g| g as usize).collect())
    }

    /// The value of chunks that are not there.
    fn fill(&self, json: &Value, kind: Kind) -> Result<Option<f64>> {
        let float = kind.class == Class::Float;
        let value = match json {
            Value::Null => return Ok(None),
            Value::Bool(set) => Some(f64::from(u8::from(*set))),
            Value::Number(n) => n.as_f64(),
            Value::String(s) if float => match (s.as_str(), s.strip_prefix("0x")) {
                ("NaN", _) => Some(f64::NAN),
                ("Infinity", _) => Some(f64::INFINITY),
                ("-Infinity", _) => Some(f64::NEG_INFINITY),
                (_, Some(bits)) if bits.len() == 2 * kind.size => {
                    let bits = u64::from_str_radix(bits, 16).ok();
                    bits.map(|b| kind.number(&b.to_le_bytes()[..kind.size], Endian::Little))
                }
                _ => None,
            },
            _ => None,
        };
        let Some(value) = value else {
            return Err(self.wrong(format!("`fill_value` {json}"), "a number"));
        };
        let span = (1u128 << (8 * kind.size)) as f64;
        let kept = match kind.class {
            Class::Float => true,
            Class::Unsigned => value >= 0.0 && value < span,
            Class::Signed => -span / 2.0 <= value && value < span / 2.0,
        };
        match kept && (float || value.fract() == 0.0) {
            true => Ok(Some(value)),
            false => Err(self.wrong(format!("`fill_value` {value}"), "a value of the type")),
        }
    }
}
