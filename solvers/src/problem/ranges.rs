//! The ranges of a pose graph: where their ends are, what they cost, whether they are valid.
//!
//! The residual is that of [`Range`]; how a range is minimized is in higher layers.

use nalgebra::Vector3;

use super::{PoseGraph, SolveError};
use crate::factors::{Range, RangeEnd, RangePlace};
use crate::geometry::LieGroup;

impl<G: LieGroup<N>, const N: usize> PoseGraph<G, N> {
    /// Where the variable is that a range of a valid graph ends at.
    pub(crate) fn place(&self, end: RangeEnd) -> RangePlace<G> {
        match end {
            RangeEnd::Pose(pose) => RangePlace::Pose(self.poses[pose]),
            RangeEnd::Landmark(landmark) => {
                RangePlace::Landmark(self.landmarks.positions[landmark])
            }
        }
    }

    /// χ² of a range of a valid graph.
    pub(crate) fn range_chi2(&self, range: &Range) -> f64 {
        let [a, b]: [Vector3<f64>; 2] = range.ends.map(|end| self.place(end).position());
        range.chi2(&a, &b)
    }

    /// ½ Σ ρ over the measurements of landmarks and the ranges of a valid graph.
    pub(crate) fn cost_of_measured(&self) -> f64 {
        let rho =
            |range: &Range| range.loss.unwrap_or(self.loss).evaluate(self.range_chi2(range)).rho;
        let ranges: f64 = self.ranges.iter().map(rho).sum();
        self.landmarks.cost(&self.poses, self.loss) + 0.5 * ranges
    }

    /// Checks indices, numbers and losses of the ranges.
    pub(super) fn check_ranges(&self) -> Result<(), SolveError> {
        let factor = "range";
        for (index, range) in self.ranges.iter().enumerate() {
            for end in range.ends {
                let (variable, value, count) = match end {
                    RangeEnd::Pose(pose) => ("pose", pose, self.poses.len()),
                    RangeEnd::Landmark(landmark) => ("landmark", landmark, self.landmarks.len()),
                };
                if value >= count {
                    let error =
                        SolveError::IndexOutOfRange { factor, index, variable, value, count };
                    return Err(error);
                }
            }
            if range.ends[0] == range.ends[1] {
                return Err(SolveError::SelfRange { index });
            }
            if !range.distance_m.is_finite() {
                return Err(SolveError::NotFinite { what: factor, index: index as i64 });
            }
            if !range.is_valid() {
                return Err(SolveError::NotPositiveDefinite { factor, index });
            }
            if !range.loss.unwrap_or_default().is_valid() {
                return Err(SolveError::BadLoss { factor, index });
            }
        }
        Ok(())
    }
}
