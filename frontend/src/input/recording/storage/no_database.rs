//! In place of `database` in a program that was built without SQLite: a database that cannot be opened.
//!
//! It says how to get one that can.

use std::path::Path;

use super::super::error::RecordingError;
use super::super::index::{Index, Place};

/// There is none.
#[derive(Debug)]
pub(in crate::input::recording) enum Database {}

impl Database {
    pub(super) fn open(path: &Path) -> Result<Self, RecordingError> {
        Err(RecordingError::WithoutSqlite { path: path.to_owned() })
    }

    pub(super) fn scan(&mut self, _: usize, _: &mut Index) -> Result<(), RecordingError> {
        match *self {}
    }

    pub(super) fn read(&mut self, _: Place, _: &mut Vec<u8>) -> Result<(), RecordingError> {
        match *self {}
    }
}
