//! Factors: residuals with analytic Jacobians, one kind a file.
//!
//! Observation factors live in batches, structures of arrays that one monomorphic loop linearizes.
//! Residual = predicted − measured, whitened by the factor's own sigmas. Poses are updated on the
//! right, `T ⊞ δ = T · Exp(δ)`, δ = (translation, rotation). Losses are applied by the caller.

mod depth_reprojection;
mod pose_prior;
mod position_prior;
mod relative_pose;
mod reprojection;

pub use depth_reprojection::{DepthReprojection, DepthReprojectionBatch};
pub use pose_prior::PosePrior;
pub use position_prior::PositionPrior;
pub(crate) use relative_pose::{FACTORS_PER_CHUNK, FACTORS_PER_QUESTION, cost};
pub use relative_pose::{PairLinearization, RelativePose};
pub use reprojection::{Linearization, Reprojection, ReprojectionBatch};
