"""CT volumes larger than memory as glTF tiles, with cells, measures and a proof that the surface has no hole.

Arrays have the axes (z, y, x), as NumPy indexes a stack of slices. Everything else is in the order x, y, z: ``spacing``,
``dims``, ``crop``, ``macrocube``, positions of vertices. Memory stays below ``memory`` however deep a volume is.

>>> import alvis, numpy, tempfile
>>> z, y, x = numpy.ogrid[:40, :44, :48]
>>> ball = 200.0 - 8.0 * numpy.sqrt((z - 20.0) ** 2 + (y - 22.0) ** 2 + (x - 24.0) ** 2)
>>> out = tempfile.mkdtemp()
>>> made = alvis.convert(ball.astype("float32"), out, threshold=96, spacing=0.05, unit="mm")
>>> made.objects.columns[:3]
['id', 'voxels', 'volume']
>>> round(float(made.objects["volume"][0]), 2), made.objects.units["volume"]
(1.15, 'mm^3')
>>> alvis.verify(out).ok
True
"""

from ._commands import Conversion, Info, Issue, Report, convert, info, verify
from ._errors import (
    AlvisWarning,
    Error,
    FileError,
    FormatError,
    InputChangedError,
    MemoryLimitError,
    MissingFileError,
    OptionError,
    OutputError,
    Stopped,
    UnsupportedError,
)
from ._native import VERSION as __version__
from ._table import Table
from ._tileset import Piece, Tile, TileSet

__all__ = [
    "AlvisWarning",
    "Conversion",
    "Error",
    "FileError",
    "FormatError",
    "Info",
    "InputChangedError",
    "Issue",
    "MemoryLimitError",
    "MissingFileError",
    "OptionError",
    "OutputError",
    "Piece",
    "Report",
    "Stopped",
    "Table",
    "Tile",
    "TileSet",
    "UnsupportedError",
    "__version__",
    "convert",
    "info",
    "verify",
]
