//! Encodes cameras, keyframes and what a lost frame shows as messages.
//! It sends nothing, and knows neither the session nor the map.

use covis_client::wire::v1;
use covis_solvers::geometry::Camera;

use super::messages;
use crate::camera::FrameCamera;
use crate::features::descriptor::Descriptor;
use crate::pipeline::relocalization::Feature;
use crate::tracking::keyframe::{NewKeyframe, NewObservation};

/// The name of the frontend's descriptors, of patches that have one size in the world. Those of earlier
/// versions had one in the image, "covis-brief-256".
const DESCRIPTOR: &str = "covis-brief-256-metric";

/// The camera with its image size.
pub(super) fn camera(id: i64, camera: &FrameCamera) -> v1::Camera {
    let (width, height) = camera.size();
    let size = |pixels: usize| i32::try_from(pixels).unwrap_or(0);
    messages::camera(id, &Camera::from(*camera.model()), (size(width), size(height)))
}

/// A keyframe with its new landmarks and all its observations.
pub(super) fn keyframe(camera_id: i64, keyframe: &NewKeyframe) -> v1::Keyframe {
    let landmarks = keyframe.landmarks.iter().map(|landmark| v1::Landmark {
        id: landmark.id as i64,
        point_in_world: Some(messages::vector3(&landmark.point_in_world)),
        ..v1::Landmark::default()
    });
    let observations = keyframe.observations.iter().map(|observation| {
        let NewObservation { landmark, seen, descriptor } = observation;
        v1::Observation {
            landmark: Some(messages::landmark_ref(*landmark as i64)),
            pixel: Some(messages::vector2(&seen.straight)),
            sigma_px: Some(seen.sigma_px),
            depth_m: seen.depth_m.map(|(z, _)| z),
            sigma_depth_m: seen.depth_m.map(|(_, sigma)| sigma),
            descriptor: descriptor.as_ref().map(self::descriptor),
            ..v1::Observation::default()
        }
    });
    v1::Keyframe {
        id: keyframe.id as i64,
        capture_time: Some(messages::timestamp(keyframe.timestamp_s)),
        sensor: Some(v1::keyframe::Sensor::CameraId(camera_id)),
        world_from_camera: Some(messages::rigid(&keyframe.world_from_camera)),
        odom_from_camera: Some(messages::rigid(&keyframe.odom_from_camera)),
        observations: observations.collect(),
        landmarks: landmarks.collect(),
        ..v1::Keyframe::default()
    }
}

/// What a lost frame shows.
pub(super) fn features(features: &[Feature]) -> Vec<v1::Feature> {
    let feature = |feature: &Feature| {
        let (depth_m, sigma_depth_m) = feature.depth_m;
        v1::Feature {
            pixel: Some(messages::vector2(&feature.pixel)),
            sigma_px: Some(feature.sigma_px),
            depth_m: Some(depth_m),
            sigma_depth_m: Some(sigma_depth_m),
            descriptor: Some(descriptor(&feature.descriptor)),
        }
    };
    features.iter().map(feature).collect()
}

fn descriptor(descriptor: &Descriptor) -> v1::Descriptor {
    v1::Descriptor {
        kind: v1::DescriptorKind::Binary.into(),
        name: DESCRIPTOR.to_owned(),
        data: descriptor.to_bytes().to_vec(),
    }
}
