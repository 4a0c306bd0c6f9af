//! Edits: what a client sends to change or remove what the map holds already.
//!
//! Each part of an edit is a reference, and may name an entity of any client. References may dangle
//! here: [`Map::check`](super::Map::check) looks them up. Nothing here changes a map.

use super::{CameraEntity, EntityRef};

/// Names what a keyframe sees of a landmark: usually one observation, more where several features
/// match the landmark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sighting {
    /// The keyframe.
    pub keyframe: EntityRef,
    /// The landmark.
    pub landmark: EntityRef,
}

/// An edit as sent.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Removes a constraint or prior.
    RevokeConstraint {
        /// The constraint or prior.
        constraint: EntityRef,
    },
    /// Removes observations.
    RemoveObservations {
        /// At least one, none twice.
        observations: Vec<Sighting>,
    },
    /// Replaces several landmarks by one of them.
    FuseLandmarks {
        /// The landmark that receives the observations.
        kept: EntityRef,
        /// The landmarks that are removed: at least one, none twice, not `kept`.
        absorbed: Vec<EntityRef>,
    },
    /// Removes landmarks with their observations.
    RemoveLandmarks {
        /// At least one, none twice.
        landmarks: Vec<EntityRef>,
    },
    /// Removes a keyframe with its observations, constraints and priors.
    RemoveKeyframe {
        /// The keyframe.
        keyframe: EntityRef,
    },
    /// Replaces the model and the image size of a camera.
    SetCamera {
        /// The camera.
        id: EntityRef,
        /// Its new values.
        camera: CameraEntity,
    },
}

/// The size of an edit that does not name all that it concerns: large.
const UNKNOWN_SIZE: usize = 1 << 16;

impl Edit {
    /// Calls `each` with every reference.
    pub(super) fn references(&mut self, mut each: impl FnMut(&mut EntityRef)) {
        match self {
            Self::RevokeConstraint { constraint: one }
            | Self::RemoveKeyframe { keyframe: one }
            | Self::SetCamera { id: one, .. } => each(one),
            Self::RemoveObservations { observations } => {
                for Sighting { keyframe, landmark } in observations {
                    each(keyframe);
                    each(landmark);
                }
            }
            Self::FuseLandmarks { kept, absorbed } => {
                each(kept);
                absorbed.iter_mut().for_each(each);
            }
            Self::RemoveLandmarks { landmarks } => landmarks.iter_mut().for_each(each),
        }
    }

    /// The camera that it brings.
    pub fn camera(&self) -> Option<&CameraEntity> {
        if let Self::SetCamera { camera, .. } = self { Some(camera) } else { None }
    }

    /// About how many entities its check looks at.
    pub fn size(&self) -> usize {
        match self {
            Self::RevokeConstraint { .. } | Self::RemoveKeyframe { .. } => 1,
            Self::RemoveObservations { observations } => observations.len(),
            Self::FuseLandmarks { absorbed: landmarks, .. }
            | Self::RemoveLandmarks { landmarks } => landmarks.len(),
            // The check projects every observation of the camera.
            Self::SetCamera { .. } => UNKNOWN_SIZE,
        }
    }
}
