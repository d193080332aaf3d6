//! The rounds in which parts of a volume are converted. All parts do a round, in any order and each by itself; then what they
//! have found is joined, for the next one.

use crate::checkpoint::LABELS;
use crate::convert::ConvertOptions;
use serde::{Deserialize, Serialize};

/// A round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Round {
    /// Finds small components, in the sweep of this number.
    Search(usize),
    /// Finds all components.
    Label,
    /// Finds the basins of cells that are to be split.
    Basins,
    /// Finds where basins touch, and joins them to cells.
    Saddles,
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
            Round::Basins => "basins",
            Round::Saddles => "necks",
            Round::Mesh => "mesh",
            Round::Finish => "finish",
        }
    }
}

/// The rounds of a conversion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Rounds {
    /// True if some of them search for small components.
    search: bool,
    /// True if some of them split cells.
    split: bool,
}

impl Rounds {
    /// Those of a conversion with these options.
    pub fn of(options: &ConvertOptions) -> Self {
        Rounds {
            search: options.min_voxels > 1,
            split: options.split.is_some(),
        }
    }

    /// How many there are.
    pub fn count(self) -> u32 {
        self.all().count() as u32
    }

    /// Their searches, by the number of the sweep.
    pub fn searches(self) -> std::ops::Range<usize> {
        match self.search {
            true => 0..LABELS,
            false => 0..0,
        }
    }

    /// All of them, in their order.
    pub fn all(self) -> impl DoubleEndedIterator<Item = Round> {
        let searches = self.searches().map(Round::Search);
        let splits: &[Round] = match self.split {
            true => &[Round::Basins, Round::Saddles],
            false => &[],
        };
        let splits = std::iter::once(Round::Label).chain(splits.iter().copied());
        searches.chain(splits).chain([Round::Mesh, Round::Finish])
    }

    /// The number of a round, from 1.
    pub fn number(self, round: Round) -> u32 {
        let at = self.all().position(|other| other == round);
        at.expect("a round of these") as u32 + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_numbered_in_their_order() {
        for (search, split, count) in [
            (false, false, 3),
            (true, false, 5),
            (false, true, 5),
            (true, true, 7),
        ] {
            let rounds = Rounds { search, split };
            assert_eq!(rounds.count(), count);
            let numbers: Vec<u32> = rounds.all().map(|round| rounds.number(round)).collect();
            assert_eq!(numbers, (1..=count).collect::<Vec<u32>>());
            assert_eq!(rounds.number(Round::Finish), count);
        }
    }
}
