//! The solver pool: the threads for all solves of a server, shared fairly among tenants.
//!
//! Small solves have their own threads, so that none waits for a large one; the system shares the
//! processors between both. As many solves of each kind run at once as there are threads; a large
//! solve also waits until its memory fits. [`FairQueue`] chooses which waiting solve is next. Work
//! runs under `catch_unwind`, so that a panic ends one solve and no thread. A solve that is
//! parallel inside uses the threads of its kind. What an engine computes itself (a window, a first
//! position, a keyframe's marginal, the change that a result makes) is not queued: an engine has
//! one such computation at a time, and each has a thread.

pub(crate) mod fair_queue;

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use covis_solvers::price::{Ceiling, Price};
use tokio::sync::oneshot;

use crate::map::{Map, Usage};
use crate::service::engine::pool::fair_queue::{FairQueue, Turn};
use crate::service::engine::{Account, Accounts, EngineError, Resource};
use crate::sync::Mutex;

/// Most work of a small solve in all its iterations, flop. By the bound, a window of ten keyframes
/// with 400 observations each takes a tenth of this in ten iterations.
const SMALL_FLOPS: f64 = 4e9;
/// Most memory of a small solve, bytes.
const SMALL_BYTES: u64 = 64 << 20;

/// An upper bound of the cost of a solve, before it starts, in one pass over the problem. It decides
/// on which threads the solve runs and how much memory is reserved for it; the exact price, which is
/// compared with the limit of a solve, is computed when the solve starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Estimate {
    bytes: u64,
    is_small: bool,
}

impl Estimate {
    /// The estimate of work that takes no more memory than a small solve, but more time.
    pub const LONG: Self = Self { bytes: SMALL_BYTES, is_small: false };

    /// The estimate of a solve that costs at most `bound`. A solve that costs more than `ceiling`
    /// is refused, so that no more is reserved.
    #[must_use]
    pub fn new(bound: Price, max_iterations: usize, ceiling: &Ceiling) -> Self {
        let flops = bound.flops_per_iteration * max_iterations.max(1) as f64;
        let is_small = bound.bytes <= SMALL_BYTES && flops <= SMALL_FLOPS;
        let bytes = ceiling.bytes.map_or(bound.bytes, |limit| bound.bytes.min(limit));
        Self { bytes, is_small }
    }

    /// The estimate of bundle adjustment or a pose graph over a whole map that holds `usage`.
    #[must_use]
    pub fn of_map(usage: Usage, max_iterations: usize, ceiling: &Ceiling) -> Self {
        let (poses, observations) = (usage.keyframes as f64, usage.observations as f64);
        // Each observation is paired with every other keyframe. This is a bound as long as no
        // keyframe sees a landmark twice.
        let pairs = 0.5 * observations * poses;
        let edges = usage.constraints as f64 + pairs.min(0.5 * poses * poses);
        let dimension = 15.0 * poses;
        let flops_per_iteration =
            1500.0 * (observations + edges) + 1400.0 * pairs + dimension.powi(3) / 3.0;
        let bytes = 16.0 * dimension * dimension + 2200.0 * pairs + 3000.0 * (observations + edges);
        Self::new(Price { bytes: bytes as u64, flops_per_iteration }, max_iterations, ceiling)
    }

    /// The estimate of making the pose graph of a map that holds `usage`, without a solve.
    #[must_use]
    pub fn of_graph(usage: Usage, ceiling: &Ceiling) -> Self {
        let solve = Self::of_map(usage, 1, ceiling);
        if solve.is_small { solve } else { Self::LONG }
    }

    /// Memory that is reserved for it while it runs, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether it is short and may run on the threads for small solves.
    pub fn is_small(&self) -> bool {
        self.is_small
    }
}

/// Work that panicked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a solve panicked: {message}")]
pub struct SolvePanicked {
    /// The message of the panic, for the log.
    pub message: String,
}

/// Why work has no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoolError {
    /// It panicked.
    #[error(transparent)]
    Panicked(#[from] SolvePanicked),
    /// Too much work of its tenant waits already; the work was not started.
    #[error(transparent)]
    Full(EngineError),
}

/// Priority of the threads for large solves and for readers, as a `nice` value: a thread of normal
/// priority gets nine times the processor time of such a thread.
#[cfg(target_os = "linux")]
const LARGE_NICE: i32 = 10;

type Work = Box<dyn FnOnce() + Send>;

/// A solve that waits in the queue.
struct Waiting {
    work: Work,
    bytes: u64,
    /// Account of the map or the tenant that requested it.
    account: Arc<Account>,
}

/// Threads for solves of one kind, and the solves that wait for them.
struct Workers {
    /// `None`: work runs as a task of the async runtime, so that one thread and one clock drive
    /// everything.
    threads: Option<rayon::ThreadPool>,
    queue: Mutex<FairQueue<Waiting>>,
}

/// Threads for solves.
pub struct SolverPool {
    small: Workers,
    large: Workers,
    accounts: Accounts,
}

impl fmt::Debug for SolverPool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SolverPool").field("threads", &self.threads()).finish_non_exhaustive()
    }
}

impl SolverPool {
    /// Starts `threads` threads, at least 1.
    ///
    /// # Errors
    /// [`EngineError::Threads`] if the system refuses.
    pub fn new(threads: usize) -> Result<Arc<Self>, EngineError> {
        Self::shared_by(Accounts::default(), threads)
    }

    /// The same, with the limits of `accounts`.
    ///
    /// # Errors
    /// As [`SolverPool::new`].
    pub fn shared_by(accounts: Accounts, threads: usize) -> Result<Arc<Self>, EngineError> {
        let (small, large) = (Workers::new("small", threads)?, Workers::new("large", threads)?);
        Ok(Arc::new(Self { small, large, accounts }))
    }

    /// A pool without threads, for simulations: solves run one after the other as tasks of the
    /// caller's runtime.
    #[cfg(feature = "faults")]
    pub(crate) fn in_place() -> Arc<Self> {
        let workers = || Workers { threads: None, queue: Mutex::new(FairQueue::new(1)) };
        Arc::new(Self { small: workers(), large: workers(), accounts: Accounts::default() })
    }

    /// The number of threads that a solve may use.
    pub fn threads(&self) -> usize {
        self.large.threads.as_ref().map_or(1, rayon::ThreadPool::current_num_threads)
    }

    /// The accounts of the tenants that share the pool.
    pub fn accounts(&self) -> &Accounts {
        &self.accounts
    }

    /// Queues `work` for the account's tenant; its result is sent to the receiver. Dropping the
    /// receiver does not stop the work.
    pub(crate) fn start<R: Send + 'static>(
        self: &Arc<Self>,
        account: &Arc<Account>,
        estimate: Estimate,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> oneshot::Receiver<Result<R, SolvePanicked>> {
        let (reply, answer) = oneshot::channel();
        let work = Box::new(move || {
            let result = caught(work);
            // The receiver is gone if the work was superseded.
            let _unread = reply.send(result);
        });
        let waiting = Waiting { work, bytes: estimate.bytes(), account: Arc::clone(account) };
        let is_small = estimate.is_small();
        self.workers(is_small).queue.lock().push(&Arc::from(account.tenant()), waiting);
        self.begin(is_small);
        answer
    }

    /// Runs `work` of a tenant on the pool.
    ///
    /// # Errors
    /// [`PoolError`].
    pub async fn run<R: Send + 'static>(
        self: &Arc<Self>,
        tenant: &Arc<Account>,
        estimate: Estimate,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> Result<R, PoolError> {
        let waits = tenant.reserve(Resource::WaitingSolves, 1).map_err(PoolError::Full)?;
        let work = move || {
            drop(waits);
            work()
        };
        Ok(answered(self.start(tenant, estimate, work).await)?)
    }

    /// Computes something that an engine awaits. A panic of `work` continues in the caller.
    pub(crate) async fn compute<R: Send + 'static>(
        &self,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> R {
        if self.small.threads.is_none() {
            return work();
        }
        match tokio::task::spawn_blocking(work).await {
            Ok(result) => result,
            Err(lost) => match lost.try_into_panic() {
                Ok(panic) => resume_unwind(panic),
                // The runtime is shutting down, and the engine with it.
                Err(canceled) => resume_unwind(Box::new(canceled.to_string())),
            },
        }
    }

    /// Computes something from a map that an engine awaits.
    pub(crate) async fn compute_from<R: Send + 'static>(
        &self,
        map: &Arc<Map>,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> R {
        let map = Arc::clone(map);
        let work = move || {
            let result = work(&map);
            // Dropped before the answer: the next change would copy a map that is shared.
            drop(map);
            result
        };
        self.compute(work).await
    }

    /// As [`Self::compute_from`], for what a solve needs: a panic of `work` loses its result.
    pub(crate) async fn attempt<R: Send + 'static>(
        &self,
        map: &Arc<Map>,
        work: impl FnOnce(&Map) -> R + Send + 'static,
    ) -> Result<R, SolvePanicked> {
        self.compute_from(map, move |map| caught(move || work(map))).await
    }

    /// Drops a large value on another thread.
    pub(crate) fn discard<T: Send + 'static>(&self, value: T) {
        if self.small.threads.is_some() {
            let work: Box<dyn FnOnce() + Send> = Box::new(move || drop(value));
            tokio::task::spawn_blocking(work);
        }
    }

    fn workers(&self, is_small: bool) -> &Workers {
        if is_small { &self.small } else { &self.large }
    }

    /// Starts the waiting solves of one kind that may run now.
    fn begin(self: &Arc<Self>, is_small: bool) {
        let workers = self.workers(is_small);
        loop {
            let mut queue = workers.queue.lock();
            let next = queue.next(
                |tenant, running, waiting| self.tenant_may(tenant, running, waiting),
                |running, waiting| is_small || running == 0 || self.fits(waiting),
            );
            let Some((turn, Waiting { work, bytes, account })) = next else { return };
            // Reserved while the queue is locked, so that no other solve gets the same memory.
            let bytes = account.reserve_existing(Resource::RunningSolveBytes, bytes);
            drop(queue);
            let pool = Arc::clone(self);
            let run = move || {
                let begin = Instant::now();
                work();
                drop(bytes);
                pool.ended(is_small, &turn, begin);
            };
            match &workers.threads {
                Some(threads) => threads.spawn(run),
                None => {
                    tokio::spawn(async { run() });
                }
            }
        }
    }

    /// Whether a tenant with `running` solves of this kind may start one more.
    fn tenant_may(&self, tenant: &str, running: u64, waiting: &Waiting) -> bool {
        let account = self.accounts.tenant(tenant);
        let limits = account.limits();
        let held = account.held(Resource::RunningSolveBytes);
        let more = held.saturating_add(waiting.bytes);
        running == 0
            || (limits.of(Resource::Solves).is_none_or(|most| running < most)
                && limits.of(Resource::RunningSolveBytes).is_none_or(|most| more <= most))
    }

    /// Whether the server has the memory for one more solve.
    fn fits(&self, waiting: &Waiting) -> bool {
        let server = self.accounts.server();
        let more = server.held(Resource::RunningSolveBytes).saturating_add(waiting.bytes);
        server.limits().of(Resource::RunningSolveBytes).is_none_or(|most| more <= most)
    }

    fn ended(self: &Arc<Self>, is_small: bool, turn: &Turn, begin: Instant) {
        let took_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.workers(is_small).queue.lock().ended(turn, took_ns);
        self.begin(is_small);
        if is_small {
            // A large solve may wait for the memory that is now free.
            self.begin(false);
        }
    }
}

impl Workers {
    fn new(kind: &'static str, threads: usize) -> Result<Self, EngineError> {
        let count = threads.max(1);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(move |index| format!("covis-{kind}-{index}"))
            .start_handler(move |_index| {
                if kind == "large" {
                    lower_priority();
                }
            })
            .build();
        let threads = pool.map_err(|_error| EngineError::Threads { count })?;
        Ok(Self { threads: Some(threads), queue: Mutex::new(FairQueue::new(count)) })
    }
}

/// Lowers the priority of this thread, so that acks and small solves do not wait for a processor
/// while a large solve computes. On an idle machine the solve takes no longer.
pub fn lower_priority() {
    // Linux has one priority per thread; elsewhere the whole process would be slowed down.
    #[cfg(target_os = "linux")]
    // If the system refuses, the priority stays unchanged.
    let _as_it_is = rustix::process::setpriority_process(None, LARGE_NICE);
}

/// A slot for one piece of work of an engine on the pool. `I` is what the engine knows about the work.
pub(crate) struct Slot<R, I = ()> {
    pool: Arc<SolverPool>,
    /// Account of the engine's map.
    account: Arc<Account>,
    running: Option<Started<R, I>>,
}

/// How work in a slot ended.
pub(crate) enum Ended<R> {
    /// With a result.
    Made(R),
    /// Nobody wants its result any more.
    Dropped,
    /// By a bug.
    Panicked {
        panicked: SolvePanicked,
        /// Whether nobody wanted its result any more.
        is_stale: bool,
    },
}

struct Started<R, I> {
    info: I,
    /// Whether the result is not wanted any more.
    is_stale: bool,
    cancel: Arc<AtomicBool>,
    answer: oneshot::Receiver<Result<R, SolvePanicked>>,
}

impl<R: Send + 'static, I> Slot<R, I> {
    /// A free slot.
    pub(crate) fn new(pool: &Arc<SolverPool>, account: &Arc<Account>) -> Self {
        Self { pool: Arc::clone(pool), account: Arc::clone(account), running: None }
    }

    /// What is known about the work that runs; `None` where none runs.
    pub(crate) fn running(&mut self) -> Option<&mut I> {
        self.running.as_mut().map(|running| &mut running.info)
    }

    /// Whether nothing runs.
    pub(crate) fn is_free(&self) -> bool {
        self.running.is_none()
    }

    /// Starts work in a free slot. The work ends early once `cancel` is set.
    pub(crate) fn start(
        &mut self,
        info: I,
        estimate: Estimate,
        cancel: Arc<AtomicBool>,
        work: impl FnOnce(&Arc<AtomicBool>) -> R + Send + 'static,
    ) {
        let flag = Arc::clone(&cancel);
        let answer = self.pool.start(&self.account, estimate, move || work(&flag));
        self.running = Some(Started { info, is_stale: false, cancel, answer });
    }

    /// Cancels the work that runs; its result is dropped.
    pub(crate) fn cancel(&mut self) {
        if let Some(running) = &mut self.running {
            running.is_stale = true;
            running.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Cancels the work that runs and does not wait for its end.
    pub(crate) fn forget(&mut self) {
        self.cancel();
        self.running = None;
    }

    /// Resolves when the work has ended; never if none runs.
    pub(crate) async fn ended(&mut self) -> (I, Ended<R>) {
        if let Some(running) = &mut self.running {
            let answer = answered((&mut running.answer).await);
            if let Some(Started { info, is_stale, .. }) = self.running.take() {
                let ended = match answer {
                    Ok(result) if is_stale => {
                        self.pool.discard(result);
                        Ended::Dropped
                    }
                    Ok(result) => Ended::Made(result),
                    Err(panicked) => Ended::Panicked { panicked, is_stale },
                };
                return (info, ended);
            }
        }
        std::future::pending().await
    }
}

/// Work loses its answer only if its thread died.
fn answered<R>(
    answer: Result<Result<R, SolvePanicked>, oneshot::error::RecvError>,
) -> Result<R, SolvePanicked> {
    answer.unwrap_or_else(|lost| Err(SolvePanicked { message: lost.to_string() }))
}

/// Runs work that touches nothing but its result.
fn caught<R>(work: impl FnOnce() -> R) -> Result<R, SolvePanicked> {
    catch_unwind(AssertUnwindSafe(work))
        .map_err(|panic| SolvePanicked { message: panic_message(panic.as_ref()) })
}

/// The message of a panic.
pub(crate) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("no message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_map(keyframes: u64, observations: u64) -> Estimate {
        let usage = Usage { keyframes, observations, ..Usage::default() };
        Estimate::of_map(usage, 100, &Ceiling { bytes: Some(1 << 30), ..Ceiling::NONE })
    }

    #[test]
    fn a_map_of_some_keyframes_is_small_and_a_building_is_not() {
        assert!(of_map(8, 3200).is_small());
        let building = of_map(10_000, 2_000_000);
        assert!(!building.is_small());
        assert_eq!(building.bytes(), 1 << 30, "no more than a solve may take");
    }

    #[test]
    fn a_small_problem_that_may_iterate_forever_is_not_small() {
        let bound = Price { bytes: 1000, flops_per_iteration: 1e6 };
        assert!(Estimate::new(bound, 100, &Ceiling::NONE).is_small());
        assert!(!Estimate::new(bound, 1_000_000, &Ceiling::NONE).is_small());
    }
}
