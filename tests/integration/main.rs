//! The integration tests, one binary: the map's invariants, the service over loopback, the cli.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a failed unwrap is a failed test")]
#![allow(clippy::print_stderr, reason = "a skipped test says so in one line")]

mod backup;
mod cli_config;
mod cli_edit;
mod cli_eval;
mod cli_eval_mask;
mod cli_fuse;
mod cli_map;
mod cli_pose_graph;
mod cli_recorded;
mod cli_run;
mod cli_solve;
mod cli_support;
mod cli_synth;
mod client;
mod closure_verdicts;
mod common;
mod demo;
mod doctor;
mod durable;
mod engine;
mod first_frontend;
mod generated;
mod jwt;
mod links;
mod logs;
mod map_check;
mod map_covisibility;
mod map_edit_solves;
mod map_edits;
mod map_fold;
mod map_numbers;
mod map_placement;
mod map_priors;
mod map_problem;
mod map_retirement;
mod map_support;
mod metrics;
#[cfg(target_os = "linux")]
mod power;
mod proto_compat;
mod proxy;
mod reference;
mod replay;
mod replay_broken;
mod rights;
mod rpc_access;
mod rpc_bad_input;
mod rpc_bad_priors;
mod rpc_compression;
mod rpc_edits;
mod rpc_export;
mod rpc_gnss;
mod rpc_import;
mod rpc_ingest;
mod rpc_lists;
mod rpc_loop_closure;
mod rpc_maps;
mod rpc_odometry;
mod rpc_optimization;
mod rpc_optimize_map;
mod rpc_overload;
mod rpc_pose_graph;
mod rpc_prices;
mod rpc_server;
mod rpc_update;
mod rpc_violations;
mod rpc_watch;
mod rpc_watch_traffic;
#[cfg(feature = "opentelemetry")]
mod spans;
mod spill;
mod strangers;
mod tls;
