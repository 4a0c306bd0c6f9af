//! Checks of single fields, each adding a violation under the field's path.
//!
//! Paths are the wire's names, written out only where there is a violation: most items have none. A
//! check never stops at the first violation and changes nothing.

use std::fmt::Display;

use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::information::InformationError;
use nalgebra::Vector3;

use super::super::{Reason, Rejection};

/// Collects violations.
#[derive(Default)]
pub(super) struct Fields {
    pub(super) rejection: Rejection,
}

impl Fields {
    pub(super) fn add(
        &mut self,
        field: impl Display,
        reason: Reason,
        description: impl Into<String>,
    ) {
        self.rejection.push(field.to_string(), reason, description);
    }

    pub(super) fn finite(&mut self, field: impl Display, value: f64) -> bool {
        if !value.is_finite() {
            self.add(field, Reason::NotFinite, format!("{value} is not finite"));
        }
        value.is_finite()
    }

    pub(super) fn positive(&mut self, field: impl Display, value: f64) {
        if self.finite(&field, value) && value <= 0.0 {
            self.add(field, Reason::OutOfRange, format!("{value} is not positive"));
        }
    }

    pub(super) fn vector(&mut self, path: impl Display, vector: &Vector3<f64>) {
        for (name, value) in ["x", "y", "z"].into_iter().zip(vector.iter()) {
            self.finite(format_args!("{path}.{name}"), *value);
        }
    }

    pub(super) fn pose(&mut self, path: &str, pose: &Se3) {
        self.vector(format_args!("{path}.translation"), &pose.translation);
        let q = &pose.rotation.quaternion().coords;
        for (name, value) in ["x", "y", "z", "w"].into_iter().zip(q.iter()) {
            self.finite(format_args!("{path}.rotation.{name}"), *value);
        }
    }

    pub(super) fn not_empty(&mut self, path: &str, length: usize) {
        if length == 0 {
            self.add(path, Reason::Missing, "at least one is needed");
        }
    }

    pub(super) fn information(&mut self, path: &str, error: &InformationError) {
        let reason = match error {
            InformationError::NotFinite { .. } => Reason::NotFinite,
            InformationError::NotSymmetric { .. } => Reason::Inconsistent,
            InformationError::NotPositiveDefinite | InformationError::Indefinite { .. } => {
                Reason::NotPositiveDefinite
            }
        };
        self.add(path, reason, error.to_string());
    }

    /// Every parameter finite, focal lengths positive.
    pub(super) fn camera(&mut self, camera: &Camera) {
        let (model, names, focal_lengths): (_, &[&str], usize) = match camera {
            Camera::Pinhole(_) => (
                "pinhole_radial_tangential",
                &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"],
                2,
            ),
            Camera::Fisheye(_) => {
                ("kannala_brandt", &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"], 2)
            }
            Camera::Snavely(_) => ("snavely", &["focal", "k1", "k2"], 1),
        };
        let parameters = camera.parameters();
        for (index, (name, value)) in names.iter().zip(parameters.as_slice()).enumerate() {
            let field = format_args!("camera.{model}.{name}");
            if index < focal_lengths {
                self.positive(field, *value);
            } else {
                self.finite(field, *value);
            }
        }
    }
}
