//! Losses, solver options, how closures are judged, iterations and the certificate of a solve.
//!
//! Absent options take the defaults that `optimization.proto` states. Costs, residuals and counts
//! are taken from the solver's summary and the evaluator's reports; nothing is computed here.

use std::time::Duration;

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::evaluation::{
    CostReport, FactorCost, Quantity, ResidualStatistics, SigmaJudgment,
};
use covis_solvers::graph_optimization::Proof;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{
    IterationSummary, Method, Options, SolveSummary, Termination, Tolerance,
};
use covis_solvers::reconstruction::Scale;
use covis_solvers::robust::Kernel;
use covis_solvers::simd::Class;

use super::{Path, Violations, count, small};
use crate::map::{ClosureRobustness, Held, Reason};
use crate::service::engine::{
    ClosureCounts, GaugeKind, HeldKeyframe, Rebuilt, SolveCertificate, SolverKind, UnplacedKeyframe,
};
use crate::wire::v1;

/// Iterations if the request names none.
const DEFAULT_ITERATIONS: usize = 50;
/// Most iterations that a request may ask for.
const MAX_ITERATIONS: i64 = 10_000;

/// A loss, `None` within where the field is absent.
pub(in crate::service) fn loss(
    at: Path<'_>,
    message: Option<&v1::Loss>,
    out: &mut Violations,
) -> Option<Option<Loss>> {
    let Some(message) = message else { return Some(None) };
    let kind = out.known::<v1::LossKind>(at.field("kind"), message.kind)?;
    let with_width: fn(f64) -> Loss = match kind {
        v1::LossKind::Unspecified => return out.missing(at.field("kind")),
        v1::LossKind::Trivial => {
            if message.width.is_some() {
                let text = "the trivial loss takes no width";
                return out.report(at.field("width"), Reason::Inconsistent, text);
            }
            return Some(Some(Loss::Trivial));
        }
        v1::LossKind::Huber => Loss::Huber,
        v1::LossKind::Cauchy => Loss::Cauchy,
        v1::LossKind::Tukey => Loss::Tukey,
        v1::LossKind::GemanMcclure => Loss::GemanMcClure,
    };
    let Some(width) = message.width else { return out.missing(at.field("width")) };
    out.positive(at.field("width"), width).map(|width| Some(with_width(width)))
}

/// The loss of one factor alone; `None` within where it has none of its own.
pub(super) fn own_loss(
    at: Path<'_>,
    message: Option<&v1::Loss>,
    out: &mut Violations,
) -> Option<Option<Loss>> {
    loss(at.field("loss"), message, out)
}

/// The message of a loss.
pub(in crate::service) fn to_loss(loss: &Loss) -> v1::Loss {
    let kind = match loss {
        Loss::Trivial => v1::LossKind::Trivial,
        Loss::Huber(_) => v1::LossKind::Huber,
        Loss::Cauchy(_) => v1::LossKind::Cauchy,
        Loss::Tukey(_) => v1::LossKind::Tukey,
        Loss::GemanMcClure(_) => v1::LossKind::GemanMcclure,
    };
    v1::Loss { kind: kind.into(), width: loss.width() }
}

/// Which linear systems a kind of problem can be solved with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::service) enum Systems {
    /// Bundle adjustment: the Schur solvers.
    Bundle,
    /// Pose graphs: sparse Cholesky.
    PoseGraph,
    /// One pose: dense Cholesky.
    SinglePose,
}

/// Options of a solve in domain terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::service) struct SolveOptions {
    /// The loop's options.
    pub optimizer: Options,
    /// The reduced system's solver; for bundles only.
    pub linear_solver: LinearSolver,
}

/// The options of a solve on a pool of `pool_threads`; `call` is the time that the call still has.
pub(in crate::service) fn options(
    message: Option<&v1::SolverOptions>,
    systems: Systems,
    pool_threads: usize,
    call: Option<Duration>,
    out: &mut Violations,
) -> Option<SolveOptions> {
    let at = Path::root("options");
    let absent = v1::SolverOptions::default();
    let m = message.unwrap_or(&absent);
    let iterations = match m.max_iteration_count {
        None => Some(DEFAULT_ITERATIONS),
        Some(n) => out.within(at.field("max_iteration_count"), n, 0, MAX_ITERATIONS),
    };
    let method = match out.known(at.field("method"), m.method) {
        Some(v1::SolverMethod::Unspecified | v1::SolverMethod::LevenbergMarquardt) => {
            Some(Method::LevenbergMarquardt)
        }
        Some(v1::SolverMethod::GaussNewton) => Some(Method::GaussNewton),
        None => None,
    };
    let linear_solver = linear_solver(at, m.linear_solver, systems, out);
    let threads = out.within(at.field("thread_count"), m.thread_count, 0, i64::from(i32::MAX));
    let tolerance = |name, value: Option<f64>, default, out: &mut Violations| {
        out.not_negative(at.field(name), value.unwrap_or(default))
    };
    let cost = tolerance("function_tolerance", m.function_tolerance, 1e-10, out);
    let gradient = tolerance("gradient_tolerance", m.gradient_tolerance, 1e-10, out);
    let step = tolerance("parameter_tolerance", m.parameter_tolerance, 1e-12, out);
    let own_deadline = match m.deadline_ms {
        None => Some(None),
        Some(ms) => out
            .within(at.field("deadline_ms"), ms, 1, i64::MAX)
            .and_then(|ms| u64::try_from(ms).ok())
            .map(|ms| Some(Duration::from_millis(ms))),
    };
    let damping = out.positive(at.field("initial_damping"), m.initial_damping.unwrap_or(1e-4));
    let threads = match threads? {
        0 => None,
        n if n >= pool_threads => None,
        n => Some(n),
    };
    let deadline = own_deadline?.into_iter().chain(call).min();
    let optimizer = Options {
        method: method?,
        max_iterations: iterations?,
        cost_tolerance: cost?,
        gradient_tolerance: gradient?,
        step_tolerance: step?,
        initial_damping: damping?,
        deadline,
        threads,
        ..Options::default()
    };
    Some(SolveOptions { optimizer, linear_solver: linear_solver? })
}

fn linear_solver(
    at: Path<'_>,
    value: i32,
    systems: Systems,
    out: &mut Violations,
) -> Option<LinearSolver> {
    use v1::LinearSolver as Wire;
    let at = at.field("linear_solver");
    let wanted = out.known::<Wire>(at, value)?;
    match (wanted, systems) {
        (Wire::Unspecified | Wire::Auto, _)
        | (Wire::SparseCholesky, Systems::PoseGraph)
        | (Wire::DenseCholesky, Systems::SinglePose) => Some(LinearSolver::Auto),
        (Wire::DenseSchur, Systems::Bundle) => Some(LinearSolver::DenseSchur),
        (Wire::SparseSchur, Systems::Bundle) => Some(LinearSolver::SparseSchur),
        (Wire::IterativeSchur, Systems::Bundle) => Some(LinearSolver::IterativeSchur),
        (
            Wire::DenseSchur | Wire::SparseSchur | Wire::IterativeSchur,
            Systems::PoseGraph | Systems::SinglePose,
        )
        | (Wire::SparseCholesky, Systems::Bundle | Systems::SinglePose)
        | (Wire::DenseCholesky, Systems::Bundle | Systems::PoseGraph) => {
            let text = format!("{} does not fit this problem", wanted.as_str_name());
            out.report(at, Reason::Inconsistent, text)
        }
    }
}

/// The message of a bundle's linear solver.
pub(in crate::service) fn to_linear_solver(solver: LinearSolver) -> v1::LinearSolver {
    match solver {
        LinearSolver::Auto => v1::LinearSolver::Auto,
        LinearSolver::DenseSchur => v1::LinearSolver::DenseSchur,
        LinearSolver::SparseSchur => v1::LinearSolver::SparseSchur,
        LinearSolver::IterativeSchur => v1::LinearSolver::IterativeSchur,
    }
}

/// The message of one row.
pub(in crate::service) fn to_iteration(row: &IterationSummary) -> v1::IterationSummary {
    v1::IterationSummary {
        iteration: small(row.iteration),
        cost: row.cost,
        accepted: row.accepted,
        gradient_max_norm: row.gradient_max_norm,
        step_norm: row.step_norm,
        damping: row.damping,
        step_quality: row.step_quality,
        elapsed_us: microseconds(row.seconds),
    }
}

/// Whole microseconds of a time in seconds.
fn microseconds(seconds: f64) -> i64 {
    let duration = Duration::try_from_secs_f64(seconds).unwrap_or_default();
    i64::try_from(duration.as_micros()).unwrap_or(i64::MAX)
}

fn to_termination(termination: Termination) -> v1::Termination {
    match termination {
        Termination::Converged(Tolerance::Cost) => v1::Termination::ConvergedFunction,
        Termination::Converged(Tolerance::Gradient) => v1::Termination::ConvergedGradient,
        Termination::Converged(Tolerance::Step) => v1::Termination::ConvergedParameter,
        Termination::MaxIterations => v1::Termination::MaxIterations,
        Termination::Deadline => v1::Termination::Deadline,
        Termination::Cancelled => v1::Termination::Cancelled,
        Termination::Stalled => v1::Termination::Stalled,
        Termination::NumericalFailure => v1::Termination::NumericalFailure,
    }
}

/// The part of a certificate that the loop itself knows; the caller fills in the rest.
pub(in crate::service) fn to_summary(solve: &SolveSummary, method: Method) -> v1::SolveSummary {
    let rows = solve.iterations.iter().skip(1);
    let method = match method {
        Method::LevenbergMarquardt => v1::SolverMethod::LevenbergMarquardt,
        Method::GaussNewton => v1::SolverMethod::GaussNewton,
    };
    v1::SolveSummary {
        termination: to_termination(solve.termination).into(),
        description: solve.termination.to_string(),
        initial_cost: solve.initial_cost,
        final_cost: solve.final_cost,
        gradient_max_norm: solve.gradient_max_norm,
        linear_residual: solve.linear_residual,
        thread_count: small(solve.threads),
        iteration_count: small(rows.clone().count()),
        accepted_iteration_count: small(rows.filter(|row| row.accepted).count()),
        method: method.into(),
        solve_duration_us: microseconds(solve.solve_seconds),
        simd_class: Class::detect().to_string(),
        ..v1::SolveSummary::default()
    }
}

/// Fills costs by kind of factor, residuals by quantity and points behind their cameras.
pub(in crate::service) fn add_costs(
    summary: &mut v1::SolveSummary,
    before: &CostReport,
    after: &CostReport,
) {
    let kinds: [(v1::FactorKind, FactorCost, FactorCost); 6] = [
        (v1::FactorKind::Reprojection, before.reprojection, after.reprojection),
        (v1::FactorKind::DepthReprojection, before.depth_reprojection, after.depth_reprojection),
        (v1::FactorKind::RelativePose, before.relative_pose, after.relative_pose),
        (v1::FactorKind::PosePrior, before.pose_prior, after.pose_prior),
        (v1::FactorKind::PositionPrior, before.position_prior, after.position_prior),
        (v1::FactorKind::Landmark, before.landmark, after.landmark),
    ];
    summary.factor_costs = kinds
        .into_iter()
        .filter(|(_, before, _)| before.count > 0)
        .map(|(kind, before, after)| v1::FactorCost {
            kind: kind.into(),
            factor_count: count(before.count),
            initial_cost: before.cost,
            final_cost: after.cost,
        })
        .collect();
    let observations = before.reprojection.count + before.depth_reprojection.count;
    summary.reprojection = (observations > 0).then_some(v1::ReprojectionStatistics {
        observation_count: count(observations),
        initial_rmse_px: before.rmse_px,
        final_rmse_px: after.rmse_px,
    });
    summary.behind_camera_observation_count = count(after.behind_camera);
    let residuals = after.residuals.iter();
    summary.residuals = residuals
        .map(|(quantity, after)| to_residuals(quantity, before.residuals.of(quantity), after))
        .collect();
}

/// The message's name of a quantity.
pub(in crate::service) fn to_residual_kind(quantity: Quantity) -> v1::ResidualKind {
    match quantity {
        Quantity::Pixel => v1::ResidualKind::Pixel,
        Quantity::Depth => v1::ResidualKind::Depth,
        Quantity::RelativeTranslation => v1::ResidualKind::RelativeTranslation,
        Quantity::RelativeRotation => v1::ResidualKind::RelativeRotation,
        Quantity::PriorTranslation => v1::ResidualKind::PriorTranslation,
        Quantity::PriorRotation => v1::ResidualKind::PriorRotation,
        Quantity::PriorPosition => v1::ResidualKind::PriorPosition,
        Quantity::LandmarkPosition => v1::ResidualKind::LandmarkPosition,
        Quantity::LandmarkBearing => v1::ResidualKind::LandmarkBearing,
        // Its name on the wire is older than ranges between poses.
        Quantity::Range => v1::ResidualKind::LandmarkRange,
    }
}

/// The message of the residuals of one quantity; `before` may have none.
fn to_residuals(
    quantity: Quantity,
    before: &ResidualStatistics,
    after: &ResidualStatistics,
) -> v1::ResidualStatistics {
    let judgment = match after.judgment() {
        SigmaJudgment::Unknown => v1::SigmaJudgment::Unspecified,
        SigmaJudgment::Plausible => v1::SigmaJudgment::Plausible,
        SigmaJudgment::TooSmall => v1::SigmaJudgment::TooSmall,
        SigmaJudgment::TooLarge => v1::SigmaJudgment::TooLarge,
    };
    v1::ResidualStatistics {
        kind: to_residual_kind(quantity).into(),
        factor_count: count(after.count),
        initial_rms: (before.count > 0).then_some(before.rms),
        final_rms: after.rms,
        redundant_count: count(after.redundant_count),
        initial_redundant_rms: (before.count > 0).then_some(before.redundant_rms),
        final_redundant_rms: after.redundant_rms,
        reduced_chi2: after.reduced_chi2,
        outlier_share: after.outlier_share,
        sigma_ratio: after.sigma_ratio,
        sigma_judgment: judgment.into(),
        hint: after.hint(quantity).unwrap_or_default(),
    }
}

/// The rows of a solve, or none if they were not requested.
pub(in crate::service) fn to_iterations(
    solve: &SolveSummary,
    wanted: bool,
) -> Vec<v1::IterationSummary> {
    if wanted { solve.iterations.iter().map(to_iteration).collect() } else { Vec::new() }
}

/// The whole certificate of a map's solve.
pub(in crate::service) fn to_certificate(certificate: &SolveCertificate) -> v1::SolveSummary {
    let mut summary = to_summary(&certificate.solve, certificate.method);
    add_costs(&mut summary, &certificate.before, &certificate.after);
    summary.linear_solver = match certificate.linear_solver {
        SolverKind::Schur(solver) => to_linear_solver(solver),
        SolverKind::SparseCholesky => v1::LinearSolver::SparseCholesky,
    }
    .into();
    summary.gauge = to_gauge(certificate.gauge).into();
    summary.free_pose_count = count(certificate.free_poses);
    summary.fixed_pose_count = count(certificate.fixed_poses);
    summary.free_landmark_count = count(certificate.free_landmarks);
    summary.closures = certificate.closures.as_ref().map(to_closure_summary);
    summary.held_keyframes = certificate.held.iter().map(to_held_keyframe).collect();
    summary
}

fn to_held_keyframe(held: &HeldKeyframe) -> v1::HeldKeyframe {
    let reason = match held.reason {
        Held::Unmeasured => v1::HoldReason::Unmeasured,
        Held::Behind => v1::HoldReason::Behind,
        Held::Worse => v1::HoldReason::Worse,
        Held::Undetermined => v1::HoldReason::Undetermined,
        Held::Scale => v1::HoldReason::Scale,
    };
    let (client_id, keyframe_id) = (held.client.clone(), held.id);
    v1::HeldKeyframe { client_id, keyframe_id, reason: reason.into() }
}

/// Most keyframes without a pose that are named.
const MOST_UNPLACED: usize = 1000;

/// What a reconstruction found.
pub(in crate::service) fn to_reconstruction(rebuilt: &Rebuilt) -> v1::Reconstruction {
    let unplaced = rebuilt.unplaced.iter().take(MOST_UNPLACED).cloned();
    let unplaced = unplaced.map(|UnplacedKeyframe { client, id, reason }| v1::UnplacedKeyframe {
        client_id: client,
        id,
        reason,
    });
    let length_unit = match rebuilt.scale {
        Scale::Depth => v1::LengthUnit::Depth,
        Scale::RelativePoses => v1::LengthUnit::RelativePoses,
        Scale::Given => v1::LengthUnit::Given,
        Scale::Convention => v1::LengthUnit::Convention,
    };
    v1::Reconstruction {
        keyframe_count: count(rebuilt.keyframes),
        placed_keyframe_count: count(rebuilt.placed),
        landmark_count: count(rebuilt.landmarks),
        placed_landmark_count: count(rebuilt.placed_landmarks),
        observation_count: count(rebuilt.observations),
        agreeing_observation_count: count(rebuilt.agreeing),
        pair_count: count(rebuilt.view_graph.pairs),
        measured_pair_count: count(rebuilt.view_graph.measured),
        relative_pose_count: count(rebuilt.view_graph.edges),
        length_unit: length_unit.into(),
        unplaced_keyframes: unplaced.collect(),
    }
}

fn to_closure_summary(closures: &ClosureCounts) -> v1::ClosureSummary {
    let factors = closures.factors.iter().map(|(client_id, factors)| v1::VarianceFactors {
        client_id: client_id.clone(),
        odometry: factors.odometry,
        loop_closure: factors.closures,
    });
    v1::ClosureSummary {
        closure_count: count(closures.judged),
        switched_off_count: count(closures.switched_off),
        provisional_count: count(closures.provisional),
        variance_factors: factors.collect(),
    }
}

/// The gauge of a map or of a request; `None` within where it is left to others.
pub(in crate::service) fn gauge(
    at: Path<'_>,
    value: i32,
    out: &mut Violations,
) -> Option<Option<GaugeKind>> {
    Some(match out.known::<v1::Gauge>(at, value)? {
        v1::Gauge::Unspecified => None,
        v1::Gauge::FirstKeyframeFixed => Some(GaugeKind::FirstKeyframeFixed),
        v1::Gauge::Free => Some(GaugeKind::Free),
        v1::Gauge::Priors => Some(GaugeKind::Priors),
        v1::Gauge::FixedPoses => Some(GaugeKind::FixedPoses),
    })
}

/// The message of a gauge.
pub(in crate::service) fn to_gauge(gauge: GaugeKind) -> v1::Gauge {
    match gauge {
        GaugeKind::FirstKeyframeFixed => v1::Gauge::FirstKeyframeFixed,
        GaugeKind::Free => v1::Gauge::Free,
        GaugeKind::Priors => v1::Gauge::Priors,
        GaugeKind::FixedPoses => v1::Gauge::FixedPoses,
    }
}

/// How closures are judged; absent fields are those of `default`.
pub(in crate::service) fn robustness(
    at: Path<'_>,
    message: Option<&v1::ClosureRobustness>,
    default: ClosureRobustness,
    out: &mut Violations,
) -> Option<ClosureRobustness> {
    let Some(m) = message else { return Some(default) };
    let kernel = match out.known::<v1::RobustKernel>(at.field("kernel"), m.kernel) {
        None => None,
        Some(v1::RobustKernel::Unspecified) => Some(default.kernel),
        Some(v1::RobustKernel::None) => Some(None),
        Some(v1::RobustKernel::GncTls) => Some(Some(Kernel::TruncatedLeastSquares)),
        Some(v1::RobustKernel::GncGm) => Some(Some(Kernel::GemanMcClure)),
    };
    let threshold = match m.threshold {
        None => Some(default.threshold),
        // As answers fill it in: a policy that is sent back stays as it is.
        Some(threshold) if threshold == default.threshold_of_dimension(6) => {
            Some(default.threshold)
        }
        Some(threshold) => out.positive(at.field("threshold"), threshold).map(Some),
    };
    Some(ClosureRobustness { kernel: kernel?, threshold: threshold? })
}

/// The message of how a map's closures are judged, its default threshold filled in.
pub(in crate::service) fn to_robustness(robustness: &ClosureRobustness) -> v1::ClosureRobustness {
    let kernel = match robustness.kernel {
        None => v1::RobustKernel::None,
        Some(Kernel::TruncatedLeastSquares) => v1::RobustKernel::GncTls,
        Some(Kernel::GemanMcClure) => v1::RobustKernel::GncGm,
    };
    v1::ClosureRobustness {
        kernel: kernel.into(),
        threshold: Some(robustness.threshold_of_dimension(6)),
    }
}

/// The message of a chordal certificate that took `seconds`.
pub(in crate::service) fn to_chordal_certificate(
    Proof { certificate, seconds }: &Proof,
) -> v1::ChordalCertificate {
    v1::ChordalCertificate {
        certified: certificate.certified,
        cost: certificate.cost,
        gap: certificate.gap,
        min_eigenvalue: certificate.min_eigenvalue,
        lift_count: small(certificate.lifts),
        duration_us: microseconds(*seconds),
    }
}
