#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| preshade_fuzz::module(data));
