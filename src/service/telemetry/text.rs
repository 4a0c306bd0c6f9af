//! The text format that Prometheus scrapes, version 0.0.4.
//!
//! A family is a line of help, a line of its kind, and rows of labels and values; a histogram's rows
//! are cumulative. Numbers that are kept in ns are shown in seconds. Knows no metric of covis.

use std::fmt::{Display, Write};

use crate::meter::Histogram;

/// What HTTP calls this format.
pub(super) const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// A page that is being written.
#[derive(Debug, Default)]
pub(super) struct Text(String);

/// Name and value of each label.
pub(super) type Labels<'a> = &'a [(&'a str, &'a str)];

/// A family whose rows are being written.
pub(super) struct Family<'a> {
    text: &'a mut String,
    name: &'a str,
}

impl Text {
    /// Begins a family of counters; the name ends in `_total`.
    pub(super) fn counter<'a>(&'a mut self, name: &'a str, help: &str) -> Family<'a> {
        self.family(name, "counter", help)
    }

    /// Begins a family of gauges.
    pub(super) fn gauge<'a>(&'a mut self, name: &'a str, help: &str) -> Family<'a> {
        self.family(name, "gauge", help)
    }

    /// Begins a family of histograms.
    pub(super) fn histogram<'a>(&'a mut self, name: &'a str, help: &str) -> Family<'a> {
        self.family(name, "histogram", help)
    }

    /// The page.
    pub(super) fn finish(self) -> String {
        self.0
    }

    fn family<'a>(&'a mut self, name: &'a str, kind: &str, help: &str) -> Family<'a> {
        let text = &mut self.0;
        put(text, format_args!("# HELP {name} {help}\n# TYPE {name} {kind}\n"));
        Family { text, name }
    }
}

impl Family<'_> {
    /// One row.
    pub(super) fn row(&mut self, labels: Labels<'_>, value: impl Display) -> &mut Self {
        self.line("", labels, None, value);
        self
    }

    /// The rows of a histogram of durations in ns.
    pub(super) fn seconds(&mut self, labels: Labels<'_>, histogram: &Histogram) -> &mut Self {
        self.buckets(labels, histogram, |ns| ns as f64 / 1e9)
    }

    /// The rows of a histogram of counts.
    pub(super) fn counts(&mut self, labels: Labels<'_>, histogram: &Histogram) -> &mut Self {
        self.buckets(labels, histogram, |count| count as f64)
    }

    fn buckets(
        &mut self,
        labels: Labels<'_>,
        histogram: &Histogram,
        shown: impl Fn(u64) -> f64,
    ) -> &mut Self {
        let mut all = 0;
        for (bound, count) in histogram.cumulative() {
            let bound = bound.map_or_else(|| "+Inf".to_owned(), |bound| shown(bound).to_string());
            self.line("_bucket", labels, Some(("le", &bound)), count);
            all = count;
        }
        self.line("_sum", labels, None, shown(histogram.sum()));
        self.line("_count", labels, None, all);
        self
    }

    fn line(
        &mut self,
        suffix: &str,
        labels: Labels<'_>,
        last: Option<(&str, &str)>,
        value: impl Display,
    ) {
        put(self.text, format_args!("{}{suffix}", self.name));
        let mut before = '{';
        for (name, value) in labels.iter().copied().chain(last) {
            let value = value.replace('\\', r"\\").replace('"', "\\\"").replace('\n', r"\n");
            put(self.text, format_args!("{before}{name}=\"{value}\""));
            before = ',';
        }
        let after = if before == ',' { "}" } else { "" };
        put(self.text, format_args!("{after} {value}\n"));
    }
}

/// Writing to memory does not fail.
fn put(text: &mut String, what: std::fmt::Arguments<'_>) {
    let _written = text.write_fmt(what);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_as_the_format_wants_them() {
        let mut text = Text::default();
        text.counter("a_total", "All.").row(&[], 3).row(&[("b", "x\"\\\n")], 0.5);
        let histogram = Histogram::new(&[1_000_000, 2_000_000_000]);
        histogram.observe(1_500_000);
        text.histogram("h_seconds", "Times.").seconds(&[("k", "v")], &histogram);
        let expected = r#"# HELP a_total All.
# TYPE a_total counter
a_total 3
a_total{b="x\"\\\n"} 0.5
# HELP h_seconds Times.
# TYPE h_seconds histogram
h_seconds_bucket{k="v",le="0.001"} 0
h_seconds_bucket{k="v",le="2"} 1
h_seconds_bucket{k="v",le="+Inf"} 1
h_seconds_sum{k="v"} 0.0015
h_seconds_count{k="v"} 1
"#;
        assert_eq!(text.finish(), expected);
    }
}
