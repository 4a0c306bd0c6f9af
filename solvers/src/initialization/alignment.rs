//! Aligns a graph with its priors, as the start of a solve.
//!
//! Each piece that edges, landmarks and ranges tie together and that has no constant pose may turn and
//! shift as a whole: its edges do not change. The motion that takes the measured points to their
//! measurements minimizes Σ √trace(Ω) ‖X p − z‖, a sum of distances, which false measurements move
//! little; it is found by iteratively reweighted closed-form fits (Umeyama 1991, without scale). A
//! piece with a prior on a whole pose has the motion that meets it as well. The candidate with the
//! least Σ √χ² over the priors is taken, the given poses included. Of an edge it uses only which poses
//! it connects.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::factors::{PosePrior, PositionPrior};
use crate::geometry::{RigidMotion, hat};
use crate::problem::{PoseGraph, are_spread};

/// Fits of a piece. They settle after some ten, more where many measurements are false.
const FITS: usize = 40;

/// A vector below this length has no direction; the cosine below which two are opposite.
const NO_LENGTH: f64 = 1e-12;
const OPPOSITE: f64 = -1.0 + 1e-12;

/// Distances below this share of their median weigh as if they were so large.
const LEAST_SHARE: f64 = 1e-3;

/// Moves each piece of `graph` that has no constant pose as a whole to where its priors are met best;
/// whether one moved. The graph is valid. Its landmarks go along, unless they hold the poses.
///
/// Positions on one line leave a turn about it open, and a single one every turn: there the piece turns
/// no more than it must.
pub fn align_to_priors<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> bool {
    // Landmarks with a place of their own hold what measures them.
    if !graph.has_priors() || graph.landmarks.are_anchored() {
        return false;
    }
    let mut sets = graph.ties();
    graph.edges.iter().for_each(|edge| _ = sets.join(edge.i, edge.j));
    let mut is_held = vec![false; graph.poses.len()];
    for pose in (0..graph.poses.len()).filter(|&pose| graph.constant[pose]) {
        is_held[sets.root(pose)] = true;
    }
    let mut pieces: Vec<Piece<'_, G, N>> =
        (0..graph.poses.len()).map(|_| Piece { whole: Vec::new(), points: Vec::new() }).collect();
    for prior in &graph.pose_priors {
        pieces[sets.root(prior.pose)].whole.push(prior);
    }
    for prior in &graph.position_priors {
        pieces[sets.root(prior.pose)].points.push(prior);
    }
    let mut motions: Vec<Option<G>> = Vec::with_capacity(pieces.len());
    for (piece, &is_held) in pieces.iter().zip(&is_held) {
        let motion = if is_held { None } else { piece.best_motion::<D>(&graph.poses) };
        motions.push(motion);
    }
    let mut has_moved = false;
    for (landmark, position) in graph.landmarks.positions.iter_mut().enumerate() {
        // Of a landmark that nothing ties to a pose there is no motion.
        let root = sets.root(graph.poses.len() + landmark);
        if let Some(Some(motion)) = motions.get(root) {
            *position = motion.act(position);
        }
    }
    for pose in 0..graph.poses.len() {
        if let Some(motion) = &motions[sets.root(pose)] {
            graph.poses[pose] = motion.compose(&graph.poses[pose]);
            has_moved = true;
        }
    }
    has_moved
}

/// A vector of the plane or of space as one of space.
fn spatial<const D: usize>(vector: &SVector<f64, D>) -> Vector3<f64> {
    Vector3::from_fn(|row, _| if row < D { vector[row] } else { 0.0 })
}

/// The rotation by the least angle that turns the direction of `from` to that of `to`; none where one
/// of them has no direction.
fn least_turn(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let (Some(from), Some(to)) = (from.try_normalize(NO_LENGTH), to.try_normalize(NO_LENGTH))
    else {
        return Matrix3::identity();
    };
    let cosine = from.dot(&to);
    if cosine < OPPOSITE {
        // Half a turn about an axis that is perpendicular: about z where that is one.
        let helper = if from.z.abs() < 0.5 { Vector3::z() } else { Vector3::x() };
        let axis = (helper - from * from.dot(&helper)).normalize();
        return axis * axis.transpose() * 2.0 - Matrix3::identity();
    }
    let sine = hat(&from.cross(&to));
    Matrix3::identity() + sine + sine * sine / (1.0 + cosine)
}

/// The priors of a piece.
struct Piece<'a, G, const N: usize> {
    whole: Vec<&'a PosePrior<G, N>>,
    points: Vec<&'a PositionPrior>,
}

impl<G, const N: usize> Piece<'_, G, N> {
    /// The motion of the whole piece under which its priors are met best; `None` where it stays.
    fn best_motion<const D: usize>(&self, poses: &[G]) -> Option<G>
    where
        G: RigidMotion<D, N>,
    {
        let mut best: (f64, Option<G>) = (self.distance(poses, &G::identity()), None);
        let by_pose = self
            .whole
            .first()
            .map(|prior| prior.world_from_camera.compose(&poses[prior.pose].inverse()));
        for motion in [by_pose, self.fit::<D>(poses)].into_iter().flatten() {
            let distance = self.distance(poses, &motion);
            // A distance that is no number never wins.
            if distance < best.0 || (best.0.is_nan() && distance.is_finite()) {
                best = (distance, Some(motion));
            }
        }
        best.1
    }

    /// Σ √χ² after `motion`.
    fn distance<const D: usize>(&self, poses: &[G], motion: &G) -> f64
    where
        G: RigidMotion<D, N>,
    {
        let moved = |pose: usize| motion.compose(&poses[pose]);
        let whole = self.whole.iter().map(|prior| prior.chi2(&moved(prior.pose)).sqrt());
        let points = self.points.iter().map(|prior| prior.chi2(&moved(prior.pose)).sqrt());
        whole.chain(points).sum()
    }

    /// The motion with the least sum of weighted distances of the points.
    fn fit<const D: usize>(&self, poses: &[G]) -> Option<G>
    where
        G: RigidMotion<D, N>,
    {
        let sources: Vec<Vector3<f64>> =
            self.points.iter().map(|prior| poses[prior.pose].act(&prior.point_in_camera)).collect();
        if sources.is_empty() {
            return None;
        }
        let is_spread = are_spread(&sources);
        let stiffness: Vec<f64> =
            self.points.iter().map(|prior| prior.information.matrix().trace().sqrt()).collect();
        let mut weights = stiffness.clone();
        let mut motion = None;
        for _ in 0..FITS {
            let fitted = self.closed_form::<D>(&sources, is_spread, &weights)?;
            let distances: Vec<f64> = self
                .points
                .iter()
                .zip(&sources)
                .map(|(prior, source)| (fitted.act(source) - prior.position_in_world).norm())
                .collect();
            let mut sorted = distances.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let least = (LEAST_SHARE * sorted[sorted.len() / 2]).max(f64::MIN_POSITIVE);
            for ((weight, distance), stiffness) in weights.iter_mut().zip(distances).zip(&stiffness)
            {
                *weight = stiffness / distance.max(least);
            }
            motion = Some(fitted);
        }
        motion
    }

    /// The motion that minimizes Σ w ‖T x − z‖²; of points on one line that with the least turn.
    fn closed_form<const D: usize>(
        &self,
        sources: &[Vector3<f64>],
        is_spread: bool,
        weights: &[f64],
    ) -> Option<G>
    where
        G: RigidMotion<D, N>,
    {
        let flat = |point: &Vector3<f64>| SVector::<f64, D>::from_fn(|row, _| point[row]);
        let total: f64 = weights.iter().sum();
        let (mut source, mut target) = (SVector::zeros(), SVector::zeros());
        for ((x, prior), &weight) in sources.iter().zip(&self.points).zip(weights) {
            source += flat(x) * (weight / total);
            target += flat(&prior.position_in_world) * (weight / total);
        }
        let mut covariance = SMatrix::<f64, D, D>::zeros();
        for ((x, prior), &weight) in sources.iter().zip(&self.points).zip(weights) {
            let arm = flat(&prior.position_in_world) - target;
            covariance += arm * (flat(x) - source).transpose() * (weight / total);
        }
        let rotation = if is_spread {
            G::from_matrix(&covariance, &SVector::zeros())?.rotation_matrix()
        } else {
            let arms = sources.iter().map(|x| flat(x) - source);
            let longest = arms.max_by(|a, b| a.norm().total_cmp(&b.norm()))?;
            let turn = least_turn(&spatial(&longest), &spatial(&(covariance * longest)));
            turn.fixed_view::<D, D>(0, 0).into_owned()
        };
        let motion = G::from_matrix(&rotation, &(target - rotation * source))?;
        motion.is_finite().then_some(motion)
    }
}
