//! Tools for tests and demonstrations: numeric Jacobians, group laws, seeded sampling.
//!
//! These functions assert, so they panic on purpose when a law fails; no solver code may call
//! them. Every random number comes from an explicit seed.

mod data;
pub mod jacobian;
pub mod laws;
pub mod random;
pub mod scene;

pub use data::{data, skip};
pub use jacobian::{JacobianMismatch, assert_jacobian, central_difference, check_jacobian};
pub use laws::{assert_group_laws, assert_tangent_laws};
pub use scene::{Scene, SceneObservation, SceneOptions};
