//! Which axes of an array are x, y and z, by their names or their number.

use crate::volume::stated::axis::{LETTERS, Role, is_made_up, roles};

/// Names of the axes of an array, and who says so.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Names {
    pub(crate) names: Vec<String>,
    /// The attribute or convention, for people.
    pub(crate) by: String,
}

impl Names {
    /// Names out of text as `z:y:x`, `[z, y, x]` or `zyx`, if it has as many as there are axes.
    pub(crate) fn split(text: &str, axes: usize, by: &str) -> Option<Names> {
        let separators = [':', ',', ';', ' ', '|', '[', ']', '(', ')', '\'', '"'];
        let mut names: Vec<String> = text
            .split(separators)
            .filter(|part| !part.is_empty())
            .map(str::to_owned)
            .collect();
        if let [word] = &names[..]
            && word.chars().count() == axes
        {
            names = word.chars().map(String::from).collect();
        }
        Names::new(names, axes, by)
    }

    /// These names, if there are as many as axes and any says something.
    pub(crate) fn new(names: Vec<String>, axes: usize, by: &str) -> Option<Names> {
        let says = |name: &String| !matches!(name.trim(), "" | "." | "?");
        (names.len() == axes && names.iter().any(says)).then(|| Names {
            names,
            by: by.to_owned(),
        })
    }

    /// Where x, y and z are, if all three have names that are known.
    fn known(&self) -> Option<[usize; 3]> {
        let roles = self.roles();
        let at = |a| roles.iter().position(|role| *role == Role::Space(a));
        Some([at(0)?, at(1)?, at(2)?])
    }

    fn roles(&self) -> Vec<Role> {
        roles(self.names.iter().map(String::as_str))
    }

    fn list(&self) -> String {
        self.names.join(", ")
    }
}

/// The first of several, unless two that are known contradict each other.
///
/// # Errors
/// The contradiction, for people.
pub(crate) fn agreed(all: Vec<Names>) -> Result<Option<Names>, String> {
    let known: Vec<&Names> = all.iter().filter(|n| n.known().is_some()).collect();
    if let [first, rest @ ..] = &known[..]
        && let Some(other) = rest.iter().find(|n| n.known() != first.known())
    {
        return Err(format!(
            "its axes are {} as {} says, and {} as {} says",
            first.list(),
            first.by,
            other.list(),
            other.by
        ));
    }
    Ok(known.first().copied().or(all.first()).cloned())
}

/// The axes of an array.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Axes {
    /// Which axes of the array x, y and z are.
    pub(crate) volume: [usize; 3],
    /// Which is that of channels and which that of times, if they have more than one entry.
    pub(crate) channel: Option<usize>,
    pub(crate) time: Option<usize>,
    /// The file names all of x, y and z.
    pub(crate) named: bool,
    /// What a user should know of it.
    pub(crate) note: Option<String>,
}

/// A shape as text: `12 x 20 x 28`.
pub(crate) fn shape_text(shape: &[u64]) -> String {
    let shape: Vec<String> = shape.iter().map(u64::to_string).collect();
    match shape.len() {
        0 => "one element".into(),
        _ => shape.join(" x "),
    }
}

impl Axes {
    /// The axes of an array of this shape. Without names x is the last one of those with more than one entry.
    ///
    /// # Errors
    /// Why the array is no volume.
    pub(crate) fn of(shape: &[u64], names: Option<&Names>) -> Result<Axes, String> {
        let many: Vec<usize> = (0..shape.len()).filter(|&a| shape[a] != 1).collect();
        if let Some(empty) = many.iter().find(|&&a| shape[a] == 0) {
            return Err(format!("axis {empty} has no entries"));
        }
        match names {
            Some(names) => Self::named(shape, names, &many),
            None => match many[..] {
                [z, y, x] => Ok(Axes {
                    volume: [x, y, z],
                    ..Axes::default()
                }),
                _ if many.len() > 3 => Err(format!(
                    "{} axes have more than one entry, and the file does not state which are x, y and z",
                    many.len()
                )),
                _ => Err(few(many.len())),
            },
        }
    }

    fn named(shape: &[u64], names: &Names, many: &[usize]) -> Result<Axes, String> {
        let roles = names.roles();
        let says = || format!("its axes are {}, as {} says", names.list(), names.by);
        let mut axes = Axes::default();
        let mut space = [None; 3];
        let mut unknown = Vec::new();
        for (at, role) in roles.iter().enumerate() {
            let slot = match role {
                Role::Space(a) => &mut space[*a],
                _ if shape[at] == 1 => continue,
                Role::Channel => &mut axes.channel,
                Role::Time => &mut axes.time,
                Role::Angle => {
                    return Err(format!("these are projections: {}", says()));
                }
                Role::Other => {
                    unknown.push(at);
                    continue;
                }
            };
            if slot.replace(at).is_some() {
                return Err(format!("two axes have the same meaning: {}", says()));
            }
        }
        let missing: Vec<usize> = [2, 1, 0]
            .into_iter()
            .filter(|&a| space[a].is_none())
            .collect();
        match (missing.len(), unknown.len()) {
            (0, 0) => axes.named = true,
            (n @ (1 | 3), m) if n == m => {
                for (&a, &at) in missing.iter().zip(&unknown) {
                    space[a] = Some(at);
                }
                axes.note = guessed(names, &missing, &unknown);
            }
            (_, 0) if many.len() < 3 => return Err(few(many.len())),
            (_, 0) => {
                let missing: Vec<&str> = missing.iter().map(|&a| LETTERS[a]).collect();
                return Err(format!(
                    "{}, of which none is {}: give the axes those names if they are in space",
                    says(),
                    missing.join(" or ")
                ));
            }
            _ => return Err(says()),
        }
        let [Some(x), Some(y), Some(z)] = space else {
            return Err(says());
        };
        axes.volume = [x, y, z];
        if let Some(flat) = axes.volume.iter().position(|&at| shape[at] == 1) {
            return Err(format!("axis {} has one entry", LETTERS[flat]));
        }
        if !(z < y && y < x) {
            axes.note = Some(format!("axes {}, as {} says", names.list(), names.by));
        }
        Ok(axes)
    }
}

/// What to say of axes of names that are not known, unless their writer made these up.
fn guessed(names: &Names, missing: &[usize], unknown: &[usize]) -> Option<String> {
    let names: Vec<&str> = unknown.iter().map(|&at| names.names[at].as_str()).collect();
    if names.iter().all(|name| is_made_up(name)) {
        return None;
    }
    let letters: Vec<&str> = missing.iter().map(|&a| LETTERS[a]).collect();
    let (axes, are) = match names.len() {
        1 => ("axis", "is"),
        _ => ("axes", "are"),
    };
    Some(format!(
        "the {axes} {} {are} taken as {}",
        names.join(", "),
        letters.join(", ")
    ))
}

fn few(many: usize) -> String {
    match many {
        0 => "it is a single number".into(),
        1 => "it is a list: one axis has more than one entry".into(),
        _ => "it is an image: two axes have more than one entry".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(shape: &[u64], names: &str) -> Result<Axes, String> {
        Axes::of(shape, Names::split(names, shape.len(), "test").as_ref())
    }

    fn volume(shape: &[u64], names: &str) -> [usize; 3] {
        of(shape, names).unwrap().volume
    }

    #[test]
    fn axes_of_one_entry_go_wherever_they_are() {
        for shape in [
            &[3, 4, 5][..],
            &[1, 3, 4, 5],
            &[3, 1, 4, 5],
            &[3, 4, 5, 1],
            &[1, 3, 1, 4, 5, 1],
        ] {
            let volume = volume(shape, "").map(|a| shape[a]);
            assert_eq!(volume, [5, 4, 3], "{shape:?}");
        }
        for shape in [
            &[][..],
            &[5],
            &[4, 5],
            &[1, 4, 5],
            &[2, 3, 4, 5],
            &[3, 0, 5],
        ] {
            assert!(of(shape, "").is_err(), "{shape:?}");
        }
    }

    #[test]
    fn names_decide_in_any_spelling() {
        assert_eq!(volume(&[3, 4, 5], "z:y:x"), [2, 1, 0]);
        assert_eq!(volume(&[3, 4, 5], "xyz"), [0, 1, 2]);
        assert_eq!(volume(&[3, 4, 5], "['Y', 'X', 'Z']"), [1, 0, 2]);
        assert_eq!(volume(&[3, 4, 5], "xspace,zspace,yspace"), [0, 2, 1]);
        assert_eq!(volume(&[3, 4, 5], "rows columns slices"), [1, 0, 2]);
        let axes = of(&[2, 3, 4, 5, 6], "tzyxc").unwrap();
        assert_eq!(axes.volume, [3, 2, 1]);
        assert_eq!((axes.time, axes.channel), (Some(0), Some(4)));
        let axes = of(&[1, 3, 4, 5, 1], "tzyxc").unwrap();
        assert_eq!((axes.time, axes.channel), (None, None));
    }

    #[test]
    fn unknown_names_stand_for_what_is_left() {
        assert_eq!(volume(&[3, 4, 5], "a,b,e"), [2, 1, 0]);
        assert_eq!(volume(&[3, 4, 5], "y,x,q"), [1, 0, 2]);
        for (names, note) in [
            ("a,b,e", Some("the axes a, b, e are taken as z, y, x")),
            ("q,y,x", Some("the axis q is taken as z")),
            ("dim_0,dim_1,dim_2", None),
            ("level,lat,lon", None),
        ] {
            let found = of(&[3, 4, 5], names).unwrap();
            assert_eq!((found.volume, found.note.as_deref()), ([2, 1, 0], note));
        }
        for (shape, names, says) in [
            (&[3, 4, 5][..], "theta:y:x", "projections"),
            (&[3, 4, 5], "rotation_angle:y:x", "projections"),
            (&[3, 4, 5], "t,y,x", "t, y, x"),
            (&[3, 4, 5], "wavelength,y,x", "none is z"),
            (&[3, 4, 5], "y,x,frame", "y, x, frame"),
            (&[3, 4, 5], "x,a,b", "x, a, b"),
            (&[3, 4, 5], "x,x,y", "same meaning"),
            (&[2, 3, 4, 5], "q,z,y,x", "q, z, y, x"),
            (&[1, 4, 5], "z,y,x", "axis z has one entry"),
            (&[1, 4, 5], "c,y,x", "image"),
        ] {
            let error = of(shape, names).unwrap_err();
            assert!(error.contains(says), "{names}: {error}");
        }
    }

    #[test]
    fn contradictions_are_told() {
        let names = |text: &str, by: &str| Names::split(text, 3, by).unwrap();
        let (a, b) = (names("zyx", "axistags"), names("xyz", "DIMENSION_LABELS"));
        assert!(agreed(vec![a.clone(), b]).unwrap_err().contains("axistags"));
        let vague = names("i,j,k", "axes");
        assert_eq!(agreed(vec![vague, a.clone()]).unwrap(), Some(a));
        assert_eq!(agreed(Vec::new()).unwrap(), None);
    }
}
