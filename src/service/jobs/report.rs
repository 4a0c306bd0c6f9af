//! Reports: what is kept of a job's work as JSON, for people and scripts.
//!
//! The keys of a solve are those of `covis solve --json`; numbers have all their digits. Nothing is
//! computed here.

use covis_solvers::evaluation::Quantity;
use covis_solvers::reconstruction::Scale;
use serde_json::{Value, json};

use crate::service::convert::solve::to_residual_kind;
use crate::wire::v1;

/// Microseconds in a second.
const MICROSECONDS: f64 = 1e6;

/// The keys of a solve.
pub(super) fn solve(summary: Option<&v1::SolveSummary>, rows: &[v1::IterationSummary]) -> Value {
    let Some(summary) = summary else { return json!({}) };
    let iterations: Vec<Value> = rows.iter().map(row).collect();
    let residuals: Vec<Value> = summary.residuals.iter().map(residual).collect();
    let converged = matches!(
        summary.termination(),
        v1::Termination::ConvergedFunction
            | v1::Termination::ConvergedGradient
            | v1::Termination::ConvergedParameter
    );
    json!({
        "initial_cost": summary.initial_cost,
        "final_cost": summary.final_cost,
        "iterations": iterations,
        "solve_seconds": summary.solve_duration_us as f64 / MICROSECONDS,
        "termination": summary.description,
        "converged": converged,
        "threads": summary.thread_count,
        "gradient_max_norm": summary.gradient_max_norm,
        "linear_residual": summary.linear_residual,
        "residuals": residuals,
    })
}

/// The keys of a reconstruction: those of `rebuilt` in `covis solve --json`.
pub(super) fn reconstruction(found: Option<&v1::Reconstruction>) -> Value {
    let Some(found) = found else { return json!({}) };
    let unplaced: Vec<Value> = found
        .unplaced_keyframes
        .iter()
        .map(|keyframe| {
            let client = Some(&keyframe.client_id).filter(|client| !client.is_empty());
            json!({ "client": client, "id": keyframe.id, "reason": keyframe.reason })
        })
        .collect();
    let scale = match found.length_unit() {
        v1::LengthUnit::Unspecified => "",
        v1::LengthUnit::Depth => Scale::Depth.name(),
        v1::LengthUnit::RelativePoses => Scale::RelativePoses.name(),
        v1::LengthUnit::Given => Scale::Given.name(),
        v1::LengthUnit::Convention => Scale::Convention.name(),
    };
    json!({ "rebuilt": {
        "keyframes": found.keyframe_count,
        "placed": found.placed_keyframe_count,
        "unplaced": unplaced,
        "landmarks": found.landmark_count,
        "placed_landmarks": found.placed_landmark_count,
        "observations": found.observation_count,
        "dropped_observations": found.observation_count - found.agreeing_observation_count,
        "pairs": found.pair_count,
        "measured_pairs": found.measured_pair_count,
        "relative_poses": found.relative_pose_count,
        "scale": scale,
    }})
}

fn row(row: &v1::IterationSummary) -> Value {
    json!({
        "iteration": row.iteration,
        "cost": row.cost,
        "seconds": row.elapsed_us as f64 / MICROSECONDS,
        "accepted": row.accepted,
        "damping": row.damping,
        "gradient_max_norm": row.gradient_max_norm,
        "step_norm": row.step_norm,
        "step_quality": row.step_quality,
    })
}

fn residual(residual: &v1::ResidualStatistics) -> Value {
    let is_its = |quantity: &Quantity| to_residual_kind(*quantity) == residual.kind();
    let quantity = Quantity::ALL.into_iter().find(is_its);
    let (name, unit) = quantity.map_or(("unknown", ""), |of| (of.name(), of.unit()));
    json!({
        "quantity": name,
        "unit": unit,
        "count": residual.factor_count,
        "initial_rms": residual.initial_rms,
        "final_rms": residual.final_rms,
        "redundant_count": residual.redundant_count,
        "reduced_chi2": residual.reduced_chi2,
        "outlier_share": residual.outlier_share,
        "sigma_ratio": residual.sigma_ratio,
        "hint": Some(&residual.hint).filter(|hint| !hint.is_empty()),
    })
}

/// Adds the keys of another object.
pub(super) fn join(object: &mut Value, more: Value) {
    if let (Value::Object(object), Value::Object(more)) = (object, more) {
        object.extend(more);
    }
}
