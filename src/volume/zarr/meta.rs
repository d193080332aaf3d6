//! The metadata of an array: `.zarray` of version 2, `zarr.json` of version 3.
//!
//! <https://zarr-specs.readthedocs.io/en/latest/v2/v2.0.html> and
//! <https://zarr-specs.readthedocs.io/en/latest/v3/core/index.html>.

use super::super::{Dtype, Endian};
use super::codec::Packing;
use crate::error::{Error, Result};
use serde_json::Value;
use std::path::Path;

/// How the samples of a chunk are written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coding {
    pub(super) endian: Endian,
    /// Stored axis i is axis `order[i]` of the array.
    pub(super) order: Vec<usize>,
    pub(super) packing: Vec<Packing>,
}

/// Chunks in one file with a table of their places.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shards {
    /// Chunks per shard along each axis.
    pub(super) count: Vec<u64>,
    /// How the table is packed.
    pub(super) index: Vec<Packing>,
    pub(super) at_end: bool,
}

/// What is known of an array.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array {
    pub(super) shape: Vec<u64>,
    /// Voxels of a chunk that is decoded as a whole.
    pub(super) chunk: Vec<u64>,
    /// The type that is handed out.
    pub(super) dtype: Dtype,
    /// Samples are stored as f16.
    pub(super) half: bool,
    /// A sample of chunks that are not there, in the machine's order.
    pub(super) fill: Vec<u8>,
    pub(super) coding: Coding,
    pub(super) shards: Option<Shards>,
    /// In front of the numbers of a chunk's file, and between them.
    pub(super) key: (&'static str, char),
    /// Names of the axes, if stated.
    pub(super) names: Vec<String>,
}

/// Reads metadata with messages that say where.
pub(super) struct Meta<'a> {
    pub(super) path: &'a Path,
    pub(super) json: &'a Value,
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

    fn chunks(&self, json: &Value, shape: &[u64]) -> Result<Vec<u64>> {
        let chunk = self.sizes(json, "chunks")?;
        if chunk.len() != shape.len() || chunk.contains(&0) {
            let expected = "a size for each axis of the array";
            return Err(self.wrong(format!("chunks of {chunk:?} for {shape:?}"), expected));
        }
        Ok(chunk)
    }

    /// An array of version 2.
    pub(super) fn version_2(&self) -> Result<Array> {
        let json = self.json;
        let shape = self.sizes(&json["shape"], "shape")?;
        let chunk = self.chunks(&json["chunks"], &shape)?;
        let kind = json["dtype"].as_str();
        let Some(kind) = kind.filter(|k| k.len() >= 3 && k.is_ascii()) else {
            return Err(self.no(format!("a Zarr array of type {}", json["dtype"])));
        };
        let endian = match &kind[..1] {
            ">" => Endian::Big,
            "<" | "|" => Endian::Little,
            _ => return Err(self.wrong(format!("the type {kind}"), "one such as <u2")),
        };
        let (dtype, half) = self.dtype(&kind[1..])?;
        let order = match json["order"].as_str() {
            Some("C") => (0..shape.len()).collect(),
            Some("F") => (0..shape.len()).rev().collect(),
            _ => return Err(self.wrong(format!("`order` {}", json["order"]), "C or F")),
        };
        let mut packing = Vec::new();
        let filters = json["filters"].as_array().into_iter().flatten();
        let compressor = Some(&json["compressor"]).filter(|c| !c.is_null());
        for step in filters.chain(compressor) {
            let id = step["id"].as_str().unwrap_or_default();
            let item = step["elementsize"]
                .as_u64()
                .filter(|n| (1..=64).contains(n));
            packing.push(match (id, item) {
                ("shuffle", Some(item)) => Packing::Shuffle(item as usize),
                _ => Packing::find(id).ok_or_else(|| self.no(format!("the Zarr codec `{id}`")))?,
            });
        }
        let key = match json["dimension_separator"].as_str() {
            Some("/") => ("", '/'),
            _ => ("", '.'),
        };
        Ok(Array {
            fill: self.fill(&json["fill_value"], dtype)?,
            shape,
            chunk,
            dtype,
            half,
            coding: Coding {
                endian,
                order,
                packing,
            },
            shards: None,
            key,
            names: Vec::new(),
        })
    }

    /// An array of version 3.
    pub(super) fn version_3(&self) -> Result<Array> {
        let json = self.json;
        let shape = self.sizes(&json["shape"], "shape")?;
        let grid = &json["chunk_grid"];
        if grid["name"] != "regular" {
            return Err(self.no(format!("the Zarr chunk grid {}", grid["name"])));
        }
        let outer = self.chunks(&grid["configuration"]["chunk_shape"], &shape)?;
        let kind = json["data_type"].as_str().unwrap_or_default();
        let short = match kind {
            "bool" => "b1".to_owned(),
            _ => kind
                .replace("uint", "u")
                .replace("int", "i")
                .replace("float", "f"),
        };
        let bits = short.get(1..).and_then(|n| n.parse::<u32>().ok());
        let short = match bits {
            Some(bits) if bits >= 8 && bits % 8 == 0 => format!("{}{}", &short[..1], bits / 8),
            _ => short,
        };
        let (dtype, half) = self.dtype(&short)?;
        let key = &json["chunk_key_encoding"];
        let separator = key["configuration"]["separator"].as_str();
        let key = match (key["name"].as_str().or(key.as_str()), separator) {
            (Some("default"), Some("/") | None) => ("c", '/'),
            (Some("default"), Some(".")) => ("c", '.'),
            (Some("v2"), Some(".") | None) => ("", '.'),
            (Some("v2"), Some("/")) => ("", '/'),
            _ => return Err(self.no(format!("the Zarr chunk names {key}"))),
        };
        let transformers = json["storage_transformers"].as_array();
        if transformers.is_some_and(|t| !t.is_empty()) {
            return Err(self.no("a Zarr storage transformer"));
        }
        let (coding, shards, chunk) = self.codecs(&json["codecs"], outer)?;
        let names = json["dimension_names"].as_array().into_iter().flatten();
        Ok(Array {
            fill: self.fill(&json["fill_value"], dtype)?,
            shape,
            chunk,
            dtype,
            half,
            coding,
            shards,
            key,
            names: names
                .map(|n| n.as_str().unwrap_or_default().to_owned())
                .collect(),
        })
    }

    /// The steps of version 3, and the chunks inside of shards of this size.
    fn codecs(&self, json: &Value, outer: Vec<u64>) -> Result<(Coding, Option<Shards>, Vec<u64>)> {
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
            let coding = self.coding(&set["codecs"], outer.len())?;
            let index = self.coding(&set["index_codecs"], outer.len() + 1)?;
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
                index: index.packing,
                at_end,
            };
            return Ok((coding, Some(shards), inner));
        }
        Ok((self.coding(json, outer.len())?, None, outer))
    }

    /// Steps without shards.
    fn coding(&self, json: &Value, axes: usize) -> Result<Coding> {
        let mut order: Vec<usize> = (0..axes).collect();
        let (mut endian, mut packing) = (None, Vec::new());
        for step in json.as_array().map(Vec::as_slice).unwrap_or_default() {
            let (name, set) = (
                step["name"].as_str().or(step.as_str()),
                &step["configuration"],
            );
            let name = name.unwrap_or_default();
            match (name, endian) {
                ("transpose", None) => {
                    let given = self.sizes(&set["order"], "order")?;
                    let mut sorted = given.clone();
                    sorted.sort_unstable();
                    if !sorted.iter().copied().eq(0..axes as u64) {
                        let found = format!("the order {given:?}");
                        return Err(self.wrong(found, "every axis once"));
                    }
                    order = given.iter().map(|&g| order[g as usize]).collect();
                }
                ("bytes", None) => {
                    endian = Some(match set["endian"].as_str() {
                        Some("big") => Endian::Big,
                        _ => Endian::Little,
                    });
                }
                (_, Some(_)) if Packing::find(name).is_some() => {
                    packing.extend(Packing::find(name))
                }
                _ => return Err(self.no(format!("the Zarr codec `{name}`"))),
            }
        }
        match endian {
            Some(endian) => Ok(Coding {
                endian,
                order,
                packing,
            }),
            None => Err(self.wrong("codecs without `bytes`", "how samples are written")),
        }
    }

    /// The type of a short name without byte order, and whether it is f16.
    fn dtype(&self, name: &str) -> Result<(Dtype, bool)> {
        Ok(match name {
            "u1" | "b1" => (Dtype::U8, false),
            "i1" => (Dtype::I8, false),
            "u2" => (Dtype::U16, false),
            "i2" => (Dtype::I16, false),
            "u4" => (Dtype::U32, false),
            "i4" => (Dtype::I32, false),
            "f2" => (Dtype::F32, true),
            "f4" => (Dtype::F32, false),
            "f8" => (Dtype::F64, false),
            _ => {
                let hint = "convert it to a type of at most 32 bits or to f64";
                let what = format!("a Zarr array of type {name}");
                return Err(Error::unsupported(self.path, what, hint));
            }
        })
    }

    /// The value of chunks that are not there.
    fn fill(&self, json: &Value, dtype: Dtype) -> Result<Vec<u8>> {
        let value = match json {
            Value::Null => Some(0.0),
            Value::Bool(set) => Some(f64::from(u8::from(*set))),
            Value::Number(n) => n.as_f64(),
            Value::String(s) if dtype.is_float() => match s.as_str() {
                "NaN" => Some(f64::NAN),
                "Infinity" => Some(f64::INFINITY),
                "-Infinity" => Some(f64::NEG_INFINITY),
                _ => None,
            },
            _ => None,
        };
        let Some(v) = value else {
            return Err(self.wrong(format!("`fill_value` {json}"), "a number"));
        };
        let (bytes, kept) = match dtype {
            Dtype::U8 => ((v as u8).to_ne_bytes().to_vec(), v as u8 as f64),
            Dtype::I8 => ((v as i8).to_ne_bytes().to_vec(), v as i8 as f64),
            Dtype::U16 => ((v as u16).to_ne_bytes().to_vec(), v as u16 as f64),
            Dtype::I16 => ((v as i16).to_ne_bytes().to_vec(), v as i16 as f64),
            Dtype::U32 => ((v as u32).to_ne_bytes().to_vec(), v as u32 as f64),
            Dtype::I32 => ((v as i32).to_ne_bytes().to_vec(), v as i32 as f64),
            Dtype::F32 => ((v as f32).to_ne_bytes().to_vec(), v),
            Dtype::F64 => (v.to_ne_bytes().to_vec(), v),
        };
        match kept == v || v.is_nan() {
            true => Ok(bytes),
            false => Err(self.wrong(
                format!("`fill_value` {v} of {dtype}"),
                "a value of the type",
            )),
        }
    }
}
