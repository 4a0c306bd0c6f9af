//! What kernels share whose lanes are observations: camera models.
//!
//! The formulas of `geometry` once more, eight at a time. Nothing here knows how observations are
//! stored or what is summed over them.

pub(crate) mod models;
