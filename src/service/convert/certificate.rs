//! The certificate of a solve: the loop's summary combined with the evaluator's cost reports.

use covis_solvers::evaluation::{CostReport, FactorCost};

use super::count;
use crate::wire::v1;

/// Fills costs by kind of factor, pixel errors and points behind their cameras.
pub(in crate::service) fn add_costs(
    summary: &mut v1::SolveSummary,
    before: &CostReport,
    after: &CostReport,
) {
    let kinds: [(v1::FactorKind, FactorCost, FactorCost); 5] = [
        (v1::FactorKind::Reprojection, before.reprojection, after.reprojection),
        (v1::FactorKind::DepthReprojection, before.depth_reprojection, after.depth_reprojection),
        (v1::FactorKind::RelativePose, before.relative_pose, after.relative_pose),
        (v1::FactorKind::PosePrior, before.pose_prior, after.pose_prior),
        (v1::FactorKind::PositionPrior, before.position_prior, after.position_prior),
    ];
    summary.factor_costs = kinds
        .into_iter()
        .filter(|(_, before, _)| before.count > 0)
        .map(|(kind, before, after)| v1::FactorCost {
            kind: kind.into(),
            factor_count: count(before.count),
            initial_cost: before.cost,
            final_cost: after.cost,
        })
        .collect();
    let observations = before.reprojection.count + before.depth_reprojection.count;
    summary.reprojection = (observations > 0).then_some(v1::ReprojectionStatistics {
        observation_count: count(observations),
        initial_rmse_px: before.rmse_px,
        final_rmse_px: after.rmse_px,
    });
    summary.behind_camera_observation_count = count(after.behind_camera);
}
