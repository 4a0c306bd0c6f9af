//! Costs of whole problems, by kind of factor.
//!
//! Cost = ½ Σ ρ(rᵀΩr) with the problem's losses, or the factor's own where it has one. Observations
//! behind the camera count in the cost and are counted apart. Indices out of range make the cost NaN:
//! whether a problem is well posed is the business of its `validate`.

use std::f64::consts::TAU;

use nalgebra::{SVector, Vector3};

use super::reference::{ReferencePose, Rigid, project};
use super::residuals::{ResidualReport, bundle_residuals, pose_graph_residuals};
use super::sum::CompensatedSum;
use crate::factors::{
    LandmarkMeasurement, PosePrior, PositionPrior, Range, RangeEnd, RelativePose, Sighting,
};
use crate::information::Information;
use crate::loss::Loss;
use crate::problem::{BundleProblem, Observation, PoseGraph};

/// One kind of factor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FactorCost {
    /// How many factors of this kind there are.
    pub count: usize,
    /// Their cost, losses applied.
    pub cost: f64,
}

/// The cost of a problem.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CostReport {
    /// The whole cost.
    pub total: f64,
    /// Observations (u, v).
    pub reprojection: FactorCost,
    /// Observations (u, v, depth).
    pub depth_reprojection: FactorCost,
    /// Relative poses.
    pub relative_pose: FactorCost,
    /// Priors on poses.
    pub pose_prior: FactorCost,
    /// Priors on positions.
    pub position_prior: FactorCost,
    /// Measurements of landmarks by position or bearing.
    pub landmark: FactorCost,
    /// Ranges.
    pub range: FactorCost,
    /// √(Σ ‖(u, v) − measured‖² / N) over the N observations of both kinds, in pixels; no loss, no
    /// sigma. 0 without observations.
    pub rmse_px: f64,
    /// Observations whose landmark is at or behind the camera's center plane (z ≤ 0).
    pub behind_camera: usize,
    /// The residuals by quantity, against their sigmas.
    pub residuals: ResidualReport,
}

impl CostReport {
    fn add_up(mut self) -> Self {
        let mut total = CompensatedSum::default();
        for part in [
            self.reprojection,
            self.depth_reprojection,
            self.relative_pose,
            self.pose_prior,
            self.position_prior,
            self.landmark,
            self.range,
        ] {
            total.add(part.cost);
        }
        self.total = total.value();
        self
    }
}

/// Collects the costs of one kind of factor.
#[derive(Default)]
struct Tally {
    count: usize,
    sum: CompensatedSum,
}

impl Tally {
    /// Adds a factor with squared whitened norm `s`.
    fn add(&mut self, loss: Loss, s: f64) {
        self.count += 1;
        self.sum.add(0.5 * loss.evaluate(s).rho);
    }

    fn cost(&self) -> FactorCost {
        FactorCost { count: self.count, cost: self.sum.value() }
    }
}

/// The cost of a pose graph in SE(2) or SE(3).
#[must_use]
pub fn pose_graph_cost<G: ReferencePose<N>, const N: usize>(graph: &PoseGraph<G, N>) -> CostReport {
    let relative_pose = relative_poses(&graph.edges, &graph.poses, graph.loss);
    let (poses, whole, points) = (&graph.poses, &graph.pose_priors, &graph.position_priors);
    let pose_prior = pose_priors(whole, poses);
    let position_prior = position_priors(points, poses);
    let (landmark, range) = (landmarks(graph), ranges(graph));
    let residuals = pose_graph_residuals(graph);
    let others = CostReport::default();
    CostReport { relative_pose, pose_prior, position_prior, landmark, range, residuals, ..others }
        .add_up()
}

/// The cost of a bundle adjustment problem.
#[must_use]
pub fn bundle_cost(problem: &BundleProblem) -> CostReport {
    let mut pixels = PixelStatistics::default();
    let (mut plain, mut with_depth) = (Tally::default(), Tally::default());
    for seen in observed(problem) {
        pixels.add(seen.square, seen.depth);
        let s = seen.square / seen.sigma_px.powi(2);
        match seen.depth_error {
            None => plain.add(problem.observation_loss, s),
            Some((error, sigma)) => {
                with_depth.add(problem.observation_loss, s + (error / sigma).powi(2));
            }
        }
    }
    let relative_pose =
        relative_poses(&problem.relative_poses, &problem.poses, problem.relative_pose_loss);
    CostReport {
        total: 0.0,
        reprojection: plain.cost(),
        depth_reprojection: with_depth.cost(),
        relative_pose,
        pose_prior: pose_priors(&problem.pose_priors, &problem.poses),
        position_prior: position_priors(&problem.position_priors, &problem.poses),
        landmark: FactorCost::default(),
        range: FactorCost::default(),
        rmse_px: pixels.rmse_px(),
        behind_camera: pixels.behind_camera,
        residuals: bundle_residuals(problem),
    }
    .add_up()
}

/// Pixel errors of both kinds of observations.
#[derive(Default)]
struct PixelStatistics {
    count: usize,
    squares: CompensatedSum,
    behind_camera: usize,
}

impl PixelStatistics {
    fn add(&mut self, squared_error: f64, depth: f64) {
        self.count += 1;
        self.squares.add(squared_error);
        self.behind_camera += usize::from(depth <= 0.0);
    }

    fn rmse_px(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares.value() / self.count as f64).sqrt() }
    }
}

/// An observation at the values of its problem; not a number where an index has no variable.
pub(super) struct Observed {
    pub(super) pose: u32,
    pub(super) landmark: u32,
    /// ‖(u, v) − measured‖², px².
    pub(super) square: f64,
    pub(super) sigma_px: f64,
    /// z of the landmark in the camera, m.
    pub(super) depth: f64,
    /// z − measured and the standard deviation, m, where a depth was measured.
    pub(super) depth_error: Option<(f64, f64)>,
}

/// All observations, those without a depth first.
pub(super) fn observed(problem: &BundleProblem) -> impl Iterator<Item = Observed> + '_ {
    let rigids: Vec<Rigid> = problem.poses.iter().map(Rigid::of).collect();
    problem.observations().map(move |Observation { pose, camera, landmark, seen }| {
        let variables = (
            rigids.get(pose as usize),
            problem.cameras.get(camera as usize),
            problem.landmarks.get(landmark as usize),
        );
        let (square, depth) = match variables {
            (Some(pose), Some(camera), Some(landmark)) => {
                let point_in_camera: Vector3<f64> = pose.to_local(landmark);
                let [u, v] = project(camera, &point_in_camera);
                let (du, dv) = (u - seen.pixel.x, v - seen.pixel.y);
                (du * du + dv * dv, point_in_camera.z)
            }
            _ => (f64::NAN, f64::NAN),
        };
        let depth_error = seen.depth_m.map(|(measured, sigma)| (depth - measured, sigma));
        Observed { pose, landmark, square, sigma_px: seen.sigma_px, depth, depth_error }
    })
}

fn relative_poses<G: ReferencePose<N>, const N: usize>(
    edges: &[RelativePose<G, N>],
    poses: &[G],
    loss: Loss,
) -> FactorCost {
    let mut tally = Tally::default();
    for edge in edges {
        tally.add(edge.loss.unwrap_or(loss), edge_chi2(edge, poses));
    }
    tally.cost()
}

/// rᵀΩr of a relative pose; NaN where an index has no pose.
pub(super) fn edge_chi2<G: ReferencePose<N>, const N: usize>(
    edge: &RelativePose<G, N>,
    poses: &[G],
) -> f64 {
    match (poses.get(edge.i), poses.get(edge.j)) {
        (Some(a), Some(b)) => {
            let residual = G::reference_residual(&edge.i_from_j, a, b);
            quadratic_form(&edge.information, &residual)
        }
        (None, _) | (_, None) => f64::NAN,
    }
}

fn pose_priors<G: ReferencePose<N>, const N: usize>(
    priors: &[PosePrior<G, N>],
    poses: &[G],
) -> FactorCost {
    let mut tally = Tally::default();
    for prior in priors {
        let s = poses.get(prior.pose).map_or(f64::NAN, |pose| {
            // Seen from the world itself.
            let measured = &prior.world_from_camera;
            let residual = G::reference_residual(measured, &G::identity(), pose);
            quadratic_form(&prior.information, &residual)
        });
        tally.add(prior.loss, s);
    }
    tally.cost()
}

fn position_priors<G: ReferencePose<N>, const N: usize>(
    priors: &[PositionPrior],
    poses: &[G],
) -> FactorCost {
    let mut tally = Tally::default();
    for prior in priors {
        let s = poses.get(prior.pose).map_or(f64::NAN, |pose| {
            let residual = pose.reference_point(&prior.point_in_camera) - prior.position_in_world;
            quadratic_form(&prior.information, &residual)
        });
        tally.add(prior.loss, s);
    }
    tally.cost()
}

fn landmarks<G: ReferencePose<N>, const N: usize>(graph: &PoseGraph<G, N>) -> FactorCost {
    let mut tally = Tally::default();
    for measurement in &graph.landmarks.measurements {
        let s = landmark_residual(measurement, graph)
            .map_or(f64::NAN, |residual| quadratic_form(&measurement.information, &residual));
        tally.add(measurement.loss.unwrap_or(graph.loss), s);
    }
    tally.cost()
}

/// The residual of a measured landmark, rows that it does not have zero; `None` where an index has no
/// variable.
pub(super) fn landmark_residual<G: ReferencePose<N>, const N: usize>(
    measurement: &LandmarkMeasurement,
    graph: &PoseGraph<G, N>,
) -> Option<Vector3<f64>> {
    let point = graph.landmarks.positions.get(measurement.landmark)?;
    let q = match measurement.pose {
        Some(pose) => graph.poses.get(pose)?.reference_local(point),
        None => *point,
    };
    Some(match measurement.sighting {
        Sighting::Position(z) => q - z,
        Sighting::Bearing(z) => {
            let turns = (q.y.atan2(q.x) - z) / TAU;
            Vector3::new((turns - turns.round()) * TAU, 0.0, 0.0)
        }
    })
}

fn ranges<G: ReferencePose<N>, const N: usize>(graph: &PoseGraph<G, N>) -> FactorCost {
    let mut tally = Tally::default();
    for range in &graph.ranges {
        let r = range_residual(range, graph).unwrap_or(f64::NAN);
        tally.add(range.loss.unwrap_or(graph.loss), r * r * range.precision);
    }
    tally.cost()
}

/// The residual of a range, m; `None` where an index has no variable.
pub(super) fn range_residual<G: ReferencePose<N>, const N: usize>(
    range: &Range,
    graph: &PoseGraph<G, N>,
) -> Option<f64> {
    let position = |end| match end {
        RangeEnd::Pose(pose) => {
            graph.poses.get(pose).map(|pose: &G| pose.reference_point(&Vector3::zeros()))
        }
        RangeEnd::Landmark(landmark) => graph.landmarks.positions.get(landmark).copied(),
    };
    let [a, b] = range.ends.map(position);
    let d = b? - a?;
    Some((d.x * d.x + d.y * d.y + d.z * d.z).sqrt() - range.distance_m)
}

/// rᵀΩr, summed entry by entry.
fn quadratic_form<const N: usize>(information: &Information<N>, r: &SVector<f64, N>) -> f64 {
    let mut sum = CompensatedSum::default();
    for row in 0..N {
        for column in 0..N {
            sum.add(information.matrix()[(row, column)] * r[row] * r[column]);
        }
    }
    sum.value()
}
