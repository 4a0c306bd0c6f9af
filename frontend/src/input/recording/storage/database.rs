//! A bag in a SQLite database, as rosbag2 writes it: the tables `topics` (id, name, type,
//! serialization_format) and `messages` (id, topic_id, timestamp in nanoseconds, data).
//!
//! The only place that knows SQLite. A database comes from anybody: it is opened for reading, no function of
//! its schema is trusted, and no value is longer than a message may be.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rusqlite::limits::Limit;
use rusqlite::{Connection, Error, OpenFlags};

use super::super::error::RecordingError;
use super::super::index::{At, HEAD_BYTES, Index, Place};
use super::{MAX_MESSAGE_BYTES, check_length};

const MESSAGES: &str = "messages";

/// An open database.
#[derive(Debug)]
pub(in crate::input::recording) struct Database {
    path: PathBuf,
    connection: Connection,
}

impl Database {
    pub(super) fn open(path: &Path) -> Result<Self, RecordingError> {
        let failed = |error| database_error(path, None, error);
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(failed)?;
        let most = i32::try_from(MAX_MESSAGE_BYTES).unwrap_or(i32::MAX);
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, most).map_err(failed)?;
        connection
            .execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON")
            .map_err(failed)?;
        let database = Self { path: path.to_owned(), connection };
        for table in ["topics", MESSAGES] {
            database.expect_table(table)?;
        }
        Ok(database)
    }

    /// Views and virtual tables by these names are not a bag's.
    fn expect_table(&self, table: &'static str) -> Result<(), RecordingError> {
        let query = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND name = ?1";
        let count = self.connection.query_row(query, [table], |row| row.get(0));
        match count.map_err(|error| database_error(&self.path, None, error))? {
            1i64 => Ok(()),
            _ => Err(RecordingError::NoTable { path: self.path.clone(), table }),
        }
    }

    /// Adds its topics and messages to the index.
    pub(super) fn scan(&mut self, file: usize, index: &mut Index) -> Result<(), RecordingError> {
        let failed = |error| database_error(&self.path, None, error);
        let mut topics = BTreeMap::new();
        let mut statement = self
            .connection
            .prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")
            .map_err(failed)?;
        let mut rows = statement.query([]).map_err(failed)?;
        while let Some(row) = rows.next().map_err(failed)? {
            let text = |column| row.get::<_, String>(column);
            let (name, type_name, encoding) =
                (text(1).map_err(failed)?, text(2).map_err(failed)?, text(3).map_err(failed)?);
            let id: i64 = row.get(0).map_err(failed)?;
            topics.insert(id, index.topic(&name, &type_name, &encoding));
        }
        let mut last = None;
        // What is before the damage is read.
        if let Err(error) = self.messages(file, &topics, index, &mut last) {
            if last.is_none() {
                return Err(database_error(&self.path, None, error));
            }
            index.damage(database_error(&self.path, last, error));
        }
        Ok(())
    }

    fn messages(
        &self,
        file: usize,
        topics: &BTreeMap<i64, usize>,
        index: &mut Index,
        last: &mut Option<i64>,
    ) -> Result<(), Error> {
        let query = "SELECT id, topic_id, timestamp, length(data) FROM messages ORDER BY id";
        let mut statement = self.connection.prepare(query)?;
        let mut rows = statement.query([])?;
        let mut head = [0; HEAD_BYTES];
        while let Some(row) = rows.next()? {
            let id: i64 = row.get(0)?;
            let (topic, time_ns): (i64, i64) = (row.get(1)?, row.get(2)?);
            let length: i64 = row.get::<_, Option<i64>>(3)?.unwrap_or_default();
            *last = Some(id);
            let length = u64::try_from(length).unwrap_or_default();
            if !index.pass(length) {
                return Ok(());
            }
            let Some(&topic) = topics.get(&topic) else { continue };
            // Data that cannot be read are reported with the frame that they belong to.
            let read = if index.wants_heads(topic) {
                let blob = self.connection.blob_open("main", MESSAGES, "data", id, true);
                blob.and_then(|blob| blob.read_at(&mut head, 0)).unwrap_or(0)
            } else {
                0
            };
            let place = Place { file, at: At::Row(id), length };
            index.message(topic, time_ns as f64 * 1e-9, &head[..read], place);
        }
        Ok(())
    }

    /// Reads a message.
    pub(super) fn read(&mut self, place: Place, into: &mut Vec<u8>) -> Result<(), RecordingError> {
        let At::Row(id) = place.at else { return Ok(()) };
        check_length(&self.path, place.length)?;
        let failed = |error| database_error(&self.path, Some(id), error);
        let blob = self.connection.blob_open("main", MESSAGES, "data", id, true).map_err(failed)?;
        check_length(&self.path, blob.len() as u64)?;
        into.resize(blob.len(), 0);
        blob.read_at_exact(into, 0).map_err(failed)
    }
}

fn database_error(path: &Path, row: Option<i64>, error: Error) -> RecordingError {
    RecordingError::Database { path: path.to_owned(), row, source: Box::new(error) }
}
