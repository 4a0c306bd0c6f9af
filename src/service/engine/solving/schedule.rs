//! The items that wait for a solve, in the order of their arrival.
//!
//! A trigger is an item that starts a solve: a window around keyframes, or a pose graph. A client's
//! items are optimized up to sequence s once none of its triggers up to s is open. The oldest
//! window is next.
//! Plain state: it starts nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::map::{ClientIndex, EntityId};

/// The solve that a trigger starts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Task {
    /// Local bundle adjustment around keyframes: a new one, or those that an edit concerns.
    Window(Arc<[EntityId]>),
    /// Pose-graph optimization.
    Loop,
    /// Pose-graph optimization that may wait for a window.
    Prior,
}

impl Task {
    /// Local bundle adjustment around one keyframe.
    pub(crate) fn around(keyframe: EntityId) -> Self {
        Self::Window(Arc::new([keyframe]))
    }
}

#[derive(Clone, Debug)]
struct Trigger {
    client: ClientIndex,
    sequence: i64,
    task: Task,
}

/// The open triggers in the order of their arrival.
#[derive(Clone, Debug, Default)]
pub(crate) struct Schedule {
    open: BTreeMap<u64, Trigger>,
    next_arrival: u64,
    /// Triggers that are done but wait for an earlier one of their client.
    done: BTreeMap<ClientIndex, BTreeSet<i64>>,
}

impl Schedule {
    /// Adds a trigger.
    pub(crate) fn push(&mut self, client: ClientIndex, sequence: i64, task: Task) {
        self.open.insert(self.next_arrival, Trigger { client, sequence, task });
        self.next_arrival += 1;
    }

    /// Adds a trigger for which there is nothing to solve and returns the client's new mark, if no
    /// earlier trigger is open.
    pub(crate) fn push_done(&mut self, client: ClientIndex, sequence: i64) -> Option<i64> {
        self.done.entry(client).or_default().insert(sequence);
        self.advance(client)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// How many items wait for a solve. An item that asks for two has both behind each other.
    pub(crate) fn item_count(&self) -> usize {
        let items = || self.open.values().map(|trigger| (trigger.client, trigger.sequence));
        let repeated = items().zip(items().skip(1)).filter(|(a, b)| a == b).count();
        self.open.len() - repeated
    }

    /// Whether an ack for the client is still to come.
    pub(crate) fn is_waiting(&self, client: ClientIndex) -> bool {
        self.open.values().any(|t| t.client == client)
    }

    /// The client's first sequence that waits for a solve.
    pub(crate) fn first_open(&self, client: ClientIndex) -> Option<i64> {
        self.open.values().filter(|t| t.client == client).map(|t| t.sequence).min()
    }

    /// Removes all triggers, because nothing more will be solved.
    pub(crate) fn clear(&mut self) {
        self.open.clear();
        self.done.clear();
    }

    /// Removes the triggers of a client that has left the map.
    pub(crate) fn forget(&mut self, client: ClientIndex) {
        self.open.retain(|_, trigger| trigger.client != client);
        self.done.remove(&client);
    }

    /// Every open trigger.
    pub(crate) fn all(&self) -> Vec<u64> {
        self.open.keys().copied().collect()
    }

    /// The open loop closures and priors: one pose graph covers them all.
    pub(crate) fn pose_graph_triggers(&self) -> Vec<u64> {
        let is_loop = |task: &Task| matches!(task, Task::Loop | Task::Prior);
        self.open.iter().filter(|(_, t)| is_loop(&t.task)).map(|(&a, _)| a).collect()
    }

    /// Whether a pose graph is due: a loop closure is open, or a prior that need not wait for a window.
    pub(crate) fn is_pose_graph_due(&self, window_first: bool) -> bool {
        let has = |task: &Task| self.open.values().any(|trigger| trigger.task == *task);
        has(&Task::Loop) || (has(&Task::Prior) && !(window_first && self.has_window()))
    }

    /// Whether a window is open.
    fn has_window(&self) -> bool {
        self.open.values().any(|trigger| matches!(trigger.task, Task::Window(_)))
    }

    /// The keyframes whose window is next: those of the oldest trigger. Later ones are carried along until
    /// then, so that a burst ends where the same items one by one end.
    pub(crate) fn next_window(&self) -> Option<Arc<[EntityId]>> {
        self.open.values().find_map(|trigger| match &trigger.task {
            Task::Window(keyframes) => Some(Arc::clone(keyframes)),
            Task::Loop | Task::Prior => None,
        })
    }

    /// The keyframes that wait for a window of their own.
    pub(crate) fn waiting(&self) -> BTreeSet<EntityId> {
        let keyframe = |trigger: &Trigger| match &trigger.task {
            Task::Window(keyframes) => <[EntityId; 1]>::try_from(&**keyframes).ok(),
            Task::Loop | Task::Prior => None,
        };
        self.open.values().filter_map(keyframe).map(|[id]| id).collect()
    }

    /// The open triggers whose keyframes are all among `centers` or `free`, which is sorted.
    pub(crate) fn within(&self, centers: &[EntityId], free: &[EntityId]) -> Vec<u64> {
        let covered = |id: &EntityId| free.binary_search(id).is_ok() || centers.contains(id);
        let covers = |task: &Task| match task {
            Task::Window(keyframes) => keyframes.iter().all(covered),
            Task::Loop | Task::Prior => false,
        };
        self.open.iter().filter(|(_, t)| covers(&t.task)).map(|(&arrival, _)| arrival).collect()
    }

    /// The marks that closing these triggers would reach, by client.
    pub(crate) fn preview(&self, arrivals: &[u64]) -> Vec<(ClientIndex, i64)> {
        self.clone().close(arrivals)
    }

    /// Closes triggers and returns the new marks.
    pub(crate) fn close(&mut self, arrivals: &[u64]) -> Vec<(ClientIndex, i64)> {
        let mut clients = BTreeSet::new();
        for arrival in arrivals {
            if let Some(trigger) = self.open.remove(arrival) {
                self.done.entry(trigger.client).or_default().insert(trigger.sequence);
                clients.insert(trigger.client);
            }
        }
        clients.into_iter().filter_map(|c| Some((c, self.advance(c)?))).collect()
    }

    fn advance(&mut self, client: ClientIndex) -> Option<i64> {
        let open = self.first_open(client);
        let done = self.done.get_mut(&client)?;
        // The last sequence that is done before the first open one.
        let mark = done.range(..open.unwrap_or(i64::MAX)).next_back().copied()?;
        done.retain(|&sequence| sequence > mark);
        if done.is_empty() {
            self.done.remove(&client);
        }
        Some(mark)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: ClientIndex = ClientIndex(0);
    const B: ClientIndex = ClientIndex(1);

    fn keyframe(client: ClientIndex, id: i64) -> EntityId {
        EntityId::new(client, id)
    }

    #[test]
    fn marks_wait_for_earlier_triggers_of_the_same_client() {
        let mut schedule = Schedule::default();
        schedule.push(A, 3, Task::around(keyframe(A, 0)));
        schedule.push(A, 5, Task::Loop);
        schedule.push(B, 1, Task::around(keyframe(B, 0)));
        let loops = schedule.pose_graph_triggers();
        assert_eq!(schedule.preview(&loops), []);
        assert_eq!(schedule.close(&loops), []);
        assert_eq!(schedule.push_done(A, 6), None);
        assert_eq!(schedule.push_done(B, 2), None);
        let rest = schedule.all();
        assert_eq!(schedule.preview(&rest), [(A, 6), (B, 2)]);
        assert_eq!(schedule.close(&rest), [(A, 6), (B, 2)]);
        assert!(schedule.is_empty() && !schedule.is_waiting(A));
        assert_eq!(schedule.push_done(A, 7), Some(7));
    }

    #[test]
    fn a_client_that_left_is_marked_by_no_solve() {
        let mut schedule = Schedule::default();
        schedule.push(A, 3, Task::Loop);
        schedule.push(B, 1, Task::Loop);
        assert_eq!(schedule.push_done(A, 4), None);
        let running = schedule.pose_graph_triggers();
        schedule.forget(A);
        assert_eq!(schedule.preview(&running), [(B, 1)]);
        assert_eq!(schedule.close(&running), [(B, 1)]);
        assert_eq!(schedule.push_done(A, 1), Some(1));
    }

    #[test]
    fn a_burst_is_worked_off_in_the_order_of_arrival() {
        let mut schedule = Schedule::default();
        for id in 0..3 {
            schedule.push(A, id + 1, Task::around(keyframe(A, id)));
        }
        schedule.push(A, 4, Task::Window([keyframe(A, 0), keyframe(A, 1)].into()));
        let waiting: Vec<EntityId> = schedule.waiting().into_iter().collect();
        assert_eq!(waiting, [0, 1, 2].map(|id| keyframe(A, id)), "an edit's keyframes were solved");
        assert_eq!(schedule.next_window().as_deref(), Some(&[keyframe(A, 0)][..]));
        let covered = schedule.within(&[keyframe(A, 0)], &[keyframe(A, 1)]);
        assert_eq!(schedule.close(&covered), [(A, 2)]);
        assert_eq!(schedule.next_window().as_deref(), Some(&[keyframe(A, 2)][..]));
    }

    #[test]
    fn a_window_covers_an_edit_whose_keyframes_are_all_in_it() {
        let mut schedule = Schedule::default();
        let group: Vec<EntityId> = (0..3).map(|id| keyframe(A, id)).collect();
        schedule.push(A, 1, Task::Window(group.clone().into()));
        // The pose graph of the same item.
        schedule.push(A, 1, Task::Loop);
        schedule.push(A, 2, Task::around(keyframe(A, 1)));
        assert_eq!(schedule.within(&group[1..2], &group[..2]), [2], "one of three is not in it");
        assert_eq!(schedule.within(&group, &[]), [0, 2]);
        assert_eq!(schedule.item_count(), 2, "two triggers are of one item");
        let loops = schedule.pose_graph_triggers();
        assert_eq!(schedule.close(&loops), [], "the item waits for its window too");
        assert_eq!(schedule.close(&[0, 2]), [(A, 2)]);
    }
}
