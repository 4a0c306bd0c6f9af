//! `CopyMap`: from the request to the engine's terms, and from its outcome to the answer. Whether the maps
//! exist is not known here.

use super::time::{nanoseconds, timestamp};
use super::update::is_frozen;
use super::{Path, Violations, ids};
use crate::map::Reason;
use crate::service::engine::{Copied, Moment};
use crate::wire::v1;
use v1::copy_map_request::At;

/// A copy that a request asks for.
#[derive(Debug, PartialEq)]
pub(in crate::service) struct Copy {
    pub(in crate::service) source: String,
    pub(in crate::service) name: String,
    /// Which state of the source; `None` for the present one.
    pub(in crate::service) moment: Option<Moment>,
    pub(in crate::service) frozen: bool,
}

/// Reads a request to copy a map.
pub(in crate::service) fn copy(request: &v1::CopyMapRequest, out: &mut Violations) -> Option<Copy> {
    let source = ids::name(Path::root("source_map_id"), &request.source_map_id, out);
    let name = ids::name(Path::root("new_map_id"), &request.new_map_id, out);
    let moment = match &request.at {
        None => Some(None),
        Some(At::Revision(revision)) if *revision < 1 => {
            let text = format!("{revision} is below 1");
            out.report(Path::root("revision"), Reason::OutOfRange, text)
        }
        Some(At::Revision(revision)) => Some(Some(Moment::Revision(*revision))),
        Some(At::Time(time)) => {
            nanoseconds(Path::root("time"), Some(time), out).map(|time| Some(Moment::Time(time)))
        }
    };
    // Open by default.
    let frozen = if request.state == 0 { Some(false) } else { is_frozen(request.state, out) };
    Some(Copy { source: source?, name: name?, moment: moment?, frozen: frozen? })
}

/// The answer about a copy.
pub(in crate::service) fn to_response(copied: &Copied, map: v1::Map) -> v1::CopyMapResponse {
    v1::CopyMapResponse {
        map: Some(map),
        revision: copied.state.revision,
        time: Some(timestamp(copied.state.time_ns)),
    }
}
