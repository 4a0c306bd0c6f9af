//! The next free ids of a client's keyframes and landmarks, counted from the server's answer and from what
//! is sent.
//!
//! They are above all ids of the client that the map holds and that were sent, whatever becomes of the items:
//! an id may be skipped, but none is given twice.

use super::wire::v1;
use v1::ingest_request::Item;

/// Each one more than the highest id so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NextIds {
    /// Of keyframes.
    pub keyframe: i64,
    /// Of landmarks.
    pub landmark: i64,
}

impl NextIds {
    /// Also above the ids of `other`.
    pub(super) fn join(&mut self, other: Self) {
        self.keyframe = self.keyframe.max(other.keyframe);
        self.landmark = self.landmark.max(other.landmark);
    }

    /// Also above the ids that an item brings.
    pub(super) fn take(&mut self, item: Option<&Item>) {
        let new = match item {
            Some(Item::Keyframe(keyframe)) => {
                self.keyframe = self.keyframe.max(keyframe.id.saturating_add(1));
                &keyframe.landmarks
            }
            Some(Item::Landmarks(batch)) => &batch.landmarks,
            // No other item brings a keyframe or a landmark.
            Some(_) | None => return,
        };
        let after = new.iter().map(|landmark| landmark.id.saturating_add(1)).max();
        self.landmark = self.landmark.max(after.unwrap_or(0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_above_all_that_items_bring() {
        let landmark = |id| v1::Landmark { id, ..v1::Landmark::default() };
        let mut next = NextIds::default();
        next.take(Some(&Item::Camera(v1::Camera { id: 9, ..v1::Camera::default() })));
        assert_eq!(next, NextIds::default());
        let landmarks = vec![landmark(7), landmark(3)];
        let keyframe = v1::Keyframe { id: 4, landmarks, ..v1::Keyframe::default() };
        next.take(Some(&Item::Keyframe(keyframe)));
        assert_eq!(next, NextIds { keyframe: 5, landmark: 8 });
        next.take(Some(&Item::Landmarks(v1::LandmarkBatch { landmarks: vec![landmark(2)] })));
        next.join(NextIds { keyframe: 2, landmark: 20 });
        assert_eq!(next, NextIds { keyframe: 5, landmark: 20 });
        let last = v1::Keyframe { id: i64::MAX, ..v1::Keyframe::default() };
        next.take(Some(&Item::Keyframe(last)));
        assert_eq!(next.keyframe, i64::MAX);
    }
}
