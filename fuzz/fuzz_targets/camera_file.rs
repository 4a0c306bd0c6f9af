//! Fuzzes the target `camera_file` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("camera_file");
