//! Rotation and rigid-motion groups with their Jacobians, camera models, geodetic coordinates.
//!
//! Transforms are named `target_from_source` and updated on the right, `T ⊞ δ = T · Exp(δ)`.
//! Tangent order is translation first, then rotation (then log scale). This floor knows nothing
//! of factors or problems.
//!
//! | file | role |
//! |---|---|
//! | `lie_group`, `rigid_motion`, `operators` | what the groups have in common |
//! | `so2`, `se2`, `so3`, `se3`, `sim3` | the groups |
//! | `coefficients`, `scale_integral` | functions with series near zero |
//! | `camera` | models behind `CameraModel`; `free` has the parameters that a solve may move |
//! | `geodetic` | WGS 84 and local frames |

pub mod camera;
mod coefficients;
mod geodetic;
mod lie_group;
mod operators;
mod rigid_motion;
mod scale_integral;
mod se2;
mod se3;
mod sim3;
mod so2;
mod so3;

pub use camera::{
    Camera, CameraModel, FreeParameters, KannalaBrandt, ParameterKind, ParameterVec,
    PinholeRadialTangential, Projection, Snavely,
};
pub use coefficients::hat;
pub use geodetic::{Geodetic, LocalFrame};
pub use lie_group::LieGroup;
pub use rigid_motion::RigidMotion;
pub use se2::Se2;
pub use se3::Se3;
pub use sim3::Sim3;
pub use so2::So2;
pub use so3::So3;
