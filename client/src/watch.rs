//! Following a map: a mirror that is kept up to date over broken links.
//!
//! After a break the watch goes on from the revision it holds, naming the map's uid; the server
//! answers the missing deltas, or a reset where it no longer has them or the map is another one. It
//! only reads: no map is changed.

use tonic::Streaming;

use super::calls::{answer, next};
use super::retry::{Retries, RetryPolicy};
use super::{Client, ClientError, MapChanges, MapMirror};
use crate::wire::v1;

const RPC: &str = "WatchMap";

/// What is watched.
#[derive(Clone, Copy, Debug, Default)]
pub struct WatchOptions {
    /// Leave out landmarks (no).
    pub omit_landmarks: bool,
    /// Leave out constraints (no).
    pub omit_constraints: bool,
    /// Positions that moved by at most this wait until they have moved farther, m (0: none waits).
    /// The mirror's positions are off by as much.
    pub position_resolution_m: f64,
    /// The same of rotations of keyframes, rad (0).
    pub rotation_resolution_rad: f64,
    /// When to give a broken link up.
    pub retry: RetryPolicy,
}

/// A map that is being followed.
#[derive(Debug)]
pub struct MapWatch {
    client: Client,
    map_id: String,
    options: WatchOptions,
    retries: Retries,
    stream: Option<Streaming<v1::WatchMapResponse>>,
    /// Parts of a delta that is not complete yet.
    parts: Vec<v1::MapDelta>,
    mirror: MapMirror,
}

impl MapWatch {
    /// Opens the watch; the mirror is empty until the first [`MapWatch::next`].
    pub(super) async fn open(
        client: &Client,
        map_id: &str,
        options: WatchOptions,
    ) -> Result<Self, ClientError> {
        let mut watch = Self {
            client: client.apart(),
            map_id: map_id.to_owned(),
            options,
            retries: Retries::new(options.retry),
            stream: None,
            parts: Vec::new(),
            mirror: MapMirror::default(),
        };
        watch.stream = Some(watch.stream().await?);
        Ok(watch)
    }

    /// The map as of the last delta.
    pub fn mirror(&self) -> &MapMirror {
        &self.mirror
    }

    /// Waits for the next delta and applies it. Safe to cancel.
    ///
    /// # Errors
    /// NOT_FOUND when the map was deleted; what a broken link ended with when it did not come back.
    pub async fn next(&mut self) -> Result<&MapMirror, ClientError> {
        self.next_changes().await?;
        Ok(&self.mirror)
    }

    /// As [`MapWatch::next`], and tells what the delta changed in the mirror, so that its reader need
    /// not go through the whole map.
    ///
    /// # Errors
    /// As [`MapWatch::next`].
    pub async fn next_changes(&mut self) -> Result<MapChanges, ClientError> {
        loop {
            match self.delta().await {
                Ok(changes) => return Ok(changes),
                Err(error) => {
                    self.client.servers.follow(&error);
                    self.stream = None;
                    self.parts.clear();
                    self.retries.wait(error).await?;
                }
            }
        }
    }

    /// Waits until the mirror holds `revision` or a later one. Safe to cancel.
    ///
    /// # Errors
    /// As [`MapWatch::next`].
    pub async fn reach(&mut self, revision: i64) -> Result<&MapMirror, ClientError> {
        while self.mirror.uid.is_empty() || self.mirror.revision < revision {
            self.next().await?;
        }
        Ok(&self.mirror)
    }

    async fn stream(&self) -> Result<Streaming<v1::WatchMapResponse>, ClientError> {
        let is_fresh = self.mirror.uid.is_empty();
        let request = v1::WatchMapRequest {
            map_id: self.map_id.clone(),
            from_revision: (!is_fresh).then_some(self.mirror.revision),
            omit_landmarks: self.options.omit_landmarks,
            omit_constraints: self.options.omit_constraints,
            map_uid: self.mirror.uid.clone(),
            position_resolution_m: self.options.position_resolution_m,
            rotation_resolution_rad: self.options.rotation_resolution_rad,
        };
        answer(RPC, self.client.map_service().watch_map(request).await)
    }

    /// Takes one whole delta.
    async fn delta(&mut self) -> Result<MapChanges, ClientError> {
        let stream = match &mut self.stream {
            Some(stream) => stream,
            None => {
                let stream = self.stream().await?;
                self.stream.insert(stream)
            }
        };
        loop {
            let Some(answer) = next(RPC, stream).await? else {
                // Watching ends with a status; an end without one is a link that went away.
                return Err(ClientError::rpc(RPC)(tonic::Status::unavailable("the stream ended")));
            };
            let Some(part) = answer.delta else { continue };
            let is_last = part.last_part;
            self.parts.push(part);
            if is_last {
                let changes = self.mirror.apply(std::mem::take(&mut self.parts))?;
                self.retries.progress();
                return Ok(changes);
            }
        }
    }
}
