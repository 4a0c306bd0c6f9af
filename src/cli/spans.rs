//! Spans to a collector of OpenTelemetry, by OTLP over gRPC; in builds with the feature
//! `opentelemetry`. Without it a collector's URL is refused; tests are built with it, and with the
//! refusal beside it.
//!
//! Exported are spans of covis from DEBUG up, whatever the log filter says: `rpc`, `item`, `solve`.
//! The span `map` is the context of a map's log lines and lasts as long as the server: it is no
//! part of a trace. The exporter has a thread of its own; what a slow collector does not take is
//! dropped.

#[cfg(feature = "opentelemetry")]
pub(super) use exporting::Exporter;
#[cfg(not(feature = "opentelemetry"))]
pub(super) use nothing::Exporter;

#[cfg(feature = "opentelemetry")]
mod exporting {
    use anyhow::Context;
    use opentelemetry::trace::TracerProvider;
    use opentelemetry_otlp::{SpanExporter, WithExportConfig};
    use opentelemetry_sdk::Resource;
    use opentelemetry_sdk::trace::SdkTracerProvider;
    use tracing::level_filters::LevelFilter;
    use tracing::{Level, Metadata, Subscriber};
    use tracing_subscriber::Layer;
    use tracing_subscriber::filter::filter_fn;
    use tracing_subscriber::registry::LookupSpan;

    /// Exports spans; dropping it sends what is left.
    pub(in crate::cli) struct Exporter {
        provider: SdkTracerProvider,
        /// For the exporter's connection, which outlives the command's own runtime.
        _runtime: tokio::runtime::Runtime,
    }

    impl Exporter {
        /// An exporter to the collector at `endpoint`; it connects when there is something to send.
        /// Fails where `endpoint` is no URL.
        pub(in crate::cli) fn new(endpoint: &str) -> anyhow::Result<Self> {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .thread_name("covis-spans")
                .enable_all()
                .build()
                .context("the thread that exports spans")?;
            let _entered = runtime.enter();
            let exporter = SpanExporter::builder()
                .with_tonic()
                .with_endpoint(endpoint)
                .build()
                .with_context(|| format!("exporting spans to {endpoint}"))?;
            let resource = Resource::builder().with_service_name("covis").build();
            let provider = SdkTracerProvider::builder()
                .with_resource(resource)
                .with_batch_exporter(exporter)
                .build();
            drop(_entered);
            Ok(Self { provider, _runtime: runtime })
        }

        /// The layer that hands spans over.
        pub(in crate::cli) fn layer<S>(&self) -> impl Layer<S> + use<S>
        where
            S: Subscriber + for<'span> LookupSpan<'span>,
        {
            let exported = |metadata: &Metadata<'_>| {
                let is_ours = metadata.target().split("::").next() == Some("covis");
                is_ours && *metadata.level() <= Level::DEBUG && metadata.name() != "map"
            };
            tracing_opentelemetry::layer()
                .with_tracer(self.provider.tracer("covis"))
                .with_filter(filter_fn(exported).with_max_level_hint(LevelFilter::DEBUG))
        }
    }

    impl Drop for Exporter {
        fn drop(&mut self) {
            if let Err(error) = self.provider.shutdown() {
                tracing::warn!(%error, "the last spans were not exported");
            }
        }
    }
}

#[cfg(any(test, not(feature = "opentelemetry")))]
mod nothing {
    /// There is none.
    pub(in crate::cli) enum Exporter {}

    impl Exporter {
        /// Refuses.
        ///
        /// # Errors
        /// Always.
        pub(in crate::cli) fn new(endpoint: &str) -> anyhow::Result<Self> {
            anyhow::bail!(
                "this build has no OpenTelemetry and cannot export to {endpoint}: build covis with \
                 --features opentelemetry"
            )
        }

        #[cfg(not(feature = "opentelemetry"))]
        pub(in crate::cli) fn layer(&self) -> tracing_subscriber::layer::Identity {
            tracing_subscriber::layer::Identity::new()
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_build_without_opentelemetry_says_so() {
        let endpoint = "http://127.0.0.1:4317";
        let refused = super::nothing::Exporter::new(endpoint).err().unwrap().to_string();
        for part in ["no OpenTelemetry", endpoint, "--features opentelemetry"] {
            assert!(refused.contains(part), "{refused}");
        }
    }
}
