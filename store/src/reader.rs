//! A journal as its readers take it: a piece at a time.
//!
//! Whether a piece comes from memory or from a file is not known here.

use std::sync::Arc;

use async_trait::async_trait;

use super::{StoreError, sequence_of};
use covis_map::Event;

/// Most events of a piece.
pub(super) const PIECE_EVENTS: usize = 1024;

/// Events that follow each other.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// At least one, but at the end.
    pub events: Vec<Arc<Event>>,
    /// What they take in the journal; 0 where that is not known.
    pub bytes: u64,
}

/// Reads a journal in order.
#[async_trait]
pub trait EventReader: Send {
    /// The next events; without any at the end. Canceled, it is not to be asked again.
    ///
    /// # Errors
    /// [`StoreError`] where they cannot be read, [`StoreError::Truncated`] where they have gone.
    async fn next(&mut self) -> Result<Piece, StoreError>;
}

/// For a store that cannot read in pieces.
pub(super) fn whole(mut events: Vec<Arc<Event>>, through: u64) -> Box<dyn EventReader> {
    events.retain(|event| sequence_of(event.revision) <= through);
    Box::new(WholeReader(events.into_iter()))
}

struct WholeReader(std::vec::IntoIter<Arc<Event>>);

#[async_trait]
impl EventReader for WholeReader {
    async fn next(&mut self) -> Result<Piece, StoreError> {
        Ok(Piece { events: self.0.by_ref().take(PIECE_EVENTS).collect(), bytes: 0 })
    }
}
