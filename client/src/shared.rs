//! What the handle and the task of a session share: the outbox, and word of what changed in it.
//!
//! The lock is held for moments only, a write to the spill file among them, and never across an await.

use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use super::outbox::Outbox;

/// The outbox of a session.
#[derive(Debug)]
pub(super) struct Shared {
    outbox: Mutex<Outbox>,
    /// Something was pushed, or the outbox was closed.
    pub(super) arrived: Notify,
    /// Something left: there may be room.
    pub(super) left: Notify,
}

impl Shared {
    /// With an empty outbox.
    pub(super) fn new(outbox: Outbox) -> Self {
        Self { outbox: Mutex::new(outbox), arrived: Notify::new(), left: Notify::new() }
    }

    /// The outbox.
    pub(super) fn outbox(&self) -> MutexGuard<'_, Outbox> {
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
