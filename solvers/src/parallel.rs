//! Loops over coarse pieces of work on the thread pool that the caller runs in.
//!
//! One loop of rayon, compiled once: a loop of its own at each place was a tenth of the crate's code.
//! A piece costs a lock, and with several threads its part in dealing out the work, so it should be worth
//! a microsecond at least. Pieces are cut by the caller and results keep their order, so that sums do not
//! depend on the number of threads.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// `work` for each item, in any order and several at a time.
pub(crate) fn for_each<T: Send>(items: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
    let items: Vec<_> = items.map(|item| Mutex::new(Some(item))).collect();
    // Nobody else has the lock: it moves the item to the task that takes it.
    let take = |k: usize| items[k].lock().unwrap_or_else(PoisonError::into_inner).take();
    run(items.len(), &|k| take(k).into_iter().for_each(&work));
}

/// What `work` gives for each item, in the order of the items.
pub(crate) fn map<T: Send, R: Send>(
    items: impl ExactSizeIterator<Item = T>,
    work: impl Fn(T) -> R + Sync,
) -> Vec<R> {
    let mut results: Vec<Option<R>> = (0..items.len()).map(|_| None).collect();
    for_each(items.zip(&mut results), |(item, result)| *result = Some(work(item)));
    results.into_iter().flatten().collect()
}

/// What `work` gives for each of many small items, of which a task takes `run` one after the other.
/// The list is full of `blank` at first, and each result replaces one.
pub(crate) fn map_in_runs<T: Sync, R: Clone + Send>(
    items: &[T],
    run: usize,
    blank: R,
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let mut results = vec![blank; items.len()];
    for_each(items.chunks(run).zip(results.chunks_mut(run)), |(items, results)| {
        for (item, result) in items.iter().zip(results) {
            *result = work(item);
        }
    });
    results
}

fn run(count: usize, work: &(dyn Fn(usize) + Sync)) {
    let threads = rayon::current_num_threads();
    if threads == 1 || count == 1 {
        return (0..count).for_each(work);
    }
    // Several pieces a thread, so that all end at about the same time.
    let most = (count / (8 * threads)).max(1);
    (0..count).into_par_iter().with_max_len(most).for_each(work);
}
