//! `OptimizationService`: one pose, a whole map, or a problem that comes with the call.
//!
//! Stateless solves run on the solver pool. A call that is dropped stops its solve; a call with a
//! deadline stops it early enough to answer with the best state so far. No mathematics here: the solves
//! are in `covis-solvers`.

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::price::Ceiling;
use prost::Message;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status};

use super::access::Caller;
use super::context::{Answers, Context, Messages, Rpcs};
use super::convert::entities::to_switched_off;
use super::convert::solve::{
    Systems, gauge, loss, options, to_certificate, to_chordal_certificate, to_iteration,
};
use super::convert::{Path, convert, count, ids};
use super::deadline::{CancelOnDrop, call_time, solve_deadline};
use super::engine::{
    Estimate, Fault, OptimizeOptions, OptimizeOutcome, OptimizeProblem, PoolError, Reservation,
    Resource, SolveStep,
};
use super::error::ServiceError;
use super::{bundle_solve, graph_solve, localize, refine};
use crate::map::Reason;
use crate::sync::Mutex;
use crate::wire::v1;
use v1::optimization_service_server::OptimizationService;
use v1::optimize_map_response::Event;

/// Largest message that is converted on the thread that received it, bytes. The time of a conversion
/// grows with the message, and other calls would wait behind a large one.
const SMALL_MESSAGE: usize = 64 << 10;

/// Most constraints that are switched off in a result: 1.5 MiB at the very most.
const MOST_SWITCHED_OFF: usize = 10_000;

/// Bytes of memory that a call counts for each byte of its message while it waits for its solve: the
/// message as it is decoded, and the problem that is made of it. The shortest entries take the most.
const WAITING_PER_BYTE: u64 = 12;

/// What the solve of a request may use.
#[derive(Clone, Copy, Debug)]
pub(super) struct SolveBudget {
    /// Threads of the pool.
    pub(super) threads: usize,
    /// The limits of a solve.
    pub(super) ceiling: Ceiling,
    /// When it must end.
    pub(super) deadline: Option<Instant>,
}

impl Rpcs {
    /// Runs a solve on the pool. A solve whose `deadline` passes while it is queued runs outside
    /// the pool instead: its time is over, so that it returns the start values.
    async fn solve<R: Send + 'static>(
        &self,
        caller: &Caller,
        estimate: Estimate,
        deadline: Option<Instant>,
        work: impl FnOnce() -> R + Send + 'static,
    ) -> Result<R, ServiceError> {
        let faulty = self.context.config.engine.injects(Fault::PanicInSolve);
        let meters = self.context.maps.meters();
        let (queued, span) = (meters.request_solve(), tracing::debug_span!("solve"));
        let held = Arc::new(Mutex::new(Some(work)));
        let take = |held: &Mutex<Option<_>>| held.lock().take();
        let offered = Arc::clone(&held);
        let work = move || {
            let _entered = span.entered();
            queued.run(|| {
                assert!(!faulty, "the fault that a test asked for");
                take(&offered).map(|work| work())
            })
        };
        let pool = self.context.maps.pool();
        let account = pool.accounts().tenant(caller.tenant());
        let mut solved = std::pin::pin!(pool.run(&account, estimate, work));
        let solved = tokio::select! {
            biased;
            solved = &mut solved => solved,
            () = reached(deadline) => match take(&held) {
                Some(work) => return Context::blocking(move || Ok(work())).await,
                // The solve runs already, and ends soon.
                None => solved.await,
            },
        };
        if let Err(PoolError::Panicked(_)) = solved {
            meters.solve_panics.increment();
        }
        // A solve without a result ran outside the pool, which is answered above.
        solved?.ok_or(ServiceError::DeadlineExceeded)
    }

    /// Reserves memory for a call of so many bytes, from its reading until its solve begins.
    fn wait(&self, caller: &Caller, bytes: usize) -> Result<Reservation, ServiceError> {
        let account = self.context.maps.pool().accounts().tenant(caller.tenant());
        let bytes = WAITING_PER_BYTE.saturating_mul(bytes as u64);
        Ok(account.reserve(Resource::WaitingSolveBytes, bytes)?)
    }

    /// Answers a call that brings its problem: reads it, and solves it on the pool.
    async fn solve_request<Q: Message + 'static, I: Send + 'static, A: Send + 'static>(
        &self,
        request: Request<Q>,
        input: fn(Q, &SolveBudget) -> Result<I, ServiceError>,
        estimate: fn(&I) -> Estimate,
        run: fn(I, &Interrupt) -> Result<A, ServiceError>,
    ) -> Result<A, ServiceError> {
        let caller = Caller::of(&request)?;
        let bytes = request.get_ref().encoded_len();
        let deadline = solve_deadline(&request, bytes);
        let (threads, ceiling) =
            (self.context.maps.pool().threads(), self.context.config.engine.ceiling());
        let waits = self.wait(&caller, bytes)?;
        let (request, budget) = (request.into_inner(), SolveBudget { threads, ceiling, deadline });
        let input = read(bytes, move || input(request, &budget)).await?;
        let (estimate, cancel) = (estimate(&input), CancelOnDrop::default());
        let interrupt = cancel.interrupt(deadline);
        let work = move || {
            drop(waits);
            run(input, &interrupt)
        };
        self.solve(&caller, estimate, deadline, work).await?
    }

    async fn locate(
        &self,
        request: Request<v1::LocalizeRequest>,
    ) -> Result<v1::LocalizeResponse, ServiceError> {
        let caller = Caller::of(&request)?;
        let bytes = request.get_ref().encoded_len();
        let deadline = solve_deadline(&request, bytes);
        let request = request.into_inner();
        // First of all: a call for a map that is not there, or of another tenant, has nothing read.
        let map_id = convert(|out| ids::map_id(&request.map_id, out))?;
        let map = self.context.maps.find(&caller.engine_name(&map_id)).await?;
        let _waits = self.wait(&caller, bytes)?;
        let input = read(bytes, move || localize::input(request)).await?;
        let snapshot = map.snapshot().await?;
        let cancel = CancelOnDrop::default();
        let interrupt = cancel.interrupt(deadline);
        let asked = Arc::new((map, snapshot, input, interrupt));
        loop {
            let asked = Arc::clone(&asked);
            let work = move || {
                let (map, snapshot, input, interrupt) = &*asked;
                let is_indexed = map.index_places(snapshot, interrupt);
                is_indexed.then(|| localize::run(map, snapshot, input, interrupt))
            };
            // An index that lacks much, as after a restart, is made in several turns of the pool.
            if let Some(answer) = self.solve(&caller, Estimate::LONG, deadline, work).await? {
                return answer;
            }
        }
    }
}

/// Converts a message of so many bytes: a large one on a blocking thread, so that other calls do not
/// wait behind it.
async fn read<T: Send + 'static>(
    bytes: usize,
    conversion: impl FnOnce() -> Result<T, ServiceError> + Send + 'static,
) -> Result<T, ServiceError> {
    if bytes <= SMALL_MESSAGE { conversion() } else { Context::blocking(conversion).await }
}

/// Resolves at `deadline`; never without one.
async fn reached(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => tokio::time::sleep_until(deadline.into()).await,
        None => std::future::pending().await,
    }
}

/// The map that a request names, and how it is to be solved.
pub(super) fn map_options(
    request: &v1::OptimizeMapRequest,
    threads: usize,
    deadline: Option<Instant>,
) -> Result<(String, OptimizeOptions), ServiceError> {
    Ok(convert(|out| {
        let map_id = ids::map_id(&request.map_id, out);
        let problem = match out.known(Path::root("problem"), request.problem)? {
            v1::MapProblem::Unspecified | v1::MapProblem::Full => OptimizeProblem::Full,
            v1::MapProblem::PoseGraph => OptimizeProblem::PoseGraph { certify: request.certify },
        };
        let systems = match problem {
            OptimizeProblem::Full | OptimizeProblem::Rebuild => Systems::Bundle,
            OptimizeProblem::PoseGraph { .. } => Systems::PoseGraph,
        };
        let options = options(request.options.as_ref(), systems, threads, None, out);
        let observation =
            loss(Path::root("observation_loss"), request.observation_loss.as_ref(), out);
        let constraint = loss(Path::root("constraint_loss"), request.constraint_loss.as_ref(), out);
        let gauge = gauge(Path::root("gauge"), request.gauge, out);
        if problem != OptimizeProblem::Full && request.observation_loss.is_some() {
            let text = "a pose graph has no observations";
            let at = Path::root("observation_loss");
            let _: Option<()> = out.report(at, Reason::Inconsistent, text);
        }
        if problem != OptimizeProblem::Full && request.refine_intrinsics {
            let text = "a pose graph has no intrinsics";
            let at = Path::root("refine_intrinsics");
            let _: Option<()> = out.report(at, Reason::Inconsistent, text);
        }
        if problem == OptimizeProblem::Full && request.certify {
            let text = "only a pose graph can be certified";
            let _: Option<()> = out.report(Path::root("certify"), Reason::Inconsistent, text);
        }
        let options = options?;
        Some((
            map_id?,
            OptimizeOptions {
                optimizer: options.optimizer,
                linear_solver: options.linear_solver,
                observation_loss: observation?,
                constraint_loss: constraint?,
                problem,
                gauge: gauge?,
                refine_intrinsics: request.refine_intrinsics,
                deadline,
            },
        ))
    })?)
}

pub(super) fn to_result(outcome: &OptimizeOutcome) -> v1::OptimizeMapResult {
    let off = outcome.switched_off.iter().take(MOST_SWITCHED_OFF);
    let off = off.map(|(client, id, off)| v1::SwitchedOffConstraint {
        constraint: Some(v1::ConstraintRef { client_id: client.clone(), id: *id }),
        switched_off: Some(to_switched_off(off)),
    });
    let proof = outcome.proof.as_ref().map(to_chordal_certificate);
    v1::OptimizeMapResult {
        summary: Some(to_certificate(&outcome.certificate)),
        revision: outcome.revision,
        camera_count: count(outcome.counts.cameras),
        keyframe_count: count(outcome.counts.keyframes),
        landmark_count: count(outcome.counts.landmarks),
        observation_count: count(outcome.counts.observations),
        constraint_count: count(outcome.counts.constraints),
        switched_off_constraints: off.collect(),
        chordal_certificate: proof,
        switched_off_constraint_count: count(outcome.switched_off.len()),
    }
}

#[async_trait::async_trait]
impl OptimizationService for Rpcs {
    async fn refine_pose(
        &self,
        request: Request<v1::RefinePoseRequest>,
    ) -> Result<Response<v1::RefinePoseResponse>, Status> {
        use refine::{Input, input, run};
        let refined = self.solve_request(request, input, Input::estimate, run);
        self.context.answer("RefinePose", refined).await
    }

    async fn localize(
        &self,
        request: Request<v1::LocalizeRequest>,
    ) -> Result<Response<v1::LocalizeResponse>, Status> {
        self.context.answer("Localize", self.locate(request)).await
    }

    type OptimizeMapStream = Answers<v1::OptimizeMapResponse>;

    async fn optimize_map(
        &self,
        request: Request<v1::OptimizeMapRequest>,
    ) -> Result<Response<Self::OptimizeMapStream>, Status> {
        let time = call_time(request.metadata());
        let deadline = solve_deadline(&request, 0);
        let caller = Caller::of(&request);
        let (context, request) = (Arc::clone(&self.context), request.into_inner());
        self.context.stream("OptimizeMap", time, Messages::Small, |sink| async move {
            let threads = context.maps.pool().threads();
            let (map_id, options) = map_options(&request, threads, deadline)?;
            let map = context.maps.find(&caller?.engine_name(&map_id)).await?;
            let (progress, mut steps) = mpsc::unbounded_channel();
            let forwarding = async {
                while let Some(step) = steps.recv().await {
                    let SolveStep::Iteration(row) = step else { continue };
                    let event = Some(Event::Iteration(to_iteration(&row)));
                    sink.send(v1::OptimizeMapResponse { event }).await?;
                }
                Ok::<(), ServiceError>(())
            };
            let solving = async { Ok(map.optimize(options, progress).await?) };
            let both = async { tokio::try_join!(solving, forwarding) };
            let (outcome, ()) = tokio::select! {
                biased;
                both = both => both?,
                () = context.drained() => return Err(ServiceError::Draining),
            };
            let event = Some(Event::Result(to_result(&outcome)));
            sink.send(v1::OptimizeMapResponse { event }).await
        })
    }

    async fn solve_bundle(
        &self,
        request: Request<v1::SolveBundleRequest>,
    ) -> Result<Response<v1::SolveBundleResponse>, Status> {
        use bundle_solve::{Input, input, run};
        let solved = self.solve_request(request, input, Input::estimate, run);
        self.context.answer("SolveBundle", solved).await
    }

    async fn solve_pose_graph(
        &self,
        request: Request<v1::SolvePoseGraphRequest>,
    ) -> Result<Response<v1::SolvePoseGraphResponse>, Status> {
        use graph_solve::{Input, input, run};
        let solved = self.solve_request(request, input, Input::estimate, run);
        self.context.answer("SolvePoseGraph", solved).await
    }
}
