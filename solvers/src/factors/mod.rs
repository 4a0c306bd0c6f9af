//! Factors: residuals with analytic Jacobians.
//!
//! Observation factors lie in batches, structures of arrays that one monomorphic loop linearizes.
//! Residual = predicted − measured, whitened by the factor's own sigmas. Poses are updated on the
//! right, `T ⊞ δ = T · Exp(δ)`, δ = (translation, rotation). Losses are applied by the caller.
//!
//! | file | role |
//! |---|---|
//! | `reprojection` | a landmark at a pixel, without or with depth |
//! | `relative_pose` | between two poses of any group |
//! | `prior` | on a pose, or on a position |
//! | `landmark` | a landmark measured from a pose: position, bearing |
//! | `range` | the distance between two poses or landmarks |

mod landmark;
mod prior;
mod range;
mod relative_pose;
mod reprojection;

pub use landmark::{LandmarkLinearization, LandmarkMeasurement, Sighting};
pub use prior::{PosePrior, PositionPrior};
pub use range::{Range, RangeEnd, RangeLinearization, RangePlace};
pub(crate) use relative_pose::{FACTORS_PER_CHUNK, FACTORS_PER_QUESTION, cost};
pub use relative_pose::{PairLinearization, RelativePose};
pub use reprojection::{DepthReprojectionBatch, Linearization, Reprojection, ReprojectionBatch};
