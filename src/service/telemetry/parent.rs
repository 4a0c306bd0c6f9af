//! The trace that a caller is in: its `traceparent` becomes the parent of the call's span.
//!
//! Without the feature `opentelemetry` nothing is done.

use tonic::codegen::http::HeaderMap;
use tracing::Span;

/// Makes `span` a child of the span that the headers name, if they name one.
#[cfg(not(feature = "opentelemetry"))]
pub(super) fn adopt(_span: &Span, _headers: &HeaderMap) {}

/// Makes `span` a child of the span that the headers name, if they name one.
#[cfg(feature = "opentelemetry")]
pub(super) fn adopt(span: &Span, headers: &HeaderMap) {
    use opentelemetry::propagation::{Extractor, TextMapPropagator};
    use opentelemetry_sdk::propagation::TraceContextPropagator;
    use tracing_opentelemetry::OpenTelemetrySpanExt;

    struct Headers<'a>(&'a HeaderMap);
    impl Extractor for Headers<'_> {
        fn get(&self, key: &str) -> Option<&str> {
            self.0.get(key)?.to_str().ok()
        }
        fn keys(&self) -> Vec<&str> {
            self.0.keys().map(|name| name.as_str()).collect()
        }
    }
    if headers.contains_key("traceparent") {
        let context = TraceContextPropagator::new().extract(&Headers(headers));
        // Refused only if there is no exporter.
        let _refused = span.set_parent(context);
    }
}
