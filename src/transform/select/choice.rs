//! Which cells are kept, and their colours.

use crate::error::{Error, Result};
use crate::manifest::{ColourBy, Manifest, Paint, Selection};
use crate::picture::{self, Map};
use crate::table::{Column, Expr, Query, Row, Table, TableReader};
use crate::tile::Rgb;
use crate::transform::select::{SelectOptions, legend, whole};
use std::path::Path;

/// Colours that a manifest lists of a map.
const LISTED: usize = 9;

/// One colour for the cells of a condition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PaintRule {
    /// A condition on cells, or `best:N` or `worst:N`: the N kept cells of the largest or smallest
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
    /// Values of the first and last colour; those of the kept cells without one.
    pub range: Option<[f64; 2]>,
}

/// The cells that are kept.
pub struct Choice {
    /// By rising id.
    cells: Vec<(u64, Option<Rgb>)>,
    condition: Option<String>,
    omit: bool,
    painted: Vec<Paint>,
    colour_by: Option<ColourBy>,
}

impl Choice {
    /// Reads the table of cells.
    pub fn new(dir: &Path, manifest: &Manifest, options: &SelectOptions) -> Result<Self> {
        let mut table = Table::Cells.open(dir, manifest)?;
        let columns = table.columns().to_vec();
        let condition = Query::default().filter(options.condition.as_deref(), &columns)?;
        let id = table.column("id").unwrap_or(0);
        let mut cells: Vec<(u64, Option<Rgb>)> = Vec::new();
        while let Some(row) = table.next_row()? {
            let id = row.whole(id)?;
            if cells.last().is_some_and(|last| last.0 >= id) {
                return Err(Error::format(
                    table.path(),
                    format!("cell {id} after cell {}", cells[cells.len() - 1].0),
                    "rows by rising id",
                ));
            }
            if condition.keeps(&row)? != options.omit {
                cells.push((id, None));
            }
        }
        let mut choice = Choice {
            cells,
            condition: options.condition.clone(),
            omit: options.omit,
            painted: Vec::new(),
            colour_by: None,
        };
        let open = || Table::Cells.open(dir, manifest);
        if let Some(rule) = &options.colour_by {
            choice.colour(rule, &columns, open)?;
        }
        for rule in &options.paint {
            choice.paint(rule, &columns, open()?)?;
        }
        Ok(choice)
    }

    /// The style of a cell's pieces: `None` if it is left out.
    pub fn style(&self, cell: u64) -> Option<Option<Rgb>> {
        let at = self.cells.binary_search_by_key(&cell, |c| c.0).ok()?;
        Some(self.cells[at].1)
    }

    /// The legend of the colours by value.
    pub fn legend(&self) -> Option<&ColourBy> {
        self.colour_by.as_ref()
    }

    /// Calls `each` with the rows of kept cells.
    fn rows(
        &mut self,
        mut table: TableReader,
        mut each: impl FnMut(&Row, &mut Option<Rgb>) -> Result<()>,
    ) -> Result<()> {
        let id = table.column("id").unwrap_or(0);
        let mut next = 0;
        while let Some(row) = table.next_row()? {
            let id = row.whole(id)?;
            if let Some(cell) = self.cells.get_mut(next)
                && cell.0 == id
            {
                each(&row, &mut cell.1)?;
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
            legend: legend::FILE.to_string(),
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
            cells: count,
        });
        Ok(())
    }

    /// Paints the cells of the largest or smallest form factor; ties go to the smaller id.
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
        for &(_, cell) in &ranks {
            self.cells[cell].1 = Some(rule.colour);
        }
        Ok(ranks.len() as u64)
    }

    /// What the part's manifest says of it.
    pub fn selection(&self, manifest: &Manifest) -> Selection {
        // what is chosen from a part is chosen by both conditions from the whole
        let earlier = manifest.selection.as_ref().and_then(|s| {
            s.condition.as_ref().map(|c| {
                if s.omit {
                    format!("not ({c})")
                } else {
                    c.clone()
                }
            })
        });
        let (condition, omit) = match (earlier, &self.condition) {
            (None, own) => (own.clone(), self.omit),
            (earlier, None) => (earlier, false),
            (Some(a), Some(b)) if self.omit => (Some(format!("({a}) and not ({b})")), false),
            (Some(a), Some(b)) => (Some(format!("({a}) and ({b})")), false),
        };
        Selection {
            condition,
            omit,
            painted: self.painted.clone(),
            colour_by: self.colour_by.clone(),
            of: whole(manifest),
        }
    }
}

/// The first cells by form factor.
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
