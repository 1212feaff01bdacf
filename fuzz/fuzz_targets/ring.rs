#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| edgecap_fuzz::targets::ring(data));
