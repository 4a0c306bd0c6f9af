//! Fuzzes the target `wire_requests` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("wire_requests");
