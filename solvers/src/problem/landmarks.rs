//! Landmarks of a pose graph: points with ids, and what was measured of them.
//!
//! A structure of arrays like the poses beside it. It holds, places and checks; the residuals are those of
//! [`LandmarkMeasurement`].

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::SolveError;
use crate::factors::{LandmarkMeasurement, Sighting};
use crate::geometry::LieGroup;
use crate::loss::Loss;

/// Points and their measurements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Landmarks {
    /// The caller's id of each; poses and landmarks share one space of ids.
    pub ids: Vec<i64>,
    /// Positions in the world, m, the start of a solve and its result; z = 0 in the plane.
    pub positions: Vec<Vector3<f64>>,
    /// Landmarks that stay where they are; one flag a landmark.
    pub constant: Vec<bool>,
    /// What was measured of them.
    pub measurements: Vec<LandmarkMeasurement>,
}

/// Dimension of space in a group whose tangent has `tangent` dimensions: 2 of SE(2), else 3.
pub(crate) const fn dimension_of_space(tangent: usize) -> usize {
    if tangent == 3 { 2 } else { 3 }
}

impl Landmarks {
    /// Appends a landmark that may move and returns its index.
    pub fn push(&mut self, id: i64, point_in_world: Vector3<f64>) -> usize {
        self.ids.push(id);
        self.positions.push(point_in_world);
        self.constant.push(false);
        self.positions.len() - 1
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Whether one of them has a place in the world of its own: it is constant, or measured from the
    /// world.
    #[must_use]
    pub fn are_anchored(&self) -> bool {
        self.constant.contains(&true) || self.measurements.iter().any(|m| m.pose.is_none())
    }

    /// The pose and the position of a landmark, as a measurement of valid landmarks has them.
    fn ends<G: LieGroup<N>, const N: usize>(
        &self,
        measurement: &LandmarkMeasurement,
        poses: &[G],
    ) -> (G, Vector3<f64>) {
        let pose = measurement.pose.map_or_else(G::identity, |pose| poses[pose]);
        (pose, self.positions[measurement.landmark])
    }

    /// χ² of a measurement at these poses.
    #[must_use]
    pub fn chi2<G: LieGroup<N>, const N: usize>(
        &self,
        measurement: &LandmarkMeasurement,
        poses: &[G],
    ) -> f64 {
        let (pose, point) = self.ends(measurement, poses);
        measurement.chi2(&pose, &point)
    }

    /// ½ Σ ρ(rᵀΩr) of all measurements at these poses, `loss` that of those without their own.
    #[must_use]
    pub fn cost<G: LieGroup<N>, const N: usize>(&self, poses: &[G], loss: Loss) -> f64 {
        let rho = |measurement: &LandmarkMeasurement| {
            let loss = measurement.loss.unwrap_or(loss);
            loss.evaluate(self.chi2(measurement, poses)).rho
        };
        0.5 * self.measurements.iter().map(rho).sum::<f64>()
    }

    /// Moves each landmark that may move and whose position was measured to where its positions fit
    /// best with the poses held: p = (Σ R Ω Rᵀ)⁻¹ Σ R Ω Rᵀ (X z). Others stay, since a bearing alone
    /// does not tell where they are.
    pub fn place<G: LieGroup<N>, const N: usize>(&mut self, poses: &[G]) {
        let space = dimension_of_space(N);
        // The third axis of the plane takes no part.
        let outside = Vector3::from_fn(|axis, _| if axis < space { 0.0 } else { 1.0 });
        let mut sums = vec![(Matrix3::from_diagonal(&outside), Vector3::zeros()); self.len()];
        for measurement in &self.measurements {
            let Sighting::Position(_) = measurement.sighting else { continue };
            let (pose, point) = self.ends(measurement, poses);
            let at = measurement.linearize(&pose, &point);
            let weighted = at.d_landmark.tr_mul(measurement.information.matrix());
            let (matrix, vector) = &mut sums[measurement.landmark];
            *matrix += weighted * at.d_landmark;
            *vector += weighted * (at.d_landmark * point - at.residual);
        }
        for (landmark, (matrix, vector)) in sums.into_iter().enumerate() {
            let solved = matrix.cholesky().map(|factor| factor.solve(&vector));
            if let Some(point) = solved.filter(|_| !self.constant[landmark]) {
                self.positions[landmark] = point;
            }
        }
    }

    /// The landmarks with a place in the world of their own, some of them twice.
    pub(crate) fn anchored(&self) -> impl Iterator<Item = usize> + '_ {
        let constant = (0..self.len()).filter(|&landmark| self.constant[landmark]);
        let surveyed = self.measurements.iter().filter(|m| m.pose.is_none()).map(|m| m.landmark);
        constant.chain(surveyed)
    }

    /// Whether every landmark that may move has a measured position with information in each of the
    /// `dimension` directions.
    pub(crate) fn are_determined_by_position(&self, dimension: usize) -> bool {
        let mut is_determined = self.constant.clone();
        for measurement in &self.measurements {
            let omega = measurement.information.matrix();
            let is_definite = match dimension {
                2 => omega.fixed_view::<2, 2>(0, 0).cholesky().is_some(),
                _ => omega.cholesky().is_some(),
            };
            let always_counts = !matches!(measurement.loss, Some(Loss::Tukey(_)));
            if matches!(measurement.sighting, Sighting::Position(_)) && is_definite && always_counts
            {
                is_determined[measurement.landmark] = true;
            }
        }
        is_determined.iter().all(|&is_determined| is_determined)
    }

    /// Checks lengths, indices, ids, numbers and losses; `pose_ids` has the ids of the `poses` poses. A
    /// landmark that nothing measures is open and stays where it is.
    pub(super) fn validate(
        &self,
        poses: usize,
        pose_ids: &BTreeMap<i64, usize>,
    ) -> Result<(), SolveError> {
        let count = self.len();
        for (what, actual) in
            [("landmark ids", self.ids.len()), ("constant landmarks", self.constant.len())]
        {
            if actual != count {
                return Err(SolveError::LengthMismatch { what, actual, expected: count });
            }
        }
        let mut index_of = BTreeMap::new();
        for (index, (&id, position)) in self.ids.iter().zip(&self.positions).enumerate() {
            if pose_ids.contains_key(&id) || index_of.insert(id, index).is_some() {
                return Err(SolveError::DuplicateId { what: "landmark", id });
            }
            if !position.iter().all(|value| value.is_finite()) {
                return Err(SolveError::NotFinite { what: "landmark", index: id });
            }
        }
        let factor = "landmark measurement";
        for (index, measurement) in self.measurements.iter().enumerate() {
            let ends = [
                ("pose", measurement.pose.unwrap_or(0), poses.max(1)),
                ("landmark", measurement.landmark, count),
            ];
            for (variable, value, count) in ends {
                if value >= count {
                    let error =
                        SolveError::IndexOutOfRange { factor, index, variable, value, count };
                    return Err(error);
                }
            }
            if !measurement.is_finite() {
                return Err(SolveError::NotFinite { what: factor, index: index as i64 });
            }
            if !measurement.loss.unwrap_or_default().is_valid() {
                return Err(SolveError::BadLoss { factor, index });
            }
        }
        Ok(())
    }
}
