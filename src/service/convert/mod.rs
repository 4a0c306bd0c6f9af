//! Wire ↔ domain: the only place that reads or fills generated messages field by field.
//!
//! Inward every function takes the field's [`Path`], reports what is wrong into [`Violations`] and
//! returns `None`; all violations of a message are reported, not only the first. What can be
//! checked without the map is checked here: presence, finite numbers, ranges, units, lengths,
//! definiteness, enum values. Outward conversions cannot fail. No other mathematics, no engine, no
//! status codes.
//!
//! | file | role |
//! |---|---|
//! | `item`, `edit`, `camera` | items of an ingest stream |
//! | `geometry`, `ids`, `time` | values that many messages share |
//! | `map`, `update`, `copy`, `merge`, `entities`, `trajectory` | maps, their changes and their content |
//! | `problem`, `solve` | problems that come with a call; options and certificates |

pub(super) mod camera;
pub(super) mod copy;
mod edit;
pub(super) mod entities;
pub(super) mod geometry;
pub(super) mod ids;
pub(super) mod item;
pub(super) mod map;
pub(super) mod merge;
pub(super) mod problem;
pub(super) mod solve;
pub(super) mod time;
pub(super) mod trajectory;
pub(super) mod update;

#[cfg(test)]
mod tests;

use std::fmt;

use crate::map::{Reason, Rejection};

/// One step of a field path.
#[derive(Clone, Copy, Debug)]
enum Step {
    Field(&'static str),
    Index(usize),
}

/// The path of a field, starting at the request; it is formatted only for a violation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path<'a> {
    parent: Option<&'a Path<'a>>,
    step: Step,
}

impl Path<'static> {
    /// A field of the request itself.
    pub(super) const fn root(field: &'static str) -> Self {
        Self { parent: None, step: Step::Field(field) }
    }
}

impl<'a> Path<'a> {
    /// A field of the message at this path.
    pub(super) fn field(&'a self, name: &'static str) -> Path<'a> {
        Path { parent: Some(self), step: Step::Field(name) }
    }

    /// An entry of the list at this path.
    pub(super) fn index(&'a self, index: usize) -> Path<'a> {
        Path { parent: Some(self), step: Step::Index(index) }
    }
}

impl fmt::Display for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(parent) = self.parent {
            parent.fmt(f)?;
        }
        match self.step {
            Step::Field(name) if self.parent.is_some() => write!(f, ".{name}"),
            Step::Field(name) => f.write_str(name),
            Step::Index(index) => write!(f, "[{index}]"),
        }
    }
}

/// Collects what is wrong with a message.
#[derive(Debug, Default)]
pub(super) struct Violations {
    rejection: Rejection,
    /// Paths of fields that have placeholders.
    unreadable: Vec<String>,
}

impl Violations {
    /// Reports a field and returns `None`, so that a conversion can end with it.
    pub(super) fn report<T>(
        &mut self,
        at: Path<'_>,
        reason: Reason,
        description: impl Into<String>,
    ) -> Option<T> {
        self.rejection.push(at.to_string(), reason, description);
        None
    }

    /// A placeholder for a field that cannot be read, so that the rest can be checked; the
    /// violation of the field is already reported.
    pub(super) fn or<T>(&mut self, at: Path<'_>, value: Option<T>, placeholder: T) -> T {
        value.unwrap_or_else(|| {
            self.unreadable.push(at.to_string());
            placeholder
        })
    }

    /// Reports a required field that is absent or empty.
    pub(super) fn missing<T>(&mut self, at: Path<'_>) -> Option<T> {
        self.report(at, Reason::Missing, "required")
    }

    /// Reports a part of the wire that is not served yet.
    pub(super) fn unimplemented<T>(&mut self, at: Path<'_>) -> Option<T> {
        self.report(at, Reason::Unimplemented, "not served yet")
    }

    /// A message that must be present.
    pub(super) fn required<M>(&mut self, at: Path<'_>, message: Option<M>) -> Option<M> {
        message.or_else(|| self.missing(at))
    }

    /// A list that must not be empty.
    pub(super) fn not_empty<T>(&mut self, at: Path<'_>, list: &[T]) {
        if list.is_empty() {
            let _: Option<()> = self.missing(at);
        }
    }

    /// A list that must not be longer than the server accepts.
    pub(super) fn at_most<T>(&mut self, at: Path<'_>, list: &[T], most: usize) -> Option<()> {
        if list.len() <= most {
            return Some(());
        }
        let text = format!("{} entries, at most {most} are allowed", list.len());
        self.report(at, Reason::TooLarge, text)
    }

    /// A number that must be finite.
    pub(super) fn finite(&mut self, at: Path<'_>, value: f64) -> Option<f64> {
        if value.is_finite() {
            return Some(value);
        }
        self.report(at, Reason::NotFinite, format!("{value} is not finite"))
    }

    /// A number that must be finite and greater than 0.
    pub(super) fn positive(&mut self, at: Path<'_>, value: f64) -> Option<f64> {
        let value = self.finite(at, value)?;
        if value > 0.0 {
            return Some(value);
        }
        self.report(at, Reason::OutOfRange, format!("{value} is not greater than 0"))
    }

    /// The numbers of fields: the first `positive` of them must be greater than 0, all finite.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        at: Path<'_>,
        positive: usize,
        fields: [(&'static str, f64); N],
    ) -> Option<[f64; N]> {
        let mut complete = true;
        for (index, (name, value)) in fields.into_iter().enumerate() {
            let at = at.field(name);
            let read =
                if index < positive { self.positive(at, value) } else { self.finite(at, value) };
            complete &= read.is_some();
        }
        complete.then_some(fields.map(|(_, value)| value))
    }

    /// A number that must be finite and at least 0.
    pub(super) fn not_negative(&mut self, at: Path<'_>, value: f64) -> Option<f64> {
        let value = self.finite(at, value)?;
        if value >= 0.0 {
            return Some(value);
        }
        self.report(at, Reason::OutOfRange, format!("{value} is below 0"))
    }

    /// An integer that must lie in a range, both ends included.
    pub(super) fn within(
        &mut self,
        at: Path<'_>,
        value: impl Into<i64>,
        low: i64,
        high: i64,
    ) -> Option<usize> {
        let value = value.into();
        if (low..=high).contains(&value)
            && let Ok(value) = usize::try_from(value)
        {
            return Some(value);
        }
        self.report(at, Reason::OutOfRange, format!("{value} is not in {low} to {high}"))
    }

    /// A known value of an enum; the unspecified one is returned, and the caller checks it.
    pub(super) fn known<E: TryFrom<i32>>(&mut self, at: Path<'_>, value: i32) -> Option<E> {
        E::try_from(value)
            .ok()
            .or_else(|| self.report(at, Reason::UnknownValue, format!("unknown value {value}")))
    }

    /// The converted message, or everything that is wrong with it.
    fn finish<T>(mut self, value: Option<T>) -> Result<T, Rejection> {
        if value.is_none() && self.rejection.is_empty() {
            // Cannot happen while every `None` is reported; an empty rejection would be useless to
            // the client.
            self.rejection.push("", Reason::Missing, "the message could not be read");
        }
        value.filter(|_| self.rejection.is_empty()).ok_or(self.rejection)
    }
}

/// Runs a conversion and gathers its violations.
pub(super) fn convert<T>(
    conversion: impl FnOnce(&mut Violations) -> Option<T>,
) -> Result<T, Rejection> {
    let mut out = Violations::default();
    let value = conversion(&mut out);
    out.finish(value)
}

/// Converts a whole list or nothing, and reports the violations of every entry.
pub(super) fn all<M, T>(
    at: Path<'_>,
    messages: impl IntoIterator<Item = M, IntoIter: ExactSizeIterator>,
    out: &mut Violations,
    mut one: impl FnMut(Path<'_>, M, &mut Violations) -> Option<T>,
) -> Option<Vec<T>> {
    let messages = messages.into_iter();
    let mut values = Vec::with_capacity(messages.len());
    let mut complete = true;
    for (index, message) in messages.enumerate() {
        match one(at.index(index), message, out) {
            Some(value) => values.push(value),
            None => complete = false,
        }
    }
    complete.then_some(values)
}

/// A count in the wire's type.
pub(super) fn count(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// A small count in the wire's type.
pub(super) fn small(value: usize) -> i32 {
    i32::try_from(value).unwrap_or(i32::MAX)
}
