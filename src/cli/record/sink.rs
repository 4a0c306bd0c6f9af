//! An MCAP file or stream that is being written: messages by topic, each with its schema.
//!
//! Nothing is sought, so that a pipe is as good as a file. What was flushed is a whole chunk: a recording
//! whose program was killed reads up to there, and one that was finished has an index and a footer.
//! What a message means is not known here.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use fs_err as fs;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use prost::{Message, Name};

use super::schemas::{figures, foxglove};
use crate::cli::output::ClosedPipe;
use crate::sync::Mutex;

/// How MCAP names protobuf, as encoding of messages and of schemas.
const PROTOBUF: &str = "protobuf";

type Output = NoSeek<BufWriter<Box<dyn Write + Send>>>;

/// A recording. Several threads may write to it.
pub(in crate::cli) struct Sink {
    open: Mutex<Open>,
}

struct Open {
    writer: Writer<Output>,
    channels: BTreeMap<String, Channel>,
    messages: u64,
}

/// A topic.
#[derive(Clone, Copy)]
struct Channel {
    id: u16,
    /// Messages so far.
    next: u32,
}

impl fmt::Debug for Sink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sink").finish_non_exhaustive()
    }
}

/// Whether this program can record: it can.
pub(super) fn available() -> anyhow::Result<()> {
    Ok(())
}

impl Sink {
    /// Opens a file, which is replaced, or standard output for `-`.
    pub(in crate::cli) fn create(path: &Path) -> anyhow::Result<Self> {
        let out: Box<dyn Write + Send> = if path.as_os_str() == "-" {
            Box::new(io::stdout())
        } else {
            Box::new(fs::File::create(path)?)
        };
        let options = WriteOptions::new()
            .library(concat!("covis ", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true)
            .compression_threads(0);
        let writer = options.create(NoSeek::new(BufWriter::new(out))).map_err(failed)?;
        let open = Open { writer, channels: BTreeMap::new(), messages: 0 };
        Ok(Self { open: Mutex::new(open) })
    }

    /// Writes a message; `time_ns` is when it was so, by the clock of what was captured.
    pub(super) fn put<M: Message + Name>(
        &self,
        topic: &str,
        time_ns: u64,
        message: &M,
    ) -> anyhow::Result<()> {
        let open = &mut *self.open.lock();
        let channel = match open.channels.get_mut(topic) {
            Some(channel) => channel,
            None => {
                let channel = new_channel::<M>(&mut open.writer, topic)?;
                open.channels.entry(topic.to_owned()).or_insert(channel)
            }
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.next,
            log_time: time_ns,
            publish_time: time_ns,
        };
        channel.next = channel.next.wrapping_add(1);
        open.messages += 1;
        open.writer.write_to_known_channel(&header, &message.encode_to_vec()).map_err(failed)
    }

    /// Ends the chunk that is being written: what came so far can be read from now on.
    pub(super) fn flush(&self) -> anyhow::Result<()> {
        let open = &mut *self.open.lock();
        open.writer.flush().map_err(failed)
    }

    /// Writes index and footer; nothing may follow. Returns how many messages there are.
    pub(super) fn finish(&self) -> anyhow::Result<u64> {
        let open = &mut *self.open.lock();
        open.writer.finish().map_err(failed)?;
        Ok(open.messages)
    }
}

fn new_channel<M: Name>(writer: &mut Writer<Output>, topic: &str) -> anyhow::Result<Channel> {
    let is_foxglove = M::PACKAGE == foxglove::Pose::PACKAGE;
    let descriptors =
        if is_foxglove { foxglove::FILE_DESCRIPTOR_SET } else { figures::FILE_DESCRIPTOR_SET };
    let schema = writer.add_schema(&M::full_name(), PROTOBUF, descriptors).map_err(failed)?;
    let id = writer.add_channel(schema, topic, PROTOBUF, &BTreeMap::new()).map_err(failed)?;
    Ok(Channel { id, next: 0 })
}

/// A reader that went away ends the program quietly, as everywhere.
fn failed(error: McapError) -> anyhow::Error {
    if let McapError::Io(cause) = &error
        && cause.kind() == io::ErrorKind::BrokenPipe
    {
        return ClosedPipe.into();
    }
    anyhow::Error::new(error).context("the recording")
}
