//! Every family of the page, with its name, its help and its rows.
//!
//! Names of counters end in `_total`, other names in their unit. A name that changes here must
//! change in `docs/operations.md`; a test compares it with the page. It reads meters and waits for no
//! engine.

use std::sync::atomic::Ordering;

use super::process;
use super::text::Text;
use crate::service::connections::Connections;
use crate::service::context::Context;
use crate::service::engine::EngineMeters;
use crate::service::jobs::Jobs;
use crate::store::StoreMeters;

/// The page of a server as it is now.
pub(in crate::service) fn page(context: &Context, jobs: &Jobs) -> String {
    let mut text = Text::default();
    server(&mut text, context);
    calls(&mut text, context);
    connections(&mut text, &context.connections);
    maps(&mut text, context);
    items(&mut text, context.maps.meters());
    solves(&mut text, context.maps.meters());
    job_counts(&mut text, jobs);
    store(&mut text, &context.meters.store);
    text.finish()
}

fn server(text: &mut Text, context: &Context) {
    text.gauge("covis_build_info", "Which build runs; always 1.")
        .row(&[("version", env!("CARGO_PKG_VERSION"))], 1);
    text.gauge("covis_start_time_seconds", "Unix time of the server's start.")
        .row(&[], context.start_time_ns as f64 / 1e9);
    let serving = context.ready.load(Ordering::Acquire) && !*context.draining.borrow();
    text.gauge("covis_serving", "1 while calls are taken, 0 while maps open and while draining.")
        .row(&[], u8::from(serving));
    text.gauge("covis_solver_threads", "Threads of the solver pool.")
        .row(&[], context.maps.pool().threads());
    let mut family = text.gauge("covis_resident_memory_bytes", "Resident memory of the process.");
    process::resident_bytes().into_iter().for_each(|bytes| {
        family.row(&[], bytes);
    });
    let mut family = text.gauge("covis_open_files", "Files and sockets that are open.");
    process::open_files().into_iter().for_each(|count| {
        family.row(&[], count);
    });
    let mut family = text.gauge("covis_open_files_limit", "Files that may be open.");
    process::max_open_files().into_iter().for_each(|count| {
        family.row(&[], count);
    });
    let engine = context.maps.meters();
    text.counter(
        "covis_panics_total",
        "Panics that were caught: bugs, each in the log with its id.",
    )
    .row(&[("where", "engine")], engine.engine_panics.get())
    .row(&[("where", "solve")], engine.solve_panics.get())
    .row(&[("where", "rpc")], context.meters.rpc_panics.get());
}

fn calls(text: &mut Text, context: &Context) {
    let mut family = text.counter("covis_rpcs_total", "Calls that ended, by RPC and status code.");
    for (rpc, meter) in context.meters.calls.rows() {
        for (code, count) in meter.codes() {
            family.row(&[("rpc", rpc), ("code", code)], count);
        }
    }
    let help = "From a call's headers to the end of its answer; streams to their end.";
    let mut family = text.histogram("covis_rpc_duration_seconds", help);
    for (rpc, meter) in context.meters.calls.rows() {
        family.seconds(&[("rpc", rpc)], &meter.duration_ns);
    }
    text.counter("covis_tls_handshake_failures_total", "TLS handshakes that failed.")
        .row(&[], context.meters.failed_handshakes.get());
}

fn connections(text: &mut Text, connections: &Connections) {
    let (strangers, known) = connections.counts();
    text.gauge("covis_connections", "Connections; strangers have made no call that was admitted.")
        .row(&[("state", "stranger")], strangers)
        .row(&[("state", "known")], known);
    let ends = &connections.ends;
    text.counter("covis_connections_ended_total", "Connections that the server ended.")
        .row(&[("reason", "displaced")], ends.displaced.get())
        .row(&[("reason", "stranger_time")], ends.stranger_time.get())
        .row(&[("reason", "idle")], ends.idle.get());
    text.counter("covis_accept_failures_total", "Connections that could not be accepted.")
        .row(&[], connections.accept_failures.get());
}

fn maps(text: &mut Text, context: &Context) {
    let counts = context.maps.counts();
    let help = "Maps; read-only by request (frozen), by a bug (poisoned), or by damage or a failing \
                disk (damaged).";
    text.gauge("covis_maps", help)
        .row(&[("state", "open")], counts.open)
        .row(&[("state", "frozen")], counts.frozen)
        .row(&[("state", "poisoned")], counts.poisoned)
        .row(&[("state", "damaged")], counts.damaged);
    text.gauge("covis_queue_items", "Items that wait for their engine, all maps.")
        .row(&[], counts.queued);
    text.gauge("covis_queue_capacity_items", "Room for waiting items, all maps.")
        .row(&[], counts.queue_capacity);
    text.gauge("covis_queue_fullest_ratio", "How full the fullest map's queue is.")
        .row(&[], counts.fullest);
    let account = context.maps.pool().accounts().server().rows();
    let help = "What the server holds of everything that has a limit, all tenants.";
    let mut family = text.gauge("covis_resource_held", help);
    for row in &account {
        family.row(&[("resource", row.name)], row.held);
    }
    let help = "How much of it the server may hold; no row where that is not limited.";
    let mut family = text.gauge("covis_resource_limit", help);
    for row in &account {
        row.limit.into_iter().for_each(|limit| {
            family.row(&[("resource", row.name)], limit);
        });
    }
    let engine = context.maps.meters();
    text.gauge("covis_ingest_streams", "Ingest streams that are open.")
        .row(&[], engine.streams.get());
    text.gauge("covis_watchers", "Watchers of maps.").row(&[], engine.watchers.get());
}

fn items(text: &mut Text, engine: &EngineMeters) {
    let help = "Items by outcome; `ceiling` ended its stream.";
    let mut family = text.counter("covis_items_total", help);
    family
        .row(&[("outcome", "received")], engine.received.get())
        .row(&[("outcome", "duplicate")], engine.duplicate.get())
        .row(&[("outcome", "ceiling")], engine.at_limit.get());
    for (reason, count) in engine.rejected() {
        family.row(&[("outcome", "rejected"), ("reason", reason)], count.get());
    }
    let help = "Invalid changes that were refused, such as a result that overflowed.";
    let mut family = text.counter("covis_changes_refused_total", help);
    for (change, count) in engine.refused() {
        family.row(&[("change", change)], count.get());
    }
    let help = "Keyframes that were marginalized because their map was full.";
    text.counter("covis_keyframes_retired_total", help).row(&[], engine.retired.get());
    let help = "Loop closures that the server found.";
    text.counter("covis_closures_found_total", help).row(&[], engine.closures_found.get());
    let help = "How long the search for the place of a keyframe took.";
    text.histogram("covis_place_search_seconds", help).seconds(&[], &engine.place_search_ns);
    let help = "From an item's arrival until it was on disk.";
    text.histogram("covis_item_durable_seconds", help).seconds(&[], &engine.durable_ns);
    let help = "From an item's arrival until its solve was applied.";
    text.histogram("covis_item_optimized_seconds", help).seconds(&[], &engine.optimized_ns);
}

fn solves(text: &mut Text, engine: &EngineMeters) {
    let mut family = text.counter("covis_solves_total", "Solves by kind and termination.");
    for (kind, solve) in engine.solves() {
        for (end, count) in solve.ends().filter(|(_, count)| count.get() > 0) {
            family.row(&[("kind", kind), ("termination", end)], count.get());
        }
    }
    let mut family = text.histogram("covis_solve_duration_seconds", "How long solves ran.");
    for (kind, solve) in engine.solves() {
        family.seconds(&[("kind", kind)], &solve.running_ns);
    }
    let help = "How long solves waited for a thread of the pool.";
    let mut family = text.histogram("covis_solve_wait_seconds", help);
    for (kind, solve) in engine.solves() {
        family.seconds(&[("kind", kind)], &solve.waiting_ns);
    }
    let mut family = text.gauge("covis_solves_running", "Solves that run.");
    for (kind, solve) in engine.solves() {
        family.row(&[("kind", kind)], solve.running.get());
    }
    let mut family = text.gauge("covis_solves_waiting", "Solves that wait for a thread.");
    for (kind, solve) in engine.solves() {
        family.row(&[("kind", kind)], solve.waiting.get());
    }
    let help = "Solves whose result was dropped: local ones for an adjustment after closures.";
    text.counter("covis_solves_superseded_total", help).row(&[], engine.superseded.get());
    let help = "Implausible results of local solves, by reason; the window was solved again with \
                the suspect keyframes held.";
    let mut family = text.counter("covis_solves_refused_total", help);
    for (reason, count) in engine.implausible().filter(|&(reason, _)| reason != "unmeasured") {
        family.row(&[("reason", reason)], count.get());
    }
    let help = "How long an engine held a thread of the async runtime at a time: processor time on \
                Linux, elapsed time elsewhere.";
    text.histogram("covis_engine_held_seconds", help).seconds(&[], &engine.held_ns);
}

fn job_counts(text: &mut Text, jobs: &Jobs) {
    let [pending, running, ended] = jobs.counts();
    text.gauge("covis_jobs", "Jobs: waiting, running, and ended ones that are kept.")
        .row(&[("state", "pending")], pending)
        .row(&[("state", "running")], running)
        .row(&[("state", "ended")], ended);
    let mut family = text.counter("covis_jobs_ended_total", "Jobs that ended, by kind and state.");
    for (kind, state, count) in jobs.meters.rows() {
        family.row(&[("kind", kind), ("state", state)], count);
    }
    text.histogram("covis_job_duration_seconds", "From a job's start to its end.")
        .seconds(&[], &jobs.meters.running_ns);
    text.histogram("covis_job_wait_seconds", "From a job's creation to its start.")
        .seconds(&[], &jobs.meters.waiting_ns);
}

fn store(text: &mut Text, store: &StoreMeters) {
    text.counter("covis_journal_bytes_total", "Bytes written to journals.")
        .row(&[], store.journal_bytes.get());
    text.histogram("covis_journal_group_events", "Events of one write and fsync.")
        .counts(&[], &store.group_events);
    text.histogram("covis_journal_sync_seconds", "How long a write and its fsync took.")
        .seconds(&[], &store.sync_ns);
    text.counter("covis_journal_failures_total", "Journals that a failed write or fsync stopped.")
        .row(&[], store.journal_failures.get());
    text.counter(
        "covis_journal_retries_total",
        "Journal writes that found no space, descriptors or memory.",
    )
    .row(&[], store.journal_retries.get());
    text.histogram("covis_snapshot_duration_seconds", "How long writing a snapshot took.")
        .seconds(&[], &store.snapshot_ns);
    text.counter("covis_snapshot_bytes_total", "Bytes of snapshots.")
        .row(&[], store.snapshot_bytes.get());
    text.counter("covis_snapshot_failures_total", "Snapshots that could not be written.")
        .row(&[], store.snapshot_failures.get());
}
