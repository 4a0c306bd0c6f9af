//! Memory for blocks, prepared on a separate thread: the first access to fresh memory costs more than
//! the work of a frame on it.

use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use super::block::Block;

/// Blocks of a slab: a megabyte.
pub(super) const SLAB: usize = 256;
/// Most slabs that are ready, besides the one being made.
const AHEAD: usize = 8;

/// Slabs of empty blocks.
pub(super) type Slab = Box<[Block]>;

/// Slabs that are ready. The thread starts when the first slab is taken and ends with the pool.
#[derive(Debug, Default)]
pub(super) struct SlabPool {
    /// The mutex is never locked: many threads may read a volume, but only one takes slabs.
    ready: Mutex<Option<Receiver<Slab>>>,
}

impl SlabPool {
    /// Takes a slab that is ready, or makes one.
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
