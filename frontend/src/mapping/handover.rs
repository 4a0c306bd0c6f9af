//! What tracking and mapping hand to each other without waiting: new keyframes one way, corrections
//! the other.
//!
//! There is one place for corrections. Mapping takes back what tracking has not fetched, joins it with
//! what is newer and puts it there again: what waits never grows beyond one value for each keyframe
//! and landmark. Tracking fetches it between two frames, or at the next one where mapping holds the
//! place just then. In lock-step tracking waits for the corrections after each keyframe instead.

use std::sync::mpsc;
use std::sync::{Arc, Mutex, PoisonError};

use crate::local_map::Corrections;

/// Where mapping puts corrections.
#[derive(Debug)]
pub(super) enum Putting {
    /// Tracking waits for them.
    LockStep(mpsc::Sender<Corrections>),
    /// Tracking fetches them when it wants to.
    Beside(Arc<Mutex<Option<Corrections>>>),
}

/// Where tracking gets them.
#[derive(Debug)]
pub(super) enum Fetching {
    /// After each keyframe, as long as it takes.
    LockStep(mpsc::Receiver<Corrections>),
    /// Between frames, at once.
    Beside(Arc<Mutex<Option<Corrections>>>),
}

/// Both ends.
pub(super) fn corrections(lock_step: bool) -> (Putting, Fetching) {
    if lock_step {
        let (sender, receiver) = mpsc::channel();
        (Putting::LockStep(sender), Fetching::LockStep(receiver))
    } else {
        let place = Arc::new(Mutex::new(None));
        (Putting::Beside(Arc::clone(&place)), Fetching::Beside(place))
    }
}

impl Putting {
    /// Hands corrections over.
    pub(super) fn put(&self, corrections: Corrections) {
        match self {
            // The receiver is gone when tracking has ended.
            Self::LockStep(sender) => drop(sender.send(corrections)),
            Self::Beside(place) => {
                if corrections.is_empty() {
                    return;
                }
                let waiting = place.lock().unwrap_or_else(PoisonError::into_inner).take();
                // Without the lock: tracking need not wait while these are joined.
                let all = match waiting {
                    Some(earlier) => earlier.then(corrections),
                    None => corrections,
                };
                *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(all);
            }
        }
    }
}

impl Fetching {
    /// What has come so far; never waits. In lock-step nothing comes between keyframes.
    pub(super) fn fetch(&self) -> Option<Corrections> {
        match self {
            Self::LockStep(_) => None,
            Self::Beside(place) => place.try_lock().ok()?.take(),
        }
    }

    /// After a keyframe was handed over: in lock-step waits for what it corrected.
    pub(super) fn after_keyframe(&self) -> Option<Corrections> {
        match self {
            // Without a sender the run is over.
            Self::LockStep(receiver) => receiver.recv().ok(),
            Self::Beside(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn point(id: usize, x: f64) -> Corrections {
        Corrections { landmarks: vec![(id, Vector3::new(x, 0.0, 0.0))], ..Default::default() }
    }

    #[test]
    fn what_tracking_does_not_fetch_is_joined_and_does_not_pile_up() {
        let (putting, fetching) = corrections(false);
        assert_eq!(fetching.fetch(), None);
        for round in 0..1000 {
            putting.put(point(round % 3, round as f64));
        }
        let fetched = fetching.fetch().unwrap();
        let x: Vec<f64> = fetched.landmarks.iter().map(|(_, point)| point.x).collect();
        assert_eq!(x, [999.0, 997.0, 998.0]);
        assert_eq!((fetching.fetch(), fetching.after_keyframe()), (None, None));
        putting.put(Corrections::default());
        assert_eq!(fetching.fetch(), None, "nothing to tell");
    }

    #[test]
    fn tracking_goes_on_without_corrections_while_mapping_holds_their_place() {
        let (putting, fetching) = corrections(false);
        putting.put(point(0, 1.0));
        let Putting::Beside(place) = &putting else { panic!() };
        let held = place.lock().unwrap();
        assert_eq!(fetching.fetch(), None);
        drop(held);
        assert!(fetching.fetch().is_some());
    }

    #[test]
    fn in_lock_step_each_keyframe_has_its_corrections_and_an_ended_run_none() {
        let (putting, fetching) = corrections(true);
        putting.put(point(0, 1.0));
        putting.put(Corrections::default());
        assert_eq!(fetching.fetch(), None);
        assert_eq!(fetching.after_keyframe(), Some(point(0, 1.0)));
        assert_eq!(fetching.after_keyframe(), Some(Corrections::default()));
        drop(putting);
        assert_eq!(fetching.after_keyframe(), None);
    }
}
