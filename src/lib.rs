//! covis: an optimization-centric SLAM backend service.
//!
//! Frontends stream keyframes over gRPC, covis keeps the map, refines it and pushes corrections
//! back. `ARCHITECTURE.md` says how it is built. The modules, lowest first; some are of crates
//! of their own (`covis_map`, `covis_store`, `covis_client`, `covis_frontend`), and the mathematics is
//! [`covis_solvers`]:
//!
//! | module | role |
//! |---|---|
//! | [`meter`] | counters, gauges and histograms as plain atomics |
//! | [`map`] | the map and its invariants; no async, no wire |
//! | [`place`] | place recognition: an index over the keyframes' descriptors |
//! | [`loop_closing`] | which candidates for the place of a view are that place |
//! | [`store`] | journal of a map's events, files of jobs |
//! | [`evaluation`] | trajectory errors as evo and the TUM scripts define them, overlap of masks |
//! | [`wire`] | messages and services of `covis.v1` |
//! | [`service`] | the engine that owns a map, and the gRPC edge |
//! | [`client`] | what a frontend in Rust links; knows nothing of the server |
//! | [`frontend`] | the reference frontend; reaches a server through the client alone |
//! | [`report`] | reports as HTML files: pages, tables, pictures |
//! | [`cli`] | one file or folder a subcommand |

pub mod cli;
#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod service;

pub use covis_client as client;
pub use covis_client::wire;
pub use covis_frontend as frontend;
pub use covis_map as map;
pub use covis_map::{loop_closing, place};
pub use covis_reports::{evaluation, html as report};
pub use covis_store as store;
pub use covis_store::meter;
pub(crate) use covis_store::sync;
