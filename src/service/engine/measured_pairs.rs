//! What was measured between pairs of keyframes, kept so that a pose graph does not measure it again.
//!
//! A measurement is a function of what its keyframes hold ([`PairInput`]), so that this is a cache: lost
//! with the process, made again when it is asked for, and the same then. Each entry knows the state that
//! it was made of. Windows fill it as keyframes come; a pose graph measures what is missing on the
//! threads of its solve. It is shared by the solves of one map and uses nothing of the engine.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use covis_solvers::interrupt::Interrupt;
use covis_solvers::relative_motion::RelativeMotion;
use rayon::prelude::*;

use crate::map::{EntityId, Map, PairInput, PairState, graph_pairs, near_pairs, pair_input};

type Pair = (EntityId, EntityId);

/// A measurement and what it was made of; `None` where the landmarks do not determine the pose.
#[derive(Clone, Debug)]
struct Entry {
    state: PairState,
    motion: Option<RelativeMotion>,
}

/// The measurements of a map.
#[derive(Debug, Default)]
pub(super) struct MeasuredPairs(Mutex<BTreeMap<Pair, Entry>>);

/// A pair that is to be measured.
#[derive(Debug)]
pub(super) struct Unmeasured {
    pair: Pair,
    state: PairState,
    input: Option<PairInput>,
}

impl Unmeasured {
    fn of(map: &Map, pair: Pair) -> Option<Self> {
        let state = PairState::of(map, pair.0, pair.1)?;
        Some(Self { pair, state, input: pair_input(map, pair.0, pair.1) })
    }

    fn measure(self) -> (Pair, Entry) {
        let motion = self.input.and_then(|input| input.measure());
        (self.pair, Entry { state: self.state, motion })
    }
}

impl MeasuredPairs {
    fn entries(&self) -> MutexGuard<'_, BTreeMap<Pair, Entry>> {
        // An entry is inserted whole or not at all.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_known(&self, map: &Map, pair: Pair) -> bool {
        let Some(state) = PairState::of(map, pair.0, pair.1) else { return true };
        self.entries().get(&pair).is_some_and(|entry| entry.state.is_same(&state))
    }

    /// The pairs of `keyframe` and its neighbors in time that are not measured.
    pub(super) fn unmeasured_near(&self, map: &Map, keyframe: EntityId) -> Vec<Unmeasured> {
        let pairs = near_pairs(map, keyframe).into_iter();
        pairs
            .filter(|&pair| !self.is_known(map, pair))
            .filter_map(|p| Unmeasured::of(map, p))
            .collect()
    }

    /// Measures pairs.
    pub(super) fn measure(&self, pairs: Vec<Unmeasured>) {
        for pair in pairs {
            let (pair, entry) = pair.measure();
            self.entries().insert(pair, entry);
        }
    }

    /// Measures what the pose graph of `map` needs and is missing, until `interrupt` is due, and forgets
    /// what it does not need. Returns the measurements.
    pub(super) fn complete(
        &self,
        map: &Map,
        interrupt: &Interrupt,
    ) -> BTreeMap<Pair, RelativeMotion> {
        let pairs = graph_pairs(map);
        let missing: Vec<Pair> =
            pairs.iter().copied().filter(|&pair| !self.is_known(map, pair)).collect();
        missing.par_iter().for_each(|&pair| {
            if !interrupt.is_due()
                && let Some(unmeasured) = Unmeasured::of(map, pair)
            {
                self.measure(vec![unmeasured]);
            }
        });
        let mut entries = self.entries();
        let mut needed = BTreeMap::new();
        let mut motions = BTreeMap::new();
        for pair in pairs {
            if let Some(entry) = entries.remove(&pair) {
                motions.extend(entry.motion.map(|motion| (pair, motion)));
                needed.insert(pair, entry);
            }
        }
        *entries = needed;
        motions
    }
}
