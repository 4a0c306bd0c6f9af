//! Where keyframes were before a job and where they are after it, for its report. Only looks.

use serde_json::{Value, json};

use super::report;
use crate::map::{ClientIndex, EntityId, Keyframe, Map};

/// Keyframes that a report shows at most, apart from the last of each client.
const SHOWN: usize = 2000;

/// Positions of keyframes by client, in the order of their capture.
pub(super) struct Positions(Vec<OfClient>);

/// A client's name, and where its keyframes are.
type OfClient = (String, Vec<(EntityId, [f64; 3])>);

impl Positions {
    /// Those of a map, evenly thinned out where they are many.
    pub(super) fn of(map: &Map) -> Self {
        let clients = (0..).map(ClientIndex).zip(map.clients());
        let step = map.keyframes().len().div_ceil(SHOWN).max(1);
        let positions = clients.map(|(index, client)| {
            let keyframes = map.trajectory(index);
            let last = keyframes.len().saturating_sub(1);
            let kept = keyframes.into_iter().enumerate();
            let kept = kept.filter(|(number, _)| number % step == 0 || *number == last);
            let position = |(_, (id, keyframe)): (usize, (EntityId, &Keyframe))| {
                (id, keyframe.world_from_camera.translation.into())
            };
            (client.name.clone(), kept.map(position).collect())
        });
        Self(positions.collect())
    }

    /// Adds them to a report, with where the same keyframes are in `after`.
    pub(super) fn add_to_report(self, after: &Map, to: &mut Value) {
        let trajectory = |(client, before): OfClient| {
            let here = |(id, before): (EntityId, [f64; 3])| {
                let after = after.keyframes().get(&id)?.world_from_camera.translation;
                Some((before, <[f64; 3]>::from(after)))
            };
            let (before, after): (Vec<_>, Vec<_>) = before.into_iter().filter_map(here).unzip();
            json!({ "client": client, "before": before, "after": after })
        };
        let trajectories: Vec<Value> =
            self.0.into_iter().filter(|(_, seen)| !seen.is_empty()).map(trajectory).collect();
        report::join(to, json!({ "trajectories": trajectories }));
    }
}
