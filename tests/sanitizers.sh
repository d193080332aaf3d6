#!/usr/bin/env bash
# Runs tests where undefined behaviour is an error. Needs a nightly toolchain.
#
#   tests/sanitizers.sh miri              the unsafe code of the kernels in Miri (component miri), compiled for
#                                         any processor and for one with wide vectors; some minutes
#   tests/sanitizers.sh address [TEST...] the tests of the crate and of tests/, or those of tests/ that are
#                                         named, under AddressSanitizer; half an hour
#
# Miri has no memory maps of files, signals or syncfs: src/volume/io/mmap.rs, src/sys/direct_io.rs, src/cli/sigbus.rs
# and src/convert/checkpoint/sync.rs run under AddressSanitizer alone.
set -euo pipefail
cd "$(dirname "$0")/.."
host=x86_64-unknown-linux-gnu

case ${1:-} in
  miri)
    for features in "" "+avx2,+bmi1,+bmi2,+lzcnt,+popcnt"; do
      RUSTFLAGS="-Ctarget-feature=$features" MIRIFLAGS=-Zmiri-disable-isolation PROPTEST_CASES=8 \
        CARGO_TARGET_DIR=target/miri-tests \
        cargo +nightly miri test --locked --no-default-features --lib -- \
        samples:: simd:: labels::bits:: unchecked:: sums:: strip:: steps_follow normals_are_unit
    done
    ;;
  address)
    shift
    tests=("$@")
    # under a limit of memory, which the sanitizer's own would pass: memory and export_memory
    [ $# -gt 0 ] || for file in tests/*.rs tests/*/main.rs; do
      name=${file#tests/}
      name=${name%.rs}
      name=${name%/main}
      [[ $name == *memory ]] || tests+=("$name")
    done
    RUSTFLAGS=-Zsanitizer=address ASAN_OPTIONS=detect_leaks=0:detect_odr_violation=0 \
      CARGO_TARGET_DIR=target/address-tests \
      cargo +nightly test --locked --no-fail-fast --target "$host" --lib "${tests[@]/#/--test=}"
    ;;
  *)
    sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac
