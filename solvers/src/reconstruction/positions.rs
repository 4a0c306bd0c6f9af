//! Global positioning: centers of cameras and points together, from rays whose rotations are known.
//!
//! Minimizes Σ ρ(‖v − d (X − c)‖) over points X, centers c and one scale d > 0 for each ray v in the world
//! (Pan, Baráth, Pollefeys and Schönberger, "Global structure-from-motion revisited", 2024). With free
//! scales the residual is the sine of the angle between ray and point (Zhuang, Cheong and Lee, "Baseline
//! desensitizing in translation averaging", 2018), the cost is bilinear, and a random start leads to the
//! optimum; no relative translation is needed, which would have neither length nor, of two keyframes in a
//! line, a use. Where the distance is measured, d is one over it: then the cost is quadratic, and metric.
//!
//! Levenberg-Marquardt: scales are eliminated ray by ray, points one by one (or centers, where there are
//! fewer points), the rest is a block-sparse system. Each ray is a spring between its point and its center
//! with the stiffness d² (I − u uᵀ / uᵀu (1 + λ)), u = X − c.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::bearings::Bearings;
use super::planned;
use crate::geometric_verification::Numbers;
use crate::geometry::So3;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, Cholesky};
use crate::price::Limits;
use crate::problem::SolveError;

/// Width of Huber's loss on the residual, as in the paper: a sine of about 6 degrees.
const WIDTH: f64 = 0.1;
/// The scale of a ray stays above this.
const LEAST_SCALE: f64 = 1e-5;
/// A measured distance counts where its standard deviation is below this share of it.
const KNOWN: f64 = 0.2;
pub(super) const MAX_ITERATIONS: usize = 200;
/// The iteration ends when each of three steps lowers the cost by less than this share of it.
const TOLERANCE: f64 = 5e-3;

/// A ray between a variable that is eliminated and one that is kept. Where points are eliminated it goes
/// from the center to the point; where centers are, both are swapped and the ray is turned round, which
/// is the same residual.
struct Spring {
    eliminated: usize,
    kept: usize,
    /// In the world.
    ray: Vector3<f64>,
    scale: f64,
    is_known: bool,
}

/// Centers by pose and points by landmark.
#[derive(Clone, Debug)]
pub(super) struct Positions {
    pub(super) centers: Vec<Option<Vector3<f64>>>,
    pub(super) points: Vec<Option<Vector3<f64>>>,
}

/// Positions of the poses with a rotation, and of the landmarks that at least two of `used` bearings of
/// theirs see. `None` where there are none, the interrupt is due, or `row`, which is told of iterations,
/// says no.
///
/// # Errors
/// [`SolveError::TooExpensive`], [`SolveError::TooLarge`].
pub(super) fn global_positions(
    bearings: &Bearings,
    rotations: &[Option<So3>],
    used: &[bool],
    seed: u64,
    limits: Limits<'_>,
    row: &mut dyn FnMut(usize, f64) -> bool,
) -> Result<Option<Positions>, SolveError> {
    let Some(mut system) = System::new(bearings, rotations, used, seed, limits)? else {
        return Ok(None);
    };
    let mut cost = system.cost(&system.state);
    let mut damping = 1e-3;
    if !row(0, cost) {
        return Ok(None);
    }
    let mut iteration = 0;
    let mut small = 0;
    while iteration < MAX_ITERATIONS && small < 3 {
        iteration += 1;
        let trial = system.step(damping, limits.interrupt);
        if limits.interrupt.is_due() {
            return Ok(None);
        }
        let next = trial.as_ref().map_or(f64::INFINITY, |trial| system.cost(trial));
        match trial {
            Some(trial) if next < cost => {
                small = if cost - next < TOLERANCE * cost { small + 1 } else { 0 };
                (system.state, cost) = (trial, next);
                damping = (damping * 0.3).max(1e-9);
            }
            Some(_) | None => {
                damping *= 4.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
        if !row(iteration, cost) {
            return Ok(None);
        }
    }
    Ok(Some(system.positions(rotations.len(), bearings.of_landmark.len())))
}

/// The variables.
#[derive(Clone)]
struct State {
    eliminated: Vec<Vector3<f64>>,
    kept: Vec<Vector3<f64>>,
    scales: Vec<f64>,
}

struct System {
    /// Pose of each center, landmark of each point.
    poses: Vec<usize>,
    landmarks: Vec<usize>,
    /// Whether centers are eliminated, of which there are more than points then.
    is_swapped: bool,
    /// By rising eliminated variable.
    springs: Vec<Spring>,
    /// First spring of each eliminated variable, and their number at the end.
    starts: Vec<usize>,
    state: State,
    matrix: BlockMatrix,
    factor: Cholesky,
}

impl System {
    fn new(
        bearings: &Bearings,
        rotations: &[Option<So3>],
        used: &[bool],
        seed: u64,
        limits: Limits<'_>,
    ) -> Result<Option<Self>, SolveError> {
        let poses: Vec<usize> =
            (0..rotations.len()).filter(|&pose| rotations[pose].is_some()).collect();
        let (mut springs, landmarks) = springs(bearings, rotations, &poses, used);
        if springs.is_empty() || poses.len() < 2 {
            return Ok(None);
        }
        let is_swapped = landmarks.len() < poses.len();
        if is_swapped {
            for spring in &mut springs {
                std::mem::swap(&mut spring.eliminated, &mut spring.kept);
                spring.ray = -spring.ray;
            }
            springs.sort_by_key(|spring| spring.eliminated);
        }
        let (eliminated, kept) = match is_swapped {
            false => (landmarks.len(), poses.len()),
            true => (poses.len(), landmarks.len()),
        };
        let starts: Vec<usize> = (0..=eliminated)
            .map(|index| springs.partition_point(|spring| spring.eliminated < index))
            .collect();
        let mut known: Vec<f64> =
            springs.iter().filter(|s| s.is_known).map(|s| 1.0 / s.scale).collect();
        let extent = if known.is_empty() { 1.0 } else { super::median(&mut known) };
        let mut numbers = Numbers::new(seed);
        let mut random = || Vector3::from_fn(|_, _| extent * (2.0 * numbers.share() - 1.0));
        let state = State {
            eliminated: (0..eliminated).map(|_| random()).collect(),
            kept: (0..kept).map(|_| random()).collect(),
            scales: springs
                .iter()
                .map(|s| if s.is_known { s.scale } else { 1.0 / extent })
                .collect(),
        };
        let pairs = starts.windows(2).flat_map(|ends| {
            let own = &springs[ends[0]..ends[1]];
            own.iter()
                .enumerate()
                .flat_map(move |(k, s)| own[..k].iter().map(move |t| (s.kept, t.kept)))
        });
        let pattern = Arc::new(BlockPattern::new(vec![3; kept], pairs));
        let matrix = BlockMatrix::new(Arc::clone(&pattern));
        let Some(factor) = planned(&pattern, limits)? else { return Ok(None) };
        Ok(Some(Self { poses, landmarks, is_swapped, springs, starts, state, matrix, factor }))
    }

    fn cost(&self, state: &State) -> f64 {
        let huber = |norm: f64| {
            if norm <= WIDTH { 0.5 * norm * norm } else { WIDTH * (norm - 0.5 * WIDTH) }
        };
        let residual = |(spring, scale): (&Spring, &f64)| {
            let u = state.eliminated[spring.eliminated] - state.kept[spring.kept];
            huber((spring.ray - u * *scale).norm())
        };
        self.springs.iter().zip(&state.scales).map(residual).sum()
    }

    /// Stiffness and pull of a spring with its scale eliminated at a damping.
    fn pull(&self, index: usize, damping: f64) -> (Matrix3<f64>, Vector3<f64>) {
        let spring = &self.springs[index];
        let d = self.state.scales[index];
        let u = self.state.eliminated[spring.eliminated] - self.state.kept[spring.kept];
        let r = spring.ray - u * d;
        let weight = WIDTH / r.norm().max(WIDTH);
        let (mut stiffness, mut pull) = (Matrix3::identity(), r);
        if !spring.is_known {
            let of_scale = (1.0 + damping) * u.norm_squared();
            if of_scale > 0.0 {
                stiffness -= u * u.transpose() / of_scale;
                pull -= u * (u.dot(&r) / of_scale);
            }
        }
        // What lowers the cost: of the eliminated variable this, of the kept one its opposite.
        (stiffness * (weight * d * d), pull * (weight * d))
    }

    fn step(&mut self, damping: f64, interrupt: &Interrupt) -> Option<State> {
        self.matrix.set_zero();
        let mut right = vec![0.0; 3 * self.state.kept.len()];
        let mut solved = Vec::with_capacity(self.state.eliminated.len());
        let mut own = Vec::new();
        for ends in self.starts.windows(2) {
            own.clear();
            own.extend((ends[0]..ends[1]).map(|index| {
                let (stiffness, pull) = self.pull(index, damping);
                (self.springs[index].kept, stiffness, pull)
            }));
            let (mut sum, mut pull_of_all) = (Matrix3::zeros(), Vector3::zeros());
            for (_, stiffness, pull) in &own {
                sum += stiffness;
                pull_of_all += pull;
            }
            for k in 0..3 {
                sum[(k, k)] += damping * sum[(k, k)] + 1e-12;
            }
            let inverse = sum.cholesky()?.inverse();
            for (k, (kept, stiffness, pull)) in own.iter().enumerate() {
                // The two variables of a spring are coupled by minus its stiffness.
                let through = stiffness * inverse;
                let change = through * pull_of_all - pull;
                right[3 * kept..].iter_mut().zip(change.iter()).for_each(|(r, c)| *r += c);
                let own_block = stiffness - through * stiffness;
                self.matrix.add_block(*kept, *kept, &own_block);
                for (other, other_stiffness, _) in &own[..k] {
                    self.matrix.add_block(*kept, *other, &-(through * other_stiffness));
                }
            }
            solved.push((inverse, pull_of_all));
        }
        let added: Vec<f64> =
            self.matrix.diagonal().iter().map(|entry| damping * entry + 1e-9).collect();
        self.factor.factor_until(&self.matrix, &added, interrupt).ok()?;
        self.factor.solve(&mut right);
        let kept_steps: Vec<Vector3<f64>> =
            right.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let mut trial = self.state.clone();
        trial.kept.iter_mut().zip(&kept_steps).for_each(|(kept, step)| *kept += step);
        for (index, (inverse, pull)) in solved.iter().enumerate() {
            let own = self.starts[index]..self.starts[index + 1];
            let pull = own.clone().fold(*pull, |pull, spring| {
                pull + self.pull(spring, damping).0 * kept_steps[self.springs[spring].kept]
            });
            let step = inverse * pull;
            trial.eliminated[index] += step;
            for k in own {
                let spring = &self.springs[k];
                let d = self.state.scales[k];
                let u = self.state.eliminated[index] - self.state.kept[spring.kept];
                let of_scale = (1.0 + damping) * u.norm_squared();
                if !spring.is_known && of_scale > 0.0 {
                    let moved = step - kept_steps[spring.kept];
                    let r = spring.ray - u * d;
                    let scale = d + (u.dot(&r) - d * u.dot(&moved)) / of_scale;
                    trial.scales[k] = scale.max(LEAST_SCALE);
                }
            }
        }
        let mut all = trial.eliminated.iter().chain(&trial.kept);
        all.all(|p| p.iter().all(|v| v.is_finite())).then_some(trial)
    }

    fn positions(self, poses: usize, landmarks: usize) -> Positions {
        let mut positions = Positions { centers: vec![None; poses], points: vec![None; landmarks] };
        let State { eliminated, kept, .. } = self.state;
        let (centers, points) =
            if self.is_swapped { (eliminated, kept) } else { (kept, eliminated) };
        for (&pose, center) in self.poses.iter().zip(centers) {
            positions.centers[pose] = Some(center);
        }
        for (&landmark, point) in self.landmarks.iter().zip(points) {
            positions.points[landmark] = Some(point);
        }
        positions
    }
}

/// The springs from points (eliminated) to centers (kept), and the landmark of each point.
fn springs(
    bearings: &Bearings,
    rotations: &[Option<So3>],
    poses: &[usize],
    used: &[bool],
) -> (Vec<Spring>, Vec<usize>) {
    let (mut springs, mut landmarks) = (Vec::new(), Vec::new());
    for (landmark, list) in bearings.of_landmark.iter().enumerate() {
        let first = springs.len();
        for &index in list.iter().filter(|&&index| used[index as usize]) {
            let bearing = bearings.get(index);
            let (Ok(center), Some(rotation)) =
                (poses.binary_search(&bearing.pose), &rotations[bearing.pose])
            else {
                continue;
            };
            let distance = bearing.point_in_camera().filter(|(_, d, sigma)| *sigma < KNOWN * d);
            springs.push(Spring {
                eliminated: landmarks.len(),
                kept: center,
                ray: rotation.rotate(&bearing.ray),
                scale: distance.map_or(1.0, |(_, distance, _)| 1.0 / distance),
                is_known: distance.is_some(),
            });
        }
        if springs.len() < first + 2 {
            springs.truncate(first);
        } else {
            landmarks.push(landmark);
        }
    }
    (springs, landmarks)
}
