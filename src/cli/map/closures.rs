//! `covis map closures`: what the searches for known places found, a line a candidate.
//!
//! Shows what the server answered: which keyframes looked alike, the loop closure that was added, or the
//! reason why none was. Judges nothing itself.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::output::{show, table};
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
    /// Client and id of the keyframe whose place was searched.
    keyframe: (String, i64),
    /// Client and id of the keyframe that looked like it.
    #[serde(skip_serializing_if = "Option::is_none")]
    candidate: Option<(String, i64)>,
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
    /// Client and id of its first keyframe.
    from: Option<(String, i64)>,
}

type States = BTreeMap<(String, i64), State>;

fn named(keyframe: Option<v1::KeyframeRef>) -> Option<(String, i64)> {
    keyframe.map(|keyframe| (keyframe.client_id, keyframe.id))
}

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
        let (verdict, from) = (verdict(pose.switched_off), named(pose.keyframe_i));
        ((pose.client_id, pose.id), State { verdict, from })
    };
    relative.map(state).collect()
}

fn rows(search: v1::PlaceSearch, states: &States) -> Vec<Row> {
    let Some(keyframe) = named(search.keyframe) else { return Vec::new() };
    let closure = search.closure.map(|closure| (closure.client_id, closure.id));
    let of_search = search.refusal;
    let accepted = match &closure {
        Some(closure) => {
            (states.get(closure).map_or("removed", |state| state.verdict), String::new())
        }
        None => ("refused", String::new()),
    };
    let row = |candidate: v1::PlaceCandidate| {
        let (verdict, text) = match (candidate.refusal, &of_search) {
            (Some(refusal), _) => (refusal.reason, refusal.text),
            (None, Some(refusal)) if closure.is_none() => {
                (refusal.reason.clone(), refusal.text.clone())
            }
            (None, _) => (accepted.0.to_owned(), accepted.1.clone()),
        };
        let (score, matches) = (candidate.score, candidate.match_count);
        let candidate = named(candidate.keyframe);
        Row { keyframe: keyframe.clone(), candidate, score, matches, verdict, text }
    };
    let mut rows: Vec<Row> = search.candidates.into_iter().map(row).collect();
    if rows.is_empty()
        && let Some(v1::PlaceRefusal { reason, text }) = &of_search
    {
        let (verdict, text) = (reason.clone(), text.clone());
        let (keyframe, candidate) = (keyframe.clone(), None);
        rows.push(Row { keyframe, candidate, score: 0.0, matches: 0, verdict, text });
    }
    for closure in search.earlier_closures {
        let Some(State { verdict, from }) = states.get(&(closure.client_id, closure.id)) else {
            continue;
        };
        let (keyframe, candidate) = (keyframe.clone(), from.clone());
        let (verdict, text) = ((*verdict).to_owned(), "by an earlier search".to_owned());
        rows.push(Row { keyframe, candidate, score: 0.0, matches: 0, verdict, text });
    }
    rows
}

fn text(rows: &[Row]) -> String {
    if rows.is_empty() {
        return "no keyframe looked like an earlier one".to_owned();
    }
    let named = |(client, id): &(String, i64)| format!("{client}/{id}");
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
    let head = ["keyframe", "candidate", "score", "matches", "verdict", ""].map(str::to_owned);
    table(std::iter::once(head).chain(rows.iter().map(cells)))
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
