//! Waiting until a map is settled: the server does nothing more to it until the next item or call.
//!
//! `GetMap` says what is pending; while something is, a watch that leaves out the entities says when
//! nothing is. A link that breaks is tried again as that of a watch.

use super::calls::{answer, next};
use super::retry::{Retries, RetryPolicy};
use super::{Client, ClientError};
use crate::wire::v1;

const RPC: &str = "WatchMap";

impl Client {
    /// Waits until a map is settled: solves have covered all items of all clients, no place is still to be
    /// searched, no adjustment after loop closures is due or runs, and no requested optimization runs.
    ///
    /// A map that others go on sending to may not settle for as long as they do.
    ///
    /// # Errors
    /// NOT_FOUND for the map, any other code of `GetMap` and `WatchMap`; [`ClientError::MapNotOpen`] for
    /// a map whose work waits; [`ClientError::Protocol`] for a server that does not say what is pending
    /// (`GetServerInfo.features` without `map.pending-work`); [`ClientError::RetriesExhausted`].
    pub async fn wait_settled(&self, map_id: &str) -> Result<(), ClientError> {
        let client = self.apart().with_retry(RetryPolicy::once());
        let mut retries = Retries::new(RetryPolicy::default());
        loop {
            match client.settled(map_id, &mut retries).await {
                Ok(()) => return Ok(()),
                Err(error) => {
                    client.servers.follow(&error);
                    retries.wait(error).await?;
                }
            }
        }
    }

    /// Waits over one link.
    async fn settled(&self, map_id: &str, retries: &mut Retries) -> Result<(), ClientError> {
        let map = self.get_map(map_id).await?;
        if is_settled(map_id, map.state(), map.pending_work)? {
            return Ok(());
        }
        let request = v1::WatchMapRequest {
            map_id: map_id.to_owned(),
            from_revision: Some(map.revision),
            map_uid: map.uid,
            omit_landmarks: true,
            omit_constraints: true,
            ..v1::WatchMapRequest::default()
        };
        let mut stream = answer(RPC, self.map_service().watch_map(request).await)?;
        while let Some(v1::WatchMapResponse { delta }) = next(RPC, &mut stream).await? {
            let Some(delta) = delta.filter(|delta| delta.last_part) else { continue };
            retries.progress();
            if is_settled(map_id, delta.state(), delta.pending_work)? {
                return Ok(());
            }
        }
        // Watching ends with a status; an end without one is a link that went away.
        Err(ClientError::rpc(RPC)(tonic::Status::unavailable("the stream ended")))
    }
}

/// Whether nothing is pending.
///
/// # Errors
/// What is pending is not known, or waits.
fn is_settled(
    map_id: &str,
    state: v1::MapState,
    pending: Option<v1::PendingWork>,
) -> Result<bool, ClientError> {
    let what = "the server does not say what is pending";
    let pending = pending.ok_or(ClientError::Protocol { rpc: RPC, what })?;
    if pending == v1::PendingWork::default() {
        return Ok(true);
    }
    let state = match state {
        v1::MapState::Frozen => "frozen",
        v1::MapState::Poisoned => "poisoned",
        v1::MapState::Open | v1::MapState::Unspecified => return Ok(false),
    };
    Err(ClientError::MapNotOpen { map_id: map_id.to_owned(), state })
}
