//! Start values where a problem comes without them.
//!
//! Triangulation, P3P, and starts of pose graphs; bringing a start to the optimum is done on higher
//! floors.
//!
//! | file | role |
//! |---|---|
//! | `triangulation` | points from views |
//! | `p3p` | a pose from three points |
//! | `spanning_tree`, `chordal` | starts of pose graphs |
//! | `relaxation` | rotations of graphs with landmarks, for `chordal` |
//! | `start`, `alignment` | the choice between them; a whole piece brought to its priors |

mod alignment;
mod chordal;
mod p3p;
mod relaxation;
mod spanning_tree;
mod start;
mod triangulation;

pub use alignment::align_to_priors;
pub use chordal::{IsotropicPrecision, chordal};
pub use p3p::p3p;
pub use spanning_tree::{odometry, spanning_tree};
pub(crate) use start::initialize_in_time;
pub use start::{Start, initialize};
pub use triangulation::{
    LeastWorstError, Triangulated, TriangulationError, TriangulationOptions, View,
    least_worst_error, triangulate,
};
