//! What `covis replay` prints: one JSON object, or lines for people.
//!
//! Figures are the server's own, from the certificate of `OptimizeMap`; nothing is computed here.

use serde::Serialize;

use super::levels::{Keyframes, Levels};
use crate::client::IngestReport;
use crate::wire::v1;

/// The object of `--json`. Sent to rejected are numbers of items, received to optimized of
/// keyframes; the rest is of the optimized problem and missing where it did not come to that.
#[derive(Debug, Serialize)]
struct Document<'a> {
    map: &'a str,
    sent: u64,
    acknowledged: u64,
    rejected: u64,
    #[serde(flatten)]
    keyframes: Keyframes,
    #[serde(flatten)]
    solved: Option<Solved>,
}

#[derive(Debug, Serialize)]
struct Solved {
    cameras: i64,
    landmarks: i64,
    observations: i64,
    cost_before: f64,
    cost_after: f64,
    rmse_px_before: f64,
    rmse_px_after: f64,
}

/// The JSON object.
pub(super) fn json(
    map: &str,
    levels: &Levels,
    solved: Option<(&v1::OptimizeMapResult, &v1::SolveSummary)>,
) -> anyhow::Result<String> {
    let [sent, acknowledged, rejected] = levels.items();
    let solved = solved.map(|(result, summary)| {
        let rmse = summary.reprojection.unwrap_or_default();
        Solved {
            cameras: result.camera_count,
            landmarks: result.landmark_count,
            observations: result.observation_count,
            cost_before: summary.initial_cost,
            cost_after: summary.final_cost,
            rmse_px_before: rmse.initial_rmse_px,
            rmse_px_after: rmse.final_rmse_px,
        }
    });
    let keyframes = levels.keyframes();
    let document = Document { map, sent, acknowledged, rejected, keyframes, solved };
    Ok(serde_json::to_string(&document)?)
}

/// The lines for people.
pub(super) fn table(
    map: &str,
    report: &IngestReport,
    levels: &Levels,
    result: &v1::OptimizeMapResult,
    summary: &v1::SolveSummary,
) -> String {
    let rmse = summary.reprojection.unwrap_or_default();
    let mut lines = vec![
        format!(
            "map {map}: {} cameras, {} keyframes, {} landmarks, {} observations",
            result.camera_count,
            result.keyframe_count,
            result.landmark_count,
            result.observation_count
        ),
        format!(
            "items: {} sent, {} acknowledged ({} of them known already), {} rejected",
            report.sent, report.acknowledged, report.duplicates, report.rejected
        ),
    ];
    let Keyframes { received, durable, optimized } = levels.keyframes();
    lines.push(format!("keyframes: {received} received, {durable} durable, {optimized} optimized"));
    if report.reconnects > 0 {
        lines.push(format!("the link broke {} times and was resumed", report.reconnects));
    }
    if report.failed_solves > 0 {
        lines.push(format!("{} local solves failed", report.failed_solves));
    }
    lines.extend([
        String::new(),
        format!("{:>8}  {:>18}  {:>10}", "", "cost", "rmse (px)"),
        row("before", summary.initial_cost, rmse.initial_rmse_px),
        row("after", summary.final_cost, rmse.final_rmse_px),
        String::new(),
        format!(
            "{} after {} iterations, {:.3} s",
            summary.description,
            summary.iteration_count,
            summary.solve_duration_us as f64 * 1e-6
        ),
    ]);
    lines.join("\n")
}

fn row(name: &str, cost: f64, rmse_px: f64) -> String {
    format!("{name:>8}  {cost:>18.6}  {rmse_px:>10.6}")
}
