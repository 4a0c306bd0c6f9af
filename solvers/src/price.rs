//! What a solve takes, estimated from its structure, and the ceiling it is held to.
//!
//! An estimate is an upper bound of the bytes that are allocated at once besides the problem itself,
//! and not far above it: `tests/memory.rs` holds it between the truth and four times that.

use crate::interrupt::Interrupt;

/// What a solve takes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Price {
    /// Most bytes allocated at once, besides the problem.
    pub bytes: u64,
    /// Floating-point operations of one iteration, about.
    pub flops_per_iteration: f64,
}

impl Price {
    /// The same with `bytes` more.
    #[must_use]
    pub fn plus_bytes(self, bytes: u64) -> Self {
        Self { bytes: self.bytes.saturating_add(bytes), ..self }
    }
}

/// What a solve may take; what is absent is not limited.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ceiling {
    /// Most bytes.
    pub bytes: Option<u64>,
    /// Most floating-point operations of one iteration.
    pub flops_per_iteration: Option<f64>,
}

/// The limits of a call: of its estimate before it starts, and of its time.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Work whose estimate exceeds it is not started.
    pub ceiling: Ceiling,
    /// Work that was started ends once this is due.
    pub interrupt: &'a Interrupt,
}

impl Limits<'static> {
    /// No limits.
    pub const NONE: Self = Self { ceiling: Ceiling::NONE, interrupt: &Interrupt::NEVER };
}

impl Limits<'_> {
    /// What is left beside `bytes`.
    #[must_use]
    pub fn less(self, bytes: u64) -> Self {
        Self { ceiling: self.ceiling.less(bytes), ..self }
    }
}

/// What there is too little of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resource {
    /// Memory, in bytes.
    Bytes,
    /// Floating-point operations of one iteration.
    FlopsPerIteration,
}

impl Resource {
    /// So much of it, in words.
    fn with_unit(self, amount: u64) -> String {
        match self {
            Self::Bytes => format!("{amount} bytes"),
            Self::FlopsPerIteration => format!("{} Gflop an iteration", to_gflop(amount)),
        }
    }
}

/// Floating-point operations in units of 1e9, rounded up: above a limit in these units it stays above.
#[must_use]
pub fn to_gflop(flops: u64) -> u64 {
    flops.div_ceil(1_000_000_000)
}

/// A price beyond its ceiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the solve takes an estimated {}, the limit is {}", .resource.with_unit(*.estimate), .resource.with_unit(*.limit))]
pub struct TooExpensive {
    /// What there is too little of.
    pub resource: Resource,
    /// The estimate; where counting ended at the ceiling, at least that.
    pub estimate: u64,
    /// The ceiling.
    pub limit: u64,
}

impl TooExpensive {
    /// The same of the whole, of which `bytes` were left out on both sides.
    #[must_use]
    pub fn beside(self, bytes: u64) -> Self {
        self.with_bytes(|part| part.saturating_add(bytes))
    }

    /// The same of two parts alike, each of which had half the bytes.
    #[must_use]
    pub fn twice(self) -> Self {
        self.with_bytes(|part| part.saturating_mul(2))
    }

    /// With `whole` of estimate and limit, where they are bytes.
    fn with_bytes(self, whole: impl Fn(u64) -> u64) -> Self {
        match self.resource {
            Resource::Bytes => {
                Self { estimate: whole(self.estimate), limit: whole(self.limit), ..self }
            }
            Resource::FlopsPerIteration => self,
        }
    }
}

impl Ceiling {
    /// No limit.
    pub const NONE: Self = Self { bytes: None, flops_per_iteration: None };

    /// Whether `price` stays within the ceiling.
    ///
    /// # Errors
    /// [`TooExpensive`] names the first limit that it passes.
    pub fn admit(&self, price: &Price) -> Result<(), TooExpensive> {
        if let Some(limit) = self.bytes.filter(|&limit| price.bytes > limit) {
            return Err(TooExpensive { resource: Resource::Bytes, estimate: price.bytes, limit });
        }
        let flops = price.flops_per_iteration;
        match self.flops_per_iteration {
            // What cannot be estimated is not admitted.
            Some(limit) if flops.is_nan() || flops > limit => Err(TooExpensive {
                resource: Resource::FlopsPerIteration,
                estimate: flops as u64,
                limit: limit as u64,
            }),
            Some(_) | None => Ok(()),
        }
    }

    /// What is left once `bytes` are taken.
    #[must_use]
    pub fn less(self, bytes: u64) -> Self {
        Self { bytes: self.bytes.map(|limit| limit.saturating_sub(bytes)), ..self }
    }

    /// Whether nothing is limited.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.bytes.is_none() && self.flops_per_iteration.is_none()
    }
}
