//! How uncertain what a client sends is, as its map's own residuals say: its odometry
//! ([`super::odometry`]) and its views ([`super::view_noise`]).

use super::{OdometryNoise, ViewNoise};

/// How uncertain what a client sends is, as the last windows found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Of its odometry.
    pub odometry: OdometryNoise,
    /// Of its views.
    pub views: ViewNoise,
}

impl Noise {
    /// Whether a map may have it.
    pub(super) fn is_possible(&self) -> bool {
        self.odometry.is_possible() && self.views.is_possible()
    }
}
