//! Fuzzes the target `pem` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("pem");
