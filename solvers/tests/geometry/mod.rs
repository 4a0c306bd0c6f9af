//! Groups and cameras against their laws, independent oracles and central differences.

mod cameras;
mod groups;
mod rotations;
