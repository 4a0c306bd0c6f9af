//! Messages of recordings: the part of Foxglove's schemas that is written, and figures of covis' own.
//! Generated from `proto/`; `tests/integration/generated.rs` says how it is generated again.

#![allow(missing_docs, reason = "the comments stand in the proto files")]
#![allow(clippy::all, reason = "generated code")]
#![allow(clippy::allow_attributes_without_reason, reason = "generated code")]
#![allow(unreachable_pub, reason = "generated code")]
#![allow(dead_code, reason = "generated code")]

/// Package `foxglove`.
pub(super) mod foxglove {
    include!("generated/foxglove.rs");

    /// The encoded `FileDescriptorSet` of the package with what it imports.
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("generated/foxglove.bin");
}

/// Package `covis.recording.v1`.
pub(super) mod figures {
    include!("generated/covis.recording.v1.rs");

    /// The encoded `FileDescriptorSet` of the package with what it imports.
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("generated/covis.recording.v1.bin");
}
