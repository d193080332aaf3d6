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
/// The same as Parquet.
pub(crate) const COMPONENTS_PARQUET: &str = "components.parquet";
pub(crate) const NECKS_PARQUET: &str = "necks.parquet";
pub(crate) const WALLS_PARQUET: &str = "walls.parquet";

impl Tables {
    /// The same with the tables of sets whose cells are `parts` of components, and that of `walls`.
    pub(crate) fn with(self, parts: bool, walls: bool) -> Self {
        let named = |there: bool, name: &str| there.then(|| name.to_owned());
        Tables {
            components: named(parts, COMPONENTS),
            necks: named(parts, NECKS),
            walls: named(walls, WALLS),
            parquet: self.parquet.map(|parquet| ParquetTables {
                components: named(parts, COMPONENTS_PARQUET),
                necks: named(parts, NECKS_PARQUET),
                walls: named(walls, WALLS_PARQUET),
                ..parquet
            }),
            ..self
        }
    }

    /// The same with those of these that `other` has.
    pub(crate) fn with_those_of(self, other: &Tables) -> Self {
        self.with(other.necks.is_some(), other.walls.is_some())
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

    /// The names of all files that there are.
    pub(crate) fn files(&self) -> impl Iterator<Item = &str> {
        let some = [&self.components, &self.necks, &self.walls];
        let parquet = self.parquet.iter().flat_map(|own| {
            let some = [&own.components, &own.necks, &own.walls];
            let always = [&own.cells, &own.objects, &own.surfaces];
            always.into_iter().chain(some.into_iter().flatten())
        });
        let always = [&self.cells, &self.objects, &self.surfaces];
        let all = always.into_iter().chain(some.into_iter().flatten());
        all.chain(parquet).map(String::as_str)
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
                components: None,
                necks: None,
                walls: None,
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
    /// `components.parquet`, if there is a table of these.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub components: Option<String>,
    /// `necks.parquet`, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub necks: Option<String>,
    /// `walls.parquet`, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walls: Option<String>,
    /// Checksums of the files; `None` until the manifest is written.
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
