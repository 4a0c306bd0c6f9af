//! Which servers are alive: each writes a beat into a key-value bucket, and all read the others'.
//!
//! A server counts as gone when its beat has not changed for the time of a lease while this server's own
//! beats arrived, and its maps may be taken over. A server that could not write its own beat for so long,
//! by its own clock, has lost its lease and serves no map until a beat arrives again. The clocks decide
//! nothing but that: two servers that believe to serve one map at once cannot both write, because the
//! map's stream refuses the one that took it over first.
//!
//! Beats are written and read on a thread of their own, over a connection of their own, so that no busy
//! worker delays them. A beat does not wait for the one before it: the lease holds as long as NATS answers
//! within the lease, however long an answer takes.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use async_nats::jetstream::kv;
use futures_util::StreamExt;
use futures_util::stream::FuturesUnordered;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{Instant, MissedTickBehavior};

use super::message::Owner;
use crate::sync::Mutex;

/// Beats in the time of a lease.
const BEATS: u32 = 4;
/// How long a broken watch waits before it is made again.
const AGAIN: Duration = Duration::from_millis(200);

/// This server's lease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Lease {
    /// Whether the server may serve maps.
    pub(super) holds: bool,
    /// How often the lease has lapsed. Where it did, another server may have taken maps.
    pub(super) lapses: u64,
}

/// The servers that share maps. Dropping it ends the beats: the lease runs out by itself.
#[derive(Debug)]
pub(super) struct Members {
    shared: Arc<Shared>,
    /// Asks the thread to let go of the lease; the thread ends where it is dropped.
    leaving: mpsc::UnboundedSender<oneshot::Sender<()>>,
}

/// What the thread of the beats tells.
#[derive(Debug)]
struct Shared {
    me: Owner,
    time: Duration,
    beats: Mutex<Beats>,
    lease: watch::Sender<Lease>,
}

/// Ends the lease when it is dropped.
struct Ending(Arc<Shared>);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0.set(false);
    }
}

/// The beats that were read.
#[derive(Debug)]
struct Beats {
    /// The newest beat of each other server, by the revision of its key, and when it was read.
    others: BTreeMap<String, (u64, Instant)>,
    /// When this server's own newest beat was read.
    own: Instant,
}

impl Members {
    /// Writes the first beat and goes on, on a thread of its own; returns when the beats of all others are
    /// known. `open` connects and opens the bucket on that thread.
    ///
    /// # Errors
    /// Why there is no lease.
    pub(super) async fn start<F>(
        me: Owner,
        time: Duration,
        open: impl FnOnce() -> F + Send + 'static,
    ) -> Result<Self, String>
    where
        F: Future<Output = Result<kv::Store, String>>,
    {
        let (leaving, leave) = mpsc::unbounded_channel();
        let (begun, begins) = oneshot::channel();
        let lease = watch::Sender::new(Lease { holds: true, lapses: 0 });
        let beats = Mutex::new(Beats { others: BTreeMap::new(), own: Instant::now() });
        let shared = Arc::new(Shared { me, time, beats, lease });
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| error.to_string())?;
        let beating = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("covis-lease".to_owned());
        let thread = thread.spawn(move || {
            // Without its thread the server has no lease, also where the thread panicked.
            let _ending = Ending(Arc::clone(&beating));
            runtime.block_on(beating.run(open, begun, leave));
        });
        thread.map_err(|error| error.to_string())?;
        begins.await.unwrap_or_else(|_ended| Err("the thread of the lease ended".to_owned()))?;
        Ok(Self { shared, leaving })
    }

    /// This server.
    pub(super) fn me(&self) -> &Owner {
        &self.shared.me
    }

    /// The time of a lease.
    pub(super) fn lease_time(&self) -> Duration {
        self.shared.time
    }

    /// Follows this server's lease.
    pub(super) fn lease(&self) -> watch::Receiver<Lease> {
        self.shared.lease.subscribe()
    }

    /// Whether another server is alive. One that listened where this one listens is gone.
    pub(super) fn is_alive(&self, owner: &Owner) -> bool {
        owner.address != self.shared.me.address
            && self.shared.beats.lock().is_alive(&owner.server, self.shared.time)
    }

    /// Lets go of the lease: others need not wait.
    pub(super) async fn leave(&self) {
        let (left, has_left) = oneshot::channel();
        // The thread drops the sender when it ends.
        if self.leaving.send(left).is_ok() {
            let _left = has_left.await;
        }
    }
}

impl Beats {
    /// A server that this one does not hear of is not gone where this one hears of nobody: time counts up
    /// to the last beat of its own that came back.
    fn is_alive(&self, server: &str, lease: Duration) -> bool {
        let beat = self.others.get(server);
        beat.is_some_and(|&(_, at)| self.own.saturating_duration_since(at) < lease)
    }

    /// Takes a beat of another server. After a broken watch the same one may come again.
    fn take(&mut self, beat: kv::Entry) {
        if beat.operation != kv::Operation::Put {
            self.others.remove(&beat.key);
        } else if self.others.get(&beat.key).is_none_or(|(old, _)| *old != beat.revision) {
            self.others.insert(beat.key, (beat.revision, Instant::now()));
        }
    }
}

impl Shared {
    /// What the thread does: tells by `begun` that there is a lease, or why there is none, and keeps it
    /// until it is to let go of it.
    async fn run<F>(
        &self,
        open: impl FnOnce() -> F,
        begun: oneshot::Sender<Result<(), String>>,
        mut leave: mpsc::UnboundedReceiver<oneshot::Sender<()>>,
    ) where
        F: Future<Output = Result<kv::Store, String>>,
    {
        let (known, mut knows) = watch::channel(false);
        let bucket = match open().await {
            Ok(bucket) => bucket,
            Err(error) => return drop(begun.send(Err(error))),
        };
        let value = bytes::Bytes::from(self.me.address.clone());
        let put = async || bucket.put(&self.me.server, value.clone()).await;
        if let Err(error) = put().await {
            return drop(begun.send(Err(error.to_string())));
        }
        let beating = keep(self.time, &put, |holds| self.tell(holds));
        let watching = self.watch(&bucket, &known);
        let starting = async {
            let knows = knows.wait_for(|&known| known);
            let knows =
                tokio::time::timeout(self.time, knows).await.is_ok_and(|known| known.is_ok());
            let unread = || "the heartbeats of the servers cannot be read".to_owned();
            let _gone = begun.send(knows.then_some(()).ok_or_else(unread));
            leave.recv().await
        };
        let left = tokio::select! {
            left = starting => left,
            () = beating => None,
            () = watching => None,
        };
        let Some(left) = left else { return };
        self.set(false);
        if let Err(error) = bucket.delete(&self.me.server).await {
            tracing::warn!(%error, "the lease runs out by itself");
        }
        let _gone = left.send(());
    }

    /// Sets whether the lease holds; returns whether that is new.
    fn set(&self, holds: bool) -> bool {
        self.lease.send_if_modified(|lease| {
            let changed = lease.holds != holds;
            lease.lapses += u64::from(changed && !holds);
            lease.holds = holds;
            changed
        })
    }

    /// Tells whether the lease holds.
    fn tell(&self, holds: bool) {
        match (self.set(holds), holds) {
            (true, true) => tracing::info!("the lease holds again"),
            (true, false) => tracing::error!("the lease is lost: this server serves no map"),
            (false, _) => {}
        }
    }

    /// Reads beats. Those that there were come first and in order: once this server's own is among
    /// them, all are known.
    async fn watch(&self, bucket: &kv::Store, known: &watch::Sender<bool>) {
        loop {
            match bucket.watch_with_history(">").await {
                Ok(mut read) => {
                    while let Some(Ok(beat)) = read.next().await {
                        let mut beats = self.beats.lock();
                        if beat.key == self.me.server {
                            beats.own = Instant::now();
                            known.send_replace(true);
                        } else {
                            beats.take(beat);
                        }
                    }
                }
                Err(error) => tracing::debug!(%error, "the servers are not watched"),
            }
            tokio::time::sleep(AGAIN).await;
        }
    }
}

/// Beats forever, and tells whether the lease of the newest beat that was answered holds. The lease counts
/// from the moment at which that beat was sent.
async fn keep<E: std::fmt::Display>(
    lease: Duration,
    put: impl AsyncFn() -> Result<u64, E>,
    tell: impl Fn(bool),
) {
    let mut ticks = tokio::time::interval(lease / BEATS);
    // After a pause of the process one beat is enough.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut last = Instant::now();
    let mut answers = FuturesUnordered::new();
    loop {
        tokio::select! {
            _ = ticks.tick() => {
                let sent = Instant::now();
                let answer = put();
                answers.push(async move { (sent, answer.await) });
            }
            Some((sent, answer)) = answers.next() => match answer {
                Ok(_revision) => last = last.max(sent),
                Err(error) => tracing::warn!(%error, "the lease was not renewed"),
            },
        }
        // After a pause of the process the lease may be over before anything else is looked at.
        tell(last.elapsed() < lease);
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::convert::Infallible;

    use super::*;

    const LEASE: Duration = Duration::from_secs(2);

    /// What is told while each beat is answered after a delay, for a minute.
    async fn told(delay: impl Fn(u32) -> Duration) -> Vec<bool> {
        let (count, told) = (Cell::new(0), RefCell::new(Vec::new()));
        let put = async || {
            count.set(count.get() + 1);
            tokio::time::sleep(delay(count.get())).await;
            Ok::<u64, Infallible>(1)
        };
        let tell = |holds| {
            let mut told = told.borrow_mut();
            if told.last() != Some(&holds) {
                told.push(holds);
            }
        };
        let kept = keep(LEASE, put, tell);
        tokio::time::timeout(Duration::from_secs(60), kept).await.unwrap_err();
        told.into_inner()
    }

    #[tokio::test(start_paused = true)]
    async fn a_lease_holds_while_answers_take_less_than_the_lease() {
        assert_eq!(told(|_| Duration::from_millis(5)).await, [true]);
        // Each answer takes longer than the time between two beats.
        assert_eq!(told(|_| Duration::from_millis(1400)).await, [true]);
        // Every third is lost.
        let lossy =
            |beat: u32| Duration::from_millis(if beat.is_multiple_of(3) { 9000 } else { 20 });
        assert_eq!(told(lossy).await, [true]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_lease_that_was_lost_holds_again_with_the_next_answer() {
        let outage =
            |beat: u32| Duration::from_secs(if (8..16).contains(&beat) { 3600 } else { 0 });
        assert_eq!(told(outage).await, [true, false, true]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_server_is_gone_only_while_own_beats_come_back() {
        let begin = Instant::now();
        let others = BTreeMap::from([("other".to_owned(), (1, begin))]);
        let mut beats = Beats { others, own: begin };
        tokio::time::advance(10 * LEASE).await;
        assert!(beats.is_alive("other", LEASE), "nothing was heard of anybody");
        assert!(!beats.is_alive("unknown", LEASE));
        beats.own = Instant::now();
        assert!(!beats.is_alive("other", LEASE));
    }
}
