//! Names as callers know them: what may be one, and maps without the tenant that the engine puts before them.
//!
//! The tenant stays inside the server: it is in no answer and no error.

use super::engine::{EngineError, SEPARATOR};
use crate::store::StoreError;

/// Whether `text` may be the name of a map, a client, a token or a tenant.
pub(super) fn is_name(text: &str) -> bool {
    let allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'_' || c == b'-';
    (1..=63).contains(&text.len()) && text.bytes().all(allowed)
}

/// The name of a map as its tenant knows it.
pub(super) fn shown(engine_name: &str) -> &str {
    engine_name.split_once(SEPARATOR).map_or(engine_name, |(_, name)| name)
}

/// The error as the map's tenant may read it.
pub(super) fn hide_tenant(mut error: EngineError) -> EngineError {
    for map in maps_of(&mut error).into_iter().flatten() {
        *map = shown(map).to_owned();
    }
    error
}

/// The maps that an error names.
pub(super) fn maps_of(error: &mut EngineError) -> [Option<&mut String>; 2] {
    let map = match error {
        EngineError::MergedAway { map, into: other }
        | EngineError::NotMerged { map, source_map: other } => {
            return [Some(map), Some(other)];
        }
        EngineError::MapNotFound { map }
        | EngineError::MapExists { map }
        | EngineError::Poisoned { map }
        | EngineError::Refused { map, .. }
        | EngineError::Frozen { map }
        | EngineError::AnchorInUse { map }
        | EngineError::NoPlaceRecognition { map }
        | EngineError::Moving { map }
        | EngineError::NotAligned { map, .. }
        | EngineError::CannotMerge { map, .. }
        | EngineError::RevisionMismatch { map, .. }
        | EngineError::EpochFenced { map, .. }
        | EngineError::OptimizationRunning { map }
        | EngineError::MapLimit { map, .. }
        | EngineError::RevisionAhead { map, .. }
        | EngineError::NotKept { map, .. }
        | EngineError::NothingToSolve { map }
        | EngineError::Cancelled { map }
        | EngineError::Journal { map, .. }
        | EngineError::Store(
            StoreError::UnknownMap { map }
            | StoreError::MapExists { map }
            | StoreError::OwnedElsewhere { map, .. }
            | StoreError::Fenced { map, .. }
            | StoreError::SequenceMismatch { map, .. }
            | StoreError::NotReadable { map, .. }
            | StoreError::Unfit { map, .. }
            | StoreError::Truncated { map, .. }
            | StoreError::NoSnapshot { map, .. }
            | StoreError::Unavailable { map, .. }
            | StoreError::Failed { map, .. }
            | StoreError::Later { map, .. }
            | StoreError::Ambiguous { map, .. }
            | StoreError::Stopped { map, .. }
            | StoreError::Damaged { map, .. },
        ) => Some(map),
        EngineError::TooLarge { .. } | EngineError::ServerLimit { .. } => None,
        EngineError::Store(
            StoreError::File { .. }
            | StoreError::Content { .. }
            | StoreError::InUse { .. }
            | StoreError::NotEmpty { .. },
        )
        | EngineError::Solve(_)
        | EngineError::NoSuchKeyframe { .. }
        | EngineError::ShuttingDown
        | EngineError::TenantLimit { .. }
        | EngineError::Threads { .. }
        | EngineError::Bug { .. } => None,
    };
    [map, None]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_does_not_tell_the_tenant() {
        let error = hide_tenant(EngineError::MapNotFound { map: "acme.house".to_owned() });
        assert_eq!(error.to_string(), "map \"house\" does not exist");
    }
}
