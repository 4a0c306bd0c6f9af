//! Epochs and sequences at the end of the numbers, which an earlier version took.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use covis::map::{Cause, Change, ClientIndex, Event, MapError, MapPolicy, Recall};

use crate::map_support::Journal;

#[test]
fn a_client_whose_numbers_an_earlier_version_took_to_the_end_goes_on() {
    let mut journal = Journal::new(MapPolicy::default());
    journal.push(Change::ClientOpened { name: "drone".to_owned(), epoch: i64::MAX });
    let drone = ClientIndex(1);
    for sequence in [3, i64::MAX] {
        let cause = Cause { client: drone, epoch: i64::MAX, sequence, digest: [1; 32] };
        let change = Change::LandmarksAdded { landmarks: Vec::new(), scale: 1.0 };
        let revision = journal.map.revision() + 1;
        let event = Event { revision, time_ns: 0, cause: Some(cause), change };
        journal.map.apply(&event).unwrap();
    }
    journal.push(Change::ClientOpened { name: "drone".to_owned(), epoch: 1 });
    let client = journal.map.client(drone).unwrap();
    assert_eq!((client.epoch, client.next_sequence), (1, 4));
    assert_eq!(journal.map.recall(drone, 3, &[1; 32]), Recall::Duplicate);
    let fenced = Change::ClientOpened { name: "drone".to_owned(), epoch: 1 };
    let revision = journal.map.revision() + 1;
    let event = Event { revision, time_ns: 0, cause: None, change: fenced };
    assert!(matches!(journal.map.apply(&event), Err(MapError::Epoch { newest: 1, .. })));
}
