//! Reading a journal in pieces, from files and from memory, while it is written.

use std::sync::Arc;

use crate::{EventReader, FileStore, FileStoreOptions, Store, StoreError};
use covis_map::{Change, Event, MapPolicy};

/// An event of about 60 KB.
fn event(revision: i64) -> Arc<Event> {
    let display_name = format!("{revision:060000}");
    let change = Change::Created { policy: MapPolicy::default(), create_time_ns: 0, display_name };
    Arc::new(Event { revision, time_ns: revision, cause: None, change })
}

/// The remaining revisions, and the size of the largest piece, bytes.
async fn rest(reader: &mut dyn EventReader) -> (Vec<i64>, u64) {
    let (mut revisions, mut most) = (Vec::new(), 0);
    loop {
        let piece = reader.next().await.unwrap();
        if piece.events.is_empty() {
            return (revisions, most);
        }
        for read in &piece.events {
            assert_eq!(**read, *event(read.revision));
        }
        revisions.extend(piece.events.iter().map(|event| event.revision));
        most = most.max(piece.bytes);
    }
}

#[tokio::test]
async fn a_journal_is_read_in_pieces_while_it_grows() {
    let folder = tempfile::tempdir().unwrap();
    let options = FileStoreOptions { segment_bytes: 1 << 20, ..FileStoreOptions::default() };
    let store = FileStore::open(folder.path(), options).await.unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    let append = async |revisions: std::ops::RangeInclusive<i64>| {
        for revision in revisions {
            let before = u64::try_from(revision - 1).unwrap();
            store.append("a", epoch, before, vec![event(revision)]).await.unwrap();
        }
    };
    append(1..=200).await;
    // Twelve megabytes: the first ones are in files only.
    let mut reader = store.reader("a", 3, 200).await.unwrap();
    let first = reader.next().await.unwrap();
    assert_eq!(first.events[0].revision, 4);
    assert!(first.bytes < (1 << 20) + 70_000, "{}", first.bytes);
    append(201..=220).await;
    let begin = first.events.last().unwrap().revision + 1;
    let (revisions, most) = rest(&mut *reader).await;
    assert_eq!(revisions, (begin..=200).collect::<Vec<_>>());
    assert!(most <= 5 << 20, "{most}");
    let mut last = store.reader("a", 217, 219).await.unwrap();
    assert_eq!(rest(&mut *last).await.0, [218, 219]);
    let mut none = store.reader("a", 220, 220).await.unwrap();
    assert!(rest(&mut *none).await.0.is_empty());
    let unknown = StoreError::UnknownMap { map: "b".to_owned() };
    assert_eq!(store.reader("b", 0, 1).await.err(), Some(unknown));
    // After a restart nothing is in memory.
    store.close().await;
    drop(store);
    let store = FileStore::open(folder.path(), options).await.unwrap();
    let mut reader = store.reader("a", 0, 220).await.unwrap();
    let (revisions, most) = rest(&mut *reader).await;
    assert_eq!(revisions, (1..=220).collect::<Vec<_>>());
    assert!(most < (1 << 20) + 70_000, "{most}");
}
