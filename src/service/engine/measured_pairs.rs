//! What was measured between pairs of keyframes, kept so that a pose graph does not measure it again.
//!
//! A measurement is a function of what the map holds ([`PairInput`]), so that this is a cache: lost with the
//! process, and recomputed on demand with the same result. The engine tells what each change of the map does
//! to measurements ([`MeasuredPairs::note`]), and one that is older than such a change is made again. Windows
//! fill it as keyframes come; a pose graph measures what is missing on the threads of its solve. It is shared
//! by the solves and the exports of one map and uses nothing of the engine.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::sync::MutexGuard;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::relative_motion::RelativeMotion;
use rayon::prelude::*;

use crate::map::{
    Change, ClientIndex, EntityId, GraphPairs, Map, Observation, PairInput, later_observers,
    near_pairs, pair_input,
};
use crate::sync::Mutex;

type Pair = (EntityId, EntityId);

/// Retired keyframes whose retirement is remembered for measurements that are under way: far more than
/// retire while one is made.
const RETIRED_REMEMBERED: usize = 1024;

/// A measurement and the revision of the map that it was made in; `None` where the landmarks do not
/// determine the pose.
#[derive(Clone, Copy, Debug)]
struct Entry {
    revision: i64,
    motion: Option<RelativeMotion>,
}

/// The measurements of a map.
#[derive(Debug, Default)]
pub(crate) struct MeasuredPairs(Mutex<Measurements>);

#[derive(Debug, Default)]
struct Measurements {
    entries: HashMap<Pair, Entry>,
    /// The keyframes that a keyframe has entries with.
    partners: HashMap<EntityId, Vec<EntityId>>,
    /// The revision of the last change of what the measurements that a keyframe takes part in are made
    /// of; no entry without a change since [`MeasuredPairs::complete`].
    changed: BTreeMap<EntityId, i64>,
    /// The retired keyframes among them with their revisions, oldest first.
    retired: VecDeque<(EntityId, i64)>,
    /// What changed up to this revision is not in `changed` any more; measurements of older maps are not
    /// kept.
    forgotten: i64,
    /// Capture time and id of the newest keyframe of a client, or of one that was newer.
    newest: BTreeMap<ClientIndex, (i64, EntityId)>,
}

impl Measurements {
    /// The revision of the last change of what a pair's measurement is made of, as far as it is known.
    fn newest_change(&self, pair: Pair) -> i64 {
        let changed = |id| self.changed.get(&id).copied().unwrap_or(0);
        changed(pair.0).max(changed(pair.1))
    }

    /// The entry of a pair, if it holds for the map at `revision`, which may be older than the newest
    /// change: then one that was made of a newer map may not hold.
    fn get(&self, pair: Pair, revision: i64) -> Option<&Entry> {
        let holds =
            |entry: &&Entry| (self.newest_change(pair)..=revision).contains(&entry.revision);
        self.entries.get(&pair).filter(holds)
    }

    /// Keeps an entry, unless a newer one is there, or it is older than a change, or what has changed
    /// since is not known.
    fn keep(&mut self, pair: Pair, entry: Entry) {
        if entry.revision < self.forgotten.max(self.newest_change(pair)) {
            return;
        }
        match self.entries.get_mut(&pair) {
            Some(known) if known.revision < entry.revision => *known = entry,
            Some(_) => {}
            None => {
                self.entries.insert(pair, entry);
                self.partners.entry(pair.0).or_default().push(pair.1);
                self.partners.entry(pair.1).or_default().push(pair.0);
            }
        }
    }

    /// Forgets what was measured with a keyframe that leaves the map. Another keyframe may come under its
    /// id while a measurement of it is under way, so that its change is remembered for a while.
    fn retire(&mut self, keyframe: EntityId, revision: i64) {
        for partner in self.partners.remove(&keyframe).unwrap_or_default() {
            self.entries.remove(&(keyframe, partner));
            self.entries.remove(&(partner, keyframe));
            if let Some(others) = self.partners.get_mut(&partner) {
                others.retain(|&other| other != keyframe);
                if others.is_empty() {
                    self.partners.remove(&partner);
                }
            }
        }
        self.changed.insert(keyframe, revision);
        self.retired.push_back((keyframe, revision));
        if self.retired.len() > RETIRED_REMEMBERED
            && let Some((oldest, at)) = self.retired.pop_front()
        {
            // A newer change is that of another keyframe of the id.
            if self.changed.get(&oldest) == Some(&at) {
                self.changed.remove(&oldest);
            }
            self.forgotten = self.forgotten.max(at);
        }
    }

    /// Keeps the entries of the pairs that `needed` has.
    fn retain(&mut self, needed: &BTreeSet<Pair>) {
        self.entries.retain(|pair, _| needed.contains(pair));
        self.partners.clear();
        for &(a, b) in needed.iter().filter(|pair| self.entries.contains_key(pair)) {
            self.partners.entry(a).or_default().push(b);
            self.partners.entry(b).or_default().push(a);
        }
    }

    /// Forgets everything, because any measurement may have changed at `revision`.
    fn clear(&mut self, revision: i64) {
        let newest = std::mem::take(&mut self.newest);
        *self = Self { newest, forgotten: revision, ..Self::default() };
    }

    /// A keyframe takes or gives up views of landmarks: the measurements of later keyframes that see
    /// them may be made of these views. `at` is its capture time and id.
    fn views_changed<'a>(
        &mut self,
        map: &Map,
        at: (i64, EntityId),
        views: impl Iterator<Item = &'a Observation>,
        revision: i64,
    ) {
        let client = at.1.client;
        let newest = self.newest.entry(client).or_insert_with(|| {
            let own = map.trajectory(client);
            own.last().map_or(at, |&(id, keyframe)| (keyframe.capture_time_ns, id))
        });
        if at >= *newest {
            *newest = at;
            return;
        }
        let later = later_observers(map, at, views.map(|view| view.landmark));
        self.changed.extend(later.into_iter().map(|id| (id, revision)));
    }
}

/// A pair that is to be measured.
#[derive(Debug)]
pub(crate) struct Unmeasured {
    pair: Pair,
    revision: i64,
    input: Option<PairInput>,
}

impl Unmeasured {
    fn of(map: &Map, pair: Pair) -> Self {
        Self { pair, revision: map.revision(), input: pair_input(map, pair.0, pair.1) }
    }

    fn measure(self) -> (Pair, Entry) {
        let motion = self.input.and_then(|input| input.measure());
        (self.pair, Entry { revision: self.revision, motion })
    }
}

impl MeasuredPairs {
    fn known(&self) -> MutexGuard<'_, Measurements> {
        // An entry is inserted whole or not at all.
        self.0.lock()
    }

    /// Takes in what the next change of the map, which makes `revision`, does to measurements; `map` is
    /// the map before it.
    pub(crate) fn note(&self, map: &Map, change: &Change, revision: i64) {
        let entity = |id: &EntityId| map.keyframes().get(id).map(|k| (k.capture_time_ns, k));
        match change {
            Change::KeyframeAdded { id, capture_time_ns, observations, .. } => {
                let at = (*capture_time_ns, *id);
                self.known().views_changed(map, at, observations.iter(), revision);
            }
            Change::ObservationsAdded { keyframe, observations } => {
                let mut known = self.known();
                known.changed.insert(*keyframe, revision);
                if let Some((time_ns, _)) = entity(keyframe) {
                    known.views_changed(map, (time_ns, *keyframe), observations.iter(), revision);
                }
            }
            Change::KeyframeRetired { retired } => {
                let mut known = self.known();
                known.retire(retired.keyframe, revision);
                if let Some((time_ns, gone)) = entity(&retired.keyframe) {
                    let (at, views) = ((time_ns, retired.keyframe), gone.observations.iter());
                    known.views_changed(map, at, views, revision);
                }
            }
            Change::CameraSet { id, .. } if !map.cameras().contains_key(id) => {}
            Change::SolveApplied { solve } if solve.cameras.is_empty() => {}
            Change::CameraSet { .. }
            | Change::SolveApplied { .. }
            | Change::ObservationsRemoved { .. }
            | Change::LandmarksFused { .. }
            | Change::LandmarksRemoved { .. }
            | Change::KeyframeRemoved { .. }
            // Ids of what has gone may come again.
            | Change::MapMerged { .. }
            | Change::MapTakenOut { .. } => self.known().clear(revision),
            Change::Created { .. }
            | Change::ItemRepeated
            | Change::MapUpdated { .. }
            | Change::ClientOpened { .. }
            | Change::LandmarksAdded { .. }
            | Change::ConstraintAdded { .. }
            | Change::PriorAdded { .. }
            | Change::ConstraintRevoked { .. }
            | Change::DuplicatesFound { .. }
            | Change::DuplicatesSplit { .. }
            | Change::PlacesSearched { .. }
            | Change::LandmarksTriangulated { .. } => {}
        }
    }

    /// The pairs of `keyframe` and its neighbors in time that are not measured.
    pub(crate) fn unmeasured_near(&self, map: &Map, keyframe: EntityId) -> Vec<Unmeasured> {
        let mut pairs = near_pairs(map, keyframe);
        let known = self.known();
        pairs.retain(|&pair| known.get(pair, map.revision()).is_none());
        drop(known);
        pairs.into_iter().map(|pair| Unmeasured::of(map, pair)).collect()
    }

    /// Measures pairs.
    pub(crate) fn measure(&self, pairs: Vec<Unmeasured>) {
        for pair in pairs {
            let (pair, entry) = pair.measure();
            self.known().keep(pair, entry);
        }
    }

    /// Measures what is missing of the pairs of `map`, until `interrupt` is due, and forgets all others.
    /// Returns the measurement of each pair.
    pub(crate) fn complete(
        &self,
        map: &Map,
        pairs: &GraphPairs<'_>,
        interrupt: &Interrupt,
    ) -> Vec<Option<RelativeMotion>> {
        let pairs: Vec<Pair> = pairs.ids().collect();
        let known = self.known();
        let found: Vec<Option<Entry>> =
            pairs.iter().map(|&pair| known.get(pair, map.revision()).copied()).collect();
        drop(known);
        let measure = |(&pair, found): (&Pair, Option<Entry>)| match found {
            None if interrupt.is_due() => None,
            None => {
                let (_, entry) = Unmeasured::of(map, pair).measure();
                Some((true, entry))
            }
            Some(entry) => Some((false, entry)),
        };
        let made: Vec<Option<(bool, Entry)>> = pairs.par_iter().zip(found).map(measure).collect();
        let mut known = self.known();
        for (&pair, entry) in pairs.iter().zip(&made) {
            if let Some((true, entry)) = entry {
                known.keep(pair, *entry);
            }
        }
        // Without an interruption every entry that stays is newer than the changes before this map.
        if made.iter().all(Option::is_some) {
            if known.entries.len() > pairs.len() {
                let needed: BTreeSet<Pair> = pairs.into_iter().collect();
                known.retain(&needed);
            }
            known.changed.retain(|_, revision| *revision > map.revision());
            known.forgotten = known.forgotten.max(map.revision());
        }
        drop(known);
        made.into_iter().map(|entry| entry?.1.motion).collect()
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
    use nalgebra::{Vector2, Vector3, Vector6};

    use super::*;
    use crate::map::{CameraEntity, Event, MapPolicy, NewLandmark, WhenFull, retire};

    const ROBOT: ClientIndex = ClientIndex(0);
    const LANDMARKS: i64 = 40;

    fn id(id: i64) -> EntityId {
        EntityId::new(ROBOT, id)
    }

    fn camera() -> Camera {
        let [fx, fy, cx, cy] = [500.0, 500.0, 320.0, 240.0];
        let [k1, k2, k3, p1, p2] = [0.0; 5];
        Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, k3, p1, p2 })
    }

    /// A map and what was measured in it, as an engine keeps them.
    struct Kept {
        map: Map,
        pairs: MeasuredPairs,
    }

    impl Kept {
        /// Six keyframes, one a second, that see landmarks without depth.
        fn new() -> Self {
            let mut kept = Self { map: Map::new(), pairs: MeasuredPairs::default() };
            let policy = MapPolicy { when_full: WhenFull::Marginalize, ..MapPolicy::default() };
            let display_name = String::new();
            kept.push(Change::Created { policy, create_time_ns: 1, display_name });
            kept.push(Change::ClientOpened { name: "robot".to_owned(), epoch: 1 });
            let camera = CameraEntity { camera: camera(), width_px: 640, height_px: 480 };
            kept.push(Change::CameraSet { id: id(0), camera });
            for k in 0..6 {
                // The second one does not see all of them yet.
                kept.keyframe(k, 10 * k, if k == 1 { 30 } else { LANDMARKS });
            }
            kept
        }

        fn push(&mut self, change: Change) {
            let event =
                Event { revision: self.map.revision() + 1, time_ns: 0, cause: None, change };
            self.pairs.note(&self.map, &event.change, event.revision);
            self.map.apply(&event).unwrap();
        }

        /// Tenths of a second are the time and the place along x; pixels are off by a fixed pattern.
        fn views(time: i64, landmarks: std::ops::Range<i64>) -> (Se3, Vec<Observation>) {
            let x = 0.02 * time as f64;
            let pose =
                Se3::identity().plus(&Vector6::new(x, 0.1 * x.sin(), 0.0, 0.0, 0.02 * x, 0.0));
            let view = |l: i64| {
                let point =
                    Vector3::new((l % 8) as f64 - 3.0, (l / 8) as f64 - 2.0, 5.0 + 0.1 * l as f64);
                let noise = |by: i64| 0.1 * (((time + 3) * (l + 5) * by) % 7 - 3) as f64;
                let pixel = camera().project(&pose.inverse().act(&point)).unwrap();
                let pixel = pixel + Vector2::new(noise(11), noise(13));
                Observation { landmark: id(l), pixel, sigma_px: 1.0, depth: None, descriptor: None }
            };
            (pose, landmarks.map(view).collect())
        }

        fn keyframe(&mut self, k: i64, time: i64, landmarks: i64) {
            let (pose, observations) = Self::views(time, 0..landmarks);
            let new = |l| NewLandmark { id: id(l), position: None };
            self.push(Change::KeyframeAdded {
                id: id(k),
                capture_time_ns: time,
                camera: Some(id(0)),
                world_from_camera: pose,
                odom_from_camera: pose,
                observations,
                landmarks: (0..LANDMARKS).map(new).collect(),
                motion: None,
                global_descriptor: None,
            });
        }

        /// What is measured of each pair, by `pairs`.
        fn measured(&self, pairs: &MeasuredPairs) -> BTreeMap<Pair, Option<RelativeMotion>> {
            let graph = GraphPairs::of(&self.map);
            let motions = pairs.complete(&self.map, &graph, &Interrupt::NEVER);
            graph.ids().zip(motions).collect()
        }

        /// The measurement of a pair, which is the same whether the others were measured before or not.
        fn of(&self, a: i64, b: i64) -> RelativeMotion {
            let kept = self.measured(&self.pairs);
            assert_eq!(kept, self.measured(&MeasuredPairs::default()));
            kept[&(id(a), id(b))].unwrap()
        }
    }

    #[test]
    fn a_late_keyframe_changes_the_pairs_after_it_that_see_its_landmarks() {
        let mut kept = Kept::new();
        let before = kept.of(2, 3);
        kept.keyframe(90, 15, LANDMARKS);
        assert_ne!(kept.of(2, 3), before, "the landmarks of 2 have a view more");
        assert_eq!(kept.of(2, 3), kept.of(2, 3));
    }

    #[test]
    fn a_retired_keyframe_changes_the_pairs_whose_landmarks_it_saw() {
        let mut kept = Kept::new();
        let before = kept.of(1, 2);
        let retired = retire(&kept.map).unwrap();
        assert_eq!(retired.keyframe, id(0));
        kept.push(Change::KeyframeRetired { retired });
        let pairs = kept.measured(&kept.pairs);
        assert_eq!(pairs, kept.measured(&MeasuredPairs::default()));
        assert_ne!(pairs[&(id(1), id(2))], Some(before));
    }

    #[test]
    fn what_is_kept_of_a_bounded_map_does_not_grow_with_what_passed_through_it() {
        let mut kept = Kept::new();
        for k in 6..3_000 {
            kept.keyframe(k, 10 * k, LANDMARKS);
            let unmeasured = kept.pairs.unmeasured_near(&kept.map, id(k));
            let near = unmeasured
                .into_iter()
                .map(|one| (one.pair, Entry { revision: one.revision, motion: None }));
            near.for_each(|(pair, entry)| kept.pairs.known().keep(pair, entry));
            let retired = retire(&kept.map).unwrap();
            kept.push(Change::KeyframeRetired { retired });
        }
        let known = kept.pairs.known();
        let keyframes = kept.map.keyframes();
        let held = |(a, b): &Pair| keyframes.contains_key(a) && keyframes.contains_key(b);
        assert!(!known.entries.is_empty() && known.entries.keys().all(held));
        assert!(known.partners.keys().all(|id| keyframes.contains_key(id)));
        assert!(known.changed.len() <= RETIRED_REMEMBERED + keyframes.len());
        assert_eq!(known.retired.len(), RETIRED_REMEMBERED);
    }

    #[test]
    fn a_measurement_under_way_does_not_outlive_its_keyframe() {
        let mut kept = Kept::new();
        let measurement = Unmeasured::of(&kept.map, (id(0), id(1)));
        let retired = retire(&kept.map).unwrap();
        kept.push(Change::KeyframeRetired { retired });
        kept.pairs.measure(vec![measurement]);
        assert!(kept.pairs.known().entries.is_empty());
    }

    #[test]
    fn observations_that_an_earlier_keyframe_gains_change_the_pairs_after_it() {
        let mut kept = Kept::new();
        let before = kept.of(3, 4);
        let (_, observations) = Kept::views(10, 30..LANDMARKS);
        kept.push(Change::ObservationsAdded { keyframe: id(1), observations });
        assert_ne!(kept.of(3, 4), before);
    }

    #[test]
    fn a_keyframe_at_the_end_leaves_the_pairs_as_they_are() {
        let mut kept = Kept::new();
        kept.measured(&kept.pairs);
        kept.keyframe(6, 60, LANDMARKS);
        let known = kept.pairs.known();
        assert!(
            known.changed.is_empty() && known.get((id(2), id(3)), kept.map.revision()).is_some()
        );
    }

    #[test]
    fn a_reader_of_an_older_snapshot_gets_the_measurements_of_that_snapshot() {
        let mut kept = Kept::new();
        let older = kept.map.clone();
        let before = kept.of(2, 3);
        kept.keyframe(90, 15, LANDMARKS);
        let after = kept.of(2, 3);
        let graph = GraphPairs::of(&older);
        let motions = kept.pairs.complete(&older, &graph, &Interrupt::NEVER);
        let found: BTreeMap<Pair, _> = graph.ids().zip(motions).collect();
        assert_eq!(found[&(id(2), id(3))], Some(before));
        assert_eq!(kept.of(2, 3), after, "and spoils nothing for the newest");
        // The same where the newest measurement is gone when the reader keeps its own.
        kept.pairs.known().retain(&BTreeSet::new());
        kept.pairs.complete(&older, &graph, &Interrupt::NEVER);
        assert_eq!(kept.of(2, 3), after);
    }

    #[test]
    fn an_interrupted_reader_measures_nothing_more() {
        let kept = Kept::new();
        let due = Interrupt::at(Some(std::time::Instant::now()));
        let graph = GraphPairs::of(&kept.map);
        assert!(kept.pairs.complete(&kept.map, &graph, &due).iter().all(Option::is_none));
        assert!(kept.pairs.known().entries.is_empty());
    }
}
