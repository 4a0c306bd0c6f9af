//! The motion that brings an estimate to the truth before they are compared, as evo's `-a`, `-as`, `-s` and
//! `--align_origin` have it.
//!
//! S minimizes Σ ‖y − c R x − t‖² over the positions x of the estimate and y of the truth (Umeyama,
//! "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991,
//! equations 34 to 43): with C = 1/n Σ (y − ȳ)(x − x̄)ᵀ = U D Vᵀ and S = diag(1, 1, ±1), its sign that of
//! det U · det V, it is R = U S Vᵀ, c = tr(D S) / σ², σ² = 1/n Σ ‖x − x̄‖², and t = ȳ − c R x̄.
//! [`align_poses`] aligns whole poses instead, of which one is enough.

use std::num::NonZeroUsize;

use covis_solvers::geometry::{LieGroup, Se3, Sim3, So3};
use nalgebra::{Matrix3, SVD, Vector3};

use super::{EvaluationError, Pair};

/// What of the motion between estimate and truth is corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Correction {
    /// Nothing: both are in one frame already.
    None,
    /// Rotation and translation (evo's `-a`).
    #[default]
    Se3,
    /// Rotation, translation and scale (evo's `-as`), as the trajectory of one camera needs it.
    Sim3,
    /// The scale alone, about the origin (evo's `-s`).
    Scale,
    /// The first matched pose becomes the true one (evo's `--align_origin`).
    Origin,
}

impl Correction {
    /// Whether it finds a scale.
    #[must_use]
    pub fn has_scale(self) -> bool {
        matches!(self, Self::Sim3 | Self::Scale)
    }

    /// Whether it is fitted to positions, of which a part may be used.
    #[must_use]
    pub fn is_fitted(self) -> bool {
        matches!(self, Self::Se3 | Self::Sim3 | Self::Scale)
    }
}

/// How an estimate is aligned; by default in SE(3) by all matched poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alignment {
    /// What is corrected.
    pub correction: Correction,
    /// Fit to this many matched poses from the start (evo's `--n_to_align`): to all where it is `None`, or
    /// where fewer are matched.
    pub first_poses: Option<NonZeroUsize>,
}

impl Alignment {
    /// Leaves the estimate as it is.
    pub const NONE: Self = Self { correction: Correction::None, first_poses: None };

    /// `truth_from_estimate` of matched poses.
    ///
    /// # Errors
    /// [`EvaluationError::Degenerate`] where the positions do not determine it.
    pub(super) fn of(self, pairs: &[Pair]) -> Result<Sim3, EvaluationError> {
        let most = self.first_poses.map_or(pairs.len(), NonZeroUsize::get);
        let fit = |with_scale| umeyama(&pairs[..most.min(pairs.len())], with_scale);
        match self.correction {
            Correction::None => Ok(Sim3::identity()),
            Correction::Se3 => fit(false),
            Correction::Sim3 => fit(true),
            Correction::Scale => Ok(Sim3::new(So3::identity(), Vector3::zeros(), fit(true)?.scale)),
            Correction::Origin => {
                let origin = |pair: &Pair| pair.truth.compose(&pair.estimate.inverse());
                Ok(pairs.first().map_or_else(Sim3::identity, |pair| origin(pair).into()))
            }
        }
    }

    /// Aligns the estimates of `pairs`. Gives `truth_from_estimate`.
    ///
    /// # Errors
    /// [`EvaluationError::Degenerate`] where the positions do not determine it.
    pub(super) fn apply(self, pairs: &mut [Pair]) -> Result<Sim3, EvaluationError> {
        let truth_from_estimate = self.of(pairs)?;
        self.move_poses(&truth_from_estimate, pairs.iter_mut().map(|pair| &mut pair.estimate));
        Ok(truth_from_estimate)
    }

    /// Moves poses by what [`Self::of`] found. Without a correction they keep their bits.
    pub(super) fn move_poses<'a>(
        self,
        truth_from_estimate: &Sim3,
        poses: impl Iterator<Item = &'a mut Se3>,
    ) {
        if self.correction != Correction::None {
            poses.for_each(|pose| *pose = truth_from_estimate.transform_pose(pose));
        }
    }
}

/// The similarity, or the motion without a scale, that aligns the positions of the estimates to the true
/// ones.
///
/// # Errors
/// [`EvaluationError::Degenerate`] where fewer than two singular values of C exceed the machine
/// epsilon (evo's bound): the positions lie on a line, or are fewer than three.
pub(super) fn umeyama(pairs: &[Pair], with_scale: bool) -> Result<Sim3, EvaluationError> {
    if pairs.is_empty() {
        return Err(EvaluationError::Degenerate { pairs: 0, rank: 0 });
    }
    let count = pairs.len() as f64;
    let mean = |of: fn(&Pair) -> &Se3| {
        pairs.iter().map(|pair| of(pair).translation).sum::<Vector3<f64>>() / count
    };
    let (truth_mean, estimate_mean) = (mean(|pair| &pair.truth), mean(|pair| &pair.estimate));
    let (mut covariance, mut variance) = (Matrix3::zeros(), 0.0);
    for pair in pairs {
        let x = pair.estimate.translation - estimate_mean;
        covariance += (pair.truth.translation - truth_mean) * x.transpose();
        variance += x.norm_squared();
    }
    let svd = SVD::new(covariance / count, true, true);
    let rank = svd.singular_values.iter().filter(|&&s| s > f64::EPSILON).count();
    let (Some(u), Some(v_transposed), 2..) = (svd.u, svd.v_t, rank) else {
        return Err(EvaluationError::Degenerate { pairs: pairs.len(), rank });
    };
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    if u.determinant() * v_transposed.determinant() < 0.0 {
        // Singular values come in falling order: the last direction is the one that is flipped.
        signs.z = -1.0;
    }
    let rotation = So3::from_matrix(&(u * Matrix3::from_diagonal(&signs) * v_transposed));
    let scale = if with_scale { svd.singular_values.dot(&signs) / (variance / count) } else { 1.0 };
    Ok(Sim3::new(rotation, truth_mean - rotation.rotate(&estimate_mean) * scale, scale))
}

/// The rigid motion a_from_b that fits the pairs of poses best: the rotation nearest to the mean of the
/// rotations between them (Moakher, SIAM J. Matrix Anal. 2002), then the mean of the translations.
/// `None` without pairs.
#[must_use]
pub fn align_poses<'a>(pairs: impl Iterator<Item = (&'a Se3, &'a Se3)> + Clone) -> Option<Se3> {
    let (mut sum, mut count) = (Matrix3::zeros(), 0.0);
    for (a, b) in pairs.clone() {
        sum += a.rotation.compose(&b.rotation.inverse()).matrix();
        count += 1.0;
    }
    if count == 0.0 {
        return None;
    }
    let rotation = So3::from_matrix(&sum);
    let mean = pairs.map(|(a, b)| a.translation - rotation.rotate(&b.translation));
    let translation = mean.fold(Vector3::zeros(), |sum, t| sum + t) / count;
    Some(Se3::new(rotation, translation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_worlds_are_aligned_by_the_poses_that_both_have() {
        let at = |x: f64| {
            Se3::new(So3::exp(&Vector3::new(0.3, x, -0.2)), Vector3::new(x, 2.0 * x, 1.0 - x))
        };
        let truth = Se3::new(So3::exp(&Vector3::new(2.0, -1.0, 0.5)), Vector3::new(5.0, 6.0, 7.0));
        let b = [0.0, 0.5, 1.0].map(at);
        let a = b.map(|pose| truth.compose(&pose));
        let found = align_poses(a.iter().zip(&b)).unwrap();
        assert!(found.inverse().compose(&truth).log().amax() < 1e-12, "{found:?}");
        // One pair is enough.
        let found = align_poses(a[..1].iter().zip(&b)).unwrap();
        assert!(found.inverse().compose(&truth).log().amax() < 1e-12, "{found:?}");
        assert_eq!(align_poses(a[..0].iter().zip(&b)), None);
    }
}
