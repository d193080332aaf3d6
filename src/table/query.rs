//! Which rows of a table, and in which order.

use super::expr::Expr;
use super::reader::{Column, Row, TableReader};
use crate::error::Result;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A choice of rows.
#[derive(Debug, Clone, Default)]
pub struct Query {
    filter: Option<Expr>,
    sort: Option<(Expr, bool)>,
    top: Option<usize>,
    /// The places of the only rows that count, rising; all that the filter keeps without.
    only: Option<Vec<u64>>,
}

/// The rows of a query by their places in the table, in order. Takes 16 bytes per row.
#[derive(Debug)]
pub struct Selected {
    /// Bytes of the file at which the rows start, see [`TableReader::row_at`].
    pub offsets: Vec<u64>,
}

impl Query {
    /// Rows for which `filter` holds; all without one.
    ///
    /// # Errors
    /// Those of [`Expr::condition`], as of the option `--where`.
    pub fn filter(mut self, filter: Option<&str>, columns: &[Column]) -> Result<Self> {
        self.filter = filter
            .map(|text| Expr::condition("--where", text, columns))
            .transpose()?;
        Ok(self)
    }

    /// Of the rows that the filter keeps, the `n` with the largest `size` of the `table`, of equals the first ones; those
    /// without one come last. Takes 8 bytes for each of them.
    ///
    /// # Errors
    /// Those of [`Expr::number`], and what reading returns.
    pub fn largest(mut self, n: usize, size: &str, table: &TableReader) -> Result<Self> {
        let ranked = self.clone().sort(Some(size), true, table.columns())?;
        let mut again = TableReader::open(table.path())?;
        let mut offsets = ranked.top(Some(n)).select(&mut again)?.offsets;
        offsets.sort_unstable();
        self.only = Some(offsets);
        Ok(self)
    }

    /// By rising values of `key`, or falling ones if `descending`, or if the key is a column's name
    /// after a `-`. Rows whose value is missing come last in either order; ties keep the table's
    /// order.
    ///
    /// # Errors
    /// Those of [`Expr::number`], as of the option `--sort`.
    pub fn sort(mut self, key: Option<&str>, descending: bool, columns: &[Column]) -> Result<Self> {
        self.sort = key
            .map(|text| -> Result<_> {
                let name = text.trim().strip_prefix('-').map(str::trim);
                let falling = name.filter(|n| columns.iter().any(|c| c.is_named(n)));
                let expr = Expr::number("--sort", falling.unwrap_or(text), columns)?;
                Ok((expr, descending != falling.is_some()))
            })
            .transpose()?;
        Ok(self)
    }

    /// At most the first `n` rows of that order.
    pub fn top(mut self, n: Option<usize>) -> Self {
        self.top = n;
        self
    }

    /// True if a row is one of the largest, if those are asked for, else if the filter holds for it.
    ///
    /// # Errors
    /// Those of [`Expr::test`].
    pub fn keeps(&self, row: &Row) -> Result<bool> {
        match &self.only {
            Some(offsets) => Ok(offsets.binary_search(&row.offset).is_ok()),
            None => self.filter.as_ref().map_or(Ok(true), |f| f.test(row)),
        }
    }

    /// Calls `each` with the chosen rows in order. With a sort, only 16 bytes of each chosen row are
    /// kept, and of at most `top` of them; rows are then read again.
    ///
    /// # Errors
    /// What reading returns, and what `each` returns.
    pub fn run(
        &self,
        table: &mut TableReader,
        mut each: impl FnMut(&Row) -> Result<()>,
    ) -> Result<()> {
        if self.sort.is_some() {
            let selected = self.select(table)?;
            let mut rows = table.reopen()?;
            for offset in selected.offsets {
                each(&rows.row_at(offset)?)?;
            }
            return Ok(());
        }
        let mut left = self.top.unwrap_or(usize::MAX);
        while left > 0
            && let Some(row) = table.next_row()?
        {
            if self.keeps(&row)? {
                each(&row)?;
                left -= 1;
            }
        }
        Ok(())
    }

    /// The places of the chosen rows in order.
    ///
    /// # Errors
    /// What reading returns.
    pub fn select(&self, table: &mut TableReader) -> Result<Selected> {
        let offsets = self.ordered(table, |row| Ok(row.offset))?;
        Ok(Selected { offsets })
    }

    /// The ids of the chosen rows in order. Takes 16 bytes per row; in a table by rising id ties keep its order.
    ///
    /// # Errors
    /// What reading returns.
    pub fn ids(&self, table: &mut TableReader) -> Result<Vec<u64>> {
        let id = table.own_column("id")?;
        self.ordered(table, |row| row.whole(id))
    }

    /// What `place` says of the chosen rows, in order, and by itself where keys are the same.
    fn ordered(
        &self,
        table: &mut TableReader,
        place: impl Fn(&Row) -> Result<u64>,
    ) -> Result<Vec<u64>> {
        let top = self.top.unwrap_or(usize::MAX);
        let mut heap: BinaryHeap<Keyed> = BinaryHeap::new();
        while let Some(row) = table.next_row()? {
            if !self.keeps(&row)? {
                continue;
            }
            let value = match &self.sort {
                Some((key, falling)) => {
                    let v = key.value(&row)?;
                    if *falling { v.map(|v| -v) } else { v }
                }
                None => Some(0.0),
            };
            let keyed = Keyed {
                // as `total_cmp` has it, infinity comes after all values, which are finite
                value: value.unwrap_or(f64::INFINITY),
                place: place(&row)?,
            };
            if heap.len() < top {
                heap.push(keyed);
            } else if heap.peek().is_some_and(|last| keyed < *last) {
                heap.pop();
                heap.push(keyed);
            }
        }
        Ok(heap.into_sorted_vec().iter().map(|k| k.place).collect())
    }
}

/// A row by its key, then by its place.
#[derive(Debug, Clone, Copy)]
struct Keyed {
    value: f64,
    place: u64,
}

impl Ord for Keyed {
    fn cmp(&self, other: &Self) -> Ordering {
        // -0 and 0 are the same key
        (self.value + 0.0)
            .total_cmp(&(other.value + 0.0))
            .then(self.place.cmp(&other.place))
    }
}

impl PartialOrd for Keyed {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Keyed {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Keyed {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ids(text: &str, query: impl Fn(&[Column]) -> Query) -> Vec<u64> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        let mut table = TableReader::open(&path).unwrap();
        let query = query(table.columns());
        let mut ids = Vec::new();
        query
            .run(&mut table, |row| {
                ids.push(row.whole(0)?);
                Ok(())
            })
            .unwrap();
        ids
    }

    const TEXT: &str = "id,v,touches_border\n1,5,0\n2,,1\n3,-1,0\n4,5,1\n5,7,0\n";

    #[test]
    fn rows_are_chosen_and_ordered() {
        let sorted = |key: &str, descending: bool, top: Option<usize>| {
            ids(TEXT, |c| {
                Query::default()
                    .sort(Some(key), descending, c)
                    .unwrap()
                    .top(top)
            })
        };
        assert_eq!(sorted("v", false, None), [3, 1, 4, 5, 2]);
        assert_eq!(sorted("-v", false, None), [5, 1, 4, 3, 2]);
        assert_eq!(sorted("v", true, Some(2)), [5, 1]);
        assert_eq!(sorted("-v", true, Some(2)), [3, 1]);
        assert_eq!(sorted("-v + 0 * v", false, Some(9)), [5, 1, 4, 3, 2]);
        assert_eq!(sorted("touches_border", false, Some(3)), [1, 3, 5]);
        assert_eq!(sorted("v", false, Some(0)), [0u64; 0]);
        let filtered = ids(TEXT, |c| {
            Query::default()
                .filter(Some("v > 0"), c)
                .unwrap()
                .top(Some(2))
        });
        assert_eq!(filtered, [1, 4]);
    }

    proptest! {
        #[test]
        fn the_top_is_the_start_of_the_whole_order(
            values in prop::collection::vec(prop::option::of(-5i32..5), 0..40),
            top in 0usize..45,
            descending: bool,
        ) {
            let mut text = "id,v\n".to_string();
            for (i, v) in values.iter().enumerate() {
                text += &format!("{},{}\n", i + 1, v.map_or(String::new(), |v| v.to_string()));
            }
            let run = |top| ids(&text, |c| {
                Query::default().sort(Some("v"), descending, c).unwrap().top(top)
            });
            let mut expected: Vec<u64> = (1..=values.len() as u64).collect();
            let sign = if descending { -1 } else { 1 };
            expected.sort_by_key(|i| values[*i as usize - 1].map_or((1, 0), |v| (0, sign * v)));
            prop_assert_eq!(&run(None), &expected);
            expected.truncate(top);
            prop_assert_eq!(run(Some(top)), expected);
        }
    }
}
