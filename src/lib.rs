//! covis: an optimization-centric SLAM backend service.
//!
//! Frontends stream keyframes over gRPC, covis keeps the map, refines it and pushes corrections
//! back.

pub mod wire;
