//! `a * b` for every group, by value and by reference: the product of [`LieGroup::compose`].
//!
//! Nothing else is overloaded: `+` and `-` would hide which side an update acts on.

use std::ops::Mul;

use super::{LieGroup, Se2, Se3, Sim3, So2, So3};

macro_rules! multiply_by_composing {
    ($group:ty) => {
        impl Mul<&$group> for &$group {
            type Output = $group;
            #[inline]
            fn mul(self, other: &$group) -> $group {
                self.compose(other)
            }
        }
        impl Mul<$group> for $group {
            type Output = $group;
            #[inline]
            fn mul(self, other: $group) -> $group {
                self.compose(&other)
            }
        }
        impl Mul<&$group> for $group {
            type Output = $group;
            #[inline]
            fn mul(self, other: &$group) -> $group {
                self.compose(other)
            }
        }
        impl Mul<$group> for &$group {
            type Output = $group;
            #[inline]
            fn mul(self, other: $group) -> $group {
                self.compose(&other)
            }
        }
    };
}

multiply_by_composing!(So2);
multiply_by_composing!(Se2);
multiply_by_composing!(So3);
multiply_by_composing!(Se3);
multiply_by_composing!(Sim3);
