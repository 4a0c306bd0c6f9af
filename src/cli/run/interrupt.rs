//! ctrl-C and SIGTERM during `covis run`: the first signal ends the sequence, and what was tracked is
//! written; the second one ends the program at once. Writes nothing itself.

use std::io;
use std::sync::{Arc, OnceLock};

use super::super::output::signal_code;
use super::super::signals::Signals;

/// The signal that a run has got; by default none, and none is caught.
#[derive(Clone, Debug, Default)]
pub(in crate::cli) struct Interrupt(Arc<OnceLock<&'static str>>);

impl Interrupt {
    /// Catches signals from now on, as long as the runtime lives in which it is called.
    ///
    /// # Errors
    /// Signals cannot be caught.
    pub(super) fn catch() -> io::Result<Self> {
        let mut signals = Signals::new()?;
        let caught = Self::default();
        let told = caught.clone();
        tokio::spawn(async move {
            let signal = signals.next().await;
            // It is the only one who sets it.
            let _set = told.0.set(signal);
            tracing::warn!(
                "{signal}: the run ends here, and what was tracked is written; a second signal ends at once"
            );
            let again = signals.next().await;
            std::process::exit(i32::from(signal_code(again)));
        });
        Ok(caught)
    }

    /// The name of the signal.
    pub(super) fn signal(&self) -> Option<&'static str> {
        self.0.get().copied()
    }
}
