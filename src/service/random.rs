//! Ids that tell starts of the server and entries of its log apart.

use std::hash::{BuildHasher, RandomState};

/// 16 hexadecimal digits, different at each call: the hasher's keys are random.
pub(super) fn random_id() -> String {
    format!("{:016x}", RandomState::new().hash_one(0u8))
}
