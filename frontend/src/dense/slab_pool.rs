//! Memory for blocks, made ready on a thread of its own: touching fresh memory for the first time costs
//! more than what a frame does with it.

use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use super::block::Block;

/// Blocks of a slab: a megabyte.
pub(super) const SLAB: usize = 256;
/// Slabs that are ready at most, besides one in the making.
const AHEAD: usize = 8;

/// Slabs of empty blocks.
pub(super) type Slab = Box<[Block]>;

/// Slabs that are ready. The thread starts with the first that is taken and ends with the pool.
#[derive(Debug, Default)]
pub(super) struct SlabPool {
    /// Behind a lock that is never taken: volumes are read by many threads, slabs are taken by one.
    ready: Mutex<Option<Receiver<Slab>>>,
}

impl SlabPool {
    /// A slab: one that is ready, or one that is made now.
    pub(super) fn take(&mut self) -> Slab {
        let ready = self.ready.get_mut().unwrap_or_else(PoisonError::into_inner);
        let ready = ready.get_or_insert_with(|| {
            let (give, take) = sync_channel(AHEAD);
            let make = move || while give.send(fresh()).is_ok() {};
            // Without a thread nothing is ever ready.
            let _ = thread::Builder::new().name("blocks".to_owned()).spawn(make);
            take
        });
        ready.try_recv().unwrap_or_else(|_| fresh())
    }
}

impl Clone for SlabPool {
    fn clone(&self) -> Self {
        Self::default()
    }
}

fn fresh() -> Slab {
    vec![Block::EMPTY; SLAB].into_boxed_slice()
}
