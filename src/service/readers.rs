//! Threads for streams that read whole maps. Their priority is lower than that of calls and
//! engines.
//!
//! A delta or a chunk of a large map takes milliseconds to put together. On the threads that send
//! acknowledgments, a robot would wait for each of four readers; here the system runs the robot's
//! work first. These threads run only work of one stream and none of the engines.

use std::io;

use futures_util::future::BoxFuture;
use tokio::runtime::{Builder, Runtime};

use super::engine::lower_priority;

/// The threads; `None` runs streams beside everything else, for simulations on one thread.
#[derive(Debug)]
pub(crate) struct Readers(Option<Runtime>);

impl Readers {
    /// Starts `threads` threads, at least one.
    ///
    /// # Errors
    /// If the system refuses the threads.
    pub(super) fn start(threads: usize) -> io::Result<Self> {
        let mut threads_of_readers = Builder::new_multi_thread();
        let builder = threads_of_readers
            .worker_threads(threads.max(1))
            .thread_name("covis-readers")
            .on_thread_start(lower_priority)
            .enable_all();
        Ok(Self(Some(builder.build()?)))
    }

    /// Without threads.
    #[cfg(feature = "faults")]
    pub(super) fn in_place() -> Self {
        Self(None)
    }

    /// Runs the task of a stream to its end.
    pub(super) fn spawn(&self, task: BoxFuture<'static, ()>) {
        let _detached = match &self.0 {
            Some(runtime) => runtime.spawn(task),
            None => tokio::spawn(task),
        };
    }
}

impl Drop for Readers {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            // The last stream may drop the runtime, so that nothing may block here.
            runtime.shutdown_background();
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::oneshot;

    use super::*;

    #[tokio::test]
    async fn a_stream_runs_on_a_thread_that_yields_to_others() {
        let readers = Readers::start(1).unwrap();
        let (reply, answer) = oneshot::channel();
        readers.spawn(Box::pin(async move {
            let name = std::thread::current().name().map(str::to_owned);
            #[cfg(target_os = "linux")]
            assert_eq!(rustix::process::getpriority_process(None).unwrap(), 10);
            reply.send(name).unwrap();
        }));
        assert_eq!(answer.await.unwrap().as_deref(), Some("covis-readers"));
        // The end of the last stream may drop the threads, which does not block.
        let last = Readers::start(1).map(std::sync::Arc::new).unwrap();
        let (held, (reply, answer)) = (std::sync::Arc::clone(&last), oneshot::channel());
        last.spawn(Box::pin(async move {
            drop(held);
            reply.send(()).unwrap();
        }));
        drop(last);
        answer.await.unwrap();
    }
}
