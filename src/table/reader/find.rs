//! The row of a table with an id.

use super::{Row, TableReader};
use crate::error::{Error, Result};
use std::io::BufRead;
use std::ops::Range;

/// Bytes in which a row is looked for one by one.
const NEAR: u64 = 1 << 14;

impl TableReader {
    /// The row with an id. In a table by rising id few rows are read, in another one all of them.
    ///
    /// # Errors
    /// Those of [`TableReader::next_row`] and [`Row::whole`].
    pub fn find(&mut self, id: u64) -> Result<Option<Row<'_>>> {
        let column = self.own_column("id")?;
        let near = self.bisect(column, id)?;
        for rows in [near, self.first..u64::MAX] {
            self.jump(rows.start)?;
            while self.offset < rows.end
                && let Some(row) = self.next_row()?
            {
                if row.whole(column)? == id {
                    let offset = row.offset;
                    return self.row_at(offset).map(Some);
                }
            }
        }
        Ok(None)
    }

    /// Bytes of a few rows among which the one with an id is, if ids rise and it is there.
    fn bisect(&mut self, column: usize, id: u64) -> Result<Range<u64>> {
        let bytes = self.input.get_ref().len();
        let bytes = bytes.map_err(|e| Error::io(&self.path, "look at the table", e))?;
        // where a row begins, whose id is not larger; from where on all are larger
        let (mut low, mut high) = (self.first, bytes);
        while high.saturating_sub(low) > NEAR {
            let middle = low + (high - low) / 2;
            match self.line_from(middle)?.filter(|&start| start < high) {
                None => high = middle,
                Some(start) => match self.row_at(start).and_then(|row| row.whole(column)) {
                    Ok(found) if found <= id => low = start,
                    Ok(_) => high = middle,
                    // lines that are no rows: a field may have an end of line in it
                    Err(_) => break,
                },
            }
        }
        Ok(low..high)
    }

    /// Where the first line begins that does so at a byte or behind it.
    fn line_from(&mut self, offset: u64) -> Result<Option<u64>> {
        self.jump(offset - 1)?;
        loop {
            let input = self.input.fill_buf();
            let input = input.map_err(|e| Error::io(&self.path, "read the table", e))?;
            let end = input.iter().position(|&b| b == b'\n');
            let (whole, read) = (input.is_empty(), end.map_or(input.len(), |end| end + 1));
            self.input.consume(read);
            self.offset += read as u64;
            if whole || end.is_some() {
                return Ok(end.map(|_| self.offset));
            }
        }
    }
}
