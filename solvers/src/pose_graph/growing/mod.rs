//! A pose graph that grows while it is solved: each update pays for what is new, not for the graph.
//!
//! A minimum of ½ Σ rᵀΩr is kept after every update, as [`super::solve`] would find it from the
//! estimate so far: Gauss-Newton on a [`GrowingCholesky`]. It need not be the lowest minimum. Each pose
//! is linearized where it last stood, and again only once its rotation has turned so far that the
//! linear prediction of a residual may be wrong by a share of its standard deviation (after Kaess et
//! al., "iSAM2", 2012). A pose that one edge ties to the others hangs there and costs nothing until a
//! second edge comes. `states`: which poses are in the linear system; `linearized`: its terms, where
//! they are made and when they are made anew; `batch`: the batch solver, where the steps do not settle
//! or go far. It knows no files, and large eliminations use the rayon pool of the caller.

mod batch;
mod linearized;
mod states;

use std::collections::BTreeMap;

use nalgebra::{SVector, Vector3};

use crate::factors::{RelativePose, cost};
use crate::geometry::RigidMotion;
use crate::interrupt::Interrupt;
use crate::linear::GrowingCholesky;
use crate::loss::Loss;
use crate::problem::{PoseGraph, SolveError};

/// Gauss-Newton steps of an update before the damped batch solver takes over.
const MAX_STEPS: usize = 12;

/// An update that linearized more than so many times all poses anew has cost as much as a solve of the
/// whole graph, and went far enough to end at a minimum that is not the lowest: the batch solver is
/// called as well.
const LARGE_CHANGE: usize = 1;

/// How the factors tie a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PoseState {
    /// No edges tie it to the held pose yet.
    Waiting,
    /// The gauge.
    Held,
    /// Tied by one edge, whose residual is zero.
    Pendant(usize),
    /// A block of the linear system.
    Block(usize),
}

/// A pose graph with its optimum, kept while poses and edges are added.
#[derive(Debug)]
pub struct GrowingPoseGraph<G, const D: usize, const N: usize> {
    graph: PoseGraph<G, N>,
    index_of: BTreeMap<i64, usize>,
    states: Vec<PoseState>,
    edges_of: Vec<Vec<usize>>,
    /// Edges that came since the last update.
    fresh: Vec<usize>,
    /// Edges between poses that both wait, by edge.
    is_parked: Vec<bool>,
    /// Pendant poses; each after the pose that its edge ties it to.
    pendant: Vec<usize>,
    system: GrowingCholesky<N>,
    blocks: Vec<Block<G>>,
    /// By block.
    motions: Vec<Motion<D>>,
    /// δ of each block as its edges were last checked.
    checked: Vec<SVector<f64, N>>,
    terms: Vec<Term>,
    /// Counts the passes over terms.
    checks: u32,
}

/// A pose in the linear system.
#[derive(Clone, Copy, Debug)]
struct Block<G> {
    pose: usize,
    /// Where its terms were made.
    world_from_pose: G,
    checked_in: u32,
}

/// An edge in the linear system.
#[derive(Clone, Copy, Debug)]
struct Term {
    edge: usize,
    /// The blocks of its poses i and j; the held pose has none.
    ends: [Option<u32>; 2],
    /// √tr Ω of translation and rotation: what an error of the residual counts at most.
    stiffness: [f64; 2],
    /// Where it is linearized.
    error: EdgeError,
    checked_in: u32,
}

/// How far an edge is off.
#[derive(Clone, Copy, Debug)]
struct EdgeError {
    /// Between the measured and the estimated position of pose j.
    distance: f64,
    /// The angle of the residual.
    angle: f64,
}

/// A block's way from where its terms were made.
#[derive(Clone, Copy, Debug)]
struct Motion<const D: usize> {
    /// Where it is, in the world.
    position: SVector<f64, D>,
    /// How far it went, in the world.
    shift: SVector<f64, D>,
    /// The angle by which it turned.
    turn: f64,
    /// The same as a vector in the world.
    spin: Vector3<f64>,
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Growth {
    /// Gauss-Newton steps taken.
    pub steps: usize,
    /// Poses that were linearized anew, counted each time.
    pub relinearized: usize,
    /// Poses that were eliminated anew, counted each time.
    pub eliminated: usize,
    /// Whether the steps did not settle, or went far, and the batch solver was called.
    pub is_batch: bool,
}

impl<G: RigidMotion<D, N>, const D: usize, const N: usize> GrowingPoseGraph<G, D, N> {
    /// A graph of one pose, which is held fixed.
    #[must_use]
    pub fn new(id: i64, world_from_pose: G) -> Self {
        let mut graph = PoseGraph::new();
        graph.push_pose(id, world_from_pose);
        graph.constant[0] = true;
        Self {
            graph,
            index_of: BTreeMap::from([(id, 0)]),
            states: vec![PoseState::Held],
            edges_of: vec![Vec::new()],
            fresh: Vec::new(),
            is_parked: Vec::new(),
            pendant: Vec::new(),
            system: GrowingCholesky::new(),
            blocks: Vec::new(),
            motions: Vec::new(),
            checked: Vec::new(),
            terms: Vec::new(),
            checks: 0,
        }
    }

    /// Appends a pose and returns its index. Where it stands follows from its edges; until some tie
    /// it to the held pose it is the identity and not part of the cost.
    ///
    /// # Errors
    /// [`SolveError::DuplicateId`].
    pub fn push_pose(&mut self, id: i64) -> Result<usize, SolveError> {
        if self.index_of.insert(id, self.states.len()).is_some() {
            return Err(SolveError::DuplicateId { what: "pose", id });
        }
        self.states.push(PoseState::Waiting);
        self.edges_of.push(Vec::new());
        Ok(self.graph.push_pose(id, G::identity()))
    }

    /// Appends an edge between two poses that are there. A loss of its own does not count: the cost is
    /// quadratic.
    ///
    /// # Errors
    /// [`SolveError::IndexOutOfRange`], [`SolveError::NotFinite`].
    pub fn push_edge(&mut self, edge: RelativePose<G, N>) -> Result<(), SolveError> {
        let (index, count) = (self.graph.edges.len(), self.states.len());
        for value in [edge.i, edge.j] {
            if value >= count {
                let (factor, variable) = ("edge", "pose");
                return Err(SolveError::IndexOutOfRange { factor, index, variable, value, count });
            }
        }
        if !edge.i_from_j.is_finite() {
            return Err(SolveError::NotFinite { what: "edge", index: index as i64 });
        }
        self.edges_of[edge.i].push(index);
        if edge.i != edge.j {
            self.edges_of[edge.j].push(index);
            self.fresh.push(index);
        }
        self.graph.edges.push(RelativePose { loss: None, ..edge });
        self.is_parked.push(false);
        Ok(())
    }

    /// The poses at their optimum as of the last update, with all edges.
    #[must_use]
    pub fn graph(&self) -> &PoseGraph<G, N> {
        &self.graph
    }

    /// The graph, with the estimate.
    #[must_use]
    pub fn into_graph(self) -> PoseGraph<G, N> {
        self.graph
    }

    /// The index of a pose.
    #[must_use]
    pub fn index_of(&self, id: i64) -> Option<usize> {
        self.index_of.get(&id).copied()
    }

    /// Whether edges tie the pose to the held one.
    #[must_use]
    pub fn is_placed(&self, pose: usize) -> bool {
        self.states.get(pose).is_some_and(|&state| state != PoseState::Waiting)
    }

    /// ½ Σ rᵀΩr over the edges between placed poses, at the estimate.
    #[must_use]
    pub fn cost(&self) -> f64 {
        if !self.states.contains(&PoseState::Waiting) {
            return cost(&self.graph.edges, &self.graph.poses, Loss::Trivial, &Interrupt::NEVER);
        }
        let placed = |edge: &&RelativePose<G, N>| self.is_placed(edge.i);
        let edges: Vec<_> = self.graph.edges.iter().filter(placed).copied().collect();
        cost(&edges, &self.graph.poses, Loss::Trivial, &Interrupt::NEVER)
    }

    /// Takes in what was added since the last update and moves the estimate to the new minimum.
    ///
    /// # Errors
    /// Those of [`super::solve`], where the steps do not settle and it is called.
    pub fn update(&mut self) -> Result<Growth, SolveError> {
        let last = self.place();
        let mut growth = Growth::default();
        if last.is_empty() {
            return Ok(growth);
        }
        let mut is_settled = false;
        while !is_settled && growth.steps < MAX_STEPS {
            growth.steps += 1;
            let Ok(updated) = self.system.update(&last) else { break };
            growth.eliminated += updated.blocks;
            let (mut moved, limit) = self.step(&updated);
            is_settled = moved.is_empty();
            self.relinearize(&mut moved, limit);
            growth.relinearized += moved.len();
        }
        let is_large = growth.relinearized > LARGE_CHANGE * self.blocks.len();
        if !is_settled || is_large {
            growth.is_batch = true;
            self.solve_batch(is_settled)?;
        }
        self.carry_pendant();
        Ok(growth)
    }
}
