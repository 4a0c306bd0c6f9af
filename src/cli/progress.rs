//! Progress of a long command: a bar on a terminal, a log line every tenth otherwise; what has no length
//! shows that it works, on a terminal only.
//!
//! Everything goes to standard error, so that `--json` on standard output stays clean.

use std::fmt::Display;
use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::service::escaped;

/// How many log lines a whole run writes where there is no terminal.
const LOG_LINES: u64 = 10;

/// A sign of life on a terminal, of work whose length is not known; gone at the end.
#[derive(Debug)]
pub(super) struct Working(Option<ProgressBar>);

impl Working {
    /// Shows `what` is done, and for how long.
    #[must_use]
    pub(super) fn new(what: impl Display) -> Self {
        Self(std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
                bar.set_style(style);
            }
            bar.set_message(escaped(&what.to_string(), &[]).into_owned());
            bar.enable_steady_tick(Duration::from_millis(250));
            bar
        }))
    }

    /// Shows something else.
    pub(super) fn tell(&self, what: impl Display) {
        if let Some(bar) = &self.0 {
            bar.set_message(escaped(&what.to_string(), &[]).into_owned());
        }
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

/// A count that goes up to a total.
#[derive(Debug)]
pub(super) struct Progress {
    label: &'static str,
    total: u64,
    done: u64,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Starts at 0 of `total`; `label` says what is counted, for instance `keyframes`.
    #[must_use]
    pub(super) fn new(label: &'static str, total: u64) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(total);
            let template = "{prefix} [{bar:30}] {pos}/{len} {elapsed}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.progress_chars("=> "));
            }
            bar.set_prefix(label);
            bar
        });
        Self { label, total, done: 0, bar }
    }

    /// Counts `count` more.
    pub(super) fn advance(&mut self, count: u64) {
        self.advance_to(self.done.saturating_add(count));
    }

    /// Counts up to `done`.
    pub(super) fn advance_to(&mut self, done: u64) {
        let before = self.done;
        self.done = done;
        match &self.bar {
            Some(bar) => bar.set_position(self.done),
            None if self.tenths(before) < self.tenths(self.done) => {
                tracing::info!("{}: {} of {}", self.label, self.done, self.total);
            }
            None => {}
        }
    }

    /// Ends the display and leaves the line standing.
    pub(super) fn finish(self) {
        if let Some(bar) = &self.bar {
            bar.finish();
        }
    }

    fn tenths(&self, done: u64) -> u64 {
        done.min(self.total).saturating_mul(LOG_LINES) / self.total.max(1)
    }
}
