//! Work that goes on one thing after the other, once there was no memory for several at once.

/// Whether a queue hands out one thing at a time, and what others still have in hand from before.
#[derive(Debug, Default)]
pub struct OneByOne {
    is_on: bool,
    /// What others have had in hand since before that.
    company: u32,
}

impl OneByOne {
    /// True from [`OneByOne::begin`] on.
    pub fn is_on(&self) -> bool {
        self.is_on
    }

    /// From now on nothing is handed out beside anything else, `in_hand` of which others still have.
    pub fn begin(&mut self, in_hand: u32) {
        if !self.is_on {
            *self = OneByOne {
                is_on: true,
                company: in_hand,
            };
        }
    }

    /// Something has ended. True if it began when all else had.
    pub fn ended_alone(&mut self) -> bool {
        let alone = self.is_on && self.company == 0;
        self.company = self.company.saturating_sub(1);
        alone
    }
}

/// What tests of queues let fail.
#[cfg(test)]
pub fn too_dense() -> crate::error::Error {
    crate::error::Error::TooDense {
        limit: 1,
        needed: 2,
        uses: Vec::new(),
    }
}
