//! Log lines on standard error, filtered by the configuration's `log`.
//!
//! Standard output belongs to results and stays free of them. Deletions are told at every level,
//! unless the filter itself says otherwise of their target `audit`.

use std::io::IsTerminal;

use anyhow::{Context, anyhow};
use tracing_subscriber::EnvFilter;

/// Starts logging. A second call in one process changes nothing.
///
/// # Errors
/// Where `filter` is not a list of directives.
pub(super) fn start(filter: &str) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(format!("audit=info,{filter}"))
        .with_context(|| anyhow!("log filter `{filter}`"))?;
    let logger = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    // The only failure is that a subscriber is installed already, as in tests.
    let _ = logger.try_init();
    Ok(())
}
