//! Start values where a problem comes without them.

mod spanning_tree;
mod triangulation;

pub use spanning_tree::spanning_tree;
pub use triangulation::{
    LeastWorstError, Triangulated, TriangulationError, TriangulationOptions, View,
    least_worst_error, triangulate,
};
