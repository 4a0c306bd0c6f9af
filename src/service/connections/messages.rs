//! Incomplete request messages: each must make progress within a time limit, and large ones share a
//! memory budget.
//!
//! A decoder reserves what the five bytes before a message announce. Here these bytes are read on
//! the way, so that the reservation waits until there is room. The messages themselves are not
//! read.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use hyper::body::{Body as HttpBody, Bytes, Frame, SizeHint};
use tokio::sync::{AcquireError, OwnedSemaphorePermit, Semaphore};
use tokio::time::{Sleep, sleep};
use tonic::Status;
use tonic::body::Body;

use super::Connections;
use crate::service::error::ServiceError;

/// Flag and length before each message.
const PREFIX_BYTES: usize = 5;
/// Messages up to this size need no room; this much must arrive within the time limit.
const STEP_BYTES: usize = 64 << 10;

/// The position of a stream in its sequence of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Framing {
    prefix: [u8; PREFIX_BYTES],
    /// Bytes of the prefix that have arrived.
    has: usize,
    /// The message's size, once the prefix has arrived.
    size: usize,
    /// Bytes of it that are missing.
    missing: usize,
    /// Messages before it.
    number: u64,
}

impl Framing {
    /// Advances by these bytes.
    fn read(&mut self, mut data: &[u8]) {
        while !data.is_empty() {
            if self.missing > 0 {
                let taken = self.missing.min(data.len());
                self.missing -= taken;
                data = &data[taken..];
            } else {
                let taken = (PREFIX_BYTES - self.has).min(data.len());
                self.prefix[self.has..self.has + taken].copy_from_slice(&data[..taken]);
                self.has += taken;
                data = &data[taken..];
                if self.has == PREFIX_BYTES {
                    let [_, a, b, c, d] = self.prefix;
                    self.size = u32::from_be_bytes([a, b, c, d]) as usize;
                    self.missing = self.size;
                }
            }
            if self.has == PREFIX_BYTES && self.missing == 0 {
                *self = Self { number: self.number + 1, ..Self::default() };
            }
        }
    }

    /// Whether a message has begun and is not complete.
    fn is_inside(&self) -> bool {
        self.has > 0
    }
}

type Room = Pin<Box<dyn Future<Output = Result<OwnedSemaphorePermit, AcquireError>> + Send>>;

/// The body of a request.
pub(super) struct Arriving {
    body: Body,
    time: Duration,
    room: Arc<Semaphore>,
    /// The whole memory budget, KiB.
    all: u32,
    framing: Framing,
    /// Bytes of the message that were missing when its time began.
    missing: usize,
    timer: Option<Pin<Box<Sleep>>>,
    held: Option<OwnedSemaphorePermit>,
    /// A frame that waits for room.
    waiting: Option<(Frame<Bytes>, Room)>,
}

impl Arriving {
    pub(super) fn new(body: Body, connections: &Connections) -> Self {
        let limits = connections.limits();
        Self {
            body,
            time: limits.message_time,
            room: Arc::clone(&connections.unfinished),
            all: u32::try_from(limits.max_unfinished_bytes >> 10).unwrap_or(u32::MAX),
            framing: Framing::default(),
            missing: 0,
            timer: None,
            held: None,
            waiting: None,
        }
    }

    /// Records what has arrived; returns the frame unless it waits for room.
    fn take(&mut self, frame: Frame<Bytes>) -> Option<Frame<Bytes>> {
        let Some(data) = frame.data_ref() else { return Some(frame) };
        let before = self.framing.number;
        self.framing.read(data);
        if self.framing.number != before || !self.framing.is_inside() {
            (self.timer, self.held) = (None, None);
        } else if self.missing.saturating_sub(self.framing.missing) >= STEP_BYTES {
            self.timer = None;
        }
        if !self.framing.is_inside() || self.framing.size <= STEP_BYTES || self.held.is_some() {
            return Some(frame);
        }
        let wanted = u32::try_from(self.framing.size.div_ceil(1 << 10)).unwrap_or(u32::MAX);
        // The decoder refuses a message that is larger than the whole room.
        let room = Arc::clone(&self.room).acquire_many_owned(wanted.min(self.all));
        self.waiting = Some((frame, Box::pin(room)));
        None
    }
}

impl HttpBody for Arriving {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let arriving = self.get_mut();
        loop {
            if let Some((_, room)) = &mut arriving.waiting {
                // The semaphore is never closed.
                arriving.held = ready!(room.as_mut().poll(cx)).ok();
                let frame = arriving.waiting.take().map(|(frame, _)| frame);
                return Poll::Ready(frame.map(Ok));
            }
            match Pin::new(&mut arriving.body).poll_frame(cx) {
                Poll::Ready(Some(Ok(frame))) => {
                    if let Some(frame) = arriving.take(frame) {
                        return Poll::Ready(Some(Ok(frame)));
                    }
                }
                Poll::Ready(end) => return Poll::Ready(end),
                Poll::Pending if !arriving.framing.is_inside() => return Poll::Pending,
                Poll::Pending => {
                    let Arriving { timer, time, missing, framing, .. } = arriving;
                    let timer = timer.get_or_insert_with(|| {
                        *missing = framing.missing;
                        Box::pin(sleep(*time))
                    });
                    ready!(timer.as_mut().poll(cx));
                    let seconds = arriving.time.as_secs();
                    let status = Status::from(ServiceError::SlowMessage { seconds });
                    return Poll::Ready(Some(Err(status)));
                }
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        self.waiting.is_none() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        // The body's own hint does not include a frame that waits.
        if self.waiting.is_some() { SizeHint::default() } else { self.body.size_hint() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::connections::ConnectionLimits;

    /// Chunks, and then nothing more, but no end.
    struct Chunks(Vec<Bytes>);

    impl HttpBody for Chunks {
        type Data = Bytes;
        type Error = Status;

        fn poll_frame(
            mut self: Pin<&mut Self>,
            _cx: &mut Context<'_>,
        ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
            match self.0.pop() {
                Some(chunk) => Poll::Ready(Some(Ok(Frame::data(chunk)))),
                None => Poll::Pending,
            }
        }
    }

    #[test]
    fn a_large_message_waits_while_others_are_half_there() {
        let limits = ConnectionLimits { max_unfinished_bytes: 150 << 10, ..Default::default() };
        let connections = Connections::new(limits, None);
        let begin = |kibibytes: u32| {
            let size = (kibibytes << 10).to_be_bytes();
            let chunk = Bytes::from([[0].as_slice(), &size].concat());
            Arriving::new(Body::new(Chunks(vec![chunk])), &connections)
        };
        let mut cx = Context::from_waker(std::task::Waker::noop());
        let mut is_there =
            |arriving: &mut Arriving| Pin::new(arriving).poll_frame(&mut cx).is_ready();
        let (mut first, mut second, mut small) = (begin(100), begin(100), begin(60));
        assert!(is_there(&mut first));
        assert!(!is_there(&mut second), "there is no room");
        assert!(is_there(&mut small), "small ones need none");
        drop(first);
        assert!(is_there(&mut second));
        drop(second);
        // A message that is larger than the whole room is left to the decoder.
        assert!(is_there(&mut begin(1000)));
    }

    #[test]
    fn messages_are_followed_however_they_are_cut() {
        let mut bytes = Vec::new();
        for size in [0u32, 1, 300, 70_000] {
            bytes.push(0);
            bytes.extend(size.to_be_bytes());
            bytes.extend(vec![7; size as usize]);
        }
        for step in [1, 2, 3, 5, 7, 64, 4096, bytes.len()] {
            let mut framing = Framing::default();
            for chunk in bytes.chunks(step) {
                framing.read(chunk);
            }
            assert!(!framing.is_inside(), "in steps of {step}");
        }
        let mut framing = Framing::default();
        framing.read(&bytes[..bytes.len() - 1]);
        assert_eq!((framing.size, framing.missing), (70_000, 1));
    }
}
