//! What makes a piece of work this one: everything that its output depends on.

use serde::{Deserialize, Serialize};

/// Names and values, as a user knows them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity(Vec<(String, String)>);

impl Identity {
    /// Of names and values.
    pub fn new(list: Vec<(String, String)>) -> Self {
        Identity(list)
    }

    /// The names and values.
    pub fn into_list(self) -> Vec<(String, String)> {
        self.0
    }

    /// What of it was another in `before`, for people.
    pub fn differences(&self, before: &Identity) -> Vec<String> {
        let find = |list: &Identity, name: &str| {
            let found = list.0.iter().find(|(n, _)| n == name);
            found.map_or("nothing".to_string(), |(_, value)| value.clone())
        };
        let mut names: Vec<&String> = self.0.iter().map(|(name, _)| name).collect();
        names.extend(before.0.iter().map(|(name, _)| name));
        let mut out = Vec::new();
        for name in names {
            let (was, is) = (find(before, name), find(self, name));
            let line = format!("{name} was {was} and is {is}");
            if was != is && !out.contains(&line) {
                out.push(line);
            }
        }
        out
    }

    /// As the work directory keeps it.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = serde_json::to_vec_pretty(self).expect("plain data serialises");
        bytes.push(b'\n');
        bytes
    }

    /// What was kept; `None` if these bytes are damaged.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice(bytes).ok()
    }

    /// Ties checkpoints to it.
    pub fn crc(&self) -> u32 {
        crc32fast::hash(&self.to_bytes())
    }
}
