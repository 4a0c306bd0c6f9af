//! When work ends early: at a deadline, or because its caller does not want it any more.
//!
//! One value is passed by reference to everything that may take long. Code that works checks
//! [`Interrupt::is_due`] at bounded intervals and returns early, with any numbers in its buffers: the
//! layer above checks it too and discards the unfinished result. That is safe because an interrupt that
//! is due stays due. When it comes never changes a number of work that is finished. Whether one is set
//! at all does: a large dense factorization that may be interrupted is cut into panels.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Why work ends early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    /// The time is up.
    Deadline,
    /// Nobody wants the result.
    Cancelled,
}

/// A deadline, a flag, or neither. Asking costs some 25 ns with a deadline and next to nothing
/// without.
#[derive(Clone, Debug, Default)]
pub struct Interrupt {
    deadline: Option<Instant>,
    /// Set once, never taken back.
    cancel: Option<Arc<AtomicBool>>,
}

impl Interrupt {
    /// Work that runs to its end.
    pub const NEVER: Self = Self { deadline: None, cancel: None };

    /// Ends work at `deadline`; `None` is no deadline.
    #[must_use]
    pub fn at(deadline: Option<Instant>) -> Self {
        Self { deadline, cancel: None }
    }

    /// The same, and once `flag` is set.
    #[must_use]
    pub fn or_when(self, flag: Arc<AtomicBool>) -> Self {
        Self { cancel: Some(flag), ..self }
    }

    /// The same, or `time` after `start` where that is earlier.
    #[must_use]
    pub fn or_after(&self, start: Instant, time: Option<Duration>) -> Self {
        // A deadline that the clock cannot express never comes.
        let own = time.and_then(|time| start.checked_add(time));
        Self { deadline: self.deadline.into_iter().chain(own).min(), cancel: self.cancel.clone() }
    }

    /// Whether nothing is set that could ever end work.
    #[inline]
    #[must_use]
    pub fn is_never(&self) -> bool {
        self.deadline.is_none() && self.cancel.is_none()
    }

    /// Whether work must end. Once true, it stays true.
    #[inline]
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.cancel.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed))
            || self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// For loops of short steps: asks once in `every` of them.
    #[must_use]
    pub fn in_steps(&self, every: u32) -> Steps<'_> {
        Steps { interrupt: self, every, left: every, is_due: false }
    }

    /// Why work must end, or `None` where it may go on. A caller that left counts before the time.
    #[must_use]
    pub fn reason(&self) -> Option<Interruption> {
        if self.cancel.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed)) {
            return Some(Interruption::Cancelled);
        }
        let late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        late.then_some(Interruption::Deadline)
    }
}

/// Asks an [`Interrupt`] once in so many steps.
#[derive(Clone, Debug)]
pub struct Steps<'a> {
    interrupt: &'a Interrupt,
    every: u32,
    left: u32,
    is_due: bool,
}

impl Steps<'_> {
    /// Takes `steps` steps; whether work must end, as far as was asked.
    #[inline]
    pub fn is_due_after(&mut self, steps: u32) -> bool {
        self.left = self.left.saturating_sub(steps);
        if self.left == 0 {
            self.left = self.every;
            self.is_due = self.is_due || self.interrupt.is_due();
        }
        self.is_due
    }
}
