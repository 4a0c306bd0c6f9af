//! Fuzzes the target `wire_item` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("wire_item");
