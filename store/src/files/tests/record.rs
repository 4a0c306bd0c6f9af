//! The reader of records on arbitrary and damaged bytes: it never panics and never makes up a record.

use proptest::prelude::*;

use crate::files::record::{HEADER, Uid, header, put_record, scan};

const UID: Uid = [9; 16];

/// A file of records with these payloads, from sequence 5 on.
fn file(payloads: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = header(&UID, 5);
    for (sequence, payload) in (5..).zip(payloads) {
        assert!(put_record(&mut bytes, &UID, sequence, sequence - 1, payload));
    }
    bytes
}

fn payloads() -> impl Strategy<Value = Vec<Vec<u8>>> {
    proptest::collection::vec(proptest::collection::vec(any::<u8>(), 1..60), 0..12)
}

proptest! {
    #[test]
    fn arbitrary_bytes_hold_no_record(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
        let found = scan(&bytes, &UID, 5);
        prop_assert!(found.records.is_empty());
        prop_assert!(bytes.is_empty() || found.bad == Some(0));
    }

    #[test]
    fn a_whole_file_is_read_and_a_cut_one_as_far_as_it_goes(
        payloads in payloads(),
        cut in any::<prop::sample::Index>(),
    ) {
        let bytes = file(&payloads);
        let found = scan(&bytes, &UID, 5);
        prop_assert_eq!((found.bad, found.clean), (None, payloads.len()));
        let cut = cut.index(bytes.len());
        let found = scan(&bytes[..cut], &UID, 5);
        prop_assert_eq!(found.clean, found.records.len());
        for (record, payload) in found.records.iter().zip(&payloads) {
            prop_assert_eq!(&bytes[record.payload.clone()], &payload[..]);
        }
        let end = found.records.last().map_or(HEADER, |record| record.payload.end);
        prop_assert_eq!(found.bad.is_some(), cut != end);
    }

    #[test]
    fn no_damage_makes_a_record_that_was_not_written(
        payloads in payloads(),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        inserted in proptest::collection::vec(any::<u8>(), 0..40),
        index in any::<prop::sample::Index>(),
    ) {
        let mut bytes = file(&payloads);
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let at = index.index(bytes.len());
        bytes.splice(at..at, inserted);
        let found = scan(&bytes, &UID, 5);
        for record in &found.records {
            let written = usize::try_from(record.sequence - 5).ok().and_then(|k| payloads.get(k));
            prop_assert_eq!(written.map(Vec::as_slice), Some(&bytes[record.payload.clone()]));
        }
        let rising = found.records.windows(2).all(|pair| pair[0].sequence < pair[1].sequence);
        prop_assert!(rising);
    }

    #[test]
    fn a_record_of_another_map_is_none(payloads in payloads()) {
        let found = scan(&file(&payloads), &[8; 16], 5);
        prop_assert!(found.records.is_empty());
    }
}

#[test]
fn the_last_sequence_there_can_be_is_read_and_nothing_follows_it() {
    let mut bytes = header(&UID, u64::MAX);
    for payload in [b"last", b"none"] {
        assert!(put_record(&mut bytes, &UID, u64::MAX, 0, payload));
    }
    let found = scan(&bytes, &UID, u64::MAX);
    assert_eq!((found.records.len(), found.clean), (1, 1));
    assert_eq!(found.bad, Some(found.records[0].payload.end));
}
