//! What tracking and mapping hand to each other without waiting: keyframes and questions one way,
//! corrections and answers the other.
//!
//! There is one slot for what goes to tracking. Mapping takes back what tracking has not fetched, joins
//! it with what is newer and puts it there again: what waits never grows beyond one value for each
//! keyframe and landmark, and the answer to the last question. Tracking fetches it between two frames, or
//! at the next one where mapping holds the slot just then. In lock-step tracking waits instead after
//! each keyframe and each question. Knows neither messages nor the network.

use std::sync::mpsc;
use std::sync::{Arc, Mutex, PoisonError};

use crate::local_map::Corrections;
use crate::pipeline::relocalization::{Answer, Question};
use crate::tracking::keyframe::NewKeyframe;

/// What tracking hands to mapping.
#[derive(Debug)]
pub(super) enum FromTracking {
    Keyframe(Box<NewKeyframe>),
    Question(Question),
}

/// What mapping hands to tracking.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct FromServer {
    pub(super) corrections: Corrections,
    /// To the question that was asked last; it is in the map as corrected.
    pub(super) answer: Option<Answer>,
}

impl From<Corrections> for FromServer {
    fn from(corrections: Corrections) -> Self {
        Self { corrections, answer: None }
    }
}

impl FromServer {
    fn is_empty(&self) -> bool {
        self.corrections.is_empty() && self.answer.is_none()
    }

    fn then(self, later: Self) -> Self {
        let answer = later.answer.or(self.answer);
        Self { corrections: self.corrections.then(later.corrections), answer }
    }
}

/// Where mapping puts it.
#[derive(Debug)]
pub(super) enum Putting {
    /// Tracking waits for it.
    LockStep(mpsc::Sender<FromServer>),
    /// Tracking fetches it when it wants to.
    Beside(Arc<Mutex<Option<FromServer>>>),
}

/// Where tracking gets it.
#[derive(Debug)]
pub(super) enum Fetching {
    /// After each keyframe and question, as long as it takes.
    LockStep(mpsc::Receiver<FromServer>),
    /// Between frames, at once.
    Beside(Arc<Mutex<Option<FromServer>>>),
}

/// Both ends.
pub(super) fn from_server(lock_step: bool) -> (Putting, Fetching) {
    if lock_step {
        let (sender, receiver) = mpsc::channel();
        (Putting::LockStep(sender), Fetching::LockStep(receiver))
    } else {
        let slot = Arc::new(Mutex::new(None));
        (Putting::Beside(Arc::clone(&slot)), Fetching::Beside(slot))
    }
}

impl Putting {
    /// Hands something over.
    pub(super) fn put(&self, news: FromServer) {
        match self {
            // The receiver is gone when tracking has ended.
            Self::LockStep(sender) => drop(sender.send(news)),
            Self::Beside(slot) => {
                if news.is_empty() {
                    return;
                }
                let waiting = slot.lock().unwrap_or_else(PoisonError::into_inner).take();
                // Without the lock: tracking need not wait while these are joined.
                let all = match waiting {
                    Some(earlier) => earlier.then(news),
                    None => news,
                };
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(all);
            }
        }
    }
}

impl Fetching {
    /// What has come so far; never waits. In lock-step nothing comes by itself.
    pub(super) fn fetch(&self) -> Option<FromServer> {
        match self {
            Self::LockStep(_) => None,
            Self::Beside(slot) => slot.try_lock().ok()?.take(),
        }
    }

    /// After a keyframe or a question was handed over: in lock-step waits for what follows from it.
    pub(super) fn after_handing_over(&self) -> Option<FromServer> {
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

    fn point(id: usize, x: f64) -> FromServer {
        let landmarks = vec![(id, Vector3::new(x, 0.0, 0.0))];
        Corrections { landmarks, ..Default::default() }.into()
    }

    #[test]
    fn what_tracking_does_not_fetch_is_joined_and_does_not_pile_up() {
        let (putting, fetching) = from_server(false);
        assert_eq!(fetching.fetch(), None);
        for round in 0..1000 {
            putting.put(point(round % 3, round as f64));
        }
        let fetched = fetching.fetch().unwrap();
        let x: Vec<f64> = fetched.corrections.landmarks.iter().map(|(_, point)| point.x).collect();
        assert_eq!(x, [999.0, 997.0, 998.0]);
        assert_eq!((fetching.fetch(), fetching.after_handing_over()), (None, None));
        putting.put(FromServer::default());
        assert_eq!(fetching.fetch(), None, "nothing to tell");
    }

    #[test]
    fn tracking_goes_on_without_corrections_while_mapping_holds_their_slot() {
        let (putting, fetching) = from_server(false);
        putting.put(point(0, 1.0));
        let Putting::Beside(slot) = &putting else { panic!() };
        let held = slot.lock().unwrap();
        assert_eq!(fetching.fetch(), None);
        drop(held);
        assert!(fetching.fetch().is_some());
    }

    #[test]
    fn in_lock_step_each_keyframe_has_its_corrections_and_an_ended_run_none() {
        let (putting, fetching) = from_server(true);
        putting.put(point(0, 1.0));
        putting.put(FromServer::default());
        assert_eq!(fetching.fetch(), None);
        assert_eq!(fetching.after_handing_over(), Some(point(0, 1.0)));
        assert_eq!(fetching.after_handing_over(), Some(FromServer::default()));
        drop(putting);
        assert_eq!(fetching.after_handing_over(), None);
    }

    #[test]
    fn an_answer_waits_with_the_corrections_and_a_later_one_takes_its_place() {
        let (putting, fetching) = from_server(false);
        let answered = |number: u64| FromServer {
            answer: Some(Answer { number, world_from_camera: None }),
            ..FromServer::default()
        };
        putting.put(answered(1));
        putting.put(point(0, 1.0));
        putting.put(answered(2));
        putting.put(point(0, 2.0));
        assert_eq!(fetching.fetch(), Some(answered(2).then(point(0, 2.0))));
    }
}
