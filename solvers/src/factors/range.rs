//! Range factor: the distance between two variables, each a pose or a landmark.
//!
//! With a and b the positions in the world (of a pose its origin) and u = (b − a) / |b − a|:
//! r = |b − a| − z, ∂r/∂b = uᵀ and ∂r/∂a = −uᵀ. A pose with the right update X · Exp(δ) moves its origin by
//! R times the translation of δ. At distance zero every unit vector is a one-sided gradient: u is the x axis
//! there, so that nothing divides by zero and a solve leaves a start where variables coincide. Nothing here
//! applies a loss.

use nalgebra::{SVector, Vector3};

use crate::geometry::LieGroup;
use crate::loss::Loss;

/// One end of a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeEnd {
    /// The origin of the pose with this index.
    Pose(usize),
    /// The landmark with this index.
    Landmark(usize),
}

/// A measured distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The two variables.
    pub ends: [RangeEnd; 2],
    /// The measurement z, in meters.
    pub distance_m: f64,
    /// 1/σ², in 1/m²; finite and positive.
    pub precision: f64,
    /// ρ of this factor alone; `None` takes the loss of the graph.
    pub loss: Option<Loss>,
}

/// Where an end of a range is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangePlace<G> {
    /// At the origin of this `world_from_pose`.
    Pose(G),
    /// At this point of the world, in meters; z = 0 in the plane.
    Landmark(Vector3<f64>),
}

/// The residual of a range with its Jacobians, not yet whitened.
#[derive(Clone, Copy, Debug)]
pub struct RangeLinearization<const N: usize> {
    /// The residual, in meters.
    pub residual: f64,
    /// ∂r/∂ of each end: of a pose over its tangent; of a landmark over (x, y, z), then zeros.
    pub d_ends: [SVector<f64, N>; 2],
}

impl<G> RangePlace<G> {
    /// The position in the world.
    #[must_use]
    pub fn position<const N: usize>(&self) -> Vector3<f64>
    where
        G: LieGroup<N>,
    {
        match self {
            Self::Pose(world_from_pose) => world_from_pose.act(&Vector3::zeros()),
            Self::Landmark(position) => *position,
        }
    }

    /// The Jacobian of `direction` · position over what the variable moves along.
    fn jacobian<const N: usize>(&self, direction: &Vector3<f64>) -> SVector<f64, N>
    where
        G: LieGroup<N>,
    {
        match self {
            Self::Pose(world_from_pose) => {
                world_from_pose.act_jacobian(&Vector3::zeros()).tr_mul(direction)
            }
            Self::Landmark(_) => {
                SVector::from_fn(|axis, _| direction.get(axis).copied().unwrap_or(0.0))
            }
        }
    }
}

impl Range {
    /// Whether the measurement and its precision are finite and the precision is positive.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.distance_m.is_finite() && self.precision.is_finite() && self.precision > 0.0
    }

    /// The landmarks at its ends.
    pub fn landmarks(&self) -> impl Iterator<Item = usize> + use<> {
        self.ends.into_iter().filter_map(|end| match end {
            RangeEnd::Pose(_) => None,
            RangeEnd::Landmark(landmark) => Some(landmark),
        })
    }

    /// The residual between two positions, in meters, not whitened.
    #[must_use]
    pub fn residual(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        (b - a).norm() - self.distance_m
    }

    /// χ² = r² / σ² between two positions.
    #[must_use]
    pub fn chi2(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        self.precision * self.residual(a, b).powi(2)
    }

    /// The residual and its Jacobians, not whitened.
    #[must_use]
    pub fn linearize<G: LieGroup<N>, const N: usize>(
        &self,
        places: &[RangePlace<G>; 2],
    ) -> RangeLinearization<N> {
        let [a, b] = places.each_ref().map(RangePlace::position);
        let direction = (b - a).try_normalize(0.0).unwrap_or_else(Vector3::x);
        RangeLinearization {
            residual: self.residual(&a, &b),
            d_ends: [places[0].jacobian(&-direction), places[1].jacobian(&direction)],
        }
    }
}
