//! A problem that a system works on: borrowed for one solve, or owned by a worker between requests.
//!
//! It adds no check and makes no copy.

use std::ops::{Deref, DerefMut};

use crate::problem::BundleProblem;

/// The problem of a system: the caller's, or its own.
pub(super) enum MaybeOwned<'a> {
    Borrowed(&'a mut BundleProblem),
    Owned(Box<BundleProblem>),
}

impl Deref for MaybeOwned<'_> {
    type Target = BundleProblem;

    fn deref(&self) -> &BundleProblem {
        match self {
            Self::Borrowed(problem) => problem,
            Self::Owned(problem) => problem,
        }
    }
}

impl DerefMut for MaybeOwned<'_> {
    fn deref_mut(&mut self) -> &mut BundleProblem {
        match self {
            Self::Borrowed(problem) => problem,
            Self::Owned(problem) => problem,
        }
    }
}
