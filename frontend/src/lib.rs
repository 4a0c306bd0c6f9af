//! The reference frontend: semi-direct RGB-D tracking that ignores what moves.
//!
//! It shows how a frontend uses covis: it reaches the server through [`covis_client`] alone, like a
//! stranger. The modules, lowest first; a module uses only modules above it in this table. [`camera`]
//! and [`dense`] come from the crate `covis-dense`:
//!
//! | module | role |
//! |---|---|
//! | [`camera`] | the lens, and the ray of each pixel |
//! | [`dense`] | a surface from depth and poses |
//! | [`simd`] | loops compiled for wide vectors |
//! | [`image`] | images, and a frame with color and depth |
//! | [`pyramid`] | an image and its halvings |
//! | [`shutter`] | rows that are exposed one after the other |
//! | [`depth`] | noise of depth, depth at a pixel |
//! | [`input`] | where frames come from: recorded folders |
//! | [`synthetic`] | ray-cast sequences with known truth, as input |
//! | [`features`] | corners and their descriptors |
//! | [`local_map`] | keyframes and landmarks as the server last sent them |
//! | [`tracking`] | where the camera is |
//! | [`motion`] | what moves |
//! | [`pipeline`] | a frame through all stages |
//! | [`mapping`] | keyframes and questions to the server, corrections and answers back |

pub mod depth;
pub mod features;
pub mod image;
pub mod input;
pub mod local_map;
pub mod mapping;
pub mod motion;
pub mod pipeline;
pub mod pyramid;
pub mod shutter;
pub mod simd;
pub mod synthetic;
pub mod tracking;

pub use covis_dense as dense;
pub use covis_dense::camera;
