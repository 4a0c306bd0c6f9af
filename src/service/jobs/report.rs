//! Reports: what is kept of a job's work as JSON, for people and scripts.
//!
//! The keys of a solve are those of `covis solve --json`; numbers have all their digits. Nothing is
//! computed here. The report of several problems is joined of theirs as texts: read again, a number might
//! differ in its last bit.

use std::io::{self, Write};

use covis_solvers::evaluation::Quantity;
use serde_json::{Value, json};

use crate::service::convert::solve::to_residual_kind;
use crate::service::engine::Rebuilt;
use crate::wire::v1;

/// A report as a file.
pub(super) fn to_text(report: &Value) -> Vec<u8> {
    // A value that is made here can be written.
    let mut text = serde_json::to_vec_pretty(report).unwrap_or_default();
    text.push(b'\n');
    text
}

/// Writes the report of problems whose own reports are texts, which `read` gives: of one problem its own.
/// Returns its length, bytes.
///
/// # Errors
/// Those of `read` and of `out`.
pub(super) fn join_parts(
    parts: u32,
    out: &mut dyn Write,
    mut read: impl FnMut(u32) -> io::Result<Vec<u8>>,
) -> io::Result<u64> {
    let mut length = 0;
    let mut put = |bytes: &[u8]| {
        length += bytes.len() as u64;
        out.write_all(bytes)
    };
    if parts == 1 {
        put(&read(0)?)?;
        return Ok(length);
    }
    put(b"{\n  \"problems\": [")?;
    for part in 0..parts {
        put(if part == 0 { b"" } else { b"," })?;
        // A text of JSON has line breaks between its values only.
        for line in read(part)?.trim_ascii().split(|&byte| byte == b'\n') {
            put(b"\n    ")?;
            put(line)?;
        }
    }
    put(b"\n  ]\n}\n")?;
    Ok(length)
}

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

/// The keys of a reconstruction: those of `rebuilt` in `covis solve --json`, with all keyframes that were
/// not placed.
pub(super) fn reconstruction(found: Option<&Rebuilt>) -> Value {
    let Some(found) = found else { return json!({}) };
    let unplaced: Vec<Value> = found
        .unplaced
        .iter()
        .map(|keyframe| {
            let client = Some(&keyframe.client).filter(|client| !client.is_empty());
            json!({ "client": client, "id": keyframe.id, "reason": keyframe.reason })
        })
        .collect();
    json!({ "rebuilt": {
        "keyframes": found.keyframes,
        "placed": found.placed,
        "unplaced": unplaced,
        "landmarks": found.landmarks,
        "placed_landmarks": found.placed_landmarks,
        "observations": found.observations,
        "dropped_observations": found.observations - found.agreeing,
        "pairs": found.view_graph.pairs,
        "measured_pairs": found.view_graph.measured,
        "relative_poses": found.view_graph.edges,
        "scale": found.scale.name(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_of_problems_are_joined_byte_by_byte() {
        let parts =
            [json!({ "path": "a", "cost": 0.1 + 0.2 }), json!({ "rows": [1, 2], "no": {} })];
        let join = |parts: &[Value]| {
            let mut text = Vec::new();
            let count = u32::try_from(parts.len()).unwrap();
            let read = |part: u32| Ok(to_text(&parts[part as usize]));
            let length = join_parts(count, &mut text, read).unwrap();
            assert_eq!(length, text.len() as u64);
            text
        };
        let whole = to_text(&json!({ "problems": parts }));
        assert_eq!(String::from_utf8(join(&parts)), String::from_utf8(whole));
        assert_eq!(join(&parts[..1]), to_text(&parts[0]));
        // An earlier version wrote parts in one line.
        let compact = |part: u32| Ok(parts[part as usize].to_string().into_bytes());
        let mut text = Vec::new();
        join_parts(2, &mut text, compact).unwrap();
        assert_eq!(serde_json::from_slice::<Value>(&text).unwrap(), json!({ "problems": parts }));
    }
}
