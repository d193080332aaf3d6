//! Which axes of an array are x, y and z, and which entry of every other one is read.

use crate::error::{Error, Result};
use crate::volume::options::OpenOptions;
use crate::volume::stated::axis::{self, LETTERS, Role};
use std::path::Path;

/// An axis of an array.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Axis {
    /// Empty if it has none.
    pub(crate) name: String,
    /// `space`, `time`, `channel` or another word, as OME-Zarr has it; empty if not stated.
    pub(crate) kind: String,
    pub(crate) size: u64,
}

/// The axes of a volume in an array.
#[derive(Debug, PartialEq)]
pub(crate) struct Chosen {
    /// Those that are x, y and z.
    pub(crate) axes: [usize; 3],
    /// The entry of every axis that is read; 0 for x, y and z.
    pub(crate) at: Vec<u64>,
    /// All of x, y and z are named.
    pub(crate) named: bool,
    pub(crate) notes: Vec<String>,
}

/// What axes stand for by their names and kinds.
fn roles(axes: &[Axis]) -> Vec<Role> {
    let by_name = axis::roles(axes.iter().map(|axis| axis.name.as_str()));
    let all = by_name
        .into_iter()
        .zip(axes)
        .map(|(role, axis)| match (axis.kind.as_str(), role) {
            ("time", _) => Role::Time,
            ("channel", _) => Role::Channel,
            ("space", role @ Role::Space(_)) | ("" | "array", role) => role,
            _ => Role::Other,
        });
    all.collect()
}

/// Axes and their sizes, for people: `c 3, z 12, y 20, x 28`.
pub(crate) fn list(axes: &[Axis]) -> String {
    let texts = axes.iter().map(|axis| match axis.name.is_empty() {
        true => axis.size.to_string(),
        false => format!("{} {}", axis.name, axis.size),
    });
    texts.collect::<Vec<_>>().join(", ")
}

/// Chooses the axes.
///
/// # Errors
/// [`Error::Usage`] if one of several channels or times is to be named, or is named wrongly; [`Error::Unsupported`]
/// with all axes and sizes if they make no volume.
pub(crate) fn choose(path: &Path, axes: &[Axis], options: &OpenOptions) -> Result<Chosen> {
    let roles = roles(axes);
    let mut notes = Vec::new();
    let volume = match space(axes, &roles, &mut notes) {
        Ok(volume) => volume,
        Err(why) => return Err(no_volume(path, axes, &why)),
    };
    let mut at = vec![0; axes.len()];
    for (role, option, wanted) in [
        (Role::Channel, "--channel", options.channel),
        (Role::Time, "--time", options.time),
    ] {
        let found = (0..axes.len()).filter(|&i| roles[i] == role && !volume.contains(&i));
        match (&found.collect::<Vec<_>>()[..], wanted) {
            ([], None) => {}
            ([], Some(n)) => {
                let expected =
                    format!("none, as the axes of {} are {}", path.display(), list(axes));
                return Err(Error::usage(option, n.to_string(), expected));
            }
            ([i], wanted) => {
                let size = axes[*i].size;
                at[*i] = entry(path, axes, option, wanted, size)?;
                if size > 1 {
                    notes.push(format!("{} {} of {size}", axes[*i].name, at[*i]));
                }
            }
            _ => return Err(no_volume(path, axes, "two axes of one kind")),
        }
    }
    for (i, axis) in axes.iter().enumerate() {
        let chosen = matches!(roles[i], Role::Channel | Role::Time) || volume.contains(&i);
        if !chosen && axis.size != 1 {
            let name = if axis.name.is_empty() {
                "one"
            } else {
                &axis.name
            };
            return Err(no_volume(
                path,
                axes,
                &format!("an axis besides x, y and z ({name})"),
            ));
        }
    }
    Ok(Chosen {
        axes: volume,
        at,
        named: (0..3).all(|a| roles.contains(&Role::Space(a))),
        notes,
    })
}

fn no_volume(path: &Path, axes: &[Axis], why: &str) -> Error {
    let what = format!("a Zarr array with {why}, of axes {}", list(axes));
    let hint = "volumes have the axes z, y and x, and others of one entry, or c and t of which --channel and --time \
                choose one: save that part as an array of its own";
    Error::unsupported(path, what, hint)
}

/// The entry of an axis that an option names, or its only one.
fn entry(path: &Path, axes: &[Axis], option: &str, wanted: Option<u32>, size: u64) -> Result<u64> {
    match wanted {
        None if size == 1 => Ok(0),
        Some(n) if u64::from(n) < size => Ok(n.into()),
        other => {
            let found = other.map_or("nothing".to_owned(), |n| n.to_string());
            let expected = format!(
                "0 to {}, as the axes of {} are {}",
                size.max(1) - 1,
                path.display(),
                list(axes)
            );
            Err(Error::usage(option, found, expected))
        }
    }
}

/// Which axes are x, y and z, or why none are.
fn space(axes: &[Axis], roles: &[Role], notes: &mut Vec<String>) -> Result<[usize; 3], String> {
    let turned = (0..axes.len()).find(|&i| roles[i] == Role::Angle && axes[i].size > 1);
    if let Some(i) = turned {
        return Err(format!("projections (along {})", axes[i].name));
    }
    let named: Vec<Vec<usize>> = (0..3)
        .map(|a| {
            (0..axes.len())
                .filter(|&i| roles[i] == Role::Space(a))
                .collect()
        })
        .collect();
    if named.iter().any(|of| of.len() > 1) {
        return Err("two axes of one kind".into());
    }
    let mut found = [0, 1, 2].map(|a| named[a].first().copied());
    // axes of other names, those with several entries first
    let mut free: Vec<usize> = (0..axes.len())
        .filter(|&i| roles[i] == Role::Other && axes[i].size > 1)
        .collect();
    let missing = found.iter().filter(|f| f.is_none()).count();
    if free.len() < missing {
        let single = (0..axes.len()).filter(|&i| roles[i] == Role::Other && axes[i].size <= 1);
        let single: Vec<usize> = single.collect();
        let spare = single.len().saturating_sub(missing - free.len());
        free.extend(&single[spare..]);
        free.sort_unstable();
    }
    if free.len() < missing {
        return Err("no three axes in space".into());
    }
    // of one name that is known and two that are not, nothing tells which is which
    let guessed = |&&i: &&usize| !axes[i].name.is_empty();
    if missing == 2 && free.iter().filter(guessed).count() == 2 {
        return Err("two axes that may be x, y or z".into());
    }
    if free.len() > missing {
        return match missing {
            0 => Ok(found.map(|f| f.unwrap_or(0))),
            _ => Err(format!("{} axes that may be x, y or z", axes.len())),
        };
    }
    // in the order z, y, x
    let mut rest = free.iter();
    for a in [2, 1, 0] {
        if found[a].is_none() {
            let i = *rest.next().unwrap_or(&0);
            found[a] = Some(i);
            let name = &axes[i].name;
            if !axis::is_made_up(name) {
                notes.push(format!("the axis {name} is taken as {}", LETTERS[a]));
            }
        }
    }
    Ok(found.map(|f| f.unwrap_or(0)))
}

/// True if an array of these axes may hold a volume, perhaps of a channel or time.
pub(crate) fn may_be_volume(axes: &[Axis]) -> bool {
    let roles = roles(axes);
    let others = (0..axes.len()).filter(|&i| roles[i] == Role::Other && axes[i].size > 1);
    let named = (0..3).filter(|&a| roles.contains(&Role::Space(a))).count();
    axes.len() >= 3
        && match space(axes, &roles, &mut Vec::new()) {
            Ok(volume) => others.filter(|i| !volume.contains(i)).count() == 0,
            // named to be refused with its axes rather than passed over
            Err(_) => named == 0 && others.count() >= 3,
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(text: &str) -> Vec<Axis> {
        let one = |word: &str| {
            let (name, size) = word.split_once('=').unwrap_or(("", word));
            Axis {
                name: name.into(),
                kind: String::new(),
                size: size.parse().unwrap(),
            }
        };
        text.split(' ').map(one).collect()
    }

    fn chosen(text: &str, options: &OpenOptions) -> Result<Chosen> {
        choose(Path::new("a.zarr"), &axes(text), options)
    }

    #[test]
    fn axes_by_name_and_by_place() {
        for (text, volume) in [
            ("x=4 y=5 z=6", [0, 1, 2]),
            ("Z=4 Y=5 X=6", [2, 1, 0]),
            ("width=4 height=5 depth=6", [0, 1, 2]),
            ("depth=4 height=5 width=6", [2, 1, 0]),
            ("plane=4 row=5 col=6", [2, 1, 0]),
            ("lon=4 lat=5 height=6", [0, 1, 2]),
            ("time=1 height=4 lat=5 lon=6", [3, 2, 1]),
            ("4 5 6", [2, 1, 0]),
            ("4 5 6 1", [2, 1, 0]),
            ("1 4 5 6 1", [3, 2, 1]),
            ("1 1 4 1", [3, 2, 1]),
            ("dim_0=4 dim_1=5 dim_2=6", [2, 1, 0]),
            ("y=4 x=5 q=6", [1, 0, 2]),
            ("x=4 c=1 y=5 t=1 z=6", [0, 2, 4]),
        ] {
            let found = chosen(text, &OpenOptions::default()).unwrap();
            assert_eq!(found.axes, volume, "{text}");
            assert_eq!(found.notes.len(), usize::from(text.contains('q')), "{text}");
            assert!(may_be_volume(&axes(text)), "{text}");
        }
    }

    #[test]
    fn one_of_several_entries_is_named() {
        let options = OpenOptions {
            channel: Some(2),
            time: Some(0),
            ..OpenOptions::default()
        };
        let found = chosen("t=1 c=3 z=4 y=5 x=6", &options).unwrap();
        assert_eq!((found.axes, &found.at[..2]), ([4, 3, 2], &[0, 2][..]));
        for (text, says) in [
            ("t=2 c=2 z=4 y=5 x=6", "--channel"),
            ("z=4 y=5 x=6", "--channel"),
            ("c=3 z=4 y=5 x=6", "--time"),
        ] {
            let error = chosen(text, &options).unwrap_err();
            assert!(matches!(error, Error::Usage { .. }), "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
        let error = chosen("c=3 z=4 y=5 x=6", &OpenOptions::default()).unwrap_err();
        assert!(error.to_string().contains("c 3, z 4, y 5, x 6"), "{error}");
    }

    #[test]
    fn other_axes_are_refused_with_the_list() {
        for (text, says) in [
            ("q=3 z=4 y=5 x=6", "q 3, z 4"),
            ("3 4 5 6", "3, 4, 5, 6"),
            ("t=3 y=5 x=6", "t 3, y 5"),
            ("5 6", "5, 6"),
            ("x=3 y=4 col=5", "col 5"),
            ("y=5 a=3 b=6 e=4", "a 3, b 6"),
            ("y=5 a=3 b=6", "a 3, b 6"),
            ("wavelength=3 y=5 x=6", "wavelength 3"),
            ("theta=3 y=5 x=6", "projections"),
        ] {
            let error = chosen(text, &OpenOptions::default()).unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn kinds_come_before_names() {
        let mut of_kind = axes("z=1 y=4 x=5 s=6");
        for (axis, kind) in of_kind
            .iter_mut()
            .zip(["channel", "space", "space", "space"])
        {
            axis.kind = kind.into();
        }
        let found = choose(Path::new("a.zarr"), &of_kind, &OpenOptions::default()).unwrap();
        assert_eq!(found.axes, [2, 1, 3]);
    }
}
