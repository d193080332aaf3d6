//! Cells that are split at their necks, in parts of a volume. What joins records and surfaces, and what a part knows of these
//! when it is finished, serves cells that labels give, too.
//!
//! | file | what it is |
//! |---|---|
//! | `columns` | how far it is from the faces of a part to what is solid in others |
//! | `basins` | the round that finds the basins of a part, and what joins them |
//! | `cells` | the round that finds their saddles, and what joins them to cells |
//! | `meshed` | what a part finds of its cells when it is meshed: sums, surfaces, necks |
//! | `join_records`, `surfaces`, `necks` | what joins these |
//! | `finished` | what a part is to know of all its cells when it is finished |

mod basins;
mod cells;
mod columns;
mod finished;
mod join_records;
mod meshed;
mod necks;
mod surfaces;

pub use basins::merge_basins;
pub use cells::{MergedCells, merge_cells};
pub use columns::{own_slices, write_columns};
pub use finished::read_cells;
pub use join_records::{MergedRecords, merge_split_records};
pub use meshed::{
    CELLS, COMPONENTS, CellRecord, CellsToMesh, MeshedPart, OBJECTS, SharedCell, write_meshed,
};
pub use necks::each_neck;
pub use surfaces::{CellOwners, merge_surfaces};
