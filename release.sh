#!/usr/bin/env bash
# Makes what people install: a program for Linux, a wheel, a Debian package, with manual pages, completions, licences
# and checksums.
#
#   ./release.sh [DIR]     writes to DIR, by default target/release-files; what it made there before is replaced
#
# Compiled and linked by zig, which comes by pip, for systems of glibc 2.28 or later: neither an old system nor a
# container is needed. Ends with an error if the program is larger, or needs more of a system, than is promised below.
#   PYTHON=python3      makes the environment in target/release-tools, with the versions of packaging/requirements.txt
set -euo pipefail
cd "$(dirname "$0")"
root=$PWD
out=$root/target/release-files
if [ $# -gt 0 ]; then
  mkdir -p "$1"
  out=$(cd "$1" && pwd)
fi
most_bytes=21500000
glibc=2.28
arch=$(uname -m)
target=$arch-unknown-linux-gnu
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
name=alvis-$version-linux-$arch
# the same bytes whenever it is made from the same state
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH CARGO_INCREMENTAL=0
# of its own, so that it goes on beside other builds
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$root/target/for-release}

tools=$root/target/release-tools
[ -x "$tools/bin/python" ] || "${PYTHON:-python3}" -m venv "$tools"
"$tools/bin/pip" install --quiet --disable-pip-version-check -r packaging/requirements.txt
export PATH=$tools/bin:$PATH

# wrapper TOOL ARGUMENTS: a tool of zig as a program, with these before its own.
wrapper() {
  printf '#!/bin/sh\nexec cargo-zigbuild zig %s -- %s "$@"\n' "$1" "$2" >"$tools/bin/zig-$1"
  chmod +x "$tools/bin/zig-$1"
}

# Compiled by zig, too: what is in C and C++ needs no library of the compiler's. All by the same wrappers, and the module,
# which needs most, before the program: so that each part is compiled once.
build() {
  local of=${target//-/_}
  wrapper cc "-g -target $arch-linux-gnu.$glibc"
  wrapper c++ "-g -target $arch-linux-gnu.$glibc"
  wrapper ar ""
  export "CC_$of=$tools/bin/zig-cc" "CXX_$of=$tools/bin/zig-c++" "AR_$of=$tools/bin/zig-ar" \
    "CARGO_TARGET_${of^^}_LINKER=$tools/bin/zig-cc"
  maturin build --profile published --locked --target "$target" --compatibility "manylinux_${glibc/./_}" \
    --manifest-path py/Cargo.toml --out "$out"
  cargo build --profile published --locked --target "$target" --package alvis --package alvis-python --bin alvis
  program=$CARGO_TARGET_DIR/$target/published/alvis
}

if [ -d "$out" ] && [ -n "$(ls -A "$out")" ] && ! [ -f "$out/SHA256SUMS" ]; then
  echo "$out: found files, expected a directory that is empty or has an earlier release" >&2
  exit 2
fi
rm -rf "$out"
mkdir -p "$out"
# goes into the wheel beside LICENSE
python packaging/licences.py >py/LICENSES.txt
build

# check PROGRAM: refuses what needs more of a system than is promised, or is larger.
check() {
  local bytes newest needed
  bytes=$(stat -c %s "$1")
  newest=$(objdump -T "$1" | grep -oE 'GLIBC_[0-9.]+' | sort -Vu | tail -n 1)
  needed=$(objdump -p "$1" | awk '/NEEDED/ { print $2 }' | tr '\n' ' ')
  echo "${1##*/}: $bytes bytes, $newest, needs $needed"
  if [ "$bytes" -gt "$most_bytes" ] ||
    [ "$(printf '%s\n' "${newest#GLIBC_}" $glibc | sort -V | tail -n 1)" != $glibc ] ||
    grep -E 'stdc\+\+|libgcc' <<<"$needed"; then
    echo "expected at most $most_bytes bytes, GLIBC_$glibc, and nothing but the C library" >&2
    return 1
  fi
}
check "$program"

stage=$out/$name
mkdir -p "$stage/man" "$stage/completions"
install -m 755 "$program" "$stage/alvis"
run=$stage/alvis
"$run" man >"$stage/man/alvis.1"
for command in $("$run" help | sed -n 's/^  \([a-z]*\) .*/\1/p' | grep -v help); do
  "$run" man "$command" >"$stage/man/alvis-$command.1"
done
"$run" completions bash >"$stage/completions/alvis.bash"
"$run" completions zsh >"$stage/completions/_alvis"
"$run" completions fish >"$stage/completions/alvis.fish"
mv py/LICENSES.txt "$stage"
cp README.md CHANGELOG.md LICENSE "$stage"

archive=(tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH")
"${archive[@]}" -C "$out" -c "$name" | gzip -9n >"$out/$name.tar.gz"

# deb: the same as a package of Debian and what follows it.
deb() {
  local tree=$out/deb share deb_arch=$arch
  case $arch in x86_64) deb_arch=amd64 ;; aarch64) deb_arch=arm64 ;; esac
  share=$tree/usr/share
  install -D -m 755 "$stage/alvis" "$tree/usr/bin/alvis"
  for page in "$stage"/man/*.1; do
    install -d "$share/man/man1"
    gzip -9nc "$page" >"$share/man/man1/${page##*/}.gz"
  done
  install -D -m 644 "$stage/completions/alvis.bash" "$share/bash-completion/completions/alvis"
  install -D -m 644 "$stage/completions/_alvis" "$share/zsh/vendor-completions/_alvis"
  install -D -m 644 "$stage/completions/alvis.fish" "$share/fish/vendor_completions.d/alvis.fish"
  install -d "$share/doc/alvis"
  cat "$stage/LICENSE" "$stage/LICENSES.txt" >"$share/doc/alvis/copyright"
  install -d "$tree/DEBIAN"
  sed -e "s/@VERSION@/$version/" -e "s/@ARCH@/$deb_arch/" -e "s/@GLIBC@/$glibc/" \
    -e "s/@SIZE@/$(du -sk --apparent-size "$tree/usr" | cut -f 1)/" packaging/control.in >"$tree/DEBIAN/control"
  chmod -R u=rwX,go=rX "$tree"
  find "$tree" -exec touch -hd "@$SOURCE_DATE_EPOCH" {} +
  dpkg-deb --root-owner-group --build "$tree" "$out/alvis_${version}_$deb_arch.deb" >/dev/null
  rm -rf "$tree"
}
if command -v dpkg-deb >/dev/null; then deb; else echo "no dpkg-deb here: no Debian package is made"; fi

cp "$stage/LICENSES.txt" "$out"
rm -rf "$stage"
(cd "$out" && sha256sum -- * >SHA256SUMS)
ls -l "$out"
