//! What a store found to be damaged, told so that a person can act on it.

use std::fmt;

/// A damaged place of a map's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The file, inside the data directory.
    pub file: String,
    /// The first byte that cannot be read.
    pub offset: u64,
    /// The first and last sequence that are lost; `None` where a snapshot or a later file still has
    /// everything.
    pub lost: Option<(u64, u64)>,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, offset, lost } = self;
        match lost {
            Some((first, last)) => {
                write!(f, "{file} is damaged at byte {offset}: events {first} to {last} are lost")
            }
            None => write!(f, "{file} is damaged at byte {offset}, nothing is lost"),
        }
    }
}
