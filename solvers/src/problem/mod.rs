//! What is to be solved: variables in structure-of-arrays form, factor batches, constants, gauge.
//!
//! A problem is plain data. [`BundleProblem`] holds poses, cameras and landmarks; [`PoseGraph`]
//! holds poses of one group and landmarks. `validate` names the first variable or factor that makes a problem
//! unsolvable as posed; how to solve it is in higher layers.
//!
//! | file | role |
//! |---|---|
//! | `bundle`, `pose_graph` | the problems |
//! | `landmarks`, `ranges` | points of a pose graph and what was measured of them; distances |
//! | `pose_factors`, `rigidity`, `disjoint_sets` | checks of them: factors of poses, poses that are determined, pieces |
//! | `error` | why a problem cannot be solved as posed |

mod bundle;
mod disjoint_sets;
mod error;
mod landmarks;
mod pose_factors;
mod pose_graph;
mod ranges;
mod rigidity;

pub use bundle::{BundleProblem, Observation};
pub use disjoint_sets::DisjointSets;
pub use error::SolveError;
pub use landmarks::Landmarks;
pub(crate) use landmarks::dimension_of_space;
pub use pose_graph::{Piece, PoseGraph};
pub(crate) use rigidity::are_spread;
