//! Every cost again: ½ Σ ρ(rᵀΩr) of a problem, evaluated plainly and independently.
//!
//! This is the referee of the solvers, so it shares none of their arithmetic: rotations become plain
//! matrices and quaternions here, logarithms and camera models are written out in `reference`,
//! sums are compensated. It uses the problem's data, `Information::matrix` and the loss
//! only, and must not call factors or the groups' own operations. One slow loop, no threads.
//!
//! | file | role |
//! |---|---|
//! | `cost` | costs by kind of factor |
//! | `residuals`, `lengths` | residuals by what is measured, against their sigmas; the length of each |
//! | `reference` | residuals and projections by their definitions |
//! | `sum` | compensated sums |

mod cost;
mod lengths;
mod reference;
mod residuals;
mod sum;

pub use cost::{CostReport, FactorCost, bundle_cost, pose_graph_cost};
pub use lengths::{ObservationLengths, edge_lengths};
pub use reference::ReferencePose;
pub use residuals::{Quantity, ResidualReport, ResidualStatistics, SIGMA_FACTOR, SigmaJudgment};
