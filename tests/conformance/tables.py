"""Compares the tables of a tile set as Parquet, as other programs read them, with those in CSV.

    tables.py ALVIS WORK

ALVIS is the command, WORK a directory for tile sets. Ends with a line `N passed, N failed`.

pyarrow, DuckDB and polars each read names, types, values to the last bit, and what is missing; units come from the
metadata. The CSV files are read by Python's own module.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import duckdb
import polars
import pyarrow.parquet

WHOLE = {
    "id", "voxels", "euler_characteristic", "tiles", "cell", "object", "triangles", "vertices", "border_edges",
}  # fmt: skip


def expected(path):
    """Names with units, and the columns as Python values."""
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    names = [title.split(" [")[0] for title in header]
    units = {name: title.split(" [")[1][:-1] for name, title in zip(names, header) if " [" in title}

    def value(name, text):
        if name in WHOLE:
            return int(text)
        if name == "touches_border":
            return text == "1"
        return float(text) if text else None

    columns = {name: [value(name, row[i]) for row in rows] for i, name in enumerate(names)}
    return columns, units


def by_pyarrow(path):
    return pyarrow.parquet.read_table(path).to_pydict()


def by_duckdb(path):
    found = duckdb.sql(f"select * from '{path}'")
    return dict(zip(found.columns, map(list, zip(*found.fetchall()))))


def by_polars(path):
    return polars.read_parquet(path).to_dict(as_series=False)


def check(tiles, report):
    for table in ["cells", "objects", "surfaces"]:
        columns, units = expected(tiles / f"{table}.csv")
        path = tiles / f"{table}.parquet"
        for read in [by_pyarrow, by_duckdb, by_polars]:
            found = read(path)
            same = list(found) == list(columns) and all(
                [repr(v) for v in found[name]] == [repr(v) for v in columns[name]] for name in columns
            )
            report(same and len(columns["id"]) > 0, f"{tiles.name}/{table} {read.__name__}: {len(columns['id'])} rows")
        about = json.loads(pyarrow.parquet.read_metadata(path).metadata[b"alvis"])
        report(about == {"table": table, "units": units}, f"{tiles.name}/{table}: units {units}")


def main(alvis, work):
    work.mkdir(parents=True, exist_ok=True)
    counts = [0, 0]

    def report(passed, what):
        counts[not passed] += 1
        print("ok" if passed else "FAILED", what)

    def run(*arguments):
        subprocess.run([alvis, *map(str, arguments), "--quiet"], check=True)

    scan = work / "foam.mhd"
    run("phantom", "foam", scan, "--dims", "120,110,100", "--spacing", "0.05", "--unit", "mm")
    tiles, part, noise = work / "tiles", work / "part", work / "noise"
    kinds = ["--tables", "csv,parquet"]
    run("convert", scan, tiles, "--threshold", "otsu", "--table-unit", "um", "--force", *kinds)
    run("select", tiles, part, "--where", "not touches_border", "--force")
    raw = work / "noise.raw"
    raw.write_bytes(bytes((i * i * 2654435761 >> 7) % 256 for i in range(64**3)))
    # more rows than a group has
    run("convert", raw, noise, "--dims", "64,64,64", "--dtype", "u8", "--threshold", 200, "--force", *kinds)
    for each in [tiles, part, noise]:
        run("verify", each)
        check(each, report)
    print(f"{counts[0]} passed, {counts[1]} failed")
    return counts[1] > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
