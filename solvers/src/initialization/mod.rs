//! Start values where a problem comes without them.

mod spanning_tree;
mod triangulation;

pub use spanning_tree::spanning_tree;
pub use triangulation::{
    Triangulated, TriangulationError, TriangulationOptions, View, triangulate,
};
