//! Log lines on standard error, filtered by the configuration's `log`, as text or as JSON; spans to
//! a collector, where one is named.
//!
//! Standard output belongs to results and stays free of them. Deletions are logged at every level,
//! unless the filter itself says otherwise of their target `audit`. As JSON each line is one
//! object, panics included: `timestamp`, `level`, `target`, `message`, the event's fields, and
//! `spans` with theirs.

use std::io::{IsTerminal, stderr};

use anyhow::{Context, anyhow};
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use super::config::{Config, LogFormat};
use super::spans::Exporter;

/// Starts logging, and exporting to `collector` where there is one; dropping the answer sends what
/// is left. Where no filter is given, servers and terminals get what is worth knowing, and what else reads
/// standard error gets warnings only. A second call in one process changes nothing. Fails where the filter is not a list of
/// directives, or the collector's URL is none.
pub(super) fn start(
    config: &Config,
    is_server: bool,
    collector: Option<&str>,
) -> anyhow::Result<Option<Exporter>> {
    let usual = if is_server || stderr().is_terminal() { "info" } else { "warn" };
    let log = config.log.as_deref().unwrap_or(usual);
    let directives = match log {
        "" => "audit=info".to_owned(),
        given => format!("audit=info,{given}"),
    };
    // Levels by target; a filter that also looks at spans and fields would bring a regex engine.
    let filter: Targets = directives.parse().with_context(|| anyhow!("log filter `{log}`"))?;
    let lines = tracing_subscriber::fmt::layer().with_writer(stderr);
    let lines = match config.log_format {
        LogFormat::Text => lines.with_ansi(has_colors()).boxed(),
        LogFormat::Json => lines.json().flatten_event(true).with_current_span(false).boxed(),
    };
    let exporter = collector.map(Exporter::new).transpose()?;
    let registry = tracing_subscriber::registry()
        .with(exporter.as_ref().map(Exporter::layer))
        .with(lines.with_filter(filter));
    // The only failure is that a subscriber is installed already, as in tests.
    let started = registry.try_init().is_ok();
    if started && config.log_format == LogFormat::Json {
        std::panic::set_hook(Box::new(|panic| {
            let location = panic.location().map(ToString::to_string).unwrap_or_default();
            let text = panic.payload_as_str().unwrap_or("no message");
            tracing::error!(location, "panic: {text}");
        }));
    }
    Ok(exporter)
}

/// Whether standard error is a terminal whose user has not asked for plain text (no-color.org).
fn has_colors() -> bool {
    stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}
