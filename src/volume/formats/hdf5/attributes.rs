//! Attributes of datasets and groups, as numbers and text.

use crate::grid::length::shortest;
use crate::volume::stated::written::{Held, Written};
use hdf5_reader::attribute_api::Attribute;
use hdf5_reader::{Dataset, Datatype, StringSize};

/// Longer lists are no coordinates of an axis, and no scales of slices.
const MAX_NUMBERS: u64 = 1 << 17;

/// The attributes of an object.
#[derive(Default)]
pub(crate) struct Attributes(pub(crate) Vec<Attribute>);

impl Attributes {
    pub(crate) fn get(&self, name: &str) -> Option<&Attribute> {
        self.0.iter().find(|a| a.name == name)
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.get(name).is_some()
    }

    /// All numbers of an attribute, of whatever type; single precision reads as it was written.
    pub(crate) fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let attribute = self.get(name)?;
        numbers(attribute).or_else(|| texts(attribute).iter().map(|t| t.parse().ok()).collect())
    }

    /// The number of an attribute that has one.
    pub(crate) fn number(&self, name: &str) -> Option<f64> {
        match self.numbers(name)?[..] {
            [number] => Some(number),
            _ => None,
        }
    }

    /// What they hold.
    pub(crate) fn written(&self) -> Written {
        let mut written = Written::default();
        for Attribute { name, .. } in &self.0 {
            let held = match (self.numbers(name), self.texts(name)) {
                (Some(numbers), _) if !numbers.is_empty() => Held::Numbers(numbers),
                (_, texts) if !texts.is_empty() => {
                    if let [one] = &texts[..]
                        && one.starts_with('{')
                        && let Ok(json) = serde_json::from_str(one)
                    {
                        written.add_json(name, &json);
                        continue;
                    }
                    match self.text(name) {
                        Some(joined) if texts.len() > 3 => Held::Texts(vec![joined]),
                        _ => Held::Texts(texts),
                    }
                }
                _ => Held::Other,
            };
            written.add(name, held);
        }
        written
    }

    /// All texts of an attribute; none if it is no text.
    pub(crate) fn texts(&self, name: &str) -> Vec<String> {
        self.get(name).map(texts).unwrap_or_default()
    }

    /// The text of an attribute; one of single characters is joined.
    pub(crate) fn text(&self, name: &str) -> Option<String> {
        let all = self.texts(name);
        match &all[..] {
            [] => None,
            [one] => Some(one.clone()),
            many if many.iter().all(|t| t.chars().count() <= 1) => Some(many.concat()),
            _ => None,
        }
    }
}

fn numbers(attribute: &Attribute) -> Option<Vec<f64>> {
    fn whole<T: hdf5_reader::H5Type + Copy>(a: &Attribute, f: fn(T) -> f64) -> Option<Vec<f64>> {
        Some(a.read_1d::<T>().ok()?.into_iter().map(f).collect())
    }
    match attribute.datatype {
        Datatype::FloatingPoint { size: 4, .. } => whole::<f32>(attribute, shortest),
        Datatype::FloatingPoint { size: 8, .. } => whole::<f64>(attribute, |v| v),
        Datatype::FixedPoint { size, signed, .. } => match (size, signed) {
            (1, false) => whole::<u8>(attribute, f64::from),
            (1, true) => whole::<i8>(attribute, f64::from),
            (2, false) => whole::<u16>(attribute, f64::from),
            (2, true) => whole::<i16>(attribute, f64::from),
            (4, false) => whole::<u32>(attribute, f64::from),
            (4, true) => whole::<i32>(attribute, f64::from),
            (8, false) => whole::<u64>(attribute, |v| v as f64),
            (8, true) => whole::<i64>(attribute, |v| v as f64),
            _ => None,
        },
        _ => None,
    }
}

fn texts(attribute: &Attribute) -> Vec<String> {
    let trimmed = |text: &str| text.trim_end_matches(['\0', ' ']).to_owned();
    match attribute.datatype {
        Datatype::String {
            size: StringSize::Fixed(len),
            ..
        } if len > 0 => {
            let all = attribute.raw_data.chunks_exact(len as usize);
            all.map(|raw| trimmed(&decoded(raw))).collect()
        }
        _ => {
            let all = attribute.read_strings();
            let all = all.or_else(|_| attribute.read_string().map(|t| vec![t]));
            all.unwrap_or_default().iter().map(|t| trimmed(t)).collect()
        }
    }
}

/// Text up to its first 0: UTF-8, or Latin 1 where it is none, as in `µm` of older writers.
fn decoded(raw: &[u8]) -> String {
    let end = raw.iter().position(|&b| b == 0).unwrap_or(raw.len());
    match std::str::from_utf8(&raw[..end]) {
        Ok(text) => text.to_owned(),
        Err(_) => raw[..end].iter().map(|&b| char::from(b)).collect(),
    }
}

/// The numbers of a short dataset.
pub(crate) fn numbers_of(dataset: &Dataset) -> Option<Vec<f64>> {
    if dataset.num_elements().ok()? > MAX_NUMBERS {
        return None;
    }
    numbers(&Attribute {
        name: String::new(),
        datatype: dataset.dtype().clone(),
        shape: dataset.shape().to_vec(),
        raw_data: dataset.read_raw_bytes().ok()?,
        decoded_strings: None,
    })
}
