//! The solver pool: one set of rayon threads for all solves of a server.
//!
//! Work runs under `catch_unwind`, so that a panic costs one solve and no thread. A solve that is
//! parallel inside spreads over the same pool. Nothing async runs here and nothing waits here.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use tokio::sync::oneshot;

use super::EngineError;

/// Work that panicked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a solve panicked: {message}")]
pub struct SolvePanicked {
    /// What the panic said, for the log.
    pub message: String,
}

/// Threads for solves.
#[derive(Debug)]
pub struct SolverPool {
    pool: rayon::ThreadPool,
}

impl SolverPool {
    /// Starts `threads` threads, at least 1.
    ///
    /// # Errors
    /// [`EngineError::Threads`] where the system refuses.
    pub fn new(threads: usize) -> Result<Arc<Self>, EngineError> {
        let count = threads.max(1);
        rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(|index| format!("covis-solver-{index}"))
            .build()
            .map(|pool| Arc::new(Self { pool }))
            .map_err(|_error| EngineError::Threads { count })
    }

    /// How many threads there are.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Starts `work` now and answers through the receiver; dropping the receiver does not stop it.
    pub(super) fn start<R: Send + 'static>(
        &self,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> oneshot::Receiver<Result<R, SolvePanicked>> {
        let (reply, answer) = oneshot::channel();
        self.pool.spawn(move || {
            let result = catch_unwind(AssertUnwindSafe(work))
                .map_err(|panic| SolvePanicked { message: panic_message(panic.as_ref()) });
            // Nobody waits for the result of work that was superseded.
            let _unread = reply.send(result);
        });
        answer
    }

    /// Runs `work` on the pool.
    ///
    /// # Errors
    /// [`SolvePanicked`] when it panicked.
    pub async fn run<R: Send + 'static>(
        &self,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> Result<R, SolvePanicked> {
        answered(self.start(work).await)
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
