//! Approximate minimum degree on the block graph, by faer, behind an exact reduction.
//!
//! Vertices of at most two neighbors are eliminated first, as minimum degree would: that takes the
//! chains of a trajectory away in linear time. Removing a vertex of two neighbors joins them, so a
//! neighbor's list never grows and everything happens in place. Sizes of blocks and values are not
//! looked at.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

use super::graph::Graph;
use crate::interrupt::Interrupt;

/// Entries of the neighbor lists from which the order takes more than some 10 ms.
const LONG: usize = 50_000;

/// How often a wait for an order asks whether it must end.
const QUESTION_EVERY: Duration = Duration::from_millis(5);

/// Orders that are still computed although their calls have returned. With this many of them a call
/// waits for its order.
const MOST_ABANDONED: usize = 4;
static ABANDONED: AtomicUsize = AtomicUsize::new(0);

/// States of an order on a thread of its own.
const RUNNING: u8 = 0;
const ENDED: u8 = 1;
const LEFT: u8 = 2;

/// The order, or `None` for want of memory or of index range.
pub(super) fn minimum_degree(graph: &Graph) -> Option<Vec<u32>> {
    reduced(graph, approximate)
}

/// The same; `None` once `interrupt` is due as well. faer's AMD cannot be interrupted: for a graph
/// where it may take long it runs on a thread of its own, which then continues without a receiver. At
/// most `MOST_ABANDONED` threads do so; beyond that number the call waits for its order.
pub(super) fn minimum_degree_until(graph: &Arc<Graph>, interrupt: &Interrupt) -> Option<Vec<u32>> {
    if interrupt.is_never() || graph.items.len() < LONG {
        return minimum_degree(graph);
    }
    let (reply, answer) = mpsc::channel();
    let state = Arc::new(AtomicU8::new(RUNNING));
    let (for_thread, state_of_thread) = (Arc::clone(graph), Arc::clone(&state));
    let work = move || {
        let order = minimum_degree(&for_thread);
        if state_of_thread.swap(ENDED, Ordering::AcqRel) == LEFT {
            ABANDONED.fetch_sub(1, Ordering::AcqRel);
        }
        // Nobody may wait for it any more.
        let _unread = reply.send(order);
    };
    if thread::Builder::new().name("covis-ordering".to_owned()).spawn(work).is_err() {
        return minimum_degree(graph);
    }
    loop {
        match answer.recv_timeout(QUESTION_EVERY) {
            Ok(order) => return order,
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) if interrupt.is_due() && may_leave(&state) => {
                return None;
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// Leaves an order to itself, where that may be.
fn may_leave(state: &AtomicU8) -> bool {
    let one_more = |abandoned: usize| (abandoned < MOST_ABANDONED).then_some(abandoned + 1);
    if ABANDONED.fetch_update(Ordering::AcqRel, Ordering::Acquire, one_more).is_err() {
        return false;
    }
    if state.swap(LEFT, Ordering::AcqRel) == ENDED {
        // It ended just now.
        ABANDONED.fetch_sub(1, Ordering::AcqRel);
    }
    true
}

/// The reduction, then `order_core` on what is left.
pub(super) fn reduced(
    graph: &Graph,
    order_core: impl FnOnce(&Graph) -> Option<Vec<u32>>,
) -> Option<Vec<u32>> {
    let count = graph.count();
    let mut order = Vec::with_capacity(count);
    let mut lists = graph.items.clone();
    let mut degrees: Vec<u32> = (0..count).map(|v| graph.of(v).len() as u32).collect();
    let mut is_eliminated = vec![false; count];
    let mut pending = Vec::new();
    // Leaves first: a junction that has two neighbors left is then no longer one with leaves.
    for (most, start) in (1..=2).flat_map(|most| (0..count as u32).map(move |v| (most, v))) {
        pending.push(start);
        while let Some(v) = pending.pop() {
            let v = v as usize;
            if is_eliminated[v] || degrees[v] > most {
                continue;
            }
            is_eliminated[v] = true;
            order.push(v as u32);
            let first = graph.starts[v];
            match *lists.get(first..first + degrees[v] as usize)? {
                [a] => {
                    replace(graph, &mut lists, &mut degrees, a, v as u32, None);
                    pending.push(a);
                }
                [a, b] => {
                    replace(graph, &mut lists, &mut degrees, a, v as u32, Some(b));
                    replace(graph, &mut lists, &mut degrees, b, v as u32, Some(a));
                    pending.extend([a, b]);
                }
                _ => {}
            }
        }
    }
    if order.len() < count {
        let left = |v: usize| &lists[graph.starts[v]..][..degrees[v] as usize];
        let (mut core, kept) = graph.induced(|v| !is_eliminated[v], left);
        for v in 0..core.count() {
            let range = core.range(v);
            core.items[range].sort_unstable();
        }
        order.extend(order_core(&core)?.into_iter().map(|k| kept[k as usize]));
    }
    Some(order)
}

/// Replaces `old` by `new` among the neighbors of `v`. Removes `old` where there is no `new`, or where
/// `new` is a neighbor already.
fn replace(
    graph: &Graph,
    lists: &mut [u32],
    degrees: &mut [u32],
    v: u32,
    old: u32,
    new: Option<u32>,
) {
    let first = graph.starts[v as usize];
    let degree = &mut degrees[v as usize];
    let list = &mut lists[first..first + *degree as usize];
    let Some(at) = list.iter().position(|&w| w == old) else { return };
    match new.filter(|new| !list.contains(new)) {
        Some(new) => list[at] = new,
        None => {
            list[at] = list[list.len() - 1];
            *degree -= 1;
        }
    }
}

/// AMD by faer.
pub(super) fn approximate(graph: &Graph) -> Option<Vec<u32>> {
    let count = graph.count();
    // Lower neighbors by column are the upper triangle.
    let (mut starts, mut rows) = (Vec::with_capacity(count + 1), Vec::new());
    starts.push(0u32);
    for v in 0..count {
        rows.extend(graph.of(v).iter().filter(|&&w| (w as usize) < v));
        starts.push(rows.len() as u32);
    }
    let upper = SymbolicSparseColMatRef::new_checked(count, count, &starts, None, &rows);
    let (mut order, mut position) = (vec![0u32; count], vec![0u32; count]);
    let mut memory = MemBuffer::try_new(amd::order_scratch::<u32>(count, rows.len())).ok()?;
    let control = amd::Control::default();
    amd::order(&mut order, &mut position, upper, control, MemStack::new(&mut memory)).ok()?;
    Some(order)
}
