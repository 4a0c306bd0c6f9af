//! How far a replay has come: which of its items and keyframes are acknowledged, and at which
//! level.
//!
//! RECEIVED and REJECTED come in the order of the items, DURABLE and OPTIMIZED cover all before, so
//! that the last sequence of each level says everything. What a broken link had acknowledged and
//! the next one acknowledges again counts once.

use std::collections::BTreeSet;

use crate::wire::v1;

/// Items are numbered from 1 without gaps.
#[derive(Clone, Debug, Default)]
pub(super) struct Levels {
    /// Sequences of the keyframes, rising.
    keyframes: Vec<i64>,
    /// The last item that was handed over.
    sent: i64,
    rejected: BTreeSet<i64>,
    answered: i64,
    durable: i64,
    optimized: i64,
}

/// Numbers of keyframes, those that were refused left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub(super) struct Keyframes {
    /// The server has them.
    pub(super) received: usize,
    /// They survive its crash.
    pub(super) durable: usize,
    /// Solves have covered them.
    pub(super) optimized: usize,
}

impl Levels {
    /// An item is about to be sent.
    pub(super) fn send(&mut self, sequence: i64, is_keyframe: bool) {
        self.sent = sequence;
        if is_keyframe {
            self.keyframes.push(sequence);
        }
    }

    /// Takes an ack.
    pub(super) fn take(&mut self, ack: &v1::IngestAck) {
        let level = match ack.status() {
            v1::AckStatus::Received => &mut self.answered,
            v1::AckStatus::Rejected => {
                self.rejected.insert(ack.sequence);
                &mut self.answered
            }
            v1::AckStatus::Durable => &mut self.durable,
            v1::AckStatus::Optimized => &mut self.optimized,
            v1::AckStatus::Unspecified => return,
        };
        *level = (*level).max(ack.sequence);
    }

    /// Items that were sent, taken and refused.
    pub(super) fn items(&self) -> [u64; 3] {
        let rejected = self.rejected.len() as u64;
        let answered = u64::try_from(self.answered).unwrap_or(0);
        [u64::try_from(self.sent).unwrap_or(0), answered.saturating_sub(rejected), rejected]
    }

    /// Keyframes at each level.
    pub(super) fn keyframes(&self) -> Keyframes {
        let taken = |through: i64| {
            let upto = self.keyframes.partition_point(|&sequence| sequence <= through);
            let taken = |sequence: &&i64| !self.rejected.contains(sequence);
            self.keyframes[..upto].iter().filter(taken).count()
        };
        Keyframes {
            received: taken(self.answered),
            durable: taken(self.durable),
            optimized: taken(self.optimized),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_acknowledged_keyframe_counts_once_at_each_level() {
        let mut levels = Levels::default();
        for sequence in 1..=6 {
            levels.send(sequence, sequence % 2 == 0);
        }
        let mut take = |sequence, status: v1::AckStatus| {
            let status = status.into();
            levels.take(&v1::IngestAck { sequence, status, ..v1::IngestAck::default() });
            let Keyframes { received, durable, optimized } = levels.keyframes();
            (levels.items(), [received, durable, optimized])
        };
        take(1, v1::AckStatus::Received);
        assert_eq!(take(2, v1::AckStatus::Received), ([6, 2, 0], [1, 0, 0]));
        take(3, v1::AckStatus::Received);
        assert_eq!(take(4, v1::AckStatus::Rejected), ([6, 3, 1], [1, 0, 0]));
        assert_eq!(take(3, v1::AckStatus::Durable), ([6, 3, 1], [1, 1, 0]));
        // The link broke: what was not durable is answered again.
        assert_eq!(take(2, v1::AckStatus::Received), ([6, 3, 1], [1, 1, 0]));
        take(5, v1::AckStatus::Received);
        take(6, v1::AckStatus::Received);
        take(6, v1::AckStatus::Durable);
        assert_eq!(take(2, v1::AckStatus::Optimized), ([6, 5, 1], [2, 2, 1]));
    }
}
