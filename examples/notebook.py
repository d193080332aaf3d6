# %% [markdown]
# # From an array to cells
# Runs as it stands, from top to bottom or cell by cell in Jupyter, VS Code or Spyder:
# `pip install alvis trimesh polars`, then `python examples/notebook.py`.

# %%
import tempfile
from pathlib import Path

import numpy as np

import alvis

out = Path(tempfile.mkdtemp())

# %% [markdown]
# ## A volume
# Axes are z, y, x, as of a stack of slices. Here: bubbles in a block, as bright as a scan has them, with noise.

# %%
random = np.random.default_rng(7)
shape = (96, 112, 128)
z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
distance = np.full(shape, 20.0)
for _ in range(60):
    cz, cy, cx = random.uniform(0, 1, 3) * shape
    distance = np.minimum(distance, np.sqrt((z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2) - random.uniform(5, 11))
volume = np.clip(20000 + 4000 * distance + random.normal(0, 900, shape), 0, 65535).astype("uint16")

# %% [markdown]
# ## What is in it
# One pass over the samples: range, histogram, thresholds, and what the surface would cost.

# %%
found = alvis.info(volume, spacing=0.02, unit="mm")
print(f"{found.shape} voxels, {found.range[0]:.0f} to {found.range[1]:.0f}, Otsu at {found.otsu:.0f}")
print(f"about {found.predicted['triangles']} triangles, {found.predicted['bytes'] >> 20} MiB of tiles")

# %% [markdown]
# ## Tiles
# The array is read where it is. `spacing` is x, y, z; one number if voxels are cubes. Filters are applied on the way.

# %%
made = alvis.convert(
    volume,
    out / "tiles",
    threshold=20000,
    spacing=0.02,
    unit="mm",
    filters={"median": 1},
    min_voxels=20,
    memory="512MiB",
    progress=lambda stage, done, total: None,
)
print(f"{made.tiles} tiles, {made.triangles} triangles, {made.cells_count} cells")

# %% [markdown]
# ## The proof
# The verifier rebuilds the surface from the files, and compares it with the volume.

# %%
report = alvis.verify(out / "tiles", against=volume)
assert report.ok, report.issues

# %% [markdown]
# ## Cells
# Columns are NumPy arrays; `units` says in what. Cells that the border cuts are left out of the distribution.

# %%
cells = made.cells
whole = ~cells["touches_border"]
diameter = cells["equivalent_diameter"][whole]
print(f"{whole.sum()} whole cells, median diameter {np.median(diameter):.3f} {cells.units['equivalent_diameter']}")

# %% [markdown]
# The same table in polars, pandas or pyarrow: `polars.DataFrame(made.cells)`, `pyarrow.table(made.cells)`.

# %%
try:
    import polars

    frame = polars.DataFrame(cells).filter(~polars.col("touches_border"))
    print(frame.select("id", "volume", "sphericity").sort("volume", descending=True).head(3))
except ImportError:
    print("polars is not installed")

# %% [markdown]
# ## Meshes
# A tile is a file; its pieces are arrays. A whole cell is sewn from all tiles that it reaches into.

# %%
tiles = made.tileset
for tile in tiles:
    for piece in tile.pieces:
        assert piece.positions.shape == piece.normals.shape
largest = int(cells["id"][whole][np.argmax(diameter)])
try:
    import trimesh  # noqa: F401

    mesh = tiles.to_trimesh(cell=largest)
    assert mesh.is_watertight
    mesh.export(out / "largest.stl")
    print(f"cell {largest}: {len(mesh.faces)} triangles, {abs(mesh.volume):.5f} mm^3")
except ImportError:
    print("trimesh is not installed")
