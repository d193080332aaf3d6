//! The files of the tables, as the manifest names them.

use super::Table;
use serde::{Deserialize, Serialize};

/// Paths of the tables.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tables {
    /// `cells.csv`.
    pub cells: String,
    /// `objects.csv`.
    pub objects: String,
    /// `surfaces.csv`.
    pub surfaces: String,
    /// `components.csv`: the components of below voxels, where cells are parts of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub components: Option<String>,
    /// `necks.csv`: where cells of one component touch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub necks: Option<String>,
    /// `walls.csv`: what lies between cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walls: Option<String>,
    /// Checksums of the files; `None` until the manifest is written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksums: Option<TableChecksums>,
    /// The same tables as Parquet, if they are there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parquet: Option<ParquetTables>,
}

/// `components.csv`.
pub(crate) const COMPONENTS: &str = "components.csv";
/// `necks.csv`.
pub(crate) const NECKS: &str = "necks.csv";
/// `walls.csv`.
pub(crate) const WALLS: &str = "walls.csv";

impl Tables {
    /// The same with the tables of sets whose cells are parts of components.
    pub(crate) fn with_components(self) -> Self {
        Tables {
            components: Some(COMPONENTS.into()),
            necks: Some(NECKS.into()),
            ..self
        }
    }

    /// The same with the table of walls, if there is one.
    pub(crate) fn with_walls(self, walls: bool) -> Self {
        let walls = walls.then(|| WALLS.into());
        Tables { walls, ..self }
    }

    /// The same with those of these that `other` has.
    pub(crate) fn with_those_of(self, other: &Tables) -> Self {
        let named = |path: &Option<String>, name: &str| path.is_some().then(|| name.into());
        Tables {
            components: named(&other.components, COMPONENTS),
            necks: named(&other.necks, NECKS),
            walls: named(&other.walls, WALLS),
            ..self
        }
    }

    /// Those in CSV that there are, each with the checksum that is stated of it.
    pub(crate) fn sums(&self) -> impl Iterator<Item = (&str, &str)> {
        let stated = self.checksums.as_ref();
        let always = stated.map(|of| {
            [
                (&self.cells, &of.cells),
                (&self.objects, &of.objects),
                (&self.surfaces, &of.surfaces),
            ]
        });
        let more = stated.map(|of| {
            [
                (&self.components, &of.components),
                (&self.necks, &of.necks),
                (&self.walls, &of.walls),
            ]
        });
        let more = more.into_iter().flatten();
        let more = more.filter_map(|(path, of)| Some((path.as_ref()?, of.as_ref()?)));
        let all = always.into_iter().flatten().chain(more);
        all.map(|(path, of)| (path.as_str(), of.as_str()))
    }

    /// Under the names that this program gives them.
    pub(crate) fn named(parquet: bool) -> Self {
        Tables {
            cells: Table::Cells.file().into(),
            objects: Table::Objects.file().into(),
            surfaces: Table::Surfaces.file().into(),
            components: None,
            necks: None,
            walls: None,
            checksums: None,
            parquet: parquet.then(|| ParquetTables {
                cells: Table::Cells.parquet_file().into(),
                objects: Table::Objects.parquet_file().into(),
                surfaces: Table::Surfaces.parquet_file().into(),
                checksums: None,
            }),
        }
    }
}

/// Paths of the tables as Parquet.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParquetTables {
    /// `cells.parquet`.
    pub cells: String,
    /// `objects.parquet`.
    pub objects: String,
    /// `surfaces.parquet`.
    pub surfaces: String,
    /// Checksums of the three files; `None` until the manifest is written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksums: Option<TableChecksums>,
}

/// Checksums of the tables, see [`super::TileEntry::checksum`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableChecksums {
    /// Of the table of cells.
    pub cells: String,
    /// Of the table of objects.
    pub objects: String,
    /// Of the table of surfaces.
    pub surfaces: String,
    /// Of the table of components, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub components: Option<String>,
    /// Of the table of necks, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub necks: Option<String>,
    /// Of the table of walls, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walls: Option<String>,
}
