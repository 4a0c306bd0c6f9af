//! Pose graphs solved to a certified global optimum of the chordal objective (SE-Sync).
//!
//! F = Σ κ ‖R_j − R_i R_Z‖² + τ ‖t_j − t_i − R_i t_Z‖² with the isotropic precisions of
//! [`IsotropicPrecision`]: not the Log objective of [`crate::pose_graph`], whose optimum it therefore
//! never certifies, but the best start known for it. A local solve (`manifold`) on the quadratic form
//! of the graph (`quadratic`) is checked by its dual (`dual`). Where the check fails, one more row is
//! given to the rotations and the solve goes on from the direction of negative curvature (the
//! Riemannian staircase, Boumal 2015); the result is rounded and solved once more.

mod dual;
mod manifold;
mod quadratic;

use dual::{dual, gradient_max};
use manifold::{Problem, retract};
use nalgebra::DMatrix;
use quadratic::{Lifted, data_matrix};

use crate::geometry::RigidMotion;
pub use crate::initialization::IsotropicPrecision;
use crate::linear::{BlockPattern, LinearError};
use crate::optimizer::from_linear;
use crate::order;
use crate::price::{Ceiling, Limits};
use crate::problem::{PoseGraph, SolveError};

/// Rows that may be added to the rotations.
const MAX_LIFTS: usize = 5;

/// The gradient's largest entry at the end, over the largest diagonal entry of M.
const GRADIENT_TOLERANCE: f64 = 1e-10;

/// A state counts as certified where its cost is proved to be within this share of the optimum.
const CERTIFIED_GAP: f64 = 1e-6;

/// What is proved of the chordal cost of the poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// Whether `gap` is at most a millionth of `cost`, or as small as rounding lets it be proved.
    pub certified: bool,
    /// F at the poses, without a factor ½.
    pub cost: f64,
    /// No state has an F below `cost` − `gap`.
    pub gap: f64,
    /// The smallest eigenvalue of the dual certificate beside the known zeros, estimated; negative
    /// where there is a better state.
    pub min_eigenvalue: f64,
    /// The largest entry of the Riemannian gradient.
    pub gradient_max_norm: f64,
    /// Rows beyond D that the rotations were given on the way.
    pub lifts: usize,
}

/// Bytes besides the two factors: the matrix and the dual's, states, and the vectors of Lanczos.
fn linear_bytes<const D: usize>(pattern: &BlockPattern) -> u64 {
    let rows = 2 * (D + MAX_LIFTS) + 8 * (D + MAX_LIFTS) + dual::LANCZOS_STEPS + 8;
    let matrices = 2 * 8 * pattern.value_count() as u64;
    matrices + 8 * (rows * pattern.dimension()) as u64 + pattern.bytes()
}

/// Moves the poses of `graph` to the best state of the chordal objective that is found from where
/// they are, and says what is proved of it.
///
/// The first constant pose, or the one with the lowest id, stays where it is. The graph's loss does
/// not count. Start near a good state: [`crate::initialization::chordal`]. `graph` is untouched after
/// an error.
///
/// # Errors
/// Those of [`PoseGraph::validate`]; [`SolveError::InvalidOption`] where several poses are constant or
/// there are priors or landmarks, since the objective knows one gauge; [`SolveError::TooLarge`],
/// [`SolveError::TooExpensive`], [`SolveError::Interrupted`].
pub fn certify<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    limits: Limits<'_>,
) -> Result<Certificate, SolveError> {
    graph.validate()?;
    if graph.constant.iter().filter(|&&constant| constant).count() > 1 {
        let reason = "a graph with several constant poses cannot be certified";
        return Err(SolveError::InvalidOption { field: "certify", reason });
    }
    if graph.has_priors() {
        let reason = "a graph with priors cannot be certified";
        return Err(SolveError::InvalidOption { field: "certify", reason });
    }
    if graph.has_measured() {
        let reason = "a graph with landmarks or ranges cannot be certified";
        return Err(SolveError::InvalidOption { field: "certify", reason });
    }
    let matrix = data_matrix(graph);
    let dimension = matrix.pattern().dimension();
    let failed = |error: LinearError| from_linear(error, dimension);
    // Half of what is left is for the dual, whose factor is of the same size.
    let linear = linear_bytes::<D>(matrix.pattern());
    let rest = limits.less(linear);
    let half = Ceiling { bytes: rest.ceiling.bytes.map(|bytes| bytes / 2), ..rest.ceiling };
    let each = Limits { ceiling: half, ..limits };
    let mut problem =
        Problem::new(&matrix, each).map_err(|error| failed(error).twice().beside(linear))?;
    let interrupted = || match limits.interrupt.is_due() {
        true => Err(SolveError::Interrupted),
        false => Ok(()),
    };
    let count = graph.poses.len();
    let mut x = Lifted::of::<G, D, N>(&graph.poses);
    let mut cost = problem.minimize::<D>(&mut x, GRADIENT_TOLERANCE);
    interrupted()?;
    // Below this, the factorization would prove its own rounding.
    let rounding = 1e-13 * matrix.diagonal().iter().fold(0.0_f64, |m, d| m.max(*d));
    let margin = |cost: f64| (0.1 * CERTIFIED_GAP * cost / (D * count) as f64).max(rounding);
    let mut lifts = 0;
    let mut proof = dual::<D>(&matrix, &x, margin(cost), limits.interrupt).map_err(failed)?;
    // The margins tried are a tenth of the largest that will do, then ten times that: give or take
    // its rounding.
    let largest = (1.0 + 1e-9) * CERTIFIED_GAP;
    let is_proved = |cost: f64, margin: f64| {
        margin * (D * count) as f64 <= largest * cost || margin <= 10.0 * rounding
    };
    while !is_proved(cost, proof.margin) && lifts < MAX_LIFTS && proof.min_eigenvalue < 0.0 {
        lifts += 1;
        descend::<D>(&mut x, &proof.direction, &matrix, cost);
        cost = problem.minimize::<D>(&mut x, GRADIENT_TOLERANCE);
        interrupted()?;
        proof = dual::<D>(&matrix, &x, margin(cost), limits.interrupt).map_err(failed)?;
    }
    if lifts > 0 {
        x = rounded::<G, D, N>(&x);
        cost = problem.minimize::<D>(&mut x, GRADIENT_TOLERANCE);
        interrupted()?;
        proof = dual::<D>(&matrix, &x, margin(cost), limits.interrupt).map_err(failed)?;
    }
    write_back(graph, &x)?;
    Ok(Certificate {
        certified: is_proved(cost, proof.margin),
        cost,
        gap: proof.margin * (D * count) as f64,
        min_eigenvalue: proof.min_eigenvalue,
        gradient_max_norm: gradient_max::<D>(&matrix, &x),
        lifts,
    })
}

/// Adds a row to `x` along `direction`, as far as it lowers the cost most.
fn descend<const D: usize>(
    x: &mut Lifted,
    direction: &[f64],
    matrix: &crate::linear::BlockMatrix,
    cost: f64,
) {
    x.rows.push(vec![0.0; direction.len()]);
    let last = x.rows.len() - 1;
    let largest = direction.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
    let mut best: Option<(f64, Lifted)> = None;
    let mut length = 1.0 / largest.max(f64::MIN_POSITIVE);
    for _ in 0..30 {
        let mut trial = x.clone();
        trial.rows[last].iter_mut().zip(direction).for_each(|(x, d)| *x = length * d);
        retract::<D>(&mut trial);
        let value = trial.dot(&trial.times(matrix));
        let is_better = best.as_ref().is_none_or(|(best, _)| value < *best);
        if value < cost && is_better {
            best = Some((value, trial));
        } else if best.is_some() {
            break;
        }
        length *= 0.5;
    }
    if let Some((_, trial)) = best {
        *x = trial;
    }
}

/// The state with D rows nearest to `x` up to a rotation: its dominant directions.
fn rounded<G: RigidMotion<D, N>, const D: usize, const N: usize>(x: &Lifted) -> Lifted {
    let rows = x.rows.len();
    let length = x.rows[0].len();
    let gram = DMatrix::from_fn(rows, rows, |a, b| {
        let rotation = |k: &usize| k % (D + 1) != D;
        (0..length).filter(rotation).map(|k| x.rows[a][k] * x.rows[b][k]).sum::<f64>()
    });
    let eigen = gram.symmetric_eigen();
    let mut order: Vec<usize> = (0..rows).collect();
    order::sort_by(&mut order, &mut |a, b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let mut result = Lifted { rows: vec![vec![0.0; length]; D] };
    for (target, &column) in result.rows.iter_mut().zip(&order) {
        for (r, source) in x.rows.iter().enumerate() {
            let share = eigen.eigenvectors[(r, column)];
            target.iter_mut().zip(source).for_each(|(t, s)| *t += share * s);
        }
    }
    // Most rotations must be proper: a mirrored basis is turned.
    let count = length / (D + 1);
    let is_proper = |&i: &usize| {
        let rotation = result.rotation::<D>(i);
        DMatrix::from_fn(D, D, |r, c| rotation[(r, c)]).determinant() > 0.0
    };
    if 2 * (0..count).filter(is_proper).count() < count {
        result.rows[0].iter_mut().for_each(|x| *x = -*x);
    }
    for i in 0..count {
        let nearest = G::from_matrix(&result.rotation::<D>(i), &result.translation::<D>(i));
        let rotation = nearest.unwrap_or_else(G::identity).rotation_matrix();
        for (r, row) in result.rows.iter_mut().enumerate() {
            for c in 0..D {
                row[(D + 1) * i + c] = rotation[(r, c)];
            }
        }
    }
    result
}

/// Moves the whole state so that the gauge stands where it stood, and stores it.
fn write_back<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    x: &Lifted,
) -> Result<(), SolveError> {
    let mut poses = Vec::with_capacity(graph.poses.len());
    for (i, &id) in graph.ids.iter().enumerate() {
        let pose = G::from_matrix(&x.rotation::<D>(i), &x.translation::<D>(i));
        poses.push(pose.ok_or(SolveError::Singular { what: "rotation of pose", id })?);
    }
    if let Some(&gauge) = graph.held().first() {
        let held = graph.poses[gauge];
        let moved = held.compose(&poses[gauge].inverse());
        poses.iter_mut().for_each(|pose| *pose = moved.compose(pose));
        poses[gauge] = held;
    }
    graph.poses = poses;
    Ok(())
}
