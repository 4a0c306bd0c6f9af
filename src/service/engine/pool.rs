//! The solver pool: one set of rayon threads for all solves of a server, with turns among tenants.
//!
//! As many solves run at once as there are threads; what waits is given its turn by [`Turns`]. Work
//! runs under `catch_unwind`, so that a panic costs one solve and no thread. A solve that is
//! parallel inside spreads over the same pool. Nothing async runs here and nothing waits here.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio::sync::oneshot;

use super::turns::{Turn, Turns};
use super::{Account, Accounts, EngineError, Resource};

/// Work that panicked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a solve panicked: {message}")]
pub struct SolvePanicked {
    /// What the panic said, for the log.
    pub message: String,
}

/// Why work has no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoolError {
    /// It panicked.
    #[error(transparent)]
    Panicked(#[from] SolvePanicked),
    /// Too much work of its tenant waits already; it was not begun.
    #[error(transparent)]
    Full(EngineError),
}

type Work = Box<dyn FnOnce() + Send>;

/// Threads for solves.
pub struct SolverPool {
    /// `None`: work runs as a task of the async runtime, so that one thread and one clock drive
    /// everything.
    threads: Option<rayon::ThreadPool>,
    turns: Mutex<Turns<Work>>,
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
    /// [`EngineError::Threads`] where the system refuses.
    pub fn new(threads: usize) -> Result<Arc<Self>, EngineError> {
        Self::shared_by(Accounts::default(), threads)
    }

    /// The same, with the limits of `accounts`.
    ///
    /// # Errors
    /// As [`SolverPool::new`].
    pub fn shared_by(accounts: Accounts, threads: usize) -> Result<Arc<Self>, EngineError> {
        let count = threads.max(1);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(|index| format!("covis-solver-{index}"))
            .build();
        let threads = pool.map_err(|_error| EngineError::Threads { count })?;
        Ok(Arc::new(Self {
            threads: Some(threads),
            turns: Mutex::new(Turns::new(count)),
            accounts,
        }))
    }

    /// A pool without threads, for simulations: work runs as a task of the caller's runtime, one after
    /// the other.
    #[cfg(test)]
    pub(crate) fn in_place() -> Arc<Self> {
        let (turns, accounts) = (Mutex::new(Turns::new(1)), Accounts::default());
        Arc::new(Self { threads: None, turns, accounts })
    }

    /// How many threads there are.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.threads.as_ref().map_or(1, rayon::ThreadPool::current_num_threads)
    }

    /// What the tenants that share the pool hold.
    #[must_use]
    pub fn accounts(&self) -> &Accounts {
        &self.accounts
    }

    /// Has `work` done when the turn of the account's tenant comes and answers through the receiver; dropping the
    /// receiver does not stop it.
    pub(super) fn start<R: Send + 'static>(
        self: &Arc<Self>,
        tenant: &Account,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> oneshot::Receiver<Result<R, SolvePanicked>> {
        let (reply, answer) = oneshot::channel();
        let work = Box::new(move || {
            let result = catch_unwind(AssertUnwindSafe(work))
                .map_err(|panic| SolvePanicked { message: panic_message(panic.as_ref()) });
            // Nobody waits for the result of work that was superseded.
            let _unread = reply.send(result);
        });
        self.lock().push(&Arc::from(tenant.tenant()), work);
        self.begin();
        answer
    }

    /// Runs `work` of a tenant on the pool.
    ///
    /// # Errors
    /// [`PoolError`].
    pub async fn run<R: Send + 'static>(
        self: &Arc<Self>,
        tenant: &Arc<Account>,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> Result<R, PoolError> {
        let waits = tenant.reserve(Resource::WaitingSolves, 1).map_err(PoolError::Full)?;
        let work = move || {
            drop(waits);
            work()
        };
        Ok(answered(self.start(tenant, work).await)?)
    }

    /// Begins what may run now.
    fn begin(self: &Arc<Self>) {
        let most = |tenant: &str| self.accounts.tenant(tenant).limits().max_solves;
        loop {
            let next = self.lock().next(most);
            let Some((turn, work)) = next else { return };
            let pool = Arc::clone(self);
            let run = move || {
                let begin = Instant::now();
                work();
                pool.ended(&turn, begin);
            };
            match &self.threads {
                Some(threads) => threads.spawn(run),
                None => {
                    tokio::spawn(async { run() });
                }
            }
        }
    }

    fn ended(self: &Arc<Self>, turn: &Turn, begin: Instant) {
        let took_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.lock().ended(turn, took_ns);
        self.begin();
    }

    fn lock(&self) -> MutexGuard<'_, Turns<Work>> {
        self.turns.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A lost answer can only mean that its thread died.
pub(super) fn answered<R>(
    answer: Result<Result<R, SolvePanicked>, oneshot::error::RecvError>,
) -> Result<R, SolvePanicked> {
    answer.unwrap_or_else(|lost| Err(SolvePanicked { message: lost.to_string() }))
}

/// What a panic said.
pub(super) fn panic_message(panic: &(dyn Any + Send)) -> String {
    if let Some(text) = panic.downcast_ref::<&'static str>() {
        (*text).to_owned()
    } else if let Some(text) = panic.downcast_ref::<String>() {
        text.clone()
    } else {
        "no message".to_owned()
    }
}
