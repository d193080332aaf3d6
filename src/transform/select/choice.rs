//! Which cells, objects or surfaces are kept, and their colours.

use crate::error::{Error, Result};
use crate::manifest::{ColourBy, LEGEND, Manifest, Paint, Painted, Selection, Step};
use crate::picture::{self, Map};
use crate::table::{Column, Expr, Row, Table, TableReader};
use crate::tile::Rgb;
use crate::tile::read::PieceIds;
use crate::transform::select::{SelectOptions, whole};
use std::path::Path;

/// Colours that a manifest lists of a map.
const LISTED: usize = 9;

/// One colour for the cells, objects or surfaces of a condition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PaintRule {
    /// A condition, or `best:N` or `worst:N`: the N kept cells or objects of the largest or smallest
    /// `form_factor` among those that have one.
    pub condition: String,
    /// sRGB.
    pub colour: [u8; 3],
}

/// Colours by value.
#[derive(Debug, Clone)]
pub struct ColourRule {
    /// A column, or an expression over columns.
    pub column: String,
    /// The colour map.
    pub map: Map,
    /// Values of the first and last colour; those of what is kept without one.
    pub range: Option<[f64; 2]>,
}

/// What is kept.
pub struct Choice {
    /// Rows of the table that was chosen from, by rising id.
    rows: Vec<(u64, Option<Rgb>)>,
    step: Step,
    painted: Vec<Paint>,
    colour_by: Option<ColourBy>,
    /// The table whose rows had colours that this choice does not keep.
    lost: Option<Table>,
}

impl Choice {
    /// Reads the table that is chosen from.
    pub fn new(dir: &Path, manifest: &Manifest, options: &SelectOptions) -> Result<Self> {
        let chosen = &options.chosen;
        let open = || chosen.table.open(dir, manifest);
        let mut table = open()?;
        let columns = table.columns().to_vec();
        let query = chosen.query(&table)?;
        let id = table.own_column("id")?;
        let mut rows: Vec<(u64, Option<Rgb>)> = Vec::new();
        let mut last = None;
        while let Some(row) = table.next_row()? {
            let id = row.whole(id)?;
            if let Some(last) = last.replace(id).filter(|last| *last >= id) {
                return Err(Error::format(
                    table.path(),
                    format!("id {id} after id {last}"),
                    "rows by rising id",
                ));
            }
            if query.keeps(&row)? != options.omit {
                rows.push((id, None));
            }
        }
        let mut choice = Choice {
            rows,
            step: Step {
                condition: chosen.condition.clone(),
                omit: options.omit,
                table: chosen.table,
                largest: chosen.largest.map(|n| n as u64),
            },
            painted: Vec::new(),
            colour_by: None,
            lost: None,
        };
        if options.paint.is_empty() && options.colour_by.is_none() {
            choice.keep_colours(manifest, &columns, open)?;
        }
        if let Some(rule) = &options.colour_by {
            choice.colour(rule, &columns, open)?;
        }
        for rule in &options.paint {
            choice.paint(rule, &columns, open()?)?;
        }
        Ok(choice)
    }

    /// Paints what is kept as it was painted before, unless colours were those of another table.
    fn keep_colours(
        &mut self,
        manifest: &Manifest,
        columns: &[Column],
        open: impl Fn() -> Result<TableReader>,
    ) -> Result<()> {
        let Some(before) = &manifest.selection else {
            return Ok(());
        };
        if before.painted.is_empty() && before.colour_by.is_none() {
            return Ok(());
        }
        if before.last.table != self.step.table {
            self.lost = Some(before.last.table);
            return Ok(());
        }
        if let Some(by) = &before.colour_by {
            let rule = ColourRule {
                column: by.column.clone(),
                map: Map::named(&by.map)?,
                range: Some([by.min, by.max]),
            };
            self.colour(&rule, columns, &open)?;
        }
        for paint in &before.painted {
            let mut rule = PaintRule {
                condition: paint.condition.clone(),
                colour: picture::parse_colour("index.json", &paint.colour)?,
            };
            if let Some(ranked) = ranked(&rule.condition)? {
                // the first of those that are left are those that were among the first of all
                let left = self.left_of(ranked, columns, &open)?;
                let word = if ranked.best { "best" } else { "worst" };
                rule.condition = format!("{word}:{left}");
                if left == 0 {
                    continue;
                }
            }
            self.paint(&rule, columns, open()?)?;
        }
        Ok(())
    }

    /// How many of the first rows of the whole table are kept.
    fn left_of(
        &self,
        ranked: Ranked,
        columns: &[Column],
        open: impl Fn() -> Result<TableReader>,
    ) -> Result<usize> {
        let mut table = open()?;
        let id = table.own_column("id")?;
        let mut rows = Vec::new();
        while let Some(row) = table.next_row()? {
            rows.push((row.whole(id)?, None));
        }
        let mut all = Choice {
            rows,
            step: self.step.clone(),
            painted: Vec::new(),
            colour_by: None,
            lost: None,
        };
        let rule = PaintRule {
            condition: String::new(),
            colour: [0; 3],
        };
        all.paint_ranked(&rule, ranked, columns, open()?)?;
        let painted = all.rows.iter().filter(|row| row.1.is_some());
        Ok(painted.filter(|row| self.has(row.0)).count())
    }

    /// Says so if colours were lost.
    pub fn lost_colours(&self) -> Option<String> {
        self.lost.map(|table| {
            format!(
                "the colours of {} are lost, since {} were chosen from: give --paint or --colour-by again",
                table.name(),
                self.step.table.name()
            )
        })
    }

    /// The table that was chosen from.
    pub fn table(&self) -> Table {
        self.step.table
    }

    /// How many of its rows are kept.
    pub fn count(&self) -> u64 {
        self.rows.len() as u64
    }

    /// True if a row of that table is kept.
    pub fn has(&self, id: u64) -> bool {
        self.rows.binary_search_by_key(&id, |row| row.0).is_ok()
    }

    /// The style of a piece that is no cap: `None` if it is left out.
    pub fn style(&self, piece: &PieceIds) -> Option<Option<Rgb>> {
        let id = piece.of(self.step.table);
        let at = self.rows.binary_search_by_key(&id, |row| row.0).ok()?;
        Some(self.rows[at].1)
    }

    /// The legend of the colours by value.
    pub fn legend(&self) -> Option<&ColourBy> {
        self.colour_by.as_ref()
    }

    /// Calls `each` with the rows that are kept.
    fn rows(
        &mut self,
        mut table: TableReader,
        mut each: impl FnMut(&Row, &mut Option<Rgb>) -> Result<()>,
    ) -> Result<()> {
        let id = table.column("id").unwrap_or(0);
        let mut next = 0;
        while let Some(row) = table.next_row()? {
            let id = row.whole(id)?;
            if let Some(kept) = self.rows.get_mut(next)
                && kept.0 == id
            {
                each(&row, &mut kept.1)?;
                next += 1;
            }
        }
        Ok(())
    }

    fn colour(
        &mut self,
        rule: &ColourRule,
        columns: &[Column],
        open: impl Fn() -> Result<TableReader>,
    ) -> Result<()> {
        let value = Expr::number("--colour-by", &rule.column, columns)?;
        let mut found = [f64::INFINITY, f64::NEG_INFINITY];
        if rule.range.is_none() {
            self.rows(open()?, |row, _| {
                if let Some(v) = value.value(row)? {
                    found = [found[0].min(v), found[1].max(v)];
                }
                Ok(())
            })?;
        }
        // no value at all: any range will do
        let none = found[0] > found[1];
        let [min, max] = rule.range.unwrap_or(if none { [0.0, 1.0] } else { found });
        let wide = max - min;
        self.rows(open()?, |row, colour| {
            if let Some(v) = value.value(row)? {
                let share = if wide == 0.0 { 0.5 } else { (v - min) / wide };
                *colour = Some(rule.map.at(share));
            }
            Ok(())
        })?;
        let unit = columns.iter().find(|c| c.name == rule.column.trim());
        let listed = |i| picture::hex(rule.map.at(i as f64 / (LISTED - 1) as f64));
        self.colour_by = Some(ColourBy {
            column: rule.column.trim().to_string(),
            unit: unit.map_or(String::new(), |c| c.unit.clone()),
            map: rule.map.name().to_string(),
            min,
            max,
            colours: (0..LISTED).map(listed).collect(),
            legend: LEGEND.to_string(),
        });
        Ok(())
    }

    fn paint(&mut self, rule: &PaintRule, columns: &[Column], table: TableReader) -> Result<()> {
        let count = match ranked(&rule.condition)? {
            Some(ranked) => self.paint_ranked(rule, ranked, columns, table)?,
            None => {
                let condition = Expr::condition("--paint", &rule.condition, columns)?;
                let mut count = 0;
                self.rows(table, |row, colour| {
                    if condition.test(row)? {
                        *colour = Some(rule.colour);
                        count += 1;
                    }
                    Ok(())
                })?;
                count
            }
        };
        // what has the same condition is painted over, all of it
        self.painted.retain(|p| p.condition != rule.condition);
        self.painted.push(Paint {
            condition: rule.condition.clone(),
            colour: picture::hex(rule.colour),
            count: Painted::of(self.step.table, count),
        });
        Ok(())
    }

    /// Paints those of the largest or smallest form factor; ties go to the smaller id.
    fn paint_ranked(
        &mut self,
        rule: &PaintRule,
        ranked: Ranked,
        columns: &[Column],
        table: TableReader,
    ) -> Result<u64> {
        let value = Expr::number("--paint", "form_factor", columns)?;
        let mut ranks: Vec<(f64, usize)> = Vec::new();
        let mut at = 0;
        self.rows(table, |row, _| {
            if let Some(v) = value.value(row)? {
                ranks.push((if ranked.best { -v } else { v }, at));
            }
            at += 1;
            Ok(())
        })?;
        ranks.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ranks.truncate(ranked.count);
        for &(_, row) in &ranks {
            self.rows[row].1 = Some(rule.colour);
        }
        Ok(ranks.len() as u64)
    }

    /// What the part's manifest says of it.
    pub fn selection(&self, manifest: &Manifest) -> Selection {
        let (mut before, last) = match &manifest.selection {
            None => (Vec::new(), Step::default()),
            Some(earlier) => (earlier.before.clone(), earlier.last.clone()),
        };
        let last = match joined(&last, &self.step) {
            Some(step) => step,
            None => {
                before.push(last);
                self.step.clone()
            }
        };
        Selection {
            last,
            before,
            painted: self.painted.clone(),
            colour_by: self.colour_by.clone(),
            of: whole(manifest),
        }
    }
}

/// One choice that says as much as two, one after the other; `None` if there is none.
fn joined(first: &Step, then: &Step) -> Option<Step> {
    if !first.chooses() {
        return Some(then.clone());
    }
    if first.table != then.table {
        return None;
    }
    if first.largest.is_some() {
        // the largest of fewer rows are others than those of all
        return (!then.chooses()).then(|| first.clone());
    }
    if then.omit && then.largest.is_some() {
        return None;
    }
    let earlier = first.condition.as_ref()?;
    let earlier = match first.omit {
        true => format!("not ({earlier})"),
        false => earlier.clone(),
    };
    let condition = match (&then.condition, then.omit) {
        (None, _) => earlier,
        (Some(own), true) => format!("({earlier}) and not ({own})"),
        (Some(own), false) => format!("({earlier}) and ({own})"),
    };
    Some(Step {
        condition: Some(condition),
        omit: false,
        ..then.clone()
    })
}

/// The first by form factor.
#[derive(Debug, Clone, Copy)]
struct Ranked {
    /// How many.
    count: usize,
    /// Those of the largest, else of the smallest.
    best: bool,
}

/// Reads `best:N` and `worst:N`. `None` for a condition.
fn ranked(text: &str) -> Result<Option<Ranked>> {
    let Some((word, number)) = text.split_once(':') else {
        return Ok(None);
    };
    let best = match word.trim() {
        "best" => true,
        "worst" => false,
        _ => return Ok(None),
    };
    match number.trim().parse() {
        Ok(count) => Ok(Some(Ranked { count, best })),
        Err(_) => Err(Error::usage(
            "--paint",
            text,
            "best:N or worst:N, as in best:100",
        )),
    }
}
