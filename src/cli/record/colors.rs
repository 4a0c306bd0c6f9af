//! Colors of landmarks, where the images of keyframes show them. The tracking thread of a run learns them, the
//! recorder of its map reads them. A server knows no images, so that other recordings have none.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::frontend::image::Image;
use crate::frontend::tracking::keyframe::NewKeyframe;

/// Red, green and blue.
type Color = [u8; 3];

/// What landmarks of one client look like, by their ids: as the first keyframe shows them.
#[derive(Clone, Debug, Default)]
pub(super) struct Colors {
    /// The client whose landmarks they are.
    pub(super) client: String,
    of: Arc<Mutex<BTreeMap<i64, Color>>>,
}

impl Colors {
    pub(super) fn new(client: &str) -> Self {
        Self { client: client.to_owned(), ..Self::default() }
    }

    /// Learns them from a keyframe and its image.
    pub(super) fn learn(&self, keyframe: &NewKeyframe, image: &Image<Color>) {
        let (width, height) = image.size();
        let mut of = self.known();
        for seen in &keyframe.observations {
            let pixel = seen.seen.pixel;
            let (u, v) = (pixel.x.round().max(0.0) as usize, pixel.y.round().max(0.0) as usize);
            if let (Ok(id), true) = (i64::try_from(seen.landmark), u < width && v < height) {
                of.entry(id).or_insert_with(|| image.at(u, v));
            }
        }
    }

    /// Those that are known by now.
    pub(super) fn known(&self) -> MutexGuard<'_, BTreeMap<i64, Color>> {
        // A thread that panicked has left no half of a color.
        self.of.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
