//! Why an item was refused: fields by their path from the request, with a reason for programs.
//!
//! Paths use the wire's field names, for instance `keyframe.observations[3].pixel.x`, so that a
//! client finds what it sent. Conversion from the wire reports through the same type. Statuses and acks
//! are made from it elsewhere.

use std::fmt;

/// Most violations that are reported for one item; the first ones are the useful ones.
const MAX_VIOLATIONS: usize = 32;

/// What is wrong with a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// A required field is absent or empty.
    Missing,
    /// A number is NaN or infinite.
    NotFinite,
    /// A number or string is outside its range.
    OutOfRange,
    /// A quaternion's norm is not within 1e-3 of 1.
    NotNormalized,
    /// A matrix is not positive definite.
    NotPositiveDefinite,
    /// A list has the wrong length.
    WrongLength,
    /// A reference names nothing that the map holds.
    UnknownReference,
    /// The id is taken by an entity with other content, or the sequence by another item.
    AlreadyExists,
    /// The same thing occurs twice within the item, or is observed already.
    Duplicate,
    /// A point has no finite projection.
    ProjectionNotFinite,
    /// Fields contradict each other.
    Inconsistent,
    /// An enum value that this server does not know.
    UnknownValue,
    /// Part of the wire, not served yet.
    Unimplemented,
    /// More than the server takes in one item.
    TooLarge,
}

/// What is wrong with one field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldViolation {
    /// Path from the request.
    pub field: String,
    /// For programs.
    pub reason: Reason,
    /// For people.
    pub description: String,
}

/// An item that was refused and changed nothing.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Rejection {
    /// What is wrong; at most 32 are reported.
    pub violations: Vec<FieldViolation>,
}

impl Rejection {
    /// A rejection for one field.
    #[must_use]
    pub fn of(field: impl Into<String>, reason: Reason, description: impl Into<String>) -> Self {
        let (field, description) = (field.into(), description.into());
        Self { violations: vec![FieldViolation { field, reason, description }] }
    }

    /// Adds a violation, unless 32 are reported already.
    pub fn push(
        &mut self,
        field: impl Into<String>,
        reason: Reason,
        description: impl Into<String>,
    ) {
        if self.violations.len() < MAX_VIOLATIONS {
            let (field, description) = (field.into(), description.into());
            self.violations.push(FieldViolation { field, reason, description });
        }
    }

    /// Adds further violations, except for fields that are reported already and for those that follow
    /// from fields that could not be read.
    pub fn join(&mut self, more: Self, unreadable: &[String]) {
        let known: Vec<String> = self.violations.iter().map(|v| v.field.clone()).collect();
        for violation in more.violations {
            let within = |field: &String| is_within(&violation.field, field);
            if !unreadable.iter().any(within) && !known.iter().any(within) {
                self.push(violation.field, violation.reason, violation.description);
            }
        }
    }

    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.violations.is_empty()
    }
}

/// Whether `field` is `whole` or a part of it.
fn is_within(field: &str, whole: &str) -> bool {
    let rest = field.strip_prefix(whole);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, violation) in self.violations.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(f, "{separator}{}: {}", violation.field, violation.description)?;
        }
        Ok(())
    }
}

impl std::error::Error for Rejection {}
