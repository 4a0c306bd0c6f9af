//! Telemetry for operators: the instruments as a page for Prometheus, and spans of calls.
//!
//! The instruments themselves are plain atomics that the engine, the store and the edge hold; only
//! here they get names, units and help texts. No label has the name of a map, a client or a tenant,
//! so that the page does not grow with them. `docs/operations.md` explains each row.
//!
//! | module | role |
//! |---|---|
//! | `page` | every family with its rows |
//! | `text` | the exposition format |
//! | `calls` | counts RPCs, opens their span |
//! | `http` | `GET /metrics` and nothing else |
//! | `parent` | the caller's trace, in builds with OpenTelemetry |
//! | `process` | what the system reports about the process |

mod calls;
mod http;
mod page;
mod parent;
mod process;
mod text;

use std::sync::Arc;

use crate::meter::Counter;
use crate::store::StoreMeters;
use calls::CallMeters;

pub(super) use calls::Metered;
pub(super) use http::{respond, serve};
pub(super) use page::page;
pub(super) use process::max_open_files;

/// Instruments of a server besides those of its engines.
#[derive(Debug)]
pub(super) struct ServerMeters {
    /// Calls by RPC.
    pub calls: Arc<CallMeters>,
    /// Panics that were caught in handlers.
    pub rpc_panics: Counter,
    /// TLS handshakes that failed or took too long.
    pub failed_handshakes: Counter,
    /// The instruments of the store.
    pub store: Arc<StoreMeters>,
}

impl ServerMeters {
    /// New instruments, with those of a store.
    pub(super) fn new(store: Arc<StoreMeters>) -> Self {
        let (rpc_panics, failed_handshakes) = (Counter::default(), Counter::default());
        Self { calls: Arc::new(CallMeters::new()), rpc_panics, failed_handshakes, store }
    }
}
