//! The form of whole cells, and which of them lie far from the others.

use crate::error::Result;
use crate::manifest::Manifest;
use crate::table::{Histogram, Outside, Row, Spread, Table, TableReader, each_cell};
use serde::Serialize;
use std::collections::HashSet;
use std::path::Path;

/// The most outliers that are listed.
const OUTLIERS: usize = 20;
/// How far an outlier lies beyond a quartile, in distances between the quartiles (J. W. Tukey, Exploratory Data
/// Analysis, Addison-Wesley, 1977, chapter 2).
const FENCE: f64 = 1.5;

/// Measures whose outliers are told, and which ends of them: the lower, the upper.
const MEASURES: [(&str, [bool; 2]); 4] = [
    ("equivalent_diameter", [true, true]),
    ("sphericity", [true, false]),
    ("elongation", [true, false]),
    ("flatness", [true, false]),
];

/// How a measure of whole cells is distributed.
#[derive(Debug, Clone, Serialize)]
pub struct Form {
    /// The column.
    pub column: &'static str,
    /// By number.
    pub spread: Spread,
    /// Cells in equal bins from min to max, and their volumes.
    pub histogram: Histogram,
    /// Cells below and above the fences.
    pub outliers: u64,
}

/// A cell that lies beyond the fence of a measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outlier {
    /// The cell.
    pub id: u64,
    /// The measure.
    pub column: &'static str,
    /// Its value.
    pub value: f64,
    /// The fence that it lies beyond.
    pub fence: f64,
    /// By how many distances between the quartiles it lies beyond the nearer one.
    pub distance: f64,
    /// Its volume.
    pub volume: f64,
    /// Its centroid, along x, y and z.
    pub centroid: [f64; 3],
}

/// What the table of cells tells.
#[derive(Debug, Clone, Default)]
pub struct Forms {
    /// Of each measure that cells have.
    pub forms: Vec<Form>,
    /// The farthest first.
    pub outliers: Vec<Outlier>,
}

/// Where a table has what is read of a cell.
struct Columns {
    id: usize,
    border: usize,
    volume: usize,
    centroid: [usize; 3],
    measures: [usize; MEASURES.len()],
}

impl Columns {
    fn of(table: &TableReader) -> Result<Self> {
        let measures: Vec<usize> = MEASURES
            .iter()
            .map(|(name, _)| table.own_column(name))
            .collect::<Result<_>>()?;
        Ok(Columns {
            id: table.own_column("id")?,
            border: table.own_column("touches_border")?,
            volume: table.own_column("volume")?,
            centroid: [
                table.own_column("centroid_x")?,
                table.own_column("centroid_y")?,
                table.own_column("centroid_z")?,
            ],
            measures: std::array::from_fn(|i| measures[i]),
        })
    }
}

/// Calls `each` for the rows of whole cells, those that do not count as outside.
fn whole_cells(
    dir: &Path,
    manifest: &Manifest,
    outside: &HashSet<u64>,
    mut each: impl FnMut(&Row, &Columns) -> Result<()>,
) -> Result<()> {
    let mut table = Table::Cells.open(dir, manifest)?;
    let columns = Columns::of(&table)?;
    while let Some(row) = table.next_row()? {
        let at_border = row.number(columns.border)?.is_some_and(|v| v != 0.0);
        if !at_border && !outside.contains(&row.whole(columns.id)?) {
            each(&row, &columns)?;
        }
    }
    Ok(())
}

/// Reads the table of cells twice. Takes 64 bytes for each whole cell.
///
/// # Errors
/// What reading returns.
pub fn forms(dir: &Path, manifest: &Manifest, outside: Outside) -> Result<Forms> {
    let mut around = HashSet::new();
    if outside != Outside::None {
        each_cell(dir, manifest, outside, |cell| {
            if cell.outside {
                around.insert(cell.id);
            }
        })?;
    }
    let mut values: [Vec<(f64, f64)>; MEASURES.len()] = Default::default();
    whole_cells(dir, manifest, &around, |row, columns| {
        let volume = row.number(columns.volume)?.unwrap_or(0.0);
        for (values, &column) in values.iter_mut().zip(&columns.measures) {
            values.extend(row.number(column)?.map(|v| (v, volume)));
        }
        Ok(())
    })?;
    let mut forms = Vec::new();
    let mut fences = [None; MEASURES.len()];
    for (m, values) in values.into_iter().enumerate() {
        let Some((form, fence)) = form(MEASURES[m], values) else {
            continue;
        };
        forms.push(form);
        fences[m] = Some(fence);
    }
    let mut outliers = Vec::new();
    whole_cells(dir, manifest, &around, |row, columns| {
        for (m, fence) in fences.iter().enumerate() {
            if let (Some(fence), Some(value)) = (fence, row.number(columns.measures[m])?)
                && let Some(beyond) = fence.beyond(value)
            {
                outliers.push(outlier(row, columns, m, beyond)?);
            }
        }
        if outliers.len() > 4 * OUTLIERS {
            farthest(&mut outliers);
        }
        Ok(())
    })?;
    farthest(&mut outliers);
    Ok(Forms { forms, outliers })
}

/// How values with the volumes of their cells are distributed, and their fences; `None` of no values.
fn form(
    (column, ends): (&'static str, [bool; 2]),
    values: Vec<(f64, f64)>,
) -> Option<(Form, Fences)> {
    let mut sorted: Vec<f64> = values.iter().map(|v| v.0).collect();
    sorted.sort_by(f64::total_cmp);
    let spread = Spread::of(&sorted)?;
    let fences = Fences {
        quartiles: [spread.q1, spread.q3],
        ends,
    };
    let beyond = sorted.iter().filter(|v| fences.beyond(**v).is_some());
    let form = Form {
        column,
        spread,
        histogram: Histogram::of(&values, [spread.min, spread.max]),
        outliers: beyond.count() as u64,
    };
    Some((form, fences))
}

fn outlier(row: &Row, columns: &Columns, measure: usize, beyond: Beyond) -> Result<Outlier> {
    let mut centroid = [0.0; 3];
    for (c, &column) in centroid.iter_mut().zip(&columns.centroid) {
        *c = row.number(column)?.unwrap_or(f64::NAN);
    }
    Ok(Outlier {
        id: row.whole(columns.id)?,
        column: MEASURES[measure].0,
        value: beyond.value,
        fence: beyond.fence,
        distance: beyond.distance,
        volume: row.number(columns.volume)?.unwrap_or(f64::NAN),
        centroid,
    })
}

/// Keeps the farthest, in order; of equals those of smaller ids.
fn farthest(outliers: &mut Vec<Outlier>) {
    outliers.sort_by(|a, b| b.distance.total_cmp(&a.distance).then(a.id.cmp(&b.id)));
    outliers.truncate(OUTLIERS);
}

/// Values beyond which a cell lies far from the others.
#[derive(Debug, Clone, Copy)]
struct Fences {
    quartiles: [f64; 2],
    /// The ends at which there is one.
    ends: [bool; 2],
}

/// A value beyond a fence.
#[derive(Debug, Clone, Copy)]
struct Beyond {
    value: f64,
    fence: f64,
    /// From the nearer quartile, in distances between the quartiles.
    distance: f64,
}

impl Fences {
    /// The fence that a value lies beyond, if there is one.
    fn beyond(&self, value: f64) -> Option<Beyond> {
        let [q1, q3] = self.quartiles;
        let between = q3 - q1;
        let far = [(q1 - value) / between, (value - q3) / between];
        let fences = [q1 - FENCE * between, q3 + FENCE * between];
        let end = (0..2).find(|&end| self.ends[end] && far[end] > FENCE)?;
        far[end].is_finite().then_some(Beyond {
            value,
            fence: fences[end],
            distance: far[end],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fences_are_those_of_tukey() {
        let fences = Fences {
            quartiles: [10.0, 14.0],
            ends: [true, false],
        };
        for value in [4.0, 10.0, 14.0, 30.0, f64::NAN] {
            assert!(fences.beyond(value).is_none(), "{value}");
        }
        let found = fences.beyond(2.0).unwrap();
        assert_eq!((found.fence, found.distance), (4.0, 2.0));
        let both = Fences {
            ends: [true, true],
            ..fences
        };
        let found = both.beyond(24.0).unwrap();
        assert_eq!((found.fence, found.distance), (20.0, 2.5));
        // all values are the same: none of them is an outlier, and no number is infinite
        let same = Fences {
            quartiles: [1.0, 1.0],
            ends: [true, true],
        };
        assert!(same.beyond(1.0).is_none() && same.beyond(2.0).is_none());
    }
}
