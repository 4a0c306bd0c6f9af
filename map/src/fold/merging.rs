//! The fold of merges: the content of another map comes, and goes again.
//!
//! All values are in the event. What comes is as new as the event, whatever revision its own map had;
//! covisibility follows one observation at a time.

use std::collections::BTreeSet;

use covis_solvers::geometry::LieGroup;

use super::super::merging::Renaming;
use super::super::usage::image_bytes;
use super::super::{Client, ClientIndex, EntityId, Keyframe, Landmark, Map, Merge, MergedMap};

impl Map {
    /// Adds the content of another map.
    pub(super) fn merge(&mut self, merge: &Merge) {
        let positions: Vec<ClientIndex> = merge.clients.iter().map(|c| c.index).collect();
        let content = &*merge.content;
        let parts = Renaming::of_clients(&positions).apply(content.to_parts());
        let revision = self.parts.revision;
        for (client, at) in parts.clients.into_iter().zip(&positions) {
            let at = at.0 as usize;
            match self.parts.clients.get_mut(at) {
                Some(known) => {
                    let epoch = known.epoch.max(client.epoch);
                    *known = Client { epoch, has_left: false, ..client };
                }
                None => self.parts.clients.push(client),
            }
        }
        self.parts.cameras.extend(parts.cameras);
        for (&id, landmark) in &parts.landmarks {
            let positioned_revision = if landmark.position.is_some() { revision } else { 0 };
            let landmark =
                Landmark { added_revision: revision, positioned_revision, ..landmark.clone() };
            self.parts.landmarks.insert(id, landmark);
            self.unseen.insert((revision, id), ());
        }
        for (&id, keyframe) in &parts.keyframes {
            let new = Keyframe {
                observations: Default::default(),
                added_revision: revision,
                ..keyframe.clone()
            };
            self.descriptor_bytes += image_bytes(new.global_descriptor.as_deref());
            self.parts.keyframes.insert(id, new);
            self.by_age.insert((revision, id), ());
            self.by_time.insert((id.client, keyframe.capture_time_ns, id), ());
            self.by_arrival.insert((id.client, revision, id), ());
        }
        // Once every keyframe is there: the counts of shared landmarks depend on their ages.
        for (&id, keyframe) in &parts.keyframes {
            self.add_observations(id, &keyframe.observations);
            self.parts.place_searches.remove(id);
        }
        parts.constraints.iter().for_each(|(&id, &c)| self.add_constraint(id, c));
        parts.priors.iter().for_each(|(&id, &p)| self.add_prior(id, p));
        self.parts.switched_off.extend(parts.switched_off);
        self.parts
            .duplicates
            .extend(parts.duplicates.pairs(), parts.duplicates.compared().iter().copied());
        let (searches, found) = (&mut self.parts.place_searches, &parts.place_searches);
        if self.parts.policy.place_recognition {
            searches.pending.extend(found.pending.keys().map(|&id| (id, revision)));
        }
        searches.done.extend(found.done.iter().map(|(&id, search)| (id, search.clone())));
        merge.closures.iter().for_each(|&(id, closure)| self.add_constraint(id, closure));
        if !merge.closures.is_empty() || parts.place_searches.unsolved > 0 {
            self.parts.place_searches.unsolved = revision;
        }
        self.parts.adjustment_due |= parts.adjustment_due;
        self.parts.contents.extend(parts.contents.iter().map(|(&key, &digest)| (key, digest)));
        let inner = parts.merged.into_iter().map(|inner| MergedMap {
            target_from_source: merge.target_from_source.compose(&inner.target_from_source),
            ..inner
        });
        self.parts.merged.extend(inner);
        self.parts.merged.push(MergedMap {
            name: merge.name.clone(),
            create_time_ns: content.create_time_ns(),
            revision: content.revision(),
            display_name: content.display_name().to_owned(),
            policy: *content.policy(),
            target_from_source: merge.target_from_source,
            clients: merge.clients.clone(),
            first: merge.first,
        });
    }

    /// Removes the clients that came with a merged map, and all that is theirs.
    pub(super) fn take_out(&mut self, name: &str, clients_leave: bool) {
        let Some(index) = self.parts.merged.iter().position(|merged| merged.name == name) else {
            return;
        };
        let merged = self.parts.merged.remove(index);
        let going: BTreeSet<ClientIndex> = merged.clients.iter().map(|c| c.index).collect();
        let mut at = 0;
        self.parts.merged.retain_mut(|other| {
            at += 1;
            let leaves = at <= index && other.is_among(|client| going.contains(&client));
            other.clients.retain(|client| !going.contains(&client.index));
            !leaves
        });
        let goes = |id: &EntityId| going.contains(&id.client);
        let keyframes: Vec<EntityId> = self.parts.keyframes.keys().copied().filter(goes).collect();
        keyframes.into_iter().for_each(|id| self.remove_keyframe(id));
        let landmarks: Vec<EntityId> = self.parts.landmarks.keys().copied().filter(goes).collect();
        self.remove_landmarks(&landmarks);
        // The server's own ones between keyframes that stay, and those that a client added to them.
        let left: Vec<EntityId> = self
            .parts
            .constraints
            .keys()
            .chain(self.parts.priors.keys())
            .copied()
            .filter(goes)
            .collect();
        left.into_iter().for_each(|id| self.revoke(id));
        self.parts.cameras.retain(|id, _| !goes(id));
        self.forget_cameras(&going);
        let digests: Vec<_> =
            self.parts.contents.keys().copied().filter(|(_, id)| goes(id)).collect();
        for key in digests {
            self.parts.contents.remove(&key);
        }
        for index in going {
            if let Some(client) = self.parts.clients.get_mut(index.0 as usize) {
                let fresh = Client::new(&client.name, client.epoch);
                *client = Client { has_left: clients_leave, ..fresh };
            }
        }
        self.parts.place_searches.unsolved = self.parts.revision;
        self.parts.adjustment_due = false;
    }

    /// A keyframe that stays keeps its pose, and loses a camera that goes with all that it saw through it.
    fn forget_cameras(&mut self, going: &BTreeSet<ClientIndex>) {
        let has_lost = |keyframe: &Keyframe| {
            keyframe.camera.is_some_and(|camera| going.contains(&camera.client))
        };
        let blind: Vec<EntityId> =
            self.parts.keyframes.iter().filter(|(_, k)| has_lost(k)).map(|(&id, _)| id).collect();
        for id in blind {
            let Some(keyframe) = self.parts.keyframes.get_mut(&id) else { continue };
            keyframe.camera = None;
            let seen = keyframe.observations.clone();
            self.remove_observations(seen.iter().map(|seen| (id, seen.landmark)));
        }
    }
}
