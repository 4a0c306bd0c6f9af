//! The generated code of `proto/covis/v1`: messages, clients and servers.
//!
//! Written by hand are the codec, and [`geometry`], which makes messages of the solver crate's types.
//! Only `service/`, `client`, `cli/` and the frontend's `mapping` may name these types.

#![allow(missing_docs, reason = "the comments stand in the proto files")]
#![allow(clippy::all, reason = "generated code")]
#![allow(clippy::allow_attributes_without_reason, reason = "generated code")]
#![allow(unreachable_pub, reason = "generated code")]

mod codec;
pub mod geometry;

pub use codec::Codec;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use codec::{check, densest};

/// Package `covis.v1`.
pub mod v1 {
    #![allow(clippy::large_enum_variant, reason = "generated code")]
    tonic::include_proto!("covis.v1");

    /// The encoded `FileDescriptorSet` of the package, as reflection serves it.
    pub const FILE_DESCRIPTOR_SET: &[u8] =
        include_bytes!(concat!(env!("OUT_DIR"), "/covis.v1.bin"));
}
