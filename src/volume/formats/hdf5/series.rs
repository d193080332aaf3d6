//! Files that hold one image as many datasets: levels, times and channels of Imaris, BigDataViewer and MINC.

use crate::error::{Error, Result};
use crate::volume::formats::hdf5::attributes::Attributes;
use crate::volume::formats::hdf5::geometry::{Along, Geometry};
use crate::volume::formats::hdf5::minc;
use crate::volume::formats::hdf5::place::Place;
use crate::volume::formats::hdf5::tree::{Item, Tree};
use crate::volume::options::OpenOptions;
use crate::volume::stated::size::shortest_near;
use hdf5_reader::Hdf5File;
use std::collections::BTreeSet;
use std::path::Path;

/// Whose layout a dataset is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Imaris,
    BigDataViewer,
    Minc,
}

/// One dataset of such a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Member {
    pub(crate) kind: Kind,
    pub(crate) level: u32,
    time: u32,
    channel: u32,
}

impl Member {
    /// What a name says in the layout of the file.
    pub(crate) fn of(name: &str) -> Option<Member> {
        let parts: Vec<&str> = name.trim_matches('/').split('/').collect();
        let number = |part: &str, front: &str| part.strip_prefix(front)?.parse::<u32>().ok();
        let of = |kind, level, time, channel| Member {
            kind,
            level,
            time,
            channel,
        };
        match parts[..] {
            [_, level, time, channel, "Data"] => Some(of(
                Kind::Imaris,
                number(level, "ResolutionLevel ")?,
                number(time, "TimePoint ")?,
                number(channel, "Channel ")?,
            )),
            [time, setup, level, "cells"] if time.len() > 1 && setup.len() > 1 => Some(of(
                Kind::BigDataViewer,
                number(level, "")?,
                number(time, "t")?,
                number(setup, "s")?,
            )),
            _ => Some(of(Kind::Minc, minc::level(name)?, 0, 0)),
        }
    }
}

/// An option, what it counts, its value, and the same of a member.
type Part = (&'static str, &'static str, Option<u32>, fn(&Member) -> u32);

/// The dataset that the options ask for, and what to say of it; `None` if the file is not of such a layout.
///
/// # Errors
/// [`Error::Usage`] with the numbers that there are.
pub(crate) fn choose(
    path: &Path,
    tree: &Tree,
    options: &OpenOptions,
) -> Result<Option<(String, Vec<String>)>> {
    let datasets = tree
        .items
        .iter()
        .filter(|(_, item)| matches!(item, Item::Dataset(_)));
    let all: Vec<(&str, Member)> = datasets
        .filter_map(|(name, _)| Some((name.as_str(), Member::of(name)?)))
        .collect();
    if all.is_empty() {
        return Ok(None);
    }
    let mut left = all;
    let mut notes = Vec::new();
    let parts: [Part; 3] = [
        ("--time", "time", options.time, |m| m.time),
        ("--channel", "channel", options.channel, |m| m.channel),
        ("--level", "level", options.level, |m| m.level),
    ];
    // times and channels of MINC are axes of its arrays
    let of_arrays = left.iter().all(|(_, m)| m.kind == Kind::Minc);
    for (option, word, wanted, of) in parts {
        if of_arrays && option != "--level" {
            continue;
        }
        let there: BTreeSet<u32> = left.iter().map(|(_, m)| of(m)).collect();
        let numbers: Vec<String> = there.iter().map(u32::to_string).collect();
        let list = || {
            format!(
                "one of {}, as {} has them",
                numbers.join(", "),
                path.display()
            )
        };
        let number = match wanted {
            Some(number) if there.contains(&number) => number,
            Some(number) => return Err(Error::usage(option, number.to_string(), list())),
            None if option == "--level" || there.len() == 1 => there.first().copied().unwrap_or(0),
            None => {
                let found = format!("nothing, and {} {word}s in {}", there.len(), path.display());
                let expected = format!("one of {}", numbers.join(", "));
                return Err(Error::usage(option, found, expected));
            }
        };
        if there.len() > 1 || wanted.is_some() {
            let finest = if option == "--level" {
                " (0 is the finest)"
            } else {
                ""
            };
            notes.push(format!("{word} {number} of {}{finest}", there.len()));
        }
        left.retain(|(_, m)| of(m) == number);
    }
    Ok(left.first().map(|(name, _)| ((*name).to_owned(), notes)))
}

/// The true size of an Imaris image, x first, whose array is padded to whole chunks; `None` if the file does not say.
pub(crate) fn true_size(place: &Place) -> Option<[u64; 3]> {
    let of = |name: &str| place.group.text(name)?.trim().parse().ok();
    Some([of("ImageSizeX")?, of("ImageSizeY")?, of("ImageSizeZ")?])
}

/// The size of a voxel of an Imaris image of that many voxels, by the extent of the image.
pub(crate) fn extent(file: &Hdf5File, size: [u64; 3]) -> Geometry {
    let mut geometry = Geometry::default();
    let Ok(group) = file.group("DataSetInfo/Image") else {
        return geometry;
    };
    let attributes = Attributes(group.attributes().unwrap_or_default());
    let number = |name: String| attributes.text(&name)?.trim().parse::<f64>().ok();
    let unit = attributes.text("Unit").unwrap_or_default();
    for (a, along) in geometry.along.iter_mut().enumerate() {
        let (Some(low), Some(high)) = (number(format!("ExtMin{a}")), number(format!("ExtMax{a}")))
        else {
            continue;
        };
        let doubt = 4.0 * f64::EPSILON * low.abs().max(high.abs());
        let step = shortest_near((high - low) / size[a] as f64, doubt);
        // the extent is from edge to edge
        *along = Some(Along {
            start: shortest_near(low + step / 2.0, doubt),
            ..Along::of(step, &unit)
        });
    }
    geometry
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_level_time_and_channel() {
        let of = |kind, level, time, channel| {
            Some(Member {
                kind,
                level,
                time,
                channel,
            })
        };
        for (name, member) in [
            (
                "/DataSet/ResolutionLevel 1/TimePoint 2/Channel 3/Data",
                of(Kind::Imaris, 1, 2, 3),
            ),
            (
                "/DataSet/ResolutionLevel 1/TimePoint 2/Channel 3/Histogram",
                None,
            ),
            ("/t00001/s02/3/cells", of(Kind::BigDataViewer, 3, 1, 2)),
            ("/minc-2.0/image/1/image", of(Kind::Minc, 1, 0, 0)),
            ("/minc-2.0/image/0/image-min", None),
            ("/t/s/3/cells", None),
            ("/exchange/data", None),
        ] {
            assert_eq!(Member::of(name), member, "{name}");
        }
    }
}
