//! Checks of the factors that touch poses alone, the same in a bundle as in a pose graph.
//!
//! An index must name a pose, a measurement be finite, and a loss have a width. The first factor that
//! is wrong is named by its kind and its place. Nothing is evaluated here.

use super::SolveError;
use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::LieGroup;
use crate::loss::Loss;

type Outcome = Result<(), SolveError>;

/// Checks the factors between poses, which errors call `factor`; there are `count` poses.
pub(super) fn check_relative_poses<G: LieGroup<N>, const N: usize>(
    factor: &'static str,
    factors: &[RelativePose<G, N>],
    count: usize,
) -> Outcome {
    for (index, edge) in factors.iter().enumerate() {
        let loss = edge.loss.unwrap_or_default();
        check_pose(factor, index, edge.i, count)?;
        check_pose(factor, index, edge.j, count)?;
        check(factor, index, edge.i_from_j.is_finite(), loss)?;
    }
    Ok(())
}

/// Checks the priors of both kinds.
pub(super) fn check_priors<G: LieGroup<N>, const N: usize>(
    pose_priors: &[PosePrior<G, N>],
    position_priors: &[PositionPrior],
    count: usize,
) -> Outcome {
    for (index, prior) in pose_priors.iter().enumerate() {
        check_pose("pose prior", index, prior.pose, count)?;
        check("pose prior", index, prior.world_from_camera.is_finite(), prior.loss)?;
    }
    for (index, prior) in position_priors.iter().enumerate() {
        check_pose("position prior", index, prior.pose, count)?;
        check("position prior", index, prior.is_finite(), prior.loss)?;
    }
    Ok(())
}

fn check_pose(factor: &'static str, index: usize, value: usize, count: usize) -> Outcome {
    if value < count {
        return Ok(());
    }
    Err(SolveError::IndexOutOfRange { factor, index, variable: "pose", value, count })
}

fn check(factor: &'static str, index: usize, is_finite: bool, loss: Loss) -> Outcome {
    if !is_finite {
        return Err(SolveError::NotFinite { what: factor, index: index as i64 });
    }
    if loss.is_valid() { Ok(()) } else { Err(SolveError::BadLoss { factor, index }) }
}
