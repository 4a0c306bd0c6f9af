//! Runs a solve on a given number of worker threads.

use crate::problem::SolveError;

/// Runs `work` in a rayon pool of `threads` threads, or in the caller's pool for `None`.
///
/// # Errors
/// [`SolveError::Threads`] where the pool cannot be started.
pub fn with_threads<R: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> R + Send,
) -> Result<R, SolveError> {
    match threads {
        None => Ok(work()),
        Some(count) => rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .map(|pool| pool.install(work))
            .map_err(|_error| SolveError::Threads { count }),
    }
}
