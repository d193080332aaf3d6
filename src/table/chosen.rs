//! Some rows of one of the tables, as commands that use tiles choose them.

use super::Table;
use super::query::Query;
use super::reader::TableReader;
use crate::error::Result;

/// Cells, objects or surfaces: those for which a condition holds, and of these the largest.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Chosen {
    /// Which of the tables the condition is on.
    pub table: Table,
    /// The condition on its columns; see [`crate::table`] for the language. All rows without one.
    pub condition: Option<String>,
    /// At most so many: the largest by volume, of surfaces by area; of equals those with the smaller id.
    pub largest: Option<usize>,
}

impl Chosen {
    /// The cells for which a condition holds.
    pub fn cells(condition: &str) -> Chosen {
        Chosen {
            condition: Some(condition.to_owned()),
            ..Chosen::default()
        }
    }

    /// True if nothing is left out.
    pub fn is_all(&self) -> bool {
        self.condition.is_none() && self.largest.is_none()
    }

    /// What to ask the table: the rows that are chosen, in the table's order.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a condition that cannot be; what reading returns, if the largest are asked for.
    pub fn query(&self, table: &TableReader) -> Result<Query> {
        let query = Query::default().filter(self.condition.as_deref(), table.columns())?;
        match self.largest {
            None => Ok(query),
            Some(n) => query.largest(n, self.table.size(), table),
        }
    }
}
