//! The generated code of `proto/covis/v1`: messages, clients and servers.
//!
//! Only the codec is written by hand. The rest is generated and kept in the repository;
//! `tests/integration/generated.rs` says how it is generated again.

#![allow(missing_docs, reason = "the comments stand in the proto files")]
#![allow(clippy::all, reason = "generated code")]
#![allow(clippy::allow_attributes_without_reason, reason = "generated code")]
#![allow(unreachable_pub, reason = "generated code")]

mod codec;

pub use codec::Codec;
#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub use codec::{check, densest};

/// Package `covis.v1`.
pub mod v1 {
    #![allow(clippy::large_enum_variant, reason = "generated code")]
    include!("generated/covis.v1.rs");

    /// The encoded `FileDescriptorSet` of the package, as reflection serves it.
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("generated/covis.v1.bin");
}
