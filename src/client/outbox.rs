//! The items that the server has not answered yet, in order: what a broken link must send again.
//!
//! An entry is waiting (not yet on this stream), sent, or received (kept only while the server will
//! still tell DURABLE). Entries leave with RECEIVED or REJECTED, on a durable server with DURABLE.
//! A state machine without clock, task or channel.

use std::collections::VecDeque;

use tokio::sync::OwnedSemaphorePermit;

use crate::wire::v1;

/// An item with the room that it takes.
#[derive(Debug)]
pub(super) struct Entry {
    /// The message, sequence included.
    pub(super) request: v1::IngestRequest,
    /// Given back when the entry leaves: this is the back-pressure.
    pub(super) permit: Option<OwnedSemaphorePermit>,
    /// Whether RECEIVED came already.
    pub(super) is_received: bool,
}

/// What an ack means for the item it names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// The item was open and is answered now.
    First,
    /// It was answered before, on an earlier stream.
    Again,
    /// No such item is waiting for an answer.
    Unknown,
}

/// The unanswered items.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    entries: VecDeque<Entry>,
    /// How many of the first entries are on the present stream.
    sent: usize,
    /// Whether entries stay until DURABLE.
    keeps_until_durable: bool,
    /// The highest sequence that left with RECEIVED.
    released: i64,
}

impl Outbox {
    /// Appends an item; its sequence is above all before.
    pub(super) fn push(&mut self, entry: Entry) {
        self.entries.push_back(entry);
    }

    /// Begins a new stream: everything is to be sent again.
    pub(super) fn rewind(&mut self, keeps_until_durable: bool) {
        self.sent = 0;
        self.keeps_until_durable = keeps_until_durable;
    }

    /// The next message that is not on the present stream; [`Outbox::mark_sent`] goes past it.
    pub(super) fn next_unsent(&self) -> Option<&v1::IngestRequest> {
        self.entries.get(self.sent).map(|entry| &entry.request)
    }

    /// The message of [`Outbox::next_unsent`] is on its way.
    pub(super) fn mark_sent(&mut self) {
        self.sent = (self.sent + 1).min(self.entries.len());
    }

    /// Whether nothing waits for an answer.
    pub(super) fn is_answered(&self) -> bool {
        self.entries.iter().all(|entry| entry.is_received)
    }

    /// The highest sequence that only the server holds.
    pub(super) fn released(&self) -> i64 {
        self.released
    }

    /// Takes RECEIVED for `sequence`.
    pub(super) fn received(&mut self, sequence: i64) -> Answer {
        let Some(index) = self.position(sequence) else { return Answer::Unknown };
        let was_received = std::mem::replace(&mut self.entries[index].is_received, true);
        if !self.keeps_until_durable {
            self.remove(index);
            self.released = self.released.max(sequence);
        }
        if was_received { Answer::Again } else { Answer::First }
    }

    /// Takes REJECTED for `sequence`.
    pub(super) fn rejected(&mut self, sequence: i64) -> Answer {
        let Some(index) = self.position(sequence) else { return Answer::Unknown };
        let was_received = self.entries[index].is_received;
        self.remove(index);
        if was_received { Answer::Again } else { Answer::First }
    }

    /// Takes DURABLE up to `sequence`.
    pub(super) fn durable(&mut self, sequence: i64) {
        let covered = |e: &Entry| e.is_received && e.request.sequence <= sequence;
        while self.entries.front().is_some_and(covered) {
            self.remove(0);
        }
        self.released = self.released.max(sequence);
    }

    /// The sent entry with this sequence.
    fn position(&self, sequence: i64) -> Option<usize> {
        let index = self.entries.binary_search_by_key(&sequence, |e| e.request.sequence).ok()?;
        (index < self.sent).then_some(index)
    }

    fn remove(&mut self, index: usize) {
        self.entries.remove(index);
        if index < self.sent {
            self.sent -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outbox(sequences: &[i64]) -> Outbox {
        let mut outbox = Outbox::default();
        for &sequence in sequences {
            let request = v1::IngestRequest { sequence, item: None };
            outbox.push(Entry { request, permit: None, is_received: false });
        }
        outbox
    }

    fn send_all(outbox: &mut Outbox) -> Vec<i64> {
        let mut sent = Vec::new();
        while let Some(request) = outbox.next_unsent() {
            sent.push(request.sequence);
            outbox.mark_sent();
        }
        sent
    }

    #[test]
    fn a_broken_link_sends_the_unanswered_items_again_in_order() {
        let mut outbox = outbox(&[1, 2, 5, 7]);
        assert_eq!(send_all(&mut outbox), [1, 2, 5, 7]);
        assert_eq!(outbox.received(1), Answer::First);
        assert_eq!(outbox.rejected(2), Answer::First);
        assert_eq!(outbox.received(1), Answer::Unknown);
        outbox.rewind(false);
        assert_eq!(outbox.received(5), Answer::Unknown, "not on this stream yet");
        assert_eq!(send_all(&mut outbox), [5, 7]);
        assert_eq!(outbox.received(5), Answer::First);
        assert_eq!(outbox.received(7), Answer::First);
        assert!(outbox.is_answered());
        assert_eq!(outbox.released(), 7);
    }

    #[test]
    fn a_durable_server_has_items_kept_until_they_are_durable() {
        let mut outbox = outbox(&[1, 2, 3]);
        outbox.rewind(true);
        send_all(&mut outbox);
        assert_eq!(outbox.received(1), Answer::First);
        assert_eq!(outbox.received(2), Answer::First);
        assert_eq!(outbox.released(), 0);
        outbox.durable(1);
        assert_eq!(outbox.released(), 1);
        outbox.rewind(true);
        assert_eq!(send_all(&mut outbox), [2, 3]);
        assert_eq!(outbox.received(2), Answer::Again);
        assert_eq!(outbox.received(3), Answer::First);
        assert!(outbox.is_answered());
    }

    #[test]
    fn an_entry_gives_its_room_back_when_it_leaves() {
        let room = std::sync::Arc::new(tokio::sync::Semaphore::new(1));
        let permit = std::sync::Arc::clone(&room).try_acquire_owned().ok();
        let mut outbox = Outbox::default();
        let request = v1::IngestRequest { sequence: 4, item: None };
        outbox.push(Entry { request, permit, is_received: false });
        send_all(&mut outbox);
        assert_eq!(room.available_permits(), 0);
        outbox.rejected(4);
        assert_eq!(room.available_permits(), 1);
    }
}
