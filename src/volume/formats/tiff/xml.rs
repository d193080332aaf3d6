//! XML in tags, element by element.

use crate::error::{Error, Result};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::io::BufRead;
use std::path::Path;

/// Elements within elements beyond this are not looked into.
const MAX_DEPTH: usize = 64;

/// An element, without the prefix of its namespace.
pub(crate) struct Element<'a> {
    pub(crate) name: &'a str,
    attributes: &'a [(String, String)],
    /// `None` where the element begins, its text where it ends.
    pub(crate) text: Option<&'a str>,
}

impl Element<'_> {
    /// The value of an attribute.
    pub(crate) fn get(&self, name: &str) -> Option<&str> {
        let mut all = self.attributes.iter();
        all.find(|(key, _)| key == name)
            .map(|(_, value)| value.as_str())
    }

    /// A number from 0 up.
    pub(crate) fn whole(&self, name: &str) -> Option<u64> {
        self.get(name)?.trim().parse().ok()
    }
}

/// An element that has begun and not ended.
struct Begun {
    name: String,
    attributes: Vec<(String, String)>,
    text: String,
}

/// Hands every element of a document to `see`, where it begins and where it ends.
///
/// # Errors
/// [`Error::Format`] for what is no XML, and what `see` returns.
pub(crate) fn elements(
    path: &Path,
    from: impl BufRead,
    mut see: impl FnMut(&Element) -> Result<()>,
) -> Result<()> {
    let wrong = |reason: String| {
        Error::format(
            path,
            format!("damaged XML in a tag ({reason})"),
            "sound XML",
        )
    };
    let mut reader = Reader::from_reader(from);
    let (mut buffer, mut open) = (Vec::new(), Vec::<Begun>::new());
    let mut seen = false;
    loop {
        buffer.clear();
        let event = reader.read_event_into(&mut buffer);
        match event.map_err(|e| wrong(e.to_string()))? {
            Event::Start(start) => {
                open.push(begin(&start).map_err(&wrong)?);
                if open.len() > MAX_DEPTH {
                    return Err(wrong(format!(
                        "more than {MAX_DEPTH} elements in one another"
                    )));
                }
                tell(&open[open.len() - 1], false, &mut see)?;
            }
            Event::Empty(start) => {
                let begun = begin(&start).map_err(&wrong)?;
                tell(&begun, false, &mut see)?;
                tell(&begun, true, &mut see)?;
            }
            Event::End(_) => {
                if let Some(begun) = open.pop() {
                    tell(&begun, true, &mut see)?;
                }
            }
            Event::Text(text) => keep(&mut open, &text),
            Event::CData(text) => keep(&mut open, &text),
            Event::Eof if open.is_empty() => return Ok(()),
            Event::Eof => return Err(wrong("it ends before its elements do".into())),
            _ => {}
        }
        // what follows the document is the end of its tag
        seen |= !open.is_empty();
        if seen && open.is_empty() {
            return Ok(());
        }
    }
}

/// Texts of elements that are looked at are short.
fn keep(open: &mut [Begun], text: &str) {
    if let Some(begun) = open.last_mut()
        && begun.text.len() + text.len() < 4096
    {
        begun.text.push_str(text);
    }
}

fn tell(begun: &Begun, ends: bool, see: &mut impl FnMut(&Element) -> Result<()>) -> Result<()> {
    see(&Element {
        name: &begun.name,
        attributes: &begun.attributes,
        text: ends.then_some(begun.text.trim()),
    })
}

fn begin(start: &BytesStart) -> Result<Begun, String> {
    let mut attributes = Vec::new();
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|e| e.to_string())?;
        let value = quick_xml::escape::unescape(&attribute.value).map_err(|e| e.to_string())?;
        let name = attribute.key.local_name().into_inner().to_owned();
        attributes.push((name, value.into_owned()));
    }
    Ok(Begun {
        name: start.local_name().into_inner().to_owned(),
        attributes,
        text: String::new(),
    })
}
