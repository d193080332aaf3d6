"""What the module promises, seen from Python. `pytest py/tests` with the module installed."""

import json
import multiprocessing
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pytest

import alvis


def foam(shape=(40, 44, 48), seed=3, dtype="u1"):
    """Material with pores, some of which touch the border."""
    random = np.random.default_rng(seed)
    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
    field = np.full(shape, 9.0)
    pores = [(random.uniform(0, 1, 3), random.uniform(3, 7)) for _ in range(8)]
    # these lie inside, and apart
    pores += [((0.3, 0.3, 0.3), 5.2), ((0.7, 0.3, 0.6), 6.1), ((0.5, 0.75, 0.5), 4.3)]
    for centre, radius in pores:
        c = centre * np.array(shape)
        distance = np.sqrt((z - c[0]) ** 2 + (y - c[1]) ** 2 + (x - c[2]) ** 2)
        field = np.minimum(field, distance - radius)
    return np.clip(120 + 12 * field, 0, 250).astype(dtype)


PLACE = {"threshold": 120, "spacing": (0.05, 0.05, 0.1), "unit": "mm", "macrocube": 16}


def files(directory):
    """The bytes of all tiles and tables."""
    root = pathlib.Path(directory)
    found = [*root.glob("tiles/**/*.glb"), *root.glob("*.csv")]
    return {str(path.relative_to(root)): path.read_bytes() for path in found}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The tile set of a `.npy` file, and the array in it."""
    directory = tmp_path_factory.mktemp("made")
    array = foam()
    np.save(directory / "foam.npy", array)
    return alvis.convert(directory / "foam.npy", directory / "set", **PLACE), array


def strided(array):
    """The same samples with other strides, by name."""
    wide = np.zeros(tuple(2 * n for n in array.shape), array.dtype)
    wide[::2, ::2, ::2] = array
    unaligned = np.zeros(array.nbytes + 1, "u1")[1:].view(array.dtype).reshape(array.shape)
    unaligned[...] = array
    frozen = array.copy()
    frozen.flags.writeable = False
    return {
        "as it is": array,
        "fortran": np.asfortranarray(array),
        "transposed": np.ascontiguousarray(array.T).T,
        "axes changed": np.ascontiguousarray(array.transpose(1, 0, 2)).transpose(1, 0, 2),
        "negative": np.ascontiguousarray(array[::-1, ::-1, ::-1])[::-1, ::-1, ::-1],
        "negative x": np.ascontiguousarray(array[:, :, ::-1])[:, :, ::-1],
        "steps": wide[::2, ::2, ::2],
        "unaligned": unaligned,
        "read only": frozen,
    }


@pytest.mark.parametrize("how", list(strided(foam())))
def test_an_array_makes_the_bytes_of_its_file(made, tmp_path, how):
    conversion, array = made
    again = alvis.convert(strided(array)[how], tmp_path / "set", **PLACE)
    assert files(tmp_path / "set") == files(conversion.path)
    assert again.raw["objects"] == conversion.raw["objects"]
    assert alvis.verify(tmp_path / "set", against=strided(array)[how]).ok


@pytest.mark.parametrize("dtype", ["?", "i1", "<u2", ">u2", "<i2", ">i2", "<u4", ">i4", "<f2", ">f2", "<f4", ">f4", ">f8"])
def test_types_are_those_of_files(tmp_path, dtype):
    array = foam(dtype="f4")
    array = array > 120 if dtype == "?" else (array / 2).astype(dtype)
    np.save(tmp_path / "a.npy", array)
    options = {**PLACE, "threshold": 1 if dtype == "?" else 60}
    alvis.convert(tmp_path / "a.npy", tmp_path / "file", **options)
    for name, form in [("array", array), ("fortran", np.asfortranarray(array)), ("steps", strided(array)["steps"])]:
        alvis.convert(form, tmp_path / name, **options)
        assert files(tmp_path / name) == files(tmp_path / "file"), (dtype, name)


def test_thin_arrays_and_those_of_any_strides(tmp_path):
    for shape in [(2, 9, 70), (9, 2, 3), (130, 2, 2)]:
        array = np.random.default_rng(1).integers(0, 9, shape, "u2")
        np.save(tmp_path / "a.npy", array)
        name = "x".join(map(str, shape))
        alvis.convert(tmp_path / "a.npy", tmp_path / f"{name}f", threshold=4)
        alvis.convert(np.asfortranarray(array), tmp_path / name, threshold=4)
        assert files(tmp_path / name) == files(tmp_path / f"{name}f")


def test_what_is_no_volume_is_refused(tmp_path):
    for array, says in [
        (np.zeros((4, 4, 4), "i8"), "int64"),
        (np.zeros((4, 4, 4), "c8"), "complex64"),
        (np.zeros((4, 4, 4), "O"), "object"),
        (np.zeros((4, 4, 4), [("a", "u1")]), "a"),
        (np.zeros((4, 4), "u1"), "(4, 4)"),
        (np.zeros((4, 0, 4), "u1"), "0"),
        (np.zeros((2, 4, 4, 4), "u1"), "array[0]"),
    ]:
        with pytest.raises(alvis.OptionError) as caught:
            alvis.convert(array, tmp_path / "x", threshold=1)
        assert caught.value.place == "volume" and caught.value.found and caught.value.expected
        assert says.strip("()") in str(caught.value), caught.value
    with pytest.raises(alvis.OptionError) as caught:
        alvis.convert(np.zeros((4, 4, 4), "i8"), tmp_path / "x", threshold=1)
    assert "float32" in caught.value.expected and "uint16" in caught.value.expected
    for other in [[[1, 2]], None, 3]:
        with pytest.raises(TypeError):
            alvis.convert(other, tmp_path / "x", threshold=1)
    assert not (tmp_path / "x").exists()


def test_zarr_arrays_are_read_from_their_directory_or_through_python(made, tmp_path):
    zarr = pytest.importorskip("zarr", minversion="3")
    conversion, array = made
    chunked = {"chunks": (8, 16, 48)}
    local = zarr.create_array(str(tmp_path / "a.zarr"), shape=array.shape, dtype=array.dtype, **chunked)
    local[...] = array
    memory = zarr.create_array(zarr.storage.MemoryStore(), shape=array.shape, dtype=array.dtype, **chunked)
    memory[...] = array
    for name, each, form in [("local", local, "zarr"), ("memory", memory, "array")]:
        alvis.convert(each, tmp_path / name, **PLACE)
        assert files(tmp_path / name) == files(conversion.path)
        assert alvis.TileSet(tmp_path / name).manifest["source"]["format"] == form
        assert alvis.info(each).range == (float(array.min()), float(array.max()))


class Slices:
    """Gives arrays when it is sliced, or fails."""

    def __init__(self, array, fails=None):
        self.array, self.fails, self.asked = array, fails, 0
        self.shape, self.dtype = array.shape, array.dtype
        self.threads = set()

    def __getitem__(self, key):
        self.asked += 1
        self.threads.add(threading.get_ident())
        if self.fails:
            raise self.fails
        return np.asfortranarray(self.array[key])


def test_what_gives_arrays_is_read_once_and_its_errors_come_back(made, tmp_path):
    conversion, array = made
    slices = Slices(array)
    alvis.convert(slices, tmp_path / "set", **PLACE)
    assert files(tmp_path / "set") == files(conversion.path)
    assert slices.asked < 10
    error = RuntimeError("the disk is on fire")
    with pytest.raises(RuntimeError) as caught:
        alvis.convert(Slices(array, error), tmp_path / "x", **PLACE)
    assert caught.value is error and not (tmp_path / "x" / "index.json").exists()
    lies = Slices(array)
    lies.dtype = np.dtype("u2")
    with pytest.raises(alvis.OptionError, match="slice"):
        alvis.convert(lies, tmp_path / "y", **PLACE)


def test_errors_say_where_what_and_what_else(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        alvis.info(tmp_path / "nothing.mhd")
    assert isinstance(caught.value, alvis.Error) and caught.value.place == str(tmp_path / "nothing.mhd")
    (tmp_path / "bad.mhd").write_text("NDims = 3\nDimSize = 4 4\n")
    with pytest.raises(alvis.FormatError) as caught:
        alvis.info(tmp_path / "bad.mhd")
    assert caught.value.place and caught.value.found and caught.value.expected
    array = foam()
    for options, place in [
        ({"threshold": "high"}, "threshold"),
        ({"threshold": 1, "memory": "lots"}, "memory"),
        ({"threshold": 1, "spacing": 0.5}, "unit"),
        ({"threshold": 1, "spacing": (1, 2, -3), "unit": "mm"}, "spacing"),
        ({"threshold": 1, "dims": (3, 4, 5)}, "dims"),
        ({"threshold": 1, "frobnicate": 3}, "frobnicate"),
        ({"threshold": 1, "roi_fill": "air"}, "roi_fill"),
        ({"threshold": 1, "filters": {"median": 9}}, "median"),
    ]:
        with pytest.raises(alvis.OptionError) as caught:
            alvis.convert(array, tmp_path / "x", **options)
        assert caught.value.place == place, caught.value.place
        assert isinstance(caught.value, ValueError)
    with pytest.raises(alvis.MemoryLimitError) as caught:
        alvis.convert(array, tmp_path / "x", threshold=1, memory=1000)
    assert isinstance(caught.value, MemoryError) and "bytes" in caught.value.expected
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) and again.expected == caught.value.expected
    assert not (tmp_path / "x").exists()
    alvis.convert(array, tmp_path / "x", threshold=120)
    with pytest.raises(alvis.OutputError, match="force") as caught:
        alvis.convert(array, tmp_path / "x", threshold=120)
    # options are called as the arguments are
    assert "--" not in str(caught.value)
    alvis.convert(array, tmp_path / "x", threshold=120, force=True)


def test_options_are_those_of_the_command(tmp_path):
    array = foam()
    np.save(tmp_path / "a.npy", array)
    alvis.convert(
        array,
        tmp_path / "array",
        threshold="otsu",
        crop=((4, None), (None, 40), slice(2, 38)),
        filters={"median": 1, "smooth": 0.8},
        roi="cylinder:22,20,18",
        min_voxels=5,
        cap=True,
        parquet=True,
        encoding="meshopt",
        lod=True,
    )
    words = "--threshold otsu --crop 4:,:40,2:38 --median 1 --smooth 0.8 --roi cylinder:22,20,18 --min-voxels 5 --cap"
    words += " --tables csv,parquet --encoding meshopt --lod --quiet"
    command = [sys.executable, "-m", "alvis", "convert", tmp_path / "a.npy", tmp_path / "file", *words.split()]
    subprocess.run(command, check=True)
    assert files(tmp_path / "array") == files(tmp_path / "file")
    assert len(files(tmp_path / "array")) >= 4 and (tmp_path / "array" / "cells.parquet").exists()
    report = alvis.verify(tmp_path / "array", against=array)
    assert report.ok, report.issues
    assert alvis.info(tmp_path / "array").format == "alvis-tiles"


def test_the_verifier_finds_what_is_wrong(made, tmp_path):
    _, array = made
    alvis.convert(array, tmp_path / "set", **PLACE)
    tile = next((tmp_path / "set").glob("tiles/**/*.glb"))
    tile.write_bytes(tile.read_bytes()[:-1] + b"x")
    report = alvis.verify(tmp_path / "set")
    assert not report.ok and report.issues[0].severity == "error" and report.issues[0].message
    with pytest.raises(alvis.FormatError):
        [tile.pieces for tile in alvis.TileSet(tmp_path / "set")]
    other = array.copy()
    other[20, 20, 20] = 250 - other[20, 20, 20]
    alvis.convert(array, tmp_path / "set", force=True, **PLACE)
    assert not alvis.verify(tmp_path / "set", against=other).ok


def test_tiles_are_arrays(made):
    conversion, array = made
    tiles = conversion.tileset
    assert len(tiles) == len(list(tiles)) == conversion.tiles and tiles.dims == array.shape[::-1]
    assert tiles.spacing == (0.05, 0.05, 0.1) and tiles.unit == "mm" and tiles.threshold == 120
    assert np.allclose(tiles.world_from_voxel @ [1, 2, 3, 1], [0.05, 0.1, 0.3, 1])
    triangles = 0
    for tile in tiles:
        for piece in tile.pieces:
            assert piece.positions.dtype == np.float32 and piece.positions.shape == piece.normals.shape
            assert piece.triangles.dtype == np.uint32 and piece.triangles.shape[1] == 3
            assert piece.triangles.max() < len(piece.positions)
            assert (piece.positions * 256 % 1 == 0).all()
            assert (piece.positions >= tile.bounds[0] - 1e-6).all() and (piece.positions <= tile.bounds[1] + 1e-6).all()
            assert piece.measures["cell"] == piece.cell
            triangles += len(piece.triangles)
        x, y, z = tile.grid
        assert tiles.tile(x, y, z).path == tile.path and os.path.exists(tile.path)
    assert triangles == conversion.triangles
    with pytest.raises(KeyError):
        tiles.tile(0, 0, 99)
    with pytest.raises(FileNotFoundError):
        alvis.TileSet("/nothing/there")


def test_meshes_of_cells_are_closed_and_have_the_tables_measures(made):
    pytest.importorskip("trimesh")
    conversion, _ = made
    tiles, cells = conversion.tileset, conversion.cells
    whole = cells["id"][~cells["touches_border"]]
    assert len(whole) > 0
    for cell in whole:
        mesh = tiles.to_trimesh(cell=int(cell))
        row = int(cell) - 1
        assert mesh.is_watertight and mesh.metadata["cell"] == cell
        # seen from the cell, so the other way round
        assert np.isclose(-mesh.volume, cells["mesh_volume"][row], rtol=1e-6)
        assert np.isclose(mesh.area, cells["area"][row], rtol=1e-5)
    assert len(tiles.to_trimesh().faces) == conversion.triangles
    assert len(tiles.to_trimesh().vertices) == conversion.vertices
    with pytest.raises(alvis.OptionError):
        tiles.to_trimesh(cell=10**6)
    tile = tiles.tile(0, 0, 0)
    assert len(tile.to_trimesh().faces) == tile.triangles


def test_tables_are_arrays_and_arrow(made):
    conversion, _ = made
    cells = conversion.cells
    assert len(cells) == conversion.cells_count == len(cells["id"]) and list(cells)[0] == "id"
    assert cells["id"].dtype == np.int64 and cells["touches_border"].dtype == bool
    assert np.isnan(cells["mesh_volume"][cells["touches_border"]]).all()
    assert cells.units["volume"] == "mm^3" and "id" not in cells.units and "volume" in cells
    with pytest.raises(KeyError, match="sphericity"):
        cells["nothing"]
    with pytest.raises(alvis.OptionError):
        alvis.Table(conversion.path, "nothing", 0)


def same_as_arrays(table, columns, values):
    """Columns of another program against those of the table; `values` gives one, with NaN or None for nothing."""
    assert columns == table.columns
    for name in columns:
        ours, theirs = table[name], [np.nan if v is None else v for v in values(name)]
        assert np.array_equal(ours, np.array(theirs), equal_nan=ours.dtype == np.float64), name


def test_cells_are_parts_where_they_are_split_or_labelled(made, tmp_path):
    conversion, array = made
    with pytest.raises(alvis.OptionError, match="split or labels"):
        conversion.necks
    # two balls that overlap: one component, and a neck between
    z, y, x = np.ogrid[:40, :40, :60]
    ball = lambda cx: (z - 20) ** 2 + (y - 20) ** 2 + (x - cx) ** 2
    both = np.where(np.minimum(ball(20), ball(38)) < 100, 20, 200).astype("u1")
    whole = alvis.convert(both, tmp_path / "whole", threshold=100)
    cut = alvis.convert(both, tmp_path / "cut", threshold=100, split=True, split_min_radius=1)
    assert whole.cells_count == 1 and cut.cells_count == 2
    assert len(cut.components) == len(cut.necks) == 1
    assert (cut.cells["component"] == cut.components["id"][0]).all()
    assert cut.cells["voxels"].sum() == whole.cells["voxels"].sum() == (both < 100).sum()
    assert [int(cut.necks[name][0]) for name in ("cell_a", "cell_b")] == [1, 2]
    # what parts of a component have no number of is missing, as numbers and by Arrow
    assert whole.cells["euler_characteristic"].dtype == np.int64
    assert cut.cells["euler_characteristic"].dtype == np.float64 and np.isnan(cut.cells["euler_characteristic"]).all()
    pa = pytest.importorskip("pyarrow")
    arrow = pa.table(cut.cells)["euler_characteristic"]
    assert arrow.type == pa.int64() and arrow.null_count == 2
    assert pa.table(whole.cells)["euler_characteristic"].to_pylist() == whole.cells["euler_characteristic"].tolist()
    for name in ("cells", "objects", "surfaces", "components", "necks"):
        table = getattr(cut, name)
        for column in table.columns:
            assert len(table[column]) == len(table)
    # the same cells from a file
    halves = np.where(np.arange(60) < 30, 7, 9).astype("u2") * (both < 100)
    np.save(tmp_path / "halves.npy", halves)
    given = alvis.convert(both, tmp_path / "given", threshold=100, labels=tmp_path / "halves.npy")
    assert given.cells["id"].tolist() == [7, 9]
    assert given.cells["voxels"].tolist() == [(halves == 7).sum(), (halves == 9).sum()]
    assert alvis.verify(tmp_path / "cut", against=both).ok and alvis.verify(tmp_path / "given", against=both).ok


def test_a_forked_process_converts_after_its_parent_has(made, tmp_path):
    _, array = made
    process = multiprocessing.get_context("fork").Process(
        target=alvis.convert, args=(array, tmp_path / "forked"), kwargs={"threshold": 100}
    )
    process.start()
    process.join(120)
    ended = process.exitcode
    process.kill()
    assert ended == 0 and alvis.verify(tmp_path / "forked", against=array).ok


def test_what_cannot_be_meant_is_refused(tmp_path):
    array = np.arange(1000, dtype="u1").reshape(10, 10, 10)
    out = tmp_path / "out"
    with pytest.raises(TypeError, match="threshold: found True"):
        alvis.convert(array, out, threshold=True)
    with pytest.raises(TypeError, match="shape"):
        alvis.convert(array, out, threshold=100, labels=array)
    with pytest.raises(TypeError, match="mask"):
        alvis.convert(np.ma.masked_greater(array, 200), out, threshold=100)
    with pytest.raises(ValueError, match="step"):
        alvis.convert(array, out, threshold=100, crop=(slice(0, 10, 2), slice(None), slice(None)))
    with pytest.raises(ValueError, match="filters"):
        alvis.convert(array, out, threshold=100, filters={"force": True})
    with pytest.raises(TypeError, match="cap"):
        alvis.convert(array, out, threshold=100, cap=2)
    with pytest.raises(alvis.OptionError, match="a number in 1..=1024"):
        alvis.convert(array, out, threshold=100, threads=0)
    # a mask that hides nothing
    assert alvis.info(np.ma.masked_greater(array, 255)).range == (0, 255)
    assert not out.exists()


def test_walls_between_cells_are_a_table(made, tmp_path):
    conversion, _ = made
    with pytest.raises(alvis.OptionError, match="walls"):
        conversion.walls
    # two boxes with a wall of 4 voxels
    array = np.full((30, 30, 40), 200, "u1")
    array[5:25, 5:25, 5:18] = array[5:25, 5:25, 22:35] = 0
    own = alvis.convert(array, tmp_path / "own", threshold=100, walls=True)
    walls = own.walls
    assert len(walls) == 1 and [int(walls[name][0]) for name in ("cell_a", "cell_b")] == [1, 2]
    assert abs(walls["wall_thickness"][0] - 4) < 0.1 and not walls["thin"][0]
    assert own.cells["neighbours"].tolist() == [1, 1]
    assert alvis.verify(tmp_path / "own", against=array).ok


def test_pyarrow_reads_the_stream(made):
    pyarrow = pytest.importorskip("pyarrow")
    for table in [made[0].cells, made[0].objects, made[0].surfaces]:
        read = pyarrow.table(table)
        read.validate(full=True)
        same_as_arrays(table, read.column_names, lambda name: read[name].to_pylist())
        assert read.schema == pyarrow.schema(table)
        for name, unit in table.units.items():
            assert read.schema.field(name).metadata == {b"unit": unit.encode()}
    reader = pyarrow.RecordBatchReader.from_stream(made[0].cells)
    assert sum(batch.num_rows for batch in reader) == len(made[0].cells)


def test_polars_and_pandas_read_the_stream(made):
    cells = made[0].cells
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame(cells)
    same_as_arrays(cells, frame.columns, lambda name: frame[name].to_list())
    pandas = pytest.importorskip("pandas")
    if hasattr(pandas.DataFrame, "from_arrow"):
        frame = pandas.DataFrame.from_arrow(cells)
        same_as_arrays(cells, list(frame.columns), lambda name: frame[name].to_list())


def test_capsules_that_nobody_takes_are_given_back(made):
    resource = pytest.importorskip("resource")
    cells = made[0].cells
    for _ in range(200):
        cells.__arrow_c_stream__(), cells.__arrow_c_schema__()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(2000):
        cells.__arrow_c_stream__(), cells.__arrow_c_schema__()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 20000


def test_a_table_of_many_batches(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    array = (np.random.default_rng(0).random((40, 100, 100)) < 0.2).astype("u1")
    made = alvis.convert(array, tmp_path / "set", threshold=1)
    read = pyarrow.table(made.objects)
    read.validate(full=True)
    assert len(read) == made.objects_count > 20000 and read["id"].num_chunks > 1
    same_as_arrays(made.objects, read.column_names, lambda name: read[name].to_pylist())


def test_progress_is_told_in_the_calling_thread(tmp_path):
    told = []
    here = threading.get_ident()
    array = np.tile(foam((64, 64, 64)), (3, 3, 3))

    def progress(stage, done, total):
        assert threading.get_ident() == here
        told.append((stage, done, total))

    alvis.convert(array, tmp_path / "set", threshold=120, progress=progress)
    assert told and all(isinstance(stage, str) and done >= 0 and total >= 0 for stage, done, total in told)


class Stop(Exception):
    pass


def test_what_progress_raises_stops_the_work_and_it_goes_on(tmp_path):
    array = np.tile(foam((64, 64, 64)), (4, 3, 3))
    options = {"threshold": 120, "macrocube": 16, "threads": 1}

    def progress(stage, done, total):
        if done > 3:
            raise Stop

    with pytest.raises(Stop):
        alvis.convert(array, tmp_path / "set", progress=progress, **options)
    assert not (tmp_path / "set" / "index.json").exists()
    if (tmp_path / "set").exists():
        with pytest.raises(alvis.OutputError, match="other|differs|interrupted"):
            alvis.convert(array + 1, tmp_path / "set", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", alvis.AlvisWarning)
        alvis.convert(array, tmp_path / "set", resume=True, **options)
    alvis.convert(array, tmp_path / "whole", **options)
    assert files(tmp_path / "set") == files(tmp_path / "whole")


CTRL_C = """
import sys, threading, time, numpy, alvis
array = numpy.tile(numpy.random.default_rng(1).integers(0, 250, (50, 50, 50), "u1"), (8, 6, 6))
print("ready", flush=True)
try:
    alvis.convert(array, sys.argv[1], threshold=120, macrocube=16, progress=lambda *told: print(*told, flush=True))
except KeyboardInterrupt as stopped:
    print("stopped", *getattr(stopped, "__notes__", []), flush=True)
    sys.exit(7)
"""


def test_ctrl_c_is_a_keyboard_interrupt_and_leaves_nothing_half_made(tmp_path):
    command = [sys.executable, "-c", CTRL_C, str(tmp_path / "set")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
    assert process.returncode == 7 and "stopped" in rest
    assert not (tmp_path / "set" / "index.json").exists()


def test_the_lock_is_released(tmp_path):
    array = np.tile(foam((64, 64, 64)), (4, 3, 3))
    ticks, over = [], threading.Event()

    def count():
        while not over.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    other = threading.Thread(target=count)
    other.start()
    alvis.convert(array, tmp_path / "set", threshold=120)
    over.set()
    other.join()
    assert len(ticks) > 20


def test_several_conversions_at_once(made, tmp_path):
    conversion, array = made
    done = []

    def work(n):
        alvis.convert(array, tmp_path / str(n), **PLACE)
        done.append(files(tmp_path / str(n)) == files(conversion.path))

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert done == [True] * 4


def test_warnings_are_warnings(tmp_path):
    with pytest.warns(alvis.AlvisWarning) as caught:
        made = alvis.convert(foam(), tmp_path / "set", threshold=1000)
    assert made.warnings and str(caught[0].message) in made.warnings
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", alvis.AlvisWarning)
        with pytest.raises(alvis.AlvisWarning):
            alvis.convert(foam(), tmp_path / "other", threshold=1000)


def test_the_command_is_there():
    command = [sys.executable, "-m", "alvis"]
    version = subprocess.run([*command, "--version"], check=True, capture_output=True, text=True).stdout
    assert version.split()[-1].startswith(alvis.__version__)
    refused = subprocess.run([*command, "info", "/nothing"], capture_output=True, text=True)
    assert refused.returncode == 2 and "/nothing" in refused.stderr
    script = pathlib.Path(sys.executable).with_name("alvis")
    if script.exists():
        assert subprocess.run([script, "--version"], check=True, capture_output=True, text=True).stdout == version


def test_json_is_what_the_command_prints(made, tmp_path):
    conversion, array = made
    printed = subprocess.run(
        [sys.executable, "-m", "alvis", "verify", conversion.path, "--json"], check=True, capture_output=True, text=True
    ).stdout
    ours = alvis.verify(conversion.path).raw
    theirs = json.loads(printed)
    for times in ["seconds", "peak_rss_bytes"]:
        ours.pop(times), theirs.pop(times)
    assert ours == theirs
