//! The service: engines that own maps, and the gRPC edge in front of them.
//!
//! A request goes wire → convert → engine and back; handlers are short and contain no mathematics.
//! The modules:
//!
//! | module | role |
//! |---|---|
//! | `server`, `config` | starting and stopping a server; its settings |
//! | [`engine`] | one actor per map: journal, fold, solves |
//! | `convert` | wire ↔ domain; names bad fields |
//! | `status`, `error`, `reasons` | domain error → status code, only here; why a call ends, and which field is wrong |
//! | `context`, `deadline` | turns a handler's outcome into an answer; when a call that solves must end |
//! | `names` | what may be a name, and maps without their tenants |
//! | `job_error` | why a call on a job ends early |
//! | `access` | tokens, roles and tenants: who may call what |
//! | `clock` | the clock that decides whether tokens and jobs have expired |
//! | `jobs` | work that outlives a call |
//! | `upload`, `import` | files that come in chunks; maps from them |
//! | `bundle_solve`, `graph_solve`, `refine`, `localize` | calls that solve on the pool and change no map |
//! | `connections` | who is connected, and for how long |
//! | `readers` | threads for streams that read whole maps |
//! | `tls` | certificates of the listeners |
//! | `routes` | the services, as the listeners serve them |
//! | `grpc_only`, `same_site` | what the listener of gRPC takes; requests that other sites send through a browser |
//! | `page` | the page for browsers |
//! | `telemetry`, `log_limit`, `random` | metrics, and spans of calls; a log that is not flooded; random ids |
//! | `printable` | characters that a terminal prints and does not obey |
//! | `*_service` | one file per service of the wire; `watch`, `export`, `listing` serve `MapService` |

pub mod engine;

mod access;
mod bundle_solve;
mod clock;
mod config;
mod connections;
mod context;
mod convert;
mod deadline;
mod error;
mod export;
#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
mod graph_solve;
mod grpc_only;
mod import;
mod ingest_service;
mod job_error;
mod job_service;
mod jobs;
mod listing;
mod localize;
mod log_limit;
mod map_service;
mod names;
mod optimization_service;
mod page;
mod printable;
mod random;
mod readers;
mod reasons;
mod refine;
mod routes;
mod same_site;
mod server;
mod server_service;
mod status;
mod telemetry;
mod tls;
mod upload;
mod watch;

pub use access::{AccessError, JwtOptions};
pub use clock::Clock;
pub use config::{KeepAlive, ServerConfig, SolveLimits, default_limits, default_map_limits};
pub use connections::ConnectionLimits;
#[cfg(feature = "cluster")]
pub use jobs::{Worker, WorkerConfig};
pub(crate) use jobs::{kind as kind_of_job, maps_of as maps_of_job};
pub(crate) use printable::escaped;
pub use server::{RunningServer, Server, ServerError, StartingServer};
pub use tls::{TlsError, TlsFiles};
