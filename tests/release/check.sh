#!/usr/bin/env bash
# Installs each of the files that release.sh makes where nothing is, converts the demo with it, and compares every byte
# with what a build from source makes.
#
#   tests/release/check.sh FILES PROGRAM DIR    FILES as release.sh leaves them, PROGRAM built from source
#
# Ends with `N passed, N failed`. Needs Python with venv, and pip to get NumPy.
set -uo pipefail
files=$(cd "$1" && pwd)
program=$(realpath "$2")
dir=$3
passed=0
failed=0
rm -rf "$dir"
mkdir -p "$dir/empty"
dir=$(cd "$dir" && pwd)
cd "$dir" || exit 1

# ok NAME COMMAND...
ok() {
  local name=$1
  shift
  if "$@" >"$dir/log" 2>&1; then
    passed=$((passed + 1))
  else
    failed=$((failed + 1))
    echo "FAILED $name: $*"
    tail -n 12 "$dir/log"
  fi
}

# nothing of this machine but the kernel and the C library
bare() { env -i PATH=/nonexistent HOME="$dir/empty" "$@"; }

# same NAME PROGRAM...: the demo, its tiles with every number in their index, and tables in another form
same() {
  local name=$1
  shift
  ok "$name: demo" bare "$@" demo "$name" --size 96 --quiet
  ok "$name: web" bare "$@" convert "$name/foam.mhd" "$name/web" --threshold otsu --for web --tables csv,parquet \
    --median 1 --quiet
  ok "$name: verify" bare "$@" verify "$name/web" --against "$name/foam.mhd"
  if [ "$name" != source ]; then ok "$name: bytes" diff -r source "$name"; fi
}

ok "checksums" sh -c "cd '$files' && sha256sum --check --quiet SHA256SUMS"
same source "$program"

mkdir archive
ok "archive" tar -xzf "$files"/alvis-*.tar.gz -C archive --strip-components=1
same from-archive archive/alvis
ok "manual pages" grep -q 'SH SYNOPSIS' archive/man/alvis.1 archive/man/alvis-convert.1
ok "completions" bash -n archive/completions/alvis.bash
ok "licences" grep -q '^meshopt .*: MIT' archive/LICENSES.txt

package=$(ls "$files"/alvis_*.deb 2>/dev/null)
if [ -z "$package" ] || [ "$(id -u)" -ne 0 ]; then
  echo "SKIPPED the Debian package: it needs dpkg-deb and the rights of root"
else
  mkdir -p root/var/lib/dpkg/info root/var/lib/dpkg/updates
  : >root/var/lib/dpkg/status
  # the C library is that of this machine
  ok "package" dpkg --root=root --force-depends --log=/dev/null -i "$package"
  same from-package root/usr/bin/alvis
  ok "its manual page" gzip -t root/usr/share/man/man1/alvis-verify.1.gz
  ok "its removal" dpkg --root=root --log=/dev/null -r alvis
  ok "is removed" test ! -e root/usr/bin/alvis
fi

ok "environment" python3 -m venv venv
ok "wheel" venv/bin/pip install --quiet --disable-pip-version-check "$files"/alvis-*.whl
same from-wheel venv/bin/alvis
cat >convert.py <<'E2'
import alvis
made = alvis.convert("from-wheel/foam.mhd", "module", threshold=alvis.TileSet("source/foam").threshold)
assert alvis.verify("module", against="from-wheel/foam.mhd").ok and made.cells_count == len(made.cells["id"])
E2
ok "module" bare venv/bin/python -W error convert.py
ok "bytes of the module" diff -r source/foam module
ok "types of the module" sh -c 'ls venv/lib/python*/site-packages/alvis/py.typed'

echo "release: $passed passed, $failed failed"
[ "$failed" -eq 0 ]
