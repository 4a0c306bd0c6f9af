//! `covis map closures`: what the searches for known places found, one line per candidate.
//!
//! Shows what the server answered: which keyframes looked alike, the loop closure that was added, or the
//! reason why none was. It judges nothing itself.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::output::{show, table};
use super::{Key, key, named};
use crate::client::Client;
use crate::wire::v1;
use v1::constraint::Constraint;

/// The searches of a map in `--json`.
#[derive(Debug, Serialize)]
struct Listed {
    map: String,
    revision: i64,
    /// Loop closures that the searches added and that are in the map.
    closures: usize,
    candidates: Vec<Row>,
}

/// A candidate, or a keyframe that was not searched.
#[derive(Debug, Serialize)]
struct Row {
    /// The keyframe whose place was searched.
    keyframe: Key,
    /// The keyframe that looked like it.
    #[serde(skip_serializing_if = "Option::is_none")]
    candidate: Option<Key>,
    score: f64,
    matches: i32,
    /// `closed`, `switched_off`, `provisional`, `removed`, or the reason of the refusal.
    verdict: String,
    /// The reason with its numbers.
    text: String,
}

/// Lists the searches of a map.
pub(super) async fn closures(client: &Client, name: String, json: bool) -> anyhow::Result<()> {
    let searches = client.place_searches(&name).await?;
    let constraints = client.constraints(&name).await?;
    let states = states(constraints.constraints);
    let candidates: Vec<Row> =
        searches.searches.into_iter().flat_map(|search| rows(search, &states)).collect();
    let is_in_map =
        |row: &&Row| ["closed", "switched_off", "provisional"].contains(&row.verdict.as_str());
    let closures = candidates.iter().filter(is_in_map).count();
    let listed = Listed { map: name, revision: searches.revision, closures, candidates };
    show(json, &listed, || text(&listed.candidates))
}

/// A relative pose of the map.
struct State {
    verdict: &'static str,
    /// Its first keyframe.
    from: Option<Key>,
}

type States = BTreeMap<Key, State>;

/// What became of each relative pose, by client and id.
fn states(constraints: Vec<v1::Constraint>) -> States {
    let relative = constraints.into_iter().filter_map(|message| match message.constraint? {
        Constraint::RelativePose(pose) => Some(pose),
        Constraint::PosePrior(_) | Constraint::PositionPrior(_) => None,
    });
    let verdict = |off: Option<v1::SwitchedOff>| match off {
        None => "closed",
        Some(off) if off.provisional => "provisional",
        Some(_) => "switched_off",
    };
    let state = |pose: v1::RelativePoseConstraint| {
        let (verdict, from) = (verdict(pose.switched_off), key(pose.keyframe_i));
        ((pose.client_id, pose.id), State { verdict, from })
    };
    relative.map(state).collect()
}

fn rows(search: v1::PlaceSearch, states: &States) -> Vec<Row> {
    let Some(keyframe) = key(search.keyframe) else { return Vec::new() };
    let row = |candidate, (score, matches), verdict: &str, text: &str| {
        let (keyframe, verdict, text) = (keyframe.clone(), verdict.to_owned(), text.to_owned());
        Row { keyframe, candidate, score, matches, verdict, text }
    };
    let closure = search.closure.map(|closure| (closure.client_id, closure.id));
    // Of a candidate that has no reason of its own.
    let (verdict, text) = match (&closure, &search.refusal) {
        (Some(closure), _) => (states.get(closure).map_or("removed", |state| state.verdict), ""),
        (None, Some(refusal)) => (&refusal.reason[..], &refusal.text[..]),
        (None, None) => ("refused", ""),
    };
    let of_candidate = |candidate: v1::PlaceCandidate| {
        let own = candidate.refusal.as_ref();
        let (verdict, text) = own.map_or((verdict, text), |own| (&own.reason[..], &own.text[..]));
        row(key(candidate.keyframe), (candidate.score, candidate.match_count), verdict, text)
    };
    let mut rows: Vec<Row> = search.candidates.into_iter().map(of_candidate).collect();
    if rows.is_empty()
        && let Some(v1::PlaceRefusal { reason, text }) = &search.refusal
    {
        rows.push(row(None, (0.0, 0), reason, text));
    }
    for closure in search.earlier_closures {
        if let Some(State { verdict, from }) = states.get(&(closure.client_id, closure.id)) {
            rows.push(row(from.clone(), (0.0, 0), verdict, "by an earlier search"));
        }
    }
    rows
}

fn text(rows: &[Row]) -> String {
    if rows.is_empty() {
        return "no keyframe looked like an earlier one".to_owned();
    }
    let cells = |row: &Row| {
        [
            named(&row.keyframe),
            row.candidate.as_ref().map_or_else(|| "-".to_owned(), named),
            format!("{:.2}", row.score),
            row.matches.to_string(),
            row.verdict.clone(),
            row.text.clone(),
        ]
    };
    let head = ["keyframe", "candidate", "score", "matches", "verdict", ""];
    table(head, rows.iter().map(cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_candidate_tells_what_became_of_it() {
        let keyframe = |id| Some(v1::KeyframeRef { client_id: "a".to_owned(), id });
        let refusal =
            |reason: &str| v1::PlaceRefusal { reason: reason.to_owned(), text: "why".to_owned() };
        let candidate = |id, refusal| v1::PlaceCandidate {
            keyframe: keyframe(id),
            score: 0.25,
            match_count: 80,
            refusal,
        };
        let closure = |id| Some(v1::ConstraintRef { client_id: "a".to_owned(), id });
        let search = |id, candidates, closure, refusal| v1::PlaceSearch {
            keyframe: keyframe(id),
            candidates,
            closure,
            refusal,
            earlier_closures: Vec::new(),
        };
        let constraint = |id, switched_off| v1::Constraint {
            constraint: Some(Constraint::RelativePose(v1::RelativePoseConstraint {
                client_id: "a".to_owned(),
                id,
                switched_off,
                ..Default::default()
            })),
        };
        let provisional = v1::SwitchedOff { provisional: true, ..Default::default() };
        let states = states(vec![
            constraint(-4, None),
            constraint(-5, Some(v1::SwitchedOff::default())),
            constraint(-6, Some(provisional)),
        ]);
        let verdicts = |search| {
            let rows = rows(search, &states);
            rows.into_iter().map(|row| (row.verdict, row.text)).collect::<Vec<_>>()
        };
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        let two = vec![candidate(3, Some(refusal("ambiguous"))), candidate(2, None)];
        let found = verdicts(search(20, two, closure(-4), None));
        assert_eq!(found, [pair("ambiguous", "why"), pair("closed", "")]);
        for (id, verdict) in [(-5, "switched_off"), (-6, "provisional"), (-7, "removed")] {
            let found = verdicts(search(20, vec![candidate(2, None)], closure(id), None));
            assert_eq!(found, [pair(verdict, "")]);
        }
        let again = v1::PlaceSearch {
            earlier_closures: vec![closure(-5).unwrap()],
            ..search(20, vec![candidate(2, None)], closure(-4), None)
        };
        let found = verdicts(again);
        assert_eq!(found, [pair("closed", ""), pair("switched_off", "by an earlier search")]);
        let full = verdicts(search(20, vec![candidate(2, None)], None, Some(refusal("no_room"))));
        assert_eq!(full, [pair("no_room", "why")]);
        let none = verdicts(search(20, Vec::new(), None, Some(refusal("descriptors"))));
        assert_eq!(none, [pair("descriptors", "why")]);
    }
}
