//! Brings two trajectories together: pairs of poses by timestamp, as evo's `associate_trajectories`
//! finds them, and the rigid motion from one to the other (Umeyama 1991, without scale).
//!
//! The trajectory with fewer poses walks (the estimate, where both have as many) and takes for each
//! of its stamps the nearest of the other within the limit, inclusive; of two equally near ones the
//! earlier. Nothing is unique: two stamps may take the same partner. Differences are plain f64 of
//! the stamps as they are, without an offset, so that the same ones pass the limit as in evo. No pose
//! is interpolated.

use covis_solvers::geometry::{Se3, So3};
use nalgebra::{Matrix3, SVD, Vector3};

use super::EvaluationError;

/// The matched pairs (index in `truth`, index in `estimate`) in the walker's order.
pub(super) fn associate(
    truth: &[f64],
    estimate: &[f64],
    max_difference_s: f64,
) -> Vec<(usize, usize)> {
    if estimate.len() > truth.len() {
        walk(truth, estimate, max_difference_s)
    } else {
        let pairs = walk(estimate, truth, max_difference_s);
        pairs.into_iter().map(|(estimate, truth)| (truth, estimate)).collect()
    }
}

/// For each stamp of `walker` that has one: its index and its partner's in `searched`.
fn walk(walker: &[f64], searched: &[f64], max_difference: f64) -> Vec<(usize, usize)> {
    let nearest = if searched.is_sorted() { nearest_in_sorted } else { nearest_in_unsorted };
    let pair = |(index, &stamp)| Some((index, nearest(searched, stamp, max_difference)?));
    walker.iter().enumerate().filter_map(pair).collect()
}

/// Binary search; past the end the last stamp is the candidate, which the range check bounds.
fn nearest_in_sorted(searched: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
    let (first, last) = (searched.first()?, searched.last()?);
    if stamp < first - max_difference || stamp > last + max_difference {
        return None;
    }
    let after = searched.partition_point(|&s| s <= stamp).min(searched.len() - 1);
    let above = searched[after] - stamp;
    let below = if after > 0 { stamp - searched[after - 1] } else { f64::INFINITY };
    if above <= max_difference && above < below {
        Some(after)
    } else if below <= max_difference && below <= above {
        Some(after - 1)
    } else {
        None
    }
}

/// Linear search: the first of the nearest stamps.
fn nearest_in_unsorted(searched: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
    let distance = |s: &f64| (s - stamp).abs();
    let (index, nearest) =
        searched.iter().enumerate().min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) <= max_difference).then_some(index)
}

/// The motion `truth_from_estimate` that aligns `estimate` to `truth`, point k to point k.
///
/// T minimizes Σ ‖y − T x‖²: with C = 1/n Σ (y − ȳ)(x − x̄)ᵀ = U D Vᵀ it is
/// R = U diag(1, 1, ±1) Vᵀ, t = ȳ − R x̄, the sign that of det U · det V.
///
/// # Errors
/// [`EvaluationError::Degenerate`] where fewer than two singular values of C exceed the machine
/// epsilon (evo's bound): the points lie on a line, or are fewer than three.
pub(super) fn align(
    truth: &[Vector3<f64>],
    estimate: &[Vector3<f64>],
) -> Result<Se3, EvaluationError> {
    let pairs = truth.len().min(estimate.len());
    let mean =
        |points: &[Vector3<f64>]| points.iter().take(pairs).sum::<Vector3<f64>>() / pairs as f64;
    let (truth_mean, estimate_mean) = (mean(truth), mean(estimate));
    let centered = truth.iter().zip(estimate).map(|(y, x)| (y - truth_mean, x - estimate_mean));
    let covariance = centered.map(|(y, x)| y * x.transpose()).sum::<Matrix3<f64>>() / pairs as f64;
    let svd = SVD::new(covariance, true, true);
    let rank = svd.singular_values.iter().filter(|&&s| s > f64::EPSILON).count();
    let (Some(u), Some(v_transposed), 2..) = (svd.u, svd.v_t, rank) else {
        return Err(EvaluationError::Degenerate { pairs, rank });
    };
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    if u.determinant() * v_transposed.determinant() < 0.0 {
        // Singular values come in falling order: the last direction is the one that is flipped.
        signs.z = -1.0;
    }
    let rotation = So3::from_matrix(&(u * Matrix3::from_diagonal(&signs) * v_transposed));
    Ok(Se3::new(rotation, truth_mean - rotation.rotate(&estimate_mean)))
}
