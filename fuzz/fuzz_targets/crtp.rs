//! libFuzzer's entrance to the target of the same name in `fuzz/src`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| haltere_fuzz::targets::crtp(data));
