#!/usr/bin/env bash
# Builds the fuzz targets and runs each for some seconds, from the corpus that is checked in.
#
#   fuzz/run.sh [SECONDS [TARGET...]]     10 seconds each and all of them, unless stated
#
# Needs a nightly toolchain, for coverage and AddressSanitizer; without one it says so and skips. New
# inputs go to fuzz/target/corpus, what fails to fuzz/target/artifacts. Ends with `N passed, N failed`.
# FUZZ_FEATURES=formats fuzzes DICOM, HDF5 and Zarr too.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-10}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(manifest shard tile strip volume expression)
host=x86_64-unknown-linux-gnu

if ! cargo +nightly --version >/dev/null 2>&1; then
  echo "SKIPPED fuzz targets: there is no nightly toolchain (rustup toolchain install nightly)"
  exit 0
fi

export RUSTFLAGS="--cfg fuzzing -Zsanitizer=address -Cpasses=sancov-module \
-Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
-Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares"
bins=()
for target in "${targets[@]}"; do bins+=(--bin "$target"); done
cargo +nightly build --release --locked --quiet --target "$host" \
  ${FUZZ_FEATURES:+--features "$FUZZ_FEATURES"} "${bins[@]}"

# a target ends without tidying up; what it writes is best in memory
[ -d /dev/shm ] && place=/dev/shm || place=${TMPDIR:-/tmp}
TMPDIR=$(mktemp -d "$place/alvis-fuzz.XXXXXX")
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

passed=0
failed=0
for target in "${targets[@]}"; do
  grown=target/corpus/$target
  mkdir -p "$grown" target/artifacts
  log=target/$target.log
  # no input is larger than 64 KiB, so nothing may ask for more than 64 MiB at once
  if ASAN_OPTIONS=detect_leaks=0:detect_odr_violation=0:allocator_may_return_null=1 \
    "target/$host/release/$target" -max_total_time="$seconds" -max_len=65536 -timeout=10 \
    -malloc_limit_mb=64 -rss_limit_mb=2048 -artifact_prefix=target/artifacts/"$target"- \
    -print_final_stats=1 -print_funcs=0 "$grown" "corpus/$target" >"$log" 2>&1; then
    passed=$((passed + 1))
  else
    failed=$((failed + 1))
    grep -aE 'panicked|ERROR|SUMMARY|Test unit' -A 2 "$log" | head -20
  fi
  echo "$target: $(grep -aoE 'number_of_executed_units: [0-9]+' "$log" || echo 'ended early')"
done
echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
