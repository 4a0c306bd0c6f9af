//! Random ids for starts of the server, entries of its log and folders of jobs. They are unique, and no
//! secrets.

use std::hash::{BuildHasher, RandomState};

/// 16 hexadecimal digits, different at each call: the hasher's keys are random.
pub(super) fn random_id() -> String {
    format!("{:016x}", RandomState::new().hash_one(0u8))
}

/// 16 bytes, different at each call.
pub(super) fn random_uid() -> [u8; 16] {
    let mut uid = [0; 16];
    for half in uid.chunks_exact_mut(8) {
        half.copy_from_slice(&RandomState::new().hash_one(0u8).to_le_bytes());
    }
    uid
}
