//! What makes a conversion this one: everything that its output depends on.

use crate::convert::ConvertOptions;
use crate::volume::Volume;
use serde::{Deserialize, Serialize};

/// As the manifest writes it.
fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain data serialises")
}

/// Names and values, as a user knows them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity(Vec<(String, String)>);

impl Identity {
    /// Of a conversion of `volume`, before it is cropped.
    pub fn of(volume: &dyn Volume, options: &ConvertOptions) -> Self {
        let header = volume.header();
        let place = header.placement;
        let mut list = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string())];
        list.extend(options.input.values.iter().cloned());
        let crop = match &options.crop {
            Some(c) => format!("{:?},{:?},{:?}", c.x, c.y, c.z),
            None => "none".into(),
        };
        let [x, y, z] = options.macrocube;
        let more = [
            ("name", options.source_name.clone()),
            ("format", header.format.into()),
            ("--dims", header.dims.to_string()),
            ("--dtype", header.dtype.name().into()),
            ("--endian", header.endian.name().into()),
            ("--offset", options.source_offset.to_string()),
            ("--spacing", format!("{:?}", place.spacing)),
            ("--unit", place.unit.name().into()),
            ("origin", format!("{:?}", place.origin)),
            ("directions", format!("{:?}", place.directions)),
            ("provenance", text(&options.provenance)),
            ("--threshold", options.threshold.to_string()),
            ("--macrocube", format!("{x},{y},{z}")),
            ("--ambiguous", text(&options.ambiguous)),
            ("--cap", options.cap.to_string()),
            ("--min-voxels", options.min_voxels.max(1).to_string()),
            ("--crop", crop),
            ("--primitives", text(&options.primitives)),
            ("--encoding", text(&options.encoding)),
            ("--layout", text(&options.layout)),
        ];
        list.extend(more.map(|(name, value)| (name.to_string(), value.replace('"', ""))));
        let part = &options.source_part;
        let asked_for = [
            ("--series", part.series.clone()),
            ("--resample", part.resample.then(|| "given".into())),
            ("--dataset", part.dataset.clone()),
            ("--level", part.level.map(|level| level.to_string())),
            ("--channel", part.channel.map(|channel| channel.to_string())),
            ("--time", part.time.map(|time| time.to_string())),
            ("values", options.source_values.clone()),
            (
                "--table-unit",
                options.table_unit.map(|unit| unit.name().to_string()),
            ),
        ];
        let given = asked_for.map(|(name, value)| value.map(|value| (name.to_string(), value)));
        list.extend(given.into_iter().flatten());
        Identity(list)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::manifest::Part;
    use crate::volume::{MemoryVolume, Stamp};

    #[test]
    fn differences_name_the_old_and_the_new_value() {
        let dims = Dims([2, 2, 2]);
        let volume = MemoryVolume::new(dims, Placement::default(), vec![0u8; 8]).unwrap();
        let options = ConvertOptions::default();
        let old = Identity::of(&volume, &options);
        let mut input = Stamp::default();
        input.values.push(("input".into(), "b.raw".into()));
        let other = ConvertOptions {
            threshold: 1.5,
            cap: true,
            source_part: Part {
                dataset: Some("b".into()),
                ..Part::default()
            },
            input,
            // these change nothing
            memory: 7,
            threads: 3,
            force: true,
            ..options
        };
        let new = Identity::of(&volume, &other);
        let expected = [
            "input was nothing and is b.raw",
            "--threshold was 0 and is 1.5",
            "--cap was false and is true",
            "--dataset was nothing and is b",
        ];
        assert_eq!(new.differences(&old), expected);
        assert!(new.differences(&new).is_empty() && new.crc() != old.crc());
        assert_eq!(Identity::from_bytes(&old.to_bytes()), Some(old.clone()));
        assert_eq!(Identity::from_bytes(&old.to_bytes()[..30]), None);
    }
}
