//! How well a solved problem knows its poses, and the relative poses that its factors measured.
//!
//! With the Gauss-Newton matrix H of all factors at the estimates, each weighted by its loss there, the
//! covariance of the free variables is H⁻¹; landmarks are eliminated first, S = H_pp − H_pl H_ll⁻¹ H_lp. For
//! a relative-pose factor with residual r and Jacobians J_i, J_j the covariance of r is
//! J S⁻¹ Jᵀ, J = (J_i J_j). Constant poses are known. S is dense: this is for windows.

use nalgebra::{DMatrix, Matrix3, Matrix6, Matrix6x3, Vector6};

use super::state_factors::{self, Linearized, Sink, Variable};
use crate::factors::{PairLinearization, RelativePose};
use crate::geometry::Se3;
use crate::problem::BundleProblem;

/// The residual of a relative-pose factor and how well the problem knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairEstimate {
    /// r at the estimates, not whitened, translation first.
    pub residual: Vector6<f64>,
    /// Its covariance.
    pub covariance: Matrix6<f64>,
}

const BLOCK: usize = 6;

/// The covariance of all free poses.
struct Marginals {
    /// The place of each free pose in the matrix.
    place: Vec<Option<usize>>,
    covariance: DMatrix<f64>,
}

impl Marginals {
    /// `None` where the factors leave a pose open.
    fn of(problem: &BundleProblem) -> Option<Self> {
        let place = places(problem);
        let count = place.iter().flatten().count();
        let mut reduced = DMatrix::<f64>::zeros(BLOCK * count, BLOCK * count);
        add_observations(problem, &place, &mut reduced);
        let mut sink = DenseSink { place: &place, reduced: &mut reduced };
        for factor in state_factors::all(problem) {
            factor.linearize(problem, &mut sink);
        }
        let covariance = reduced.cholesky()?.inverse();
        Some(Self { place, covariance })
    }

    fn block(&self, a: usize, b: usize) -> Matrix6<f64> {
        self.covariance.fixed_view::<BLOCK, BLOCK>(BLOCK * a, BLOCK * b).into_owned()
    }
}

/// The covariance of these poses of `problem`, about δ of T · Exp(δ), translation first, 0 of a constant one; `None`
/// where the factors leave a pose open.
#[must_use]
pub fn pose_covariances(problem: &BundleProblem, wanted: &[usize]) -> Option<Vec<Matrix6<f64>>> {
    let marginals = Marginals::of(problem)?;
    let covariance = |&pose: &usize| match marginals.place.get(pose)? {
        Some(at) => Some(marginals.block(*at, *at)),
        None => Some(Matrix6::zeros()),
    };
    wanted.iter().map(covariance).collect()
}

/// Of the relative-pose factors of `problem` with these indices; `None` where the factors leave a pose open.
#[must_use]
pub fn pair_covariances(problem: &BundleProblem, wanted: &[usize]) -> Option<Vec<PairEstimate>> {
    let marginals = Marginals::of(problem)?;
    let place = &marginals.place;
    let estimate = |&index: &usize| {
        let factor = problem.relative_poses.get(index)?;
        let PairLinearization { residual, d_i, d_j } = linearized(problem, factor);
        let mut known = Matrix6::zeros();
        let ends = [(place[factor.i], d_i), (place[factor.j], d_j)];
        for (a, of_a) in ends {
            for (b, of_b) in ends {
                if let (Some(a), Some(b)) = (a, b) {
                    known += of_a * marginals.block(a, b) * of_b.transpose();
                }
            }
        }
        Some(PairEstimate { residual, covariance: known })
    };
    wanted.iter().map(estimate).collect()
}

fn linearized(problem: &BundleProblem, factor: &RelativePose<Se3, 6>) -> PairLinearization<6> {
    factor.linearize(&problem.poses[factor.i], &problem.poses[factor.j])
}

/// The place of each free pose in the matrix.
fn places(problem: &BundleProblem) -> Vec<Option<usize>> {
    let mut next = 0;
    let place = |&constant: &bool| {
        next += usize::from(!constant);
        (!constant).then(|| next - 1)
    };
    problem.constant_poses.iter().map(place).collect()
}

/// Adds `values` to block (`row`, `column`).
fn add(reduced: &mut DMatrix<f64>, row: usize, column: usize, values: &Matrix6<f64>) {
    let mut block = reduced.fixed_view_mut::<BLOCK, BLOCK>(BLOCK * row, BLOCK * column);
    block += values;
}

fn add_observations(problem: &BundleProblem, place: &[Option<usize>], reduced: &mut DMatrix<f64>) {
    let mut views: Vec<Vec<(Option<usize>, Matrix6x3<f64>)>> =
        vec![Vec::new(); problem.landmarks.len()];
    let mut of_landmark = vec![Matrix3::<f64>::zeros(); problem.landmarks.len()];
    for seen in problem.observations() {
        let (pose, landmark) = (seen.pose as usize, seen.landmark as usize);
        let camera = &problem.cameras[seen.camera as usize];
        let point = &problem.landmarks[landmark];
        let Some(lin) = seen.seen.linearize(&problem.poses[pose], camera, point) else { continue };
        let weight = problem.observation_loss.evaluate(lin.residual.norm_squared()).weight;
        if let Some(at) = place[pose] {
            add(reduced, at, at, &(weight * lin.d_pose.transpose() * lin.d_pose));
        }
        if !problem.constant_landmarks[landmark] {
            of_landmark[landmark] += weight * lin.d_landmark.transpose() * lin.d_landmark;
            if place[pose].is_some() {
                let cross = weight * lin.d_pose.transpose() * lin.d_landmark;
                views[landmark].push((place[pose], cross));
            }
        }
    }
    for (views, information) in views.iter().zip(&of_landmark) {
        let inverse = pseudo_inverse(information);
        for &(a, of_a) in views {
            let gain = of_a * inverse;
            for &(b, of_b) in views {
                if let (Some(a), Some(b)) = (a, b) {
                    add(reduced, a, b, &-(gain * of_b.transpose()));
                }
            }
        }
    }
}

/// Below this share of the largest eigenvalue an information is none.
const NO_INFORMATION: f64 = 1e-10;

/// The inverse of a landmark's information, where a single ray leaves its depth open, that across the ray: what
/// the view says along it is then taken from the pose.
fn pseudo_inverse(information: &Matrix3<f64>) -> Matrix3<f64> {
    let scale = information.trace() / 3.0;
    if information.determinant() > NO_INFORMATION * scale.powi(3)
        && let Some(inverse) = information.try_inverse()
    {
        return inverse;
    }
    let eigen = information.symmetric_eigen();
    let least = NO_INFORMATION * eigen.eigenvalues.max();
    let inverses = eigen.eigenvalues.map(|value| if value > least { 1.0 / value } else { 0.0 });
    eigen.eigenvectors * Matrix3::from_diagonal(&inverses) * eigen.eigenvectors.transpose()
}

/// Sums the state factors into the matrix.
struct DenseSink<'a> {
    place: &'a [Option<usize>],
    reduced: &'a mut DMatrix<f64>,
}

impl Sink for DenseSink<'_> {
    fn add<const R: usize, const C: usize, const K: usize>(
        &mut self,
        factor: &Linearized<'_, R, C, K>,
    ) {
        let Linearized { residual, jacobian, information, .. } = factor;
        let weight = factor.loss.evaluate(information.squared_norm(residual)).weight;
        // Both are ρ' JᵀΩ. The order decides the last bits, and stored results have these.
        let left = match K {
            1 => weight * jacobian.transpose() * information.matrix(),
            _ => jacobian.transpose() * (information.matrix() * weight),
        };
        let hessian = left * jacobian;
        let ends = factor.columns().map(|(Variable::Pose(pose), columns)| {
            self.place[pose].map(|place| (place, columns.start))
        });
        for &(a, row) in ends.iter().flatten() {
            for &(b, column) in ends.iter().flatten() {
                add(self.reduced, a, b, &hessian.fixed_view::<BLOCK, BLOCK>(row, column).into());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3x6, Matrix6};

    use super::*;
    use crate::factors::{PosePrior, Reprojection};
    use crate::geometry::LieGroup;
    use crate::information::Information;
    use crate::loss::Loss;
    use crate::testing::scene::{Scene, SceneOptions};

    /// Few keyframes of a walk, tied by their odometry, two of them constant.
    fn problem() -> BundleProblem {
        let options =
            SceneOptions { keyframes: 6, laps: 0.1, landmarks: 300, ..Default::default() };
        let mut problem = Scene::generate(&options).to_problem();
        problem.constant_poses[3] = true;
        problem.observation_loss = Loss::Cauchy(2.0);
        for j in 1..problem.poses.len() {
            problem.relative_poses.push(RelativePose {
                i: j - 1,
                j,
                i_from_j: problem.poses[j - 1].inverse().compose(&problem.poses[j]),
                information: Information::new(&(Matrix6::identity() * 1e4)).unwrap(),
                loss: None,
            });
        }
        problem
    }

    /// The inverse of the whole Gauss-Newton matrix, poses before landmarks, all of them 6 or 3 wide; what is
    /// constant or unseen has a unit there, and what is constant no coupling.
    fn dense_inverse(problem: &BundleProblem) -> DMatrix<f64> {
        let poses = BLOCK * problem.poses.len();
        let size = poses + 3 * problem.landmarks.len();
        let mut dense = DMatrix::<f64>::zeros(size, size);
        let mut add = |rows: &DMatrix<f64>, weight: f64| dense += rows.transpose() * rows * weight;
        for seen in problem.observations() {
            let (pose, landmark) = (seen.pose as usize, seen.landmark as usize);
            let camera = &problem.cameras[seen.camera as usize];
            let point = &problem.landmarks[landmark];
            let lin = seen.seen.linearize(&problem.poses[pose], camera, point).unwrap();
            let weight = problem.observation_loss.evaluate(lin.residual.norm_squared()).weight;
            let mut rows = DMatrix::<f64>::zeros(3, size);
            if !problem.constant_poses[pose] {
                let d_pose: Matrix3x6<f64> = lin.d_pose;
                rows.view_mut((0, BLOCK * pose), (3, BLOCK)).copy_from(&d_pose);
            }
            rows.view_mut((0, poses + 3 * landmark), (3, 3)).copy_from(&lin.d_landmark);
            add(&rows, weight);
        }
        for factor in &problem.relative_poses {
            let lin = linearized(problem, factor);
            let mut rows = DMatrix::<f64>::zeros(BLOCK, size);
            for (pose, d) in [(factor.i, lin.d_i), (factor.j, lin.d_j)] {
                if !problem.constant_poses[pose] {
                    rows.view_mut((0, BLOCK * pose), (BLOCK, BLOCK)).copy_from(&d);
                }
            }
            // The information is a multiple of the identity.
            add(&rows, factor.information.matrix()[(0, 0)]);
        }
        for k in 0..size {
            if dense[(k, k)] == 0.0 {
                dense[(k, k)] = 1.0;
            }
        }
        dense.cholesky().unwrap().inverse()
    }

    #[test]
    fn covariances_of_pairs_are_those_of_the_whole_normal_equations() {
        let problem = problem();
        let inverse = dense_inverse(&problem);
        let wanted: Vec<usize> = (0..problem.relative_poses.len()).collect();
        let found = pair_covariances(&problem, &wanted).unwrap();
        for (factor, found) in problem.relative_poses.iter().zip(&found) {
            let lin = linearized(&problem, factor);
            let mut expected = Matrix6::zeros();
            let ends = [(factor.i, lin.d_i), (factor.j, lin.d_j)];
            let ends = ends.into_iter().filter(|(pose, _)| !problem.constant_poses[*pose]);
            let ends: Vec<_> = ends.collect();
            for &(a, of_a) in &ends {
                for &(b, of_b) in &ends {
                    let block = inverse.view((BLOCK * a, BLOCK * b), (BLOCK, BLOCK));
                    let block = Matrix6::from_iterator(block.iter().copied());
                    expected += of_a * block * of_b.transpose();
                }
            }
            assert!(
                (found.covariance - expected).norm() <= 1e-8 * expected.norm(),
                "{found:?}\n{expected}"
            );
            assert_eq!(found.residual, lin.residual);
        }
    }

    #[test]
    fn covariances_of_poses_are_those_of_the_whole_normal_equations() {
        let problem = problem();
        let inverse = dense_inverse(&problem);
        let all: Vec<usize> = (0..problem.poses.len()).collect();
        for (pose, found) in pose_covariances(&problem, &all).unwrap().into_iter().enumerate() {
            let expected = match problem.constant_poses[pose] {
                true => Matrix6::zeros(),
                false => {
                    let block = inverse.view((BLOCK * pose, BLOCK * pose), (BLOCK, BLOCK));
                    Matrix6::from_iterator(block.iter().copied())
                }
            };
            assert!((found - expected).norm() <= 1e-8 * expected.norm(), "{found}\n{expected}");
        }
        assert_eq!(pose_covariances(&problem, &[problem.poses.len()]), None, "no such pose");
    }

    #[test]
    fn landmarks_that_one_pose_alone_sees_say_nothing_of_it() {
        let mut problem = problem();
        problem.relative_poses.clear();
        let own: Vec<_> = problem.observations().filter(|seen| seen.pose == 1).collect();
        problem.reprojections = Default::default();
        problem.depth_reprojections = Default::default();
        for seen in own {
            let view = Reprojection { depth_m: None, ..seen.seen };
            problem.push_observation(seen.pose, seen.camera, seen.landmark, view);
        }
        problem.constant_poses.fill(true);
        problem.constant_poses[1] = false;
        // The pose is open, or uncertain beyond any use.
        let found = pose_covariances(&problem, &[1]);
        let largest = found.map_or(f64::INFINITY, |found| found[0].diagonal().max());
        assert!(largest > 1e6, "{largest}");
    }

    #[test]
    fn a_prior_alone_gives_its_own_covariance() {
        let mut problem = BundleProblem::default();
        let pose = problem.push_pose(Se3::identity());
        let information = Information::from_sigmas(&Vector6::repeat(0.1)).unwrap();
        let world_from_camera = Se3::identity();
        assert_eq!(pose_covariances(&problem, &[pose]), None);
        let loss = Loss::Trivial;
        problem.pose_priors.push(PosePrior { pose, world_from_camera, information, loss });
        let found = pose_covariances(&problem, &[pose]).unwrap();
        assert!((found[0] - Matrix6::identity() * 0.01).norm() < 1e-12, "{}", found[0]);
    }

    #[test]
    fn on_a_chain_the_covariance_of_a_pair_is_that_of_its_measurement() {
        let mut problem = problem();
        problem.reprojections = Default::default();
        problem.depth_reprojections = Default::default();
        problem.constant_poses.fill(false);
        problem.constant_poses[0] = true;
        for found in pair_covariances(&problem, &[1, 4]).unwrap() {
            assert!((found.covariance - Matrix6::identity() * 1e-4).norm() < 1e-12, "{found:?}");
        }
        problem.relative_poses.remove(2);
        assert_eq!(pair_covariances(&problem, &[1]), None, "the poses behind it are open");
    }
}
