//! Everything that the output of a conversion depends on.

use crate::checkpoint::Identity;
use crate::grid::{Region, Shape, filters_text};
use crate::manifest::{Manifest, PartsBy};
use crate::volume::Stamp;
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

/// Labels, and all that makes them others.
fn labels_text(cells: &PartsBy) -> Option<String> {
    match cells {
        PartsBy::Labels { file, checksum, .. } => Some(format!("{file} ({checksum})")),
        PartsBy::Split { .. } => None,
    }
}

/// The rule of necks.
fn split_text(cells: &PartsBy) -> Option<String> {
    match cells {
        PartsBy::Split {
            version,
            ratio_permille,
            h_256,
            min_radius_256,
            ..
        } => {
            let thousandths = f64::from(*ratio_permille) / 1000.0;
            let [h, radius] = [*h_256, *min_radius_256].map(|v| f64::from(v) / 256.0);
            Some(format!(
                "{thousandths} with --split-h {h} and --split-min-radius {radius} (version {version})"
            ))
        }
        PartsBy::Labels { .. } => None,
    }
}

/// Of a conversion of this input to a tile set that states this.
pub fn of(input: &Stamp, asked: &Manifest) -> Identity {
    let mut list = vec![version(asked)];
    list.extend(input.values.iter().cloned());
    list.extend(stated(asked));
    Identity::new(list)
}

/// What a tile set states of how it was made.
pub fn of_set(manifest: &Manifest) -> Identity {
    let mut list = vec![version(manifest)];
    list.extend(stated(manifest));
    Identity::new(list)
}

fn version(manifest: &Manifest) -> (String, String) {
    ("version".to_string(), manifest.generator.version.clone())
}

fn stated(manifest: &Manifest) -> Vec<(String, String)> {
    let (source, place) = (&manifest.source, &manifest.placement);
    let crop = match &source.crop {
        Some(c) => format!("{:?},{:?},{:?}", c.x, c.y, c.z),
        None => "none".into(),
    };
    let [x, y, z] = manifest.grid.macrocube;
    let min_voxels = manifest.dust.map_or(1, |dust| dust.min_voxels);
    let always = [
        ("name", source.name.clone()),
        ("format", source.format.clone()),
        ("--dims", source.dims.to_string()),
        ("--dtype", source.dtype.name().into()),
        ("--endian", source.endian.name().into()),
        ("--offset", source.offset.to_string()),
        ("--spacing", format!("{:?}", place.spacing)),
        ("--unit", place.unit.name().into()),
        ("origin", format!("{:?}", place.origin)),
        ("directions", format!("{:?}", place.directions)),
        ("provenance", text(&source.provenance)),
        ("--threshold", manifest.threshold.to_string()),
        ("--macrocube", format!("{x},{y},{z}")),
        ("--ambiguous", text(&manifest.ambiguous)),
        ("--cap", manifest.cap.to_string()),
        ("--min-voxels", min_voxels.to_string()),
        ("--crop", crop),
        ("--primitives", text(&manifest.primitives)),
        ("--encoding", text(&manifest.encoding)),
        ("--layout", text(&manifest.layout)),
    ];
    let always = always.map(|(name, value)| (name.to_string(), value.replace('"', "")));
    let (part, filters) = (&source.part, &manifest.filters);
    let parquet = manifest.tables.parquet.is_some();
    let asked_for = [
        ("--series", part.series.clone()),
        ("--resample", part.resample.then(|| "given".into())),
        ("--dataset", part.dataset.clone()),
        ("--level", part.level.map(|level| level.to_string())),
        ("--channel", part.channel.map(|channel| channel.to_string())),
        ("--time", part.time.map(|time| time.to_string())),
        ("values", source.values.clone()),
        (
            "filters",
            (!filters.is_empty()).then(|| filters_text(filters)),
        ),
        ("--roi", manifest.region.as_ref().map(region_text)),
        ("--labels", manifest.cells.as_ref().and_then(labels_text)),
        ("--split", manifest.cells.as_ref().and_then(split_text)),
        (
            "--walls",
            manifest.tables.walls.as_ref().map(|_| "given".into()),
        ),
        (
            "--table-unit",
            manifest.table_unit.map(|unit| unit.name().to_string()),
        ),
        ("--tables", parquet.then(|| "csv,parquet".into())),
    ];
    let given = asked_for.map(|(name, value)| value.map(|value| (name.to_string(), value)));
    always
        .into_iter()
        .chain(given.into_iter().flatten())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::conversion::Conversion;
    use crate::convert::layers::Layers;
    use crate::convert::plan::plan;
    use crate::convert::{ConvertOptions, Volume};
    use crate::grid::{Dims, Dtype, Filter, Filtered, Part, Placement};
    use crate::progress::Quiet;
    use crate::volume::{MemoryVolume, Watch};

    fn identity(volume: &dyn Volume, options: &ConvertOptions) -> Identity {
        let plan = plan(
            volume,
            volume.header().dims,
            options,
            options.region.is_some(),
        )
        .unwrap();
        let job = Conversion {
            volume,
            grid: volume,
            region: None,
            options,
            plan: &plan,
            made: Layers::all(plan.tiling),
            watch: &Watch::new(volume.header(), false),
            progress: &Quiet,
        };
        of(&options.input, &job.asked())
    }

    #[test]
    fn differences_name_the_old_and_the_new_value() {
        let dims = Dims([2, 2, 2]);
        let volume = MemoryVolume::new(dims, Placement::default(), vec![0u8; 8]).unwrap();
        let options = ConvertOptions::default();
        let old = identity(&volume, &options);
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
                dims,
                dtype: Dtype::U8,
            }),
            input,
            // these change nothing
            memory: 1 << 29,
            threads: 3,
            force: true,
            ..options
        };
        let new = identity(&volume, &other);
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
