//! A map made smaller on request: redundant keyframes are marginalized, and the journal before a
//! snapshot is dropped.
//!
//! Which keyframes are redundant is found in a snapshot, beside the engine. The engine looks at each
//! again before it goes, a few at a time, so that items are taken in between. What a keyframe measured
//! stays as constraints and priors between others, as in a full map. Nothing is changed before the
//! caller's [`Cancellation`] is asked.

use std::future::ready;
use std::sync::Arc;

use futures_util::FutureExt;

use crate::map::{Map, redundant_keyframes};
use crate::service::engine::error::report_bug;
use crate::service::engine::{Cancellation, EngineError, MapHandle};

/// Keyframes that are removed before the engine takes items again.
const AT_ONCE: usize = 8;

/// What was made smaller.
#[derive(Clone, Debug)]
pub struct Compacted {
    /// The map before.
    pub before: Arc<Map>,
    /// The map after.
    pub after: Arc<Map>,
    /// Keyframes that went.
    pub retired: usize,
}

impl MapHandle {
    /// Removes keyframes of which `redundant_share` of the landmarks are seen by at least three others,
    /// where one is given, then drops the journal before a snapshot if `drop_journal`. `on_progress`
    /// gets how many keyframes were looked at, and of how many.
    ///
    /// # Errors
    /// [`EngineError::Cancelled`]: nothing was changed. [`EngineError::Frozen`],
    /// [`EngineError::Poisoned`], [`EngineError::Store`], [`EngineError::Bug`], and as
    /// [`MapHandle::info`].
    pub async fn compact(
        &self,
        redundant_share: Option<f64>,
        drop_journal: bool,
        cancellation: &Cancellation,
        mut on_progress: impl FnMut(usize, usize),
    ) -> Result<Compacted, EngineError> {
        let before = self.snapshot().await?;
        let keyframes = match redundant_share {
            None => Vec::new(),
            Some(share) => {
                let map = Arc::clone(&before);
                let found = tokio::task::spawn_blocking(move || redundant_keyframes(&map, share));
                found.await.map_err(|error| report_bug(&error.to_string()))?
            }
        };
        if !cancellation.commit() {
            return Err(EngineError::Cancelled { map: self.name().to_owned() });
        }
        let (all, mut looked, mut retired) = (keyframes.len(), 0, 0);
        let share = redundant_share.unwrap_or(1.0);
        for some in keyframes.chunks(AT_ONCE) {
            let keyframes = some.to_vec();
            let call = self.call(move |actor| actor.retire_redundant(keyframes, share).boxed());
            retired += call.await??;
            looked += some.len();
            on_progress(looked, all);
        }
        if drop_journal {
            let dropping = self.call(|actor| ready(actor.drop_journal()).boxed()).await??;
            dropping.await.map_err(|error| report_bug(&error.to_string()))??;
        }
        let after = self.snapshot().await?;
        self.durable(after.revision()).await?;
        Ok(Compacted { before, after, retired })
    }
}
