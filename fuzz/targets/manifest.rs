#![no_main]
use alvis_fuzz::Set;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SET: LazyLock<Set> = LazyLock::new(|| Set::new(Default::default(), false));

fuzz_target!(|data: &[u8]| {
    SET.put_manifest(data);
    SET.read();
});
