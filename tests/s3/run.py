#!/usr/bin/env python3
"""Volumes and tile sets in buckets, compared with the same on this machine.

    tests/s3/run.py PROGRAM DIR [--npm DIR] [--without PROGRAM]

PROGRAM is built with the feature `s3`, the one of --without is not. Objects lie in moto's store, behind a proxy that refuses,
breaks off, shortens and forgets conditions, and in s3rver, whose objects are files and which ignores conditions by itself.
What is not installed is skipped, with a line that says so. Ends with `N passed, N failed`.
"""

import argparse
import filecmp
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import threading
import time
import traceback
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import stores
import volumes
from proxy import Fault, Proxy, key_of

BUCKET = "lab"
KEY, SECRET, TOKEN = "AKIAALVISTESTKEY0001", "hidden/secret+of+the+tests", "token-of-the-tests"
DIMS = [90, 70, 60]
OPTIONS = ["--threshold", "otsu", "--macrocube", "32", "--quiet"]


class Lab:
    """A program, a directory, and a bucket behind a proxy."""

    def __init__(self, program, directory, proxy, client):
        self.program, self.directory, self.proxy, self.client = program, directory, proxy, client
        self.said = []
        self.home = directory / "home"
        self.home.mkdir()
        self.environment = {
            "HOME": str(self.home),
            "PATH": os.environ["PATH"],
            "TMPDIR": str(directory / "tmp"),
            "AWS_ACCESS_KEY_ID": KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET,
            "AWS_SESSION_TOKEN": TOKEN,
            "AWS_REGION": "eu-central-1",
            "AWS_ENDPOINT_URL": proxy.url,
        }
        (directory / "tmp").mkdir()

    def run(self, *words, status=0, program=None, environment=None):
        """What a command prints, that ends with a status; and what it says beside."""
        words = [str(word) for word in [program or self.program, *words]]
        done = subprocess.run(words, capture_output=True, text=True, env=environment or self.environment, timeout=300)
        self.said += [done.stdout, done.stderr]
        if done.returncode != status:
            raise AssertionError(
                f"{words[1:]} ended with {done.returncode}, expected {status}: {done.stderr[-2000:]}"
            )
        return done.stdout, done.stderr

    def refused(self, *words, says, **kwargs):
        """Checks that a command fails with a message that has these texts."""
        _, said = self.run(*words, status=2, **kwargs)
        missing = [text for text in says if text not in said]
        if missing:
            raise AssertionError(f"{words}: found {said!r}, expected {missing}")
        return said

    def put(self, path, key):
        """Puts a file, or all files of a directory."""
        files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
        for file in files:
            inner = "" if path.is_file() else "/" + str(file.relative_to(path))
            self.client.put_object(Bucket=BUCKET, Key=key + inner, Body=file.read_bytes())

    def keys(self, key):
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=key)
        return [entry["Key"] for page in pages for entry in page.get("Contents", [])]

    def get(self, key, to):
        """Fetches all objects below a key into a directory."""
        for each in self.keys(key + "/"):
            file = to / each.removeprefix(key + "/")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(self.client.get_object(Bucket=BUCKET, Key=each)["Body"].read())
        return to

    def place(self, name):
        return self.directory / name


def same(a, b):
    """Checks that two directories have the same files."""
    found = [{path.relative_to(root) for path in root.rglob("*") if path.is_file()} for root in [a, b]]
    differing = [path for path in found[0] & found[1] if not filecmp.cmp(a / path, b / path, shallow=False)]
    differing = sorted(map(str, [*(found[0] ^ found[1]), *differing]))
    assert found[0] and not differing, f"{a} and {b} differ in {differing[:9]}"


def url(key):
    return f"s3://{BUCKET}/{key}"


def formats(lab):
    """Each format tells the same, and gives the same tiles."""
    for name, words in lab.opening.items():
        local, remote = lab.place("scans") / name, url(f"scans/{name}")
        told = [json.loads(lab.run("info", path, *words, "--json")[0]) for path in [local, remote]]
        # what is fetched takes memory, which is counted
        memory = [each["predicted"].pop("memory_bytes") for each in told]
        assert told[0] == told[1] and memory[0] <= memory[1], f"{name}: {memory} {told}"
        made = [lab.place(f"{name}-{where}") for where in ["here", "there"]]
        for path, out in zip([local, remote], made):
            lab.run("convert", path, out, *words, *OPTIONS)
        same(*made)
        lab.run("verify", made[1], "--against", remote, *words, "--quiet")


def few_requests(lab):
    """A volume is fetched in few parts, none twice, and in memory that is counted."""
    lab.proxy.reset()
    told = lab.run(
        "convert",
        url("scans/big.raw"),
        lab.place("big"),
        *lab.big,
        "--threshold",
        "otsu",
        "--memory",
        "200MiB",
        "--json",
    )
    gets = [entry for entry in lab.proxy.log if entry[0] == "GET" and "big.raw" in entry[1]]
    size = lab.place("scans/big.raw").stat().st_size
    # otsu reads it once, the sweep a second time; opening takes a few more
    assert len(gets) <= 2 * size / (2 << 20) + 30, f"{len(gets)} requests for {size} bytes"
    report = json.loads(told[0])
    assert report["peak_rss_bytes"] < 200 << 20, report["peak_rss_bytes"]
    lab.run("convert", lab.place("scans/big.raw"), lab.place("big-here"), *lab.big, *OPTIONS[:2], "--quiet")
    same(lab.place("big"), lab.place("big-here"))


def output(lab):
    """A tile set in a bucket is that on this machine; each object was put once, the index last."""
    lab.proxy.reset()
    lab.run("convert", lab.scan, url("sets/foam"), *OPTIONS, "--lod", "--tables", "csv,parquet")
    put = [key_of(path, BUCKET) for path in lab.proxy.asked("PUT")]
    sets = [key for key in put if "probe" not in key]
    assert len(sets) == len(set(sets)) and sets[-1] == "sets/foam/index.json", sets[-3:]
    assert sorted(sets) == sorted(lab.keys("sets/foam/")), "probes are gone, all else is there"
    lab.run("convert", lab.scan, lab.place("foam"), *OPTIONS, "--lod", "--tables", "csv,parquet")
    same(lab.get("sets/foam", lab.place("fetched")), lab.place("foam"))
    assert not any(lab.place("tmp").iterdir()), list(lab.place("tmp").iterdir())


def readers(lab):
    """What commands make of a tile set in a bucket is what they make of it here."""
    here, there = lab.place("foam"), url("sets/foam")
    for words in [
        ["verify", "SET", "--json"],
        ["info", "SET", "--json"],
        ["cells", "SET", "--json"],
        ["cells", "SET", "--summary", "--json"],
        ["cells", "SET", "--sort", "volume", "--top", "3", "--json"],
        ["verify", "SET", "--against", lab.scan, "--json"],
    ]:
        told = []
        for place in [here, there]:
            report = json.loads(lab.run(*[place if word == "SET" else word for word in words])[0])
            told.append(
                {key: value for key, value in report.items() if key not in ["seconds", "peak_rss_bytes", "name"]}
            )
        assert told[0] == told[1], f"{words}: {told}"
    for name, words in {
        "select": ["select", "SET", "OUT", "--where", "not touches_border"],
        "repack": ["repack", "SET", "OUT", "--for", "web"],
        "export.ply": ["export", "SET", "OUT"],
        "export.glb": ["export", "SET", "OUT"],
        "slice.png": ["preview", lab.scan, "OUT", "--tiles", "SET"],
    }.items():
        made = []
        for place, out in [(here, lab.place(f"here-{name}")), (there, lab.place(f"there-{name}"))]:
            lab.run(
                *[{"SET": place, "OUT": out}.get(word, word) if isinstance(word, str) else word for word in words],
                "--quiet",
            )
            made.append(out)
        same(*made) if made[0].is_dir() else check(filecmp.cmp(*made, shallow=False), f"{name} differs")
    lab.run("report", there, lab.place("report.html"), "--quiet")


def check(holds, message):
    assert holds, message


def viewing(lab):
    """The page of a tile set in a bucket has its tiles, and `serve` its files."""
    answers = {}
    for place in [lab.place("foam"), url("sets/foam")]:
        viewer = subprocess.Popen(
            [str(lab.program), "view", str(place), "--no-open"],
            env=lab.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            address = next(found for found in (re.search(r"http://\S+", line) for line in viewer.stdout) if found)[0]
            page, _, token = address.partition("#")
            token = re.search(r"[0-9a-f]{32}", token)[0]
            get = lambda path: urllib.request.urlopen(
                urllib.request.Request(page.rstrip("/") + path, headers={"Authorization": f"Bearer {token}"}),
                timeout=60,
            ).read()
            told = json.loads(get("/set.json"))
            told.pop("command", None)
            answers[place] = [told, get("/tile/0/0/0/0"), get("/row/cells/1")]
        finally:
            viewer.terminate()
            viewer.wait()
    first, second = answers.values()
    assert first == second, f"{first[0]} {second[0]}"


def damage(lab):
    """What is wrong with a tile set in a bucket is told as of one here."""
    broken = lab.place("broken")
    shutil.copytree(lab.place("foam"), broken)
    tiles = sorted(broken.glob("tiles/*/*.glb"))
    tiles[0].write_bytes(tiles[0].read_bytes()[:-7])
    tiles[1].unlink()
    (broken / "tiles" / "notes.txt").write_text("mine")
    lab.put(broken, "sets/broken")
    codes = []
    for place in [broken, url("sets/broken")]:
        issues = json.loads(lab.run("verify", place, "--json", status=1)[0])["issues"]
        codes.append(sorted((issue["code"], issue["path"]) for issue in issues))
    assert codes[0] == codes[1] and len(codes[0]) >= 3, codes
    lab.refused("info", url("sets/none"), says=["s3://lab/sets/none"])
    lab.refused("cells", url("sets/none"), says=["s3://lab/sets/none/index.json"])


def bad_days(lab):
    """Refusals, resets, answers that are short or cut off, and answers that are lost change nothing."""
    here = lab.place("scan.raw-here")
    for kind in ["503", "429", "reset", "short", "cut"]:
        lab.proxy.reset(Fault(kind, times=2))
        out = lab.place(f"bad-{kind}")
        lab.run("convert", url("scans/scan.raw"), out, *lab.opening["scan.raw"], *OPTIONS)
        same(out, here)
        lab.run("verify", url("sets/foam"), "--quiet")
    for kind in ["503", "reset", "lost answer"]:
        lab.proxy.reset(Fault(kind, times=1, matches=lambda request: request.command != "DELETE"))
        lab.run("convert", lab.scan, url(f"sets/bad-{kind[:4]}"), *OPTIONS)
        same(lab.get(f"sets/bad-{kind[:4]}", lab.place(f"fetched-{kind[:4]}")), lab.place("scan.mhd-here"))


def errors(lab):
    """What stays wrong is told with the key, what was asked for, found and expected; nothing is left behind."""
    words, samples = lab.opening["scan.raw"], lab.place("scans/scan.raw").read_bytes()
    size = lab.place("scans/big.raw").stat().st_size
    long = Fault(
        "short",
        matches=lambda request: "big.raw" in request.path
        and request.headers.get("Range", "").startswith("bytes=3145728-"),
    )
    lab.proxy.reset(long)
    said = lab.refused(
        "convert",
        url("scans/big.raw"),
        lab.place("no"),
        *lab.big,
        *OPTIONS,
        says=["s3://lab/scans/big.raw", "bytes 3145728 to 5242880", "8 times"],
    )
    assert "found 1048576 bytes, expected 2097152" in said, said
    assert size > 5242880 and not lab.place("no").exists()
    lab.proxy.reset(Fault("503", matches=lambda request: request.command == "GET"))
    lab.refused("info", url("scans/scan.raw"), *words, says=["s3://lab/scans/scan.raw", "503", "SlowDown"])
    lab.proxy.reset(Fault("403", matches=lambda request: request.command == "GET"))
    lab.refused("info", url("scans/scan.raw"), *words, says=["403", "SignatureDoesNotMatch"])
    lab.proxy.reset()
    lab.refused("info", url("scans/none.raw"), *words, says=["s3://lab/scans/none.raw"])
    lab.refused("info", "s3://nobody/none.raw", *words, says=["s3://nobody/none.raw"])
    lab.refused("info", url("scans/scan.raw"), *words, "--io", "mmap", says=["--io", "read"])
    lab.refused("info", url("scans"), says=["s3://lab/scans", "no Zarr"])
    for key, data, says in [
        ("empty.raw", b"", ["0 bytes"]),
        ("short.raw", samples[:-1], [f"{len(samples) - 1} bytes"]),
        (
            "away.nhdr",
            b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: /etc/passwd\n",
            ["on this machine"],
        ),
    ]:
        lab.client.put_object(Bucket=BUCKET, Key=f"scans/{key}", Body=data)
        lab.refused(
            "info",
            url(f"scans/{key}"),
            *(words if key.endswith("raw") else []),
            says=[f"s3://lab/scans/{key}", *says],
        )


def changed(lab):
    """An object that is exchanged while it is read is an error, and nothing is left behind."""
    samples = lab.place("scans/big.raw").read_bytes()
    lab.client.put_object(Bucket=BUCKET, Key="scans/new.raw", Body=samples)
    state = {"asked": 0}

    def exchange(request):
        if request.command == "GET" and "new.raw" in request.path:
            state["asked"] += 1
            if state["asked"] == 12:
                lab.client.put_object(Bucket=BUCKET, Key="scans/new.raw", Body=samples[::-1])

    for faults in [[], [Fault("no conditions")]]:
        state["asked"] = 0
        lab.client.put_object(Bucket=BUCKET, Key="scans/new.raw", Body=samples)
        lab.proxy.reset(*faults, before=exchange)
        lab.refused(
            "convert", url("scans/new.raw"), lab.place("no"), *lab.big, *OPTIONS, says=["s3://lab/scans/new.raw"]
        )
        assert not lab.place("no").exists()
        assert state["asked"] >= 12, state
    lab.proxy.reset()


def refusals(lab):
    """Nothing in a bucket is replaced, and what would not be safe is refused."""
    before = lab.keys("sets/")
    lab.refused("convert", lab.scan, url("sets/foam"), *OPTIONS, says=["s3://lab/sets/foam", "a tile set"])
    lab.refused(
        "convert", lab.scan, url("sets"), *OPTIONS, says=["s3://lab/sets", "objects below this key", "--resume"]
    )
    lab.proxy.reset(Fault("no conditions"))
    lab.refused("convert", lab.scan, url("new/unsafe"), *OPTIONS, says=["If-None-Match"])
    lab.proxy.reset()
    assert lab.keys("sets/") == before and not lab.keys("new/"), "nothing was put, and no probe is left"
    for words in [
        ["select", lab.place("foam"), url("new/a"), "--largest", "1"],
        ["repack", lab.place("foam"), url("new/a"), "--for", "web"],
        ["lod", url("sets/bad-503")],
        ["demo", url("new/a")],
        ["convert", lab.scan, lab.scan, "--out-dir", url("new/a"), "--threshold", "9"],
    ]:
        lab.refused(*words, says=["to a bucket is not supported"])
    for words in [
        ["plan", lab.scan, url("new/a"), "--parts", "2", "--macrocube", "16", "--threshold", "9"],
        ["work", url("new/a"), "--part", "0"],
        ["merge", url("new/a")],
    ]:
        lab.refused(*words, says=["to a bucket is not supported", "a directory that all machines share"])


def resumed(lab):
    """An upload that is broken off goes on with --resume, and puts what is missing alone."""
    lab.proxy.reset(Fault("403", matches=lambda request: request.command == "PUT" and "z0001" in request.path))
    lab.refused("convert", lab.scan, url("sets/late"), *OPTIONS[:4], says=["whole in", "--resume"])
    there = lab.keys("sets/late/")
    assert "sets/late/index.json" not in there, there
    lab.proxy.reset()
    if there:
        lab.refused("convert", lab.scan, url("sets/late"), *OPTIONS, says=["--resume"])
    lab.run("convert", lab.scan, url("sets/late"), *OPTIONS, "--resume")
    same(lab.get("sets/late", lab.place("late")), lab.place("scan.mhd-here"))
    # an object of other bytes is not taken for the tile
    lab.client.put_object(Bucket=BUCKET, Key="sets/mixed/tiles/z0000/y0000_x0000.glb", Body=b"of another")
    lab.refused("convert", lab.scan, url("sets/mixed"), *OPTIONS, "--resume", says=["another object is there"])
    assert "sets/mixed/index.json" not in lab.keys("sets/mixed/")
    shutil.rmtree(lab.place("tmp"))
    lab.place("tmp").mkdir()


def parts(lab):
    """Parts of a volume in a bucket give the tile set of one process."""
    out = lab.place("parts")
    lab.run("plan", url("scans/scan.mhd"), out, "--parts", "2", *OPTIONS[:4], "--quiet")
    for _ in range(4):
        for part in range(2):
            done = subprocess.run(
                [str(lab.program), "work", str(out), "--part", str(part), "--quiet"],
                env=lab.environment,
                capture_output=True,
                text=True,
            )
            check(done.returncode in [0, 75], done.stderr)
        done = subprocess.run(
            [str(lab.program), "merge", str(out), "--quiet"], env=lab.environment, capture_output=True, text=True
        )
        if done.returncode == 0:
            break
    same(out, lab.place("scan.mhd-here"))


def credentials(lab):
    """Keys come from files of the AWS tools, too, and stand in nothing that the program writes."""
    (lab.home / ".aws").mkdir()
    (lab.home / ".aws" / "credentials").write_text(
        f"[other]\naws_access_key_id = AKIAOTHER\naws_secret_access_key = {SECRET}\n"
    )
    (lab.home / ".aws" / "config").write_text(
        f"[profile other]\nregion = eu-west-1\nendpoint_url = {lab.proxy.url}\n[profile far]\nrole_arn = arn:x\n"
    )
    plain = {key: value for key, value in lab.environment.items() if not key.startswith("AWS_")}
    seen = []
    lab.proxy.reset(before=lambda request: seen.append(request.headers.get("Authorization", "")))
    words = ["info", url("scans/scan.mhd"), "--json"]
    lab.run(*words, environment={**plain, "AWS_PROFILE": "other"})
    assert seen and all("AKIAOTHER/" in each and "eu-west-1" in each for each in seen), seen[:2]
    lab.refused(*words, says=["role_arn", "export-credentials"], environment={**plain, "AWS_PROFILE": "far"})
    lab.refused(*words, says=["the profile nobody"], environment={**plain, "AWS_PROFILE": "nobody"})
    seen.clear()
    for key in ["scan.mhd", "scan.raw"]:
        lab.client.put_object_acl(Bucket=BUCKET, Key=f"scans/{key}", ACL="public-read")
    lab.run(*words, environment={**plain, "AWS_SKIP_SIGNATURE": "true", "AWS_ENDPOINT_URL": lab.proxy.url})
    assert seen and not any(seen), "requests without a signature"
    lab.proxy.reset()
    hidden = [KEY, SECRET, TOKEN, "AKIAOTHER"]
    written = [
        path.read_bytes()
        for path in lab.directory.rglob("*")
        if path.is_file() and lab.home not in path.parents and path.suffix != ".log"
    ]
    for each in hidden:
        assert not any(each in said for said in lab.said), "a key stands in what the program said"
        assert not any(each.encode() in data for data in written), "a key stands in a file"
    assert len(written) > 100 and len(lab.said) > 100


TESTS = [
    formats,
    few_requests,
    output,
    readers,
    viewing,
    damage,
    bad_days,
    errors,
    changed,
    refusals,
    resumed,
    parts,
    credentials,
]


def in_files(program, directory, store, counted):
    """The same volume and tile set in a store of files that ignores conditions."""
    import boto3

    proxy = Proxy(store.address)
    client = boto3.client(
        "s3",
        endpoint_url=f"http://{store.address}",
        aws_access_key_id="S3RVER",
        aws_secret_access_key="S3RVER",
        region_name="us-east-1",
    )
    place = directory / "files"
    place.mkdir()
    lab = Lab(program, place, proxy, client)
    lab.environment |= {"AWS_ACCESS_KEY_ID": "S3RVER", "AWS_SECRET_ACCESS_KEY": "S3RVER", "AWS_REGION": "us-east-1"}
    del lab.environment["AWS_SESSION_TOKEN"]
    scans, foam = directory / "scans", directory / "foam"

    def reading(lab):
        for name in ["scan.raw", "scan.mhd", "scan.nrrd"]:
            lab.put(scans / name, f"scans/{name}")
        words = ["--dims", ",".join(map(str, DIMS)), "--dtype", "u16"]
        for name, options in {"scan.raw": words, "scan.mhd": [], "scan.nrrd": []}.items():
            told = [
                json.loads(lab.run("info", path, *options, "--json")[0])
                for path in [scans / name, url(f"scans/{name}")]
            ]
            assert told[0]["histogram"] == told[1]["histogram"] and told[0]["spacing"] == told[1]["spacing"], name
            lab.run("convert", url(f"scans/{name}"), place / name, *options, *OPTIONS)
            same(place / name, directory / f"{name}-here")

    def tiles(lab):
        lab.put(foam, "sets/foam")
        lab.run("verify", url("sets/foam"), "--against", scans / "scan.mhd", "--quiet")
        assert lab.run("cells", url("sets/foam"), "--json")[0] == lab.run("cells", foam, "--json")[0]

    def ignoring(lab):
        lab.refused("convert", scans / "scan.mhd", url("new/set"), *OPTIONS, says=["If-None-Match"])
        assert not lab.keys("new/")

    for test in [reading, tiles, ignoring]:
        counted(f"s3rver: {test.__name__}", lambda: test(lab))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--npm", type=pathlib.Path)
    parser.add_argument("--without", type=pathlib.Path)
    args = parser.parse_args()
    program, directory = args.program.resolve(), args.directory.resolve()
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir(parents=True)
    results = []

    def counted(name, test):
        start = time.monotonic()
        try:
            test()
            results.append(True)
            print(f"ok {name} ({time.monotonic() - start:.1f} s)", flush=True)
        except Exception:
            results.append(False)
            print(f"FAILED {name}\n{traceback.format_exc()}", flush=True)

    if args.without:

        def message():
            words = [str(args.without.resolve()), "info", "s3://lab/scan.mhd"]
            done = subprocess.run(words, capture_output=True, text=True)
            assert done.returncode == 2 and "--features s3" in done.stderr, done.stderr

        counted("a program without the feature says so", message)
    store = stores.moto(directory)
    if store is None:
        print("SKIPPED objects in moto's store: moto is not installed")
    else:
        with store:
            in_moto(program, directory, store, counted)
    files = stores.s3rver(directory, args.npm)
    if files is None or store is None:
        print("SKIPPED objects in files: s3rver, or moto for its client, is not installed")
    else:
        with files:
            in_files(program, directory, files, counted)
    print(f"{sum(results)} passed, {len(results) - sum(results)} failed")
    return 0 if all(results) else 1


def in_moto(program, directory, store, counted):
    import boto3

    proxy = Proxy(store.address)
    client = boto3.client(
        "s3",
        endpoint_url=f"http://{store.address}",
        aws_access_key_id=KEY,
        aws_secret_access_key=SECRET,
        region_name="eu-central-1",
    )
    client.create_bucket(Bucket=BUCKET, CreateBucketConfiguration={"LocationConstraint": "eu-central-1"})
    lab = Lab(program, directory, proxy, client)
    scans = directory / "scans"
    scans.mkdir()
    raw = directory / "foam.raw"
    lab.run("phantom", "foam", raw, "--dims", ",".join(map(str, DIMS)), "--dtype", "u16", "--quiet")
    lab.opening = volumes.all_formats(scans, raw.read_bytes(), DIMS)
    lab.scan = scans / "scan.mhd"
    lab.run("phantom", "foam", scans / "big.raw", "--dims", "260,250,240", "--dtype", "u16", "--quiet")
    lab.big = ["--dims", "260,250,240", "--dtype", "u16"]
    lab.put(scans, "scans")
    for test in TESTS:
        counted(test.__name__, lambda: test(lab))


if __name__ == "__main__":
    # a store that hangs is a fault, too
    threading.excepthook = lambda args: None
    sys.exit(main())
