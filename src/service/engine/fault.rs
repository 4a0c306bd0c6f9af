//! Faults that tests inject. Without the feature `faults` none can be injected, and the checks here
//! are constant.

use super::EngineConfig;

/// A fault that tests inject.
#[cfg(feature = "faults")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Every solve panics.
    PanicInSolve,
    /// The engine panics while it applies a client's item.
    PanicInEngine,
    /// Every call on a map, including its creation and deletion, returns
    /// [`EngineError::Bug`](super::EngineError::Bug).
    FailCalls,
}

#[cfg(feature = "faults")]
impl EngineConfig {
    pub(crate) fn panics_in_solve(&self) -> bool {
        self.fault == Some(Fault::PanicInSolve)
    }

    pub(super) fn panics_in_engine(&self) -> bool {
        self.fault == Some(Fault::PanicInEngine)
    }

    pub(super) fn fails_calls(&self) -> bool {
        self.fault == Some(Fault::FailCalls)
    }
}

#[cfg(not(feature = "faults"))]
impl EngineConfig {
    pub(crate) const fn panics_in_solve(&self) -> bool {
        false
    }

    pub(super) const fn panics_in_engine(&self) -> bool {
        false
    }

    pub(super) const fn fails_calls(&self) -> bool {
        false
    }
}
