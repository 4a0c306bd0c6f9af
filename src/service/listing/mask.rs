//! Read masks: what leaves out of an entity the fields that a request does not name.
//!
//! Which fields an entity has, and what a request without a mask gets, is known to its list.

use prost_types::FieldMask;

use super::super::convert::update::MOST_PATHS;
use super::super::convert::{Path, Violations};
use crate::map::Reason;

/// Leaves a field out of a message.
pub(super) type LeaveOut<M> = fn(&mut M);

/// A field that a mask can name; one that is always returned is left as it is.
pub(super) type Field<M> = (&'static str, LeaveOut<M>);

/// What leaves out the fields that a mask does not name: nothing without a mask.
pub(super) fn left_out<M>(
    mask: Option<&FieldMask>,
    fields: &[Field<M>],
    message: &str,
    out: &mut Violations,
) -> Option<Vec<LeaveOut<M>>> {
    let Some(FieldMask { paths }) = mask else { return Some(Vec::new()) };
    out.at_most(Path::root("read_mask"), paths, MOST_PATHS)?;
    if let Some(unknown) = paths.iter().find(|path| fields.iter().all(|(name, _)| path != name)) {
        let text = format!("{unknown:?} is not a field of {message}");
        return out.report(Path::root("read_mask"), Reason::UnknownValue, text);
    }
    let unnamed = fields.iter().filter(|(name, _)| paths.iter().all(|path| path != name));
    Some(unnamed.map(|(_, leave_out)| *leave_out).collect())
}
