//! How often and how soon a broken link is tried again: exponential backoff with jitter.
//!
//! Attempt k waits min(first · 2^k, longest), shortened at random by up to a half so that many
//! robots do not come back in one instant; never less than what the server asked for. Attempts are
//! counted since the last progress, so that a long session survives many short outages; the time is
//! counted since the link broke. Which errors may be tried again is decided in `error`.

use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher, Hasher, RandomState};
use std::time::Duration;

use tokio::time::Instant;

use super::ClientError;

/// When to give up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// Attempts without progress after which a session fails (8).
    pub max_attempts: u32,
    /// Wait before the second attempt (100 ms).
    pub first_delay: Duration,
    /// Longest wait (5 s).
    pub longest_delay: Duration,
    /// How long a link may be broken before a session fails (no limit).
    pub give_up_after: Option<Duration>,
    /// What the random part of the waits is drawn from, for runs that must repeat exactly (none: it
    /// differs from process to process).
    pub seed: Option<u64>,
}

impl Default for RetryPolicy {
    fn default() -> Self {
        Self {
            max_attempts: 8,
            first_delay: Duration::from_millis(100),
            longest_delay: Duration::from_secs(5),
            give_up_after: None,
            seed: None,
        }
    }
}

impl RetryPolicy {
    /// One attempt, for callers that repeat calls themselves.
    #[must_use]
    pub fn once() -> Self {
        Self { max_attempts: 1, ..Self::default() }
    }

    /// Makes a call, and again while it fails for a reason that may pass. The call must be one that
    /// may be made twice.
    ///
    /// # Errors
    /// What the call ended with; [`ClientError::RetriesExhausted`].
    pub async fn run<T, F>(self, mut call: impl FnMut() -> F) -> Result<T, ClientError>
    where
        F: Future<Output = Result<T, ClientError>>,
    {
        let mut retries = Retries::new(self);
        loop {
            match call().await {
                Ok(answer) => return Ok(answer),
                Err(error) => retries.wait(error).await?,
            }
        }
    }
}

/// Attempts since the last progress.
#[derive(Debug)]
pub(super) struct Retries {
    policy: RetryPolicy,
    failed: u32,
    /// When the link broke; `None` while it stands.
    broken_since: Option<Instant>,
}

impl Retries {
    pub(super) fn new(policy: RetryPolicy) -> Self {
        Self { policy, failed: 0, broken_since: None }
    }

    /// The link stands again. The attempts still count: it may break at once.
    pub(super) fn opened(&mut self) {
        self.broken_since = None;
    }

    /// Forgets the failures so far.
    pub(super) fn progress(&mut self) {
        self.failed = 0;
    }

    /// Waits before the next attempt; `error` comes back where it is final or was the last straw.
    pub(super) async fn wait(&mut self, error: ClientError) -> Result<(), ClientError> {
        if !error.is_transient() {
            return Err(error);
        }
        self.failed += 1;
        let since = *self.broken_since.get_or_insert_with(Instant::now);
        let left = self.policy.give_up_after.map(|limit| limit.saturating_sub(since.elapsed()));
        if self.failed >= self.policy.max_attempts || left == Some(Duration::ZERO) {
            let (attempts, last) = (self.failed, Box::new(error));
            return Err(ClientError::RetriesExhausted { attempts, last });
        }
        let delay = self.delay(self.jitter()).max(error.retry_delay().unwrap_or_default());
        let delay = left.map_or(delay, |left| delay.min(left));
        tracing::debug!(%error, ?delay, attempt = self.failed, "trying again");
        tokio::time::sleep(delay).await;
        Ok(())
    }

    /// The wait after the failures so far; `jitter` within 0 to 1.
    fn delay(&self, jitter: f64) -> Duration {
        let doublings = self.failed.saturating_sub(1).min(20);
        let full = self.policy.first_delay.saturating_mul(1 << doublings);
        full.min(self.policy.longest_delay).mul_f64(1.0 - 0.5 * jitter)
    }

    /// A number within 0 to 1.
    fn jitter(&self) -> f64 {
        // The standard library's hash keys are random, and good enough to spread robots in time.
        let bits = match self.policy.seed {
            None => RandomState::new().build_hasher().finish(),
            Some(seed) => {
                BuildHasherDefault::<DefaultHasher>::default().hash_one((seed, self.failed))
            }
        };
        f64::from((bits >> 32) as u32) / f64::from(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_the_longest() {
        let mut retries = Retries::new(RetryPolicy::default());
        let waits: Vec<u128> = (1..=8)
            .map(|failed| {
                retries.failed = failed;
                retries.delay(0.0).as_millis()
            })
            .collect();
        assert_eq!(waits, [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
        assert_eq!(retries.delay(1.0).as_millis(), 2500);
    }

    #[tokio::test]
    async fn attempts_are_bounded_and_progress_starts_over() {
        let policy = RetryPolicy {
            max_attempts: 2,
            first_delay: Duration::ZERO,
            longest_delay: Duration::ZERO,
            ..RetryPolicy::default()
        };
        let broken = || ClientError::rpc("Ingest")(tonic::Status::unavailable("gone"));
        let mut retries = Retries::new(policy);
        assert!(retries.wait(broken()).await.is_ok());
        retries.progress();
        assert!(retries.wait(broken()).await.is_ok());
        let error = retries.wait(broken()).await.unwrap_err();
        assert!(matches!(error, ClientError::RetriesExhausted { attempts: 2, .. }), "{error}");
        assert!(matches!(retries.wait(ClientError::Closed).await, Err(ClientError::Closed)));
        let policy = RetryPolicy { give_up_after: Some(Duration::ZERO), ..RetryPolicy::default() };
        let mut calls = 0;
        let answer: Result<(), _> = policy
            .run(|| {
                calls += 1;
                std::future::ready(Err(broken()))
            })
            .await;
        let error = answer.unwrap_err();
        assert!(matches!(error, ClientError::RetriesExhausted { attempts: 1, .. }), "{error}");
        assert_eq!(calls, 1);
    }
}
