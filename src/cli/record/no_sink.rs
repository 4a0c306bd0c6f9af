//! In place of `sink` in a program that was built without MCAP: a recording that cannot be opened.

use std::path::Path;

use anyhow::bail;
use prost::{Message, Name};

/// Why a program without the feature does not record, and what to do.
const LACKING: &str =
    "this covis was built without MCAP; build it with `cargo build --release --features mcap`";

/// There is none.
#[derive(Debug)]
pub(in crate::cli) enum Sink {}

/// Says that this program cannot record.
pub(super) fn available() -> anyhow::Result<()> {
    bail!(LACKING)
}

impl Sink {
    pub(in crate::cli) fn create(_path: &Path) -> anyhow::Result<Self> {
        bail!(LACKING)
    }

    pub(super) fn put<M: Message + Name>(
        &self,
        _topic: &str,
        _time_ns: u64,
        _message: &M,
    ) -> anyhow::Result<()> {
        match *self {}
    }

    pub(super) fn flush(&self) -> anyhow::Result<()> {
        match *self {}
    }

    pub(super) fn finish(&self) -> anyhow::Result<u64> {
        match *self {}
    }
}
