//! Observations of the landmarks that the removed pose sees, and the basis that eliminates one.
//!
//! With J the whitened Jacobian of a landmark's observations by the poses and Q an orthonormal basis
//! of the columns of that by the landmark, Jᵀ(I − QQᵀ)J is what they say of the poses when the
//! landmark is eliminated. Nothing is squared or inverted: parallax of a billionth still counts, and
//! a landmark with one view says nothing, whatever directions that view leaves open. No estimate is
//! moved.

use nalgebra::{Matrix3, SMatrix};

use crate::problem::{BundleProblem, Observation};

/// A column of Q that keeps less than this of the largest one, when those before it are projected
/// out, depends on them.
const DEPENDENT: f64 = 1e-9;

/// An observation, whitened and weighted; a plain one has a third row of zeros.
pub(super) struct WhitenedObservation {
    pub(super) landmark: usize,
    pub(super) pose: usize,
    pub(super) d_pose: SMatrix<f64, 3, 6>,
    pub(super) d_landmark: Matrix3<f64>,
}

/// The usable observations of the landmarks that pose `removed` observes, by landmark.
pub(super) fn views(problem: &BundleProblem, removed: usize) -> Vec<WhitenedObservation> {
    let mut is_seen = vec![false; problem.landmarks.len()];
    for o in problem.observations() {
        is_seen[o.landmark as usize] |= o.pose as usize == removed;
    }
    let seen = problem.observations().filter(|o| is_seen[o.landmark as usize]);
    let mut views: Vec<WhitenedObservation> = seen.filter_map(|o| view(problem, &o)).collect();
    views.sort_by_key(|view| view.landmark);
    views
}

/// The views of each landmark that both the removed pose and another one see.
pub(super) fn tracks(views: &[WhitenedObservation], removed: usize) -> Vec<&[WhitenedObservation]> {
    let is_shared = |track: &&[WhitenedObservation]| {
        let of_removed = track.iter().filter(|view| view.pose == removed).count();
        of_removed > 0 && of_removed < track.len()
    };
    views.chunk_by(|a, b| a.landmark == b.landmark).filter(is_shared).collect()
}

/// One observation, unless its landmark is behind its camera, its loss gives it no weight or its
/// Jacobians are not finite.
fn view(problem: &BundleProblem, observation: &Observation) -> Option<WhitenedObservation> {
    let (pose, landmark) = (observation.pose as usize, observation.landmark as usize);
    let (world_from_camera, point) = (&problem.poses[pose], &problem.landmarks[landmark]);
    if world_from_camera.inverse_transform(point).z <= 0.0 {
        return None;
    }
    let camera = &problem.cameras[observation.camera as usize];
    let lin = observation.seen.linearize(world_from_camera, camera, point)?;
    let root = problem.observation_loss.evaluate(lin.residual.norm_squared()).weight.sqrt();
    let (d_pose, d_landmark) = (lin.d_pose * root, lin.d_landmark * root);
    let is_finite = d_pose.iter().chain(d_landmark.iter()).all(|x| x.is_finite());
    (root > 0.0 && is_finite).then_some(WhitenedObservation { landmark, pose, d_pose, d_landmark })
}

/// Makes the three columns of the stacked matrices orthonormal, or zero where they depend on those
/// before them: Gram and Schmidt, twice each.
pub(super) fn orthonormalize(rows: &mut [Matrix3<f64>]) {
    let dot = |rows: &[Matrix3<f64>], a: usize, b: usize| -> f64 {
        rows.iter().map(|row| row.column(a).dot(&row.column(b))).sum()
    };
    let largest = (0..3).map(|c| dot(rows, c, c)).fold(0.0, f64::max).sqrt();
    for column in 0..3 {
        for before in (0..column).chain(0..column) {
            let share = dot(rows, before, column);
            for row in rows.iter_mut() {
                let projection = row.column(before) * share;
                row.column_mut(column).axpy(-1.0, &projection, 1.0);
            }
        }
        let norm = dot(rows, column, column).sqrt();
        let factor = if norm > DEPENDENT * largest { 1.0 / norm } else { 0.0 };
        rows.iter_mut().for_each(|row| row.column_mut(column).scale_mut(factor));
    }
}
