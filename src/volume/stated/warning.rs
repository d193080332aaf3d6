//! Warnings of an input, and what settles them.

/// What may make numbers wrong unless the user does something about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Warning {
    text: String,
    of_size: bool,
}

impl Warning {
    /// A warning that has no cause any more where `--spacing` states the size of a voxel.
    pub(crate) fn of_size(text: impl Into<String>) -> Self {
        Warning {
            text: text.into(),
            of_size: true,
        }
    }
}

impl From<String> for Warning {
    fn from(text: String) -> Self {
        Warning {
            text,
            of_size: false,
        }
    }
}

impl From<&str> for Warning {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl std::ops::Deref for Warning {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}

/// Names of keys by which people state a scale, without what separates words.
const SCALES: [&str; 12] = [
    "rescaleslope",
    "rescaleintercept",
    "scaleslope",
    "scaleintercept",
    "sclslope",
    "sclinter",
    "slope",
    "intercept",
    "scalefactor",
    "addoffset",
    "rescaletype",
    "scaling",
];

/// What to say of keys that a format gives no meaning, by which people state a scale that is not that of stored samples.
pub(crate) fn unapplied_scale<'a>(
    keys: impl Iterator<Item = (&'a str, &'a str)>,
) -> Option<Warning> {
    let is_scale = |name: &str, value: &str| {
        let name = crate::volume::stated::written::plain(name);
        let like = SCALES.iter().any(|scale| name.ends_with(scale));
        let none = if name.ends_with("slope") || name.ends_with("factor") {
            1.0
        } else {
            0.0
        };
        // a key that says that nothing is scaled needs no word
        like && value.parse::<f64>().is_ok_and(|v| v != none)
    };
    let mut found: Vec<String> = keys
        .filter(|(name, value)| is_scale(name, value))
        .map(|(name, value)| format!("{name} {value}"))
        .collect();
    found.sort();
    (!found.is_empty()).then(|| {
        format!(
            "the file states {}, which is not applied, since the format gives such keys no meaning: values are as they \
             are stored",
            found.join(" and ")
        )
        .into()
    })
}

/// The texts of warnings, without those that `--spacing` settles if it is given.
pub(crate) fn texts(all: Vec<Warning>, spacing: bool) -> Vec<String> {
    let left = all.into_iter().filter(|w| !(spacing && w.of_size));
    left.map(|w| w.text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stated_size_settles_warnings_of_size_alone() {
        let all = || vec![Warning::of_size("size"), "give --spacing".into()];
        assert_eq!(texts(all(), false), ["size", "give --spacing"]);
        assert_eq!(texts(all(), true), ["give --spacing"]);
    }
}
