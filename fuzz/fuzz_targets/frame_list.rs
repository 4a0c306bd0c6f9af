//! Fuzzes the target `frame_list` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("frame_list");
