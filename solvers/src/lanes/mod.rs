//! What kernels share whose lanes are observations: camera models and losses.
//!
//! The formulas of `geometry` and `loss` once more, eight at a time. Nothing here knows how
//! observations are stored or what is summed over them.

pub(crate) mod loss;
pub(crate) mod models;
