//! Questions to all sections, and what becomes of them where workers are lost.
//!
//! The crew records what was sent to each worker. A worker that is lost is started again and is sent
//! what the pending question needs: its sections, and the values that the question is about. It checks
//! the kind of each reply; its numbers are checked by `coordinator`.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::SplitError;
use super::kept::Kept;
use super::message::{
    Answer, BorderPart, Linearize, Motion, Reply, Request, START, Source, Version,
};
use super::partition::Partition;
use super::section::Values;
use super::summary::{Round, Task, WorkerReport};
use super::workers::Workers;
use crate::interrupt::Interrupt;
use crate::price::Ceiling;
use crate::problem::BundleProblem;
use crate::simd::Class;

/// A request that loses so many workers in a row is what loses them.
const MOST_LOSSES: usize = 3;

/// What workers are told first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub(super) class: Class,
    pub(super) ceiling: Ceiling,
    pub(super) keep_bytes: u64,
}

/// What the coordinator knows of a section's worker.
#[derive(Default)]
struct State {
    /// Whether the worker has it, and which values.
    is_loaded: bool,
    kept: Kept<()>,
    border: Vec<BorderPart>,
    bytes: u64,
}

/// What one request of a queue was for.
#[derive(Clone, Copy)]
enum Asked {
    Open,
    Load(usize),
    SetValues(usize, Version),
    Question(usize),
}

/// What sections are asked.
pub(super) enum Question<'q> {
    /// Nothing: they are only loaded.
    Load,
    Cost,
    Contribute(Linearize),
    /// With the step of each section's border.
    Move(Linearize, &'q [Vec<f64>], Motion, Version),
}

/// All workers with their sections.
pub(super) struct Crew<'a> {
    problem: &'a BundleProblem,
    partition: &'a Partition,
    /// Where sections are that are in a file.
    sources: Vec<Source>,
    workers: &'a mut dyn Workers,
    opening: Opening,
    interrupt: &'a Interrupt,
    states: Vec<State>,
    is_open: Vec<bool>,
    pub(super) rounds: Vec<Round>,
    pub(super) reports: Vec<WorkerReport>,
    /// Why there is no result.
    pub(super) failure: Option<SplitError>,
    /// Set with it, for the observer of the loop's rows.
    pub(super) has_failed: Arc<AtomicBool>,
}

impl<'a> Crew<'a> {
    pub(super) fn new(
        problem: &'a BundleProblem,
        partition: &'a Partition,
        sources: Vec<Source>,
        workers: &'a mut dyn Workers,
        opening: Opening,
        interrupt: &'a Interrupt,
    ) -> Self {
        let sections = partition.sections.len();
        let count = workers.count();
        let mut reports = vec![WorkerReport::default(); count];
        for s in 0..sections {
            reports[s % count].sections.push(s);
        }
        Self {
            problem,
            partition,
            sources,
            opening,
            interrupt,
            states: (0..sections).map(|_| State::default()).collect(),
            is_open: vec![false; count],
            rounds: Vec::new(),
            reports,
            failure: None,
            has_failed: Arc::default(),
            workers,
        }
    }

    /// The border of each section, as its worker named it.
    pub(super) fn borders(&self) -> Vec<Vec<BorderPart>> {
        self.states.iter().map(|state| state.border.clone()).collect()
    }

    /// Estimated bytes of each section.
    pub(super) fn section_bytes(&self) -> Vec<u64> {
        self.states.iter().map(|state| state.bytes).collect()
    }

    /// Notes why there is no result.
    pub(super) fn fail<T>(&mut self, error: SplitError) -> Option<T> {
        // The first one is the cause of all others.
        self.failure.get_or_insert(error);
        self.has_failed.store(true, Ordering::Relaxed);
        None
    }

    /// A section as it is sent: with the values of the start.
    fn source(&self, section: usize) -> Source {
        match self.sources.get(section) {
            Some(source) => source.clone(),
            None => Source::Here(Box::new(self.partition.section(self.problem, section))),
        }
    }

    /// The queue of each worker for a question about `base`, with what each request is for.
    fn queues(
        &self,
        question: &Question<'_>,
        (base, values): (Version, &Values),
        replies: &[Option<Reply>],
    ) -> (Vec<Vec<Request>>, Vec<Vec<Asked>>) {
        let count = self.is_open.len();
        let (mut queues, mut asked) = (vec![Vec::new(); count], vec![Vec::new(); count]);
        for worker in 0..count {
            let mut ask = |request: Request, what: Asked| {
                queues[worker].push(request);
                asked[worker].push(what);
            };
            if !self.is_open[worker] {
                let Opening { class, ceiling, keep_bytes } = self.opening;
                let (ceiling_bytes, ceiling_flops) = (ceiling.bytes, ceiling.flops_per_iteration);
                ask(Request::Open { class, ceiling_bytes, ceiling_flops, keep_bytes }, Asked::Open);
            }
            for &s in &self.reports[worker].sections {
                if replies[s].is_some() {
                    continue;
                }
                let state = &self.states[s];
                let section = s as u32;
                if !state.is_loaded {
                    ask(Request::Load { section, source: self.source(s) }, Asked::Load(s));
                }
                let has_base = match state.is_loaded {
                    true => state.kept.get(base).is_some(),
                    false => base == START,
                };
                if !has_base {
                    let values = Values::gathered(values, &self.partition.sections[s]);
                    let request = Request::SetValues { section, version: base, values };
                    ask(request, Asked::SetValues(s, base));
                }
                if let Some(request) = question.request(s, base) {
                    ask(request, Asked::Question(s));
                }
            }
        }
        (queues, asked)
    }

    /// Asks every section about the values `base` of the whole, again where a worker is lost; the replies by section. `None` where there are
    /// none: interrupted or failed.
    pub(super) fn ask(
        &mut self,
        question: &Question<'_>,
        base: (Version, &Values),
    ) -> Option<Vec<Reply>> {
        if self.failure.is_some() {
            return None;
        }
        let start = Instant::now();
        let mut replies: Vec<Option<Reply>> = self.states.iter().map(|_| None).collect();
        let mut tasks = Vec::new();
        let mut losses = 0;
        loop {
            if self.interrupt.is_due() {
                return None;
            }
            let (queues, asked) = self.queues(question, base, &replies);
            let exchanged = self.workers.exchange(queues, self.interrupt);
            if self.interrupt.is_due() {
                return None;
            }
            let mut is_whole = true;
            let before = replies.iter().flatten().count();
            for (worker, (exchanged, asked)) in exchanged.into_iter().zip(asked).enumerate() {
                let is_short = exchanged.answers.len() < asked.len();
                is_whole &= !is_short;
                if is_short && exchanged.lost.is_none() {
                    return self.fail(SplitError::Answer { what: "silence" });
                }
                for (answer, what) in exchanged.answers.into_iter().zip(asked) {
                    self.take(
                        worker,
                        what,
                        answer,
                        question,
                        (replies.as_mut_slice(), &mut tasks),
                    )?;
                }
                if let Some(reason) = exchanged.lost {
                    losses = if replies.iter().flatten().count() > before { 1 } else { losses + 1 };
                    if losses > MOST_LOSSES {
                        return self.fail(SplitError::Lost { worker, reason });
                    }
                    self.restart(worker)?;
                }
            }
            if is_whole {
                break;
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        self.rounds.push(Round { kind: question.task(), tasks, seconds });
        Some(replies.into_iter().map(|reply| reply.unwrap_or(Reply::Done)).collect())
    }

    fn restart(&mut self, worker: usize) -> Option<()> {
        self.reports[worker].restarts += 1;
        self.is_open[worker] = false;
        for &s in &self.reports[worker].sections {
            self.states[s].is_loaded = false;
            self.states[s].kept.clear();
        }
        match self.workers.restart(worker) {
            Ok(()) => Some(()),
            Err(error) => self.fail(SplitError::Start { worker, reason: error.to_string() }),
        }
    }

    /// Takes one answer.
    fn take(
        &mut self,
        worker: usize,
        what: Asked,
        Answer { seconds, peak_bytes, reply }: Answer,
        question: &Question<'_>,
        (replies, tasks): (&mut [Option<Reply>], &mut Vec<(usize, f64)>),
    ) -> Option<()> {
        let report = &mut self.reports[worker];
        report.busy_seconds += seconds;
        report.peak_bytes = report.peak_bytes.max(peak_bytes);
        match (what, reply) {
            (Asked::Open, Reply::Opened(class)) if class == self.opening.class => {
                self.is_open[worker] = true;
            }
            (Asked::Load(s), Reply::Loaded { border, bytes }) => {
                let kept = &mut self.states[s].kept;
                kept.clear();
                kept.push(START, ());
                let state = &mut self.states[s];
                (state.is_loaded, state.border, state.bytes) = (true, border, bytes);
                if matches!(question, Question::Load) {
                    replies[s] = Some(Reply::Done);
                    tasks.push((s, seconds));
                }
            }
            (Asked::SetValues(s, version), Reply::Done) => self.states[s].kept.push(version, ()),
            (
                Asked::Question(s),
                reply @ (Reply::Cost(_) | Reply::Contributed(_) | Reply::Moved { .. }),
            ) => {
                if let Question::Move(linearize, _, _, version) = question {
                    self.states[s].kept.push_beside(linearize.base, *version, ());
                }
                tasks.push((s, seconds));
                replies[s] = Some(reply);
            }
            (_, Reply::Refused(reason)) => {
                return self.fail(SplitError::Refused { worker, reason });
            }
            _ => return self.fail(SplitError::Answer { what: "reply" }),
        }
        Some(())
    }
}

impl Question<'_> {
    fn request(&self, section: usize, base: Version) -> Option<Request> {
        let number = section as u32;
        match *self {
            Self::Load => None,
            Self::Cost => Some(Request::Cost { section: number, base }),
            Self::Contribute(linearize) => Some(Request::Contribute { section: number, linearize }),
            Self::Move(linearize, steps, motion, version) => {
                let step = steps.get(section)?.clone();
                Some(Request::Move { section: number, linearize, step, motion, version })
            }
        }
    }

    fn task(&self) -> Task {
        match self {
            Self::Load => Task::Load,
            Self::Cost => Task::Cost,
            Self::Contribute(_) => Task::Contribute,
            Self::Move(..) => Task::Move,
        }
    }
}
