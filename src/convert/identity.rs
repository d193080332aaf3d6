//! Everything that the output of a conversion depends on.

use crate::checkpoint::Identity;
use crate::convert::ConvertOptions;
use crate::grid::{Region, Shape, filters_text};
use crate::volume::Volume;
use serde::Serialize;

/// As the manifest writes it.
fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain data serialises")
}

/// A region of interest, and all that makes it another one.
fn region_text(region: &Region) -> String {
    let Region {
        shape,
        fill,
        fill_value,
        ..
    } = region;
    let of = match shape {
        Shape::Mask { checksum, .. } => format!(" ({checksum})"),
        Shape::Cylinder(_) => String::new(),
    };
    format!("{shape}{of} with {fill} of {fill_value} around it")
}

/// Of a conversion of `volume`, before it is cropped.
pub fn of(volume: &dyn Volume, options: &ConvertOptions) -> Identity {
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
    let (part, filtered) = (&options.source_part, options.source_filtered.as_ref());
    let asked_for = [
        ("--series", part.series.clone()),
        ("--resample", part.resample.then(|| "given".into())),
        ("--dataset", part.dataset.clone()),
        ("--level", part.level.map(|level| level.to_string())),
        ("--channel", part.channel.map(|channel| channel.to_string())),
        ("--time", part.time.map(|time| time.to_string())),
        ("values", options.source_values.clone()),
        ("filters", filtered.map(|f| filters_text(&f.filters))),
        (
            "--roi",
            options.region.as_ref().map(|r| region_text(&r.stated)),
        ),
        (
            "--table-unit",
            options.table_unit.map(|unit| unit.name().to_string()),
        ),
        ("--tables", options.parquet.then(|| "csv,parquet".into())),
    ];
    let given = asked_for.map(|(name, value)| value.map(|value| (name.to_string(), value)));
    list.extend(given.into_iter().flatten());
    Identity::new(list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Dtype, Filter, Filtered, Part, Placement};
    use crate::volume::{MemoryVolume, Stamp};

    #[test]
    fn differences_name_the_old_and_the_new_value() {
        let dims = Dims([2, 2, 2]);
        let volume = MemoryVolume::new(dims, Placement::default(), vec![0u8; 8]).unwrap();
        let options = ConvertOptions::default();
        let old = of(&volume, &options);
        let mut input = Stamp::default();
        input.values.push(("input".into(), "b.raw".into()));
        let other = ConvertOptions {
            threshold: 1.5,
            cap: true,
            source_part: Part {
                dataset: Some("b".into()),
                ..Part::default()
            },
            source_filtered: Some(Filtered {
                filters: vec![Filter::Invert {}, Filter::Downsample { factor: 2 }],
                dims: Dims([4, 4, 5]),
                dtype: Dtype::U8,
            }),
            input,
            // these change nothing
            memory: 7,
            threads: 3,
            force: true,
            ..options
        };
        let new = of(&volume, &other);
        let expected = [
            "input was nothing and is b.raw",
            "--threshold was 0 and is 1.5",
            "--cap was false and is true",
            "--dataset was nothing and is b",
            "filters was nothing and is invert, downsample 2",
        ];
        assert_eq!(new.differences(&old), expected);
        assert!(new.differences(&new).is_empty() && new.crc() != old.crc());
        assert_eq!(Identity::from_bytes(&old.to_bytes()), Some(old.clone()));
        assert_eq!(Identity::from_bytes(&old.to_bytes()[..30]), None);
    }
}
