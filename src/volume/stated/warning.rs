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
