//! The items that the server has not answered yet, in order: what a broken link must send again.
//!
//! An entry is waiting (not yet on this stream), sent, or received (kept only while the server will
//! still tell DURABLE). Entries leave with RECEIVED or REJECTED, on a durable server with DURABLE.
//!
//! Memory holds the oldest entries. What does not fit goes to the spill file, where there is one, and comes
//! back as they leave. From the first item in the file on, the file holds everything that is unanswered, in
//! order, also what memory holds: the next session that opens it has no gap. A state machine without clock,
//! task or channel.

use std::collections::VecDeque;

use super::ClientError;
use super::spill::Spill;
use crate::wire::v1;

/// An item in memory.
#[derive(Debug)]
struct Entry {
    /// The message, sequence included.
    request: v1::IngestRequest,
    /// Whether RECEIVED came already.
    is_received: bool,
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
#[derive(Debug)]
pub(super) struct Outbox {
    entries: VecDeque<Entry>,
    /// Most entries in memory.
    capacity: usize,
    spill: Option<Spill>,
    /// How many of the first entries are on the present stream.
    sent: usize,
    /// Whether entries stay until DURABLE.
    keeps_until_durable: bool,
    /// The highest sequence that left with RECEIVED.
    released: i64,
    /// Whether nothing more will be pushed.
    is_closing: bool,
}

impl Outbox {
    /// An empty outbox that keeps so many entries in memory, at least 1.
    pub(super) fn new(capacity: usize) -> Self {
        Self {
            entries: VecDeque::new(),
            capacity: capacity.max(1),
            spill: None,
            sent: 0,
            keeps_until_durable: false,
            released: 0,
            is_closing: false,
        }
    }

    /// Begins with what the file holds, before anything was pushed.
    ///
    /// # Errors
    /// As [`Outbox::refill`].
    pub(super) fn attach(&mut self, spill: Spill) -> Result<(), ClientError> {
        self.spill = Some(spill);
        self.refill()
    }

    /// Appends an item, whose sequence is above all before; gives it back where there is no room.
    pub(super) fn push(&mut self, request: v1::IngestRequest) -> Option<v1::IngestRequest> {
        let has_unread = self.spill.as_ref().is_some_and(Spill::has_unread);
        if self.entries.len() < self.capacity && !has_unread {
            self.entries.push_back(Entry { request, is_received: false });
            return None;
        }
        let is_spilled =
            self.save() && self.spill.as_mut().is_some_and(|spill| spill.append(&request));
        (!is_spilled).then_some(request)
    }

    /// Writes what only memory holds to the file; false where that cannot be.
    fn save(&mut self) -> bool {
        let Some(spill) = &mut self.spill else { return false };
        if spill.has_unread() {
            return true;
        }
        let last = spill.last_sequence();
        let missing = self.entries.iter().filter(|entry| entry.request.sequence > last);
        let is_saved = missing.map(|entry| &entry.request).all(|request| spill.append(request));
        spill.mark_read();
        is_saved
    }

    /// Takes back what fits memory from the file, and empties a file that has served.
    ///
    /// # Errors
    /// [`ClientError::Spill`] where the file cannot be read any more.
    pub(super) fn refill(&mut self) -> Result<(), ClientError> {
        let Some(spill) = &mut self.spill else { return Ok(()) };
        while self.entries.len() < self.capacity && spill.has_unread() {
            let request = spill.next()?;
            self.entries.push_back(Entry { request, is_received: false });
        }
        let first = self.entries.front().map_or(i64::MAX, |entry| entry.request.sequence);
        if spill.is_used() && !spill.has_unread() && first > spill.last_sequence() {
            spill.clear();
        }
        Ok(())
    }

    /// Lets go of the file, which then holds all that is unanswered.
    pub(super) fn leave(&mut self) {
        if !self.entries.is_empty() {
            self.save();
        }
        self.spill = None;
    }

    /// Nothing more will be pushed.
    pub(super) fn close(&mut self) {
        self.is_closing = true;
    }

    /// Whether nothing more will be pushed.
    pub(super) fn is_closing(&self) -> bool {
        self.is_closing
    }

    /// Begins a new stream: everything is to be sent again.
    pub(super) fn rewind(&mut self, keeps_until_durable: bool) {
        self.sent = 0;
        self.keeps_until_durable = keeps_until_durable;
    }

    /// Whether a message is not on the present stream.
    pub(super) fn has_unsent(&self) -> bool {
        self.sent < self.entries.len()
    }

    /// Whether everything that was pushed is on the present stream.
    pub(super) fn is_sent(&self) -> bool {
        !self.has_unsent() && !self.spill.as_ref().is_some_and(Spill::has_unread)
    }

    /// The next message that is not on the present stream; it is on its way now.
    pub(super) fn take_unsent(&mut self) -> Option<v1::IngestRequest> {
        let request = self.entries.get(self.sent)?.request.clone();
        self.sent += 1;
        Some(request)
    }

    /// Whether everything was sent and nothing waits for an answer.
    pub(super) fn is_answered(&self) -> bool {
        self.is_sent() && self.entries.iter().all(|entry| entry.is_received)
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

    use crate::spill::tests::on_small_disk;

    fn push(outbox: &mut Outbox, sequence: i64) -> bool {
        outbox.push(v1::IngestRequest { sequence, item: None }).is_none()
    }

    fn outbox(sequences: &[i64]) -> Outbox {
        let mut outbox = Outbox::new(64);
        assert!(sequences.iter().all(|&sequence| push(&mut outbox, sequence)));
        outbox
    }

    fn send_all(outbox: &mut Outbox) -> Vec<i64> {
        std::iter::from_fn(|| outbox.take_unsent()).map(|request| request.sequence).collect()
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
        let mut outbox = Outbox::new(1);
        assert!(push(&mut outbox, 4));
        assert!(!push(&mut outbox, 5));
        send_all(&mut outbox);
        outbox.rejected(4);
        assert!(push(&mut outbox, 5));
    }

    /// Sends and answers all that comes, in a window of what memory holds.
    fn drain(outbox: &mut Outbox) -> Vec<i64> {
        let mut sent = Vec::new();
        while !outbox.is_answered() {
            let some = send_all(outbox);
            assert!(!some.is_empty() && outbox.entries.len() <= outbox.capacity);
            for &sequence in &some {
                assert_eq!(outbox.received(sequence), Answer::First);
                outbox.refill().unwrap();
            }
            sent.extend(some);
        }
        sent
    }

    #[test]
    fn what_does_not_fit_memory_comes_back_in_order() {
        let mut outbox = Outbox::new(4);
        outbox.attach(on_small_disk(1 << 20)).unwrap();
        assert!((1..=40).all(|sequence| push(&mut outbox, sequence)));
        assert_eq!(send_all(&mut outbox), [1, 2, 3, 4]);
        // All that is unanswered is in the file, what memory holds too.
        assert_eq!(outbox.spill.as_ref().unwrap().last_sequence(), 40);
        outbox.rewind(false);
        assert_eq!(drain(&mut outbox), (1..=40).collect::<Vec<_>>());
        assert!(!outbox.spill.as_ref().unwrap().is_used());
        // Then memory serves alone, and the file again when it must, without a gap.
        assert!((41..=44).all(|sequence| push(&mut outbox, sequence)));
        assert!(!outbox.spill.as_ref().unwrap().is_used());
        assert!(push(&mut outbox, 45));
        assert_eq!(drain(&mut outbox), [41, 42, 43, 44, 45]);
    }

    #[test]
    fn the_file_keeps_what_memory_has_taken_back_until_it_is_answered() {
        let mut outbox = Outbox::new(2);
        outbox.attach(on_small_disk(1 << 20)).unwrap();
        assert!((1..=3).all(|sequence| push(&mut outbox, sequence)));
        outbox.rewind(true);
        assert_eq!(send_all(&mut outbox), [1, 2]);
        outbox.received(1);
        outbox.received(2);
        outbox.durable(2);
        outbox.refill().unwrap();
        // Item 3 is in memory again, and a newer one beside it in memory alone.
        assert!(push(&mut outbox, 4));
        let is_used = |outbox: &Outbox| outbox.spill.as_ref().unwrap().is_used();
        assert_eq!(outbox.spill.as_ref().unwrap().last_sequence(), 3);
        assert_eq!(send_all(&mut outbox), [3, 4]);
        outbox.received(3);
        outbox.refill().unwrap();
        assert!(is_used(&outbox), "not durable yet");
        outbox.durable(3);
        outbox.refill().unwrap();
        assert!(!is_used(&outbox));
        outbox.save();
        assert_eq!(outbox.spill.as_ref().unwrap().last_sequence(), 4, "as a session ends");
    }

    #[test]
    fn a_full_disk_means_waiting_and_loses_nothing() {
        let mut outbox = Outbox::new(4);
        outbox.attach(on_small_disk(120)).unwrap();
        let taken = (1..).take_while(|&sequence| push(&mut outbox, sequence)).count() as i64;
        assert!(taken > 4 && !push(&mut outbox, taken + 1), "{taken}");
        assert_eq!(drain(&mut outbox), (1..=taken).collect::<Vec<_>>());
        assert!(push(&mut outbox, taken + 1));
        // A disk that was full from the beginning takes nothing, and memory serves.
        let mut outbox = Outbox::new(4);
        outbox.attach(on_small_disk(10)).unwrap();
        assert!((1..=4).all(|sequence| push(&mut outbox, sequence)));
        assert!(!push(&mut outbox, 5));
        assert_eq!(drain(&mut outbox), [1, 2, 3, 4]);
        assert!(push(&mut outbox, 5));
    }
}
