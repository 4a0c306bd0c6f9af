//! Fuzzes the target `bal` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("bal");
