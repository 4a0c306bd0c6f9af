//! The loop: linearize, solve for λ, try the step, accept or restore.
//!
//! Levenberg-Marquardt after Madsen, Nielsen and Tingleff, "Methods for non-linear least squares
//! problems" (2004): an accepted step of quality q multiplies λ by max(1/3, 1 − (2q − 1)³), a
//! rejected one by 2, 4, 8, …. The model's decrease is ½ δᵀ(λDδ − g), which needs no further pass.
//!
//! Reweighted least squares overstates the curvature of a robust loss along a residual, so that steps
//! fall short of the minimum, in flat valleys by far. With losses the system therefore follows each
//! step by inner iterations, and the loop lowers the stiffness of linearizations where steps turn out
//! too short, raises it where they overshoot, as it does with λ, and lengthens a short step, which
//! takes costs only. Under bounded losses all this begins once steps lower the cost by little: before,
//! they would give up observations of a poor start for good. Without losses nothing of this is done.

use std::time::Instant;

use super::options::{Method, Options};
use super::summary::{Control, IterationSummary, Observer, SolveSummary, Termination, Tolerance};
use super::system::{Losses, Step, System};
use crate::interrupt::{Interrupt, Interruption};

/// λ leaves this range only by ending the loop.
const DAMPING_RANGE: (f64, f64) = (1e-16, 1e32);

/// Diagonal entries of D, Marquardt's scaling of the damping λD, are kept in this range: directions
/// without information are damped, and products of two entries are finite.
///
/// It is wide, since where it cuts, the damping depends on the unit of length. A larger lower end
/// would hold landmarks on their way to infinity by an absolute length (at a million kilometers a
/// pixel still says 1e-13 per m²); a smaller upper end would leave a landmark next to a camera's
/// center plane undamped.
pub(crate) const SCALE_RANGE: (f64, f64) = (1e-18, 1e150);

/// The entry of D at a diagonal entry of H.
pub(crate) fn damping_scale(diagonal: f64) -> f64 {
    diagonal.clamp(SCALE_RANGE.0, SCALE_RANGE.1)
}

/// A linear residual above this makes a step untrustworthy: it is rejected like one that fails.
const LINEAR_RESIDUAL_LIMIT: f64 = 1e-3;

/// A short damped step proves a minimum only where no more than this share of the cost is left to gain.
const COST_RESOLUTION: f64 = 1e-12;

/// Damping of a first step that counts as next to none.
const NEARLY_UNDAMPED: f64 = 1e-8;

/// Where the model with next to no damping falls by more than this share of the cost although damped
/// steps lower it by next to nothing, the damping begins anew.
const RESTART: f64 = 1e-6;

/// With losses, a step of better quality than this is too short: the parabola through the costs before
/// and after it is lower at twice the step.
const SHORT_STEP: f64 = 4.0 / 3.0;

/// What multiples of a short step are tried.
const LENGTHS: [f64; 4] = [2.0, 4.0, 8.0, 16.0];

/// The stiffness falls by the first factor after a short step, to `LEAST_STIFFNESS` at least, and rises
/// by the second after one of worse quality than `TOO_SOFT`, twice after one that is rejected.
/// Constants from measurements on RGB-D and photo collections.
const SOFTEN: f64 = 0.25;
const STIFFEN: f64 = 4.0;
const TOO_SOFT: f64 = 0.5;
const LEAST_STIFFNESS: f64 = 0.003;

/// Under bounded losses a step that lowers the cost by this share or less ends the approach.
const APPROACHED: f64 = 0.01;

/// Where a loop stands after an accepted step. With the values of the variables it is all that the rest
/// depends on: a loop that goes on from there takes the steps that it would have taken, to the bit.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopState {
    /// Cost before the first step.
    pub initial_cost: f64,
    /// Cost now.
    pub cost: f64,
    /// λ of the next step.
    pub damping: f64,
    /// By what λ grows where that step is rejected.
    pub damping_growth: f64,
    /// See [`System::set_stiffness`]; `None` where inner iterations have not begun.
    pub stiffness: Option<f64>,
    /// Whether steps under bounded losses still lower the cost by much.
    pub is_approaching: bool,
    /// See [`Step::linear_residual`]; that of the last step.
    pub linear_residual: f64,
    /// The rows so far.
    pub rows: Vec<IterationSummary>,
}

impl LoopState {
    /// Iterations so far.
    #[must_use]
    pub fn iteration(&self) -> usize {
        self.rows.last().map_or(0, |row| row.iteration)
    }

    fn seconds(&self) -> f64 {
        self.rows.last().map_or(0.0, |row| row.seconds)
    }
}

/// Minimizes `system` and leaves it at the best state found. `start` is when the caller's clock
/// began, so that its preparations are counted.
///
/// It ends at `interrupt`, which is that of the system and alone decides: the deadline of the options
/// is the caller's to put into it. The cost of the start is counted whatever the time is, since the
/// answer needs it. If `from` is given, it goes on from where another loop stood: the system has the
/// values that the variables had then. Rows and times go on from those of that loop.
pub fn minimize(
    system: &mut dyn System,
    options: &Options,
    start: Instant,
    interrupt: &Interrupt,
    from: Option<&LoopState>,
    observer: &mut Observer<'_>,
) -> SolveSummary {
    let cost = system.cost();
    let losses = system.losses();
    if losses == Losses::Unbounded || from.is_some_and(|from| from.stiffness.is_some()) {
        system.begin_inner_iterations();
    }
    let state = LoopState {
        initial_cost: cost,
        cost,
        damping: match options.method {
            Method::LevenbergMarquardt => options.initial_damping,
            Method::GaussNewton => 0.0,
        },
        damping_growth: 2.0,
        stiffness: (losses == Losses::Unbounded).then_some(1.0),
        is_approaching: losses == Losses::Bounded,
        linear_residual: 0.0,
        rows: Vec::new(),
    };
    let state = from.cloned().unwrap_or(state);
    let seconds_before = state.seconds();
    let mut run = Run {
        options,
        start,
        interrupt,
        seconds_before,
        gradient_max_norm: 0.0,
        light_decrease: None,
        state,
    };
    let termination = match from {
        None => run.begin(system, observer),
        Some(_) => run.resume(system, observer),
    };
    SolveSummary {
        termination,
        initial_cost: run.state.initial_cost,
        final_cost: run.state.cost,
        iterations: run.state.rows,
        gradient_max_norm: run.gradient_max_norm,
        linear_residual: run.state.linear_residual,
        solve_seconds: run.seconds_before + start.elapsed().as_secs_f64(),
        threads: rayon::current_num_threads(),
    }
}

/// Lengthens the applied step while the cost falls, from `cost`; returns the cost of the best.
fn lengthen(system: &mut dyn System, cost: f64) -> f64 {
    let (mut best, mut at) = (cost, 1.0);
    for length in LENGTHS {
        match system.apply_lengthened(length) {
            Some(trial) if trial < best => (best, at) = (trial, length),
            Some(_) => return system.apply_lengthened(at).unwrap_or(best),
            None => return best,
        }
    }
    best
}

/// Whether the linear system was solved as exactly as it was meant to be.
fn is_trusted(step: &Step) -> bool {
    step.is_inexact || step.linear_residual <= LINEAR_RESIDUAL_LIMIT
}

struct Run<'a> {
    options: &'a Options,
    start: Instant,
    interrupt: &'a Interrupt,
    /// Of the loop that this one goes on from.
    seconds_before: f64,
    gradient_max_norm: f64,
    /// See [`Run::light_decrease`]; of the last linearization, once it was asked for.
    light_decrease: Option<f64>,
    state: LoopState,
}

impl Run<'_> {
    fn begin(&mut self, system: &mut dyn System, observer: &mut Observer<'_>) -> Termination {
        if !self.state.cost.is_finite() {
            return Termination::NumericalFailure;
        }
        let end = self.linearize(system);
        if let Some(end) = self.record(0, true, None, observer).or(end) {
            return end;
        }
        self.iterate(system, 0, observer)
    }

    /// Continues where another loop ended.
    fn resume(&mut self, system: &mut dyn System, observer: &mut Observer<'_>) -> Termination {
        if let Some(stiffness) = self.state.stiffness {
            system.set_stiffness(stiffness);
        }
        if let Some(end) = self.linearize(system) {
            return end;
        }
        self.iterate(system, self.state.iteration(), observer)
    }

    fn iterate(
        &mut self,
        system: &mut dyn System,
        mut iteration: usize,
        observer: &mut Observer<'_>,
    ) -> Termination {
        let tolerance = self.options.cost_tolerance;
        loop {
            if !self.gradient_max_norm.is_finite() {
                return Termination::NumericalFailure;
            }
            if self.gradient_max_norm <= self.options.gradient_tolerance {
                return Termination::Converged(Tolerance::Gradient);
            }
            iteration += 1;
            if iteration > self.options.max_iterations {
                return Termination::MaxIterations;
            }
            let solved = system.solve(self.state.damping);
            if let Some(end) = self.interrupted() {
                return end;
            }
            let Some(step) = solved.ok().filter(is_trusted) else {
                if let Some(end) = self.reject(iteration, None, observer) {
                    return end;
                }
                continue;
            };
            self.state.linear_residual = step.linear_residual;
            // Under heavy damping every step is short: then it proves a minimum only where the gradient
            // agrees. A light one that is short has reached what rounding leaves of the state.
            let short = step.norm <= self.options.step_tolerance * step.state_norm;
            let damping = self.state.damping;
            let light = damping <= self.options.initial_damping;
            let mut trial = system.apply();
            // That of the step before it is lengthened.
            let quality = (self.state.cost - trial) / step.predicted_decrease;
            if self.state.stiffness.is_some() && quality > SHORT_STEP {
                trial = lengthen(system, trial);
            }
            if let Some(end) = self.interrupted() {
                // Its cost may be half counted.
                system.restore();
                return end;
            }
            let decrease = self.state.cost - trial;
            if trial.is_finite() && decrease >= 0.0 && quality > 0.0 {
                let small = decrease <= tolerance * self.state.cost;
                let has_approached =
                    self.state.is_approaching && decrease <= APPROACHED * self.state.cost;
                self.state.cost = trial;
                let damping_used = self.state.damping;
                self.accept(quality);
                self.adapt_stiffness(system, quality);
                if has_approached {
                    self.state.is_approaching = false;
                    self.state.stiffness = Some(1.0);
                    system.begin_inner_iterations();
                }
                let end = self.linearize(system);
                let stats = Some((step, quality, damping_used));
                if let Some(end) = self.record(iteration, true, stats, observer).or(end) {
                    return end;
                }
                // A small decrease proves a minimum only where the model agrees with the cost.
                let gain = step.predicted_decrease;
                let is_small = small && gain <= 4.0 * tolerance * self.state.cost;
                if is_small && self.is_flat(system, tolerance, damping) {
                    return Termination::Converged(Tolerance::Cost);
                }
                if short && (light || self.is_flat(system, COST_RESOLUTION, damping)) {
                    return Termination::Converged(Tolerance::Step);
                }
                if let Some(row) = self.state.rows.last() {
                    system.keep(row, &|| self.state.clone());
                }
            } else {
                system.restore();
                let spent = step.predicted_decrease <= 1e-3 * tolerance * self.state.cost;
                let met = if short && (light || self.is_flat(system, COST_RESOLUTION, damping)) {
                    Some(Tolerance::Step)
                } else {
                    (spent && self.is_flat(system, tolerance, damping)).then_some(Tolerance::Cost)
                };
                if let Some(met) = met {
                    // The model sees nothing left to gain that the cost could resolve.
                    let stats = Some((step, quality, self.state.damping));
                    let end = self.record(iteration, false, stats, observer);
                    return end.unwrap_or(Termination::Converged(met));
                }
                if self.state.stiffness.is_some_and(|stiffness| stiffness < 1.0) {
                    let stats = Some((step, quality, self.state.damping));
                    if let Some(end) = self.record(iteration, false, stats, observer) {
                        return end;
                    }
                    self.adapt_stiffness(system, f64::NEG_INFINITY);
                    continue;
                }
                if let Some(end) = self.reject(iteration, Some((step, quality)), observer) {
                    return end;
                }
            }
        }
    }

    /// Sets the stiffness of the next linearization from the quality of a step, −∞ where the step was
    /// rejected.
    fn adapt_stiffness(&mut self, system: &mut dyn System, quality: f64) {
        let Some(stiffness) = self.state.stiffness else { return };
        let adapted = if quality > SHORT_STEP {
            (SOFTEN * stiffness).max(LEAST_STIFFNESS)
        } else if quality >= TOO_SOFT {
            stiffness
        } else if quality == f64::NEG_INFINITY {
            (STIFFEN * STIFFEN * stiffness).min(1.0)
        } else {
            (STIFFEN * stiffness).min(1.0)
        };
        if adapted != stiffness {
            self.state.stiffness = Some(adapted);
            system.set_stiffness(adapted);
        }
    }

    /// Linearizes; without an interruption the gradient is then that of the state.
    fn linearize(&mut self, system: &mut dyn System) -> Option<Termination> {
        let gradient = system.linearize(self.state.damping);
        self.light_decrease = None;
        let end = self.interrupted();
        if end.is_none() {
            self.gradient_max_norm = gradient.max_norm;
        }
        end
    }

    /// How the loop ends where the interrupt is due.
    fn interrupted(&self) -> Option<Termination> {
        self.interrupt.reason().map(Termination::from)
    }

    /// Whether no more than `share` of the cost is left to gain at the last linearization.
    ///
    /// Where the undamped model falls by Δ, gᵀH⁻¹g = 2Δ and so g_i² ≤ 2Δ H_ii for every i. A larger
    /// gradient tells a step that is short for its damping from one that is at a minimum. A small one
    /// does not prove the minimum: along a soft direction, where H⁻¹ is far above 1 / H_ii, it leaves
    /// much to gain. Where damping may hide such a direction, the model with next to none decides, which
    /// takes one more factorization. If it sees very much, the damping begins anew.
    fn is_flat(&mut self, system: &mut dyn System, share: f64, damping: f64) -> bool {
        // Up to four times the share is granted to the model, as above.
        if self.gradient_max_norm.powi(2) > 8.0 * share * self.state.cost {
            return false;
        }
        if !self.may_hide(damping) {
            return true;
        }
        let decrease = self.light_decrease(system);
        if decrease > RESTART * self.state.cost && decrease.is_finite() {
            self.state.damping = self.options.initial_damping;
            self.state.damping_growth = 2.0;
        }
        decrease <= 4.0 * share * self.state.cost
    }

    /// Whether a step of this damping may hide a soft direction.
    ///
    /// Heavier damping than that of the first step does. Where that one is next to nothing, as in pose
    /// graphs, lighter damping may hide one too once a step was rejected. Elsewhere it counts as light:
    /// a landmark on its way to infinity has no minimum without damping.
    fn may_hide(&self, damping: f64) -> bool {
        let is_heavy = damping > self.options.initial_damping;
        let had_rejections = || self.state.rows.iter().any(|row| !row.accepted);
        is_heavy || (self.options.initial_damping <= NEARLY_UNDAMPED && had_rejections())
    }

    /// By how much the model with next to no damping falls; infinite where that step cannot be computed.
    fn light_decrease(&mut self, system: &mut dyn System) -> f64 {
        if let Some(decrease) = self.light_decrease {
            return decrease;
        }
        let first = self.options.initial_damping;
        let lightest = if first <= NEARLY_UNDAMPED { DAMPING_RANGE.0 } else { first };
        let mut solve = |damping: f64| system.solve(damping).ok().filter(is_trusted);
        let step = solve(lightest).or_else(|| solve(first));
        // Once the interrupt is due the numbers mean nothing.
        let step = step.filter(|_| self.interrupted().is_none());
        let decrease = step.map_or(f64::INFINITY, |step| step.predicted_decrease);
        self.light_decrease = Some(decrease);
        decrease
    }

    /// Changes the damping after an accepted step: down to a third where the model predicted the cost
    /// well, up to twice where it did not (Nielsen 1999).
    fn accept(&mut self, quality: f64) {
        if self.options.method == Method::GaussNewton {
            return;
        }
        let cubic = 1.0 - (2.0 * quality - 1.0).powi(3);
        self.state.damping = (self.state.damping * cubic.max(1.0 / 3.0)).max(DAMPING_RANGE.0);
        self.state.damping_growth = 2.0;
    }

    /// Writes the row of a rejected step and raises the damping.
    fn reject(
        &mut self,
        iteration: usize,
        step: Option<(Step, f64)>,
        observer: &mut Observer<'_>,
    ) -> Option<Termination> {
        let stats = step.map(|(step, quality)| (step, quality, self.state.damping));
        if let Some(end) = self.record(iteration, false, stats, observer) {
            return Some(end);
        }
        let failure =
            if step.is_none() { Termination::NumericalFailure } else { Termination::Stalled };
        self.state.damping *= self.state.damping_growth;
        if self.options.method == Method::GaussNewton {
            // A singular matrix has no full step, but damped ones.
            if step.is_some() {
                return Some(failure);
            }
            self.state.damping = self.state.damping.max(self.options.initial_damping);
        }
        self.state.damping_growth *= 2.0;
        (self.state.damping > DAMPING_RANGE.1).then_some(failure)
    }

    /// Writes a row and shows it; says whether the observer or the clock ends the loop.
    fn record(
        &mut self,
        iteration: usize,
        accepted: bool,
        step: Option<(Step, f64, f64)>,
        observer: &mut Observer<'_>,
    ) -> Option<Termination> {
        let quality = step.map(|(_, quality, _)| quality);
        let row = IterationSummary {
            iteration,
            cost: self.state.cost,
            seconds: self.seconds_before + self.start.elapsed().as_secs_f64(),
            accepted,
            damping: step.map_or(0.0, |(_, _, damping)| damping),
            gradient_max_norm: self.gradient_max_norm,
            step_norm: step.map_or(0.0, |(step, _, _)| step.norm),
            // Not a number where the model predicts nothing, infinite where the cost of the step is.
            step_quality: quality.filter(|quality| quality.is_finite()).unwrap_or(0.0),
        };
        self.state.rows.push(row);
        if observer(&row) == Control::Cancel {
            return Some(Termination::Cancelled);
        }
        self.interrupted()
    }
}

impl From<Interruption> for Termination {
    fn from(interruption: Interruption) -> Self {
        match interruption {
            Interruption::Deadline => Self::Deadline,
            Interruption::Cancelled => Self::Cancelled,
        }
    }
}
