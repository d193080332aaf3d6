//! The rounds in which parts of a volume are converted. All parts do a round, in any order and each by itself; then what they
//! have found is joined, for the next one.

use crate::checkpoint::LABELS;
use crate::convert::ConvertOptions;

/// A round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Round {
    /// Finds small components, in the sweep of this number.
    Search(usize),
    /// Finds all components.
    Label,
    /// Writes the geometry of tiles.
    Mesh,
    /// Gives tiles their JSON, writes the index and rows of tables.
    Finish,
}

impl Round {
    /// What it does, for people.
    pub fn name(self) -> &'static str {
        match self {
            Round::Search(0) => "search for small objects",
            Round::Search(_) => "search for small cells",
            Round::Label => "label",
            Round::Mesh => "mesh",
            Round::Finish => "finish",
        }
    }
}

/// The rounds of a conversion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rounds {
    /// How many of them search for small components.
    searches: usize,
}

impl Rounds {
    /// Those of a conversion with these options.
    pub fn of(options: &ConvertOptions) -> Self {
        Rounds {
            searches: match options.min_voxels > 1 {
                true => LABELS,
                false => 0,
            },
        }
    }

    /// So many.
    pub fn counting(count: u32) -> Self {
        Rounds {
            searches: (count as usize).saturating_sub(3).min(LABELS),
        }
    }

    /// How many there are.
    pub fn count(self) -> u32 {
        self.searches as u32 + 3
    }

    /// Their searches, by the number of the sweep.
    pub fn searches(self) -> std::ops::Range<usize> {
        0..self.searches
    }

    /// All of them, in their order.
    pub fn all(self) -> impl DoubleEndedIterator<Item = Round> {
        let searches = self.searches().map(Round::Search);
        searches.chain([Round::Label, Round::Mesh, Round::Finish])
    }

    /// The number of a round, from 1.
    pub fn number(self, round: Round) -> u32 {
        let searches = self.searches as u32;
        match round {
            Round::Search(sweep) => sweep as u32 + 1,
            Round::Label => searches + 1,
            Round::Mesh => searches + 2,
            Round::Finish => searches + 3,
        }
    }
}
