//! Follows a map and writes what changes: keyframes as they come, states of the whole map now and then.
//!
//! The watch brings the map with what changes; the poses in the odometry frames of keyframes that were there
//! before are asked for once. It reads through the client and changes nothing in the map.

use std::collections::BTreeMap;
use std::pin::pin;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use covis_solvers::geometry::Se3;
use tokio::time::Instant;

use super::colors::Colors;
use super::scene::Scene;
use super::sink::Sink;
use crate::client::{Client, ClientError, MapWatch, WatchOptions};
use crate::frontend::mapping::messages::se3;

/// A map that is being recorded.
#[derive(Debug)]
pub(super) struct Recorder {
    client: Client,
    map: String,
    every: Duration,
    watch: MapWatch,
    scene: Scene,
}

impl Recorder {
    /// Opens the watch. States are written every so often at most, landmarks in `colors` where they are known.
    pub(super) async fn open(
        client: &Client,
        map: &str,
        every: Duration,
        colors: Option<Colors>,
    ) -> Result<Self, ClientError> {
        let mut watch = client.watch(map, WatchOptions::default()).await?;
        watch.next().await?;
        let (client, map) = (client.clone(), map.to_owned());
        Ok(Self { client, map, every, watch, scene: Scene::new(colors) })
    }

    /// Writes the map as it is; where it `follows`, also what changes until `end`. Finishes the recording in
    /// any case and returns how many messages it has.
    pub(super) async fn record(
        &mut self,
        sink: &Sink,
        follows: bool,
        end: impl Future<Output = ()>,
    ) -> anyhow::Result<u64> {
        let mut ended = self.begin(sink).await;
        if follows && ended.is_ok() {
            ended = self.follow(sink, end).await;
        }
        // What was recorded until the link or the map went away is complete all the same.
        let messages = sink.finish()?;
        ended.map(|()| messages)
    }

    async fn begin(&mut self, sink: &Sink) -> anyhow::Result<()> {
        let odometry = self.odometry().await?;
        self.scene.put_new(self.watch.mirror(), &odometry, sink)?;
        self.scene.put_state(self.watch.mirror(), None, sink)?;
        sink.flush()
    }

    /// The poses of the keyframes in the frames of their odometry.
    async fn odometry(&self) -> Result<BTreeMap<(String, i64), Se3>, ClientError> {
        let paths = vec!["odom_from_camera".to_owned()];
        let fields = Some(prost_types::FieldMask { paths });
        let keyframes = self.client.keyframes(&self.map, fields).await?.keyframes;
        let of =
            |k: crate::wire::v1::Keyframe| Some(((k.client_id, k.id), se3(&k.odom_from_camera?)?));
        Ok(keyframes.into_iter().filter_map(of).collect())
    }

    async fn follow(&mut self, sink: &Sink, end: impl Future<Output = ()>) -> anyhow::Result<()> {
        let mut end = pin!(end);
        // When the last state was written, and whether the map has changed since.
        let (mut last, mut is_due) = (Instant::now(), false);
        loop {
            tokio::select! {
                () = &mut end => break,
                changes = self.watch.next_changes() => {
                    if let Err(error) = changes {
                        // The last state that was seen; then why there is no later one.
                        self.put_due(is_due, sink)?;
                        return Err(error.into());
                    }
                    self.scene.put_new(self.watch.mirror(), &BTreeMap::new(), sink)?;
                    is_due = true;
                }
                () = tokio::time::sleep_until(last + self.every), if is_due => {
                    self.put_due(true, sink)?;
                    sink.flush()?;
                    (last, is_due) = (Instant::now(), false);
                }
            }
        }
        // Changes that the server had made by now are part of it.
        let revision = self.client.get_map(&self.map).await?.revision;
        if self.watch.mirror().revision < revision {
            self.watch.reach(revision).await?;
            is_due = true;
        }
        self.put_due(is_due, sink)
    }

    /// Writes new keyframes and a state, where the map has changed since the last one.
    fn put_due(&mut self, is_due: bool, sink: &Sink) -> anyhow::Result<()> {
        if is_due {
            self.scene.put_new(self.watch.mirror(), &BTreeMap::new(), sink)?;
            self.scene.put_state(self.watch.mirror(), now_ns(), sink)?;
        }
        Ok(())
    }
}

/// This machine's time, Unix nanoseconds.
fn now_ns() -> Option<u64> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}
