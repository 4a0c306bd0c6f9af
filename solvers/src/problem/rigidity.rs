//! Whether the factors of a pose graph determine every pose for certain.
//!
//! A union of poses that edges with information in every direction tie together moves as one body. A
//! pose prior ties a body to the world, and so do the positions of three of its points that are not on
//! one line. A landmark is determined by a measured position. What this file does not find may still be determined: it only counts, and solves nothing.

use nalgebra::{Matrix3, Vector3};

use super::{DisjointSets, PoseGraph, dimension_of_space};
use crate::geometry::LieGroup;
use crate::loss::Loss;

/// Points are on one line where the second largest moment is at most this share of the largest.
const COLLINEAR: f64 = 1e-8;

impl<G: LieGroup<N>, const N: usize> PoseGraph<G, N> {
    /// Whether edges with information in every direction tie all poses together (constant ones
    /// hang together by themselves), and, where there are priors, whether these or a constant pose
    /// hold the whole in the world. Then each pose is determined, but for the gauge of a graph
    /// without priors; where not, other factors may determine it or may leave a direction open.
    ///
    /// A loss of one factor alone counts where its weight never is zero, the graph's loss always.
    #[must_use]
    pub fn is_rigid(&self) -> bool {
        let has_constant = self.constant.contains(&true);
        let landmarks = &self.landmarks;
        // Landmarks in place of poses may hold the whole in the world: that is not looked into.
        if !landmarks.are_determined_by_position(dimension_of_space(N))
            || landmarks.are_anchored() && !has_constant
        {
            return false;
        }
        let world = self.poses.len();
        let mut sets = DisjointSets::new(world + 1);
        let constant = (0..world).filter(|&pose| self.constant[pose]);
        let mut pieces = world - constant.clone().count().saturating_sub(1);
        sets.join_all(constant.clone());
        for edge in &self.edges {
            if pieces <= 1 {
                break;
            }
            // Only an edge that would join two pieces is looked at: a spanning tree of them.
            if sets.root(edge.i) != sets.root(edge.j)
                && edge.information.is_definite()
                && edge.loss.is_none_or(always_counts)
            {
                sets.join(edge.i, edge.j);
                pieces -= 1;
            }
        }
        if !self.has_priors() {
            return pieces <= 1;
        }
        sets.join_all(constant.chain([world]));
        for prior in &self.pose_priors {
            if always_counts(prior.loss) && prior.information.is_definite() {
                sets.join(prior.pose, world);
            }
        }
        let held = sets.root(world);
        for root in sets.roots() {
            if root != held && are_spread(&self.surveyed(root, &mut sets)) {
                sets.join(root, world);
            }
        }
        sets.roots().len() == 1
    }

    /// Where the poses have the points of the body `root` whose positions are measured.
    fn surveyed(&self, root: usize, sets: &mut DisjointSets) -> Vec<Vector3<f64>> {
        let counts = |loss, is_definite| always_counts(loss) && is_definite;
        let priors = self.position_priors.iter();
        let of_body = priors.filter(|prior| {
            counts(prior.loss, prior.information.is_definite()) && sets.root(prior.pose) == root
        });
        of_body.map(|prior| self.poses[prior.pose].act(&prior.point_in_camera)).collect()
    }
}

/// Whether the weight of a loss is positive for every residual.
fn always_counts(loss: Loss) -> bool {
    !matches!(loss, Loss::Tukey(_))
}

/// Whether there are three points that are not on one line.
pub(crate) fn are_spread(points: &[Vector3<f64>]) -> bool {
    if points.len() < 3 {
        return false;
    }
    let center = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let moments = points.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, point| {
        let arm = point - center;
        sum + arm * arm.transpose()
    });
    if !moments.iter().all(|value| value.is_finite()) {
        return false;
    }
    let mut eigenvalues: [f64; 3] = moments.symmetric_eigenvalues().into();
    eigenvalues.sort_unstable_by(f64::total_cmp);
    eigenvalues[1] > COLLINEAR * eigenvalues[2]
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::are_spread;

    #[test]
    fn points_on_a_line_are_not_spread() {
        let line: Vec<_> = (0..9).map(|k| Vector3::new(1.0, 2.0, 3.0) * f64::from(k)).collect();
        assert!(!are_spread(&line) && !are_spread(&line[..2]));
        assert!(are_spread(&[line[0], line[1], Vector3::x()]));
    }
}
