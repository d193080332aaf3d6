//! JSON against the schemas that are published with the format: what these do not name is not of alvis.
//!
//! A reader passes over members that it does not know, as glTF demands, and of a member that is there
//! twice it takes the last, where another program takes the first. Either way a file may show more than
//! was looked at. So the verifier walks each JSON once more along its schema, and reports each member
//! that has no place there, is missing, is there twice, or has another type or none of the values listed.
//!
//! Of JSON Schema it knows what describes objects and lists (`properties`, `required`, `items`,
//! `prefixItems`, `minItems`, `maxItems`), and `type`, `const`, `enum` and `$ref`; every object is closed. Limits and patterns are
//! left to the checks of what members mean. Nothing is built in memory from what is walked.

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::Value;
use std::fmt;
use std::rc::Rc;
use std::sync::LazyLock;

/// Findings of one file that are reported at most.
const MOST: usize = 100;

/// A schema.
pub(super) struct Schema {
    shapes: Vec<Shape>,
}

/// The shape that a value must have.
#[derive(Default)]
struct Shape {
    /// Types it may have: those stated, or those of the values. Never empty, for then lists and objects pass, too.
    types: Vec<Type>,
    /// Values it may have; empty for any.
    values: Vec<Value>,
    /// Of an object.
    members: Vec<Member>,
    /// Of the first items of a list, by shape, and of the others.
    first: Vec<usize>,
    items: Option<usize>,
    /// How many items a list has, at least and at most.
    counts: [Option<u64>; 2],
}

struct Member {
    name: String,
    shape: usize,
    required: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Type {
    Null,
    Boolean,
    Integer,
    Number,
    String,
    Array,
    Object,
}

impl Type {
    /// Of a value; a number without a fraction is an integer, as in the schema's rules.
    fn of(value: &Value) -> Type {
        match value {
            Value::Null => Type::Null,
            Value::Bool(_) => Type::Boolean,
            Value::Number(n) => Type::of_number(n.as_f64().unwrap_or(f64::NAN)),
            Value::String(_) => Type::String,
            Value::Array(_) => Type::Array,
            Value::Object(_) => Type::Object,
        }
    }

    fn of_number(v: f64) -> Type {
        match v.fract() == 0.0 {
            true => Type::Integer,
            false => Type::Number,
        }
    }
}

const TYPES: [(&str, Type); 7] = [
    ("null", Type::Null),
    ("boolean", Type::Boolean),
    ("integer", Type::Integer),
    ("number", Type::Number),
    ("string", Type::String),
    ("array", Type::Array),
    ("object", Type::Object),
];

/// The schema of the manifest.
pub(super) static MANIFEST: LazyLock<Schema> =
    LazyLock::new(|| Schema::new("manifest.schema.json", ""));
/// The schema of a shard.
pub(super) static SHARD: LazyLock<Schema> = LazyLock::new(|| Schema::new("shard.schema.json", ""));
/// The schema of the index of levels.
pub(super) static LEVELS: LazyLock<Schema> = LazyLock::new(|| Schema::new("lod.schema.json", ""));
/// The schema of a list of nodes.
pub(super) static NODES: LazyLock<Schema> = LazyLock::new(|| Schema::new("nodes.schema.json", ""));
/// The schemas of tiles in node layout and merged.
pub(super) static TILES: LazyLock<[Schema; 2]> = LazyLock::new(|| {
    ["/$defs/nodes", "/$defs/merged"].map(|at| Schema::new("tile.schema.json", at))
});

/// The text of a published schema.
fn text(name: &str) -> &'static str {
    match name {
        "manifest.schema.json" => include_str!("../../schema/manifest.schema.json"),
        "shard.schema.json" => include_str!("../../schema/shard.schema.json"),
        "lod.schema.json" => include_str!("../../schema/lod.schema.json"),
        "nodes.schema.json" => include_str!("../../schema/nodes.schema.json"),
        "tile.schema.json" => include_str!("../../schema/tile.schema.json"),
        "extras.schema.json" => include_str!("../../schema/extras.schema.json"),
        other => panic!("no schema is named {other}"),
    }
}

/// Reads schemas; each place in them becomes one shape.
#[derive(Default)]
struct Loader {
    files: Vec<(String, Rc<Value>)>,
    known: Vec<(String, String)>,
    shapes: Vec<Shape>,
}

impl Schema {
    /// The schema at a JSON pointer of a published file. Panics if that is none: they are part of the program.
    fn new(file: &str, pointer: &str) -> Self {
        let mut loader = Loader::default();
        loader.shape(file, pointer);
        Schema {
            shapes: loader.shapes,
        }
    }

    /// Walks a JSON text; returns JSON pointers and what is wrong there, a hundred at most.
    ///
    /// # Errors
    /// If it is not JSON.
    pub fn walk(&self, json: &[u8]) -> serde_json::Result<Findings> {
        self.walk_input(serde_json::Deserializer::from_slice(json))
    }

    /// The same of a file, of which one value at a time is in memory.
    ///
    /// # Errors
    /// If it is not JSON, or cannot be read.
    pub fn walk_file(&self, json: impl std::io::Read) -> serde_json::Result<Findings> {
        self.walk_input(serde_json::Deserializer::from_reader(json))
    }

    fn walk_input<'de, R: serde_json::de::Read<'de>>(
        &self,
        mut input: serde_json::Deserializer<R>,
    ) -> serde_json::Result<Findings> {
        let mut walk = Walk {
            schema: self,
            path: Vec::new(),
            found: Vec::new(),
        };
        let root = Place {
            walk: &mut walk,
            shape: 0,
        };
        root.deserialize(&mut input)?;
        input.end()?;
        Ok(walk.found)
    }
}

/// JSON pointers, and what is wrong there.
pub(super) type Findings = Vec<(String, String)>;

impl Loader {
    fn file(&mut self, name: &str) -> Rc<Value> {
        if let Some((_, known)) = self.files.iter().find(|(n, _)| n == name) {
            return known.clone();
        }
        let value: Rc<Value> = Rc::new(serde_json::from_str(text(name)).expect("a schema is JSON"));
        self.files.push((name.to_owned(), value.clone()));
        value
    }

    /// The number of the shape at a pointer of a file.
    fn shape(&mut self, file: &str, pointer: &str) -> usize {
        let all = self.file(file);
        let at = all.pointer(pointer).expect("a pointer leads to a schema");
        if let Some(target) = at["$ref"].as_str() {
            let (other, pointer) = target.split_once('#').unwrap_or((target, ""));
            return self.shape(if other.is_empty() { file } else { other }, pointer);
        }
        let key = (file.to_owned(), pointer.to_owned());
        if let Some(known) = self.known.iter().position(|k| *k == key) {
            return known;
        }
        let number = self.shapes.len();
        self.known.push(key);
        self.shapes.push(Shape::default());
        let values = match (&at["const"], &at["enum"]) {
            (Value::Null, Value::Array(all)) => all.clone(),
            (Value::Null, _) => Vec::new(),
            (one, _) => vec![one.clone()],
        };
        let shape = Shape {
            types: match types(&at["type"]) {
                none if none.is_empty() => values.iter().map(Type::of).collect(),
                stated => stated,
            },
            values,
            members: self.members(at, file, pointer),
            first: (0..at["prefixItems"].as_array().map_or(0, Vec::len))
                .map(|i| self.shape(file, &format!("{pointer}/prefixItems/{i}")))
                .collect(),
            items: at
                .get("items")
                .map(|_| self.shape(file, &format!("{pointer}/items"))),
            counts: ["minItems", "maxItems"].map(|name| at[name].as_u64()),
        };
        assert!(
            !shape.types.is_empty(),
            "{file}#{pointer} lets any value pass"
        );
        self.shapes[number] = shape;
        number
    }

    fn members(&mut self, at: &Value, file: &str, pointer: &str) -> Vec<Member> {
        let is_required = |name: &str| {
            let mut all = at["required"].as_array().into_iter().flatten();
            all.any(|r| r == name)
        };
        let properties = at["properties"].as_object();
        let names = properties.into_iter().flat_map(|p| p.keys());
        names
            .map(|name| Member {
                shape: self.shape(file, &format!("{pointer}/properties/{name}")),
                required: is_required(name),
                name: name.clone(),
            })
            .collect()
    }
}

fn types(stated: &Value) -> Vec<Type> {
    let named = |v: &Value| TYPES.iter().find(|(name, _)| v == name).map(|t| t.1);
    match stated {
        Value::Array(all) => all.iter().filter_map(named).collect(),
        one => named(one).into_iter().collect(),
    }
}

/// A walk under way.
struct Walk<'s> {
    schema: &'s Schema,
    path: Vec<Step<'s>>,
    found: Findings,
}

#[derive(Clone, Copy)]
enum Step<'s> {
    Member(&'s str),
    Item(usize),
}

impl fmt::Display for Step<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Step::Member(name) => write!(f, "/{name}"),
            Step::Item(i) => write!(f, "/{i}"),
        }
    }
}

impl Walk<'_> {
    fn report(&mut self, message: String) {
        if self.found.len() < MOST {
            let path: String = self.path.iter().map(Step::to_string).collect();
            self.found.push((path, message));
        }
    }
}

/// A value that is about to be walked.
struct Place<'w, 's> {
    walk: &'w mut Walk<'s>,
    shape: usize,
}

impl<'s> Place<'_, 's> {
    fn shape(&self) -> &'s Shape {
        &self.walk.schema.shapes[self.shape]
    }

    /// Checks a value's type, and the value if it has one of its own.
    fn check(&mut self, is: Type, value: Option<Value>) {
        let shape = self.shape();
        let fits = |t: &Type| *t == is || (*t == Type::Number && is == Type::Integer);
        let name = |t: &Type| {
            TYPES
                .iter()
                .find(|(_, other)| other == t)
                .map_or("", |n| n.0)
        };
        if !shape.types.iter().any(fits) {
            let expected: Vec<&str> = shape.types.iter().map(name).collect();
            let message = format!(
                "found a value of type {}, expected {}",
                name(&is),
                expected.join(" or ")
            );
            self.walk.report(message);
        } else if let (Some(value), false) = (value, shape.values.is_empty())
            && !shape.values.iter().any(|v| same(v, &value))
        {
            let expected: Vec<String> = shape.values.iter().map(Value::to_string).collect();
            let message = format!("found {value}, expected {}", expected.join(" or "));
            self.walk.report(message);
        }
    }

    fn scalar(mut self, is: Type, value: impl FnOnce() -> Value) {
        let value = (!self.shape().values.is_empty()).then(value);
        self.check(is, value);
    }
}

/// True if two values are the same, numbers by what they are.
fn same(a: &Value, b: &Value) -> bool {
    a == b || a.is_number() && b.is_number() && a.as_f64() == b.as_f64()
}

impl<'de> DeserializeSeed<'de> for Place<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Place<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any JSON")
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        self.scalar(Type::Null, || Value::Null);
        Ok(())
    }

    fn visit_bool<E>(self, v: bool) -> Result<(), E> {
        self.scalar(Type::Boolean, || v.into());
        Ok(())
    }

    fn visit_u64<E>(self, v: u64) -> Result<(), E> {
        self.scalar(Type::Integer, || v.into());
        Ok(())
    }

    fn visit_i64<E>(self, v: i64) -> Result<(), E> {
        self.scalar(Type::Integer, || v.into());
        Ok(())
    }

    fn visit_f64<E>(self, v: f64) -> Result<(), E> {
        self.scalar(Type::of_number(v), || v.into());
        Ok(())
    }

    fn visit_str<E>(self, v: &str) -> Result<(), E> {
        self.scalar(Type::String, || v.into());
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut list: A) -> Result<(), A::Error> {
        self.check(Type::Array, None);
        let shape = self.shape();
        let mut count = 0;
        for i in 0.. {
            let of_item = shape.first.get(i).copied().or(shape.items);
            self.walk.path.push(Step::Item(i));
            let more = match of_item {
                Some(shape) => list.next_element_seed(Place {
                    walk: &mut *self.walk,
                    shape,
                })?,
                None => list.next_element::<IgnoredAny>()?.map(|_| ()),
            };
            self.walk.path.pop();
            if more.is_none() {
                break;
            }
            count += 1;
        }
        let [least, most] = shape.counts;
        if least.is_some_and(|n| count < n) || most.is_some_and(|n| count > n) {
            let limit = |n: Option<u64>, none: &str| n.map_or(none.to_owned(), |n| n.to_string());
            let (least, most) = (limit(least, "0"), limit(most, "any"));
            self.walk
                .report(format!("found {count} items, expected {least} to {most}"));
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
        self.check(Type::Object, None);
        let shape = self.shape();
        let mut seen = vec![false; shape.members.len()];
        while let Some(key) = map.next_key_seed(Key(&shape.members))? {
            let at = match key {
                Ok(at) => at,
                Err(name) => {
                    let message =
                        format!("found a member {name:?}, which the format does not have");
                    self.walk.report(message);
                    map.next_value::<IgnoredAny>()?;
                    continue;
                }
            };
            let member = &shape.members[at];
            self.walk.path.push(Step::Member(&member.name));
            if std::mem::replace(&mut seen[at], true) {
                self.walk.report("the member is there twice".to_owned());
            }
            map.next_value_seed(Place {
                walk: &mut *self.walk,
                shape: member.shape,
            })?;
            self.walk.path.pop();
        }
        for (member, seen) in shape.members.iter().zip(seen) {
            if member.required && !seen {
                self.walk
                    .report(format!("found no member {:?}", member.name));
            }
        }
        Ok(())
    }
}

/// The name of a member: its number, or the name if it is unknown.
struct Key<'s>(&'s [Member]);

impl<'de> DeserializeSeed<'de> for Key<'_> {
    type Value = Result<usize, String>;

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<Self::Value, D::Error> {
        d.deserialize_str(self)
    }
}

impl<'de> Visitor<'de> for Key<'_> {
    type Value = Result<usize, String>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a member")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        let known = self.0.iter().position(|m| m.name == name);
        Ok(known.ok_or_else(|| name.chars().take(80).collect()))
    }
}

#[cfg(test)]
mod tests;
