//! Loops over coarse pieces of work on the thread pool that the caller runs in.
//!
//! One loop of rayon, compiled once: a loop of its own at each place was a tenth of the crate's code.
//! A piece costs an allocation, so it should be worth a microsecond at least. Pieces are cut by the
//! caller and results keep their order, so that sums do not depend on the number of threads.

use rayon::prelude::*;

type Task<'a> = Box<dyn FnOnce() + Send + 'a>;

/// `work` for each item, in any order and several at a time.
pub(crate) fn for_each<T: Send>(items: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
    let work = &work;
    run(items.map(|item| Box::new(move || work(item)) as Task<'_>).collect());
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

fn run(tasks: Vec<Task<'_>>) {
    tasks.into_par_iter().with_max_len(1).for_each(|task| task());
}
