//! Which servers are alive: each writes a beat into a key-value bucket, and all read the others'.
//!
//! A server whose beat has not changed for the time of a lease, by the reader's clock, counts as gone, and
//! its maps may be taken over. A server that could not write its own beat for so long, by its own clock,
//! stops serving. The clocks decide nothing but that: two servers that believe to serve one map at once
//! cannot both write, because the map's stream refuses the one that took it over first.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use async_nats::jetstream::kv;
use futures_util::StreamExt;
use tokio::sync::watch;
use tokio::task::AbortHandle;
use tokio::time::Instant;

use super::message::Owner;
use crate::sync::Mutex;

/// Beats in the time of a lease.
const BEATS: u32 = 4;
/// How long a broken watch waits before it is made again.
const AGAIN: Duration = Duration::from_millis(200);

/// The servers that share maps.
#[derive(Debug)]
pub(super) struct Members {
    me: Owner,
    lease: Duration,
    bucket: kv::Store,
    /// The newest beat of each server, by the revision of its key, and when it was seen first.
    seen: Mutex<BTreeMap<String, (u64, Instant)>>,
    /// Whether this server holds its lease.
    alive: watch::Sender<bool>,
    tasks: Mutex<Vec<AbortHandle>>,
}

impl Members {
    /// Writes the first beat, and goes on; returns when the beats of all others are known.
    ///
    /// # Errors
    /// What NATS answered.
    pub(super) async fn start(
        me: Owner,
        lease: Duration,
        bucket: kv::Store,
    ) -> Result<Arc<Self>, String> {
        let put = bucket.put(&me.server, me.address.clone().into()).await;
        put.map_err(|error| error.to_string())?;
        let (seen, tasks) = (Mutex::default(), Mutex::default());
        let members =
            Arc::new(Self { me, lease, bucket, seen, alive: watch::Sender::new(true), tasks });
        let beating = Arc::clone(&members);
        let watching = Arc::clone(&members);
        let (known, mut knows) = watch::channel(false);
        let tasks = [
            tokio::spawn(async move { beating.beat().await }).abort_handle(),
            tokio::spawn(async move { watching.watch(&known).await }).abort_handle(),
        ];
        members.tasks.lock().extend(tasks);
        let knows = knows.wait_for(|&known| known);
        match tokio::time::timeout(lease, knows).await {
            Ok(Ok(_)) => Ok(members),
            Ok(Err(_)) | Err(_) => {
                members.stop();
                Err("the beats of the servers cannot be read".to_owned())
            }
        }
    }

    /// This server.
    pub(super) fn me(&self) -> &Owner {
        &self.me
    }

    /// Whether this server holds its lease; changes are told.
    pub(super) fn holds_lease(&self) -> watch::Receiver<bool> {
        self.alive.subscribe()
    }

    /// Whether another server is alive. One that listened where this one listens is gone.
    pub(super) fn is_alive(&self, owner: &Owner) -> bool {
        owner.address != self.me.address
            && self.seen.lock().get(&owner.server).is_some_and(|(_, at)| at.elapsed() < self.lease)
    }

    /// Lets go of the lease: others need not wait.
    pub(super) async fn leave(&self) {
        self.stop();
        self.alive.send_replace(false);
        if let Err(error) = self.bucket.delete(&self.me.server).await {
            tracing::warn!(%error, "the lease runs out by itself");
        }
    }

    /// Beats no more: the lease runs out by itself.
    pub(super) fn stop(&self) {
        for task in self.tasks.lock().drain(..) {
            task.abort();
        }
    }

    async fn beat(&self) {
        let period = self.lease / BEATS;
        let mut last = Instant::now();
        loop {
            tokio::time::sleep(period).await;
            // After a pause of the process the lease may be over before anything else is looked at.
            self.tell(last);
            let begun = Instant::now();
            let beat = self.bucket.put(&self.me.server, self.me.address.clone().into());
            match tokio::time::timeout(period, beat).await {
                Ok(Ok(_revision)) => last = begun,
                Ok(Err(error)) => tracing::warn!(%error, "the lease was not renewed"),
                Err(_elapsed) => tracing::warn!("the lease was not renewed in time"),
            }
            self.tell(last);
        }
    }

    /// Tells whether the lease of a beat that began at `last` still holds.
    fn tell(&self, last: Instant) {
        let holds = last.elapsed() < self.lease;
        let changed = self.alive.send_if_modified(|alive| std::mem::replace(alive, holds) != holds);
        match (changed, holds) {
            (true, true) => tracing::info!("the lease holds again"),
            (true, false) => tracing::error!("the lease is lost: this server serves no map"),
            (false, _) => {}
        }
    }

    /// Reads beats. Those that there were come first and in order: once this server's own is among
    /// them, all are known.
    async fn watch(&self, known: &watch::Sender<bool>) {
        loop {
            match self.bucket.watch_with_history(">").await {
                Ok(mut beats) => {
                    while let Some(Ok(beat)) = beats.next().await {
                        if beat.key == self.me.server {
                            known.send_replace(true);
                            continue;
                        }
                        let mut seen = self.seen.lock();
                        if beat.operation != kv::Operation::Put {
                            seen.remove(&beat.key);
                        } else if seen.get(&beat.key).is_none_or(|(old, _)| *old != beat.revision) {
                            // After a break the same beat may come again.
                            seen.insert(beat.key, (beat.revision, Instant::now()));
                        }
                    }
                }
                Err(error) => tracing::debug!(%error, "the servers are not watched"),
            }
            tokio::time::sleep(AGAIN).await;
        }
    }
}
