//! What the searches for known places found, as messages and back.
//!
//! Used by events and by snapshots. Scores are kept to the bit. Nothing is searched here.

use super::entities::{decode_id, encode_id, required_id};
use super::{EncodingError, v1};
use covis_map::{EntityId, PlaceCandidate, PlaceRefusal, PlaceSearch};

type Decoded<T> = Result<T, EncodingError>;

fn encode_refusal(refusal: &PlaceRefusal) -> v1::PlaceRefusal {
    let PlaceRefusal { reason, text } = refusal.clone();
    v1::PlaceRefusal { reason, text }
}

fn decode_refusal(refusal: v1::PlaceRefusal) -> PlaceRefusal {
    let v1::PlaceRefusal { reason, text } = refusal;
    PlaceRefusal { reason, text }
}

pub(super) fn encode_search(keyframe: EntityId, search: &PlaceSearch) -> v1::PlaceSearch {
    let PlaceSearch { candidates, closure, refusal } = search;
    let candidate = |candidate: &PlaceCandidate| {
        let PlaceCandidate { keyframe, score, matches, refusal } = candidate;
        v1::PlaceCandidate {
            keyframe: Some(encode_id(*keyframe)),
            score: score.to_bits(),
            matches: *matches,
            refusal: refusal.as_ref().map(encode_refusal),
        }
    };
    v1::PlaceSearch {
        keyframe: Some(encode_id(keyframe)),
        candidates: candidates.iter().map(candidate).collect(),
        closure: closure.map(encode_id),
        refusal: refusal.as_ref().map(encode_refusal),
    }
}

pub(super) fn decode_search(search: v1::PlaceSearch) -> Decoded<(EntityId, PlaceSearch)> {
    let v1::PlaceSearch { keyframe, candidates, closure, refusal } = search;
    let candidate = |candidate: v1::PlaceCandidate| {
        Ok(PlaceCandidate {
            keyframe: required_id(candidate.keyframe, "a candidate")?,
            score: f64::from_bits(candidate.score),
            matches: candidate.matches,
            refusal: candidate.refusal.map(decode_refusal),
        })
    };
    let search = PlaceSearch {
        candidates: candidates.into_iter().map(candidate).collect::<Decoded<_>>()?,
        closure: closure.map(decode_id),
        refusal: refusal.map(decode_refusal),
    };
    Ok((required_id(keyframe, "a keyframe")?, search))
}

pub(super) fn encode_pending(keyframe: EntityId, revision: &i64) -> v1::PendingSearch {
    v1::PendingSearch { keyframe: Some(encode_id(keyframe)), revision: *revision }
}

pub(super) fn decode_pending(pending: v1::PendingSearch) -> Decoded<(EntityId, i64)> {
    Ok((required_id(pending.keyframe, "a keyframe")?, pending.revision))
}
