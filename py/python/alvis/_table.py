"""Tables of cells, objects and surfaces; of components and necks where cells are parts, and of walls."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import Any

from numpy.typing import NDArray

from . import _native
from ._errors import OptionError


class Table:
    """A table of a tile set, read from its file whenever it is asked, and never kept.

    Columns are NumPy arrays of one entry a row: ``table["volume"]``. All of it goes, batch by batch, to whatever knows
    the Arrow C interface, with units in the metadata of the fields and nothing to install::

        polars.DataFrame(table)
        pyarrow.table(table)
        pandas.DataFrame.from_arrow(table)      # from pandas 3 on
    """

    def __init__(self, path: str | PathLike[str], name: str, rows: int) -> None:
        opened = _native.TileSet(path).table(name)
        if opened is None:
            expected = (
                "cells, objects or surfaces; components or necks of a set that was converted with split or labels; "
                "walls of one that was converted with walls"
            )
            raise OptionError(f"name: found {name!r}, expected {expected}", "name", name, expected)
        self._table, self._rows = opened, rows
        self.name = name
        """``cells``, ``objects``, ``surfaces``, ``components``, ``necks`` or ``walls``."""

    @property
    def columns(self) -> list[str]:
        """The names of the columns, without units."""
        return [name for name, _ in self._table.columns]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column that has one, such as ``mm^3``."""
        return {name: unit for name, unit in self._table.columns if unit}

    def __len__(self) -> int:
        """Rows."""
        return self._rows

    def __iter__(self) -> Iterator[str]:
        """The names of the columns."""
        return iter(self.columns)

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column, shape (rows,): int64, bool, or float64 with NaN where the table has nothing.

        Whole numbers are float64, too, where some are missing: ``euler_characteristic`` of cells that are parts of
        components.

        Raises ``KeyError`` if there is no such column.
        """
        column = self._table.column(name)
        if column is None:
            raise KeyError(f"{name!r}: the columns are {', '.join(self.columns)}")
        return column

    def __repr__(self) -> str:
        return f"<alvis.Table {self.name}: {len(self)} rows, {len(self.columns)} columns>"

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """The table for whatever speaks Arrow; types are as they are, whatever is requested."""
        return self._table.stream()

    def __arrow_c_schema__(self) -> object:
        """The columns for whatever speaks Arrow."""
        return self._table.schema()
