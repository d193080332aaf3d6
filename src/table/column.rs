//! Columns of a table: names, units, and which one is meant.

use crate::error::{Error, Result};

/// A column: its name, and its unit or nothing.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Column {
    /// `volume`.
    pub name: String,
    /// `mm^3`; empty for a plain number.
    pub unit: String,
}

impl Column {
    /// Reads `volume [mm^3]`.
    pub(super) fn parse(text: &str) -> Self {
        let text = text.trim();
        let split = text
            .strip_suffix(']')
            .and_then(|t| t.split_once('['))
            .map(|(name, unit)| (name.trim_end(), unit));
        let (name, unit) = split.unwrap_or((text, ""));
        Column {
            name: name.to_string(),
            unit: unit.to_string(),
        }
    }

    /// `volume [mm^3]`.
    pub fn header(&self) -> String {
        if self.unit.is_empty() {
            self.name.clone()
        } else {
            format!("{} [{}]", self.name, self.unit)
        }
    }

    /// True for the column's name, and for that with its unit.
    pub fn is_named(&self, text: &str) -> bool {
        self.name == text || self.header() == text
    }

    /// True if the values are 0 and 1 and mean a condition.
    pub fn is_condition(&self) -> bool {
        ["touches_border", "thin", "neighbour"].contains(&self.name.as_str())
    }

    /// True if some of the values may be missing where cells are parts of components, though they are whole numbers.
    pub fn may_lack_whole(&self) -> bool {
        ["euler_characteristic", "component"].contains(&self.name.as_str())
    }

    /// True if the values are counts, ids or other whole numbers, none of which is missing but as
    /// [`may_lack_whole`](Self::may_lack_whole) says.
    pub fn is_whole(&self) -> bool {
        const WHOLE: [&str; 17] = [
            "id",
            "voxels",
            "euler_characteristic",
            "tiles",
            "cell",
            "object",
            "triangles",
            "vertices",
            "border_edges",
            "component",
            "neighbours",
            "necks",
            "cell_a",
            "cell_b",
            "chords",
            "thin",
            "neighbour",
        ];
        WHOLE.contains(&self.name.as_str())
    }
}

/// The names of columns, with commas between them.
pub(super) fn names(columns: &[Column]) -> String {
    let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
    names.join(", ")
}

/// The place of a column by its name, or by its name and unit as in the table's head.
///
/// # Errors
/// [`Error::Usage`] with the names that there are, as of `option`.
pub fn find_column(option: &str, name: &str, columns: &[Column]) -> Result<usize> {
    let name = name.trim();
    let found = columns.iter().position(|c| c.is_named(name));
    found.ok_or_else(|| {
        Error::usage(option, name, format!("a column: {}", names(columns)))
            .with_hint(did_you_mean(name, columns))
    })
}

/// Names the column that a name is most like, if it is like one at all.
pub(super) fn did_you_mean(name: &str, columns: &[Column]) -> String {
    // a letter in three may be wrong; a part of a name is like it, too, but less
    const LETTERS: usize = 3;
    let name = name.to_lowercase();
    let likeness = |column: &Column| {
        let wrong = strsim::damerau_levenshtein(&name, &column.name);
        let part = name.len() >= LETTERS && column.name.contains(&name);
        match wrong <= name.chars().count().div_ceil(LETTERS) {
            true => Some(wrong),
            false => part.then_some(usize::MAX),
        }
    };
    let like = columns.iter().filter_map(|c| Some((likeness(c)?, &c.name)));
    like.min_by_key(|(wrong, _)| *wrong)
        .map_or(String::new(), |(_, name)| format!("did you mean `{name}`?"))
}
