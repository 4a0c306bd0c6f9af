//! The workers that serve sections: threads of this process, or programs that answer over a stream.
//!
//! An exchange gives each worker its queue of requests and takes its answers in order. A worker that is
//! lost answers no more until it was started anew; nothing here says anything to it a second time.

use std::io::{self, Read, Write};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use super::frames::{FrameError, read_message, write_message};
use super::message::{Answer, Request};
use super::worker::Worker;
use crate::interrupt::Interrupt;
use crate::parallel;

/// How often a wait for answers asks whether it must end.
const QUESTION_EVERY: Duration = Duration::from_millis(10);

/// The answers of one worker to the first requests of its queue.
#[derive(Debug, Default)]
pub struct Exchanged {
    /// In order; fewer than requests where the worker was lost or the exchange interrupted.
    pub answers: Vec<Answer>,
    /// Why it answers no more.
    pub lost: Option<String>,
}

/// Some workers.
pub trait Workers: Send {
    /// How many; at least one.
    fn count(&self) -> usize;

    /// Whether sections are better left in a file than sent.
    fn read_files(&self) -> bool;

    /// Gives each worker its requests. Once `interrupt` is due it may return with fewer answers, and
    /// workers that were at work are lost.
    fn exchange(&mut self, queues: Vec<Vec<Request>>, interrupt: &Interrupt) -> Vec<Exchanged>;

    /// Starts a worker anew, without sections.
    ///
    /// # Errors
    /// Why it cannot be started.
    fn restart(&mut self, worker: usize) -> io::Result<()>;
}

/// Workers in this process, on the rayon pool of the caller.
#[derive(Debug)]
pub struct LocalWorkers {
    workers: Vec<Worker>,
}

impl LocalWorkers {
    /// So many, at least one.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { workers: (0..count.max(1)).map(|_| Worker::new()).collect() }
    }
}

impl Workers for LocalWorkers {
    fn count(&self) -> usize {
        self.workers.len()
    }

    fn read_files(&self) -> bool {
        false
    }

    fn exchange(&mut self, queues: Vec<Vec<Request>>, interrupt: &Interrupt) -> Vec<Exchanged> {
        let serve = |(worker, queue): (&mut Worker, Vec<Request>)| {
            let mut answers = Vec::with_capacity(queue.len());
            for request in queue {
                if interrupt.is_due() {
                    break;
                }
                answers.push(worker.answer(request, interrupt));
            }
            Exchanged { answers, lost: None }
        };
        match self.workers.as_mut_slice() {
            [worker] => {
                queues.into_iter().take(1).map(|queue| serve((&mut *worker, queue))).collect()
            }
            workers => parallel::map(workers.iter_mut().zip(queues), serve),
        }
    }

    fn restart(&mut self, worker: usize) -> io::Result<()> {
        if let Some(worker) = self.workers.get_mut(worker) {
            *worker = Worker::new();
        }
        Ok(())
    }
}

/// The way to a worker that answers over a stream, and how to end it.
pub struct Link {
    /// Its answers.
    pub answers: Box<dyn Read + Send>,
    /// What it is asked.
    pub requests: Box<dyn Write + Send>,
    /// Ends it; a read of its answers then ends too.
    pub end: Box<dyn FnMut() + Send>,
}

impl std::fmt::Debug for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Link")
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        (self.end)();
    }
}

/// Starts the worker of a number.
pub type Start = dyn FnMut(usize) -> io::Result<Link> + Send;

/// Workers behind streams, for instance processes.
pub struct RemoteWorkers {
    links: Vec<Link>,
    start: Box<Start>,
}

impl std::fmt::Debug for RemoteWorkers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RemoteWorkers").field("links", &self.links).finish_non_exhaustive()
    }
}

impl RemoteWorkers {
    /// Starts `count` workers, at least one. They are ended with this value.
    ///
    /// # Errors
    /// Why one cannot be started.
    pub fn start(count: usize, mut start: Box<Start>) -> io::Result<Self> {
        let links = (0..count.max(1)).map(&mut start).collect::<io::Result<_>>()?;
        Ok(Self { links, start })
    }
}

/// What the thread of a worker's connection reports.
enum News {
    Answer(usize, Answer),
    Lost(usize, String),
    Done,
}

fn talk(
    worker: usize,
    (answers, requests): (&mut dyn Read, &mut dyn Write),
    queue: &[Request],
    news: &mpsc::Sender<News>,
) -> Result<(), FrameError> {
    let (mut answers, mut requests) = (answers, requests);
    for request in queue {
        write_message(&mut requests, request)?;
        let answer = read_message::<Answer>(&mut answers)?;
        let ended = || io::Error::new(io::ErrorKind::UnexpectedEof, "the worker ended");
        // The receiver outlives every thread.
        let _sent = news.send(News::Answer(worker, answer.ok_or_else(ended)?));
    }
    Ok(())
}

impl Workers for RemoteWorkers {
    fn count(&self) -> usize {
        self.links.len()
    }

    fn read_files(&self) -> bool {
        true
    }

    fn exchange(&mut self, queues: Vec<Vec<Request>>, interrupt: &Interrupt) -> Vec<Exchanged> {
        let mut all: Vec<Exchanged> = queues.iter().map(|_| Exchanged::default()).collect();
        let (news, inbox) = mpsc::channel();
        thread::scope(|scope| {
            let mut ends = Vec::new();
            let mut running = 0;
            for (worker, (link, queue)) in self.links.iter_mut().zip(&queues).enumerate() {
                let Link { answers, requests, end } = link;
                ends.push(end);
                let news = news.clone();
                running += 1;
                scope.spawn(move || {
                    let streams =
                        (&mut **answers as &mut dyn Read, &mut **requests as &mut dyn Write);
                    let outcome = talk(worker, streams, queue, &news);
                    let last = outcome.map_or_else(
                        |error| News::Lost(worker, error.to_string()),
                        |()| News::Done,
                    );
                    let _sent = news.send(last);
                });
            }
            let mut is_ended = false;
            while running > 0 {
                match inbox.recv_timeout(QUESTION_EVERY) {
                    Ok(News::Answer(worker, answer)) => all[worker].answers.push(answer),
                    Ok(News::Lost(worker, why)) => {
                        all[worker].lost = Some(why);
                        running -= 1;
                    }
                    Ok(News::Done) => running -= 1,
                    Err(RecvTimeoutError::Disconnected) => break,
                    Err(RecvTimeoutError::Timeout) => {}
                }
                if !is_ended && interrupt.is_due() {
                    is_ended = true;
                    ends.iter_mut().for_each(|end| end());
                }
            }
        });
        all
    }

    fn restart(&mut self, worker: usize) -> io::Result<()> {
        let link = (self.start)(worker)?;
        if let Some(old) = self.links.get_mut(worker) {
            *old = link;
        }
        Ok(())
    }
}
