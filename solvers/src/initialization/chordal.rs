//! Start values of a pose graph from its relaxed rotations.
//!
//! Rotations as free matrices make the chordal cost Σ κ ‖R_j − R_i Z‖² linear: each row of every R
//! is a least-squares problem with the same matrix (Martinec and Pajdla 2007; Carlone et al.,
//! "Initialization techniques for 3D SLAM", 2015). The solution is projected onto the rotations;
//! with these held, translations and sighted landmarks are linear least squares with the information of
//! the measurements. Without landmarks both systems have one block a pose on one pattern, so that one plan
//! serves two factorizations; with landmarks, `relaxation` makes the rotations. It must not look at the
//! start values of what may move.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::relaxation::{relaxed_rotations, sighted};
use crate::factors::RelativePose;
use crate::geometry::RigidMotion;
use crate::information::Information;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError};
use crate::optimizer::from_linear;
use crate::parallel;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};

/// Edges that a task looks at at least.
const MIN_EDGES: usize = 256;

/// The isotropic precisions that are fitted to a factor's information matrix.
///
/// As SE-Sync fits them (Rosen et al. 2019): in space τ = 3/tr Ω_t⁻¹ and κ = 3/(2 tr Ω_R⁻¹); in the
/// plane τ = 2/tr Ω_t⁻¹ and κ = Ω_θθ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsotropicPrecision {
    /// τ, of the translation, 1/m².
    pub translation: f64,
    /// κ, of the rotation, concentration of a Langevin distribution.
    pub rotation: f64,
}

impl IsotropicPrecision {
    /// Fits to an information matrix over a tangent of D translations, then rotations.
    #[must_use]
    pub fn of<const D: usize, const N: usize>(information: &Information<N>) -> Self {
        let omega = information.matrix();
        let inverse_trace = |first: usize| {
            inverse_trace(&SMatrix::<f64, D, D>::from_fn(|r, c| omega[(first + r, first + c)]))
        };
        let translation = D as f64 / inverse_trace(0);
        let rotation = match N - D {
            1 => omega[(D, D)],
            // In space there are as many angles as directions.
            _ => D as f64 / (2.0 * inverse_trace(D)),
        };
        Self { translation, rotation }
    }
}

/// tr Ω⁻¹; infinite for a block without information in some direction: its inverse has no bound.
pub(super) fn inverse_trace<const D: usize>(omega: &SMatrix<f64, D, D>) -> f64 {
    let minor = |i: usize, j: usize| omega[(i, i)] * omega[(j, j)] - omega[(i, j)] * omega[(j, i)];
    // The sum of the principal minors of one order less, over the determinant.
    let (sum, determinant, is_definite) = match D {
        2 => (omega.trace(), minor(0, 1), omega[(0, 0)] > 0.0),
        3 => {
            let cofactor = |c: usize| {
                let (a, b) = ((c + 1) % 3, (c + 2) % 3);
                omega[(1, a)] * omega[(2, b)] - omega[(1, b)] * omega[(2, a)]
            };
            let determinant: f64 = (0..3).map(|c| omega[(0, c)] * cofactor(c)).sum();
            let is_definite = omega[(0, 0)] > 0.0 && minor(0, 1) > 0.0;
            (minor(0, 1) + minor(1, 2) + minor(0, 2), determinant, is_definite)
        }
        _ => return omega.cholesky().map_or(f64::INFINITY, |factor| factor.inverse().trace()),
    };
    if is_definite && determinant > 0.0 { sum / determinant } else { f64::INFINITY }
}

/// Replaces every pose that is not constant by its chordal start.
///
/// Constant poses hold the gauge; without one, the pose with the lowest id, which stays where it
/// is. The result depends on the factors and the gauge only. `graph` is untouched after an error.
///
/// # Errors
/// Those of [`PoseGraph::validate`], [`SolveError::Singular`] where measurements leave a rotation
/// or a position open to rounding; [`SolveError::TooExpensive`], [`SolveError::Interrupted`].
pub fn chordal<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    limits: Limits<'_>,
) -> Result<(), SolveError> {
    graph.validate()?;
    let rows = Rows::of::<G, D, N>(graph);
    if rows.poses.is_empty() {
        return Ok(());
    }
    let pattern = Arc::new(BlockPattern::new(vec![D; rows.len()], rows.pairs(graph)));
    let linear = linear_bytes(graph, &pattern);
    let limits = limits.less(linear);
    let (mut system, rotations) = if rows.has_sightings {
        let rotations = relaxed_rotations(graph, &rows, limits);
        let rotations = rotations.map_err(|error| error.beside(linear))?;
        (Linear::new(pattern, limits).map_err(|error| error.beside(linear))?, rotations)
    } else {
        let system = Linear::new(pattern, limits);
        let mut system = system.map_err(|error| error.beside(linear))?;
        let rotations = rotations_of_edges(graph, &rows, &mut system)?;
        (system, rotations)
    };
    let mut poses = graph.poses.clone();
    for (&pose, matrix) in rows.poses.iter().zip(&rotations) {
        let unknown = || SolveError::Singular { what: "rotation of pose", id: graph.ids[pose] };
        poses[pose] = G::from_matrix(matrix, &SVector::zeros()).ok_or_else(unknown)?;
    }
    let translations = translations(graph, &rows, &poses, &mut system)?;
    for (&pose, t) in rows.poses.iter().zip(&translations) {
        let unknown = || SolveError::Singular { what: "position of pose", id: graph.ids[pose] };
        let rotation = poses[pose].rotation_matrix();
        poses[pose] = G::from_matrix(&rotation, t).ok_or_else(unknown)?;
    }
    graph.poses = poses;
    Ok(())
}

/// Bytes besides the factor: matrix, right-hand sides, poses, a factor an edge.
fn linear_bytes<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
    pattern: &BlockPattern,
) -> u64 {
    let poses = graph.poses.len() * (2 * size_of::<G>() + 8 * (3 * D * D + 2 * D) + 32);
    let landmarks = graph.landmarks.len() * (16 * D + 32);
    let edges = graph.edges.len() * (8 * (D * D + D) + 16);
    (poses + landmarks + edges) as u64 + 8 * pattern.value_count() as u64 + pattern.bytes()
}

/// What moves, and its block rows: poses, then landmarks.
pub(super) struct Rows {
    /// Poses in row order.
    pub(super) poses: Vec<usize>,
    /// Block row of each pose, `None` where it is held.
    pub(super) of: Vec<Option<usize>>,
    /// Landmarks in row order, after the poses.
    landmarks: Vec<usize>,
    /// Block row of each landmark, `None` where it is held or its position was not measured.
    pub(super) of_landmark: Vec<Option<usize>>,
    /// Whether the position of a landmark was measured.
    has_sightings: bool,
}

impl Rows {
    fn of<G: RigidMotion<D, N>, const D: usize, const N: usize>(graph: &PoseGraph<G, N>) -> Self {
        let (poses, of) = graph.free_poses();
        let mut is_sighted = vec![false; graph.landmarks.len()];
        let measurements = graph.landmarks.measurements.iter();
        let sighted = measurements.filter(|measurement| sighted::<D>(measurement).is_some());
        sighted.for_each(|measurement| is_sighted[measurement.landmark] = true);
        let is_free =
            |&landmark: &usize| is_sighted[landmark] && !graph.landmarks.constant[landmark];
        let landmarks: Vec<usize> = (0..is_sighted.len()).filter(is_free).collect();
        let mut of_landmark = vec![None; is_sighted.len()];
        for (row, &landmark) in (poses.len()..).zip(&landmarks) {
            of_landmark[landmark] = Some(row);
        }
        let has_sightings = is_sighted.contains(&true);
        Self { poses, of, landmarks, of_landmark, has_sightings }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.poses.len() + self.landmarks.len()
    }

    /// The rows that a factor ties together.
    pub(super) fn pairs<'a, G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &'a self,
        graph: &'a PoseGraph<G, N>,
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        let edges = graph.free_indices_of_edges(&self.of).filter_map(|(i, j)| i.zip(j));
        let sightings = graph.landmarks.measurements.iter().filter_map(|measurement| {
            self.of[measurement.pose?].zip(self.of_landmark[measurement.landmark])
        });
        edges.chain(sightings)
    }

    /// The error for a block row that measurements leave open; `what` is open of a pose.
    fn open<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &PoseGraph<G, N>,
        what: &'static str,
        block: usize,
    ) -> SolveError {
        match self.poses.get(block) {
            Some(&pose) => SolveError::Singular { what, id: graph.ids[pose] },
            None => {
                let landmark = self.landmarks[block - self.poses.len()];
                SolveError::Singular { what: "landmark", id: graph.landmarks.ids[landmark] }
            }
        }
    }
}

/// A block-sparse system with a block for each row of [`Rows`].
pub(super) struct Linear<'a> {
    pub(super) matrix: BlockMatrix,
    factor: Cholesky,
    interrupt: &'a Interrupt,
}

impl<'a> Linear<'a> {
    pub(super) fn new(pattern: Arc<BlockPattern>, limits: Limits<'a>) -> Result<Self, SolveError> {
        let dimension = pattern.dimension();
        let Limits { ceiling, interrupt } = limits;
        let factor = Cholesky::within(Arc::clone(&pattern), ceiling, interrupt)
            .map_err(|error| from_linear(error, dimension))?;
        Ok(Self { matrix: BlockMatrix::new(pattern), factor, interrupt })
    }

    /// How many scalar rows it has.
    pub(super) fn dimension(&self) -> usize {
        self.matrix.pattern().dimension()
    }

    pub(super) fn factor<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
        rows: &Rows,
        what: &'static str,
    ) -> Result<(), SolveError> {
        // The matrix is on the pattern planned for, so that only its values can be at fault.
        let factored = self.factor.factor_until(&self.matrix, &[], self.interrupt);
        factored.map_err(|error| match error {
            LinearError::NotPositiveDefinite { block, .. } | LinearError::NonFinite { block } => {
                rows.open(graph, what, block)
            }
            LinearError::DimensionMismatch { .. }
            | LinearError::PatternMismatch { .. }
            | LinearError::TooExpensive(_)
            | LinearError::Interrupted
            | LinearError::TooLarge { .. }
            | LinearError::OutOfMemory { .. } => from_linear(error, self.dimension()),
        })
    }

    /// Solves in place with the last factor.
    pub(super) fn solve(&mut self, right: &mut [f64]) -> Result<(), SolveError> {
        self.factor.solve(right);
        match self.interrupt.is_due() {
            // What is there may be a part of a solution.
            true => Err(SolveError::Interrupted),
            false => Ok(()),
        }
    }
}

/// Matrices near the rotations of the poses that move, in row order.
fn rotations_of_edges<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
    system: &mut Linear<'_>,
) -> Result<Vec<SMatrix<f64, D, D>>, SolveError> {
    system.matrix.set_zero();
    // Row r of each rotation, transposed, is unknown x: the factor is √κ (x_j − Zᵀ x_i).
    let mut right = vec![vec![0.0; D * rows.poses.len()]; D];
    let mut add = |row: usize, fixed: &SMatrix<f64, D, D>, z: &SMatrix<f64, D, D>, kappa: f64| {
        // x_row is drawn to z times the row of the rotation that is held.
        for (r, right) in right.iter_mut().enumerate() {
            let pull = z * fixed.row(r).transpose() * kappa;
            for (value, pull) in right[D * row..].iter_mut().zip(pull.iter()) {
                *value += pull;
            }
        }
    };
    let factor = |edge: &RelativePose<G, N>| {
        let kappa = IsotropicPrecision::of::<D, N>(&edge.information).rotation;
        (kappa, edge.i_from_j.rotation_matrix())
    };
    let factors = parallel::map_in_runs(&graph.edges, MIN_EDGES, (0.0, SMatrix::zeros()), factor);
    for (edge, &(kappa, z)) in graph.edges.iter().zip(&factors) {
        if edge.i == edge.j {
            continue;
        }
        let (i, j) = (rows.of[edge.i], rows.of[edge.j]);
        for row in [i, j].into_iter().flatten() {
            system.matrix.add_block(row, row, &(SMatrix::<f64, D, D>::identity() * kappa));
        }
        match (i, j) {
            (Some(i), Some(j)) => system.matrix.add_block(i, j, &(z * -kappa)),
            (Some(i), None) => add(i, &graph.poses[edge.j].rotation_matrix(), &z, kappa),
            (None, Some(j)) => {
                add(j, &graph.poses[edge.i].rotation_matrix(), &z.transpose(), kappa);
            }
            (None, None) => {}
        }
    }
    system.factor(graph, rows, "rotation of pose")?;
    right.iter_mut().try_for_each(|right| system.solve(right))?;
    let matrix = |row: usize| SMatrix::from_fn(|r, c| right[r][D * row + c]);
    Ok((0..rows.poses.len()).map(matrix).collect())
}

/// Positions of the poses that move, in row order, given the rotations of `poses`.
fn translations<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
    poses: &[G],
    system: &mut Linear<'_>,
) -> Result<Vec<SVector<f64, D>>, SolveError> {
    system.matrix.set_zero();
    let mut right = vec![0.0; D * rows.len()];
    let add = |system: &mut Linear<'_>,
               right: &mut [f64],
               ends: [Option<usize>; 2],
               weight: &SMatrix<f64, D, D>,
               pull: &SVector<f64, D>| {
        for (row, sign) in ends.into_iter().zip([-1.0, 1.0]) {
            let Some(row) = row else { continue };
            system.matrix.add_block(row, row, weight);
            for (value, pull) in right[D * row..].iter_mut().zip(pull.iter()) {
                *value += sign * pull;
            }
        }
        if let [Some(i), Some(j)] = ends {
            system.matrix.add_block(i, j, &-weight);
        }
    };
    let factor = |edge: &RelativePose<G, N>| {
        let rotation = poses[edge.i].rotation_matrix();
        let omega = edge.information.matrix();
        let omega = SMatrix::<f64, D, D>::from_fn(|r, c| omega[(r, c)]);
        // t_j − t_i should be R_i t_Z.
        (rotation * omega * rotation.transpose(), rotation * edge.i_from_j.translation())
    };
    let blank = (SMatrix::zeros(), SVector::zeros());
    let factors = parallel::map_in_runs(&graph.edges, MIN_EDGES, blank, factor);
    for (edge, &(weight, measured)) in graph.edges.iter().zip(&factors) {
        if edge.i == edge.j {
            continue;
        }
        let (i, j) = (rows.of[edge.i], rows.of[edge.j]);
        let held = |pose: usize, row: Option<usize>| match row {
            None => graph.poses[pose].translation(),
            Some(_) => SVector::zeros(),
        };
        let pull = weight * (measured + held(edge.i, i) - held(edge.j, j));
        add(system, &mut right, [i, j], &weight, &pull);
    }
    for measurement in &graph.landmarks.measurements {
        let Some((_, z)) = sighted::<D>(measurement) else { continue };
        let rotation = measurement.pose.map(|pose| poses[pose].rotation_matrix());
        let rotation = rotation.unwrap_or_else(SMatrix::identity);
        let omega = measurement.information.matrix();
        let omega = SMatrix::<f64, D, D>::from_fn(|r, c| omega[(r, c)]);
        let weight = rotation * omega * rotation.transpose();
        let (i, landmark) = (measurement.pose, measurement.landmark);
        let (from, to) = (i.and_then(|pose| rows.of[pose]), rows.of_landmark[landmark]);
        let held_pose = i.filter(|_| from.is_none()).map(|pose| graph.poses[pose].translation());
        let position = &graph.landmarks.positions[landmark];
        let held_landmark = match to {
            Some(_) => SVector::zeros(),
            None => SVector::<f64, D>::from_fn(|axis, _| position[axis]),
        };
        // l − t_i should be R_i z.
        let pull =
            weight * (rotation * z + held_pose.unwrap_or_else(SVector::zeros) - held_landmark);
        add(system, &mut right, [from, to], &weight, &pull);
    }
    system.factor(graph, rows, "position of pose")?;
    system.solve(&mut right)?;
    let poses = right.chunks_exact(D).take(rows.poses.len());
    Ok(poses.map(SVector::from_column_slice).collect())
}
