//! The observations of a keyframe, found by landmark.
//!
//! The list is immutable: a keyframe that gains or loses observations gets a new one. It is in the
//! order of arrival, on which the solvers' results and the map's hash depend. The index is made when a
//! landmark is first looked up: many maps never need it. Independent of maps.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use super::{EntityId, Observation};

/// Observations in the order of arrival. Clones share their memory.
#[derive(Clone, Debug, Default)]
pub struct Observations(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    list: Box<[Observation]>,
    /// Places in `list` by landmark, then by arrival.
    by_landmark: OnceLock<Box<[u32]>>,
}

impl Observations {
    /// Whether both are one list in memory, which is cheaper to tell than whether they are equal.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// The first observation of `landmark`, if there is one.
    pub fn of(&self, landmark: EntityId) -> Option<&Observation> {
        let Inner { list, by_landmark } = &*self.0;
        let indices = by_landmark.get_or_init(|| indices(list));
        let seen = |&index: &u32| list.get(index as usize).map(|o| o.landmark);
        let first = indices.partition_point(|index| seen(index) < Some(landmark));
        let observation = list.get(*indices.get(first)? as usize)?;
        (observation.landmark == landmark).then_some(observation)
    }
}

fn indices(list: &[Observation]) -> Box<[u32]> {
    // An item brings 65,536 observations at most, and memory ends long before 2³² of them.
    let mut indices: Vec<u32> = (0..u32::MAX).take(list.len()).collect();
    indices.sort_by_key(|&index| list.get(index as usize).map(|o| o.landmark));
    indices.into()
}

impl Deref for Observations {
    type Target = [Observation];

    fn deref(&self) -> &[Observation] {
        &self.0.list
    }
}

impl From<Vec<Observation>> for Observations {
    fn from(list: Vec<Observation>) -> Self {
        Self(Arc::new(Inner { list: list.into(), by_landmark: OnceLock::new() }))
    }
}

impl FromIterator<Observation> for Observations {
    fn from_iter<I: IntoIterator<Item = Observation>>(observations: I) -> Self {
        observations.into_iter().collect::<Vec<_>>().into()
    }
}

impl PartialEq for Observations {
    fn eq(&self, other: &Self) -> bool {
        self.0.list == other.0.list
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::ClientIndex;

    #[test]
    fn a_landmark_is_found_where_it_was_first_seen() {
        let landmark = |id: i64| EntityId::new(ClientIndex(u32::from(id % 2 == 0)), id);
        let observation = |index: i64| Observation {
            landmark: landmark(index * 7 % 50),
            pixel: Vector2::new(index as f64, 0.0),
            sigma_px: 1.0,
            depth: None,
            descriptor: None,
        };
        // Each landmark is seen twice, some are not.
        let list: Observations = (0..80).map(observation).collect();
        for id in 0..60 {
            let id = landmark(id);
            assert_eq!(list.of(id), list.iter().find(|o| o.landmark == id));
        }
        assert_eq!(Observations::default().of(landmark(1)), None);
    }
}
