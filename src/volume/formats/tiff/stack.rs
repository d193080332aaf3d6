//! Which of the pages are the slices of the volume that is asked for.

use crate::error::{Error, Result};
use crate::grid::Origin;
use crate::volume::adapters::values::Values;
use crate::volume::options::OpenOptions;
use crate::volume::stated::size::{self, Step, VoxelSize};
use crate::volume::stated::warning::Warning;
use std::path::Path;

/// The most volumes that a message lists.
const LISTED: usize = 30;

/// What a file says of a stack besides its pages.
#[derive(Debug, Default)]
pub(crate) struct About {
    /// Sizes along x, y and z.
    pub(crate) steps: [Option<Step>; 3],
    /// The size along z that readers assume where none is stated, if it is not that of a pixel.
    pub(crate) z_if_none: Option<Step>,
    /// Sizes along x and y are, or follow from, TIFF's own tags, which every page has for itself.
    pub(crate) of_tags: bool,
    pub(crate) values: Option<Values>,
    /// The voxel at the origin of coordinates.
    pub(crate) zero: Option<[f64; 3]>,
    pub(crate) notes: Vec<String>,
    /// Notes that have no cause any more where `--spacing` states the size of a voxel.
    pub(crate) notes_of_size: Vec<String>,
    pub(crate) warnings: Vec<Warning>,
}

impl About {
    /// Adds a warning that has no cause any more where `--spacing` states the size of a voxel.
    pub(crate) fn of_size(&mut self, text: impl Into<String>) {
        self.warnings.push(Warning::of_size(text));
    }

    /// The size of a voxel; warnings are added to the others.
    pub(crate) fn size(&mut self) -> VoxelSize {
        let [x, y, z] = std::mem::take(&mut self.steps);
        let assumed = self.z_if_none.take().filter(|_| z.is_none());
        let mut size = size::voxel_size([x, y, z.or_else(|| assumed.clone())]);
        if let (true, Some([_, _, z])) = (assumed.is_some(), size.spacing) {
            size.from[2] = Origin::Assumed;
            let unit = size.unit.map_or(String::new(), |unit| format!(" {unit}"));
            size.warning = Some(Warning::of_size(format!(
                "the file does not state the distance of slices, assumed to be {z}{unit} as ImageJ does: give \
                 --spacing X,Y,Z and --unit if it is another"
            )));
        }
        self.warnings.extend(size.warning.take());
        size
    }
}

/// A volume, or several channels and times of it, that pages make together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stack {
    /// Its names besides its number.
    pub(crate) names: Vec<String>,
    /// Width and height of pages, where known.
    pub(crate) size: Option<[u32; 2]>,
    /// Slices, channels, times.
    pub(crate) counts: [u64; 3],
    /// Another axis: its name, for messages, and its length.
    pub(crate) other: Option<(String, u64)>,
    /// Pages from one slice, channel, time to the next.
    strides: [u64; 3],
}

/// The slices of one channel and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Chosen {
    /// Number of the stack.
    pub(crate) stack: usize,
    pub(crate) slices: u64,
    pub(crate) channel: u64,
    pub(crate) time: u64,
    /// Times stand for slices.
    pub(crate) movie: bool,
    first: u64,
    stride: u64,
}

impl Chosen {
    /// The page of slice `z`, counted from the stack's first.
    pub(crate) fn page(&self, z: u64) -> u64 {
        self.first + z * self.stride
    }
}

impl Stack {
    /// A stack of slices, channels and times in an order such as `czt`, the fastest first; `None` for any other order.
    pub(crate) fn new(counts: [u64; 3], order: &str) -> Option<Self> {
        let mut strides = [0; 3];
        let mut pages = 1u64;
        for axis in order.bytes() {
            let axis = b"zct"
                .iter()
                .position(|a| *a == axis.to_ascii_lowercase())?;
            if strides[axis] != 0 {
                return None;
            }
            strides[axis] = pages;
            pages = pages.checked_mul(counts[axis])?;
        }
        (!strides.contains(&0)).then_some(Stack {
            names: Vec::new(),
            size: None,
            counts,
            other: None,
            strides,
        })
    }

    /// All its pages are slices.
    pub(crate) fn slices(count: u64, size: [u32; 2]) -> Self {
        Stack {
            names: Vec::new(),
            size: Some(size),
            counts: [count, 1, 1],
            other: None,
            strides: [1, count, count],
        }
    }

    /// Number of pages.
    pub(crate) fn pages(&self) -> u64 {
        let other = self.other.as_ref().map_or(1, |(_, n)| *n);
        self.counts.iter().fold(other, |n, c| n.saturating_mul(*c))
    }

    /// One line of a list.
    fn line(&self, number: usize) -> String {
        let [slices, channels, times] = self.counts;
        let mut line = format!("{number}: ");
        if let Some([x, y]) = self.size {
            line += &format!("{x} x {y} x ");
        }
        line += &format!("{slices}");
        for (count, name) in [(channels, "channels"), (times, "times")] {
            if count > 1 {
                line += &format!(", {count} {name}");
            }
        }
        if let Some((name, count)) = &self.other {
            line += &format!(", {count} {name}");
        }
        for name in self.names.iter().filter(|n| !n.is_empty()) {
            line += &format!(", {name}");
        }
        line
    }
}

/// The volume that the options ask for.
///
/// # Errors
/// [`Error::Usage`] with the list of what there is if there are several volumes and none, or no such one, is asked for;
/// [`Error::Unsupported`] for other axes.
pub(crate) fn choose(path: &Path, stacks: &[Stack], options: &OpenOptions) -> Result<Chosen> {
    let number = one_of(path, stacks, options.series.as_deref())?;
    let stack = &stacks[number];
    if let Some((name, count)) = &stack.other {
        let what = format!("a stack of {} slices with {count} {name}", stack.counts[0]);
        return Err(Error::unsupported(
            path,
            what,
            "save the one volume as a stack of slices",
        ));
    }
    let [mut slices, channels, times] = stack.counts;
    let [mut stride, of_channel, of_time] = stack.strides;
    if slices == 1 && times == 1 && channels > 1 {
        let what = format!("a stack of {channels} channels of one slice");
        let hint = format!(
            "if these are slices, write them as such: in ImageJ by Image > Properties, or by `python -c \"import tifffile \
             as t; t.imwrite('slices.tif', t.imread(r'{}'), metadata={{'axes': 'ZYX'}})\"` and then give slices.tif with \
             --spacing and --unit",
            path.display()
        );
        return Err(Error::unsupported(path, what, hint));
    }
    let channel = index(path, "--channel", options.channel, channels, "channels")?;
    // a stack that was opened as a sequence of times
    let movie = slices == 1 && times > 1 && options.time.is_none();
    let time = if movie {
        (slices, stride) = (times, of_time);
        0
    } else {
        index(path, "--time", options.time, times, "times")?
    };
    Ok(Chosen {
        stack: number,
        slices,
        channel,
        time,
        movie,
        first: channel * of_channel + time * of_time,
        stride,
    })
}

/// Why a file has another number of pages than it says.
pub(crate) fn other_count(found: u64, stated: u64) -> &'static str {
    match found < stated {
        true => "the file was cut short: get it again",
        false => {
            "it has more pages than it says: it was changed by a program that left its description as it was; save it anew, \
             as a stack of slices without it"
        }
    }
}

fn one_of(path: &Path, stacks: &[Stack], wanted: Option<&str>) -> Result<usize> {
    let found = match wanted {
        None if stacks.len() == 1 => return Ok(0),
        None => format!("nothing, and {} series in {}", stacks.len(), path.display()),
        Some(wanted) => {
            let number = wanted.parse::<usize>().ok().filter(|n| *n < stacks.len());
            let mut named =
                (0..stacks.len()).filter(|&i| stacks[i].names.iter().any(|n| n == wanted));
            match (number, named.next(), named.next()) {
                (Some(number), _, _) | (None, Some(number), None) => return Ok(number),
                _ => format!("\"{wanted}\""),
            }
        }
    };
    let lines = stacks.iter().take(LISTED).enumerate();
    let lines: String = lines.map(|(i, s)| format!("\n  {}", s.line(i))).collect();
    let more = match stacks.len().saturating_sub(LISTED) {
        0 => String::new(),
        n => format!("\n  and {n} more"),
    };
    let expected = format!("the number in front, or the name or ID, of one of{lines}{more}");
    Err(Error::usage("--series", found, expected))
}

/// Which of `count` channels or times.
fn index(path: &Path, option: &str, wanted: Option<u32>, count: u64, name: &str) -> Result<u64> {
    let found = match wanted.map(u64::from) {
        Some(wanted) if count == 1 && wanted > 0 => {
            let expected = format!("0 or nothing: {} has no several {name}", path.display());
            return Err(Error::usage(option, wanted.to_string(), expected));
        }
        None if count == 1 => return Ok(0),
        Some(wanted) if wanted < count => return Ok(wanted),
        None => format!("nothing, and {count} {name} in {}", path.display()),
        Some(wanted) => format!("{wanted}, and {count} {name} in {}", path.display()),
    };
    Err(Error::usage(
        option,
        found,
        format!("one of 0 to {}", count - 1),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_of_pages() {
        for (order, page) in [
            ("czt", 1 + 2 * 3 + 8),
            ("zct", 3 + 4 + 8),
            ("tzc", 1 + 3 * 3 + 12),
        ] {
            let stack = Stack::new([4, 2, 3], order).unwrap();
            let options = OpenOptions {
                channel: Some(1),
                time: Some(1),
                ..OpenOptions::default()
            };
            let chosen = choose(Path::new("f"), &[stack], &options).unwrap();
            assert_eq!((chosen.slices, chosen.page(3)), (4, page), "{order}");
        }
        for bad in ["cz", "czz", "czx", ""] {
            assert_eq!(Stack::new([4, 2, 3], bad), None, "{bad}");
        }
        assert_eq!(Stack::new([u64::MAX, 2, 3], "zct"), None);
    }

    #[test]
    fn what_is_not_asked_for_is_listed() {
        let mut stacks = vec![
            Stack::slices(4, [3, 2]),
            Stack::new([4, 2, 3], "zct").unwrap(),
        ];
        stacks[1].names = vec!["the scan".into(), "Image:1".into()];
        let ask = |series: Option<&str>, channel, time| {
            let options = OpenOptions {
                series: series.map(String::from),
                channel,
                time,
                ..OpenOptions::default()
            };
            choose(Path::new("f"), &stacks, &options).map_err(|e| e.to_string())
        };
        let error = ask(None, None, None).unwrap_err();
        assert!(
            error.contains("0: 3 x 2 x 4") && error.contains("1: 4, 2 channels, 3 times, the scan"),
            "{error}"
        );
        assert_eq!(ask(Some("0"), None, None).unwrap().stack, 0);
        for name in ["1", "the scan", "Image:1"] {
            assert_eq!(ask(Some(name), Some(1), Some(2)).unwrap().stack, 1);
            assert!(
                ask(Some(name), None, Some(2))
                    .unwrap_err()
                    .contains("2 channels")
            );
            assert!(
                ask(Some(name), Some(0), None)
                    .unwrap_err()
                    .contains("3 times")
            );
            assert!(
                ask(Some(name), Some(2), Some(0))
                    .unwrap_err()
                    .contains("0 to 1")
            );
        }
        for (series, channel, time) in [
            ("2", None, None),
            ("x", None, None),
            ("0", Some(1), None),
            ("0", None, Some(1)),
        ] {
            assert!(ask(Some(series), channel, time).is_err());
        }
    }
}
