//! A disk that is full or fails: acknowledged events are kept, and the failure is reported.

use super::faulty::{Fault, FaultyDisk, Survives};
use super::script::{Model, check, event, open, session};
use crate::{Store, StoreError};

#[tokio::test]
async fn a_fault_at_any_operation_takes_back_nothing() {
    let whole = FaultyDisk::new();
    session(&whole, &mut Model::default()).await.unwrap();
    for fault in [Fault::NoSpace, Fault::Broken] {
        for (number, operation) in whole.log().iter().enumerate() {
            let disk = FaultyDisk::new();
            disk.stage(number, fault);
            let mut model = Model::default();
            let _failed = session(&disk, &mut model).await;
            for survives in [Survives::Nothing, Survives::Everything, Survives::Some(7)] {
                let what = format!("{fault:?} at operation {number} ({operation}), {survives:?}");
                check(&disk.after(survives), &model, &what).await;
            }
        }
    }
}

#[tokio::test]
async fn after_a_failed_fsync_nothing_is_acknowledged_any_more() {
    let disk = FaultyDisk::new();
    let store = open(&disk).unwrap();
    let epoch = store.create_map("a", None).await.unwrap();
    let other = store.create_map("b", None).await.unwrap();
    store.append("a", epoch, 0, vec![event(1, 1)]).await.unwrap();
    let mut flushed = store.follow("a").await.unwrap();
    flushed.wait_for(|f| f.through == 1).await.unwrap();
    // The mark of an append may not be written yet: one of these faults hits an fsync.
    let mut next = 2;
    while flushed.borrow().failed.is_none() {
        let operations = disk.log().len();
        disk.stage(operations + 1, Fault::Broken);
        let appended = store.append("a", epoch, next - 1, vec![event(next as i64, 1)]).await;
        if appended.is_ok() {
            flushed.wait_for(|f| f.through == next || f.failed.is_some()).await.unwrap();
        }
        next += 1;
        assert!(next < 50, "no fault was hit");
    }
    let told = flushed.borrow().clone();
    let Some(StoreError::Stopped { map, durable, .. }) = &told.failed else { panic!("{told:?}") };
    assert_eq!(store.meters().journal_failures.get(), 1);
    assert_eq!((map.as_str(), *durable), ("a", told.through));
    // The disk works again; the journal does not trust it.
    let last = next - 1;
    let refused = store.append("a", epoch, last, vec![event(last as i64 + 1, 1)]).await;
    assert!(matches!(refused, Err(StoreError::Stopped { .. })), "{refused:?}");
    // The other map is not affected.
    store.append("b", other, 0, vec![event(1, 2)]).await.unwrap();
    let mut flushed = store.follow("b").await.unwrap();
    assert_eq!(flushed.wait_for(|f| f.through == 1).await.unwrap().failed, None);
    // A new start reads the files, and continues.
    drop(store);
    let store = open(&disk.after(Survives::Everything)).unwrap();
    store.acquire("a").await.unwrap();
    assert!(store.read("a", 0).await.unwrap().len() as u64 >= told.through);
}
