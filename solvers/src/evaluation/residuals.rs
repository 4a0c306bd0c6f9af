//! Residuals by what is measured: how large they are, in their own unit and against their sigmas.
//!
//! A squared whitened residual s of k rows has, where the sigmas are right, the χ² distribution with k
//! degrees of freedom; here its median is compared, so that less than half of outliers do not decide.
//! Losses give the limit of outliers and nothing else. This file evaluates and must not solve.

use nalgebra::{SMatrix, SVector};

use super::cost::{landmark_residual, observed, range_residual};
use super::reference::ReferencePose;
use super::sum::CompensatedSum;
use crate::factors::{PosePrior, PositionPrior, Range, Sighting};
use crate::information::Information;
use crate::loss::Loss;
use crate::problem::{BundleProblem, Observation, PoseGraph, dimension_of_space};

/// A sigma that is off by more than this factor is told.
pub const SIGMA_FACTOR: f64 = 3.0;

/// With fewer residuals that others can contradict nothing is said of their sigma.
const MIN_COUNT: usize = 20;

/// With a smaller share of rows beyond the unknowns nothing is said of the sigmas of a graph: the
/// residuals of an open chain are zero whatever the sigmas are.
const MIN_REDUNDANCY: f64 = 0.1;

/// Median and 99 % quantile of χ² with 1, 2 and 3 degrees of freedom.
const CHI2: [(f64, f64); 3] =
    [(0.454_936, 6.634_897), (1.386_294, 9.210_340), (2.365_974, 11.344_867)];

/// What a residual is a difference of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Pixels of observations, px.
    Pixel,
    /// Depths of observations, m.
    Depth,
    /// Translations of relative poses, m.
    RelativeTranslation,
    /// Rotations of relative poses, rad.
    RelativeRotation,
    /// Translations of pose priors, m.
    PriorTranslation,
    /// Rotations of pose priors, rad.
    PriorRotation,
    /// Position priors, m.
    PriorPosition,
    /// Positions of landmarks in the frames of poses, m.
    LandmarkPosition,
    /// Bearings of landmarks, rad.
    LandmarkBearing,
    /// Distances between poses and landmarks, m.
    Range,
}

impl Quantity {
    /// All of them, in the order of [`ResidualReport`].
    pub const ALL: [Self; 10] = [
        Self::Pixel,
        Self::Depth,
        Self::RelativeTranslation,
        Self::RelativeRotation,
        Self::PriorTranslation,
        Self::PriorRotation,
        Self::PriorPosition,
        Self::LandmarkPosition,
        Self::LandmarkBearing,
        Self::Range,
    ];

    /// Its name in texts and in JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Depth => "depth",
            Self::RelativeTranslation => "relative translation",
            Self::RelativeRotation => "relative rotation",
            Self::PriorTranslation => "prior translation",
            Self::PriorRotation => "prior rotation",
            Self::PriorPosition => "prior position",
            Self::LandmarkPosition => "landmark position",
            Self::LandmarkBearing => "landmark bearing",
            Self::Range => "range",
        }
    }

    /// The unit of its residuals.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Pixel => "px",
            Self::Depth
            | Self::RelativeTranslation
            | Self::PriorTranslation
            | Self::PriorPosition
            | Self::LandmarkPosition
            | Self::Range => "m",
            Self::RelativeRotation | Self::PriorRotation | Self::LandmarkBearing => "rad",
        }
    }
}

/// What the residuals say of a sigma.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SigmaJudgment {
    /// There are too few residuals that others could contradict.
    Unknown,
    /// The sigma is right to within [`SIGMA_FACTOR`].
    Plausible,
    /// The residuals are larger than the sigma says: these measurements have too much weight.
    TooSmall,
    /// The residuals are smaller than the sigma says.
    TooLarge,
}

/// The residuals of one quantity.
///
/// The observations of a landmark that one pose alone sees fit by construction, so they count in
/// `count` and `rms` only, and so does the only measurement of a landmark; all other figures are of the
/// *redundant* residuals. Of relative poses and priors all are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ResidualStatistics {
    /// Residuals (vectors, not rows).
    pub count: usize,
    /// √(Σ ‖r‖² / count) in the quantity's unit; no loss, no sigma.
    pub rms: f64,
    /// Redundant residuals.
    pub redundant_count: usize,
    /// As `rms`, of the redundant ones.
    pub redundant_rms: f64,
    /// Σ rᵀΩr over the number of their rows; the unknowns are not subtracted from the rows, so that
    /// right sigmas give somewhat less than 1. Ω is the marginal information of the quantity.
    pub reduced_chi2: f64,
    /// Share with √(rᵀΩr) beyond the loss's width, or without a loss beyond the 99 % quantile.
    pub outlier_share: f64,
    /// By what the sigmas would have to be multiplied for the median of rᵀΩr to be that of χ², with
    /// the unknowns' share of the rows taken into account; `None` where too few are redundant.
    pub sigma_ratio: Option<f64>,
}

impl ResidualStatistics {
    /// Whether the sigma is off by more than [`SIGMA_FACTOR`].
    #[must_use]
    pub fn judgment(&self) -> SigmaJudgment {
        match self.sigma_ratio {
            Some(ratio) if ratio > SIGMA_FACTOR => SigmaJudgment::TooSmall,
            Some(ratio) if ratio < 1.0 / SIGMA_FACTOR => SigmaJudgment::TooLarge,
            Some(ratio) if ratio.is_nan() => SigmaJudgment::Unknown,
            Some(_) => SigmaJudgment::Plausible,
            None => SigmaJudgment::Unknown,
        }
    }

    /// A sentence for people where the sigma of `quantity` is off.
    #[must_use]
    pub fn hint(&self, quantity: Quantity) -> Option<String> {
        let name = quantity.name();
        let ratio = self.sigma_ratio?;
        match self.judgment() {
            SigmaJudgment::TooSmall => Some(format!(
                "{name} residuals are typically {ratio:.1} times as large as their sigmas say: the \
                 sigmas are too small, or the model is wrong"
            )),
            SigmaJudgment::TooLarge => Some(format!(
                "{name} residuals are typically {:.1} times smaller than their sigmas say: the \
                 sigmas are too large{}",
                1.0 / ratio,
                if quantity == Quantity::Depth { ", or the depths are not in meters" } else { "" }
            )),
            SigmaJudgment::Unknown | SigmaJudgment::Plausible => None,
        }
    }
}

/// The residuals of a problem, by quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ResidualReport([ResidualStatistics; Quantity::ALL.len()]);

impl ResidualReport {
    /// Those of one quantity.
    #[must_use]
    pub fn of(&self, quantity: Quantity) -> &ResidualStatistics {
        &self.0[quantity as usize]
    }

    /// The quantities that occur.
    pub fn iter(&self) -> impl Iterator<Item = (Quantity, &ResidualStatistics)> {
        Quantity::ALL.into_iter().zip(&self.0).filter(|(_, statistics)| statistics.count > 0)
    }
}

/// Collects the residuals of one quantity, whose dimension is 1, 2 or 3.
struct Samples {
    dimension: usize,
    limit: f64,
    count: usize,
    squares: CompensatedSum,
    redundant: CompensatedSum,
    chi2: CompensatedSum,
    outliers: usize,
    /// rᵀΩr of the redundant ones over the share of rows beyond the unknowns.
    scaled: Vec<f64>,
}

impl Samples {
    fn new(dimension: usize, loss: Loss) -> Self {
        let limit = loss.width().map_or(CHI2[dimension - 1].1, |width| width * width);
        Self {
            dimension,
            limit,
            count: 0,
            squares: CompensatedSum::default(),
            redundant: CompensatedSum::default(),
            chi2: CompensatedSum::default(),
            outliers: 0,
            scaled: Vec::new(),
        }
    }

    /// Adds ‖r‖² and rᵀΩr; `redundancy` is the share of rows beyond the unknowns, 0 where the
    /// residual fits by construction.
    fn add(&mut self, square: f64, s: f64, redundancy: f64) {
        self.count += 1;
        self.squares.add(square);
        if redundancy > 0.0 {
            self.redundant.add(square);
            self.chi2.add(s);
            self.outliers += usize::from(s > self.limit || s.is_nan());
            self.scaled.push(s / redundancy);
        }
    }

    fn statistics(mut self) -> ResidualStatistics {
        let redundant_count = self.scaled.len();
        let mean = |sum: &CompensatedSum, count: usize| match count {
            0 => 0.0,
            count => sum.value() / count as f64,
        };
        let median = (redundant_count >= MIN_COUNT).then(|| {
            let (_, median, _) =
                self.scaled.select_nth_unstable_by(redundant_count / 2, f64::total_cmp);
            *median
        });
        ResidualStatistics {
            count: self.count,
            rms: mean(&self.squares, self.count).sqrt(),
            redundant_count,
            redundant_rms: mean(&self.redundant, redundant_count).sqrt(),
            reduced_chi2: mean(&self.chi2, redundant_count * self.dimension),
            outlier_share: match redundant_count {
                0 => 0.0,
                count => self.outliers as f64 / count as f64,
            },
            sigma_ratio: median.map(|median| (median / CHI2[self.dimension - 1].0).sqrt()),
        }
    }
}

/// The residuals of a pose graph.
pub(super) fn pose_graph_residuals<G: ReferencePose<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> ResidualReport {
    let free = graph.constant.iter().filter(|&&constant| !constant).count();
    let unknowns = free.min(graph.poses.len().saturating_sub(1));
    let redundancy = redundancy_of(graph.edges.len() + graph.pose_priors.len(), unknowns);
    let mut tangents = Tangents::new::<N>(graph.loss);
    for edge in &graph.edges {
        if let (Some(a), Some(b)) = (graph.poses.get(edge.i), graph.poses.get(edge.j)) {
            let residual = G::reference_residual(&edge.i_from_j, a, b);
            tangents.add(&residual, &edge.information, redundancy);
        }
    }
    let mut report = ResidualReport::default();
    tangents.finish(
        &mut report,
        [Quantity::RelativeTranslation, Quantity::RelativeRotation],
        redundancy,
    );
    let (whole, positions) = (&graph.pose_priors, &graph.position_priors);
    prior_residuals(whole, positions, &graph.poses, redundancy, &mut report);
    landmark_residuals(graph, &mut report);
    report
}

/// Those of measured landmarks and of ranges.
fn landmark_residuals<G: ReferencePose<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    report: &mut ResidualReport,
) {
    let landmarks = &graph.landmarks;
    let space = dimension_of_space(N);
    // Measurements and rows of each.
    let mut tracks = vec![(0, 0); landmarks.len()];
    let measured = landmarks.measurements.iter().map(|m| (m.landmark, m.rows(space)));
    let ranged = graph.ranges.iter().flat_map(Range::landmarks).map(|landmark| (landmark, 1));
    for (landmark, own) in measured.chain(ranged) {
        if let Some((count, rows)) = tracks.get_mut(landmark) {
            *count += 1;
            *rows += own;
        }
    }
    let redundancy =
        |landmark: usize| match (landmarks.constant.get(landmark), tracks.get(landmark)) {
            (Some(true), _) => 1.0,
            (_, Some(&(count, rows))) if count > 1 => redundancy_of(rows, space),
            _ => 0.0,
        };
    let kinds =
        [(Quantity::LandmarkPosition, space), (Quantity::LandmarkBearing, 1), (Quantity::Range, 1)];
    let mut samples = kinds.map(|(_, dimension)| Samples::new(dimension, graph.loss));
    for measurement in &landmarks.measurements {
        let kind = match measurement.sighting {
            Sighting::Position(_) => 0,
            Sighting::Bearing(_) => 1,
        };
        if let Some(r) = landmark_residual(measurement, graph) {
            let s = r.dot(&(measurement.information.matrix() * r));
            samples[kind].add(r.norm_squared(), s, redundancy(measurement.landmark));
        }
    }
    for range in &graph.ranges {
        if let Some(r) = range_residual(range, graph) {
            // Between poses alone a range is beyond their unknowns.
            let redundancy = range.landmarks().map(redundancy).fold(1.0, f64::min);
            samples[2].add(r * r, r * r * range.precision, redundancy);
        }
    }
    for ((quantity, _), samples) in kinds.into_iter().zip(samples) {
        report.0[quantity as usize] = samples.statistics();
    }
}

/// Those of priors on poses and on positions.
fn prior_residuals<G: ReferencePose<N>, const N: usize>(
    pose_priors: &[PosePrior<G, N>],
    position_priors: &[PositionPrior],
    poses: &[G],
    redundancy: f64,
    report: &mut ResidualReport,
) {
    let mut priors = Tangents::new::<N>(Loss::Trivial);
    for prior in pose_priors {
        if let Some(pose) = poses.get(prior.pose) {
            // Seen from the world itself.
            let residual = G::reference_residual(&prior.world_from_camera, &G::identity(), pose);
            priors.add(&residual, &prior.information, redundancy);
        }
    }
    priors.finish(report, [Quantity::PriorTranslation, Quantity::PriorRotation], redundancy);
    let mut positions = Samples::new(dimension_of_space(N), Loss::Trivial);
    for prior in position_priors {
        if let Some(pose) = poses.get(prior.pose) {
            let r = pose.reference_point(&prior.point_in_camera) - prior.position_in_world;
            positions.add(r.norm_squared(), r.dot(&(prior.information.matrix() * r)), 1.0);
        }
    }
    report.0[Quantity::PriorPosition as usize] = positions.statistics();
}

/// (rows − unknowns) / rows, 0 where there are too few rows.
fn redundancy_of(rows: usize, unknowns: usize) -> f64 {
    if rows <= unknowns { 0.0 } else { (rows - unknowns) as f64 / rows as f64 }
}

/// Residuals in a tangent space, translation first.
struct Tangents {
    translation: Samples,
    rotation: Samples,
}

impl Tangents {
    fn new<const N: usize>(loss: Loss) -> Self {
        // SE(2) has two rows of translation and one of rotation, SE(3) three of each.
        let translation = if N == 3 { 2 } else { 3 };
        Self {
            translation: Samples::new(translation, loss),
            rotation: Samples::new(N - translation, loss),
        }
    }

    fn add<const N: usize>(
        &mut self,
        residual: &SVector<f64, N>,
        information: &Information<N>,
        redundancy: f64,
    ) {
        let covariance = information.covariance().ok();
        let covariance = covariance.as_ref().map(|covariance| covariance.matrix());
        let middle = self.translation.dimension;
        for (samples, start) in [(&mut self.translation, 0), (&mut self.rotation, middle)] {
            let (square, s) = match samples.dimension {
                1 => block::<1, N>(start, residual, information.matrix(), covariance),
                2 => block::<2, N>(start, residual, information.matrix(), covariance),
                _ => block::<3, N>(start, residual, information.matrix(), covariance),
            };
            samples.add(square, s, redundancy);
        }
    }

    fn finish(self, report: &mut ResidualReport, quantities: [Quantity; 2], redundancy: f64) {
        for (quantity, samples) in quantities.into_iter().zip([self.translation, self.rotation]) {
            let mut statistics = samples.statistics();
            if redundancy < MIN_REDUNDANCY {
                statistics.sigma_ratio = None;
            }
            report.0[quantity as usize] = statistics;
        }
    }
}

/// ‖r‖² and rᵀΩr of the K rows of a residual from `start` on. Their marginal information is the inverse
/// of their covariance, where there is one.
fn block<const K: usize, const N: usize>(
    start: usize,
    residual: &SVector<f64, N>,
    information: &SMatrix<f64, N, N>,
    covariance: Option<&SMatrix<f64, N, N>>,
) -> (f64, f64) {
    let of = |matrix: &SMatrix<f64, N, N>| {
        SMatrix::<f64, K, K>::from_fn(|i, j| matrix[(start + i, start + j)])
    };
    let marginal = covariance.and_then(|covariance| of(covariance).try_inverse());
    let r = SVector::<f64, K>::from_fn(|i, _| residual[start + i]);
    (r.norm_squared(), r.dot(&(marginal.unwrap_or_else(|| of(information)) * r)))
}

/// The residuals of a bundle adjustment problem.
pub(super) fn bundle_residuals(problem: &BundleProblem) -> ResidualReport {
    let mut report = ResidualReport::default();
    observations(problem, &mut report);
    let poses = problem.constant_poses.iter().filter(|&&constant| !constant).count();
    let factors = problem.relative_poses.len() + problem.pose_priors.len();
    // Beside observations, pose factors have little to say on the poses.
    let redundancy = match problem.observation_count() {
        0 => redundancy_of(factors, poses),
        _ => 1.0,
    };
    let mut edges = Tangents::new::<6>(problem.relative_pose_loss);
    for edge in &problem.relative_poses {
        if let (Some(a), Some(b)) = (problem.poses.get(edge.i), problem.poses.get(edge.j)) {
            let residual = ReferencePose::reference_residual(&edge.i_from_j, a, b);
            edges.add(&residual, &edge.information, redundancy);
        }
    }
    let quantities = [Quantity::RelativeTranslation, Quantity::RelativeRotation];
    edges.finish(&mut report, quantities, redundancy);
    let (whole, positions) = (&problem.pose_priors, &problem.position_priors);
    prior_residuals(whole, positions, &problem.poses, redundancy, &mut report);
    report
}

/// Pixels and depths.
fn observations(problem: &BundleProblem, report: &mut ResidualReport) {
    let redundancies = redundancies(problem);
    let mut pixels = Samples::new(2, problem.observation_loss);
    let mut depths = Samples::new(1, problem.observation_loss);
    for seen in observed(problem) {
        let redundancy = redundancies.get(seen.landmark as usize).copied().unwrap_or(0.0);
        pixels.add(seen.square, seen.square / seen.sigma_px.powi(2), redundancy);
        if let Some((error, sigma)) = seen.depth_error {
            let square = error.powi(2);
            depths.add(square, square / sigma.powi(2), redundancy);
        }
    }
    report.0[Quantity::Pixel as usize] = pixels.statistics();
    report.0[Quantity::Depth as usize] = depths.statistics();
}

/// For each landmark the share of its rows that are beyond its own three unknowns: 0 where one pose
/// alone sees it, 1 where it is constant.
fn redundancies(problem: &BundleProblem) -> Vec<f64> {
    #[derive(Clone, Copy)]
    struct Track {
        rows: usize,
        pose: u32,
        several: bool,
    }
    let none = Track { rows: 0, pose: 0, several: false };
    let mut tracks = vec![none; problem.landmarks.len()];
    for Observation { pose, landmark, seen, .. } in problem.observations() {
        let rows = if seen.depth_m.is_some() { 3 } else { 2 };
        if let Some(track) = tracks.get_mut(landmark as usize) {
            track.several |= track.rows > 0 && track.pose != pose;
            track.rows += rows;
            track.pose = pose;
        }
    }
    let constant = problem.constant_landmarks.iter().chain(std::iter::repeat(&false));
    let share = |(track, &constant): (&Track, &bool)| match (constant, track.several) {
        (true, _) => 1.0,
        (false, true) => redundancy_of(track.rows, 3),
        (false, false) => 0.0,
    };
    tracks.iter().zip(constant).map(share).collect()
}
