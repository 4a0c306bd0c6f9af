//! Power lost at every operation of a session, with every choice of what survives.

use super::faulty::{Fault, FaultyDisk, Survives};
use super::script::{Model, check, session};

const CHOICES: [Survives; 7] = [
    Survives::Nothing,
    Survives::Everything,
    Survives::Some(1),
    Survives::Some(2),
    Survives::Some(3),
    Survives::Some(4),
    Survives::Some(5),
];

#[tokio::test]
async fn a_crash_at_any_operation_loses_nothing_that_was_acknowledged() {
    let whole = FaultyDisk::new();
    let mut model = Model::default();
    session(&whole, &mut model).await.unwrap();
    let operations = whole.log();
    assert!(operations.len() > 80, "{operations:?}");
    check(&whole.after(Survives::Nothing), &model, "a whole session").await;
    for (number, operation) in operations.iter().enumerate() {
        let disk = FaultyDisk::new();
        disk.stage(number, Fault::Crash);
        let mut model = Model::default();
        // The last operations may be marks, which nobody waits for.
        let _crashed = session(&disk, &mut model).await;
        for survives in CHOICES {
            let what =
                format!("a crash at operation {number} ({operation}), {survives:?} survives");
            check(&disk.after(survives), &model, &what).await;
        }
    }
}

/// A crash during the repair after a crash.
#[tokio::test]
async fn a_crash_while_opening_loses_nothing_either() {
    for first in (5..90).step_by(4) {
        let disk = FaultyDisk::new();
        disk.stage(first, Fault::Crash);
        let mut model = Model::default();
        let _crashed = session(&disk, &mut model).await;
        let left = disk.after(Survives::Some(first as u64));
        for second in 0..6 {
            let disk = left.after(Survives::Everything);
            disk.stage(second, Fault::Crash);
            if let Ok(store) = super::script::open(&disk) {
                for name in ["a", "b"] {
                    let _crashed = super::script::stored(&store, name).await;
                }
            }
            for survives in CHOICES {
                let what = format!("crashes at {first} and, opening, {second}, {survives:?}");
                check(&disk.after(survives), &model, &what).await;
            }
        }
    }
}
