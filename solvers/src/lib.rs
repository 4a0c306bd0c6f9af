//! Sparse nonlinear least squares for SLAM: bundle adjustment, pose graphs, pose refinement.
//!
//! Every problem minimizes ½ Σ ρ(rᵀΩr) over poses, camera parameters and landmarks. Modules are in
//! layers, lowest first; a file uses only the layers below it:
//!
//! | floor | modules |
//! |---|---|
//! | 0 | [`simd`]: which instruction set kernels use, and eight lanes of f64 for each; `lists`, `order` and `parallel`: lists by group, sorting, loops on the thread pool; [`interrupt`]: when work must end early |
//! | 1 | [`geometry`]: groups with their Jacobians, camera models; [`price`]: memory and work of a solve, known before it starts |
//! | 2 | [`information`]: how certain a measurement is; [`loss`]: less weight for outliers |
//! | 3 | [`factors`]: residuals with their Jacobians; `lanes`: camera models and losses, eight observations at a time |
//! | 4 | [`problem`]: variables, factor batches, gauge, validation |
//! | 5 | [`linear`]: block-sparse matrices, orderings, Cholesky |
//! | 6 | [`optimizer`]: the trust-region loop |
//! | 7 | [`initialization`]: triangulation, P3P, start values of pose graphs |
//! | 8 | [`bundle_adjustment`]: poses, cameras and landmarks; [`pose_graph`]: poses; [`pose_refinement`]: one pose, landmarks fixed; [`relative_motion`]: the pose between two keyframes |
//! | 9 | [`robust`]: pose graphs with false loop closures; [`certificate`]: a proven global optimum; [`marginalization`]: a keyframe removed, its knowledge kept |
//! | 10 | [`evaluation`]: every cost again, independent of the fast paths; [`point_matching`]: points of two places that are one |
//! | 11 | [`graph_optimization`]: a pose graph from its start to its result, closures judged and proved; [`geometric_verification`]: whether two keyframes show one place |
//! | 12 | [`reconstruction`]: poses and points from observations alone; [`similarity`]: two clouds of points at different scales |
//! | 13 | [`io`]: files of BAL, Bundler, COLMAP, g2o and PyFactorGraph, trajectories, PLY |
//! | 14 | `testing`, a feature: numeric Jacobians, group laws, a synthetic room |
//!
//! The crate is synchronous and knows nothing of servers, maps or the wire.
//! Conventions (frames, tangent order, units) are those of `docs/conventions.md`.

pub mod bundle_adjustment;
pub mod certificate;
pub mod evaluation;
pub mod factors;
pub mod geometric_verification;
pub mod geometry;
pub mod graph_optimization;
pub mod information;
pub mod initialization;
pub mod interrupt;
pub mod io;
mod lanes;
pub mod linear;
mod lists;
pub mod loss;
pub mod marginalization;
pub mod optimizer;
mod order;
mod parallel;
pub mod point_matching;
pub mod pose_graph;
pub mod pose_refinement;
pub mod price;
pub mod problem;
pub mod reconstruction;
pub mod relative_motion;
pub mod robust;
pub mod simd;
pub mod similarity;
#[cfg(feature = "testing")]
pub mod testing;
