//! `covis map constraints`: the constraints of a map, one per line.
//!
//! Shows what the server answered: which keyframes, what kind, and whether the constraint is switched off. It
//! judges nothing itself.

use serde::Serialize;

use super::super::output::{show, table};
use super::{Key, key, named};
use crate::client::Client;
use crate::wire::v1;
use v1::constraint::Constraint;

/// The constraints of a map in `--json`.
#[derive(Debug, Serialize)]
struct Listed {
    map: String,
    revision: i64,
    constraints: Vec<Row>,
}

/// A constraint.
#[derive(Debug, Serialize)]
struct Row {
    client: String,
    id: i64,
    kind: &'static str,
    /// Client and id of each keyframe: two of a relative pose, one of a prior.
    keyframes: Vec<Key>,
    /// Whether it is left out of every solve.
    switched_off: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    chi2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weight: Option<f64>,
    /// Whether nothing but the odometry speaks against it.
    #[serde(skip_serializing_if = "Option::is_none")]
    provisional: Option<bool>,
}

/// Lists the constraints of a map.
pub(super) async fn constraints(client: &Client, name: String, json: bool) -> anyhow::Result<()> {
    let listed = client.constraints(&name).await?;
    let constraints = listed.constraints.into_iter().filter_map(row).collect();
    let listed = Listed { map: name, revision: listed.revision, constraints };
    show(json, &listed, || text(&listed.constraints))
}

fn row(message: v1::Constraint) -> Option<Row> {
    let entry = |client, id, kind, keyframes: [_; 2], off: Option<v1::SwitchedOff>| Row {
        client,
        id,
        kind,
        keyframes: keyframes.into_iter().filter_map(key).collect(),
        switched_off: off.is_some(),
        chi2: off.map(|off| off.chi2),
        weight: off.map(|off| off.weight),
        provisional: off.map(|off| off.provisional),
    };
    // A kind that this version does not know is absent.
    Some(match message.constraint? {
        Constraint::RelativePose(c) => {
            let kind = match c.kind() {
                v1::ConstraintKind::Odometry => "odometry",
                v1::ConstraintKind::LoopClosure => "loop closure",
                v1::ConstraintKind::Other => "other",
                v1::ConstraintKind::Marginal => "marginal",
                v1::ConstraintKind::Unspecified => "unknown",
            };
            entry(c.client_id, c.id, kind, [c.keyframe_i, c.keyframe_j], c.switched_off)
        }
        Constraint::PositionPrior(p) => {
            entry(p.client_id, p.id, "position prior", [p.keyframe, None], p.switched_off)
        }
        Constraint::PosePrior(p) => {
            entry(p.client_id, p.id, "pose prior", [p.keyframe, None], None)
        }
    })
}

fn text(rows: &[Row]) -> String {
    if rows.is_empty() {
        return "no constraints".to_owned();
    }
    let cells = |row: &Row| {
        let keyframes: Vec<String> = row.keyframes.iter().map(named).collect();
        let state = match (row.chi2, row.provisional) {
            (Some(chi2), Some(true)) => format!("switched off for now (chi2 {chi2:.1})"),
            (Some(chi2), _) => format!("switched off (chi2 {chi2:.1})"),
            (None, _) => "counts".to_owned(),
        };
        [format!("{}/{}", row.client, row.id), row.kind.to_owned(), keyframes.join(" - "), state]
    };
    table(["constraint", "kind", "keyframes", "state"], rows.iter().map(cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constraint_that_is_switched_off_tells_why() {
        let keyframe = |id| Some(v1::KeyframeRef { client_id: "a".to_owned(), id });
        let closure = v1::RelativePoseConstraint {
            client_id: "a".to_owned(),
            id: 12,
            keyframe_i: keyframe(3),
            keyframe_j: keyframe(400),
            kind: v1::ConstraintKind::LoopClosure.into(),
            switched_off: Some(v1::SwitchedOff { chi2: 321.04, ..Default::default() }),
            ..Default::default()
        };
        let prior = v1::PosePrior { id: 1, keyframe: keyframe(3), ..Default::default() };
        let fix = v1::PositionPrior {
            client_id: "a".to_owned(),
            id: 2,
            keyframe: keyframe(7),
            switched_off: Some(v1::SwitchedOff { chi2: 90.0, ..Default::default() }),
            ..Default::default()
        };
        let rows = [
            Constraint::PosePrior(prior),
            Constraint::RelativePose(closure),
            Constraint::PositionPrior(fix),
        ];
        let rows: Vec<Row> = rows
            .into_iter()
            .filter_map(|constraint| row(v1::Constraint { constraint: Some(constraint) }))
            .collect();
        let text = text(&rows);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "constraint  kind            keyframes    state");
        assert_eq!(lines[1], "/1          pose prior      a/3          counts");
        let off = "a/12        loop closure    a/3 - a/400  switched off (chi2 321.0)";
        assert_eq!(lines[2], off);
        let off = "a/2         position prior  a/7          switched off (chi2 90.0)";
        assert_eq!(lines[3], off);
    }
}
