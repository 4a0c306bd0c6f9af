//! Fuzzes the target `journal_folder` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("journal_folder");
