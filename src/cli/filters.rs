//! The options that filter a volume before it is compared with the threshold: the same for every command that reads
//! one, in the order in which they are typed.

use super::parse;
use crate::error::{Error, Result};
use crate::grid::{Filter, Placement, Sigma, Unit, filters_text};
use crate::manifest::Manifest;
use crate::volume::Opened;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

/// Filters, in the order in which they were typed.
#[derive(Debug, Clone, Default)]
pub struct FilterArgs(Vec<FilterArg>);

/// A filter, as typed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FilterArg {
    /// In voxels, if in anything.
    Known(Filter),
    /// `--smooth` by a length, of which the size of a voxel tells how many voxels that is.
    Smooth { length: f64, unit: Unit },
}

impl FilterArg {
    /// The filter for voxels in this place.
    fn known(&self, place: &Placement) -> Result<Filter> {
        let (length, unit) = match *self {
            FilterArg::Known(filter) => return Ok(filter),
            FilterArg::Smooth { length, unit } => (length, unit),
        };
        let in_unit = Placement {
            spacing: [length; 3],
            unit,
            ..Placement::default()
        };
        let of_voxels = in_unit.in_unit(place.unit).map_err(|_| {
            let expected = "a number of voxels, or a volume whose voxels have a size";
            Error::usage("--smooth", format!("{length}{unit}"), expected)
                .with_hint("give --spacing and --unit")
        })?;
        let voxels = |a: usize| rounded(of_voxels.spacing[a] / place.spacing[a]);
        let sigma = Sigma(std::array::from_fn(voxels));
        let filter = Filter::Smooth { sigma };
        match filter.check() {
            Err(Error::Usage {
                option,
                found,
                expected,
                ..
            }) => {
                let found = format!("{length}{unit}, which is {found} voxels");
                Err(Error::usage(option, found, expected))
            }
            checked => checked.map(|()| filter),
        }
    }

    fn name(&self) -> &'static str {
        match self {
            FilterArg::Known(filter) => filter.name(),
            FilterArg::Smooth { .. } => "smooth",
        }
    }
}

/// The number without what the division left behind its twelfth digit: 0.02 / 0.05 is 0.4.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

/// An option that adds a filter.
struct FilterOption {
    /// That of the filter.
    name: &'static str,
    /// How the help calls its value; empty if it takes none.
    value: &'static str,
    help: &'static str,
    /// What else there is to say.
    more: &'static str,
}

const OPTIONS: [FilterOption; 5] = [
    FilterOption {
        name: "smooth",
        value: "SIGMA",
        help: "Smooth by a Gaussian of this standard deviation, in voxels, as in 1, or as a length, as in 20um",
        more: "Values become floats: f64 where they were f64, else f32. Voxels up to 4 standard deviations away count; \
               beyond the faces of the volume lie copies of its outermost voxels (scipy.ndimage.gaussian_filter with mode \
               nearest). Three numbers of voxels are for x, y and z; a length is the same along all axes, whatever the \
               size of a voxel. What is not finite stays where it is and counts for no other voxel.",
    },
    FilterOption {
        name: "median",
        value: "R",
        help: "Take the median of the cube of 2 R + 1 voxels around each voxel, R 1 or 2",
        more: "It takes away single voxels that are far off, and edges stay sharp (scipy.ndimage.median_filter with mode \
               nearest). NaN stays where it is and counts for no other voxel; of an even number that is left, the lower of \
               the two in the middle counts.",
    },
    FilterOption {
        name: "downsample",
        value: "N",
        help: "Take the mean of every N x N x N voxels, N from 2 to 16, as one larger voxel",
        more: "Means of whole numbers are rounded, half to even. NaN counts for nothing: a mean is of the numbers in \
               its block, and NaN if there is none. Voxels at the far faces that fill no block are left out. The size of \
               a voxel and the origin follow.",
    },
    FilterOption {
        name: "invert",
        value: "",
        help: "Make dark what is bright: v becomes 255 - v in u8, 65535 - v in u16, -1 - v in signed types, -v in floats",
        more: "",
    },
    FilterOption {
        name: "clamp",
        value: "A,B",
        help: "Set values below A to A, those above B to B; NaN stays",
        more: "",
    },
];

impl FilterOption {
    fn arg(&self) -> Arg {
        let arg = Arg::new(self.name).long(self.name).help(self.help);
        let arg = match self.more {
            "" => arg,
            more => arg.long_help(format!("{}\n\n{more}", self.help)),
        };
        match self.value {
            // each time counts, as of the others
            "" => arg
                .action(ArgAction::Append)
                .num_args(0)
                .default_missing_value(self.name)
                .value_parser(|name: &str| name.parse().map(FilterArg::Known)),
            value => arg
                .value_name(value)
                .action(ArgAction::Append)
                .allow_hyphen_values(true)
                .value_parser(parse::filter(self.name)),
        }
    }

    /// Filters that it adds, each with its place on the command line.
    fn typed(&self, matches: &ArgMatches) -> Vec<(usize, FilterArg)> {
        let places = matches.indices_of(self.name).into_iter().flatten();
        let filters = matches.get_many(self.name).into_iter().flatten();
        places.zip(filters.copied()).collect()
    }
}

impl Args for FilterArgs {
    fn augment_args(command: Command) -> Command {
        let heading = "Filters, applied in the order given, before --crop and the threshold";
        let command = command.next_help_heading(heading);
        OPTIONS
            .iter()
            .fold(command, |c, option| c.arg(option.arg()))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for FilterArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut typed: Vec<_> = OPTIONS.iter().flat_map(|o| o.typed(matches)).collect();
        typed.sort_by_key(|(place, _)| *place);
        Ok(FilterArgs(typed.into_iter().map(|(_, f)| f).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl FilterArgs {
    /// Names of the filters.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(FilterArg::name)
    }

    /// The volume after the filters.
    ///
    /// # Errors
    /// Those of [`Opened::filter`].
    pub fn apply(&self, opened: Opened) -> Result<Opened> {
        let mut place = opened.volume.header().placement;
        let mut filters = Vec::new();
        for filter in &self.0 {
            let filter = filter.known(&place)?;
            place = filter.placement(place);
            filters.push(filter);
        }
        opened.filter(&filters)
    }

    /// The volume after the filters of a tile set, which these have to be if there are any.
    ///
    /// # Errors
    /// Those of [`Opened::filter`]; [`Error::Usage`] that names the option by which the tile set or the volume was
    /// given if filters differ.
    pub fn apply_as(&self, manifest: &Manifest, opened: Opened, option: &str) -> Result<Opened> {
        if self.0.is_empty() {
            return opened.filter(&manifest.filters);
        }
        let opened = self.apply(opened)?;
        let own = opened.filtered.as_ref().map_or(&[][..], |f| &f.filters);
        if own == manifest.filters {
            return Ok(opened);
        }
        let found = format!("filters {}", filters_text(own));
        let expected = format!("those of the tiles: {}", filters_text(&manifest.filters));
        let hint = "leave the filters out: they are taken from the tile set";
        Err(Error::usage(option, found, expected).with_hint(hint))
    }
}
