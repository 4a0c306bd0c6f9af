//! Block-sparse symmetric positive definite systems: pattern, values, ordering, Cholesky.
//!
//! Solves (H + D) x = g, where H is symmetric with blocks of any sizes and D is an added
//! diagonal (the damping of a trust-region loop). The symbolic part (ordering, fill, scatter
//! map, memory) is computed once for a [`BlockPattern`] and serves every factorization after it.
//!
//! - [`pattern`]: which blocks are stored; [`matrix`]: their values.
//! - [`ordering`]: elimination orders of the block graph and what they cost.
//! - [`sparse`]: the factorization by fronts; [`cholesky`]: the choice between many and one.
//! - [`pcg`]: conjugate gradients, for systems whose factor would be too large.
//!
//! This floor knows nothing of poses, factors or losses. The factorization uses the rayon pool that it is
//! called on; all give the same bits each time, on any number of threads.
//!
//! | file | role |
//! |---|---|
//! | `error`, `checked` | what can go wrong; checks of the matrix and of each solution |
//! | `ordering/graph`, `elimination` | the block graph, and elimination of it in a given order |
//! | `ordering/minimum_degree` | approximate minimum degree |
//! | `ordering/dissection`, `multilevel`, `refinement` | nested dissection and its separators |
//! | `sparse/supernodes`, `plan`, `shape`, `workspace` | structure and memory, computed once |
//! | `sparse/span` | how far more threads can help |
//! | `sparse/front`, `columns`, `kernels` | dense work in a front |
//! | `sparse/numeric`, `triangular` | the factorization; solves with the factor |
//! | `sparse/growing` | a factorization that grows and pays for what changed |

mod checked;
pub mod cholesky;
pub mod error;
pub mod matrix;
pub mod ordering;
pub mod pattern;
pub mod pcg;
pub mod sparse;
#[cfg(test)]
mod tests;

pub use cholesky::{Cholesky, Ordered, dense_price};
pub use error::LinearError;
pub use matrix::{BlockMatrix, BlockRowMut};
pub use ordering::{BlockOrdering, OrderingMethod};
pub use pattern::BlockPattern;
pub use pcg::{BlockJacobi, Pcg, Solved, StoppingRule};
pub use sparse::{GrowingCholesky, PairTerm, Updated};
