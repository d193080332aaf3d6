"""One volume in the formats that are read out of buckets, by the definitions of these."""

import itertools
import json
import struct
import zlib


def write(path, data):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def chunk(samples, dims, origin, shape, size):
    """The samples of a chunk, x fastest, zeros where the volume ends."""
    out = bytearray()
    nx, ny, nz = dims
    for k, j in itertools.product(range(shape[2]), range(shape[1])):
        z, y, x = origin[2] + k, origin[1] + j, origin[0]
        count = max(0, min(shape[0], nx - x)) if z < nz and y < ny else 0
        start = ((z * ny + y) * nx + x) * size
        out += samples[start : start + count * size] + bytes((shape[0] - count) * size)
    return bytes(out)


def chunks(samples, dims, shape):
    """Index (z, y, x) and samples of each chunk."""
    counts = [-(-n // s) for n, s in zip(dims, shape)]
    for k, j, i in itertools.product(*map(range, reversed(counts))):
        origin = [i * shape[0], j * shape[1], k * shape[2]]
        yield (k, j, i), chunk(samples, dims, origin, shape, 2)


def zarr2(folder, samples, dims):
    """Zarr 2, in an OME-Zarr of one level, packed by zlib."""
    nx, ny, nz = dims
    shape = [40, 30, 20]
    levels = [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [0.5, 0.25, 0.25]}]}]
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    write(folder / ".zgroup", b'{"zarr_format": 2}')
    write(
        folder / ".zattrs",
        json.dumps({"multiscales": [{"version": "0.4", "axes": axes, "datasets": levels}]}).encode(),
    )
    array = {
        "zarr_format": 2,
        "shape": [nz, ny, nx],
        "chunks": shape[::-1],
        "dtype": "<u2",
        "fill_value": 0,
        "compressor": {"id": "zlib", "level": 1},
        "order": "C",
        "filters": None,
        "dimension_separator": "/",
    }
    write(folder / "0" / ".zarray", json.dumps(array).encode())
    for place, data in chunks(samples, dims, shape):
        # one that is not there is full of the fill value
        if any(data):
            write(folder.joinpath("0", *map(str, place)), zlib.compress(data, 1))


def zarr3(folder, samples, dims):
    """Zarr 3 in shards of two chunks along each axis."""
    nx, ny, nz = dims
    shape, count = [32, 16, 16], 2
    inner = {
        "name": "sharding_indexed",
        "configuration": {
            "chunk_shape": shape[::-1],
            "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
            "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
            "index_location": "end",
        },
    }
    array = {
        "zarr_format": 3,
        "node_type": "array",
        "shape": [nz, ny, nx],
        "data_type": "uint16",
        "fill_value": 0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [n * count for n in shape[::-1]]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [inner],
        "attributes": {},
        "dimension_names": ["z", "y", "x"],
    }
    write(folder / "zarr.json", json.dumps(array).encode())
    shards = {}
    for place, data in chunks(samples, dims, shape):
        shards.setdefault(tuple(p // count for p in place), {})[tuple(p % count for p in place)] = data
    for place, inside in shards.items():
        body, table = b"", b""
        for at in itertools.product(range(count), repeat=3):
            data = inside.get(at)
            table += struct.pack("<QQ", len(body), len(data)) if data else b"\xff" * 16
            body += data or b""
        write(folder.joinpath("c", *map(str, place)), body + table)


def all_formats(directory, samples, dims):
    """Writes them; the words that open each, below the directory."""
    nx, ny, nz = dims
    write(directory / "scan.raw", samples)
    size = ["--dims", f"{nx},{ny},{nz}", "--dtype", "u16"]
    place = f"ElementSpacing = 0.5 0.5 1\nDimSize = {nx} {ny} {nz}\nElementType = MET_USHORT\n"
    head = f"ObjectType = Image\nNDims = 3\n{place}"
    write(directory / "scan.mhd", f"{head}ElementDataFile = scan.raw\n".encode())
    write(directory / "scan.mha", f"{head}ElementDataFile = LOCAL\n".encode() + samples)
    head = f"NRRD0004\ntype: ushort\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\n"
    write(directory / "scan.nrrd", f"{head}encoding: raw\n\n".encode() + samples)
    write(directory / "scan.nhdr", f"{head}encoding: raw\ndata file: scan.raw\n".encode())
    write(directory / "packed.nrrd", f"{head}encoding: gzip\n\n".encode() + packed(samples))
    slices = [samples[z * nx * ny * 2 : (z + 1) * nx * ny * 2] for z in range(nz)]
    for number, data in enumerate(slices):
        write(directory / "slices" / f"s{number:04}.raw", data)
    write(directory / "slices.nhdr", f"{head}encoding: raw\ndata file: slices/s%04d.raw 0 {nz - 1} 1\n".encode())
    shape = f"{{'descr': '<u2', 'fortran_order': False, 'shape': ({nz}, {ny}, {nx}), }}"
    shape = shape.ljust(118 - 1) + "\n"
    write(directory / "scan.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(shape)) + shape.encode() + samples)
    zarr2(directory / "pyramid.zarr", samples, dims)
    zarr3(directory / "shards.zarr", samples, dims)
    names = [
        "scan.mhd",
        "scan.mha",
        "scan.nrrd",
        "scan.nhdr",
        "packed.nrrd",
        "slices.nhdr",
        "scan.npy",
        "pyramid.zarr",
        "shards.zarr",
    ]
    return {"scan.raw": size, **{name: [] for name in names}}


def packed(samples):
    packer = zlib.compressobj(1, zlib.DEFLATED, 31)
    return packer.compress(samples) + packer.flush()
