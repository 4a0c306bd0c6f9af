//! What a loss of power leaves of a disk, operation by operation.

use rand::SeedableRng;

use super::*;

fn bytes(disk: &Disk, path: &str) -> Option<Vec<u8>> {
    disk.contents().get(path).cloned().flatten()
}

fn lost_power(disk: &Disk) -> Disk {
    disk.lose_power(Survival::Nothing)
}

#[test]
fn bytes_and_names_survive_by_syncs_of_their_own() {
    let mut disk = Disk::new();
    let file = disk.create_file("a");
    disk.write(file, 0, b"one");
    disk.sync(file);
    assert_eq!(bytes(&lost_power(&disk), "a"), None, "the name was not synced");
    disk.sync(ROOT);
    disk.write(file, 3, b"two");
    assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one".to_vec()));
    let all = disk.lose_power(Survival::Everything);
    assert_eq!(bytes(&all, "a"), Some(b"onetwo".to_vec()));
    disk.cut(file, 1);
    disk.sync(file);
    assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"o".to_vec()));
}

#[test]
fn a_rename_is_one_change() {
    let mut disk = Disk::new();
    disk.create_folder("x");
    let file = disk.create_file("x/map");
    disk.sync(disk.find("x").unwrap());
    disk.sync(file);
    disk.sync(ROOT);
    disk.rename("x", "x.deleted");
    let names = |disk: &Disk| disk.contents().into_keys().collect::<Vec<_>>();
    assert_eq!(names(&lost_power(&disk)), ["x", "x/map"]);
    disk.sync(ROOT);
    disk.remove("x.deleted/map");
    assert_eq!(names(&lost_power(&disk)), ["x.deleted", "x.deleted/map"]);
    for seed in 0..20 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        disk.rename("x.deleted", "y");
        let left = names(&disk.lose_power(Survival::Random(&mut rng)));
        assert!(left.contains(&"y".to_owned()) != left.contains(&"x.deleted".to_owned()));
        disk.rename("y", "x.deleted");
    }
}

#[test]
fn a_sync_with_names_takes_the_folders_above_and_earlier_changes_of_the_name_along() {
    let mut disk = Disk::new();
    disk.create_folder("x");
    let old = disk.create_file("x/map");
    disk.create_file("x/other");
    disk.write(old, 0, b"old");
    disk.sync_with_names(old);
    let names = |disk: &Disk| disk.contents().into_keys().collect::<Vec<_>>();
    assert_eq!(names(&lost_power(&disk)), ["x", "x/map"]);
    disk.remove("x/map");
    let new = disk.create_file("x/new");
    disk.write(new, 0, b"new");
    disk.rename("x/new", "x/map");
    disk.rename("x", "y");
    assert_eq!(names(&lost_power(&disk)), ["x", "x/map"]);
    disk.sync_with_names(new);
    let left = lost_power(&disk);
    assert_eq!(names(&left), ["y", "y/map"]);
    assert_eq!(bytes(&left, "y/map"), Some(b"new".to_vec()));
    // The removal of the old one does not come after the new one.
    disk.sync(disk.find("y").unwrap());
    assert_eq!(bytes(&lost_power(&disk), "y/map"), Some(b"new".to_vec()));
}

#[test]
fn a_failed_sync_is_mended_by_writing_again_only() {
    let mut disk = Disk::new();
    let file = disk.create_file("a");
    disk.sync(ROOT);
    disk.write(file, 0, b"one");
    disk.sync(file);
    disk.write(file, 3, b"two");
    disk.fail_sync(file);
    disk.sync(file);
    assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one".to_vec()));
    disk.write(file, 6, b"end");
    disk.sync(file);
    assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"one\0\0\0end".to_vec()));
    disk.write(file, 3, b"two");
    disk.sync(file);
    assert_eq!(bytes(&lost_power(&disk), "a"), Some(b"onetwoend".to_vec()));
}

#[test]
fn what_survives_is_told_by_the_seed() {
    let mut disk = Disk::new();
    let file = disk.create_file("a");
    disk.sync(ROOT);
    for part in 0..8_u8 {
        disk.write(file, usize::from(part) * 1000, &[part + 1; 1000]);
    }
    let left = |seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        bytes(&disk.lose_power(Survival::Random(&mut rng)), "a").unwrap()
    };
    assert_eq!(left(7), left(7));
    let kinds: std::collections::BTreeSet<Vec<u8>> = (0..50).map(left).collect();
    assert!(kinds.len() > 40, "{} of 50 seeds differ", kinds.len());
}
