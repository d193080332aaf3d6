//! Openings between cells, held against the table of necks.

use super::code::Code;
use super::ledger::Kind;
use super::report::Issues;
use super::table_files::Lines;
use super::tile::Context;

/// Relative error of numbers of the table, which are rounded once or twice.
const ROUNDING: f64 = 1e-11;
/// Places of the first column of numbers, and of those of places.
const FIRST: usize = 2;
const PLACE: std::ops::Range<usize> = 2..5;
const NAMES: [&str; 6] = ["neck_radius", "ratio", "x", "y", "z", "neck_area"];

/// An opening, as the table has it.
pub(super) struct Opening {
    /// The cells, the smaller id first.
    pub cells: [u64; 2],
    /// Radius and ratio, where it is, and its area, in the units of the tables.
    pub numbers: [Option<f64>; 6],
}

/// The rows of the table of necks, one after the other, while openings come by rising cells. What is wrong with the table
/// alone is said elsewhere.
pub(super) struct NeckRows {
    lines: Lines,
    unsaid: Issues,
    /// The next one and its cells.
    next: Option<([u64; 2], Vec<Option<f64>>)>,
    last: [u64; 2],
    /// What says where cells touch.
    by: &'static str,
    /// The longest step of a voxel.
    coarsest: f64,
}

impl NeckRows {
    /// `None` if the table cannot be read.
    pub fn open(cx: &Context, by: &'static str) -> Option<Self> {
        let mut unsaid = Issues::new(0);
        let lines = Lines::open(cx, Kind::Neck, &mut unsaid)?;
        let spacing = cx.manifest.measured().spacing;
        let mut rows = NeckRows {
            lines,
            unsaid,
            next: None,
            last: [0; 2],
            by,
            coarsest: spacing.into_iter().fold(0.0, f64::max),
        };
        rows.advance();
        Some(rows)
    }

    fn advance(&mut self) {
        self.next = self.lines.next_row(&mut self.unsaid).map(|row| {
            let cells = [0, 1].map(|at| row[at].unwrap_or(0.0) as u64);
            (cells, row)
        });
        let cells = self.next.as_ref().map(|next| next.0);
        if cells.is_some_and(|cells| cells <= self.last) {
            // what follows is none of what is looked for
            self.next = None;
            self.lines.give_up();
        }
        self.last = cells.unwrap_or(self.last);
    }

    /// Passes rows before that of these cells, which do not touch.
    fn up_to(&mut self, cells: [u64; 2], issues: &mut Issues) {
        while let Some(([a, b], _)) = self.next.as_ref().filter(|next| next.0 < cells) {
            let message = format!(
                "found cells {a} and {b}, which do not touch by the {}",
                self.by
            );
            issues.add(Code::TableRows, self.lines.place(), message);
            self.advance();
        }
    }

    /// Compares the next opening with its row.
    pub fn compare(&mut self, opening: &Opening, issues: &mut Issues) {
        self.up_to(opening.cells, issues);
        let row = self.next.as_ref().filter(|next| next.0 == opening.cells);
        let Some((_, row)) = row else {
            if !self.lines.damaged {
                let [a, b] = opening.cells;
                let by = self.by;
                let message =
                    format!("found no row for cells {a} and {b}, which touch by the {by}");
                issues.add(Code::TableRows, &self.lines.path, message);
            }
            return;
        };
        let wrong = self.differences(row, opening);
        if !wrong.is_empty() {
            let message = format!("{}, by the {}", wrong.join("; "), self.by);
            issues.add(Code::TableValue, self.lines.place(), message);
        }
        self.advance();
    }

    /// All openings have come.
    pub fn finish(mut self, issues: &mut Issues) {
        self.up_to([u64::MAX; 2], issues);
    }

    /// In what a row differs from an opening.
    fn differences(&self, row: &[Option<f64>], opening: &Opening) -> Vec<String> {
        let text = |v: Option<f64>| v.map_or("nothing".to_owned(), |v| v.to_string());
        let mut wrong = Vec::new();
        for (i, (&found, &stated)) in opening.numbers.iter().zip(&row[FIRST..]).enumerate() {
            let beside = if PLACE.contains(&i) {
                self.coarsest
            } else {
                0.0
            };
            let close = match (found, stated) {
                (Some(found), Some(stated)) => {
                    (found - stated).abs() <= ROUNDING * (found.abs() + beside)
                }
                (None, None) => true,
                _ => false,
            };
            if !close {
                wrong.push(format!(
                    "{} {}, it is {}",
                    NAMES[i],
                    text(stated),
                    text(found)
                ));
            }
        }
        wrong
    }
}
