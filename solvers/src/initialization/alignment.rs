//! A graph in a frame of its own is brought to the frame of its priors, as the start of a solve.
//!
//! Each piece that edges tie together and that has no constant pose may turn and shift as a whole: its
//! edges do not change. The motion that takes the measured points to their measurements minimizes
//! Σ √trace(Ω) ‖X p − z‖, a sum of distances, which false measurements move little; it is found by
//! iteratively reweighted closed-form fits (Umeyama 1991, without scale). A piece with a prior on a
//! whole pose has the motion that meets it as well. The candidate with the least Σ √χ² over the priors
//! is taken, the given poses included. No edge is looked at but for what it ties together.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::factors::{PosePrior, PositionPrior};
use crate::geometry::RigidMotion;
use crate::problem::{DisjointSets, PoseGraph, are_spread};

/// Fits of a piece. They settle after some ten, more where many measurements are false.
const FITS: usize = 40;

/// Distances below this share of their median weigh as if they were so large.
const LEAST_SHARE: f64 = 1e-3;

/// Moves each piece of `graph` that has no constant pose as a whole to where its priors are met best;
/// whether one moved. The graph is valid.
///
/// Positions count where three of a piece are not on one line; otherwise they leave a turn open, and
/// the given poses or a pose prior decide.
pub fn align_to_priors<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> bool {
    if !graph.has_priors() {
        return false;
    }
    let mut sets = DisjointSets::new(graph.poses.len());
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
    for pose in 0..graph.poses.len() {
        if let Some(motion) = &motions[sets.root(pose)] {
            graph.poses[pose] = motion.compose(&graph.poses[pose]);
            has_moved = true;
        }
    }
    has_moved
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
        if !are_spread(&sources) {
            return None;
        }
        let stiffness: Vec<f64> =
            self.points.iter().map(|prior| prior.information.matrix().trace().sqrt()).collect();
        let mut weights = stiffness.clone();
        let mut motion = None;
        for _ in 0..FITS {
            let fitted = self.closed_form::<D>(&sources, &weights)?;
            let distances: Vec<f64> = self
                .points
                .iter()
                .zip(&sources)
                .map(|(prior, source)| (fitted.act(source) - prior.position_in_world).norm())
                .collect();
            let mut sorted = distances.clone();
            sorted.sort_by(f64::total_cmp);
            let least = (LEAST_SHARE * sorted[sorted.len() / 2]).max(f64::MIN_POSITIVE);
            for ((weight, distance), stiffness) in weights.iter_mut().zip(distances).zip(&stiffness)
            {
                *weight = stiffness / distance.max(least);
            }
            motion = Some(fitted);
        }
        motion
    }

    /// The motion that minimizes Σ w ‖T x − z‖²; `None` where the points leave it open.
    fn closed_form<const D: usize>(&self, sources: &[Vector3<f64>], weights: &[f64]) -> Option<G>
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
        let turn = G::from_matrix(&covariance, &SVector::zeros())?;
        let rotation = turn.rotation_matrix();
        let motion = G::from_matrix(&rotation, &(target - rotation * source))?;
        motion.is_finite().then_some(motion)
    }
}
